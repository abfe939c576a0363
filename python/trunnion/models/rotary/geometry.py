"""Where the targets of a sweep are: axis average line, places, and plain circles."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from trunnion.base.arguments import checked
from trunnion.base.errors import DataError
from trunnion.base.report import Result, Table
from trunnion.base.units import Floats, Integers
from trunnion.data.sweep import Sweep

MIN_POSITIONS = 3
MIN_CIRCLE_POSITIONS = 4


def directions(axis: Floats) -> Floats:
    """Return the directions of an axis' frame, (3, 3), one a column; the third is the ``axis``.

    The first is the instrument's X, or its Y where the axis is within 45° of X, as far as it is
    square to the axis. So two sweeps by an instrument that stands alike have one frame, however
    they scatter.
    """
    towards = np.eye(3)[int(abs(axis[0]) > np.sqrt(0.5))]
    x = towards - (towards @ axis) * axis
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


@dataclass(frozen=True)
class Geometry:
    """Axis average line and targets by plain circles.

    ``frame``: (3, 3), directions of the axis' frame in the instrument's, one a column (`directions`
    of the axis); ``origin``: a point of the axis, mm; ``targets``: (k, 3), each at position 0 in
    that frame.
    """

    origin: Floats
    frame: Floats
    targets: Floats

    @classmethod
    def of(cls, p: Floats, turn: Floats, target: Integers, labels: Sequence[Any]) -> Geometry:
        """Fit all targets, with the axis in common: ``p = origin + frame Rz(turn) targets``."""
        count = len(labels)
        for k, label in enumerate(labels):
            different = len(np.unique(np.round(turn[target == k], 9)))
            if different < MIN_POSITIONS:
                raise DataError(
                    f"target {label}: got {different} different positions of the axis, "
                    f"expected at least {MIN_POSITIONS}"
                )
        centred = p.copy()
        for k in range(count):
            centred[target == k] -= p[target == k].mean(axis=0)
        _, size, vt = np.linalg.svd(centred, full_matrices=len(centred) < 3)
        if size[0] == 0.0:
            raise DataError("sweep: got targets that do not move, expected targets that turn")
        start = p.mean(axis=0)
        # the sense in which the targets go round is the one whose circles fit
        fits = []
        for sense in (1.0, -1.0):
            turned = directions(sense * vt[2])
            fits.append((turned, *cls._circles((p - start) @ turned, turn, target, count)))
        frame, x, _ = min(fits, key=lambda fit: fit[2])
        q = (p - start) @ frame
        height = np.array([q[target == k, 2].mean() for k in range(count)])
        middle = (height.max() + height.min()) / 2
        origin = start + frame @ np.array([x[0], x[1], middle])
        return cls(origin, frame, np.column_stack([x[2:].reshape(-1, 2), height - middle]))

    @staticmethod
    def _circles(q: Floats, turn: Floats, target: Integers, count: int) -> tuple[Floats, float]:
        """Axis place and targets in the plane, mm (2 + 2 count,); sum of squares left, mm²."""
        c, s = np.cos(turn), np.sin(turn)
        # linear in axis place and targets: q = (ox, oy) + Rz(turn) v
        a = np.zeros((len(q), 2, 2 + 2 * count))
        a[:, 0, 0] = a[:, 1, 1] = 1.0
        rows = np.arange(len(q))
        a[rows, 0, 2 + 2 * target], a[rows, 0, 3 + 2 * target] = c, -s
        a[rows, 1, 2 + 2 * target], a[rows, 1, 3 + 2 * target] = s, c
        design, y = a.reshape(-1, a.shape[2]), q[:, :2].reshape(-1)
        x = np.asarray(np.linalg.lstsq(design, y, rcond=None)[0], dtype=np.float64)
        return x, float(np.sum((y - design @ x) ** 2))


@dataclass(frozen=True, eq=False, repr=False)
class Circle(Result):
    """Plain circle of one target; the commanded positions do not enter.

    Attributes
    ----------
    radius_mm, centre_mm, normal
        Circle in space, instrument frame.
    radial_um, axial_um
        Distance of each position from it, in the plane and off the plane, in the order of rows.

    Examples
    --------
    >>> import trunnion as tn
    >>> circles = tn.fit_circles(tn.read_sweep(tn.sample_path("axis/sweep.csv")))
    >>> round(circles[1].radius_mm, 1), circles[1].centre_mm.round(1)
    (90.0, array([400., 300., 150.]))
    """

    radius_mm: float
    centre_mm: Floats
    normal: Floats
    radial_um: Floats
    axial_um: Floats

    @property
    def radial_rms_um(self) -> float:
        """Rms of the radial distances."""
        return float(np.sqrt(np.mean(self.radial_um**2)))

    @property
    def axial_rms_um(self) -> float:
        """Rms of the axial distances."""
        return float(np.sqrt(np.mean(self.axial_um**2)))

    def sentences(self) -> Sequence[str]:
        """Say radius and residuals."""
        return (
            f"Circle of radius {self.radius_mm:.4f} mm: {self.radial_rms_um:.2f} µm rms radially, "
            f"{self.axial_rms_um:.2f} µm rms axially.",
        )

    def tables(self) -> tuple[Table, ...]:
        """Distance of each position."""
        rows = [
            (i, float(r), float(a))
            for i, (r, a) in enumerate(zip(self.radial_um, self.axial_um, strict=True))
        ]
        return (
            Table.of("Distances from the circle", ("position", "radial, µm", "axial, µm"), rows),
        )

    def derived(self) -> Mapping[str, Any]:
        """Rms of the distances."""
        return {"radial_rms_um": self.radial_rms_um, "axial_rms_um": self.axial_rms_um}


@checked
def fit_circles(data: Sweep) -> dict[Any, Circle]:
    """Fit a plane and in it a circle (least distances) to each target of a sweep.

    Raises
    ------
    DataError
        A target has fewer than four positions.

    Examples
    --------
    >>> import trunnion as tn
    >>> circles = tn.fit_circles(tn.read_sweep(tn.sample_path("axis/sweep.csv")))
    >>> round(circles[1].radius_mm, 1)
    90.0
    """
    labels, target = targets_of(data)
    out = {}
    for k, label in enumerate(labels):
        p = data.position_mm[target == k]
        if len(p) < MIN_CIRCLE_POSITIONS:
            raise DataError(f"target {label}: got {len(p)} positions, expected at least 4")
        middle = p.mean(axis=0)
        vt = np.linalg.svd(p - middle, full_matrices=len(p) < 3)[2]
        q = (p - middle) @ vt.T
        a = np.column_stack([2 * q[:, :2], np.ones(len(q))])
        x, y, w = np.linalg.lstsq(a, np.sum(q[:, :2] ** 2, axis=1), rcond=None)[0]
        start = np.array([x, y, np.sqrt(max(w + x * x + y * y, 0.0))])

        def distance(c: Floats, q: Floats = q) -> Floats:
            return np.asarray(np.hypot(q[:, 0] - c[0], q[:, 1] - c[1]) - c[2])

        def slope(c: Floats, q: Floats = q) -> Floats:
            r = np.hypot(q[:, 0] - c[0], q[:, 1] - c[1])
            return np.stack([(c[0] - q[:, 0]) / r, (c[1] - q[:, 1]) / r, -np.ones(len(q))], axis=1)

        best = optimize.least_squares(distance, start, jac=slope, method="lm", x_scale="jac").x
        out[label] = Circle(
            radius_mm=float(best[2]),
            centre_mm=middle + best[:2] @ vt[:2],
            normal=vt[2],
            radial_um=1e3 * distance(best),
            axial_um=1e3 * q[:, 2],
        )
    return out


def targets_of(data: Sweep) -> tuple[list[Any], Integers]:
    """Labels of the targets, and the number of that of each row."""
    labels, target = np.unique(np.asarray(data.target), return_inverse=True)
    return list(labels), target.reshape(-1).astype(np.intp)


@checked
def circles(data: Sweep) -> dict[Any, Circle]:
    """Fit circles: the former name of :func:`fit_circles`.

    Examples
    --------
    >>> import trunnion as tn
    >>> sweep = tn.read_sweep(tn.sample_path("axis/sweep.csv"))
    >>> len(tn.fit_circles(sweep))
    3
    """
    warnings.warn("circles is called fit_circles now", DeprecationWarning, stacklevel=2)
    return fit_circles(data)
