"""An error of more waves a turn than causes have is seen where positions are on a grid."""

import numpy as np
import pytest

import trunnion as tn
from trunnion.models.kinds import model_of

STEP_DEG = 10.0


def swept(
    seed: int, waves: int, size_um: float, step_deg: float = STEP_DEG, turned_arcsec: float = 0.0
) -> tn.Sweep:
    """Two targets; the axis moves along itself, and turns too far, so many times a turn."""
    rng = np.random.default_rng([63, seed])
    turn = np.arange(0.0, 360.0, step_deg)
    angle, target = np.tile(turn, 2), np.repeat([1, 2], len(turn))
    radius, height = np.where(target == 1, 100.0, 60.0), np.where(target == 1, 0.0, 50.0)
    wave = np.cos(waves * np.radians(angle) + seed)
    too_far = np.radians(turned_arcsec / 3600.0) * wave
    at = np.radians(angle + np.where(target == 1, 0.0, 90.0)) + too_far
    along = 1e-3 * size_um * wave
    place = np.stack([radius * np.cos(at), radius * np.sin(at), height + along], axis=1)
    place += 2e-4 * rng.standard_normal(place.shape)
    columns = dict(zip(("x_mm", "y_mm", "z_mm"), place.T, strict=True))
    return tn.Sweep({"angle_deg": angle, "target": target} | columns)


@pytest.mark.parametrize(
    ("waves", "step_deg"), [(9, 10.0), (11, 10.0), (13, 10.0), (17, 10.0), (45, 2.0), (72, 2.0)]
)
def test_more_waves_than_causes_have_are_unexplained(waves: int, step_deg: float) -> None:
    ordinal = {72: "72nd"}.get(waves, f"{waves}th")
    for seed in range(3):
        d = tn.diagnose(swept(seed, waves, 2.0, step_deg))
        assert d.verdict == "unexplained"
        assert f"{ordinal} harmonic" in (d.unexplained or "")


@pytest.mark.parametrize(("waves", "step_deg"), [(45, 2.0), (72, 2.0), (90, 1.0), (144, 1.0)])
def test_a_worm_is_a_cyclic_error_with_its_pitch(waves: int, step_deg: float) -> None:
    for seed in range(3):
        d = tn.diagnose(swept(seed, waves, 0.0, step_deg, turned_arcsec=3.0))
        (cause,) = (c for c in d.causes if c.probability > 0.9)
        assert cause.id == "positioning_cyclic"
        period, std = cause["period_deg"], cause.std_errors["period_deg"]
        assert abs(period - 360.0 / waves) < 4 * std
        size = float(np.hypot(cause["a_arcsec"], cause["b_arcsec"]))
        assert size == pytest.approx(3.0, abs=0.3)


@pytest.mark.parametrize("step_deg", [10.0, 2.0])
def test_noise_has_no_waves(step_deg: float) -> None:
    found = [tn.diagnose(swept(seed, 9, 0.0, step_deg)).verdict for seed in range(12)]
    assert found.count("consistent") >= 11


def test_positions_read_anew_for_each_target_have_no_waves_below_two_steps() -> None:
    rng = np.random.default_rng(7)
    data = swept(1, 9, 0.0)
    read = np.asarray(data.angle_deg) + 1e-3 * rng.standard_normal(len(data))
    cyclic = model_of(data.with_columns(angle_deg=read)).effect("positioning_cyclic")
    (period,) = (p for p in cyclic.parameters if not p.linear)
    assert min(period.grid) >= 2 * STEP_DEG * 0.99
