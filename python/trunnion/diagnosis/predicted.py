"""Causes that a fit demands and of which readings that are left out show nothing.

Where a fit demands a cause and all that is open leaves its size open as well, what the cause does
is made up by others that do nearly the same: a warm-up so slow that any amplitude does, beside a
scale that changes from cycle to cycle; a kink in a smooth shape that has no kink. Is each group of
readings then predicted no better from the others with it than without it, it does not act for
certain.
"""

from dataclasses import replace

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.cross_validation import better
from trunnion.diagnosis.doubt import Doubt, alternatives_of
from trunnion.diagnosis.effect import Effect
from trunnion.diagnosis.explanation import Explanation
from trunnion.diagnosis.fit import Fit, fit
from trunnion.diagnosis.open_structure import without_doubtful
from trunnion.diagnosis.records import CERTAIN, Alternative

SIZE_OPEN = 2.0  # standard errors with all that is open, below which the size of a cause is open
UNDECIDED = 0.5  # probability of what a fit demands and readings that are left out do not show


def weighed(
    case: Case,
    kept: Case,
    e: Explanation,
    f: Fit,
    variance: float,
    growth: Floats,
    left: Floats,
) -> tuple[Explanation, list[Alternative], Doubt]:
    """Weigh sets of causes, in doubt what no left-out reading shows; ``left``: mean squares."""
    alternatives = alternatives_of(case, e)
    of_sets = Doubt.of(kept, f, alternatives, variance, growth)
    doubted = _not_predicted(kept, e, f, of_sets.covariance + left)
    if doubted is not e:
        alternatives = alternatives_of(case, doubted)
        of_sets = Doubt.of(kept, f, alternatives, variance, growth)
    return doubted, alternatives, of_sets


def _not_predicted(case: Case, e: Explanation, f: Fit, covariance: Floats) -> Explanation:
    """Return an explanation in which causes are in doubt that predict no readings.

    ``covariance``: of the parameters of the fit ``f``, with all that is open, (p + k, p + k).
    """
    out = {
        j: UNDECIDED
        for j, effect in enumerate(case.effects[: e.candidates.count])
        if effect.id in f.effects
        and not effect.expected
        and e.probabilities.of_cause(j) > CERTAIN
        and _size(case, effect, f, covariance) < SIZE_OPEN
        and not _predicts(case, effect, f)
    }
    if not out:
        return e
    e = replace(e, probabilities=e.probabilities.in_doubt(out))
    return replace(e, sets=[*e.sets, *without_doubtful(e, out)])


def _size(case: Case, effect: Effect, f: Fit, covariance: Floats) -> float:
    """Size of an effect in standard errors, all its linear parameters together."""
    linear = [q.linear for q in effect.parameters]
    at = np.array(case.columns_of(effect, f), dtype=np.intp)[linear]
    size = np.array([f.effects[effect.id][q.name] for q in effect.parameters])[linear]
    own = covariance[np.ix_(at, at)]
    if not np.all(np.isfinite(own)):
        return 0.0
    return float(np.sqrt(max(size @ np.linalg.pinv(own) @ size, 0.0)))


def _predicts(case: Case, effect: Effect, f: Fit) -> bool:
    """Whether readings are predicted better with an effect of a fit than without it."""
    model = case.model
    others = {id_: values for id_, values in f.effects.items() if id_ != effect.id}
    every = [model.effect(id_) for id_ in others]
    rest = fit(model, case.rows, every, f.nuisance, others, case.whiten, f.judged)
    before, after = (case.cross_validated(one) for one in (rest, f))
    return better(model, case.rows, before, after)
