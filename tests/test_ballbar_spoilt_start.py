"""A recording that begins before the machine has come to its feed: its first readings are bad ones.

They were a slip of the ball (> 99 %), of a size that nothing determined.
"""

import numpy as np
import pytest

import trunnion as tn

RADIUS_MM, COUNT, FEED_MM_S = 150.0, 720, 30.0


def spoilt(seed: int, size_um: float, length_s: float) -> tn.Ballbar:
    """Two runs with a backlash of Y; the first second or so of the record rings off."""
    rng = np.random.default_rng(seed)
    turn = 2 * np.pi * (np.arange(COUNT) + 0.5) / COUNT
    angle, sense = np.r_[turn, -turn], np.repeat([1, -1], COUNT)
    time = np.r_[turn, turn + 2 * np.pi + 1.0] * RADIUS_MM / FEED_MM_S
    x, y = RADIUS_MM * np.cos(angle), RADIUS_MM * np.sin(angle)
    way = np.sign(np.cos(angle)) * sense
    length = np.hypot(x + 4e-3, y - 0.5e-3 * 2.5 * way - 3e-3)
    ringing = size_um * np.exp(-time / length_s) * np.cos(2 * np.pi * 6.0 * time)
    length += 1e-3 * (ringing + 0.1 * rng.standard_normal(2 * COUNT))
    columns = {"setup": np.ones(2 * COUNT), "x_mm": x, "y_mm": y, "sense": sense}
    return tn.Ballbar(columns | {"length_mm": np.round(length, 5), "time_s": time})


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("size_um", "length_s"), [(3.0, 0.15), (6.0, 0.3)])
def test_bad_readings_at_the_start_are_no_slip(seed: int, size_um: float, length_s: float) -> None:
    d = tn.diagnose(spoilt(seed, size_um, length_s))
    sure = {c.id for c in d.causes if c.probability > 0.9}
    assert "backlash_y" in sure
    assert "setup_shift" not in {c.id for c in d.causes}
