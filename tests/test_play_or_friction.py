"""Backlash beside what looks like it: friction, a start in the midst of motion.

Logs of the independent twin: its C axis turns one way over the path of the paper, so that only its
start tells backlash from Coulomb friction.
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
CUT = 400  # rows at the beginning of a run, after which every axis is at speed


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


def log(
    actual: list[Floats], rng: np.random.Generator, axis: int = C, skipped: int = 0
) -> tn.AxisLog:
    """Log of one axis alone, without the first rows of each run."""
    commanded = [c[skipped:] for c in commands()]
    whole = twin.log(commanded, [a[skipped:] for a in actual], rng)
    letter, unit = twin.AXES[axis].lower(), "mm" if axis < 3 else "deg"
    names = ("time_s", "run", f"{letter}_cmd_{unit}", f"{letter}_act_{unit}")
    return tn.AxisLog(**{name: np.asarray(whole.columns[name]) for name in names})


def right(d: Diagnosis, *truth: str) -> bool:
    """Whether the truth alone explains the log, and nothing is left."""
    return frozenset(truth) in d.alternatives and d.unexplained is None


def drawn(runs: int, rng: np.random.Generator) -> tuple[list[int], twin.Cases]:
    """Backlash of the twin's usual sizes on an axis drawn."""
    cases, axes = twin.Cases(runs), rng.integers(5, size=runs).tolist()
    for i, j in enumerate(axes):
        cases.backlash[i, j] = rng.uniform(1.0, 8.0) * twin.SMALL[j] * (2 if j >= 3 else 1)
    return axes, cases


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


def test_a_log_that_begins_in_motion_begins_with_its_play_taken_up() -> None:
    runs, rng = needed_runs(PROMISE), np.random.default_rng(SEED + 1)
    axes, cases = drawn(runs, rng)
    actual = [twin.actual(c, cases) for c in commands()]
    good = 0
    for i, j in enumerate(axes):
        d = tn.diagnose(log([a[i] for a in actual], rng, j, CUT), SETUP)
        good += right(d, f"backlash_{twin.AXES[j].lower()}")
    assert kept(good, runs, PROMISE)
