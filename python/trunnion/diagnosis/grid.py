"""The best place on a grid, found between its points."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from trunnion.base.units import Floats

MAX_CELLS = 8
POINTS = 9  # that are tried at once, between the neighbours of the best of the last ones
CLOSE = 1e-3  # of the value, points of which three show the peak


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
    middle = float(np.log(best))
    return float(np.exp(_peak(lambda logs: gains(np.exp(logs)), middle - width, middle + width)))


def _peak(gains: Callable[[Floats], Floats], low: float, high: float) -> float:
    """Return where a gain with one peak is largest: points closer and closer, then a parabola."""
    while True:
        points = np.linspace(low, high, POINTS)
        found = gains(points)
        middle = int(np.clip(np.argmax(found), 1, POINTS - 2))
        low, at, high = points[middle - 1 : middle + 2].tolist()
        if high - at <= CLOSE:
            break
    before, top, after = found[middle - 1 : middle + 2].tolist()
    curved = 2.0 * top - before - after
    off = (after - before) / (2.0 * curved) if curved > 0.0 else 0.0
    return float(at + np.clip(off, -1.0, 1.0) * (high - at))
