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
X, C = 0, 4
PROMISE = 0.97
SEED = 15
CUT = 400  # rows at the beginning of a run, after which every axis is at speed
RADIUS = 5.0  # of a circle, mm
FEEDS = (2000 / 60, 4000 / 60)
NEAR = (-20, 60)  # rows from a reversal of the command, where a log begins
FAR = 4.0  # standard errors


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


@cache
def circles() -> tuple[Floats, ...]:
    """Commands of X on a circle, (rows, 5): two turns at each feed, from a place of no reversal."""
    turns = []
    for feed in FEEDS:
        at = np.arange(0.0, 4 * np.pi, feed / RADIUS * twin.PERIOD)
        turns.append(np.outer(RADIUS * np.sin(at + 0.3), np.eye(5)[X]))
    return tuple(turns)


def turns_at(command: Floats) -> int:
    """Row at which X turns back in its first turn, once the twin has forgotten its start."""
    back = np.flatnonzero(np.diff(np.sign(np.diff(command[:, X]))) != 0) + 1
    return int(back[back > 0.3 * len(command)][0])


def begun(command: Floats, actual: Floats, row: int) -> tuple[Floats, Floats]:
    """One turn from a row on."""
    rows = slice(row, row + len(command) // 2)
    return command[rows], actual[rows]


def x_log(windows: list[tuple[Floats, Floats]], rng: np.random.Generator) -> tn.AxisLog:
    whole = twin.log([c for c, _ in windows], [a for _, a in windows], rng)
    names = ("time_s", "run", "x_cmd_mm", "x_act_mm")
    return tn.AxisLog(**{name: np.asarray(whole.columns[name]) for name in names})


def test_a_log_that_begins_near_a_reversal_names_backlash_and_friction_by_their_sizes() -> None:
    """Its play was taken for that of an axis which came from rest, its friction for that of one."""
    runs, rng = needed_runs(PROMISE), np.random.default_rng(SEED + 2)
    cases, sizes = twin.Cases(runs), []
    for i in range(runs):
        at, most = ((cases.backlash, 8.0), (cases.friction, 5.0))[i % 2]
        sizes.append(float(rng.uniform(1.0, most)))
        at[i, X] = sizes[-1] * twin.SMALL[X]
    actual = [twin.actual(c, cases) for c in circles()]
    good = 0
    for i, size in enumerate(sizes):
        k = int(rng.integers(*NEAR))
        windows = [begun(c, a[i], turns_at(c) + k) for c, a in zip(circles(), actual, strict=True)]
        d = tn.diagnose(x_log(windows, rng), SETUP)
        truth = ("backlash_x", "friction_x")[i % 2]
        named = [c for c in d.causes if c.id == truth]
        near = all(
            abs(value - size) <= FAR * c.std_errors[name]
            for c in named
            for name, value in c.parameters.items()
        )
        good += right(d, truth) and near
    assert kept(good, runs, PROMISE)


def test_rows_just_after_a_reversal_are_left_out_and_said() -> None:
    rng = np.random.default_rng(SEED + 3)
    actual = [twin.actual(c, twin.Cases(1))[0] for c in circles()]
    for k, turned in ((-20, False), (5, True), (120, False)):
        windows = [begun(c, a, turns_at(c) + k) for c, a in zip(circles(), actual, strict=True)]
        model = tn.AxisLogModel(x_log(windows, rng), SETUP)
        assert [run.left_out > 0 for run in model.runs] == [turned, turned]
        assert len(model.remarks) == 2 * turned
        for run, feed in zip(model.runs, FEEDS, strict=True):
            # A way of R (1 - cos) of 25 µm since the axis turned, 1/K after its command.
            way_s = np.arccos(1 - 0.025 / RADIUS) * RADIUS / feed
            expected = 1e3 * (way_s + 1 / twin.GAIN[X]) - k
            assert not turned or abs(run.left_out - expected) < 3
    from_rest = [(c[:900], twin.actual(c[:900], twin.Cases(1))[0]) for c in commands()]
    assert all(run.left_out == 0 for run in tn.AxisLogModel(x_log(from_rest, rng), SETUP).runs)
