"""Common mistakes of a measurement are named; ordinary machines are not suspected."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.machine.sizes import length_doubts
from trunnion.setup.machines import presets

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


HEADS = ("table-c-head-b", "head-bc", "head-ac", "nutating-head")
PLACED_ONLY = ("four-axis-c", "three-axis")


def on_machine(preset: str, **more: Any) -> tuple[tn.Setup, tn.Touches]:
    """Touches of a cross on a machine with location errors, the cross near its place."""
    setup = replace(SETUP, machine=tn.Machine(preset))
    plan = tn.plan(setup)
    rng = np.random.default_rng(more.pop("seed", 1))
    errors = {name: float(rng.uniform(-60, 60)) for name in tn.identify(plan, setup).errors}
    placement = {name: float(rng.uniform(-300, 300)) for name in ("dx_um", "dy_um", "dz_um")}
    return setup, tn.simulate(plan, setup, errors, placement | more, noise_um=0.3, seed=2)


def along_spindle(data: tn.Touches, setup: tn.Setup) -> np.ndarray[Any, Any]:
    """Return the direction from the tool point to the spindle of a head, by its own formulas."""
    turn = {"b": np.radians(data.columns.get("b_deg", np.zeros(len(data))))}
    turn["a"] = np.radians(data.columns.get("a_deg", np.zeros(len(data))))
    turn["c"] = np.radians(data.columns.get("c_deg", np.zeros(len(data))))
    zero, b, a, c = np.zeros(len(data)), turn["b"], turn["a"], turn["c"]
    up = {
        "table-c-head-b": (np.sin(b), zero, np.cos(b)),
        "head-bc": (np.cos(c) * np.sin(b), np.sin(c) * np.sin(b), np.cos(b)),
        "head-ac": (np.sin(c) * np.sin(a), -np.cos(c) * np.sin(a), np.cos(a)),
        "nutating-head": (np.sin(b) / np.sqrt(2), (1 - np.cos(b)) / 2, (1 + np.cos(b)) / 2),
    }
    return np.column_stack(up[setup.machine.name])


@pytest.mark.parametrize("preset", HEADS)
@pytest.mark.parametrize(("sign", "end"), [(1, "to the tip of"), (-1, "beyond the centre of")])
def test_a_tool_of_a_head_that_is_measured_to_the_tip_is_named(
    preset: str, sign: int, end: str
) -> None:
    """A control that follows the tool point has it wrong along the spindle."""
    setup, data = on_machine(preset)
    x, y, z = (data.position_mm - sign * along_spindle(data, setup)).T
    wrong = data.with_columns(x_mm=x, y_mm=y, z_mm=z)
    for method in (tn.identify, tn.diagnose):
        said = likely_cause(method, wrong, setup)
        assert said.endswith(
            f"if the tool's length was measured {end} the ball (not to its centre)."
        )


@pytest.mark.parametrize("preset", [*HEADS, *PLACED_ONLY])
@pytest.mark.parametrize(("sign", "where"), [(-1, "below"), (1, "above")])
def test_a_tool_to_the_tip_that_no_touch_tells_is_a_doubt(
    preset: str, sign: int, where: str
) -> None:
    """Along Z it is as an artefact that stands lower: both are said, and what they are in."""
    setup, data = on_machine(preset, dz_um=0.0)
    offset = {"head-ac": "EZ0A and ", **dict.fromkeys(PLACED_ONLY, "")}.get(preset, "EZ0B and ")
    z_mm = data["z_mm"] + sign * setup.probe.ball_radius_mm
    for method in (tn.identify, tn.diagnose):
        said = " ".join(method(data.with_columns(z_mm=z_mm), setup).notes)
        assert f"µm {where} its place in the set-up, about the radius of the ball (1000" in said
        assert f"do not say which: either is in {offset}dz_um." in said
    (note,) = (n for n in tn.plan_notes(data, setup) if "to the tip of the ball" in n)
    assert f"is in {offset}dz_um" in note
    assert ("no error of the machine shows it" in note) == (preset in PLACED_ONLY)


@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc", "tt-ab", "nutating-table", "four-axis-a"])
def test_a_tool_to_the_tip_is_named_on_every_table(preset: str) -> None:
    setup, data = on_machine(preset)
    fit = tn.identify(data.with_columns(z_mm=data["z_mm"] - 1.0), setup)
    assert any("to the tip of the ball? It is expected to the centre" in n for n in fit.notes)
    assert not any("tip of the ball" in note for note in tn.plan_notes(data, setup))


@pytest.mark.parametrize("preset", presets())
def test_no_ordinary_machine_of_any_preset_is_suspected(preset: str) -> None:
    for seed in range(12):
        setup, data = on_machine(preset, seed=seed)
        assert suspected(tn.identify(data, setup)) == []


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
FACTORS = [
    *((1 / 25.4, "inches"), (1e3, "µm"), (0.1, "cm"), (1e-3, "m")),
    (25.4, "mm but were taken for inches"),
]
"""What lengths in mm are multiplied by, and how they are then."""


def measured(setup: tn.Setup) -> tn.Touches:
    plan = tn.plan(setup)
    return tn.simulate(plan, setup, ERRORS, PLACEMENT, noise_um=0.3, seed=1)


def moved(data: tn.Touches, factor: float) -> tn.Touches:
    return data.with_columns(**{name: data[name] * factor for name in ("x_mm", "y_mm", "z_mm")})


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("factor", "unit"), FACTORS)
def test_positions_in_another_unit_are_named(
    method: Callable[..., Any], factor: float, unit: str
) -> None:
    off = "modelled (surface|artefact)"
    with pytest.raises(tn.DataError, match=f"{off}.*if their positions are in {unit}\\.$"):
        method(moved(measured(SETUP), factor), SETUP)


ARTEFACTS = [
    {"kind": "cross", "length_mm": 80.0, "width_mm": 20.0, "height_mm": 20.0},
    {"kind": "cuboid", "length_mm": 80.0, "width_mm": 60.0, "height_mm": 40.0},
    {"kind": "sphere", "diameter_mm": 22.0, "centre_mm": (30.0, 10.0, 80.0)},
    {
        "kind": "spheres",
        "diameter_mm": 20.0,
        "spheres_mm": ((60.0, 0.0, 60.0), (-60.0, 10.0, 60.0)),
    },
    {"kind": "ring", "diameter_mm": 60.0, "outer_diameter_mm": 90.0, "height_mm": 30.0},
]


RECIPROCAL = {"mm but were taken for inches": ["their positions are in inches"]}
"""Unit of a set-up in whose place the touches may be in another one.

