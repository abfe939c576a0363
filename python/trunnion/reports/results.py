"""The table that people came for: each result with U (k = 2), the value before, the tolerance."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from trunnion.base.conformity import Decision, decide
from trunnion.base.report import Cell, Shown, Table, measured, significant
from trunnion.base.units import unit_of
from trunnion.setup.names import called

COVERAGE = 2.0
EXPANDED = "U (k = 2)"
NO_DECISION = "–"
_ERROR = re.compile(r"(?<=would shift )\S+(?= by )")
_TWICE = re.compile(r"would shift (shift|turn)\b")
_PARAMETER = re.compile(r"(?<= of )(\w+?)_(?:um|arcsec|ppm)(?:_\w+)?\b")
_MINUS = re.compile(r"(?<![\w.])-(?=\d)")


@dataclass(frozen=True)
class Figure:
    """One result.

    Attributes
    ----------
    name
        As programs call it; the tolerance and the old value are found by it.
    label
        As people call it.
    value, std
        In `unit`; a standard uncertainty of inf: not identifiable, None: not stated.
    old
        What was taken for it before; None: nothing.
    """

    name: str
    label: str
    value: float
    std: float | None
    unit: str
    old: float | None = None


def figures_table(
    title: str, figures: Iterable[Figure], tolerance: Mapping[str, float]
) -> tuple[Table, list[Decision]]:
    """Return results as a table, and what is decided of those that have a tolerance.

    A value keeps its tolerance where its size does (ISO 14253-1).
    """
    listed = list(figures)
    has_old = any(f.old for f in listed)
    judged = any(f.name in tolerance for f in listed)
    decisions: list[Decision] = []
    rows = []
    for f in listed:
        value, expanded = with_expanded(f.value, f.std)
        row: list[Cell] = [f.label]
        if has_old:
            row.append(None if f.old is None else significant(f.old, 4))
        row += [value, expanded, f.unit]
        if judged:
            limit = tolerance.get(f.name)
            if limit is None:
                row += [None, NO_DECISION]
            else:
                std = np.inf if f.std is None else f.std
                decisions.append(decide(f.value, std, upper=limit, lower=-limit))
                row += [Shown(limit, f"± {limit:g}"), str(decisions[-1])]
        rows.append(row)
    heads = [
        "",
        *(["old value (set-up)"] if has_old else []),
        "new value" if has_old else "value",
        EXPANDED,
    ]
    heads += ["unit", *(["tolerance", "ISO 14253-1"] if judged else [])]
    return Table.of(title, heads, rows), decisions


def with_expanded(value: float, std: float | None) -> tuple[Cell, Cell]:
    """Return a value and its U (k = 2), shown to the two leading digits of the latter."""
    return measured(value, None if std is None else COVERAGE * std)


def location_errors(
    errors: Mapping[str, float],
    std: Mapping[str, float],
    old: Mapping[str, float],
    units: Mapping[str, str],
) -> list[Figure]:
    """Return location errors beside what the set-up states of them."""
    return [
        Figure(
            name,
            called(name),
            value,
            std.get(name),
            units.get(name) or unit_of(name),
            old.get(name),
        )
        for name, value in errors.items()
    ]


def plain_words(text: str) -> str:
    """Return what is said of effects that readings do not show, without names of programs."""
    text = text.replace("what is always fitted absorbs it", "what is always estimated takes it up")
    text = text.replace("what is always fitted absorbs", "what is always estimated takes up")
    text = _PARAMETER.sub(r"its part \1", _MINUS.sub("−", text))
    text = _ERROR.sub(lambda match: called(match[0]), text)
    return _TWICE.sub(r"would change the \1", text)  # a placement


def largest_of(errors: Mapping[str, float], std: Mapping[str, float]) -> dict[str, str]:
    """Return the largest error of each unit that is beyond its U, by name, with U."""
    found = {}
    beyond = {k: v for k, v in errors.items() if abs(v) > COVERAGE * std.get(k, 0.0)}
    for unit in dict.fromkeys(unit_of(name) for name in beyond):
        mine = {k: v for k, v in beyond.items() if unit_of(k) == unit}
        name = max(mine, key=lambda k: abs(mine[k]))
        value, expanded = with_expanded(mine[name], std.get(name))
        shown = f"{value.text if isinstance(value, Shown) else value}"
        half = f" ± {expanded.text}" if isinstance(expanded, Shown) else ""
        found[name] = f"{shown}{half} {unit}"
    return found


def of_interest(errors: Mapping[str, float], std: Mapping[str, float]) -> str:
    """Say the largest error of each unit, and how many are not identifiable."""
    known = {k: v for k, v in errors.items() if np.isfinite(std.get(k, 0.0))}
    parts = [f"{called(name)} {said}" for name, said in largest_of(known, std).items()]
    lost = len(errors) - len(known)
    none = "none beyond its U" if known else "none identifiable"
    largest = f"largest: {'; '.join(parts)} (k = 2)" if parts else none
    more = f"; {lost} not identifiable" if lost and parts else ""
    return f"{len(errors)} errors of the machine, {largest}{more}."
