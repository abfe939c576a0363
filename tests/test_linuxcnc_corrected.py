"""Corrections in the real LinuxCNC: what its joints do on a machine with errors."""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from controller import Bench, compiled, needs_linuxcnc, run
from corrected_bench import motion_us
from probing_bench import ERRORS, SPEED, Hidden, hidden, run_program
from reference_trt_ca import TABLE_2, Floats, table_pose
from trunnion.cli import app
from trunnion.controls import linuxcnc_files
from trunnion.setup.control import ControlSetup

pytestmark = needs_linuxcnc

CENTRE = np.array([210.5, 148.2, -301.0])
TOOL = 100.0
SETUP = tn.Setup(
    artefact=tn.Artefact("none"), control=ControlSetup(centre_mm=(210.5, 148.2, -301.0))
)
EMPTY: dict[str, Any] = {"boxes": [], "table_radius_mm": 1.0, "table_z_mm": -1500.0}
POSES = [(a, c) for a in (-90, -40, 0, 60) for c in (0, 130, 250)]
POINTS = np.array([[150.0, -120.0, 0.0], [-150.0, 120.0, 150.0]])


def errors_left_um(folder: Path, code: str, bench: Bench, offset: Floats) -> Floats:
    """Where the tool point comes on the table less where it was programmed, (moves, 3)."""
    steps = [{"mdi": "T1 M6 G43 H1"}, {"mdi": "G21 G90 G94"}, {"mdi": code}]
    wanted = []
    for a, c in POSES:
        for point in POINTS:
            at = point
            if code == "M430":  # the program of a machine without errors, in its own coordinates
                at = (table_pose({}, a, c) @ np.append(point, 1.0))[:3]
            x, y, z = at + offset
            steps.append({"mdi": f"G0 X{x:.6f} Y{y:.6f} Z{z:.6f} A{a} C{c}"})
            wanted.append(point)
    found = run(bench, steps, folder)
    left = []
    for step, point in zip(found[3:], wanted, strict=True):
        assert not step["messages"], step["messages"]
        joints = np.array(step["joints"])
        tip = np.append(joints[:3] - CENTRE - [0, 0, TOOL], 1.0)
        # An axis that reads HOME_OFFSET at its switch stands at zero of the machine there.
        turned = joints[3:] - [bench.home.get(3, 0.0), bench.home.get(4, 0.0)]
        reached = np.linalg.solve(table_pose(TABLE_2, *turned), tip)[:3]
        left.append(1e3 * (reached - point))
    return np.array(left)


def largest(left: Floats) -> float:
    return float(np.linalg.norm(left, axis=-1).max())


@pytest.mark.parametrize("code", ["M428", "M430"])
def test_the_component_puts_the_tool_point_right(code: str, tmp_path: Path) -> None:
    files = linuxcnc_files(SETUP, TABLE_2)
    bench = Bench(
        **EMPTY,
        kinematics="trunnionkins",
        components={"trunnionkins": compiled("trunnionkins", files.files["trunnionkins.comp"])},
        hal=files.files["trunnion.hal"],
    )
    left = errors_left_um(tmp_path, code, bench, CENTRE)
    assert largest(left) < 0.01  # joints are reported to a nanometre, programs written to one
    assert files.before_um / max(largest(left), files.after_um) > 1000


@pytest.mark.parametrize("machine", ["three-axis", "four-axis-a", "head-bc", "table-c-head-b"])
def test_halcompile_takes_the_component_of_any_chain(machine: str) -> None:
    control = ControlSetup(centre_mm=(1.0, 2.0, 3.0), pivot_mm=150.0 if "head" in machine else None)
    setup = replace(SETUP, machine=tn.Machine(preset=machine), control=control)
    made = linuxcnc_files(setup, {})
    assert compiled("trunnionkins", made.files["trunnionkins.comp"])


