"""Where points are: programmed places, travel of the axes, placements of the set-ups."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.rotation import rotations
from trunnion.base.units import ARCSEC, Floats, Integers
from trunnion.data.points import Points
from trunnion.machine.linear_axes import Travel

AXES = "xyz"
SAME_PLACE_MM = 1e-3
MIN_PITCH_MM = 4.0
MAX_PITCHES = 400


@dataclass(frozen=True)
class Places:
    """Where the points are: middle and half length of the travel used along each axis, mm.

    ``smallest``: step along each axis between programmed places if they are on a grid, else 0.
    """

    middle: Floats
    half: Floats
    smallest: Floats

    @classmethod
    def of(cls, nominal: Floats) -> Places:
        """Return those of programmed places, mm, (n, d)."""
        low, high = nominal.min(axis=0), nominal.max(axis=0)
        half = (high - low) / 2
        if not np.any(half > 0):
            raise DataError("points: got all at one programmed place, expected several")
        return cls((low + high) / 2, half, np.array([grid_step(x) for x in nominal.T]))

    def over(self, travel: Travel) -> Places:
        """Return these places on a travel that is longer."""
        return replace(self, middle=np.array(travel.middle_mm), half=np.array(travel.half_mm))

    @property
    def used(self) -> Travel:
        """Middle and half length as plain data."""
        return Travel(tuple(map(float, self.middle)), tuple(map(float, self.half)))

    def pitches(self, axis: int) -> tuple[float, ...]:
        """Pitches to try, mm, longest first, evenly spaced in frequency.

        From half the travel down to 4 mm, or to twice the step of a grid of places: a shorter one
        looks like a longer one there. At most 400: what would need more is not looked for.
        """
        length = 2 * float(self.half[axis])
        shortest = max(MIN_PITCH_MM, 2.0 * float(self.smallest[axis]))
        if length <= 2 * shortest:
            return ()
        step = 1.0 / (3.0 * length)
        count = int((1.0 / shortest - 2.0 / length) / step) + 1
        return tuple(1.0 / (2.0 / length + step * np.arange(min(count, MAX_PITCHES))))


def grid_step(x: Floats) -> float:
    """Step of places on a grid (1 % of it off at most), 0 if they are on none."""
    steps = np.diff(np.unique(np.round(x, 3)))
    if len(steps) == 0:
        return 0.0
    step = float(steps.min())
    off = np.abs(steps / step - np.round(steps / step))
    return step if np.all(off < 0.01) else 0.0


@dataclass(frozen=True)
class Frame:
    """Rigid placement of a group by the plain fit: measured = turn (nominal − middle) + at."""

    middle: Floats
    at: Floats
    turn: Floats

    @classmethod
    def of(cls, nominal: Floats, measured: Floats, label: str) -> Frame:
        """Fit it to places (n, d), programmed and measured, mm; ``label`` names the set-up."""
        d = nominal.shape[1]
        if len(nominal) < d:
            raise DataError(
                f"group {label}: got {len(nominal)} points, expected at least {d} for its placement"
            )
        middle, at = nominal.mean(axis=0), measured.mean(axis=0)
        u, _, vt = np.linalg.svd((measured - at).T @ (nominal - middle))
        mirror = np.ones(d)
        mirror[-1] = np.sign(np.linalg.det(u @ vt))
        return cls(middle, at, (u * mirror) @ vt)

    def back(self, measured: Floats) -> Floats:
        """Measured places in the machine frame, mm."""
        return np.asarray((measured - self.at) @ self.turn + self.middle)


def rotation(angles: Floats) -> tuple[Floats, list[Floats]]:
    """Rotation by angles in arcsec (rz in a plane, or rx ry rz: Rx Ry Rz), derivative by each."""
    d = 2 if len(angles) == 1 else 3
    full = np.zeros((1, 3))
    full[0, 3 - len(angles) :] = angles * ARCSEC
    (turned,), by = rotations(full)
    return turned[:d, :d], [ARCSEC * x[0, :d, :d] for x in by[3 - len(angles) :]]


def turned(at: Floats, turn: Floats) -> Floats:
    """Rows (m, d), one after the other in memory, turned by a matrix (d, d).

    In a plane as complex numbers: a fifth of the time of a product with a matrix of four numbers.
    """
    if len(turn) == 3:
        return np.asarray(at @ turn.T)
    return (at.view(np.complex128) * complex(turn[0, 0], turn[1, 0])).view(np.float64)


def groups_of(data: Points) -> tuple[list[Any], Integers]:
    """Labels of the set-ups and the group of each row."""
    if data.group is None:
        return [0], np.zeros(len(data), dtype=np.intp)
    labels, group = np.unique(np.asarray(data.group), return_inverse=True)
    return list(labels), group.reshape(-1).astype(np.intp)


def rounded(nominal: Floats) -> Integers:
    """Places in steps of 1 µm, for comparison, (n, d)."""
    return np.asarray(np.round(nominal / SAME_PLACE_MM), dtype=np.intp)


def places_of(nominal: Floats) -> Integers:
    """Number of the programmed place of each row: equal where it is the same within 1 µm."""
    _, place = np.unique(rounded(nominal), axis=0, return_inverse=True)
    return place.reshape(-1).astype(np.intp)


def first_of(places: Integers) -> Integers:
    """First row of each place."""
    return np.unique(places, return_index=True)[1].astype(np.intp)
