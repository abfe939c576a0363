"""Say whether a model is right, and if not, what is wrong with it.

Algorithm
---------
1. The model is fitted without effects (:mod:`.fit`). What the readings do not identify is decided
   at the model's start and held there. The noise is taken from the residuals and made white.
2. Readings far out for the noise of the others are set aside (:mod:`.outliers`).
3. Every candidate is linearised at the plain fit and judged after what the nuisance parameters can
   absorb; sets of causes are searched (:mod:`.selection`). The best set is demanded if it is far
   better than none, or if a test of all candidates together says so (:mod:`.alarms`).
4. The best set is fitted exactly; the residual is searched for structure without a name
   (:mod:`.scan`), which then competes with the causes (:mod:`.explain`).
5. Readings set aside are tried again as readings: a point or a face of its own looks like a few
   outliers, and costs less to explain as what it is. The choice with the best score wins.
6. The named causes, every other set of causes that explains the readings about as well, and the
   cross-validated gain are reported (:mod:`.report`, :mod:`.cross_validation`).

The levels add up to less than 5 %: causes 2 %, structure without a name 1 %, repeats 0.5 %,
scatter against the stated noise 0.5 %. Outliers take no share for any noise with finite variance
that the readings themselves show.

Time and memory are linear in readings. Numbers do not depend on the count of threads.
"""

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.threads import one_blas_thread
from trunnion.base.units import Integers as IntArray
from trunnion.diagnosis import outliers as out
from trunnion.diagnosis.case import Case, Explanation, Linearised, kept_rows
from trunnion.diagnosis.explain import best_score, explain
from trunnion.diagnosis.fit import Fit, fit
from trunnion.diagnosis.model import Model, identity
from trunnion.diagnosis.report import report
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.selection import MAX_CAUSES, search

__all__ = ["diagnose"]

INLIER_SIGMAS = 3.5  # a reading within so many sigma of a model that did not use it is no outlier
MAX_REVISIONS = 3
MAX_SUSPECTS = 12
SAME_DIRECTION_COSINE = 0.999
MIN_DOF = 5  # degrees of freedom from which outliers can be told
FAR_SIGMAS = 4.0
MIN_FREE = 0.05  # of a reading that the fit leaves free, for residuals per leverage
TINY = 1e-300

Choice = tuple[float, Explanation, IntArray]  # score, explanation, readings set aside


def diagnose(model: Model) -> Diagnosis:
    """Say whether the model explains its data, and if not, what does.

    Raises
    ------
    DataError
        Fewer readings than unknowns, or readings that are not finite.
    """
    with one_blas_thread():
        case = _case(model)
        _, explanation, dropped = _choose(case)
        return report(case, explanation, dropped)


def _case(model: Model) -> Case:
    """Fit the model without effects, and linearise the candidates there."""
    n, p = len(model.readings), len(model.nuisance)
    if not np.all(np.isfinite(model.readings.values)):
        bad = int(np.argmin(np.isfinite(model.readings.values)))
        raise DataError(
            f"reading of row {model.readings.rows[bad]}: got {model.readings.values[bad]}, "
            "expected a finite number"
        )
    if n <= p:
        raise DataError(f"readings: got {n} for {p} unknowns, expected more than unknowns")
    rows = np.arange(n)
    start = np.asarray(model.start, dtype=np.float64)
    plain = fit(model, rows, (), start, {}, identity)
    whiten = model.whitener(plain.residuals)
    if whiten is not identity:
        plain = fit(model, rows, (), plain.nuisance, {}, whiten)
    return Case(model, rows, whiten, plain, Linearised(model, plain.nuisance, whiten))


# --- which readings to set aside


