"""Inner products of some blocks of candidates with the columns of all.

Columns of one of several measurements are zero in the readings of the others: only what has a part
in the same readings is multiplied with them.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.columns import Part, inner, products
from trunnion.diagnosis.of_some import Beside

Places = Mapping[int, tuple[Floats | Part, slice]]
"""The part that holds the columns of each of some blocks, and which of it they are."""


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
