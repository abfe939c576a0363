"""Ways by which what has no name may enter readings: along a direction, or as an axis' angle.

A direction is a component in the unit of the readings; the angle of a rotary axis is one in arcsec.
"""

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion.base.units import Floats

ANGLE_OF = "angle of "
ANGLE_UNIT = "arcsec"
NO_CHANGE = 1e-6  # of the largest change of a reading by an arcsec: rounding of differences


def is_angle(way: str) -> bool:
    """Whether a component is the angle of a rotary axis."""
    return way.startswith(ANGLE_OF)


def angles(turning: Mapping[str, Floats]) -> dict[str, Floats]:
    """Components, from the change of each reading (n,) as an axis stands further, by its letter."""
    out = {}
    for letter, change in turning.items():
        least = NO_CHANGE * np.abs(change).max(initial=0.0)
        out[f"{ANGLE_OF}{letter.upper()}"] = np.where(np.abs(change) > least, change, 0.0)
    return out


def directions(components: Mapping[str, Floats]) -> dict[str, Floats]:
    """Components that are no angle."""
    return {way: enters for way, enters in components.items() if not is_angle(way)}


def in_words(way: str, before: str = " in ") -> str:
    """Say by which component something enters."""
    return f", as an {way}" if is_angle(way) else before + way if way else ""


@dataclass(frozen=True, eq=False)
class OnMachine:
    """An effect by a formula that is an angle, on data of a machine.

    turning: Change of each reading as a rotary axis stands further by 1 arcsec, by its letter.
    """

    source: Any
    turning: Mapping[str, Floats]

    def change(self, data: Any, values: Mapping[str, float]) -> Floats:
        """Change of each reading, (n,)."""
        return np.asarray(self._bound(data).change(values), dtype=np.float64)

    def jacobian(self, data: Any, values: Mapping[str, float]) -> Floats:
        """Derivative of the change by each parameter, (n, k)."""
        return np.asarray(self._bound(data).columns(values))

    def _bound(self, data: Any) -> Any:
        own = importlib.import_module("trunnion.models.kinds").described(data)
        ways = {**own.components, **angles(self.turning)}
        return self.source.bound(data, Description(own.covariates, ways, own.reading_unit))


@dataclass(frozen=True, eq=False)
class Description:
    """What data depend on and by which components, where a model does not say so itself."""

    covariates: Sequence[Any]
    components: Mapping[str, Floats]
    reading_unit: str
