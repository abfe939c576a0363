"""Nothing is lost: files are written whole or not at all, over others only when asked; messages
name lines of files."""

import os
import re
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

import trunnion as tn
from command_lines import command_lines
from result_examples import cross, diagnosis_of, error_map
from trunnion.base.output import whole_file, write_text
from trunnion.cli import app
from trunnion.cli.command import COMMANDS

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


NO_PATHS: list[Any] = ["a\0b", "x" * 5000, "x" * 300, Path("a\0b"), 5, b"x", 1.5]
"""What no file can be called, and what is no name."""

READERS: dict[str, Callable[[Any], object]] = {
    **{
        name: getattr(tn, name)
        for name in vars(tn)["__all__"]
        if name.startswith("read_") and not name.endswith("_log")
    },
    "read_axis_log": tn.read_axis_log,
    "read_probe_log": lambda path: tn.read_probe_log(path, cross()[0]),
    "read_table_log": lambda path: tn.read_table_log(path, *cross()),
    "read_shape": tn.turning.read_shape,
    "Touches.from_json": tn.Touches.from_json,
    "Diagnosis.from_json": tn.Diagnosis.from_json,
    "open_sweep": tn.open_sweep,
    "load": lambda path: tn.datasets.load(tn.datasets.names()[0], path),
}


