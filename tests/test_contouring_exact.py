"""Exact checks: figures that have a closed form, orders of convergence, edge cases."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from trunnion import contouring as ct
from trunnion.base.errors import InputError, UnknownNameError

Array = NDArray[np.float64]
PAPER = ct.Servo.paper()


def matched(gain: float = 81.28, tau_ms: float = 5.76) -> ct.Servo:
    linear, rotary = ct.LinearAxis(gain, tau_ms), ct.RotaryAxis(gain, tau_ms)
    return ct.Servo({"X": linear, "Y": linear, "Z": linear, "A": rotary, "C": rotary})


def test_contour_error_of_a_line_at_45_degrees_with_unequal_gains() -> None:
    path = ct.Path.lines([[0, 0, 0], [200, 200, 0]], [0, 0, 1])
    # One tau and one tau more: only the gains differ in the steady state.
    servo = replace(PAPER, axes={**PAPER.axes, "Y": ct.LinearAxis(25.17 * 3.2, 5.76)})
    run = ct.simulate(path, 3000.0, controller="independent", servo=servo)
    exact = 50.0 / 2 * abs(1 / 81.28 - 1 / 80.544) * 1e3
    assert exact == pytest.approx(2.810612, abs=5e-7)
    assert run.contour_um[-1] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize(("radius", "expected_um"), [(10.0, 0.317738), (1.9, -0.543866)])
def test_matched_axes_on_a_circle_are_off_by_the_sampled_response(
    radius: float, expected_um: float
) -> None:
    speed, gain, tau, period = 50.0, 81.28, 5.76e-3, 1e-3
    z = np.exp(1j * speed / radius * period)
    e = np.exp(-period / tau)
    g = tau * (1 - e)
    plant = ((period - g) * z + (g - period * e)) / ((z - 1) * (z - e))
    exact = radius * (abs(gain * plant / (1 + gain * plant)) - 1) * 1e3
    assert exact == pytest.approx(expected_um, abs=6e-7)
    path = ct.Path.circle(radius, turn_deg=720.0)
    feed = ct.Feed(speed * 60, acceleration_time_s=0.0)
    run = ct.simulate(path, feed, controller="independent", servo=matched())
    off = (np.hypot(*run.tip_mm[-1, :2]) - radius) * 1e3
    assert off == pytest.approx(exact, abs=1e-8)
    assert run.contour_um[-1] == pytest.approx(abs(exact), abs=1e-8)


def test_c_alone_lags_without_contour_or_orientation_error() -> None:
    path = ct.Path.circle(20.0, tilt_deg=30.0, turn_deg=400.0)
    run = ct.simulate(path, 3000.0, controller="independent")
    assert run.contour_um.max() < 1e-9
    assert run.orientation_arcsec.max() < 1e-9
    lag = np.deg2rad(abs(run.reference[-1, 4] - run.actual[-1, 4])) * 20.0
    assert lag == pytest.approx(50.0 / (0.0101 * 8101), rel=1e-9)
    assert lag == pytest.approx(0.611097, abs=6e-7)
    # C turned more than a whole turn without a jump.
    assert np.ptp(run.reference[:, 4]) > 390.0
    assert np.abs(np.diff(run.reference[:, 4])).max() < 1.0
    # The coupled loop adds what its orientation model is off by, no more.
    coupled = ct.simulate(path, 3000.0, controller="proposed")
    assert coupled.contour_um.max() < 1e-3
    assert coupled.orientation_arcsec.max() < coupled.proposed_arcsec.max() < 0.1


def test_vertical_tool_keeps_c() -> None:
    path = ct.Path.lines([[0, 0, 0], [30, 10, 0], [50, 40, 5]], [0, 0, 1])
    run = ct.simulate(path, ct.Feed(3000.0, decelerate=True, dwell_s=0.2))
    assert np.all(run.reference[:, 3:] == run.reference[0, 3:])
    assert run.orientation_arcsec.max() < 1e-9


def test_straight_lines_corners_and_rest_are_harmless() -> None:
    path = ct.Path.lines(
        [[0, 0, 0], [10, 0, 0], [10, 10, 0], [30, 10, 0]],
        np.array([[0, 0, 1], [0.1, 0, 1], [0.1, 0.2, 1], [0.1, 0.2, 1]]),
    )
    feed = ct.Feed(2000.0, decelerate=True, normal_acceleration_mm_s2=500.0, dwell_s=0.3)
    controllers: tuple[ct.Controller, ...] = ("independent", "existing", "proposed")
    for controller in controllers:
        run = ct.simulate(path, feed, controller=controller)
        for values in (run.contour_um, run.orientation_arcsec, run.actual, run.circle_um):
            assert np.isfinite(values).all()
        # At rest in the end: on the end point, foot clamped to it.
        np.testing.assert_allclose(run.tip_mm[-1], [30, 10, 0], atol=1e-3)
        assert run.foot_u.max() <= 3.0
        # The reference comes to rest in each corner.
        speed = np.linalg.norm(np.diff(run.point_mm, axis=0), axis=1)
        corner = np.linalg.norm(run.point_mm - [10, 0, 0], axis=1).argmin()
        assert speed[corner] < 0.1 * speed.max()


def test_integrals_stop_while_an_axis_saturates() -> None:
    def run(limit: float) -> ct.ContourRun:
        axes = dict(PAPER.axes)
        axes["X"] = ct.LinearAxis(25.40 * 3.2, 5.76, limit_mm_min=limit)
        gains = ct.Coupling().gains * [1.0, 20.0, 1.0]
        return ct.simulate(
            ct.Path.paper(),
            ct.Feed(1000.0, decelerate=True, dwell_s=1.0),
            controller=ct.Coupling(gains=gains),
            servo=replace(PAPER, axes=axes),
        )

    free, limited = run(np.inf), run(900.0)
    assert not limited.diverged
    assert limited.contour_um.max() > 20 * free.contour_um.max()  # it did saturate
    # With wound-up integrals the axes would rest some 0.8 mm off along the path.
    assert limited.following_um[-200:].max() < 5.0


def test_bad_input_is_refused_with_what_was_wanted() -> None:
    path = ct.Path.paper()
    with pytest.raises(InputError, match="feed"):
        ct.simulate(path, -1.0)
    with pytest.raises(UnknownNameError, match="controller"):
        ct.simulate(path, 1000.0, controller="best")  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="EX0Q"):
        ct.simulate(path, 1000.0, errors={"EX0Q": 1.0})
    with pytest.raises(InputError, match="time_constant"):
        ct.simulate(
            path, 1000.0, servo=replace(PAPER, axes={**PAPER.axes, "X": ct.LinearAxis(80.0, -1.0)})
        )
    with pytest.raises(InputError, match=r"servo axis X"):
        ct.simulate(path, 1000.0, servo=ct.Servo({}))
    with pytest.raises(UnknownNameError, match=r"servo\.X\.gain"):
        ct.Servo.from_table({"X": {"gain": 80.0}})
    with pytest.raises(InputError, match="same as the one before"):
        ct.Path.lines([[0, 0, 0], [0, 0, 0]], [0, 0, 1])
    with pytest.raises(InputError, match="acceleration time"):
        ct.simulate(path, ct.Feed(1000.0, 0.0, decelerate=True))


def test_servo_table_round_trip() -> None:
    assert ct.Servo.from_table(PAPER.to_table()) == PAPER
