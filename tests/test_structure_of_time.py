"""Structure of time in a test with times: it is called one of time, not of the order of stops."""

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import axis

SECONDS = 700.0  # of the wave; stops are 8 to 22 s apart, with a pause between cycles


def wandering(seed: int, *, even: bool) -> tn.Positioning:
    """An axis whose stops all move with a wave of time."""
    rng = np.random.default_rng([61, seed])
    made = axis(rng, noise=0.3)
    count = len(made)
    time = 15.0 * np.arange(count)
    if not even:
        time = np.cumsum(rng.uniform(8.0, 22.0, count)) + 120.0 * (np.asarray(made.cycle) - 1)
    moved = 2e-3 * np.sin(2 * np.pi * time / SECONDS + seed)
    return made.with_columns(time_s=time, measured_mm=made.measured + moved)


@pytest.mark.parametrize("even", [True, False])
def test_a_wave_of_time_is_one_of_time(*, even: bool) -> None:
    for seed in range(4):
        d = tn.diagnose(wandering(seed, even=even))
        assert "time (periodic" in (d.unexplained or "")
        assert d.structure is not None
        assert d.structure.effect.covariate == "time"
        assert d.structure.parameters["period_s"] == pytest.approx(SECONDS, rel=0.05)


def test_a_degree_is_stated_where_it_explains_more_than_chance() -> None:
    """Of a drift that begins slowly 6 of 60 were a cubic or of degree 4: two columns by chance."""
    runs, higher = 60, 0
    for seed in range(runs):
        made = axis(np.random.default_rng([19, seed]), noise=0.4)
        moved = 8e-3 * np.linspace(0.0, 1.0, len(made)) ** 2
        d = tn.diagnose(made.with_columns(measured_mm=made.measured + moved))
        assert "time (" in (d.unexplained or "")
        higher += "time (quadratic)" not in (d.unexplained or "")
    assert higher <= 4  # 1 % for each of two degrees: more in 1 % of such tests
