"""What every command promises: JSON by its schema, exit codes, one line instead of a traceback."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from typer.testing import CliRunner

import trunnion as tn
from command_lines import SETUP, TOUCHES, command_lines
from trunnion.__main__ import main
from trunnion.cli import app
from trunnion.cli.command import COMMANDS, SCHEMA_VERSION

RUN = CliRunner().invoke
TRUNNION = [sys.executable, "-m", "trunnion"]
HOSTILE_LINES = 100


def run(*words: object, code: int = 0) -> str:
    result = RUN(app, [*map(str, words)])
    assert result.exit_code == code, result.output
    return result.stdout if "--json" in words else result.output


@pytest.mark.parametrize("name", COMMANDS)
def test_json_is_as_the_schema_says(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    schema = json.loads(run("schema", *name.split()))
    jsonschema.Draft202012Validator.check_schema(schema)
    found: dict[str, Any] = {}
    for line in command_lines(tmp_path)[name]:
        found = json.loads(run(*line, "--json"))
        jsonschema.validate(found, schema)
        assert found["schema"] == {"command": name, "version": SCHEMA_VERSION}
    # A schema that takes anything would prove nothing.
    for change in ({}, {**found, "schema": {"command": "other", "version": SCHEMA_VERSION}}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(change, schema)


def test_a_schema_refuses_other_types() -> None:
    schema = json.loads(run("schema", "estimate"))
    found = json.loads(run("estimate", TOUCHES, SETUP, "--json"))
    jsonschema.validate(found, schema)
    for key, wrong in (("errors", [1.0]), ("converged", "yes"), ("std_errors", {"EX0C": "small"})):
        changed = {**found, "least-squares": {**found["least-squares"], key: wrong}}
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(changed, schema)


@pytest.mark.parametrize("ending", ["json", "csv", "xlsx", "parquet"])
def test_output_is_written_as_its_ending_says(ending: str, tmp_path: Path) -> None:
    for words in (("estimate", TOUCHES, SETUP), ("observe", SETUP), ("plan", SETUP)):
        file = tmp_path / f"{words[0]}.{ending}"
        assert str(file) in run(*words, "--output", file).replace("\n", "")
        assert file.stat().st_size > 100
    if ending != "json":
        assert len(tn.read(tmp_path / f"plan.{ending}")) == 72
    assert "expected one of .csv" in run("observe", SETUP, "-o", tmp_path / "x.docx", code=2)
    assert not (tmp_path / "x.docx").exists()


def test_several_files_make_pages_and_a_table_and_name_what_failed(tmp_path: Path) -> None:
    out, bad = tmp_path / "reports", tmp_path / "bad.csv"
    bad.write_text("x_mm\n1\n")
    hidden = tn.sample_path("hidden/touches.csv")
    said = run("diagnose", TOUCHES, hidden, bad, SETUP, "--out", out, code=2)
    assert "3 measurements: 1 consistent, 1 ambiguous, 1 failed." in said
    assert "bad.csv:1:1" in said.replace("\n", "")
    pages = sorted(path.name for path in out.glob("*.html"))
    assert len(pages) == 2
    assert all((out / page).read_text().startswith("<!DOCTYPE html>") for page in pages)
    table = (out / "diagnoses.csv").read_text().splitlines()
    assert [line.split(",")[1] for line in table] == [
        "verdict",
        "consistent",
        "ambiguous",
        "failed",
    ]
    assert "give --force" in run("diagnose", TOUCHES, SETUP, "--out", out, code=2)


@pytest.mark.parametrize("how", ["--quiet", "--json"])
def test_a_batch_of_bad_files_says_each_on_the_error_stream(how: str, tmp_path: Path) -> None:
    bad = [tmp_path / "empty.csv", tmp_path / "text.csv"]
    bad[0].write_text("")
    bad[1].write_text("hello world\n")
    found = RUN(app, ["diagnose", *map(str, bad), how])
    assert found.exit_code == 2
    lines = found.stderr.splitlines()
    assert len(lines) == len(bad)
    for line, path in zip(lines, bad, strict=True):
        assert line.startswith(f"error: {path}:1:1: got ")


AXIS = str(tn.sample_path("positioning/axis.csv"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["program", TOUCHES, SETUP, "--feed", "-1"], "feed_mm_min: got -1, and a plan with"),
        (["plan", SETUP, "--for", "EB0C", "--feeds", "600,300"], "got several --feeds with --for"),
        (["plan", SETUP, "--for", "EB0C", "--c", "0,90"], "got --c with --for"),
        (["plan", SETUP, "--max-touches", "10"], "got --max-touches without --for"),
        (["compare", TOUCHES, SETUP, "--level", "0.1"], "--level: got it with one measurement"),
        (["diagnose", AXIS, "--sheet", "Foo"], "axis.csv: got no workbook (xlsx), and the sheet"),
        (["diagnose", AXIS, "--effects", "nonsense"], "effects: got 'nonsense', expected the name"),
    ],
)
def test_what_is_given_and_has_no_use_is_refused(words: list[object], said: str) -> None:
    assert said in run(*words, code=2)


def test_a_message_names_the_file_that_was_given(tmp_path: Path) -> None:
    path = tmp_path / "out.pdf"
    said = run("diagnose", AXIS, "-o", path, code=2)
    assert said.startswith(f"error: {path}: got the ending '.pdf'")
    assert not [*tmp_path.iterdir()]


def test_inches_are_an_option_of_every_command_that_reads(tmp_path: Path) -> None:
    touches = tn.read_touches(TOUCHES)
    inches = tmp_path / "inches.csv"
    names = [name for name in touches.columns if name.endswith("_mm")]
    touches.with_columns(**{name: touches[name] / 25.4 for name in names}).to_csv(inches)
    found = json.loads(run("estimate", inches, SETUP, "--unit", "inch", "--json"))
    expected = json.loads(run("estimate", TOUCHES, SETUP, "--json"))
    for name, value in expected["least-squares"]["errors"].items():
        assert found["least-squares"]["errors"][name] == pytest.approx(value, abs=1e-6)
    assert "inch" in run("estimate", inches, SETUP, code=2)
    assert "expected one of mm, inch" in run("read", inches, "--unit", "feet", code=2)


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["diagnos"], "diagnose"),
        (["levels", "result"], "results"),
        (["plan", SETUP, "--repeat", "2"], "--repeats"),
        (["estimate", TOUCHES, SETUP, "--effects", "driftz"], "drift_z"),
        (["simulate", SETUP, "--effect", "drift_zz.rate_um_h=1"], "drift_z"),
        (["schema", "diagnos"], "diagnose"),
        (["sweep", "--parameters", "calibratoin"], "calibration"),
    ],
)
def test_a_near_name_is_proposed(words: list[str], meant: str) -> None:
    said = run(*words, code=2).partition("expected one of")
    assert meant in said[0] + said[2].partition("did you mean")[2]


# --- how a command ends


def test_a_fault_is_one_line_and_its_place_with_vv(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("of our own")

    monkeypatch.setattr(tn, "observability", broken)
    short = run("observe", SETUP, code=1)
    assert short.startswith("fault of trunnion: ZeroDivisionError: of our own")
    assert "Traceback" not in short
    assert "in broken" in run("observe", SETUP, "-vv", code=1)


def test_verbose_says_what_is_done() -> None:
    loud = run("diagnose", TOUCHES, SETUP, "-v")
    assert f"trunnion.files: {TOUCHES}: 72 rows" in loud
    assert "trunnion.diagnosis: 72 readings" in loud
    assert "trunnion." not in run("diagnose", TOUCHES, SETUP)


def test_an_interrupt_ends_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(tn, "plan", interrupted)
    assert run("plan", SETUP, code=130).strip() == "interrupted"


def process(*words: str, **how: Any) -> subprocess.Popen[str]:
    env = {**os.environ, **how.pop("env", {})}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([*TRUNNION, *words], env=env, **{**pipes, **how})


def test_a_real_interrupt_leaves_no_traceback() -> None:
    def listens() -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    running = process("diagnose", *[TOUCHES] * 1000, SETUP, "-v", preexec_fn=listens)
    assert running.stderr is not None
    while "diagnosing" not in running.stderr.readline():
        assert running.poll() is None
    time.sleep(0.5)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    assert said.splitlines()[-1] == "interrupted"
    assert "Traceback" not in said
    assert running.returncode == 130


def test_an_interrupt_before_anything_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(**_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("trunnion.cli.app", interrupted)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130


def test_a_closed_pipe_is_no_error() -> None:
    running = process("simulate", SETUP, env={"PYTHONUNBUFFERED": ""})
    assert running.stdout is not None
    assert running.stderr is not None
    running.stdout.close()
    assert running.stderr.read() == ""
    running.stderr.close()
    assert running.wait(timeout=60) == 0


def test_a_terminal_without_letters_and_names_without_utf8(tmp_path: Path) -> None:
    how = {"env": {"PYTHONIOENCODING": "latin-1"}, "encoding": "latin-1"}
    running = process("estimate", TOUCHES, SETUP, "--method", "separating", **how)
    said, failed = running.communicate(timeout=60)
    assert (running.returncode, failed) == (0, "")
    assert "µm" in said
    assert "\\u03ba" in said  # κ, which Latin-1 does not have
    odd = os.fsdecode(b"\xff\xfe.csv")
    running = process("diagnose", odd, SETUP, cwd=tmp_path)
    assert "no such file" in running.communicate(timeout=60)[1]
    assert running.returncode == 2


def test_no_color_is_kept() -> None:
    for env, coloured in (({"NO_COLOR": "1"}, False), ({"NO_COLOR": ""}, True)):
        result = RUN(app, ["plan", "no.toml"], env=env, color=True)
        assert ("\x1b[" in result.output) == coloured


def test_no_line_that_a_user_can_type_ends_in_a_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rng = random.Random(1)
    (tmp_path / "folder").mkdir()
    (tmp_path / "empty.csv").touch()
    (tmp_path / "binary.csv").write_bytes(bytes(range(256)))
    (tmp_path / "binary.toml").write_bytes(bytes(range(256)))
    (tmp_path / "gone").symlink_to(tmp_path / "nowhere")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    paths = ["folder", "empty.csv", "binary.csv", "binary.toml", "gone", "loop", "no/such.csv", ""]
    words = [
        *paths,
        SETUP,
        TOUCHES,
        "x" * 5000,
        "nan",
        "-1",
        "1e999",
        "0",
        "1:2:0",
        "a=b",
        "[",
        "é",
    ]
    lines = [
        line for lines in command_lines(tmp_path).values() for line in lines if line[0] != "demo"
    ]
    options = [
        "--json",
        "-q",
        "-v",
        "-o",
        "--unit",
        "--decimal",
        "--kind",
        "--out",
        "--html",
        "--seed",
    ]
    for _ in range(HOSTILE_LINES):
        line = list(rng.choice(lines))
        for _ in range(rng.randint(1, 3)):
            place = rng.randint(len(line) > 2, len(line))
            line[place : place + rng.randint(0, 1)] = [rng.choice([*words, *options])]
        result = RUN(app, line)
        assert result.exit_code in (0, 2), (line, result.output)
        assert "Traceback" not in result.output
        assert isinstance(result.exception, SystemExit | None), (line, result.exception)


def test_completion_of_a_shell_is_offered() -> None:
    words = {"COMP_WORDS": "trunnion dia", "COMP_CWORD": "1", "_TRUNNION_COMPLETE": "complete_bash"}
    done = process(env=words)
    said, _ = done.communicate(timeout=60)
    assert said.split() == ["diagnose"]


def test_a_report_holds_the_command_that_made_it(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    run("estimate", TOUCHES, SETUP, "--effects", "scale_x", "--html", page)
    text = page.read_text()
    assert f"estimate {TOUCHES} {SETUP} --effects scale_x --html {page}" in text
