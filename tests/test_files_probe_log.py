"""LinuxCNC's probe log: the plan with the recorded positions, or an error that names the line."""
# ruff: noqa: E501  (a table of cases reads best with one line a case)

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app
from trunnion.data.linuxcnc_log import probe_log_of

FIRST = "37.500012 0.000000 26.003100 0.000000 0.000000 90.000000 0.000000 0.000000 0.000000\n"
SECOND = "50.998700 12.500000 1.000000 -90.000000 0.000000 180.000100 0.000000 0.000000 0.000000\n"

BAD_LOGS = {
    "empty": ("", ":1:1: got no touches, expected those of the plan"),
    "one more": (f"{FIRST}{SECOND}\n{SECOND}", ":4:1: got 3 touches, expected 2"),
    "another order": (SECOND + FIRST, ":1:30: A (touch 1): got -90.000000, expected 0.000000 (to 0.001), as planned"),
    "rotary": (FIRST + SECOND.replace("180.0001", "180.0011"), ":2:50: C (touch 2): got 180.001100, expected 180.000000 (to 0.001), as planned"),
    "axis not planned": (FIRST.replace("0.000000 90", "5.000000 90") + SECOND, ":1:39: B (touch 1): got 5.000000, expected 0.000000 (to 0.001), as the plan has no B axis"),
    "far": (FIRST + SECOND.replace("50.9987", "56.0013"), ":2:1: X (touch 2): got a touch 5.001 mm from the planned one, expected at most 5 mm from (51.000, 12.500, 1.000)"),
    "beside": (FIRST + SECOND.replace("12.500000", "13.100000"), ":2:11: Y (touch 2): got a touch 0.600 mm beside the line of its approach, expected at most 0.5 mm"),
    "beside, from above": (FIRST.replace("37.500012", "36.000000") + SECOND, ":1:1: X (touch 1): got a touch 1.500 mm beside"),
    "six columns": ("1 2 3 4 5 6\n" + SECOND, ":1:11: got 6 fields, expected nine numbers: X Y Z A B C U V W"),
    "not a number": (FIRST.replace("26.003100", "26,003100") + SECOND, ":1:20: Z: got '26,003100', expected a finite number"),
    "nan": (FIRST.replace("26.003100", "-nan") + SECOND, ":1:20: Z: got '-nan', expected a finite number"),
}  # fmt: skip


@pytest.fixture
def plan() -> tn.Touches:
    return tn.Touches(
        a_deg=[0, -90], c_deg=[90, 180], x_mm=[37.5, 51.0], y_mm=[0, 12.5], z_mm=[26, 1],
        dir_x=[0, -1], dir_y=[0, 0], dir_z=[-1, 0],
        point=[1, 3], feed_mm_min=[600, 600], c_dir=[1, 1], face=["top", "end"],
    )  # fmt: skip


def test_a_log_gives_the_plan_with_the_recorded_positions(plan: tn.Touches, tmp_path: Path) -> None:
    path = tmp_path / "probe.log"
    path.write_text(FIRST + SECOND)
    touches = tn.read_probe_log(path, plan)
    np.testing.assert_array_equal(
        touches.position_mm, [[37.500012, 0.0, 26.0031], [50.9987, 12.5, 1.0]]
    )
    x, y, z = plan.position_mm.T
    assert touches.with_columns(x_mm=x, y_mm=y, z_mm=z) == plan


@pytest.mark.parametrize("case", BAD_LOGS)
def test_a_bad_log_is_refused_with_its_place(case: str, plan: tn.Touches, tmp_path: Path) -> None:
    text, message = BAD_LOGS[case]
    path = tmp_path / "probe.log"
    path.write_text(text)
    with pytest.raises(tn.FileFormatError) as error:
        tn.read_probe_log(path, plan)
    assert str(error.value).startswith(f"{path}:")
    assert message in str(error.value)


def test_a_log_of_a_stopped_run_gives_the_touches_before(plan: tn.Touches, tmp_path: Path) -> None:
    path = tmp_path / "probe.log"
    path.write_text(FIRST)
    touches = tn.read_probe_log(path, plan)
    assert len(touches) == 1
    assert touches.position_mm[0].tolist() == [37.500012, 0.0, 26.0031]


