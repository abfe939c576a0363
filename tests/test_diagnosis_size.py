"""Diagnosis is linear in readings, and its numbers depend neither on storage nor on threads."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

import trunnion as tn
from power.measured_twin import make_sweep
from trunnion.base.units import Floats
from trunnion.diagnosis import candidates, classes, functions, jumps, linearised
from trunnion.diagnosis import columns as kept
from trunnion.diagnosis.effect import Effect, Parameter, Values, periodic
from trunnion.diagnosis.fit import fit
from trunnion.diagnosis.linear_model import LinearModel
from trunnion.diagnosis.model import Covariate, Nuisance, Readings
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.whitening import Scaling, identity


def line(n: int, outliers: int = 0) -> LinearModel:
    """A line with a step, n readings, each a class, a group and a moment of its own."""
    rng = np.random.default_rng(n)
    x = np.linspace(0.0, 1.0, n)
    y = 3.0 * x + 0.5 * (x > 0.4) + rng.standard_normal(n)
    y[rng.choice(n, outliers, replace=False)] += 50.0
    step = Effect("step", (Parameter("h_um"),), lambda v: v["h_um"] * (x > 0.4))
    wave = Effect(
        "wave",
        (Parameter("a_um"), Parameter("pitch_mm", grid=tuple(np.geomspace(0.05, 0.2, 12)))),
        lambda v: v["a_um"] * np.sin(2 * np.pi * x / v["pitch_mm"]),
    )
    return LinearModel(
        x,
        Readings(y, np.arange(n), "µm"),
        [Nuisance("offset", "µm"), Nuisance("slope", "µm")],
        np.stack([np.ones(n), x], axis=1),
        effects=[step, wave],
        covariates=[
            Covariate("position", x, sequence=True),
            Covariate("part", np.arange(n), classes=True),
        ],
        groups=np.arange(n),
        replicates=np.arange(n) // 2,
    )


@pytest.mark.parametrize("outliers", [0, 10])
def test_memory_is_linear_in_readings(outliers: int) -> None:
    """Three times the readings take three times the memory; an n x n array nine times."""
    peaks = []
    for n in (10_000, 30_000):
        model = line(n, outliers)
        tracemalloc.start()
        d = tn.diagnose(model)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert [c.id for c in d.causes] == ["step"]
        assert len(d.outliers) == outliers
    assert peaks[1] < 4 * peaks[0]


def _numbers(d: tn.Diagnosis) -> list[float]:
    numbers = [d.sigma, d.p_value, *d.errors_after.values()]
    return [*numbers, *(v for c in d.causes for v in (*c.parameters.values(), c.p_value))]


@pytest.mark.parametrize("hidden", [(), ("axial_2",), ("radial_3", "tilt_2")])
def test_many_readings_are_stored_in_single_precision_with_the_same_result(
    hidden: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    data = tn.Sweep(**make_sweep(5, hidden, targets=1).columns)
    usual = tn.diagnose(data)
    monkeypatch.setattr(kept, "MAX_DOUBLES", 0)
    monkeypatch.setattr(linearised, "MAX_DOUBLES", 0)
    monkeypatch.setattr(kept, "BATCH_NUMBERS", 2000)
    d = tn.diagnose(data)
    assert (d.verdict, d.alternatives) == (usual.verdict, usual.alternatives)
    np.testing.assert_allclose(_numbers(d), _numbers(usual), rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_fit_of_many_readings_arrives_where_another_step_gains_nothing(seed: int) -> None:
    """A wave beside another that nobody looks for: plain Gauss-Newton steps fall by half each."""
    n, rng = 20_000, np.random.default_rng(seed)
    place = rng.uniform(0.0, 400.0, n)
    y = rng.normal(0.0, 0.4, n)
    for pitch in (64.0, 78.0):
        y += 0.2 * np.cos(2 * np.pi * place / pitch)
    sought = Parameter("pitch_mm", grid=(60.0, 66.0, 72.0, 79.0, 87.0), bounds=(50.0, 100.0))
    wave = periodic("cyclic", sought, [(place, np.ones(n))])
    readings = Readings(y, np.arange(n), "µm")
    model = LinearModel(
        place, readings, [Nuisance("offset", "µm")], np.ones((n, 1)), effects=[wave]
    )
    start = {"cyclic": Values(a_um=0.0, b_um=0.0, pitch_mm=72.0)}
    found = fit(model, np.arange(n), [wave], model.start, start, identity)
    step = np.linalg.lstsq(found.jacobian, found.residuals, rcond=None)[0]
    assert np.sum((found.jacobian @ step) ** 2) < 1e-10 * found.rss


def test_numbers_do_not_depend_on_blas_threads() -> None:
    model = line(2000)
    seen = []
    for threads in (1, 2):
        with threadpool_limits(threads, user_api="blas"):
            seen.append(tn.diagnose(model).to_dict())
    assert seen[0] == seen[1]


def test_a_pencil_of_columns_is_as_good_as_all_of_them() -> None:
    """Variants that are affine in a parameter are kept as two of them, with the same numbers."""
    rng = np.random.default_rng(8)
    base, slope = rng.standard_normal((2, 60, 2))
    at = np.linspace(-3.0, 5.0, 9)
    variants = base + at[:, None, None] * slope
    other = rng.standard_normal((1, 60, 1))
    basis = np.linalg.qr(rng.standard_normal((60, 3)))[0]
    firsts: list[Floats | kept.Pencil] = [variants, kept.Pencil(base, slope, at)]
    made = [
        candidates.Candidates.of_pieces([(0, first), (1, other)], 2, 60 * 19, basis)
        for first in firsts
    ]
    r = rng.standard_normal((60, 4))
    np.testing.assert_allclose(made[1].gains(r), made[0].gains(r), rtol=1e-10)
    np.testing.assert_allclose(made[1].penalty, made[0].penalty, rtol=1e-10)
    for block in range(10):
        ours, theirs = made[1].columns(block), made[0].columns(block)
        np.testing.assert_allclose(ours.T @ ours, theirs.T @ theirs, atol=1e-10)


@pytest.mark.parametrize("shuffled", [False, True])
def test_columns_in_classes_are_as_good_as_all_of_them(shuffled: bool) -> None:
    """Functions times classes are kept as functions, with the same numbers."""
    rng = np.random.default_rng(9)
    label = np.repeat(np.arange(3), [20, 25, 15])
    if shuffled:
        label = rng.permutation(label)
    functions = rng.standard_normal((40, 2, 60))
    functions[[20, 39], 1] = functions[[20, 39], 0]  # of lower rank than those beside them
    inside = label == np.arange(3)[:, None]
    variants = (functions[:, None] * inside[None, :, None]).reshape(40, 6, 60).transpose(0, 2, 1)
    spread = classes.InClasses(functions.__getitem__, 40, label, slice(60))
    basis = np.linalg.qr(rng.standard_normal((60, 3)))[0]
    other = rng.standard_normal((1, 60, 1))
    used = np.flatnonzero(rng.random(60) < 0.9)
    for rows, beside in ((slice(60), basis), (used, np.linalg.qr(basis[used])[0])):
        firsts: list[Floats | kept.Family] = [variants[:, rows], spread.rows(rows)]
        made = [
            candidates.Candidates.of_pieces(
                [(0, first), (1, other[:, rows])], 2, len(beside) * 241, beside
            )
            for first in firsts
        ]
        for r in rng.standard_normal((2, len(beside), 4)):
            np.testing.assert_allclose(made[1].gains(r), made[0].gains(r), rtol=1e-9)
            np.testing.assert_allclose(made[1].gains(r[:, 0]), made[0].gains(r[:, 0]), rtol=1e-9)
        np.testing.assert_allclose(made[1].penalty, made[0].penalty, rtol=1e-9)
        for block in range(41):
            ours, theirs = made[1].columns(block), made[0].columns(block)
            np.testing.assert_allclose(ours.T @ ours, theirs.T @ theirs, atol=1e-10)


def test_sums_of_columns_in_single_precision_are_exact() -> None:
    """Columns that a hundredth of a per mille tells apart."""
    rng = np.random.default_rng(3)
    one, other = rng.standard_normal((2, 200_000))
    columns: Any = np.stack([one, one + 1e-5 * other]).astype(np.float32)
    columns /= np.linalg.norm(columns, axis=1, keepdims=True)
    exact = columns.astype(np.float64) @ columns.astype(np.float64).T
    assert kept.inner(columns, columns.T) == pytest.approx(exact, abs=1e-13)


@pytest.mark.parametrize("weighted", [False, True])
def test_jumps_that_are_not_made_are_those_that_are(
    monkeypatch: pytest.MonkeyPatch, *, weighted: bool
) -> None:
    """Of many readings inner products with jumps are sums over the readings behind them."""
    n, rng = 3000, np.random.default_rng(3)
    model = line(n)
    whiten = Scaling(rng.uniform(0.5, 2.0, n)) if weighted else identity
    rows = np.flatnonzero(rng.random(n) > 0.1)
    made = Dictionary(model, rows, whiten)
    monkeypatch.setattr(functions, "MANY_ROWS", 0)
    monkeypatch.setattr(functions, "AT_ONCE", 100)
    summed = Dictionary(model, rows, whiten)
    assert summed.terms == made.terms
    assert sum(term.kind == "jump" for term in made.terms) > jumps.JUMPS // 2
    basis = np.linalg.qr(rng.standard_normal((len(rows), 3)))[0]
    values = rng.standard_normal((len(rows), 2))
    values -= basis @ (basis.T @ values)
    (gain, rank), (expected, same) = (d.gains(values, basis) for d in (summed, made))
    assert gain == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert np.array_equal(rank, same)
    for term in range(made.count):
        assert summed.block(term) == pytest.approx(made.block(term), abs=1e-14)
