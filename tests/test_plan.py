"""Plans: the paper's, others, and what a plan must never contain."""

import numpy as np
import pytest

import trunnion as tn
from trunnion.nc import follow
from trunnion.setup.machines import presets

CROSS = tn.Setup(artefact=tn.Artefact("cross"))


def test_the_papers_three_cycles() -> None:
    plan = tn.plan(CROSS)
    assert len(plan) == 72
    assert plan.point is not None
    assert plan.a_deg is not None
    assert plan.c_deg is not None
    for c in (0, 90, 180, 270):
        rows = (plan.a_deg == 0) & (np.round(plan.c_deg) == c)
        assert plan.point[rows].tolist() == list(range(1, 17))
    for a in (90, -90):
        assert plan.point[np.round(plan.a_deg) == a].tolist() == [17, 18, 19, 20]
    # Contacts of the arm -X at A = C = 0 (label 8 is its +Y side, 37.5 mm out).
    row = int(np.flatnonzero(plan.point == 8)[0])
    assert plan.position_mm[row] == pytest.approx([-37.5, 13.5, 12.5])
    assert plan.direction[row] == pytest.approx([0.0, -1.0, 0.0])


def test_commands_are_rounded_to_the_resolution() -> None:
    coarse = tn.Setup(
        artefact=tn.Artefact("cross"),
        resolution=tn.Resolution(linear_um=1.0, rotary_arcsec=36.0),
    )
    plan = tn.plan(coarse, c_deg=(17.1234,), a_deg=(33.3333,))
    assert plan.start_mm is not None
    assert np.allclose(plan.start_mm * 1e3, np.round(plan.start_mm * 1e3), atol=1e-9)
    assert plan.c_deg is not None
    assert np.allclose(plan.c_deg / 0.01, np.round(plan.c_deg / 0.01), atol=1e-9)
    assert np.allclose(np.linalg.norm(plan.direction, axis=1), 1.0, atol=1e-12)


def test_both_senses_and_two_feeds_are_balanced() -> None:
    plan = tn.plan(
        CROSS,
        c_deg=range(0, 360, 30),
        a_deg=range(-90, 91, 30),
        both_senses=True,
        feeds_mm_min=(200, 600),
    )
    assert 450 < len(plan) < 560
    assert plan.c_dir is not None
    assert plan.feed_mm_min is not None
    for sense in (-1, 1):
        for feed in (200, 600):
            share = np.mean((plan.c_dir == sense) & (plan.feed_mm_min == feed))
            assert abs(share - 0.25) < 0.1
    assert plan.time_s is not None
    assert np.all(np.diff(plan.time_s) > 0)


@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc"])
@pytest.mark.parametrize("kind", ["cross", "cuboid"])
def test_the_program_never_takes_ball_or_stem_into_anything(preset: str, kind: str) -> None:
    """Sampled independently of the planner: distances of ball and stem to boxes and table."""
    setup = tn.Setup(artefact=tn.Artefact(kind), machine=tn.Machine(preset=preset))
    tilt = {"a_deg" if preset == "trt-ca" else "b_deg": (-90, -60, -30, 30, 60, 90)}
    plan = tn.plan(setup, c_deg=(0, 30, 90, 200), **tilt)  # type: ignore[arg-type]
    machine = presets()[preset].core(150.0)
    moves = follow(tn.probing_program(plan, setup).moves)
    letters = "AC" if preset == "trt-ca" else "BC"
    columns = [3 + "ABC".index(letter) for letter in letters]
    checked = 0
    stopped = None
    for start, end, feed in zip(moves.start, moves.end, moves.feed, strict=True):
        if np.any(start[3:] != end[3:]):
            assert start[2] > 155.0 or checked == 0  # above all that swings
            continue
        pose = machine.table_pose(np.ascontiguousarray(end[columns])[None, :]).reshape(3, 4)
        # An approach ends at the contact, half way to its target; the next move starts there.
        approach = feed == 600.0
        origin = start[:3] if stopped is None else stopped
        target = 0.5 * (start[:3] + end[:3]) if approach else end[:3]
        stopped = target if approach else None
        ball = origin + np.linspace(0.0, 1.0, 9)[:, None] * (target - origin)
        stem = ball[:, None] + np.linspace(0.0, 150.0, 151)[:, None] * [0.0, 0.0, 1.0]
        gap = _distance((stem - pose[:, 3]) @ pose[:, :3], setup)
        assert gap[:, 0].min() > 1.0 - 1e-3
        assert gap.min() > 0.5 - 1e-3
        checked += len(gap)
    assert checked > 1000