def _choose(case: Case) -> Choice:
    """Choose which readings to set aside, and explain the others: the best score wins."""
    none = np.zeros(0, dtype=np.intp)
    if not case.model.allows_outliers:
        return 0.0, explain(case), none
    aside = none if case.exact(case.plain) else _far_out(case.plain)
    best = _explained_without(case, aside)
    tried = [aside, best[2]]
    if len(aside) and best_score(case) < best[0]:
        # Perhaps the readings set aside are good ones, and show a cause.
        best = min(best, _explained_without(case, none), key=lambda c: c[0])
        tried.append(none)
    # A robust fit may follow a bad reading that weighs much, and blame those that check it.
    snooped = out.one_by_one(case.plain.basis, case.plain.white) if len(aside) else none
    for bad in (snooped, *_proposals(case, best, aside)):
        if any(np.array_equal(bad, t) for t in tried):
            continue
        tried.append(bad)
        other = _explained_without(case, bad)
        fewer = not other[1].sets and not other[1].terms and set(other[2]) < set(best[2])
        # Without a cause to show for it, a suspect stays set aside, but for those that only
        # checked a bad one.
        if not fewer or np.array_equal(other[2], snooped):
            best = min(best, other, key=lambda c: c[0])
    bad = _with_same_direction(case, best[2])
    if len(bad) > len(best[2]):
        return best[0], explain(case.without(bad)), bad
    return best


def _proposals(case: Case, best: Choice, aside: IntArray) -> list[IntArray]:
    """Propose further readings to set aside: far out under the causes, or competing with them."""
    out_of_causes = []
    if not len(best[2]) and best[1].sets and not case.exact(best[1].fit):
        out_of_causes.append(_far_out(best[1].fit))
    suspects = np.union1d(aside, out_of_causes[0]) if out_of_causes else aside
    if 0 < len(suspects) <= MAX_SUSPECTS:
        out_of_causes.append(_among_causes(case, suspects))
    return out_of_causes


def _explained_without(case: Case, bad: IntArray) -> Choice:
    """Explain without these readings, or those of them that stay bad."""
    n = len(case.rows)
    without = explain(case.without(bad))
    for _ in range(MAX_REVISIONS if len(bad) else 0):
        late = case.rows[kept_rows(n, bad)][_far_out(without.fit)]
        revised = np.union1d(_still_out(case, without, bad), late)
        if np.array_equal(revised, bad):
            break
        bad = revised
        without = explain(case.without(bad))
    score = case.plain.dof * np.log(max(without.rss, TINY)) + without.penalty
    return score + out.outlier_penalty(n) * len(bad), without, bad


def _with_same_direction(case: Case, bad: IntArray) -> IntArray:
    """Add readings that bend the fit as a bad one does: no data tell which of them it is."""
    q = case.plain.basis
    size = np.sqrt(np.maximum(1.0 - np.einsum("ij,ij->i", q, q), TINY))
    found = [bad]
    for i in bad:
        cosine = -(q @ q[i]) / (size * size[i])
        cosine[i] += 1.0 / size[i] ** 2
        found.append(np.flatnonzero(np.abs(cosine) > SAME_DIRECTION_COSINE))
    return np.unique(np.concatenate(found)).astype(np.intp)


def _among_causes(case: Case, suspects: IntArray) -> IntArray:
    """Let a few suspect readings compete with the causes, each as a cause of its own."""
    n = len(case.model.readings)
    alone = np.zeros((n, len(suspects)))
    alone[suspects, np.arange(len(suspects))] = 1.0
    white = np.asarray(case.whiten(alone)).T[:, None, :, None]
    both = case.candidates.beside(list(white), np.full(len(suspects), out.OUTLIER_LEVEL / n))
    top = search(both, case.plain.white, most=MAX_CAUSES + len(suspects))[0]
    count = len(case.effects)
    return np.sort(suspects[[m - count for m in top.members if m >= count]])


def _still_out(case: Case, e: Explanation, bad: IntArray) -> IntArray:
    """Drop from the readings set aside those that the explanation found without them fits."""
    sigma = np.sqrt(e.fit.rss / max(e.fit.dof, 1))
    size = np.abs(np.asarray(case.whiten(e.fit.residuals))[bad])
    return np.asarray(bad[size > INLIER_SIGMAS * sigma])


def _far_out(f: Fit) -> IntArray:
    """Find readings far out under a fit (indices into the readings it used)."""
    leverage = np.einsum("ij,ij->i", f.basis, f.basis)
    size = np.abs(f.white) / np.sqrt(np.maximum(1 - leverage, MIN_FREE))
    typical = np.median(size) / 0.6745
    if f.dof < MIN_DOF or typical <= 0 or size.max() < FAR_SIGMAS * typical:
        return np.zeros(0, dtype=np.intp)
    return out.far_out(out.robust_residuals(f.basis, f.white), leverage)
