"""Points on the diagnosis engine: signs, exact derivatives, placement, honest sharing out."""

import pickle
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.base.smooth import Modes, SmoothField
from trunnion.models.points import ExtendedPoints

RNG = np.random.default_rng(7)
Q = np.round(RNG.uniform(-200, 200, (120, 3)), 3)
ARC = np.pi / 180 / 3600


def points(
    error_um: np.ndarray, noise_um: float = 0.2, turn: float = 0.01, **more: Any
) -> tn.Points:
    """Features at Q with these errors, turned and shifted on the instrument."""
    d = error_um.shape[1]
    m = Q + 0.0
    m[:, :d] += (error_um + noise_um * np.random.default_rng(3).normal(size=error_um.shape)) * 1e-3
    c, s = np.cos(turn), np.sin(turn)
    m = m @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + [10.0, -20.0, 5.0]
    columns: dict[str, Any] = {f"nominal_{a}_mm": Q[:, i] for i, a in enumerate("xyz"[:d])}
    columns |= {f"{a}_mm": m[:, i] for i, a in enumerate("xyz"[:d])}
    return tn.Points(**columns, **more)


def plane(x: np.ndarray | float = 0.0, y: np.ndarray | float = 0.0) -> np.ndarray:
    return np.column_stack([np.broadcast_to(x, 120), np.broadcast_to(y, 120)])


@pytest.mark.parametrize(
    ("error", "name", "parameter", "value"),
    [
        (plane(x=40e-3 * Q[:, 0]), "scale_x", "ppm", 40.0),
        (plane(x=-8 * ARC * 1e3 * Q[:, 1]), "squareness_xy", "arcsec", 8.0),
        (plane(*(30e-3 * Q[:, :2].T)), "expansion", "ppm", 30.0),
    ],
)
def test_signs_and_sizes_as_in_the_contract(
    error: np.ndarray, name: str, parameter: str, value: float
) -> None:
    d = tn.diagnose(points(error))
    assert {c.id for c in d.causes} == {name} or any({name} == set(a) for a in d.alternatives)
    cause = next(c for c in d.causes if c.id == name)
    assert abs(cause.parameters[parameter] - value) < 4 * cause.std_errors[parameter] + 1e-3 * value


def test_periodic_error_with_its_pitch() -> None:
    d = tn.diagnose(points(plane(x=2.0 * np.cos(2 * np.pi * Q[:, 0] / 20.0 + 1.0))))
    (cause,) = d.causes
    assert cause.id == "periodic_x"
    assert abs(cause.parameters["pitch_mm"] - 20.0) < 4 * cause.std_errors["pitch_mm"]
    assert np.hypot(cause.parameters["a_um"], cause.parameters["b_um"]) == pytest.approx(2, abs=0.1)


def test_a_field_without_a_name_is_called_that() -> None:
    bump = 5.0 * np.exp(-((Q[:, 0] - 80) ** 2 + (Q[:, 1] + 40) ** 2) / (2 * 60.0**2))
    d = tn.diagnose(points(plane(x=bump)))
    assert "field" in {c.id for c in d.causes}
    assert d.gain.heldout_rms_after_um < 0.6 * d.gain.heldout_rms_before_um


def test_a_slip_of_the_part_is_found_and_its_moment() -> None:
    d = tn.diagnose(points(plane(x=np.where(np.arange(120) >= 45, 1.5, 0.0))))
    (cause,) = d.causes
    assert cause.id == "setup_shift"
    assert cause.parameters["dx_um"] == pytest.approx(1.5, abs=0.2)
    assert abs(cause.parameters["row"] - 44.5) < 3


def test_far_off_and_too_few_points_are_refused() -> None:
    good = points(plane())
    x = np.array(good.x_mm)
    x[17] += 12.0
    with pytest.raises(tn.DataError, match="row 17"):
        tn.diagnose(good.with_columns(x_mm=x))
    with pytest.raises(tn.TrunnionError):
        tn.diagnose(good[:1])


def test_readings_that_any_cause_fits_exactly_speak_for_none() -> None:
    d = tn.diagnose(points(plane())[[3, 90]])  # one degree of freedom is left
    assert d.verdict == "consistent"
    assert d.p_value == 1.0


