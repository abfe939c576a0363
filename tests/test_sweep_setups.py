"""Sweeps over anything that a set-up holds; their size, and Ctrl-C in a long call of the core."""

import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app

DRIFT = "drift_z.rate_um_h"


def test_a_node_is_what_single_calls_give_for_its_set_up() -> None:
    """Set-up, plan and effects of a node by hand; least squares one by one."""
    grid = {"machine.preset": ["trt-bc", "trt-ca"], "artefact.length_mm": [60.0, 120.0]}
    fixed = {
        "artefact.kind": "cuboid",
        "artefact.width_mm": 50.0,
        "plan.c_deg": "0:300:60",
        "plan.repeats": 2,
        "probe.ball_radius_mm": 1.5,
        DRIFT: 30.0,
        "estimate": "drift_z",
        "noise_um": 0.0,
    }
    found = tn.sweep("identification", grid, 3, 5, fixed=fixed)
    assert found.attrs["samples_failed"] == 0
    setup = tn.Setup(
        machine=tn.Machine(preset="trt-bc"),
        artefact=tn.Artefact("cuboid", length_mm=120.0, width_mm=50.0, height_mm=25.0),
        probe=tn.Probe(ball_radius_mm=1.5),
    )
    plan = tn.plan(setup, c_deg=range(0, 301, 60), repeats=2)
    data = tn.simulate(plan, setup, effects={"drift_z": {"rate_um_h": 30.0}})
    fit = tn.identify(data, setup, ["drift_z"])
    node = found.sel({"machine.preset": "trt-bc", "artefact.length_mm": 120.0})
    there = node.dropna("parameter", how="all")["parameter"].values.tolist()
    assert set(there) == {*fit.errors, *(fit.placement or {}), DRIFT}
    assert np.isfinite(node["error"].sel(parameter=there)).all()
    for name in ("EX0C", "EB0B", DRIFT):
        # Without noise and ticks the estimate is the truth.
        assert abs(node["error"].sel(parameter=name)).max() < 1e-3
    assert np.isnan(node["error"].sel(parameter="EB0A")).all()  # an error of the other machine


def test_an_effect_that_is_not_estimated_biases_and_one_that_is_does_not() -> None:
    rates, estimated = [0.0, 60.0], ["", "drift_z"]
    grid = {DRIFT: rates, "estimate": estimated}
    found = tn.sweep("identification", grid, 30, 1, fixed={"noise_um": 0.1})
    bias = abs(found["error"].sel(parameter="EZ0A").mean("sample"))
    seen = {
        (rate, names): float(bias.sel({DRIFT: rate, "estimate": names}))
        for rate in rates
        for names in estimated
    }
    unbiased = max(value for key, value in seen.items() if key != (60.0, ""))
    assert seen[60.0, ""] > 20 * unbiased


def test_a_sweep_begins_with_the_set_up_that_is_given(tmp_path: Path) -> None:
    setup = tn.Setup(artefact=tn.Artefact("sphere", diameter_mm=30.0, centre_mm=(80.0, 0.0, 90.0)))
    (tmp_path / "machine.toml").write_text(setup.to_toml())
    (tmp_path / "study.toml").write_text(
        'study = "identification"\nsamples = 2\nsetup = "machine.toml"\n'
        '[grid]\n"probe.ball_radius_mm" = [1.0, 3.0]\n'
    )
    done = CliRunner().invoke(app, ["sweep", str(tmp_path / "study.toml")])
    assert done.exit_code == 0, done.output
    found = tn.open_sweep(tmp_path / "study.nc")
    here = tn.sweep("identification", {"probe.ball_radius_mm": [1.0, 3.0]}, 2, setup=setup)
    np.testing.assert_array_equal(found["error"], here["error"])
    other = tn.sweep("identification", {"probe.ball_radius_mm": [1.0, 3.0]}, 2)
    assert not np.array_equal(here["error"], other["error"], equal_nan=True)
    with pytest.raises(tn.InputError, match="setup: got one for study calibration"):
        tn.sweep("calibration", samples=1, setup=setup)


@pytest.mark.parametrize(
    ("fixed", "said"),
    [
        ({"artefact.lenght_mm": 1.0}, r"did you mean artefact\.length_mm"),
        ({"machine.preset": "trt"}, "trt-ca"),
        ({"plan.c_deg": "0:x:1"}, "expected numbers such as"),
        ({"artefact.kind": "cube"}, "cross, cuboid, sphere"),
        ({"axes.C.sense": 3}, "sense"),
    ],
)
def test_a_set_up_that_cannot_be_is_refused(fixed: dict[str, Any], said: str) -> None:
    with pytest.raises(tn.TrunnionError, match=said):
        tn.sweep("identification", samples=2, fixed=fixed, most_failures=0.0)


def test_power_of_any_machine_and_artefact() -> None:
    fixed = {"machine.preset": "trt-bc", "artefact.kind": "cuboid", "effect": "scale_x"}
    found = tn.sweep("diagnosis-power", samples=4, fixed={**fixed, "rms_um": 3.0})
    assert found.attrs["samples_failed"] == 0
    assert int(found["found"].sum() + found["among_alternatives"].sum()) >= 3


def test_the_size_is_said_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "trunnion.studies")
    path, fixed = tmp_path / "a.nc", {"identify": False}
    tn.sweep("calibration", {"noise_um": [0.1, 0.2]}, 500, path=path, fixed=fixed)
    assert "2 nodes of 500 samples, 22 numbers each: 176 kB, and as much" in caplog.text
    assert 176_000 < path.stat().st_size < 200_000
    usage = shutil.disk_usage(tmp_path)._replace(free=100_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(tn.InputError, match=r"a result of 88 kB, expected room for twice as much"):
        tn.sweep("calibration", samples=500, path=tmp_path / "b.nc", fixed=fixed)
    assert not (tmp_path / "b.nc").exists()
    assert not (tmp_path / "b.nc.part").exists()


LONG = """
import sys, trunnion as tn
print("begins", flush=True)
tn.sweep({study}, samples={samples}, chunk={samples}, path=sys.argv[1], threads=1)
"""


@pytest.mark.parametrize("study", ["calibration", "compensation"])
def test_an_interrupt_ends_a_call_of_the_core(study: str, tmp_path: Path) -> None:
    """One block of a million samples takes minutes: the process ends in the middle of it."""
    script = LONG.format(study=repr(study), samples=1_000_000)
    running = subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path / "a.nc")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert running.stdout is not None
    assert running.stdout.readline() == "begins\n"
    time.sleep(2.0)
    assert running.poll() is None
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    assert "KeyboardInterrupt" in said
    assert not (tmp_path / "a.nc").exists()
