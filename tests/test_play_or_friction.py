"""Backlash and Coulomb friction of an axis that never turns back: only its start tells them apart.

Logs of the independent twin: its C axis turns one way over the path of the paper.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

import axis_log_twin as twin
import trunnion as tn
from promise import kept, needed_runs
from trunnion import contouring as ct
from trunnion.diagnosis.result import Diagnosis
from trunnion.setup import Artefact, Setup

Floats = NDArray[np.float64]

SETUP = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
C = 4
PROMISE = 0.97
SEED = 15


@cache
def commands() -> tuple[Floats, ...]:
    return tuple(twin.commanded(feed) for feed in (50.0, 100.0))


def hidden(runs: int, rng: np.random.Generator) -> tuple[list[str], twin.Cases]:
    """Backlash and friction in turn, of the twin's usual sizes."""
    cases = twin.Cases(runs)
    for i in range(runs):
        at, most = ((cases.backlash, 8.0), (cases.friction, 5.0))[i % 2]
        at[i, C] = rng.uniform(1.0, most) * 2 * twin.SMALL[C]
    return [("backlash_c", "friction_c")[i % 2] for i in range(runs)], cases


def log(actual: list[Floats], rng: np.random.Generator) -> tn.AxisLog:
    """Log of the C axis alone."""
    whole = twin.log(commands(), actual, rng)
    names = ("time_s", "run", "c_cmd_deg", "c_act_deg")
    return tn.AxisLog(**{name: np.asarray(whole.columns[name]) for name in names})


def right(d: Diagnosis, truth: str) -> bool:
    """Whether the truth alone explains the log, and nothing is left."""
    return frozenset({truth}) in d.alternatives and d.unexplained is None


def test_the_axis_never_turns_back() -> None:
    assert all(np.all(np.diff(c[:, C]) >= 0) or np.all(np.diff(c[:, C]) <= 0) for c in commands())


def test_backlash_and_friction_compete_where_an_axis_never_turns_back() -> None:
    runs, rng = needed_runs(PROMISE), np.random.default_rng(SEED)
    truths, cases = hidden(runs, rng)
    actual = [twin.actual(c, cases) for c in commands()]
    good = 0
    for i, truth in enumerate(truths):
        d = tn.diagnose(log([a[i] for a in actual], rng), SETUP)
        good += right(d, truth)
    assert kept(good, runs, PROMISE)
