"""The probing program: LinuxCNC's interpreter makes the moves that obstacles are checked with."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from rs274 import interpret, needs_rs274
from trunnion.cli import app
from trunnion.nc import follow

CROSS = tn.Setup(artefact=tn.Artefact("cross"))
PRINTED_MM = 6e-5


def plan_of(kind: str) -> tuple[tn.Touches, tn.Setup]:
    """Return plans that differ in axes, senses and starts."""
    if kind == "trt-bc":
        setup = tn.Setup(artefact=tn.Artefact("cuboid"), machine=tn.Machine(preset="trt-bc"))
        return tn.plan(setup, c_deg=(0, 30, 200), b_deg=(-60, 45)), setup
    if kind == "both senses":
        angles = {"c_deg": (0, 90, 210), "a_deg": (-90, 0, 60), "feeds_mm_min": (600, 200)}
        return tn.plan(CROSS, both_senses=True, **angles), CROSS  # type: ignore[arg-type]
    if kind == "turned senses":
        setup = tn.Setup(artefact=tn.Artefact("cross"), axes={"C": tn.AxisSetup(sense=-1)})
        return tn.plan(setup), setup
    if kind == "next touches":
        plan, backlash = plan_of("both senses")[0], {"c_backlash": {"b_arcsec": 20.0}}
        d = tn.diagnose(tn.simulate(plan, CROSS, effects=backlash, noise_um=0.3, seed=1), CROSS)
        return tn.next_touches(d, 40), CROSS
    return tn.plan(CROSS), CROSS


@needs_rs274
@pytest.mark.parametrize("kind", ["paper", "both senses", "trt-bc", "turned senses"])
@pytest.mark.parametrize("start_at", [1, 23])
def test_the_interpreter_makes_the_moves_of_the_cycle(
    kind: str, start_at: int, tmp_path: Path
) -> None:
    plan, setup = plan_of(kind)
    program = tn.probing_program(plan, setup, start_at=start_at)
    theirs = interpret(program.text(), tmp_path)
    ours = follow(program.moves)
    assert len(ours) > 4 * (len(plan) - start_at)
    theirs = theirs[len(theirs) - len(ours) :]
    for code, end, move in zip(ours.code, ours.end, theirs, strict=True):
        assert move.kind == {0: "traverse", 38: "probe"}[int(code)]
        assert np.abs(end - move.end).max() < PRINTED_MM
    ends = np.array([move.end for move in theirs])
    assert np.abs(np.diff(ends, axis=0)).max(axis=1).min() > 0, "a block without a move"


@needs_rs274
@pytest.mark.parametrize("options", [{}, {"corrected": True}, {"tcp": True}])
def test_the_interpreter_takes_what_the_header_quotes(
    options: dict[str, Any], tmp_path: Path
) -> None:
    """A spindle is in brackets in the code of a chain; lines of the user's may have comments."""
    control = tn.ControlSetup(
        tcp_on="M428 (on)",
        tcp_off="M429 (off)",
        corrected_on="M430 (corrected; " + 150 * "x" + ")",
        probe_on="M64 P1 (on)",
        before_turn="M64 P2 (unclamp)",
    )
    setup = tn.Setup(
        artefact=tn.Artefact("cuboid"),
        machine=tn.Machine(chain="[w C' A' b X Y Z (C1) t]"),
        control=control,
    )
    plan = tn.plan(setup)
    text = tn.probing_program(plan, setup, **options).text()
    # The M-codes of the kinematics are the INI file's, which is not here.
    moves = interpret(re.sub(r"(?m)^( *)M4[23]\d \(", r"\1(", text), tmp_path)
    assert sum(move.kind == "probe" for move in moves) > len(plan)


@needs_rs274
def test_a_dry_run_makes_no_approach(tmp_path: Path) -> None:
    plan, setup = plan_of("paper")
    starts = plan.start_mm
    assert starts is not None
    moves = interpret(tn.probing_program(plan, setup, dry_run=True).text(), tmp_path)
    probed = [move.end[:3] for move in moves if move.kind == "probe"]
    assert probed.pop(0)[:2] == (0.0, 0.0)
    assert len(probed) > 50
    for end in probed:
        assert np.abs(starts - end).max(axis=1).min() < PRINTED_MM


