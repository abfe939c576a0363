"""Blind tests: causes hidden by a generator of its own are named, and nothing else is.

A seeded sample of ``ballbar_study.py``, which prints the whole table.
"""

import numpy as np
import pytest

from ballbar_study import CARTESIAN, HYBRID, run

RUNS = 2


@pytest.mark.parametrize("hidden", HYBRID)
def test_causes_of_the_hybrid_machine_are_named_or_in_the_alias_group(hidden: str) -> None:
    runs = 1 if hidden == "gravity" else RUNS
    outcomes = [run("hybrid", hidden, seed) for seed in range(runs)]
    assert all(o.found for o in outcomes), outcomes


@pytest.mark.parametrize("hidden", CARTESIAN)
def test_causes_of_a_plain_circle_test_are_named_or_in_the_alias_group(hidden: str) -> None:
    outcomes = [run("cartesian", hidden, seed) for seed in range(RUNS)]
    assert all(o.found for o in outcomes), outcomes


@pytest.mark.parametrize(("kind", "count"), [("hybrid", 5), ("cartesian", 10)])
def test_nothing_is_named_without_an_effect(kind: str, count: int) -> None:
    # At 5 % of false alarms two of five have a chance of 2 %, three of ten of 1 %.
    outcomes = [run(kind, None, seed) for seed in range(count)]
    assert sum(not o.found for o in outcomes) <= count // 5, outcomes


def test_named_causes_have_their_size() -> None:
    backlash = run("cartesian", "backlash", 21)
    assert abs(backlash.parameters["b_um"]) == pytest.approx(3.0, abs=0.2)
    lost = run("hybrid", "lost_motion", 21)
    assert abs(lost.parameters["b_um"]) == pytest.approx(6.0, abs=0.4)
    screw = run("hybrid", "screw_cyclic", 21).parameters
    assert np.hypot(screw["a_um"], screw["b_um"]) == pytest.approx(2.0, abs=0.2)
