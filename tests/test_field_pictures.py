"""What the field's own pictures show, held to figures that are known beforehand."""

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.text import Text

import trunnion as tn
from trunnion import contouring
from trunnion.plot.picture import Form
from trunnion.plot.points import deviations_um
from trunnion.plot.rotary import error_motions
from trunnion.plot.static import panels


def test_the_diagram_of_a_linear_axis_marks_what_the_standard_says() -> None:
    target = np.tile(np.concatenate([np.arange(5.0), np.arange(5.0)[::-1]]) * 100.0, 3)
    sense = np.tile(np.repeat([1, -1], 5), 3)
    cycle = np.repeat([1, 2, 3], 10)
    # 10 µm of reversal, 2 µm a target, ± 1 µm from cycle to cycle
    error = 5e-3 * sense + 2e-5 * target + 1e-3 * (cycle - 2)
    data = tn.Positioning(
        target_mm=target, measured_mm=target + error, direction=sense, cycle=cycle, axis=["X"] * 30
    )
    (picture,) = tn.plot.pictures(data)
    r = data.iso230_2()
    for letter, value in (("A", r.accuracy_um), ("E", r.systematic_um), ("B", r.reversal_um)):
        assert f"{letter} = {value:.3g} µm" in picture.title
    assert [text for *_, text in picture.notes_at] == ["A", "E", "M", "R", "B"]
    spans = [s for s in picture.series if s.form is Form.LINE and len(s.x) == 6]
    heights = sorted(float(np.ptp(s.y)) for s in spans)
    assert r.reversal_um == pytest.approx(10.0)
    assert r.mean_systematic_um == pytest.approx(8.0)
    expected = sorted(
        [r.accuracy_um, r.systematic_um, r.mean_systematic_um, r.repeatability_um, r.reversal_um]
    )
    np.testing.assert_allclose(heights, expected, rtol=1e-9)


def _turned(radial_um: float, axial_um: float, tilt_arcsec: float, turns: int = 2) -> tn.Sweep:
    """Four targets on a table whose axis has an error motion three times a turn."""
    angle = np.tile(np.arange(0.0, 360.0, 10.0), turns)
    turn = np.radians(angle)
    places = np.array([[90.0, 0, 0], [0, 80.0, 60.0], [-70.0, 10.0, 30.0], [5.0, -60.0, 90.0]])
    rows = []
    for k, p in enumerate(places, 1):
        x = p[0] * np.cos(turn) - p[1] * np.sin(turn)
        y = p[0] * np.sin(turn) + p[1] * np.cos(turn)
        z = np.full_like(turn, p[2])
        wave = np.cos(3 * turn)
        lean = tilt_arcsec * np.pi / 648000 * wave  # towards the direction that turns
        # tilt about the middle height of the targets, 45 mm
        away = radial_um * 1e-3 * wave + lean * (z - 45.0)
        along = axial_um * 1e-3 * wave - lean * (x * np.cos(turn) + y * np.sin(turn))
        xyz = np.column_stack(
            [300 + x + away * np.cos(turn), 200 + y + away * np.sin(turn), 100 + z + along]
        )
        rows.append((k, xyz))
    points = np.concatenate([xyz for _, xyz in rows])
    return tn.Sweep(
        angle_deg=np.tile(angle, 4),
        target=np.repeat([k for k, _ in rows], len(angle)),
        x_mm=points[:, 0],
        y_mm=points[:, 1],
        z_mm=points[:, 2],
    )


@pytest.mark.parametrize("size", [(4.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0, 0.0, 5.0)])
def test_error_motions_are_found_and_kept_apart(size: tuple[float, float, float]) -> None:
    radial, axial, tilt = error_motions(_turned(*size))
    for motion, amplitude in zip((radial, axial, tilt), size, strict=True):
        assert motion.synchronous == pytest.approx(2 * amplitude, abs=0.02)
        assert motion.asynchronous == pytest.approx(0.0, abs=1e-4)
        assert motion.repeated


def test_what_does_not_come_again_is_asynchronous() -> None:
    sweep = _turned(4.0, 0.0, 0.0)
    second = np.tile(np.repeat([0.0, 1.0], 36), 4)
    lifted = sweep.with_columns(z_mm=sweep.z_mm + 2e-3 * second)
    axial = error_motions(lifted)[1]
    assert axial.asynchronous == pytest.approx(2.0, abs=1e-3)
    assert axial.synchronous == pytest.approx(0.0, abs=1e-3)


def test_a_vector_map_has_one_scale_and_no_placement() -> None:
    x, y = (g.ravel() for g in np.meshgrid(np.arange(6) * 50.0, np.arange(5) * 40.0))
    turn = 2e-3
    grown = 1 + 100e-6
    measured = tn.Points(
        nominal_x_mm=x,
        nominal_y_mm=y,
        x_mm=7 + np.cos(turn) * grown * x - np.sin(turn) * y,
        y_mm=-3 + np.sin(turn) * grown * x + np.cos(turn) * y,
    )
    away = deviations_um(measured)
    np.testing.assert_allclose(away[:, 0], 100e-3 * (x - x.mean()), atol=1e-2)
    np.testing.assert_allclose(away[:, 1], 0.0, atol=1e-2)
    (picture,) = tn.plot.pictures(measured)
    assert "Largest 12.5 µm" in picture.note
    assert picture.notes_at[0][2].strip() == "10 µm"


