"""Whether the sense of approach of an axis' stops is what the order of its targets shows."""

from typing import Protocol

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.units import Floats, Integers

MIN_STEPS = 4
"""From target to target in either sense, or in one pass, that say which way the axis went."""
MIN_OF_RANGE = 0.5
"""Of the targets' range, more than which a pass goes over: steps back (pilgrim) are short."""
SENSES = (1, -1)
ALL_SWAPPED = (
    "direction: the targets fall in every pass with direction 1 and rise in every pass with "
    "-1. Is its sign the other one? A reversal (backlash) has the other sign then."
)
HALF_SWAPPED = (
    "direction: with one direction the targets rise in {} and fall in as many: does its sign mean "
    "the same in all of them?"
)


class Stops(Protocol):
    """What says which way an axis went."""

    @property
    def target(self) -> Floats:
        """Target positions, (n,)."""
        ...

    @property
    def direction(self) -> Integers:
        """Sense of approach, (n,)."""
        ...

    @property
    def cycle(self) -> Integers:
        """Number of the cycle, (n,)."""
        ...

    @property
    def in_time(self) -> Integers:
        """Rows in the order of their times, (n,)."""
        ...

    def place(self, row: int) -> str:
        """Where people find a row."""
        ...


def approach_doubts(data: Stops) -> list[str]:
    """Ask about a sense of approach that is the other one in every pass, or in half of them.

    From stop to stop of a pass the axis goes the way that it approaches. A run with steps back
    (ISO 230-2, pilgrim steps) has none of one sense, and rows in order of the targets agree in one.
    """
    rows = data.in_time
    step = np.diff(data.target[rows])
    sense, cycle = data.direction[rows], data.cycle[rows]
    same = (sense[1:] == sense[:-1]) & (cycle[1:] == cycle[:-1]) & (step != 0)
    along = np.sign(step[same]) * sense[1:][same]
    enough = all(np.sum(sense[1:][same] == one) >= MIN_STEPS for one in SENSES)
    if enough and np.all(along < 0):
        return [ALL_SWAPPED]
    way = _ways(data)
    if _is_contradicted(way) and _count(way, 1) == _count(way, -1):
        return [HALF_SWAPPED.format(_passes(_count(way, 1)))]
    return []


def refuse_other_approach(data: Stops) -> None:
    """Refuse passes that go against their sense where most go along with it.

    A pass all of whose steps rise is one of direction 1: which meaning the sign has is the same
    throughout. Data of one sense only may have approached from one side on both ways.

    Raises DataError: with the first row of such a pass.
    """
    way = _ways(data)
    along, against = (_count(way, one) for one in SENSES)
    if not _is_contradicted(way) or along == against:
        return
    wrong = 1 if along < against else -1
    row, goes, sense = next(one for one in way if one[1] == wrong)
    where = f"direction ({data.place(row)}): got {sense:+d}"
    most = f"in {_passes(max(along, against))} of {along + against} it is the other way"
    does = "rise" if goes * sense > 0 else "fall"
    cycles = sorted({int(data.cycle[one[0]]) for one in way if one[1] == wrong})
    listed = ", ".join(map(str, cycles))
    of = f"cycle{'s' if len(cycles) > 1 else ''} {listed}"
    raise DataError(
        f"{where} in a pass whose targets {does}, expected one meaning of the sign: {most}. "
        f"Is the sign of direction the other one in {of}? Rows that are not in the order in which "
        "they were measured need time_s"
    )


def _ways(data: Stops) -> list[tuple[int, int, int]]:
    """First row, 1 (along) or -1 (against its sense) and sense of each pass over the axis.

    A pass: stops of one sense in one cycle whose targets go one way over most of their range.
    """
    rows = data.in_time
    target, sense, cycle = data.target[rows], data.direction[rows], data.cycle[rows]
    far = MIN_OF_RANGE * np.ptp(target)
    cuts = np.flatnonzero((np.diff(sense) != 0) | (np.diff(cycle) != 0)) + 1
    found = []
    for mine in np.split(np.arange(len(rows)), cuts):
        steps = np.sign(np.diff(target[mine]))
        turns = np.flatnonzero(np.diff(steps[steps != 0])) + 1
        for one in np.split(np.flatnonzero(steps), turns):
            if len(one) < MIN_STEPS or _gone(target[mine], one) <= far:
                continue
            own, first = int(sense[mine[0]]), mine[one[0]]
            found.append((int(rows[first]), int(steps[one[0]]) * own, own))
    return found


def _gone(target: Floats, steps: Integers) -> float:
    """Way over some steps that follow each other."""
    return float(abs(target[steps[-1] + 1] - target[steps[0]]))


def _is_contradicted(way: list[tuple[int, int, int]]) -> bool:
    """Whether passes of one sense go both ways, in data of both senses."""
    kinds = {(goes, sense) for _, goes, sense in way}
    both = {sense for _, sense in kinds} == set(SENSES)
    return both and any({(1, sense), (-1, sense)} <= kinds for sense in SENSES)


def _count(way: list[tuple[int, int, int]], goes: int) -> int:
    return sum(one[1] == goes for one in way)


def _passes(count: int) -> str:
    return f"{count} pass{'es' if count != 1 else ''}"
