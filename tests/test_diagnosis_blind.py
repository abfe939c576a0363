"""A sample of the power table: fails when a rate has moved. The whole of it: ``make power``."""

from __future__ import annotations

import pytest
from scipy import stats

from power.study import Case, Tally, part, run

RUNS = 12


def no_worse(good: int, count: int, expected: float) -> bool:
    """Whether this many good ones of count speak against a rate of at least that (1 in 1000)."""
    return good >= stats.binom.ppf(0.001, count, expected)


def count(tally: Tally, what: str) -> int:
    return sum(bool(getattr(o, what)) for o in tally.outcomes)


@pytest.mark.parametrize("plan", ["paper", "rich"])
@pytest.mark.parametrize("noise", ["gaussian", "heavy"])
def test_no_effect(plan: str, noise: str) -> None:
    t = run(Case("no effect", plan, noise_um=(0.1, 2.0), noise=noise), RUNS, seed=11)
    consistent = sum(o.diagnosis.verdict == "consistent" for o in t.outcomes)
    assert no_worse(consistent, RUNS, 0.95)


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        (Case("one", "paper", 1, 1.0), 0.99),
        (Case("one", "rich", 1, 0.4), 0.99),
        (Case("two", "paper", 2, 1.0), 0.95),
        (Case("two", "rich", 2, 0.5), 0.97),
        (Case("three", "rich", 3, 0.7), 0.95),
        (Case("four", "rich", 4, 1.0), 0.90),
    ],
    ids=lambda x: f"{x.name} {x.plan}" if isinstance(x, Case) else None,
)
def test_hidden_effects_are_found(case: Case, expected: float) -> None:
    t = run(case, RUNS, seed=12)
    assert no_worse(count(t, "among"), RUNS, expected)
    assert no_worse(RUNS - count(t, "wrong"), RUNS, 0.97)
    assert t.alternatives <= 3
    covered, intervals = t.coverage
    assert no_worse(round(covered * intervals), intervals, 0.90)


@pytest.mark.parametrize("plan", ["paper", "rich"])
def test_effects_outside_the_catalogue(plan: str) -> None:
    t = run(Case("unknown", plan, size=1.0, unknown=True), RUNS, seed=13)
    assert no_worse(count(t, "quantity_named"), RUNS, 0.90)


@pytest.mark.parametrize("plan", ["paper", "rich"])
def test_bad_touches(plan: str) -> None:
    t = run(Case("outliers", plan, outliers=0.05), RUNS, seed=14)
    assert no_worse(count(t, "outliers_found"), RUNS, 0.95)
    unnamed = sum(not o.diagnosis.causes for o in t.outcomes)
    assert no_worse(unnamed, RUNS, 0.97)


def test_large_effects_are_no_outliers() -> None:
    t = run(Case("large", "rich", 1, 8.0), RUNS, seed=15)
    assert no_worse(count(t, "among"), RUNS, 0.97)
    assert not any(o.diagnosis.outliers for o in t.outcomes)


def test_bias_of_the_location_errors_is_removed() -> None:
    t = run(Case("bias", "rich", size=2.0, only=("drift_z",)), 6, seed=16)
    for o in t.outcomes:
        true = o.measurement.truth.errors
        before = abs(o.diagnosis.errors_before["EZ0A"] - true["EZ0A"])
        after = abs(o.diagnosis.errors_after["EZ0A"] - true["EZ0A"])
        assert after < 0.5
        assert after < 0.5 * before
        assert o.diagnosis.gain.heldout_rms_after_um < 0.5 * o.diagnosis.gain.heldout_rms_before_um


def test_the_predicted_chance_of_parting_is_kept() -> None:
    """Aliases of A under the paper's plan, parted by the touches that ``next_touches`` plans."""
    t = run(Case("alike", "paper", size=1.0, only=("a_positioning",)), 4, seed=17)
    parted = promised = 0
    for k, o in enumerate(t.outcomes):
        if o.diagnosis.verdict == "ambiguous":
            chance, came = part(o, 16, seed=k)
            promised += chance >= 0.9
            parted += chance >= 0.9 and came
    assert promised >= 2
    assert no_worse(parted, promised, 0.9)