Not where no ball and no artefact is as small as the set-up says: it is the set-up then."""


def in_unit(artefact: dict[str, Any], factor: float) -> tn.Artefact:
    """Return an artefact whose lengths are all stated in another unit."""
    kind = {"kind": artefact["kind"]}
    lengths = {k: (np.array(v) * factor).tolist() for k, v in artefact.items() if k != "kind"}
    return tn.Artefact(**kind, **lengths)


@pytest.mark.parametrize("artefact", ARTEFACTS, ids=lambda artefact: artefact["kind"])
@pytest.mark.parametrize(("factor", "unit"), FACTORS)
def test_an_artefact_in_another_unit_is_named(
    artefact: dict[str, Any], factor: float, unit: str
) -> None:
    """Alone, and with the ball of the probe, where it may be the touches that are wrong."""
    true = tn.Setup(artefact=tn.Artefact(**artefact), probe=tn.Probe(ball_radius_mm=1.5))
    data = measured(true)
    methods = METHODS if artefact["kind"] == "cross" else (tn.identify, tn.diagnose)
    ball = tn.Probe(ball_radius_mm=1.5 * factor)
    for probe, tables in ((true.probe, "[artefact]"), (ball, "[artefact] and [probe]")):
        given = tn.Setup(artefact=in_unit(artefact, factor), probe=probe)
        for method in methods:
            said = likely_cause(method, data, given, is_refused=True)
            *others, last = said.split("µm if ")[-1].split(", or if ")
            assert last == f"the lengths in {tables} are in {unit}.", said
            assert [*others] == (RECIPROCAL.get(unit, []) if probe is ball else []), said


def likely_cause(
    method: Callable[..., Any], data: tn.Touches, setup: tn.Setup, *, is_refused: bool = False
) -> str:
    """Return what is named: in the notes, or in the error where touches are off the surface.

    is_refused: It has to be an error.
    """
    try:
        found = method(data, setup)
    except tn.DataError as error:
        return str(error).partition("Likely cause: ")[2]
    assert not is_refused
    return str(next(iter(found.notes), ""))


def test_angles_in_radians_are_named() -> None:
    data = measured(SETUP)
    radians = data.with_columns(**{k: np.radians(data[k]) for k in ("a_deg", "c_deg")})
    for method in METHODS:
        with pytest.raises(tn.DataError, match=r"if their angles are in radians\.$"):
            method(radians, SETUP)


TO_DEGREES = float(np.degrees(1.0))


@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        ({"c_deg": 1 / TO_DEGREES}, "if c_deg is in radians"),
        ({"a_deg": 1 / TO_DEGREES}, "if a_deg is in radians"),
        ({"c_deg": TO_DEGREES}, "if c_deg is in degrees but was taken for radians"),
        (
            {"a_deg": TO_DEGREES, "c_deg": TO_DEGREES},
            "if their angles are in degrees but were taken for radians",
        ),
        ({"x_mm": 1 / 25.4}, "if x_mm is in inches"),
        ({"z_mm": 1e-3}, "if z_mm is in m"),
        ({"dir_x": -1.0}, "if dir_x counts the other way"),
    ],
)
def test_single_columns_in_another_unit_are_named(wrong: dict[str, float], cause: str) -> None:
    data = measured(SETUP)
    columns = {name: factor * data[name] for name, factor in wrong.items()}
    for method in METHODS:
        assert f"{cause}." in said_of(method, data.with_columns(**columns), SETUP)


@pytest.mark.parametrize("value", [0.004, 7e-5])  # 14 arcsec in degrees, in radians
def test_angular_errors_in_another_unit_are_named(value: float) -> None:
    with pytest.warns(UserWarning, match=r"EA0A = .*: are these degrees or radians\?"):
        tn.simulate(PLAN, SETUP, errors={"EA0A": value, "EX0C": 15.0})
    known = replace(SETUP, machine=tn.Machine(errors={"EB0C": value}))
    with pytest.warns(UserWarning, match=r"plan, \[machine\.errors\]: got EB0C"):
        data = measured(known)
    notes = tn.identify(data, known).notes
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
    [
        *(("trt-bc", "table-c-head-b"), ("table-c-head-b", "trt-bc"), ("trt-ca", "trt-bc")),
        *(("trt-ca", preset) for preset in ("head-bc", "nutating-head", "four-axis-a")),
    ],
)
def test_a_wrong_preset_is_named(true: str, given: str) -> None:
    right = replace(SETUP, machine=tn.Machine(true))
    data = tn.simulate(tn.plan(right), right, noise_um=0.3, seed=1)
    for method in (tn.identify, tn.diagnose):
        with pytest.raises(tn.DataError, match=f'with preset = "{true}"'):
            method(data, replace(SETUP, machine=tn.Machine(given)))


CROSS = {"kind": "cross"}
SPHERE: dict[str, Any] = {"kind": "sphere", "diameter_mm": 25.0, "centre_mm": (30.0, 10.0, 80.0)}


@pytest.mark.parametrize(
    ("artefact", "radius", "expected"),
    [
        (CROSS, 0.5, ["probe.ball_radius_mm = 0.5 (not 1)"]),  # the diameter as the radius
        (CROSS, 3.0, ["probe.ball_radius_mm = 3 (not 1)"]),
        ({**CROSS, "length_mm": 101.0}, 1.0, ["artefact.length_mm = 101 (not 100)"]),
        ({**CROSS, "width_mm": 24.5}, 1.0, ["artefact.width_mm = 24.5 (not 25)"]),
        ({**CROSS, "width_mm": 30.0}, 1.0, ["artefact.width_mm = 30 (not 25)"]),
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


@pytest.mark.parametrize(
    ("artefact", "radius", "said"),
    [
        ({}, 1.0 / 25.4, ["ball_radius_mm = 0.0393"]),
        ({}, 3.0 / 25.4, ["ball_radius_mm = 0.118"]),
        ({"length_mm": 3.15, "width_mm": 2.36, "height_mm": 1.18}, 1.5, ["length_mm = 3.15"]),
        ({"kind": "sphere", "diameter_mm": 1.0, "centre_mm": (2, 0, 3)}, 1.5, ["diameter_mm = 1"]),
        ({"length_mm": 3.15, "width_mm": 1.0, "height_mm": 1.0}, 0.0787, ["ball_", "length_"]),
        ({}, 0.15, []),
        ({"length_mm": 25.0, "width_mm": 8.0, "height_mm": 5.0}, 0.125, []),
    ],
)
def test_a_set_up_in_inches_is_asked_about(
    artefact: dict[str, Any], radius: float, said: list[str]
) -> None:
    """By its sizes alone: with what is planned and identified, or why nothing can be planned."""
    without_kind = {key: value for key, value in artefact.items() if key != "kind"}
    setup = tn.Setup(
        artefact=tn.Artefact(artefact.get("kind", "cuboid"), **without_kind),
        probe=tn.Probe(ball_radius_mm=radius),
    )
    doubts = length_doubts(setup)
    assert len(doubts) == len(said)
    for doubt, text in zip(doubts, said, strict=True):
        assert text in doubt
        assert "are these inches (25.4 times as large in mm)" in doubt
    if artefact and said:  # nothing keeps clear of so small a one
        with pytest.raises(tn.DataError) as caught:
            tn.plan(setup)
        assert str(caught.value).endswith(f"Likely cause: {' '.join(doubts)}")
        return
    plan = tn.plan(setup)
    notes = tn.plan_notes(plan, setup)
    head = tn.probing_program(plan, setup).text()
    found = tn.identify(tn.simulate(plan, setup, noise_um=0.5, seed=1), setup).notes
    for where in (notes, found):
        assert [one for one in where if "are these inches" in one] == doubts
    assert head.count("are these inches") == len(doubts)


@pytest.mark.parametrize(("factor", "unit"), FACTORS)
def test_a_probe_or_places_of_axes_in_another_unit_are_named(factor: float, unit: str) -> None:
    """By the touches, where the other lengths of the set-up are right."""
    axes = {"A": tn.AxisSetup(point_mm=(0.0, 12.0, -40.0))}
    true = tn.Setup(artefact=tn.Artefact("cross"), probe=tn.Probe(ball_radius_mm=1.5), axes=axes)
    data = tn.simulate(tn.plan(true), true, errors={"EX0C": 20.0}, noise_um=0.5, seed=6)
    wrong = (0.0, factor * 12.0, factor * -40.0)
    for given, words in (
        (replace(true, probe=tn.Probe(ball_radius_mm=1.5 * factor)), "probe.ball_radius_mm is in "),
        (replace(true, axes={"A": tn.AxisSetup(point_mm=wrong)}), "the places of the axes"),
    ):
        said = likely_cause(tn.identify, data, given).replace(" was taken", " were taken")
        assert words in said, said
        assert f" in {unit}" in said


@pytest.mark.parametrize(
    ("kind", "lengths", "wrong"),
    [
        ("cross", {"width_mm": 25.0}, ("width_mm", "height_mm", "ball_radius_mm")),
        (
            "cross",
            {"length_mm": 120.0, "width_mm": 30.0, "height_mm": 20.0},
            ("width_mm", "height_mm", "ball_radius_mm"),
        ),
        (
            "cuboid",
            {"length_mm": 80.0, "width_mm": 60.0, "height_mm": 30.0, "place_mm": (5.0, 40.0, 0.0)},
            ("length_mm", "width_mm", "height_mm", "place_mm", "ball_radius_mm"),
        ),
        (
            "sphere",
            {"diameter_mm": 25.0, "centre_mm": (60.0, 30.0, 40.0)},
            ("diameter_mm", "centre_mm", "ball_radius_mm"),
        ),
    ],
)
def test_one_length_of_a_set_up_in_inches_is_named_alone(
    kind: str, lengths: dict[str, Any], wrong: tuple[str, ...]
) -> None:
    """Whatever the others are: as they are by default, or stated. No other length is suspected."""
    true = tn.Setup(tn.Artefact(kind, **lengths), probe=tn.Probe(ball_radius_mm=1.0))
    data = tn.simulate(tn.plan(true), true, errors={"EX0C": 20.0}, noise_um=0.5, seed=103)
    for name in wrong:
        part = "probe" if name == "ball_radius_mm" else "artefact"
        table: Any = getattr(true, part)
        value = np.divide(getattr(table, name), 25.4).tolist()
        changed = {name: tuple(value) if isinstance(value, list) else value}
        given = replace(true, **{part: replace(table, **changed)})
        said = likely_cause(tn.identify, data, given)
        assert f"if {part}.{name} is in inches" in said, said
        assert "the lengths in" not in said
        assert said.count("in inches") == 1


@pytest.mark.parametrize("off_mm", [0.4, 1.5])
def test_touches_beside_their_approach_are_named(off_mm: float) -> None:
    """Two touches from above read right 1.5 mm beside where they were planned: the top is flat."""
    cuboid = tn.Artefact("cuboid", length_mm=80.0, width_mm=60.0, height_mm=30.0)
    setup = tn.Setup(artefact=cuboid)
    data = tn.simulate(tn.plan(setup), setup, errors={"EX0C": 20.0}, noise_um=0.5, seed=5)
    above = np.flatnonzero(data.direction[:, 2] < -0.9)[:2]
    x_mm = data["x_mm"].copy()
    x_mm[above] += off_mm
    for method in (tn.identify, tn.diagnose):
        assert not any("beside the line" in note for note in method(data, setup).notes)
        notes = method(data.with_columns(x_mm=x_mm), setup).notes
        said = [note for note in notes if "beside the line" in note]
        assert len(said) == (off_mm > 0.5)
        for note in said:
            assert note.startswith(f"2 of {len(data)} touches are up to 1.5 mm beside the line")
            assert f"rows {above[0]} and {above[1]}" in note or f"{above[0]}, {above[1]}" in note


@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc"])
@pytest.mark.parametrize("centre", [(-30.0, 10.0, 80.0), (30.0, 70.0, 80.0), (0.0, 0.0, 120.0)])
def test_a_centre_of_a_sphere_far_from_where_it_stands_is_named(
    preset: str, centre: tuple[float, float, float]
) -> None:
    """On a table that turns, the touches are off by a vector that turns with it."""
    stands: dict[str, Any] = {"place_mm": (5.0, -3.0, 2.0), "turn_deg": 30.0}
    true = tn.Setup(artefact=tn.Artefact(**SPHERE, **stands), machine=tn.Machine(preset=preset))
    given = replace(true, artefact=replace(true.artefact, centre_mm=centre))
    for seed in range(3):
        data = tn.simulate(tn.plan(true), true, errors={"EX0C": 20.0}, noise_um=0.5, seed=seed)
        for method in (tn.identify, tn.diagnose):
            stated = ", ".join(f"{v:g}" for v in centre)
            said = likely_cause(method, data, given, is_refused=True)
            where = r"with artefact\.centre_mm = \[([\d.]+), ([\d.]+), ([\d.]+)\]"
            found = re.match(rf"the touches fit to \S+ µm {where} \(not \[{stated}\]\)\.$", said)
            assert found, said
            near = np.array([float(one) for one in found.groups()])
            assert np.allclose(near, SPHERE["centre_mm"], atol=0.11)


@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc"])
@pytest.mark.parametrize("kind", ["cross", "cuboid"])
@pytest.mark.parametrize("off", [(9.0, 0.0, 0.0), (-30.0, 22.0, 4.0), (3.0, -55.0, 11.0)])
def test_a_place_of_an_artefact_far_from_where_it_stands_is_named(
    off: tuple[float, float, float], kind: str, preset: str
) -> None:
    """On a table that turns, the touches are off by a vector that turns with it."""
    stands = (12.0, -7.0, 15.0)
    sizes: dict[str, Any] = (
        {} if kind == "cross" else {"length_mm": 80.0, "width_mm": 60.0, "height_mm": 40.0}
    )
    artefact = tn.Artefact(kind, place_mm=stands, turn_deg=30.0, **sizes)
    true = tn.Setup(artefact=artefact, machine=tn.Machine(preset=preset))
    wrong: Any = tuple(a + b for a, b in zip(stands, off, strict=True))
    given = replace(true, artefact=replace(artefact, place_mm=wrong))
    for seed in range(3):
        data = tn.simulate(tn.plan(true), true, errors={"EX0C": 20.0}, noise_um=0.5, seed=seed)
        assert tn.identify(data, true).notes == ()
        for method in (tn.identify, tn.diagnose):
            stated = ", ".join(f"{v:g}" for v in wrong)
            said = likely_cause(method, data, given, is_refused=True)
            where = r"with artefact\.place_mm = \[(\S+), (\S+), (\S+)\]"
            found = re.search(rf"{where} \(not \[{stated}\]\)", said)
            assert found, said
            near = np.array([float(one) for one in found.groups()])
            assert np.allclose(near, stands, atol=0.21)


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


def test_a_rotary_axis_far_from_its_zero_is_named() -> None:
    """A work offset with half a degree of A: residuals are perfect, EA0A holds it."""
    data = measured(SETUP)
    shifted = tn.simulate(PLAN, SETUP, errors={"EA0A": 1800.0}, noise_um=0.3, seed=1)
    for method in METHODS:
        notes = method(shifted, SETUP).notes
        assert any("a work offset that shifts A" in note for note in notes)
        assert not any("work offset" in note for note in method(data, SETUP).notes)


def test_known_errors_larger_than_any_machine_has_are_asked_about_when_a_plan_is_made() -> None:
    known = replace(SETUP, machine=tn.Machine(errors={"EX0C": 25_400.0}))
    with pytest.warns(UserWarning, match=r"EX0C = 25400: more than 2 mm.*1000 times too large"):
        tn.plan(known)


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


@pytest.mark.parametrize("kind", ["cross", "cuboid", "sphere"])
def test_exchanged_columns_and_a_missing_tool_length_are_named(kind: str) -> None:
    sizes: dict[str, dict[str, Any]] = {
        "cross": {},
        "cuboid": {"length_mm": 60.0, "width_mm": 40.0, "height_mm": 30.0},
        "sphere": {"diameter_mm": 25.0, "centre_mm": (60.0, 0.0, 80.0)},
    }
    setup = tn.Setup(tn.Artefact(kind, **sizes[kind]))
    data = tn.simulate(tn.plan(setup), setup, {"EX0C": 15.0}, {"dx_um": 90.0}, noise_um=0.5, seed=1)
    for method in (tn.identify, tn.diagnose):
        with pytest.raises(tn.DataError, match="if x_mm and y_mm are exchanged"):
            method(data.with_columns(x_mm=data.y_mm, y_mm=data.x_mm), setup)
        with pytest.raises(tn.DataError, match=r"tool is 50 mm longer .*was G43 off"):
            method(data.with_columns(z_mm=data.z_mm + 50.0), setup)
        with pytest.raises(tn.DataError, match=r"tool is 120 mm shorter .*lower \(place_mm\)"):
            method(data.with_columns(z_mm=data.z_mm - 120.0), setup)


def reversed_approaches(data: tn.Touches) -> tn.Touches:
    return data.with_columns(**{f"dir_{x}": -data[f"dir_{x}"] for x in "xyz"})


def exchanged_axes(data: tn.Touches) -> tn.Touches:
    names = [name for x in "yz" for name in (f"{x}_mm", f"dir_{x}")]
    others = (data[name] for name in (*names[2:], *names[:2]))
    return data.with_columns(**dict(zip(names, others, strict=True)))


def of_the_contact(data: tn.Touches) -> tn.Touches:
    """Report where the ball touches: its centre and the radius of 1 mm along the approach."""
    at = data.position_mm + data.direction
    return data.with_columns(x_mm=at[:, 0], y_mm=at[:, 1], z_mm=at[:, 2])


@pytest.mark.parametrize("seed", [4, 31, 77])
@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        (
            lambda d: d.with_columns(a_deg=d["c_deg"], c_deg=d["a_deg"]),
            "a_deg and c_deg are exchanged",
        ),
        (lambda d: d.with_columns(x_mm=-d["x_mm"]), "x_mm counts the other way"),
        (exchanged_axes, "Y and Z are exchanged, places and directions"),
        (reversed_approaches, "every direction of approach is reversed"),
        (of_the_contact, "the positions are those of the contact, already corrected by the ball"),
    ],
)
def test_columns_that_are_others_are_named(
    wrong: Callable[[tn.Touches], tn.Touches], cause: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    errors = {name: float(rng.uniform(-size, size)) for name, size in SIZES.items()}
    data = tn.simulate(PLAN, SETUP, errors=errors, noise_um=0.3, seed=seed)
    for method in (tn.identify, tn.diagnose):
        assert f"if {cause}" in said_of(method, wrong(data), SETUP)


@pytest.mark.parametrize(
    ("stated", "cause"),
    [
        ({"kind": "cuboid"}, 'artefact.kind = "cross"'),
        ({"height_mm": 50.0}, "artefact.height_mm = 25 (not 50)"),
    ],
)
def test_an_artefact_of_another_kind_or_height_is_named(stated: dict[str, Any], cause: str) -> None:
    data = tn.simulate(PLAN, SETUP, errors=ERRORS, noise_um=0.3, seed=8)
    wrong = replace(SETUP, artefact=replace(SETUP.artefact, **stated))
    for method in (tn.identify, tn.diagnose):
        assert cause in said_of(method, data, wrong)


def said_of(method: Callable[..., Any], data: tn.Touches, setup: tn.Setup) -> str:
    """Return the refusal, or the notes."""
    try:
        return " ".join(method(data, setup).notes)
    except tn.DataError as error:
        return str(error)


def test_length_and_width_exchanged_are_named() -> None:
    true = tn.Artefact("cuboid", length_mm=60.0, width_mm=40.0, height_mm=30.0)
    setup = tn.Setup(true)
    data = tn.simulate(tn.plan(setup), setup, {"EX0C": 15.0}, noise_um=0.5, seed=1)
    wrong = replace(setup, artefact=replace(true, length_mm=40.0, width_mm=60.0))
    with pytest.raises(tn.DataError, match=r"artefact\.length_mm and width_mm exchanged"):
        tn.identify(data, wrong)


def test_errors_in_mm_are_asked_about_when_a_plan_is_made() -> None:
    small = replace(SETUP, machine=tn.Machine(errors={"EX0C": 0.03, "EZ0A": 0.01}))
    with pytest.warns(UserWarning, match=r"\[machine\.errors\]: got EX0C = 0\.03.*are these mm"):
        tn.plan(small)


def test_the_servo_period_is_seen_at_two_feeds_and_not_taken_for_a_delay_unsaid() -> None:
    """A sound machine, a control that looks every ms, and nobody who said so."""
    control = replace(SETUP, probe=tn.Probe(servo_period_ms=1.0))
    plan = tn.plan(control, feeds_mm_min=(60.0, 600.0))
    data = tn.simulate(plan, control, {"EX0C": 20.3, "EA0A": 11.0}, noise_um=0.2, seed=3)
    for method in (tn.identify, tn.diagnose):
        assert any("state probe.servo_period_ms = 1." in note for note in method(data, SETUP).notes)
        assert not any("servo_period_ms = " in note for note in method(data, control).notes)
    assert tn.diagnose(data, control).verdict == "consistent"
    exact = tn.simulate(plan, SETUP, {"EX0C": 20.3, "EA0A": 11.0}, noise_um=0.2, seed=3)
    assert not any("servo_period_ms" in note for note in tn.identify(exact, SETUP).notes)


def machine(seed: int) -> dict[str, float]:
    """Errors of a machine of these seeds."""
    rng = np.random.default_rng(seed)
    return {name: float(rng.uniform(-size, size)) for name, size in SIZES.items()}


@pytest.mark.parametrize("seed", [6, 41, 903])
@pytest.mark.parametrize("tick", [{"tick_um": 10.0}, {"servo_period_ms": 1.0}])
def test_a_tick_that_is_stated_and_not_there_is_named(tick: dict[str, float], seed: int) -> None:
    """Half of it was taken off readings that a control latched; one that is there is not."""
    plan = tn.plan(SETUP, feeds_mm_min=(600.0,))
    placed = {"dx_um": 130.0, "dy_um": -70.0, "dz_um": 45.0}
    stated = replace(SETUP, probe=tn.Probe(**tick))
    latched = tn.simulate(plan, SETUP, machine(seed), placed, noise_um=0.3, seed=seed)
    for method in (tn.identify, tn.diagnose):
        name = next(iter(tick))
        assert any(f"Then probe.{name} = 0." in note for note in method(latched, stated).notes)
    looked = tn.simulate(plan, stated, machine(seed), placed, noise_um=0.3, seed=seed)
    assert not any("The readings scatter" in note for note in tn.identify(looked, stated).notes)


@pytest.mark.parametrize("seed", [6, 41, 903])
def test_half_a_tick_of_starts_that_differ_is_named(seed: int) -> None:
    """Starts anywhere between two looks, that nobody recorded: rounding is as random."""
    plan = tn.plan(SETUP, feeds_mm_min=(600.0,))
    exact = tn.simulate(plan, SETUP, machine(seed), {"dx_um": 130.0}, noise_um=0.2, seed=seed)
    late_um = np.random.default_rng(seed).uniform(0.0, 10.0, len(exact))
    at = exact.position_mm + 1e-3 * late_um[:, None] * exact.direction
    known = {n: exact[n] for n in exact.columns if not n.startswith("start_")}
    data = tn.Touches({**known, "x_mm": at[:, 0], "y_mm": at[:, 1], "z_mm": at[:, 2]})
    for method in (tn.identify, tn.diagnose):
        assert any("scatter as a control does" in note for note in method(data, SETUP).notes)
    noisy = tn.simulate(plan, SETUP, machine(seed), {"dx_um": 130.0}, noise_um=2.9, seed=seed)
    assert not any("as a control does" in note for note in tn.identify(noisy, SETUP).notes)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_mirrored_c_is_seen_by_a_cross_that_is_off_the_middle_alone(seed: int) -> None:
    """In the middle either sense fits, with the same errors: docs/how-to/common-mistakes.md."""
    meant = tn.Setup(tn.Artefact("cross"))
    mirrored = replace(meant, axes={"C": tn.AxisSetup(sense=-1)})
    plan, errors = tn.plan(meant), {"EX0C": 20.0, "EY0A": 10.0, "EB0C": 12.0, "EA0A": 8.0}

    def fits(off_um: float) -> list[tn.IdentificationResult]:
        touches = tn.simulate(
            plan, mirrored, errors, placement={"dx_um": off_um}, noise_um=0.3, seed=seed
        )
        return [tn.identify(touches, setup) for setup in (meant, mirrored)]

    wrong, right = fits(0.0)
    assert wrong.rms_um == pytest.approx(right.rms_um, rel=0.2)
    assert not wrong.notes
    for name, value in right.errors.items():
        assert abs(wrong.errors[name] - value) < 0.3 * right.std_errors[name]
    wrong, right = fits(20.0)
    assert any("sense = -1 of axis C" in note for note in wrong.notes)
    assert right.rms_um < 0.4