def test_a_log_in_another_unit_is_named(plan: tn.Touches, tmp_path: Path) -> None:
    """All touches are where they were planned in inches; one false touch is none of these."""
    path = tmp_path / "probe.log"
    for factor, said in (
        (1 / 25.4, "Z are in inches (G20)"),
        (25.4, "Z are in mm, taken for inches, or if the plan's set-up is in inches"),
    ):
        rows = [[float(n) for n in line.split()] for line in (FIRST, SECOND)]
        lines = (
            " ".join(f"{n:.6f}" for n in [*(factor * x for x in row[:3]), *row[3:]]) for row in rows
        )
        path.write_text("\n".join(lines))
        with pytest.raises(tn.FileFormatError, match=r":1:1: X \(touch 1\): got a touch") as error:
            tn.read_probe_log(path, plan)
        assert str(error.value).endswith(f"; all are where they were planned if X, Y and {said}")
    path.write_text(FIRST + SECOND.replace("50.9987", "56.0013"))
    with pytest.raises(tn.FileFormatError, match=r"1\.000\)$"):
        tn.read_probe_log(path, plan)


ONE = "1 600.000000 37.500012 0.000000 26.003100 0.000000 0.000000 90.000000\n"
TWO = "2 60.000000 50.998700 12.500000 1.000000 -90.000000 0.000000 180.000100\n"


def run(plan: tn.Touches, first: int = 1) -> str:
    """First lines of a run, as its program writes them."""
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    text = tn.probing_program(plan, setup, start_at=first).text()
    line = next(line for line in text.splitlines() if "trunnion-touches" in line)
    line = line.split("LOG,%d")[1].rstrip(")").replace("#<_from>", str(first))
    return f"{line}\n; G54 0 0 0 tool length 100\n"


def test_a_last_line_that_was_cut_is_no_touch(plan: tn.Touches, tmp_path: Path) -> None:
    path = tmp_path / "touches.log"
    path.write_text(run(plan) + ONE + TWO[:-30])
    assert len(tn.read_probe_log(path, plan)) == 1
    path.write_text(run(plan) + ONE[:20])
    with pytest.raises(tn.FileFormatError, match="got no touches"):
        tn.read_probe_log(path, plan)
    path.write_text(run(plan) + ONE[:20] + "\n" + TWO)
    with pytest.raises(tn.FileFormatError, match="fields"):  # not the last: something is wrong
        tn.read_probe_log(path, plan)


def test_a_last_line_that_was_cut_inside_its_last_number_is_no_touch(
    plan: tn.Touches, tmp_path: Path
) -> None:
    path = tmp_path / "touches.log"
    for left in (1, 4, 6):
        path.write_text(run(plan) + ONE + TWO.rstrip()[:-left])
        assert len(tn.read_probe_log(path, plan)) == 1
    path.write_text(run(plan) + ONE + TWO.rstrip())
    assert len(tn.read_probe_log(path, plan)) == 2
    for head in ("trunnion-touches", "trunnion-touches 1 2.00 3 4 5 6.00 7"):
        path.write_text(head)
        with pytest.raises(tn.FileFormatError, match="first line of a run"):
            tn.read_probe_log(path, plan)


@pytest.mark.parametrize(
    ("now", "what"),
    [
        ("; G54 0 0 0 tool length 100.02", "tool length: got 100.02, expected 100"),
        ("; G54 0 0.05 0 tool length 100", "work offset y: got 0.05, expected 0"),
        ("; G55 0 0 0 tool length 100", "work offset wcs: got G55, expected G54"),
    ],
)
def test_runs_of_one_measurement_have_one_frame(
    now: str, what: str, plan: tn.Touches, tmp_path: Path
) -> None:
    """The tool was measured again, or the part set again, while the program was stopped."""
    path = tmp_path / "touches.log"
    state = "; G54 0 0 0 tool length 100"
    changed = run(plan, 2).replace(state, now)
    path.write_text(run(plan) + ONE + changed + TWO)
    with pytest.raises(tn.FileFormatError, match=what) as error:
        tn.read_probe_log(path, plan)
    assert f"{path}:5:1: " in str(error.value)
    path.write_text(run(plan) + ONE + run(plan, 2) + TWO)
    assert len(tn.read_probe_log(path, plan)) == 2
    path.write_text(run(plan) + ONE + run(plan).replace(state, now) + ONE + TWO)
    assert len(tn.read_probe_log(path, plan)) == 2  # a measurement of its own


