"""Common mistakes are named for every kind of data; sound data are not asked about.

Each is made on the small measurement of the kind. What a file is refused for, and what is said
beside a diagnosis, are both read as a user reads them.
"""

from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import axis_log_twin as twin
import trunnion as tn
from measured import FOLDER, needs_files
from trunnion import datasets
from trunnion.base.units import unit_of
from trunnion.contouring import Servo
from trunnion.data.mistaken import size_notes
from trunnion.data.whole import in_inches, in_radians
from trunnion.diagnosis.model import Covariate
from trunnion.diagnosis.remaining import when_large
from trunnion.files.table import Table
from trunnion.models import examples
from trunnion.models.kinds import kinds, model_of

Made = tuple[Any, Any]


def times(made: Made, factor: float, unit: str, *, readings: bool, positions: bool = False) -> Made:
    """Columns of a unit times a factor."""
    data, setup = made
    columns = {**(data.readings if readings else {}), **(data.set_positions if positions else {})}
    some = {n: factor * v for n, v in columns.items() if unit_of(n) == unit}
    assert some
    return data.with_columns(**some), setup


REFUSED: list[tuple[str, Callable[[Made], Made], str]] = [
    ("points", lambda m: times(m, 1e3, "mm", readings=True), "are in µm (× 0.001)"),
    ("points", lambda m: times(m, 1 / 25.4, "mm", readings=True), "are in inches (× 25.4)"),
    ("points", lambda m: times(m, 1e-3, "mm", readings=True), "are in m (× 1000)"),
    ("sweep", lambda m: times(m, np.pi / 180, "deg", readings=False, positions=True), "radians"),
    ("ballbar", lambda m: times(m, 1e3, "mm", readings=True), "length_mm is in µm (× 0.001)"),
    ("ballbar", lambda m: times(m, 25.4, "mm", readings=True), "was taken for inches"),
    ("rotary_test", lambda m: times(m, 1e4, "µm", readings=True), "1000 times too large (× 0.001)"),
    (
        "rotary_bars",
        lambda m: times(m, 1 / 25.4, "mm", readings=False, positions=True),
        "x_mm, y_mm and z_mm are in inches (× 25.4)",
    ),
    (
        "rotary_test",
        lambda m: times(m, np.pi / 180, "deg", readings=False, positions=True),
        "a_deg and c_deg are in radians",
    ),
    ("hybrid_ballbar", lambda m: times(m, 1e3, "mm", readings=True), "length_mm is in µm"),
    (
        "rotary_bars",
        lambda m: times(m, 180 / np.pi, "deg", readings=False, positions=True),
        "a_deg and c_deg are in degrees but were taken for radians",
    ),
    ("diameters", lambda m: times(m, 25.4, "mm", readings=False, positions=True), "for inches"),
    ("diameters", lambda m: times(m, 1e3, "mm", readings=False, positions=True), "z_mm is in µm"),
]
REFUSED_IDS = [f"{name}: {said}" for name, _, said in REFUSED]


@pytest.mark.parametrize(("name", "mistake", "said"), REFUSED, ids=REFUSED_IDS)
def test_a_refusal_names_the_likely_unit(
    name: str, mistake: Callable[[Made], Made], said: str
) -> None:
    data, setup = mistake(getattr(examples, name)())
    with pytest.raises(tn.TrunnionError, match="Likely cause") as refused:
        model_of(data, setup)
    assert said in str(refused.value)


def test_whole_errors_of_diameters_in_nanometres_are_named() -> None:
    data, setup = examples.diameters()
    data = data.with_columns(error_um=data.error_um * 1e5)
    with pytest.raises(tn.DataError, match="1000 times too large"):
        model_of(data, setup)


def test_deviations_in_place_of_positions_are_named() -> None:
    data, _ = examples.points()
    off = {f"{a}_mm": data[f"{a}_mm"] - data[f"nominal_{a}_mm"] for a in "xyz"}
    with pytest.raises(tn.DataError, match="are deviations from the nominal places in mm"):
        model_of(data.with_columns(**off))
    off = {name: 1e3 * values for name, values in off.items()}  # µm
    with pytest.raises(tn.DataError, match="are deviations from the nominal places in µm"):
        model_of(data.with_columns(**off))
    stops, _ = examples.positioning()
    with pytest.raises(tn.DataError, match="are these deviations from the target"):
        model_of(stops.with_columns(measured_mm=stops["measured_mm"] - stops["target_mm"]))


