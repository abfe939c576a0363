"""docs/gallery.md: every kind of picture, each made by the code beside it: ``make gallery``.

Static figures are drawn by matplotlib; views in space are photographed by chromium, and keep the
picture they have where there is none.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from textwrap import dedent
from typing import Any

import matplotlib

matplotlib.use("Agg")

import numpy as np
from make_notebooks import photograph, smaller
from matplotlib import pyplot as plt

import trunnion as tn
from trunnion import contouring, hybrid

DOCS = Path(__file__).parent
FIGURES = DOCS / "figures" / "gallery"
SAMPLES = tn.sample_path
ERRORS = {"EX0C": 15.0, "EA0A": 20.0, "EY0A": 10.0, "EB0C": 12.0}


# --- in space


def machine() -> Any:
    """The machine in a posture: axes, table, artefact."""
    setup = tn.read_setup(SAMPLES("cross/setup.toml"))
    return tn.plot.scene(setup, A=30.0, C=20.0)


def probe_path() -> Any:
    """A plan in space: approach vectors and the path of the ball, posture by posture."""
    setup = tn.read_setup(SAMPLES("cross/setup.toml"))
    return tn.plan(setup).scene(setup)


def residual_arrows() -> Any:
    """Residuals of touches as arrows, magnified, with their scale in µm."""
    setup = tn.read_setup(SAMPLES("cross/setup.toml"))
    touches = tn.read_touches(SAMPLES("cross/touches.csv"))
    return tn.identify(touches, setup).scene(touches, setup)


def error_field() -> Any:
    """Volumetric error over the work space before and after a compensation, on one scale."""
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    sparse = {"points": (7, 6, 5)}
    before = tn.volumetric_error(setup, ERRORS, **sparse)
    parameters = tn.cnc_parameters(setup, ERRORS)
    return before.scene(tn.volumetric_error(setup, ERRORS, compensation=parameters, **sparse))


def contour_in_space() -> Any:
    """Contour error as colour along the tool path, and magnified beside it."""
    return contouring.simulate(contouring.Path.paper(), 3000.0).scene()


def mechanism() -> Any:
    """The hybrid mechanism in a pose."""
    return tn.plot.scene(hybrid.Mechanism(), pose=[1180, 1120, 1060, 25, -15])


def surface() -> Any:
    """Heights of a surface plate from the readings of a level."""
    return tn.read_levels(SAMPLES("levels/plate.csv")).flatness().scene()


# --- the field's own


def circular_test() -> Any:
    """Circular test, ISO 230-4: both directions, magnified, with G, H and F."""
    return tn.read_ballbar(SAMPLES("ballbar/circle.csv")).plot()


def ranked_causes() -> Any:
    """Causes of a circular test, ranked by their share."""
    return tn.plot.plot_contributions(tn.diagnose(tn.read_ballbar(SAMPLES("ballbar/circle.csv"))))


def positioning() -> Any:
    """Positioning, ISO 230-2: means, ± 2 s, and A, E, M, R, B."""
    return tn.read_positioning(SAMPLES("positioning/axis.csv")).plot()


def error_motion() -> Any:
    """Error motion of a rotary axis, ISO 230-7: radial, axial, tilt."""
    return tn.read_sweep(SAMPLES("axis/sweep.csv")).plot()


def plate() -> Any:
    """Holes of a plate: a vector map on one scale."""
    return tn.read_points(SAMPLES("plate/first.csv")).plot()


def turned_part() -> Any:
    """Deviation along a turned part, passes apart."""
    return tn.read_diameters(SAMPLES("turning/passes.csv")).plot()


def servo_log() -> Any:
    """Log of a position loop: following error over time and speed, reversals, response."""
    log = tn.read_axis_log(SAMPLES("contour/axislog.csv"))
    setup = tn.read_setup(SAMPLES("contour/setup.toml"))
    return tn.plot.plot_axis_log(log, servo=setup)


def section() -> Any:
    """A section through the volumetric error."""
    return tn.volumetric_error(tn.Setup(artefact=tn.Artefact("cross")), ERRORS).plot()


def power_table() -> Any:
    """How often a diagnosis of touches is right, from the table of docs/results/power.md."""
    text = (DOCS / "results" / "power.md").read_text(encoding="utf-8")
    rows = re.findall(r"\| (\w+) \| paper \| 1 σ \|((?: \d+% \|){4})", text)
    rates = np.array([[float(x) for x in re.findall(r"(\d+)%", cells)] for _, cells in rows])
    outcomes = dict(zip(("found", "aliased", "missed", "wrong"), rates.T, strict=True))
    return tn.plot.plot_rates([name for name, _ in rows], outcomes, title="Effects of 1 σ")


# --- results


def estimates() -> Any:
    """Location errors by three methods beside the injected values."""
    setup = tn.read_setup(SAMPLES("cross/setup.toml"))
    touches = tn.read_touches(SAMPLES("cross/touches.csv"))
    return tn.compare_methods(touches, setup, {"EX0C": 15.0, "EY0A": 17.0, "EZ0A": 12.0}).plot()


def cause() -> Any:
    """A named cause over what it depends on, with the fitted curve."""
    setup = tn.read_setup(SAMPLES("hidden/setup.toml"))
    return tn.diagnose(tn.read_touches(SAMPLES("hidden/touches.csv")), setup).plot()


def observability() -> Any:
    """What a plan can tell of each effect, before anything is measured."""
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    return tn.observability(tn.plan(setup), setup).plot()


def straightness() -> Any:
    """Straightness of a bed from a level, with U (k = 2)."""
    return tn.read_levels(SAMPLES("levels/bed.csv")).plot()


def cubes() -> Any:
    """What each error of the hybrid machine does to a cube."""
    return hybrid.cube_study(hybrid.Mechanism()).plot()


GROUPS: dict[str, tuple[Callable[[], Any], ...]] = {
    "In space": (
        *(machine, probe_path, residual_arrows, error_field, contour_in_space),
        *(mechanism, surface),
    ),
    "The field's own pictures": (
        *(circular_test, ranked_causes, positioning, error_motion, plate, turned_part),
        *(servo_log, section, power_table),
    ),
    "Results": (estimates, cause, observability, straightness, cubes),
}


def draw(one: Callable[[], Any], path: Path) -> None:
    """Make the picture of a function as PNG."""
    import base64

    made = one()
    if hasattr(made, "to_plotly_json"):
        taken = photograph(made.to_plotly_json())
        if taken is None:
            sys.stdout.write(f"{path.name}: kept, there is no chromium\n")
            return
        path.write_bytes(base64.b64decode(smaller(taken)))
        return
    figure = getattr(made, "figure", made)
    figure.savefig(path, dpi=80, metadata={"Software": None})
    plt.close("all")


def code_of(one: Callable[[], Any]) -> str:
    """Return the lines of a function below its docstring, as one would write them."""
    source = dedent(inspect.getsource(one)).split('"""', 2)[2].strip("\n")
    return dedent(source).replace("return ", "", 1) if "return " in source else dedent(source)


