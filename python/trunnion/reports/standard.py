"""Results of a standard (ISO 230-2, ISO 230-4, levels): their figures and their pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeAlias, TypeVar

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.report import Result
from trunnion.base.report import Table as Shown
from trunnion.base.units import unit_of
from trunnion.data.ballbar import Ballbar
from trunnion.data.iso230_4 import iso230_4
from trunnion.files.table import Table
from trunnion.plot.dispatch import pictures
from trunnion.plot.picture import Picture
from trunnion.plot.statistics import estimates_picture
from trunnion.reports.document import Item
from trunnion.reports.results import Figure

Standard: TypeAlias = tuple[str, Result]
"""A result of a standard, of the measurement of this name among several; '' of a single one."""
AnItem = TypeVar("AnItem")
FIRST = ("accuracy", "systematic", "repeatability", "reversal", "mean_reversal")
"""Figures of ISO 230-2 in the order in which an acceptance asks for them."""


def standard_results(data: Table) -> tuple[Result, ...]:
    """Return what the standard of a kind of data says of it; none where it does not apply."""
    try:
        if isinstance(data, Ballbar):
            return tuple(iso230_4(data))
        evaluate: Any = getattr(data, "results", None)
        return tuple(evaluate()) if evaluate is not None else ()
    except DataError:  # no circle, too few places
        return ()


def figures_of(result: Any) -> list[Figure]:
    """Return the figures of a result that have a standard uncertainty."""
    std = getattr(result, "std_errors", None)
    if not isinstance(std, Mapping):
        return []
    labels: Mapping[str, str] = result.labels() if hasattr(result, "labels") else {}
    found = [
        Figure(name, labels.get(name, name), float(getattr(result, name)), float(s), unit_of(name))
        for name, s in std.items()
        if isinstance(getattr(result, name, None), int | float) and not isinstance(s, Mapping)
    ]
    return sorted(found, key=_rank)


def _rank(figure: Figure) -> tuple[int, bool]:
    """What an acceptance asks for stands first, of both directions before those of one."""
    heads = [k for k, head in enumerate(FIRST) if figure.name.startswith(head)]
    return heads[0] if heads else len(FIRST), "ward_" in figure.name


def titled(item: AnItem, name: str) -> AnItem:
    """Return a picture or table of one of several measurements with its name in the title."""
    if name and isinstance(item, Picture | Shown):
        return replace(item, title=f"{item.title} ({name})")
    return item


def drawn(of: Result | Table, **options: Any) -> list[Item]:
    """Return the pictures of a result or of data, interactive; none of too few readings."""
    try:
        return list(pictures(of, **options))
    except DataError:
        return []


def of_errors(errors: Mapping[str, float], std: Mapping[str, float]) -> list[Item]:
    """Return bars of location errors with U (k = 2), one picture a unit."""
    units: dict[str, list[str]] = {}
    for name in errors:
        if np.isfinite(std.get(name, np.inf)):
            units.setdefault(unit_of(name), []).append(name)
    return [estimates_picture(names, errors, std, unit) for unit, names in units.items()]
