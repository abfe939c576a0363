"""Columns of effects on axis logs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.diagnosis.effect import Effect
from trunnion.models.axis_log.signals import AxisSignal, Blocks, ToolTip

MAX_CHORD_STEPS = 4


@dataclass(frozen=True, eq=False)
class Signals:
    """What the effects of a log are made of: its axes, its tool tip if there is one, its blocks."""

    axes: tuple[AxisSignal, ...]
    tip: ToolTip | None
    blocks: Blocks


class Places:
    """Values at which the effects' columns are taken: those given, else where each fits best alone.

    design: What initial states may change in the readings, shape (n, p).
    readings: Shape (n,).
    given: Name → value, of another log; they are not sought anew.
    about: Id → value, of effects that are in what the readings are compared with: their columns are
        slopes there.

    found: Name → value, in the end of all.
    """

    def __init__(
        self,
        design: Floats,
        readings: Floats,
        given: Mapping[str, float],
        about: Mapping[str, float] | None = None,
    ) -> None:
        self.found = dict(given)
        self.about = dict(about or {})
        self._design = design
        self._readings = readings
        self._basis = np.linalg.qr(design)[0]

    def chord(
        self, name: str, start: float, change: Callable[[float], Floats], *, signed: bool = True
    ) -> Floats:
        """Column of an effect: its exact change over its parameter, where it alone fits best.

        Secant steps from ``start``. ``change(value)``: change of the readings, shape (n,).
        ``signed``: whether the parameter can be negative; if not, the chord is that of its size.
        """
        given = self.found.get(name)
        value = start if given is None else given
        q = self._basis
        y = self._readings - q @ (q.T @ self._readings)
        column = change(value) / value
        for _ in range(0 if given is not None else MAX_CHORD_STEPS):
            seen = column - q @ (q.T @ column)
            size = float(seen @ seen)
            if size <= 1e-18 * len(seen):
                break
            best = float(y @ seen) / size
            best = best if signed else abs(best)
            low, high = 0.02 * abs(start), 50.0 * abs(start)
            next_value = float(np.copysign(np.clip(abs(best), low, high), best if best else start))
            if abs(next_value - value) <= 1e-3 * abs(value):
                break
            value = next_value
            column = change(value) / value
        self.found[name] = value
        return column

    def unexplained(self, rows: slice) -> tuple[Callable[[Floats], Floats], Floats]:
        """Of some readings: what initial states leave of columns (m, k), and of the readings."""
        design = self._design[rows]
        q, _ = np.linalg.qr(design[:, np.any(design != 0, axis=0)])

        def left(values: Floats) -> Floats:
            return np.asarray(values - q @ (q.T @ values))

        return left, left(self._readings[rows])


@dataclass(frozen=True, eq=False)
class OwnChange:
    """A user's effect, by row and axis of the log in µm or arcsec, as a change of readings."""

    effect: Effect
    shape: tuple[int, int]
    blocks: Blocks

    def __call__(self, values: Mapping[str, float]) -> Floats:
        """Return the change of the readings, shape (n,)."""
        raw = np.asarray(self.effect.change(values), dtype=np.float64)
        if raw.shape != self.shape:
            raise InputError(
                f"effect {self.effect.id}: change: got shape {raw.shape}, expected {self.shape}: "
                "every row and axis, µm or arcsec"
            )
        return self.blocks.place(
            self.blocks.rows(0, self.shape[1]), self.blocks.mean(raw).T.ravel()
        )


def on_readings(effect: Effect, rows: int, signals: Signals) -> Effect:
    """Bring a user's effect, by row and axis of a log, to readings."""
    change = OwnChange(effect, (rows, len(signals.axes)), signals.blocks)
    return replace(effect, change=change, jacobian=None)
