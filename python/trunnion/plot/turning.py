"""Pictures of a turned part: deviations along it, the probe's path, a correction."""

from __future__ import annotations

from typing import Any

import numpy as np

from trunnion.base.units import Floats
from trunnion.data.diameters import Diameters
from trunnion.nc import follow
from trunnion.plot.picture import Axis, Kind, Picture, Series, band, line, points
from trunnion.plot.style import BLUE, GREEN, MUTED, OCHRE, PALETTE, RED, VERMILLION
from trunnion.turning.correction import Correction
from trunnion.turning.probing import Interval, ProbePath
from trunnion.turning.profile import Finishing, Profile

Z_AXIS = Axis("Z from the chuck face", "mm")
PART = "#9aa3ab"
MAX_PASSES = 6


def plot_profile(profile: Profile, *, ax: Any = None, **style: Any) -> Any:
    """Draw the upper half of the part, Z to the right, radius up, to scale."""
    return profile_picture(profile).draw(ax, width=9.0, height=3.8, **style)


def profile_picture(profile: Profile) -> Picture:
    """Return the upper half of the part, to scale."""
    return Picture(
        "Profile of the part", Z_AXIS, Axis("Radius", "mm"), tuple(_part(profile)), Kind.MAP
    )


def _part(profile: Profile) -> list[Series]:
    z, x = profile.outline_mm().T
    return [
        band(z, np.zeros_like(x), x, colour=PART, opacity=0.3),
        line(np.r_[z[0], z, z[-1]], np.r_[0.0, x, 0.0], "part", colour=MUTED),
    ]


def diameters_picture(data: Diameters) -> Picture:
    """Return the error of the diameter over Z, passes apart."""
    labels = np.full(len(data), "") if data.pass_ is None else np.asarray(data.pass_).astype(str)
    names = list(dict.fromkeys(labels.tolist()))
    series: list[Series] = []
    for k, name in enumerate(names[:MAX_PASSES]):
        mine = np.flatnonzero(labels == name)
        order = mine[np.argsort(data.z_mm[mine], kind="stable")]
        colour = PALETTE[k % len(PALETTE)]
        z, error = data.z_mm[order], data.error_um[order]
        series.append(line(z, error, colour=colour, width=0.9, opacity=0.6))
        hover = tuple(
            f"{a:g} mm: {e:+.3g} µm".replace("-", "−") for a, e in zip(z, error, strict=True)
        )
        label = _called(data, name, mine)
        series.append(points(z, error, label, colour=colour, size=3.5, rows=order, hover=hover))
    few = len(names) > MAX_PASSES
    note = f"{MAX_PASSES} of {len(names)} passes are drawn." if few else ""
    y = Axis("Error of the diameter", "µm")
    return Picture("Deviation along the part", Z_AXIS, y, tuple(series), note=note)


def _called(data: Diameters, name: str, rows: Any) -> str:
    """What a pass is called: its label, the sense of its feed, its depth."""
    parts = [f"pass {name}"] if name else ["measured"]
    if data.feed_sign is not None:
        sign = data.feed_sign[rows]
        if np.all(sign == sign[0]):
            parts.append("towards the chuck" if sign[0] < 0 else "from the chuck")
    if data.depth_mm is not None and np.ptp(data.depth_mm[rows]) == 0:
        parts.append(f"{data.depth_mm[rows][0]:g} mm deep")
    return ", ".join(parts)


def plot_probe_path(path: ProbePath, *, ax: Any = None, **style: Any) -> Any:
    """Draw the path of the ball's centre over the part; the probe at the end of each interval."""
    return probe_path_picture(path).draw(ax, width=9.0, height=4.6, **style)


def probe_path_picture(path: ProbePath) -> Picture:
    """Return the path of the ball's centre, to scale."""
    series = _part(path.profile)
    kinds = (
        (~path.feed, BLUE, 0.9, "dash", "rapid"),
        (path.feed & ~path.measures, OCHRE, 1.4, "solid", "approach at feed"),
        (path.measures, RED, 2.2, "solid", "measuring"),
    )
    top = float(path.moves_mm[:, 1::2].max()) + 2 * path.probe.ball_diameter_mm
    for rows, colour, width, dash, label in kinds:
        if rows.any():
            ends = path.moves_mm[rows].reshape(-1, 2, 2)
            gap = np.full((len(ends), 1, 2), np.nan)
            z, x = np.concatenate([ends, gap], axis=1).reshape(-1, 2).T
            series.append(line(z, x, label, colour=colour, width=width, dash=dash))
    series += _probes(path, top)
    return Picture(
        "Path of the ball's centre",
        Z_AXIS,
        Axis("Radius", "mm", limits=(0.0, top)),
        tuple(series),
        Kind.MAP,
    )


