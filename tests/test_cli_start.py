"""From an empty folder: init and samples write files that every other command takes."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app


def run(*arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == code, result.output
    return result.output


@pytest.mark.parametrize("artefact", ["cross", "cuboid", "sphere"])
@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc"])
def test_init_writes_a_set_up_and_its_plan(preset: str, artefact: str, tmp_path: Path) -> None:
    folder = tmp_path / "new"
    said = run("init", str(folder), "--preset", preset, "--artefact", artefact)
    assert "Next: put the real dimensions" in said
    setup = tn.read_setup(folder / "setup.toml")
    assert setup.machine.preset == preset
    assert setup.artefact.kind == artefact
    assert len(tn.read_touches(folder / "plan.csv")) == len(tn.plan(setup))
    assert "exists already" in run("init", str(folder), code=2)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("init", "setup.toml and plan.csv are written into a folder, trunnion init DIR"),
        ("samples", "the samples are written into a folder, trunnion samples DIR"),
    ],
)
@pytest.mark.parametrize("name", ["setup.toml", "new.csv", "folder"])
def test_a_file_for_what_goes_into_a_folder_is_refused_first(
    command: str, said: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both files stood there, and the command ended with "expected .json"."""
    monkeypatch.chdir(tmp_path)
    refused = run(command, "--quiet", "-o", name, code=2)
    assert said in refused
    assert list(tmp_path.iterdir()) == []
    run(command, "--quiet", "-o", "answer.json")
    assert "files" in json.loads((tmp_path / "answer.json").read_text())


def test_the_plan_of_the_page_on_rotary_tests_goes_beside_the_files_of_init(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was refused: plan.csv exists already."""
    page = Path(__file__).parents[1] / "docs" / "how-to" / "rotary-tests.md"
    (line,) = re.findall(r"`trunnion (rotary-test plan [^`]+)`", page.read_text(encoding="utf-8"))
    monkeypatch.chdir(tmp_path)
    run("init", "--quiet")
    run(*line.split())
    assert len(tn.read_rotary_test(tmp_path / line.split()[-1])) == 32


def test_a_commented_set_up_reads_back(tmp_path: Path) -> None:
    setup = tn.Setup(
        machine=tn.Machine(errors={"EX0C": 12.5}, tolerance={"EX0C": 10.0}),
        artefact=tn.Artefact("cuboid", length_mm=80.0, width_mm=70.0, height_mm=30.0),
        axes={"C": tn.AxisSetup(sense=-1)},
        probe=tn.Probe(ball_radius_mm=1.5, servo_period_ms=1.0),
        servo={"X": {"gain_per_s": 80.0, "time_constant_ms": 5.0}},
    )
    path = tmp_path / "setup.toml"
    path.write_text(setup.to_toml(comments=True), encoding="utf-8")
    assert tn.read_setup(path) == setup
    text = path.read_text()
    for part in ("# radius of the ball", "# centre_mm"):
        assert part in text


def test_samples_are_data_of_every_kind(tmp_path: Path) -> None:
    said = run("samples", str(tmp_path / "s"))
    for name in ("cross/touches.csv", "levels/bed.csv", "turning/part.ngc"):
        assert (tmp_path / "s" / name).read_bytes() == tn.sample_path(name).read_bytes()
    assert "Try: trunnion diagnose" in said
    hidden = tmp_path / "s" / "hidden"
    assert "Ambiguous" in run("diagnose", str(hidden / "touches.csv"), str(hidden / "setup.toml"))


def test_a_simulated_log_is_read_like_that_of_the_control(tmp_path: Path) -> None:
    setup, plan, log, out, made = (
        str(tmp_path / name)
        for name in ("setup.toml", "plan.csv", "touches.log", "out.csv", "made.csv")
    )
    run("init", str(tmp_path))
    text = Path(setup).read_text().replace("slow_feed_mm_min = 0.0", "slow_feed_mm_min = 30.0")
    Path(setup).write_text(text.replace("servo_period_ms = 0.0", "servo_period_ms = 1.0"))
    run("simulate", plan, setup, "--error", "EX0C=15", "--probe-log", log, "-o", made)
    run("touches", plan, log, setup, "-o", out)
    read, simulated = tn.read_touches(out), tn.read_touches(made)
    assert read.feed_mm_min is not None
    assert set(read.feed_mm_min) == {30.0}
    assert abs(read.position_mm - simulated.position_mm).max() < 1e-6
    fit = tn.identify(read, tn.read_setup(setup))
    assert abs(fit["EX0C"] - 15.0) < 3.0 * fit.std_errors["EX0C"]
