"""Places between those of a grid, at which a large candidate explains more.

A grid of time constants is close enough for a cause of a few times the noise. What is left of one
of a hundred times the noise at the nearest place of the grid looks like outliers, or like further
causes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats
from trunnion.diagnosis.effect import Effect, Parameter, Values
from trunnion.diagnosis.gains import gains_beside
from trunnion.diagnosis.grid import best_place
from trunnion.diagnosis.linearised import affine

if TYPE_CHECKING:
    from trunnion.diagnosis.candidates import Candidates
    from trunnion.diagnosis.case import Case

LOST = 0.5  # of -2 ln L, that a grid may lose of what a candidate explains by itself
TINY = 1e-300


def nearer(case: Case, c: Candidates) -> dict[int, Values]:
    """Places of candidates that their grids miss, by the candidate's number; linear values 0.

    ``c``: the candidates of the case at the places of their grids.
    """
    r = case.plain.white
    if len(r) >= MANY_ROWS or case.dependent:
        return {}
    found: dict[int, Values] = {}
    gains = c.gains(r)
    seen = _lost(case, 0.0, gains) > c.chance
    for j in np.unique(c.owner[seen]).tolist():
        effect = case.effects[j]
        free = [p for p in effect.parameters if not p.linear]
        blocks = np.flatnonzero(c.owner == j)
        if len(free) != 1 or len(blocks) < 3 or affine(effect):
            continue
        values = [case.values[j][v] for v in c.variant[blocks]]
        own = gains[blocks]
        best = int(np.argmax(own))
        around = (values[max(best - 1, 0)], values[best], values[min(best + 1, len(own) - 1)])
        if min(v[free[0].name] for v in around) <= 0.0:  # no time, no length
            continue
        if _lost(case, own[best], _peak(own, best)) > LOST:
            gain, there = _best(case, effect, free[0], around)
            if _lost(case, own[best], gain) > LOST:
                found[j] = there
    return found


def _lost(case: Case, at: float, most: Floats | float) -> Floats:
    """-2 ln L of a gain above that of the most that can be gained."""
    rss, dof, deviance = case.plain.rss, case.plain.dof, case.floor.deviance
    left = np.maximum(rss - np.asarray(most), TINY)
    return np.asarray(deviance(max(rss - at, TINY), dof) - deviance(left, dof))


def _peak(gains: Floats, best: int) -> float:
    """Most of a parabola about the best of some gains; at an end as much more as to its inside."""
    at = float(gains[best])
    if best in (0, len(gains) - 1):
        return at + abs(at - float(gains[1 if best == 0 else -2]))
    before, after = float(gains[best - 1]), float(gains[best + 1])
    curved = 2 * at - before - after
    return at + (after - before) ** 2 / (8 * curved) if curved > 0 else at


def _best(
    case: Case, effect: Effect, free: Parameter, around: tuple[Values, Values, Values]
) -> tuple[float, Values]:
    """Most gain between the neighbours of a place, or a step beyond the last; and where."""
    low, at, high = sorted(v[free.name] for v in around)
    low, high = (at**2 / high if low == at else low), (at**2 / low if high == at else high)
    plain = case.plain

    def values(place: float) -> Values:
        return Values({**around[1], free.name: float(np.clip(place, *free.bounds))})

    def gains(places: Floats) -> Floats:
        every = [values(place) for place in places.tolist()]
        white = case.model.white_columns(plain.nuisance, effect, every, case.whiten)
        return gains_beside(white[:, case.rows], plain.basis, plain.white)

    there = best_place(gains, (low, at, high))
    return float(gains(np.array([there]))[0]), values(there)
