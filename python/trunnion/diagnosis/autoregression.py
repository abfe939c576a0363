"""Autoregressions: noise that remembers, and the linear map that makes it white."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trunnion.base.units import Floats as Array


@dataclass(frozen=True)
class Autoregression:
    """Autoregressive noise.

    Attributes
    ----------
    predictors:
        ``predictors[k]``: coefficients that predict a reading from the k before it, last first.
    sizes:
        ``sizes[k]``: standard deviation of what is left then. The last pair holds from there on.
    """

    predictors: tuple[Array, ...] = (np.zeros(0),)
    sizes: tuple[float, ...] = (1.0,)

    @property
    def order(self) -> int:
        """How many readings back the noise remembers; 0: white."""
        return len(self.predictors) - 1

    def whiten(self, values: Array) -> Array:
        """Innovations of (n, m) consecutive values in units of their size."""
        order = min(self.order, len(values))
        out = np.empty(values.shape)
        out[:order] = self._first[:order, :order] @ values[:order]
        if len(values) > order:
            out[order:] = predicted_off(values, self.predictors[-1], order) / self.sizes[-1]
        return out

    @cached_property
    def _first(self) -> Array:
        """Matrix that whitens the first readings, from which less is known than later."""
        out = np.eye(self.order)
        for i, ar in enumerate(self.predictors[: self.order]):
            out[i, :i] = -ar[::-1]
        return np.asarray(out / np.array(self.sizes[: self.order])[:, None])

    def log_size(self, count: int) -> float:
        """Sum of the logarithms of the sizes of so many consecutive innovations."""
        logs = np.log(self.sizes[: min(count, len(self.sizes))])
        return float(np.sum(logs)) + (count - len(logs)) * float(np.log(self.sizes[-1]))


def levinson(partial: Array) -> tuple[Array, ...]:
    """Coefficients of every order from 0 up, from partial autocorrelations."""
    out: list[Array] = [np.zeros(0)]
    for r in partial:
        out.append(np.append(out[-1] - r * out[-1][::-1], r))
    return tuple(out)


def partial_autocorrelations(ar: Array) -> Array:
    """Partial autocorrelations of an autoregression; of an unstable one, those to where it is."""
    out, a = np.zeros(len(ar)), np.asarray(ar, dtype=np.float64)
    for k in range(len(ar) - 1, -1, -1):
        out[k] = a[k]
        a = (a[:k] + a[k] * a[:k][::-1]) / max(1.0 - a[k] ** 2, 1e-6)
    return out


def predicted_off(values: Array, ar: Array, first: int) -> Array:
    """Values (n, m) from row ``first`` on, less what an autoregression predicts."""
    out = np.array(values[first:], dtype=np.float64)
    for k, a in enumerate(ar, start=1):
        out -= a * values[first - k : len(values) - k]
    return out


def of_covariances(covariances: Array) -> Autoregression:
    """Autoregression of the order of the last of these autocovariances, from lag 0 on.

    Normal noise of just these autocovariances (recursion of Levinson and Durbin).
    """
    predictors, left = [np.zeros(0)], float(covariances[0])
    sizes = [left**0.5]
    for k in range(1, len(covariances)):
        a = predictors[-1]
        r = (float(covariances[k]) - float(a @ covariances[k - 1 : 0 : -1])) / left
        predictors.append(np.append(a - r * a[::-1], r))
        left *= 1.0 - r * r
        sizes.append(left**0.5)
    return Autoregression(tuple(predictors), tuple(sizes))
