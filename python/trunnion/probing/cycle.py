"""What a probing program does: its touches, every move in order, and how long they take.

`Cycle.blocks` is the motion without expressions, for checks of every move; the text that makes
LinuxCNC do it is in `trunnion.probing.linuxcnc`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.units import Floats
from trunnion.data.frame import Frame
from trunnion.data.linuxcnc_runs import spans
from trunnion.setup import Setup

BACK_OFF_DEG = 5.0
"""How far an axis goes beyond a position to come to it from the other sense."""
SHORTEST_PROBE_MM = 0.3
"""LinuxCNC refuses probing moves below 0.254 mm."""
CHECK_DEG, CHECK_MM = 5.0, 10.0
"""Where C stands, and how far X moves, to see whether tool centre point control is on."""
MAX_LOOKS = 3
ALONG, ACROSS = 0.99, 0.5
"""Cosines of directions that are one, and of such that are across each other."""
Move = tuple[int, dict[str, float], float]
"""Code (0 rapid, 1 down to a start, 38 approach), positions by axis, feed."""


@dataclass(frozen=True)
class Step:
    """One touch: positions and expected senses of turning by letter, and its approach, mm.

    way: From start to end as the table sees it.
    """

    angles: Mapping[str, float]
    senses: Mapping[str, int]
    start: tuple[float, ...]
    contact: tuple[float, ...]
    end: tuple[float, ...]
    way: tuple[float, ...]
    level: float
    feed: float

    @property
    def towards(self) -> tuple[float, ...]:
        """Direction of the approach, of length 1."""
        way = math.dist(self.start, self.end)
        return tuple((b - a) / way for a, b in zip(self.start, self.end, strict=True))


@dataclass(frozen=True, eq=False)
class Cycle:
    """What a probing program does.

    offset_mm: How far offsets of the rotary axes move a point at the origin of the table's frame,
    and so much more with each mm from there.
    notes: On the plan, for the header; ASCII.
    frame_before: Work offset and tool length of the runs that it goes on with, as their log says.
    measured: Numbers of the touches in a log of runs before, `measured_in`; None: no log is known.
    """

    setup: Setup
    letters: tuple[str, ...]
    swing: float
    steps: Sequence[Step]
    offset_mm: tuple[float, float]
    notes: tuple[str, ...] = ()
    name: str = "plan"
    plan_hash: str = ""
    log: str = "touches.log"
    start_at: int = 1
    dry_run: bool = False
    frame: Frame = "machine"
    frame_before: Mapping[str, float] = field(default_factory=dict)
    measured: frozenset[int] | None = None
    measured_in: str = ""

    @property
    def mode(self) -> str:
        """Line that switches the kinematics to what the moves between touches are written for."""
        control = self.setup.control
        return control.corrected_on if self.frame == "corrected" else control.tcp_off

    def said_before(self) -> Iterator[str]:
        """Say what is known of the touches before the first one that it makes; ASCII."""
        before, head = range(1, self.start_at), f"From touch {self.start_at} on"
        if before and self.measured is None:
            yield (
                f"{head}: {spans(before)} of the plan are taken to be in {self.log} already; "
                "--continues LOG looks whether they are."
            )
        elif missing := set(before).difference(self.measured or ()):
            yield (
                f"{head}: {spans(missing)} of the plan are not in {self.measured_in}, and no run "
                f"measures them; --from {min(missing)} would."
            )

    @property
    def checks_tcp(self) -> bool:
        """Whether the program moves to see that tool centre point control is off."""
        return self.setup.control.tcp_check and "C" in self.letters

    @cached_property
    def looks(self) -> tuple[Step, ...]:
        """Touches that are made before all others, to see that all is where it is planned.

        The first from above with nothing turned; where the work offset is not stated, two from the
        sides, too, across each other.
        """
        found: list[Step] = []
        untilted = [step for step in self.steps if not any(step.angles.values())]
        for step in untilted:
            if step.towards[2] < -ALONG and not found:
                found = [step]
        if not found or self.setup.control.centre_mm is not None:
            return tuple(found)
        for step in untilted:
            across = all(abs(np.dot(step.towards, one.towards)) < ACROSS for one in found)
            if across and len(found) < MAX_LOOKS:
                found.append(step)
        return tuple(found)

    def look_mm(self, look: Step) -> float:
        """How far the contact of a look may be from where it is planned."""
        artefact, reach = self.setup.artefact, math.hypot(*look.contact)
        turned = math.radians(artefact.tolerance_deg) * reach
        turned += self.offset_mm[0] + self.offset_mm[1] * reach
        return artefact.tolerance_mm + turned + self.setup.control.centre_tolerance_mm

    def _begin(self) -> Iterator[Move]:
        """Moves before the first touch; what may be in the way stops those to the touches."""
        down = self.setup.control.positioning_mm_min
        yield 0, {"Z": self.swing}, 0.0
        yield 0, dict.fromkeys(self.letters, 0.0), 0.0
        if self.checks_tcp:
            yield 0, {"C": CHECK_DEG}, 0.0
            yield 0, {"X": CHECK_MM}, 0.0
            yield 0, {"C": 0.0}, 0.0
        yield 1, {"X": 0.0, "Y": 0.0}, down
        for look in () if self.dry_run else self.looks:
            x, y, z = look.start
            yield 1, {"X": x, "Y": y}, down
            yield 1, {"Z": z}, down
            yield 1, dict(zip("XYZ", look.end, strict=True)), look.feed
            yield 0, dict(zip("XYZ", look.start, strict=True)), 0.0
            yield 0, {"Z": self.swing}, 0.0

    def moves(self) -> Iterator[tuple[int, Move]]:
        """Every move with the number of its touch, 0 outside touches."""
        at = dict.fromkeys(self.letters, 0.0)
        sense = dict.fromkeys(self.letters, 0)
        if self.checks_tcp:
            sense["C"] = -1
        x, y, z = 0.0, 0.0, self.swing
        for move in self._begin():
            yield 0, move
            x, y = move[1].get("X", x), move[1].get("Y", y)
        for number, step in enumerate(self.steps, start=1):
            if number < self.start_at:
                continue
            turns = list(_turns(step, at, sense))
            if turns:
                if z < self.swing:
                    yield number, (0, {"Z": self.swing}, 0.0)
                z = self.swing
                yield from ((number, (0, turn, 0.0)) for turn in turns)
            if (step.start[0], step.start[1]) != (x, y):
                yield number, (0, {"X": step.start[0], "Y": step.start[1]}, 0.0)
            x, y = step.start[:2]
            start = dict(zip("XYZ", step.start, strict=True))
            if z > step.start[2]:
                protected = z - step.start[2] > SHORTEST_PROBE_MM
                feed = self.setup.control.positioning_mm_min if protected else 0.0
                yield number, (1 if protected else 0, {"Z": step.start[2]}, feed)
            if not self.dry_run:
                yield number, (38, dict(zip("XYZ", step.end, strict=True)), step.feed)
                yield number, (0, start, 0.0)
            z = step.level
            if z > step.start[2]:
                yield number, (0, {"Z": z}, 0.0)
        if z < self.swing:
            yield 0, (0, {"Z": self.swing}, 0.0)
        if any(at.values()):
            yield 0, (0, dict.fromkeys(self.letters, 0.0), 0.0)

    def blocks(self) -> list[str | list[tuple[str, float]]]:
        """Return the moves as blocks of a program without expressions, from X0 Y0."""
        blocks: list[str | list[tuple[str, float]]] = [
            f"moves of plan {self.name} {self.plan_hash}",
            [("G", 21), ("G", 90), ("G", 94), ("G", 61)],
            [("G", 0), ("X", 0.0), ("Y", 0.0)],
        ]
        for _, (code, to, feed) in self.moves():
            words = [("G", 38.3 if code else 0.0), *to.items()]
            blocks.append([*words, ("F", feed)] if code else words)
        return [*blocks, [("M", 2)]]

    def times(self) -> tuple[Floats, float]:
        """When each touch triggers (nan: not touched), and how long all takes, s."""
        return self._times

    @cached_property
    def _times(self) -> tuple[Floats, float]:
        at: dict[str, float] = {}
        clock = 0.0
        triggers = np.full(len(self.steps), np.nan)
        for number, (code, to, feed) in self.moves():
            if code == 38:
                step = self.steps[number - 1]
                clock += self._touch_s(step)
                triggers[number - 1] = clock
                to = dict(zip("XYZ", step.contact, strict=True))
            else:
                clock += self._move_s(at, to, feed)
            at |= to
        return triggers, clock

    def _touch_s(self, step: Step) -> float:
        """Time from the start of an approach to its last trigger."""
        way, plan = math.dist(step.start, step.contact), self.setup.plan
        accelerating = self.setup.control.acceleration_mm_s2
        once = _ramp(way, step.feed / 60, accelerating)
        if plan.slow_feed_mm_min == 0:
            return once
        back = self.setup.control.back_off_mm
        once += _ramp(back, plan.rapid_mm_min / 60, accelerating)
        return once + _ramp(back, plan.slow_feed_mm_min / 60, accelerating)

    def _move_s(self, at: Mapping[str, float], to: Mapping[str, float], feed: float) -> float:
        plan, control = self.setup.plan, self.setup.control
        way = {axis: abs(value - at.get(axis, value)) for axis, value in to.items()}
        turn = max((v for axis, v in way.items() if axis in "ABC"), default=0.0)
        linear = math.hypot(*(v for axis, v in way.items() if axis in "XYZ"))
        speed = (feed or plan.rapid_mm_min) / 60
        turning = _ramp(turn, plan.rotary_deg_min / 60, control.rotary_acceleration_deg_s2)
        return max(turning, _ramp(linear, speed, control.acceleration_mm_s2))

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest position of each axis."""
        found: dict[str, list[float]] = {}
        for _, (_, to, _) in self.moves():
            for axis, value in to.items():
                found.setdefault(axis, []).append(value)
        order = sorted(found, key=lambda axis: (axis in "ABC", axis))
        return {axis: (min(found[axis]), max(found[axis])) for axis in order}

    def check_ranges(self) -> None:
        """Refuse moves beyond the ranges of axes in the set-up: of each its first one."""
        ranges = self.setup.axis_ranges()
        found: dict[str, str] = {}
        for number, (_, to, _) in self.moves():
            for axis, value in to.items():
                low, high = ranges.get(axis, (-math.inf, math.inf))
                if not low <= value <= high:
                    unit = "deg" if axis in "ABC" else "mm"
                    where = f"touch {number}" if number else "the way to the touches and back"
                    found.setdefault(
                        axis,
                        f"{where}: got a move of {axis} to {value:g} {unit}, expected {low:g} to "
                        f"{high:g} {unit} as axes.{axis}.range_{unit} of the set-up says",
                    )
        if found:
            raise DataError(f"plan, {'; '.join(found.values())}")


def _turns(step: Step, at: dict[str, float], sense: dict[str, int]) -> Iterator[dict[str, float]]:
    """Turn to the angles of a step, by way of an overshoot where the sense needs one."""
    over = {}
    moves = False
    for letter, angle in step.angles.items():
        expected, way = step.senses[letter], angle - at[letter]
        still = abs(way) < 1e-6
        if expected and (way * expected < -1e-6 or (still and sense[letter] != expected)):
            over[letter] = angle - expected * BACK_OFF_DEG
        moves |= not still
        if expected or not still:
            sense[letter] = expected or (1 if way > 0 else -1)
        at[letter] = angle
    if over:
        yield {**step.angles, **over}
    if over or moves:
        yield dict(step.angles)


def _ramp(way: float, speed: float, acceleration: float) -> float:
    """Time of a move from rest to rest; acceleration 0: not known, none."""
    if acceleration == 0.0 or way == 0.0:
        return way / speed
    if way > speed * speed / acceleration:
        return way / speed + speed / acceleration
    return 2.0 * math.sqrt(way / acceleration)
