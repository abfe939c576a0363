"""`tn.read`: files of controls and instruments, columns by another name, arrays."""

import re
import runpy
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import trunnion as tn
from foreign_files import CAMONITOR, HALSCOPE, TWINCAT
from trunnion.contouring import Servo
from trunnion.models.kinds import kinds


def written(folder: Path, text: str) -> Path:
    path = folder / "file"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("kind", kinds(), ids=lambda kind: kind.name)
def test_samples_of_every_kind(kind: object) -> None:
    from result_examples import SAMPLES

    name = kind.name  # type: ignore[attr-defined]
    path = tn.sample_path(SAMPLES[name][0])
    data = tn.read(path)
    assert data == kind.read(path)  # type: ignore[attr-defined]
    assert data.recognised.as_written
    assert tn.read(data.to_dataframe()) == data
    assert tn.read(dict(data.columns)) == data


@pytest.mark.parametrize("mark", [".", ","])
def test_twincat(tmp_path: Path, mark: str) -> None:
    path = written(tmp_path, TWINCAT.format(mark))
    with pytest.raises(tn.FileFormatError, match=r"with the channels Cmd, Vel, Act, expected col"):
        tn.read(path)
    log = tn.read(path, columns={"x_cmd_mm": "Cmd", "x_act_mm": "Act"})
    assert isinstance(log, tn.AxisLog)
    assert log.x_cmd_mm is not None
    assert log.x_cmd_mm.tolist() == [1.5, 2.0]
    np.testing.assert_allclose(log.actual("x"), [1.5, 2.0])
    assert log.time_s.tolist() == [0.0, 0.01]
    assert log.recognised is not None
    said = log.recognised.summary()
    assert "Read as AxisLog from TwinCAT Scope CSV" in said
    assert "x_act_mm: m → mm" in said
    assert "file times of the export" in said
    assert log.place(1) == "line 12 of file"
    path = written(tmp_path, TWINCAT.format(mark).replace("2;0", "two;0"))
    with pytest.raises(tn.FileFormatError, match=r":12:20: Cmd: got 'two', expected a finite num"):
        tn.read(path, columns={"x_cmd_mm": "Cmd", "x_act_mm": "Act"})


def test_halscope_writes_a_sample_too_many(tmp_path: Path) -> None:
    log = tn.read(
        written(tmp_path, HALSCOPE), columns={"x_cmd_mm": "x-cmd [inch]", "x_act_mm": "x-fb"}
    )
    assert log.time_s.tolist() == [0.0, 0.001]
    np.testing.assert_allclose(log.x_cmd_mm, [1.5 * 25.4, 2.5 * 25.4])
    assert log.x_act_mm.tolist() == [1.4, 2.4]
    assert log.recognised.units == {"x_cmd_mm": "inch → mm", "x_act_mm": "taken as mm"}
    with pytest.raises(tn.UnknownNameError, match="did you mean x-cmd"):
        tn.read(written(tmp_path, HALSCOPE), columns={"x_cmd_mm": "x-cnd", "x_act_mm": "x-fb"})


def test_halsampler(tmp_path: Path) -> None:
    mapping = {"x_cmd_mm": "1", "x_act_mm": "2"}
    path = written(tmp_path, "1.5 1.4 \n2.5 2.4 \n2.6 2.5 \n")
    with pytest.raises(tn.FileFormatError, match="period_s= gives the time between two samples"):
        tn.read(path, columns=mapping)
    assert tn.read(path, columns=mapping, period_s=0.002).time_s.tolist() == [0.0, 0.002, 0.004]
    path = written(tmp_path, "1.5 1.4 \noverrun\n2.5 2.4 \n2.6 2.4 \n")
    with pytest.raises(tn.FileFormatError, match=r":2:1: got 'overrun' .*halsampler -t"):
        tn.read(path, columns=mapping, period_s=0.002)
    path = written(tmp_path, "4 1.5 1.4 \noverrun\n9 2.5 2.4 \n10 2.6 2.4 \n")
    log = tn.read(path, columns={"x_cmd_mm": "2", "x_act_mm": "3"}, period_s=0.002)
    assert log.time_s.tolist() == [0.0, 0.01, 0.012]
    assert "missing before line 3: 5 to 8 (overrun)." in log.recognised.summary()


SAMPLED = {"x_cmd_mm": "2", "x_act_mm": "3"}


def sampled(numbers: Sequence[int]) -> list[str]:
    return [f"{n} {0.5 * n:.6f} {0.5 * n - 0.1:.6f} " for n in numbers]


