"""Positioning tests of an axis with hidden causes, from the formulas of the notes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import trunnion as tn


def axis(
    rng: np.random.Generator,
    *,
    targets: int = 11,
    cycles: int = 5,
    noise: float = 0.7,
    change: np.ndarray | float = 0.0,
) -> tn.Positioning:
    """Stops of an axis in 1 µm steps of nothing: only noise, and ``change`` in µm."""
    up = np.round(np.linspace(0.0, 500.0, targets) + rng.uniform(-8, 8, targets), 1)
    target = np.tile(np.concatenate([up, up[::-1]]), cycles)
    error = 2.0 + change + noise * rng.standard_normal(len(target))
    return tn.Positioning(
        target_mm=target,
        measured_mm=target + 1e-3 * error,
        direction=np.tile(np.repeat([1, -1], targets), cycles),
        cycle=np.repeat(np.arange(1, cycles + 1), 2 * targets),
        time_s=15.0 * np.arange(len(target)),
    )


def worn(data: tn.Positioning, rng: np.random.Generator) -> np.ndarray:
    """A nut with more backlash where the axis works, less what it has on average."""
    at, width = rng.uniform(150, 350), rng.uniform(60, 120)
    more = np.exp(-(((data.target - at) / width) ** 2))
    return np.asarray(rng.uniform(2, 6) * data.direction * (more - more.mean()))


def wound_up(data: tn.Positioning, rng: np.random.Generator) -> np.ndarray:
    """A screw of 25 mm held at one end: friction stretches what is between, either way."""
    newton, stiff = rng.uniform(200, 800), 206e3 * np.pi / 4 * 25.0**2
    stretch_um = 1e3 * newton * data.target / stiff
    return np.asarray(data.direction * (stretch_um - stretch_um.mean()))


def beside_a_line(place: np.ndarray, change: np.ndarray) -> np.ndarray:
    """A change less the straight line in it."""
    return np.asarray(change - np.polyval(np.polyfit(place, change, 1), place))


def grown_from_its_bearing(data: tn.Positioning, rng: np.random.Generator) -> np.ndarray:
    """A screw warms up by some kelvin and grows from the bearing that holds it, at an end."""
    warm_k = rng.uniform(0.6, 2.0)
    along_m = 1e-3 * (data.target - rng.choice([-60.0, 560.0]))
    part = np.arange(len(data)) / len(data) / rng.uniform(0.1, 0.6)
    return np.asarray(11.5 * along_m * warm_k * -np.expm1(-part))


def in_each_cycle(data: tn.Positioning, rng: np.random.Generator, size: float) -> np.ndarray:
    """A size of its own in each cycle, of each stop: the axis was homed before it."""
    number = np.unique(data.cycle, return_inverse=True)[1]
    return np.asarray(rng.normal(0.0, size, number.max() + 1)[number])


def compensated_anew(data: tn.Positioning, rng: np.random.Generator) -> np.ndarray:
    """A control that takes the temperature anew before each cycle, about its reference point.

    It is that of the first cycle to which others are compared.
    """
    number = np.unique(data.cycle, return_inverse=True)[1]
    ppm = np.r_[0.0, rng.normal(0.0, 12.0, number.max())]
    return np.asarray(1e-3 * ppm[number] * (data.target - rng.uniform(-100.0, 600.0)))


def heat_in_between(data: tn.Positioning, rng: np.random.Generator) -> np.ndarray:
    """A hall that gets warmer while doors are open, the screw from its bearing: a half cosine."""
    part = np.arange(len(data)) / len(data)
    begins, takes = rng.uniform(0.1, 0.35), rng.uniform(0.3, 0.5)
    share = (1 - np.cos(np.pi * np.clip((part - begins) / takes, 0, 1))) / 2
    along_m = 1e-3 * (data.target - rng.choice([-60.0, 560.0]))
    return np.asarray(rng.choice([-1, 1]) * 11.5 * along_m * rng.uniform(0.8, 2.0) * share)


HIDDEN: dict[str, Callable[[tn.Positioning, np.random.Generator], np.ndarray]] = {
    "scale": lambda d, rng: 1e-3 * rng.uniform(10, 30) * (d.target - 250),
    "reversal": lambda d, rng: rng.uniform(1, 4) * d.direction,
    "reversal_slope": wound_up,
    "reversal_of_position": worn,
    "cycle_drift": lambda d, rng: rng.uniform(0.5, 2) * (d.cycle - 1),
    # a screw whose pitch wanders, seen by stops: not a wave of the catalogue, but one in places
    "curve": lambda d, _: (
        6.0 * beside_a_line(d.target, np.sin(d.target / 71.0 + 2e-3 * (d.target / 71.0) ** 3))
    ),
    "drift": lambda d, rng: rng.choice([-1, 1]) * rng.uniform(2, 6) * np.arange(len(d)) / len(d),
    "warmup": lambda d, rng: (
        rng.uniform(2, 8) * (1 - np.exp(-np.arange(len(d)) / len(d) / rng.uniform(0.1, 0.6)))
    ),
    "screw_warmup": grown_from_its_bearing,
    "scale_change": heat_in_between,
    "zero_of_cycle": lambda d, rng: in_each_cycle(d, rng, 2.0),
    "scale_of_cycle": compensated_anew,
    "periodic": lambda d, rng: (
        rng.uniform(1, 4)
        * np.sin(2 * np.pi * d.target / rng.uniform(110, 160) + rng.uniform(0, 6.28))
    ),
    # no cause of the catalogue: it goes with the order, up and down
    "unknown": lambda d, rng: (
        rng.uniform(1, 4)
        * np.sin(2 * np.pi * rng.uniform(2, 4) * np.arange(len(d)) / len(d) + rng.uniform(0, 6))
    ),
}
