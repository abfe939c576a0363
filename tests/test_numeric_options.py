"""No number of the command line that no machine has gets through, whichever option it is given."""

import inspect
import math
import re
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from command_lines import SETUP, TOUCHES, command_lines
from trunnion.cli import app
from trunnion.cli.diagnose import MAX_NEXT
from trunnion.models.next_touches import MAX_TOUCHES

RUN = CliRunner().invoke

SIGNED = {"--offset", "--origin-mm", "--access-z-mm", "--chuck-face-mm", "--amount"}
"""Places, and an error: they may be below 0."""

NO_ZERO = {"--feed", "--probe-feed", "--speed-m-min", "--window", "--unit-um", "--repeats"}
"""A few of those that may not be 0."""

WITH = {
    "--max-minutes": ["--for", "EX0C"],
    "--max-touches": ["--for", "EX0C"],
    "--pause": ["--after", TOUCHES],
    "--level": [TOUCHES],
    "--tolerance": ["--sigma-um", "1"],
    "--diameter-mm": ["--artefact", "sphere"],
}
"""What an option needs beside it to be of use."""


class Option(typing.NamedTuple):
    """An option that takes numbers: its command and name, how many of which type, default."""

    command: str
    name: str
    many: int
    kind: type
    default: Any


def numeric_options() -> Iterator[Option]:
    """Every option of every command that takes numbers, as their functions say."""

    def below(group: typer.Typer, made: Any, words: tuple[str, ...]) -> Iterator[Option]:
        for one in group.registered_groups:
            assert one.typer_instance is not None
            name = str(one.typer_instance.info.name)
            yield from below(one.typer_instance, made.commands[name], (*words, name))
        for known in group.registered_commands:
            assert known.callback is not None
            name = known.name or known.callback.__name__
            yield from of_command(" ".join((*words, name)), known.callback, made.commands[name])

    def of_command(command: str, function: Callable[..., Any], made: Any) -> Iterator[Option]:
        annotations = inspect.signature(function).parameters
        for parameter in made.params:
            kinds = leaves(annotations[parameter.name].annotation)
            if parameter.param_type_name == "option" and {*kinds} & {int, float}:
                kind = float if float in kinds else int
                many = kinds.count(kind)
                yield Option(command, parameter.opts[0], many, kind, parameter.default)

    yield from below(app, typer.main.get_command(app), ())


def leaves(annotation: Any) -> list[Any]:
    """Types that an annotation is made of."""
    inner = typing.get_args(annotation)
    if typing.get_origin(annotation) is typing.Annotated:
        inner = inner[:1]
    return [leaf for one in inner for leaf in leaves(one)] if inner else [annotation]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (["plan", SETUP, "--c", ""], "--c: got '', expected numbers"),
        (["plan", SETUP, "--tilt", " , "], "--tilt: got ' , ', expected numbers"),
        (["plan", SETUP, "--feeds", "", "--for", "EX0C"], "--feeds: got '', expected numbers"),
        (["observe", SETUP, "--noise-um", "1e-300"], "--noise-um: got 1e-300, expected a number"),
        (["diagnose", TOUCHES, SETUP, "--next", "5000"], "Invalid value for '--next': "),
        (["compare", TOUCHES, TOUCHES, "--html", "page.txt"], "got the ending '.txt' (no page)"),
        (["turning", "finish", "shape.csv", "--picture", "a.xyz"], "--picture: got 'a.xyz', "),
        (["turning", "path", "none.ngc", "--picture", "a.xyz"], "--picture: got 'a.xyz', "),
        (["turning", "correct", "a.csv", "b.ngc", "--picture", "a.xyz"], "--picture: got 'a.x"),
    ],
)
def test_what_an_option_cannot_be_is_said_before_anything_is_read(
    line: list[str], said: str
) -> None:
    done = RUN(app, line)
    assert done.exit_code == 2, done.output
    assert said in " ".join(done.output.replace("│", " ").split())


def test_as_many_touches_are_planned_as_the_library_takes() -> None:
    assert MAX_NEXT == MAX_TOUCHES


OPTIONS = [option for option in numeric_options() if option.name != "--verbose"]


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[list[str]]]:
    return command_lines(tmp_path_factory.mktemp("lines"))


def refused(option: Option, value: str, line: list[str], folder: Path) -> str:
    """What is said of the value, on one line; nothing is written."""
    line = [word for word in line if word != "--no-chuck" or option.name != "--chuck-radius-mm"]
    if "-o" not in line:
        line = [*line, "-o", str(folder / f"out.{'nc' if line[0] == 'sweep' else 'json'}")]
    line = [*line, *WITH.get(option.name, []), option.name, *[value] * option.many]
    done = RUN(app, [*line, "--force"])
    assert done.exit_code == 2, done.output
    assert "Traceback" not in done.output
    assert not [*folder.iterdir()]
    return " ".join(" ".join(re.findall(r"[ -~]+", done.stderr)).split())  # no frame about it


def test_the_options_are_found() -> None:
    names = {(option.command, option.name) for option in OPTIONS}
    assert len(names) > 50
    assert names > {("touches", "--pause"), ("contour simulate", "--seed"), ("plan", "--repeats")}
    assert {option.many for option in OPTIONS} == {1, 3}


@pytest.mark.parametrize(
    "option", [o for o in OPTIONS if o.kind is float], ids=lambda o: f"{o.command} {o.name}"
)
def test_what_is_no_size_is_refused_by_its_option(
    option: Option, lines: dict[str, list[list[str]]], tmp_path: Path
) -> None:
    """An infinite one only where that is the default: no limit."""
    for value in ("nan", "-inf", "1e300", "-1e300", "inf"):
        if value != "inf" or option.default != math.inf:
            said = refused(option, value, lines[option.command][0], tmp_path)
            assert option.name in said
            assert "xpected" in said or "should be" in said


@pytest.mark.parametrize(
    "option", [o for o in OPTIONS if o.name not in SIGNED], ids=lambda o: f"{o.command} {o.name}"
)
def test_what_may_not_be_negative_is_refused(
    option: Option, lines: dict[str, list[list[str]]], tmp_path: Path
) -> None:
    for value in ("-1", *("0" for _ in range(option.name in NO_ZERO))):
        said = refused(option, value, lines[option.command][0], tmp_path)
        assert value in said or "should be greater than or equal" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["plan", "{setup}", "--c", "0:90:inf"], "--c: got '0:90:inf'"),
        (["simulate", "{setup}", "--error", "EX0C=1e300"], "--error EX0C: got 1e+300, expected a"),
        (["simulate", "{setup}", "--placement", "dx_um=nan"], "--placement dx_um: got nan"),
        (["contour", "simulate", "--assumed", "EX0C=-1e300"], "--assumed EX0C: got -1e+300"),
        (["init", "new", "--artefact", "sphere", "--length-mm", "3"], "a sphere has diameter_mm"),
        (["init", "new", "--diameter-mm", "3"], "a cross has length_mm"),
    ],
)
def test_numbers_in_text_and_sizes_of_another_artefact_are_refused(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = RUN(app, [word.format(setup=SETUP) for word in words])
    assert done.exit_code == 2
    assert said in done.stderr
    assert not [*tmp_path.iterdir()]
