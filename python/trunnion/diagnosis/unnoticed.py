"""Causes that readings would not show: how much of one can stay, and when that is most of them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.effect import Effect
from trunnion.diagnosis.fit import ABSORBED_SHARE, Fit, first_values
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.records import labelled, with_unit
from trunnion.machine.unnoticed import (
    BesideFit,
    large,
    noticed_with,
    unnoticed,
    unnoticed_if_large,
)

MOST = 0.5
"""Share of the causes looked for, beyond which more stay unnoticed than could be found."""
READINGS_A_CAUSE = 10
"""Of more readings, what stays unnoticed is for want of other places, not of readings."""
MAX_MISSED = 5


@dataclass(frozen=True)
class Others:
    """Linear effects beside a fit. noticed: Standard errors from which one is noticed."""

    beside: BesideFit
    noticed: float

    @classmethod
    def of(cls, case: Case, f: Fit, variance: float) -> Others | None:
        """Return those beside a fit; None where there are none, or readings without noise."""
        others = [e for e in case.effects if e.linear and e.id not in f.effects]
        if not others or variance <= 0:
            return None
        columns = _Columns(case, f.nuisance, variance, others)
        jacobian = case.white_jacobian(f) / np.sqrt(variance)
        noticed = noticed_with(np.inf if variance == case.floor.variance else f.dof - 1)
        return cls(BesideFit.of(jacobian, f.covariance * variance, columns), noticed)


class _Columns(Mapping[str, Floats]):
    """Derivative of the readings by each parameter over their noise, of one effect at a time."""

    def __init__(
        self, case: Case, nuisance: Floats, variance: float, effects: list[Effect]
    ) -> None:
        self._case, self._nuisance, self._noise = case, nuisance, np.sqrt(variance)
        names = [[f"{e.id}.{p.name}" for p in e.parameters] for e in effects]
        self._of = {name: e for e, own in zip(effects, names, strict=True) for name in own}
        self._made: dict[str, Floats] = {}

    def __getitem__(self, name: str) -> Floats:
        """Columns are made in the order in which they are iterated."""
        if name not in self._made:
            effect, variant = self._of[name], first_values(self._of[name])
            case = self._case
            x = case.model.white_columns(self._nuisance, effect, [variant], case.whiten)[0]
            white = x[case.rows] / self._noise
            names = (f"{effect.id}.{p.name}" for p in effect.parameters)
            self._made = dict(zip(names, white.T, strict=True))
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._of)

    def __len__(self) -> int:
        return len(self._of)


def unnoticed_of(
    case: Case, f: Fit, std: dict[str, float], others: Others | None, lost: Collection[str]
) -> dict[str, str]:
    """Effects beside a fit that may be there unnoticed, and what they would do to an error.

    lost: Those that are absorbed, of which that is said.
    """
    if others is None or not std:
        return {}
    names = names_of(case.model, f)
    return unnoticed(others.beside, names, std, ABSORBED_SHARE, others.noticed, lost)


def is_small(case: Case) -> bool:
    """Whether there are few readings for the causes looked for."""
    return len(case.model.readings) <= READINGS_A_CAUSE * len(case.effects)


def too_little(case: Case, others: Others | None) -> str | None:
    """Say that most causes would stay unnoticed even if they were large, if so."""
    if others is None or not is_small(case):
        return None
    ids = unnoticed_if_large(others.beside, ABSORBED_SHARE, others.noticed)
    looked_for = [e for e in case.effects if e.linear]
    if len(ids) <= MOST * len(looked_for):
        return None
    missed = [e for e in looked_for if e.id in ids]
    units = dict.fromkeys(p.unit for e in missed for p in e.parameters if p.unit)
    sizes = ", ".join(with_unit(f"{large(unit):g}", unit) for unit in units)
    named = ", ".join(labelled(e.id, e.label) for e in missed[:MAX_MISSED])
    more = f" and {len(missed) - MAX_MISSED} more" if len(missed) > MAX_MISSED else ""
    return (
        f"Too little is measured to say which causes act: {len(ids)} of {len(looked_for)} would "
        f"stay unnoticed even at {sizes}: {named}{more}."
    )


def names_of(model: Model, f: Fit) -> tuple[str, ...]:
    """Names of all parameters of a fit."""
    return (*(x.name for x in model.nuisance), *(f"{i}.{name}" for i, name in f.names))
