"""What candidates gain beside a set, by those of its blocks that change it.

Causes of one of several measurements change nothing of what is gained in another one. A search
meets the same few blocks of a measurement in many sets: what they leave is worked out once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from trunnion._core import CauseBlocks, CauseSet
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.columns import APART

_Blocks = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class AtVariants:
    """What a set leaves with each variant of some of its causes, beside the others as they are.

    at: Which variant of each cause is in the set (c,). count: How many each has (c,). rss: Sums of
    squares, those of one cause after the other (v,).
    """

    at: Integers
    count: Integers
    rss: Floats

    @classmethod
    def of(cls, causes: Sequence[tuple[int, Floats]]) -> AtVariants:
        """Return those of causes: which variant is in the set, and what each leaves (v,)."""
        at, rss = zip(*causes, strict=True)
        return cls(np.array(at), np.array([len(own) for own in rss]), np.concatenate(rss))

    def with_more(self, left: float) -> AtVariants:
        """Return the same of a set that leaves more."""
        return AtVariants(self.at, self.count, self.rss + left)


class Reach:
    """Which candidates have something in common, and what they gain beside some blocks.

    c: The candidates. core, empty: Their blocks and the empty set, as the core has them.
    """

    def __init__(self, c: Candidates, core: CauseBlocks, empty: CauseSet) -> None:
        self._c, self._core, self._empty = c, core, empty
        self._owner: list[int] = c.owner.tolist()
        self._first: list[int] = np.searchsorted(c.owner, np.arange(c.count + 1)).tolist()
        self._of_column = np.repeat(c.owner, c.rank)
        before = np.repeat(c.start - (np.cumsum(c.rank) - c.rank), c.rank)
        self._columns = before + np.arange(len(before))
        self._touched: dict[int, int] = {}
        self._reached = [1 << j for j in range(c.count)]
        self._gains: dict[tuple[_Blocks, int, int], tuple[float, Floats]] = {}
        self._variants: dict[_Blocks, AtVariants | None] = {}

    def that_matter(self, blocks: Sequence[int], candidate: int) -> _Blocks:
        """Those of some blocks that change what a candidate gains beside them, in order."""
        parts = self.parts(blocks)
        return _joined(own for own, touched in parts if touched >> candidate & 1)

    def gains_beside(self, blocks: Sequence[int], further: range) -> tuple[float, Floats]:
        """What a set leaves (RSS), and by how much less each of further blocks beside it would."""
        parts = self.parts(blocks)
        first, last = self._owner[further.start], self._owner[further.stop - 1]
        if first == last:
            own = _joined(some for some, touched in parts if touched >> first & 1)
            return self._left(parts), self._beside(own, further)[1]
        beside = np.zeros(self._c.count, dtype=np.int64)  # bits of the parts
        for i, (_, touched) in enumerate(parts):
            beside += self._flags(touched).astype(np.int64) << i
        starts = np.flatnonzero(np.diff(beside[first : last + 1], prepend=-1)) + first
        begun = [*starts.tolist(), last + 1]
        every = {
            bits: _joined(some for i, (some, _) in enumerate(parts) if bits >> i & 1)
            for bits in dict.fromkeys(beside[starts].tolist())
        }
        gains = []
        for bits, j, end in zip(beside[starts].tolist(), begun, begun[1:], strict=False):
            some = range(max(further.start, self._first[j]), min(further.stop, self._first[end]))
            gains.append(self._beside(every[bits], some)[1])
        return self._left(parts), np.concatenate(gains)

    def at_variants(self, blocks: Sequence[int]) -> Iterator[AtVariants]:
        """What a set would leave with each variant of its causes that have several."""
        parts = self.parts(blocks)
        whole = self._empty.rss
        more = [self._beside(own, range(0))[0] - whole for own, _ in parts]
        for i, (own, _) in enumerate(parts):
            found = self._of_variants(own)
            if found is not None:
                yield found.with_more(sum(more[:i]) + sum(more[i + 1 :]))

    def _of_variants(self, part: _Blocks) -> AtVariants | None:
        """What a part would leave with each variant of its causes; None: none has several."""
        if part not in self._variants:
            found = []
            for b in part:
                first, end = self._first[self._owner[b]], self._first[self._owner[b] + 1]
                if end - first > 1:
                    rest = [other for other in part if other != b]
                    rss, gains = self.gains_beside(rest, range(first, end))
                    found.append((b - first, rss - gains))
            self._variants[part] = AtVariants.of(found) if found else None
        return self._variants[part]

    def _left(self, parts: Sequence[tuple[_Blocks, int]]) -> float:
        """What parts of a set leave together."""
        whole = self._empty.rss
        return whole - sum(whole - self._beside(own, range(0))[0] for own, _ in parts)

    def _beside(self, blocks: _Blocks, further: range) -> tuple[float, Floats]:
        """What blocks leave, and what further ones gain that have nothing to do with any other.

        No columns of others have a part in it.
        """
        key = blocks, further.start, further.stop
        if key not in self._gains:
            rows = [(b, self._c.gram_rows(b)) for b in blocks]
            self._gains[key] = self._core.gains_beside(self._empty, rows, *key[1:])
        return self._gains[key]

    def parts(self, blocks: Sequence[int]) -> list[tuple[_Blocks, int]]:
        """Parts of a set that have nothing in common: blocks, and bits of what these touch.

        At these places of their causes or others.
        """
        ordered = sorted(blocks)
        touched = [self._touching(b) for b in ordered]  # after which it is known both ways
        found: list[tuple[int, list[int], int]] = []  # bits of their causes, blocks, touched
        for b, more in zip(ordered, touched, strict=True):
            j = self._owner[b]
            bits, own, reached, apart = 1 << j, [b], self._reached[j], []
            for part in found:
                if part[0] & reached:
                    bits, own, more = bits | part[0], [*part[1], *own], more | part[2]
                else:
                    apart.append(part)
            found = [*apart, (bits, own, more)]
        ends = sorted((sorted(own), more) for _, own, more in found)
        return [(tuple(own), more) for own, more in ends]

    def _touching(self, block: int) -> int:
        """Bits of the candidates with which a block has something in common."""
        if block not in self._touched:
            seen = np.max(np.abs(self._c.gram_rows(block)), axis=0)[self._columns] > APART
            flags = np.zeros(self._c.count, dtype=bool)
            flags[self._of_column[seen]] = True
            bits = np.packbits(flags, bitorder="little").tobytes()
            self._touched[block] = touched = int.from_bytes(bits, "little")
            j = self._owner[block]
            self._reached[j] |= touched
            for other in np.flatnonzero(flags).tolist():
                self._reached[other] |= 1 << j
        return self._touched[block]

    def _flags(self, bits: int) -> Flags:
        """Whether each candidate is among some, by their bits."""
        of_bytes = np.frombuffer(bits.to_bytes(self._c.count // 8 + 1, "little"), dtype=np.uint8)
        return np.unpackbits(of_bytes, bitorder="little", count=self._c.count).astype(bool)


def _joined(parts: Iterable[_Blocks]) -> _Blocks:
    """Blocks of some parts, in order."""
    return tuple(sorted(b for part in parts for b in part))