def test_a_frame_that_only_some_runs_of_a_measurement_say_is_given_to_none(
    plan: tn.Touches, tmp_path: Path
) -> None:
    """A run without one, before or behind one with it, and one that says less of it."""
    path, state = tmp_path / "touches.log", "; G54 0 0 0 tool length 100"
    full = f"{state} A 0 C 0 corrected"
    first, then = (run(plan, at).replace(state, "{}") for at in (1, 2))
    what = "wcs, work offset x, work offset y, work offset z, tool length"
    for one, other, message in (
        ("", state, f":1:2: got a run that does not say work offset {what}, expected it as in li"),
        (state, "", f":4:2: got a run that does not say work offset {what}, expected it as in li"),
        (state, full, ":2:1: got a run that does not say work offset a, work offset c, kinematics"),
        (full, state, ":5:1: got a run that does not say work offset a, work offset c, kinematics"),
    ):
        log = first.format(one) + ONE + then.format(other) + TWO
        path.write_text("\n".join(line for line in log.split("\n") if line) + "\n")
        with pytest.raises(tn.FileFormatError) as error:
            tn.read_probe_log(path, plan)
        assert message in str(error.value)
    path.write_text(first.format(full) + ONE + then.format(full) + TWO)
    frame = tn.read_probe_log(path, plan).control_frame
    assert frame is not None
    assert frame.corrected


def test_a_numbered_log_gives_the_touches_that_it_names(plan: tn.Touches, tmp_path: Path) -> None:
    path = tmp_path / "touches.log"
    path.write_text(run(plan) + TWO)
    touches = tn.read_probe_log(path, plan)
    assert touches.position_mm.tolist() == [[50.9987, 12.5, 1.0]]
    assert touches.feed_mm_min is not None
    assert touches.feed_mm_min.tolist() == [60.0]
    assert touches.point is not None
    assert touches.point.tolist() == [3]


def test_runs_in_one_log(plan: tn.Touches, tmp_path: Path) -> None:
    """A run that went on, one that touched again, and one that began anew."""
    path = tmp_path / "touches.log"
    again = TWO.replace("50.998700", "50.998800")
    path.write_text(run(plan) + ONE + TWO + run(plan, 2) + again)
    touches = tn.read_probe_log(path, plan)
    assert touches.x_mm.tolist() == [37.500012, 50.9988]
    assert touches.recognised is not None
    assert not touches.recognised.notes
    path.write_text(path.read_text() + run(plan) + again)
    assert tn.read_probe_log(path, plan).x_mm.tolist() == [50.9988]


def test_measurements_before_the_last_are_said(plan: tn.Touches, tmp_path: Path) -> None:
    """What is used, what is not and where it stands, with what to do about it."""
    path = tmp_path / "touches.log"
    path.write_text(run(plan) + ONE + TWO + run(plan) + ONE + run(plan) + run(plan, 2) + TWO)
    read = tn.read_probe_log(path, plan).recognised
    assert read is not None
    (note,) = read.notes
    assert note == (
        "touches.log has 3 measurements (a run from touch 1 begins a new one): the last is used, "
        "1 touch from line 8 on; not used: 2 touches from line 1 on, 1 touch from line 5 on. To "
        "use one of those, read a copy of the log that ends with it."
    )
    path.write_text(run(plan) + ONE + TWO + run(plan))
    with pytest.raises(
        tn.FileFormatError, match=r"got no touches.*not used: 2 touches from line 1"
    ):
        tn.read_probe_log(path, plan)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("hash=", "hash=0", "expected the first line of a run"),
        ("2 60.0", "3 60.0", ":4:1: touch: got 3, expected a number from 1 to 2"),
        ("2 60.0", "1.5 60.0", ":4:1: touch: got 1.5, expected a number from 1 to 2"),
        ("2 60.0", "2 -60.0", ":4:3: feed: got -60, expected a number from 1e-09"),
        ("2 60.000000", "2 6e12", ":4:3: feed: got 6e+12, expected a number from 1e-09 to 1e+09"),
        ("2 60.000000", "2 6e-323", ":4:3: feed: got 5.92879e-323, expected a number"),
        ("50.9987", "57.9987", ":4:13: X (touch 2): got a touch 6.999 mm from the planned one"),
        ("-90.00", "-91.00", ":4:42: A (touch 2): got -91.000000, expected -90.000000"),
        (" 180.000100", "", ":4:53: got 7 fields, expected eight numbers: touch feed X Y Z A B C"),
    ],
)
def test_a_bad_numbered_log_is_refused_with_its_place(
    old: str, new: str, message: str, plan: tn.Touches, tmp_path: Path
) -> None:
    path = tmp_path / "touches.log"
    text = run(plan) + ONE + TWO
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(tn.FileFormatError) as error:
        tn.read_probe_log(path, plan)
    assert message in str(error.value)


