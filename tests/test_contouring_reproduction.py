"""Figs. 7, 8, 9 of Byun and Jee 2010 by ordering and ratio, and what their text leaves open."""

import numpy as np
import pytest

import trunnion as tn
from trunnion import contouring as ct


@pytest.fixture(scope="module")
def comparison() -> ct.ContourComparison:
    return ct.compare()


def test_fig_7_the_proposed_model_is_as_good_as_the_truth(comparison: ct.ContourComparison) -> None:
    slow = comparison[1000.0, "independent"].figures
    fast = comparison[3000.0, "independent"].figures
    assert slow["proposed_max_arcsec"] < 0.1
    assert fast["proposed_max_arcsec"] < 1.0
    # The earlier one degrades about tenfold.
    assert 7 < fast["tangent_max_arcsec"] / slow["tangent_max_arcsec"] < 13
    assert slow["tangent_max_arcsec"] > 300 * slow["proposed_max_arcsec"]
    assert slow["circle_max_um"] < 1e-4 < 5 < slow["tangent_max_um"]


def test_fig_8_coupling_cuts_the_contour_error(comparison: ct.ContourComparison) -> None:
    for feed in comparison.feeds_mm_min:
        for name in ("existing", "proposed"):
            assert 5 < comparison.ratio("contour_max_um", feed, "independent", name) < 10
            assert 7 < comparison.ratio("contour_rms_um", feed, "independent", name) < 12


def test_fig_8_depends_on_the_contour_error_model_of_the_existing_controller() -> None:
    found = ct.position_models()
    tangent = found.controllers[-1]
    for feed, left in ((1000.0, 9.2), (3000.0, 86.0)):  # independent numpy loop
        assert found[feed, tangent].figures["contour_max_um"] == pytest.approx(left, abs=0.05)
        assert found.ratio("contour_max_um", feed, tangent, "independent") > 10
        assert found.ratio("contour_max_um", feed, "independent", "existing") > 5


def test_fig_9_the_proposed_controller_orients_best(comparison: ct.ContourComparison) -> None:
    for feed in comparison.feeds_mm_min:
        assert comparison.ratio("orientation_max_arcsec", feed, "independent", "proposed") > 8
        # With the earlier model it is worse than without coupling.
        assert comparison.ratio("orientation_max_arcsec", feed, "existing", "independent") > 2


def test_figures_of_the_reference(comparison: ct.ContourComparison) -> None:
    published = {
        (1000.0, "independent"): (0.805, 0.467, 12.9),
        (1000.0, "existing"): (0.095, 0.044, 32.4),
        (1000.0, "proposed"): (0.095, 0.044, 1.1),
        (3000.0, "independent"): (7.107, 1.969, 75.7),
        (3000.0, "existing"): (0.967, 0.239, 324.0),
        (3000.0, "proposed"): (0.992, 0.240, 7.8),
    }
    for key, (largest, rms, orientation) in published.items():
        f = comparison[key].figures
        assert f["contour_max_um"] == pytest.approx(largest, abs=6e-4)
        assert f["contour_rms_um"] == pytest.approx(rms, abs=6e-4)
        assert f["orientation_max_arcsec"] == pytest.approx(orientation, rel=5e-3)


def test_rounding_of_table_1_moves_the_independent_figures() -> None:
    largest = []
    for a, c in ((0.00505, 0.01005), (0.00515, 0.01015)):
        servo = ct.Servo.paper()
        axes = {
            **servo.axes,
            "A": ct.RotaryAxis(a * 16070.0, 5.85),
            "C": ct.RotaryAxis(c * 8101.0, 5.75),
        }
        run = ct.simulate(ct.Path.paper(), 3000.0, controller="independent", servo=ct.Servo(axes))
        largest.append(run.figures["contour_max_um"])
    assert largest == pytest.approx([5.8, 8.6], abs=0.05)


def test_order_of_controller_and_inverse_jacobian() -> None:
    near = ct.order_of_controller(feed_mm_min=1000.0)
    last, right, printed = (run.figures["contour_max_um"] for run in near.runs.values())
    # In right units the order hardly matters, because the ratios C/K_p are nearly equal ...
    assert right == pytest.approx(last, rel=0.02)
    # ... as printed it is worse, and diverges with the path away from the rotary axes.
    assert printed > 2 * last
    far = ct.order_of_controller(path=ct.Path.paper(offset_mm=(0, 0, 100)), feed_mm_min=1000.0)
    assert [run.diverged for run in far.runs.values()] == [False, False, True]


def test_the_unpublished_place_of_the_path_changes_figures_but_not_the_ordering() -> None:
    shown = ct.offsets()
    largest = [c[3000.0, "independent"].figures["contour_max_um"] for c in shown.values()]
    assert max(largest) > 3 * min(largest)
    for c in shown.values():
        assert c.ratio("contour_max_um", 3000.0, "independent", "proposed") > 5
        assert c.ratio("orientation_max_arcsec", 3000.0, "independent", "proposed") > 8


