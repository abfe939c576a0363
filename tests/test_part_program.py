"""Corrected part programs, run by LinuxCNC's interpreter on the contract's machine in numpy."""

import json
import re
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from control_readers import RealMachine
from reference_trt_ca import TABLE_2, Floats, turn
from rs274 import _command, needs_rs274
from trunnion.cli import app
from trunnion.controls import correct_program

SETUP = tn.Setup(artefact=tn.Artefact("none"))
ERRORS = {name: 3 * value for name, value in TABLE_2.items()}
EFFECTS = {"scale_x": {"ppm": 80.0}, "squareness_xy": {"arcsec": 20.0}}
ESTIMATE = tn.Estimate(errors=ERRORS, effects=EFFECTS)
REAL = RealMachine(ERRORS, scale=(80.0, 0.0, 0.0), squareness=(20.0, 0.0, 0.0))
PRINTED_UM = 0.2
"""The interpreter prints four decimals, in both programs."""


@dataclass(frozen=True)
class Canon:
    """A canonical move: kind, ends (6,), minutes, and positions along it (n, 6)."""

    kind: str
    minutes: float
    way: Floats


def canonical(text: str, folder: Path) -> list[Canon]:
    """What LinuxCNC's interpreter makes of a program of a mill."""
    command = _command()
    assert command is not None
    (folder / "p.ngc").write_text(text)
    (folder / "tool.tbl").write_text("T1 P1 D1 ;\n")
    (folder / "empty.var").write_text("")
    done = subprocess.run(
        [command[0], "-t", "tool.tbl", "-v", "empty.var", "-g", "p.ngc"],
        cwd=folder, env=command[1], capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "executing" in done.stderr or "error" not in done.stderr
    moves: list[Canon] = []
    at, rate, axes, unit = np.zeros(6), 0.0, (0, 1, 2), 1.0
    for line in done.stdout.splitlines():
        found = re.search(r"(\w+)\((.*)\)", line)
        if found is None:
            continue
        numbers = [float(v) for v in re.findall(r"-?\d+\.?\d*", found[2])]
        if found[1] == "SET_FEED_RATE":
            rate = numbers[0] * unit
        elif found[1] == "USE_LENGTH_UNITS":
            unit = 25.4 if "INCH" in found[2] else 1.0
        elif found[1] == "SELECT_PLANE":
            axes = {"XY": (0, 1, 2), "XZ": (2, 0, 1), "YZ": (1, 2, 0)}[found[2][-2:]]
        elif found[1] in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED"):
            to = np.array(numbers[:6]) * ([unit] * 3 + [1] * 3)
            way = at + np.linspace(0, 1, 40)[:, None] * (to - at)
            moves.append(Canon(found[1][9:], minutes(way, rate), way))
            at = to
        elif found[1] == "ARC_FEED":
            lengths = [v if i == 4 else v * unit for i, v in enumerate(numbers[:6])]
            way = arc(at, [*lengths, *numbers[6:9]], axes)
            moves.append(Canon("ARC", minutes(way, rate), way))
            at = way[-1]
    return moves


def arc(at: Floats, numbers: Sequence[float], axes: tuple[int, int, int]) -> Floats:
    """Positions along an arc: first end, second end, centre, turns, end along the third axis."""
    first, second, third = axes
    centre = np.array(numbers[2:4])
    begin = np.arctan2(at[second] - centre[1], at[first] - centre[0])
    end = np.arctan2(numbers[1] - centre[1], numbers[0] - centre[0])
    sweep = (end - begin) % (2 * np.pi)
    if numbers[4] < 0:
        sweep -= 2 * np.pi
    if abs(sweep) < 1e-6:
        sweep = 2 * np.pi * np.sign(numbers[4])
    to = np.zeros(6)
    to[[first, second, third]] = numbers[0], numbers[1], numbers[5]
    to[3:] = numbers[6:9]
    part = np.linspace(0, 1, 1000)
    way = at + part[:, None] * (to - at)
    size = np.hypot(*(at[[first, second]] - centre))
    size = size + part * (np.hypot(*(to[[first, second]] - centre)) - size)
    way[:, first] = centre[0] + size * np.cos(begin + part * sweep)
    way[:, second] = centre[1] + size * np.sin(begin + part * sweep)
    return np.asarray(way)


def minutes(way: Floats, rate: float) -> float:
    """LinuxCNC's time: the rate is along X, Y, Z, or that of the rotary axes where these rest."""
    length = float(np.linalg.norm(np.diff(way[:, :3], axis=0), axis=1).sum())
    turned = float(np.linalg.norm(way[-1, 3:] - way[0, 3:]))
    return (length if length > 1e-9 else turned) / rate if rate else 0.0


def on_table(machine: RealMachine, way: Floats, tcp: bool) -> Floats:
    """Tool point on the table; with tool centre point control the axes are the nominal ones."""
    points = []
    for x, y, z, a, _, c in way:
        at = np.array([x, y, z, 1.0])
        if tcp:
            at = turn("x", np.radians(a)) @ turn("z", np.radians(c)) @ at
        tip = np.append(machine.linear() @ at[:3], 1.0)
        points.append(np.linalg.solve(machine.pose(a, c), tip)[:3])
    return np.array(points)


def denser(way: Floats) -> Floats:
    """Positions of a move at twenty times as many places."""
    part = np.linspace(0, 1, 20 * len(way))
    old = np.linspace(0, 1, len(way))
    return np.column_stack([np.interp(part, old, column) for column in way.T])


def distance_um(points: Floats, path: Floats) -> float:
    """Largest distance of points from a polyline, µm."""
    start, along = path[:-1], np.diff(path, axis=0)
    square = np.maximum((along**2).sum(1), 1e-18)
    worst = 0.0
    for p in points[:: 1 + len(points) // 700]:
        part = np.clip(((p - start) * along).sum(1) / square, 0, 1)
        nearest = start + part[:, None] * along
        worst = max(worst, float(np.linalg.norm(p - nearest, axis=1).min()))
    return 1e3 * worst


def time_of(text: str, moves: list[Canon]) -> float:
    """Minutes at feed; in G93 from F itself, as the interpreter prints short moves too coarsely."""
    total, mode, feed = 0.0, 94, 0.0
    lines = [line for line in text.splitlines() if re.search(r"G[0-3] ", line)]
    for line, move in zip(lines, moves, strict=True):
        mode = int((re.findall(r"G(9[34])", line) or [mode])[0])
        feed = float((re.findall(r"F([\d.]+)", line) or [feed])[0])
        if "G0 " not in line:
            total += 1 / feed if mode == 93 else move.minutes
    return total


def feeds(moves: list[Canon]) -> list[Canon]:
    return [move for move in moves if move.kind != "TRAVERSE"]


THREE_AXES = """%
(three axes) ; and arcs
N10 G20 G90 G17 T1 M6
G0 Z4
G0 X0 Y0 S5000 M3
G1 Z0.4 F25
G1 X4 M8
G2 X4.4 Y-0.4 I0 J-0.4
G21 G91
G3 X-40 Y-40 I-40 J0 Z-3
G18 G2 X20 Z0 I10 K0
G17 G2 I15 J-20
G90 G1 X-120 Y90 F900
G0 Z100
M2
%
"""
FIVE_AXES = """G21 G90 G17
G0 X0 Y0 Z120 A0 C0
G1 Z20 F600
X60 Y10 A-20 C30
X20 Y50 Z35 A-45 C80 F400
A-60 C120
G93 G1 X0 A-90 C180 F20
G94 G1 X25 F300
G0 Z120 A0 C0
M2
"""


@needs_rs274
@pytest.mark.parametrize("tolerance", [1.0, 5.0])
def test_three_axes_keep_arcs_and_feeds(tolerance: float, tmp_path: Path) -> None:
    made = correct_program(SETUP, ESTIMATE, THREE_AXES, tolerance_um=tolerance)
    before, after = canonical(THREE_AXES, tmp_path), canonical(made.text, tmp_path)
    wanted = np.vstack([on_table(RealMachine({}), m.way, False) for m in feeds(before)])
    reached = np.vstack([on_table(REAL, m.way, False) for m in feeds(after)])
    raw = np.vstack([on_table(REAL, m.way, False) for m in feeds(before)])
    assert distance_um(raw, wanted) > 25
    # Points of arcs lie 0.3 µm off their polyline here.
    assert distance_um(reached, wanted) < tolerance + PRINTED_UM + 0.6
    assert distance_um(wanted, reached) < tolerance + PRINTED_UM + 0.6
    assert made.left_um <= tolerance
    assert sum(m.minutes for m in feeds(after)) == pytest.approx(
        sum(m.minutes for m in feeds(before)), rel=1e-3
    )
    assert made.minutes == pytest.approx(sum(m.minutes for m in feeds(before)), rel=1e-3)
    # Arcs stay arcs (tilted planes make some of them several): chords would be many more.
    arcs = ((40.0, 0.5), (20.0, 1.0), (25.0, 2.0), (10.16, 0.5))
    chords = sum(np.pi * t / 2 / np.sqrt(2e-3 * tolerance / r) for r, t in arcs)
    assert len(feeds(after)) < 0.25 * chords
    assert made.text.count("M8") == made.text.count("T1 M6") == made.text.count("M2\n") == 1
    assert made.text.startswith("%\n")


@needs_rs274
@pytest.mark.parametrize(("given", "written"), [("axes", "axes"), ("tcp", "tcp"), ("tcp", "axes")])
def test_five_axes(given: Any, written: Any, tmp_path: Path) -> None:
    made = correct_program(
        SETUP,
        ESTIMATE,
        FIVE_AXES,
        given=given,
        written=written,
        tolerance_um=3.0,
    )
    before, after = canonical(FIVE_AXES, tmp_path), canonical(made.text, tmp_path)
    ideal = RealMachine({})
    wanted = np.vstack([on_table(ideal, m.way, given == "tcp") for m in feeds(before)])
    reached = np.vstack([on_table(REAL, m.way, written == "tcp") for m in feeds(after)])
    dense = np.vstack([on_table(ideal, denser(m.way), given == "tcp") for m in feeds(before)])
    assert distance_um(reached, dense) < 3.0 + PRINTED_UM
    assert distance_um(wanted, reached) < 3.0 + PRINTED_UM
    if given == written:
        assert made.before_um is not None
        assert made.before_um > 40
    total = sum(m.minutes for m in feeds(before))
    assert time_of(made.text, after) == pytest.approx(total, rel=1e-4)
    # Every written move turns the rotary axes where the programmed one does, and no further.
    assert after[-1].way[-1, 3:] == pytest.approx(before[-1].way[-1, 3:])


def test_a_part_of_the_moves_would_not_do() -> None:
    """Each written move goes as far as the tolerance lets it: a tighter one needs more moves."""
    counts = [
        correct_program(
            SETUP, ESTIMATE, FIVE_AXES, given="tcp", written="axes", tolerance_um=tolerance
        ).moves_after
        for tolerance in (1.0, 4.0, 16.0)
    ]
    # The sagitta of a chord goes with the square of its length.
    assert 1.6 < counts[0] / counts[1] < 2.2
    assert 1.5 < counts[1] / counts[2] < 2.2


def test_what_cannot_be_corrected_is_refused() -> None:
    for line, message in (
        ("G41 D1 G1 X10 F100", "line 3, column .*: got tool radius compensation"),
        ("G38.2 X10 F100", "line 3, column .*: got a probing move"),
        ("G95 G1 X10 F0.1", "line 3, column .*: got feed per revolution"),
    ):
        with pytest.raises(tn.ProgramError, match=message):
            correct_program(SETUP, TABLE_2, f"G21 G90\nG0 X0 Y0 Z0\n{line}\nM2\n")
    with pytest.raises(tn.ProgramError, match="does not name every axis"):
        correct_program(
            SETUP, TABLE_2, "G0 Z100\nG0 X0 Y0 A0 C0\nG1 A9 F9\nM2\n", given="tcp", written="axes"
        )


def test_the_command(tmp_path: Path) -> None:
    (tmp_path / "p.ngc").write_text(FIVE_AXES)
    (tmp_path / "e.json").write_text(json.dumps(TABLE_2))
    (tmp_path / "s.toml").write_text('[artefact]\nkind = "cross"\n')
    files = [str(tmp_path / name) for name in ("p.ngc", "e.json", "s.toml")]
    arguments = ["correct", *files, "--given", "tcp", "-o", str(tmp_path / "out.ngc")]
    done = CliRunner(env={"COLUMNS": "120"}).invoke(app, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert "µm before" in done.output
    expected = correct_program(tn.read_setup(tmp_path / "s.toml"), TABLE_2, FIVE_AXES, given="tcp")
    assert (tmp_path / "out.ngc").read_text() == expected.text


def test_feeds_have_no_exponent() -> None:
    """A move of half a micrometre was written with F2e+06, which no control reads."""
    text = "G21 G90\nG0 X0 Y0 Z0 A0 C0\nG1 X0.0005 C0.0001 F1000\nX0.001 C90 F0.0001\nM2\n"
    made = correct_program(SETUP, ESTIMATE, text)
    feeds = re.findall(r"F\S*", made.text)
    assert all(re.fullmatch(r"F\d+(\.\d+)?", feed) for feed in feeds)
    assert float(feeds[0][1:]) == pytest.approx(1000 / 0.0005, rel=1e-5)


@pytest.mark.parametrize("move", ["G1 X40 Y10 A30 C45 F500", "G3 X40 Y0 I20 J0 F500"])
def test_a_tolerance_below_what_is_written_is_refused(move: str) -> None:
    """Positions of four decimals are up to half of the last one off; no part is short enough."""
    text = f"G21 G90 G17\nG0 X0 Y0 Z0 A0 C0\n{move}\nM2\n"
    said = r"line 3, column \d+: got a tolerance of 0\.01 µm .* written to 0\.0001 mm"
    with pytest.raises(tn.ProgramError, match=said):
        correct_program(SETUP, ESTIMATE, text, tolerance_um=0.01)
    made = correct_program(SETUP, ESTIMATE, text, tolerance_um=0.5)
    assert made.left_um < 0.6
