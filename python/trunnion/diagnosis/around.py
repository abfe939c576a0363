"""Where an effect with some nonlinear parameters explains most, from a place of its grid on.

By Gauss-Newton steps: at a peak of one parameter alone (:mod:`.along`) another one of the others
may explain more.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.effect import Effect, Values
from trunnion.diagnosis.gains import gains_beside

if TYPE_CHECKING:
    from trunnion.diagnosis.along import Beside
    from trunnion.diagnosis.case import Case

STEPS = 6
HALVES = 3  # of a step that explains less
ABOVE = 2.0  # times what slopes promise, that a step may gain
MIN_SHARE = 1e-4  # of the gain, by which a further step is worth it


def best_around(
    case: Case, effect: Effect, beside: Beside, start: Values, enough: Callable[[float], bool]
) -> tuple[float, Values]:
    """Most that an effect gains beside others about a place, within its bounds; and where.

    The gain is the drop of the sum of squares; linear parameters of the place are 0. ``enough``:
    whether a gain matters; where none is in reach, no place is sought.
    """
    free = [i for i, p in enumerate(effect.parameters) if not p.linear]
    low, high = np.array([effect.parameters[i].bounds for i in free]).T
    flat = [i for i, p in enumerate(effect.parameters) if p.linear]
    basis = beside.directions

    def gain(place: Floats) -> float:
        made = case.model.white_columns(beside.nuisance, effect, [values(place)], case.whiten)
        return float(gains_beside(made[:, case.rows], basis, beside.residual)[0])

    def values(place: Floats, sizes: Floats | None = None) -> Values:
        every = np.zeros(len(effect.parameters))
        every[free], every[flat] = place, 0.0 if sizes is None else sizes
        return effect.values(every.tolist())

    def slopes(at: Values) -> Floats:
        made = case.model.effect_jacobian(beside.nuisance, effect, at)
        white = np.asarray(case.whiten(made))[case.rows]
        return np.asarray(white - basis @ (basis.T @ white))

    place = np.array([start[effect.parameters[i].name] for i in free])
    most = gain(place)
    for _ in range(STEPS):
        own = slopes(values(place))[:, flat]
        sizes = np.asarray(np.linalg.lstsq(own, beside.residual, rcond=None)[0])
        every = slopes(values(place, sizes))
        if not np.isfinite(every).all():  # nothing is left of the effect beside the others
            break
        full = np.linalg.lstsq(every, beside.residual, rcond=None)[0]
        left, step = beside.residual - every @ full, full[free]
        if not enough(most + ABOVE * (beside.rss - float(left @ left) - most)):
            break
        tried = [np.clip(place + step / 2**k, low, high) for k in range(HALVES)]
        better = next(((g, x) for x in tried if (g := gain(x)) > most), None)
        if better is None:
            break
        grown, (most, place) = better[0] - most, better
        if grown < MIN_SHARE * most:
            break
    return most, values(place)
