"""Nothing is lost: files are written whole or not at all, over others only when asked; messages
name lines of files."""

import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

import trunnion as tn
from result_examples import cross, diagnosis_of, error_map
from trunnion.base.output import whole_file, write_text
from trunnion.cli import app

RUN = CliRunner().invoke
CROSS = tn.sample_path("cross")


def test_a_writer_that_fails_leaves_the_file(tmp_path: Path) -> None:
    target = tmp_path / "a.csv"
    target.write_text("kept")

    def fails() -> None:
        with whole_file(target) as draft:
            draft.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fails()
    assert target.read_text() == "kept"
    assert list(tmp_path.iterdir()) == [target]


def test_a_link_stays_a_link_and_a_mode_stays(tmp_path: Path) -> None:
    target, link = tmp_path / "a.csv", tmp_path / "link.csv"
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    write_text(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640


def test_a_device_is_written_to(tmp_path: Path) -> None:
    write_text("/dev/null", "gone")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    assert not list(tmp_path.iterdir())


WRITERS: dict[str, Callable[[Path], object]] = {
    "Table.to_csv": lambda path: cross()[0].to_csv(path),
    "Table.to_json": lambda path: cross()[0].to_json(path),
    "Result.to_json": lambda path: diagnosis_of("sweep").to_json(path),
    "Result.to_html": lambda path: diagnosis_of("sweep").to_html(path),
    "ErrorMap.to_csv": lambda path: error_map().to_csv(path),
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_writer_goes_through_a_draft(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "file"
    target.write_text("kept")

    def fail(*_: object) -> None:
        raise OSError("no space left on device")

    with monkeypatch.context() as broken:
        broken.setattr(os, "fsync", fail)
        with pytest.raises(OSError, match="no space"):
            WRITERS[name](target)
    assert target.read_text() == "kept"
    assert list(tmp_path.iterdir()) == [target]
    WRITERS[name](target)
    assert target.read_text() != "kept"


def commands(folder: Path) -> dict[str, tuple[list[str], str]]:
    """A command line of every command that writes, and the file it writes."""
    setup, touches = str(CROSS / "setup.toml"), str(CROSS / "touches.csv")
    plan = str(folder / "a plan.csv")
    tn.plan(cross()[1]).to_csv(plan)
    (folder / "errors.json").write_text('{"EX0C": 10.0}')
    turning = tn.sample_path("turning")
    part = str(turning / "part.ngc")
    contour = str(tn.sample_path("contour/setup.toml"))
    return {
        "plan": (["plan", setup, "-o", "OUT"], "out.csv"),
        "program": (["plan", setup, "--program", "OUT"], "out.ngc"),
        "simulate": (["simulate", setup, "--noise-um", "0", "-o", "OUT"], "out.csv"),
        "html": (["diagnose", touches, setup, "--html", "OUT"], "out.html"),
        "compensate": (
            ["compensate", str(folder / "errors.json"), setup, "-o", "DIR"],
            "parameters.json",
        ),
        "turning path": (["turning", "path", part, "--no-chuck", "-o", "OUT"], "out.ngc"),
        "contour simulate": (["contour", "simulate", contour, "-o", "OUT"], "out.csv"),
    }


NAMES = ("plan", "program", "simulate", "html", "compensate", "turning path", "contour simulate")


@pytest.mark.parametrize("name", NAMES)
def test_no_command_overwrites_without_force(name: str, tmp_path: Path) -> None:
    line, file = commands(tmp_path)[name]
    target = tmp_path / file
    target.write_text("kept")
    given = [{"OUT": str(target), "DIR": str(tmp_path)}.get(word, word) for word in line]
    refused = RUN(app, given)
    assert refused.exit_code == 2, refused.output
    assert "--force" in refused.output.replace("\n", " ")
    assert target.read_text() == "kept"
    done = RUN(app, [*given, "--force"])
    assert done.exit_code == 0, done.output
    assert target.read_text() != "kept"


def test_a_message_about_a_row_names_the_line_of_the_file(tmp_path: Path) -> None:
    touches, setup = cross()
    path = tmp_path / "bad.csv"
    x = touches["x_mm"].copy()
    x[5] += 30.0
    touches.with_columns(x_mm=x).to_csv(path)
    read = tn.read_touches(path)
    for call in (tn.identify, tn.closed_form, tn.diagnose):
        with pytest.raises(tn.TrunnionError, match=r"line 7 of bad\.csv") as raised:
            call(read, setup)
        assert "row" not in str(raised.value)
    with pytest.raises(tn.TrunnionError, match="row 5"):
        tn.identify(tn.Touches({**touches.columns, "x_mm": x}), setup)


def test_the_readme_does_not_overwrite_a_measurement() -> None:
    text = (Path(__file__).parent.parent / "README.md").read_text()
    written = [line.split(" -o ")[1].split()[0] for line in text.splitlines() if " -o " in line]
    assert written
    assert not any(name.endswith("touches.csv") for name in written)
    assert len(set(written)) == len(written)
