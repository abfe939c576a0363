"""Sweeps on the diagnosis engine: the axis, signs, exact derivatives, and honest limits."""

import pickle

import numpy as np
import pytest

import trunnion as tn
from trunnion.models.rotary import ExtendedSweep, SweepModel

ARC = np.pi / 180 / 3600


def sweep(
    angle: np.ndarray,
    targets: list[tuple[float, float, float]],
    *,
    shift_um: np.ndarray | float = 0.0,
    turn_arcsec: np.ndarray | float = 0.0,
    noise_um: float = 0.5,
    axis: tuple[float, float, float] = (0.2, -0.3, 1.0),
) -> tn.Sweep:
    """Turn targets (radius, phase, height) about an axis through (100, 50, 20)."""
    n = np.array(axis) / np.linalg.norm(axis)
    e1 = np.cross([0.0, 1.0, 0.0], n)
    e1 /= np.linalg.norm(e1)
    frame = np.column_stack([e1, np.cross(n, e1), n])
    rng = np.random.default_rng(4)
    rows = []
    t = np.radians(angle) + turn_arcsec * ARC
    for r, phase, h in targets:
        local = np.column_stack([r * np.cos(t + phase), r * np.sin(t + phase), np.full(len(t), h)])
        rows.append((local + 1e-3 * shift_um) @ frame.T + [100.0, 50.0, 20.0])
    p = np.concatenate(rows) + 1e-3 * noise_um * rng.normal(size=(len(t) * len(targets), 3))
    return tn.Sweep(
        angle_deg=np.tile(angle, len(targets)),
        target=np.repeat(np.arange(1, len(targets) + 1), len(angle)),
        x_mm=p[:, 0],
        y_mm=p[:, 1],
        z_mm=p[:, 2],
    )


FULL = np.arange(0.0, 360.0, 10.0)
THREE = [(100.0, 0.3, 0.0), (150.0, 2.0, 60.0), (80.0, 4.0, -40.0)]


def turned_twice(axis: tuple[float, float, float], noise_um: float, seed: int) -> tn.Sweep:
    """Targets whose axis moves by 3 µm along the instrument's axes, twice a turn."""
    data = sweep(FULL, THREE, axis=axis, noise_um=0.0)
    t = 2 * np.radians(np.asarray(data.angle_deg))
    rng = np.random.default_rng(seed)
    along = 3.0 * np.column_stack([np.cos(t), np.sin(t), 0.5 * np.cos(t)])
    p = data.position_mm + 1e-3 * (along + noise_um * rng.normal(size=along.shape))
    return data.with_columns(x_mm=p[:, 0], y_mm=p[:, 1], z_mm=p[:, 2])


@pytest.mark.parametrize(
    ("axis", "x", "y"),
    [
        ((0.0, 0.0, 1.0), (3.0, 0.0), (0.0, 3.0)),
        ((0.0, 0.0, -1.0), (3.0, 0.0), (0.0, -3.0)),
        ((1e-3, 1.0, 0.0), (3.0, 0.0), (-1.5, 0.0)),
        ((1.0, 0.0, 0.0), (0.0, 3.0), (1.5, 0.0)),
    ],
)
def test_error_motions_are_along_the_instruments_axes(
    axis: tuple[float, float, float], x: tuple[float, float], y: tuple[float, float]
) -> None:
    """However the readings scatter: the directions were those in which these were longest."""
    for seed in range(3):
        d = tn.diagnose(turned_twice(axis, 0.3, seed))
        cause = next(c for c in d.causes if c.id == "radial_2")
        found = [cause[f"{name}_um"] for name in ("ax", "bx", "ay", "by")]
        assert found == pytest.approx([*x, *y], abs=0.2)


def test_a_sweep_that_is_made_again_shows_no_change() -> None:
    axis = (0.1, 0.2, -1.0)
    for seed in range(12):
        dates = [turned_twice(axis, 0.5, 2 * seed + date) for date in range(2)]
        d = tn.diagnose(dates)
        assert not any("change" in cause for cause in d.named), d.named


