"""Recorded quantities that an error may depend on, and smooth functions of them.

Of several measurements each has quantities of its own, and ways of its own by which a disturbance
enters its readings: what is left of one is a function of nothing in another.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.model import Covariate, Model
from trunnion.diagnosis.smooth import polynomials
from trunnion.diagnosis.ways import directions

MAX_ARC = 0.5  # of a turn that has polynomials: in more they jump where the angle begins anew
PERPENDICULAR = 1e-9  # of the sizes of components, their product at an instant: rounding
MIN_DISTINCT = 5  # values of a quantity, of which a smooth function is more than a polynomial


def smooth_functions(
    model: Model,
    rows: Integers,
    most: int,
    *,
    competing: bool = False,
    known: "Iterable[Said] | None" = None,
) -> list[Floats]:
    """Polynomials of quantities that an error of some rows may be a smooth function of, (n, m).

    0 in other rows. Each in each direction; of a measurement none if more than ``most``. No
    angle that comes round, nor what goes with one. ``competing``: of those only what may compete
    with causes. ``known``: what all covariates say of these rows, where that was asked before.
    """
    if known is None:
        known = saying(model.covariates, model.components, rows)
    every = [x for x in known if len(x.distinct) >= MIN_DISTINCT and not x.said]
    turns = [x for x in every if not straight(x.covariate, x.distinct)]
    smooth = [
        x
        for x in every
        if straight(x.covariate, x.distinct) and not any(t.goes_with(x) for t in turns)
    ]
    count = Counter[int]()  # by the first reading of a measurement
    for x in smooth:
        count[x.some.start] += len(directions(x.enter))
    found: dict[int, list[Floats]] = {start: [] for start in count}
    for x in smooth:
        if count[x.some.start] > most:
            continue
        functions = polynomials(x.distinct, x.distinct)[x.ranks]
        if x.covariate.known is not None:
            functions = (functions.T * x.covariate.known[rows[x.some]]).T
        for c in directions(x.enter).values():
            full = np.zeros((len(model.readings), functions.shape[1]))
            full[rows[x.some]] = functions * c[:, None]
            if competing and x.covariate.comes_back:
                full = _not_repeated(model, rows, full)
            if full.any():
                found[x.some.start].append(full)
    return [f for own in found.values() for f in own]


def _not_repeated(model: Model, rows: Integers, columns: Floats) -> Floats:
    """Columns (n, m) of some rows less their means over repeats; nothing where none is repeated."""
    out = np.zeros_like(columns)
    if model.replicates is None:
        return out
    labels = model.replicates[rows]
    repeated = rows[labels >= 0]
    label = np.unique(labels[labels >= 0], return_inverse=True)[1]
    mean = np.zeros((int(label.max(initial=-1)) + 1, columns.shape[1]))
    np.add.at(mean, label, columns[repeated])
    mean /= np.bincount(label)[:, None]
    out[repeated] = columns[repeated] - mean[label]
    return out


class Said(NamedTuple):
    """A covariate that says something new.

    ``said``: whether all but the jumps is said. ``some``: the readings of its measurement; of these
    the values, those that are distinct, the rank of each among them (of classes none), and how a
    disturbance enters.
    """

    covariate: Covariate
    said: bool
    some: slice
    values: NDArray[Any]
    distinct: NDArray[Any]
    ranks: Integers
    enter: dict[str, Floats]

    def goes_with(self, other: "Said") -> bool:
        """Whether another one is a monotonic function of it."""
        backward = other.ranks.max() - other.ranks
        same = self.some == other.some
        return same and any(np.array_equal(self.ranks, x) for x in (other.ranks, backward))


def saying(
    covariates: Iterable[Covariate], components: Mapping[str, Floats], rows: Integers
) -> Iterator[Said]:
    """Covariates that say something new of the readings that have them."""
    entering: dict[int, dict[str, Floats]] = {}
    seen: list[tuple[int, bool, bool, Integers]] = []
    for v in covariates:
        some = in_measurement(v, rows)
        at = some.start
        if at not in entering:
            entering[at] = _entering(components, rows[some])
        enter = entering[at] if v.turns else directions(entering[at])
        values = np.asarray(v.values)[rows[some]]
        said, distinct, ranks = False, values[:0], np.zeros(0, dtype=np.intp)
        if not v.classes:
            values = values.astype(np.float64)
            distinct, ranks = np.unique(values, return_inverse=True)
            kind = at, v.period is not None
            same = [q for *k, q, s in seen if (*k,) == kind and np.array_equal(ranks, s)]
            if len(distinct) < 2 or (same and (any(same) or not v.sequence)):
                continue  # constant, or says what another covariate says
            said = bool(same)
            seen.append((*kind, v.sequence, ranks))
        yield Said(v, said, some, values, distinct, ranks, enter)


def in_measurement(v: Covariate, rows: Integers) -> slice:
    """Which of some rows, in order, are of the measurement that a quantity is recorded in."""
    if v.readings is None:
        return slice(0, len(rows))
    first, end = np.searchsorted(rows, v.readings).tolist()
    return slice(first, end)


def _entering(components: Mapping[str, Floats], rows: Integers) -> dict[str, Floats]:
    """How a disturbance may enter some readings, each way once."""
    enter = {"": np.ones(len(rows))}
    for name, c in components.items():
        c = np.asarray(c, dtype=np.float64)[rows]
        if not any(np.array_equal(c, d) for d in enter.values()) and np.any(c):
            enter[name] = c
    return enter


def straight(v: Covariate, distinct: Floats) -> bool:
    """Whether a quantity does not come round between its least and its largest value."""
    return v.period is None or bool(distinct[-1] - distinct[0] < MAX_ARC * v.period)


def at_an_instant(
    v: Covariate, ways: Sequence[str], components: Mapping[str, Floats]
) -> list[tuple[int, ...]]:
    """Ways by which all that is read at an instant is disturbed, each complete set of them.

    Components at right angles at every instant: X, Y, Z; radial, tangential, axial. None of a
    quantity that is not in the order of measurement, or where few readings are of one instant.
    """
    if not v.sequence:
        return []
    some = np.zeros(len(v.values), dtype=bool)
    some[slice(*(v.readings or (None,)))] = True
    some &= True if v.known is None else v.known
    moments, instant = np.unique(np.asarray(v.values)[some], return_inverse=True)
    if len(instant) < max(2 * len(moments), 1):
        return []
    enter = [(i, np.asarray(components[way])[some]) for i, way in enumerate(ways) if way]
    sets: list[tuple[int, ...]] = []
    for first, x in enter:
        if any(first in own for own in sets):
            continue
        together = {first: x}
        for i, y in enter:
            sums = [np.abs(np.bincount(instant, y * z)).max() for z in together.values()]
            sizes = [np.abs(y).max() * np.abs(z).max() for z in together.values()]
            if np.all(np.less(sums, PERPENDICULAR * np.array(sizes))):
                together[i] = y
        if len(together) > 1:
            sets.append(tuple(sorted(together)))
    return sets