def ball_bar(deviation_mm: float, factor: float) -> tn.Ballbar:
    """A circle of a bar of 120 mm in a tilted plane, off its centre, with deviations as lengths."""
    rng = np.random.default_rng(6)
    turn = np.linspace(0.0, 2 * np.pi, 90, endpoint=False)
    first, second = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    place = 120.0 * (np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second) + [30, -5, 80]
    off = deviation_mm + 0.02 * np.sin(turn) + 0.006 * np.cos(2 * turn) + rng.normal(0, 3e-4, 90)
    x, y, z = place.T
    columns: dict[str, Any] = {"setup": ["1"] * 90, "x_mm": x, "y_mm": y, "z_mm": z}
    return tn.Ballbar(**columns, length_mm=factor * off, feed_mm_min=np.full(90, 1000.0))


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "mm"), (1e3, "µm")])
def test_deviations_in_place_of_the_lengths_of_a_ball_bar_are_named(
    factor: float, unit: str
) -> None:
    with pytest.raises(tn.InputError, match="are these deviations"):
        ball_bar(0.0, factor)
    with pytest.raises(tn.DataError) as refused:  # all above 0
        model_of(ball_bar(0.05, factor))
    said = f"length_mm holds deviations from the nominal length in {unit}."
    assert str(refused.value).endswith(said)
    assert str(refused.value).count(" if ") == 1


def test_one_length_below_0_is_a_slip() -> None:
    columns: dict[str, Any] = {"setup": ["1"] * 20, "x_mm": range(20), "y_mm": range(20)}
    with pytest.raises(tn.InputError, match=r"above 0$"):
        tn.Ballbar(**columns, length_mm=[-100.0] + [100.0] * 19)


@pytest.mark.parametrize("factor", [25.4, 10.0, 1e3, 1e-3, 1 / 25.4])
def test_lengths_in_another_unit_are_no_deviations(factor: float) -> None:
    data, setup = examples.ballbar()
    with pytest.raises(tn.DataError, match="Likely cause") as refused:
        model_of(data.with_columns(length_mm=factor * data["length_mm"]), setup)
    assert "deviations" not in str(refused.value)


@pytest.mark.parametrize("scale_ppm", [0.0, 39.4, -120.0, 1000.0])
@pytest.mark.parametrize("suffix", ["mm", "deg"])
def test_deviations_in_um_or_arcsec_in_place_of_positions_of_an_axis_are_named(
    suffix: str, scale_ppm: float
) -> None:
    rng = np.random.default_rng(8)
    target = np.tile(np.linspace(3.0, 340.0, 11), 10)
    direction = np.repeat(np.tile([1, -1], 5), 11)
    deviation = 1e-3 * scale_ppm * target + 5 * np.sin(target / 50) + 2.0 * direction
    columns = {
        f"target_{suffix}": target,
        f"measured_{suffix}": deviation + rng.normal(0.0, 0.5, 110),
        "direction": direction,
        "cycle": np.repeat(np.arange(1, 6), 22),
    }
    data = tn.Positioning(columns)
    said = {"mm": "in µm?.*deviation / 1000", "deg": "in arcsec?.*deviation / 3600"}[suffix]
    with pytest.raises(tn.DataError, match=said.replace("?", r"\?")):
        model_of(data)
    with pytest.raises(tn.DataError, match="are these deviations"):
        data.iso230_2()


@pytest.mark.parametrize("axis", ["a_deg", "c_deg", "y_mm"])
def test_a_mirrored_sense_of_a_rotary_test_is_named(axis: str) -> None:
    data, setup = examples.rotary_test()
    with pytest.raises(tn.DataError, match=f"if {axis} counts the other way"):
        model_of(data.with_columns(**{axis: -data[axis]}), setup)


def test_an_identification_of_rotary_axes_names_it_too() -> None:
    data, setup = examples.rotary_test()
    radians, _ = times((data, setup), np.pi / 180, "deg", readings=False, positions=True)
    with pytest.raises(tn.DataError, match="a_deg and c_deg are in radians"):
        tn.identify_rotary_test(radians, setup)


def test_a_mirrored_reading_is_a_note() -> None:
    """A sensor that counts the other way is less than 5 mm: nothing refuses it."""
    setup = tn.read_setup(tn.sample_path("rotary/setup.toml"))
    data = tn.read_rotary_test(tn.sample_path("rotary/rtest.csv"))
    found = tn.diagnose(data.with_columns(dx_um=-data["dx_um"]), setup)
    assert "if dx_um counts the other way" in found.summary()
    assert "counts the other way" not in tn.diagnose(data, setup).summary()


