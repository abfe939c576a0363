"""The rates of the power table, held with as many runs as that takes. The table: ``make power``."""

from __future__ import annotations

import pytest

from power.study import Case, Tally, part, run
from promise import kept, needed_runs


def count(tally: Tally, what: str) -> int:
    return sum(bool(getattr(o, what)) for o in tally.outcomes)


@pytest.mark.parametrize("plan", ["paper", "rich"])
@pytest.mark.parametrize("noise", ["gaussian", "heavy"])
def test_no_effect(plan: str, noise: str) -> None:
    runs = needed_runs(0.95)
    t = run(Case("no effect", plan, noise_um=(0.1, 2.0), noise=noise), runs, seed=11)
    consistent = sum(o.diagnosis.verdict == "consistent" for o in t.outcomes)
    assert kept(consistent, runs, 0.95)


@pytest.mark.parametrize(
    ("case", "promise"),
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
def test_hidden_effects_are_found(case: Case, promise: float) -> None:
    runs = max(needed_runs(promise), needed_runs(0.97))
    t = run(case, runs, seed=12)
    assert kept(count(t, "among"), runs, promise)
    assert kept(runs - count(t, "wrong"), runs, 0.97)
    assert t.alternatives <= 3
    covered, intervals = t.coverage
    assert kept(round(covered * intervals), intervals, 0.90)


@pytest.mark.parametrize("plan", ["paper", "rich"])
def test_effects_outside_the_catalogue(plan: str) -> None:
    runs = needed_runs(0.90)
    t = run(Case("unknown", plan, size=1.0, unknown=True), runs, seed=13)
    assert kept(count(t, "quantity_named"), runs, 0.90)


@pytest.mark.parametrize("plan", ["paper", "rich"])
def test_outliers(plan: str) -> None:
    runs = needed_runs(0.95)
    t = run(Case("outliers", plan, outliers=0.05), runs, seed=14)
    assert kept(count(t, "outliers_found"), runs, 0.95)
    unnamed = sum(not o.diagnosis.causes for o in t.outcomes)
    assert kept(unnamed, runs, 0.97)


def test_large_effects_are_no_outliers() -> None:
    runs = needed_runs(0.97)
    t = run(Case("large", "rich", 1, 8.0), runs, seed=15)
    assert kept(count(t, "among"), runs, 0.97)
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


def test_the_predicted_discrimination_is_achieved() -> None:
    """Aliases of A under the paper's plan, told apart by the touches of ``next_touches``.

    Few runs, so that it fails only if the prediction is far off; the rate is in docs/power.md.
    """
    t = run(Case("alike", "paper", size=1.0, only=("a_positioning",)), 8, seed=17)
    achieved = predicted = 0
    for k, o in enumerate(t.outcomes):
        if o.diagnosis.verdict == "ambiguous":
            chance, came = part(o, 16, seed=k)
            predicted += chance >= 0.9
            achieved += chance >= 0.9 and came
    assert predicted >= 4
    assert achieved >= 0.6 * predicted
