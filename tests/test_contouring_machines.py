"""Contouring on other machines than the paper's: the same loop with their kinematics."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from trunnion import contouring
from trunnion.machine.chain import Chain
from twin.machines import Layout


@pytest.mark.parametrize("name", ["trt-bc", "table-c-head-b", "nutating-head", "head-bc"])
def test_reference_positions_reach_the_path(name: str) -> None:
    """Forward kinematics of the twin, errors included, are the points of the path."""
    known = tn.Machine(name).description()
    layout = Layout(known.chain, known.directions, known.points_mm)
    paper = contouring.Servo.paper()
    axes = {k: v for k, v in paper.axes.items() if k in "XYZC"} | {"B": paper.axes["A"]}
    servo = contouring.Servo(axes, period_ms=1.0)
    setup = tn.Setup(artefact=tn.Artefact("none"), machine=tn.Machine(name))
    points = np.array([[0.0, 0, 0], [4, 1, 1], [9, 2, 2], [14, 2, 3]])
    tools = np.array([[0.2, 0.1, 1.0], [0.25, 0.12, 1], [0.3, 0.15, 1], [0.32, 0.2, 1]])
    tools /= np.linalg.norm(tools, axis=1)[:, None]
    path = contouring.Path.spline(points, tools)
    # The twin takes errors that are not named for ones that the machine has not.
    errors = dict.fromkeys(Chain(setup).location_errors, 0.0) | {"EB0B": 50.0, "EX0C": 30.0}
    run = contouring.simulate(path, 1500.0, servo=servo, setup=setup, assumed=errors, errors=errors)
    assert run.axes == f"XYZ{''.join(layout.letters)}"
    for row in range(0, len(run), 25):
        at = np.r_[run.reference[row, :3], np.radians(run.reference[row, 3:])]
        assert np.abs(layout.tool(at, errors)[:3] - run.point_mm[row]).max() < 1e-9
    unknown = contouring.simulate(path, 1500.0, servo=servo, setup=setup, errors=errors)
    assert unknown.figures["contour_max_um"] > run.figures["contour_max_um"]
    assert sorted(run.axis_log().axes) == sorted("xyzbc")


def test_a_machine_without_two_rotary_axes_is_refused() -> None:
    setup = tn.Setup(artefact=tn.Artefact("none"), machine=tn.Machine("four-axis-a"))
    path = contouring.Path.lines(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
    )
    with pytest.raises(tn.InputError, match="four-axis-a: A, expected one with two rotary axes"):
        contouring.simulate(path, 100.0, setup=setup)


def test_known_errors_and_senses_of_the_set_up_are_not_ignored() -> None:
    path = contouring.Path.lines(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.3, 0.0, 1.0], [0.3, 0.1, 1.0]]
    )
    known = tn.Setup(artefact=tn.Artefact("none"), machine=tn.Machine(errors={"EX0C": 500.0}))
    run = contouring.simulate(path, 600.0, setup=known)
    told = contouring.simulate(path, 600.0, errors={"EX0C": 500.0}, assumed={"EX0C": 500.0})
    assert np.array_equal(run.reference, told.reference)
    turned = tn.Setup(artefact=tn.Artefact("none"), axes={"C": tn.AxisSetup(-1)})
    with pytest.raises(tn.InputError, match=r"axes\.C\.sense: got -1, expected 1"):
        contouring.simulate(path, 600.0, setup=turned)