def test_another_preset_is_named() -> None:
    other = tn.Setup(tn.Artefact("none"), tn.Machine("trt-bc"))
    ball, turns = (90.0, 20.0, 60.0), {"B": [0, 0, 40, -40, 60] * 3, "C": list(range(0, 300, 20))}
    planned = tn.plan_rotary_test(other, ball, turns)
    made = tn.simulate_rotary_test(planned, other, ball, {"EX0C": 9.0}, noise_um=0.3, seed=1)
    given = tn.Setup(tn.Artefact("none"), tn.Machine("head-bc"))
    with pytest.raises(tn.DataError, match='with preset = "trt-bc"'):
        model_of(made, given)


@pytest.mark.parametrize(
    ("axis", "factor", "said"),
    [
        ("x_act_mm", 1 / 25.4, "x_act_mm: its positions are in inches (× 25.4)"),
        ("x_act_mm", -1e3, "are in µm (× 0.001) and count the other way"),
        ("y_act_mm", 25.4, "are in mm but were taken for inches"),
        ("y_act_mm", -1.0, "got motion opposite to y_cmd_mm"),
        ("c_act_deg", np.pi / 180, "are in radians (× 57.3)"),
        ("c_act_deg", 180 / np.pi, "are in degrees but were taken for radians"),
        ("c_act_deg", 60.0, "are in arcminutes"),
    ],
)
def test_an_axis_of_a_log_in_another_unit_or_sense_is_named(
    axis: str, factor: float, said: str
) -> None:
    log, setup = examples.axis_log()
    with pytest.raises(tn.DataError) as refused:
        model_of(log.with_columns(**{axis: factor * log[axis]}), setup)
    assert said in str(refused.value)


SERVO = tn.Setup(tn.Artefact("none"), servo=Servo.paper().to_table())


@pytest.mark.parametrize(("axis", "ppm"), [(0, 400.0), (1, -3000.0), (2, 2e4)])
def test_positions_recorded_at_another_scale_are_named(axis: int, ppm: float) -> None:
    """By the twin; a gear ratio that is off was a cyclic error, a force and a resonance."""
    rng = np.random.default_rng(40 + axis)
    commands = tuple(twin.commanded(feed / 60) for feed in (1000, 3000))
    sound = [twin.actual(c, twin.Cases(1))[0] for c in commands]
    scale = np.ones(5)
    scale[axis] += 1e-6 * ppm
    found = tn.diagnose(twin.log(commands, [a * scale for a in sound], rng), SERVO)
    name = f"recorded_scale_{'xyzac'[axis]}"
    assert [c.id for c in found.causes] == [name]
    cause = found.causes[0]
    assert cause.parameters["scale_ppm"] == pytest.approx(
        ppm, abs=4 * cause.std_errors["scale_ppm"]
    )


def test_a_scale_far_from_the_zero_of_an_axis_is_among_the_sets() -> None:
    """C is at 95°: all of the run is 200" off, which is no noise of a servo and no cause alone."""
    rng = np.random.default_rng(44)
    commands = tuple(twin.commanded(feed / 60) for feed in (1000, 3000))
    sound = [twin.actual(c, twin.Cases(1))[0] for c in commands]
    scale = np.array([1.0, 1.0, 1.0, 1.0, 1.0006])
    found = tn.diagnose(twin.log(commands, [a * scale for a in sound], rng), SERVO)
    assert {"recorded_scale_c"} in found.alternatives
    assert all({c.rpartition("_")[2] for c in causes} == {"c"} for causes in found.alternatives)
    assert "at a scale" not in tn.diagnose(twin.log(commands, sound, rng), SERVO).summary()


# --- sizes: what is said beside a diagnosis


