"""Windows of axis logs, begun and ended anywhere: sound ones are taken, mistakes in them named.

Logs of the independent twin, and of an axis at constant speed from a start on.
"""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import axis_log_twin as twin
import trunnion as tn
from trunnion import contouring as ct
from trunnion.models.axis_log import AxisLogModel
from trunnion.setup import Artefact, Setup

Floats = NDArray[np.float64]

SETUP = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
AXES = dict(zip("xyzac", ("mm", "mm", "mm", "deg", "deg"), strict=True))
WINDOWS = 60
SEED = 31
MOVES = 0.05  # mm or deg, rms: an axis that moves less is at rest, whatever is recorded
SPECIFIC = 0.9  # of the windows with following errors; some are as like the motion


@cache
def motions() -> list[tuple[Floats, Floats]]:
    """Commanded and actual positions, (rows, 5), at two feeds."""
    commands = [twin.commanded(feed / 60) for feed in (1000, 3000)]
    return [(command, twin.actual(command, twin.Cases(1))[0]) for command in commands]


def windows(least: float = 0.0) -> list[tuple[str, Floats, Floats]]:
    """Axis, commanded and actual positions of windows in which it moves at least so much."""
    rng = np.random.default_rng(SEED)
    found: list[tuple[str, Floats, Floats]] = []
    while len(found) < WINDOWS:
        command, actual = motions()[int(rng.integers(2))]
        count = int(np.exp(rng.uniform(np.log(60), np.log(len(command)))))
        begin, k = int(rng.integers(len(command) - count + 1)), int(rng.integers(5))
        rows, small = slice(begin, begin + count), 2e-4
        noisy = actual[rows, k] + small * rng.standard_normal(count)
        if np.std(command[rows, k]) >= least:
            found.append(("xyzac"[k], command[rows, k], noisy))
    return found


def log(letter: str, commanded: Floats, actual: Floats) -> tn.AxisLog:
    unit = AXES[letter]
    return tn.AxisLog(
        **{
            "time_s": np.arange(len(commanded)) * twin.PERIOD,
            f"{letter}_cmd_{unit}": commanded,
            f"{letter}_act_{unit}": actual,
        }
    )


def refusal(letter: str, commanded: Floats, actual: Floats) -> str:
    with pytest.raises(tn.DataError) as refused:
        AxisLogModel(log(letter, commanded, actual), SETUP)
    return str(refused.value)


def test_windows_of_a_sound_log_are_taken() -> None:
    """Of some it was asked whether the positions were following errors."""
    for window in windows():
        AxisLogModel(log(*window), SETUP)


@pytest.mark.parametrize("factor", [1.0, -1.0, 1e3, -1e3])
def test_following_errors_in_windows_are_named(factor: float) -> None:
    """Where a run begins was taken from them, so that only those from rest were known."""
    named = 0
    for letter, commanded, actual in windows(MOVES):
        size = factor if abs(factor) == 1.0 or AXES[letter] == "mm" else 3.6 * factor
        said = refusal(letter, commanded, size * (commanded - actual))
        which = "commanded less actual" if factor > 0 else "actual less commanded"
        named += f"are these following errors, {which}, in " in said
    assert named >= SPECIFIC * WINDOWS


@pytest.mark.parametrize(
    ("linear", "rotary", "said"),
    [
        (-1.0, -1.0, "got motion opposite to"),
        (1 / 25.4, np.pi / 180, "times the motion that the servo model says"),
    ],
)
def test_senses_and_units_in_windows_are_named(linear: float, rotary: float, said: str) -> None:
    """They were another axis's motion where a run begins at speed."""
    for letter, commanded, actual in windows(MOVES):
        factor = linear if AXES[letter] == "mm" else rotary
        assert said in refusal(letter, commanded, factor * actual)


def constant_speed(noise: float, step: float, seed: int) -> tuple[Floats, Floats]:
    """X from some way of its start on, at 1000 mm/min: a 60th of a mm a sample."""
    rng = np.random.default_rng(seed)
    speed = np.minimum(np.arange(1, 2001) / 50, 1.0) * 1000 / 60
    commanded = np.cumsum(speed) * twin.PERIOD
    lag = 1000 / 60 / SETUP.servo["X"]["gain_per_s"]
    actual = commanded - lag + noise * rng.standard_normal(len(commanded))
    rows = slice(60, None)
    if step:
        commanded = step * np.round(commanded / step)
    return commanded[rows], actual[rows]


def test_constant_speed_is_no_step_of_positions() -> None:
    """Every difference of commands is the same there: feed times period."""
    AxisLogModel(log("x", *constant_speed(2e-4, 0.0, 1)), SETUP)


def test_steps_at_constant_speed_are_named() -> None:
    said = refusal("x", *constant_speed(2e-4, 0.01, 1))
    assert "x_cmd_mm: got positions in steps of 0.01 mm" in said
