"""Probabilities of sets of causes: sums, exact data, and a small sample of the reliability table.

The whole table is docs/results/power-probabilities.md, made by ``make power-probabilities``.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import HIDDEN, axis
from power.probabilities import binned, calibration_error, state
from power.study import draw_effects, ground
from promise import kept
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.probability import Probabilities
from trunnion.diagnosis.selection import search
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement


def drifting(seed: int, *names: str, noise: float = 0.7) -> tn.Positioning:
    rng = np.random.default_rng(seed)
    data = axis(rng, noise=noise)
    change = np.sum([HIDDEN[name](data, rng) for name in names], axis=0)
    return data.with_columns(measured_mm=data.measured + 1e-3 * change)


def test_probabilities_are_of_all_sets_and_of_none() -> None:
    d = tn.diagnose(drifting(1, "drift", "reversal"))
    stated = [a.probability for a in d.evidence]
    assert 0.9 < sum(stated) + d.none_probability <= 1.0
    assert stated == sorted(stated, reverse=True)
    for c in d.causes:
        holding = sum(a.probability for a in d.evidence if c.id in a.causes)
        assert holding <= c.probability <= 1.0
    again = tn.Diagnosis.from_json(d.to_json())
    assert again.none_probability == d.none_probability
    assert [a.probability for a in again.evidence] == stated


def ratios(*names: str) -> tuple[list[float], list[float]]:
    """Odds of the best set against the next over their likelihoods: of one size, of one more."""
    of_one_size: list[float] = []
    one_more: list[float] = []
    for seed in range(30):
        d = tn.diagnose(drifting(seed, *names))
        for first, second in zip(d.evidence[:1], d.evidence[1:2], strict=False):
            ratio = first.probability / second.probability
            stated = ratio / np.exp((second.distance - first.distance) / 2)
            (one_more if second.causes > first.causes else of_one_size).append(stated)
    return of_one_size, one_more


def test_a_likelihood_ratio_is_the_ratio_of_two_sets() -> None:
    """Of two sets of which neither has a cause too many; one more that does not pay weighs less.

    One more that the set hides (a drift beside one from cycle to cycle) keeps its odds instead.
    """
    of_one_size, _ = ratios("cycle_drift")
    assert of_one_size == pytest.approx([1.0] * len(of_one_size))
    assert of_one_size
    _, one_more = ratios("reversal")
    assert one_more
    assert min(one_more) > 1.0


def test_the_summary_leads_with_them() -> None:
    d = tn.diagnose(drifting(2, "reversal"))
    assert d.verdict == "explained"
    assert "99 %)" in d.sentences()[0]
    calm = tn.diagnose(axis(np.random.default_rng(5)))
    assert calm.verdict == "consistent"
    assert "that no known cause acts: " in calm.sentences()[0]


def test_data_without_noise_are_never_in_doubt() -> None:
    """Where no two effects change the readings alike: a rich plan, without those that do."""
    plan, setup, _, read = ground("rich")
    read = replace(read, probe=replace(read.probe, tick_um=0.0))
    for k in range(12):
        rng = np.random.default_rng([9, k])
        names = rng.choice(["drift_y", "c_positioning_2", "squareness_xy", "c_axial"], 2, False)
        hidden = draw_effects(rng, "rich", 2, float(rng.uniform(0.1, 5.0)), tuple(map(str, names)))
        truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=hidden)
        m = measure(plan, setup, truth, noise_um=0.0, tick_um=0.0, seed=k)
        d = tn.diagnose(tn.Touches(m.columns), read)
        assert d.verdict == "explained"
        assert d.named == frozenset(hidden)
        assert d.evidence[0].probability == 1.0
        for c in d.causes:
            for name, value in c.parameters.items():
                assert value == pytest.approx(hidden[c.id][name], rel=1e-4, abs=1e-4)


def test_stops_without_noise_get_their_causes() -> None:
    d = tn.diagnose(drifting(4, "reversal", "scale", noise=0.0))
    assert d.verdict == "explained"
    assert d.named == {"reversal", "scale"}


def test_the_calibration_error_is_what_its_name_says() -> None:
    pairs = [(0.95, True)] * 19 + [(0.95, False)] + [(0.25, True)] * 10 + [(0.25, False)] * 10
    assert calibration_error(pairs) == pytest.approx(0.125)
    assert [n for *_, n in binned(pairs)] == [20, 20]


def test_stated_probabilities_are_true_of_a_sample() -> None:
    """The quickest kind: sets stated with 90 % and more are the hidden ones that often."""
    made = [state("positioning", n, seed=3) for n in range(330)]
    sure = [true for c in made if not c.unknown for p, true in c.sets if p > 0.9]
    assert kept(sum(sure), len(sure), 0.9)
    doubtful = [true for c in made for p, true in c.sets if 0.01 < p < 0.3]
    assert np.mean(doubtful) < 0.35


def test_a_cause_that_another_hides_keeps_its_odds() -> None:
    """Causes act each with odds of one among all, in pairs of which one hides most of the other."""
    cases, count = 600, 8
    rng = np.random.default_rng(0)
    first = rng.standard_normal((100, count // 2))
    second = first + 0.2 * rng.standard_normal(first.shape)
    columns = np.concatenate([first, second], axis=1)
    columns /= np.linalg.norm(columns, axis=0)
    candidates = Candidates([x[None, :, None] for x in columns.T], np.zeros((100, 0)))
    stated, true = np.zeros((2, cases, count))
    for i in range(cases):
        rng = np.random.default_rng([1, i])
        acts = rng.random(count) < 1 / (1 + count)
        size = np.exp(rng.uniform(np.log(4), np.log(100), count)) * rng.choice([-1, 1], count)
        readings = columns @ (acts * size) + rng.standard_normal(100)
        found = Probabilities(search(candidates, readings), candidates)
        stated[i], true[i] = [found.of_cause(j) for j in range(count)], acts
    for low, high in itertools.pairwise((0.0, 0.02, 0.1, 0.3, 0.7, 1.0)):
        some = (stated >= low) & (stated < high)
        error = np.sqrt(stated[some].mean() / some.sum())
        assert true[some].mean() == pytest.approx(stated[some].mean(), abs=3 * error)
    assert np.sum((stated >= 0.02) & (stated < 0.1)) > 200