def interval_picture(interval: Interval) -> Picture:
    """Return the stretch along which the ball's centre measures, to scale."""
    z, x = zip(interval.start_mm, interval.end_mm, strict=True)
    low, high = min(x), max(x)
    room = max(0.25 * abs(z[1] - z[0]), 1.0)
    return Picture(
        f"Measured along element {interval.element}: the ball's centre",
        Z_AXIS,
        Axis("Radius", "mm", limits=(low - room, high + room)),
        (
            line(z, x, "measuring", colour=RED, width=2.2),
            points([z[0]], [x[0]], "start", colour=RED, size=7.0),
        ),
        Kind.MAP,
    )


def finishing_picture(made: Finishing) -> Picture:
    """Return the path of a finishing program in Z and radius; stretches left out are marked."""
    moves = follow(made.program)
    series: list[Series] = []
    for rapid, colour, dash, label in (
        (False, BLUE, "solid", "at feed"),
        (True, MUTED, "dash", "rapid"),
    ):
        mine = (moves.code == 0) == rapid
        if mine.any():
            gap = np.full(int(mine.sum()), np.nan)
            z, x = (
                np.stack([moves.start[mine, k], moves.end[mine, k], gap], axis=1).ravel()
                for k in (2, 0)
            )
            series.append(line(z, x, label, colour=colour, dash=dash))
    high = float(max(moves.start[:, 0].max(), moves.end[:, 0].max()))
    for k, ends in enumerate(made.left_out_mm):
        label = "left to another tool" if k == 0 else ""
        shown = band(ends, [0.0] * 2, [high] * 2, label, colour=OCHRE, opacity=0.2)
        series.append(shown)
    title = f"Finishing program of {len(made.program)} blocks"
    return Picture(
        title, Z_AXIS, Axis("Radius", "mm", limits=(0.0, 1.05 * high)), tuple(series), Kind.MAP
    )


def _probes(path: ProbePath, top: float) -> list[Series]:
    """Ball and body of the probe at both ends of every interval."""
    ball = path.probe.ball_diameter_mm / 2
    half = path.probe.body_diameter_mm / 2
    angle = np.radians(path.probe.contact_angle_deg / 2)
    z0, x0 = ball * np.cos(angle), -ball * np.sin(angle)
    turn = np.linspace(0, 2 * np.pi, 60)
    parts: list[Floats] = []
    for interval in path.intervals:
        for z, x in (interval.start_mm, interval.end_mm):
            parts.append(np.column_stack([z + ball * np.sin(turn), x + ball * np.cos(turn)]))
            shoulder = x + (x0 + (half - z0) / np.tan(angle) if half > z0 and angle > 0 else 0.0)
            parts += [
                np.array([[z + k * half, top], [z + k * half, shoulder], [z + k * z0, x + x0]])
                for k in (-1, 1)
            ]
    if not parts:
        return []
    whole = np.concatenate([np.vstack([part, [np.nan, np.nan]]) for part in parts])
    return [line(whole[:, 0], whole[:, 1], "probe: ball and body", colour=GREEN, width=0.8)]


def plot_correction(correction: Correction, *, ax: Any = None, **style: Any) -> Any:
    """Draw the readings and what the corrected program leaves of them if they repeat."""
    return correction_picture(correction).draw(ax, width=8.0, **style)


def correction_picture(correction: Correction) -> Picture:
    """Return measured and predicted errors of the diameter over Z, with the bound."""
    on = correction.covered
    order = np.flatnonzero(on)[np.argsort(correction.z_mm[on])]
    z = correction.z_mm[order]
    limit = correction.bound_um or correction.unit_um / 2
    name = "bound" if correction.bound_um is not None else "half a unit of the program"
    ends = np.array([z[0], z[-1]]) if len(z) else np.array([0.0, 1.0])
    count = len(correction.inserted)
    return Picture(
        f"Correction by {count} block{'s' if count != 1 else ''}, rule {correction.rule!r}, "
        f"unit {correction.unit_um:g} µm",
        Z_AXIS,
        Axis("Error of the diameter", "µm"),
        (
            band(ends, [-limit] * 2, [limit] * 2, f"± {name}", colour=GREEN, opacity=0.15),
            points(z, correction.error_um[order], "measured", colour=MUTED, size=3.0),
            line(z, correction.remaining_um[order], "left, predicted", colour=VERMILLION),
        ),
    )