def _distance(points: np.ndarray, setup: tn.Setup) -> np.ndarray:
    """Distance of points (..., 3) in the table's frame to the artefact and the table."""
    a = setup.artefact
    if a.kind == "cross":
        boxes = [(a.length_mm, a.width_mm), (a.width_mm, a.length_mm)]
    else:
        boxes = [(a.length_mm, a.width_mm)]
    found = []
    for x, y in boxes:
        low = np.array([-x / 2, -y / 2, 0.0])
        high = np.array([x / 2, y / 2, a.height_mm])
        found.append(np.linalg.norm(points - np.clip(points, low, high), axis=-1))
    x, y, z = np.moveaxis(points, -1, 0)
    radial = np.maximum(np.hypot(x, y) - setup.table.radius_mm, 0.0)
    axial = np.maximum(np.maximum(z, -setup.table.thickness_mm - z), 0.0)
    found.append(np.hypot(radial, axial))
    return np.asarray(np.min(found, axis=0))


def test_a_log_of_probeopen_reads_back(tmp_path) -> None:  # type: ignore[no-untyped-def]
    plan = tn.plan(CROSS)
    measured = tn.simulate(plan, CROSS, {"EX0C": 15.0, "EA0A": 20.0}, noise_um=0.3, seed=1)
    log = tmp_path / "log.txt"
    rows = zip(measured.position_mm, measured.a_deg, measured.c_deg, strict=True)  # type: ignore[arg-type]
    log.write_text(
        "".join(
            f"{x:f} {y:f} {z:f} {a:f} 0.000000 {c:f} 0.000000 0.000000 0.000000\n"
            for (x, y, z), a, c in rows
        )
    )
    again = tn.read_probe_log(log, plan)
    assert np.allclose(again.position_mm, measured.position_mm, atol=1e-6)
    assert tn.identify(again, CROSS).errors["EX0C"] == pytest.approx(15.0, abs=0.5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"c_deg": (), "a_deg": ()}, "angles of a plan: got none"),
        ({"c_deg": (float("nan"),)}, r"c_deg\[0\]: got nan"),
        ({"c_deg": (1e9,)}, r"c_deg: got 1e\+09, expected angles within ±3600°"),
        ({"repeats": 10**9}, "more than 10,000 stops of the rotary axes together"),
        ({"feeds_mm_min": ()}, "feeds of a plan: got none"),
        ({"feeds_mm_min": (-5,)}, "feeds_mm_min: got -5"),
        ({"repeats": 0}, "repeats: got 0"),
        ({"b_deg": (90,)}, "b_deg: got angles, expected none"),
        ({"layout": "upside"}, "layout.*upside.*side, top"),
        ({"c_deg": ("a",)}, r"c_deg\[0\]: got 'a'"),
    ],
)
def test_bad_requests_say_what_is_wrong(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(tn.TrunnionError, match=message):
        tn.plan(CROSS, **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("axis", "limits", "found"),
    [
        ("X", {"range_mm": (-50.0, 300.0)}, r"touch 7: got a move of X to -56\.0"),
        ("Z", {"range_mm": (-100.0, 130.0)}, r"the way to the .*: got a move of Z to 161\.0"),
        ("A", {"range_deg": (-120.0, 30.0)}, "touch 65: got a move of A to 90 deg"),
        # C comes to 0 from the positive sense, by way of -5.
        ("C", {"range_deg": (0.0, 360.0)}, "touch 1: got a move of C to -5 deg"),
    ],
)
def test_a_plan_beyond_the_range_of_an_axis(
    axis: str, limits: dict[str, tuple[float, float]], found: str
) -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"), axes={axis: tn.AxisSetup(**limits)})  # type: ignore[arg-type]
    message = found + rf".* expected .* as axes\.{axis}\.range_"
    with pytest.raises(tn.DataError, match=message):
        tn.plan(setup)
    with pytest.raises(tn.DataError, match=message):
        tn.probing_program(tn.plan(CROSS), setup)
    name, (low, high) = next(iter(limits.items()))
    wide = tn.AxisSetup(**{name: (low - 200.0, high + 200.0)})  # type: ignore[arg-type]
    assert len(tn.plan(tn.Setup(artefact=tn.Artefact("cross"), axes={axis: wide}))) == 72


def test_all_axes_beyond_their_ranges_are_named_at_once() -> None:
    """Each plan that was made again found the next axis."""
    axes = {
        "X": tn.AxisSetup(range_mm=(-50.0, 300.0)),
        "A": tn.AxisSetup(range_deg=(-120.0, 30.0)),
        "Y": tn.AxisSetup(range_mm=(-300.0, 300.0)),
    }
    with pytest.raises(tn.DataError) as caught:
        tn.plan(tn.Setup(artefact=tn.Artefact("cross"), axes=axes))
    said = str(caught.value)
    assert said.startswith("plan, touch 7: got a move of X to -56.0")
    assert "; touch 65: got a move of A to 90 deg, expected -120 to 30 deg as axes.A." in said
    assert "of Y" not in said


@pytest.mark.parametrize(
    ("axis", "limits"),
    [("X", {"range_deg": (0, 1)}), ("A", {"range_mm": (0, 1)}), ("A", {"range_deg": (1, 0)})],
)
def test_ranges_that_are_none(axis: str, limits: dict[str, tuple[float, float]]) -> None:
    with pytest.raises(tn.InputError, match=rf"axes\.{axis}\.range_.* got .* expected"):
        tn.Setup(artefact=tn.Artefact("cross"), axes={axis: tn.AxisSetup(**limits)})  # type: ignore[arg-type]


@pytest.mark.parametrize("both_senses", [False, True])
def test_times_are_those_of_the_program(both_senses: bool) -> None:
    """Counted from the program's moves: each at its speed, approaches half way to their ends."""
    plan = tn.plan(CROSS, c_deg=(0, 30, 200), both_senses=both_senses, dither=False)
    program = tn.probing_program(plan, CROSS)
    moves = follow(program.moves)
    clock, found, at = 0.0, [], moves.start[0]
    for start, end, feed, code in zip(moves.start, moves.end, moves.feed, moves.code, strict=True):
        approach = code == 38 and feed == 600.0
        to = 0.5 * (start + end) if approach else end
        way = to - at
        speed = CROSS.plan.rapid_mm_min if code == 0 else feed
        clock += 60 * max(
            np.linalg.norm(way[:3]) / speed, np.abs(way[3:]).max() / CROSS.plan.rotary_deg_min
        )
        found += [clock] if approach else []
        at = to
    assert plan.time_s is not None
    found = found[len(program.cycle.looks) :]
    # Where the program begins is not known: its first moves are left out.
    # Moves are written to 0.1 µm, half a step off: 6e-6 s at the feed of an approach.
    assert np.diff(plan.time_s) == pytest.approx(np.diff(found), abs=1.2e-5)
    assert plan.time_s[0] == pytest.approx(found[0], abs=3.0)


def test_an_artefact_out_of_reach_is_an_error() -> None:
    thick = tn.Setup(
        artefact=tn.Artefact("cross"), probe=tn.Probe(ball_radius_mm=1.0, stem_radius_mm=0.9)
    )
    assert len(tn.plan(thick)) == 72
    with pytest.raises(tn.DataError, match="no face of the artefact can be reached"):
        tn.plan(CROSS, c_deg=(), a_deg=(180,))
