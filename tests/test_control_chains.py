"""Files for controls of machines with heads, with one rotary axis and with none."""

from typing import Any

import numpy as np
import pytest

import trunnion as tn
from control_readers import etalon, isg_csv, kinematics_steps, pose_of
from reference_trt_ca import ARCSEC
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
def test_isg_names_the_errors_of_every_chain(machine: str, layout: Any) -> None:
    """The kernel turns about the axes of the chain itself: read back, the machine is the one meant.

    Where a chain has no location errors, there is nothing but the tables of its axes.
    """
    setup = placed(machine, ALL[machine], 200.0)
    errors = random_errors(setup, np.random.default_rng(12))
    stated = {"angle_unit": "rad", "sign": "1", "chain": "XYZ"}
    files = isg_files(setup, errors, layout=layout, stated=stated)
    assert files.after_um < 1e-6
    if not errors:
        assert not any(name.startswith("location") for name in files.files)
        return
    name = "location.csv" if layout == "ISG_CSV" else "location.txt"
    read = (isg_csv if layout == "ISG_CSV" else etalon)(files.files[name])
    found = {f"E{k}": v * (1e3 if k[0] in "XYZ" else 1 / ARCSEC) for k, v in read.items()}
    assert found == pytest.approx(errors, abs=1e-6)


def test_three_axes_need_no_kinematics() -> None:
    setup = placed("three-axis", {}, 200.0)
    ranges = {axis: tn.AxisSetup(range_mm=(-200.0, 200.0)) for axis in "XYZ"}
    setup = tn.Setup(
        artefact=setup.artefact, machine=setup.machine, axes=ranges, control=setup.control
    )
    effects = {"scale_x": {"ppm": 40.0}, "squareness_xy": {"arcsec": 12.0}}
    known = tn.Estimate(errors={}, effects=effects)
    made = heidenhain_files(setup, known, stated={"com_sign": "1"})
    assert set(made.files) == {"x.com", "y.com", "config.cma", "settings.csv"}
    assert made.before_um > 5
    assert made.after_um < 1e-6


def test_siemens_says_why_a_head_has_no_place() -> None:
    setup = placed("head-bc", HEADS["head-bc"], 200.0)
    with pytest.raises(tn.InputError, match="Siemens 840D: got machine head-bc, expected"):
        siemens_files(setup, {}, stated={"vector_sign": "1"})
