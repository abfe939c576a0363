"""An error of more waves a turn than causes have is seen where positions are on a grid."""

import numpy as np
import pytest

import trunnion as tn

STEP_DEG = 10.0


def swept(seed: int, waves: int, size_um: float) -> tn.Sweep:
    """Two targets at every 10°; the axis moves along itself, so many times a turn."""
    rng = np.random.default_rng([63, seed])
    turn = np.arange(0.0, 360.0, STEP_DEG)
    angle, target = np.tile(turn, 2), np.repeat([1, 2], len(turn))
    radius, height = np.where(target == 1, 100.0, 60.0), np.where(target == 1, 0.0, 50.0)
    at = np.radians(angle + np.where(target == 1, 0.0, 90.0))
    along = 1e-3 * size_um * np.cos(waves * np.radians(angle) + seed)
    place = np.stack([radius * np.cos(at), radius * np.sin(at), height + along], axis=1)
    place += 2e-4 * rng.standard_normal(place.shape)
    columns = dict(zip(("x_mm", "y_mm", "z_mm"), place.T, strict=True))
    return tn.Sweep({"angle_deg": angle, "target": target} | columns)


@pytest.mark.parametrize("waves", [9, 11, 13, 17])
def test_more_waves_than_causes_have_are_unexplained(waves: int) -> None:
    for seed in range(3):
        d = tn.diagnose(swept(seed, waves, 2.0))
        assert d.verdict == "unexplained"
        assert f"{waves}th harmonic" in (d.unexplained or "")


def test_noise_has_no_waves() -> None:
    found = [tn.diagnose(swept(seed, 9, 0.0)).verdict for seed in range(12)]
    assert found.count("consistent") >= 11
