"""Axes with friction whose load hangs on a structure that resonates, as most real ones do.

Drawn with the independent twin. A gain, a delay and a time constant imitate a resonance.
"""

from functools import cache

import numpy as np
import pytest

import axis_log_twin as twin
import trunnion as tn
from trunnion import contouring as ct
from trunnion.diagnosis.result import Diagnosis
from trunnion.setup import Artefact, Setup

CASES = 12
AXES = "XYZC"  # A never turns back: friction, backlash and a constant force look alike


DAMPINGS = {"motor": (0.02, 0.1), "load": (0.1, 0.3)}  # with less a loop on the load is unstable
BOTH = pytest.mark.parametrize("feedback", list(DAMPINGS))


@cache
def drawn(feedback: str) -> tuple[list[tuple[str, dict[str, float]]], list[Diagnosis]]:
    """Axis, and friction (µm or arcsec), frequency and damping of each case; their diagnoses."""
    rng = np.random.default_rng(2311)
    cases, truth = twin.Cases(CASES), []
    for i in range(CASES):
        axis = AXES[i % len(AXES)]
        at = (i, twin.AXES.index(axis))
        small = rng.uniform(2.0, 8.0)
        hidden = rng.uniform(25.0, 70.0), rng.uniform(*DAMPINGS[feedback])
        cases.friction[at] = small * twin.SMALL[at[1]]
        cases.frequency[at], cases.damping[at] = hidden
        truth.append((axis.lower(), {"friction": small, "hz": hidden[0], "damping": hidden[1]}))
    commands = [twin.commanded(feed / 60) for feed in (1000, 3000)]
    actual = [twin.actual(c, cases, feedback=feedback) for c in commands]
    servo = {**ct.Servo.paper().to_table(), "feedback": feedback}
    setup = Setup(artefact=Artefact("none"), servo=servo)
    logs = [twin.log(commands, [a[i] for a in actual], rng) for i in range(CASES)]
    return truth, [tn.diagnose(log, setup) for log in logs]


@BOTH
def test_both_are_named_and_nothing_else(feedback: str) -> None:
    truth, found = drawn(feedback)
    named = [{c.id for c in d.causes} for d in found]
    right = [
        names == {f"friction_{axis}", f"resonance_{axis}"}
        for (axis, _), names in zip(truth, named, strict=True)
    ]
    assert sum(right) >= CASES - 1, named
    assert sum(d.unexplained is None for d in found) >= CASES - 1


@BOTH
@pytest.mark.parametrize("name", ["friction", "hz", "damping"])
def test_their_sizes_are_within_their_uncertainty(name: str, feedback: str) -> None:
    pulls = []
    for (axis, hidden), d in zip(*drawn(feedback), strict=True):
        effect, part = ("friction", "coulomb") if name == "friction" else ("resonance", name)
        for cause in (c for c in d.causes if c.id == f"{effect}_{axis}"):
            key = next(k for k in cause.parameters if part in k)
            pulls.append((cause.parameters[key] - hidden[name]) / cause.std_errors[key])
    assert len(pulls) >= CASES - 1
    assert np.sqrt(np.mean(np.square(pulls))) < 1.8, pulls
