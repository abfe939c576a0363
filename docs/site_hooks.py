"""Pages that the site's build writes from the package itself, so that they cannot be out of date.

Every command from the command line's own parser, every key of the set-up from its declarations, the
changelog and the page for contributors from the files in the root of the repository.
"""

import inspect
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import MISSING
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from trunnion import plot
from trunnion.base.frozen import thawed
from trunnion.base.units import unit_of
from trunnion.cli import app
from trunnion.contouring import LinearAxis, RotaryAxis
from trunnion.models.ballbar.settings import BallbarSettings
from trunnion.models.diameters import Conditions
from trunnion.probing.rotary_readings import RotaryTestSettings
from trunnion.setup.fields import keys_of
from trunnion.setup.parts import PARTS, AxisSetup

ROOT = Path(__file__).parent.parent

MORE_TABLES: Mapping[str, tuple[type, str]] = {
    "axes.X": (AxisSetup, "One table an axis: `[axes.X]`, `[axes.A]` and so on."),
    "turning": (Conditions, "Turned diameters: the conditions of the cut."),
    "servo.X": (LinearAxis, "Position loop of a linear axis: `[servo.X]`, `[servo.Y]`, ..."),
    "servo.C": (RotaryAxis, "Position loop of a rotary axis: `[servo.A]`, `[servo.C]`, ..."),
    "ballbar": (BallbarSettings, "Ball-bar tests."),
    "rotary_test": (RotaryTestSettings, "R-tests and ball-bar tests of rotary axes."),
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    pages = {
        "reference/commands.md": commands_page(),
        "reference/setup.md": setup_page(),
        "reference/results.md": results_page(),
        "reference/api/plot.md": _plot_page(),
        "changelog.md": _from_root("CHANGELOG.md"),
        "contributing.md": _from_root("CONTRIBUTING.md"),
    }
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    return files


def _from_root(name: str) -> str:
    """Return a page of the repository's root, its links as from here."""
    return (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")


def _plot_page() -> str:
    return PLOT_HEAD + "".join(f"::: trunnion.plot.{name}\n" for name in plot.__all__)


PLOT_HEAD = """# Pictures

Every function takes a result and returns the axes that it drew on; `result.plot()` finds the right
one.

"""

# --- set-up


def setup_page() -> str:
    """Return the page of every key of the set-up file."""
    parts = [SETUP_HEAD]
    for name, kind in PARTS.items():
        parts += [f"## `[{name}]`\n", f"{_first_paragraph(kind)}\n", setup_table(kind)]
    for name, (kind, said) in MORE_TABLES.items():
        parts += [f"## `[{name}]`\n", f"{said} {_first_paragraph(kind)}\n", setup_table(kind)]
    parts.append(HYBRID)
    return "\n".join(parts)


SETUP_HEAD = """# The set-up file

`setup.toml` says what the machine, the artefact and the probe are. `trunnion init` writes one with
a comment at every key; `print(tn.read_setup("setup.toml"))` lists every key with its value, unit
and meaning. Every key but the artefact's kind has a default; any other key is an error that names
file, line and column. This page is made from the declarations that the reader uses.

```toml
[machine]
preset = "trt-ca"       # tilting rotary table, C on A

[artefact]
kind = "cross"
length_mm = 100.0

[probe]
ball_radius_mm = 1.0
```
"""

HYBRID = """## `[hybrid]`

Dimensions (each a key, mm and degrees) and errors (`[hybrid.errors]`, µm and arcsec) of the hybrid
parallel machine. Names and defaults are those of [`tn.hybrid.Mechanism`](api/hybrid.md).
"""


def _first_paragraph(kind: type) -> str:
    text = (kind.__doc__ or "").split("\n\n")[0]
    return re.sub(r"\s+", " ", text).strip()


def setup_table(kind: type) -> str:
    """Return the Markdown table of the keys of one table."""
    lines = ["| key | default | takes | meaning |", "|---|---|---|---|"]
    for name, declared in keys_of(kind).items():
        unit = unit_of(name)
        takes = declared.takes.words + (f", {unit}" if unit else "")
        default = "required" if declared.default is MISSING else _shown(declared.default)
        lines.append(f"| `{name}` | {default} | {takes} | {declared.meaning} |")
    return "\n".join(lines) + "\n"


def _shown(value: Any) -> str:
    value = thawed(value)
    if value is None or value in ("", {}):
        return "–"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value!r}`".replace("'", '"')


# --- results


def results_page() -> str:
    """Return the page of what each public function returns."""
    lines = [RESULTS_HEAD]
    for page in sorted((ROOT / "docs/reference/api").glob("*.md")):
        rows = list(_returned(page))
        if rows:
            title = page.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")
            head = ("| call | returns | which says |", "|---|---|---|")
            lines += [f"## {title}\n", *head, *rows, ""]
    return "\n".join(lines)


RESULTS_HEAD = """# What each call returns

Every result is a frozen, typed dataclass: data, never a model. It pickles, equals its copy, and
comes back from its JSON. All of them have

| | |
|---|---|
| `print(r)`, `r.summary()` | sentences, most important first, then tables |
| `r.plot()` | its picture; `trunnion.plot` has them all |
| `r.to_html(path)` | one self-contained page |
| `r.to_dataframe()` | its first table as a pandas DataFrame; `r.tables()` has the others |
| `r.to_dict()`, `r.to_json(path)` | as plain values; `Class.from_json(path)` gives it back |

Tables of measured data (`Touches`, `Points`, ...) have `to_csv`, `to_dataframe`, `with_columns`,
and rows by mask or slice. This page is made from the annotations of the functions.
"""


def _returned(page: Path) -> Iterator[str]:
    """Give a row for each function of a page that returns a class of this package."""
    for name in re.findall(r"^::: trunnion\.(\S+)", page.read_text(encoding="utf-8"), re.MULTILINE):
        thing = resolve_name(f"trunnion:{name}")
        result = inspect.signature(thing).return_annotation if inspect.isfunction(thing) else ""
        returned = getattr(sys.modules[thing.__module__], str(result), None) if result else None
        if inspect.isclass(returned) and returned.__module__.startswith("trunnion"):
            said = (returned.__doc__ or "").strip().splitlines()[0].split(" See :")[0]
            where = f"api/{page.name}#trunnion.{name}"
            yield f"| [`tn.{name}`]({where}) | `{returned.__name__}` | {said} |"


# --- commands


def commands_page() -> str:
    """Return the page of every command."""
    return "\n".join([COMMANDS_HEAD, *_commands(typer.main.get_command(app), "trunnion", 2)])


COMMANDS_HEAD = """# Commands

`trunnion COMMAND DATA... SETUP [options]`: data first, then the set-up, in either order where
their endings differ. Every command has `--json` (the result as JSON), `--quiet`/`-q`, `--force`
(write over existing files) and `--help`/`-h`; where it writes a file, `--output`/`-o`.
This page is made from the parser of the command line.
"""


def _commands(command: Any, path: str, level: int) -> Iterator[str]:
    """Give the section of a command, and of the commands below it."""
    for name, one in command.commands.items():
        full = f"{path} {name}"
        yield f"{'#' * level} `{full}`\n"
        yield f"{_paragraphs(one.help or '')}\n"
        if hasattr(one, "commands"):
            yield from _commands(one, full, level + 1)
        else:
            yield f"```text\n{_usage(one, full)}\n```\n"
            yield _options(one)


def _paragraphs(text: str) -> str:
    return "\n\n".join(re.sub(r"\s+", " ", part) for part in text.strip().split("\n\n"))


def _usage(command: Any, path: str) -> str:
    given = [
        (p.metavar or p.name.upper()) if p.required else f"[{p.metavar or p.name.upper()}]"
        for p in command.params
        if p.param_type_name == "argument"
    ]
    return " ".join([path, *given, "[options]"])


SHARED = {"json_", "quiet", "force", "help"}


def _options(command: Any) -> str:
    """Return the table of a command's own options and arguments."""
    lines = ["| | default | |", "|---|---|---|"]
    for one in command.params:
        if one.name in SHARED:
            continue
        default = one.default if isinstance(one.default, str | int | float | Path) else None
        shown = f"`{default}`" if default not in (None, "", False) else ""
        names = one.opts if one.param_type_name == "option" else [one.metavar or one.name.upper()]
        said = re.sub(r"\s+", " ", getattr(one, "help", None) or "").replace("|", "\\|")
        lines.append(f"| {', '.join(f'`{name}`' for name in names)} | {shown} | {said} |")
    return "\n".join(lines) + "\n" if len(lines) > 2 else ""
