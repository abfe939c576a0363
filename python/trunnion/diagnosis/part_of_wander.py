"""Effects that are a part of a wander: which of a fit are not demanded beside it.

The size and the length of a wander (:mod:`.wander`) are taken beside all effects of its channel,
and what an effect explains of it is missing there. So an effect is asked for against the wander
that would be there without it.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.noise import Whitener
from trunnion.diagnosis.wander import deviance, fit_wander


def part_of_wander(case: Case, f: Fit) -> set[int]:
    """Effect of a fit that is a part of a wander, the least demanded; none where all are demanded.

    It makes more of the readings that wander than it explains, or explains next to nothing beside
    the wander without it. Asked of effects on nothing else: of others, what is seen elsewhere is
    evidence.
    """
    margin: dict[int, float] = {}
    for segments in _channels(case):
        rows = case.rows[np.concatenate(segments)]
        elsewhere = np.delete(f.jacobian, rows, axis=0)
        left, before = f.residuals[rows], case.plain.residuals[rows]
        for j, effect in enumerate(case.effects):
            at = case.columns_of(effect, f) if effect.id in f.effects else []
            if not at or np.any(elsewhere[:, at]):
                continue
            own = left + np.asarray(effect.change(Values(f.effects[effect.id])))[rows]
            worse = float(left @ left) > max(float(before @ before), float(own @ own))
            paid = float(np.min(case.candidates.penalty[case.candidates.owner == j]))
            margin[j] = -np.inf if worse else _gain(before, f.jacobian[rows], at, segments) - paid
    worst = min(margin, key=lambda j: margin[j], default=None)
    return set() if worst is None or margin[worst] > 0 else {worst}


def _channels(case: Case) -> Iterable[list[Integers]]:
    """Of each channel that wanders, its used readings in a row."""
    if not isinstance(case.whiten, Whitener):
        return []
    every = case.segments
    by_noise: dict[int, list[Integers]] = {}  # that of a channel is one
    for i in case.whiten.wandering:
        by_noise.setdefault(id(case.whiten.filters[i][1]), []).append(every[i])
    return by_noise.values()


def _gain(y: Floats, columns: Floats, at: Sequence[int], segments: Sequence[Integers]) -> float:
    """Drop of -2 ln L of readings y by some of the columns (n, k), beside the wander without them.

    A wander fitted beside a wave of a long pitch is smaller: with it the wave would be asked for.
    """
    ends = np.cumsum([0, *map(len, segments)])
    own = [np.arange(first, last) for first, last in pairwise(ends)]

    def basis(q: Floats) -> Floats:
        return np.linalg.qr(q[:, np.any(q != 0, axis=0)])[0]

    without = basis(np.delete(columns, at, axis=1))
    noise = fit_wander(y, without, own).noise
    return deviance(noise, y, without, own) - deviance(noise, y, basis(columns), own)
