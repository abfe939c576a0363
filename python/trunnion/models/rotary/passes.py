"""Whether one axis can explain a sweep: at one angle a target is at one place, pass after pass."""

from __future__ import annotations

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.units import Floats, Integers

MIN_ROWS_OF_A_PASS = 20
MAX_DIFFERENCE_UM = 100.0
"""Between passes, once shift, drift and backlash are taken off; no rotary axis is worse."""
MAX_RATIO = 20.0
"""The same in multiples of the scatter between neighbouring rows."""


def check_one_axis(angle_deg: Floats, away_um: Floats, target: Integers) -> None:
    """Refuse a sweep whose passes there and back differ as no axis with these targets does.

    angle_deg: Commanded positions in the order of measurement, (n,).
    away_um: Distance from the plain circle, radial, tangential, axial, (n, 3).
    target: Number of the target of each row, (n,).

    Raises DataError: a second axis, or something else, moved.
    """
    for k in np.unique(target):
        mine = target == k
        found = _difference(angle_deg[mine], away_um[mine])
        if found is None:
            continue
        size, scatter = found
        if size > MAX_DIFFERENCE_UM and size > MAX_RATIO * scatter:
            raise DataError(
                f"sweep: got places that differ by {1e-3 * size:.3g} mm rms between the ways there "
                f"and back at the same angle (neighbouring rows scatter by {scatter:.2g} µm), "
                "expected one axis: one axis does not explain it. A second rotation is in the "
                "data, or the target or the instrument moved"
            )


def _difference(angle: Floats, away: Floats) -> tuple[float, float] | None:
    """Return rms difference of the longest passes of both senses and the scatter, µm."""
    sense = np.sign(np.diff(angle, prepend=angle[0]))
    up, down = sense > 0, sense < 0
    if min(up.sum(), down.sum()) < MIN_ROWS_OF_A_PASS:
        return None
    low = max(angle[up].min(), angle[down].min())
    high = min(angle[up].max(), angle[down].max())
    there = up & (angle > low) & (angle < high)
    if there.sum() < MIN_ROWS_OF_A_PASS:
        return None
    back = np.argsort(angle[down], kind="stable")
    x, y = angle[down][back], away[down][back]
    gap = away[there] - np.stack([np.interp(angle[there], x, c) for c in y.T], axis=1)
    # a shift and a drift of the whole are three waves once a turn; backlash is tangential
    turn = np.radians(angle[there])
    order = np.linspace(-1.0, 1.0, len(turn))
    waves = np.column_stack([np.ones(len(turn)), np.cos(turn), np.sin(turn)])
    design = np.concatenate([waves, waves * order[:, None]], axis=1)
    left = gap - design @ np.linalg.lstsq(design, gap, rcond=None)[0]
    steps = np.diff(away, n=2, axis=0) / np.sqrt(6.0)
    return float(np.sqrt(np.mean(left**2))), float(1.4826 * np.median(np.abs(steps)))
