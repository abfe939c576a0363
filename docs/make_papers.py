"""Write a page a paper: its every result beside what this package gives: ``make docs``.

Numbers of the papers are copied from them; ours come from runs, here and now.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from papers_lathe import lathe, picture

import trunnion as tn
from trunnion import contouring as ct
from trunnion import hybrid
from trunnion.demo import PAPER_ESTIMATES, table_3
from trunnion.samples.truth import TABLE_2

RESULTS = Path(__file__).parent / "results"
POSE = (1100.0, 1150.0, 1100.0, 0.0, 18.0)
"""Legs, mm, and wrist, degrees: in the middle of the working space."""

Row = tuple[str, str, str, str, str]
HEAD = ("in the paper", "here", "the paper says", "we get", "why they differ, or what was chosen")


Rows = Callable[[], Iterable[Row]]


def papers() -> Sequence[tuple[str, str, str, str, Rows]]:
    """File, title, what the paper is about, where to read on, rows of its table."""
    return (
        (
            "paper-rotary-table.md",
            "Kang, Kim, Jee (2022): location errors of a tilting rotary table with a cross",
            "Eight location errors found by touches on a cross, and compensated.",
            "[closed-forms.md](../explanation/closed-forms.md), `notebooks/01_calibrate.ipynb`, "
            "`trunnion demo`.",
            cross,
        ),
        (
            "paper-turning.md",
            "C. K. Park, D. S. Park (1990): correction of turning programs",
            "Turning programs corrected by probed diameters.",
            "[turning.md](../how-to/turning.md), `notebooks/03_turning.ipynb`. The crossings of "
            "Figs. 18 and 20 are the only measured facts of the paper that its text holds; all "
            "else is simulated.",
            lathe,
        ),
        (
            "paper-contouring.md",
            "Byun, Jee (2010): cross-coupled control of five axes",
            "Contour errors of five axes under cross-coupled control.",
            "[contouring.md](../how-to/contouring.md), `notebooks/04_contouring.ipynb`. The "
            "figures have no numbers: order and ratio can be compared.",
            five_axes,
        ),
        (
            "paper-hybrid.md",
            "Ko, Kim, Kim, Na: sensitivities of a hybrid parallel machine",
            "What 17 errors of a hybrid parallel machine do at its tool.",
            "`notebooks/05_hybrid.ipynb`, `trunnion.hybrid`. Fig. 1, which defines the errors, "
            "is not in the text: e1, e3, e4, e8 to e15 and all dimensions are a reconstruction.",
            parallel,
        ),
    )


def pages() -> dict[str, str]:
    """Return the text of each page by its file: an index, and a page a paper."""
    made = {}
    index = ["# The four papers, result by result\n", "Made by `make docs` from runs.\n"]
    for file, title, about, where, rows in papers():
        lines = [f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|"]
        lines += [f"| {' | '.join(row)} |" for row in rows()]
        made[file] = (
            f"# {title}\n\nMade by `make docs` from runs. {where}\n\n" + "\n".join(lines) + "\n"
        )
        index.append(f"- [{title}]({file}). {about}")
    return {"papers.md": "\n".join([*index, "", artefacts()]), **made}


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
        "Table 1, Fig. 2: location errors, cross", '`tn.Machine("trt-ca")`, `tn.Artefact("cross")`',
        "8 errors; 100, 25, 25 mm", f"{len(tn.identify(plan_data(setup), setup).errors)} errors; "
        f"{setup.artefact.length_mm:g}, {setup.artefact.width_mm:g}, "
        f"{setup.artefact.height_mm:g} mm", "",
    )  # fmt: skip
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
    yield from _around_the_cross(setup)
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


def plan_data(setup: tn.Setup) -> tn.Touches:
    """Return the paper's touches on the machine of its Table 2."""
    return tn.simulate(tn.plan(setup), setup, TABLE_2)