def test_the_log_of_another_plan_is_refused(plan: tn.Touches, tmp_path: Path) -> None:
    path = tmp_path / "touches.log"
    path.write_text(run(plan) + ONE)
    other = plan.with_columns(x_mm=np.asarray(plan.x_mm) + 0.01)
    with pytest.raises(tn.FileFormatError, match=r"log of plan plan, hash .*is it another plan"):
        tn.read_probe_log(path, other)
    plan.to_csv(tmp_path / "plan.csv")
    assert len(tn.read_probe_log(path, tn.read_touches(tmp_path / "plan.csv"))) == 1


def test_whole_turns_are_the_same_posture(plan: tn.Touches, tmp_path: Path) -> None:
    """A wrapped axis shows in the log; senses that the plan gives it were then others."""
    path = tmp_path / "touches.log"
    path.write_text(run(plan) + ONE + TWO.replace("180.000100", "-180.000100"))
    read = tn.read_probe_log(path, plan)
    assert read.columns["c_deg"].tolist() == [90.0, 180.0]
    assert "c_dir" in plan.columns
    assert "c_dir" not in read.columns
    assert read.recognised is not None
    (note,) = read.recognised.notes
    assert "has C whole turns from the plan" in note
    for no_turn in ("0.000100", "180.002000", "-179.990000"):
        path.write_text(run(plan) + ONE + TWO.replace("180.000100", no_turn))
        with pytest.raises(tn.FileFormatError, match=r"C \(touch 2\): got"):
            tn.read_probe_log(path, plan)


def test_the_frame_of_a_log_for_its_next_run(plan: tn.Touches, tmp_path: Path) -> None:
    """The program has it as numbers; what cannot be compared is refused."""
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    path = tmp_path / "touches.log"
    state = "; G55 1 -2.5 3 tool length 100.25 A 0 C 0.5 machine"
    path.write_text(run(plan).replace("; G54 0 0 0 tool length 100", state) + ONE)
    own = replace(setup, control=tn.ControlSetup(wcs="G55", rotary_offset_deg=0.5))
    made = tn.probing_program(plan, own, start_at=2, continues=path)
    assert dict(made.cycle.frame_before) == {
        "wcs": 2, "x": 1, "y": -2.5, "z": 3, "length": 100.25, "a": 0, "c": 0.5,
    }  # fmt: skip
    assert "#<was_length> = 100.250000" in made.text()
    for control, message in (
        (tn.ControlSetup(rotary_offset_deg=0.5), "got runs in G55, expected G54 as in the set-up"),
        (tn.ControlSetup(wcs="G55"), "got runs with C shifted by 0.5 deg, expected at most"),
        (
            tn.ControlSetup(wcs="G55", rotary_offset_deg=0.5, centre_mm=(1.0, 2.5, 3.0)),
            r"G55 at \[1, -2.5, 3\], expected it within 1 mm of control.centre_mm = \[1, 2.5, 3\]",
        ),
        (
            tn.ControlSetup(wcs="G55", centre_mm=(1.0, 2.5, 3.0)),
            r"got runs with G55 at .* changed since\?; and with C shifted by 0.5 deg, expected at",
        ),
    ):  # a program that the control's state would stop before its first move
        other = replace(setup, control=control)
        with pytest.raises(tn.InputError, match=message):
            tn.probing_program(plan, other, start_at=2, continues=path)
    path.write_text(run(plan) + ONE)  # of a program before these had rotary offsets
    assert (
        "frame_c> - #<was_c>"
        not in tn.probing_program(plan, setup, start_at=2, continues=path).text()
    )
    with pytest.raises(tn.InputError, match="continues: got it with start_at = 1"):
        tn.probing_program(plan, setup, continues=path)
    for text, message in (
        (run(plan).replace("; G54", "; G5x"), "expected G54"),
        (run(plan).replace("length 100", "length long"), "length: got 'long', expected a number"),
        (run(plan).replace("length 100", "length nan"), ":2:25: tool length: got 'nan', expected"),
        (run(plan).split("\n")[0] + "\n" + ONE, "does not say its work offset"),
        (ONE, "got no run of a probing program"),
    ):
        path.write_text(text)
        with pytest.raises(tn.FileFormatError, match=message):
            tn.probing_program(plan, setup, start_at=2, continues=path)
    path.write_text(run(plan).replace("length 100", "length 100 A 0 C 0 corrected") + ONE)
    with pytest.raises(
        tn.InputError, match=r"got runs with other kinematics \(corrected\) than this"
    ):
        tn.probing_program(plan, setup, start_at=2, continues=path)


