"""Files for controls of machines with heads, with one rotary axis and with none."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from control_readers import CENTRE, Siemens, chained, etalon, isg_csv, kinematics_steps, pose_of
from test_linuxcnc_kinematics import HEADS, OBLIQUE, POINTS, frames, placed
from trunnion.controls import heidenhain_files, isg_files, siemens_files
from trunnion.machine.chain import Chain

TOOL = 87.25
PROBE = 50.0
ALL = {**POINTS, **HEADS}


def random_errors(setup: tn.Setup, random: np.random.Generator) -> dict[str, float]:
    return {
        name: round(float(random.uniform(-300, 300)), 3) for name in Chain(setup).location_errors
    }


@pytest.mark.parametrize("chain_sign", [1, -1])
@pytest.mark.parametrize("machine", [name for name in ALL if name not in (*OBLIQUE, "three-axis")])
def test_heidenhain_holds_every_chain(machine: str, chain_sign: int) -> None:
    """With a tool of another length than the probe's, on Pinocchio's machine with the errors."""
    pin = pytest.importorskip("pinocchio")
    random = np.random.default_rng(11)
    setup = placed(machine, ALL[machine], 150.0 + PROBE)
    errors = random_errors(setup, random)
    files = heidenhain_files(setup, errors, stated={"chain_sign": str(chain_sign)})
    assert files.after_um < 1e-6
    table, head = (
        kinematics_steps(files.files[name]) if name in files.files else []
        for name in ("kinematics.csv", "kinematics_head.csv")
    )
    assert bool(head) == (machine in HEADS)
    model = tn.pinocchio_model(placed(machine, ALL[machine], 150.0 + TOOL), errors)
    data = model.createData()
    letters = Chain(setup).letters
    for _ in range(10):
        point = random.uniform(-200, 200, 3)
        turned = random.uniform(-170, 170, len(letters))
        angles = dict(zip(letters, turned, strict=True))
        at = (pose_of(table, chain_sign, angles) @ np.append(point, 1.0))[:3]
        # The control puts the tool length at the end of the head, and takes it off at its zero.
        tip = (pose_of(head, chain_sign, angles) @ np.array([0.0, 0.0, -TOOL, 1.0]))[:3]
        tip[2] += TOOL
        work, ball = frames(pin, model, data, np.r_[at - tip, np.radians(turned)])
        np.testing.assert_allclose(work.actInv(ball.translation), point, rtol=0, atol=1e-6)


@pytest.mark.parametrize("layout", ["ISG_CSV", "etalon"])
@pytest.mark.parametrize("machine", [name for name in ALL if name not in OBLIQUE])
def test_isg_holds_every_chain(machine: str, layout: Any) -> None:
    """Read back and applied to a chain in plain numpy, nothing is left on Pinocchio's machine.

    Where a chain has no location errors, there is nothing but the tables of its axes.
    """
    pin = pytest.importorskip("pinocchio")
    random = np.random.default_rng(12)
    setup = placed(machine, ALL[machine], 200.0)
    errors = random_errors(setup, random)
    stated = {"angle_unit": "rad", "sign": "1", "chain": "XYZ"}
    files = isg_files(setup, errors, layout=layout, stated=stated)
    assert files.after_um < 1e-6
    if not errors:
        assert not any(name.startswith("location") for name in files.files)
        return
    name = "location.csv" if layout == "ISG_CSV" else "location.txt"
    read = (isg_csv if layout == "ISG_CSV" else etalon)(files.files[name])
    sides = Chain(setup).sides
    head, table = ("".join(x for x in sides if sides[x] == side) for side in ("head", "table"))
    points = {x: np.array(ALL[machine].get(x, (0.0, 0.0, 0.0))) for x in sides}
    model = tn.pinocchio_model(setup, errors)
    data = model.createData()
    reach = np.array([0.0, 0.0, 200.0])
    for _ in range(10):
        point = random.uniform(-200, 200, 3)
        turned = dict(zip(sides, random.uniform(-170, 170, len(sides)), strict=True))
        pose_head, pose_table = (
            chained(axes, points, read, np.array([turned[x] for x in axes]))
            for axes in (head, table)
        )
        tip = (pose_head @ np.append(-reach, 1.0))[:3] + reach
        linear = (pose_table @ np.append(point, 1.0))[:3] - tip
        q = np.r_[linear, np.radians(list(turned.values()))]
        work, ball = frames(pin, model, data, q)
        np.testing.assert_allclose(work.actInv(ball.translation), point, rtol=0, atol=1e-6)


def three_axes(write: Any, stated: dict[str, str]) -> tuple[Any, tn.Setup]:
    """Write the files of a machine with scale and squareness, which hold all of them."""
    setup = placed("three-axis", {}, 200.0)
    ranges = {axis: tn.AxisSetup(range_mm=(-200.0, 200.0)) for axis in "XYZ"}
    setup = replace(setup, axes=ranges)
    effects = {"scale_x": {"ppm": 40.0}, "squareness_xy": {"arcsec": 12.0}}
    made = write(setup, tn.Estimate(errors={}, effects=effects), stated=stated)
    assert made.before_um > 5
    assert made.after_um < 1e-6
    return made, setup


def test_three_axes_need_no_kinematics() -> None:
    made, _ = three_axes(heidenhain_files, {"com_sign": "1"})
    assert set(made.files) == {"x.com", "y.com", "config.cma", "settings.csv"}


HEAD_ALONE = "[w b X Y Z B (C) t]"


def siemens_setup(machine: str, tool_mm: float, sense: int) -> tn.Setup:
    """Every rotary axis and X count the other way for a sense of -1."""
    length = 150.0 + tool_mm
    points = {**ALL, HEAD_ALONE: {"B": (-4.0, 0.0, length)}}[machine]
    setup = placed(machine, points, length)
    letters = (*Chain(setup).letters, "X")
    axes = {x: replace(setup.axes.get(x, tn.AxisSetup()), sense=sense) for x in letters}
    return replace(setup, axes=axes)


@pytest.mark.parametrize(("vector_sign", "sense"), [(1, 1), (-1, -1), (-1, 1)])
@pytest.mark.parametrize("machine", [*(x for x in ALL if x != "three-axis"), HEAD_ALONE])
def test_siemens_holds_every_chain(machine: str, vector_sign: int, sense: int) -> None:
    """With the probe exactly; a tool of another length misses by what the notes say."""
    pin = pytest.importorskip("pinocchio")
    random = np.random.default_rng(13)
    setup = siemens_setup(machine, PROBE, sense)
    errors = random_errors(setup, random)
    sides = Chain(setup).sides
    numbered = [x for side in ("head", "table") for x in sides if sides[x] == side]
    stated = {"vector_sign": str(vector_sign)} if "table" in sides.values() else {}
    files = siemens_files(setup, errors, stated=stated)
    assert files.after_um < 1e-6
    control = Siemens.read(files.files, vector_sign, 1)
    assert control.kind == {"head": "T", "table": "P"}.get("".join(set(sides.values())), "M")
    said = re.findall(r"leaves ([\d.]+) µm for each 100 mm", " ".join(files.notes))
    assert bool(said) == ("head" in sides.values())
    other_way = np.array([sense, 1, 1])
    for tool in (PROBE, TOOL):
        model = tn.pinocchio_model(siemens_setup(machine, tool, sense), errors)
        data = model.createData()
        for _ in range(6):
            point = random.uniform(-200, 200, 3)
            turned = random.uniform(-170, 170, len(numbered))
            angles = dict(zip(numbered, sense * np.radians(turned), strict=True))
            linear = control.linear(point, (*turned, 0.0)[:2], tool) - CENTRE
            q = np.r_[linear * other_way, [angles[x] for x in sides]]
            work, ball = frames(pin, model, data, q)
            left = work.actInv(ball.translation) * other_way - point
            meant = float(said[0]) * (tool - PROBE) / 100 if said else 0.0
            assert 1e3 * np.linalg.norm(left) == pytest.approx(meant, abs=1e-3)


def test_siemens_without_rotary_axes_has_tables_alone() -> None:
    files, _ = three_axes(siemens_files, {"cec_sign": "1"})
    assert set(files.files) == {"enc_comp.ini", "cec.ini", "settings.csv"}
    assert "no $TC_CARR" in files.notes[0]
