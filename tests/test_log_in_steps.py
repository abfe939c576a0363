"""Axis logs whose positions are rounded: rounding is no cause, and hides none of a usual size."""

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

import axis_log_twin as twin
import trunnion as tn
from promise import kept, needed_runs
from trunnion import contouring as ct
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.axis_log import AxisLogModel
from trunnion.models.kinds import diagnose
from trunnion.setup import Artefact, Setup

Floats = NDArray[np.float64]

AXES_TABLE = {k: v for k, v in ct.Servo.paper().to_table().items() if isinstance(v, dict)}
SETUP = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
STEP = 0.005  # mm, deg
AXES = {"z": (2, "mm"), "c": (4, "deg")}  # the slow ones: their errors of rounding are the slowest
NOISES = (0.0, 0.03, 0.1)  # in steps
PROMISE = 0.97
FEEDS = (12000 / 60, 24000 / 60)
HIDDEN = ("none", "gain", "none", "none", "backlash", "none", "none", "loop_delay")


@cache
def commands() -> tuple[Floats, ...]:
    return tuple(twin.commanded(feed) for feed in FEEDS)


def moved(cases: twin.Cases) -> tuple[Floats, ...]:
    return tuple(twin.actual(c, cases)[0] for c in commands())


@cache
def hidden(kind: str, letter: str) -> tuple[str | None, tuple[Floats, ...]]:
    """Effect on an axis of several times the scatter of rounding, and the motion with it."""
    cases, column = twin.Cases(1), AXES[letter][0]
    match kind:
        case "none":
            return None, moved(cases)
        case "backlash":
            cases.backlash[0, column] = 2.0 * STEP
        case "gain":
            cases.gain[0, column] *= 1.3
        case "loop_delay":
            cases.delay[0, column] = 1.5e-3
    return f"{kind}_{letter}", moved(cases)


def log(
    actual: tuple[Floats, ...], letters: str, noise: float, seed: int, *, of_command: bool
) -> tn.AxisLog:
    """Positions of some axes in steps, which lie anywhere; ``noise`` in steps."""
    rng = np.random.default_rng(seed)
    columns: dict[str, Floats] = {
        "time_s": np.concatenate([np.arange(len(c)) * twin.PERIOD for c in commands()]),
        "run": np.concatenate([np.full(len(c), i) for i, c in enumerate(commands())]),
    }
    for letter in letters:
        (column, unit), step = AXES[letter], STEP
        place = step * rng.uniform()
        commanded = np.concatenate(commands())[:, column] + place
        own = np.concatenate(actual)[:, column] + place
        own = own + noise * step * rng.standard_normal(len(own))
        columns[f"{letter}_act_{unit}"] = step * np.round(own / step)
        if of_command:
            commanded = step * np.round(commanded / step)
        columns[f"{letter}_cmd_{unit}"] = commanded
    return tn.AxisLog(**columns)


def right(d: Diagnosis, truth: str | None) -> bool:
    if truth is None:
        return d.verdict == "consistent"
    return any(truth == c.id or truth in c.aliases for c in d.causes) or any(
        truth in names for names in d.alternatives
    )


def test_rounding_is_no_cause_and_hides_none() -> None:
    runs, good = needed_runs(PROMISE), 0
    for i in range(runs):
        letter = "zc"[i // 8 % 2]
        truth, actual = hidden(HIDDEN[i % 8], letter)
        noise, of_command = NOISES[i // 16 % 3], i % 3 == 0
        d = diagnose(log(actual, letter, noise, i, of_command=of_command), SETUP)
        good += right(d, truth)
    assert kept(good, runs, PROMISE)


def test_steps_are_said_where_they_matter_and_change_nothing_where_not() -> None:
    _, sound = hidden("none", "z")
    coarse = diagnose(log(sound, "zc", 0.1, 1, of_command=False), SETUP)
    assert any("recorded in steps of 5 µm, 18 arcsec" in note for note in coarse.notes)
    assert AxisLogModel(log(sound, "zc", 0.7, 1, of_command=False), SETUP).grid is None


def noted(log: tn.AxisLog, **stated: float) -> str:
    """Return the note on steps with a step of some axes stated in the set-up."""
    servo = {name: dict(table) for name, table in AXES_TABLE.items()}
    for key, size in stated.items():
        letter, _, name = key.partition("_")
        servo[letter.upper()][name] = size
    (note,) = (n for n in diagnose(log, replace(SETUP, servo=servo)).notes if "in steps" in n)
    return note


def test_a_stated_step_is_used_and_said() -> None:
    _, sound = hidden("none", "z")
    coarse = log(sound, "zc", 0.1, 1, of_command=False)
    assert "steps of 5 µm, 18 arcsec (recognised in the data)" in noted(coarse)
    both = noted(coarse, z_resolution_um=5.0, c_resolution_arcsec=18.0)
    assert "steps of 5 µm, 18 arcsec (as the set-up states)" in both
    one = noted(coarse, z_resolution_um=5.0)
    assert "steps of 5 µm, 18 arcsec (recognised in the data or as the set-up states)" in one
    assert "steps of 5 µm, 18 arcsec (recognised" in noted(coarse, z_resolution_um=1.0)


def test_a_stated_step_is_used_where_the_data_do_not_show_it() -> None:
    """Positions that a program has scaled and rounded once more lie on no grid."""
    _, sound = hidden("none", "z")
    coarse = log(sound, "z", 0.1, 1, of_command=False)
    again = coarse.actual("z") + 2e-4 * np.random.default_rng(3).uniform(-1, 1, len(coarse))
    blurred = coarse.with_columns(z_act_mm=again)
    assert AxisLogModel(blurred, SETUP).grid is None
    assert "steps of 5 µm (as the set-up states)" in noted(blurred, z_resolution_um=5.0)


def test_a_stated_step_is_no_part_of_the_simulation() -> None:
    plain = ct.LinearAxis(80.0, 5.0)
    stated = ct.LinearAxis(80.0, 5.0, resolution_um=5.0)
    first, other = (ct.Servo({"X": axis}).row("X") for axis in (plain, stated))
    np.testing.assert_array_equal(first, other)
    assert ct.Servo.from_table(ct.Servo({"X": stated}).to_table()).axes["X"] == stated
