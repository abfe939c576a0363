"""Places that targets mean, where the targets are what a control read back and scatter."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trunnion.base.units import Floats, Integers

MIN_SEPARATION = 5.0
"""Distance of two places over the width of one: nearer, nothing says which place is meant."""
MIN_UNSHARED = 0.2
"""Of the scatter: what all places share in one pass is a shift of the targets, which was meant."""
MAX_OF_DIRECTION = 10.0
"""Width of a place over the scatter in one direction: beyond, each has targets of its own."""
MAX_AGAIN = 0.5
"""Of the stops of a pass: more that are at one place are targets within it, which were meant.

And of the passes at a place: two targets that each is in more are two that were meant.
"""
MEAN_SIGMAS = 4.0
"""A mean may lie so many standard errors beside the number that was meant."""
SWEEPS = 20
MIN_DISTANCE = 1e-6
"""mm or degrees: targets nearer to each other differ by how numbers are stored."""
DECIMALS = range(-3, 10)


class Places(NamedTuple):
    """What targets mean.

    nominal: Places in ascending order, (m,).
    number: Number of each row's, (n,).
    scatter: Largest distance of a target from its place; 0: the targets are the places.
    """

    nominal: Floats
    number: Integers
    scatter: float = 0.0

    @classmethod
    def of(cls, target: Floats, direction: Integers, cycle: Integers) -> Places:
        """Return the targets as they are; or where they scatter, the places that they mean."""
        nominal, first = np.unique(target, return_inverse=True)
        index = np.asarray(first.reshape(-1), dtype=np.intp)
        if len(nominal) < 3 or np.diff(nominal).min() * MIN_SEPARATION > np.diff(nominal).max():
            return cls(nominal, index)
        stops = _Stops(target, direction, _passes(direction, cycle))
        joined = index
        while (wider := stops.joined(joined)) is not None:
            joined = wider
        if joined is index:
            return cls(nominal, index)
        nominal = _nominal(target, joined)
        return cls(nominal, joined, float(np.abs(target - nominal[joined]).max()))


class _Stops(NamedTuple):
    """Targets, in the directions and passes in which they were reached."""

    target: Floats
    direction: Integers
    passes: Integers

    def joined(self, index: Integers) -> Integers | None:
        """Return the places with the next ones joined that mean the same; None: there are none."""
        low, high = self.limits(index)
        gaps = low[1:] - high[:-1]
        levels = np.unique(gaps)
        for level in levels[:-1][levels[1:] >= MIN_SEPARATION * levels[:-1]]:
            number = np.concatenate([[0], np.cumsum(gaps > level)])
            found = np.asarray(number[index], dtype=np.intp)
            low, high = self.limits(found)
            apart = MIN_SEPARATION * (high - low).max() <= (low[1:] - high[:-1]).min()
            rounding = float((high - low).max()) < MIN_DISTANCE
            if apart and (rounding or self.scatter(found)):
                return found
        return None

    def limits(self, index: Integers) -> tuple[Floats, Floats]:
        """Return the lowest and the highest target of each place."""
        order = np.lexsort((self.target, index))
        first = np.flatnonzero(np.diff(index[order], prepend=-1))
        last = np.append(first[1:], len(index)) - 1
        return self.target[order[first]], self.target[order[last]]

    def scatter(self, index: Integers) -> bool:
        """Whether targets scatter about these places, rather than being meant as they are.

        They differ from pass to pass at one place, but not by what a pass shifts all targets; and
        no pass stops at several targets of a place.
        """
        if self._again(index) > MAX_AGAIN or self._meant(index):
            return False
        cell = index
        if len(np.unique(self.passes)) > 2:  # in each direction by itself
            cell = _numbered(index, self.direction)
        one, of_place = _centred(self.target, cell), _centred(self.target, index)
        left = one
        for _ in range(SWEEPS):
            left = _centred(_centred(left, self.passes), cell)
        rms = [float(np.sqrt(np.mean(x**2))) for x in (left, one, of_place)]
        return rms[1] > 0 and rms[0] > MIN_UNSHARED * rms[1] and rms[2] < MAX_OF_DIRECTION * rms[1]

    def _again(self, index: Integers) -> float:
        """Further targets that passes have at a place, a stop of a pass at a place."""
        stop = _numbered(index, self.passes)
        targets = _numbered(stop, self.target).max() + 1
        return float(targets / (stop.max() + 1) - 1)

    def _meant(self, index: Integers) -> bool:
        """Whether most passes stop at the same two targets of a place, which both were meant."""
        own = _numbered(index, self.target)
        _, first = np.unique(own, return_index=True)
        of = index[first]  # the place of each target
        each, every = (_passes_at(x, self.passes) for x in (own, index))
        common = each > MAX_AGAIN * every[of]
        return bool(np.bincount(of[common], minlength=1).max() > 1)


def _passes_at(label: Integers, passes: Integers) -> Integers:
    """Count of the passes that have each label."""
    _, first = np.unique(_numbered(label, passes), return_index=True)
    return np.bincount(label[first])


def _numbered(*labels: NDArray[Any]) -> Integers:
    """Number of each row, the same for rows with the same labels."""
    codes = [np.unique(each, return_inverse=True)[1].reshape(-1) for each in labels]
    found = np.unique(np.stack(codes), axis=1, return_inverse=True)[1]
    return np.asarray(found.reshape(-1), dtype=np.intp)


def _centred(values: Floats, index: Integers) -> Floats:
    """Values less the mean of those with the same number."""
    mean = np.bincount(index, values) / np.maximum(np.bincount(index), 1)
    return np.asarray(values - mean[index])


def _passes(direction: Integers, cycle: Integers) -> Integers:
    """Number of the pass of each row: a cycle in one direction; of one cycle what is in a row."""
    if len(np.unique(cycle)) > 1:
        return _numbered(cycle, direction)
    return np.cumsum(np.diff(direction, prepend=direction[:1]) != 0)


def _nominal(target: Floats, number: Integers) -> Floats:
    """Mean target of each place, with as few decimals as the scatter allows."""
    count = np.bincount(number)
    mean = np.bincount(number, target) / count
    variance = np.sum((target - mean[number]) ** 2) / max(len(target) - len(count), 1)
    reach = np.maximum(MEAN_SIGMAS * np.sqrt(variance / count), 10.0 ** -DECIMALS[-1])
    rounded = (np.round(mean, decimals) for decimals in DECIMALS)
    return next((each for each in rounded if np.all(np.abs(each - mean) <= reach)), mean)
