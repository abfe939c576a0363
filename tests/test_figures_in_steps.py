"""Figures of standards from readings in steps: what repeats that round alike do not say."""

import numpy as np
import pytest

import trunnion as tn
from trunnion.base.recognition import as_displayed, recognised
from trunnion.base.repeats import shared_variance

STEP = 1.0  # µm, µm/m


def stops(cycles: int, noise: float, scale: float, reversal: float, seed: int) -> tn.Positioning:
    """An axis of 11 targets in whole micrometres."""
    rng, up = np.random.default_rng(seed), np.linspace(0.0, 500.0, 11)
    target = np.tile(np.concatenate([up, up[::-1]]), cycles)
    sense = np.tile(np.repeat([1, -1], 11), cycles)
    at = 1e3 * target + scale * target + reversal * (sense > 0)
    return tn.Positioning(
        target_mm=target,
        measured_mm=1e-3 * np.round(at + noise * rng.standard_normal(len(at))),
        direction=sense,
        cycle=np.repeat(np.arange(1, cycles + 1), 22),
    )


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3])
def test_uncertainties_of_stops_in_steps_are_true(noise: float) -> None:
    """Against the scatter of 120 axes that lie otherwise between the steps."""
    rng, off, stated = np.random.default_rng(5), [], []
    for seed in range(120):
        scale, reversal = rng.uniform(-0.02, 0.02), rng.uniform(2, 8)
        found = stops(5, noise, scale, reversal, seed).iso230_2()
        off.append((found.mean_reversal_um - reversal, found.mean_systematic_um - 500 * abs(scale)))
        names = ("mean_reversal_um", "mean_systematic_um")
        stated.append([found.std_errors[name] for name in names])
    assert np.mean(stated, axis=0) == pytest.approx(np.std(off, axis=0), rel=0.3)


def test_repeats_that_round_alike_say_no_more_than_one() -> None:
    few, many = (stops(n, 0.0, 0.013, 4.3, 1).iso230_2().std_errors for n in (2, 20))
    assert all(u > 0.02 for u in few.values())
    for name in ("mean_reversal_um", "reversal_um", "mean_systematic_um"):
        assert many[name] == pytest.approx(few[name], rel=0.15)
    # what scatters between stops is known the better the more of them are alike
    assert 0 < many["repeatability_forward_um"] < 0.2 * few["repeatability_forward_um"]


@pytest.mark.parametrize("noise", [0.0, 0.03, 0.3])
def test_a_circle_in_steps_has_no_vanishing_uncertainty(noise: float) -> None:
    rng, at = np.random.default_rng(3), np.arange(180) * np.pi / 90
    both = np.tile(np.concatenate([at, at[::-1]]), 2)
    length = 100.0 + 1e-3 * (4.2 * np.cos(both - 1.0) + 1.7 * np.sin(2 * both))
    length = np.round(length + 1e-3 * noise * rng.standard_normal(len(both)), 3)
    (found,) = tn.iso230_4(
        tn.Ballbar(
            setup=np.zeros(len(both), dtype=int),
            x_mm=100 * np.cos(both),
            y_mm=100 * np.sin(both),
            length_mm=length,
            sense=np.tile(np.repeat([1, -1], 180), 2),
        )
    )
    assert all(0.1 * STEP < u < 0.5 * STEP for u in found.std_errors.values())


def test_a_level_in_steps_knows_its_digits_only() -> None:
    place = 100.0 * np.arange(20)
    slope = np.round(np.cumsum(np.random.default_rng(2).normal(0, 5, 20)))
    profiles = {}
    for repeats in (1, 3, 12):
        level = tn.Levels(position_mm=np.tile(place, repeats), along_um_m=np.tile(slope, repeats))
        profiles[repeats] = level.straightness().noise_um_m / np.sqrt(repeats)
    assert profiles[3] == pytest.approx(STEP / np.sqrt(12), rel=0.01)
    assert profiles[12] == pytest.approx(profiles[3])
    assert profiles[1] >= STEP / np.sqrt(12)


def test_what_repeats_share_vanishes_where_the_noise_is_a_step() -> None:
    rng = np.random.default_rng(8)
    for noise in (0.0, 0.1, 0.25):
        place = rng.uniform(0, 1, (40_000, 1))
        read = np.round(place + noise * rng.standard_normal((40_000, 4)))
        off = read.mean(axis=1) - place[:, 0]
        scatter = float(np.mean(np.var(read, axis=1, ddof=1)))
        shared = np.mean(off**2) - scatter / 4
        assert shared_variance(scatter, 1.0) == pytest.approx(shared, abs=0.002)
    assert shared_variance(1.0 + 1 / 12, 1.0) < 1e-12
    assert shared_variance(1.5, 1.0) == 0.0
    assert shared_variance(0.3, 0.0) == 0.0


@pytest.mark.parametrize(
    ("step", "distinct", "shown"),
    [
        (8.0, 2, 2.0),  # a reversal of 8 µm
        (7.0, 3, 1.0),
        (137.0, 2, 1.0),
        (8.0, 40, 8.0),  # so many readings are no multiples of 8 by chance
        (5.0, 2, 5.0),
        (0.02, 2, 0.02),
        (5 / 3, 3, 5 / 3),  # a tick: feed times period
        (0.36, 2, 0.36),  # 0.0001 degrees
        (2.54, 2, 2.54),  # 0.0001 inches
        (0.0, 5, 0.0),
    ],
)
def test_displays_count_in_ones_twos_and_fives(step: float, distinct: int, shown: float) -> None:
    assert as_displayed(step, distinct) == pytest.approx(shown)


def test_a_reversal_is_no_step() -> None:
    """A sound axis but for 8 µm of reversal, read to 0.1 µm: the step is no larger than 2 µm."""
    sense = np.tile(np.repeat([1, -1], 11), 3)
    assert recognised(np.array([0.0, 8.0])) == 8.0
    up = np.linspace(0.0, 500.0, 11)
    target = np.tile(np.concatenate([up, up[::-1]]), 3)
    run = tn.Positioning(
        target_mm=target,
        measured_mm=target + 8e-3 * (sense > 0),
        direction=sense,
        cycle=np.repeat([1, 2, 3], 22),
    )
    d = tn.diagnose(run)
    assert d.named == {"reversal"}
    assert not any("steps of 8" in note for note in d.notes)
