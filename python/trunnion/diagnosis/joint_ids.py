"""Ids of causes of several measurements, made and taken apart.

What one measurement has of its own has its name in front ("touches:drift_x"); so has what changed
before it ("touches 2:change_EX0C"), what ended there, and what its kind sees otherwise.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Happened(Enum):
    """What is another in one of several measurements than in the rest."""

    CHANGED = "change_{}"
    ENDED = "change_{}_ended"
    DIFFERS = "differs_{}"

    def id(self, measurement: str, cause: str) -> str:
        """Id of a candidate: this happened to a cause, or an error, at a measurement."""
        return f"{measurement}:{self.value.format(cause)}"


class JointId(NamedTuple):
    """An id taken apart: its measurement or '', what happened there if anything, and the cause."""

    measurement: str
    happened: Happened | None
    cause: str

    @classmethod
    def of(cls, id_: str) -> JointId:
        """Take an id apart, of a cause of several measurements or of one."""
        measurement, colon, own = id_.rpartition(":")
        for one in (Happened.ENDED, Happened.CHANGED, Happened.DIFFERS) if colon else ():
            before, _, after = one.value.partition("{}")
            if own.startswith(before) and own.endswith(after):
                return cls(measurement, one, own.removeprefix(before).removesuffix(after))
        return cls(measurement, None, own)