@pytest.mark.parametrize(
    "kind", ["paper", "both senses", "trt-bc", "turned senses", "next touches"]
)
def test_axes_come_from_the_senses_of_the_plan(kind: str) -> None:
    """Senses are read off the moves: the last turn of each axis before each approach."""
    plan, setup = plan_of(kind)
    program = tn.probing_program(plan, setup)
    moves, looks = follow(program.moves), len(program.cycle.looks)
    assert plan.start_mm is not None
    last = np.zeros(6)
    row = 0
    seen = {1: 0, -1: 0}
    after = [*moves.end[1:], np.full(6, np.nan)]
    for start, end, code, way in zip(moves.start, moves.end, moves.code, after, strict=True):
        turned = end - start
        last[turned != 0] = np.sign(turned[turned != 0])
        if code == 38 and (way == start).all():
            if looks:
                looks -= 1
                continue
            assert np.abs(start[:3] - plan.start_mm[row]).max() < PRINTED_MM
            for letter, senses in plan.rotary_dir.items():
                if senses[row]:
                    assert last[3 + "abc".index(letter)] == senses[row]
                    seen[int(senses[row])] += 1
            row += 1
    assert row == len(plan)
    assert min(seen.values()) > 0
    if kind == "next touches":
        assert all((senses != 0).all() for senses in plan.rotary_dir.values())


def test_a_plan_in_another_order_is_refused_where_its_senses_are_wrong() -> None:
    plan = tn.plan(CROSS)
    rows = np.r_[64:72, 0:64].astype(
        np.int64
    )  # tilted first: A has then turned before the touches at A0
    with pytest.raises(tn.DataError, match=r"touch 9: got a_dir 0 .* but A turns before it"):
        tn.probing_program(plan[rows], CROSS)
    assert tn.probing_program(plan[rows].with_columns(a_dir=None), CROSS).seconds > 100


def test_text_says_what_the_machine_must_be() -> None:
    plan, setup = plan_of("paper")
    program = tn.probing_program(plan, setup, name="a plan (1).csv")
    text = program.text()
    assert text.isascii()
    assert max(map(len, text.splitlines())) < 250
    assert len(re.findall(r"^o<touch> call", text, re.M)) == len(plan)
    assert "72 touches of plan a_plan__1_.csv, hash " + program.plan_hash in text
    assert "CENTRE of the ball" in text
    head = text[: text.index("(state of the control)")].splitlines()
    assert "G21 G17 G40 G80 G90 G94 G61" in head
    assert "G54" in head
    assert "M5" in head
    assert text.rstrip().endswith("M2")


