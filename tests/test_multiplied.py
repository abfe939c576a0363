"""Inner products of blocks with columns of which some are zero in other measurements."""

import numpy as np
import pytest

from trunnion.base.units import Floats
from trunnion.diagnosis.columns import Combined, Part
from trunnion.diagnosis.multiplied import multiplied, squared_products
from trunnion.diagnosis.of_some import Beside

N, FIRST = 20, 8


@pytest.mark.parametrize("seed", range(3))
def test_products_are_those_of_whole_columns(seed: int) -> None:
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.standard_normal((N, 2)))[0]
    first, last = slice(0, FIRST), slice(FIRST, N)
    parts: list[Floats | Part] = [
        Beside(rng.standard_normal((3, FIRST)), first, basis),
        Beside(rng.standard_normal((4, N - FIRST)), last, basis),
        rng.standard_normal((2, N)),
        Beside(rng.standard_normal((3, FIRST)), first, basis, rng.standard_normal((3, 2))),
        Combined(rng.standard_normal((3, 2)), rng.standard_normal((2, N))),
        Beside(rng.standard_normal((2, 5)), slice(FIRST - 2, FIRST + 3), basis),
    ]
    every = [np.asarray(part[: len(part)]) for part in parts]
    places = {7 * i: (part, slice(i % 2, 2)) for i, part in enumerate(parts)}
    found = dict(multiplied(parts, places, N))
    assert found.keys() == places.keys()
    for i, own in enumerate(every):
        made = own[i % 2 : 2] @ np.concatenate(every).T
        np.testing.assert_allclose(found[7 * i], made, atol=1e-12)
        assert found[7 * i].flags.c_contiguous


@pytest.mark.parametrize("seed", range(3))
def test_squares_of_products_are_those_of_whole_columns(seed: int) -> None:
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.standard_normal((N, 2)))[0]
    first, last = slice(0, FIRST), slice(FIRST, N)
    parts: list[Floats | Part] = [
        Beside(rng.standard_normal((3, FIRST)), first, basis),
        rng.standard_normal((2, N)),
        Beside(rng.standard_normal((4, N - FIRST)), last, basis),
        Beside(rng.standard_normal((3, FIRST)), first, basis, rng.standard_normal((3, 2))),
        Beside(rng.standard_normal((2, FIRST)), first, basis),
    ]
    places = [(part, slice(0, 2)) for part in parts]
    whole = np.concatenate([np.asarray(part[:2]) for part in parts])
    np.testing.assert_allclose(squared_products(places, N), (whole @ whole.T) ** 2, atol=1e-12)
