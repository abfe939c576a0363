"""Pictures of contouring runs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from trunnion.base.units import capital
from trunnion.contouring.margins import Margins
from trunnion.contouring.paths import Path
from trunnion.contouring.reproduction import ContourComparison
from trunnion.contouring.simulation import ContourRun, ContourSweep
from trunnion.plot.axes import axes_or_new
from trunnion.plot.picture import Axis, Dash, Picture, Series, line, points
from trunnion.plot.statistics import bars_picture, with_limit
from trunnion.plot.style import BLUE, MUTED, PALETTE, VERMILLION

COLOURS = {"independent": MUTED, "existing": VERMILLION, "proposed": BLUE}
DASHES: tuple[Dash, ...] = ("solid", "dash", "dot")
LOWEST = 30.0
"""How far below its median the least error of a run is drawn."""
MODELS = {
    "circle_max": "circle foot point less truth, largest",
    "tangent_max": "tangent model less truth, largest",
    "proposed_max": "proposed model less truth, largest",
}


def _runs(
    result: ContourComparison | ContourRun | Iterable[ContourRun],
) -> list[tuple[str, float | None, ContourRun]]:
    """Controller, feed where there are several, and run."""
    if isinstance(result, ContourComparison):
        feeds = sorted({feed for feed, _ in result.runs})
        return [(c, f if len(feeds) > 1 else None, run) for (f, c), run in result.runs.items()]
    runs = [result] if isinstance(result, ContourRun) else list(result)
    return [(run.controller, None, run) for run in runs]


def _over_time(result: Any, column: str, label: str, unit: str) -> Picture:
    series: list[Series] = []
    runs = _runs(result)
    feeds = sorted({feed for _, feed, _ in runs if feed is not None})
    low = min(float(np.median(getattr(run, column))) for *_, run in runs)
    high = max(float(getattr(run, column).max()) for *_, run in runs)
    for k, (controller, feed, run) in enumerate(runs):
        name = controller if feed is None else f"{controller}, {feed:g} mm/min"
        style: dict[str, Any] = {"colour": COLOURS.get(controller, PALETTE[k % len(PALETTE)])}
        if feed is not None:
            style["dash"] = DASHES[feeds.index(feed) % len(DASHES)]
        series.append(line(run.time_s, getattr(run, column), name, **style))
    limits = (max(low / LOWEST, 1e-9), 2 * high or 1.0)
    return Picture(
        f"{label}, largest {high:.3g} {unit}",
        Axis("Time", "s"),
        Axis(label, unit, limits=limits, log=True),
        tuple(series),
    )


def plot_contour_error(
    result: ContourComparison | ContourRun | Iterable[ContourRun], *, ax: Any = None, **style: Any
) -> Any:
    """True contour error over time, as in Fig. 8; one dash a feed where there are several."""
    return contour_error_picture(result).draw(ax, **style)


def contour_error_picture(
    result: ContourComparison | ContourRun | Iterable[ContourRun],
) -> Picture:
    """Return the true contour error over time."""
    return _over_time(result, "contour_um", "Contour error", "µm")


def plot_orientation_error(
    result: ContourComparison | ContourRun | Iterable[ContourRun], *, ax: Any = None, **style: Any
) -> Any:
    """True tool-orientation error over time, as in Fig. 9."""
    return orientation_error_picture(result).draw(ax, **style)


def orientation_error_picture(
    result: ContourComparison | ContourRun | Iterable[ContourRun],
) -> Picture:
    """Return the true orientation error over time."""
    return _over_time(result, "orientation_arcsec", "Orientation error", "arcsec")


def contour_pictures(
    result: ContourComparison | ContourRun | Iterable[ContourRun],
) -> list[Picture]:
    """Return contour and orientation error over time."""
    return [contour_error_picture(result), orientation_error_picture(result)]


def plot_model_error(run: ContourRun, *, ax: Any = None, **style: Any) -> Any:
    """Orientation-error models less the truth along a run, as in Fig. 7."""
    shown = (("existing", run.tangent_arcsec), ("proposed", run.proposed_arcsec))
    series = [line(run.time_s[2:], v[2:], name, colour=COLOURS[name]) for name, v in shown]
    low = max(float(np.median(run.proposed_arcsec)) / LOWEST, 1e-7)
    high = 2 * max(float(v.max()) for _, v in shown)
    return Picture(
        "Orientation-error models less the truth",
        Axis("Time", "s"),
        Axis("Model less truth", "arcsec", limits=(low, max(high, 2 * low)), log=True),
        tuple(series),
    ).draw(ax, **style)


def plot_path(path: Path, *, ax: Any = None, tools: int = 25) -> Any:
    """Path and tool axes in the part's frame (Fig. 6); ``ax`` has to be three-dimensional."""
    space = axes_or_new(ax, 6.0, 5.0, "3d")
    u = path.at_length(np.linspace(0.0, path.length_mm, 400))
    tip = path.points_mm(u)
    space.plot(*tip.T, color=BLUE, label="path of the tool tip")
    at = path.at_length(np.linspace(0.0, path.length_mm, tools))
    feet, axes = path.points_mm(at), path.tools(at)
    reach = 0.15 * float(np.ptp(tip, axis=0).max())
    ends = np.stack([feet, feet + reach * axes, np.full_like(feet, np.nan)], axis=1)
    space.plot(*ends.reshape(-1, 3).T, color=VERMILLION, linewidth=0.8, label="tool axis")
    for letter in "xyz":
        getattr(space, f"set_{letter}label")(f"{letter.upper()} (mm)")
    space.locator_params(nbins=5)
    space.set_aspect("equal")
    space.set_box_aspect(None, zoom=0.95)
    space.legend(frameon=False, loc="upper left", fontsize="small")
    space.set_title(
        f"Path of {path.length_mm:.4g} mm with tool axes, part's frame", fontsize="medium"
    )
    return space


