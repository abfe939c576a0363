"""Displacements by heat: one that comes to its end exponentially, one that comes in between."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.effect import Effect, Parameter, gridded

DURATIONS = 10
"""Time constants tried, from a twentieth of the measurement to some times all of it."""
LONGEST = 1.5
SHORTEST_MIN = 1.0
"""Of a part of a machine. What is at its end within seconds is no warm-up, but a step."""
BEGINNINGS = np.linspace(0.1, 0.8, 8)
"""Of a change in the course of a measurement: tried, over the time that this takes.

What begins with it is a warm-up."""
SPANS = np.geomspace(0.1, 0.8, 4)
"""The same of the time over which it comes. What comes at once is no change by heat, but a step."""
TENTH_TO_NINE = 2 * np.log(9.0)
"""Of the logistic function: from a tenth of its height to nine of them."""


def warmup(
    id_: str,
    sizes: str | Sequence[str],
    minutes: Floats,
    enters: Floats,
    label: str,
    *,
    longest: float = LONGEST,
    **more: Any,
) -> Effect:
    """Make an effect in proportion to 1 - exp(-t/τ), τ (`tau_min`) sought on a grid.

    sizes: Name of its size, or of k sizes with the same τ.
    minutes: Time of each reading since the first, (n,), not all the same.
    enters: Change of each reading per unit of each size, (n,) or (n, k).
    longest: Time constant that is tried, times the length of the measurement.
    """
    length = float(np.max(minutes))
    most = longest * length
    shortest = min(max(length / 20, SHORTEST_MIN), most / 2)
    tau = Parameter("tau_min", "min", tuple(np.geomspace(shortest, most, DURATIONS)))
    names = [sizes] if isinstance(sizes, str) else sizes
    shape = _Warming(minutes, enters.reshape(len(minutes), len(names)))
    return gridded(id_, [*map(Parameter, names), tau], shape, label, **more)


@dataclass(frozen=True, eq=False)
class _Warming:
    """1 - exp(-t/τ) at times in minutes, as it enters the readings."""

    minutes: Floats
    enters: Floats

    def __call__(self, values: Mapping[str, float]) -> Floats:
        return self.enters * settled(self.minutes, values["tau_min"])[:, None]


def settled(minutes: Floats, tau_min: Floats | float) -> Floats:
    """Share of a displacement that is there, which comes to its end with a time constant."""
    return np.asarray(1 - np.exp(-minutes / tau_min))


def gradual(
    id_: str,
    sizes: str | Sequence[str],
    minutes: Floats,
    enters: Floats,
    label: str,
    **more: Any,
) -> Effect:
    """Make an effect that comes in the course of the measurement: a logistic function of the time.

    As of heat that comes or goes in between (air conditioning, a door, the sun, a pump). A tenth of
    it is there at a time (`from_min`), and nine tenths a span later (`over_min`).

    sizes, minutes, enters: As of :func:`warmup`.
    """
    length = float(np.max(minutes))
    times = [
        Parameter(name, "min", tuple(shares * length), (shares[0] * length, shares[-1] * length))
        for name, shares in (("from_min", BEGINNINGS), ("over_min", SPANS))
    ]
    names = [sizes] if isinstance(sizes, str) else sizes
    shape = _Gradual(minutes, enters.reshape(len(minutes), len(names)))
    return gridded(id_, [*map(Parameter, names), *times], shape, label, **more)


@dataclass(frozen=True, eq=False)
class _Gradual:
    """A change in the course of a measurement at times in minutes, as it enters the readings."""

    minutes: Floats
    enters: Floats

    def __call__(self, values: Mapping[str, float]) -> Floats:
        return self.enters * come(self.minutes, values["from_min"], values["over_min"])[:, None]


def come(minutes: Floats, from_min: float, over_min: float) -> Floats:
    """Share of a change that is there, less that at the first reading."""
    share = (1 + np.tanh(TENTH_TO_NINE / 2 * ((minutes - from_min) / over_min - 0.5))) / 2
    return np.asarray(share - share[np.argmin(minutes)])
