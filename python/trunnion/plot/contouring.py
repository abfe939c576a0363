"""Pictures of contouring runs. Each function draws on ``ax`` (or new axes) and returns it."""

from collections.abc import Iterable
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes

from trunnion.contouring.margins import Margins
from trunnion.contouring.paths import Path
from trunnion.contouring.reproduction import ContourComparison
from trunnion.contouring.simulation import ContourRun, ContourSweep
from trunnion.plot.axes import axes_or_new

STYLES = {
    "independent": {"color": "0.45", "linestyle": "-."},
    "existing": {"color": "tab:orange", "linestyle": "--"},
    "proposed": {"color": "tab:blue", "linestyle": "-"},
}


def _runs(result: "ContourComparison | ContourRun | Iterable[ContourRun]") -> list[ContourRun]:
    if isinstance(result, ContourComparison):
        return list(result.runs.values())
    return [result] if isinstance(result, ContourRun) else list(result)


def _draw(result: Any, column: str, label: str, ax: Axes | None, title: str | None) -> Axes:
    ax = axes_or_new(ax)
    for run in _runs(result):
        style: dict[str, Any] = STYLES.get(run.controller, {})
        ax.plot(run.time_s, getattr(run, column), linewidth=1.2, label=run.controller, **style)
    ax.set_yscale("log")
    low = min(float(np.median(getattr(run, column))) for run in _runs(result))
    high = max(float(getattr(run, column).max()) for run in _runs(result))
    ax.set_ylim(max(low / 30, 1e-9), high * 2)
    ax.set_xlabel("time / s")
    ax.set_ylabel(label)
    if title:
        ax.set_title(title)
    ax.grid(alpha=0.3)
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    return ax


def plot_contour_error(
    result: "ContourComparison | ContourRun | Iterable[ContourRun]",
    *,
    ax: Axes | None = None,
    title: str | None = None,
) -> Axes:
    """True contour error over time, as in Fig. 8."""
    return _draw(result, "contour_um", "contour error / µm", ax, title)


def plot_orientation_error(
    result: "ContourComparison | ContourRun | Iterable[ContourRun]",
    *,
    ax: Axes | None = None,
    title: str | None = None,
) -> Axes:
    """True tool-orientation error over time, as in Fig. 9."""
    label = "orientation error / arcsec"
    return _draw(result, "orientation_arcsec", label, ax, title)


def plot_model_error(run: ContourRun, *, ax: Axes | None = None, title: str | None = None) -> Axes:
    """Orientation-error models less the truth along a run, as in Fig. 7."""
    ax = axes_or_new(ax)
    for name, values in (
        ("existing", run.tangent_arcsec),
        ("proposed", run.proposed_arcsec),
    ):
        style: dict[str, Any] = STYLES[name]
        ax.plot(run.time_s[2:], values[2:], linewidth=1.2, label=name, **style)
    ax.set_yscale("log")
    ax.set_ylim(max(float(np.median(run.proposed_arcsec)) / 30, 1e-7), None)
    ax.set_xlabel("time / s")
    ax.set_ylabel("model less truth / arcsec")
    if title:
        ax.set_title(title)
    ax.grid(alpha=0.3)
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    return ax


def plot_path(path: Path, *, ax: Axes | None = None, tools: int = 25) -> Axes:
    """Path and tool axes in the part's frame (Fig. 6); ``ax`` has to be three-dimensional."""
    ax = axes_or_new(ax, 6.0, 5.0, "3d")
    space: Any = ax
    u = path.at_length(np.linspace(0.0, path.length_mm, 400))
    points = path.points_mm(u)
    space.plot(*points.T, color="tab:blue")
    at = path.at_length(np.linspace(0.0, path.length_mm, tools))
    feet, axes = path.points_mm(at), path.tools(at)
    reach = 0.15 * float(np.ptp(points, axis=0).max())
    for foot, axis in zip(feet, axes, strict=True):
        space.plot(*np.stack([foot, foot + reach * axis]).T, color="tab:orange", linewidth=0.8)
    space.set_xlabel("x / mm")
    space.set_ylabel("y / mm")
    space.set_zlabel("z / mm")
    space.locator_params(nbins=5)
    space.set_aspect("equal")
    space.set_box_aspect(None, zoom=0.82)
    return ax


def plot_contour_sweep(
    result: ContourSweep,
    *,
    figure: str = "orientation_max_arcsec",
    controller: str | int = 0,
    labels: Iterable[str] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw one figure of a sweep over feed, one curve a path; diverged runs leave a gap."""
    ax = axes_or_new(ax)
    k = result.controllers.index(controller) if isinstance(controller, str) else controller
    values = getattr(result, figure)[:, :, k]
    names = list(labels) if labels is not None else [f"path {i}" for i in range(len(values))]
    colours = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, len(values)))
    for row, name, colour in zip(values, names, colours, strict=True):
        shown = np.where(np.isfinite(row), row, np.nan)
        ax.plot(result.feeds_mm_min, shown, marker="o", markersize=3, color=colour, label=name)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel("feed / (mm/min)")
    ax.set_ylabel(_label(figure))
    ax.grid(alpha=0.3)
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    return ax


def _label(figure: str) -> str:
    name, unit = figure.rsplit("_", 1)
    words = {
        "circle_max": "circle foot point less truth, max",
        "tangent_max": "tangent model less truth, max",
        "proposed_max": "proposed model less truth, max",
    }
    text = words.get(name, name.replace("_", " error, "))
    return f"{text} / {'µm' if unit == 'um' else unit}"


def plot_margins(result: Margins, *, ax: Axes | None = None) -> Axes:
    """Gain margin of the coupled loop along the path."""
    ax = axes_or_new(ax)
    ax.plot(result.u, result.coupled_gain, marker="o", markersize=3)
    ax.axhline(1.0, color="0.4", linewidth=0.8, linestyle="--")
    ax.set_xlabel("path parameter u")
    ax.set_ylabel("gain margin of the coupled loop")
    ax.set_ylim(0.0, None)
    ax.grid(alpha=0.3)
    return ax
