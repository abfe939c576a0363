"""The command line on files: what a user types is what happens."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from click import Command
from typer.main import get_command
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
    assert program.read_text().count("o<touch> call") == 72
    rich = run("plan", SETUP, "--c", "0:330:30", "--tilt", "-90:90:30", "--both-senses", "--json")
    assert json.loads(rich)["touches"] > 400


def test_simulate_and_estimate_go_round(tmp_path: Path) -> None:
    touches = tmp_path / "touches.csv"
    run(
        "simulate", SETUP, "-o", str(touches), "--error", "EX0C=15", "--error", "e_a0a=20",
        "--placement", "dx_um=50", "--effect", "scale_x.ppm=20", "--noise-um", "0.1", "--seed", "1",
    )  # fmt: skip
    asked = ("--method", "least-squares", "--effects", "scale_x", "--json")
    found = json.loads(run("estimate", str(touches), SETUP, *asked))["least-squares"]
    assert found["errors"]["EX0C"] == pytest.approx(15.0, abs=0.3)
    assert found["errors"]["EA0A"] == pytest.approx(20.0, abs=2.0)
    assert found["effects"]["scale_x"]["ppm"] == pytest.approx(20.0, abs=6.0)


def test_estimate_prints_readable_tables() -> None:
    said = run("estimate", TOUCHES, SETUP, "--method", "printed,separating", "--per-position")
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


@pytest.mark.parametrize(
    "words",
    [
        ("estimate", TOUCHES, SETUP),
        ("simulate", TOUCHES, SETUP),
        ("observe", TOUCHES, SETUP),
        ("diagnose", TOUCHES, SETUP),
    ],
)
def test_data_and_set_up_may_be_given_in_either_order(words: tuple[str, str, str]) -> None:
    name, first, second = words
    one, other = (
        json.loads(run(name, *files, "--json")) for files in ((first, second), (second, first))
    )
    records = [found.pop("record", {}) for found in (one, other)]  # the command line differs
    assert records[0].get("files") == records[1].get("files")
    assert one == other


def test_no_command_overwrites_a_file_unless_forced(tmp_path: Path) -> None:
    commands = [
        ("touches.csv", "plan", SETUP, "--output"),
        ("probe.ngc", "plan", SETUP, "--program"),
        ("touches.csv", "simulate", SETUP, "--output"),
        ("estimate.json", "estimate", TOUCHES, SETUP, "--output"),
        ("report.html", "diagnose", TOUCHES, SETUP, "--html"),
        ("log.csv", "contour", "simulate", "--output"),
    ]
    for name, *command in commands:
        kept = tmp_path / name
        kept.write_text("measured yesterday")
        assert f"{name}: the file exists already; give --force" in run(*command, str(kept), code=2)
        assert kept.read_text() == "measured yesterday"
    kept = tmp_path / "touches.csv"
    run("plan", SETUP, "--output", str(kept), "--force")
    assert len(tn.read_touches(kept)) == 72
    assert {path.name for path in tmp_path.iterdir()} == {name for name, *_ in commands}


def test_every_command_has_the_same_options() -> None:
    found = get_command(app)
    commands: dict[str, Command] = {}
    for name, entry in found.commands.items():  # type: ignore[attr-defined]
        for sub, inner in getattr(entry, "commands", {name: entry}).items():
            commands[f"{name} {sub}"] = inner
    assert len(commands) > 12
    for name, entry in commands.items():
        options = {option for parameter in entry.params for option in parameter.opts}
        assert {"--json", "--quiet", "-q", "--force"} <= options, name
        # A folder for one page a file; what is one file is --output everywhere.
        assert ("--out" in options) == (name == "diagnose diagnose"), name
        assert entry.help, name


def test_help_version_and_quiet() -> None:
    assert run("-h") == run("--help")
    assert run("turning", "correct", "-h").count("--force") == 1
    assert run("--version").strip() == f"trunnion {tn.__version__}"
    assert run("estimate", TOUCHES, SETUP, "--quiet") == ""
    assert "--install-completion" in run("-h")


def test_demo_shows_table_2() -> None:
    said = run("demo")
    for part in ("Table 2 of the paper", "21.5784", "printed forms", "separating forms"):
        assert part in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("estimate", "nowhere.csv", SETUP), "nowhere.csv: no such file"),
        (
            ("estimate", SETUP, SETUP),
            "as set-up (.toml), expected 1 of touches and 1 set-up",
        ),
        (("estimate", TOUCHES, SETUP, "--method", "guess"), "--method: got 'guess'"),
        (("estimate", TOUCHES, SETUP, "--method", "least-squares", "--effects", "magic"), "magic"),
        (("simulate", SETUP, "--error", "EX0C"), "--error: got 'EX0C', expected name=number"),
        (("simulate", SETUP, "--effect", "drift_z=3"), "expected effect.parameter=number"),
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


def test_a_plan_becomes_a_program_and_its_log_touches(tmp_path: Path) -> None:
    """The log is written line by line as the program's own (LOG, ...) does."""
    plan, program, log = (tmp_path / name for name in ("plan.csv", "probe.ngc", "touches.log"))
    run("plan", SETUP, "-o", str(plan))
    said = run("program", str(plan), SETUP, "-o", str(program), "--from", "3", "--log", str(log))
    assert "70 touches" in said
    assert "Ranges: X" in said
    text = program.read_text()
    assert "#<_from> = 3" in text
    assert f"(LOGAPPEND,{log})" in text
    planned, setup = tn.read_touches(plan), tn.read_setup(SETUP)
    measured = tn.simulate(planned, setup, {"EX0C": 15.0}, noise_um=0.3, seed=1)
    first = re.search(r"LOG,%d (trunnion-touches .*)#<_from>\)", text)
    assert first is not None
    rows = zip(measured.position_mm.tolist(), planned.a_deg, planned.c_deg, strict=True)  # type: ignore[arg-type]
    lines = [f" {n} 600 {x} {y} {z} {a} 0 {c}" for n, ((x, y, z), a, c) in enumerate(rows, 1)]
    log.write_text("\n".join([f" {first[1]}1", *lines[:60]]) + "\n")
    out = tmp_path / "measured.csv"
    assert "60 of 72 planned touches" in run("touches", str(plan), str(log), SETUP, "-o", str(out))
    touches = tn.read_touches(out)
    np.testing.assert_allclose(touches.position_mm, measured.position_mm[:60])
    assert touches.time_s is not None
    times = tn.probing_program(planned, setup).time_s
    np.testing.assert_allclose(touches.time_s, times[:60])
    for command in ("estimate", "diagnose"):
        found = json.loads(run(command, str(plan), SETUP, "--probe-log", str(log), "--json"))
        assert found
    log.write_text(log.read_text().replace("hash=", "hash=x"))
    assert "first line of a run" in run("touches", str(plan), str(log), code=2)


def test_a_warning_of_the_library_is_a_note_beside_the_answer() -> None:
    setup = str(tn.sample_path("cross/setup.toml"))
    result = CliRunner().invoke(app, ["simulate", setup, "--error", "EX0C=0.015"])
    assert result.exit_code == 0
    assert "note: simulate, errors: got EX0C = 0.015: are these mm?" in result.stderr
    assert "note" not in result.stdout


def test_compare_of_one_measurement_shows_every_method() -> None:
    said = run("compare", TOUCHES, SETUP)
    for method in ("closed form, printed", "closed form, separating", "least squares"):
        assert method in said
    with pytest.raises(AssertionError, match="expected two measurements to compare, or touches"):
        run("compare", TOUCHES)
