"""Views in space: what is drawn is where it is, at the scale that is stated."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion import contouring, hybrid
from trunnion.cli import app
from trunnion.plot.scenes.machine import posture
from trunnion.plot.scenes.page import views_page
from trunnion.plot.scenes.touches import touches_view
from trunnion.plot.style import round_number

CROSS = tn.Setup(artefact=tn.Artefact("cross"))
ERRORS = {"EX0C": 15.0, "EA0A": 20.0}


def _measured() -> tuple[tn.Touches, tn.Setup]:
    folder = tn.sample_path("cross")
    return tn.read_touches(folder / "touches.csv"), tn.read_setup(folder / "setup.toml")


def _lines(figure: Any, name: str) -> list[Any]:
    return [t for t in figure.data if t.name == name]


def _shafts(trace: Any) -> np.ndarray:
    """Tails of the arrows of a trace, and which way they point: (n, 2, 3)."""
    points = np.column_stack([trace.x, trace.y, trace.z]).reshape(-1, 3, 3)
    return points[:, :2]


def test_axes_are_where_the_machine_has_them() -> None:
    a, c = posture(CROSS, {"A": 30.0}).axes()
    assert (a.letter, c.letter) == ("A", "C")
    assert a.direction == pytest.approx([1, 0, 0], abs=1e-12)
    assert c.direction == pytest.approx([0, -0.5, np.sqrt(0.75)], abs=1e-12)
    sunk = tn.Setup(
        artefact=tn.Artefact("cross"), axes={"A": tn.AxisSetup(point_mm=(0.0, 5.0, -30.0))}
    )
    axis = posture(sunk).axes()[0]
    assert axis.point == pytest.approx([0, 5, -30], abs=1e-9)
    # turned by 90° about it, the table's origin goes from (0, 0) to (y - z, z + y) of the point
    at = posture(sunk, {"A": 90.0}).of_table(np.zeros(3))
    assert at == pytest.approx([0, 5 - 30, -30 - 5], abs=1e-9)


def test_an_axis_of_the_head_is_at_its_pivot() -> None:
    head = tn.Setup(
        artefact=tn.Artefact("cross"),
        machine=tn.Machine("table-c-head-b"),
        probe=tn.Probe(length_mm=120.0),
    )
    found = {axis.letter: axis for axis in posture(head).axes()}
    assert np.abs(found["B"].direction) == pytest.approx([0, 1, 0], abs=1e-9)
    assert found["B"].point[2] == pytest.approx(120.0, abs=1e-9)
    assert found["C"].direction == pytest.approx([0, 0, 1], abs=1e-9)


def test_sense_of_the_control_turns_the_arrow() -> None:
    other = tn.Setup(artefact=tn.Artefact("cross"), axes={"C": tn.AxisSetup(sense=-1)})
    assert posture(other).axes()[1].direction == pytest.approx([0, 0, -1], abs=1e-12)


def test_every_posture_has_its_touches() -> None:
    plan = tn.plan(CROSS)
    figure = tn.plot.scene(plan, CROSS)
    shown = _lines(figure, "touch")
    assert len(figure.layout.sliders[0].steps) == len(shown) == 6
    assert sum(len(t.x) for t in shown) == len(plan)
    for number, step in enumerate(figure.layout.sliders[0].steps):
        visible = [t for t, seen in zip(figure.data, step.args[0]["visible"], strict=True) if seen]
        assert [t for t in visible if t.name == "touch"] == [shown[number]]


def test_residuals_are_drawn_on_the_stated_scale() -> None:
    touches, setup = _measured()
    fit = tn.identify(touches, setup)
    figure = fit.scene(touches, setup)
    said = re.search(r"× ([\d,]+): ([\d.]+) µm drawn as ([\d.]+) mm", figure.layout.title.text)
    assert said is not None
    scale, um, mm = (float(x.replace(",", "")) for x in said.groups())
    assert mm == pytest.approx(scale * um * 1e-3)
    coloured = [t for t in figure.data if t.type == "scatter3d" and t.line.coloraxis]
    value = np.concatenate([np.asarray(t.line.color)[::3] for t in coloured])
    np.testing.assert_allclose(np.sort(value), np.sort(np.abs(fit.residuals_um)))
    twice = fit.scene(touches, setup, magnification=2 * scale)
    lengths = [
        np.concatenate(
            [
                np.linalg.norm(np.diff(_shafts(t), axis=1)[:, 0], axis=1)
                for t in f.data
                if t.type == "scatter3d" and t.line.coloraxis
            ]
        )
        for f in (figure, twice)
    ]
    # shafts end where heads begin, which have an upper bound
    assert np.all(lengths[1] > 1.99 * lengths[0] - 1e-5)


def test_fields_before_and_after_share_one_scale() -> None:
    before = tn.volumetric_error(CROSS, ERRORS, points=(3, 3, 2))
    model = tn.ModelCompensation.of(CROSS, {"EX0C": 15.0, "EA0A": 10.0})
    after = tn.volumetric_error(CROSS, ERRORS, compensation=model, points=(3, 3, 2))
    figure = before.scene(after)
    assert figure.layout.coloraxis.cmax == pytest.approx(before.max_um)
    for scene, field in (("scene", before), ("scene2", after)):
        shown = [t for t in figure.data if t.type == "scatter3d" and t.scene == scene]
        (dots,) = (t for t in shown if t.mode == "markers")
        np.testing.assert_allclose(
            np.sort(dots.marker.color), np.sort(field.magnitude_um.ravel()), rtol=1e-12
        )
    assert "largest" in figure.layout.annotations[0].text


def test_contour_error_is_the_colour_of_the_path() -> None:
    run = contouring.simulate(contouring.Path.circle(5.0, turn_deg=20.0, tilt_deg=10.0), 1000.0)
    (drawn,) = _lines(run.scene(), "tool tip, magnified")
    np.testing.assert_allclose(drawn.line.color, run.contour_um)
    said = re.search(r"× ([\d,]+): ", run.scene().layout.title.text)
    assert said is not None
    feet = np.column_stack([run.scene().data[-1][x] for x in "xyz"])
    lengths = np.linalg.norm(feet[1::3] - feet[::3], axis=1)
    assert lengths[-1] == pytest.approx(
        1e-3 * float(said[1].replace(",", "")) * run.contour_um[-1], rel=1e-3
    )


def test_legs_have_their_length_and_the_platform_its_size() -> None:
    from trunnion.plot.scenes.hybrid import _joints

    row = np.array([1100.0, 1130.0, 1110.0, 20.0, 5.0])
    base, ends, wrist, tip = _joints(hybrid.Mechanism(), row)
    np.testing.assert_allclose(np.linalg.norm(ends - base, axis=1), row[:3], rtol=1e-12)
    # e9 + e11 = 400 apart; leg 2 at e10 = 130 from the middle of the two
    assert np.linalg.norm(ends[2] - ends[0]) == pytest.approx(400.0)
    assert np.linalg.norm(ends[1] - (ends[0] + ends[2]) / 2) == pytest.approx(130.0)
    # the axes of q4 and q5 meet (e14 = 0): both ways to the wrist agree
    np.testing.assert_allclose(wrist[0], wrist[1], atol=1e-6)
    assert np.linalg.norm(tip - wrist[1]) == pytest.approx(250.0)


@pytest.mark.parametrize(
    "sample", ["plate/first.csv", "axis/sweep.csv"], ids=lambda name: name.split("/")[0]
)
def test_measured_vectors_do_not_hold_the_placement(sample: str) -> None:
    data = tn.read(tn.sample_path(sample))
    figure = data.scene()
    assert 0 < figure.layout.coloraxis.cmax < 200  # µm; the plate lay 4 mm off its place


def test_what_has_no_view_says_so() -> None:
    with pytest.raises(tn.InputError, match="scene: got Gain, expected one of"):
        tn.plot.scene(tn.diagnose(*_measured()).gain)
    with pytest.raises(tn.InputError, match="got 0 Setup, expected the one that it is of"):
        _measured()[0].scene()
    bar, stop = (tn.read(tn.sample_path(f)) for f in ("ballbar/circle.csv", "positioning/axis.csv"))
    with pytest.raises(tn.InputError, match="scene: got a diagnosis of 2 measurements together"):
        tn.diagnose([bar, stop]).scene()
    with pytest.raises(tn.InputError, match="residuals_um: got shape"):
        tn.plot.scene(*_measured(), residuals_um=np.zeros(3))


@pytest.mark.parametrize("value", [0.0034, 1.0, 19.9, 200.0, 5e6])
def test_a_round_number_is_not_above(value: float) -> None:
    found = round_number(value)
    assert 0.4 * value < found <= value
    assert f"{found:e}"[0] in "125"


def test_a_page_of_views_needs_no_network_and_escapes() -> None:
    page = views_page([("<script>x</script>", tn.plot.scene(CROSS))], "a & <b>")
    assert "<script>x" not in page
    assert "a &amp; &lt;b&gt;" in page
    assert "default-src 'none'" in page
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", page)


def test_command_writes_one_page(tmp_path: Path) -> None:
    folder = tn.sample_path("cross")
    out = tmp_path / "view.html"
    files = [str(folder / "touches.csv"), str(folder / "setup.toml")]
    run = CliRunner().invoke(app, ["view", *files, "-o", str(out), "--residuals"])
    assert run.exit_code == 0, run.output
    assert "Residuals of 72 touches" in out.read_text(encoding="utf-8")
    again = CliRunner().invoke(app, ["view", *files, "-o", str(out)])
    assert again.exit_code == 2
    lone = CliRunner().invoke(app, ["view", files[0], "-o", str(tmp_path / "other.html")])
    assert lone.exit_code == 2
    assert "got no set-up (.toml) beside it" in lone.output


def test_command_shows_estimates_programs_and_machines(tmp_path: Path) -> None:
    errors = tmp_path / "errors.json"
    errors.write_text('{"EX0C": 15.0, "EA0A": 20.0}', encoding="utf-8")
    setup = str(tn.sample_path("cross/setup.toml"))
    part = str(tn.sample_path("turning/part.ngc"))
    calls = (
        [setup],
        [str(errors), setup],
        [part, "--dialect", "linuxcnc-lathe"],
        [str(tn.sample_path("levels/plate.csv"))],
    )
    for number, arguments in enumerate(calls):
        out = tmp_path / f"{number}.html"
        run = CliRunner().invoke(app, ["view", *arguments, "-o", str(out)])
        assert run.exit_code == 0, run.output
        assert "Plotly.newPlot" in out.read_text(encoding="utf-8")


@pytest.mark.parametrize("ending", ["ngc", "nc", "TAP", "gcode", "mpf", "spf"])
def test_a_file_that_a_control_takes_for_a_program_is_viewed_as_one(
    ending: str, tmp_path: Path
) -> None:
    """And no table is written under its name: one list says what is a program."""
    part, out = tmp_path / f"part.{ending}", tmp_path / "part.html"
    part.write_text("G21 G90\nG0 X0 Y0 Z5\nG1 X10 F100\nM2\n", encoding="utf-8")
    run = CliRunner().invoke(app, ["view", str(part), "-o", str(out)])
    assert run.exit_code == 0, run.output
    setup = str(tn.sample_path("cross/setup.toml"))
    words = ["simulate", setup, "-o", str(part), "--force"]
    assert "takes for a program" in CliRunner().invoke(app, words).stderr


def test_arrows_of_residuals_stand_outside_the_body_and_an_outlier_hides_none() -> None:
    """A touch that meets the body late is an arrow that ends on it; the outlier's is cut."""
    setup = tn.Setup(tn.Artefact("cross"))
    plan = tn.plan(setup, c_deg=(0,), a_deg=(90,))
    touches = tn.simulate(plan, setup, noise_um=0.3, seed=1)
    first = np.flatnonzero(touches.rotary_deg["a"] == touches.rotary_deg["a"][0])
    residuals = np.linspace(-0.5, 0.5, len(touches))
    residuals[first[0]] = 40.0
    figure = touches_view(touches, setup, residuals_um=residuals).figure()
    shafts = next(t for t in figure.data if t.type == "scatter3d" and t.line.coloraxis)
    heads = next(t for t in figure.data if t.type == "mesh3d" and t.coloraxis)
    tails = np.column_stack([shafts.x, shafts.y, shafts.z])[::3]
    tips = np.column_stack([heads.x, heads.y, heads.z])[:: len(heads.x) // len(tails)]
    contact = touches.position_mm + setup.probe.ball_radius_mm * touches.direction
    into = residuals[first] > 0
    ends = np.where(into[:, None], tips, tails)
    np.testing.assert_allclose(ends, contact[first], atol=1e-4)
    lengths = np.linalg.norm(tips - tails, axis=1)
    outside = np.einsum(
        "ni,ni->n", np.where(into[:, None], tails, tips) - ends, touches.direction[first]
    )
    np.testing.assert_allclose(outside, -lengths, atol=1e-4)
    sizes = np.abs(residuals[first])
    assert lengths[0] == lengths.max()
    assert lengths[0] / sizes[0] < 0.1 * lengths[1] / sizes[1]  # cut, and the others are seen
    assert "1 beyond" in figure.layout.title.text


def test_a_diagnosis_without_its_data_has_no_view() -> None:
    found = replace(tn.diagnose(tn.read(tn.sample_path("plate/first.csv"))), data=None)
    with pytest.raises(tn.InputError, match="without its measured data"):
        found.scene()
