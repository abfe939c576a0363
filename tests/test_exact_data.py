"""Data without any noise get the set that made them, in whatever number and size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import trunnion as tn
from power.study import draw_effects, ground
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement


def exact(plan: str, seed: int) -> tuple[tn.Diagnosis, frozenset[str]]:
    """Diagnose touches of the independent generator without noise or ticks; what is hidden."""
    rng = np.random.default_rng([5, seed, *plan.encode()])
    made, twin, _, read = ground(plan)
    while True:
        hidden = draw_effects(rng, plan, 1 + seed % 3, 1.0)
        # What is always fitted absorbs a part of a sag, which comes back in second order.
        if "a_sag" not in hidden:
            break
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=hidden)
    m = measure(made, twin, truth, noise_um=0.0, tick_um=0.0, seed=seed)
    setup = replace(read, probe=replace(read.probe, tick_um=0.0))
    return tn.diagnose(tn.Touches(m.columns), setup), frozenset(hidden)


@pytest.mark.parametrize("seed", range(9))
def test_a_rich_plan_gets_the_right_set(seed: int) -> None:
    d, hidden = exact("rich", seed)
    assert (d.verdict, d.named) == ("explained", hidden)
    assert d.gain.rms_after_um < 1e-6
    assert not d.outliers


@pytest.mark.parametrize("seed", range(9))
def test_a_short_plan_gets_the_sets_that_fit_exactly(seed: int) -> None:
    """The paper's plan does not distinguish a ball radius from a delay: every set fits exactly."""
    d, hidden = exact("paper", seed)
    assert d.verdict in ("explained", "ambiguous")
    assert hidden in d.alternatives
    assert not d.outliers
    assert all(len(a) <= len(hidden) for a in d.alternatives)
    for one in d.alternatives:
        fit = tn.identify(d.data, d.setup, effects=tuple(sorted(one)))
        assert fit.rms_um < 1e-6
