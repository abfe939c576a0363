"""The best place on a grid, found between its points."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import optimize

from trunnion.base.units import Floats

MAX_CELLS = 8


def best_place(gains: Callable[[Floats], Floats], grid: Sequence[float]) -> float:
    """Return the positive value at which a gain is largest.

    The grid is close enough to find the valley; the best cells are divided first, since the best
    of them may look worse than a side lobe until it is. Then one variable is searched for in the
    best of these.

    gains: What a fit at each of several values explains.
    grid: Values in ascending order, all above zero.
    """
    points = np.asarray(grid, dtype=np.float64)
    at_points = gains(points)
    cells = np.argsort(-at_points)[:MAX_CELLS]
    between = np.unique(
        [
            points[c] ** (1 - t) * points[d] ** t
            for c in cells
            for d in (max(c - 1, 0), min(c + 1, len(points) - 1))
            for t in (0.25, 0.5)
            if c != d
        ]
    )
    best = points[cells[0]]
    if len(between) and (further := gains(between)).max() > at_points.max():
        best = between[int(np.argmax(further))]
    cell = int(np.clip(np.searchsorted(points, best), 1, len(points) - 1))
    width = 0.3 * float(np.log(points[cell] / points[cell - 1]))
    low, high = best * np.exp(-width), best * np.exp(width)
    found = optimize.minimize_scalar(
        lambda log: -float(gains(np.exp([log]))[0]),
        bounds=(float(np.log(low)), float(np.log(high))),
        method="bounded",
        options={"xatol": 1e-5},
    )
    return float(np.exp(found.x))
