"""Axis logs whose positions are rounded: rounding is no cause, and hides none of a usual size."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import axis_log_twin as twin
import trunnion as tn
from promise import kept, needed_runs
from trunnion import contouring as ct
from trunnion.models.axis_log import AxisLogModel
from trunnion.models.axis_log.steps import step_of
from trunnion.models.kinds import diagnose
from trunnion.setup import Artefact, Setup

SETUP = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
STEPS = ((1.0, 0.001), (5.0, 0.005), (10.0, 0.01))  # µm and deg
NOISES = (0.0, 0.03, 0.1)  # in steps
QUIET = 0.85
FEEDS = (6000 / 60, 12000 / 60)
Floats = NDArray[np.float64]


@cache
def commands() -> tuple[Floats, ...]:
    return tuple(twin.commanded(feed) for feed in FEEDS)


@cache
def sound() -> tuple[Floats, ...]:
    return tuple(twin.actual(c, twin.Cases(1))[0] for c in commands())


def log(
    actual: tuple[Floats, ...], step: tuple[float, float], noise: float, seed: int
) -> tn.AxisLog:
    """Actual positions in steps, which lie anywhere; noise in steps."""
    rng = np.random.default_rng(seed)
    own = np.array([step[0] * 1e-3] * 3 + [step[1]] * 2)
    place = own * rng.uniform(0.0, 1.0, 5)
    columns: dict[str, Floats] = {
        "time_s": np.concatenate([np.arange(len(c)) * twin.PERIOD for c in commands()]),
        "run": np.concatenate([np.full(len(c), i) for i, c in enumerate(commands())]),
    }
    every = np.concatenate([a + noise * own * rng.standard_normal(a.shape) for a in actual])
    read = own * np.round((every + place) / own)
    for i, name in enumerate(("x_{}_mm", "y_{}_mm", "z_{}_mm", "a_{}_deg", "c_{}_deg")):
        columns[name.format("cmd")] = np.concatenate(commands())[:, i] + place[i]
        columns[name.format("act")] = read[:, i]
    return tn.AxisLog(**columns)


def test_rounding_is_no_cause() -> None:
    runs = needed_runs(QUIET)
    quiet = 0
    for i in range(runs):
        step, noise = STEPS[i % 3], NOISES[i // 3 % 3]
        quiet += diagnose(log(sound(), step, noise, i), SETUP).verdict == "consistent"
    assert kept(quiet, runs, QUIET)
