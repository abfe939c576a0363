"""Files for controls: tables as LinuxCNC applies them, old and new values, refusals."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from reference_trt_ca import TABLE_2
from trunnion.cli import app
from trunnion.controls import (
    comp_file,
    iso_table,
    linuxcnc_files,
    measured_comp_file,
    twincat_files,
)
from trunnion.setup.control import ControlSetup

SETUP = tn.Setup(
    artefact=tn.Artefact("none"),
    axes={
        "X": tn.AxisSetup(range_mm=(-200, 200)),
        "C": tn.AxisSetup(range_deg=(-360, 360)),
        "A": tn.AxisSetup(range_deg=(-120, 30), sense=-1),
    },
    control=ControlSetup(centre_mm=(210.5, 148.2, -301.0)),
)
EFFECTS = {
    "c_positioning": {"a1_arcsec": 20.0, "b1_arcsec": -12.0},
    "c_positioning_2": {"a2_arcsec": 3.0, "b2_arcsec": 8.0},
    "c_backlash": {"b_arcsec": 30.0},
    "a_scale": {"k_arcsec": 15.0},
    "a_positioning": {"k_arcsec": -9.0},
    "scale_x": {"ppm": 55.0},
    "backlash_x": {"b_um": 6.0},
}


def estimate(effects: dict[str, dict[str, float]]) -> tn.Estimate:
    return tn.Estimate(errors=dict(TABLE_2), effects=effects)


def motor(table: str, position: float, forward: bool) -> float:
    """What LinuxCNC sends to the motor: the position, and what the table takes off."""
    rows = np.array([[float(v) for v in line.split()] for line in table.splitlines()])
    actual = rows[:, 1 if forward else 2]
    taken_off = np.interp(position, rows[:, 0], rows[:, 0] - actual)
    return float(position + taken_off)


def test_a_measured_axis_is_corrected_over_its_turns(tmp_path: Path) -> None:
    """A rotary axis with a wave and a reversal, measured every 30°: as a Pocket NC's B."""

    def reached(sent: float, sense: int) -> float:
        return sent + (40 * float(np.sin(np.radians(sent))) - 15 * sense) / 3600

    stops = [(t, d, c) for c in (1, 2) for d in (1, -1) for t in np.arange(0.0, 361.0, 30.0)]
    target, sense, cycle = (np.array(column) for column in zip(*stops, strict=True))
    measured = [reached(t, d) for t, d, _ in stops]
    data = tn.Positioning(
        target_deg=target, measured_deg=measured, direction=sense.astype(int), cycle=cycle
    )
    data.to_csv(tmp_path / "b.csv")
    arguments = ["positioning", "results", str(tmp_path / "b.csv"), "--turns", "9"]
    arguments += ["--comp-file", str(tmp_path / "comp_b.txt")]
    done = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    text = (tmp_path / "comp_b.txt").read_text()
    rows = [line.split() for line in text.splitlines()]
    assert len(rows) == 19 * 12 <= 256
    for position in np.linspace(-3200, 3500, 400):
        for d in (1, -1):
            left = reached(motor(text, position, d > 0), d) - position
            # Between nodes a chord leaves 1 - cos 15° of the wave.
            assert 3600 * abs(left) < 40 * (1 - np.cos(np.radians(15))) + 0.05
    table = data.iso230_2().compensation_table()
    with pytest.raises(tn.InputError, match="684 rows, expected at most 256: 4 targets a turn"):
        measured_comp_file(table, turns=28)
    linear = tn.read_positioning(tn.sample_path("positioning/axis.csv")).iso230_2()
    with pytest.raises(tn.InputError, match="turns: got 2 for an axis in mm"):
        measured_comp_file(linear.compensation_table(), turns=2)


