"""Circular tests by ISO 230-4: circular deviation G, hysteresis H, radial deviation F.

Radial deviations of the actual paths from the nominal circle, its centre fitted to both paths
together by least squares:

- G of one path: least distance of two concentric circles that hold it (minimum zone); G(b): both
  paths;
- H: largest difference of the two paths at one angle;
- F: largest and smallest radial deviation from the nominal circle, which needs a calibrated bar.

Standard uncertainties are the scatter of these figures from test to test by the noise of the
readings: the test is repeated `DRAWS` times on its own path with noise of the same size. The noise
is found from each reading and the mean of its neighbours, the path by a running median, which
keeps the step of a reversal; of 360 readings the uncertainty is itself known to about a fifth. The
largest and the smallest of noisy readings lie further out than those of the path: this is in the
figures, as the standard has them, not in their uncertainty. Readings in steps share their error of
rounding with their neighbours and repeats that show the same: these have one error in each test.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import linprog

from trunnion.base.arguments import checked
from trunnion.base.errors import DataError
from trunnion.base.recognition import displayed
from trunnion.base.repeats import shared_variance
from trunnion.base.report import Cell, Result, Table, measured
from trunnion.base.statistics import NORMAL_MEDIAN
from trunnion.base.units import Floats, Integers
from trunnion.data.ballbar import Ballbar
from trunnion.data.circles import MIN_POINTS, ROUND_MM, Circle, check_sense

NEAR_STEPS = 3.0
SAME_ANGLE_DECIMALS = 4
DRAWS, SEED = 200, 1
MAX_DRAWN = 500_000  # readings in all draws
WINDOW = 15  # readings of the running median
STRUCTURE = 4.0  # standard deviations from the median, from which a reading is no noise
SHRINKS = 14
FIGURES = {
    "circular_ccw_um": "circular deviation G, counter-clockwise",
    "circular_cw_um": "circular deviation G, clockwise",
    "circular_um": "bi-directional circular deviation G(b)",
    "hysteresis_um": "circular hysteresis H",
    "radial_max_um": "radial deviation F, largest",
    "radial_min_um": "radial deviation F, smallest",
}


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
    std_errors
        Standard uncertainty of each figure by the noise of the readings and the step in which they
        are recorded (not of the instrument, the place of its centre sockets or the temperature).

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
    std_errors: Mapping[str, float]

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
            (FIGURES[name], *measured(getattr(self, name), u), "µm")
            for name, u in self.std_errors.items()
        ]
        title = f"ISO 230-4, circle {self.setup} in {self.plane}"
        return (Table.of(title, ("", "value", "standard uncertainty", "unit"), rows),)

    @classmethod
    def labels(cls) -> dict[str, str]:
        """Name of each figure → what people call it."""
        return dict(FIGURES)


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
        No set-up is such a circle; joints are commanded; the rows of both paths go round it the
        other way than `sense` says.

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
        circle = Circle.through(full[rows])
        if circle is not None:
            found.append(_evaluated(data, rows, label, circle))
    if not found:
        raise DataError(
            "circular test: got no set-up whose commanded points lie on a circle in the XY, YZ or "
            f"ZX plane (to {ROUND_MM:g} mm), expected at least one"
        )
    return tuple(found)


def _evaluated(data: Ballbar, rows: Integers, label: str, circle: Circle) -> Iso2304:
    lengths = np.asarray(data.length_mm)[rows]
    plane, radius, angle = circle.plane, circle.radius_mm, circle.angle
    sense = np.zeros(len(rows), dtype=np.intp)
    if data.sense is not None:
        sense = np.asarray(data.sense)[rows].astype(np.intp)
        both = [np.flatnonzero(sense == k) for k in (1, -1)]
        check_sense(data, plane, [(rows[at], angle[at]) for at in both], any_order=True)
    raw = 1e3 * (lengths - radius)
    path = _Paths(angle, {k: np.flatnonzero(sense == k) for k in (1, -1)})
    deviation = path.centred(raw)
    zones = {name: _zone(angle[at], raw[at]) for name, at in path.zones.items()}
    extremes = {name: float(v[0]) for name, v in path.extremes(raw[:, None]).items()}
    return Iso2304(
        setup=label,
        plane=plane,
        radius_mm=round(radius, 3),
        angle_deg=np.degrees(angle),
        deviation_um=deviation,
        sense=sense,
        circular_ccw_um=zones.get("circular_ccw_um"),
        circular_cw_um=zones.get("circular_cw_um"),
        circular_um=zones["circular_um"],
        hysteresis_um=extremes.get("hysteresis_um"),
        radial_max_um=extremes["radial_max_um"],
        radial_min_um=extremes["radial_min_um"],
        std_errors={k: u for k, u in path.scatter(raw).items() if k in zones | extremes},
    )


class _Paths:
    """The two paths of a circle, whose readings (n,) stand at these angles (rad).

    paths: rows of each by its sense; none where there is no sense.
    """

    def __init__(self, angle: Floats, paths: Mapping[int, Integers]) -> None:
        self.angle = angle
        self.paths = {k: at for k, at in paths.items() if len(at) >= MIN_POINTS}
        self._waves = np.column_stack([np.cos(angle), np.sin(angle), np.ones(len(angle))])
        self._fit = np.linalg.pinv(self._waves)[:2]
        names = {1: "circular_ccw_um", -1: "circular_cw_um"}
        self.zones = {names[k]: at for k, at in self.paths.items()}
        self.zones["circular_um"] = np.arange(len(angle))

    def centred(self, raw: Floats) -> Floats:
        """Readings (n,) or (n, m) less the centre fitted to them."""
        return np.asarray(raw - self._waves[:, :2] @ (self._fit @ raw))

    def extremes(self, raw: Floats) -> dict[str, Floats]:
        """F and H of readings (n, m), each (m,); no H where the paths have no angle in common."""
        deviation = self.centred(raw)
        found = {"radial_max_um": deviation.max(axis=0), "radial_min_um": deviation.min(axis=0)}
        if len(self.paths) == 2:
            first, second = (
                _mean_path(self.angle[at], deviation[at]) for at in self.paths.values()
            )
            apart = _hysteresis(first, second)
            found |= {} if apart is None else {"hysteresis_um": apart}
        return found

    def scatter(self, raw: Floats) -> dict[str, float]:
        """Standard deviation of each figure from test to test."""
        ordered = [
            at[np.argsort(self.angle[at], kind="stable")]
            for at in self.paths.values() or (self.zones["circular_um"],)
        ]
        noise, path = _noise([raw[at] for at in ordered]), raw.copy()
        for at in ordered:
            path[at] = _path(raw[at], noise)
        count = max(2, min(DRAWS, MAX_DRAWN // len(raw)))
        rng = np.random.default_rng(SEED)
        drawn = path[:, None] + noise * rng.standard_normal((len(raw), count))
        width = np.sqrt(12 * shared_variance(noise**2, displayed(raw)))
        for at in ordered if width > 0 else ():
            alike = np.cumsum(np.diff(raw[at], prepend=raw[at][0]) != 0)
            drawn[at] += width * rng.uniform(-0.5, 0.5, (alike[-1] + 1, count))[alike]
        figures = {k: _zones(self.angle[at], drawn[at]) for k, at in self.zones.items()}
        figures |= self.extremes(drawn)
        return {k: float(np.std(figures[k], ddof=1)) for k in FIGURES if k in figures}


def _noise(paths: Sequence[Floats]) -> float:
    """Standard deviation of readings, paths in the order of their angle: beside their neighbours.

    By the median, which steps and spikes of a path do not change.
    """
    beside = np.concatenate([v - (np.roll(v, 1) + np.roll(v, -1)) / 2 for v in paths])
    size = np.median(np.abs(beside)) / NORMAL_MEDIAN or np.sqrt(np.mean(beside**2))
    return float(size / np.sqrt(1.5))


def _path(values: Floats, noise: float) -> Floats:
    """The path under readings (n,) in the order of their angle."""
    middle = np.asarray(median_filter(values, WINDOW, mode="wrap"))
    near = np.abs(values - middle) <= STRUCTURE * noise
    return np.asarray(np.where(near, middle, values))


def _zones(angle: Floats, deviation: Floats) -> Floats:
    """Least distance of two concentric circles that hold each of m paths, (n, m) → (m,).

    By a search of the centre about that of least squares: for many draws at once, and to a
    thousandth of what moving the centre changes, which `_zone` has exactly.
    """
    waves = np.column_stack([np.cos(angle), np.sin(angle)])
    whole = np.column_stack([waves, np.ones(len(angle))])
    left = deviation - whole @ np.linalg.lstsq(whole, deviation, rcond=None)[0]
    best = np.ptp(left, axis=0)
    centre = np.zeros((2, deviation.shape[1]))
    turn = 2 * np.pi * np.arange(8) / 8
    step = float(best.max()) / 4
    for _ in range(SHRINKS):
        for way in np.stack([np.cos(turn), np.sin(turn)], axis=1):
            tried = centre + step * way[:, None]
            width = np.ptp(left - waves @ tried, axis=0)
            better = width < best
            best, centre = np.where(better, width, best), np.where(better, tried, centre)
        step /= 2
    return np.asarray(best)


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


def _hysteresis(one: tuple[Floats, Floats], other: tuple[Floats, Floats]) -> Floats | None:
    """Largest difference of the mean paths at one angle, (m,); None without an angle in common.

    Paths: angles that rise (k,) and deviations (k, m). The other one runs straight between its
    readings.
    """
    known = other[0]
    turns = np.concatenate([known - 2 * np.pi, known, known + 2 * np.pi])
    away = np.abs(turns[None, :] - one[0][:, None]).min(axis=1)
    near = away < NEAR_STEPS * float(np.median(np.diff(known)))
    if not near.any():
        return None
    place = np.interp(one[0][near], turns, np.arange(len(turns)))
    low = np.minimum(place.astype(np.intp), len(turns) - 2)
    part = (place - low)[:, None]
    count = len(known)
    around = (1 - part) * other[1][low % count] + part * other[1][(low + 1) % count]
    return np.asarray(np.abs(one[1][near] - around).max(axis=0))


def _mean_path(angle: Floats, deviation: Floats) -> tuple[Floats, Floats]:
    """Angles that rise (k,), and the mean of m deviations (n, m) at each, (k, m)."""
    places, index = np.unique(np.round(angle, SAME_ANGLE_DECIMALS), return_inverse=True)
    sums = np.zeros((len(places), deviation.shape[1]))
    np.add.at(sums, index, deviation)
    return places, sums / np.bincount(index)[:, None]