@pytest.mark.parametrize(
    ("state", "says"),
    [
        ("G54 nan 0 0 tool length 100", ":2:7: work offset x: got 'nan', expected a number"),
        ("G54 0 0 0 tool length inf", ":2:25: tool length: got 'inf', expected a number"),
        ("G54 0 0 0 tool length 100 A nan", ":2:31: work offset a: got 'nan', expected a number"),
        ("G60 0 0 0 tool length 100", "work offset wcs: got 'G60', expected G54, G55"),
        ("G5x 0 0 0 tool length 100", ":2:3: work offset wcs: got 'G5x', expected G54, G55"),
        ("G54 0 0 tool length 100", ":2:11: work offset z: got 'tool', expected a number"),
        ("G54 0 0 0 A 0 C 0 machine", ":2:13: frame of the control: got 'A', expected tool"),
        ("G54 0 0 0 tool length", ":2:18: tool length: got the end of the line, expected a number"),
        *(
            (f"G54 0 0 0 tool length 100 {behind}", says)
            for behind, says in (
                ("A 0 C 0 on", ":2:37: kinematics: got 'on', expected machine, corrected, table"),
                ("A 0 C 0 Machine", ":2:37: kinematics: got 'Machine', expected machine"),
                ("A 0 C 0", "kinematics: got the end of the line, expected machine, corrected"),
                ("A 0 B 0 machine", ":2:33: frame of the control: got 'B', expected C"),
                ("C 0 C 0 machine", ":2:33: frame of the control: got 'C', expected A"),
                ("A 0 machine", ":2:33: frame of the control: got 'machine', expected C"),
                ("A 0 C 0 machine 1", ":2:45: .* got '1', expected the end of the line"),
            )
        ),
    ],
)
def test_a_frame_that_is_none_is_refused_where_it_stands(
    state: str, says: str, plan: tn.Touches, tmp_path: Path
) -> None:
    """It was read as if the control had said nothing, and any word of kinematics as corrections."""
    path = tmp_path / "touches.log"
    path.write_text(run(plan).replace("G54 0 0 0 tool length 100", state) + ONE + TWO)
    with pytest.raises(tn.FileFormatError, match=says):
        tn.read_probe_log(path, plan)


@pytest.mark.parametrize(
    ("line", "turned"),
    [
        ("; G54 1 2 3 tool length 100 A 0.1 C 0.2 corrected", {"A": 0.1, "C": 0.2}),
        (" ;G54 1 2 3  tool length 100 C 0.2 A 0.1 corrected", {"A": 0.1, "C": 0.2}),
        ("; G54 1 2 3 tool length 100", {}),  # of earlier programs
        ("; clamped at 40 bar", None),
    ],
)
def test_the_frame_of_a_log_in_any_order(
    line: str, turned: dict[str, float] | None, plan: tn.Touches, tmp_path: Path
) -> None:
    path = tmp_path / "touches.log"
    path.write_text(run(plan).replace("; G54 0 0 0 tool length 100", line) + ONE + TWO)
    frame = tn.read_probe_log(path, plan).control_frame
    assert (frame is None) == (turned is None)
    if frame is not None:
        assert frame.turned_deg == turned
        assert (frame.place_mm, frame.tool_length_mm) == ((1.0, 2.0, 3.0), 100.0)
        assert frame.corrected == (True if turned else None)


