"""The further test that is recommended settles the doubt, measured by independent formulas.

The whole table is docs/results/power-further.md, made by ``make power-further``.
"""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from power.further import Machine, again, done, left_of_doubt
from power.study import draw_effects, ground
from promise import kept, needed_runs
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

PROMISE = 0.85  # of what is said to settle the doubt with a probability of CHANCE or more
CHANCE = 0.9
MAX_SETS = 8
NOISE_UM = 0.3
GROUPS = (
    ("trigger_delay",),
    ("scale_x", "scale_y"),
    ("backlash_x", "backlash_y"),
    ("probe_bending",),
    ("scale_x", "scale_y"),
    ("a_positioning",),
)
"""Under the short plan others of the catalogue do much the same."""
Rng = np.random.Generator


def settled(d: tn.Diagnosis, test: tn.NextMeasurement, truth: Truth, rng: Rng) -> bool:
    """Whether the hidden set alone is left of those that were in doubt."""
    try:
        both = again(d, done(test.plan, Machine(truth, NOISE_UM), rng))
    except tn.DataError:  # a touch beside its face, as the artefact stands: nothing is settled
        return False
    return left_of_doubt(d, both) == {frozenset(truth.effects)}


def recommended(seed: int) -> tuple[tn.Diagnosis, tn.NextMeasurement, Truth, Rng] | None:
    """Diagnose hidden causes; the first test, if there is doubt and it may settle it."""
    rng = np.random.default_rng([61, seed])
    plan, setup, _, read = ground("paper")
    hidden: dict[str, dict[str, float]] = {}
    for name in GROUPS[seed % len(GROUPS)]:
        hidden |= draw_effects(rng, "paper", 1, 1.2, (name,))
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=hidden)
    first = measure(plan, setup, truth, noise_um=NOISE_UM, tick_um=0.1, seed=seed)
    d = tn.diagnose(tn.Touches(first.columns), read)
    if frozenset(hidden) not in d.alternatives[:MAX_SETS] or len(d.alternatives) < 2:
        return None
    best = tn.next_measurement(d)[0]
    return (d, best, truth, rng) if best.chance >= CHANCE else None


def achieved(runs: int) -> tuple[list[str], list[bool]]:
    """Kinds of recommended tests, and whether they settled the doubt."""
    kinds: list[str] = []
    came: list[bool] = []
    for seed in range(6 * runs):
        if len(came) < runs and (one := recommended(seed)) is not None:
            kinds.append(one[1].kind)
            came.append(settled(*one))
    return kinds, came


def test_the_recommended_test_settles_the_doubt() -> None:
    """Few runs, so that it fails only if the prediction is far off."""
    kinds, came = achieved(9)
    assert len(came) == 9
    assert {"touches", "positioning"} <= set(kinds)
    assert sum(came) >= 6


@pytest.mark.power
def test_the_recommended_test_settles_the_doubt_as_often_as_it_says() -> None:
    _, came = achieved(needed_runs(PROMISE))
    assert kept(sum(came), len(came), PROMISE)


def test_scales_and_an_artefact_that_grew_are_a_matter_of_another_instrument() -> None:
    one = recommended(1)
    assert one is not None
    d, best, _, _ = one
    assert {"scale_x", "scale_y"} in d.alternatives
    found = {test.label: test for test in tn.next_measurement(d)}
    run, reverse = found["a positioning run of X"], found["the same touches in reversed order"]
    assert run.chance > reverse.chance
    assert all(apart > 4 for apart in run.apart.values())
    assert min(reverse.apart.values()) < 4
    assert best.minutes < 60
    quick = tn.next_measurement(d, mounting_minutes={"positioning": 1.0})
    assert quick[0].kind == "positioning"
    again = tn.NextMeasurement.from_dict(best.to_dict())
    assert (again.label, again.apart, again.chance) == (best.label, best.apart, best.chance)


def test_without_doubt_there_is_nothing_to_measure() -> None:
    d = tn.diagnose(tn.read_ballbar(tn.sample_path("ballbar/circle.csv")))
    assert tn.next_measurement(d) == ()
    with pytest.raises(tn.UnknownNameError, match="ballbar"):
        tn.next_measurement(d, mounting_minutes={"balbar": 3.0})


@pytest.mark.parametrize("axis", ["X", "Y", "Z", "A", "C"])
def test_a_positioning_run_in_doubt_that_names_its_axis(axis: str) -> None:
    """What only the instrument has, a curve of many parameters too, is fitted beside each test."""
    plain = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    d = tn.diagnose(plain.with_columns(axis=np.full(len(plain), axis)))
    assert d.verdict == "ambiguous"
    assert all(0.0 <= one.chance <= 1.0 for one in tn.next_measurement(d))


def test_a_shift_of_no_known_size_leaves_the_other_sets_to_settle() -> None:
    """One after nearly all touches is 12 mm by what is left: no further touch meets with it."""
    one = recommended(587)
    assert one is not None
    d = one[0]
    doubtful = {a.causes for a in d.evidence[1:]}
    assert any("setup_shift" in causes for causes in doubtful)
    assert any(set(test.apart) < doubtful for test in tn.next_measurement(d))
