"""The point about which a log's effects are taken, where strong effects are in the servo model.

The response of an axis is not linear in its servo's parameters: a friction of 15 µm on a loop whose
gain is 20 % off is not the sum of both. So strong effects are fitted to each axis by exact
simulation, jointly and with the state at the start of each run, by least squares: the effect that
explains most is taken in, then all are fitted anew, while one explains `MIN_SHARE` of what is left.
The catalogue is then built about this point. Which effects are causes is not decided here.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.contouring.servo import Axis
from trunnion.models.axis_log.effects import is_scaled, servo_effects
from trunnion.models.axis_log.signals import AxisSignal

MIN_SHARE = 0.05  # of the variance left, that an effect explains to be taken in
MAX_TAKEN = 8
MAX_STEPS = 12
MAX_HALVINGS = 5
SETTLED = 1e-6  # of the variance left, by which a step still gains
DEPENDENT = 1e-6  # of a squared unit column
NONLINEAR = 1.0  # of the rms left, by which chords are off from the exact response


@dataclass(frozen=True)
class Point:
    """Where a log's model is linearised.

    effects: Id → amount, of servo effects that are in.
    starts: Letter → position (µm, arcsec) and speed (µm/ms) at the start of each run, (runs, 2).
    """

    effects: Mapping[str, float] = field(default_factory=dict)
    starts: Mapping[str, Floats] = field(default_factory=dict)


def near(axes: Iterable[AxisSignal], inputs: Iterable[Floats]) -> tuple[Point, bool]:
    """Return the point near a log, and whether sums of chords are not exact enough without it.

    ``inputs``: further columns of the log, (rows,) each, that may act on each axis.
    """
    effects: dict[str, float] = {}
    starts: dict[str, Floats] = {}
    far = False
    inputs = list(inputs)
    for axis in axes:
        found = _Search(axis, inputs)
        found.take_in()
        far = far or found.nonlinear()
        effects |= dict(zip(found.taken, found.at[: len(found.taken)].tolist(), strict=True))
        starts[axis.letter] = found.starts()
    return Point(effects, starts), far


class _Search:
    """Effects of one axis taken in one after the other."""

    def __init__(self, axis: AxisSignal, inputs: Sequence[Floats]) -> None:
        self.axis = axis
        # What inputs can make of the readings is taken out of everything, through the nominal loop.
        columns = [axis.mean(axis.through_loop(one)) for one in inputs]
        if is_scaled(axis):  # a servo fitted to it would be of no machine
            columns.append(axis.mean(axis.commanded))
        size = (len(axis.blocks), len(columns))
        self.acted = np.linalg.qr(np.reshape(columns, size[::-1]).T)[0]
        self.entries = servo_effects(axis)
        self.taken: list[str] = []
        self.dropped: set[str] = set()
        self.runs = len(axis.runs)
        self.y = self.rest(axis.mean(axis.units.scale * (axis.actual - axis.commanded)))
        self.run_of = axis.blocks.run_of[: len(axis.blocks)]
        self.at = np.zeros(2 * self.runs)
        self.left = self.y - self.predicted([self.at])[0]

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
        return self.rest(self.axis.readings_of(servos, starts))

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
        low = [self.entries[n].lowest(self.axis) for n in self.taken]
        for _ in range(MAX_HALVINGS):
            new = self.at + step
            new[: len(low)] = np.maximum(new[: len(low)], low)
            try:
                left = self.y - self.predicted([new])[0]
            except InputError:  # no servo has such parameters
                left = np.full(len(self.y), np.inf)
            if np.all(np.isfinite(left)) and left @ left < self.left @ self.left:
                self.at, self.left = new, left
                return True
            step = step / 2
        return False

    def take_in(self) -> None:
        """Take in what is expected to be off, then what explains most, as long as it is enough."""
        self.taken = [name for name, entry in self.entries.items() if entry.expected]
        self.at = np.insert(self.at, 0, np.zeros(len(self.taken)))
        basis = self.fit()
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
        self.left = self.y - self.predicted([self.at])[0]

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
        lost[[self.entries[n].expected for n in self.taken]] = np.inf
        i = int(np.argmin(lost))
        return self.taken[i] if lost[i] < MIN_SHARE * float(left @ left) else ""

    def best(self, basis: Floats) -> str:
        """Effect that explains most of what is left, if it is enough; else an empty name."""
        others = [n for n in self.entries if n not in self.taken and n not in self.dropped]
        if not others:
            return ""
        here = self.servo(self.taken, self.at[: len(self.taken)])
        servos = [self.entries[n].added(here, self.axis, self.step(n)) for n in others]
        starts = np.broadcast_to(self.starts(), (len(others), self.runs, 2))
        rise = (self.rest(self.axis.readings_of(servos, starts)) - (self.y - self.left)).T
        size = np.einsum("ij,ij->j", rise, rise)
        rise = rise - basis @ (basis.T @ rise)
        own = np.einsum("ij,ij->j", rise, rise)
        along = self.left @ rise
        along[(along < 0) & [not self.entries[n].signed for n in others]] = 0.0
        seen = own > DEPENDENT * size
        gain = np.where(seen, along**2 / np.where(seen, own, 1.0), 0.0)
        enough = gain.max(initial=0.0) > MIN_SHARE * float(self.left @ self.left)
        return others[int(np.argmax(gain))] if enough else ""

    def nonlinear(self) -> bool:
        """Whether chords, one an effect, are off by more than what is left."""
        k = len(self.taken)
        alone = np.zeros((k + 1, len(self.at)))
        alone[:, k:] = self.at[k:]
        alone[np.arange(k), np.arange(k)] = self.at[:k]
        each = self.predicted(list(alone))
        off = (self.y - self.left) - each[k] - (each[:k] - each[k]).sum(axis=0)
        return bool(off @ off > NONLINEAR**2 * (self.left @ self.left))
