"""What a diagnosis says, in sentences."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from trunnion.base.report import uncertainty
from trunnion.base.units import capital, parameter_words, unit_of
from trunnion.diagnosis.contributions import largest_biases
from trunnion.diagnosis.records import (
    MAX_WORST,
    MIN_DOUBT,
    NO_CAUSE,
    Cause,
    chance,
    labelled,
    percent,
    together,
    with_unit,
)
from trunnion.files.origin import places
from trunnion.setup.names import spoken

if TYPE_CHECKING:
    from trunnion.diagnosis.result import Diagnosis

MAX_SETS = 6  # in a sentence
WORTH_SAYING = 0.05  # probability of sets that are not listed
ROUNDING = 1e-9  # µm, arcsec: data without noise have standard errors of 0


def sentences_of(d: Diagnosis) -> tuple[str, ...]:
    """Say the verdict first, then what carries it."""
    said = [_probable(c) for c in d.causes]
    lines: list[str] = []
    match d.verdict:
        case "consistent":
            lines = [
                "Consistent: the model explains the data, the residual is noise of "
                f"{_noise(d)} ({chance(d.p_value)}); probability {percent(d.none_probability)} "
                "that no known cause is large enough to show in these readings."
            ]
        case "explained" if len(said) == 1:
            lines = [f"Explained by one cause: {said[0]}."]
        case "explained" if said:
            lines = [f"Explained by {len(said)} causes: {'; '.join(said)}."]
        case "explained":
            count = "one outlier" if len(d.outliers) == 1 else "the outliers"
            lines = [f"Explained: the model fits the data without {count}."]
        case "ambiguous":
            lines = _ambiguous(d)
        case "unexplained":
            lines = [f"Unexplained: no known cause fits; {d.unexplained}."]
            if said:
                lines = [
                    "Unexplained in part: beside the causes named here, something acts that no "
                    f"known cause makes; {d.unexplained}.",
                    f"Named beside it: {'; '.join(said)}.",
                ]
    if d.unexplained and d.verdict in ("explained", "ambiguous"):
        lines.append(f"Left unexplained: {d.unexplained}.")
    if d.structure is not None:
        lines += d.structure.sentences()
    if said or d.structure is not None:
        lines += [
            *_bias(d),
            *(() if d.ladder is None else d.ladder.sentences()),
            f"Cross-validated rms {d.gain.fall()}; the plain model alone has {chance(d.p_value)}.",
        ]
    weak = (f"{labelled(k, d.labels.get(k, ''))}: {_worded(v)}" for k, v in d.unnoticed.items())
    small = "; ".join(weak)
    return (
        *d.mistakes,
        *(first for first in (d.reservation, d.too_little) if first is not None),
        *lines,
        *_left_out(d),
        *((f"Not excluded: {small}.",) if small else ()),
        *(note for note in d.notes if note not in d.mistakes),
    )


def _probable(cause: Cause) -> str:
    return f"{cause.headline()} ({percent(cause.probability)}{cause.reserve})"


def _noise(d: Diagnosis) -> str:
    if not d.gain.others:
        return with_unit(f"{d.sigma:.3g}", d.gain.unit)
    parts = (with_unit(f"{g.rms_after_um:.3g}", u) for u, g in d.gain.by_unit().items())
    return ", ".join(parts)


def _ambiguous(d: Diagnosis) -> list[str]:
    """Say what is certain, then what is in doubt."""
    certain = frozenset.intersection(*d.alternatives)
    lines = [f"Ambiguous: {len(d.alternatives)} sets of causes are possible."]
    sure = [_probable(c) for c in d.causes if c.id in certain]
    if sure:
        lines.append(f"In all of them: {'; '.join(sure)}.")
    first = together([c.headline() for c in d.causes if c.id not in certain])
    others = [
        together([labelled(i, d.labels.get(i, "")) for i in sorted(a.causes - certain)])
        for a in d.evidence[1 : MAX_SETS + 1]
    ]
    more = len(d.alternatives) - 1 - len(others)
    none = "no further cause" if certain else NO_CAUSE
    doubt = "; or ".join(
        f"{text or none} ({percent(a.probability)})"
        for text, a in zip((first, *others), d.evidence, strict=False)
    )
    if more:
        doubt += f"; or one of {more} more sets"
    apart = 0.0 if frozenset() in d.alternatives else d.none_probability
    rest = 1.0 - apart - sum(a.probability for a in d.evidence)
    if rest > WORTH_SAYING:
        doubt += f"; or a set that is not listed ({percent(rest)})"
    return [
        *lines,
        f"In doubt, with the probability of each set: {doubt}.",
        *_widened(d),
    ]


def _widened(d: Diagnosis) -> list[str]:
    """Say of which errors the uncertainty is mostly the doubt between two sets."""
    shares = {
        k: d.doubt[k] / d.errors_std[k]
        for k in d.rivals
        if np.isfinite(d.errors_std[k]) and d.doubt[k] > ROUNDING
    }
    worst = [k for k in sorted(shares, key=lambda k: -shares[k]) if shares[k] > MIN_DOUBT]
    lines = []
    for name in worst[:MAX_WORST]:
        std, part = (uncertainty(v[name]) for v in (d.errors_std, d.doubt))
        one, other = d.alternatives[0], d.rivals[name]
        pair = (
            together([labelled(i, d.labels.get(i, "")) for i in sorted(s)]) or "no further cause"
            for s in (one - other, other - one)
        )
        size = f"{capital(spoken(name))} ± {std} {unit_in(d, name)}"
        lines.append(f"{size}, of it ± {part} from the doubt between {' and '.join(pair)}")
    return [f"{'; '.join(lines)}."] if lines else []


def _bias(d: Diagnosis) -> list[str]:
    """Name the machine error whose bias by the causes moves the tool most."""
    moved = {k: v - d.errors_after.get(k, v) for k, v in d.errors_before.items()}
    count = len(d.causes) + (d.structure is not None)
    return [
        f"Without {'it' if count == 1 else 'them'}, {spoken(name)} is biased by "
        f"{with_unit(f'{abs(moved[name]):.2g}', unit_in(d, name))}."
        for name in largest_biases(moved, d.errors_std, d.units)[:1]
    ]


def _left_out(d: Diagnosis) -> list[str]:
    """Name outliers by their place, and errors that the data do not identify."""
    lines = []
    if d.outliers:
        what = "Outlier" if len(d.outliers) == 1 else "Outliers"
        lines.append(f"{what}, left out: {_places(d)}.")
    lost = [k for k in d.not_identifiable if k in d.errors_after]
    if lost:
        reasons = {d.not_identifiable[k] for k in lost}
        why = next(iter(reasons)) if len(reasons) == 1 else ""
        lines.append(f"Not identifiable: {', '.join(lost)}{f' ({why})' if why else ''}.")
    return lines


def _places(d: Diagnosis) -> str:
    """Say where people find the outliers; rows of several measurements are counted on."""
    if not isinstance(d.data, tuple):
        return places(d.data, d.outliers)
    parts, first = [], 0
    for i, one in enumerate(d.data, start=1):
        mine = [row - first for row in d.outliers if 0 <= row - first < len(one)]
        where = "" if one.origin else f" of measurement {i}"
        parts += [f"{places(one, mine)}{where}"] if mine else []
        first += len(one)
    return ", ".join(parts)


def _worded(text: str) -> str:
    """Return what an effect would do in words: "5 µm of ky_um with -5 µm" → "of ky with −5 µm"."""
    text = re.sub(r"(?<![\w.])-(?=\d)", "−", text)
    text = re.sub(r"\bof (\w+)", lambda m: f"of {parameter_words(m[1])}", text)
    return re.sub(r"(?<=would shift )\w+|(?<= and )\w+(?= by )", lambda m: spoken(m[0]), text)


def unit_in(d: Diagnosis, name: str) -> str:
    """Return the unit of a parameter."""
    return d.units.get(name) or unit_of(name)
