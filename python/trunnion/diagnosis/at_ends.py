"""Parameters that stand at the end of what is looked for: what that says of sizes beside them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trunnion.base.report import rough
from trunnion.base.units import parameter_words, unit_of
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.records import labelled, with_unit

AT_END = 1e-6  # of the end, from which on a parameter stands there


def notes_at_ends(case: Case, f: Fit, variance: float) -> Iterator[str]:
    """Say of which effects of a fit a parameter is held at its end, where it has no standard error.

    Standard errors of the sizes beside it are those of a parameter that is known. What does not
    change with the parameter (a moment between two readings) is another matter.
    """
    for effect in case.effects:
        if effect.id not in f.effects:
            continue
        std, columns = case.std(effect, f, variance), f.jacobian[:, case.columns_of(effect, f)]
        sizes = " and ".join(parameter_words(p.name) for p in effect.parameters if p.linear)
        for i, p in enumerate(effect.parameters):
            value = f.effects[effect.id][p.name]
            lowest, highest = np.isclose(value, p.bounds, rtol=AT_END, atol=0.0)
            held = (lowest or highest) and np.isinf(std[i]) and columns[:, i].any()
            if p.linear or not held:
                continue
            said, end = (
                with_unit(rough(value, 3), unit_of(p.name)),
                "lowest" if lowest else "highest",
            )
            yield (
                f"{labelled(effect.id, effect.label)}: the readings do not determine "
                f"{parameter_words(p.name)}, which stands at {said}, the {end} value that is "
                f"looked for. {sizes} with the standard error holds for this value only: what "
                "the readings determine is the change, and not its size and shape apart."
            )
