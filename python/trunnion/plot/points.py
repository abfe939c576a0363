"""Measured points: deviations from their nominal places, as a vector map on one scale."""

from __future__ import annotations

from typing import Any

import numpy as np

from trunnion.base.checks import choose
from trunnion.base.units import Floats
from trunnion.data.points import Points
from trunnion.machine.linear_axes import FieldMotion
from trunnion.models.points.geometry import Frame, groups_of
from trunnion.plot.picture import Axis, Kind, Picture, arrows, line, points
from trunnion.plot.style import MUTED, PALETTE, round_number

PLANES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
ARROW_SHARE = 0.12
"""Of the size of the map: the longest arrow, where no magnification is given."""
BELOW = 0.14  # of the size: where the scale stands


def deviations_um(data: Points) -> Floats:
    """Return measured less nominal (n, d), µm, after the best fit of place and turn of each group.

    Where the plate lay on the measuring machine is no error of the machine that made it.
    """
    labels, group = groups_of(data)
    nominal, measured = data.nominal_mm, data.measured_mm
    away = np.empty_like(nominal)
    for k, label in enumerate(labels):
        mine = group == k
        frame = Frame.of(nominal[mine], measured[mine], str(label))
        away[mine] = 1e3 * (frame.back(measured[mine]) - nominal[mine])
    return away


def points_picture(
    data: Points, *, plane: str = "xy", magnification: float | None = None
) -> Picture:
    """Return the vector map of measured points, after the best fit of place and turn of each group.

    plane: "xy", "xz" or "yz". magnification: Of all arrows; by default the longest is well seen.
    """
    labels, group = groups_of(data)
    names = [str(label) for label in labels] if len(labels) > 1 else ["deviation"]
    return vector_picture(
        data.nominal_mm,
        deviations_um(data),
        np.asarray(group),
        names,
        title="Deviations after best fit of place and turn",
        plane=plane,
        magnification=magnification,
    )


def vector_picture(
    places: Floats,
    away_um: Floats,
    group: Floats,
    names: list[str],
    *,
    title: str,
    plane: str = "xy",
    magnification: float | None = None,
    bar_um: float | None = None,
) -> Picture:
    """Return vectors (n, d) at places (n, d) in a plane, one colour a group, with their scale.

    bar_um: Length of the scale; a round number near the largest vector if None.
    """
    i, j = PLANES[choose("plane", plane, PLANES)]
    at, by = places[:, [i, j]], away_um[:, [i, j]]
    low, high = at.min(axis=0), at.max(axis=0)
    size = float(np.max(high - low)) or 1.0
    length = np.hypot(*by.T)
    largest = float(length.max(initial=0.0))
    times = magnification or round_number(1e3 * ARROW_SHARE * size / max(largest, 1e-9))
    series = []
    for k, name in enumerate(names):
        mine = group == k
        colour = PALETTE[k % len(PALETTE)]
        texts = tuple(
            f"{a[0]:g}, {a[1]:g} mm: {b[0]:+.3g}, {b[1]:+.3g} µm".replace("-", "−")
            for a, b in zip(at[mine], by[mine], strict=True)
        )
        rows = np.flatnonzero(mine)
        series.append(points(*at[mine].T, colour=MUTED, size=2.5, hover=texts, rows=rows))
        drawn = 1e-3 * times * by[mine]
        look: dict[str, Any] = {"colour": colour, "width": 1.3}
        series.append(arrows(at[mine, 0], at[mine, 1], drawn[:, 0], drawn[:, 1], name, **look))
    bar = bar_um or (round_number(largest) if largest > 0 else 1.0)
    across = 1e-3 * times * bar
    x, y, tick = float(low[0]), float(low[1] - BELOW * size), 0.012 * size
    path = [(x, y - tick), (x, y + tick), (x, y), (x + across, y)]
    path += [(x + across, y - tick), (x + across, y + tick)]
    series.append(line(*np.transpose(path), colour=MUTED, width=1.8))
    rms = float(np.sqrt(np.mean(np.sum(by**2, axis=1))))
    letters = plane.upper()
    return Picture(
        title,
        Axis(letters[0], "mm"),
        Axis(letters[1], "mm"),
        tuple(series),
        Kind.MAP,
        note=f"Largest {largest:.3g} µm, rms {rms:.3g} µm; arrows × {times:,.0f}.",
        notes_at=((x + across, y, f" {bar:g} µm"),),
    )


def field_motion_picture(motion: FieldMotion) -> Picture:
    """Return a smooth field at the places that it goes through, as vectors on one scale."""
    travel = motion.travel
    places = motion.places * max(travel.half_mm)
    if places.shape[1] < 2:
        names = "XYZ"[: motion.readings.shape[1]]
        series = [
            points(places[:, 0], motion.readings[:, k], f"along {name}", colour=PALETTE[k])
            for k, name in enumerate(names)
        ]
        x = Axis("Position from the middle", "mm")
        return Picture("Smooth field without a name", x, Axis("Error", "µm"), tuple(series))
    away = np.zeros((len(places), 3))
    away[:, : motion.readings.shape[1]] = motion.readings
    where = np.zeros((len(places), 3))
    where[:, : places.shape[1]] = places
    group = np.zeros(len(places))
    title = "Smooth field without a name, from the middle of the travel"
    return vector_picture(where, away, group, ["error"], title=title)
