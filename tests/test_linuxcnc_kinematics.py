"""The kinematics component for LinuxCNC holds the machine of the contract, both ways."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from kins_bench import Floats, Kinematics, needs_gcc
from reference_trt_ca import ARCSEC, table_pose
from trunnion.compensation import MachineErrors
from trunnion.controls import linuxcnc_files
from trunnion.controls.linuxcnc.kinematics import component, held
from trunnion.controls.screws import screws, steps
from trunnion.machine.chain import Chain
from trunnion.machine.linear_axes import LinearMotion, Travel
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


@pytest.mark.parametrize("senses", [(-1, 1, 1), (1, -1, -1), (-1, -1, -1)])
def test_linear_axes_that_count_the_other_way(senses: tuple[int, int, int], tmp_path: Path) -> None:
    random = np.random.default_rng(7)
    named = dict(zip("XYZ", senses, strict=True))
    axes = {letter: tn.AxisSetup(sense=sense) for letter, sense in named.items()}
    setup = replace(setup_of(), axes=axes)
    errors = random_errors("trt-ca", random)
    kins = Kinematics(component(setup, MachineErrors.of(setup, errors, EFFECTS)), tmp_path)
    for _ in range(50):
        joints = np.r_[random.uniform(-400, 400, 3), random.uniform(-180, 180, 2)]
        tip = linear_matrix() @ (senses * (joints[:3] - CENTRE))
        on_table = np.linalg.solve(table_pose(errors, *joints[3:]), np.append(tip, 1.0))[:3]
        found = kins.forward(joints)
        np.testing.assert_allclose(found[:3] - CENTRE, senses * on_table, rtol=0, atol=1e-10)
        np.testing.assert_allclose(kins.inverse(found), joints, rtol=0, atol=1e-10)


def test_stock_kinematics_refuse_linear_axes_that_count_the_other_way() -> None:
    setup = setup_of(Y=tn.AxisSetup(sense=-1))
    with pytest.raises(tn.InputError, match=r"trt-kins: got axes\.Y\.sense = -1, expected 1: it"):
        linuxcnc_files(setup, {}, kinematics="stock")


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


POINTS: dict[str, dict[str, tuple[float, float, float]]] = {
    "trt-ca": {"A": (0.0, 5.5, -42.0)},
    "trt-bc": {"B": (-3.5, 0.0, 30.0)},
    "tt-ab": {"A": (0.0, -51.0, 4.0)},  # a Pocket NC
    "[w B' A' b X Y Z (C) t]": {"A": (0.0, 7.0, -20.0), "B": (4.0, 0.0, -35.0)},
    "nutating-table": {"B": (2.0, 10.0, -30.0)},
    "four-axis-a": {"A": (0.0, 3.0, -60.0)},
    "four-axis-c": {},
    "three-axis": {},
}
HEADS: dict[str, dict[str, tuple[float, float, float]]] = {
    "head-bc": {"C": (3.0, -2.0, 0.0)},
    "head-ac": {},
    "table-c-head-b": {"B": (-4.0, 0.0, 0.0)},
    "nutating-head": {},
}
"""Points less the pivot."""


ERROR_MOTIONS = ("radial_2", "wobble_2", "axial", "axial_2", "sag", "twist")
OBLIQUE = ("nutating-table", "nutating-head")


def placed(
    machine: str, points: dict[str, tuple[float, float, float]], length_mm: float
) -> tn.Setup:
    """A set-up of a preset or a chain, with points that count from the pivot for heads."""
    up = length_mm if machine in HEADS else 0.0
    axes = {k: tn.AxisSetup(point_mm=(x, y, z + up)) for k, (x, y, z) in points.items()}
    named = tn.Machine(chain=machine) if machine[0] == "[" else tn.Machine(preset=machine)
    pivot = 150.0 if "head" in named.description().core(length_mm).sides else None
    return tn.Setup(
        artefact=tn.Artefact("none"),
        machine=named,
        axes=axes,
        probe=tn.Probe(length_mm=length_mm),
        control=ControlSetup(centre_mm=tuple(CENTRE), pivot_mm=pivot),
    )


@pytest.mark.parametrize("machine", [*POINTS, *HEADS])
def test_any_chain_is_that_of_pinocchio(machine: str, tmp_path: Path) -> None:
    """With a tool of another length than that of the probe in the set-up."""
    pin = pytest.importorskip("pinocchio")
    random = np.random.default_rng(7)
    tool, probe = 87.25, 50.0
    points = (POINTS | HEADS)[machine]
    setup, with_tool = (placed(machine, points, 150.0 + length) for length in (probe, tool))
    names = Chain(setup).location_errors
    errors = {name: round(float(random.uniform(-300, 300)), 3) for name in names}
    known = MachineErrors.of(setup, errors, EFFECTS)
    model = tn.pinocchio_model(with_tool, errors)
    data = model.createData()
    kins = Kinematics(component(setup, known), tmp_path)
    kins.set({"tool-offset": tool})
    nominal = tn.pinocchio_model(with_tool, {})
    order = [3 + "".join(kins.letters).upper().index(letter) for letter in Chain(setup).letters]
    for kind in (0, 2):
        assert kins.switch(kind) == 0
        for _ in range(10):
            joints = np.r_[
                random.uniform(-300, 300, 3), random.uniform(-170, 170, len(kins.letters))
            ]
            linear = joints[:3] - CENTRE - [0, 0, tool]
            q = np.r_[linear, np.radians(joints[order])]
            _, recorded = frames(pin, nominal, nominal.createData(), q)
            q[:3] += linear_matrix() @ recorded.translation - recorded.translation
            table, ball = frames(pin, model, data, q)
            meant = table.actInv(ball.translation)
            found = kins.forward(joints)
            place = found[:3] - CENTRE - [0, 0, tool]
            if kind == 2:  # where the linear axes of a machine without errors are for this point
                q[:3] = place
                table, ball = frames(pin, nominal, nominal.createData(), q)
                place = table.actInv(ball.translation)
            np.testing.assert_allclose(place, meant, rtol=0, atol=1e-9)
            np.testing.assert_allclose(kins.inverse(found), joints, rtol=0, atol=1e-9)


def frames(pin: Any, model: Any, data: Any, q: Floats) -> tuple[Any, Any]:
    """Frames of the table and of the ball."""
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId("table")], data.oMf[model.getFrameId("ball")].copy()


@pytest.mark.parametrize("machine", [*POINTS, *HEADS])
def test_the_forecast_is_made_for_the_same_machine(machine: str, tmp_path: Path) -> None:
    """Joints of the component are the commands of the exact correction in the forecast.

    Error motions included; those of an oblique axis are refused by name.
    """
    random = np.random.default_rng(8)
    setup = placed(machine, (POINTS | HEADS)[machine], 200.0)
    names = Chain(setup).location_errors
    errors = {name: round(float(random.uniform(-300, 300)), 3) for name in names}
    motions = {
        name: {p.name: round(float(random.uniform(-90, 90)), 3) for p in info.parameters}
        for name, info in Chain(setup).effects.items()
        if name.partition("_")[2] in ERROR_MOTIONS and machine not in OBLIQUE
    }
    assert bool(motions) == (machine not in (*OBLIQUE, "three-axis"))
    known = MachineErrors.of(setup, errors, EFFECTS | motions)
    assert held(setup, known).effects.keys() == known.effects.keys()
    kins = Kinematics(component(setup, known), tmp_path)
    kins.set({"tool-offset": 50.0})
    at = random.uniform(-200, 200, (10, 3))
    rotary = random.uniform(-170, 170, (10, len(kins.letters)))
    letters = "".join(kins.letters).upper()
    order = [letters.index(letter) for letter in Chain(setup).letters]
    commands = tn.ModelCompensation(known).commands(setup, at, rotary[:, order])
    offset = CENTRE + np.array([0, 0, 50.0])
    joints = np.array([kins.inverse(np.r_[p + offset, r]) for p, r in zip(at, rotary, strict=True)])
    np.testing.assert_allclose(joints[:, :3] - offset, commands[:, :3], rtol=0, atol=1e-9)


TRAVEL = Travel((10.0, -20.0, 100.0), (250.0, 200.0, 120.0))


def straight(points: Floats) -> Floats:
    """EYX = 8 P2(u) - 5 P3(u), and a turn of the table of X about Z by 6″ u; mm."""
    u = np.clip((points[:, 0] - 10.0) / 250.0, -1, 1)
    y = np.clip(points[:, 1] + 20.0, -200, 200) - 20.0
    out = np.zeros_like(points)
    out[:, 1] = 1e-3 * (8 * (3 * u**2 - 1) / 2 - 5 * (5 * u**3 - 3 * u) / 2)
    out[:, 0] -= 6 * ARCSEC * u * y
    return out


@pytest.mark.parametrize("machine", ["three-axis", "trt-ca", "table-c-head-b"])
def test_motions_of_the_linear_axes_are_in_the_component(machine: str, tmp_path: Path) -> None:
    random = np.random.default_rng(9)
    plain = placed(machine, {}, 200.0)
    ranges = {axis: tn.AxisSetup(range_mm=(-300.0, 300.0)) for axis in "XY"}
    setup = replace(plain, axes={**plain.axes, **ranges})
    effects = {
        "straightness_y_of_x": {"a2_um": 8.0, "a3_um": -5.0},
        "angular_z_of_x": {"a1_arcsec": 6.0, "a2_arcsec": 0.0},
    }
    known = tn.Estimate(
        errors=dict.fromkeys(Chain(setup).location_errors, 0.0),
        effects=effects,
        motions={name: LinearMotion(name, TRAVEL) for name in effects},
    )
    files = linuxcnc_files(setup, known)
    assert files.left_out == ()
    assert files.between_nodes is not None
    between = files.between_nodes["xyz map"]
    assert files.after_um < 0.01
    assert between < 0.5 < 4 < files.before_um  # it bends at the ends of the travel
    kins = Kinematics(files.files["trunnionkins.comp"], tmp_path)
    count = len(kins.letters)
    joints = np.c_[random.uniform(-290, 290, (40, 3)) + CENTRE, np.zeros((40, count))]
    if machine == "table-c-head-b":
        kins.set({"tool-offset": 50.0})
        joints[:, 2] += 50.0
    found = np.array([kins.forward(row) for row in joints])
    off = found[:, :3] - joints[:, :3] - straight(joints[:, :3] - CENTRE)
    assert 1e3 * np.linalg.norm(off, axis=-1).max() < between + 1e-3
    joints[:, 3:] = random.uniform(-170, 170, (40, count))
    for kind in (0, 2):
        kins.switch(kind)
        back = np.array([kins.inverse(kins.forward(row)) for row in joints])
        np.testing.assert_allclose(back, joints, rtol=0, atol=1e-9)
    bare = linuxcnc_files(plain, known)
    assert all("its map needs [axes." in text for text in bare.left_out)
    assert bare.after_um > 4


@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc", "tt-ab", "[w B' A' b X Y Z (C) t]"])
def test_lines_and_steps_of_other_controls_are_those_of_the_component(
    preset: str, tmp_path: Path
) -> None:
    pin = pytest.importorskip("pinocchio")
    random = np.random.default_rng(7)
    setup = placed(preset, POINTS[preset], 100.0)
    names = Chain(setup).location_errors
    errors = {name: round(float(random.uniform(-300, 300)), 3) for name in names}
    known = MachineErrors.of(setup, errors)
    kins = Kinematics(component(setup, known), tmp_path)
    lines, chain = screws(setup, known), list(steps(setup, known))
    for _ in range(20):
        joints = np.r_[random.uniform(-300, 300, 3), random.uniform(-170, 170, 2)]
        found = kins.forward(joints)[:3] - CENTRE
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
        np.testing.assert_allclose(place.act(found), joints[:3] - CENTRE, rtol=0, atol=1e-9)


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
    with pytest.raises(tn.InputError, match=r"control.pivot_mm: not given, expected the distance"):
        component(head, MachineErrors())
    with pytest.raises(tn.InputError, match="table-c-head-b, expected rotary axes under the table"):
        linuxcnc_files(head, {}, kinematics="stock")
    with pytest.raises(
        tn.InputError, match=r"pocketnckins: got axes that meet in \(210.5, 148.2, -301\) mm"
    ):
        linuxcnc_files(placed("tt-ab", {}, 100.0), {}, kinematics="stock")
    with pytest.raises(tn.InputError, match=r"control.centre_mm: not given, expected the origin"):
        component(tn.Setup(artefact=tn.Artefact("none")), MachineErrors())
