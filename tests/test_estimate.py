"""What a measurement says of a machine, and what it may tell a control."""

from __future__ import annotations

import copy
import json
import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.hybrid import Mechanism, ballbar_plan, identify_ballbar
from trunnion.machine.effects import Owner
from trunnion.machine.estimate import Estimate
from trunnion.machine.linear_axes import LinearMotion, Travel
from trunnion.models.kinds import model_of


def only_c_turns() -> tuple[tn.Touches, tn.Setup]:
    """Touches of the sample at A = 0: they do not show where the A axis is."""
    touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    return touches[np.asarray(touches.a_deg) == 0], tn.read_setup(
        tn.sample_path("cross/setup.toml")
    )


def test_a_diagnosis_carries_nothing_unmeasured_into_a_control() -> None:
    part, setup = only_c_turns()
    model = tn.diagnose(part, setup).model
    assert np.isinf(model.std_errors["EY0A"])
    for use in (tn.cnc_parameters, tn.error_map, tn.volumetric_error):
        with pytest.raises(tn.DataError, match="EY0A"):
            use(setup, model)


SETUP = tn.Setup(artefact=tn.Artefact("cross"))
BOX: dict[str, Any] = {
    "x_mm": (-150, 150),
    "y_mm": (-100, 100),
    "z_mm": (0, 50),
    "points": (5, 5, 2),
}


def plate(x_um: np.ndarray, y_um: np.ndarray, z_um: np.ndarray, at: np.ndarray) -> tn.Points:
    """Points in space with these errors and 0.1 µm of noise."""
    noise = 0.1 * np.random.default_rng(5).normal(size=at.shape)
    measured = at + 1e-3 * (np.column_stack([x_um, y_um, z_um]) + noise)
    return tn.Points(
        **{f"nominal_{a}_mm": at[:, i] for i, a in enumerate("xyz")},
        **{f"{a}_mm": measured[:, i] for i, a in enumerate("xyz")},
    )


