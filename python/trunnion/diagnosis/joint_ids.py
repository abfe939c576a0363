"""Ids of causes of several measurements, made and taken apart.

What one measurement has of its own has its name in front ("touches:drift_x"); so has what changed
before it ("touches 2:change_EX0C"), what ended there, what was another in it alone, and what its
kind sees otherwise.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Happened(Enum):
    """What is another in one of several measurements than in the rest: in its id, and in words."""

    CHANGED = "change_{}", "change of {} before {}"
    ENDED = "change_{}_ended", "{}, ended before {}"
    ONCE = "once_{}", "{}, other in {} alone"
    DIFFERS = "differs_{}", "{}, other in {}"

    def id(self, measurement: str, cause: str) -> str:
        """Id of a candidate: this happened to a cause, or an error, at a measurement."""
        return f"{measurement}:{self.value[0].format(cause)}"

    def label(self, cause: str, measurement: str) -> str:
        """Say the same in words, of what a cause is called."""
        return self.value[1].format(cause, measurement)


class JointId(NamedTuple):
    """An id taken apart: its measurement or '', what happened there if anything, and the cause."""

    measurement: str
    happened: Happened | None
    cause: str

    @classmethod
    def of(cls, id_: str) -> JointId:
        """Take an id apart, of a cause of several measurements or of one."""
        measurement, colon, own = id_.rpartition(":")
        # of what ended the id begins as that of what changed
        for one in sorted(Happened, key=lambda x: -len(x.value[0])) if colon else ():
            before, _, after = one.value[0].partition("{}")
            if own.startswith(before) and own.endswith(after):
                return cls(measurement, one, own.removeprefix(before).removesuffix(after))
        return cls(measurement, None, own)