SIZES: list[tuple[str, str, float, bool, bool, str]] = [
    ("diameters", "µm", 0.01, True, False, "error_um: values differ by"),
    ("diameters", "µm", 1 / 25400, True, False, "are these inches (25400 times as large in µm)"),
    ("diameters", "mm", 1 / 25.4, False, True, "z_mm: 0.19685, 0.3937"),
    ("rotary_test", "µm", 1 / 254, True, False, "or inches (25400 times)"),
    ("levels", "mm", 1e-3, False, True, "position_mm: values reach 1.2 mm at most: are these m"),
    ("levels", "mm", 1 / 25.4, False, True, "are these inches"),
    ("surface_levels", "mm", 1 / 25.4, False, True, "are these inches"),
    ("positioning", "mm", 1 / 25.4, True, True, "target_mm: "),
    ("rotary_test", "µm", 1e-3, True, False, "are these mm (1000 times as large in µm)"),
    ("levels", "µm/m", 1e-3, True, False, "are these mm/m"),
    ("levels", "µm/m", 1e-6, True, False, "are these radians"),
    ("levels", "µm/m", 1e3, True, False, "made 1000 times too large"),
    ("surface_levels", "mm", 1e-3, False, True, "are these m (1000 times as large in mm)"),
    ("points", "mm", 1e-3, True, True, "are these m (1000 times as large in mm)"),
    ("ballbar", "mm", 1e3, True, True, "are these µm (1000 times as small in mm)"),
    ("positioning", "mm", 1e3, True, True, "are these µm (1000 times as small in mm)"),
    ("sweep", "deg", np.pi / 180, False, True, "are these radians"),
]


@pytest.mark.parametrize(("name", "unit", "factor", "readings", "positions", "said"), SIZES)
def test_a_size_of_another_unit_is_asked_about(
    name: str, unit: str, factor: float, readings: bool, positions: bool, said: str
) -> None:
    made = getattr(examples, name)()
    data, _ = times(made, factor, unit, readings=readings, positions=positions)
    assert said in " ".join(size_notes(data))
    assert not size_notes(made[0])


def test_the_summaries_of_levels_and_of_a_diagnosis_say_it() -> None:
    bed = tn.read_levels(tn.sample_path("levels/bed.csv"))
    in_mm_m = bed.with_columns(along_um_m=bed["along_um_m"] * 1e-3, across_um_m=None)
    assert "are these mm/m" in in_mm_m.straightness().summary()
    assert "are these mm/m" in tn.diagnose(in_mm_m).summary()
    assert "are these" not in bed.straightness().summary()


def test_errors_of_the_machine_in_mm_are_asked_about() -> None:
    data, setup = examples.rotary_test()
    known = tn.Setup(setup.artefact, tn.Machine("trt-ca", errors={"EX0C": 0.005}))
    assert "[machine.errors] has EX0C = 0.005: are these mm?" in tn.diagnose(data, known).summary()


def test_lengths_beyond_any_machine_are_asked_about() -> None:
    with pytest.raises(tn.InputError, match="are these µm"):
        tn.Levels(position_mm=[0.0, 2e6], along_um_m=[1.0, 2.0])


# --- sound data


EXAMPLES = [example for kind in kinds() for example in kind.examples]


@pytest.mark.parametrize("example", EXAMPLES)
def test_sound_data_of_every_kind_are_not_asked_about(example: str) -> None:
    assert size_notes(resolve_name(example)()[0]) == ()


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.csv"))


@pytest.mark.parametrize("file", files(tn.sample_path("plate/first.csv").parents[1]), ids=str)
def test_samples_are_not_asked_about(file: Path) -> None:
    data = tn.read(file)
    assert isinstance(data, Table)
    assert size_notes(data) == ()


@needs_files
@pytest.mark.parametrize("name", datasets.names())
def test_measured_files_are_not_asked_about(name: str) -> None:
    assert size_notes(datasets.load(name, FOLDER)) == ()


def test_a_second_rotation_in_a_sweep_is_no_unit() -> None:
    """Smaller readings would be within any limit of a refusal: this is no evidence."""
    there = np.arange(0.0, 360.0, 1.0)
    angle = np.concatenate([there, there[::-1]])
    tilt = np.where(np.arange(720) < 360, 0.0, 0.0015)
    turn = np.radians(angle)
    x, y, z = 200 * np.cos(turn), 200 * np.sin(turn), 200 * tilt * np.cos(3 * turn)
    data = tn.Sweep(angle_deg=angle, target=np.ones(720, int), x_mm=x, y_mm=y, z_mm=z)
    with pytest.raises(tn.DataError) as refused:
        model_of(data)
    assert "Likely cause" not in str(refused.value)


def test_another_place_of_a_ball_is_no_unit() -> None:
    data, setup = examples.rotary_bars()
    off = tn.Setup(setup.artefact, rotary_test={"balls_mm": [(130.0, -20.0, 60.0)] * 3})
    with pytest.raises(tn.DataError) as refused:
        model_of(data, off)
    assert "are in" not in str(refused.value)
    assert "too large" not in str(refused.value)