@pytest.mark.parametrize("axis", [(0.2, -0.3, 1.0), (0.1, 0.2, -1.0), (1.0, 0.1, 0.3)])
def test_axis_and_radii_are_found_with_the_sense_of_rotation(
    axis: tuple[float, float, float],
) -> None:
    d = tn.diagnose(sweep(FULL, THREE, axis=axis))
    assert d.verdict == "consistent"
    assert isinstance(d.model, ExtendedSweep)
    n = np.array(axis) / np.linalg.norm(axis)
    assert d.model.direction == pytest.approx(n, abs=1e-5)
    away = np.cross(d.model.point_mm - [100.0, 50.0, 20.0], n)
    assert np.linalg.norm(away) < 1e-3
    assert list(d.model.radius_mm.values()) == pytest.approx([100.0, 150.0, 80.0], abs=1e-3)


def test_axial_and_positioning_harmonics_by_their_formulas() -> None:
    t = np.radians(FULL)
    shift = np.zeros((36, 3))
    shift[:, 2] = 3.0 * np.cos(2 * t) - 1.0 * np.sin(2 * t)
    d = tn.diagnose(sweep(FULL, THREE, shift_um=shift))
    (cause,) = d.causes
    assert cause.id == "axial_2"
    assert cause.parameters["a2_um"] == pytest.approx(3.0, abs=4 * cause.std_errors["a2_um"])
    assert cause.parameters["b2_um"] == pytest.approx(-1.0, abs=4 * cause.std_errors["b2_um"])
    turn = 4.0 * (np.cos(3 * t) - 1) + 2.0 * np.sin(3 * t)
    d = tn.diagnose(sweep(FULL, THREE, turn_arcsec=turn))
    (cause,) = d.causes
    assert cause.id == "positioning_3"
    assert cause.parameters["a3_arcsec"] == pytest.approx(4, abs=4 * cause.std_errors["a3_arcsec"])
    assert cause.parameters["b3_arcsec"] == pytest.approx(2, abs=4 * cause.std_errors["b3_arcsec"])
    motion = d.model.error_motions(FULL)
    assert motion["EC"] - motion["EC"].mean() == pytest.approx(turn - turn.mean(), abs=0.5)
    assert np.all(motion["EZ"] == 0)


def test_a_scale_of_the_axis_and_its_sign() -> None:
    d = tn.diagnose(sweep(FULL, THREE, turn_arcsec=50e-6 * np.radians(FULL) / ARC))
    (cause,) = d.causes
    assert cause.id == "positioning_scale"
    assert cause.parameters["ppm"] == pytest.approx(50.0, abs=4 * cause.std_errors["ppm"])


def test_gear_with_a_period_of_its_own() -> None:
    angle = np.arange(-60.0, 61.0, 2.0)
    d = tn.diagnose(sweep(angle, THREE, turn_arcsec=8.0 * np.cos(2 * np.pi * angle / 13.0)))
    cause = next(c for c in d.causes if c.id == "positioning_cyclic")
    assert cause.parameters["period_deg"] == pytest.approx(13.0, abs=0.2)


def test_an_arc_of_95_deg_cannot_tell_a_harmonic_from_a_slow_trend() -> None:
    angle = np.arange(-60.0, 36.0, 5.0)
    shift = np.zeros((len(angle), 3))
    shift[:, 2] = 200.0 * np.cos(2 * np.radians(angle) + 0.5)
    d = tn.diagnose(sweep(angle, [(325.0, 0.0, 0.0)], shift_um=shift, noise_um=1.0))
    assert d.verdict == "ambiguous"
    sets = set().union(*d.alternatives)
    assert {"axial_2", "axial_trend"} <= sets
    assert any(c.aliases for c in d.causes)


def test_a_target_near_the_axis_does_not_give_its_direction() -> None:
    near = tn.diagnose(sweep(FULL, [(2.0, 0.0, 0.0)], noise_um=1.0))
    far = tn.diagnose(sweep(FULL, [(200.0, 0.0, 0.0)], noise_um=1.0))
    assert near.verdict == far.verdict == "consistent"
    # sigma / (r sqrt(n / 2)): 24 arcsec at 2 mm, 0.24 at 200 mm
    want = 1e-3 / (2.0 * np.sqrt(18.0)) / ARC
    assert near.errors_std["axis_rx_arcsec"] == pytest.approx(want, rel=0.3)
    assert near.errors_std["axis_rx_arcsec"] > 50 * far.errors_std["axis_rx_arcsec"]


