"""Reports: one self-contained page a result, for a screen and for A4."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from trunnion.base.input import path_of
from trunnion.base.output import write_text
from trunnion.base.report import Result
from trunnion.reports.build import document
from trunnion.reports.page import page
from trunnion.reports.source import Source


def write(
    result: Result,
    path: str | PathLike[str],
    *,
    data: Any = None,
    setup: Any = None,
    tolerance: Mapping[str, float] | None = None,
    made_by: str = "",
) -> Path:
    """Write the report of a result; see :meth:`trunnion.base.report.Result.to_html`."""
    target = path_of(path)
    write_text(target, page(document(result, Source.of(result, data, setup, tolerance, made_by))))
    return target
