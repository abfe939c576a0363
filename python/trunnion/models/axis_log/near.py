"""The point about which a log's effects are taken, where strong effects are in the servo model.

The response of an axis is not linear in its servo's parameters: a friction of 15 µm on a loop whose
gain is 20 % off is not the sum of both. So strong effects are fitted to each axis by exact
simulation, jointly and with the state at the start of each run, by least squares: the effect that
explains most is taken in, then all are fitted anew, while one explains `MIN_SHARE` of what is left.
The catalogue is then built about this point. Which effects are causes is not decided here.

A structure that resonates is taken in like them: a gain, a delay and a time constant imitate it,
and beside friction no sum of chords leads back from there. It is not in the point, though: an axis
is recorded behind its structure, whose effect is built about the point (:mod:`.effects`).

A delay of the log is one of all axes. Each axis alone mistakes a part of it for its servo's, so it
is sought with the strong effects of each first. The one that fits all axes best is kept if they are
explained better with it than without any.
"""

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.contouring.servo import Axis, varied
from trunnion.models.axis_log.effects import (
    BEYOND,
    DAMPINGS,
    DELAY_STEP_MS,
    LOG_DELAY,
    LOWEST_HZ,
    MAX_CHANGE,
    MAX_DAMPING,
    MIN_DAMPING,
    is_scaled,
    resonances_hz,
    servo_effects,
    top_hz,
)
from trunnion.models.axis_log.servo_effects import ServoEffect
from trunnion.models.axis_log.signals import AxisSignal

MIN_SHARE = 0.05  # of the variance left, that an effect explains to be taken in
MAX_TAKEN = 8
MAX_ROUNDS = 3  # of taking in effects beside a delay of the log
SAME = 0.01  # of the variance of noise, by which a step of the log's delay still gains
MAX_STEPS = 12
MAX_HALVINGS = 5
SETTLED = 1e-6  # of the variance left, by which a step still gains
DEPENDENT = 1e-6  # of a squared unit column
TINY = 1e-300
NONLINEAR = 1.0  # of the rms left, by which chords are off from the exact response


@dataclass(frozen=True)
class Point:
    """Where a log's model is linearised.

    effects: Id → amount, of servo effects that are in, and of a delay of the log.
    places: Name → value, of places of other effects that fit beside these (of a resonance).
    starts: Letter → position (µm, arcsec) and speed (µm/ms) at the start of each run, (runs, 2).
    """

    effects: Mapping[str, float] = field(default_factory=dict)
    starts: Mapping[str, Floats] = field(default_factory=dict)
    places: Mapping[str, float] = field(default_factory=dict)


def near(axes: Iterable[AxisSignal], inputs: Iterable[Floats]) -> tuple[Point, bool]:
    """Return the point near a log, and whether sums of chords are not exact enough without it.

    ``inputs``: further columns of the log, (rows,) each, that may act on each axis.
    """
    axes, inputs = list(axes), list(inputs)
    found = [_searched(axis, inputs) for axis in axes]
    if delays := [one.log_delay() for one in found if LOG_DELAY in one.taken]:
        without = [_searched(axis, inputs, 0.0) for axis in axes]
        found = min(without, _delayed(axes, inputs, float(np.median(delays))), key=_cost)
    effects: dict[str, float] = {}
    places: dict[str, float] = {}
    for one in found:
        effects |= one.amounts()
        places |= one.structures()
    starts = {one.axis.letter: one.starts() for one in found}
    return Point(effects, starts, places), any(one.nonlinear() for one in found)


def _searched(
    axis: AxisSignal, inputs: Sequence[Floats], log_delay_ms: float | None = None
) -> "_Search":
    """Return what is found on an axis: with a structure that resonates where it fits better so."""
    stiff = _Search(axis, inputs, log_delay_ms).exchanged()
    frequencies = resonances_hz(axis)
    if not frequencies or all(stiff.entries[n].expected or n in stiff.held for n in stiff.taken):
        return stiff
    bare = [stiff.nonlinear_part(expected=expected) for expected in (True, False)]
    place = bare[0].best_structure(frequencies)
    return min(
        [stiff, *(one.with_structure(place).exchanged() for one in bare)],
        key=lambda one: _cost([one]),
    )


