"""Error motions of linear axes as functions of where the axes stand.

What the machine's catalogue in the core lacks because it depends on the measured travel: linear
positioning, straightness, angular errors, periodic errors, a smooth field. Everything here is plain
data, so that an estimate can be stored. Beyond the measured travel the value at its end holds:
nothing is extrapolated.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion.base.report import Result
from trunnion.base.smooth import SmoothField
from trunnion.base.units import ARCSEC, Floats
from trunnion.machine.effects import MotionPose

AXES = "xyz"
MEAN_SQUARE = 1.0 / 3.0  # of a position between -1 and 1
CURVATURE = "curvature_um_m2"
"""Parameter of a straightness that does not depend on the travel: second derivative, µm/m²."""


@dataclass(frozen=True)
class Travel:
    """Travel of the linear axes that was measured, mm: X and Y, or X, Y and Z.

    middle_mm, half_mm: Middle and half length along each axis; half 0 where the axis did not move.
    """

    middle_mm: tuple[float, ...]
    half_mm: tuple[float, ...]

    @classmethod
    def of(cls, position_mm: Floats) -> Travel:
        """Return that of positions, (..., d)."""
        every = position_mm.reshape(-1, position_mm.shape[-1])
        low, high = every.min(axis=0), every.max(axis=0)
        return cls(tuple(((low + high) / 2).tolist()), tuple(((high - low) / 2).tolist()))

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return len(self.half_mm)

    def with_more(self, others: Iterable[Travel]) -> Travel:
        """Return the travel of this measurement and others together, of the same axes."""
        every = {self, *others}
        if len(every) == 1:
            return self
        both = [(np.array(t.middle_mm), np.array(t.half_mm)) for t in every]
        return Travel.of(np.array([[middle - half, middle + half] for middle, half in both]))

    def scaled(self, position_mm: Floats, axis: int) -> Floats:
        """Position along an axis, (n,), −1 to 1 over the travel."""
        half = self.half_mm[axis]
        return np.asarray(
            (position_mm[:, axis] - self.middle_mm[axis]) / (half if half > 0 else 1.0)
        )

    def inside(self, position_mm: Floats) -> Floats:
        """Positions (n, 3), none beyond the travel, in the coordinates that it has, (n, d)."""
        middle, half = np.array(self.middle_mm), np.array(self.half_mm)
        return np.asarray(np.clip(position_mm[:, : self.dimension], middle - half, middle + half))

    def field_places(self, position_mm: Floats) -> Floats:
        """Places for a smooth field: coordinates that vary, all on one scale."""
        middle, half = np.array(self.middle_mm), np.array(self.half_mm)
        vary = half > 1e-3 * half.max()
        return np.asarray((position_mm[:, vary] - middle[vary]) / half.max())


def bow(into: int, along: int, position_mm: Floats, travel: Travel) -> Floats:
    """Second and third Legendre polynomial of the position along an axis, 1 at the end.

    Displacement per unit of each, (n, 3, 2), in the direction `into`.
    """
    u = travel.scaled(position_mm, along)
    out = np.zeros((len(u), 3, 2))
    out[:, into, 0] = (3 * u * u - 1) / 2
    out[:, into, 1] = (5 * u**3 - 3 * u) / 2
    return out


def arc(into: int, along: int, position_mm: Floats, travel: Travel) -> Floats:
    """Displacement per µm/m² of curvature of a guide, (n, 3, 1): the same over any travel.

    Beside the line of least squares through evenly spaced places of the travel.
    """
    half = travel.half_mm[along] * 1e-3
    return bow(into, along, position_mm, travel)[..., :1] * (half * half / 3.0)


def angular(about: int, along: int, position_mm: Floats, travel: Travel) -> Floats:
    """Displacement ω × lever, ω = a1 u + a2 (u² − 1/3), u from −1 to 1 along the axis' travel.

    Per arcsec of a1 and a2, µm, (n, 3, 2). The lever is the position, its own coordinate left out:
    that is zero in the frame of the moving axis.
    """
    lever = np.zeros((len(position_mm), 3))
    lever[:, : position_mm.shape[1]] = position_mm
    lever[:, along] = 0.0
    omega = np.zeros(3)
    omega[about] = ARCSEC * 1e3
    moved = np.cross(omega, lever)
    u = travel.scaled(position_mm, along)[:, None]
    return np.stack([u * moved, (u * u - MEAN_SQUARE) * moved], axis=2)


def wave(axis: int, position_mm: Floats, values: Mapping[str, float]) -> Floats:
    """Periodic error of an axis, µm, (n, 3): a cos(2π s / pitch) + b sin(2π s / pitch)."""
    turn = 2 * np.pi * position_mm[:, axis] / values["pitch_mm"]
    out = np.zeros((len(turn), 3))
    out[:, axis] = values["a_um"] * np.cos(turn) + values["b_um"] * np.sin(turn)
    return out


@dataclass(frozen=True)
class LinearMotion:
    """How the tool moves under one effect of the linear axes.

    effect: Id: ``positioning_x``, ``straightness_y_of_x``, ``angular_z_of_x``, ``periodic_x``,
        ``cyclic_x``, and the like for the other axes.
    travel: Over which its parameters were found. Those of a straightness are two shapes over it, or
        a curvature.
    """

    effect: str
    travel: Travel

    def __call__(self, pose: MotionPose, values: Mapping[str, float]) -> Floats:
        """Displacement of the tool, machine frame, µm, (n, 3)."""
        at = self.travel.inside(pose.position_mm)
        kind, *axes = (part for part in self.effect.split("_") if part != "of")
        into, along = (AXES.index(axes[0]), AXES.index(axes[-1]))
        if kind in ("periodic", "cyclic"):
            return wave(along, at, values)
        names: tuple[str, ...]
        if kind == "angular":
            columns, names = angular(into, along, at, self.travel), ("a1_arcsec", "a2_arcsec")
        elif CURVATURE in values:
            columns, names = arc(into, along, at, self.travel), (CURVATURE,)
        else:
            columns, names = bow(into, along, at, self.travel), ("a2_um", "a3_um")
        return np.asarray(columns @ np.array([values[name] for name in names]))


@dataclass(frozen=True, eq=False, repr=False)
class FieldMotion(Result):
    """How the tool moves under a smooth field without a name.

    places, readings: Scaled places, (m, d), and the error at each, µm, in each coordinate.
    smoothing, freedom: Of the spline through them, see :class:`~trunnion.base.smooth.SmoothField`.
    travel: Over which it was found.
    """

    places: Floats
    readings: Floats
    smoothing: float
    freedom: float
    travel: Travel

    def sentences(self) -> tuple[str, ...]:
        """Say through how many places it goes."""
        return (f"Smooth field through {len(self.places)} places.",)

    def __call__(self, pose: MotionPose, values: Mapping[str, float]) -> Floats:  # noqa: ARG002
        """Displacement of the tool, machine frame, µm, (n, 3)."""
        smooth = SmoothField(self.places, self.readings, self.smoothing, self.freedom)
        found = smooth.at(self.travel.field_places(self.travel.inside(pose.position_mm)))
        out = np.zeros((len(found), 3))
        out[:, : found.shape[1]] = found
        return out


def motion_from_dict(values: Mapping[str, Any]) -> LinearMotion | FieldMotion:
    """Return a motion from its fields as plain values."""
    if "effect" not in values:
        return FieldMotion.from_dict(values)
    travel = values["travel"]
    middle, half = (tuple(map(float, travel[k])) for k in ("middle_mm", "half_mm"))
    return LinearMotion(str(values["effect"]), Travel(middle, half))