def page() -> str:
    """Return the page: each picture with the code that makes it."""
    lines = [
        "# Gallery",
        "",
        "Every picture is made by the code beside it, from samples that come with the package "
        "(`SAMPLES = tn.sample_path`): `make gallery`, `docs/make_gallery.py`. Each result and "
        "each kind of data has `.plot()` (matplotlib: `ax=` and keywords such as `color=` or "
        "`title=` are passed on), and what is in space has `.scene()` (Plotly: drag to turn); "
        "`tn.plot.pictures(result)` gives descriptions with `.draw()` and `.figure()` for both.",
        "",
        "```python",
        *(
            "import numpy as np",
            "",
            "import trunnion as tn",
            "from trunnion import contouring, hybrid",
        ),
        *("", "SAMPLES = tn.sample_path", f"ERRORS = {json.dumps(ERRORS)}"),
        *("```", ""),
    ]
    for group, members in GROUPS.items():
        lines += [f"## {group}", ""]
        for one in members:
            title = (one.__doc__ or "").strip()
            lines += [f"### {title.rstrip('.')}", ""]
            lines += [f"![{title}](figures/gallery/{one.__name__}.png)", ""]
            code = code_of(one)
            if "DOCS" in code:
                lines += ["<!-- not run: it reads a page of these documents -->"]
            lines += ["```python", code, "```", ""]
    return "\n".join(lines)


def main(names: list[str]) -> None:
    """Draw the pictures of these names, or all, and write the page."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    for members in GROUPS.values():
        for one in members:
            if not names or one.__name__ in names:
                draw(one, FIGURES / f"{one.__name__}.png")
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