def _delayed(
    axes: Sequence[AxisSignal], inputs: Sequence[Floats], log_delay_ms: float
) -> list["_Search"]:
    """Searches with the delay of the log that fits all axes best; ``log_delay_ms``: near it."""
    for _ in range(MAX_ROUNDS):
        found = [_searched(axis, inputs, log_delay_ms) for axis in axes]
        before = log_delay_ms
        for _ in range(MAX_STEPS):
            along, sizes = np.sum([one.pull() for one in found], axis=0)
            log_delay_ms += float(along / max(sizes, TINY))
            for one in found:
                one.hold(log_delay_ms)
            if along**2 <= SAME * sizes:
                break
        if abs(log_delay_ms - before) <= DELAY_STEP_MS:
            break
    return found


def _cost(found: Sequence["_Search"]) -> float:
    """-2 ln L of all axes, with what taken effects and a delay of the log cost (Schwarz 1978)."""
    taken = len({name for one in found for name in one.taken})
    count = sum(len(one.y) for one in found)
    sizes = [len(one.y) * np.log(max(float(one.left @ one.left), TINY)) for one in found]
    return float(sum(sizes) + taken * float(np.log(count)))


@dataclass(frozen=True)
class _Value:
    """A delay of the log, or a number of a structure for the whole load, as an entry of a search.

    size: From which it is sought: a tenth of it is a small change.
    low, high: Smallest and largest value.
    parameter: Of the servo, which has no other value of it; empty: of the log.
    """

    size: float
    low: float = -np.inf
    high: float = np.inf
    parameter: str = ""
    signed: ClassVar[bool] = True
    expected: ClassVar[bool] = False
    linear: ClassVar[bool] = True

    def lowest(self, axis: AxisSignal) -> float:  # noqa: ARG002
        """Return the smallest amount."""
        return self.low

    def highest(self, axis: AxisSignal) -> float:  # noqa: ARG002
        """Return the largest amount."""
        return self.high

    def least(self, axis: AxisSignal) -> float:  # noqa: ARG002
        """Return the amount from which its size is sought."""
        return self.size

    def added(self, servo: Axis, axis: AxisSignal, amount: float) -> Axis:  # noqa: ARG002
        """Return the servo of an axis with the amount."""
        return varied(servo, {self.parameter: amount}) if self.parameter else servo


