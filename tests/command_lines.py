"""A command line of every command that ends well, for the tests of what all commands promise."""
# ruff: noqa: E501  (a table of lines reads best with one line each)

import shutil
from pathlib import Path

import numpy as np

import trunnion as tn
from hostile import ballbar_plan
from result_examples import cross

SETUP = str(tn.sample_path("cross/setup.toml"))
TOUCHES = str(tn.sample_path("cross/touches.csv"))


def sample(name: str) -> str:
    """Return the path of a sample file."""
    return str(tn.sample_path(name))


def command_lines(folder: Path) -> dict[str, list[list[str]]]:
    """Return command lines by command; `folder` takes what they read and write."""
    plan, log, study = folder / "plan.csv", folder / "touches.log", folder / "study.toml"
    planned = tn.plan(cross()[1])
    planned.to_csv(plan)
    none = np.zeros(len(planned))
    x, y, z = planned.position_mm.T
    rows = [x, y, z, planned["a_deg"], none, planned["c_deg"], none, none, none]
    np.savetxt(log, np.column_stack(rows), fmt="%.4f")
    study.write_text('study = "calibration"\nsamples = 3\n[grid]\nnoise_um = [0.1, 0.2]\n')
    (folder / "errors.json").write_text('{"EX0C": 10.0}')
    (folder / "mill.ngc").write_text("G0 X0 Y0 Z9 A0 C0\nG1 X9 A10 F99\nM2\n")
    (folder / "shape.csv").write_text("z_mm,x_mm\n60,0\n60,20\n0,20\n")
    second = folder / "second.csv"
    shutil.copyfile(TOUCHES, second)
    stops, ball = sample("positioning/axis.csv"), sample("ballbar/circle.csv")
    two, hybrid = folder / "instruments.csv", folder / "lengths.csv"
    axis = tn.read_positioning(stops)
    axis.with_columns(laser_mm=axis["measured_mm"]).to_csv(two)
    ballbar_plan().to_csv(hybrid)
    part, passed = sample("turning/part.ngc"), folder / "pass.csv"
    z_mm = np.arange(64.5, 16.0, -0.5)
    tn.Diameters(z_mm=z_mm, error_um=0.1 * z_mm).to_csv(passed)
    sphere = tn.Setup(tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(30.0, 20.0, 60.0)))
    ball_setup, found = folder / "ball.toml", folder / "ball.csv"
    ball_setup.write_text(sphere.to_toml())
    better = folder / "better.csv"
    for seed, path in enumerate((found, better)):
        tn.simulate(tn.plan(sphere), sphere, noise_um=0.3, seed=seed).to_csv(path)
    return {
        "init": [["init", str(folder / "new")]],
        "samples": [["samples", str(folder / "samples")]],
        "plan": [["plan", SETUP]],
        "simulate": [["simulate", SETUP, "--noise-um", "0.1", "--seed", "1"]],
        "estimate": [["estimate", TOUCHES, SETUP], ["estimate", TOUCHES, SETUP, "--method", "printed"]],
        "observe": [["observe", SETUP]],
        "program": [["program", str(plan), SETUP]],
        "touches": [["touches", str(plan), str(log)]],
        "read": [["read", TOUCHES]],
        "diagnose": [
            ["diagnose", TOUCHES, SETUP],
            ["diagnose", TOUCHES, str(second), SETUP],
            ["diagnose", sample("turning/diameters.csv"), sample("turning/setup.toml")],
        ],
        "view": [["view", TOUCHES, SETUP, "-o", str(folder / "view.html")]],
        "compare": [["compare", TOUCHES, SETUP], ["compare", TOUCHES, str(second), SETUP]],
        "compensate": [
            ["compensate", str(folder / "errors.json"), SETUP, "-o", str(folder / "general"), "--linear-step-mm", "200", "--rotary-step-deg", "90"],
            ["compensate", str(folder / "errors.json"), SETUP, "-o", str(folder / "table"), "--control", "table"],
        ],
        "correct": [["correct", str(folder / "mill.ngc"), str(folder / "errors.json"), SETUP]],
        "verify": [["verify", str(found), str(ball_setup)], ["verify", str(found), str(better), str(ball_setup)]],
        "sweep": [["sweep", str(study)], ["sweep", "--parameters", "calibration"]],
        "demo": [["demo"]],
        "schema": [["schema", "diagnose"], ["schema"]],
        "turning finish": [["turning", "finish", str(folder / "shape.csv")]],
        "turning path": [["turning", "path", part, "--no-chuck"]],
        "turning correct": [["turning", "correct", str(passed), part]],
        "turning diagnose": [["turning", "diagnose", sample("turning/diameters.csv"), sample("turning/setup.toml")]],
        "contour simulate": [["contour", "simulate", "--feed", "3000", "--controller", "independent"]],
        "contour diagnose": [["contour", "diagnose", sample("contour/axislog.csv"), sample("contour/setup.toml")]],
        "ballbar diagnose": [["ballbar", "diagnose", ball]],
        "ballbar results": [["ballbar", "results", ball]],
        "ballbar identify": [["ballbar", "identify", str(hybrid), "--sigma-um", "0.5", "--tolerance", "50"]],
        "ballbar plan": [["ballbar", "plan", str(hybrid)]],
        "positioning results": [["positioning", "results", stops], ["positioning", "results", stops, "--table", "--tolerance", "accuracy_um=20"]],
        "positioning instruments": [["positioning", "instruments", str(two)]],
        "positioning diagnose": [["positioning", "diagnose", stops]],
        "levels results": [["levels", "results", sample("levels/bed.csv")]],
        "levels diagnose": [["levels", "diagnose", sample("levels/bed.csv")]],
        "rotary-test plan": [["rotary-test", "plan", SETUP, "--ball", "90,20,60", "--tilt", "0,60", "--bar", "0,0,100"]],
        "rotary-test identify": [["rotary-test", "identify", sample("rotary/rtest.csv"), sample("rotary/setup.toml")]],
        "rotary-test diagnose": [["rotary-test", "diagnose", sample("rotary/rtest.csv"), sample("rotary/setup.toml")]],
        "hybrid sensitivity": [["hybrid", "sensitivity"]],
        "hybrid cube": [["hybrid", "cube"]],
    }  # fmt: skip
