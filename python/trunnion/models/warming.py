"""Warm-up: a displacement that comes to its end exponentially."""

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