class _Search:
    """Effects of one axis taken in one after the other.

    ``log_delay_ms``: of the log, as it is known; None: it may be taken in like any other.
    """

    def __init__(
        self, axis: AxisSignal, inputs: Sequence[Floats], log_delay_ms: float | None = None
    ) -> None:
        self.axis = axis
        # What inputs can make of the readings is taken out of everything, through the nominal loop.
        columns = [axis.mean(axis.through_loop(one)) for one in inputs]
        if is_scaled(axis):  # a servo fitted to it would be of no machine
            columns.append(axis.mean(axis.commanded))
        size = (len(axis.blocks), len(columns))
        self.acted = np.linalg.qr(np.reshape(columns, size[::-1]).T)[0]
        self.held = frozenset({LOG_DELAY} if log_delay_ms else ())
        self.entries: dict[str, ServoEffect | _Value] = {**servo_effects(axis)}
        self.structure: frozenset[str] = frozenset()
        if log_delay_ms != 0.0:
            self.entries[LOG_DELAY] = _Value(10 * DELAY_STEP_MS)
        self.taken = list(self.held)
        self.dropped: set[str] = set()
        self.runs = len(axis.runs)
        self.y = self.rest(axis.mean(axis.units.scale * (axis.actual - axis.commanded)))
        self.run_of = axis.blocks.run_of[: len(axis.blocks)]
        self.at = np.concatenate([[log_delay_ms] * len(self.held), axis.begins.ravel()])
        self.left = self.left_at(self.at)
        self.take_in()

    def at_point(self, taken: Iterable[str], at: Floats) -> "_Search":
        """Return the search with these effects taken in, at a point."""
        new = copy(self)
        new.taken, new.at, new.dropped = list(taken), at, set(self.dropped)
        new.left = new.left_at(at)
        return new

    def left_at(self, point: Floats) -> Floats:
        """What is left of the readings at a point."""
        return np.asarray(self.y - self.predicted([point])[0])

    def nonlinear_part(self, *, expected: bool) -> "_Search":
        """Return the search with what leaves the loop no linear one: nothing imitates a structure.

        ``expected``: whether what is expected to be off is in, too, with nothing to begin with.
        """
        amounts = dict(zip(self.taken, self.at.tolist(), strict=False))
        for one in self.taken:
            entry = self.entries[one]
            if entry.expected and expected:
                amounts[one] = 0.0
            elif entry.linear and one not in self.held:
                amounts.pop(one)
        starts = self.axis.begins.ravel()
        return self.at_point(amounts, np.concatenate([list(amounts.values()), starts]))

    def best_structure(self, frequencies: Sequence[float]) -> tuple[float, float]:
        """Frequency and damping of the structure for the whole load that explains most."""
        places = [(f, d) for f in frequencies for d in DAMPINGS]
        here = self.servo(self.taken, self.at[: len(self.taken)])
        servos = [varied(here, {"resonance_hz": f, "damping": d}) for f, d in places]
        rise = self.rise(servos, [self.log_delay()] * len(servos))
        basis = np.linalg.qr(self.slopes())[0]
        rise = np.where(np.max(np.abs(rise), axis=0) <= MAX_CHANGE, rise, 0.0)
        rise = rise - basis @ (basis.T @ rise)
        gains = 2 * (self.left @ rise) - np.einsum("ij,ij->j", rise, rise)
        return places[int(np.argmax(gains))]

    def with_structure(self, place: tuple[float, float]) -> "_Search":
        """Return the search with a structure taken in, and what explains most beside it.

        ``place``: its frequency and damping to begin with.
        """
        name, top = f"resonance_{self.axis.letter.lower()}", BEYOND * top_hz(self.axis)
        structure: dict[str, ServoEffect | _Value] = {
            f"{name}_hz": _Value(0.2, LOWEST_HZ, top, "resonance_hz"),
            f"{name}_damping": _Value(0.01, MIN_DAMPING, MAX_DAMPING, "damping"),
        }
        bare = copy(self)
        bare.entries, bare.structure = self.entries | structure, frozenset(structure)
        new = bare.at_point([*self.taken, *structure], np.insert(self.at, len(self.taken), place))
        new.fit()
        new.take_in_more(new.fit())
        return new

    def exchanged(self) -> "_Search":
        """Return the best of this search and those with another effect in place of one.

        Of effects with which the loop is no linear one: the first that is taken in, beside what
        else is off, may be a friction where it is a play.
        """
        best = self
        taken, others = (
            [n for n, e in self.entries.items() if not e.linear and (n in self.taken) == taken]
            for taken in (True, False)
        )
        for old in taken:
            for other in others:
                entry, at = self.entries[other], self.at.copy()
                at[self.taken.index(old)] = min(entry.least(self.axis), entry.highest(self.axis))
                new = self.at_point([other if n == old else n for n in self.taken], at)
                new.dropped = {old}
                new.fit()
                best = min(best, new, key=lambda one: _cost([one]))
        return best

    def amounts(self) -> dict[str, float]:
        """Return what is taken in but a structure, id → amount."""
        every = zip(self.taken, self.at[: len(self.taken)].tolist(), strict=True)
        return {name: amount for name, amount in every if name not in self.structure}

    def structures(self) -> dict[str, float]:
        """Return frequency and damping of a structure if one is in: name → value."""
        every = zip(self.taken, self.at[: len(self.taken)].tolist(), strict=True)
        return {name: amount for name, amount in every if name in self.structure}

    def starts(self) -> Floats:
        """State at the start of each run, (runs, 2)."""
        return self.at[len(self.taken) :].reshape(self.runs, 2)

    def servo(self, names: Sequence[str], amounts: Floats) -> Axis:
        """Servo with these amounts."""
        servo = self.axis.nominal
        for name, amount in zip(names, amounts.tolist(), strict=True):
            servo = self.entries[name].added(servo, self.axis, amount)
        return servo

    def predicted(self, points: Sequence[Floats]) -> Floats:
        """Readings at some points, (points, blocks)."""
        k = len(self.taken)
        servos = [self.servo(self.taken, p[:k]) for p in points]
        starts = np.stack([p[k:].reshape(self.runs, 2) for p in points])
        delays = [self.log_delay(p) for p in points]
        return self.rest(self.axis.readings_of(servos, starts, delays))

    def log_delay(self, point: Floats | None = None) -> float:
        """Delay of the log at a point, by default the present one, ms."""
        at = self.at if point is None else point
        return float(at[self.taken.index(LOG_DELAY)]) if LOG_DELAY in self.taken else 0.0

    def rest(self, values: Floats) -> Floats:
        """Values (..., blocks) less what inputs can make of them."""
        return np.asarray(values - (values @ self.acted) @ self.acted.T)

    def step(self, name: str) -> float:
        """Step over which the response is differenced."""
        return 0.1 * self.entries[name].least(self.axis)

    def slopes(self) -> Floats:
        """Derivative at the present point, (blocks, parameters)."""
        k = len(self.taken)
        moved = [self.at.copy() for _ in range(k + 2)]
        for j, name in enumerate(self.taken):
            moved[j][j] += self.step(name)
        moved[k][k::2] += 0.1
        moved[k + 1][k + 1 :: 2] += 0.1
        rise = self.predicted(moved) - (self.y - self.left)
        out = np.zeros((len(self.y), len(self.at)))
        for j, name in enumerate(self.taken):
            if name not in self.held:
                out[:, j] = rise[j] / self.step(name)
        for i in range(2):
            of_run = np.arange(self.runs) == self.run_of[:, None]
            out[:, k + i :: 2] = np.where(of_run, rise[k + i][:, None] / 0.1, 0.0)
        return out

    def fit(self) -> Floats:
        """Least squares in all that is taken in; returns an orthonormal basis of the slopes."""
        for _ in range(MAX_STEPS):
            slopes = self.slopes()
            size = np.sqrt(np.einsum("ij,ij->j", slopes, slopes))
            unit = slopes / np.where(size > 0, size, 1.0)
            u, s, vt = np.linalg.svd(unit, full_matrices=False)
            kept = s > DEPENDENT**0.5 * s[0]
            along = u[:, kept].T @ self.left
            step = (vt[kept].T @ (along / s[kept])) / np.where(size > 0, size, 1.0)
            before = float(self.left @ self.left)
            if not self.moved(step) or before - float(self.left @ self.left) < SETTLED * before:
                break
        return np.asarray(u[:, kept])

    def moved(self, step: Floats) -> bool:
        """Go a step, or a part of it that leads down."""
        limits = [self.entries[n] for n in self.taken]
        low = [entry.lowest(self.axis) for entry in limits]
        high = [entry.highest(self.axis) for entry in limits]
        for _ in range(MAX_HALVINGS):
            new = self.at + step
            new[: len(low)] = np.clip(new[: len(low)], low, high)
            try:
                left = self.left_at(new)
            except InputError:  # no servo has such parameters
                left = np.full(len(self.y), np.inf)
            with np.errstate(over="ignore"):  # of a servo that runs away
                lower = np.all(np.isfinite(left)) and left @ left < self.left @ self.left
            if lower:
                self.at, self.left = new, left
                return True
            step = step / 2
        return False

    def take_in(self) -> None:
        """Take in what is expected to be off, then what explains most, as long as it is enough."""
        expected = [name for name, entry in self.entries.items() if entry.expected]
        self.at = np.insert(self.at, len(self.taken), np.zeros(len(expected)))
        self.taken += expected
        self.take_in_more(self.fit())

    def take_in_more(self, basis: Floats) -> None:
        """Take in what explains most of what is left; ``basis``: that of what is in."""
        while len(self.taken) < MAX_TAKEN and (name := self.best(basis)):
            self.at = np.insert(self.at, len(self.taken), 0.0)
            self.taken.append(name)
            basis = self.fit()
            if weak := self.weakest():
                self.drop(weak)
                basis = self.fit()

    def drop(self, name: str) -> None:
        """Leave an effect out again, and for good."""
        self.dropped.add(name)
        i = self.taken.index(name)
        self.at = np.delete(self.at, i)
        self.taken.pop(i)
        self.left = self.left_at(self.at)

    def weakest(self) -> str:
        """Effect without which too little more is left; an empty name if there is none."""
        slopes = self.slopes()
        size = np.sqrt(np.einsum("ij,ij->j", slopes, slopes))
        q, r = np.linalg.qr(slopes / np.where(size > 0, size, 1.0))
        left = self.left - q @ (q.T @ self.left)
        inverse = np.linalg.pinv(r)
        k = len(self.taken)
        values = (self.at * size)[:k]
        lost = values**2 / np.maximum(np.einsum("ij,ij->i", inverse, inverse)[:k], 1e-300)
        kept = self.held | self.structure
        lost[[self.entries[n].expected or n in kept for n in self.taken]] = np.inf
        i = int(np.argmin(lost))
        return self.taken[i] if lost[i] < MIN_SHARE * float(left @ left) else ""

    def best(self, basis: Floats) -> str:
        """Effect that explains most of what is left, if it is enough; else an empty name."""
        others = [n for n in self.entries if n not in self.taken and n not in self.dropped]
        if not others:
            return ""
        here, delay = self.servo(self.taken, self.at[: len(self.taken)]), self.log_delay()
        servos = [self.entries[n].added(here, self.axis, self.step(n)) for n in others]
        delays = [delay + (self.step(n) if n == LOG_DELAY else 0.0) for n in others]
        rise = self.rise(servos, delays)
        size = np.einsum("ij,ij->j", rise, rise)
        rise = rise - basis @ (basis.T @ rise)
        own = np.einsum("ij,ij->j", rise, rise)
        along = self.left @ rise
        along[(along < 0) & [not self.entries[n].signed for n in others]] = 0.0
        seen = own > DEPENDENT * size
        gain = np.where(seen, along**2 / np.where(seen, own, 1.0), 0.0)
        enough = gain.max(initial=0.0) > MIN_SHARE * float(self.left @ self.left)
        return others[int(np.argmax(gain))] if enough else ""

    def rise(self, servos: Sequence[Axis], delays_ms: Sequence[float]) -> Floats:
        """Change of the readings from the present point to other servos, (blocks, servos)."""
        starts = np.broadcast_to(self.starts(), (len(servos), self.runs, 2))
        readings = self.rest(self.axis.readings_of(servos, starts, delays_ms))
        return np.asarray((readings - (self.y - self.left)).T)

    def pull(self) -> Floats:
        """Inner products of the log's delay, beside all that is fitted: with what is left, its own.

        In the variance that is left.
        """
        slopes = self.slopes()
        at, delay_ms = self.at.copy(), self.step(LOG_DELAY)
        at[self.taken.index(LOG_DELAY)] += delay_ms
        rise = (self.predicted([at])[0] - (self.y - self.left)) / delay_ms
        own = rise - slopes @ np.linalg.lstsq(slopes, rise, rcond=DEPENDENT**0.5)[0]
        variance = max(float(self.left @ self.left) / len(self.y), TINY)
        return np.array([own @ self.left, own @ own]) / variance

    def hold(self, log_delay_ms: float) -> None:
        """Fit anew with another delay of the log."""
        self.at[self.taken.index(LOG_DELAY)] = log_delay_ms
        self.left = self.left_at(self.at)
        self.fit()

    def nonlinear(self) -> bool:
        """Whether chords, one an effect, are off by more than what is left."""
        k = len(self.taken)
        parts = [[name] for name in self.taken if name not in self.structure]
        parts += [list(self.structure)] if self.structure else []
        alone = np.zeros((len(parts) + 1, len(self.at)))
        alone[:, k:] = self.at[k:]
        for one, part in zip(alone, parts, strict=False):
            within = np.isin(self.taken, part)
            one[:k][within] = self.at[:k][within]
        *each, none = self.predicted(list(alone))
        off = (self.y - self.left) - none - sum(one - none for one in each)
        return bool(off @ off > NONLINEAR**2 * (self.left @ self.left))
