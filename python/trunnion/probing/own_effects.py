"""Least squares of touches with effects of the user's own: the core's model, the one linear solver.

The core gives residuals and exact derivatives of its own parameters; those of a user's effect come
from its `jacobian`, else from differences of its `change`. What is not identifiable is decided at
the start, as in the core: one parameter of each such combination is held there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trunnion._core import Moves
from trunnion.base.errors import DataError
from trunnion.base.statistics import NORMAL_MEDIAN, LinearFit, linear_fit
from trunnion.base.units import Floats
from trunnion.data.touches import Touches
from trunnion.machine.effects import UserEffect, own_call, own_numbers
from trunnion.probing.inputs import on_machine
from trunnion.probing.model import TouchModel, rounding_um

CLOSE_UM = 1e-6
"""A step that moves no reading further ends the search."""
MAX_HALVINGS = 12


@dataclass(frozen=True)
class Loss:
    """What is minimised.

    knee: Of Huber's loss in standard deviations; None: squares.
    sigma_um: Standard deviation of a reading if known, else 0.
    priors: Parameter's number, value, standard uncertainty.
    """

    knee: float | None
    sigma_um: float
    priors: Sequence[tuple[int, float, float]] = ()


@dataclass(frozen=True)
class Found:
    """Estimates in the order of a problem's names; what is not identifiable has no error.

    `combinations`: rows of components that change no reading, (k, p).
    """

    values: Floats
    std_errors: Floats
    covariance: Floats
    combinations: Floats
    residuals_um: Floats
    weights: Floats
    sigma_um: float
    degrees_of_freedom: int
    converged: bool


def own_names(model: TouchModel, own: Sequence[UserEffect]) -> tuple[str, ...]:
    """Names of all parameters: the model's, then those of the user's effects."""
    return (*model.names, *(f"{e.id}.{name}" for e in own for name in e.parameters))


class TouchProblem:
    """Touches with effects of the catalogue (in the model) and of the user's own."""

    def __init__(
        self, model: TouchModel, data: Touches, moves: Moves, own: Sequence[UserEffect]
    ) -> None:
        self.model, self.data, self.moves, self.own = model, data, moves, tuple(own)
        self.acting = {e.id: on_machine(e, model, data, model.values()) for e in own}
        self.built_in = len(model.names)
        self.names = own_names(model, own)
        # A moment is searched by the core; the derivative by it is nothing.
        self.moments = np.array([k == "moment" for k in model.kinds] + [False] * self._own_count)
        known = np.append(~model.unknown, np.zeros(self._own_count, dtype=bool))
        self.held = self.moments | known
        unknowns = int(np.sum(~known))
        if len(data) < unknowns:
            raise DataError(
                f"got {len(data)} touches for {unknowns} parameters, expected at least as many"
            )

    @property
    def _own_count(self) -> int:
        return sum(len(effect.parameters) for effect in self.own)

    def own_values(self, vector: Floats) -> list[dict[str, float]]:
        """Values of the user's effects, one dict each."""
        found, first = [], self.built_in
        for effect in self.own:
            part = vector[first : first + len(effect.parameters)]
            found.append(dict(zip(effect.parameters, map(float, part), strict=True)))
            first += len(effect.parameters)
        return found

    def residuals(self, vector: Floats) -> Floats:
        """Recorded less modelled coordinate along the approach, µm, (n,)."""
        left = self.model.core.residuals(self.moves, vector[: self.built_in])
        for effect, values in zip(self.own, self.own_values(vector), strict=True):
            left = left - self._change(effect, values)
        return np.asarray(left)

    def jacobian(self, vector: Floats) -> Floats:
        """Derivative of the modelled coordinate by all parameters, (n, p)."""
        _, exact = self.model.core.linearise(self.moves, vector[: self.built_in])
        pairs = zip(self.own, self.own_values(vector), strict=True)
        return np.hstack([exact, *(self._columns(e, values) for e, values in pairs)])

    def _change(self, effect: UserEffect, values: Mapping[str, float]) -> Floats:
        """Change of each reading by a user's effect, (n,)."""
        change = self.acting[effect.id].change
        found = own_call(effect, "change", change, self.data, dict(values))
        return own_numbers(effect.id, "change", found, (len(self.data),))

    def _columns(self, effect: UserEffect, values: Mapping[str, float]) -> Floats:
        """Derivative of a user's effect by its parameters, (n, k): its own, or by differences."""
        shape = (len(self.data), len(effect.parameters))
        given = getattr(self.acting[effect.id], "jacobian", None)
        if given is not None:
            found = own_call(effect, "jacobian", given, self.data, dict(values))
            return own_numbers(effect.id, "jacobian", found, shape)
        columns = np.empty(shape)
        for k, name in enumerate(effect.parameters):
            step = 1e-4 * max(1.0, abs(values[name]))
            ahead, back = (
                self._change(effect, {**values, name: values[name] + s}) for s in (step, -step)
            )
            columns[:, k] = (ahead - back) / (2 * step)
        return columns

    def _start(self, loss: Loss, max_steps: int) -> Floats:
        """Known errors; nonlinear parameters where the core finds them without the own effects."""
        start = self.model.values()
        if any(kind != "linear" for kind in self.model.kinds):
            start = self.model.core.fit(
                self.moves,
                start,
                huber=loss.knee,
                sigma_um=loss.sigma_um,
                priors=[],
                max_steps=max_steps,
            )["values"]
        return np.concatenate([start, np.zeros(self._own_count)])

    def fit(self, loss: Loss, max_steps: int) -> Found:
        """Gauss-Newton; a step is halved until it fits no worse."""
        x = self._start(loss, max_steps)
        left = self.residuals(x)
        weights = np.ones(len(left))
        first = self._solve(x, left, weights, loss, self.held)
        held, last, converged = first.held, first, False
        for _ in range(max_steps):
            last = self._solve(x, left, weights, loss, held)
            moved = self.jacobian(x) @ last.solution
            x, left = self._step(x, left, last.solution, weights, loss)
            before, weights = weights, _weights(left, loss.knee)
            if np.abs(moved).max() < CLOSE_UM and np.abs(weights - before).max() < CLOSE_UM:
                converged = True
                break
        last = self._solve(x, left, weights, loss, held)
        rows = len(left) + len(loss.priors)
        freedom = max(rows - last.rank - int(self.moments.sum()), 0)
        sigma = loss.sigma_um or float(np.sqrt(np.sum(weights * left**2) / max(freedom, 1)))
        sigma = max(sigma, rounding_um(self.model.setup, self.data))
        spread = sigma * np.sqrt(np.diag(last.cofactor))
        return Found(
            values=x,
            std_errors=np.where(first.not_identifiable, np.inf, spread),
            covariance=sigma**2 * last.cofactor,
            combinations=first.combinations,
            residuals_um=left,
            weights=weights,
            sigma_um=sigma,
            degrees_of_freedom=freedom,
            converged=converged,
        )

    def _solve(
        self, x: Floats, left: Floats, weights: Floats, loss: Loss, held: np.ndarray
    ) -> LinearFit:
        root = np.sqrt(weights)
        columns, right = self.jacobian(x) * root[:, None], left * root
        for k, value, uncertainty in loss.priors:
            row = np.zeros((1, len(x)))
            row[0, k] = loss.sigma_um / uncertainty
            columns = np.vstack([columns, row])
            right = np.append(right, row[0, k] * (value - x[k]))
        return linear_fit(columns, right, hold=held)

    def _cost(self, x: Floats, left: Floats, weights: Floats, loss: Loss) -> float:
        known = sum((loss.sigma_um / u * (value - x[k])) ** 2 for k, value, u in loss.priors)
        return float(np.sum(weights * left**2) + known)

    def _step(
        self, x: Floats, left: Floats, step: Floats, weights: Floats, loss: Loss
    ) -> tuple[Floats, Floats]:
        bound = self._cost(x, left, weights, loss) * (1 + 1e-9) + CLOSE_UM**2
        share = 1.0
        for _ in range(MAX_HALVINGS):
            try:
                there = self.residuals(x + share * step)
            except DataError:  # a touch left the modelled artefact
                share /= 2
                continue
            if self._cost(x + share * step, there, weights, loss) <= bound:
                return x + share * step, there
            share /= 2
        return x, left


def _weights(left: Floats, knee: float | None) -> Floats:
    """Weights of Huber's loss by the median absolute deviation; 1 for squares."""
    if knee is None:
        return np.ones(len(left))
    size = np.abs(left)
    limit = knee * float(np.sort(size)[len(size) // 2]) / NORMAL_MEDIAN
    return np.where(size <= limit, 1.0, limit / np.maximum(size, 1e-300))
