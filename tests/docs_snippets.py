"""Run what a page of the documentation shows, in order, in an empty folder.

Blocks of a page: ``bash`` and ``python`` are run, one folder and one Python session a page; any
block with a ``title`` is a file that is written there; ``text`` behind a run block is what it must
print, with ``...`` for any lines, and numbers within two units of their last digit. The comment
``<!-- not run: why -->`` in front of a block leaves it out.

``python tests/docs_snippets.py PAGE...`` writes what is printed into the pages; the comment
``<!-- output: 12 lines -->`` in front of a ``text`` block keeps the first twelve, ``from WORD``
those from the first line with this word. ``--check`` follows pages as a new user does, with the
trunnion that is installed: nothing is written, and the ``pip install`` lines in the text are run.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib
import io
import os
import re
import shlex
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from trunnion.cli import app

ROOT = Path(__file__).parents[1]
RUN = ("bash", "python")
TIMEOUT_S = 300

_BLOCK = re.compile(
    r"(?P<notes>(?:^<!--[^\n]*-->\n)*)^(?P<fence>```+)(?P<info>[^\n`]*)\n(?P<text>.*?)^(?P=fence)$",
    re.DOTALL | re.MULTILINE,
)
_PLAIN_COMMAND = re.compile(r"trunnion [^|&;<>$`*]*")
_PIP = re.compile(r"`(pip install [^`]*)`")
_NUMBER = re.compile(r"[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Block:
    """A fenced block: language, text, title, comments in front, line, and where its text is."""

    language: str
    text: str
    title: str
    notes: str
    line: int
    span: tuple[int, int]

    @property
    def is_run(self) -> bool:
        return self.language in RUN and "not run:" not in self.notes and not self.title

    def shortened(self, printed: str) -> str:
        """Output as the comment in front of the block wants it."""
        lines = [line.rstrip() for line in printed.strip("\n").splitlines()]
        head = ""
        if found := re.search(r"from (\S+)", self.notes):
            first = next((i for i, line in enumerate(lines) if found[1] in line), 0)
            head, lines = "...\n" if first else "", lines[first:]
        if found := re.search(r"(\d+) lines", self.notes):
            count = int(found[1])
            lines = [*lines[:count], "..."] if len(lines) > count else lines
        return head + "\n".join(lines) + "\n"


def blocks(page: str) -> Iterator[Block]:
    """Fenced blocks of a page, in order."""
    for found in _BLOCK.finditer(page):
        info = found["info"].strip()
        title = re.search(r'title="([^"]*)"', info)
        yield Block(
            language=(info.split() or [""])[0],
            text=found["text"],
            title=title[1] if title else "",
            notes=found["notes"],
            line=page[: found.start()].count("\n") + 1,
            span=found.span("text"),
        )


class Session:
    """An empty folder with a shell and a Python session.

    is_literal: Every command is a process of the trunnion that is installed.
    """

    def __init__(self, folder: Path, is_literal: bool = False) -> None:
        self.folder, self.is_literal = folder / "work", is_literal
        self.folder.mkdir()
        self.names: dict[str, Any] = {"__name__": "__main__"}
        commands = Path(sys.executable).parent if is_literal else self._commands(folder / "bin")
        self.environment = {
            **os.environ,
            "PATH": f"{commands}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": os.pathsep.join(str(Path(p).resolve()) for p in sys.path if p),
            "MPLBACKEND": "Agg",
            "NO_COLOR": "1",
            "COLUMNS": "110",
        }
        if is_literal:
            del self.environment["PYTHONPATH"]

    @staticmethod
    def _commands(commands: Path) -> Path:
        commands.mkdir()
        for name, module in (("trunnion", "-m trunnion"), ("python", "")):
            script = commands / name
            script.write_text(f'#!/bin/sh\nexec "{sys.executable}" {module} "$@"\n')
            script.chmod(script.stat().st_mode | stat.S_IEXEC)
        return commands

    def read(self, text: str) -> None:
        """Install what a text between blocks says."""
        for line in _PIP.findall(text) if self.is_literal else ():
            self._shell(f"python -m {line}")
            importlib.invalidate_caches()

    def run(self, block: Block) -> str:
        """What a block prints, errors and all."""
        return self._shell(block.text) if block.language == "bash" else self._python(block)

    def _shell(self, text: str) -> str:
        lines = [x for x in text.replace("\\\n", " ").splitlines() if x and x[0] != "#"]
        if not self.is_literal and all(_PLAIN_COMMAND.fullmatch(line) for line in lines):
            return "".join(map(self._here, lines))
        done = subprocess.run(
            ["bash", "-e", "-c", text],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=TIMEOUT_S,
        )
        assert done.returncode == 0, f"{text}\n{done.stdout}"
        return done.stdout

    def _here(self, line: str) -> str:
        """Run a command of trunnion in this process, which has imported it."""
        with contextlib.chdir(self.folder):
            done = CliRunner().invoke(
                app, shlex.split(line, comments=True)[1:], env={"COLUMNS": "110"}
            )
        assert done.exit_code == 0, f"{line}\n{done.output}"
        return done.output

    def _python(self, block: Block) -> str:
        """Run it as a notebook does: the value of the last expression is printed."""
        tree = ast.parse(block.text)
        last = tree.body[-1] if tree.body else None
        if isinstance(last, ast.Expr):
            tree.body.pop()
        out = io.StringIO()
        with contextlib.chdir(self.folder), contextlib.redirect_stdout(out):
            exec(compile(tree, f"block at line {block.line}", "exec"), self.names)
            if isinstance(last, ast.Expr):
                value = eval(compile(ast.Expression(last.value), "block", "eval"), self.names)
                if value is not None:
                    print(repr(value))
        return out.getvalue()


def results(page: str, folder: Path, is_literal: bool = False) -> Iterator[tuple[Block, str]]:
    """Run a page; each ``text`` block behind a run one, with what was printed."""
    session = Session(folder, is_literal)
    printed: str | None = None
    last = 0
    for block in blocks(page):
        session.read(page[last : block.span[0]])
        last = block.span[1]
        if block.title:
            target = session.folder / block.title
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(block.text, encoding="utf-8")
        elif block.is_run:
            printed = session.run(block)
        elif block.language == "text" and printed is not None and "not run:" not in block.notes:
            yield block, printed
            printed = None


def differs(expected: str, printed: str) -> str | None:
    """Say where a printed text is not as expected; None: it is."""
    wanted = [line.rstrip() for line in expected.strip("\n").splitlines()]
    lines = [line.rstrip() for line in printed.strip("\n").splitlines()]
    at, free = 0, False
    for line in wanted:
        if line == "...":
            free = True
            continue
        while at < len(lines) and free and not _same(line, lines[at]):
            at += 1
        if at == len(lines) or not _same(line, lines[at]):
            got = lines[at] if at < len(lines) else "nothing more"
            return f"expected {line!r}\nprinted  {got!r}"
        at, free = at + 1, False
    return None if free or at == len(lines) else f"also printed {lines[at]!r}"


def _same(expected: str, printed: str) -> bool:
    """Whether two lines are alike, numbers within two units of their last digit."""
    if "".join(_NUMBER.sub("#", expected).split()) != "".join(_NUMBER.sub("#", printed).split()):
        return False
    pairs = zip(_NUMBER.findall(expected), _NUMBER.findall(printed), strict=True)
    return all(_close(a, b) for a, b in pairs)


def _close(expected: str, printed: str) -> bool:
    a, b = (float(text.replace("−", "-")) for text in (expected, printed))
    mantissa = expected.partition("e")[0]
    decimals = len(mantissa.partition(".")[2])
    if not decimals:
        return bool(a == b)
    unit = 10.0**-decimals * 10.0 ** float(expected.partition("e")[2] or 0)
    return bool(abs(a - b) <= 2.001 * unit)


def written(page: str, folder: Path) -> str:
    """Return a page with what its blocks print."""
    for block, printed in reversed(list(results(page, folder))):
        first, last = block.span
        page = page[:first] + block.shortened(printed) + page[last:]
    return page


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="+", type=Path)
    parser.add_argument("--check", action="store_true")
    asked = parser.parse_args()
    for path in asked.pages:
        with tempfile.TemporaryDirectory() as folder:
            text = path.read_text(encoding="utf-8")
            if not asked.check:
                path.write_text(written(text, Path(folder)), encoding="utf-8")
                continue
            for block, printed in results(text, Path(folder), is_literal=True):
                if found := differs(block.text, printed):
                    sys.exit(f"{path.name}:{block.line}: {found}\n\n{printed}")


if __name__ == "__main__":
    main()
