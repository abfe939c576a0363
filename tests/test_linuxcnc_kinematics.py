"""The kinematics component for LinuxCNC holds the machine of the contract, both ways."""

from pathlib import Path

import numpy as np
import pytest

import trunnion as tn
from kins_bench import Floats, Kinematics, needs_gcc
from reference_trt_ca import ARCSEC, table_pose
from trunnion.compensation import MachineErrors
from trunnion.controls.linuxcnc.kinematics import component
from trunnion.controls.screws import screws, steps
from trunnion.setup.control import ControlSetup
from trunnion.setup.machines import presets

pytestmark = needs_gcc

CENTRE = np.array([210.5, 148.2, -301.0])
EFFECTS = {
    "scale_x": {"ppm": 40.0}, "scale_y": {"ppm": -25.0}, "scale_z": {"ppm": 60.0},
    "squareness_xy": {"arcsec": 12.0}, "squareness_xz": {"arcsec": -7.0},
    "squareness_yz": {"arcsec": 9.0},
}  # fmt: skip


def setup_of(preset: str = "trt-ca", **axes: tn.AxisSetup) -> tn.Setup:
    return tn.Setup(
        artefact=tn.Artefact("none"),
        machine=tn.Machine(preset=preset),
        axes=axes,
        control=ControlSetup(centre_mm=tuple(CENTRE)),
    )


def random_errors(preset: str, random: np.random.Generator) -> dict[str, float]:
    names = [name for name, _ in presets()[preset].core(150.0).location_errors]
    return {name: round(float(random.uniform(-300, 300)), 3) for name in names}


def linear_matrix() -> Floats:
    """I + Λ of the effects above, by the contract."""
    matrix = np.eye(3)
    for i, axis in enumerate("xyz"):
        matrix[i, i] += EFFECTS[f"scale_{axis}"]["ppm"] * 1e-6
    matrix[0, 1] -= EFFECTS["squareness_xy"]["arcsec"] * ARCSEC
    matrix[0, 2] += EFFECTS["squareness_xz"]["arcsec"] * ARCSEC
    matrix[1, 2] -= EFFECTS["squareness_yz"]["arcsec"] * ARCSEC
    return matrix