def plot_contour_sweep(
    result: ContourSweep,
    *,
    figure: str = "orientation_max_arcsec",
    controller: str | int = 0,
    labels: Iterable[str] | None = None,
    ax: Any = None,
    **style: Any,
) -> Any:
    """Draw one figure of a sweep over feed, one curve a path; diverged runs leave a gap."""
    p = contour_sweep_picture(result, figure=figure, controller=controller, labels=labels)
    return p.draw(ax, **style)


def contour_sweep_picture(
    result: ContourSweep,
    *,
    figure: str = "orientation_max_arcsec",
    controller: str | int = 0,
    labels: Iterable[str] | None = None,
) -> Picture:
    """Return one figure of a sweep over feed."""
    k = result.controllers.index(controller) if isinstance(controller, str) else controller
    values = getattr(result, figure)[:, :, k]
    names = list(labels) if labels is not None else [f"path {i}" for i in range(len(values))]
    series: list[Series] = []
    for number, (row, name) in enumerate(zip(values, names, strict=True)):
        shown = np.where(np.isfinite(row), row, np.nan)
        colour = PALETTE[number % len(PALETTE)]
        series += [
            line(result.feeds_mm_min, shown, colour=colour),
            points(result.feeds_mm_min, shown, name, colour=colour),
        ]
    name, unit = figure.rsplit("_", 1)
    text = capital(MODELS.get(name, name.replace("_", " error, ")))
    y = Axis(text, "µm" if unit == "um" else unit, log=True)
    x = Axis("Feed", "mm/min", log=True)
    return Picture(f"{text}, {result.controllers[k]} controller", x, y, tuple(series))


def margins_picture(result: Margins) -> Picture:
    """Return the gain margin of the coupled loop over the path with the margins of the axes.

    Without a coupling the margins do not depend on the path: one bar an axis.
    """
    if not len(result.coupled_gain):
        return _margins_of_axes(result)
    ends = np.array([result.u[0], result.u[-1]]) if len(result.u) else np.array([0.0, 1.0])
    coupled = result.coupled_gain
    series = [line(ends, [1.0, 1.0], "limit of stability", colour=VERMILLION, dash="dash")]
    for number, (axis, gain) in enumerate(zip(result.axes, result.gain, strict=True)):
        if np.isfinite(gain):
            colour = PALETTE[2 + number % (len(PALETTE) - 2)]
            label = f"axis {axis} alone"
            series.append(line(ends, [gain, gain], label, colour=colour, dash="dot", width=1.2))
    series.append(line(result.u, coupled, "all axes, coupled", colour=BLUE, width=2.0))
    least = float(np.min(coupled, initial=np.inf))
    title = "Gain margin along the path"
    if np.isfinite(least):
        title += f": least {least:.3g}, largest {np.max(coupled):.3g}"
    return Picture(title, Axis("Path parameter u"), Axis("Gain margin"), tuple(series))


def _margins_of_axes(result: Margins) -> Picture:
    gains = {f"axis {axis}": float(g) for axis, g in zip(result.axes, result.gain, strict=True)}
    p = bars_picture("Gain margin of each axis, no coupling", "Gain margin", "", gains, digits=3)
    return with_limit(p, 1.0, "limit of stability", colour=VERMILLION)
