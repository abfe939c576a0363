"""``trunnion contour`` on files: what a user types is what happens."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app

RUN = CliRunner()
SETUP = str(tn.sample_path("contour/setup.toml"))
LOG = str(tn.sample_path("contour/axislog.csv"))
CROSS = str(tn.sample_path("cross/setup.toml"))


def run(*arguments: str, code: int = 0) -> str:
    result = RUN.invoke(app, list(arguments))
    assert result.exit_code == code, result.output
    return result.output


def test_simulate_with_the_sample_set_up_is_the_papers_machine() -> None:
    figures = [
        json.loads(run("contour", "simulate", "--feed", "3000", "--json", *extra))["runs"]
        for extra in ((), (SETUP,))
    ]
    assert [f["controller"] for f in figures[0]] == ["independent", "existing", "proposed"]
    for one, other in zip(*figures, strict=True):
        assert one["contour_max_um"] == pytest.approx(other["contour_max_um"], rel=1e-9)


def test_a_simulated_log_is_diagnosed(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    made = ("--controller", "proposed", "--noise-um", "0.2", "--noise-arcsec", "1")
    said = run("contour", "simulate", SETUP, "--output", str(log), *made)
    assert "wrote" in said
    assert len(np.unique(tn.read_axis_log(log).run)) == 2  # type: ignore[arg-type]
    assert "Consistent: " in run("contour", "diagnose", str(log), SETUP)


def test_the_samples_hidden_effect_is_named_by_both_commands(tmp_path: Path) -> None:
    page = tmp_path / "d.html"
    said = run("contour", "diagnose", LOG, SETUP, "--html", str(page))
    assert "backlash of the Y axis (backlash_y): " in said
    assert "backlash_y" in page.read_text(encoding="utf-8")
    assert said.startswith(run("diagnose", LOG, SETUP))
    found = json.loads(run("contour", "diagnose", LOG, SETUP, "--json"))
    assert [c["id"] for c in found["causes"]] == ["backlash_y"]


def test_a_run_that_diverges_is_said_so_and_not_logged(tmp_path: Path) -> None:
    wild = tmp_path / "wild.toml"
    text = Path(SETUP).read_text(encoding="utf-8")
    wild.write_text(text.replace("gain_per_s = 81.28 ", "gain_per_s = 99999.0 "), encoding="utf-8")
    given = (str(wild), "--controller", "independent")
    assert "diverged" in run("contour", "simulate", *given)
    log = tmp_path / "log.csv"
    assert "diverged" in run("contour", "simulate", *given, "--output", str(log), code=2)
    assert not log.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("contour", "simulate", "--feed", "-5"), "--feed: got -5"),
        (("contour", "simulate", "--controller", "best"), "expected one of independent"),
        (("contour", "simulate", CROSS), "servo: the"),
        (
            ("contour", "diagnose", LOG),
            "expected a set-up (TOML) that names each axis of the log: [servo.X]",
        ),
        (
            ("contour", "diagnose", LOG, str(tn.sample_path("cross/setup.toml"))),
            "setup.toml:1:1: servo: the table is missing",
        ),
    ],
)
def test_faults_are_one_line(arguments: tuple[str, ...], message: str) -> None:
    said = run(*arguments, code=2)
    assert message in said
    assert "Traceback" not in said