def test_samples_that_are_missing_are_named(tmp_path: Path) -> None:
    """By the numbers of halsampler -t, whether it said 'overrun' there or lines went lost later."""
    lines = [*sampled(range(4)), "overrun", *sampled(range(9, 12)), *sampled(range(13, 16))]
    path = written(tmp_path, "\n".join(lines) + "\n")
    log = tn.read(path, columns=SAMPLED, period_s=0.5)
    assert log.time_s.tolist() == [0, 0.5, 1, 1.5, 4.5, 5, 5.5, 6.5, 7, 7.5]
    assert log.recognised.notes[1:] == (
        "Samples are missing before line 6: 4 to 8 (overrun); line 9: 12 (lines of the file were "
        "lost). The times of the others are kept.",
    )
    path = written(tmp_path, "\n".join([*sampled(range(4)), *sampled(range(4))]) + "\n")
    with pytest.raises(tn.FileFormatError, match=r":5:1: sample 0: got it after sample 3"):
        tn.read(path, columns=SAMPLED, period_s=0.5)
    turns = "\n".join(f"{n % 4} {n}.5 {n}.4" for n in range(8)) + "\n"
    angle = {"x_cmd_mm": "1", "x_act_mm": "2"}  # whole numbers that are data
    log = tn.read(written(tmp_path, turns), columns=angle, period_s=0.5)
    assert log.time_s.tolist() == [0.5 * n for n in range(8)]


@pytest.mark.parametrize(
    ("left", "short"),
    [
        (12, "2 of 3 fields"),
        (3, "no space behind its last field"),
        (1, "no space behind its last field"),
        (0, ""),
    ],
)
def test_a_last_sample_that_was_cut_is_left_out(tmp_path: Path, left: int, short: str) -> None:
    text = "\n".join(sampled(range(5)))
    log = tn.read(written(tmp_path, text[: len(text) - left]), columns=SAMPLED, period_s=0.5)
    assert len(log) == (4 if short else 5)
    cut = [note for note in log.recognised.notes if "cut off" in note]
    assert [note.startswith(f"Line 5 is cut off ({short}") for note in cut] == [True] * bool(short)
    bare = text.replace(" \n", "\n").rstrip()  # by an editor
    assert len(tn.read(written(tmp_path, bare), columns=SAMPLED, period_s=0.5)) == 5
    cut_short = tn.read(written(tmp_path, bare[:-2]), columns=SAMPLED, period_s=0.5)
    assert "fewer decimals" in cut_short.recognised.notes[-1]


def test_a_gap_in_a_log_is_no_even_sampling(tmp_path: Path) -> None:
    lines = [*sampled(range(40)), "overrun", *sampled(range(45, 90))]
    log = tn.read(written(tmp_path, "\n".join(lines) + "\n"), columns=SAMPLED, period_s=0.001)
    with pytest.raises(
        tn.DataError, match=r"line 42 of file: got 0.006 s .*5 samples missing: overrun"
    ):
        tn.diagnose(log, tn.Setup(tn.Artefact("none"), servo=Servo.paper().to_table()))


def test_camonitor(tmp_path: Path) -> None:
    path = written(tmp_path, CAMONITOR)
    log = tn.read(path, columns={"x_cmd_mm": "AX:Set", "x_act_mm": "AX:Act"})
    np.testing.assert_allclose(log.time_s, [0.0, 0.25])
    np.testing.assert_allclose(log.x_cmd_mm, [1.5, 2.0])
    assert log.x_act_mm.tolist() == [1.1, 1.4]
    assert "interpolated linearly to the times of AX:Act" in log.recognised.summary()
    with pytest.raises(tn.FileFormatError, match="AX:Stat: got 0 posted numbers"):
        tn.read(path, columns={"x_cmd_mm": "AX:Stat", "x_act_mm": "AX:Act"})
    with pytest.raises(tn.FileFormatError, match=r":8:1: got 'nonsense', expected NAME"):
        tn.read(written(tmp_path, CAMONITOR + "nonsense\n"), columns={"x_cmd_mm": "AX:Set"})


