"""What targets reached from one side, or from other sides than before, say of a reversal."""

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import HIDDEN, axis
from promise import kept, needed_runs
from trunnion.models.kinds import model_of

SIDES = "reached from both sides: curve and reversal are not distinguished"


def alternating(rng: np.random.Generator, *, shared: int = 0, cycles: int = 5) -> tn.Positioning:
    """Stops with a curve; of every two neighbours one is reached forward, the other backward.

    shared: So many targets, from the first on, are reached from both sides.
    """
    plain = axis(rng, targets=int(rng.integers(4, 16)), cycles=cycles)
    change = rng.uniform(3, 10, 16)[plain.stops[1]] * rng.choice([-1, 1], 16)[plain.stops[1]]
    data = plain.with_columns(measured_mm=plain.measured + 1e-3 * change)
    number = data.stops[1]
    kept: tn.Positioning = data[(number < shared) | ((-1.0) ** number == data.direction)]
    return kept


@pytest.mark.parametrize(("shared", "said"), [(0, "No target was"), (1, "One of ")])
def test_a_curve_is_no_reversal(shared: int, said: str) -> None:
    runs, good = needed_runs(0.95), 0
    for seed in range(runs):
        data = alternating(np.random.default_rng([seed, shared]), shared=shared)
        found = tn.diagnose(data)
        named = {name for a in found.alternatives for name in a}
        assert not named & {"reversal", "reversal_of_position"}
        text = found.summary()
        assert SIDES in text
        assert said in text
        good += "curve" in named
    assert kept(good, runs, 0.95)


def test_a_reversal_of_position_is_seen_where_both_sides_are() -> None:
    """Parameters for the five targets that are reached from both sides, less one; no others."""
    data = alternating(np.random.default_rng(3), shared=5)
    names = next(e for e in tn.catalogue(data) if e.id == "reversal_of_position").parameters
    assert len(names) == 4
    assert SIDES not in tn.diagnose(data).summary()


def test_the_shortest_pitch_is_of_the_targets_of_one_direction() -> None:
    """Pairs of targets 0.2 mm apart, 40 mm from pair to pair: no wave of 0.4 mm is looked for."""
    rng = np.random.default_rng(8)
    plain = axis(rng)
    data = plain.with_columns(
        target_mm=plain.target + 0.2 * (plain.direction < 0),
        measured_mm=plain.measured + 0.2 * (plain.direction < 0),
    )
    wave = next(e for e in model_of(data).effects if e.id == "periodic")
    assert min(next(p.grid for p in wave.parameters if p.grid)) > 60.0


def test_compare_says_that_the_approach_differs() -> None:
    rng = np.random.default_rng(9)
    plain = axis(rng)
    change = HIDDEN["curve"](plain, rng) + 3.0 * plain.direction * np.sin(plain.target / 100)
    data = plain.with_columns(measured_mm=plain.measured + 1e-3 * change)
    forward, backward = data[data.direction > 0], data[data.direction < 0]
    said = "reached from different directions (forward in before, backward in after)"
    assert said in tn.compare(forward, backward).summary()
    assert "(both in before, forward in" in tn.compare(data, forward).summary()
    lost = data[rng.random(len(data)) > 0.1]
    assert "different directions" not in tn.compare(data, lost).summary()
    odd = (-1.0) ** data.stops[1] == data.direction
    assert "at 11 of 11 targets" in tn.compare(data[odd], data[~odd]).summary()
