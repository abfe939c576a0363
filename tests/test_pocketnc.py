"""A Pocket NC: its homing offsets and tables, read back and applied to a machine with errors.

Its control is written anew from what its settings and kinematics say: machine units are inches,
homing gives the switch the reading HOME_OFFSET, COMP_FILE of type 0 says where a joint is,
pocketnckins turn the table about the machine's zero, A carrying B.
"""

import configparser
import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from kins_bench import Floats, Kinematics, needs_gcc
from trunnion.cli import app
from trunnion.controls import linuxcnc_files

INCH = 25.4
ERRORS = {
    "EX0B": 30.0, "EY0A": 20.0, "EZ0A": -15.0, "EZ0B": 5.0,
    "EA0A": 40.0, "EB0A": 30.0, "EC0A": 10.0, "EC0B": 25.0,
}  # fmt: skip
EFFECTS = {
    "b_positioning": {"k_arcsec": -12.0},
    "a_scale": {"k_arcsec": 15.0},
    "b_backlash": {"b_arcsec": 20.0},
    "scale_x": {"ppm": 60.0},
}
SETUP = """
[machine]
preset = "tt-ab"
[artefact]
kind = "none"
[axes.A]
point_mm = [0, -51, 0]
range_deg = [-25, 135]
[axes.B]
range_deg = [-360, 360]
[axes.X]
range_mm = [-250, 250]
[control]
centre_mm = [0, 51, 0]
linear_units = "inch"
"""
HOME = (2.75, 2.4658, 0.07, -17.5, -5.0)
POSES = list(product(np.linspace(-25, 135, 12), np.linspace(-360, 360, 36)))
BOX = np.array(list(product((-150.0, 150.0), (-120.0, 120.0), (0.0, 150.0))))


def folder_of(tmp_path: Path, errors: dict[str, float]) -> Path:
    """Set-up, estimate and present files of the machine."""
    (tmp_path / "setup.toml").write_text(SETUP)
    (tmp_path / "estimate.json").write_text(json.dumps({"errors": errors, "effects": EFFECTS}))
    sections = [f"[JOINT_{j}]\nHOME_OFFSET={HOME[j]}\n" for j in (0, 1, 3, 4)]
    (tmp_path / "CalibrationOverlay.inc").write_text("\n".join(sections))
    (tmp_path / "PocketNC.ini").write_text(
        f"[JOINT_2]\nHOME_OFFSET={HOME[2]}\n[TRAJ]\nLINEAR_UNITS=inch\n"
    )
    return tmp_path


class PocketNc:
    """Joints of the machine, mm and degrees as it counted before, for points on the table."""

    def __init__(self, overlay: Path) -> None:
        read = configparser.ConfigParser()
        read.read(overlay)
        self.offset = [float(read[f"JOINT_{j}"]["HOME_OFFSET"]) for j in range(5)]
        assert all(read[f"JOINT_{j}"]["COMP_FILE_TYPE"] == "0" for j in (0, 3, 4))
        names = {0: read["JOINT_0"]["COMP_FILE"], 3: "a.comp", 4: "b.comp"}
        self.tables = {j: np.loadtxt(overlay.parent / name) for j, name in names.items()}

    def joints(self, point: Floats, a: float, b: float, sense: int) -> Floats:
        ca, sa, cb, sb = (f(np.radians(q)) for q in (a, b) for f in (np.cos, np.sin))
        on_b = np.array([cb * point[0] + sb * point[2], point[1], -sb * point[0] + cb * point[2]])
        x, y, z = on_b[0], ca * on_b[1] - sa * on_b[2], sa * on_b[1] + ca * on_b[2]
        reading = np.array([x / INCH, y / INCH, z / INCH, a, b])
        for j, table in self.tables.items():
            actual = table[:, 1 if sense > 0 else 2]
            reading[j] += np.interp(reading[j], table[:, 0], table[:, 0] - actual)
        before = reading - self.offset + HOME
        return before * [INCH, INCH, INCH, 1.0, 1.0]