def test_round_positions_and_those_of_inches_are_not_taken_for_inches() -> None:
    rng = np.random.default_rng(3)
    for _ in range(2000):
        step = rng.choice([0.1, 0.25, 0.4, 1.0, 2.5, 5.0, 12.5, 100 / 3, 100 / 7, 25.4, 3.175])
        start = rng.choice([0.0, 0.5, 1.0, step / 2, rng.uniform(0.0, 100.0)])
        grid = start + step * np.arange(rng.integers(3, 40))
        digits = rng.integers(2, 6)
        assert not in_inches([np.round(grid, digits)])
        assert not in_inches([np.round(rng.uniform(-300, 300, rng.integers(3, 40)), digits)])
        turn = 2 * np.pi * np.arange(rng.integers(3, 40)) / rng.integers(3, 40)
        radius = rng.choice([50.0, 100.0, 150.0])
        assert not in_inches([radius * np.cos(turn), radius * np.sin(turn)])
    for step in (0.1, 1.0, 2.5, 7.0, 50.0):
        assert in_inches([np.round(step * np.arange(1, 12) / 25.4, 4)])


def test_degrees_are_not_taken_for_radians() -> None:
    rng = np.random.default_rng(2)
    for _ in range(500):
        step = rng.choice([0.5, 1.0, 5.0, 7.5, 30.0, 360 / 7])
        assert not in_radians(np.arange(0.0, 360.0, step))
        assert not in_radians(rng.uniform(-180.0, 180.0, rng.integers(3, 30)))
        assert not in_radians(rng.uniform(-6.0, 6.0, rng.integers(3, 30)))
    for step in (1.0, 5.0, 15.0, 30.0):
        assert in_radians(np.radians(np.arange(0.0, 360.0, step)))
        assert in_radians(np.round(np.radians(np.arange(-90.0, 91.0, step)), 5))


# --- a wrong likely cause is worse than none


def plate(seed: int = 3) -> tn.Points:
    """Measured holes of a plate that is a little turned, by formulas of its own."""
    rng = np.random.default_rng(seed)
    x, y = (v.ravel() for v in np.meshgrid(np.arange(9) * 40.0, np.arange(7) * 50.0))
    turn = 0.004
    at_x = np.cos(turn) * x - np.sin(turn) * y + 2.0 + 1e-3 * rng.normal(0.0, 1.5, x.size)
    at_y = np.sin(turn) * x + np.cos(turn) * y - 1.0 + 1e-3 * rng.normal(0.0, 1.5, x.size)
    return tn.Points(nominal_x_mm=x, nominal_y_mm=y, x_mm=at_x, y_mm=at_y)


def refusal(data: Any, setup: Any = None) -> str:
    with pytest.raises(tn.DataError) as refused:
        tn.diagnose(data, setup)
    return str(refused.value)


@pytest.mark.parametrize(
    ("factor", "unit"), [(1 / 25.4, "is in inches"), (1e-3, "is in m"), (1e3, "is in µm")]
)
def test_one_column_of_a_plate_in_another_unit_is_no_deviation(factor: float, unit: str) -> None:
    """The whole plate was called deviations in µm: what is small enough fits any model."""
    data = plate()
    said = refusal(data.with_columns(x_mm=factor * data["x_mm"]))
    assert f"if x_mm {unit}" in said
    assert "deviations" not in said


def test_one_hole_in_another_unit_is_no_deviation() -> None:
    data = plate()
    x_mm = np.array(data["x_mm"])
    x_mm[30] /= 25.4
    said = refusal(data.with_columns(x_mm=x_mm))
    assert f"Likely cause: 1 of {len(data)} rows does not go with the others" in said
    assert "row 30 (counted from 0) holds" in said
    assert "deviations" not in said
    assert "inches" not in said


@pytest.mark.parametrize("factor", [1.0, 1e3])
def test_deviations_of_a_turned_plate_are_named(factor: float) -> None:
    data = plate()
    off = {f"{a}_mm": factor * (data[f"{a}_mm"] - data[f"nominal_{a}_mm"]) for a in "xy"}
    assert "are deviations from the nominal places in" in refusal(data.with_columns(**off))


def test_a_part_that_is_longer_than_the_overhang_is_not_called_inches() -> None:
    data, setup = examples.diameters()
    said = refusal(data.with_columns(z_mm=1.7 * data["z_mm"]), setup)
    assert "expected at most the overhang" in said
    assert "Likely cause" not in said


def test_diameters_in_place_of_their_errors_are_not_called_errors_in_nm() -> None:
    data, setup = examples.diameters()
    assert "Likely" not in refusal(data.with_columns(error_um=4e4 + data["error_um"]), setup)


