"""Circular tests by ISO 230-4: circular deviation G, hysteresis H, radial deviation F.

Radial deviations of the actual paths from the nominal circle, its centre fitted to both paths
together by least squares:

- G of one path: least distance of two concentric circles that hold it (minimum zone); G(b): both
  paths;
- H: largest difference of the two paths at one angle;
- F: largest and smallest radial deviation from the nominal circle, which needs a calibrated bar.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from trunnion.base.arguments import checked
from trunnion.base.errors import DataError
from trunnion.base.report import Cell, Result, Table
from trunnion.base.units import Floats, Integers
from trunnion.data.ballbar import Ballbar

ROUND_MM = 0.01
"""Commanded points may lie so far off their circle, mm: what three decimals of a chord leave."""
MIN_POINTS = 8
NEAR_STEPS = 3.0
SAME_ANGLE_DECIMALS = 4


@dataclass(frozen=True, eq=False, repr=False)
class Iso2304(Result):
    """Circular test of one set-up in one plane.

    Attributes
    ----------
    setup, plane
        Label of the set-up; "XY", "YZ" or "ZX".
    radius_mm
        Nominal radius: of the commanded circle.
    angle_deg, deviation_um, sense
        Angle in the plane, radial deviation with the centre taken off, sense of travel (+1
        counter-clockwise; 0 where it is not known), shape (n,).
    circular_ccw_um, circular_cw_um
        G of the paths; None where there is none.
    circular_um
        G(b) of both, or G of the only path.
    hysteresis_um
        H; None with one path.
    radial_max_um, radial_min_um
        F, with the length of the bar as measured.

    Examples
    --------
    >>> import trunnion as tn
    >>> found = tn.iso230_4(tn.read_ballbar(tn.sample_path("ballbar/circle.csv")))[0]
    >>> round(found.hysteresis_um, 1)
    3.6
    """

    setup: str
    plane: str
    radius_mm: float
    angle_deg: Floats
    deviation_um: Floats
    sense: Integers
    circular_ccw_um: float | None
    circular_cw_um: float | None
    circular_um: float
    hysteresis_um: float | None
    radial_max_um: float
    radial_min_um: float

    GRID = dict.fromkeys(("angle_deg", "deviation_um", "sense"), ("reading",))

    def title(self) -> str:
        """Name the test."""
        return "Circular test, ISO 230-4"

    def sentences(self) -> Sequence[str]:
        """Name the circle and its values."""
        both = "G(b)" if self.hysteresis_um is not None else "G"
        parts = [f"{both} = {self.circular_um:.2f} µm"]
        if self.hysteresis_um is not None:
            parts.append(f"H = {self.hysteresis_um:.2f} µm")
        parts.append(
            f"F = {self.radial_max_um:+.2f} / {self.radial_min_um:+.2f} µm".replace("-", "−")
        )
        return (
            f"Circle {self.setup}, {self.plane}, radius {self.radius_mm:g} mm: {', '.join(parts)}.",
        )

    def tables(self) -> tuple[Table, ...]:
        """Values of the standard."""
        rows: list[tuple[Cell, ...]] = [
            ("circular deviation G, counter-clockwise", self.circular_ccw_um),
            ("circular deviation G, clockwise", self.circular_cw_um),
            ("bi-directional circular deviation G(b)", self.circular_um),
            ("circular hysteresis H", self.hysteresis_um),
            ("radial deviation F, largest", self.radial_max_um),
            ("radial deviation F, smallest", self.radial_min_um),
        ]
        title = f"ISO 230-4, circle {self.setup} in {self.plane}"
        return (Table.of(title, ("", "µm"), rows, digits=3),)


@checked
def iso230_4(data: Ballbar) -> tuple[Iso2304, ...]:
    """Evaluate the circles of a ball-bar test by ISO 230-4.

    Parameters
    ----------
    data
        Lengths over circles in the XY, YZ or ZX plane; column `sense` separates the two paths.

    Returns
    -------
    tuple of Iso2304
        One for each set-up whose commanded points lie on a circle in one plane.

    Raises
    ------
    DataError
        No set-up is such a circle; joints are commanded.

    Examples
    --------
    >>> import trunnion as tn
    >>> circles = tn.iso230_4(tn.read_ballbar(tn.sample_path("ballbar/circle.csv")))
    >>> circles[0].plane
    'XY'
    """
    position = data.position_mm
    if position is None:
        raise DataError("circular test: got commanded joints, expected x_mm and y_mm")
    full = np.zeros((len(data), 3))
    full[:, : position.shape[1]] = position
    labels = np.asarray(data.setup).astype(str)
    found = []
    for label in dict.fromkeys(labels.tolist()):
        rows = np.flatnonzero(labels == label)
        circle = _circle(full[rows])
        if circle is not None:
            found.append(_evaluated(data, rows, label, *circle))
    if not found:
        raise DataError(
            "circular test: got no set-up whose commanded points lie on a circle in the XY, YZ or "
            f"ZX plane (to {ROUND_MM:g} mm), expected at least one"
        )
    return tuple(found)


def _circle(points: Floats) -> tuple[str, float, Floats] | None:
    """Plane, radius and angles (rad) of points on a circle in a plane of the axes; else None."""
    flat = np.flatnonzero(np.ptp(points, axis=0) < ROUND_MM)
    if len(points) < MIN_POINTS or len(flat) != 1:
        return None
    normal = int(flat[0])
    u, v = points[:, (normal + 1) % 3], points[:, (normal + 2) % 3]
    design = np.column_stack([2 * u, 2 * v, np.ones(len(u))])
    a, b, c = np.linalg.lstsq(design, u**2 + v**2, rcond=None)[0]
    radius = float(np.sqrt(c + a * a + b * b))
    if np.abs(np.hypot(u - a, v - b) - radius).max() > ROUND_MM:
        return None
    return ("YZ", "ZX", "XY")[normal], radius, np.arctan2(v - b, u - a)


def _evaluated(
    data: Ballbar, rows: Integers, label: str, plane: str, radius: float, angle: Floats
) -> Iso2304:
    lengths = np.asarray(data.length_mm)[rows]
    sense = np.zeros(len(rows), dtype=np.intp)
    if data.sense is not None:
        sense = np.asarray(data.sense)[rows].astype(np.intp)
    raw = 1e3 * (lengths - radius)
    waves = np.column_stack([np.cos(angle), np.sin(angle), np.ones(len(angle))])
    centre = np.linalg.lstsq(waves, raw, rcond=None)[0][:2]
    deviation = raw - waves[:, :2] @ centre
    paths = {s: np.flatnonzero(sense == s) for s in (1, -1)}
    each = {
        s: _zone(angle[at], raw[at]) if len(at) >= MIN_POINTS else None for s, at in paths.items()
    }
    hysteresis = None
    if all(zone is not None for zone in each.values()):
        hysteresis = _hysteresis(angle, deviation, paths[1], paths[-1])
    return Iso2304(
        setup=label,
        plane=plane,
        radius_mm=round(radius, 3),
        angle_deg=np.degrees(angle),
        deviation_um=deviation,
        sense=sense,
        circular_ccw_um=each[1],
        circular_cw_um=each[-1],
        circular_um=_zone(angle, raw),
        hysteresis_um=hysteresis,
        radial_max_um=float(deviation.max()),
        radial_min_um=float(deviation.min()),
    )


def _zone(angle: Floats, deviation: Floats) -> float:
    """Least radial distance of two concentric circles that hold a path: a linear programme."""
    waves = np.column_stack([np.cos(angle), np.sin(angle)])
    ones, zeros = np.ones((len(angle), 1)), np.zeros((len(angle), 1))
    upper = np.hstack([-waves, -ones, zeros])  # deviation - centre <= high
    lower = np.hstack([waves, zeros, ones])  # low <= deviation - centre
    found = linprog(
        [0, 0, 1, -1],
        A_ub=np.vstack([upper, lower]),
        b_ub=np.concatenate([-deviation, deviation]),
        bounds=[(None, None)] * 4,
        method="highs",
    )
    _, _, high, low = np.asarray(found.x, dtype=np.float64)
    return float(high - low)


def _hysteresis(angle: Floats, deviation: Floats, one: Integers, other: Integers) -> float | None:
    """Largest difference of the mean paths at one angle; None where they have no angle in common.

    The second path runs straight between its readings; several turns are averaged.
    """
    first, second = (_mean_path(angle[at], deviation[at]) for at in (one, other))
    known, values = second
    around = np.interp(first[0], known, values, period=2 * np.pi)
    turns = np.concatenate([known - 2 * np.pi, known, known + 2 * np.pi])
    away = np.abs(turns[None, :] - first[0][:, None]).min(axis=1)
    near = away < NEAR_STEPS * float(np.median(np.diff(known)))
    return float(np.abs(first[1] - around)[near].max()) if near.any() else None


def _mean_path(angle: Floats, deviation: Floats) -> tuple[Floats, Floats]:
    """Angles that rise, and the mean deviation at each."""
    places, index = np.unique(np.round(angle, SAME_ANGLE_DECIMALS), return_inverse=True)
    return places, np.bincount(index, deviation) / np.bincount(index)
