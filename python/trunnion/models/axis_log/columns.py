"""Columns of effects on axis logs: at which values they are taken, and in which readings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trunnion.base.errors import InputError
from trunnion.diagnosis.protocol import Array, Effect, Parameter
from trunnion.models.axis_log.signals import AxisSignal, Blocks, ToolTip

__all__ = ["Columns", "Gridded", "Places", "Signals", "bound_to_readings"]

MAX_CHORD_STEPS = 4


@dataclass(frozen=True, eq=False)
class Signals:
    """What the effects of a log are made of: its axes, its tool tip if there is one, its blocks."""

    axes: tuple[AxisSignal, ...]
    tip: ToolTip | None
    blocks: Blocks


class Places:
    """Values at which the effects' columns are taken: those given, else where each fits best alone.

    Parameters
    ----------
    design:
        What initial states may change in the readings, shape (n, p).
    readings:
        Shape (n,).
    given:
        Name → value, of another log; they are not sought anew.

    Attributes
    ----------
    found:
        Name → value, in the end of all.
    """

    def __init__(self, design: Array, readings: Array, given: Mapping[str, float]) -> None:
        self.found = dict(given)
        self._design = design
        self._readings = readings
        self._basis = np.linalg.qr(design)[0]

    def chord(
        self, name: str, start: float, change: Callable[[float], Array], *, signed: bool = True
    ) -> Array:
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

    def unexplained(self, rows: slice) -> tuple[Callable[[Array], Array], Array]:
        """Of some readings: what initial states leave of columns (m, k), and of the readings."""
        design = self._design[rows]
        q, _ = np.linalg.qr(design[:, np.any(design != 0, axis=0)])

        def left(values: Array) -> Array:
            return np.asarray(values - q @ (q.T @ values))

        return left, left(self._readings[rows])


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns (m, k) of some readings as columns (n, k) of all of them."""

    blocks: Blocks
    rows: slice
    values: Array

    def __call__(self, _data: Any) -> Array:
        """Return the columns in their place."""
        return self.blocks.place(self.rows, self.values)


@dataclass(frozen=True, eq=False)
class Gridded:
    """Effect linear in some parameters, whose columns (n, k) depend on the others.

    The derivative by a nonlinear parameter is differenced over 1e-4 of it (relative error 1e-8 of
    the curvature): the response is a simulation.
    """

    parameters: tuple[Parameter, ...]
    columns: Callable[[Mapping[str, float]], Array]

    @property
    def linear(self) -> list[str]:
        """Names of the linear parameters, in the order of the columns."""
        return [p.name for p in self.parameters if p.linear]

    def change(self, _data: Any, values: Mapping[str, float]) -> Array:
        """Change of the readings, shape (n,)."""
        return np.asarray(self.columns(values) @ np.array([values[p] for p in self.linear]))

    def jacobian(self, data: Any, values: Mapping[str, float]) -> Array:
        """Derivative by each parameter, shape (n, parameters)."""
        own = self.columns(values)
        out = np.zeros((len(own), len(self.parameters)))
        there = any(values[name] for name in self.linear)
        for j, p in enumerate(self.parameters):
            if p.linear:
                out[:, j] = own[:, self.linear.index(p.name)]
            elif there:
                step = 1e-4 * abs(values[p.name])
                up = self.change(data, {**values, p.name: values[p.name] + step})
                down = self.change(data, {**values, p.name: values[p.name] - step})
                out[:, j] = (up - down) / (2 * step)
        return out

    def effect(self, id_: str, label: str) -> Effect:
        """Return the effect."""
        return Effect(id_, self.parameters, self.change, self.jacobian, words=label)


@dataclass(frozen=True, eq=False)
class OwnChange:
    """A user's effect, by row and axis of the log in µm or arcsec, as a change of readings."""

    effect: Effect
    axes: int
    blocks: Blocks

    def __call__(self, data: Any, values: Mapping[str, float]) -> Array:
        """Return the change of the readings, shape (n,)."""
        raw = np.asarray(self.effect.change(data, values), dtype=np.float64)
        expected = (len(data), self.axes)
        if raw.shape != expected:
            raise InputError(
                f"effect {self.effect.id}: change: got shape {raw.shape}, expected {expected}: "
                "every row and axis, µm or arcsec"
            )
        return self.blocks.place(self.blocks.rows(0, self.axes), self.blocks.mean(raw).T.ravel())


def bound_to_readings(effect: Effect, signals: Signals) -> Effect:
    """Bring a user's effect, by row and axis, to readings."""
    change = OwnChange(effect, len(signals.axes), signals.blocks)
    return replace(effect, change=change, jacobian=None)