@pytest.mark.parametrize("forward", [True, False])
def test_tables_leave_what_lies_between_their_rows(forward: bool) -> None:
    files = linuxcnc_files(SETUP, estimate(EFFECTS)).files
    sense = 1 if forward else -1
    for position in np.linspace(-359, 359, 101):
        sent = motor(files["comp_c.txt"], position, forward)
        c = np.radians(sent)
        ecc = 20 * (np.cos(c) - 1) - 12 * np.sin(c) + 3 * (np.cos(2 * c) - 1) + 8 * np.sin(2 * c)
        reached = sent + (ecc - 15.0 * sense) / 3600
        # Two waves a turn bend by amplitude × (2 × 5°)² / 8 between rows; slopes are small.
        assert (
            3600 * abs(reached - position) < (23.3 * np.radians(5) ** 2 + 8.5 * 0.0305) / 8 + 0.05
        )
    for position in np.linspace(-119, 29, 50):
        sent = motor(files["comp_a.txt"], position, forward)
        a = -sent  # the control counts A the other way
        eaa = 15 * a / 90 - 9 * np.sin(np.radians(a))
        assert 3600 * abs(-(a + eaa / 3600) - position) < 0.02
    for position in np.linspace(20, 400, 30):
        sent = motor(files["comp_x.txt"], position, forward)
        assert 1e3 * abs(sent - 3e-3 * sense - position) < 1e-3  # scale is in the kinematics


def test_tables_are_what_linuxcnc_reads() -> None:
    files = linuxcnc_files(SETUP, estimate(EFFECTS)).files
    for name in ("comp_a.txt", "comp_c.txt", "comp_x.txt"):
        lines = files[name].splitlines()
        assert len(lines) <= 256
        assert all(len(line.split()) == 3 for line in lines)
    ini = files["trunnion.ini"]
    assert "[JOINT_4]\nCOMP_FILE = comp_c.txt\nCOMP_FILE_TYPE = 0\n" in ini
    with pytest.raises(tn.InputError, match="got 257 rows, expected 2 to 256"):
        comp_file(np.arange(257.0), np.arange(257.0), np.arange(257.0))
    with pytest.raises(tn.InputError, match="do not ascend"):
        comp_file([1.0, 0.0], [1.0, 0.0], [1.0, 0.0])


def test_what_has_no_place_is_said() -> None:
    wobble = {"c_wobble_2": {"ax_arcsec": 5.0}}
    made = linuxcnc_files(SETUP, estimate(EFFECTS | wobble | {"backlash_y": {"b_um": 4.0}}))
    said = made.summary()
    assert "Not compensated: backlash_y (its table needs [axes.Y] range_mm, or --range)." in said
    assert "c_wobble_2" not in said
    assert made.after_um < 1e-6  # error motions are in the kinematics, reversal is no field
    assert linuxcnc_files(SETUP, TABLE_2).after_um < 1e-6
    oblique = tn.Setup(
        artefact=SETUP.artefact,
        machine=tn.Machine(preset="nutating-table"),
        axes={"C": SETUP.axes["C"]},
        control=SETUP.control,
    )
    known = tn.Estimate(errors={"EX0C": 10.0}, effects={"b_twist": {"k_arcsec": 20.0}})
    left = linuxcnc_files(oblique, known)
    assert left.left_out == ("b_twist (LinuxCNC with trunnionkins has no place for it)",)
    assert left.after_um > 1.0  # and stays in the forecast


