"""Places of candidates between those of their grids."""

import numpy as np
import pytest

from trunnion.base.units import Floats
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.grid import best_place


def test_candidates_with_a_place_more_are_those_made_with_it() -> None:
    rng = np.random.default_rng(3)
    widths = [(1, 2), (5, 1), (4, 2), (1, 1), (6, 1)]  # variants, columns
    every = [rng.standard_normal((v, 60, k)) for v, k in widths]
    basis = np.linalg.qr(rng.standard_normal((60, 4)))[0]
    left = rng.standard_normal(60)
    left -= basis @ (basis.T @ left)
    last = {1: 4, 2: 0, 4: 3}
    fewer = [np.delete(x, last[j], axis=0) if j in last else x for j, x in enumerate(every)]
    other = rng.standard_normal((1, 60, 1))
    fewer[4] = np.insert(fewer[4], 1, other, axis=0)  # which is left out again
    whole, part = Candidates(every, basis), Candidates(fewer, basis)
    part.gains(left)
    found = part.with_variants({j: (v, every[j][[v]]) for j, v in last.items()}, {4: 1})
    for name in ("owner", "variant", "rank"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
    np.testing.assert_allclose(found.penalty, whole.penalty, rtol=1e-12)
    np.testing.assert_allclose(found.gains(left), whole.gains(left), rtol=1e-10)
    np.testing.assert_allclose(found.gains(2 * left), 4 * whole.gains(left), rtol=1e-10)
    for block in range(len(whole.owner)):
        own = found.columns(block).T @ found.columns(block)
        np.testing.assert_allclose(own, whole.columns(block).T @ whole.columns(block), atol=1e-12)


@pytest.mark.parametrize("ratio", [1.2, 2.0, 4.0])
def test_the_best_place_is_found_between_those_of_a_grid(ratio: float) -> None:
    """Of a warm-up without noise it is its own time constant: no other column is parallel to it."""
    minutes, rng = np.linspace(0.0, 90.0, 200), np.random.default_rng(5)
    grid = 3.0 * ratio ** np.arange(np.ceil(np.log(40.0) / np.log(ratio)) + 1)
    for place in rng.uniform(3.0, 120.0, 20):
        shown = 1.0 - np.exp(-minutes / place)

        def gains(places: Floats, shown: Floats = shown) -> Floats:
            x = 1.0 - np.exp(-minutes / places[:, None])
            return np.asarray((x @ shown) ** 2 / np.sum(x**2, axis=1))

        assert best_place(gains, grid.tolist()) == pytest.approx(place, rel=1e-6)
