"""A sweep of one turn in the order of time: an instrument that drifts looks like a slow axis."""

from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import trunnion as tn
from trunnion.diagnosis.records import CERTAIN

Floats = NDArray[np.float64]
SEEDS = range(6)
SECONDS = 6.0


def sweep(
    seed: int, motion: Callable[[float, float], tuple[float, float, float]], turns: int = 1
) -> tn.Sweep:
    """Three targets every 10°; ``motion``: of all of them, µm, by angle (rad) and time (s)."""
    rng = np.random.default_rng(seed)
    rows = []
    every = np.arange(0.0, 360.0, 10.0)
    angles = np.concatenate([every if k % 2 == 0 else every[::-1] for k in range(turns)])
    for i, degrees in enumerate(angles):
        for k, (radius, at, height) in enumerate(((80, 0, 10), (60, 100, 60), (90, 215, 35))):
            turn, time = np.deg2rad(degrees + at), SECONDS * (3 * i + k)
            p = np.array([radius * np.cos(turn), radius * np.sin(turn), height])
            p = p + 1e-3 * np.array(motion(np.deg2rad(degrees), time))
            p = p + np.array([500.0, 300.0, 150.0]) + 0.5e-3 * rng.standard_normal(3)
            rows.append((degrees, str(k + 1), *np.round(p, 5), time))
    names = ("angle_deg", "target", "x_mm", "y_mm", "z_mm", "time_s")
    return tn.Sweep(dict(zip(names, zip(*rows, strict=True), strict=True)))


def certain(
    motion: Callable[[float, float], tuple[float, float, float]], turns: int = 1
) -> Counter[str]:
    """How often a cause is certain, and not "or a drift of the instrument"."""
    found: Counter[str] = Counter()
    for seed in SEEDS:
        d = tn.diagnose(sweep(seed, motion, turns))
        found.update(c.id for c in d.causes if c.probability > CERTAIN and not c.instead)
        slow = [c for c in d.causes if c.id.endswith("_trend")]
        assert all(bool(c.instead) == (turns == 1) for c in slow)
        if slow and turns == 1:
            assert any("measure them once more, the other way" in note for note in d.notes)
    return found


def test_a_swinging_instrument_is_no_axis() -> None:
    """Its period is that of no harmonic: a smooth drift in time says as much with less."""
    found = certain(lambda _, t: (0.0, 0.0, 2.0 * np.sin(2 * np.pi * t / 300.0)))
    assert sum(found.values()) <= 2, found


def test_a_warming_instrument_is_no_slow_radial_motion() -> None:
    """What slows down in time does in the angle."""
    found = certain(lambda _, t: (8.0 * (1.0 - np.exp(-t / 150.0)), 0.0, 0.0))
    assert sum(found.values()) <= 1, found


def test_harmonics_of_the_axis_are_certain_in_one_turn() -> None:
    """A smooth drift that makes just a harmonic is next to impossible."""
    found = certain(lambda a, _: (0.0, 0.0, 2.0 * np.sin(2 * a)))
    assert found == {"axial_2": len(SEEDS)}
    found = certain(lambda a, _: (1.5 * np.cos(2 * a), 1.5 * np.sin(2 * a), 0.0))
    assert found["radial_2"] == len(SEEDS)


def test_a_second_turn_distinguishes_a_slow_motion_from_a_drift() -> None:
    """There and back the angle is no function of time."""
    found = certain(lambda a, _: (0.0, 0.0, 4.0 * (a / (2 * np.pi)) ** 2), turns=2)
    assert found["axial_trend"] >= len(SEEDS) - 1, found
