"""The picture of a circular test: radial deviations, magnified, on the circle (ISO 230-4)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from trunnion.base.units import Floats
from trunnion.data.ballbar import Ballbar
from trunnion.data.iso230_4 import Iso2304, iso230_4
from trunnion.plot.picture import Axis, Kind, Picture, Series, line
from trunnion.plot.static import draw_all
from trunnion.plot.style import BLUE, MUTED, SENSES, near_number

WIDE_STEPS = 4.0
SAME_ANGLE_RAD = 1e-4
SHARE = 0.35
"""Of the radius of the picture for the largest deviation."""
PATHS = {
    1: "counter-clockwise",
    -1: "clockwise",
    0: "path",
}
LEVELS = (-2, -1, 0, 1, 2)
MAX_CIRCLES = 6
FIRST_AXIS = {"XY": "+X", "YZ": "+Y", "ZX": "+Z"}


def plot_circular(
    result: Iso2304 | Sequence[Iso2304] | Ballbar, *, ax: Any = None, **style: Any
) -> Any:
    """Draw both paths over the angle, deviations magnified, with G, H and F.

    Parameters
    ----------
    result
        A circle; several, or a ball-bar test: a panel each.
    ax
        Polar axes for one circle; a new figure unless given.
    **style
        As :meth:`trunnion.plot.picture.Picture.draw` takes it.
    """
    return draw_all(circular_pictures(result), ax, columns=3, size=(4.9, 5.9), **style)


def circular_pictures(result: Iso2304 | Sequence[Iso2304] | Ballbar) -> list[Picture]:
    """Return the polar picture of each circle."""
    if isinstance(result, Ballbar):
        result = iso230_4(result)
    found = [result] if isinstance(result, Iso2304) else list(result)
    return [circular_picture(circle) for circle in found[:MAX_CIRCLES]]


def circular_picture(circle: Iso2304) -> Picture:
    """Return the polar picture of a circle."""
    largest = float(np.abs(circle.deviation_um).max())
    step = near_number(largest / 2)
    scale = SHARE / max(largest, 1e-9)
    whole = np.linspace(0, 360, 361)
    series = [
        line(whole, np.full_like(whole, 1 + scale * step * level), colour=MUTED, width=width)
        for level, width in zip(LEVELS, (0.5, 0.5, 1.3, 0.5, 0.5), strict=True)
    ]
    for sense, label in PATHS.items():
        on = np.flatnonzero(circle.sense == sense)
        if len(on):
            order = on[np.argsort(circle.angle_deg[on])]
            path = (circle.angle_deg[order], 1 + scale * circle.deviation_um[order])
            hover = tuple(
                f"{a:.1f}°: {d:+.2f} µm, {label}".replace("-", "−")
                for a, d in zip(path[0], circle.deviation_um[order], strict=True)
            )
            series.append(_path(*path, label=label, colour=SENSES.get(label, BLUE), hover=hover))
    ticks = tuple(
        (1 + scale * step * k, f"{step * k:+g}".replace("-", "−") if k else "0") for k in LEVELS
    )
    said = " ".join(circle.sentences()).partition(": ")[2].rstrip(".")
    at = FIRST_AXIS.get(circle.plane, "the first axis")
    return Picture(
        f"Circle {circle.setup} in {circle.plane}, radius {circle.radius_mm:g} mm",
        Axis("angle", "°"),
        Axis(limits=(0.0, 1 + 1.15 * SHARE), ticks=ticks),
        tuple(series),
        Kind.POLAR,
        note=f"{said}. {step:g} µm a line, the thick one is zero; 0° at {at}.",
    )


def _path(angle: Floats, radius: Floats, hover: tuple[str, ...], **style: Any) -> Series:
    """Return a path over the angle (degrees, sorted): closed if it is a whole turn, else broken."""
    steps = np.diff(np.radians(angle))
    wide = WIDE_STEPS * float(np.median(steps[steps > SAME_ANGLE_RAD]))
    gap = np.flatnonzero(steps > wide) + 1
    if 2 * np.pi - np.radians(np.ptp(angle)) < wide:
        angle, radius = np.append(angle, angle[0] + 360), np.append(radius, radius[0])
        hover = (*hover, *hover[:1])
    texts = np.insert(np.array(hover, dtype=object), gap, "")
    angle, radius = np.insert(angle, gap, np.nan), np.insert(radius, gap, np.nan)
    return line(angle, radius, hover=tuple(texts), width=1.3, **style)
