"""What is supposed beside a candidate, and causes of which one makes others likelier.

Of those the range of their sizes is not known, either.
"""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import special

from trunnion.base.resolution import NO_FLOOR
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.evidence import Evidence, log_odds_together, sizes_assumed
from trunnion.diagnosis.selection import Search, search
from trunnion.diagnosis.supposed import Supposed

Floats = NDArray[np.float64]
READINGS = 40
VARIANCE = 0.3


def _supposed(seed: int) -> tuple[Supposed, Floats]:
    """Three candidates, the last of five places, and two columns beside the first; residuals."""
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.standard_normal((READINGS, 2)))[0]

    def free(x: Floats) -> Floats:
        return np.asarray(x - basis @ (basis.T @ x))

    variants = [rng.standard_normal((v, READINGS, k)) for v, k in ((1, 4), (1, 1), (5, 2))]
    r, columns = free(rng.standard_normal(READINGS)), free(rng.standard_normal((READINGS, 2)))
    s = Search(Candidates(variants, basis), r, NO_FLOOR)
    return Supposed(s, 0, 0b111, columns, r, VARIANCE), r


def _left(one: Supposed, blocks: list[int], r: Floats) -> float:
    """Least of the squares that blocks leave, and of the sizes of what is supposed."""
    a = np.concatenate([one.search.c.columns(b) for b in blocks]).T
    both = np.hstack([a, one.columns])
    held = np.diag([0.0] * a.shape[1] + [VARIANCE] * one.columns.shape[1])
    sizes = np.linalg.solve(both.T @ both + held, both.T @ r)
    return float(r @ (r - both @ sizes))


@pytest.mark.parametrize("seed", range(5))
def test_sizes_are_those_of_a_normal_distribution(seed: int) -> None:
    one, r = _supposed(seed)
    sets = [[0], [0, 1], [0, 1, 4]]
    for blocks, gain in zip(sets, one.sizes(sets, np.ones(7, dtype=bool))[0], strict=True):
        assert r @ r - gain == pytest.approx(_left(one, blocks, r))
    v = np.eye(READINGS) + one.columns @ one.columns.T / VARIANCE
    assert one.cost == pytest.approx(np.linalg.slogdet(v)[1])
    assert one.within(0b101)
    assert not one.within(0b110)
    assert len(dict(one.fewer(0b111, (0, 1, 4)))) == 4


@pytest.mark.parametrize("seed", range(5))
def test_further_blocks_explain_what_the_set_and_what_is_supposed_leave(seed: int) -> None:
    one, r = _supposed(seed)
    rss, gains = one.gains_beside([0, 1], range(2, 7))
    assert rss == pytest.approx(_left(one, [0, 1], r))
    for b in range(2, 7):
        assert rss - gains[b - 2] == pytest.approx(_left(one, [0, 1, b], r))
    _, seen, again, columns = one.left_by([0])
    assert again == pytest.approx(_left(one, [0], r))
    assert again - seen[1] == pytest.approx(_left(one, [0, 1], r))
    assert columns == 4


@pytest.mark.parametrize("count", [1, 3, 7, 40])
def test_odds_together_are_those_of_a_beta_binomial_distribution(count: int) -> None:
    k = np.arange(count + 1)
    odds = np.exp(log_odds_together(count, k)) / float(count) ** k
    none = special.beta(1, 2 * count) / special.beta(1, count)
    chance = none * odds * special.binom(count, k)
    assert chance.sum() == pytest.approx(1.0)
    assert chance @ k == pytest.approx(count / (count + 1))
    more = odds[1:] / odds[:-1]
    assert np.all(np.diff(more) > 0)


def _of_range(seen: float, least: float, widest: float) -> float:
    """Mean likelihood of a cause, its size logarithmically uniform up to ``widest`` times least."""
    size = least * np.exp(np.linspace(0.0, np.log(widest), 4001))
    either = np.exp(-((size - seen) ** 2) / 2) + np.exp(-((size + seen) ** 2) / 2)
    return float(np.mean(either))


@pytest.mark.parametrize("sizes", [(12.0, 1.0), (12.0, 3.0), (80.0, 3.0)])
def test_the_range_of_sizes_is_not_known_and_the_same_for_all(sizes: tuple[float, float]) -> None:
    """Two causes at right angles, of such sizes: by how much a range of 10 to 100 is likelier."""
    ways = np.linalg.qr(np.random.default_rng(2).standard_normal((READINGS, READINGS)))[0]
    # what is left makes a noise of 1, whatever is fitted, and hardly anything is explained by it
    readings = ways[:, :2] @ sizes + ways[:, 2:].sum(axis=1)
    variants = [ways[:, j][None, :, None] for j in range(2)]

    def odds(together: bool) -> tuple[float, Floats]:
        c = Candidates(variants, np.zeros((READINGS, 0)))
        c.together = together
        found = Evidence(search(c, readings)).values
        return float(np.exp((found[0b01] - found[0b11]) / 2)), np.sqrt(c.chance)

    more, least = odds(together=True)
    before = odds(together=False)[0]
    ranges = np.geomspace(10.0, 100.0, 201)
    each = np.array(
        [[_of_range(x, t, r) for r in ranges] for x, t in zip(sizes, least, strict=True)]
    )
    expected = np.mean(each[0] * each[1]) / np.mean(each[0]) / each[1, -1]
    expected *= np.exp(np.diff(log_odds_together(2.0, np.array([1, 2])))[0])
    assert more / before == pytest.approx(expected, rel=0.05)


def test_sizes_that_are_hidden_are_of_all_ranges() -> None:
    for together in (False, True):
        assert sizes_assumed(together).sum() == pytest.approx(1.0)
    assert np.ptp(sizes_assumed(together=False)) == 0.0
    decade = sizes_assumed(together=True)[:17].sum()
    assert decade == pytest.approx(np.log(2.0), rel=0.05)  # mean of ln 10 / ln range
