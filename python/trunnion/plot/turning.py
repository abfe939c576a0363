"""Pictures of a turned part, the probe's path and a correction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trunnion.plot.axes import axes_or_new
from trunnion.turning.correction import Correction
from trunnion.turning.probing import ProbePath
from trunnion.turning.profile import Profile

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_profile(profile: Profile, *, ax: Axes | None = None) -> Axes:
    """Draw the upper half of the part, Z to the right, radius up, to scale."""
    ax = axes_or_new(ax, 9.0, 3.6)
    points = profile.outline_mm()
    z, x = points.T
    ax.fill_between(z, x, color="0.87", lw=0)
    ax.plot(np.r_[z[0], z, z[-1]], np.r_[0.0, x, 0.0], color="0.25", lw=1.3, label="part")
    ax.axhline(0.0, color="0.5", lw=0.8, ls=(0, (12, 4, 2, 4)))
    ax.set_aspect("equal")
    ax.set_xlabel("Z, mm from the chuck face")
    ax.set_ylabel("radius, mm")
    return ax


def plot_probe_path(path: ProbePath, *, ax: Axes | None = None) -> Axes:
    """Draw the path of the ball's centre over the part; the probe at the end of each interval."""
    from matplotlib.collections import LineCollection

    ax = plot_profile(path.profile, ax=ax)
    styles = [
        (~path.feed, "tab:blue", 0.9, "--", "rapid"),
        (path.feed & ~path.measures, "tab:orange", 1.2, "-", "approach at feed"),
        (path.measures, "tab:red", 2.0, "-", "measuring"),
    ]
    for rows, colour, width, dash, label in styles:
        segments = path.moves_mm[rows].reshape(-1, 2, 2)
        ax.add_collection(
            LineCollection(list(segments), colors=colour, linewidths=width, ls=dash, label=label)
        )
    ball = path.probe.ball_diameter_mm / 2
    half = path.probe.body_diameter_mm / 2
    angle = np.radians(path.probe.contact_angle_deg / 2)
    z0, x0 = ball * np.cos(angle), -ball * np.sin(angle)
    turn = np.linspace(0, 2 * np.pi, 60)
    top = float(path.moves_mm[:, 1::2].max()) + 4 * ball
    for interval in path.intervals:
        for z, x in (interval.start_mm, interval.end_mm):
            ax.plot(z + ball * np.sin(turn), x + ball * np.cos(turn), color="tab:green", lw=0.8)
            shoulder = x + (x0 + (half - z0) / np.tan(angle) if half > z0 and angle > 0 else 0.0)
            for side in (-1, 1):
                across = [z + side * half, z + side * half, z + side * z0]
                ax.plot(across, [top, shoulder, x + x0], color="tab:green", lw=0.6)
    ax.autoscale_view()
    ax.set_ylim(0.0, top)
    ax.legend(loc="lower left", fontsize="small", ncols=2)
    ax.set_title("Path of the ball's centre", fontsize="medium")
    return ax


def plot_correction(correction: Correction, *, ax: Axes | None = None) -> Axes:
    """Draw the readings and what the corrected program leaves of them if they repeat."""
    ax = axes_or_new(ax, 8.0, 3.6)
    on = correction.covered
    order = np.argsort(correction.z_mm[on])
    z = correction.z_mm[on][order]
    ax.plot(z, correction.error_um[on][order], ".", ms=3, color="0.55", label="measured")
    ax.plot(z, correction.remaining_um[on][order], color="tab:red", lw=1.4, label="left, predicted")
    limit = correction.bound_um or correction.unit_um / 2
    name = "bound" if correction.bound_um is not None else "half a unit"
    ax.axhspan(-limit, limit, color="tab:green", alpha=0.12, lw=0, label=name)
    ax.axhline(0.0, color="0.3", lw=0.8)
    ax.set_xlabel("Z, mm from the chuck face")
    ax.set_ylabel("error of the diameter, µm")
    ax.legend(fontsize="small")
    count = len(correction.inserted)
    ax.set_title(
        f"{count} block{'s' if count != 1 else ''}, rule {correction.rule!r}, "
        f"unit {correction.unit_um:g} µm",
        fontsize="medium",
    )
    return ax
