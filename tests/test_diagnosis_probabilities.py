"""Probabilities of sets of causes: sums, exact data, and a small sample of the reliability table.

The whole table is docs/results/power-probabilities.md, made by ``make power-probabilities``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import HIDDEN, axis
from power.probabilities import binned, calibration_error, state
from power.study import draw_effects, ground
from promise import kept
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


def test_a_likelihood_ratio_is_the_ratio_of_two_sets() -> None:
    """Of two sets of which neither has a cause too many; one more that does not pay weighs less."""
    of_one_size: list[float] = []
    one_more: list[float] = []
    for seed in range(30):
        d = tn.diagnose(drifting(seed, "cycle_drift"))
        for first, second in zip(d.evidence[:1], d.evidence[1:2], strict=False):
            ratio = first.probability / second.probability
            stated = ratio / np.exp((second.distance - first.distance) / 2)
            (one_more if second.causes > first.causes else of_one_size).append(stated)
    assert of_one_size == pytest.approx([1.0] * len(of_one_size))
    assert of_one_size
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
