"""From slopes that a level read to heights above a line or a plane, with their covariance.

Heights are linear in slopes, so that their covariance is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.units import Floats

SAME_STEP = 0.01  # relative difference of steps that are one
MIN_TRIPLES = 3
MM_UM_M = 1e-3  # a slope of 1 µm/m over 1 mm, µm


@dataclass(frozen=True, eq=False)
class Slopes:
    """Slopes at m places from all readings of one component.

    values: µm/m, (m,). count, turned: readings at each place, and their mean sense, (m,).
    zero: of the instrument, µm/m; None where it was not turned. zero_cofactor: its variance per
    unit of variance of a reading. rss, free: sum of squares of the residuals, and its degrees of
    freedom. step: in which readings are recorded, 0: none is seen. repeats: readings at a place,
    turned alike.
    """

    places: Floats
    values: Floats
    count: Floats
    turned: Floats
    zero: float | None
    zero_cofactor: float
    rss: float
    free: int
    step: float
    repeats: float

    @property
    def cofactor(self) -> Floats:
        """Covariance of the slopes per unit of variance of a reading, (m, m)."""
        own = np.diag(1.0 / self.count)
        if self.zero is None:
            return own
        return own + self.zero_cofactor * np.outer(self.turned, self.turned)

    def variance(self, by: Floats) -> float:
        """Of a combination of the slopes (m,), per unit of variance of a reading."""
        zero = 0.0 if self.zero is None else self.zero_cofactor * float(by @ self.turned) ** 2
        return float(by**2 @ (1.0 / self.count)) + zero


@dataclass(frozen=True)
class Noise:
    """Noise of a reading, µm/m (1 σ; inf: not known), and where it is from."""

    sigma: float
    source: str

    @property
    def variance(self) -> float:
        """Of a noise that is not known as if it were 1."""
        return self.sigma**2 if np.isfinite(self.sigma) else 1.0

    @classmethod
    def of_neighbours(cls, places: Floats, slopes: Floats) -> Noise:
        """Of slopes off the line between their neighbours along x: structure counts as noise."""
        squares = []
        rows = np.unique(places[:, 1:], axis=0) if places.shape[1] > 1 else np.zeros((1, 0))
        for row in rows:
            mine = np.flatnonzero((places[:, 1:] == row).all(axis=1))
            x, r = places[mine, 0], slopes[mine]
            w = (x[1:-1] - x[:-2]) / (x[2:] - x[:-2])
            off = r[1:-1] - (1 - w) * r[:-2] - w * r[2:]
            squares += (off**2 / (1 + w**2 + (1 - w) ** 2)).tolist()
        if len(squares) < MIN_TRIPLES:
            return cls(np.inf, "not known: too few readings")
        return cls(float(np.sqrt(np.mean(squares))), "of second differences, structure included")


def heights_of_line(places: Floats, foot_mm: float | None) -> tuple[Floats, Floats, bool]:
    """Where heights follow from slopes at places (m,), (n,), how, (n, m), and whether by a chain.

    A chain: each reading stands on the places where its neighbours stand.
    """
    steps = np.diff(places)
    foot = float(np.median(steps)) if foot_mm is None else foot_mm
    if not foot > 0:
        raise DataError(f"foot_mm: got {foot:g}, expected a distance above 0")
    m = len(places)
    if np.all(np.abs(steps - foot) <= SAME_STEP * foot):
        at = np.append(places - foot / 2, places[-1] + foot / 2)
        return at, MM_UM_M * foot * np.tri(m + 1, m, -1), True
    rise = np.zeros((m, m))
    rows = np.arange(m - 1)
    rise[rows + 1, rows] = rise[rows + 1, rows + 1] = steps / 2
    return places, MM_UM_M * np.cumsum(rise, axis=0), False


@dataclass(frozen=True, eq=False)
class Mesh:
    """Neighbours on a grid of m places: slope between them by heights, and by slopes in x and y.

    differences: (e, m). means: mean slope of two neighbours, (e, 2 m).
    """

    differences: Floats
    means: Floats

    @classmethod
    def of(cls, places: Floats) -> Mesh:
        """Neighbours along x and along y of places (m, 2)."""
        m = len(places)
        differences, means = [], []
        for axis in (0, 1):
            order = np.lexsort((places[:, axis], places[:, 1 - axis]))
            one, other = order[:-1], order[1:]
            joined = places[one, 1 - axis] == places[other, 1 - axis]
            one, other = one[joined], other[joined]
            rows = np.arange(len(one))
            length = MM_UM_M * (places[other, axis] - places[one, axis])
            difference, mean = np.zeros((len(one), m)), np.zeros((len(one), 2 * m))
            difference[rows, other], difference[rows, one] = 1 / length, -1 / length
            mean[rows, axis * m + one] = mean[rows, axis * m + other] = 0.5
            differences.append(difference)
            means.append(mean)
        made = cls(np.concatenate(differences), np.concatenate(means))
        if np.linalg.matrix_rank(made.differences) < m - 1:
            raise DataError(
                "flatness: got places that are not connected along x and y, expected a grid"
            )
        return made

    def heights(self) -> Floats:
        """Heights by slopes: least squares, (m, 2 m)."""
        return np.asarray(np.linalg.pinv(self.differences) @ self.means)

    def closure(self, heights: Floats, slopes: Floats) -> float:
        """What heights (m,) leave of slopes (2 m,) between neighbours, rms."""
        left = self.differences @ heights - self.means @ slopes
        return float(np.sqrt(np.mean(left**2)))


@dataclass(frozen=True)
class Zone:
    """Heights (n,) above their line or plane, with both zones."""

    heights: Floats
    std: Floats
    widths: tuple[float, float]
    std_errors: tuple[float, float]

    @classmethod
    def of(cls, places: Floats, heights: Floats, covariance: Floats) -> Zone:
        """Of heights (n,) at places (n, d), and their covariance."""
        size = np.ptp(places, axis=0)
        plane = np.column_stack([np.ones(len(places)), (places - places.mean(axis=0)) / size])
        off = np.eye(len(places)) - plane @ np.linalg.pinv(plane)
        left, spread = off @ heights, off @ covariance @ off.T
        ends = np.zeros(len(places))
        ends[np.argmax(left)] += 1.0
        ends[np.argmin(left)] -= 1.0
        width, by = _minimum_zone(plane, left)
        return cls(
            left,
            np.sqrt(np.maximum(np.diag(spread), 0.0)),
            (float(np.ptp(left)), width),
            (_std(ends, spread), _std(by, spread)),
        )


def _std(by: Floats, covariance: Floats) -> float:
    return float(np.sqrt(np.maximum(by @ covariance @ by, 0.0)))


def _minimum_zone(plane: Floats, heights: Floats) -> tuple[float, Floats]:
    """Width of the narrowest zone between parallel lines or planes; its derivative by heights."""
    from scipy.optimize import linprog

    half = np.full((len(heights), 1), -0.5)
    above, below = np.hstack([-plane, half]), np.hstack([plane, half])
    cost = np.append(np.zeros(plane.shape[1]), 1.0)
    solved = linprog(
        cost,
        A_ub=np.concatenate([above, below]),
        b_ub=np.concatenate([-heights, heights]),
        bounds=[(None, None)] * len(cost),
        method="highs",
    )
    up, down = np.split(np.asarray(solved.ineqlin.marginals), 2)
    return float(np.asarray(solved.fun)), np.asarray(down - up)