def left_um(control: PocketNc, errors: dict[str, float]) -> float:
    """Largest distance on the real table between tool point and programmed point."""
    pin = pytest.importorskip("pinocchio")
    setup = tn.Setup(
        tn.Artefact("none"),
        machine=tn.Machine(preset="tt-ab"),
        axes={"A": tn.AxisSetup(point_mm=(0.0, -51.0, 0.0))},
    )
    model = tn.pinocchio_model(setup, errors)
    data = model.createData()
    centre = np.array([0.0, 51.0, 0.0])
    largest = 0.0
    for (a, b), corner, sense in product(POSES, BOX, (1, -1)):
        joints = control.joints(corner + centre, a, b, sense)
        linear = (joints[:3] - centre) * [1 + 60e-6, 1, 1]
        at_a = joints[3] + 15.0 * joints[3] / 90 / 3600
        at_b = joints[4] + (-12.0 * np.sin(np.radians(joints[4])) - 10.0 * sense) / 3600
        pin.framesForwardKinematics(model, data, np.r_[linear, np.radians([at_a, at_b])])
        table = data.oMf[model.getFrameId("table")]
        reached = table.actInv(data.oMf[model.getFrameId("ball")].translation)
        largest = max(largest, float(np.linalg.norm(reached - corner)))
    return 1e3 * largest


@pytest.mark.parametrize("tilted", [True, False])
def test_overlay_and_tables_leave_what_is_forecast(tilted: bool, tmp_path: Path) -> None:
    names = ERRORS if tilted else {"EX0B": 30.0, "EY0A": 20.0, "EA0A": 40.0}
    folder = folder_of(tmp_path, names)
    command = ["compensate", "estimate.json", "setup.toml", "--control", "linuxcnc", "--kinematics"]
    command += ["stock", "--present", "PocketNC.ini", "--present", "CalibrationOverlay.inc", "-o"]
    words = [str(folder / w) if "." in w else w for w in command]
    done = CliRunner().invoke(app, [*words, str(folder / "out"), "--json"], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    said = json.loads(done.output)
    left = left_um(PocketNc(folder / "out/CalibrationOverlay.inc"), names)
    between = said["between_nodes"]
    # Angles act at the far corner of the box; offsets are written to 1e-6 inch and degree.
    more = between["x"] + (between["a"] + between["b"]) * 240e3 * np.pi / 648e3 + 0.06
    assert abs(left - said["after_um"]) < 0.01 * said["after_um"] + more
    assert left < 0.6 * said["before_um"] if tilted else left < more
    assert any("EZ0B - EZ0A" in text for text in said["left_out"]) == tilted


def test_what_it_needs_is_asked_for(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, ERRORS)
    setup = tn.read_setup(folder / "setup.toml")
    stock = {"kinematics": "stock"}
    with pytest.raises(tn.InputError, match=r"\[JOINT_0\] HOME_OFFSET: got no present value"):
        linuxcnc_files(setup, ERRORS, kinematics="stock")
    apart = SETUP.replace("[0, 51, 0]", "[0, 50, 0]")
    (folder / "apart.toml").write_text(apart)
    with pytest.raises(tn.InputError, match=r"axes that meet in \(0, -1, 0\) mm of the machine"):
        linuxcnc_files(tn.read_setup(folder / "apart.toml"), ERRORS, **stock)  # type: ignore[arg-type]
    (folder / "mm.toml").write_text(SETUP.replace('"inch"', '"mm"'))
    with pytest.raises(tn.InputError, match="got 'mm', expected 'inch': LINEAR_UNITS of the INI"):
        linuxcnc_files(tn.read_setup(folder / "mm.toml"), ERRORS, present=[folder / "PocketNC.ini"])


@needs_gcc
def test_the_component_counts_in_units_of_the_machine(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, ERRORS)
    inch = tn.read_setup(folder / "setup.toml")
    (folder / "mm.toml").write_text(SETUP.replace('"inch"', '"mm"'))
    mm = tn.read_setup(folder / "mm.toml")
    kins = []
    for name, setup in (("inch", inch), ("mm", mm)):
        (folder / name).mkdir()
        source = linuxcnc_files(setup, ERRORS).files["trunnionkins.comp"]
        kins.append(Kinematics(source, folder / name))
    kins[0].set({"tool-offset": 2.0})
    kins[1].set({"tool-offset": 50.8})
    joints = np.array([1.0, -2.0, -1.5, 40.0, 70.0])
    size = np.array([INCH, INCH, INCH, 1.0, 1.0])
    np.testing.assert_allclose(
        size * kins[0].forward(joints), kins[1].forward(size * joints), rtol=0, atol=1e-10
    )
    np.testing.assert_allclose(kins[0].inverse(kins[0].forward(joints)), joints, atol=1e-11)
