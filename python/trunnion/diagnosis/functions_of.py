"""Functions of one covariate of which unexplained structure may consist, and their terms."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.functions import Functions, Jumps, Places
from trunnion.diagnosis.jumps import places_of_jumps
from trunnion.diagnosis.local_errors import local, places_of
from trunnion.diagnosis.quantities import MIN_DISTINCT, Said, straight
from trunnion.diagnosis.smooth import over_range, polynomials
from trunnion.diagnosis.waves import (
    WAVES_ON_A_GRID,
    places_apart,
    step_of_grid,
    waves,
    waves_of,
)

MAX_CLASSES = 512
MAX_STOPS = 48  # of a rotary axis, each of which may stand off by itself
HARMONICS = 6
MOST_OF_A_TURN = 180  # harmonics, where each angle has several readings
DEGREE = 4
MAX_ALIKE = 2  # readings of a value on average: of more, functions are made once for each value


class Some(NamedTuple):
    """Terms of one kind, by their numbers (m,), and the functions of each."""

    kind: str
    numbers: Sequence[object]
    width: int = 1


class Shown:
    """Which terms the readings show, of those that enter by each way."""

    def __init__(self, x: Said, ways: Sequence[str]) -> None:
        """Find what values the readings of each way have."""
        v = x.covariate
        self._places = not (v.sequence or v.classes)
        self._turns = v.period is not None
        own = [x.values[x.enter[way] != 0.0] for way in ways] if self._places else []
        self._few = np.array([places_apart(values) < MIN_DISTINCT for values in own])
        self._ends = [(values.min(initial=np.inf), values.max(initial=-np.inf)) for values in own]

    def hidden(self, some: Some) -> Integers:
        """Those not shown, counted by number, then way.

        Waves and local errors at too few values, and local errors where no reading is.
        """
        if not self._places or some.kind not in ("wave", "local"):
            return np.zeros(0, dtype=np.intp)
        out = np.tile(self._few, (len(some.numbers), 1))
        if some.kind == "local" and not self._turns:
            at = np.array(
                [place for place, _ in cast("Sequence[tuple[float, float]]", some.numbers)]
            )
            low, high = np.array(self._ends).T
            out |= (at[:, None] < low) | (at[:, None] > high)
        return np.flatnonzero(out)


def functions_of(x: Said, has: Flags | None) -> Iterator[tuple[Functions | Jumps, Sequence[Some]]]:
    """Functions of one covariate, and their terms; ``has``: readings that have it; None: all.

    Of values that come again and again each is made once, but for jumps of many readings.
    """
    if x.covariate.classes:
        yield from _by_itself(x.values)
        return
    if x.covariate.turns and x.covariate.period is not None and len(x.distinct) <= MAX_STOPS:
        yield from _by_itself(x.values)
    few = MAX_ALIKE * len(x.distinct) < len(x.values)
    at = Places(x.ranks if has is None else np.where(has, x.ranks, -1), len(x.distinct))
    for f, terms in _functions_at(x.distinct if few else x.values, x):
        if isinstance(f, Jumps):
            yield f, terms
            continue
        f = f.reshape(-1, f.shape[-1])
        if few:
            yield Functions(f, at), terms
        else:
            yield Functions(f if has is None else f * has), terms


def _by_itself(values: NDArray[Any]) -> Iterator[tuple[Functions, Sequence[Some]]]:
    """Each of some values by itself: those with the most readings, in their order."""
    labels, index, count = np.unique(values, return_inverse=True, return_counts=True)
    if len(labels) > 1:
        shown = np.sort(np.argsort(-count, kind="stable")[:MAX_CLASSES])
        place = np.full(len(labels), -1)
        place[shown] = np.arange(len(shown))
        at = Places(place[index.reshape(-1)], len(shown))
        yield Functions(np.eye(len(shown)), at), [Some("class", labels[shown].tolist())]


def _harmonics(angles: Floats, period: float, most: int) -> int:
    """Count of harmonics of a turn: on a grid of angles, down to two of its steps."""
    few, step = min(HARMONICS, len(angles) - 1), step_of_grid(angles)
    if not step:
        return few
    steps = round(period / step)
    return max(few, min((steps - 1) // 2, (len(angles) - 1) // 2, most))


def _functions_at(values: Floats, x: Said) -> Iterator[tuple[Floats | Jumps, Sequence[Some]]]:
    """Functions of a covariate at some of its values (n,); jumps of many readings, of all."""
    v, distinct = x.covariate, x.distinct
    if v.period is not None and not x.said:
        turn = 2 * np.pi * values / v.period
        angles = np.unique(np.round(np.mod(distinct, v.period), 9))
        # made once for each of few angles, many of them cost little
        most = MOST_OF_A_TURN if len(values) == len(distinct) else WAVES_ON_A_GRID
        orders = np.arange(1, _harmonics(angles, v.period, most) + 1)
        yield waves(orders, turn), [Some("harmonic", list(orders), 2)]
    if straight(v, distinct) and not x.said:
        legendre = polynomials(values, distinct, DEGREE).T
        every = range(1, len(legendre) + 1)
        yield legendre, [Some("polynomial", [k], k) for k in every]
    if v.period is None and not x.said:
        low, high = distinct[0], distinct[-1]
        counts = waves_of(v, distinct)
        made = waves(np.pi * counts, over_range(values, low, high))
        yield made, [Some("wave", list((high - low) / counts), 2)]
    if v.sequence:
        places = places_of_jumps(distinct)
        many = Jumps.at(x.values, places) if v.known is None else None
        jumps = (values >= places[:, None]).astype(float) if many is None else many
        yield jumps, [Some("jump", list(places))]
    if len(x.values) < MANY_ROWS and len(distinct) > 1 and not x.said:
        places, widths = places_of(distinct, v.period)
        made = local(values, places[:, None], widths[:, None], v.period)
        numbers = list(zip(places.tolist(), widths.tolist(), strict=True))
        yield made, [Some("local", numbers)]