def test_present_values_stand_beside_the_new_ones(tmp_path: Path) -> None:
    hal, ini = tmp_path / "my.hal", tmp_path / "my.ini"
    hal.write_text("loadrt x\nsetp trunnionkins.ex0c-um 7.5\nsetp other.pin TRUE\n")
    ini.write_text("[JOINT_3]\nHOME_OFFSET = 1.5\nHOME = 0.25\n[JOINT_4]\nHOME_OFFSET = -2\n")
    made = linuxcnc_files(SETUP, TABLE_2, present=[hal, ini])
    old = {one.name: one.old for one in made.settings}
    assert old["trunnionkins.ex0c-um"] == 7.5
    assert old["trunnionkins.ea0a-arcsec"] is None
    both = tn.Setup(artefact=SETUP.artefact, control=SETUP.control)
    stock = linuxcnc_files(both, TABLE_2, kinematics="stock", present=[ini])
    new = {one.name: one.new for one in stock.settings}
    zeros = tn.cnc_parameters(both, TABLE_2).zeros_arcsec
    assert new["[JOINT_3] HOME_OFFSET"] == pytest.approx(1.5 - zeros["A"] / 3600)
    assert new["[JOINT_3] HOME"] == pytest.approx(0.25 - zeros["A"] / 3600)
    assert new["[JOINT_4] HOME_OFFSET"] == pytest.approx(-2 - zeros["C"] / 3600)
    hal.write_text("setp trunnionkins.ex0c-um seven\n")
    with pytest.raises(tn.FileFormatError, match=r"my.hal, line 1: got 'seven', expected a number"):
        linuxcnc_files(SETUP, TABLE_2, present=[hal])
    for no_number in ("nan", "inf", "1e999", "1_5"):
        ini.write_text(f"[JOINT_3]\nHOME_OFFSET = {no_number}\n")
        with pytest.raises(tn.FileFormatError, match=f"line 2: got '{no_number}', expected"):
            linuxcnc_files(SETUP, TABLE_2, present=[ini])


def test_stock_kinematics_get_tables_of_their_axes() -> None:
    plain = tn.Setup(
        artefact=SETUP.artefact,
        control=SETUP.control,
        axes={"X": SETUP.axes["X"], "C": SETUP.axes["C"]},
    )
    stock = linuxcnc_files(plain, estimate(EFFECTS), kinematics="stock")
    alone = linuxcnc_files(plain, TABLE_2, kinematics="stock")
    left = {name for name in EFFECTS if name.startswith("a_")}
    assert {text.partition(" (")[0] for text in stock.left_out} >= left
    assert "[JOINT_4]\nCOMP_FILE = comp_c.txt\n" in stock.files["trunnion.ini"]
    table = np.loadtxt(stock.files["comp_x.txt"].splitlines())
    middle = table[:, 0] - table[:, 1:].mean(axis=1)
    np.testing.assert_allclose(middle, -55e-6 * (table[:, 0] - 210.5), rtol=0, atol=1e-6)
    # Effects of A have no table without its range; the others leave what location errors leave.
    without = {name: values for name, values in EFFECTS.items() if name not in left}
    both = linuxcnc_files(plain, estimate(without), kinematics="stock")
    assert both.after_um == pytest.approx(alone.after_um, abs=1e-6)
    assert both.before_um > alone.before_um + 1


def test_the_interval_is_of_what_these_files_leave() -> None:
    """Not of an exact correction: what has no place in the control is in it."""
    names = tuple(TABLE_2)
    known = tn.Estimate(
        errors=dict(TABLE_2),
        effects={"c_wobble_2": {"ax_arcsec": 9.0}},
        std_errors=dict.fromkeys(names, 0.5),
        names=names,
        covariance=0.25 * np.eye(len(names)),
    )
    plain = tn.Setup(artefact=SETUP.artefact, control=SETUP.control)
    exact = linuxcnc_files(plain, known)
    stock = linuxcnc_files(plain, known, kinematics="stock")
    tables = twincat_files(plain, known)
    for files, least in ((exact, 0.1), (stock, 20.0), (tables, 40.0)):
        assert files.interval_um is not None
        low, high = files.interval_um
        assert least < low < high
        assert high - low < 10
    assert stock.interval_um is not None
    assert stock.interval_um[0] < stock.after_um < stock.interval_um[1]


def test_a_diagnosis_goes_to_the_control_as_it_is_printed(tmp_path: Path) -> None:
    cross = tn.sample_path("cross/setup.toml").parent
    done = CliRunner().invoke(
        app, ["diagnose", str(cross / "touches.csv"), str(cross / "setup.toml"), "--json"]
    )
    (tmp_path / "found.json").write_text(done.output)
    diagnosis = tn.diagnose(
        tn.read_touches(cross / "touches.csv"), tn.read_setup(cross / "setup.toml")
    )
    found = tn.read_estimate(tmp_path / "found.json")
    assert found.errors == pytest.approx(diagnosis.model.errors)
    assert found.effects.keys() == diagnosis.model.effects.keys()


