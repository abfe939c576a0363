"""Axis logs of a servo in two states compared: each state's size is its own.

Logs of the independent twin; where play is between the loop and the load, of the core.
"""

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

import axis_log_twin as twin
import trunnion as tn
from trunnion import contouring as ct
from trunnion.setup import Artefact, Setup

TABLE = ct.Servo.paper().to_table()
SETUP = Setup(artefact=Artefact("none"), servo=TABLE)
X, Y = 0, 1
GAIN, FRICTION, PLAY = "gain_y.gain_percent", "friction_x.coulomb_um", "backlash_x.backlash_um"


@cache
def commands() -> tuple[twin.Array, ...]:
    return tuple(twin.commanded(feed) for feed in (100.0, 200.0))


def logged(found: Mapping[str, float], seed: int) -> tn.AxisLog:
    """X and Y of a servo with a gain (%), friction and play (µm) of its own."""
    cases = twin.Cases(1)
    cases.gain[0, Y] *= 1 + found.get(GAIN, 0.0) / 100
    cases.friction[0, X] = 1e-3 * found.get(FRICTION, 0.0)
    cases.backlash[0, X] = 1e-3 * found.get(PLAY, 0.0)
    actual = [twin.actual(c, cases)[0] for c in commands()]
    log = twin.log(commands(), actual, np.random.default_rng(seed))
    names = ["time_s", "run", *(f"{x}_{what}_mm" for x in "xy" for what in ("cmd", "act"))]
    return tn.AxisLog(**{name: np.asarray(log[name]) for name in names})


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({GAIN: 11.74}, {GAIN: -13.09}),
        ({GAIN: 20.0, FRICTION: 3.0, PLAY: 2.0}, {GAIN: -15.0, FRICTION: 9.0, PLAY: 12.0}),
        ({}, {GAIN: 5.0, FRICTION: 10.0}),
    ],
)
def test_each_log_has_the_sizes_of_its_own_state(
    before: Mapping[str, float], after: Mapping[str, float]
) -> None:
    """Columns taken about the first log made a gain of −13.09 % one of −16.8 %."""
    found = tn.compare(logged(before, 200), logged(after, 201), setup=SETUP)
    assert after.keys() <= found.changed
    for name in after:
        ends, stds = found.values[name], found.std_errors[name]
        assert ends[0] == pytest.approx(before.get(name, 0.0), abs=4 * stds[0])
        assert ends[1] == pytest.approx(after[name], abs=4 * stds[1])


def test_play_in_front_of_a_load_that_is_fed_back() -> None:
    """6 → 18 µm, either way round: what a log says does not depend on the one beside it."""
    true = (6.0, 18.0)
    logs = []
    for seed, play in enumerate(true):
        table = {**TABLE, "feedback": "load", "Y": {**TABLE["Y"], "backlash_um": play}}
        servo = ct.Servo.from_table(table)
        runs = [
            ct.simulate(ct.Path.paper(), feed, controller="independent", servo=servo).axis_log(
                noise_um=0.2, noise_arcsec=1.0, seed=2 * seed + i, run=f"{feed:g}"
            )
            for i, feed in enumerate((3000.0, 6000.0))
        ]
        logs.append(tn.AxisLog.concatenate(runs))
    setup = Setup(artefact=Artefact("none"), servo={**TABLE, "feedback": "load"})
    there, back = (tn.compare(*pair, setup=setup) for pair in (logs, logs[::-1]))
    name = "backlash_y.backlash_um"
    assert there.changed == {name}
    for i, play in enumerate(true):
        assert there.values[name][i] == pytest.approx(play, abs=4 * there.std_errors[name][i])
        assert back.values[name][1 - i] == pytest.approx(there.values[name][i], rel=1e-4)
