"""Pictures of levels: the profile of a line, the heights of a surface."""

from __future__ import annotations

from typing import Any

import numpy as np

from trunnion.data.flatness import Flatness, Straightness
from trunnion.data.levels import Levels
from trunnion.plot.picture import Axis, Kind, Picture, band, heat, line, points
from trunnion.plot.style import BLUE, MUTED


def plot_straightness(result: Straightness, *, ax: Any = None, **style: Any) -> Any:
    """Draw the profile above its line of least squares, with ± 2 standard uncertainties."""
    return straightness_picture(result).draw(ax, **style)


def straightness_picture(result: Straightness) -> Picture:
    """Return the profile of a line with U (k = 2), its extremes dotted."""
    at, z, u = result.positions_mm, result.heights_um, result.heights_std_um
    ends = np.array([at[0], at[-1]])
    limits = [line(ends, [level] * 2, colour=MUTED, dash="dot") for level in (z.min(), z.max())]
    shown = [band(at, z - 2 * u, z + 2 * u, "U (k = 2)")] if np.all(np.isfinite(u)) else []
    return Picture(
        f"Straightness {result.straightness_um:.3g} µm, line of least squares",
        Axis("Position", "mm"),
        Axis("Height", "µm"),
        (*shown, line(at, z, colour=BLUE), points(at, z, "height"), *limits),
    )


def plot_flatness(result: Flatness, *, ax: Any = None, **style: Any) -> Any:
    """Draw the heights above the plane of least squares over the surface."""
    return flatness_picture(result).draw(ax, **style)


def flatness_picture(result: Flatness) -> Picture:
    """Return the heights of a surface as a map."""
    x, column = np.unique(result.x_mm, return_inverse=True)
    y, row = np.unique(result.y_mm, return_inverse=True)
    z = np.full((len(y), len(x)), np.nan)
    z[row, column] = result.heights_um
    texts = tuple(
        f"{a:g}, {b:g} mm: {h:+.3g} µm".replace("-", "−")
        for a, b, h in zip(result.x_mm, result.y_mm, result.heights_um, strict=True)
    )
    low, high = float(result.heights_um.min()), float(result.heights_um.max())
    return Picture(
        f"Flatness {result.flatness_um:.3g} µm, plane of least squares",
        Axis("X", "mm"),
        Axis("Y", "mm"),
        (
            heat(z, x, y, scale=(low, high), label="height (µm)"),
            points(result.x_mm, result.y_mm, colour=MUTED, size=2.0, hover=texts),
        ),
        Kind.MAP,
    )


def levels_pictures(data: Levels) -> list[Picture]:
    """Return straightness of a line, or flatness of a surface, of the readings of a level."""
    kinds = {Straightness: straightness_picture, Flatness: flatness_picture}
    return [kinds[type(r)](r) for r in data.results() if type(r) in kinds]  # type: ignore[operator]


def plot_levels(data: Levels, *, ax: Any = None, **style: Any) -> Any:
    """Draw the profile of a line, or the heights of a surface, from the readings of a level."""
    pictures = levels_pictures(data)
    return pictures[0].draw(ax, **style)