def test_what_nobody_measured_or_believes_is_not_written() -> None:
    with pytest.raises(tn.InputError, match="EZ0A: got 30000 µm, expected at most 2000"):
        linuxcnc_files(SETUP, {"EZ0A": 30_000.0})
    assert linuxcnc_files(SETUP, {"EZ0A": 30_000.0}, any_size=True).files
    unknown = tn.Estimate(errors=dict(TABLE_2), std_errors={"EB0A": np.inf})
    with pytest.raises(tn.DataError, match="EB0A: got no estimate"):
        linuxcnc_files(SETUP, unknown)


def test_the_table_for_people_says_what_a_centre_absorbs() -> None:
    plain = tn.Setup(artefact=SETUP.artefact, control=SETUP.control)
    stock = linuxcnc_files(plain, TABLE_2, kinematics="stock")
    row = next(one for one in stock.settings if one.name.endswith("x-rot-point"))
    said = re.fullmatch(r"EX0C ([+-][\d.]+) µm, tilts ([+-][\d.]+) µm", row.why)
    assert said is not None, row.why
    estimated, absorbed = map(float, said.groups())
    assert estimated == TABLE_2["EX0C"]
    assert row.new == pytest.approx(210.5 + 1e-3 * (estimated + absorbed), abs=1e-4)
    rows = list(csv.DictReader(stock.files["settings.csv"].splitlines()))
    assert [r["name"] for r in rows] == [one.name for one in stock.settings]
    assert all(r["sign"] for r in rows)
    assert "why not the estimate" in stock.summary()


def test_the_command_writes_for_every_control(tmp_path: Path) -> None:
    (tmp_path / "e.json").write_text(json.dumps({"EX0C": 15.0, "EA0A": 20.0}))
    (tmp_path / "s.toml").write_text(
        '[artefact]\nkind = "cross"\n[control]\ncentre_mm = [1, 2, 3]\n'
    )
    stated = {
        "isg": ("angle_unit=rad", "sign=1", "chain=CAXYZ"),
        "etalon": ("angle_unit=rad", "sign=1", "chain=CAXYZ"),
        "siemens": ("vector_sign=1",),
        "heidenhain": ("chain_sign=1",),
        "twincat": (), "table": (), "linuxcnc": (),
    }  # fmt: skip
    for control, words in stated.items():
        folder = tmp_path / control
        arguments = ["compensate", str(tmp_path / "e.json"), str(tmp_path / "s.toml")]
        arguments += ["--control", control, "-o", str(folder), "--range", "X=-300:300"]
        bare = list(arguments)
        for word in words:
            arguments += ["--stated", word]
        done = CliRunner(env={"COLUMNS": "200"}).invoke(app, arguments)
        assert done.exit_code == 0, done.output
        assert (folder / "settings.csv").exists()
        if words:
            missing = CliRunner().invoke(app, [*bare, "--force"])
            assert missing.exit_code == 2
            assert f"got no {words[0].partition('=')[0]}" in missing.output


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    made = linuxcnc_files(SETUP, TABLE_2)
    written = made.write(tmp_path / "out")
    assert {path.name for path in written} == set(made.files)
    with pytest.raises(tn.InputError, match="the file exists already"):
        made.write(tmp_path / "out")
    assert made.write(tmp_path / "out", overwrite=True) == written


def test_the_table_names_every_error_with_its_unit() -> None:
    text = iso_table(SETUP, estimate(EFFECTS)).files["errors.csv"]
    rows = {line.split(",")[0]: line.split(",") for line in text.splitlines() if line[0] != "#"}
    for name, value in TABLE_2.items():
        assert float(rows[name][1]) == pytest.approx(value)
        assert rows[name][2] == ("µm" if name[1] in "XYZ" else "arcsec")
    assert float(rows["c_backlash.b_arcsec"][1]) == 30.0
