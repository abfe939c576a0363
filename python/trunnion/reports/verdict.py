"""The sentence at the top: what is wrong, how large with U (k = 2), and how sure that is."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trunnion.base.conformity import Conformity, Decision
from trunnion.base.report import Result, Shown, significant
from trunnion.base.units import Floats, parameter_words, unit_of
from trunnion.data.rotary_test import RotaryTest
from trunnion.diagnosis.records import Cause, percent, value_in_words, with_unit
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.structure import Structure
from trunnion.plot.diagnosis import record_of, root_of
from trunnion.reports.results import COVERAGE, Figure, of_interest, with_expanded
from trunnion.setup.names import error_label
from trunnion.turning.correction import Correction

MAX_PARAMETERS = 6  # of a cause
MAX_SETS = 4
MAX_FIGURES = 3
FIRST = ("accuracy", "systematic", "reversal")
"""Figures that stand before all others."""
EXPANDED = " ± is U (k = 2)."
_HARMONIC = re.compile(r"([ab])(\d*)_(.+)")


def verdict_of_diagnosis(d: Diagnosis) -> str:
    """Say what a diagnosis found, with sizes and probabilities."""
    if d.verdict == "consistent":
        size = with_unit(f"{d.sigma:.3g}", d.gain.unit) if not d.gain.others else "the usual size"
        return " ".join(
            (
                f"The model explains the readings, what is left is noise of {size}. That nothing "
                f"else acts, of all causes looked for: {percent(d.none_probability)}.",
                *_located(d),
            )
        )
    parts = _found(d) if d.causes else [d.sentences()[0]]
    if d.unexplained and d.causes:
        parts.append(f"Not explained: {d.unexplained}.")
    if d.structure is not None:
        parts.append(f"Its size: {_of_structure(d.structure)}.")
    located = _located(d)
    if located and isinstance(d.data, RotaryTest):  # made for them
        left = with_unit(f"{d.gain.rms_before_um:.3g}", d.gain.unit)
        parts = [*located, f"They leave {left} rms of the readings.", *parts]
    else:
        parts += located
    text = " ".join(parts)
    return text.replace(" (k = 2)", "") + EXPANDED if "±" in text else text


def _located(d: Diagnosis) -> list[str]:
    """Say the largest location errors, where these data give any."""
    located = {k: v for k, v in d.errors_after.items() if error_label(k) != k}
    return [of_interest(located, d.errors_std)] if located else []


def _found(d: Diagnosis) -> list[str]:
    certain = frozenset.intersection(*d.alternatives) if d.alternatives else d.named
    sure = [f"{_sized(d, c.id)} ({percent(c.probability)})" for c in d.causes if c.id in certain]
    parts = [f"Found: {'; '.join(sure)}."] if sure else []
    if len(d.alternatives) > 1:
        sets = [
            (" + ".join(_sized(d, i) for i in sorted(a.causes - certain)) or "no further cause")
            + f" ({percent(a.probability)})"
            for a in d.evidence[:MAX_SETS]
        ]
        more = len(d.alternatives) - len(sets)
        if more > 0:
            sets.append(f"one of {more} other sets" if more > 1 else "one other set")
        parts.append(f"In doubt, with the probability of each set: {'; or '.join(sets)}.")
    return parts


def _sized(d: Diagnosis, id_: str) -> str:
    """Name a cause with its size; the size of one that the diagnosis does not name is not known."""
    c = next((c for c in d.causes if c.id == id_), None)
    if c is None:
        return d.labels.get(id_) or id_.replace("_", " ")
    return f"{c.label or c.id.replace('_', ' ')}, {size_of(d, c)}"


def size_of(d: Diagnosis, c: Cause) -> str:
    """Say the size of a named cause with U; of one of many parameters what it does at most."""
    if len(c.parameters) > MAX_PARAMETERS:
        record = record_of(d)
        change = np.abs(record.changes[c.id])
        at = int(np.argmax(change))
        unit = record.units[record.unit_index[at]]
        return f"up to {change[at]:.3g} {unit} in a reading".replace("  ", " ")
    return _said(c.parameters, c.std_errors, root_of(d, c))


def _of_structure(s: Structure) -> str:
    std = np.array([v if np.isfinite(v) else 0.0 for v in s.std_errors.values()])
    return _said(s.parameters, s.std_errors, np.diag(std))


def _said(values: Mapping[str, float], std: Mapping[str, float], root: Floats) -> str:
    """Say parameters with U; cosine and sine of a harmonic as its amplitude."""
    names, parts = list(values), []
    for k, name in enumerate(names):
        match = _HARMONIC.fullmatch(name)
        other = f"b{match[2]}_{match[3]}" if match and match[1] == "a" else ""
        if other in values:
            at = [k, names.index(other)]
            pair = np.array([values[name], values[other]])
            size = float(np.hypot(*pair))
            u = float(np.linalg.norm(pair @ root[at])) / size if size > 0 else std[name]
            known = np.isfinite(std[name]) and np.isfinite(std[other])
            expanded = COVERAGE * u if known else None
            parts.append(f"amplitude {value_in_words(size, expanded, unit_of(name))}")
        elif not (match and match[1] == "b" and f"a{match[2]}_{match[3]}" in values):
            text = value_in_words(values[name], _twice(std[name]), unit_of(name))
            parts.append(text if len(values) == 1 else f"{parameter_words(name)} {text}")
    return ", ".join(parts)


def _twice(std: float | None) -> float | None:
    return None if std is None else COVERAGE * std


def verdict_of_result(result: Result, figures: Sequence[Figure]) -> str:
    """Say what any other result found."""
    if isinstance(result, Conformity):
        return " ".join([*result.sentences(), *_judged(result)])
    if isinstance(result, Correction):
        on = result.covered
        before, left = (
            float(np.max(np.abs(x[on]), initial=0.0))
            for x in (result.error_um, result.remaining_um)
        )
        return (
            f"Largest error of the diameter {before:.3g} µm before, {left:.3g} µm after if it "
            f"repeats. {result.sentences()[0]}"
        )
    if figures:
        ranked = [f for head in FIRST for f in figures if f.name.startswith(f"{head}_")]
        plain = [f for f in ranked if not f.name.removesuffix("_um").endswith("ward")]
        ranked = [f for f in plain if not f.name.removesuffix("_arcsec").endswith("ward")]
        shown = (ranked or list(figures))[:MAX_FIGURES]
        text = "; ".join(_figure(f) for f in shown)
        return f"{text[:1].upper()}{text[1:]}.{EXPANDED if '±' in text else ''}"
    return " ".join(list(result.sentences())[:1]) or result.headline()


def _figure(f: Figure) -> str:
    value, expanded = with_expanded(f.value, f.std)
    half = f" ± {expanded.text}" if isinstance(expanded, Shown) else ""
    return f"{f.label} {_text(value)}{half} {f.unit}".rstrip()


def _text(cell: Any) -> str:
    return cell.text if isinstance(cell, Shown) else str(significant(float(cell), 4).text)


def _judged(result: Conformity) -> list[str]:
    """Name what is exceeded, then what is not decided."""
    said = []
    for decision, verb in ((Decision.FAIL, "Exceeded"), (Decision.UNDECIDED, "Not decided")):
        mine = [
            f"{j.label or j.name} {value_in_words(j.value, _twice(j.std_error), unit_of(j.name))} "
            f"of {j.tolerance:g} allowed"
            for j in result.judged
            if j.decision is decision
        ]
        if mine:
            said.append(f"{verb}: {'; '.join(mine)}.{EXPANDED}")
    return said