def test_one_target_cannot_tell_radial_motion_from_positioning() -> None:
    turn = 6.0 * np.cos(2 * np.radians(FULL))
    one = tn.diagnose(sweep(FULL, THREE[:1], turn_arcsec=turn))
    assert any("positioning_2" in a for a in one.alternatives)
    several = tn.diagnose(sweep(FULL, THREE, turn_arcsec=turn))
    assert [c.id for c in several.causes] == ["positioning_2"]


def test_a_harmonic_beyond_the_usual_is_tried_when_asked_for() -> None:
    shift = np.zeros((36, 3))
    shift[:, 2] = 2.0 * np.cos(12 * np.radians(FULL))
    data = sweep(FULL, THREE, shift_um=shift)
    d = tn.diagnose(data, effects=["axial_12"])
    assert "axial_12" in {c.id for c in d.causes}
    with pytest.raises(tn.UnknownNameError, match="wobble"):
        tn.diagnose(data, effects=["wobble_2"])


def test_too_few_positions_are_refused() -> None:
    with pytest.raises(tn.DataError, match="different positions"):
        tn.diagnose(sweep(np.array([0.0, 90.0]), THREE))
    still = sweep(FULL, [(0.0, 0.0, 0.0)], noise_um=0.0)
    with pytest.raises(tn.DataError, match="do not move"):
        tn.diagnose(
            still.with_columns(x_mm=np.full(36, 1.0), y_mm=np.full(36, 1.0), z_mm=np.full(36, 1.0))
        )


def test_results_pickle_and_bind_to_another_sweep() -> None:
    shift = np.zeros((36, 3))
    shift[:, 2] = 3.0 * np.cos(2 * np.radians(FULL))
    d = tn.diagnose(sweep(FULL, THREE, shift_um=shift))
    assert pickle.loads(pickle.dumps(d)).to_dict() == d.to_dict()
    again = sweep(FULL, THREE, shift_um=shift, axis=(0.4, 0.1, 1.0))
    gain = d.score(again)
    assert gain.rms_after_um < 0.55
    assert gain.rms_before_um > 1.2


@pytest.mark.parametrize("axis", [(0.2, -0.3, 1.0), (0.1, 0.2, -1.0), (1.0, 0.1, 0.3)])
def test_a_way_there_and_back_has_the_sense_of_one_way(axis: tuple[float, float, float]) -> None:
    both = np.concatenate([FULL, FULL[::-1]])
    d = tn.diagnose(sweep(both, THREE, axis=axis))
    assert d.verdict == "consistent"
    assert isinstance(d.model, ExtendedSweep)
    assert d.model.direction == pytest.approx(np.array(axis) / np.linalg.norm(axis), abs=1e-5)


def test_positions_or_targets_that_are_wrong_are_said() -> None:
    data = sweep(FULL, THREE)
    for wrong in (
        data.with_columns(angle_deg=np.radians(data.angle_deg)),
        data.with_columns(target=np.ones(len(data), dtype=int)),
    ):
        with pytest.raises(tn.DataError, match=r"target \d \(row \d+\): got a place .* mm from"):
            SweepModel(wrong)


@pytest.mark.parametrize("at", [3.0, 147.0, 251.0])
@pytest.mark.parametrize("height_um", [4.0, 15.0])
def test_a_local_error_is_no_sum_of_harmonics(at: float, height_um: float) -> None:
    """A raised cosine in X of the instrument, which no cause makes, and no bell either."""
    data = sweep(FULL, THREE)
    off = np.mod(data.angle_deg - at + 180.0, 360.0) - 180.0
    raised = np.where(np.abs(off) < 40.0, np.cos(np.pi * off / 80.0) ** 2, 0.0)
    moved = data.with_columns(x_mm=data.position_mm[:, 0] + 1e-3 * height_um * raised)
    d = tn.diagnose(moved)
    assert d.verdict == "unexplained"
    assert not d.causes
    assert d.none_probability > 0.9
    assert "a local error at" in str(d.unexplained)
    assert d.structure is not None
    found = d.structure.parameters
    assert np.mod(found["place_deg"] - at + 180.0, 360.0) - 180.0 == pytest.approx(0.0, abs=2.0)
    assert found["width_deg"] == pytest.approx(40.0, abs=8.0)
    assert found["height_um"] == pytest.approx(height_um, rel=0.15)
