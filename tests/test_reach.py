"""What candidates gain beside sets of which parts have nothing in common."""

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from trunnion.base.resolution import NO_FLOOR
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.selection import Search

Floats = NDArray[np.float64]
HALF = 30  # readings of each of two measurements


def _search(seed: int) -> tuple[Search, Floats]:
    """Candidates that the first of two measurements sees, the second, and both; residuals."""
    rng = np.random.default_rng(seed)
    shapes = [(0, 1, 1), (0, 3, 1), (1, 1, 2), (1, 4, 1), (1, 2, 2), (0, 1, 3), (-1, 2, 1)]
    variants = []
    for where, places, columns in shapes:
        x = rng.standard_normal((places, 2 * HALF, columns))
        if where >= 0:
            x[:, (1 - where) * HALF : (2 - where) * HALF] = 0.0
        variants.append(x)
    basis = np.zeros((2 * HALF, 2))
    basis[:HALF, 0] = basis[HALF:, 1] = HALF**-0.5
    r = rng.standard_normal(2 * HALF)
    r -= basis @ (basis.T @ r)
    return Search(Candidates(variants, basis), r, NO_FLOOR), r


def _left(s: Search, blocks: tuple[int, ...], r: Floats) -> float:
    """Sum of squares that a fit of blocks leaves of readings."""
    if not blocks:
        return float(r @ r)
    a = np.concatenate([s.c.columns(b) for b in blocks]).T
    return float(np.sum((r - a @ np.linalg.lstsq(a, r, rcond=None)[0]) ** 2))


SETS = [(), (0,), (0, 4), (0, 2, 4, 7), (1, 9, 4), (12, 0, 4), (6, 11, 3)]


@pytest.mark.parametrize(("seed", "blocks"), [*product(range(3), SETS)])
def test_gains_are_those_beside_the_whole_set(seed: int, blocks: tuple[int, ...]) -> None:
    s, r = _search(seed)
    for further in (range(len(s.owner)), range(5, 9), range(12, 14)):
        rss, gains = s.reach.gains_beside(blocks, further)
        assert rss == pytest.approx(_left(s, blocks, r), rel=1e-9)
        made = [rss - _left(s, (*blocks, b), r) for b in further]
        np.testing.assert_allclose(gains, made, atol=1e-9)


@pytest.mark.parametrize(("seed", "blocks"), [*product(range(3), SETS)])
def test_a_set_is_known_at_all_places_of_its_causes(seed: int, blocks: tuple[int, ...]) -> None:
    (s, r), found = _search(seed), 0
    several = [b for b in blocks if s.owner.count(s.owner[b]) > 1]
    at = {(s.owner.index(s.owner[b]), b - s.owner.index(s.owner[b])): b for b in several}
    for one in s.reach.at_variants(blocks):
        each = np.split(one.rss, np.cumsum(one.count)[:-1])
        for variant, rss in zip(one.at.tolist(), each, strict=True):
            first = next(i for i, v in at if v == variant and len(rss) == s.owner.count(s.owner[i]))
            rest = [b for b in blocks if s.owner[b] != s.owner[first]]
            made = [_left(s, (*rest, first + v), r) for v in range(len(rss))]
            np.testing.assert_allclose(rss, made, atol=1e-9)
            found += 1
    assert found == len(several)


@pytest.mark.parametrize(
    ("blocks", "parts"),
    [
        ((), []),
        ((4, 0), [(0,), (4,)]),
        ((0, 2, 4, 7), [(0, 2), (4, 7)]),
        ((9, 1, 4), [(1,), (4, 9)]),
        ((12, 0, 4), [(0, 4, 12)]),  # one that both see
    ],
)
def test_parts_of_a_set_are_those_of_each_measurement(
    blocks: tuple[int, ...], parts: list[tuple[int, ...]]
) -> None:
    s, _ = _search(1)
    assert sorted(own for own, _ in s.reach.parts(blocks)) == parts


def test_of_a_set_only_blocks_of_the_same_measurement_matter() -> None:
    s, _ = _search(0)
    assert s.reach.that_matter((0, 4, 1), 0) == (0, 1)
    assert s.reach.that_matter((0, 4, 1), 2) == (4,)
    # one that both see has to do with all
    assert s.reach.that_matter((0, 4, 12), 2) == (0, 4, 12)