def test_points_of_a_tracker(tmp_path: Path) -> None:
    turned = {"angle_deg": [0.0, 90.0], "x_mm": "x [m]", "y_mm": ("y", "m"), "z_mm": ("z", 1e3)}
    path = written(tmp_path, "        x\t        y\t z\n 1.0\t 2.0\t 3.0\n -1.0\t2.0\t3.5\n")
    sweep = tn.read(path, columns={**turned, "target": 1})
    np.testing.assert_allclose(sweep.position_mm, [[1e3, 2e3, 3e3], [-1e3, 2e3, 3.5e3]])
    assert sweep.target.tolist() == [1, 1]
    named = tn.read(
        written(tmp_path, "P1 1.0 2.0 3.0\nP2 -1 2 3.5\n"), columns={**turned, "target": "name"}
    )
    assert named.target.tolist() == ["P1", "P2"]
    np.testing.assert_allclose(named.position_mm, sweep.position_mm)
    with pytest.raises(tn.FileFormatError, match=r"got . values, expected"):
        tn.read(path, columns={**turned, "angle_deg": [1.0, 2.0, 3.0], "target": 1})


def test_other_names_and_units(tmp_path: Path) -> None:
    path = written(tmp_path, "t;Ref;Enc;u\n0;0,5;0,4;2\n1;1,5;1,4;2\n")
    log = tn.read(path, columns={
        "time_s": "t [ms]", "x_cmd_mm": ("Ref", "m"), "x_act_mm": ("Enc", 1000), "drive_v": "u",
    })  # fmt: skip
    np.testing.assert_allclose(log.time_s, [0.0, 1e-3])
    np.testing.assert_allclose(log.x_cmd_mm, [500.0, 1500.0])
    np.testing.assert_allclose(log.x_act_mm, [400.0, 1400.0])
    assert log["drive_v"].tolist() == [2, 2]
    assert log.recognised.columns["x_cmd_mm"] == "Ref"
    with pytest.raises(tn.InputError, match="expected a unit that goes into mm"):
        tn.read(path, columns={"time_s": "t", "x_cmd_mm": "Ref [deg]", "x_act_mm": "Enc"})
    with pytest.raises(tn.FileFormatError, match=r"file:1:1: got the columns t, Ref, Enc, u, exp"):
        tn.read(path)


def test_a_header_that_states_its_unit_is_taken_at_its_word() -> None:
    columns = {"time_s": "Time [ms]", "x_cmd_mm": "Ref [um]", "x_act_mm": "Enc [counts]"}
    data = {"Time [ms]": [0.0, 1.0], "Ref [um]": [0.0, 5.0], "Enc [counts]": [0.0, 0.1]}
    log = tn.read(data, columns=columns)
    np.testing.assert_allclose(log.time_s, [0.0, 1e-3])
    np.testing.assert_allclose(log.commanded("x"), [0.0, 5e-3])
    np.testing.assert_allclose(log.columns["x_act_mm"], [0.0, 0.1])


def test_columns_of_two_kinds_are_refused() -> None:
    two = {"setup": [1], "length_mm": [1.0], "direction": [1], "cycle": [1]}
    with pytest.raises(tn.InputError, match="may be ballbar, positioning, expected one of these"):
        tn.read(two)
    more = {**two, "target_mm": [1.0], "measured_mm": [1.0]}
    assert isinstance(tn.read(more, kind="positioning"), tn.Positioning)


def test_the_page_of_files_has_every_column_and_its_code_runs() -> None:
    docs = Path(__file__).parents[1] / "docs"
    text = (docs / "reference" / "files.md").read_text(encoding="utf-8")
    assert runpy.run_path(str(docs / "make_files_tables.py"))["page"](text) == text
    code = "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
    out: dict[str, tn.AxisLog] = {}
    exec(code, out)
    np.testing.assert_allclose(out["log"].time_s, [0.0, 1e-3, 2e-3])
    np.testing.assert_allclose(out["log"].commanded("x"), [0.0, 1.0, 2.0])


def test_set_ups_are_no_data() -> None:
    with pytest.raises(tn.InputError, match="expected measured data"):
        tn.read(tn.sample_path("cross/setup.toml"))


def test_frames_are_diagnosed() -> None:
    points = tn.read_points(tn.sample_path("plate/first.csv"))
    frame: pd.DataFrame = points.to_dataframe()
    assert tn.diagnose(frame).named == tn.diagnose(points).named


def test_the_command(tmp_path: Path) -> None:
    path = written(tmp_path, TWINCAT.format("."))
    out = tmp_path / "log.csv"
    run = subprocess.run(
        [sys.executable, "-m", "trunnion", "read", str(path), "--column", "x_cmd_mm=Cmd",
         "--column", "x_act_mm = Act [m]", "-o", str(out)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "Read as AxisLog from TwinCAT Scope CSV" in run.stdout
    assert tn.read_axis_log(out).time_s.tolist() == [0.0, 0.01]