def test_all_that_differs_between_two_runs_is_said_at_once(
    plan: tn.Touches, tmp_path: Path
) -> None:
    path = tmp_path / "touches.log"
    state = "G54 0 0 0 tool length 100"
    second = run(plan, 2).replace(state, "G54 0 0.5 0 tool length 101")
    path.write_text(run(plan) + ONE + second + TWO)
    says = "work offset y: got 0.5, expected 0; tool length: got 101, expected 100 as in line 2"
    with pytest.raises(tn.FileFormatError, match=says):
        tn.read_probe_log(path, plan)


def test_touches_that_no_run_measures_are_said(
    plan: tn.Touches, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the program runs: by the log of the runs before, where it is given or is here."""
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    monkeypatch.chdir(tmp_path)
    plan = tn.plan(setup)

    def head(start_at: int, continues: str | None = None, log: str = "new.log") -> str:
        made = tn.probing_program(plan, setup, log, start_at=start_at, continues=continues)
        lines = made.text().split("\n")
        found = [line[1:-1] for line in lines if line.startswith("(From touch")]
        said = [
            re.sub(r"[()]", lambda m: "[]"["()".index(m[0])], s) for s in made.cycle.said_before()
        ]
        assert found == said
        return found[0] if found else ""

    x, y, z = plan.position_mm.T
    rows = [x, y, z, plan["a_deg"], 0 * x, plan["c_deg"]]
    lines = [
        f"{n} 600.000000 " + " ".join(f"{v:.6f}" for v in row)
        for n, row in enumerate(np.column_stack(rows).tolist(), 1)
    ]
    state = run(plan)
    Path("a.log").write_text(state + "\n".join([*lines[:4], *lines[5:30]]) + "\n")
    assert head(1) == ""
    assert "From touch 40 on: 1 to 39 of the plan are taken to be in new.log already" in head(40)
    missing = "5, 31 to 39 of the plan are not in a.log, and no run measures them; --from 5 would"
    assert missing in head(40, "a.log")
    assert missing in head(40, log="a.log")
    assert "5 of the plan are not in a.log" in head(31, "a.log")
    Path("a.log").write_text(state + "\n".join(lines[:30]) + "\n")
    assert head(31, "a.log") == head(7, "a.log") == ""
    Path("a.log").write_text(state)  # a run that was stopped before its first touch
    assert "1 to 4 of the plan are not in a.log" in head(5, "a.log")
    Path("b.log").write_text(run(plan[:40]) + lines[0])  # none of the plan: nothing is known
    assert "are taken to be in b.log already" in head(5, log="b.log")
    plan.to_csv("plan.csv")
    Path("setup.toml").write_text(setup.to_toml())
    given = ["program", "plan.csv", "setup.toml", "--from", "40", "-o", "p.ngc"]
    assert "note: From touch 40 on: 1 to 39" in CliRunner().invoke(app, given).stderr


def other(plan: tn.Touches) -> tuple[tn.Touches, str]:
    """Another plan, and a run of it with one touch more than `plan` has."""
    longer = tn.Touches(
        **{name: np.r_[column, column[:1]] for name, column in plan.columns.items()}
    )
    lines = "".join(f"{n} 600.000000 1 2 3 0.000000 0.000000 9.000000\n" for n in (1, 2, 3))
    return longer, run(longer).replace("plan=plan", "plan=other") + lines


def test_several_plans_in_one_log(plan: tn.Touches, tmp_path: Path) -> None:
    """Runs of the plan are read, also those that went on behind another plan's; others are named."""
    path = tmp_path / "touches.log"
    longer, theirs = other(plan)
    path.write_text(theirs + run(plan) + ONE + theirs + run(plan, 2) + TWO + theirs[:-20])
    touches = tn.read_probe_log(path, plan)
    assert touches.x_mm.tolist() == [37.500012, 50.9987]
    assert touches.origin is not None
    assert [touches.origin.line[i] for i in range(2)] == [8, 16]
    assert touches.recognised is not None
    (note,) = touches.recognised.notes
    named = tn.probing_program(longer, tn.Setup(tn.Artefact("cross"))).plan_hash
    assert note == (f"touches.log also has 3 runs of plan other, hash {named} (line 1): not read.")


def test_a_log_without_the_plan_names_those_it_has(plan: tn.Touches, tmp_path: Path) -> None:
    path = tmp_path / "touches.log"
    _, theirs = other(plan)
    path.write_text("a line of another program\n" + theirs + run(plan) + ONE)
    another = plan.with_columns(x_mm=np.asarray(plan.x_mm) + 0.01)
    with pytest.raises(tn.FileFormatError) as error:
        tn.read_probe_log(path, another)
    said = str(error.value)
    assert said.startswith(f"{path}:2:2: got the log of plan other, hash ")
    assert "(line 2); plan plan, hash " in said
    assert "(line 7), expected that of this plan, hash " in said


def test_lines_before_the_first_run(plan: tn.Touches, tmp_path: Path) -> None:
    """Those of other programs are skipped and counted; touches without their run are refused."""
    path = tmp_path / "touches.log"
    path.write_text("probe 12.5 3\n\nwarm-up done, 20 min\n" + run(plan) + ONE + TWO)
    read = tn.read_probe_log(path, plan)
    assert len(read) == 2
    assert read.recognised is not None
    assert read.recognised.notes == (
        "2 lines (1 to 3) of touches.log before its first run are of no probing program: skipped.",
    )
    with pytest.raises(tn.FileFormatError, match=r":4:1: got the log of a probing program"):
        tn.read(path)
    path.write_text("warm-up\n" + ONE + run(plan, 2) + TWO)
    with pytest.raises(tn.FileFormatError, match=r":2:1: got a touch before the first line"):
        tn.read_probe_log(path, plan)


def test_a_line_that_was_cut_before_the_next_run(plan: tn.Touches, tmp_path: Path) -> None:
    """The control lost its power while it wrote touch 2; the next run appends to that line."""
    path = tmp_path / "touches.log"
    path.write_text(run(plan) + ONE + TWO[:30] + run(plan, 2) + TWO)
    read = tn.read_probe_log(path, plan)
    assert read.x_mm.tolist() == [37.500012, 50.9987]
    assert read.recognised is not None
    (note,) = read.recognised.notes
    assert note.startswith("Line 4 of touches.log begins with one that was cut off")
    path.write_text(run(plan) + ONE + TWO + run(plan).split("\n")[0][:-9])
    assert len(tn.read_probe_log(path, plan)) == 2


def test_one_plan_with_and_without_tool_centre_point_control(tmp_path: Path) -> None:
    """The last run of the plan says what its touches are."""
    from trunnion.data.linuxcnc_log import probe_log_of
    from trunnion.probing.on_table import is_table_log, on_table

    setup = tn.Setup(tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(30.0, 0.0, 60.0)))
    plan = tn.plan(setup)
    table = on_table(plan, setup)
    plain, held = probe_log_of(plan, plan, "p"), probe_log_of(table, table, "p")
    path = tmp_path / "touches.log"
    for text, expected in ((plain + held, True), (held + plain, False), (held, True)):
        path.write_text(text)
        assert is_table_log(path, plan, setup) is expected
    assert len(tn.read_table_log(path, plan, setup)) == len(plan)


