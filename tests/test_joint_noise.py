"""Measurements of one machine of different noise, which nobody states."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import axis

QUIET_UM, LOUD_UM = 0.3, 1.5
BACKLASH_UM = 0.6


def run(rng: np.random.Generator, noise: float) -> tn.Positioning:
    data = axis(rng, noise=noise)
    return data.with_columns(
        measured_mm=data.measured - 0.5e-3 * BACKLASH_UM * data.direction, axis=["X"] * len(data)
    )


@pytest.mark.parametrize("order", [1, -1])
def test_each_measurement_weighs_by_its_own_noise(order: int) -> None:
    """Of one noise for all, backlash would have 2.6 times the standard error."""
    off, stated = [], []
    for seed in range(8):
        rng = np.random.default_rng([105, seed])
        runs = [run(rng, QUIET_UM), run(rng, LOUD_UM)]
        d = tn.diagnose(runs[::order])
        # A loud first run may not say whether the backlash was there before the second.
        (name,) = (cause.id for cause in d.causes)
        assert name == "backlash_x" or (order < 0 and name.endswith(":change_backlash_x")), seed
        (found,), (std,) = d.causes[0].parameters.values(), d.causes[0].std_errors.values()
        off.append(abs(found) - BACKLASH_UM)
        stated.append(std)
    # a backlash is twice what a reading is off, and the loud run adds a twenty-fifth
    best = 2 / np.sqrt(len(runs[0]) * (QUIET_UM**-2 + LOUD_UM**-2))
    assert np.median(stated) == pytest.approx(best, rel=0.1)
    assert np.sqrt(np.mean(np.square(off))) < 1.5 * best
