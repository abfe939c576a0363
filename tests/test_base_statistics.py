"""One linear solver: numpy's numbers where all is identifiable, and what is not by name."""

from __future__ import annotations

import numpy as np
import pytest

from trunnion.base import statistics
from trunnion.base.errors import InputError
from trunnion.base.statistics import linear_fit

RNG = np.random.default_rng(1)


@pytest.mark.parametrize("rows", [7, 500, 3000, 20_000])
def test_numbers_are_those_of_numpy(rows: int) -> None:
    columns = RNG.standard_normal((rows, 5)) * [1.0, 1e-4, 1e4, 3.0, 2.0]
    values = RNG.standard_normal(rows)
    fit = linear_fit(columns, values, basis=True)
    assert fit.rank == 5
    scale = np.linalg.norm(columns, axis=0)
    expected = np.linalg.lstsq(columns / scale, values, rcond=None)[0] / scale
    np.testing.assert_allclose(fit.solution * scale, expected * scale, rtol=1e-10)
    inverse = np.linalg.inv((columns / scale).T @ (columns / scale))
    np.testing.assert_allclose(fit.cofactor * np.outer(scale, scale), inverse, atol=1e-10)
    np.testing.assert_allclose(fit.basis.T @ fit.basis, np.eye(5), atol=1e-12)
    sizes = np.linalg.svd(columns / scale, compute_uv=False)
    np.testing.assert_allclose(fit.singular_values, sizes, rtol=1e-10)
    assert not fit.held.any()
    assert len(fit.combinations) == 0
    np.testing.assert_allclose(fit.std, np.sqrt(np.diag(fit.cofactor)))


@pytest.mark.parametrize("rows", [7, 3000])
def test_columns_of_zeros_have_a_basis_of_no_columns(rows: int) -> None:
    fit = linear_fit(np.zeros((rows, 2)), np.ones(rows), basis=True)
    assert fit.rank == 0
    assert fit.basis.shape == (rows, 0)
    assert fit.not_identifiable.all()


@pytest.mark.parametrize("apart", [1e-2, 1e-5, 0.0])
def test_many_rows_are_judged_as_few(apart: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """By inner products where their condition is small, by LAPACK elsewhere: as by the core."""
    columns = RNG.standard_normal((20_000, 5)) * [1.0, 1e-4, 1e4, 3.0, 2.0]
    columns[:, 3] = 2.0 * columns[:, 0] + apart * columns[:, 3]
    values = RNG.standard_normal(len(columns))
    many = linear_fit(columns, values, basis=True)
    monkeypatch.setattr(statistics, "MANY_ROWS", len(columns) + 1)
    few = linear_fit(columns, values, basis=True)
    assert (many.rank, many.held.tolist()) == (few.rank, few.held.tolist())
    assert many.not_identifiable.tolist() == few.not_identifiable.tolist()
    sizes = np.sqrt(np.diag(few.cofactor))
    np.testing.assert_allclose(many.solution, few.solution, atol=1e-9 * sizes.max())
    np.testing.assert_allclose(many.cofactor, few.cofactor, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(many.basis.T @ many.basis, np.eye(many.rank), atol=1e-9)
    left = many.basis - few.basis @ (few.basis.T @ many.basis)
    assert np.abs(left).max() < 1e-9


@pytest.mark.parametrize("apart", [1.0, 1e-4, 1e-7, 1e-11])
def test_factor_of_many_rows_keeps_the_least_singular_value(apart: float) -> None:
    """Of columns given, and of combinations of columns that stand for them; as LAPACK has it."""
    columns = RNG.standard_normal((20_000, 6)) * [1.0, 1e3, 1e-3, 1.0, 1.0, 0.0]
    columns[:, 4] = columns[:, 0] + 1e-3 * columns[:, 1] + apart * columns[:, 4]
    values = columns[:, 3] + 1e-3 * RNG.standard_normal(20_000)
    mixed = np.eye(6)[:, [0, 1, 2, 4, 5]] + 0.5 * np.eye(6)[:, [3, 3, 2, 3, 5]]
    for some, mix in ((columns, None), (columns, mixed)):
        every = np.column_stack([some if mix is None else some @ mix, values])
        length = np.linalg.norm(every, axis=0)
        length[length == 0] = 1.0
        factor = statistics.quick_factor(some, values, mix)
        sizes = np.linalg.svd(factor / length, compute_uv=False)
        np.testing.assert_allclose(
            sizes, np.linalg.svd(every / length, compute_uv=False), rtol=1e-3, atol=1e-14
        )
        assert not factor[:, every.any(axis=0) == 0].any()


@pytest.mark.parametrize("unit", [1.0, 1e-4, 1e4])
def test_the_rule_does_not_depend_on_units(unit: float) -> None:
    """x, y, 2 x - y and an empty column: the last of the three is held, as is the empty one."""
    x, y = RNG.standard_normal((2, 50))
    columns = np.stack([x, y, (2 * x - y) * unit, 0 * x], axis=1)
    fit = linear_fit(columns, x + y)
    assert fit.rank == 2
    assert fit.held.tolist() == [False, False, True, True]
    assert fit.not_identifiable.tolist() == [True] * 4
    np.testing.assert_allclose(fit.solution, [1.0, 1.0, 0.0, 0.0], atol=1e-12)
    assert np.all(np.isinf(fit.std))
    assert np.abs(columns @ fit.combinations.T).max() < 1e-10
    assert [np.flatnonzero(row).tolist() for row in fit.combinations] == [[3], [0, 1, 2]]


def test_what_is_held_beforehand_is_no_unknown() -> None:
    x, y = RNG.standard_normal((2, 50))
    columns = np.stack([x, y, x + y], axis=1)
    fit = linear_fit(columns, 3 * x + y, hold=np.array([False, False, True]))
    np.testing.assert_allclose(fit.solution, [3.0, 1.0, 0.0], atol=1e-12)
    assert not fit.not_identifiable.any()
    assert fit.held.tolist() == [False, False, True]


@pytest.mark.parametrize("unit", [1.0, 1e-4, 1e4])
def test_a_weak_combination_is_left_alone_as_a_whole(unit: float) -> None:
    """Along the directions the solution is numpy's pseudo-inverse, cut at the same share."""
    x, y, rest, values = RNG.standard_normal((4, 60))
    columns = np.stack([x, y, (x - y + 1e-4 * rest) * unit, 0 * x], axis=1)
    judged = linear_fit(columns, values)
    along = linear_fit(columns @ judged.directions.T, values)
    scale = np.array([*np.linalg.norm(columns[:, :3], axis=0), 1.0])
    expected = np.linalg.pinv(columns / scale, rcond=1e-3) @ values / scale
    np.testing.assert_allclose(along.solution @ judged.directions, expected, rtol=1e-9, atol=1e-15)
    assert judged.rank == len(judged.directions) == 2
    assert judged.not_identifiable.all()


def test_directions_are_parameters_where_combinations_are_exact() -> None:
    x, y = RNG.standard_normal((2, 50))
    fit = linear_fit(np.stack([x, y, x + y], axis=1), x)
    assert fit.directions.tolist() == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    nothing = linear_fit(np.zeros((5, 2)), np.ones(5))
    assert nothing.directions.shape == (0, 2)


def test_numbers_that_are_not_finite_are_refused() -> None:
    with pytest.raises(InputError, match="finite"):
        linear_fit(np.array([[1.0], [np.nan]]), np.ones(2))
    with pytest.raises(InputError, match="columns"):
        linear_fit(np.ones((3, 1)), np.ones(2))