@pytest.mark.parametrize(
    ("state", "says"),
    [
        ("G54 210.5 148.2 -301 tool length 100 A 0.0 C 0.0 machine", ()),
        ("G54 210.9 148.2 -301 tool length 100", ("Line 2 of touches.log: G54 was at 210.9, 148.2, -301, 0.4 mm from control.centre_mm = [210.5, 148.2, -301]", "state centre_mm = [210.9, 148.2, -301] before a compensation")),
        ("G55 210.5 148.2 -301 tool length 100 A 0.137 C 0.0 machine", ("Line 2 of touches.log: G55 shifts A by 0.137 deg", "measure again")),
        ("G54 210.5 148.2 -301 tool length 100 A 0.0 C 0.0 corrected", ("Line 2 of touches.log: the control's corrections were on while it measured", "trunnion verify and", "for one, measure without")),
    ],
)  # fmt: skip
def test_what_a_compensation_must_know_of_the_work_offset_is_said(
    state: str, says: tuple[str, ...], plan: tn.Touches, tmp_path: Path
) -> None:
    """A compensation turns by the joints about centre_mm: 0.4 mm beside it would be 0.8 mm off."""
    setup = tn.Setup(
        tn.Artefact("cross"), control=tn.ControlSetup(centre_mm=(210.5, 148.2, -301.0))
    )
    path = tmp_path / "touches.log"
    path.write_text(run(plan).replace("G54 0 0 0 tool length 100", state) + ONE + TWO)
    read = tn.read_probe_log(path, plan, setup).recognised
    assert read is not None
    assert len(read.notes) == bool(says)
    for part in says:
        assert part in read.notes[0]


