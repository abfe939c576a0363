"""A large bump is where it is and not at a place of a grid.

What is missed there of one many times the noise looks like further causes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import minimize

from trunnion.diagnosis.local_errors import likeliest

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