def test_stock_kinematics_leave_what_is_forecast(tmp_path: Path) -> None:
    files = linuxcnc_files(SETUP, TABLE_2, kinematics="stock")
    homes = {
        int(one.name[7]): one.new for one in files.settings if one.name.endswith("] HOME_OFFSET")
    }
    offset = np.array([float(word[1:]) for word in _words(files.files["work_offset.ngc"])])
    bench = Bench(
        **EMPTY,
        kinematics="xyzac-trt-kins",
        hal=files.files["trunnion.hal"]
        + "net tool motion.tooloffset.z => xyzac-trt-kins.tool-offset\n",
        home=homes,
    )
    plain = Bench(
        **EMPTY,
        kinematics="xyzac-trt-kins",
        hal=_pins(dict(zip("xyz", CENTRE, strict=True)))
        + "net tool motion.tooloffset.z => xyzac-trt-kins.tool-offset\n",
    )
    before = errors_left_um(tmp_path / "before", "M428", plain, CENTRE)
    after = errors_left_um(tmp_path / "after", "M428", bench, offset)
    assert largest(after) < 0.75 * largest(before)
    assert largest(before) <= files.before_um + 0.02
    assert largest(after) <= files.after_um + 0.02
    assert largest(after) > 0.5 * files.after_um


def test_the_time_of_a_servo_cycle_is_recorded(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """Of LinuxCNC's motion controller, with the component and with trivkins: no limit is tested."""
    found = motion_us(tmp_path)
    for name, (median, longest) in found.items():
        record_property(name, f"median {median:.2f} µs, longest {longest:.0f} µs")
        assert 0 < median <= longest
    print(found)


def _pins(centre: Mapping[str, float]) -> str:
    return "".join(f"setp xyzac-trt-kins.{k}-rot-point {v}\n" for k, v in centre.items())


def _words(program: str) -> list[str]:
    line = next(line for line in program.splitlines() if line.startswith("G10"))
    return line.split()[3:]


def trunnion(folder: Path, *words: str) -> None:
    """Run a command in a folder."""
    with contextlib.chdir(folder):
        done = CliRunner().invoke(app, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output


def probed(case: Hidden, folder: Path, name: str, *options: str) -> tn.Estimate:
    """Program, run, log, touches, estimate: what commands make of a plan."""
    trunnion(folder, "program", "plan.csv", "setup.toml", "-o", f"{name}.ngc", *options)
    report = run_program(case, folder / name, text=(folder / f"{name}.ngc").read_text())
    assert report["strikes"] == 0, report
    log = f"{name}/touches.log"
    trunnion(folder, "touches", "plan.csv", log, "setup.toml", "-o", f"{name}.csv")
    assert len(tn.read_touches(folder / f"{name}.csv")) == len(case.plan), report
    trunnion(folder, "estimate", f"{name}.csv", "setup.toml", "-o", f"{name}.json")
    return tn.read_estimate(folder / f"{name}.json")


def test_measured_corrected_and_measured_again(tmp_path: Path) -> None:
    """Plan, program, log, estimate, component, program again: by commands, nothing by hand."""
    case = hidden(31, clearance=4.0, kind="cross", slow_feed_mm_min=30 * SPEED)
    (tmp_path / "setup.toml").write_text(case.setup.to_toml())
    trunnion(tmp_path, "plan", "setup.toml", "-o", "plan.csv", "--feeds", f"{600 * SPEED:g}")
    case = replace(case, plan=tn.read_touches(tmp_path / "plan.csv"))
    before = probed(case, tmp_path, "before")
    words = ("before.json", "setup.toml", "--control", "linuxcnc", "-o", "made")
    trunnion(tmp_path, "compensate", *words)
    source = (tmp_path / "made/trunnionkins.comp").read_text()
    bench = replace(
        case.bench,
        kinematics="trunnionkins",
        components={"trunnionkins": compiled("trunnionkins", source)},
        hal=(tmp_path / "made/trunnion.hal").read_text(),
    )
    after = probed(replace(case, bench=bench), tmp_path, "after", "--corrected")
    trunnion(tmp_path, "compare", "before.csv", "after.csv", "setup.toml")
    for name in ERRORS:
        both = np.hypot(before.std_errors[name], after.std_errors[name])
        assert abs(after.errors[name]) < 4 * both, name
    # What is left on the machine as it is: the difference of its errors and the estimate.
    error = {name: case.errors[name] - before.errors[name] for name in ERRORS}
    left = tn.volumetric_error(case.setup, error, a_deg=(-90, 0, 90), c_deg=(0, 90, 200)).max_um
    found = tn.volumetric_error(
        case.setup, case.errors, a_deg=(-90, 0, 90), c_deg=(0, 90, 200)
    ).max_um
    assert found > 40 * left
    files = linuxcnc_files(case.setup, before)
    assert files.files["trunnionkins.comp"] == source
    assert files.interval_um is not None
    assert left < 1.5 * files.interval_um[1]
