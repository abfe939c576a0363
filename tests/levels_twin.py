"""Levels on lines and surfaces with hidden causes: differences of heights below the feet.

A level stands on two feet and reads the rise from one to the other over their distance, along its
line and across. Surfaces are heights written from geometry: arcs, planes that meet, rails that are
wound about each other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

import trunnion as tn
from twin.forward import Floats

Rng = np.random.Generator
Height: TypeAlias = Callable[[Floats, Floats], Floats]
"""In µm, at places x, y in mm."""
SECONDS = 20.0  # between readings
RADIUS_MM = 1e6  # of a bow, before it is scaled


@dataclass(frozen=True, eq=False)
class Way:
    """Where a level stands (mm), which way round, and how far its feet are apart."""

    x: Floats
    y: Floats
    sense: Floats
    feet: float
    grid: bool

    @property
    def time(self) -> Floats:
        """Of each row, s."""
        return np.asarray(SECONDS * np.arange(len(self.x)))

    def slopes(self, height: Height) -> Floats:
        """Rise between the feet over their distance, along and across, (n, 2), µm/m."""
        half, x, y = self.feet / 2, self.x, self.y
        rise = [
            height(x + half, y) - height(x - half, y),
            height(x, y + half) - height(x, y - half),
        ]
        return np.asarray(1e3 * np.stack(rise, axis=1) / self.feet)

    def read(self, height: Height) -> Floats:
        """What it shows of a surface, µm/m: turned, it shows the other sign."""
        return np.asarray(self.sense[:, None] * self.slopes(height))

    def left(self, change: Floats) -> Floats:
        """What the inclination of the whole does not make of a change, flat."""
        off = change - self.sense[:, None] * (self.sense @ change / len(self.sense))
        return np.asarray(off.ravel())

    def data(self, readings: Floats) -> tn.Levels:
        """As the package takes them."""
        places = {"x_mm": self.x, "y_mm": self.y} if self.grid else {"position_mm": self.x}
        return tn.Levels(
            **places,
            along_um_m=readings[:, 0],
            across_um_m=readings[:, 1],
            turn_deg=np.where(self.sense > 0, 0, 180),
            time_s=self.time,
        )


def drawn_way(rng: Rng) -> Way:
    """A line of 14 to 30 places or a grid, read twice in one order, turned in between."""
    feet = float(rng.choice([50.0, 100.0, 200.0]))
    if rng.random() < 0.3:
        mesh = np.meshgrid(np.arange(rng.integers(7, 12)), np.arange(rng.integers(6, 9)))
        x, y = (np.asarray(feet * one.ravel()) for one in mesh)
        grid = True
    else:
        x = np.asarray(feet * (0.5 + np.arange(rng.integers(14, 31))))
        y, grid = 0 * x, False
    sense = np.repeat([1.0, -1.0], len(x))
    return Way(np.tile(x, 2), np.tile(y, 2), sense, feet, grid)


# --- surfaces and instruments


def _within(way: Way, axis: int, rng: Rng) -> float:
    """A joint of the bed: anywhere but near its ends."""
    low, high = way.x.min(), way.x.max()
    if axis:
        low, high = way.y.min(), way.y.max()
    return float(low + rng.uniform(0.2, 0.8) * (high - low))


def _zero(way: Way, rng: Rng) -> Floats:
    return np.ones((len(way.x), 1)) * rng.standard_normal(2)


def _drift(way: Way, rng: Rng) -> Floats:
    return np.outer(way.time, rng.standard_normal(2))


def _twist(way: Way, _: Rng) -> Floats:
    """Rails that rise one beside the other."""
    return way.read(lambda x, y: 1e-4 * (x - way.x.mean()) * (y - way.y.mean()))


def _bow(way: Way, rng: Rng) -> Floats:
    """Arcs of a circle, of a surface along x and y."""
    across = float(rng.standard_normal()) if way.grid else 0.0

    def height(x: Floats, y: Floats) -> Floats:
        middle = way.x.mean(), way.y.mean()
        arcs = [np.sqrt(RADIUS_MM**2 - (p - m) ** 2) for p, m in zip((x, y), middle, strict=True)]
        return np.asarray(1e3 * (arcs[0] + across * arcs[1]))

    return way.read(height)


def _kink(way: Way, rng: Rng) -> Floats:
    """Two straight parts that meet, the second turned about both axes."""
    joint, pitch, roll = _within(way, 0, rng), *rng.standard_normal(2)
    return way.read(
        lambda x, y: np.maximum(x - joint, 0) * pitch + np.where(x > joint, y, 0) * roll
    )


def _fold(axis: int) -> Callable[[Way, Rng], Floats]:
    def fold(way: Way, rng: Rng) -> Floats:
        joint = _within(way, axis, rng)
        return way.read(lambda x, y: np.maximum((x, y)[axis] - joint, 0.0))

    return fold


def _shape(way: Way, rng: Rng) -> Floats:
    """Waves longer than half of it, of a surface, or of pitch and roll.

    Part of such a wave is straight where it is short of a whole number: no bow and no twist.
    """
    first, phase = rng.uniform(0.9, 2.0, 2) / np.ptp(way.x), rng.uniform(0, 6.28, 2)
    if way.grid:
        second = rng.uniform(0.5, 1.2) / np.ptp(way.y)
        return way.read(
            lambda x, y: 100 * np.sin(2 * np.pi * (first[0] * x + second * y) + phase[0])
        )
    return way.sense[:, None] * np.sin(2 * np.pi * np.outer(way.x, first) + phase)


ON_A_LINE: dict[str, Callable[[Way, Rng], Floats]] = {
    "instrument_zero": _zero,
    "drift": _drift,
    "twist": _twist,
    "bow": _bow,
    "kink": _kink,
    "field": _shape,
}
ON_A_GRID = {n: f for n, f in ON_A_LINE.items() if n != "kink"}
ON_A_GRID |= {"kink_x": _fold(0), "kink_y": _fold(1)}


def unknown(way: Way, rng: Rng) -> Floats:
    """What no cause makes: the room's air goes on and off, or the level is knocked.

    Cycles of the air about fit into a pass: half of one more, and the level turned for the second
    pass reads what a surface of that shape would give.
    """
    share = np.linspace(0.0, 1.0, len(way.x))
    if rng.random() < 0.5:
        cycles = 2 * rng.integers(1, 4) + rng.uniform(-0.4, 0.4)
        wave = np.sin(2 * np.pi * cycles * share + rng.uniform(0, 6.28))
    else:
        wave = (share > rng.uniform(0.2, 0.4) + rng.choice([0.0, 0.4])).astype(float)
    return np.outer(wave, rng.standard_normal(2))
