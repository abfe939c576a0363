"""Rows of paper-turning.md, and its picture; used by make_papers.py."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

import trunnion as tn
from trunnion import turning
from trunnion.nc import Program, follow

Row = tuple[str, str, str, str, str]
LISTINGS = Path(__file__).parents[1] / "tests" / "data" / "turning"
CODES = [("G", 4503.0)]  # a code of that lathe which moves nothing

PART = turning.Profile.from_points(
    [
        turning.Corner(235, 0), turning.Corner(235, 10), turning.Corner(230, 15),
        turning.Corner(190, 15), turning.Corner(155, 25), turning.Corner(155, 30),
        turning.Corner(150, 35), turning.Corner(125, 35, "fillet", 5), turning.Corner(125, 20),
        turning.Corner(65, 20), turning.Corner(65, 35, "fillet", 5), turning.Corner(35, 35),
        turning.Corner(35, 42), turning.Corner(0, 42),
    ]
)  # fmt: skip
"""Fig. 9, z and radius."""


def lathe() -> Iterable[Row]:
    """Rows of the second paper."""
    path = turning.probe_path(
        PART, turning.TurningProbe(ball_diameter_mm=10.0, contact_angle_deg=110.0,
        body_diameter_mm=12.0), allowance_mm=0.5, skip=[len(PART.elements) - 1], retract_x_mm=50.0,
        approach_mm=1.0, chuck_radius_mm=0.0,
    )  # fmt: skip
    yield from _probe(path)
    made = path.program("paper-um", first_number=3, tail=[[("T", 40.0)]], retract_last=False).text()
    yield (
        "Fig. 12: path of the probe", "`turning.probe_path`", "listing", _same(made, "fig12"),
        "from the shape of Fig. 9, with a ball of 10 mm; the dimensions of the text (3.175 mm, "
        "89°, "
        "4.9 mm) do not make it",
    )  # fmt: skip
    yield (
        "Fig. 14: finishing program, corrected", "`turning.correct`", "listing",
        "line for line, `tests/test_turning_listings.py`",
        "its readings are not printed: readings with the printed units prove place and format of "
        "the "
        "blocks, not the error",
    )  # fmt: skip
    wet, dry = _facts("fig18", 196, 74), _facts("fig20", 190, 54)
    for name, facts in (("18, with coolant", wet), ("20, without", dry)):
        said = ", ".join(f"{level:+.0f} µm at {t:.1f} s" for t, level in facts)
        yield (
            f"Fig. {name}", "`turning.crossings`", "listing", said,
            "**measured**: where the error crossed half units"
            + ("; X 70 is programmed, the text says φ72" if name.startswith("18") else ""),
        )  # fmt: skip
    size, tau = least_squares(lambda p: [_law(t, *p) - level for t, level in dry], (40.0, 30.0)).x
    wet_size = wet[0][1] / float(_law(wet[0][0], 1.0, tau))
    yield (
        "error without coolant at the chuck", "`tool_heating`", "about −27 µm",
        f"{_law(65 / _speed(54), size, tau):.1f} µm",
        f"E = {size:.1f} µm, τ = {tau:.1f} s through the three crossings",
    )  # fmt: skip
    yield (
        "error with coolant at z = 5", "the same τ", "about −11 µm",
        f"{_law(60 / _speed(74), wet_size, tau):.1f} µm", "one crossing gives the amplitude",
    )  # fmt: skip
    for name, words, paper, figures in (
        ("fig18", "with coolant", "±4.3 µm", (wet_size, tau, 74, 0.0)),
        ("fig20", "without", "±7 µm", (size, tau, 54, 0.0)),
    ):
        left = _left(name, *figures)
        yield (
            f"after correction, {words}", "`turning.change_um`", paper,
            f"{left.min():+.1f} to {left.max():+.1f} µm",
            "the printed program replayed against the law: blocks stand half a unit ahead. "
            "Acceleration, which the paper holds responsible, is in the row below",
        )  # fmt: skip
    _, made = simulation()
    yield (
        "Figs. 13, 15", "`tn.plot.plot_correction`", "largest error 28 µm at the chuck",
        f"[picture](../figures/papers_turning.png): {np.abs(made.error_um).max():.0f} µm at the "
        f"chuck, left {np.abs(made.remaining_um[made.covered]).max():.1f} µm",
        "the paper's readings are not printed: these are ours, with its largest",
    )  # fmt: skip
    yield (
        "Fig. 3: eight types of points", "`turning.read_shape`, `trunnion turning finish`",
        "TY 1 to 8", "read from a file, to the finishing program",
        "a drawing; the text fixes 7 (5 and 6 together) and 8 (after finishing), the others are a "
        "reconstruction",
    )  # fmt: skip
    yield (
        "Fig. 10: eight jobs of a menu",
        "`trunnion turning finish`, `path`, `correct`, `diagnose`, pictures of each", "eight",
        "all that the text names but the transfer to the lathe",
        "that is the control's; the menu itself is a drawing",
    )  # fmt: skip
    yield (
        "section 5.3: acceleration at the added blocks", "`block_acceleration`",
        "held responsible for ±7 µm, not examined", _accelerating(),
        "uniform acceleration from a stop; `[turning] blocks_mm` states the blocks, a diagnosis "
        "tests the explanation on measured diameters",
    )  # fmt: skip
    yield (
        "section 1: thermal growth of the workpiece", "`workpiece_heating`", "named as a cause",
        "a cause where diameters differ by a tenth", "on one diameter it looks like a tool that "
        "grows",
    )  # fmt: skip
    yield (
        "section 2.3 (6): measuring feed", "`turning.Gauge`", "speed of the data acquisition",
        f"{1e3 * turning.Gauge(cycle_ms=8.0).tick_mm(120.0):.0f} µm between places at 120 mm/min "
        "and 8 ms", "`cycle_ms`: the control gives its position once a cycle, feed × cycle time "
        "apart; the cycle of its control is not printed",
    )  # fmt: skip


def _probe(path: turning.ProbePath) -> Iterable[Row]:
    """Rows on the probe and on what it measures."""
    probe = turning.TurningProbe()
    steepest = np.tan(np.radians(180 - probe.contact_angle_deg) / 2)
    gauge = turning.Gauge()
    yield (
        "Figs. 1, 2, 9: coordinates, part", "`turning.Profile`", "drawings",
        f"{len(PART.elements)} lines and arcs", "z from the chuck outward, x the radius, as "
        "printed",
    )  # fmt: skip
    yield (
        "Fig. 4: the probe", "`turning.TurningProbe`", "d 3.175 mm, θ 89°, D 4.9 mm",
        f"d {probe.ball_diameter_mm:g} mm, θ {probe.contact_angle_deg:g}°, "
        f"D {probe.body_diameter_mm:g} mm", "slopes up to tan((180° − θ)/2) = "
        f"{steepest:.3f} touch the ball alone; steeper lines, walls and arcs are not measured",
    )  # fmt: skip
    ends = "; ".join(f"{i.start_mm[0]:.1f} to {i.end_mm[0]:.1f}" for i in path.intervals)
    yield (
        "Fig. 5, section 2.2: change points, measured stretches", "`turning.probe_path`",
        "Z_start, Z_end of the listing", f"Z {ends}", "walls by intersection; the flange is left "
        "out in the listing by no printed rule",
    )  # fmt: skip
    yield (
        "section 2.3 (1): curves", "`turning.correct`", "linear between the errors of their ends",
        "linear, whatever the rule", "arcs and steep lines are not measured; "
        "`tests/test_turning_correction.py` holds that there is no notch with `look_ahead` on or "
        "off",
    )  # fmt: skip
    yield (
        "Fig. 16: gauge and data acquisition", "`turning.Gauge`", "150 µm, 0.5 µm",
        f"{gauge.range_um:g} µm, {gauge.resolution_um:g} µm, simulated",
        "no voltages are read here: readings come as `diameters.csv`",
    )  # fmt: skip


def simulation() -> tuple[turning.Finishing, turning.Correction]:
    """Return the part of Fig. 9, and its correction for an error of 28 µm at the chuck."""
    plain = PART.finishing(
        "paper-um", follows="nose-centre", nose_mm=0.8, convex="meet", first_element=1,
        start_z_mm=236.5, retract_x_mm=50.0, approach_mm=1.0, access_z_mm=[92.945], first_number=3,
    )  # fmt: skip
    z = np.concatenate(
        [np.arange(a, b, -1.0) for a, b in ((230, 166), (150, 129), (113, 76), (60, 35))]
    )
    error = -28.0 * (1 - np.exp(-(235 - z) / 70)) / (1 - np.exp(-200 / 70))
    made = turning.correct(plain.program, (z, error), rule="paper", unit_um=10.0, feed=0.1)
    return plain, made


def _accelerating() -> str:
    """Return how far an axis goes until it has its feed, and what that does on the dry run."""
    feed = _speed(54)
    ways = ", ".join(f"{1e3 * feed**2 / 2 / a:.1f} µm at {a:g} mm/s²" for a in (50.0, 500.0))
    return f"feed {feed:.2f} mm/s is reached within {ways}: too short a way to show in diameters"


def picture(target: Path) -> None:
    """Draw what Figs. 13 and 15 show: error, correction and corrected path."""
    _, made = simulation()
    figure = Figure(figsize=(9.0, 7.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    tn.plot.plot_correction(made, ax=above)
    tn.plot.plot_profile(PART, ax=below)
    moves = follow(made.program, feed=0.1)
    labels = {0: "rapid", 1: "corrected path"}
    for i, code in enumerate(moves.code):
        rapid = code == 0
        points = np.array([moves.start[i], moves.end[i]])[:, [2, 0]]
        if code in (2, 3):
            away = points - moves.centre_mm[i]
            first, last = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
            angles = np.linspace(first, last, 20)
            circle = np.column_stack([np.cos(angles), np.sin(angles)])
            points = moves.centre_mm[i] + np.hypot(*away[0]) * circle
        style = {"color": "0.6", "ls": ":"} if rapid else {"color": "tab:red"}
        below.plot(*points.T, lw=1.2, label=labels.pop(0 if rapid else 1, "_"), **style)
    starts = moves.end[np.isin(moves.block, made.inserted)]
    below.plot(starts[:, 2], starts[:, 0], "o", ms=4, color="tab:red", label="added blocks")
    below.set_ylim(0.0, 72.0)
    below.legend(loc="upper center", fontsize="small", ncols=4)
    figure.savefig(target, dpi=120)


def _same(text: str, name: str) -> str:
    """Compare with a listing, line by line."""
    pairs = list(zip(text.splitlines(), _listing(name).splitlines(), strict=False))
    same = sum(a == b for a, b in pairs)
    return f"{same} of {len(_listing(name).splitlines())} lines equal"


def _speed(turned_mm: float) -> float:
    """Feed along Z at 0.1 mm a revolution and 200 m/min, mm/s."""
    return 0.1 * (200e3 / 60) / (np.pi * turned_mm)


def _law(seconds: object, size: float, tau: float) -> np.ndarray:
    return -size * (1 - np.exp(-np.asarray(seconds) / tau))


def _listing(name: str) -> str:
    return (LISTINGS / f"{name}.nc").read_text(encoding="utf-8")


def _facts(name: str, readings: int, turned_mm: float) -> list[tuple[float, float]]:
    """Cutting time and level of each crossing."""
    nominal = 70.0 if name == "fig18" else 52.0
    found = turning.crossings(
        Program.parse(_listing(name), "fanuc-lathe"), unit_um=10, window_mm=5 * 60 / readings,
        nominal_mm=nominal, machine_codes=CODES,
    )  # fmt: skip
    return [((65 - c.z_mm[1]) / _speed(turned_mm), c.level_um) for c in found]


def _left(name: str, size: float, tau: float, turned_mm: float, end_mm: float) -> np.ndarray:
    """What the printed program leaves of the law down to a place, µm."""
    text = _listing(name)
    before = {
        "fig18": text.replace("N0009 X70.01Z45.714\n", "").replace("N0010 Z0F.10", "N0009 Z0F.10"),
        "fig20": text.replace("N0009 X52.01Z56.158\n", "")
        .replace("N0010 X52.02Z37.211\n", "")
        .replace("N0011 X52.03Z7.211\n", "")
        .replace("N0012 X52.02Z0", "N0009 Z0"),
    }[name]
    z = np.linspace(64.9, end_mm, 400)
    change, _ = turning.change_um(
        Program.parse(before, "fanuc-lathe"), Program.parse(text, "fanuc-lathe"), z,
        machine_codes=CODES,
    )  # fmt: skip
    return np.asarray(_law((65 - z) / _speed(turned_mm), size, tau) + change)
