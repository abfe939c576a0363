"""Where a table of rates goes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path


def write(lines: Sequence[str], out: Path | None) -> None:
    """Write the lines to a file, or print them."""
    text = "\n".join(lines) + "\n"
    if out:
        out.write_text(text, encoding="utf-8")
    else:
        sys.stdout.write(text)