@pytest.mark.parametrize(
    ("measured", "target", "said"),
    [
        (1 / 25.4, 1.0, "are these inches?"),
        (0.1, 1.0, "are these cm?"),
        (1.0, 1e3, "are these m, or the targets µm?"),
        (-1.0, 1.0, "does the instrument count the other way?"),
        (0.0, 1.0, "got 0 in every row"),
    ],
)
def test_positions_that_move_otherwise_are_asked_about(
    measured: float, target: float, said: str
) -> None:
    data, _ = examples.positioning()
    changed = {
        "measured_mm": measured * data["measured_mm"],
        "target_mm": target * data["target_mm"],
    }
    assert said in refusal(data.with_columns(**changed))


def test_a_whole_positioning_test_in_um_is_no_deviation() -> None:
    data, _ = examples.positioning()
    moved = {name: 1e3 * data[name] for name in ("target_mm", "measured_mm")}
    assert "are these µm (1000 times" in tn.diagnose(data.with_columns(**moved)).notes[0]


@pytest.mark.parametrize(("factor", "said"), [(np.pi / 180, "radians"), (180 / np.pi, "targets")])
def test_a_rotary_axis_in_radians_is_asked_about(factor: float, said: str) -> None:
    target = np.tile(np.linspace(0.0, 330.0, 12), 4)
    columns = {
        "target_deg": target,
        "measured_deg": factor * (target + 1e-3 * np.sin(np.radians(target))),
        "direction": np.repeat([1, -1, 1, -1], 12),
        "cycle": np.repeat([1, 1, 2, 2], 12),
    }
    assert f"are the{'se' if said == 'radians' else ''}" in refusal(tn.Positioning(columns))
    assert said in refusal(tn.Positioning(columns))


@pytest.mark.parametrize(("small", "factor"), [("mm", 1.0), ("mm", -1.0), ("µm", 1e3)])
def test_following_errors_in_place_of_positions_are_asked_about(small: str, factor: float) -> None:
    """They were a motion opposite to the command, or another axis."""
    log, setup = examples.axis_log()
    errors = factor * (log["x_cmd_mm"] - log["x_act_mm"])
    said = refusal(log.with_columns(x_act_mm=errors), setup)
    which = "commanded less actual" if factor > 0 else "actual less commanded"
    assert f"are these following errors, {which}, in {small}?" in said


@pytest.mark.parametrize(
    ("columns", "factor", "said"),
    [
        (("along_um_m", "across_um_m"), np.pi / 180 * 1e-4, "or degrees (17453 times)"),
        (("along_um_m",), 1e-3, "along_um_m: values differ by"),
        (("across_um_m",), 1e3, "across_um_m: values differ by"),
    ],
)
def test_levels_in_another_unit_are_asked_about_column_by_column(
    columns: tuple[str, ...], factor: float, said: str
) -> None:
    bed = tn.read_levels(tn.sample_path("levels/bed.csv"))
    changed = bed.with_columns(**{name: factor * bed[name] for name in columns})
    assert said in " ".join(size_notes(changed))


def test_readings_in_m_are_not_only_called_inches() -> None:
    data, _ = examples.rotary_test()
    some = {name: 1e-6 * data[name] for name in ("dx_um", "dy_um", "dz_um")}
    assert "m (10⁶ times" in " ".join(size_notes(data.with_columns(**some)))


def test_a_cross_whose_length_alone_is_in_inches_is_asked_about() -> None:
    """It is refused as no cross before any touch is looked at."""
    with pytest.raises(tn.InputError, match=r"arms \(is length_mm in inches, 100 mm\?\)$"):
        tn.Artefact("cross", length_mm=100.0 / 25.4)
    with pytest.raises(tn.InputError, match=r"a cross has arms$"):
        tn.Artefact("cross", length_mm=90.0, width_mm=95.0)


def test_a_stretch_that_is_the_whole_time_is_not_named() -> None:
    """Of two axes at the same times one has all of the residual, throughout or in part."""
    half = 400
    time = Covariate("time", np.tile(np.linspace(0.0, 4.0, half), 2), "s", sequence=True)
    model: Any = SimpleNamespace(covariates=(time,))
    left = np.tile([1.0, -1.0], half)
    left[:half] *= 20.0
    segments = [np.arange(half), np.arange(half, 2 * half)]
    assert when_large(model, left, segments) == ""
    left[:half] /= 20.0
    left[:100] *= 20.0
    assert "of it lies at time 0 to 0.99" in when_large(model, left, segments)