def test_what_points_say_of_the_linear_axes_reaches_compensation() -> None:
    grid = np.meshgrid(np.linspace(-150, 150, 13), np.linspace(-100, 100, 9), [0.0, 50.0])
    at = np.stack(grid, axis=-1).reshape(-1, 3)
    u = at[:, 0] / 150
    data = plate(30e-3 * at[:, 0], 8.0 * (3 * u * u - 1) / 2, 0 * u, at)
    model = tn.diagnose(data).model
    assert set(model.effects) == {"scale_x", "straightness_y_of_x"}
    bent = tn.volumetric_error(SETUP, model, **BOX)
    nodes = np.stack(np.meshgrid(bent.x_mm, bent.y_mm, bent.z_mm, indexing="ij"), axis=-1)
    none = np.zeros(nodes.size // 3)
    asked = plate(none, none, none, nodes.reshape(-1, 3))  # measured values play no part
    assert bent.field_um.reshape(-1, 3) == pytest.approx(model.error_um(asked), abs=1e-3)
    exact = tn.ModelCompensation.of(SETUP, model)
    assert tn.volumetric_error(SETUP, model, compensation=exact, **BOX).max_um < 0.01
    table = tn.error_map(SETUP, model, a_deg=0, c_deg=0, linear_step_mm=25.0)
    assert tn.volumetric_error(SETUP, model, compensation=table, **BOX).max_um < 1.0
    with pytest.raises(tn.InputError, match="straightness_y_of_x"):
        tn.cnc_parameters(SETUP, model)


def test_beyond_the_measured_travel_the_last_value_holds() -> None:
    at = np.stack(np.meshgrid(np.linspace(-90, 90, 9), np.linspace(-50, 50, 5), [0.0, 20.0]), -1)
    at = at.reshape(-1, 3)
    u = at[:, 0] / 90
    model = tn.diagnose(plate(0 * u, 0 * u, 9.0 * (3 * u * u - 1) / 2, at)).model
    assert set(model.effects) == {"straightness_z_of_x"}
    far = tn.volumetric_error(SETUP, model, x_mm=[0, 90, 900], y_mm=0, z_mm=0).field_um[..., 2]
    assert far.ravel()[1] == pytest.approx(9.0, abs=0.3)
    assert far.ravel()[2] == far.ravel()[1]


def test_what_a_ballbar_says_of_a_three_axis_machine_reaches_compensation() -> None:
    angle = np.radians(np.arange(0.0, 720.0, 2.0))
    x, y = 50 + 100 * np.cos(angle), -20 + 100 * np.sin(angle)
    length = np.hypot(x - 50 - 40e-6 * y, y + 20)  # squareness
    length += 2e-4 * np.random.default_rng(2).normal(size=len(x))
    data = tn.Ballbar(setup=np.zeros(len(x), int), x_mm=x, y_mm=y, length_mm=length)
    model = tn.diagnose(data, SETUP).model
    assert set(model.effects) == {"squareness_xy"}
    gamma = model["squareness_xy.arcsec"]
    assert gamma == pytest.approx(40e-6 * 648000 / np.pi, abs=0.1)
    v = tn.volumetric_error(SETUP, model, **BOX)
    assert v.max_um == pytest.approx(40e-3 * 100, rel=0.02)


@pytest.mark.parametrize(
    ("kind", "read", "path", "setup"),
    [
        ("sweep", tn.read_sweep, "axis/sweep.csv", None),
        ("diameters", tn.read_diameters, "turning/diameters.csv", "turning/setup.toml"),
        ("axis log", tn.read_axis_log, "contour/axislog.csv", "contour/setup.toml"),
        ("ball-bar", tn.read_ballbar, "ballbar/circle.csv", None),
        ("points", tn.read_points, "plate/first.csv", None),
    ],
)
def test_what_has_no_meaning_for_compensation_is_listed_by_name(
    kind: str, read: Any, path: str, setup: str | None
) -> None:
    """Every kind of data goes through: compensated, or named as taking no part and why."""
    known = None if setup is None else tn.read_setup(tn.sample_path(setup))
    model = tn.diagnose(read(tn.sample_path(path)), known).model
    v = tn.volumetric_error(SETUP, model, **BOX)
    assert set(v.ignored) == set(model.not_compensable), kind
    for name, reason in model.not_compensable.items():
        assert name in model.effects
        assert len(reason.split()) > 2
    taking_part = set(model.effects) - set(v.ignored)
    assert (v.max_um > 0) == bool(taking_part), (kind, taking_part)


def test_errors_of_a_hybrid_machine_are_none_of_these_axes() -> None:
    found = Estimate(errors={"e5_um": 3.0})
    with pytest.raises(tn.TrunnionError, match="e5_um"):
        tn.volumetric_error(SETUP, found)


def test_an_offset_of_the_rotary_axes_from_a_log_is_a_location_error() -> None:
    setup = tn.read_setup(tn.sample_path("contour/setup.toml"))
    found = model_of(tn.read_axis_log(tn.sample_path("contour/axislog.csv")), setup).extended(
        np.zeros(0), {"rotary_centre": {"EX0C_um": 12.0, "EY0C_um": 0.0}}
    )
    assert found.errors == {"EX0C": 12.0, "EY0C": 0.0}
    assert tn.volumetric_error(setup, found).max_um == pytest.approx(12.0)


@cache
def estimates() -> dict[str, tn.Estimate]:
    """One of each: every kind of measurement says what it says as an estimate."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    part, _ = only_c_turns()
    found: dict[str, tn.Estimate] = {
        "identify": tn.identify(touches, setup),
        "identify a part": tn.identify(part, setup),
        "printed": tn.closed_form(touches, setup, method="printed"),
        "separating": tn.closed_form(touches, setup),
        "touches": tn.diagnose(touches, setup).model,
        "points": tn.diagnose(tn.read_points(tn.sample_path("plate/first.csv"))).model,
        "sweep": tn.diagnose(tn.read_sweep(tn.sample_path("axis/sweep.csv"))).model,
        "ball-bar": tn.diagnose(tn.read_ballbar(tn.sample_path("ballbar/circle.csv"))).model,
    }
    plan = ballbar_plan(Mechanism(), np.array([0.0, -350.0, -1400.0]), step_deg=15.0)
    found["hybrid"] = identify_ballbar(plan, Mechanism())
    return found


@pytest.mark.parametrize("kind", list(estimates()))
def test_every_measurement_gives_an_estimate_that_is_a_value(kind: str, tmp_path: Path) -> None:
    found = estimates()[kind]
    assert isinstance(found, tn.Estimate)
    for again in (pickle.loads(pickle.dumps(found)), copy.deepcopy(found)):
        assert again == found
    path = tmp_path / "estimate.json"
    found.to_json(path)
    read = tn.read_estimate(path)
    assert read.errors == found.errors
    assert read.std_errors == found.std_errors
    assert read.combinations == found.combinations
    assert np.array_equal(read.covariance, found.covariance)
    assert read.motions == found.motions
    assert tn.Estimate.from_json(read.to_json()) == read
    for parameter in found.parameters:
        assert found[parameter.name] == parameter.value
        assert isinstance(parameter.owner, Owner)
        assert parameter.identifiable == (parameter.std_error != np.inf)
    assert len(found.to_dataframe()) >= len(found.values)
    assert "<table>" in found._repr_html_()
    assert len(repr(found)) < 1000


def test_an_identification_reads_back_as_itself() -> None:
    part, setup = only_c_turns()
    fit = tn.identify(part, setup)
    assert tn.IdentificationResult.from_json(fit.to_json()) == fit
    assert fit["EX0C"] == fit.errors["EX0C"]
    with pytest.raises(tn.UnknownNameError, match="EX0Q"):
        fit["EX0Q"]


def test_what_is_not_identifiable_is_named_and_refused_after_a_file(tmp_path: Path) -> None:
    part, setup = only_c_turns()
    fit = tn.identify(part, setup)
    assert "EY0A" in fit.not_identifiable
    assert "EX0C" not in fit.not_identifiable
    assert any("EY0A" in sentence for sentence in fit.not_identifiable)
    assert "EY0A" in fit.summary()
    fit.to_json(tmp_path / "fit.json")
    for given in (fit, tn.read_estimate(tmp_path / "fit.json")):
        with pytest.raises(tn.DataError, match="EY0A"):
            tn.error_map(setup, given)


def test_a_stored_straightness_still_bends_the_machine() -> None:
    found = Estimate(
        effects={"straightness_y_of_x": {"a2_um": 8.0, "a3_um": 0.0}},
        motions={"straightness_y_of_x": LinearMotion("straightness_y_of_x", TRAVEL)},
    )
    again = Estimate.from_json(found.to_json())
    assert again == found
    bent = [
        tn.volumetric_error(SETUP, e, x_mm=[0, 50, 100], y_mm=0, z_mm=0) for e in (found, again)
    ]
    assert bent[0].max_um == bent[1].max_um == pytest.approx(8.0)


TRAVEL = Travel((0.0, 0.0), (100.0, 80.0))


@pytest.mark.parametrize("field", ["covariance", "residuals_um"])
def test_a_stored_result_that_none_can_have_is_an_error(field: str) -> None:
    folder = tn.sample_path("cross")
    touches, setup = tn.read_touches(folder / "touches.csv"), tn.read_setup(folder / "setup.toml")
    fit = tn.identify(touches, setup)
    wrong = {"covariance": -fit.covariance, "residuals_um": 1e200 * fit.residuals_um}
    stored = json.loads(fit.to_json())
    assert tn.IdentificationResult.from_json(json.dumps(stored)) == fit
    with pytest.raises(tn.FileFormatError, match="do not fit"):
        tn.IdentificationResult.from_json(json.dumps({**stored, field: wrong[field].tolist()}))
