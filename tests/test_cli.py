"""The command line on files: what a user types is what happens."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.cli import app

RUN = CliRunner()
SETUP = str(tn.sample_path("cross/setup.toml"))
TOUCHES = str(tn.sample_path("cross/touches.csv"))


def run(*arguments: str, code: int = 0) -> str:
    result = RUN.invoke(app, list(arguments))
    assert result.exit_code == code, result.output
    return result.output


def test_plan_writes_csv_and_a_program(tmp_path: Path) -> None:
    plan, program = tmp_path / "plan.csv", tmp_path / "probe.ngc"
    said = run("plan", SETUP, "-o", str(plan), "--program", str(program))
    assert "72 touches" in said
    assert len(tn.read_touches(plan)) == 72
    assert program.read_text().count("G38.2") == 72
    rich = run("plan", SETUP, "--c", "0:330:30", "--tilt", "-90:90:30", "--both-senses", "--json")
    assert json.loads(rich)["touches"] > 400


def test_simulate_and_estimate_go_round(tmp_path: Path) -> None:
    touches = tmp_path / "touches.csv"
    run(
        "simulate", SETUP, "-o", str(touches), "--error", "EX0C=15", "--error", "e_a0a=20",
        "--placement", "dx_um=50", "--effect", "scale_x.ppm=20", "--noise-um", "0.1", "--seed", "1",
    )  # fmt: skip
    asked = ("--method", "least-squares", "--effects", "scale_x", "--json")
    found = json.loads(run("estimate", SETUP, str(touches), *asked))["least-squares"]
    assert found["errors"]["EX0C"] == pytest.approx(15.0, abs=0.3)
    assert found["errors"]["EA0A"] == pytest.approx(20.0, abs=2.0)
    assert found["effects"]["scale_x"]["ppm"] == pytest.approx(20.0, abs=6.0)


def test_estimate_prints_readable_tables() -> None:
    said = run("estimate", SETUP, TOUCHES, "--method", "printed,separating", "--per-position")
    for part in (
        "printed closed forms",
        "separating closed forms",
        "EB0C−EB0A",
        "Check κ",
        "c_deg",
    ):
        assert part in said
    assert "expected standard errors" in run("observe", SETUP).lower()
    assert "rank" in json.loads(run("observe", SETUP, "--json"))


def test_demo_shows_table_2() -> None:
    said = run("demo")
    for part in ("Table 2 of the paper", "21.5784", "printed forms", "separating forms"):
        assert part in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("estimate", SETUP, "nowhere.csv"), "nowhere.csv"),
        (("estimate", SETUP, SETUP), "setup.toml:2:1"),
        (("estimate", SETUP, TOUCHES, "--method", "guess"), "--method: got 'guess'"),
        (("estimate", SETUP, TOUCHES, "--method", "least-squares", "--effects", "magic"), "magic"),
        (("simulate", SETUP, "--error", "EX0C"), "--error: got 'EX0C', wanted name=number"),
        (("simulate", SETUP, "--effect", "drift_z=3"), "wanted effect.parameter=number"),
        (("simulate", SETUP, "--noise-um", "0.3"), "seed: got none"),
        (("plan", SETUP, "--c", "0,ninety"), "--c: got '0,ninety'"),
        (("plan", SETUP, "--c", "0:90:0"), "--c: got '0:90:0'"),
    ],
)
def test_mistakes_get_one_clear_line_and_exit_code_2(
    arguments: tuple[str, ...], message: str
) -> None:
    result = RUN.invoke(app, list(arguments))
    assert result.exit_code == 2
    assert message in result.output.replace("\n", " ")
    assert "Traceback" not in result.output
