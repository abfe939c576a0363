"""Pictures of levels: the profile of a line, the heights of a surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trunnion.data.flatness import Flatness, Straightness
from trunnion.plot.axes import axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_straightness(result: Straightness, *, ax: Axes | None = None) -> Axes:
    """Draw the profile above its line of least squares, with ±2 standard uncertainties."""
    ax = axes_or_new(ax, 7.5, 3.6)
    at, z, u = result.positions_mm, result.heights_um, result.heights_std_um
    ax.fill_between(at, z - 2 * u, z + 2 * u, color="tab:blue", alpha=0.2)
    ax.plot(at, z, "o-", color="tab:blue", ms=3, lw=1.3, label="height ± 2 u")
    for level in (z.min(), z.max()):
        ax.axhline(level, color="0.5", lw=0.8, ls="--")
    ax.set_title(f"Straightness {result.straightness_um:.3g} µm, least squares", loc="left")
    ax.set_xlabel("position, mm")
    ax.set_ylabel("height, µm")
    ax.legend(frameon=False)
    return ax


def plot_flatness(result: Flatness, *, ax: Axes | None = None) -> Axes:
    """Draw the heights above the plane of least squares as contours over the grid."""
    ax = axes_or_new(ax, 7.0, 4.6)
    heights = ax.tricontourf(result.x_mm, result.y_mm, result.heights_um, 16, cmap="viridis")
    ax.plot(result.x_mm, result.y_mm, ".", color="0.3", ms=2)
    ax.figure.colorbar(heights, ax=ax, label="height, µm")
    ax.set_aspect("equal")
    ax.set_title(f"Flatness {result.flatness_um:.3g} µm, least squares", loc="left")
    ax.set_xlabel("x, mm")
    ax.set_ylabel("y, mm")
    return ax
