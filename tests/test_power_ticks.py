"""The control of ``power/ticks.py`` writes down what a control writes down."""

import numpy as np
import pytest

from power.ticks import (
    LOG_DECIMALS,
    TICK_UM,
    first_look,
    ground,
    recorded,
    rounded_away,
    run,
    starts,
)
from twin.contact import step_to_contact
from twin.forward import MM_PER_UM, Truth, approach_lines
from twin.generator import random_errors, random_placement

LOGGED = 10.0**-LOG_DECIMALS  # a position in the log is rounded by up to half of this


@pytest.mark.parametrize("plan", ["paper", "rich"])
def test_the_position_is_that_of_the_first_look_that_touches(plan: str) -> None:
    """Without scatter: looking at every tick, one after another, comes to the same."""
    touched, setup, _, _ = ground(plan)
    rng = np.random.default_rng(1)
    truth = Truth(random_errors(rng), random_placement(rng))
    positions = recorded(touched, setup, truth, 0.0, touched.start_mm, rng)
    lines = approach_lines(touched.conditions, touched.start_mm, setup, truth)
    looks = step_to_contact(lines, TICK_UM * MM_PER_UM, reach_mm=4.0)
    along = looks[:, None] * TICK_UM * MM_PER_UM * touched.conditions.direction
    np.testing.assert_allclose(positions, touched.start_mm + along, atol=LOGGED)


def test_dither_spreads_the_looks_over_a_tick() -> None:
    touched, setup, _, _ = ground("rich")
    truth = Truth()
    k = touched.conditions
    for dither, spread in ((False, 0.0), (True, TICK_UM / np.sqrt(12))):
        rng = np.random.default_rng(2)
        start = starts(touched, dither, rng)
        positions = recorded(touched, setup, truth, 0.0, start, rng)
        way = np.einsum("ni,ni->n", positions - touched.start_mm, k.direction) / MM_PER_UM
        phase = way % TICK_UM
        phase = np.minimum(phase, TICK_UM - phase)  # 0 where the look is on the undithered grid
        # a phase of 0 to 1 tick is folded to 0 to 1/2: its standard deviation is half as large
        assert phase.std() == pytest.approx(spread / 2, abs=0.02 * TICK_UM)


def test_scatter_and_tick_add_up() -> None:
    """The delay of a look is uniform over a tick: half a tick late, variances add."""
    rng = np.random.default_rng(3)
    contact = rng.uniform(0, 100, 20_000) * TICK_UM
    noise = 0.3 * TICK_UM
    way = first_look(contact + noise * rng.standard_normal(len(contact)), TICK_UM)
    late = way - contact
    assert late.mean() == pytest.approx(TICK_UM / 2, abs=0.01 * TICK_UM)
    assert late.std() == pytest.approx(np.hypot(noise, TICK_UM / np.sqrt(12)), rel=0.02)


def test_rounding_hides_an_effect_that_a_sound_machine_reads_too() -> None:
    """Hidden is a scale that moves no contact over a look; not one of several ticks."""
    touched, setup, _, _ = ground("paper")
    rng = np.random.default_rng(4)
    errors, placement = random_errors(rng), random_placement(rng)
    for ppm, hidden in ((0.0, True), (0.02, True), (30.0, False)):
        truth = Truth(errors, placement, {"scale_x": {"ppm": ppm}})
        assert rounded_away(touched, setup, truth, touched.start_mm) is hidden


def test_a_run_says_what_came_of_it() -> None:
    """Far from the grid, where the power table says that a diagnosis is right."""
    nothing = run("paper", 3.0, "yes", seed=1)
    assert nothing.truth == frozenset()
    assert set(nothing.z) <= {"EX0C", "EY0C", "EA0A", "EB0A", "EC0A", "EB0C", "EY0A", "EZ0A"}
    assert nothing.scatter_um == pytest.approx(np.hypot(3.0, 1 / np.sqrt(12)))
    scale = run("paper", 3.0, "yes", "scale_x", seed=1)
    assert (scale.hidden, scale.found, scale.wrong) == ("scale_x", True, False)
    assert len(scale.covered) == len(scale.z)