TONES_HZ = (1.0, 2.0, 3.0, 5.0, 7.0, 9.0, 12.0, 15.0)


def _lag(gain_per_s: float) -> tn.AxisLog:
    """A log of an axis of first order, by its exact solution for a sum of sines."""
    time = np.arange(0.0, 12.0, 1e-3)
    commanded, actual = np.zeros_like(time), np.zeros_like(time)
    for k, hz in enumerate(TONES_HZ):
        w, amplitude = 2 * np.pi * hz, 5.0 / hz
        commanded += amplitude * np.sin(w * time + k)
        response = 1 / (1 + 1j * w / gain_per_s)
        actual += amplitude * np.abs(response) * np.sin(w * time + k + np.angle(response))
    return tn.AxisLog(time_s=time, x_cmd_mm=commanded, x_act_mm=actual)


def test_response_of_data_and_model_is_that_of_a_first_order_lag() -> None:
    servo = contouring.Servo(
        {"X": contouring.LinearAxis(gain_per_s=60.0, time_constant_ms=0.0)}, period_ms=1.0
    )
    *_, response = tn.plot.axis_log_pictures(_lag(60.0), servo=servo)
    data, model = response.series
    assert (data.label, model.label) == ("data", "servo model")
    tones = np.array(TONES_HZ)
    shown = np.abs(data.x[:, None] - tones).min(axis=1) < 0.02
    assert shown.sum() == len(tones)
    expected = -10 * np.log10(1 + (2 * np.pi * data.x[shown] / 60.0) ** 2)
    np.testing.assert_allclose(data.y[shown], expected, atol=0.1)
    both = np.isin(data.x, model.x) & shown
    np.testing.assert_allclose(model.y[np.isin(model.x, data.x[both])], data.y[both], atol=0.3)
    *_, slower = tn.plot.axis_log_pictures(_lag(30.0), servo=servo)
    assert np.abs(slower.series[0].y - slower.series[1].y).max() > 2.0


def test_loop_gain_is_the_slope_over_speed() -> None:
    log = contouring.simulate(
        contouring.Path.circle(20.0, turn_deg=360.0), 2000.0, controller="independent"
    ).axis_log()
    speed = tn.plot.axis_log_pictures(log, axis="x")[1]
    found = float(speed.title.partition("loop gain ")[2].partition(" ")[0])
    assert found == pytest.approx(81.28, rel=0.02)


def test_causes_are_ranked_in_percent() -> None:
    folder = tn.sample_path("hidden")
    d = tn.diagnose(tn.read_touches(folder / "touches.csv"), tn.read_setup(folder / "setup.toml"))
    ax = tn.plot.plot_contributions(d)
    widths = [bar.get_width() for bar in ax.patches if np.isfinite(bar.get_width())]
    assert sum(widths) == pytest.approx(100.0, abs=1e-6)
    assert widths[: len(d.contributions)] == sorted(widths[: len(d.contributions)], reverse=True)
    plt.close("all")


def test_passes_of_a_turned_part_are_apart() -> None:
    data = tn.read_diameters(tn.sample_path("turning/passes.csv"))
    (picture,) = tn.plot.pictures(data)
    assert picture.x.title == "Z from the chuck face (mm)"
    named = [s for s in picture.series if s.label]
    assert len(named) == len(set(np.asarray(data.pass_).tolist())) > 1
    assert sum(len(s.x) for s in named) == len(data)
    assert len({s.colour for s in named}) == len(named)


def test_rates_are_stacked() -> None:
    ax = tn.plot.plot_rates(["a", "b"], {"found": [80, 50], "missed": [20, 40], "wrong": [0, 10]})
    assert max(bar.get_width() for bar in ax.patches) == 100
    with pytest.raises(tn.InputError, match="found: got shape"):
        tn.plot.plot_rates(["a", "b"], {"found": [80]})
    plt.close("all")


def test_axes_and_keywords_are_passed_on() -> None:
    data = tn.read_diameters(tn.sample_path("turning/diameters.csv"))
    _, ax = plt.subplots()
    assert data.plot(ax=ax, color="black", title="mine", legend=False) is ax
    assert ax.get_title(loc="left") == "mine"
    assert {line.get_color() for line in ax.get_lines()} == {"black"}
    assert ax.get_legend() is None
    with pytest.raises(tn.InputError, match="expected polar ones"):
        tn.read_ballbar(tn.sample_path("ballbar/circle.csv")).plot(ax=ax)
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    with pytest.raises(tn.InputError, match="expected axes of projection '3d'"):
        tn.plot.plot_artefact(tn.plan(setup), setup, ax=ax)
    plt.close("all")