def _around_the_cross(setup: tn.Setup) -> Iterable[Row]:
    """Rows on the program, the length of the bars, rounding, and what the paper leaves out."""
    lines = tn.probing_program(tn.plan(setup), setup).text().splitlines()
    yield (
        "Fig. 8: probing cycle", "`trunnion program`", "flowchart",
        f"a program for LinuxCNC, {len(lines)} lines",
        "the cycles of other controls are their builders': plan.csv has each start and approach, "
        "and touches.csv takes what they measure",
    )  # fmt: skip
    needed = 0.1e-3 / np.sin(np.radians(0.36 / 3600))
    yield (
        "eq. (21), Fig. 10: length of the bars", "`notebooks/06_studies.ipynb`, `trunnion sweep`",
        "L > λ_LR csc λ_RR", f"L > {needed:.3f} mm", "at 0.1 µm and 0.36″; what shorter bars "
        "cost is in the notebook",
    )  # fmt: skip
    rounded = tn.cnc_parameters(setup, TABLE_2).rounded(setup)
    left = tn.volumetric_error(setup, TABLE_2, compensation=rounded).max_um
    exact = tn.cnc_parameters(setup, TABLE_2)
    whole = tn.volumetric_error(setup, TABLE_2, compensation=exact).max_um
    yield (
        "least increment of parameters", "`CncParameters.rounded`", "0.1 µm, 0.36″",
        f"{left:.2f} µm with it, {whole:.2f} µm without", "parameters fitted over all positions, "
        "at A = C = 0; as a whole they are limited by the tilts, not by the increment",
    )  # fmt: skip
    yield (
        "stylus bending, left out", "effect `probe_bending`", "named", "estimated where touches "
        "along Z and across differ", "",
    )  # fmt: skip
    yield (
        "error motions over the angle, left out",
        "effects `c_radial_2`, `c_wobble_2`, `a_sag` and others; `tn.error_map` over A and C",
        "named", "named by `trunnion diagnose`", "docs/reference/effects.md lists them",
    )  # fmt: skip
    bare, ball = tn.Setup(tn.Artefact("none")), (90.0, 20.0, 60.0)
    tilts, turns = np.meshgrid([0, 60, -60, 90], np.arange(0, 360, 45), indexing="ij")
    test = tn.plan_rotary_test(bare, ball, {"A": tilts.ravel(), "C": turns.ravel()})
    read = tn.simulate_rotary_test(test, bare, ball, TABLE_2)
    rate = _worst_rate(tn.identify_rotary_test(read, bare, ball, sigma_um=1.0).errors)
    off = f"{rate:.2%}" if rate > 1e-4 else "less than 0.01%"
    yield (
        "double ball-bar and R-test of rotary axes", "`tn.identify_rotary_test`, `tn.read_sweep`",
        "earlier methods", f"an R-test of {len(test)} positions without noise: off by {off}",
        "[rotary-tests.md](../how-to/rotary-tests.md); beside touches in "
        "[artefacts.md](artefacts.md)",
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
    run = ct.simulate(path, 1000.0)
    fast = ct.simulate(path, 3000.0)
    yield (
        "sections 2, 4: 1 and 3 m/min, 1 ms, 0.15 s", "`contouring.Feed`, `Path.paper`", "–",
        f"{len(run)} and {len(fast)} control periods", "the parametric interpolator is an exact "
        "one along the arc length",
    )  # fmt: skip
    yield (
        "Figs. 1, 2, eq. (1): circle through three points", "`contouring` (position error)",
        "formula", "lines, circles and single axes exact",
        "`tests/test_contouring_exact.py`",
    )  # fmt: skip
    yield (
        "eq. (2): error of the rotary axes", "`contouring` (orientation error)",
        "ratio of the ways",
        "as printed", "the tool axis between two reference points by the ratio of the ways to them",
    )  # fmt: skip
    orders = ct.order_of_controller(path=path)
    sizes = ", ".join(f"{o.figures['contour_max_um']:.3g}" for o in orders.all_runs)
    yield (
        "Fig. 5, eqs. (6), (7): PID and J⁻¹", "`contouring.order_of_controller`", "J⁻¹ after C(z)",
        f"{sizes} µm", "3 m/min: C(z) after J⁻¹; J⁻¹ after C(z) in right units; the same with the "
        "mixed units of Table 1",
    )  # fmt: skip
    yield (
        "288 structures of the cited work", "`[machine] chain`, `contouring.simulate(setup=)`",
        "any structure", "any chain with two rotary axes", "`tests/test_contouring_machines.py` "
        "holds four others to an independent model",
    )  # fmt: skip
    yield (
        "the earlier model of the cited work", "`Coupling(orientation=\"tangent\")`", "cited",
        "a reconstruction along the tangent", "the cited paper was not available",
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
    given = machine.with_errors({f"e{i}": 50.0 for i in range(1, 18)})
    paper = replace(given, closure_mm=(1000.0, 0.0, 1000.0, 0.0))
    yield (
        "Fig. 1: skeleton, E, Y", "`hybrid.Mechanism`", "a drawing, missing in the text",
        f"{len(machine.sensitivity(POSE).parameters)} errors, six of them fixed by the text",
        "e2, e5, e6, e7, e16 and e17 follow from the printed column and the words; the others "
        "and all dimensions are chosen here",
    )  # fmt: skip
    yield (
        "G(Y, E) = 0 and Y(E)", "`Mechanism.forward`", "eight equations, solved numerically",
        f"with every error 50 {_closed(given)} by all ten equations, {_closed(paper)} by the eight",
        "an over-constrained loop closes by least squares; the paper's eight are "
        "`closure_mm = [1000, 0, 1000, 0]`",
    )  # fmt: skip
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
    yield (
        "calibration with a ball-bar", "`hybrid.identify_ballbar`, `trunnion hybrid`", "announced",
        "estimate, plan and what a plan can determine", "`hybrid.ballbar_plan`, "
        "`hybrid.identifiability`, `hybrid.choose_poses`; no measured data are in the paper",
    )  # fmt: skip


def _closed(machine: hybrid.Mechanism) -> str:
    """Return whether the loops close, to 1e-6 µm and arcsec."""
    found = machine.forward(POSE)
    left = max(np.abs(found.gap_um).max(), np.abs(found.misfit_arcsec).max())
    return "closed" if left < 1e-6 else f"{left:.3g} left"


def _differences(machine: hybrid.Mechanism) -> np.ndarray:
    """Central differences of the tool point by each of the 17 errors, (3, 17)."""
    columns = []
    for name in machine.sensitivity(POSE).parameters:
        ends = [machine.with_errors({name: s}).forward(POSE).tip_mm[0] for s in (100.0, -100.0)]
        columns.append(1e3 * (ends[0] - ends[1]) / 200.0)
    return np.array(columns).T


if __name__ == "__main__":
    picture(RESULTS.parent / "figures" / "papers_turning.png")
    for file, text in pages().items():
        (RESULTS / file).write_text(text, encoding="utf-8")
