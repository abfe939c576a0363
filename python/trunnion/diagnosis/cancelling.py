"""Causes that make more than there is to explain, and cancel each other.

Kinks, bows and the modes of a smooth shape are many to a few places. Some of them cancel to almost
anything: a hollow between two places is a kink and a bow, each several times as large as all that
was read, and what is left of them where they are taken apart at other places is as large, too. So
where a cause makes far more than the plain model leaves, the others have to cancel it. Such causes
are taken for real where they predict readings from the others, and for as many as what they explain
where the plain model alone predicts better.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.cross_validation import better
from trunnion.diagnosis.effect import Effect
from trunnion.diagnosis.fit import Fit, fit
from trunnion.diagnosis.selection import CANCELLING

NEXT_TO_NOTHING = 1e-3
"""Of the plain model's sum of squares: data without noise are judged by the count of causes."""


def cancelling(case: Case, f: Fit) -> set[int]:
    """Cause of a fit that others cancel, and that predicts readings worst; none where all is well.

    Of those that make far more than the plain model leaves: without it the others predict best.
    """
    if case.dependent or not f.effects or f.rss < NEXT_TO_NOTHING * case.plain.rss:
        return set()
    large = [j for j, e in enumerate(case.effects) if e.id in f.effects and _large(case, f, e)]
    if not large:
        return set()
    before, after = (case.cross_validated(one) for one in (case.plain, f))
    if better(case.model, case.rows, before, after):
        return set()
    if len(large) == 1:
        return set(large)
    return {min(large, key=lambda j: _missed(case, f, without=case.effects[j]))}


def _large(case: Case, f: Fit, effect: Effect) -> bool:
    """Whether an effect makes far more than the plain model leaves, beside what always acts."""
    if effect.expected:
        return False
    values = [f.effects[effect.id][p.name] if p.linear else 0.0 for p in effect.parameters]
    made: Floats = case.white(f.jacobian[:, case.columns_of(effect, f)] @ np.array(values))
    basis = case.plain.basis
    made = made - basis @ (basis.T @ made)
    return float(made @ made) > CANCELLING**2 * case.plain.rss


def _missed(case: Case, f: Fit, without: Effect) -> float:
    """Sum of squares by which the causes of a fit but one miss readings that others predict."""
    named: Sequence[Effect] = [e for e in case.effects if e.id in f.effects and e is not without]
    start = {e.id: f.effects[e.id] for e in named}
    plain = case.plain
    fewer = fit(case.model, case.rows, named, f.nuisance, start, case.whiten, plain.judged)
    missed = case.cross_validated(fewer)
    return float(missed @ missed)
