"""Write papers.md: every result of the four papers beside what this package gives: ``make docs``.

Numbers of the papers are copied from them; ours come from runs, here and now.
"""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

import trunnion as tn
from trunnion import contouring as ct
from trunnion import hybrid, turning
from trunnion.demo import PAPER_ESTIMATES, table_3
from trunnion.nc import Program, follow
from trunnion.samples.truth import TABLE_2

PAGE = Path(__file__).parent / "results" / "papers.md"
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

POSE = (1100.0, 1150.0, 1100.0, 0.0, 18.0)
"""Legs, mm, and wrist, degrees: in the middle of the working space."""

Row = tuple[str, str, str, str, str]
HEAD = ("in the paper", "here", "the paper says", "we get", "why they differ, or what was chosen")


def page() -> str:
    """Return the whole page."""
    sections: Sequence[tuple[str, str, Callable[[], Iterable[Row]]]] = (
        (
            "Kang, Kim, Jee (2022): location errors of a tilting rotary table with a cross",
            "[closed-forms.md](../explanation/closed-forms.md), `notebooks/01_calibrate.ipynb`, "
            "`trunnion demo`.",
            cross,
        ),
        (
            "C. K. Park, D. S. Park (1990): correction of turning programs",
            "[turning.md](../how-to/turning.md), `notebooks/03_turning.ipynb`. The crossings of "
            "Figs. 18 "
            "and 20 "
            "are the only measured facts of the paper that its text holds; all else is simulated.",
            lathe,
        ),
        (
            "Byun, Jee (2010): cross-coupled control of five axes",
            "[contouring.md](../how-to/contouring.md), `notebooks/04_contouring.ipynb`. The "
            "figures have no "
            "numbers: order and ratio can be compared.",
            five_axes,
        ),
        (
            "Ko, Kim, Kim, Na: sensitivities of a hybrid parallel machine",
            "`notebooks/05_hybrid.ipynb`, `trunnion.hybrid`. Fig. 1, which defines the errors, "
            "is not in "
            "the text: e1, e3, e4, e8 to e15 and all dimensions are a reconstruction.",
            parallel,
        ),
    )
    parts = ["# The four papers, result by result\n\nMade by `make docs` from runs.\n"]
    for title, where, rows in sections:
        lines = [f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|"]
        lines += [f"| {' | '.join(row)} |" for row in rows()]
        parts.append(f"## {title}\n\n{where}\n\n" + "\n".join(lines) + "\n")
    parts.append(artefacts())
    return "\n".join(parts)


def artefacts() -> str:
    """Return what plans on other artefacts see, and at what cost."""
    head = ("artefact", "plan", "touches", "minutes", "tilts", "offsets", "not identifiable")
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    kinds = {
        "cross 100 × 25 × 25": tn.Artefact("cross"),
        "cuboid 100 × 100 × 50": tn.Artefact(
            "cuboid", length_mm=100.0, width_mm=100.0, height_mm=50.0
        ),
        "sphere 25, 60 off the axis": tn.Artefact(
            "sphere", diameter_mm=25.0, centre_mm=(60.0, 0.0, 80.0)
        ),
    }
    turns = {"a_deg": (-90, -45, 45, 90), "c_deg": tuple(range(0, 360, 45))}
    for name, artefact in kinds.items():
        setup = tn.Setup(artefact=artefact)
        for said, plan in (("paper", tn.plan(setup)), ("rich", tn.plan(setup, **turns))):
            seen = tn.observability(plan, setup, noise_um=1.0)
            units = {
                k: "um" if k[1] in "XYZ" else "arcsec" for k in seen.std_errors if k[:1] == "E"
            }
            worst = {
                unit: max(seen.std_errors[k] for k, u in units.items() if u == unit)
                for unit in ("arcsec", "um")
            }
            missing = [k for k in units if not np.isfinite(seen.std_errors[k])]
            minutes = f"{float(plan.time_s[-1]) / 60:.1f}"
            cells = (
                name, said, str(len(plan)), minutes, f"{worst['arcsec']:.1f}″",
                f"{worst['um']:.2f} µm", ", ".join(missing) or "–",
            )  # fmt: skip
            lines.append(f"| {' | '.join(cells)} |")
    return (
        "## Cross, cuboid and sphere\n\n"
        "The paper compares its cross with the cuboid and the sphere of earlier work in words. "
        "Largest standard\nuncertainty of a tilt and of an offset at 1 µm repeatability; "
        "plans: the paper's positions, and C every 45°\nwith A = ±45°, ±90°. A cuboid of the "
        "cross' "
        "size sees tilts better, as its faces are wider apart; a sphere has\nno rotation of its "
        "own "
        "to be found and needs the fewest touches.\n\n" + "\n".join(lines) + "\n"
    )


# --- the cross


def cross() -> Iterable[Row]:
    """Rows of the first paper."""
    setup = tn.Setup(artefact=tn.Artefact("cross"), probe=tn.Probe(tick_um=0.1))
    plan = tn.plan(setup)
    yield (
        "Figs. 3, 4: labels 1 to 20, three cycles", "`tn.plan`", "72 touches", f"{len(plan)} "
        f"touches",
        "17 and 20 on side faces as drawn; `layout=\"top\"` puts them on top. Eq. (2) gives A = "
        "0 for "
        "i = 1, 2, its text ±90°: the text is followed",
    )  # fmt: skip
    data = tn.simulate(plan, setup, TABLE_2)
    for method in ("printed", "separating"):
        found = tn.closed_form(data, setup, method).errors
        rates = [abs(_table_2(found, k) / _table_2(TABLE_2, k) - 1) for k in PAPER_ESTIMATES]
        why = (
            "as printed they lose EX0C and EY0C and find EB0A too small; six corrections of "
            "misprints "
            "are listed by `slips`"
            if method == "printed"
            else "eight errors and six placement parameters from the same touches; what is left "
            "is the "
            "0.1 µm tick"
        )
        yield (
            "eqs. (3) to (20), Table 2", f'`tn.closed_form(method="{method}")`',
            "largest error rate 1.7 %", f"{max(rates):.2%}", why,
        )  # fmt: skip
    yield (
        "the same by least squares", "`tn.identify`, `tn.casadi_baseline.identify`", "–",
        f"{_worst_rate(tn.identify(data, setup).errors):.2%}",
        "`tn.compare_methods` and `trunnion compare` put all methods side by side",
    )  # fmt: skip
    yield (
        "section 2: any position of A", '`tn.closed_form(method="printed")`', "any",
        "A = ±90°, others refused", "(9) and (10) do not hold at other tilts; least squares do",
    )  # fmt: skip
    yield (
        "section 3.1: ADAMS and Simulink", "`tn.simulate`", "co-simulation",
        "contact of ball and artefact solved",
        "no servo lag, no contact force; the trigger's tick is feed × servo period "
        "(`probe.servo_period_ms`)",
    )  # fmt: skip
    for name, paper, ours in _table_3_rows():
        yield "Table 3, Figs. 11 to 13", "`tn.volumetric_error`", f"{name}: {paper} µm", ours, ""
    turned = tn.printed_zeros(TABLE_2, setup_yaw_arcsec=600.0)
    yield (
        "E_CRS, the turn of the set-up", "`tn.printed_zeros(setup_yaw_arcsec=600)`",
        "in eq. (22), without a number", f"C {turned.c_deg[0]:+.1f}° instead of "
        f"{tn.printed_zeros(TABLE_2).c_deg[0]:+.1f}°, A {3600 * turned.a_deg[0]:+.1f}″",
        "the turn of the set-up goes over into C as a whole: −600″ are −0.17°",
    )  # fmt: skip
    yield (
        "eqs. (22) to (24)", "`tn.printed_zeros`", "A and C of the zeros",
        _zeros(),
        "near A = 0 the position of C is decided by the ratio of two small errors; with the origin "
        "offsets the upper sign removes a third",
    )  # fmt: skip


def _table_2(errors: dict[str, float], name: str) -> float:
    first, _, second = name.partition("−")
    return errors[first] - (errors[second] if second else 0.0)


def _worst_rate(errors: dict[str, float]) -> float:
    return max(abs(_table_2(errors, k) / _table_2(TABLE_2, k) - 1) for k in PAPER_ESTIMATES)


def _table_3_rows() -> Iterable[tuple[str, str, str]]:
    for row in table_3().rows:
        name, paper, ours = (str(cell) for cell in row)
        yield name, paper, f"{ours} µm"


def _zeros() -> str:
    printed = tn.printed_zeros(TABLE_2)
    pairs = zip(printed.a_deg, printed.c_deg, strict=True)
    return "; ".join(f"A {3600 * a:+.1f}″, C {c:+.1f}°" for a, c in pairs)


# --- the lathe


def lathe() -> Iterable[Row]:
    """Rows of the second paper."""
    path = turning.probe_path(
        PART, turning.TurningProbe(ball_diameter_mm=10.0, contact_angle_deg=110.0,
        body_diameter_mm=12.0), allowance_mm=0.5, skip=[len(PART.elements) - 1], retract_x_mm=50.0,
        approach_mm=1.0, chuck_radius_mm=0.0,
    )  # fmt: skip
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


# --- five axes


def five_axes() -> Iterable[Row]:
    """Rows of the third paper."""
    path = ct.Path.paper()
    found = ct.compare()
    models = ct.position_models()
    yield (
        "eq. (8), Fig. 6", "`contouring.Path.paper`", "curve", f"length {path.length_mm:.4f} mm",
        "the tool stands on the surface that the path lies on; the path's place on the table is "
        "not "
        "printed",
    )  # fmt: skip
    for feed in found.feeds_mm_min:
        f = found[feed, "independent"].figures
        yield (
            f"Fig. 7, {feed / 1000:g} m/min", "`contouring.compare`", "proposed model as the truth",
            f"{f['proposed_max_arcsec']:.2f}″ against {f['tangent_max_arcsec']:.0f}″ of the "
            f"earlier one",
            "the earlier one is a reconstruction",
        )  # fmt: skip
        sizes = ", ".join(
            f"{c} {found[feed, c].figures['contour_max_um']:.2f}" for c in found.controllers
        )
        tangent = models[feed, models.controllers[-1]].figures["contour_max_um"]
        yield (
            f"Fig. 8, {feed / 1000:g} m/min", "`contouring.compare`", "coupling cuts the error",
            f"{sizes} µm",
            f"the existing controller with the tangent line for the position would leave "
            f"{tangent:.1f} "
            "µm: the circle is the choice that fits the paper",
        )  # fmt: skip
        sizes = ", ".join(
            f"{c} {found[feed, c].figures['orientation_max_arcsec']:.1f}" for c in found.controllers
        )
        yield (
            f"Fig. 9, {feed / 1000:g} m/min",
            "`contouring.compare`",
            "proposed best",
            f"{sizes}″",
            "",
        )
    servo = ct.Servo.paper()
    gains = ", ".join(f"{k} {a.gain_per_s:.2f}" for k, a in servo.axes.items())
    yield (
        "Table 1", "`contouring.Servo.of_gains`, `Coupling.of_gains`, `Servo.paper`",
        "gains in mixed units, gears of 1/180 and 1/90", f"loop gains {gains} 1/s",
        "entered as printed; the rotary open-loop gains include the gears (0.918 and 0.909 at the "
        "motors). Only products and ratios enter the loop; its two-digit rotary gain moves "
        "independent axes by a third",
    )  # fmt: skip
    yield (
        "eqs. (3) to (5)", "orientation error", "axis of the turn", "O(k−d) × O(neighbour)",
        "as printed the tool axis turns about itself",
    )  # fmt: skip
    yield (
        "integration into a control, test bed", "`contouring.margins`", "announced",
        f"gain margin {ct.margins(path=path).coupled_gain.min():.2f}", "margins of the loop are "
        "given instead",
    )  # fmt: skip


# --- the hybrid machine


def parallel() -> Iterable[Row]:
    """Rows of the fourth paper."""
    machine = hybrid.Mechanism()
    constraint = machine.constraint(POSE)
    yield (
        "over-constraint", "`Mechanism.constraint`", "over-constrained",
        f"rank {constraint.rank}, mobility {constraint.mobility}", "",
    )  # fmt: skip
    study = hybrid.cube_study(machine)
    yield (
        "Fig. 2: cubes", "`hybrid.cube_study`", "lengths change little beside the rigid motion",
        f"{study.below()} of 17 errors change edges by less than a fifth of the motion",
        "depends on the reconstruction of the errors",
    )  # fmt: skip
    exact = machine.sensitivity(POSE).tip[0]
    yield (
        "eqs. (1), (2)", "`Mechanism.sensitivity`", "dr/dE",
        f"{np.abs(_differences(machine) - exact).max() / np.abs(exact).max():.0e} of the largest "
        f"off "
        "differences of the solved loops", "",
    )  # fmt: skip
    found = machine.sensitivity(POSE)
    u2 = np.radians(found.forward.passive_deg[0][2])
    printed = np.array([[0, 0, 0], [0, np.sin(u2), -np.cos(u2)]]).T
    yield (
        "columns of e1 and e2 at fixed joints", "`Sensitivity.serial_tip`",
        "0 and (0, sin u2, −cos u2)",
        f"{np.abs(found.serial_tip[0][:, :2] - printed).max():.0e} off", "the only two printed",
    )  # fmt: skip


def _differences(machine: hybrid.Mechanism) -> np.ndarray:
    """Central differences of the tool point by each of the 17 errors, (3, 17)."""
    columns = []
    for name in machine.sensitivity(POSE).parameters:
        ends = [machine.with_errors({name: s}).forward(POSE).tip_mm[0] for s in (100.0, -100.0)]
        columns.append(1e3 * (ends[0] - ends[1]) / 200.0)
    return np.array(columns).T


if __name__ == "__main__":
    picture(PAGE.parents[1] / "figures" / "papers_turning.png")
    PAGE.write_text(page(), encoding="utf-8")