def test_lines_of_the_set_up_are_where_they_belong() -> None:
    control = tn.ControlSetup(
        wcs="G56", tool_number=7, tcp_off="M429", probe_on="M64 P1", probe_off="M65 P1",
        before_turn="M64 P2", after_turn="M65 P2", centre_mm=(1.0, -2.5, 3.25),
    )  # fmt: skip
    setup = tn.Setup(artefact=tn.Artefact("cross"), control=control)
    lines = tn.probing_program(tn.plan(setup), setup).text().splitlines()
    plain = [line.strip() for line in lines]
    assert plain.index("G56") < plain.index("G43 H7") < plain.index("M429") < plain.index("M0")
    assert plain.index("M0") < plain.index("M64 P1")
    assert plain.count("M65 P1") == 1
    assert plain.count("M64 P2") == plain.count("M65 P2") == 3
    assert "o111 if [ABS[#<at> - [-2.5]] GT 1]" in plain
    again = tn.Setup(artefact=setup.artefact, control=tn.ControlSetup(**control.to_dict()))
    assert again == setup


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("wcs", "G53"),
        ("tool_number", 1.5),
        ("tool_number", -1),
        ("tcp_off", "M429\nG0 Z0"),
        ("before_turn", "M64 P2 (öffnen)"),
        ("centre_mm", (1.0, 2.0)),
        ("positioning_mm_min", 0.0),
        ("back_off_mm", 0.0),
    ],
)
def test_keys_of_the_control_are_checked(key: str, value: object) -> None:
    with pytest.raises(tn.InputError, match=rf"control\.{key}: got .* expected"):
        tn.ControlSetup(**{key: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("log", ["", "a(b).log", "a#1.log", "a\nb", "x" * 200, "é.log", " a", "a "])
def test_names_of_logs_that_linuxcnc_cannot_take(log: str) -> None:
    with pytest.raises(tn.InputError, match="log: got"):
        tn.probing_program(tn.plan(CROSS), CROSS, log)


@pytest.mark.parametrize("log", ["there", "new/", "/", ".", "..", "a/..", "~/touches.log"])
def test_a_log_that_is_no_file_is_refused(
    log: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """LinuxCNC would measure, and write the touches to its terminal."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    with pytest.raises(tn.InputError, match=r"log: got .*in no file"):
        tn.probing_program(tn.plan(CROSS), CROSS, log)


@pytest.mark.parametrize(
    ("log", "said"),
    [
        ("plan", "got a file that this command reads"),
        ("touches.csv", "got the ending '.csv' (a table) for a log of touches"),
        ("probe.ngc", "got the ending '.ngc' (an NC program) for a log of touches"),
    ],
)
def test_a_control_appends_to_no_file_of_another_kind(
    log: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    tn.plan(CROSS).to_csv("plan")
    Path("setup.toml").write_text(CROSS.to_toml())
    given = ["-o", "probe.ngc", "--log", log]
    done = CliRunner().invoke(app, ["program", "plan", "setup.toml", *given])
    assert done.exit_code == 2
    assert said in done.stderr
    assert not Path("probe.ngc").exists()
    if log != "plan":
        given = ["plan", "setup.toml", "--program", "probe.ngc", "--log", log]
        assert said in CliRunner().invoke(app, given).stderr


def test_a_plan_without_starts_and_feeds_becomes_a_program() -> None:
    plan = tn.plan(CROSS, dither=False)
    names = ("feed_mm_min", "start_x_mm", "start_y_mm", "start_z_mm")
    bare = plan.with_columns(**dict.fromkeys(names))
    with pytest.raises(tn.DataError, match="feed_mm_min"):
        tn.probing_program(bare, CROSS)
    made = tn.probing_program(bare, CROSS, feed_mm_min=600)
    assert (
        made.moves.text().splitlines()[1:]
        == (tn.probing_program(plan, CROSS).moves.text().splitlines()[1:])
    )


@pytest.mark.parametrize("start_at", [0, 73, True, 1.5])
def test_a_first_touch_that_is_not_there(start_at: int) -> None:
    with pytest.raises(tn.InputError, match="start_at: got"):
        tn.probing_program(tn.plan(CROSS), CROSS, start_at=start_at)


def test_time_grows_with_accelerations_and_slow_feeds() -> None:
    plan = tn.plan(CROSS)

    def seconds(**more: float) -> float:
        slow = more.pop("slow_feed_mm_min", 0.0)
        setup = tn.Setup(
            artefact=tn.Artefact("cross"),
            plan=tn.PlanSetup(slow_feed_mm_min=slow),
            control=tn.ControlSetup(**more),  # type: ignore[arg-type]
        )
        made = tn.probing_program(plan, setup)
        assert np.all(np.diff(made.time_s) > 0)
        assert made.time_s[-1] < made.seconds
        return made.seconds

    plain = seconds()
    assert seconds(acceleration_mm_s2=500.0) > plain
    assert seconds(rotary_acceleration_deg_s2=100.0) > plain
    # 72 second passes over 0.3 mm at 30 mm/min.
    extra = 72 * (0.3 / 0.5 + 0.3 / (10_000 / 60))
    assert seconds(slow_feed_mm_min=30.0) == pytest.approx(plain + extra)


def test_fast_approaches_are_said(tmp_path: Path) -> None:
    """In the notes of a plan, by the command and in the head of the program."""
    plan = tn.plan(CROSS)
    assert not any("goes on" in note for note in tn.plan_notes(plan, CROSS))
    assert "goes on" not in tn.probing_program(plan, CROSS).text()
    feeds = np.full(len(plan), 600.0)
    feeds[4] = 4800.0
    fast = plan.with_columns(feed_mm_min=feeds)
    (note,) = (n for n in tn.plan_notes(fast, CROSS) if "goes on" in n)
    assert note.startswith("Touch 5 approaches at 4800 mm/min: the ball goes on by feed^2")
    assert "3.2 mm if acceleration_mm_s2 of [control], not stated, is 1000 mm/s^2" in note
    head = tn.probing_program(fast, CROSS).text()
    assert f"({note})" in head
    assert "The probe must take that" in note
    assert len(note) < 240  # LinuxCNC reads lines of up to 255 characters
    assert note.isascii()
    fast.to_csv(tmp_path / "plan.csv")
    (tmp_path / "setup.toml").write_text(CROSS.to_toml())
    words = ["program", str(tmp_path / "plan.csv"), str(tmp_path / "setup.toml")]
    ran = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "bench.ngc")])
    assert ran.exit_code == 0
    assert f"note: {note}" in ran.output


def test_a_slow_machine_goes_on_further_than_an_approach_ends() -> None:
    slow = tn.Setup(artefact=tn.Artefact("cross"), control=tn.ControlSetup(acceleration_mm_s2=20.0))
    plan = tn.plan(slow)
    assert not any("goes on" in note for note in tn.plan_notes(plan, slow))
    faster = plan.with_columns(feed_mm_min=np.full(len(plan), 1200.0))
    (note,) = (n for n in tn.plan_notes(faster, slow) if "goes on" in n)
    assert "10 mm at 20 mm/s^2" in note
    assert "no program is written of it" in note
    with pytest.raises(tn.DataError, match=r"touch 1: .* got 1200, .* goes on by 10 mm .* = 5: "):
        tn.probing_program(faster, slow)


def test_a_feed_in_the_wrong_unit_makes_no_program() -> None:
    plan = tn.plan(CROSS)
    feeds = np.full(len(plan), 600.0)
    feeds[7] = 60_000.0
    with pytest.raises(tn.DataError, match=r"touch 8: feed_mm_min: got 60000, .* 500 mm behind"):
        tn.probing_program(plan.with_columns(feed_mm_min=feeds), CROSS)
