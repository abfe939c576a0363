"""The sentence at the top: what is wrong, how large with U (k = 2), and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from trunnion.base.conformity import Conformity, Decision
from trunnion.base.report import Result, Shown, significant
from trunnion.base.units import unit_of
from trunnion.diagnosis.records import Gain, percent, value_in_words, with_unit
from trunnion.reports.causes import Found, said
from trunnion.reports.results import COVERAGE, Figure, of_interest, with_expanded
from trunnion.turning.correction import Correction

MAX_SETS = 4
MAX_FIGURES = 3
FIRST = ("accuracy", "systematic", "reversal")
"""Figures that stand before all others."""
EXPANDED = " ± is U (k = 2)."


def verdict_of_diagnosis(found: Found) -> str:
    """Say what a diagnosis found, with sizes and probabilities; first what makes it doubtful."""
    said = _verdict(found)
    return " ".join((*found.d.mistakes, *filter(None, [found.d.too_little]), said))


def _verdict(found: Found) -> str:
    d = found.d
    if d.verdict == "consistent":
        size = with_unit(f"{d.sigma:.3g}", d.gain.unit) if not d.gain.others else "the usual size"
        return " ".join(
            (
                f"The model explains the readings, the residual is noise of {size}. Probability "
                f"{percent(d.none_probability)} that none of the causes looked for is large enough "
                "to show in these readings.",
                *_located(found),
            )
        )
    own = [x for x in d.sentences() if x not in (*d.mistakes, d.reservation, d.too_little)]
    parts = _found(found) if d.causes else own[: 2 if d.verdict == "ambiguous" else 1]
    if d.unexplained and d.causes:
        parts.append(f"Not explained: {d.unexplained}.")
    if d.structure is not None:
        std = np.array([v if np.isfinite(v) else 0.0 for v in d.structure.std_errors.values()])
        size = said(d.structure.parameters, d.structure.std_errors, np.diag(std))
        parts.append(f"Its size: {size}.")
    if located := _located(found):
        parts = [*located, *_left(d.gain, named=bool(d.causes)), *parts]
    text = " ".join(parts)
    return text.replace(" (k = 2)", "") + EXPANDED if "±" in text else text


def _left(gain: Gain, *, named: bool) -> list[str]:
    """Say what location errors leave of the readings, and what they leave beside the causes."""
    if gain.others:
        return []
    before, after = (
        with_unit(f"{rms:.3g}", gain.unit) for rms in (gain.rms_before_um, gain.rms_after_um)
    )
    if not named:
        return [f"They leave {before} rms of the readings."]
    return [f"Alone, location errors leave {before} rms of the readings; with the causes, {after}."]


def _located(found: Found) -> list[str]:
    """Say the largest location errors, where these data give any."""
    return [of_interest(found.located, found.d.errors_std)] if found.located else []


def _found(found: Found) -> list[str]:
    """Say what is certain of the machine, of other things, then what is in doubt."""
    parts = []
    heads = (
        ("Found", found.of_machine),
        ("The instrument's or the machine's", found.of_either),
        ("Not the machine's", found.of_others),
    )
    for head, causes in heads:
        sure = [found.sized(c.id) for c in causes if c.id in found.certain]
        parts += [f"{head}: {'; '.join(sure)}."] if sure else []
    if len(found.d.evidence) > 1:
        parts.append(found.in_doubt(MAX_SETS))
    return parts


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

    def u(j: Any) -> float | None:
        return None if j.std_error is None else COVERAGE * j.std_error

    lines = []
    for decision, verb in ((Decision.FAIL, "Exceeded"), (Decision.UNDECIDED, "Not decided")):
        mine = [
            f"{j.label or j.name} {value_in_words(j.value, u(j), unit_of(j.name))} "
            f"of {j.tolerance:g} allowed"
            for j in result.judged
            if j.decision is decision
        ]
        if mine:
            lines.append(f"{verb}: {'; '.join(mine)}.{EXPANDED}")
    return lines
