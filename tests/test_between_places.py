"""A large bump, or a change in the course of a run, is where it is and not at a place of a grid.

What is missed there of one many times the noise looks like further causes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import minimize

import trunnion as tn
from positioning_twin import axis
from trunnion.diagnosis.along import Beside
from trunnion.diagnosis.around import best_around
from trunnion.diagnosis.local_errors import likeliest
from trunnion.diagnosis.plain import case_of
from trunnion.models.kinds import model_of

NOISE_UM = 0.3
MISSED = 1.0  # of chi², that a place may miss


def left_of(columns: np.ndarray, y: np.ndarray) -> float:
    """Sum of squares that columns and a constant leave."""
    every = np.column_stack([np.ones(len(y)), columns])
    rest = y - every @ np.linalg.lstsq(every, y, rcond=None)[0]
    return float(rest @ rest)


def least(left: Callable[[np.ndarray], float], start: list[float]) -> float:
    """The least that is left, by a simplex from the true values."""
    found = minimize(left, start, method="Nelder-Mead", options={"maxiter": 4000, "fatol": 1e-6})
    return float(found.fun)


@pytest.mark.parametrize("seed", range(6))
def test_a_local_error_is_found_between_places(seed: int) -> None:
    """At a quarter of the range where the scan has none: to less than a noise."""
    rng = np.random.default_rng([31, seed])
    s = np.linspace(0.0, 1.0, 120)
    at, width = 0.5 + rng.uniform(-0.03, 0.03), 0.125 * rng.uniform(0.75, 1.3)
    y = 8.0 * np.exp2(-((2 * (s - at) / width) ** 2)) + NOISE_UM * rng.standard_normal(len(s))

    def left(values: np.ndarray) -> float:
        return left_of(np.exp2(-((2 * (s - values[0]) / values[1]) ** 2)), y)

    def gains(places: np.ndarray, widths: np.ndarray) -> np.ndarray:
        return np.array([-left(np.array(x)) for x in zip(places, widths, strict=True)])

    (place, wide), gain = likeliest(0.5, 0.125, gains, -np.inf)
    assert -gain - least(left, [at, width]) < MISSED * NOISE_UM**2
    assert left(np.array([place, wide])) == pytest.approx(-gain)


@pytest.mark.parametrize("seed", range(12))
def test_a_bump_in_time_is_no_scale_of_a_cycle(seed: int) -> None:
    """Beside one at a place of the scan a scale of the third cycle was named with 51 %."""
    rng = np.random.default_rng([86, seed])
    data = axis(rng, noise=NOISE_UM)
    at = np.linspace(-1.0, 1.0, len(data))
    change = 1e-3 * rng.uniform(10, 30) * (data.target - 250.0) + 8.0 * np.exp(-((at / 0.2) ** 2))
    d = tn.diagnose(data.with_columns(measured_mm=data.measured + 1e-3 * change))
    assert d.unexplained is not None
    assert "a local error at" in d.unexplained
    ways = {a.causes: a.probability for a in d.evidence}
    assert sum(p for causes, p in ways.items() if "scale_of_cycle" in causes) < 0.1
    assert d.named == {"scale"}


@pytest.mark.parametrize("seed", range(6))
def test_a_change_in_the_course_of_a_run_is_found_between_places(seed: int) -> None:
    """Of a scale: to less than a noise of the best logistic function of the time."""
    rng = np.random.default_rng([33, seed])
    data = axis(rng, noise=NOISE_UM)
    minutes = np.asarray(data.time_s) / 60.0
    length = minutes.max()
    true = [rng.uniform(-400, 100), length * rng.uniform(0.15, 0.4), length * rng.uniform(0.2, 0.5)]

    def column(values: np.ndarray) -> np.ndarray:
        about, begins, over = values
        steps = 2 * np.log(9.0) * ((minutes - begins) / over - 0.5)
        share = 1 / (1 + np.exp(-steps))
        return np.asarray((data.target - about) * (share - share[0]) * 1e-3)

    def left(values: np.ndarray) -> float:
        return left_of(column(values), 1e3 * (made.measured - made.target))

    made = data.with_columns(measured_mm=data.measured + 1e-3 * 25.0 * column(np.array(true)))
    case = case_of(model_of(made))
    (j,) = (j for j, e in enumerate(case.effects) if e.id == "scale_change")
    places = case.values[j]
    names = ("about_mm", "from_min", "over_min")
    start = min(places, key=lambda v: left(np.array([v[n] for n in names])))
    beside = Beside(case.linearised.nuisance, case.plain.basis, case.plain.white)
    gain, found = best_around(case, case.effects[j], beside, start, lambda _: True)
    best = least(left, true)
    assert beside.rss - gain - best < MISSED * NOISE_UM**2
    assert left(np.array([start[n] for n in names])) - best > MISSED * NOISE_UM**2
    assert left(np.array([found[n] for n in names])) == pytest.approx(beside.rss - gain)
