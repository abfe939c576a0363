"""Programs mean to LinuxCNC's interpreter what they mean to the project: same path, no error."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from rs274 import Canonical, interpret, needs_rs274
from trunnion.nc import Moves, Program, follow
from trunnion.turning import Profile, TurningProbe, correct, probe_path
from trunnion.turning.profile import Blocks
from turning_shapes import random_points

pytestmark = needs_rs274

FloatArray = npt.NDArray[np.float64]

HEAD: Blocks = [
    [("G", 7), ("G", 18), ("G", 21), ("G", 90)],
    [("G", 64), ("P", 0.001), ("Q", 0)],
    [("G", 97), ("S", 800), ("M", 3)],
    [("G", 95), ("F", 0.1)],
]
TAIL: Blocks = [[("M", 5)], [("M", 2)]]
# The interpreter prints four decimals.
PRINTED_MM = 6e-5


def same_path(program: Program, folder: Path) -> Moves:
    ours = follow(program)
    theirs = interpret(program.text(), folder)
    # The first rapids, which lead to the first known place, are not moves to us.
    theirs = theirs[len(theirs) - len(ours) :]
    for code, end, centre, move in zip(ours.code, ours.end, ours.centre_mm, theirs, strict=True):
        kinds = {0: "traverse", 1: "feed", 2: "arc", 3: "arc", 38: "probe"}
        assert move.kind == kinds[int(code)]
        assert np.abs(end - move.end).max() < PRINTED_MM
        if move.centre is not None:
            # The interpreter works the centre of an R arc out from the ends; where the radius is
            # half the distance of the ends but for rounding, that is ill-conditioned.
            assert np.abs(centre - move.centre).max() < 2e-4
    return ours


@pytest.mark.parametrize("seed", range(5))
def test_finishing_programs_by_the_nose_centre(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    profile = Profile.from_points(random_points(rng, grooves=False))
    made = profile.finishing(
        "linuxcnc-lathe", follows="nose-centre", nose_mm=0.2, head=HEAD, tail=TAIL
    )
    same_path(made.program, tmp_path)
    z = np.linspace(float(profile.elements[0, 1]), float(profile.elements[-1, 3]), 300)
    error = 20 * np.sin(z / 15) - 10
    corrected = correct(
        made.program, (z, error), follows="nose-centre", nose_mm=0.2, unit_um=1.0, window=1
    )
    same_path(corrected.program, tmp_path)


@pytest.mark.parametrize("seed", range(5))
def test_nose_compensation_gives_our_centre_path(seed: int, tmp_path: Path) -> None:
    """Under G42 the interpreter offsets the contour itself: an outside check of `Profile.path`."""
    rng = np.random.default_rng(100 + seed)
    profile = Profile.from_points(random_points(rng, grooves=False))
    nose = 0.2
    made = profile.finishing(
        "linuxcnc-lathe",
        head=[*HEAD, [("T", 1), ("M", 6)], [("G", 42)]],
        tail=[[("G", 40)], *TAIL],
    )
    got = interpret(made.program.text(), tmp_path, nose_mm=nose)
    path = profile.path("nose-centre", nose)
    # Ends of our elements lie on their path (which places a flat corner a little elsewhere along
    # it: the programmed contour is rounded to 1 µm).
    theirs = polyline([m for m in got if m.kind in ("feed", "arc")])
    ours = path[:-1, 3:5]
    assert distance(ours, theirs).max() < 2e-3


def polyline(moves: list[Canonical]) -> FloatArray:
    """Points z, x along feed moves, arcs (short of half a turn) in chords that leave 0.1 µm."""
    points = [np.array([moves[0].end[2], moves[0].end[0]])]
    for move in moves[1:]:
        end = np.array([move.end[2], move.end[0]])
        if move.centre is not None:
            centre = np.array(move.centre)
            a, b = points[-1] - centre, end - centre
            turned = np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
            for angle in np.linspace(0, turned, 400)[1:-1]:
                c, s = np.cos(angle), np.sin(angle)
                points.append(centre + np.array([c * a[0] - s * a[1], s * a[0] + c * a[1]]))
        points.append(end)
    return np.array(points)


def distance(points: FloatArray, line: FloatArray) -> FloatArray:
    """Distance of each point from a polyline."""
    start, way = line[:-1], np.diff(line, axis=0)
    length = np.maximum((way**2).sum(1), 1e-30)
    share = ((points[:, None] - start) * way).sum(2) / length
    foot = start + np.clip(share, 0, 1)[..., None] * way
    least: FloatArray = np.sqrt(((points[:, None] - foot) ** 2).sum(2)).min(1)
    return least


@pytest.mark.parametrize("seed", range(4))
def test_probe_programs(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(200 + seed)
    profile = Profile.from_points(random_points(rng))
    path = probe_path(profile, TurningProbe(), chuck_radius_mm=0.0)
    if not path.intervals:
        pytest.skip("nothing of this part can be measured")
    program = path.program("linuxcnc-lathe", feed=120, head=HEAD[:2], tail=TAIL[1:])
    moves = same_path(program, tmp_path)
    assert np.abs(moves.begin[[2, 0]] - path.moves_mm[0, 2:]).max() < 1e-3


def test_a_probing_cycle_of_the_mill(tmp_path: Path) -> None:
    program = Program.from_blocks(
        "linuxcnc",
        [
            [("G", 21), ("G", 90), ("G", 94)],
            "PROBEOPEN touches.txt",
            [("G", 0), ("X", 10), ("Y", -20.5), ("Z", 30), ("A", -90), ("C", 45)],
            [("G", 38.2), ("X", -3.1234), ("F", 600)],
            [("G", 0), ("X", 10)],
            "PROBECLOSE",
            [("M", 2)],
        ],
    )
    moves = interpret(program.text(), tmp_path)
    assert [m.kind for m in moves][:2] == ["traverse", "probe"]
    assert moves[1].end == (-3.1234, -20.5, 30.0, -90.0, 0.0, 45.0)


def test_what_we_refuse_the_interpreter_refuses(tmp_path: Path) -> None:
    for text in ("G0 X0 Z0\nG3 X5 Z-5 F1\nM2\n", "G0 X0 Z0\nG3 X50 Z-5 R5 F1\nM2\n"):
        with pytest.raises(ValueError, match="line 2"):
            follow(Program.parse(text, "linuxcnc-lathe"))
        with pytest.raises(AssertionError, match=r"[Rr]adius|R i j k"):
            interpret("G18\n" + text, tmp_path)