@pytest.mark.parametrize(
    ("mirrored", "said"),
    [
        (("x_mm",), r": X \(touch .* if X counts the other way: does the control's axis run"),
        (("y_mm",), r": Y \(touch .* all are as planned if Y counts the other way"),
        (("z_mm",), r": Z \(touch .* all are as planned if Z counts the other way"),
        (("a_deg",), r"A \(touch .*if A counts the other way: .*set-up \(\[axes.A\] sense\)\?$"),
        (("c_deg",), "if C counts the other way"),
        (("x_mm", "y_mm"), "if X and Y count the other way"),
        (("y_mm", "c_deg"), "if Y and C count the other way"),
    ],
)
@pytest.mark.parametrize("is_numbered", [True, False])
def test_an_axis_that_counts_the_other_way_is_named(
    mirrored: tuple[str, ...], said: str, is_numbered: bool, tmp_path: Path
) -> None:
    setup = tn.Setup(tn.Artefact("cuboid", length_mm=70.0, width_mm=50.0, height_mm=40.0))
    plan = tn.plan(setup, c_deg=(0, 50, 110), a_deg=(30, -75))
    made = tn.simulate(plan, setup, {"EX0C": 40.0}, {"dx_um": 900.0}, seed=3)
    at = {name: made[name] * (-1.0 if name in mirrored else 1.0) for name in made.columns}
    order = ("x_mm", "y_mm", "z_mm", "a_deg", "", "c_deg")
    rows = np.column_stack([at[name] if name else 0.0 * made.x_mm for name in order])
    head = f"{probe_log_of(plan, made, 'p').splitlines()[0]}\n" if is_numbered else ""
    lines = [
        (f"{i} 600 " if is_numbered else "") + " ".join(f"{v:.6f}" for v in row)
        + ("" if is_numbered else " 0 0 0")
        for i, row in enumerate(rows.tolist(), 1)
    ]  # fmt: skip
    path = tmp_path / "probe.log"
    path.write_text(head + "\n".join(lines) + "\n")
    with pytest.raises(tn.FileFormatError, match=said):
        tn.read_probe_log(path, plan)


@pytest.mark.parametrize(
    ("moved", "said"),
    [
        ((0.0, 0.0, -1.0), "ball was (0, 0, -1) mm from where it was planned: was the work offset another, or the tool's length (of another tool, or to the tip"),
        ((0.0, 0.0, -25.4), "ball was (0, 0, -25.4) mm from where it was planned"),
        ((2.0, -3.0, 0.5), "ball was (2, -3, 0.5) mm from where it was planned: was the work offset another, or the tool's length (of another tool)?"),
    ],
)  # fmt: skip
def test_touches_all_beside_their_lines_alike_have_a_likely_cause(
    moved: tuple[float, float, float], said: str, tmp_path: Path
) -> None:
    """The artefact stands elsewhere, too: that moves touches along their lines only."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    plan = tn.plan(setup)
    rng = np.random.default_rng(5)
    along = rng.uniform(-1.5, 1.5, (len(plan), 1)) * plan.direction
    x, y, z = (plan.position_mm + along + moved).T
    path = tmp_path / "probe.log"
    path.write_text(probe_log_of(plan, plan.with_columns(x_mm=x, y_mm=y, z_mm=z), "plan.csv"))
    with pytest.raises(tn.FileFormatError) as error:
        tn.read_probe_log(path, plan)
    assert said in str(error.value)


def test_touches_beside_their_lines_in_all_directions_have_no_likely_cause(tmp_path: Path) -> None:
    plan = tn.plan(tn.read_setup(tn.sample_path("cross/setup.toml")))
    off = np.random.default_rng(6).uniform(-1.5, 1.5, (len(plan), 3))
    x, y, z = (plan.position_mm + off).T
    path = tmp_path / "probe.log"
    path.write_text(probe_log_of(plan, plan.with_columns(x_mm=x, y_mm=y, z_mm=z), "plan.csv"))
    with pytest.raises(tn.FileFormatError, match="is it a touch of another program"):
        tn.read_probe_log(path, plan)