def test_unknown_effect_is_refused_and_a_users_own_competes() -> None:
    data = points(plane(y=3.0 * (np.abs(Q[:, 0]) > 150)))
    with pytest.raises(tn.UnknownNameError, match="scale_q"):
        tn.diagnose(data, effects=["scale_q"])

    class Ends:
        id = "worn_ends"
        parameters = ("wear_um",)

        def change(self, data: tn.Points, values: Mapping[str, float]) -> np.ndarray:
            out = np.zeros((len(data), 2))
            out[:, 1] = values["wear_um"] * (np.abs(data.nominal_x_mm) > 150)
            return out.reshape(-1)

    d = tn.diagnose(data, effects=[Ends()])
    assert [c.id for c in d.causes] == ["worn_ends"]
    assert d.causes[0].parameters["wear_um"] == pytest.approx(3.0, abs=0.2)


def test_what_repeats_is_shared_out_as_it_was_made() -> None:
    rng = np.random.default_rng(5)
    holes = rng.normal(size=(120, 2)) * 2.0
    scale = plane(x=30e-3 * Q[:, 0])
    one, two = (
        points(scale + holes + rng.normal(size=(120, 2)), noise_um=0.0, turn=t) for t in (0.1, -0.2)
    )
    d = tn.diagnose(one)
    part = tn.repeatable_part(d, two[rng.permutation(120)])
    assert part.named + part.smooth + part.hole_by_hole == pytest.approx(1.0)
    made = np.mean((scale - scale.mean(axis=0)) ** 2)
    assert part.named == pytest.approx(made / (made + 4.0), abs=0.12)
    assert part.scatter_um == pytest.approx(1.0, abs=0.15)
    assert part.left_hole_by_hole_um == pytest.approx(np.sqrt(2.0), abs=0.2)
    assert part.left_hole_by_hole_um < part.left_named_um < part.other_rms_um
    assert "hole by hole" in part.summary()
    assert part.to_dict()["features"] == 120


def test_features_measured_again_show_what_belongs_to_the_feature() -> None:
    rng = np.random.default_rng(6)
    holes = rng.normal(size=(120, 2)) * 3.0
    one, two = (
        points(holes + rng.normal(size=(120, 2)), noise_um=0.0, turn=t, group=np.full(120, g))
        for g, t in enumerate((0.0, 0.3))
    )
    d = tn.diagnose(tn.Points.concatenate([one, two]))
    assert d.verdict == "consistent"  # the axes make nothing of it
    assert d.model.features is not None
    assert d.model.features.feature_um == pytest.approx(3.0, abs=0.4)
    assert d.model.features.measurement_um == pytest.approx(1.0, abs=0.15)


def test_results_pickle_and_turn_to_plain_numbers() -> None:
    d = tn.diagnose(points(plane(x=40e-3 * Q[:, 0])))
    again = pickle.loads(pickle.dumps(d))
    assert again.to_dict() == d.to_dict()
    assert isinstance(again.model, ExtendedPoints)
    assert d.model.error_um(again.data)[:, 0] == pytest.approx(
        again.model.error_um(again.data)[:, 0]
    )


def test_smoothing_is_the_one_that_predicts_left_out_places_best() -> None:
    rng = np.random.default_rng(2)
    at = rng.uniform(-1, 1, (60, 2))
    values = np.sin(3 * at[:, :1]) + 0.3 * rng.normal(size=(60, 1))
    chosen = SmoothField.of(at, values)

    def left_out(smoothing: float) -> float:
        total = 0.0
        for i in range(60):
            keep = np.arange(60) != i
            f = SmoothField(at[keep], values[keep], smoothing, 0.0)
            total += float((f.at(at[i : i + 1])[0, 0] - values[i, 0]) ** 2)
        return total

    best = left_out(chosen.smoothing)
    assert best <= 1.02 * min(left_out(chosen.smoothing * f) for f in (0.1, 0.3, 3.0, 10.0))


def test_modes_are_the_same_functions_everywhere() -> None:
    at = RNG.uniform(-1, 1, (80, 2))
    modes = Modes.of(at, np.sin(3 * at))
    assert modes is not None
    assert np.allclose(modes.at(at), modes.values, atol=1e-8)
    assert np.allclose(np.mean(modes.values**2, axis=0), 1.0)
