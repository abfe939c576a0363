"""Common mistakes of a measurement are named; ordinary machines are not suspected."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import trunnion as tn

SETUP = tn.Setup(artefact=tn.Artefact("cross"))
PLAN = tn.plan(SETUP)
SIZES = {"EX0C": 60, "EY0C": 60, "EY0A": 60, "EZ0A": 60, "EA0A": 60, "EB0A": 60, "EC0A": 60}


def test_a_tool_measured_to_the_tip_is_named() -> None:
    data = tn.simulate(PLAN, SETUP, errors={"EX0C": 20.0}, noise_um=0.3, seed=1)
    tip = tn.Touches({**data.columns, "z_mm": data["z_mm"] - SETUP.probe.ball_radius_mm})
    fit = tn.identify(tip, SETUP)
    assert "to the tip of the ball?" in fit.summary().replace("\n", " ")
    assert abs(fit.errors["EZ0A"] + 1000.0) < 2.0  # said, not corrected
    for method in (tn.closed_form, tn.diagnose):
        assert "to the tip of the ball?" in method(tip, SETUP).summary().replace("\n", " ")


def test_no_ordinary_machine_is_suspected() -> None:
    rng = np.random.default_rng(5)
    for seed in range(200):
        errors = {name: float(rng.uniform(-size, size)) for name, size in SIZES.items()}
        data = tn.simulate(PLAN, SETUP, errors=errors, noise_um=0.3, seed=seed)
        assert suspected(tn.identify(data, SETUP)) == []


def suspected(fit: tn.IdentificationResult) -> list[str]:
    """Return the notes of a fit but for that on the scatter, which is no mistake."""
    return [note for note in fit.notes if not note.startswith("Touches scatter")]


ERRORS = {"EX0C": 20.0, "EY0A": -15.0, "EB0A": 12.0, "EZ0A": 30.0}
PLACEMENT = {"dx_um": 80.0, "dy_um": -50.0, "rc_arcsec": 60.0}
METHODS: list[Callable[..., Any]] = [tn.identify, tn.closed_form, tn.diagnose]


def measured(setup: tn.Setup) -> tn.Touches:
    plan = tn.plan(setup)
    return tn.simulate(plan, setup, ERRORS, PLACEMENT, noise_um=0.3, seed=1)


def moved(data: tn.Touches, factor: float) -> tn.Touches:
    return data.with_columns(**{name: data[name] * factor for name in ("x_mm", "y_mm", "z_mm")})


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("factor", "unit"), [(1 / 25.4, "inches"), (1e3, "µm"), (0.1, "cm"), (1e-3, "m")]
)
def test_positions_in_another_unit_are_named(
    method: Callable[..., Any], factor: float, unit: str
) -> None:
    off = "modelled (surface|artefact)"
    with pytest.raises(tn.DataError, match=f"{off}.*if their positions are in {unit}\\.$"):
        method(moved(measured(SETUP), factor), SETUP)


def test_angles_in_radians_are_named() -> None:
    data = measured(SETUP)
    radians = data.with_columns(**{k: np.radians(data[k]) for k in ("a_deg", "c_deg")})
    for method in METHODS:
        with pytest.raises(tn.DataError, match=r"if their angles are in radians\.$"):
            method(radians, SETUP)


@pytest.mark.parametrize("value", [0.004, 7e-5])  # 14 arcsec in degrees, in radians
def test_angular_errors_in_another_unit_are_named(value: float) -> None:
    with pytest.warns(UserWarning, match=r"EA0A = .*: are these degrees or radians\?"):
        tn.simulate(PLAN, SETUP, errors={"EA0A": value, "EX0C": 15.0})
    known = replace(SETUP, machine=tn.Machine(errors={"EB0C": value}))
    notes = tn.identify(measured(known), known).notes
    assert any("They are expected in arcsec" in note for note in notes)


@pytest.mark.parametrize("axes", ["A", "C", "AC"])
def test_a_mirrored_sense_is_named(axes: str) -> None:
    true = replace(SETUP, axes={axis: tn.AxisSetup(sense=-1) for axis in axes})
    data = measured(true)
    expected = " and ".join(f"sense = -1 of axis {axis}" for axis in axes) + "."
    for method in METHODS:
        if axes == "C":  # the cross is on itself again
            assert expected in method(data, SETUP).notes[0]
        else:
            with pytest.raises(tn.DataError, match=expected):
                method(data, SETUP)
    assert tn.identify(data, true).notes == ()


def test_a_mirrored_sense_is_named_on_the_grid_of_a_control() -> None:
    """A tick of 10 µm leaves a tenth of what the mirrored axis does."""
    given = replace(SETUP, probe=tn.Probe(servo_period_ms=1.0))
    true = replace(given, axes={"C": tn.AxisSetup(sense=-1)})
    rng = np.random.default_rng(3)
    for seed in range(20):
        errors = {name: float(rng.uniform(-size, size)) / 2 for name, size in SIZES.items()}
        data = tn.simulate(tn.plan(true), true, errors, PLACEMENT, noise_um=0.3, seed=seed)
        assert any("sense = -1 of axis C" in note for note in tn.identify(data, given).notes)


@pytest.mark.parametrize(
    ("true", "given"),
    [("trt-bc", "table-c-head-b"), ("table-c-head-b", "trt-bc"), ("trt-ca", "trt-bc")],
)
def test_a_wrong_preset_is_named(true: str, given: str) -> None:
    right = replace(SETUP, machine=tn.Machine(true))
    data = tn.simulate(tn.plan(right), right, noise_um=0.3, seed=1)
    for method in (tn.identify, tn.diagnose):
        with pytest.raises(tn.DataError, match=f'with preset = "{true}"'):
            method(data, replace(SETUP, machine=tn.Machine(given)))


CROSS = {"kind": "cross"}
SPHERE = {"kind": "sphere", "diameter_mm": 25.0, "centre_mm": (30.0, 10.0, 80.0)}


@pytest.mark.parametrize(
    ("artefact", "radius", "expected"),
    [
        (CROSS, 0.5, ["probe.ball_radius_mm = 0.5 (not 1)"]),  # the diameter as the radius
        (CROSS, 3.0, ["probe.ball_radius_mm = 3 (not 1)"]),
        ({**CROSS, "length_mm": 101.0}, 1.0, ["artefact.length_mm = 101 (not 100)"]),
        ({**CROSS, "width_mm": 24.5}, 1.0, ["artefact.width_mm = 24.5 (not 25)"]),
        (
            {**SPHERE, "diameter_mm": 26.0},
            1.0,
            ["probe.ball_radius_mm = 1.5 (not 1)", "artefact.diameter_mm = 26 (not 25)"],
        ),
    ],
)
def test_a_length_wrong_by_a_round_number_is_named(
    artefact: dict[str, Any], radius: float, expected: list[str]
) -> None:
    true = tn.Setup(artefact=tn.Artefact(**artefact), probe=tn.Probe(ball_radius_mm=radius))
    given = tn.Setup(artefact=tn.Artefact(**(SPHERE if "diameter_mm" in artefact else CROSS)))
    data = measured(true)
    methods = METHODS if true.artefact.kind == "cross" else (tn.identify, tn.diagnose)
    for method in methods:
        note = method(data, given).notes[0]
        named = note.split("µm ")[-1].removesuffix(".").split(", or ")
        assert named == [f"with {text}" for text in expected]
    summary = tn.identify(data, given).summary().replace("\n", " ")
    assert "have a likely cause" in summary


def test_errors_in_mm_and_places_off_by_more_than_1_mm_are_named() -> None:
    with pytest.warns(UserWarning, match=r"got EX0C = 0.015: are these mm\?"):
        data = tn.simulate(PLAN, SETUP, errors={"EX0C": 0.015})
    with pytest.raises(tn.DataError, match="Likely cause: EZ0A = 30000 µm: errors are in µm"):
        tn.simulate(PLAN, SETUP, errors={"EZ0A": 30_000.0})
    known = replace(SETUP, machine=tn.Machine(errors={"EX0C": 0.015}))
    far = tn.simulate(PLAN, SETUP, errors={"EX0C": 1500.0}, noise_um=0.3, seed=1)
    for method in METHODS:
        assert "EX0C = 0.015 µm: if the data are simulated" in method(data, SETUP).notes[0]
        assert "has EX0C = 0.015: are these mm?" in method(measured(SETUP), known).notes[0]
        assert "EX0C is +1500 µm from the set-up" in method(far, SETUP).notes[0]


def test_no_cause_of_the_catalogue_is_taken_for_a_mistake() -> None:
    """Residuals of many times a probe's scatter, from causes that the machine may have."""
    rng = np.random.default_rng(7)
    named: list[str] = []
    for seed in range(150):
        errors = {name: float(rng.uniform(-size, size)) for name, size in SIZES.items()}
        placement = {"dx_um": float(rng.uniform(-300, 300)), "rc_arcsec": 200.0}
        effects = {
            "probe_radius": {"dr_um": float(rng.uniform(-40, 40))},
            "squareness_xy": {"arcsec": float(rng.uniform(-200, 200))},
            "c_positioning": dict.fromkeys(("a1_arcsec", "b1_arcsec"), float(rng.uniform(20, 80))),
        }
        data = tn.simulate(PLAN, SETUP, errors, placement, effects, noise_um=0.3, seed=seed)
        fit = tn.identify(data, SETUP)
        assert fit.rms_um > 5.0
        named += suspected(fit)
    assert not named


def test_a_false_touch_is_not_taken_for_a_mistake() -> None:
    data = measured(SETUP)
    row = int(np.argmax(np.abs(data["dir_x"])))

    def false(off_mm: float) -> tn.Touches:
        x = np.array(data["x_mm"])
        x[row] += off_mm
        return data.with_columns(x_mm=x)

    for off in (0.5, 3.0):
        assert tn.identify(false(off), SETUP).notes == ()
    with pytest.raises(tn.DataError, match=r"its axes$"):
        tn.identify(false(7.0), SETUP)
