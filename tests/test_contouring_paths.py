"""Paths: lengths by scipy, splines through points, programs, feed in curves and at the end."""

import pickle
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from trunnion import contouring as ct
from trunnion.base.errors import InputError, ProgramError


def test_arc_length_is_that_of_quadrature() -> None:
    path = ct.Path.paper()

    def speed(u: float) -> float:
        d = (15.0, 240 * u**2 - 80, -38.4 * u**5 + 51.2 * u**3 - 42.8 * u)
        return float(np.linalg.norm(d))

    for u in (0.1, 0.5, 0.9):
        length = quad(speed, 0, u, epsabs=1e-13, epsrel=1e-13)[0]
        assert path.at_length(length)[0] == pytest.approx(u, abs=1e-12)
    assert path.length_mm == pytest.approx(quad(speed, 0, 1, epsabs=1e-12)[0], abs=1e-10)
    assert pickle.loads(pickle.dumps(path)) == path


def test_a_spline_goes_through_its_points_with_their_tools() -> None:
    t = np.linspace(0, 2, 12)
    points = np.stack([10 * np.cos(t), 10 * np.sin(t), 2 * t], axis=1)
    tools = np.stack([0.3 * np.cos(t), 0.3 * np.sin(t), np.ones(12)], axis=1)
    path = ct.Path.spline(points, tools)
    u = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    u /= u[-1]
    np.testing.assert_allclose(path.points_mm(u), points, atol=1e-11)
    unit = tools / np.linalg.norm(tools, axis=1, keepdims=True)
    np.testing.assert_allclose(path.tools(u), unit, atol=1e-12)
    assert path.length_mm == pytest.approx(2 * np.hypot(10, 2), rel=1e-3)
    assert np.isfinite(ct.simulate(path, 1000.0).contour_um).all()


def test_a_program_gives_lines_and_arcs() -> None:
    text = "\n".join(
        [
            "G21 G90 G17",
            "G0 X0 Y0 Z0 A30 C90",
            "G1 X10 F1000",
            "G3 X10 Y20 I0 J10",
            "G1 X0 A40",
            "M2",
        ]
    )
    path = ct.Path.from_program(text)
    assert path.length_mm == pytest.approx(20 + 10 * np.pi, rel=1e-12)
    corners = [[0, 0], [10, 0], [20, 10], [10, 20], [0, 20]]
    np.testing.assert_allclose(path.points_mm([0, 1, 1.5, 2, 3])[:, :2], corners, atol=1e-9)
    run = ct.simulate(path, ct.Feed(1000.0, decelerate=True, dwell_s=0.3))
    np.testing.assert_allclose(run.reference[0, 3:], [30, 90], atol=1e-9)
    np.testing.assert_allclose(run.reference[-1, 3:], [40, 90], atol=1e-9)
    with pytest.raises(ProgramError, match="gap"):
        ct.Path.from_program(text.replace("G1 X0 A40", "G0 X5\nG1 X0 A40"))


def test_feed_in_curves_and_at_the_end() -> None:
    path = ct.Path.paper()
    limit = 300.0
    feed = ct.Feed(3000.0, decelerate=True, normal_acceleration_mm_s2=limit)
    run = ct.simulate(path, feed, controller="independent")
    d = np.diff(run.point_mm, n=2, axis=0) / 1e-6
    v = np.diff(run.point_mm, axis=0)[:-1] / 1e-3
    speed = np.linalg.norm(v, axis=1)
    normal = np.linalg.norm(np.cross(v, d), axis=1) / np.maximum(speed, 1e-9)
    assert normal[speed > 1].max() < limit * 1.01
    assert normal.max() > limit * 0.99
    assert speed.max() > 49.0
    along = np.diff(speed) / 1e-3
    assert np.abs(along).max() < 1.02 * 50.0 / 0.15
    # Rest at both ends, the end reached exactly.
    assert speed[0] < 0.5 > speed[-1]
    np.testing.assert_array_equal(run.u[-1], 1.0)


def test_cli_simulates_and_diagnoses(tmp_path: object) -> None:
    import json
    from pathlib import Path

    from typer.testing import CliRunner

    from trunnion.cli import app
    from trunnion.setup import Artefact, Setup

    folder = Path(str(tmp_path))
    servo = ct.Servo.paper()
    (folder / "setup.toml").write_text(
        Setup(artefact=Artefact("none"), servo=servo.to_table()).to_toml(), encoding="utf-8"
    )
    runner = CliRunner()
    log = str(folder / "axislog.csv")
    simulate = ["contour", "simulate", "--controller", "independent", "--output", log]
    done = runner.invoke(app, [*simulate, "--noise-um", "0.2", "--noise-arcsec", "1"])
    assert done.exit_code == 0, done.output
    assert "7.107" in done.output
    done = runner.invoke(app, ["contour", "diagnose", log, str(folder / "setup.toml"), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.output)["verdict"] == "consistent"
    done = runner.invoke(app, ["contour", "simulate", "--controller", "best"])
    assert done.exit_code == 2
    assert "controller" in done.output


@pytest.mark.parametrize(
    "u", [None, np.nan, [0.1, np.inf], [[0.1, 0.2]], "x", "1", 1j, np.ones(2) * 1j, [1, [2]]]
)
def test_parameters_that_are_no_finite_numbers_are_refused(u: Any) -> None:
    path = ct.Path.paper()
    for question in (path.points_mm, path.tools, path.curvature_per_mm, path.at_length):
        with pytest.raises(InputError, match=r"^(u|s_mm)(\[\d\])?: got"):
            question(u)
