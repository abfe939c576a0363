"""Distance to the artefact, and two ways to find where the ball touches it along a line.

The bars and the cuboid are convex, so the distance of a point that moves along a line is a convex
function of the way; Newton's method started before the contact then comes to the first root from
the left and never oversteps. The union of two bars is touched where the first of them is: the
distance to a union is the smaller of the two. ``step_to_contact`` knows none of this: it looks at
every tick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from twin.forward import Artefact, Floats, Lines

DONE_MM = 1e-13
MAX_STEPS = 200


class NoTouchError(ValueError):
    """The ball never gets to the artefact, or starts inside it."""


# --- distances ------------------------------------------------------------------------------------

NDArrayInt = NDArray[np.int64]


@dataclass(frozen=True)
class Box:
    """Stands on z = 0 with its centre over the origin, turned about Z."""

    half: Floats
    turned: float = 0.0

    def _local(self, points: Floats) -> Floats:
        if self.turned:
            cos, sin = np.cos(self.turned), np.sin(self.turned)
            points = points @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(points - (0.0, 0.0, self.half[2]))

    def distance(self, points: Floats) -> Floats:
        """Signed distance (...) of points (..., 3)."""
        beyond = np.abs(self._local(points)) - self.half
        x, y, z = beyond[..., 0], beyond[..., 1], beyond[..., 2]
        inside = np.maximum(np.maximum(x, y), z)
        x, y, z = np.maximum(x, 0.0), np.maximum(y, 0.0), np.maximum(z, 0.0)
        outside = np.sqrt(x * x + y * y + z * z)
        return np.asarray(np.where(inside > 0, outside, inside))

    def normal(self, points: Floats) -> Floats:
        """Gradient (..., 3) of the distance; inside, that of the nearest face."""
        local = self._local(points)
        beyond = np.abs(local) - self.half
        outside = np.maximum(beyond, 0.0)
        length = np.linalg.norm(outside, axis=-1, keepdims=True)
        nearest = np.eye(3)[np.argmax(beyond, axis=-1)]
        gradient = np.where(length > 0, outside / np.where(length > 0, length, 1.0), nearest)
        gradient = gradient * np.where(local < 0, -1.0, 1.0)
        cos, sin = np.cos(self.turned), np.sin(self.turned)
        back = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(gradient @ back)


@dataclass(frozen=True)
class Ball:
    """A sphere."""

    centre: Floats
    radius: float

    def distance(self, points: Floats) -> Floats:
        """Signed distance (...) of points (..., 3)."""
        return np.asarray(np.linalg.norm(points - self.centre, axis=-1) - self.radius)

    def normal(self, points: Floats) -> Floats:
        """Gradient (..., 3) of the distance."""
        away = points - self.centre
        return np.asarray(away / np.linalg.norm(away, axis=-1, keepdims=True))


Solid = Box | Ball


def solids(artefact: Artefact) -> tuple[Solid, ...]:
    """The convex parts whose union the artefact is."""
    half = np.array([artefact.length_mm, artefact.width_mm, artefact.height_mm]) / 2
    if artefact.kind == "cross":
        return Box(half), Box(half[[1, 0, 2]], artefact.squareness_rad)
    if artefact.kind == "cuboid":
        return (Box(half),)
    if artefact.kind == "sphere":
        return (Ball(np.array(artefact.centre_mm), artefact.diameter_mm / 2),)
    raise KeyError(f"no artefact is called {artefact.kind!r}")


def distance(points: Floats, artefact: Artefact) -> Floats:
    """Signed distance of points (..., 3): exact outside, a bound from below inside a union."""
    parts = [solid.distance(points) for solid in solids(artefact)]
    return np.asarray(np.minimum.reduce(parts))


# --- the exact contact ----------------------------------------------------------------------------


def _first_root(lines: Lines, solid: Solid) -> Floats:
    """Way (n,) to the first contact with one convex part, inf where there is none."""
    way = np.zeros(len(lines.radius))
    active = np.arange(len(way))
    for _ in range(MAX_STEPS):
        start, step = lines.start[active], lines.step[active]
        points = start + way[active, None] * step
        gap = solid.distance(points) - lines.radius[active]
        closing = -np.einsum("ni,ni->n", solid.normal(points), step)
        lost = closing <= 0  # past the nearest point: a convex distance only grows from here
        way[active[lost & (gap > DONE_MM)]] = np.inf
        going = ~lost & (np.abs(gap) >= DONE_MM)
        change = gap[going] / closing[going]
        active = active[going]
        before = way[active]
        way[active] = before + change
        active = active[way[active] != before]
        if not len(active):
            return way
    raise NoTouchError(f"{len(active)} grazing touches did not settle in {MAX_STEPS} steps")


def way_to_contact(lines: Lines) -> Floats:
    """Way (n,) in mm from the start to where the ball touches, exact to rounding."""
    inside = distance(lines.start, lines.artefact) <= lines.radius
    if np.any(inside):
        raise NoTouchError(f"touches {np.flatnonzero(inside)[:5]} start inside the artefact")
    way = np.min([_first_root(lines, solid) for solid in solids(lines.artefact)], axis=0)
    missed = ~np.isfinite(way)
    if np.any(missed):
        raise NoTouchError(f"touches {np.flatnonzero(missed)[:5]} pass the artefact")
    return np.asarray(way)


def bracketed_way(lines: Lines, i: int, reach_mm: float) -> float:
    """The same for touch i by scipy's bracketing root finder: slow, and nothing to get wrong."""
    found = []
    for solid in solids(lines.artefact):

        def gap(way: float, solid: Solid = solid) -> float:
            at = lines.start[i] + way * lines.step[i]
            return float(solid.distance(at) - lines.radius[i])

        lowest = minimize_scalar(gap, bounds=(0.0, reach_mm), method="bounded").x
        if gap(lowest) < 0 < gap(0.0):
            found.append(brentq(gap, 0.0, lowest, xtol=1e-13, rtol=1e-14))
    if not found:
        raise NoTouchError(f"touch {i} passes the artefact")
    return float(min(found))


# --- tick by tick ---------------------------------------------------------------------------------


def step_to_contact(lines: Lines, tick_mm: float, reach_mm: float, chunk: int = 512) -> NDArrayInt:
    """Number (n,) of the first tick at which the ball touches; every tick is looked at."""
    first = np.full(len(lines.radius), -1, dtype=np.int64)
    waiting = np.arange(len(first))
    for begin in range(0, int(np.ceil(reach_mm / tick_mm)) + 1, chunk):
        ticks = np.arange(begin, begin + chunk)
        ways = (ticks * tick_mm)[None, :, None]
        points = lines.start[waiting, None, :] + ways * lines.step[waiting, None, :]
        touching = distance(points, lines.artefact) <= lines.radius[waiting, None]
        hit = touching.any(axis=1)
        first[waiting[hit]] = ticks[touching[hit].argmax(axis=1)]
        waiting = waiting[~hit]
        if not len(waiting):
            return first
    raise NoTouchError(f"touches {waiting[:5]} pass the artefact within {reach_mm} mm")


def ticks_after(way: Floats, tick_mm: float) -> NDArrayInt:
    """The first tick that is not before the contact."""
    return np.ceil(way / tick_mm).astype(np.int64)
