"""The gauge of the paper: 150 µm, 0.5 µm, a sampling rate and a response that limit the feed."""

import numpy as np
import pytest

from trunnion import DataError
from trunnion.turning import Gauge

Z = np.linspace(65.0, 5.0, 601)


def test_readings_are_steps_of_a_micrometre_on_the_diameter() -> None:
    z, read = Gauge(response_s=0.0).read(Z, 10 * np.sin(Z / 7), feed_mm_min=300)
    assert np.allclose(read, np.round(read))
    assert np.abs(read - 10 * np.sin(z / 7)).max() < 0.51
    assert np.allclose(np.diff(z), -300 / 60 / 50)


def test_the_response_lags_by_slope_times_feed_times_time_constant() -> None:
    gauge = Gauge(resolution_um=0.0, response_s=0.05)
    feed = 600.0
    z, read = gauge.read(Z, 0.5 * (65 - Z), feed_mm_min=feed)
    lag = 0.5 * (65 - z) - read
    assert lag[-1] == pytest.approx(0.5 * feed / 60 * 0.05, rel=1e-6)
    # The same by small steps of the differential equation.
    step, state, at = 1e-5, 0.0, []
    for i in range(int(0.4 / step)):
        state += step * (0.5 * feed / 60 * i * step - state) / 0.05
        at.append(state)
    assert read[15] == pytest.approx(at[int(15 / 50 / step)], abs=2e-3)


def test_feed_limits() -> None:
    gauge = Gauge(rate_hz=20.0, response_s=0.1)
    assert gauge.feed_limit_mm_min(0.3) == pytest.approx(0.3 * 20 * 60)
    limit = gauge.feed_limit_mm_min(5.0, slope_um_mm=2.0, lag_um=1.0)
    assert limit == pytest.approx(60 * 1.0 / (2.0 * 0.1))
    exact = Gauge(rate_hz=20.0, response_s=0.1, resolution_um=0.0)
    _, read = exact.read(Z, 2.0 * (65 - Z), feed_mm_min=limit)
    z, _ = exact.read(Z, Z * 0, feed_mm_min=limit)
    assert np.abs(2.0 * (65 - z) - read).max() <= 1.0 + 1e-9


def test_beyond_its_range_it_refuses() -> None:
    with pytest.raises(DataError, match=r"z 34\.9\d+ mm: got -7[5-9]"):
        Gauge().read(Z, -5.0 * (65 - Z), feed_mm_min=100)
    z, _ = Gauge().read(Z, np.full(601, 149.0), feed_mm_min=100)
    assert len(z) > 100


def test_places_are_those_of_the_last_cycle_of_the_control() -> None:
    gauge = Gauge(resolution_um=0.0, response_s=0.0, rate_hz=70.0, cycle_ms=8.0)
    assert gauge.tick_mm(600.0) == pytest.approx(0.08)
    z = np.array([60.0, 10.0])
    at, read = gauge.read(z, np.array([0.0, 50.0]), feed_mm_min=600.0)
    exact, same = Gauge(resolution_um=0.0, response_s=0.0, rate_hz=70.0).read(
        z, np.array([0.0, 50.0]), feed_mm_min=600.0
    )
    np.testing.assert_array_equal(read, same)
    behind = at - exact  # z falls along the way: the stored place is above the true one
    assert behind.min() >= -1e-9
    assert behind.max() < 0.08
    assert behind.mean() == pytest.approx(0.04, abs=0.004)
    np.testing.assert_allclose(np.remainder(60.0 - at + 1e-9, 0.08), 0.0, atol=1e-6)
    # On a slope of 1 µm/mm the readings seem late by half a tick.
    assert (read - (60.0 - at)).mean() == pytest.approx(0.04, abs=0.004)