def test_estimates_of_two_machines_stand_side_by_side() -> None:
    folder = tn.sample_path("cross")
    fit = tn.identify(tn.read_touches(folder / "touches.csv"), tn.read_setup(folder / "setup.toml"))
    other = tn.Setup(artefact=tn.Artefact("cross"), machine=tn.Machine("trt-bc"))
    second = tn.identify(tn.simulate(tn.plan(other), other, {}, noise_um=0.1, seed=1), other)
    figure = tn.plot.plot_estimates({"ca": fit, "bc": second})
    names = {t.get_text() for ax in figure.axes for t in ax.get_xticklabels()}
    assert {"EA0A", "EB0B", "EX0C"} <= names
    _, ax = plt.subplots()
    with pytest.raises(tn.InputError, match="expected unit='µm'"):
        tn.plot.plot_estimates(fit, ax=ax)
    assert tn.plot.plot_estimates(fit, ax=ax, unit="µm") is ax
    plt.close("all")


def test_arguments_that_say_nothing_are_refused() -> None:
    field = tn.volumetric_error(
        tn.Setup(artefact=tn.Artefact("cross")), {"EX0C": 10.0}, points=(3, 3, 2)
    )
    with pytest.raises(tn.InputError, match="at_mm: got 999"):
        tn.plot.plot_volumetric(field, at_mm=999.0)
    with pytest.raises(tn.InputError, match="pose: got 'Q'"):
        tn.plot.plot_volumetric(field, pose={"Q": 0.0})


def test_titles_and_legends_do_not_cover_data() -> None:
    log = tn.read_axis_log(tn.sample_path("contour/axislog.csv"))
    figure = panels(tn.plot.axis_log_pictures(log), columns=2)
    figure.canvas.draw()
    for ax in figure.axes:
        legend = ax.get_legend()
        if legend is not None:
            box = legend.get_window_extent()
            assert box.y0 >= ax.get_window_extent().y1 - 2
            (title,) = (
                text
                for text in ax.get_children()
                if isinstance(text, Text) and text.get_text() == ax.get_title(loc="left")
            )
            assert title.get_window_extent().y0 >= box.y1 - 2
    plt.close("all")


def test_what_parameters_of_a_control_leave_is_ranked() -> None:
    setup = tn.Setup(tn.Artefact("cross"))
    found = tn.cnc_parameters(setup, {"EX0C": 15.0, "EB0A": 10.0})
    (picture,) = tn.plot.pictures(found)
    lengths = np.asarray(picture.series[0].x)
    assert picture.y.names[0] == "tilt of the A axis about Y"
    assert np.all(np.diff(lengths) <= 0)
    # An offset is a centre of the control's transformation: nothing of it is left.
    assert lengths[picture.y.names.index("offset of the C axis along X")] < 1e-6
    # EB0A turns the A axis alone, by w = (1 - Rx(a)) y: its error is w × r at r = Rx(a) Rz(c) p.
    a, c = (np.radians(np.arange(*ends, 15)) for ends in ((-90, 91), (0, 360)))
    moments, squares = np.diag([150.0**2, 120.0**2, 150.0**2]) / 3, []  # of the box, from z = 0
    for tilt, turn in np.stack(np.meshgrid(a, c), axis=-1).reshape(-1, 2):
        (s1, s2), (c1, c2) = np.sin([tilt, turn]), np.cos([tilt, turn])
        pose = np.array([[1, 0, 0], [0, c1, -s1], [0, s1, c1]]) @ np.array(
            [[c2, -s2, 0], [s2, c2, 0], [0, 0, 1]]
        )
        w, m = np.array([0.0, 1.0 - c1, -s1]), pose @ moments @ pose.T
        squares.append(w @ w * np.trace(m) - w @ m @ w)
    tilted = tn.cnc_parameters(setup, {"EB0A": 10.0})
    expected = 1e3 * np.radians(10.0 / 3600) * np.sqrt(np.mean(squares))
    assert tilted.before_um == pytest.approx(expected, rel=1e-4)
    assert tilted.left_um is not None
    assert 0 < tilted.left_um < expected
    alone = tn.cnc_parameters(setup, {"EX0C": 15.0})
    assert alone.before_um == pytest.approx(15.0, rel=1e-6)  # a shift, the same everywhere
    assert alone.left_um == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(tn.InputError, match="least-squares"):
        tn.cnc_parameters(setup, {"EX0C": 15.0}, method="direct").plot()


def test_a_batch_shows_what_is_explained_of_each() -> None:
    plate = tn.sample_path("plate/first.csv")
    batch = tn.diagnose_many([plate, "none.csv"], workers=1)
    (picture,) = tn.plot.pictures(batch)
    assert picture.y.names == ("first.csv: explained",)
    d = tn.diagnose(tn.read(plate))
    share = 1 - (d.gain.rms_after_um / d.gain.rms_before_um) ** 2
    assert np.asarray(picture.series[0].x)[0] == pytest.approx(100 * share, abs=1.5)
