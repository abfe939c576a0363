"""What a diagnosis leaves of the readings, for one that has further measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.explanation import Explanation
from trunnion.diagnosis.in_steps import as_read
from trunnion.diagnosis.linearised import Linearised
from trunnion.diagnosis.remaining import unexplained
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.structure import with_structure
from trunnion.diagnosis.whitening import Whiten


@dataclass(frozen=True, eq=False)
class Left:
    """What a diagnosis leaves of the readings: all that one of several measurements asks of it.

    before, after: Reading minus prediction of the plain and of the extended model, (n,).
    rows: Data row of each reading, (n,).
    outliers: Data rows that were set aside, in order.
    parameters: Count of those of the named causes.
    unexplained: Structure that no cause makes, in words.
    linearised: The candidates at the plain fit of all readings.
    whiten: What made the noise of all readings white; None: some are left out, or it is not known.
    dictionary: Structure without a name in all readings, if it was looked for there.
    exact: Whether they have no noise.
    assumed: Variance of a white reading that the causes of exact ones were searched with.
    """

    before: Floats
    after: Floats
    rows: Integers
    outliers: tuple[int, ...]
    parameters: int
    unexplained: str | None
    linearised: Linearised | None = None
    whiten: Whiten | None = None
    dictionary: Dictionary | None = None
    exact: bool = False
    assumed: float = 0.0

    @classmethod
    def of(cls, found: Diagnosis) -> Left | None:
        """Return that of a diagnosis; None: it has no residuals."""
        r = found.residuals
        if r is None:
            return None
        count = sum(len(c.parameters) for c in found.causes)
        return cls(r.before, r.after, r.rows, found.outliers, count, found.unexplained)


def left_of(case: Case, e: Explanation, dropped: Integers) -> Left:
    """Return what an explanation leaves: the same as its report says."""
    kept, model = case.without(dropped), case.model
    said = unexplained(kept, e)
    named = e.fit if e.sets else kept.plain
    kept, f, _ = with_structure(kept, e.terms, named)
    f = as_read(kept, f)[0]
    rows = np.asarray(model.readings.rows)
    return Left(
        (case.given or as_read(case, case.plain)[0]).residuals,
        f.residuals,
        rows,
        tuple(sorted({int(r) for r in rows[dropped]})),
        sum(len(values) for values in named.effects.values()),
        said,
        case.linearised,
        None if len(dropped) else case.whiten,
        case.searched_for,
        exact=e.assumed > 0 or kept.exact(f),
        assumed=e.assumed,
    )
