"""Sensors of an R-test that are turned, or of unlike gain, as effects on its readings.

What they read is a product: gains times a rotation times what location errors make. Effects are
linear; these are so about the turn that fits best, where a turn of it is exact: cos 3° is no gain
of −0.14 %.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.statistics import linear_fit
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.effect import Effect, linear
from trunnion.machine.effects import Owner
from trunnion.probing.rotary_acting import SENSORS, cross_with, sensors_of

TURN, GAIN = SENSORS
MAX_STEPS = 10
SMALL = 1e-6
"""Last step of the fit, degrees and percent."""
USUAL = 5.0
"""Degrees and percent, 1 sigma: what readings do not determine stays next to none."""
MAX_TURN_DEG = 20.0
"""Sensors that are turned by more were mounted another way, and no fit is near."""
MAX_ROWS = 3000
MAX_GAIN_PERCENT = 40.0
DEPENDENT = 1e-9
SHARE, BETTER = 0.1, 0.5
"""Of the rms that the plain model, and all linear candidates at once, leave: what the plain model
leaves at most of readings of which one counts the other way."""
MIN_FREEDOM = 5


@dataclass(frozen=True, eq=False)
class Sensors:
    """What an R-test read, and what explains it.

    Attributes
    ----------
    read_um
        Readings, (n, 3).
    modelled_um
        Those of the machine of the set-up.
    derivatives
        By what is always fitted, (n, 3, unknowns).
    """

    read_um: Floats
    modelled_um: Floats
    derivatives: Floats

    @classmethod
    def of(cls, read_um: Floats, modelled_um: Floats, derivatives: Floats) -> Sensors:
        """Take derivatives as (3 n, unknowns)."""
        return cls(read_um, modelled_um, derivatives.reshape(*read_um.shape, -1))

    def effects(self) -> Iterator[Effect]:
        """Yield turn and gain: of what location errors make of the readings beside both."""
        turn, unknown = self._fitted()
        before = self.modelled_um + self.derivatives @ unknown
        between, after = before @ _mean_turn(turn).T, before @ sensors_of(TURN, turn).T
        made = {
            TURN: [between @ cross_with(row).T for row in np.radians(np.eye(3))],
            GAIN: [after @ way.T for way in _GAINS],
        }
        for name, (parameters, label) in SENSORS.items():
            found = np.column_stack([column.reshape(-1) for column in made[name]])
            yield linear(name, parameters, found, label, owner=Owner.INSTRUMENT)

    def _fitted(self) -> tuple[Floats, Floats]:
        """Turn (deg), and the unknowns of the plain model, as they fit best beside a gain."""
        some = self._some(self._rows())
        count = self.derivatives.shape[2]
        x = np.zeros(5 + count)
        for _ in range(MAX_STEPS):
            step = some._step(x)
            x = x + step
            if np.max(np.abs(step[:5])) < SMALL:
                break
        if np.linalg.norm(x[:3]) > MAX_TURN_DEG or np.abs(x[3:5]).max() > MAX_GAIN_PERCENT:
            x = np.append(np.zeros(5), some._step(np.zeros(5 + count), plain=True)[5:])
        return x[:3], x[5:]

    def _step(self, x: Floats, *, plain: bool = False) -> Floats:
        """Change of turn, gain and unknowns that fits best, by derivatives here.

        plain: Of the unknowns alone.
        """
        turn, gained = sensors_of(TURN, x[:3]), sensors_of(GAIN, x[3:5])
        before = self.modelled_um + self.derivatives @ x[5:]
        left = (self.read_um - before @ (gained @ turn).T).ravel()
        turned = before @ turn.T
        ways = [gained @ cross_with(row) for row in (_mean_turn(x[:3]) @ np.radians(np.eye(3))).T]
        own = np.stack([turned @ way.T for way in (*ways, *_GAINS)], axis=2)
        moved = np.einsum("ij,njk->nik", gained @ turn, self.derivatives)
        columns = np.concatenate([own * (not plain), moved], axis=2).reshape(len(left), -1)
        usual = np.zeros((5, columns.shape[1]))
        weight = np.sqrt(left @ left / len(left)) / USUAL
        usual[:, :5] = weight * np.eye(5)
        columns = np.vstack([columns, usual])
        size = np.linalg.norm(columns, axis=0)
        size[size == 0.0] = 1.0
        values = np.append(left, -weight * x[:5])
        return np.asarray(np.linalg.lstsq(columns / size, values, rcond=DEPENDENT)[0] / size)

    def mirrored(self, effects: Sequence[Effect]) -> bool:
        """Whether one reading counts the other way against the others, as no candidates make it.

        So does a nest that is turned by 180°, but for the sign of all three. effects: Candidates;
        turns and gains of hundreds of percent, that make it of a scale, are none.
        """
        rows = self._rows()
        readings = (3 * rows[:, None] + np.arange(3)).ravel()
        some = self._some(rows)
        plain = some.derivatives.reshape(len(readings), -1)
        off = (some.read_um * _ONE_MIRRORED - some.modelled_um).reshape(3, -1)
        least = min(_left(plain, one) for one in off)
        given = (some.read_um - some.modelled_um).ravel()
        if not least <= SHARE * _left(plain, given):
            return False
        others = [e for e in effects if e.linear and e.id not in SENSORS]
        every = [plain, *(e.columns(e.values([0.0] * len(e.parameters)))[readings] for e in others)]
        return least <= BETTER * _left(np.hstack(every), given)

    def _some(self, rows: Integers) -> Sensors:
        """Take some rows."""
        return Sensors(self.read_um[rows], self.modelled_um[rows], self.derivatives[rows])

    def _rows(self) -> Integers:
        """Return some of many rows, in order: they say well enough how sensors are mounted."""
        return np.sort(np.random.default_rng(0).permutation(len(self.read_um))[:MAX_ROWS])


_ONE_MIRRORED = (1.0 - 2.0 * np.eye(3))[:, None, :]
"""Signs of X, Y and Z, three times: of both others it is the same, all errors of the other sign."""
_GAINS = tuple(sensors_of(GAIN, one) - np.eye(3) for one in np.eye(2))


def _left(columns: Floats, values: Floats) -> float:
    """Rms that columns leave of values, by what is free; infinite where hardly anything is."""
    found = linear_fit(columns, values, tolerance=DEPENDENT)
    free = len(values) - found.rank
    left = values - columns @ found.solution
    return float(np.sqrt(left @ left / free)) if free >= MIN_FREEDOM else np.inf


def _mean_turn(degrees: ArrayLike) -> Floats:
    """Mean of the rotations from none to this one, G: [turn]× G is the rotation less one."""
    turn = np.radians(np.asarray(degrees, dtype=np.float64))
    angle, about = float(np.linalg.norm(turn)), cross_with(turn)
    once = np.sinc(angle / (2.0 * np.pi)) ** 2 / 2.0
    twice = (angle - np.sin(angle)) / angle**3 if angle > 1e-2 else 1.0 / 6.0 - angle**2 / 120.0
    return np.asarray(np.eye(3) + once * about + twice * about @ about)
