"""Follow every tutorial as a new user does: `make tutorials`.

Each in a fresh environment and an empty folder, with the wheel of this tree: the lines
`pip install ...` of the page as they stand, every block of code, and what each must print. Packages
other than trunnion come from PyPI.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import wheels

RUNNER = wheels.ROOT / "tests" / "docs_snippets.py"
INSTALL = ["-m", "pip", "install", "--quiet", "trunnion"]  # of docs/installation.md


def followed(page: Path, folder: Path) -> None:
    """Follow one page; leave the program with what it printed if it is not what it should."""
    wheels.step(page.name)
    wheels.run([sys.executable, "-m", "venv", folder])
    python = folder / "bin" / "python"
    wheels.run([python, *INSTALL], cwd=folder)
    wheels.run([python, RUNNER, "--check", page], cwd=folder)


def main() -> None:
    """Build the wheel, and follow the pages that are named, or all."""
    names = sys.argv[1:]
    pages = [*map(Path, names)] or sorted((wheels.ROOT / "docs" / "tutorials").glob("*.md"))
    with tempfile.TemporaryDirectory(prefix="trunnion tutorials ") as temporary:
        wheels.step("wheel of this tree")
        words = [sys.executable, "-m", "maturin", "build", "--release", "--quiet", "--out"]
        wheels.run([*words, temporary], cwd=wheels.ROOT)
        already = os.environ.get("PIP_FIND_LINKS", "")
        # Not quoted in the variable: pip reads a path with spaces as several.
        link = Path(temporary).as_uri()
        os.environ["PIP_FIND_LINKS"] = f"{link} {already}".strip()
        for page in pages:
            if page.name != "index.md":
                followed(page.resolve(), Path(temporary) / page.stem)
    wheels.step("done")


if __name__ == "__main__":
    main()
