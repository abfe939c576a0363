"""Where a table of rates goes, and at which commit it was made."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path


def commit() -> str:
    """Return a line that names the commit, and says if files were changed since."""
    here = Path(__file__).parent

    def git(*words: str) -> str:
        run = subprocess.run(["git", *words], cwd=here, capture_output=True, text=True, check=False)
        return run.stdout.strip() if run.returncode == 0 else ""

    name = git("rev-parse", "--short=10", "HEAD")
    if not name:
        return "Made outside a git checkout."
    changed = " with uncommitted changes" if git("status", "--porcelain", "-uno") else ""
    return f"Made at commit {name}{changed}."


def count_and_out(description: str | None) -> tuple[int, Path | None]:
    """Return how many runs a command line asks for, and the file that its table goes to."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("count", type=int)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    return given.count, given.out


def write(lines: Sequence[str], out: Path | None) -> None:
    """Write the lines and the commit they were made at to a file, or print them."""
    text = "\n".join([*lines, "", commit()]) + "\n"
    if out:
        out.write_text(text, encoding="utf-8")
    else:
        sys.stdout.write(text)
