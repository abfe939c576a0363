"""Readings that wander as no cause does: what their noise is taken for, and what is named then."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import toeplitz

import axis_log_twin as twin
import trunnion as tn
from trunnion import contouring as ct
from trunnion.diagnosis.autoregression import Autoregression, of_covariances
from trunnion.diagnosis.noise import fit_noise
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.wander import deviance, fit_wander
from trunnion.models.kinds import diagnose
from trunnion.setup import Artefact, Setup

SETUP = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
WAVES = ((1.7, 3.1), (2.6, 1.9), (3.6, 2.3), (2.2, 3.7))  # over each of two runs
LONG_WAVES = (  # seed; count over each run, size of each in µm: a cyclic error makes a part of both
    (14, (3.5, 2.4), (0.97, 0.52)),
    (21, (3.7, 3.1), (0.5, 0.37)),
    (33, (2.4, 2.2), (0.93, 0.41)),
    (50, (3.5, 3.1), (0.53, 0.27)),
)
N = 60


def of_lags(share: float, length: float) -> NDArray[np.float64]:
    """Autocovariances of white noise of size 1 and a wander."""
    covariances = share * np.exp(-0.5 * (np.arange(N) / length) ** 2)
    covariances[0] += 1.0
    return covariances


def test_an_autoregression_of_autocovariances_is_that_noise() -> None:
    covariances = of_lags(30.0, 12.0)
    noise = of_covariances(covariances)
    white = noise.whiten(np.eye(N))
    assert white @ toeplitz(covariances) @ white.T == pytest.approx(np.eye(N), abs=1e-9)
    determinant = np.linalg.slogdet(toeplitz(covariances))[1]
    assert 2 * noise.log_size(N) == pytest.approx(determinant)


def test_the_likelihood_is_that_of_generalised_least_squares() -> None:
    rng = np.random.default_rng(1)
    y, q = rng.standard_normal(N), rng.standard_normal((N, 3))
    whole = toeplitz(of_lags(5.0, 6.0))
    inverse = np.linalg.inv(whole)
    solved = np.linalg.solve(q.T @ inverse @ q, q.T @ inverse @ y)
    left = y - q @ solved
    expected = N * np.log(left @ inverse @ left / N) + np.linalg.slogdet(whole)[1]
    noise = of_covariances(of_lags(5.0, 6.0))
    assert deviance(noise, y, q, [np.arange(N)]) == pytest.approx(expected)


def test_share_and_length_of_a_wander_are_found() -> None:
    n, share, length = 600, 25.0, 30.0
    rng = np.random.default_rng(2)
    apart = np.arange(n)
    smooth = toeplitz(share * np.exp(-0.5 * (apart / length) ** 2)) + 1e-9 * np.eye(n)
    root = np.linalg.cholesky(smooth)
    found = []
    for _ in range(10):
        y = 0.2 * (root @ rng.standard_normal(n) + rng.standard_normal(n))
        noise = fit_wander(y, np.ones((n, 1)) / n**0.5, [apart]).noise
        found.append((noise.sizes[0], noise.sizes[-1]))
        short = fit_noise(y, np.ones((n, 1)) / n**0.5, [apart])
        own = [deviance(x, y, np.ones((n, 1)), [apart]) for x in (noise, short)]
        assert own[0] < own[1]
    first, last = np.mean(found, axis=0)
    assert first == pytest.approx(0.2 * (1 + share) ** 0.5, rel=0.2)
    # What 64 readings do not say of the wander is next to nothing beside the white noise.
    known = of_covariances(np.r_[1.0 + share, share * np.exp(-0.5 * (apart[1:65] / length) ** 2)])
    assert last == pytest.approx(0.2 * known.sizes[-1], rel=0.05)


def test_short_series_are_whitened_to_their_end() -> None:
    noise = of_covariances(of_lags(9.0, 5.0))
    short = np.random.default_rng(3).standard_normal((7, 2))
    assert noise.whiten(short) == pytest.approx(noise.whiten(np.vstack([short, short]))[:7])
    assert Autoregression().log_size(0) == 0.0


def slow_c(cases: twin.Cases) -> None:
    cases.gain[0, 4] *= 0.985


def late_log(cases: twin.Cases) -> None:
    cases.log_delay[0] = 1.5e-6


def wandering(
    waves: tuple[float, float],
    seed: int,
    hide: Callable[[twin.Cases], None] = slow_c,
    sign: float = 1.0,
) -> Diagnosis:
    """Diagnose a log of which X wanders otherwise in each run."""
    commands = [twin.commanded(feed / 60) for feed in (1000, 3000)]
    cases = twin.Cases(1)
    hide(cases)
    actual = [twin.actual(c, cases)[0] for c in commands]
    for a, count, size in zip(actual, waves, (1.2e-3, 0.7e-3), strict=True):
        a[:, 0] += sign * size * np.sin(2 * np.pi * count * np.linspace(0, 1, len(a)) + count)
    return diagnose(twin.log(commands, actual, np.random.default_rng(seed)), SETUP)


@pytest.mark.parametrize("number", range(len(WAVES)))
def test_a_wander_is_stated_and_not_named(number: int) -> None:
    d = wandering(WAVES[number], number)
    assert d.verdict == "unexplained"
    assert d.unexplained is not None
    assert "X" in d.unexplained
    assert d.named == {"gain_c"}
    assert d.effects["gain_c"]["gain_percent"] == pytest.approx(-1.5, abs=0.05)


@pytest.mark.parametrize(("number", "sign"), [(0, -1.0), (1, -1.0), (2, 1.0), (3, 1.0)])
def test_a_wander_of_one_axis_takes_no_cause_from_the_others(number: int, sign: float) -> None:
    """A log that is late is seen in all axes: what it does to a wander says nothing of it."""
    d = wandering(WAVES[number], number, late_log, sign)
    assert d.named == {"log_delay"}
    assert d.effects["log_delay"]["delay_ms"] == pytest.approx(1.5e-3, abs=5e-4)


@pytest.mark.parametrize("number", range(len(WAVES)))
def test_what_a_wander_hides_is_not_excluded(number: int) -> None:
    """X may have causes of its own: slow ones, of which such readings say next to nothing."""
    d = wandering(WAVES[number], number)
    (found,) = [a.probability for a in d.evidence if a.causes == {"gain_c"}]
    assert 0.75 < found < 0.97


@pytest.mark.parametrize(("seed", "counts", "sizes"), LONG_WAVES)
def test_a_wander_is_no_cyclic_error_of_a_long_pitch(
    seed: int, counts: tuple[float, float], sizes: tuple[float, float]
) -> None:
    """What a wave explains is compared beside the wander without it, not a smaller one."""
    commands = [twin.commanded(feed / 60) for feed in (1000, 3000)]
    actual = [twin.actual(c, twin.Cases(1))[0] for c in commands]
    for a, count, um in zip(actual, counts, sizes, strict=True):
        a[:, 0] += um * 1e-3 * np.sin(2 * np.pi * count * np.linspace(0, 1, len(a)))
    d = diagnose(twin.log(commands, actual, np.random.default_rng(seed)), SETUP)
    assert d.verdict == "unexplained"
    assert not d.named


def test_a_sound_log_does_not_wander() -> None:
    commands = [twin.commanded(feed / 60) for feed in (1000, 3000)]
    actual = [twin.actual(c, twin.Cases(1))[0] for c in commands]
    log: tn.AxisLog = twin.log(commands, actual, np.random.default_rng(5), memory=0.8)
    d = diagnose(log, SETUP)
    assert d.verdict == "consistent"
    assert d.unexplained is None
