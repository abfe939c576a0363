"""Runs whose cycles are not alike, and causes that one of the measurements alone names."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import trunnion as tn
from ballbar_twin import Array
from positioning_twin import axis
from trunnion.models.judged import Value, change_of

SEEDS = 20
PPM = 3.0  # of each cycle
UM = 0.4


def _run(seed: int, scale: float, differs: str) -> tn.Positioning:
    """An axis with a scale error (ppm) and 2 µm of reversal; what differs from cycle to cycle."""
    rng = np.random.default_rng([29, seed])
    data = axis(rng, noise=UM)
    number = np.asarray(data.cycle, dtype=int) - 1
    more = np.zeros(len(data))
    if differs == "scale":
        more = 1e-3 * rng.normal(0.0, PPM, 5)[number] * data.target
    if differs == "memory":
        steps = rng.normal(0.0, 2 * UM * np.sqrt(1 - 0.85**2), len(data))
        for i in range(1, len(data)):
            more[i] = 0.85 * more[i - 1] + steps[i]
    error = 1e-3 * scale * data.target + data.direction + more
    return data.with_columns(measured_mm=np.asarray(data["measured_mm"]) + 1e-3 * error)


@pytest.mark.parametrize("differs", ["", "scale", "memory"])
def test_what_differs_from_cycle_to_cycle_is_no_change(differs: str) -> None:
    """A scale of 3 ppm in each cycle was a change in half of the comparisons."""
    found = [
        tn.compare(_run(2 * s, 10.0, differs), _run(2 * s + 1, 10.0, differs)).changed
        for s in range(SEEDS)
    ]
    wrong = sum("scale.ppm" in one for one in found)
    # A bound that less than 1 of 1000 sets of as many comparisons exceed at the stated level.
    assert wrong <= stats.binom.ppf(0.999, SEEDS, 0.05)


def test_a_change_beyond_what_differs_from_cycle_to_cycle_is_found() -> None:
    seen = [
        "scale.ppm"
        in tn.compare(_run(2 * s, 10.0, "scale"), _run(2 * s + 1, 25.0, "scale")).changed
        for s in range(SEEDS)
    ]
    assert np.mean(seen) > 0.8


def test_standard_errors_are_those_of_cycles_that_scatter() -> None:
    """Of the mean of five slopes, each of one cycle, by numpy's fit of a line."""
    one, other = _run(0, 10.0, "scale"), _run(1, 10.0, "scale")
    found = tn.compare(one, other)
    change = next(q for q in found.quantities if q.name == "scale.ppm")
    own = np.array([_slopes(one), _slopes(other)])
    expected = float(np.sqrt(np.sum(own.var(axis=1, ddof=1) / 5)))
    assert change.std_error == pytest.approx(expected, rel=0.05)
    assert change.change == pytest.approx(float(own[1].mean() - own[0].mean()), abs=0.05)


def _slopes(data: tn.Positioning) -> Array:
    """Slope of each cycle, ppm."""
    cycle = np.asarray(data.cycle)
    each = (cycle == k for k in np.unique(cycle))
    return np.array([1e3 * np.polyfit(data.target[c], data.deviation[c], 1)[0] for c in each])


def test_a_cause_that_one_measurement_alone_names_is_one_of_all_candidates() -> None:
    """It was chosen for being large there: by chance, the largest of all candidates is."""
    values = Value(0.0, 0.2), Value(0.9, 0.2)
    alone = change_of("backlash_x.b_um", *values)
    among = change_of("backlash_x.b_um", *(replace(v, among=50.0) for v in values))
    assert among.p_value == pytest.approx(50.0 * alone.p_value)
    few = change_of("backlash_x.b_um", *(replace(v, among=1e9) for v in values))
    assert few.p_value == 1.0


@pytest.mark.parametrize("seed", range(5))
def test_a_cause_that_was_not_there_before_is_a_change(seed: int) -> None:
    before, after = _run(2 * seed, 0.0, ""), _run(2 * seed + 1, 8.0, "")
    assert "scale" not in [c.id for c in tn.diagnose(before).causes]
    assert "scale.ppm" in tn.compare(before, after).changed


def test_runs_with_one_target_in_common_have_no_results_of_the_standard_to_compare() -> None:
    """Of one target mean deviations are nothing, which was "E 0.000000000 µm"."""
    one, other = _run(0, 10.0, ""), _run(1, 10.0, "")
    first = np.asarray(other.target) == other.stops[0][0]
    target = np.where(first, one.stops[0][0], other.target)
    measured = target + np.asarray(other["measured_mm"]) - other.target
    found = tn.compare(one, other.with_columns(target_mm=target, measured_mm=measured))
    assert {q.name for q in found.quantities} == {"scale.ppm", "reversal.b_um"}
    assert any("one place in common" in note for note in found.notes)


def test_what_is_taken_as_scatter_is_said_in_words() -> None:
    found = tn.compare(_run(0, 10.0, "scale"), _run(1, 10.0, "scale"))
    (note,) = (one for one in found.notes if "scatter" in one)
    assert note.startswith("Scale of the axis, another in each cycle")


def test_a_run_of_few_cycles_is_compared_with_one_of_many() -> None:
    """Of two cycles neither zero nor scale is a cause of each."""
    one, other = _run(0, 10.0, ""), _run(1, 10.0, "scale")
    few = one[np.asarray(one.cycle) <= 2]
    found = tn.compare(few, other)
    assert any("scatter" in note for note in found.notes)
    assert "scale.ppm" in found.values