def test_margins_of_the_coupled_loop() -> None:
    path = ct.Path.paper()
    servo = ct.Servo.paper()
    plain = ct.margins(servo, path=path)
    assert plain.stable
    np.testing.assert_allclose(plain.coupled_gain, 3.3, atol=0.02)
    assert plain.coupled_gain.min() == pytest.approx(plain.gain.min(), rel=2e-3)

    def late(delay_ms: float) -> ct.Servo:
        from dataclasses import replace

        axes = {k: replace(a, delay_ms=delay_ms) for k, a in servo.axes.items()}
        return replace(servo, axes=axes)

    one = ct.margins(late(1.0), path=path)
    assert one.stable
    assert one.coupled_gain.min() == pytest.approx(1.08, abs=5e-3)
    two = ct.margins(late(2.0), path=path)
    assert not two.stable
    assert two.gain.max() < 1
    # The loop itself says the same.
    feed = ct.Feed(1000.0)
    assert not ct.simulate(path, feed, servo=late(1.0)).figures["contour_max_um"] > 5
    assert ct.simulate(path, feed, servo=late(2.0)).diverged
    # Margins against the loop: just below and just above the delay margin.
    delay = float(plain.delay_ms.min())
    assert not ct.simulate(path, feed, servo=late(0.97 * delay)).diverged
    assert ct.simulate(path, feed, servo=late(1.1 * delay)).figures["contour_max_um"] > 1e3


def test_location_errors_pass_the_controller_unless_it_knows_them() -> None:
    errors = {"EX0C": 20.0, "EY0C": -15.0, "EA0A": 30.0, "EB0C": 25.0, "EZ0A": 10.0}
    identified = {k: v * 0.98 for k, v in errors.items()}
    # Away from A = 0: see below.
    path = ct.Path.circle(15.0, tilt_deg=30.0, centre_mm=(10.0, 0.0, 50.0))
    wrong = ct.simulate(path, 1000.0, errors=errors).figures
    known = ct.simulate(path, 1000.0, errors=errors, assumed=identified).figures
    exact = ct.simulate(path, 1000.0, errors=errors, assumed=errors).figures
    ideal = ct.simulate(path, 1000.0).figures
    assert wrong["contour_max_um"] > 10
    assert wrong["orientation_max_arcsec"] > 15
    assert known["contour_max_um"] < ideal["contour_max_um"] + 0.03 * wrong["contour_max_um"]
    assert known["orientation_max_arcsec"] < 0.05 * wrong["orientation_max_arcsec"]
    assert exact["contour_max_um"] == pytest.approx(ideal["contour_max_um"], rel=0.1)


def test_a_known_tilt_makes_c_swing_where_the_path_begins_at_the_pole() -> None:
    # The tool starts along the nominal C axis. On the tilted machine that direction lies beside the
    # pole by the tilt, so that C has to turn quickly there: no controller takes that out.
    errors = {"EB0C": 25.0, "EA0A": 30.0}
    path = ct.Path.paper(offset_mm=(0, 0, 50))
    run = ct.simulate(path, 1000.0, errors=errors, assumed=errors)
    nominal = ct.simulate(path, 1000.0)
    swing = np.abs(np.diff(run.reference[:, 4])).max()
    assert swing > 20 * np.abs(np.diff(nominal.reference[:, 4])).max()
    assert run.contour_um.max() > 2 * nominal.contour_um.max()
    unknown = ct.simulate(path, 1000.0, errors=errors)
    # It settles; what is not known stays.
    assert run.contour_um[-1] < 0.05 * unknown.contour_um[-1]


def test_sweep_shows_where_each_model_breaks() -> None:
    radii = (1.0, 2.0, 5.0, 20.0)
    feeds = np.geomspace(500, 8000, 6)
    swept = ct.sweep([ct.Path.circle(r, tilt_deg=30.0) for r in radii], feeds)
    assert swept.contour_max_um.shape == (4, 6, 3)
    k = swept.controllers.index("independent")
    # Errors of the models grow with feed (the step's length) and with curvature.
    for model in (swept.tangent_max_arcsec, swept.proposed_max_arcsec):
        assert (np.diff(model[:, :, k], axis=1) > 0).all()
        assert (np.diff(model[:, :, k], axis=0) < 0).all()
    assert (swept.proposed_max_arcsec < swept.tangent_max_arcsec)[:, :, k].all()
    one = ct.simulate(ct.Path.circle(2.0, tilt_deg=30.0), feeds[3], controller="proposed")
    assert swept.contour_max_um[1, 3, 2] == one.figures["contour_max_um"]


def test_table_1_is_entered_as_it_stands() -> None:
    axial = {"X": 3.2, "Y": 3.2, "Z": 3.2, "A": 16070.0, "C": 8101.0}
    times = {"X": 5.76, "Y": 5.77, "Z": 5.50, "A": 5.85, "C": 5.75}
    at_axis = {"X": 25.40, "Y": 25.17, "Z": 25.37, "A": 0.0051, "C": 0.0101}
    entered = ct.Servo.of_gains(at_axis, axial, times)
    assert entered == ct.Servo.paper()
    # The rotary ones are those of motors behind gears of 1/180 and 1/90.
    at_motor = at_axis | {"A": 0.0051 * 180, "C": 0.0101 * 90}
    geared = ct.Servo.of_gains(at_motor, axial, times, gear_ratio={"A": 1 / 180, "c": 1 / 90})
    for letter, axis in geared.axes.items():
        assert axis.gain_per_s == pytest.approx(entered.axes[letter].gain_per_s, rel=1e-12)
    assert at_motor["A"] == pytest.approx(at_motor["C"], rel=0.02)  # two motors of one kind
    cross = [[22.5, 17.6, 0.0008]] * 3 + [[112491, 78744, 4.0175], [56709, 39696, 2.0253]]
    coupling = ct.Coupling.of_gains(cross, list(axial.values()))
    np.testing.assert_allclose(coupling.gains, ct.Coupling().gains, rtol=1e-12)
    with pytest.raises(
        tn.InputError, match="expected open-loop gain, axial gain and time constant"
    ):
        ct.Servo.of_gains({"X": 1.0}, {"X": 1.0, "Y": 2.0}, {"X": 1.0})
