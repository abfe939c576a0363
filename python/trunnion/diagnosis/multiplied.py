"""Inner products of some blocks of candidates with the columns of all.

Columns of one of several measurements are zero in the readings of the others: only what has a part
in the same readings is multiplied with them.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations_with_replacement, groupby, pairwise, starmap

import numpy as np

from trunnion.base.rows import ROWS_AT_HAND
from trunnion.base.units import Floats
from trunnion.diagnosis.columns import Part, inner, products
from trunnion.diagnosis.of_some import Beside

Place = tuple[Floats | Part, slice]
"""The part that holds the columns of a block, and which of it they are."""
Places = Mapping[int, Place]


def multiplied(
    parts: Sequence[Floats | Part], places: Places, n: int
) -> Iterator[tuple[int, Floats]]:
    """Return each block with the inner products of its columns with all of some parts, (k, M).

    n: Count of the readings.
    """
    ordered = sorted(places, key=lambda b: _bounds(places[b][0]))
    for bounds, group in groupby(ordered, key=lambda b: _bounds(places[b][0])):
        blocks = list(group)
        some = [places[b] for b in blocks]
        if bounds:
            at = slice(*bounds)
            own = [part.own[s] for part, s in some if isinstance(part, Beside)]
            made = _of_some(parts, np.concatenate(own).T, at, n)
        else:
            own = [part[s] for part, s in some]
            made = products(parts, np.concatenate(own).T)
        ends = np.cumsum([len(x) for x in own])
        yield from zip(blocks, np.split(np.ascontiguousarray(made.T), ends[:-1]), strict=True)


def _bounds(part: Floats | Part) -> tuple[int, ...]:
    """First and last of the readings in which alone columns of a part are not zero; or nothing."""
    if not isinstance(part, Beside) or part.of_basis is not None:
        return ()
    return part.at.start, part.at.stop


def _of_some(parts: Sequence[Floats | Part], r: Floats, at: slice, n: int) -> Floats:
    """Inner products of the columns of parts with r (m, s), which is zero but for readings at."""
    found = []
    for x in parts:
        if isinstance(x, np.ndarray):
            found.append(inner(x[:, at], r))
        elif isinstance(x, Beside):
            found.append(x.with_some(r, at))
        else:
            whole = np.zeros((n, r.shape[1]))
            whole[at] = r
            found.append(x.times(whole))
    return np.concatenate(found)


def squared_products(places: Sequence[Place], n: int) -> Floats:
    """Squares of the inner products of all columns of some blocks with each other, (m, m).

    n: Count of the readings.
    """
    first = np.cumsum([0, *(some.stop - some.start for _, some in places)]).tolist()
    groups: dict[tuple[int, int], tuple[list[int], list[Floats]]] = {}  # by their readings
    for (part, some), numbers in zip(places, starmap(range, pairwise(first)), strict=True):
        bounds = _bounds(part)
        own = part.own[some] if isinstance(part, Beside) and bounds else part[some]
        group = groups.setdefault((bounds[0], bounds[1]) if bounds else (0, n), ([], []))
        group[0].extend(numbers)
        group[1].append(own)
    out = np.zeros((first[-1], first[-1]))
    for one, other in combinations_with_replacement(groups.items(), 2):
        (begin, end), (i, columns) = one
        (begin_other, end_other), (j, others) = other
        made = np.zeros((len(i), len(j)))
        for row in range(max(begin, begin_other), min(end, end_other), ROWS_AT_HAND):
            stop = min(row + ROWS_AT_HAND, end, end_other)
            x = _rows(columns, slice(row - begin, stop - begin))
            y = _rows(others, slice(row - begin_other, stop - begin_other))
            made += x @ y.T
        out[np.ix_(i, j)], out[np.ix_(j, i)] = made, made.T
    return out**2


def _rows(columns: Sequence[Floats], some: slice) -> Floats:
    """Some rows of columns, (m, r)."""
    return np.concatenate([x[:, some] for x in columns]).astype(np.float64, copy=False)
