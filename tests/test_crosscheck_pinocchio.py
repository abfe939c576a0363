"""Kinematics against Pinocchio, which nobody here wrote."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trunnion.base.errors import UnknownNameError
from trunnion.reference.pinocchio_model import pinocchio_model
from trunnion.setup import Artefact, AxisSetup, Machine, Setup
from trunnion.setup.machines import presets
from twin import forward, generator
from twin.forward import Floats

pin = pytest.importorskip("pinocchio")

PRESETS = ("trt-ca", "trt-bc", "table-c-head-b")
POSES = 200
EXACT = 1e-12  # mm and rad, of lengths of 100 mm: a few roundings


def setup_of(preset: str, point_mm: tuple[float, float, float] | None = None) -> Setup:
    letter = "A" if preset == "trt-ca" else "B"
    axes = {letter: AxisSetup(point_mm=point_mm)}
    return Setup(artefact=Artefact("cross"), machine=Machine(preset), axes=axes)


def axis_point(rng: np.random.Generator, preset: str) -> tuple[float, float, float]:
    """A point of the tilting axis; a head's pivot is as high as the probe is long."""
    x, y, z = rng.uniform(-60, 60, 3)
    length = setup_of(preset).probe.length_mm
    return (x, y, length if preset == "table-c-head-b" else z)


def frames(model: object, q: Floats) -> tuple[Floats, Floats]:
    """Poses (4, 4) of table and ball."""
    data = model.createData()  # type: ignore[attr-defined]
    pin.framesForwardKinematics(model, data, q)
    both = (data.oMf[model.getFrameId(name)] for name in ("table", "ball"))  # type: ignore[attr-defined]
    table, ball = (np.asarray(pose.homogeneous) for pose in both)
    return table, ball


@pytest.mark.parametrize("preset", PRESETS)
def test_the_twin_moves_as_pinocchio_does(preset: str) -> None:
    rng = np.random.default_rng(len(preset))
    length = setup_of(preset).probe.length_mm
    for _ in range(POSES):
        errors = generator.random_errors(rng, preset, 1000.0, 3600.0)
        point = axis_point(rng, preset)
        twin_setup = forward.Setup(preset=preset, probe_length_mm=length, tilt_point_mm=point)
        setup = setup_of(preset, point)
        model = pinocchio_model(setup, errors)
        first, second = rng.uniform(-120, 120), rng.uniform(-360, 360)
        xyz = rng.uniform(-200, 200, 3)
        q = pin.neutral(model)
        for name, value in zip("XYZ", xyz, strict=True):
            q[model.joints[model.getJointId(name)].idx_q] = value
        letter = twin_setup.tilt_letter
        q[model.joints[model.getJointId(letter)].idx_q] = np.radians(first)
        q[model.joints[model.getJointId("C")].idx_q] = np.radians(second)
        table, ball = frames(model, q)
        truth = forward.Truth(errors=errors)
        at = np.array([first]), np.array([second])
        assert np.abs(table - forward.table_pose(*at, twin_setup, truth)[0]).max() < EXACT
        if preset == "table-c-head-b":
            none = frames(pinocchio_model(setup), q)[1]
            moved = forward.head_displacement(np.radians(at[0]), twin_setup, errors)[0]
            assert np.abs(ball[:3, 3] - none[:3, 3] - moved).max() < 1e-11
        else:
            assert np.abs(ball[:3, 3] - xyz).max() < EXACT


def in_the_work(model: Any, q: Floats) -> tuple[Floats, Floats]:
    """Tool point and direction in the table's frame (6,), and their derivatives (6, axes)."""
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    ids = [model.getFrameId(name) for name in ("table", "ball")]
    table, ball = (data.oMf[i] for i in ids)
    back = table.rotation.T
    arm = ball.translation - table.translation
    spindle = ball.rotation[:, 2]
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    of_table, of_ball = (pin.getFrameJacobian(model, data, i, world) for i in ids)

    def cross(rates: Floats, vector: Floats) -> Floats:
        return np.cross(rates.T, vector).T

    point = of_ball[:3] - of_table[:3] - cross(of_table[3:], arm)
    direction = cross(of_ball[3:] - of_table[3:], spindle)
    return np.r_[back @ arm, back @ spindle], np.vstack([back @ point, back @ direction])


@pytest.mark.parametrize("preset", PRESETS)
def test_the_core_moves_as_pinocchio_does(preset: str) -> None:
    rng = np.random.default_rng(len(preset) + 1)
    length = setup_of(preset).probe.length_mm
    for _ in range(POSES):
        errors = generator.random_errors(rng, preset, 1000.0, 3600.0)
        point = axis_point(rng, preset)
        letter = "A" if preset == "trt-ca" else "B"
        ours = replace(presets()[preset], points_mm={letter: point}).core(
            length, list(errors.items())
        )
        model = pinocchio_model(setup_of(preset, point), errors)
        xyz, angles = rng.uniform(-200, 200, 3), rng.uniform(-180, 180, len(ours.letters))
        q = pin.neutral(model)
        order = ["X", "Y", "Z", *ours.letters]
        where = [model.joints[model.getJointId(name)].idx_q for name in order]
        q[where] = np.r_[xyz, np.radians(angles)]
        tool, slope = in_the_work(model, q)
        axes = np.r_[xyz, angles][None, :]
        assert np.abs(ours.forward(axes)[0] - tool).max() < EXACT
        per_rad = np.r_[np.ones(3), np.full(len(angles), 180 / np.pi)]
        ours_slope = ours.jacobian(axes).reshape(6, -1) * per_rad
        assert np.abs(ours_slope - slope[:, where]).max() < EXACT


def test_joints_are_the_axes() -> None:
    model = pinocchio_model(setup_of("trt-ca"), {})
    assert list(model.names)[1:] == ["X", "Y", "Z", "A", "C"]
    assert (model.nq, model.nv) == (5, 5)


def test_known_errors_hold_where_nothing_else_is_said() -> None:
    known = Setup(Artefact("cross"), Machine("trt-ca", {"EX0C": 7.0, "EY0A": 3.0}))
    model = pinocchio_model(known, {"E_YOA": 5.0})
    table, _ = frames(model, pin.neutral(model))
    assert table[:3, 3] == pytest.approx([7e-3, 0.0, 0.0])
    q = pin.neutral(model)
    q[3] = np.pi / 2
    assert frames(model, q)[0][:3, 3] == pytest.approx([7e-3, 5e-3, -5e-3])


def test_an_error_that_the_machine_has_not_is_refused() -> None:
    with pytest.raises(UnknownNameError, match=r"trt-bc: got 'EX0A', expected one of EA0B"):
        pinocchio_model(setup_of("trt-bc"), {"EX0A": 1.0})
    with pytest.raises(UnknownNameError, match="preset: got 'hexapod'"):
        pinocchio_model(setup_of("hexapod"), {})


def test_without_pinocchio_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    with pytest.raises(ImportError, match=r"trunnion\[reference\]"):
        pinocchio_model(setup_of("trt-ca"), {})
