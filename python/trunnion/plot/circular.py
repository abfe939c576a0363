"""The picture of a circular test: radial deviations, magnified, on the circle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trunnion.data.iso230_4 import Iso2304

if TYPE_CHECKING:
    from matplotlib.projections.polar import PolarAxes

WIDE_STEPS = 4.0
SAME_ANGLE_RAD = 1e-4
SHARE = 0.35
"""Of the radius of the picture for the largest deviation."""
PATHS = {
    1: ("counter-clockwise", "tab:blue"),
    -1: ("clockwise", "tab:orange"),
    0: ("path", "tab:blue"),
}


def plot_circular(result: Iso2304 | Sequence[Iso2304], *, ax: PolarAxes | None = None) -> PolarAxes:
    """Draw both paths over the angle, deviations magnified, with G, H and F.

    Parameters
    ----------
    result
        A circle; of several the first.
    ax
        Polar axes; a new figure unless given.
    """
    circle = result if isinstance(result, Iso2304) else result[0]
    polar = _new_axes() if ax is None else ax
    largest = float(np.abs(circle.deviation_um).max())
    step = _division(largest)
    scale = SHARE / max(largest, 1e-9)
    whole = np.linspace(0, 2 * np.pi, 361)
    polar.plot(whole, np.ones_like(whole), color="0.35", lw=1.2)
    for level in (-2, -1, 1, 2):
        polar.plot(whole, 1 + scale * step * level * np.ones_like(whole), color="0.8", lw=0.6)
    for sense, (label, colour) in PATHS.items():
        on = np.flatnonzero(circle.sense == sense)
        if len(on):
            order = on[np.argsort(circle.angle_deg[on])]
            angle = np.radians(circle.angle_deg[order])
            radius = 1 + scale * circle.deviation_um[order]
            steps = np.diff(angle)
            wide = WIDE_STEPS * float(np.median(steps[steps > SAME_ANGLE_RAD]))
            gap = np.flatnonzero(steps > wide) + 1
            if 2 * np.pi - np.ptp(angle) < wide:  # a whole turn: the path closes
                angle, radius = np.append(angle, angle[0] + 2 * np.pi), np.append(radius, radius[0])
            angle, radius = np.insert(angle, gap, np.nan), np.insert(radius, gap, np.nan)
            polar.plot(angle, radius, color=colour, lw=1.3, label=label)
    polar.set_ylim(0, 1 + 1.15 * SHARE)
    polar.set_yticks([])
    polar.grid(visible=True, axis="x", color="0.9")
    said = " ".join(circle.sentences()).partition(": ")[2].rstrip(".")
    polar.set_title(
        f"Circle {circle.setup}, {circle.plane}, radius {circle.radius_mm:g} mm\n{said}",
        loc="left",
        fontsize="medium",
    )
    polar.text(0.5, 0.5, f"{step:g} µm a line", transform=polar.transAxes, ha="center", va="center")
    polar.legend(loc="lower right", bbox_to_anchor=(1.1, -0.08), frameon=False, fontsize="small")
    return polar


def _new_axes() -> PolarAxes:
    from matplotlib import pyplot as plt
    from matplotlib.projections.polar import PolarAxes as Polar

    figure = plt.figure(figsize=(5.6, 5.8), layout="constrained")
    polar = figure.add_subplot(projection="polar")
    assert isinstance(polar, Polar)
    return polar


def _division(largest: float) -> float:
    """A round length, so that two of it reach about the largest deviation."""
    exponent = 10.0 ** np.floor(np.log10(max(largest / 2, 1e-9)))
    choices = exponent * np.array([1.0, 2.0, 5.0, 10.0])
    return float(choices[np.argmin(np.abs(choices - largest / 2))])
