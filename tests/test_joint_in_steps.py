"""Several measurements that a control or a file records in steps, diagnosed together."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

import from_twin
import trunnion as tn
from power.ticks import COVERED, TICK_UM, ground, recorded, rounded, starts, touches
from promise import kept, needed_runs
from trunnion.base.resolution import Grid, Known
from twin.forward import Truth
from twin.generator import random_errors, random_placement

NULLS = 0.95
HELD = 0.93  # of 95 % intervals, as in the table of one measurement


def twice(seed: int, ratio: float, read: str) -> tuple[tn.Diagnosis, dict[str, float]]:
    """A sound machine measured on two dates by the rich plan: its diagnosis, errors over u."""
    plan, setup, _, _ = ground("rich")
    rng = np.random.default_rng([seed, 77])
    errors, noise, data = random_errors(rng), ratio * TICK_UM, []
    for _ in range(2):
        truth = Truth(errors, random_placement(rng), {})
        if read == "rounded":
            at = rounded(plan, setup, truth, noise, rng)
        else:
            at = recorded(plan, setup, truth, noise, starts(plan, read == "yes", rng), rng)
        data.append(touches(plan, at))
    stated = setup if read != "rounded" else replace(setup, tick_um=0.0)
    d = tn.diagnose(data, from_twin.setup(stated))
    known = {k: s for k, s in d.errors_std.items() if math.isfinite(s)}
    return d, {k: (d.errors_after[k] - errors[k]) / s for k, s in known.items()}


def test_sound_machines_measured_twice_in_rounded_coordinates() -> None:
    """Nothing changed, and no effect is there: repeats that round alike must not say so."""
    runs, good = needed_runs(NULLS), 0
    held: list[bool] = []
    for seed in range(runs):
        d, z = twice(seed, (0.0, 0.03, 0.1)[seed % 3], "rounded")
        good += d.verdict == "consistent"
        held += [abs(x) <= COVERED for x in z.values()]
    assert kept(good, runs, NULLS), f"{good} of {runs}"
    assert kept(sum(held), len(held), HELD), f"{sum(held)} of {len(held)}"


def test_the_grid_of_several_measurements_keeps_what_each_knows() -> None:
    label = np.array([0, 0, -1])
    one = Grid(np.ones(3), label, None, Known(np.full(3, 0.2), np.ones(3), 0.5))
    way = np.tile([0.0, 0.8, -0.6], (2, 1))
    other = Grid(
        np.full(2, 5.0),
        np.zeros(2, dtype=np.intp),
        way,
        Known(np.full(2, 4.0), np.full(2, 5.0), 0.1),
    )
    assert Grid.joined([(None, 4), (None, 1)]) is None
    both = Grid.joined([(one, 3), (None, 4), (other, 2)])
    assert both is not None
    assert both.known is not None
    assert both.parts is not None
    assert list(both.step) == [1, 1, 1, 0, 0, 0, 0, 5, 5]
    assert list(both.label) == [0, 0, -1, -1, -1, -1, -1, 1, 1]
    assert np.array_equal(both.parts[:3], np.tile([1.0, 0.0, 0.0], (3, 1)))
    assert np.array_equal(both.parts[-2:], way)
    assert both.rounding == (3 * 0.5 + 2 * 0.1) / 9
    white = both.known.completed(np.zeros((9, 2000)))
    # where nothing is rounded there is noise, whatever the others do
    assert np.all(white[[0, 1, 2, 7, 8]] == 0.0)
    assert np.abs(np.std(white[3:7], axis=1) - 1.0).max() < 0.1
