"""What is supposed beside a candidate, and causes of which one makes others likelier."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import special

from trunnion.base.resolution import NO_FLOOR
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.evidence import log_odds_together
from trunnion.diagnosis.selection import Search
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