@pytest.mark.parametrize("path", NO_PATHS, ids=lambda path: repr(path)[:12])
@pytest.mark.parametrize("name", [*READERS, *WRITERS, "Table.save", "Result.save"])
def test_what_is_no_path_is_an_error_of_the_package(
    name: str, path: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python's own would be "embedded null byte", a TypeError, or an OSError without a place."""
    monkeypatch.chdir(tmp_path)
    more: dict[str, Callable[[Any], object]] = {
        "Table.save": lambda path: cross()[0].save(path),
        "Result.save": lambda path: diagnosis_of("sweep").save(path),
    }
    of_json = name.endswith(("from_json", "read_estimate"))  # which may take text for JSON
    kind = tn.TrunnionError if of_json else tn.InputError
    with pytest.raises(kind, match=r"got .*, expected"):
        {**READERS, **WRITERS, **more}[name](path)
    assert not list(tmp_path.iterdir())


def test_an_estimate_whose_path_is_its_text() -> None:
    """The likely cause is named, and the message stays short."""
    with pytest.raises(tn.InputError) as caught:
        tn.read_touches("a_deg,c_deg,x_mm\n" + "0,90,1.5\n" * 100)
    assert str(caught.value).endswith("(file name too long: is it what the file holds?)")
    assert len(str(caught.value)) < 200


def test_a_file_that_is_not_there_stays_so() -> None:
    """Python's own error, as for `open`: it says what is not there."""
    with pytest.raises(FileNotFoundError, match=r"none\.csv"):
        tn.read_touches("none.csv")


WRITE = ("output", "html", "picture")
"""Options that name a file or a folder to write, whichever command has them."""

OTHERS = [
    *(("plan", "--program"), ("simulate", "--probe-log"), ("diagnose", "--out")),
    ("positioning results", "--comp-file"),
]
"""Further ones of single commands."""

ENDINGS = (".json", ".csv", ".html", ".ngc", ".png", ".netcdf", ".nc", ".comp", ".log", "")


def writers(command: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[str, str]]:
    """Every command below this one, with each of its options that names what is written."""
    for name, one in getattr(command, "commands", {}).items():
        yield from writers(one, (*words, name))
    for parameter in getattr(command, "params", ()):
        if words and parameter.name in WRITE:
            yield " ".join(words), parameter.opts[0]


WRITERS_OF_COMMANDS = [*writers(typer.main.get_command(app)), *OTHERS]


def test_every_command_has_an_output() -> None:
    assert {name for name, option in WRITERS_OF_COMMANDS if option == "--output"} == set(COMMANDS)
    assert len({option for _, option in WRITERS_OF_COMMANDS}) == len(WRITE) + len(OTHERS)


def files_below(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_file()}


def figures() -> set[int]:
    """Figures that pyplot keeps."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    return set() if pyplot is None else set(pyplot.get_fignums())


def line_that_writes(name: str, option: str, folder: Path) -> tuple[list[str], set[Path]]:
    """A command line with an option, and the files that it writes."""
    for line in command_lines(folder)[name]:
        if "-o" in line and option == "--output":
            at = line.index("-o")
            line = [*line[:at], *line[at + 2 :]]
        for ending in ENDINGS:
            given = [*line, option, str(folder / f"out{ending}")]
            before = files_below(folder)
            done = RUN(app, [*given, "--force"])
            if made := files_below(folder) - before:
                assert done.exit_code == 0, done.output
                return given, made
    raise AssertionError(f"{name} {option}: {done.output}")


@pytest.mark.parametrize(("name", "option"), WRITERS_OF_COMMANDS)
def test_no_command_overwrites_without_force(
    name: str, option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever of its files is there already."""
    monkeypatch.chdir(tmp_path)
    kept = figures()
    given, made = line_that_writes(name, option, tmp_path)
    for there in made:
        for each in made:
            each.unlink(missing_ok=True)
        there.parent.mkdir(parents=True, exist_ok=True)
        there.write_text("kept")
        refused = RUN(app, given)
        assert refused.exit_code == 2, refused.output
        assert "--force" in refused.output.replace("\n", " ")
        assert there.read_text() == "kept"
    done = RUN(app, [*given, "--force"])
    assert done.exit_code == 0, done.output
    assert there.read_bytes() != b"kept"
    assert figures() <= kept  # pictures are let go of


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


@pytest.mark.parametrize(
    ("words", "ending"),
    [
        (["program", "{plan}", "{setup}", "-o"], "xlsx"),
        (["program", "{plan}", "{setup}", "-o"], "CSV"),
        (["plan", "{setup}", "--program"], "json"),
        (["correct", "{mill}", "{errors}", "{setup}", "-o"], "toml"),
        (["turning", "finish", "{shape}", "-o"], "csv"),
        (["view", "{touches}", "{setup}", "-o"], "ngc"),
        (["diagnose", "{touches}", "{setup}", "--html"], "csv"),
        (["estimate", "{touches}", "{setup}", "--html"], "ngc"),
        (["simulate", "{setup}", "--probe-log"], "csv"),
        (["positioning", "results", "{stops}", "--comp-file"], "xlsx"),
    ],
)  # fmt: skip
def test_nothing_is_written_under_the_ending_of_another_kind(
    words: list[str], ending: str, tmp_path: Path
) -> None:
    """What looks at no ending is refused one that says another format, whatever its case."""
    command_lines(tmp_path)
    known = {
        **{"plan": tmp_path / "plan.csv", "mill": tmp_path / "mill.ngc"},
        **{"errors": tmp_path / "errors.json", "shape": tmp_path / "shape.csv"},
        **{"setup": CROSS / "setup.toml", "touches": CROSS / "touches.csv"},
        "stops": tn.sample_path("positioning/axis.csv"),
    }
    target = tmp_path / f"out.{ending}"
    done = RUN(app, [*(word.format(**known) for word in words), str(target)])
    assert done.exit_code == 2
    assert f"got the ending '.{ending}' (" in done.stderr
    assert not target.exists()


@pytest.mark.parametrize(
    "name", ["plan", "observe", "compare", "diagnose", "hybrid cube", "schema"]
)
def test_an_ending_that_is_refused_names_those_that_are_written(name: str, tmp_path: Path) -> None:
    """Each of them is; what is written is no program, and only a result with a page is one."""
    line = command_lines(tmp_path)[name][0]
    for ending in ("txt", "nc", "", "x.y"):
        refused = RUN(app, [*line, "-o", str(tmp_path / f"out.{ending}")])
        assert refused.exit_code == 2
        assert f"out.{ending}" in refused.stderr
    known = re.findall(r"\.[a-z]+", refused.stderr.partition(", expected ")[2])
    assert ".json" in known
    for ending in known:
        target = tmp_path / f"out{ending}"
        done = RUN(app, [*line, "-o", str(target)])
        assert done.exit_code == 0, done.stderr
        assert target.stat().st_size
    assert (".html" in known) == (name not in ("plan", "schema"))


FOLDERS = [("compensate", "--output"), ("diagnose", "--out"), ("init", ""), ("samples", "")]
"""Commands that write into a folder, and the option that names it, or none: an argument does."""


def files_of_options() -> list[tuple[str, str]]:
    return [one for one in WRITERS_OF_COMMANDS if one not in FOLDERS]


def line_with(name: str, option: str, target: str, folder: Path) -> list[str]:
    line = command_lines(folder)[name][0]
    if not option:
        return [name, target]
    line = line[: line.index("-o")] if "-o" in line and option == "--output" else line
    return [*line, option, target]


@pytest.mark.parametrize(("name", "option"), FOLDERS)
def test_a_folder_is_made_where_one_is_named_and_nothing_else(
    name: str, option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A name of a file made a folder, and a folder that is not there was made on the way."""
    monkeypatch.chdir(tmp_path)
    line_with(name, option, "", tmp_path)
    (tmp_path / "there").write_text("kept")
    before = {*tmp_path.rglob("*")}
    for target, said in (
        (
            "none/x.csv",
            "none/x.csv: got the ending '.csv' (a table), expected the name of a folder",
        ),
        ("x.HTML", "x.HTML: got the ending '.HTML' (a page (HTML)), expected the name of a folder"),
        ("none/new", "none/new: there is no folder none to make it in"),
        ("there", "there: got a file, expected the name of a folder"),
    ):
        done = RUN(app, line_with(name, option, target, tmp_path))
        assert done.exit_code == 2
        assert said in done.stderr
        assert {*tmp_path.rglob("*")} == before
    assert RUN(app, line_with(name, option, "new", tmp_path)).exit_code == 0
    assert files_below(tmp_path / "new")
    (tmp_path / "old.csv").mkdir()  # what is there is taken as it is
    assert RUN(app, line_with(name, option, "old.csv", tmp_path)).exit_code == 0


@pytest.mark.parametrize(("name", "option"), files_of_options())
def test_no_command_makes_the_folder_of_a_file(
    name: str, option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is said before anything else is written."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    for ending in ENDINGS:
        done = RUN(app, [*line_with(name, option, f"none/x{ending}", tmp_path / "in"), "--force"])
        assert done.exit_code == 2, ending
        assert [*tmp_path.iterdir()] == [tmp_path / "in"]
        if "there is no folder none to write it to" in done.stderr:
            return
    raise AssertionError(done.stderr)


@pytest.mark.parametrize("name", ["a.ngc", "a.nc", "a.NGC", "a.txt", "a.i", "a"])
def test_a_program_may_have_the_ending_of_any_control(name: str, tmp_path: Path) -> None:
    command_lines(tmp_path)
    words = ["program", tmp_path / "plan.csv", CROSS / "setup.toml", "-o", tmp_path / name]
    assert RUN(app, [*map(str, words)]).exit_code == 0
    assert (tmp_path / name).read_text().startswith("(trunnion")


def test_simulated_touches_beside_their_log_are_written_as_the_ending_says(tmp_path: Path) -> None:
    log, book = tmp_path / "a.log", tmp_path / "a.xlsx"
    words = ["simulate", CROSS / "setup.toml", "--probe-log", log, "-o", book]
    assert RUN(app, [*map(str, words)]).exit_code == 0
    assert len(tn.read_touches(book)) == len(tn.plan(tn.read_setup(CROSS / "setup.toml")))


def test_a_page_that_exists_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "a.html"
    page.write_text("kept")
    monkeypatch.setattr(tn, "diagnose", pytest.fail)
    files = [CROSS / "touches.csv", CROSS / "setup.toml", "--html", page]
    done = RUN(app, ["diagnose", *map(str, files)])
    assert done.exit_code == 2
    assert "give --force" in done.stderr
    assert page.read_text() == "kept"


@pytest.mark.parametrize(
    "words",
    [
        ["plan", "{setup}", "-o"],
        ["simulate", "{setup}", "-o"],
        ["estimate", "{touches}", "{setup}", "-o"],
        ["diagnose", "{touches}", "{setup}", "--next", "2", "-o"],
        ["read", "{touches}", "-o"],
    ],
)
@pytest.mark.parametrize("ending", ["nc", "NC", "tap"])
def test_no_data_are_written_under_the_ending_of_a_program(
    words: list[str], ending: str, tmp_path: Path
) -> None:
    """The plan was netCDF in probe.nc, and further touches were CSV in it."""
    known = {"setup": CROSS / "setup.toml", "touches": CROSS / "touches.csv"}
    target = tmp_path / f"probe.{ending}"
    done = RUN(app, [*(word.format(**known) for word in words), str(target)])
    assert done.exit_code == 2
    assert "program" in done.stderr
    assert not target.exists()


@pytest.mark.parametrize("force", [(), ("--force",)])
def test_a_folder_is_no_file(force: tuple[str, ...], tmp_path: Path) -> None:
    """It "exists already; give --force", and with --force it "is a directory"."""
    command_lines(tmp_path)
    words = ["program", tmp_path / "plan.csv", CROSS / "setup.toml", "-o", tmp_path, *force]
    done = RUN(app, [*map(str, words)])
    assert done.exit_code == 2
    assert f"{tmp_path}: got a folder, expected the name of a file" in done.stderr


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--continues", "a.log"], "--continues a.log: got it without --from"),
        (["--tcp", "--corrected"], "--tcp: got it with --corrected, expected one"),
        (["--log", "~/a.log"], "--log: got '~/a.log'"),
    ],
)
def test_a_message_about_an_option_speaks_of_it_as_it_is_typed(
    words: list[str], says: str, tmp_path: Path
) -> None:
    command_lines(tmp_path)
    files = [str(tmp_path / "plan.csv"), str(CROSS / "setup.toml")]
    done = RUN(app, ["program", *files, *words])
    assert done.exit_code == 2
    assert says in done.stderr
    assert "start_at" not in done.stderr


def test_a_file_called_as_an_option_is_spoken_of_as_a_file() -> None:
    """The ending of ``-o program`` was "--program: got the ending ''"."""
    done = RUN(app, ["plan", str(CROSS / "setup.toml"), "-o", "program"])
    assert done.exit_code == 2
    assert "--program" not in done.stderr
