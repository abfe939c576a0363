"""Making the noise of readings white, of one size."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from trunnion.base.rows import seen_of
from trunnion.base.units import Floats, Integers

SEEN = 1e-6  # of a squared combination, what is left of it without some readings

Whiten: TypeAlias = Callable[[NDArray[Any]], NDArray[Any]]


def identity(columns: Floats) -> Floats:
    """Whiten noise that is white already."""
    return columns


@dataclass(frozen=True, eq=False)
class Scaling:
    """Whiten readings of different noise: divide each by its own, ``scale`` (n,)."""

    scale: Floats

    def __call__(self, columns: Floats) -> Floats:
        """Divide columns (n, ...)."""
        return columns / self.scale.reshape(-1, *(1,) * (columns.ndim - 1))


@dataclass(frozen=True, eq=False)
class Scaled:
    """A whitener, then readings of size 1: what it leaves, divided by ``size``."""

    whiten: Whiten
    size: float

    def __call__(self, columns: Floats) -> Floats:
        """Whiten columns (n, ...)."""
        return np.asarray(self.whiten(columns)) / self.size


@dataclass(frozen=True, eq=False)
class Whiteners:
    """Whiten the readings of each part by its own.

    Attributes
    ----------
    parts:
        Readings and whitener of each.
    known:
        Whether white noise is of size 1 for sure. If so, what is left says nothing of it.
    apart:
        Parts of which more is left than noise: it says nothing of the noise of others.
    """

    parts: tuple[tuple[slice, Whiten], ...]
    known: bool = False
    apart: tuple[slice, ...] = ()

    def __call__(self, columns: Floats) -> Floats:
        """Whiten columns (n, ...)."""
        if self._scale is not None:
            return self._scale(columns)
        white = np.zeros_like(columns, dtype=np.float64)
        for at, whiten in self.parts:
            own = columns[at]
            seen = seen_of(own)  # what is one measurement's own is zero in all others
            if np.all(seen):
                white[at] = whiten(own)
            elif np.any(seen):
                white[at, seen] = whiten(own[:, seen])
        return white

    @cached_property
    def _scale(self) -> Scaling | None:
        """The whitener of all parts, if each only divides its readings."""
        sizes = sizes_of(self, max((at.stop for at, _ in self.parts), default=0))
        return Scaling(sizes) if sizes is not None and np.all(np.isfinite(sizes)) else None


def within(whiten: Whiten, rows: Integers) -> Whiten | None:
    """Whitener of all readings of one of several measurements, by their rows; None: of no such."""
    for at, own in whiten.parts if isinstance(whiten, Whiteners) else ():
        if len(rows) == at.stop - at.start and (rows[0], rows[-1]) == (at.start, at.stop - 1):
            return own
    return None


def sizes_of(whiten: Whiten, n: int) -> Floats | None:
    """By what a whitener divides each of n readings; None: it does more than that.

    NaN in the parts of several measurements where that is so.
    """
    if whiten is identity:
        return np.ones(n)
    if isinstance(whiten, Scaling):
        return whiten.scale
    if isinstance(whiten, Scaled):
        own = sizes_of(whiten.whiten, n)
        return None if own is None else own * whiten.size
    if not isinstance(whiten, Whiteners):
        return None
    sizes = np.full(n, np.nan)
    for at, part in whiten.parts:
        own = sizes_of(part, at.stop - at.start)
        if own is not None:
            sizes[at] = own
    return sizes


@dataclass(frozen=True, eq=False)
class Coloured:
    """Whiten noise of which some combinations of readings have more than a reading has.

    Attributes
    ----------
    basis:
        The combinations, orthonormal, shape (n, k).
    more:
        Covariance that they have beside that of white noise of variance 1, shape (k, k).
    """

    basis: Floats
    more: Floats

    @cached_property
    def _change(self) -> Floats:
        w, u = np.linalg.eigh(self.more)
        return np.asarray((u * (1.0 / np.sqrt(1.0 + np.maximum(w, 0.0)) - 1.0)) @ u.T)

    def __call__(self, columns: Floats) -> Floats:
        """Whiten columns (n, ...)."""
        flat = np.asarray(columns, dtype=np.float64).reshape(len(columns), -1)
        return np.asarray(flat + self.basis @ (self._change @ (self.basis.T @ flat))).reshape(
            columns.shape
        )


@dataclass(frozen=True, eq=False)
class Correlated(Coloured):
    """Whiten noise of neighbours that err alike.

    Smooth errors of no known form make combinations that are smooth themselves (a scale, a bow)
    uncertain. What is left beside these is taken as white: structure is looked for in it.

    Attributes
    ----------
    note:
        What is said of it.
    groups:
        Group of each reading for cross-validation, shape (n,).
    cause:
        Id of an effect without a name that was found and makes them; empty: none was.
    parameters:
        Of this noise, where it is that of all readings and competes with white noise; 0: of
        combinations only, and it is there.
    """

    note: str
    groups: Integers
    cause: str = ""
    parameters: int = 0

    def shared(self, residuals: Floats) -> Floats:
        """Return what is expected to be theirs in residuals, shape (n,)."""
        noise = np.linalg.inv(self.more + np.eye(len(self.more)))
        part = self.basis.T @ residuals
        return np.asarray(self.basis @ (part - noise @ part))

    def without(self, rows: Integers) -> "Correlated":
        """Return the noise of the other readings, on which these do not act."""
        kept = self.basis.copy()
        kept[rows] = 0.0
        w, u = np.linalg.eigh(kept.T @ kept)
        turn = u[:, w > SEEN] / np.sqrt(w[w > SEEN])
        return replace(self, basis=kept @ turn, more=turn.T @ self.more @ turn)


def correlated(whiten: Whiten) -> Correlated | None:
    """Return the noise that a whitener is made for where readings share some of it; else None."""
    return whiten if isinstance(whiten, Correlated) else None
