"""Pictures of levels: the profile of a line, the heights of a surface."""

from __future__ import annotations

import numpy as np

from trunnion.base.report import plus_minus
from trunnion.data.flatness import Flatness, Straightness, Twist
from trunnion.data.levels import Levels
from trunnion.plot.picture import Axis, Kind, Picture, band, heat, line, points
from trunnion.plot.style import BLUE, MUTED, PURPLE


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


def twist_pictures(result: Twist) -> list[Picture]:
    """Return the slopes across over the position along, with the line of the twist."""
    at, slopes = result.at_mm, result.slopes_um_m
    if not len(at):  # stored before slopes were
        return []
    ends = np.array([at.min(), at.max()])
    fitted = 1e-3 * result.twist_um_m_m * ends
    x = Axis("Position along, from the middle", "mm")
    series = (
        points(at, slopes, "slope across"),
        line(ends, fitted, "constant twist", colour=PURPLE, width=2.0),
    )
    u = result.std_errors["twist_um_m_m"]
    twist = plus_minus(result.twist_um_m_m, 2 * u if np.isfinite(u) else None)
    title = f"Twist {twist} µm/m per m (k = 2)"
    return [Picture(title, x, Axis("Slope across", "µm/m"), series)]


def levels_pictures(data: Levels) -> list[Picture]:
    """Return straightness of a line or flatness of a surface, and twist, of the readings."""
    found: list[Picture] = []
    for r in data.results():
        match r:
            case Straightness():
                found.append(straightness_picture(r))
            case Flatness():
                found.append(flatness_picture(r))
            case Twist():
                found += twist_pictures(r)
    return found
