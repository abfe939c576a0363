"""What is left beside the causes where it is no stationary noise: how much, when, on what."""

from collections.abc import Sequence

import numpy as np

from trunnion.base.report import rough
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.dependence import BLOCK, length
from trunnion.diagnosis.explanation import Explanation
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.records import rms, units_of, with_unit
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.term import Term
from trunnion.diagnosis.ways import directions

LARGER = 4.0  # in variance than the middle block of readings: the residual is large there
MAX_STRETCHES = 3
WHOLE = 0.9  # of the time of all readings: a stretch as long says nothing of when
MIN_STRETCHED = 0.25  # of the variance, that the largest stretches are named for


def unexplained(case: Case, e: Explanation) -> str | None:
    """Say what an explanation leaves that is more than noise; None: there is none."""
    if found := _remaining(case, e.fit, e.terms):
        return found
    if e.terms:
        return depends_on(e.terms)
    return e.note


def depends_on(terms: Sequence[tuple[Term, float]]) -> str:
    """Say what a residual depends on, its share of the variance, and what it may be instead."""
    (first, share), *others = terms
    text = f"the residual depends on {first.sentence()}: {100 * share:.0f} % of its variance"
    if others:
        text += "; equally consistent with " + " or ".join(t.sentence() for t, _ in others)
    return text


def _remaining(case: Case, f: Fit, terms: Sequence[tuple[Term, float]]) -> str | None:
    """Say what a fit leaves; None where all of it is stationary noise.

    ``terms``: quantities that it depends on, with their share of its variance.
    """
    segments = case.dependent
    said = "is left that is no stationary noise"
    if not segments and not terms:
        segments, said = case.wandering, "is left that wanders as no known cause does"
        terms = _goes_with(case, f, segments) if segments else []
    if not segments:
        return None
    rows = case.rows[np.concatenate(segments)]
    left = f.residuals
    units, index = units_of(case.model.readings)
    sizes = [
        with_unit(f"{rms(left[rows[index[rows] == i]]):.3g}", unit)
        for i, unit in enumerate(units)
        if np.any(index[rows] == i)
    ]
    ways = directions(case.model.components)
    where = [name for name, c in ways.items() if np.any(np.asarray(c)[rows])]
    axis = f" of {', '.join(where)}" if where and any(where) else ""
    text = f"{' and '.join(sizes)} rms{axis} {said}"
    if terms:
        said = " or ".join(term.sentence() for term, _ in terms)
        text += f"; it depends on {said}: {100 * terms[0][1]:.0f} % of its variance"
    places = [case.rows[some] for some in segments]
    return text + when_large(case.model, left, places)


def _goes_with(case: Case, f: Fit, segments: Sequence[Integers]) -> list[tuple[Term, float]]:
    """Term that explains most of readings that wander, and its share of the variance, if any does.

    By the criterion of Schwarz (1978), of as many readings as would be independent.
    """
    places = np.concatenate(segments)
    left = f.residuals[case.rows[places]]
    left = left - left.mean()
    known = Dictionary(case.model, case.rows[places])
    gain, rank = known.gains(left, np.full((len(left), 1), len(left) ** -0.5))
    share = np.clip(gain / max(float(left @ left), 1e-300), 0.0, 1.0 - 1e-12)
    count = len(left) / length([f.residuals[case.rows[s]] for s in segments])
    worth = -count * np.log(1.0 - share) - rank * np.log(max(count, 1.0))
    best = int(np.argmax(worth)) if len(worth) else 0
    return [(known.term(best), float(share[best]))] if np.any(worth > 0) else []


def when_large(model: Model, left: Floats, segments: Sequence[Integers]) -> str:
    """Say where in the sequence of readings the residual is largest, if it is so anywhere."""
    along = next((c for c in model.covariates if c.sequence), None)
    if along is None:
        return ""
    blocks = [b for s in segments for b in np.array_split(s, max(1, len(s) // BLOCK))]
    squares = np.array([float(left[b] @ left[b]) for b in blocks])
    each = squares / [len(b) for b in blocks]
    large = each > LARGER * np.median(each)
    stretches: list[tuple[float, Integers]] = []
    joined = False
    for block, size, out in zip(blocks, squares.tolist(), large.tolist(), strict=True):
        if out and joined and block[0] == stretches[-1][1][-1] + 1:
            before, rows = stretches.pop()
            stretches.append((before + size, np.concatenate([rows, block])))
        elif out:
            stretches.append((size, block))
        joined = out
    stretches.sort(key=lambda s: -s[0])
    some = stretches[:MAX_STRETCHES]
    share = sum(size for size, _ in some) / max(float(squares.sum()), 1e-300)
    if share < MIN_STRETCHED:
        return ""
    values = np.asarray(along.values, dtype=np.float64)
    whole = float(np.ptp(values[np.concatenate(segments)]))
    if any(float(np.ptp(values[rows])) > WHOLE * whole for _, rows in some):
        return ""  # of one axis, or of one run, throughout: when says nothing
    some.sort(key=lambda s: int(s[1][0]))
    said = ", ".join(
        f"{rough(values[rows].min(), 4)} to {with_unit(rough(values[rows].max(), 4), along.unit)}"
        for _, rows in some
    )
    return f"; {100 * share:.0f} % of it lies at {along.name} {said}"