@pytest.mark.parametrize("sense", [1, -1])
def test_the_tool_point_is_on_the_table_where_the_contract_says(sense: int, tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    setup = setup_of(A=tn.AxisSetup(sense=sense), C=tn.AxisSetup(sense=sense))
    errors = random_errors("trt-ca", random)
    kins = Kinematics(component(setup, MachineErrors.of(setup, errors, EFFECTS)), tmp_path)
    kins.set({"tool-offset": 87.25})
    linear = linear_matrix()
    for _ in range(50):
        joints = np.r_[random.uniform(-400, 400, 3), random.uniform(-180, 180, 2)]
        tip = linear @ (joints[:3] - CENTRE - [0, 0, 87.25])
        pose = table_pose(errors, sense * joints[3], sense * joints[4])
        on_table = np.linalg.solve(pose, np.append(tip, 1.0))[:3]
        found = kins.forward(joints)
        np.testing.assert_allclose(found[:3] - CENTRE - [0, 0, 87.25], on_table, rtol=0, atol=1e-10)
        np.testing.assert_array_equal(found[3:], joints[3:])
        np.testing.assert_allclose(kins.inverse(found), joints, rtol=0, atol=1e-10)


def test_a_program_for_the_machine_without_errors_is_corrected(tmp_path: Path) -> None:
    random = np.random.default_rng(6)
    setup = setup_of()
    errors = random_errors("trt-ca", random)
    kins = Kinematics(component(setup, MachineErrors.of(setup, errors, EFFECTS)), tmp_path)
    assert kins.switch(2) == 0
    for _ in range(20):
        programmed = np.r_[random.uniform(-300, 300, 3), random.uniform(-120, 120, 2)]
        joints = kins.inverse(programmed)
        meant = np.linalg.solve(
            table_pose({}, *programmed[3:]), np.append(programmed[:3] - CENTRE, 1)
        )
        tip = np.append(linear_matrix() @ (joints[:3] - CENTRE), 1.0)
        reached = np.linalg.solve(table_pose(errors, *joints[3:]), tip)
        np.testing.assert_allclose(reached, meant, rtol=0, atol=1e-10)
        np.testing.assert_allclose(kins.forward(joints), programmed, rtol=0, atol=1e-10)


def test_identity_is_identity_and_other_types_are_refused(tmp_path: Path) -> None:
    setup = setup_of()
    kins = Kinematics(component(setup, MachineErrors.of(setup, {"EX0C": 80.0})), tmp_path)
    assert kins.switch(1) == 0
    kins.set({"zero-a-arcsec": 36.0})
    joints = np.array([1.0, 2.0, 3.0, 40.0, 50.0])
    np.testing.assert_array_equal(kins.forward(joints), joints)
    np.testing.assert_array_equal(kins.inverse(joints), joints)
    assert kins.switch(3) == -1
    np.testing.assert_array_equal(kins.forward(joints), joints)
    assert kins.switch(0) == 0
    assert kins.forward(joints)[3] == pytest.approx(40.0 - 0.01)
    np.testing.assert_allclose(kins.inverse(kins.forward(joints)), joints, rtol=0, atol=1e-10)


POINTS = {
    "trt-ca": {"A": (0.0, 5.5, -42.0)},
    "trt-bc": {"B": (-3.5, 0.0, 30.0)},
    "tt-ab": {"A": (0.0, -51.0, 4.0)},  # a Pocket NC
}


@pytest.mark.parametrize("preset", POINTS)
def test_axes_off_the_table_top_are_those_of_pinocchio(preset: str, tmp_path: Path) -> None:
    """The component, the lines of the axes and the steps of the chain, each by itself."""
    pin = pytest.importorskip("pinocchio")
    random = np.random.default_rng(7)
    axes = {letter: tn.AxisSetup(point_mm=point) for letter, point in POINTS[preset].items()}
    setup = setup_of(preset, **axes)
    errors = random_errors(preset, random)
    known = MachineErrors.of(setup, errors)
    model = tn.pinocchio_model(setup, errors)
    data = model.createData()
    kins = Kinematics(component(setup, known), tmp_path)
    lines, chain = screws(setup, known, "test"), list(steps(setup, known))
    for _ in range(20):
        joints = np.r_[random.uniform(-300, 300, 3), random.uniform(-170, 170, 2)]
        q = np.r_[joints[:3] - CENTRE, np.radians(joints[3:])]
        pin.framesForwardKinematics(model, data, q)
        table = data.oMf[model.getFrameId("table")]
        ball = data.oMf[model.getFrameId("ball")].translation
        found = kins.forward(joints)[:3] - CENTRE
        np.testing.assert_allclose(found, table.actInv(ball), rtol=0, atol=1e-9)
        at = (lines.zero @ np.append(found + CENTRE, 1.0))[:3]
        for i in (1, 0):
            turn = pin.exp3(np.radians(joints[3 + i]) * lines.directions[i])
            at = lines.points[i] + turn @ (at - lines.points[i])
        np.testing.assert_allclose(at, joints[:3], rtol=0, atol=1e-7)
        place = pin.SE3.Identity()
        angles = dict(zip(kins.letters, joints[3:], strict=True))
        for step in chain:
            way = np.eye(3)["XYZABC".index(step.key) % 3]
            if step.is_axis or step.key in "ABC":
                angle = step.value * (angles[step.key.lower()] if step.is_axis else 1.0)
                place *= pin.SE3(pin.exp3(np.radians(angle) * way), np.zeros(3))
            else:
                place *= pin.SE3(np.eye(3), step.value * way)
        np.testing.assert_allclose(place.act(found), ball, rtol=0, atol=1e-9)


def test_directions_of_iso_841_are_the_other_sense(tmp_path: Path) -> None:
    setup = setup_of()
    errors = {"EA0A": 20.0, "EX0C": 30.0, "EB0C": -50.0}
    kins = Kinematics(component(setup, MachineErrors.of(setup, errors)), tmp_path)
    joints = np.array([200.0, 100.0, -250.0, 30.0, 70.0])
    plain = kins.forward(joints * [1, 1, 1, -1, -1])[:3]
    kins.set({"conventional-directions": 1.0})
    np.testing.assert_allclose(kins.forward(joints)[:3], plain, rtol=0, atol=1e-12)
    (tmp_path / "other").mkdir()
    other = setup_of(A=tn.AxisSetup(sense=-1), C=tn.AxisSetup(sense=-1))
    made = component(other, MachineErrors.of(other, errors))
    assert "conventional_directions = 1 " in made
    found = Kinematics(made, tmp_path / "other").forward(joints)[:3]
    np.testing.assert_allclose(found, plain, rtol=0, atol=1e-12)


def test_what_it_cannot_hold_is_refused() -> None:
    head = tn.Setup(
        artefact=tn.Artefact("none"),
        machine=tn.Machine(preset="table-c-head-b"),
        control=ControlSetup(centre_mm=(0.0, 0.0, 0.0)),
    )
    with pytest.raises(tn.InputError, match="table-c-head-b, expected rotary axes under the table"):
        component(head, MachineErrors())
    with pytest.raises(tn.InputError, match=r"control.centre_mm: not given, expected the origin"):
        component(tn.Setup(artefact=tn.Artefact("none")), MachineErrors())
