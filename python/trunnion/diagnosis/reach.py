"""What candidates gain beside a set, by those of its blocks that change it.

Causes of one of several measurements change nothing of what is gained in another one. A search
meets the same few blocks of a measurement in many sets: what they leave is worked out once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from trunnion._core import CauseBlocks, CauseSet
from trunnion.base.units import Flags, Floats
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.columns import APART

_Blocks = tuple[int, ...]


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
        self._gains: dict[tuple[_Blocks, int, int], tuple[float, Floats]] = {}
        self._variants: dict[tuple[_Blocks, int], tuple[float, Floats]] = {}

    def that_matter(self, blocks: Sequence[int], candidate: int) -> _Blocks:
        """Those of some blocks that change what a candidate gains beside them, in order."""
        parts = self._parts(blocks)
        return _joined(own for own, touched in parts if touched >> candidate & 1)

    def gains_beside(self, blocks: Sequence[int], further: range) -> tuple[float, Floats]:
        """What a set leaves (RSS), and by how much less each of further blocks beside it would."""
        parts = list(self._parts(blocks))
        first, last = self._owner[further.start], self._owner[further.stop - 1]
        beside = np.zeros(self._c.count, dtype=np.int64)  # bits of the parts
        for i, (_, touched) in enumerate(parts):
            beside += self._flags(touched).astype(np.int64) << i
        starts = np.flatnonzero(np.diff(beside[first : last + 1], prepend=-1)) + first
        begun = [*starts.tolist(), last + 1]
        own = {
            bits: _joined(some for i, (some, _) in enumerate(parts) if bits >> i & 1)
            for bits in dict.fromkeys(beside[starts].tolist())
        }
        gains = []
        for bits, j, end in zip(beside[starts].tolist(), begun, begun[1:], strict=False):
            some = range(max(further.start, self._first[j]), min(further.stop, self._first[end]))
            gains.append(self._beside(own[bits], some)[1])
        return self._left(parts), gains[0] if len(gains) == 1 else np.concatenate(gains)

    def at_variants(self, blocks: Sequence[int]) -> Iterator[tuple[int, Floats]]:
        """Each block of a set whose candidate has others, and what the set would leave with these.

        Its number among them; a sum of squares each, (v,).
        """
        parts = list(self._parts(blocks))
        for part in parts:
            others = self._left([other for other in parts if other is not part])
            for b in part[0]:
                j = self._owner[b]
                first, end = self._first[j], self._first[j + 1]
                if end - first > 1:
                    rss, gains = self._of_variants(part[0], b, range(first, end))
                    yield b - first, others - (self._empty.rss - rss) - gains

    def _of_variants(self, part: _Blocks, block: int, variants: range) -> tuple[float, Floats]:
        """What a part without a block leaves, and what the variants of that gain beside it."""
        key = part, block
        if key not in self._variants:
            rest = [b for b in part if b != block]
            self._variants[key] = self.gains_beside(rest, variants)
        return self._variants[key]

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

    def _parts(self, blocks: Sequence[int]) -> Iterator[tuple[_Blocks, int]]:
        """Parts of a set that have nothing in common: blocks, and bits of what these touch."""
        left = list(blocks)
        while left:
            own, touched, inside = [left.pop()], 0, 0
            for b in own:  # and those that are found on the way
                touched |= self._touching(b)
                inside |= 1 << self._owner[b]
                near = [x for x in left if self._near(x, touched, inside)]
                own += near
                left = [x for x in left if x not in near]
            yield tuple(sorted(own)), touched

    def _near(self, block: int, touched: int, inside: int) -> bool:
        """Whether a block, at this place or another, has to do with candidates (bits)."""
        return bool(touched >> self._owner[block] & 1 or self._touching(block) & inside)

    def _touching(self, block: int) -> int:
        """Bits of the candidates with which a block has something in common."""
        if block not in self._touched:
            seen = np.max(np.abs(self._c.gram_rows(block)), axis=0)[self._columns] > APART
            flags = np.zeros(self._c.count, dtype=bool)
            flags[self._of_column[seen]] = True
            bits = np.packbits(flags, bitorder="little").tobytes()
            self._touched[block] = int.from_bytes(bits, "little")
        return self._touched[block]

    def _flags(self, bits: int) -> Flags:
        """Whether each candidate is among some, by their bits."""
        of_bytes = np.frombuffer(bits.to_bytes(self._c.count // 8 + 1, "little"), dtype=np.uint8)
        return np.unpackbits(of_bytes, bitorder="little", count=self._c.count).astype(bool)


def _joined(parts: Iterable[_Blocks]) -> _Blocks:
    """Blocks of some parts, in order."""
    return tuple(sorted(b for part in parts for b in part))
