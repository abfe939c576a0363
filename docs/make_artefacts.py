"""Which plan on which artefact identifies which errors, in how many minutes; R-tests, ball-bars.

Makes docs/results/artefacts.md. Everything is computed: plans by the planner, uncertainties by
`observability` at 1 µm a reading, minutes by the time that the probing program takes.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

import trunnion as tn

PAGE = Path(__file__).parent / "results" / "artefacts.md"
ARTEFACTS: Mapping[str, tn.Artefact] = {
    "cross, 100 mm": tn.Artefact("cross"),
    "datum cube, 40 mm, 70 mm off centre": tn.Artefact(
        "cuboid", 40.0, 40.0, 40.0, place_mm=(70.0, 0.0, 0.0)
    ),
    "sphere on the axis of C": tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(0.0, 0.0, 60.0)),
    "sphere, 60 mm off the axis": tn.Artefact(
        "sphere", diameter_mm=25.0, centre_mm=(60.0, 0.0, 80.0)
    ),
    "three spheres on a plate": tn.Artefact(
        "spheres",
        diameter_mm=20.0,
        spheres_mm=((-60.0, -50.0, 60.0), (60.0, -40.0, 80.0), (0.0, 65.0, 50.0)),
    ),
    "ring gauge, 60 mm": tn.Artefact(
        "ring", diameter_mm=60.0, outer_diameter_mm=80.0, height_mm=25.0
    ),
}
ERRORS = ("EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EB0C", "EX0C", "EY0C")
PLANS: Mapping[str, Callable[[tn.Setup], tn.Touches]] = {
    "`plan`": tn.plan,
    "`plan_by_axis`": tn.plan_by_axis,
    "`plan_for` all, 3 min": lambda setup: tn.plan_for(setup, ERRORS, max_minutes=3.0),
}
HEAD = """# Artefacts and plans

Made by `docs/make_artefacts.py`: standard errors that each plan is expected to have (Cramér-Rao
bound at 1 µm a reading, 1 σ; arcsec for EA0A, EB0A, EC0A and EB0C, µm for the others), with the
location errors, the placement and nothing else unknown, on a machine with tables C on A (`trt-ca`),
and how long the probing program takes. "–": not identifiable with this artefact or plan.
`plan` is the plan of the paper where the artefact is the cross; `plan_by_axis` turns one axis at a
time, three positions each, as the cycles of controls do; `plan_for` chooses touches for all eight
errors within three minutes.

"""


def row(name: str, setup: tn.Setup, make: Callable[[tn.Setup], tn.Touches]) -> str:
    """One plan on one artefact, or the errors that no plan identifies with it."""
    try:
        plan = make(setup)
    except tn.DataError as refused:
        lacking = [error for error in ERRORS if error in str(refused).split(", expected")[0]]
        return f"\n{name}: refused, no touch of this artefact identifies {', '.join(lacking)}."
    seen = tn.observability(plan, setup, noise_um=1.0).std_errors
    minutes = tn.probing_program(plan, setup).seconds / 60
    errors = [f"{seen[e]:.2g}" if np.isfinite(seen[e]) else "–" for e in ERRORS]
    return f"| {name} | {len(plan)} | {minutes:.1f} | " + " | ".join(errors) + " |"


BALL = (90.0, 20.0, 60.0)
C_ALONE = {"A": np.zeros(8), "C": np.arange(0.0, 360.0, 45.0)}
A_ALONE = {"A": np.linspace(-90.0, 90.0, 9), "C": np.zeros(9)}
BOTH = {"A": np.repeat([0.0, 60.0, -60.0, 90.0], 8), "C": np.tile(np.arange(0.0, 360.0, 45.0), 4)}
TESTS = {"C alone": C_ALONE, "A alone": A_ALONE, "both": BOTH}
BARS = {"X": (100.0, 0.0, 0.0), "Y": (0.0, 100.0, 0.0), "Z": (0.0, 0.0, 100.0)}
HEAD_OF_TESTS = """## R-test and ball-bar on a ball 92 mm off the axis

The same, by [tests](../how-to/rotary-tests.md) in which the tool follows a ball on the table: C all
around in steps of 45°, A from -90° to 90°, or both; the tool's point known. How long a test takes
depends on the instrument.
"""


def test_row(name: str, setup: tn.Setup, plans: list[tn.RotaryTest], *, bar: bool) -> str:
    """One test of rotary axes: what it identifies."""
    made = [tn.simulate_rotary_test(plan, setup, BALL, bar=bar) for plan in plans]
    data = tn.RotaryTest({k: np.concatenate([one[k] for one in made]) for k in made[0].columns})
    seen = tn.identify_rotary_test(data, setup, BALL, sigma_um=1.0).std_errors
    errors = [f"{seen[e]:.2g}" if np.isfinite(seen[e]) else "–" for e in ERRORS]
    return f"| {name} | {len(data) * (1 if bar else 3)} | " + " | ".join(errors) + " |"


def tests_of_axes() -> list[str]:
    """The table of tests that follow a ball."""
    setup = tn.Setup(artefact=tn.Artefact("none"))
    lines = [HEAD_OF_TESTS, f"| test | readings | {' | '.join(ERRORS)} |"]
    lines.append("|---|" + "---|" * (1 + len(ERRORS)))
    for name, turns in TESTS.items():
        plan = tn.plan_rotary_test(setup, BALL, turns)
        lines.append(test_row(f"R-test, {name}", setup, [plan], bar=False))
    plans = {k: tn.plan_rotary_test(setup, BALL, BOTH, bar_mm=bar) for k, bar in BARS.items()}
    for letter, plan in plans.items():
        lines.append(test_row(f"ball-bar along {letter}, both", setup, [plan], bar=True))
    name = "ball-bar along X, then Y, then Z, both"
    return [*lines, test_row(name, setup, list(plans.values()), bar=True), ""]


def page() -> str:
    """The text of the page."""
    lines = [HEAD]
    for title, artefact in ARTEFACTS.items():
        setup = tn.Setup(artefact=artefact)
        lines.append(f"## {title[0].upper()}{title[1:]}\n")
        lines.append(f"| plan | touches | minutes | {' | '.join(ERRORS)} |")
        lines.append("|---|" + "---|" * (2 + len(ERRORS)))
        lines += [row(name, setup, make) for name, make in PLANS.items()]
        lines.append("")
    return "\n".join([*lines, *tests_of_axes()])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
