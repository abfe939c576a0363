"""Say whether a model is right, and if not, what is wrong with it.

Algorithm
---------
1. The model is fitted without effects (:mod:`.fit`). What the readings do not identify is decided
   at the model's start and held there. The noise is taken from the residuals and made white; where
   readings are recorded in steps it has a floor (:mod:`trunnion.base.resolution`).
2. Readings far out for the noise of the others are set aside (:mod:`.outliers`). Where a cause or
   structure is found, those that are nearly so compete with it.
3. Every candidate is linearised at the plain fit and judged after what the nuisance parameters can
   absorb; sets of causes are searched (:mod:`.selection`). The best set is demanded if the plain
   model is not about as good, or a test of all candidates together says so (:mod:`.alarms`).
4. The best set is fitted exactly; the residual is searched for structure without a name
   (:mod:`.scan`), which then competes with the causes (:mod:`.explain`).
5. Readings set aside are tried again as readings: a point or a face of its own looks like a few
   outliers, and costs less to explain as what it is. The choice with the best score wins.
6. Where what is left of neighbours is alike (errors of no known form that change slowly in space),
   all is repeated with what they share in the noise (:meth:`.Model.correlated`).
7. Where readings of one direction scatter more than others, all is repeated with each weighed by
   its own (:mod:`.scatter`), and kept if the likelihood of all readings is larger.
8. The named causes, every other set of causes that explains the readings about as well, and the
   cross-validated gain are reported (:mod:`.report`, :mod:`.cross_validation`).

The levels add up to 5 %: causes 2 %, structure without a name 1 %, repeats 0.5 %, scatter against
the stated noise 0.5 %, outliers 1 % (on average over the tails of the noise; none to speak of for
normal noise).

Time and memory are linear in readings. Numbers do not depend on the count of threads.
"""

import logging
from dataclasses import replace

import numpy as np

from trunnion.base.threads import one_blas_thread
from trunnion.base.units import Integers
from trunnion.diagnosis import outliers as out
from trunnion.diagnosis.case import Case, kept_rows
from trunnion.diagnosis.cross_validation import better
from trunnion.diagnosis.explain import LINEAR_ERROR, best_score, exactly, explain
from trunnion.diagnosis.explanation import Explanation
from trunnion.diagnosis.fit import Fit, fit
from trunnion.diagnosis.in_turn import price as price_of_wander
from trunnion.diagnosis.left import MAX_NONLINEAR, Left, left_of, left_one_by_one
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.plain import case_of, plain_fit, whitened
from trunnion.diagnosis.records import rms, units_of
from trunnion.diagnosis.report import report
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.scatter import Directions, price
from trunnion.diagnosis.selection import WITHIN
from trunnion.diagnosis.steps import (
    weights_of,
    white_beside,
)
from trunnion.diagnosis.structure import structure_beside
from trunnion.diagnosis.suspects import far_out, proposals
from trunnion.diagnosis.whitening import Whiteners, identity

LOG = logging.getLogger("trunnion.diagnosis")

INLIER_SIGMAS = 3.5  # a reading within so many sigma of a model that did not use it is no outlier
MAX_REVISIONS = 3
MAX_ROUNDS = 3
MAX_POINTS = 3  # about which candidates are linearised
MAX_WORSE = 1.001  # of the rms of the plain model
MAX_WORSE_OF_ONE = 30.0  # of squares over the noise: one of several measurements fitted worse
SAME_DIRECTION_COSINE = 0.999
SAME_LIKELIHOOD = 0.5  # of -2 ln L: weights are good enough
TINY = 1e-300
BY_NUMBER = (
    "sets of causes that leave nothing tell readings worse from the others than no cause does: "
    "they are as many as what they explain"
)
WORSE = "sets of causes that fit better by the noise leave a larger rms than the plain model"

Choice = tuple[float, Explanation, Integers]  # score, explanation, readings set aside


def diagnose(model: Model) -> Diagnosis:
    """Say whether the model explains its data, and if not, what does.

    Raises
    ------
    DataError
        Fewer readings than unknowns, or readings that are not finite.
    """
    with one_blas_thread():
        return report(*_explained(case_of(model)))


def leave(model: Model) -> Left:
    """Return what is left of a model's readings, for one that has further measurements.

    Raises
    ------
    DataError
        As `diagnose`.
    """
    with one_blas_thread():
        case = case_of(model)
        return left_one_by_one(case) or left_of(*_explained(case))


def _explained(case: Case) -> tuple[Case, Explanation, Integers]:
    """Explain a model's readings: the case, the explanation, the readings set aside.

    ``case``: that the diagnosis starts from.
    """
    model = case.model
    LOG.info(
        "%d readings, %d parameters that are always fitted, %d candidates",
        len(model.readings),
        len(model.nuisance),
        len(model.effects),
    )
    case, choice, sure = _ordinary(case)
    if choice is None or not sure:
        about = case_of(model.near(always=True), dependent=True)
        about, other = _settled(plain_fit(model), about, _choose(about))
        settled = _to_first_order(about, other[1].fit)
        if choice is None or (settled and _score(case, about, other) < _score(case, case, choice)):
            case, choice = _of_noise(about, other)
    scores: dict[frozenset[str], float] = {}  # of the sets found
    for _ in range(MAX_ROUNDS if case.grid is not None else 0):
        # What was found was in the noise that the errors of rounding were weighed against.
        again = _with_noise_of(case, choice) if choice[1].sets or len(choice[2]) else None
        if again is None:
            break
        before = frozenset(choice[1].fit.effects)
        scores[before] = choice[0]
        del choice  # columns of many rows: not those of both cases at a time
        case = again
        choice = _choose(case)
        named = frozenset(choice[1].fit.effects)
        if named == before or (choice[0] <= scores[before] and named in scores):
            break  # of two sets that lead to each other the better one
    case, choice = _with_correlation(case, choice)
    case, choice = _with_scatter(case, choice)
    if _worse(case, choice):
        case, choice = _without_causes(case, choice, WORSE)
    elif _by_number_alone(case, choice):
        case, choice = _without_causes(case, choice, BY_NUMBER)
    return case, choice[1], choice[2]


def _with_correlation(case: Case, choice: Choice) -> tuple[Case, Choice]:
    """Explain with what neighbouring readings share, where what is left of them is alike.

    It is judged beside the causes found, and these beside it, until neither changes. Noise of all
    readings is kept where they are likelier by it.
    """
    best, at = (case, choice), case
    for _ in range(MAX_ROUNDS if case.whiten is identity else 0):
        used = np.flatnonzero(kept_rows(len(case.rows), choice[2]))
        found, structure = structure_beside(at, choice[1], choice[2])
        if case.exact(found):
            break
        noise = found.rss / max(found.dof, 1)
        if case.grid is not None and case.grid.matters(float(np.sqrt(noise))):
            break
        effects = choice[1].fit.effects
        whiten = case.model.correlated(found.nuisance, effects, used, noise, structure)
        if whiten is None:
            return best
        at = whitened(case.model, case.plain, case.grid, whiten)
        before, choice = effects.keys(), _choose(at)
        # Without causes the plain model is compared with itself, by the same weights.
        causes = bool(choice[1].fit.effects) and not len(choice[2])
        at.given = case.given or (case.plain if causes else None)
        if whiten.parameters:
            return min(best, (at, choice), key=lambda one: _likelihood(*one))
        if choice[1].fit.effects.keys() == before:
            break
    return at, choice


def _with_scatter(case: Case, choice: Choice) -> tuple[Case, Choice]:
    """Explain with the scatter of each direction of its own, where that explains better.

    Loud readings look like outliers: the scatter is that of all, and of those that were not.
    """
    best, n = (case, choice), len(case.rows)
    directions = Directions.of(case.model) if case.whiten is identity else None
    if directions is None or case.exact(choice[1].fit):
        return best
    every = [(case.plain, np.zeros(0, dtype=np.intp))] if len(choice[2]) else []
    for f, bad in (*every, (choice[1].fit, choice[2])):
        at, last = case, np.inf
        for _ in range(MAX_ROUNDS):
            scatter = directions.scatter(at, f, np.flatnonzero(kept_rows(n, bad)))
            if scatter is None:
                break
            quiet = min(scatter.sizes.values()) * float(np.sqrt(f.rss / max(f.dof, 1)))
            if case.grid is not None and case.grid.matters(quiet):
                break
            at = whitened(case.model, case.plain, case.grid, scatter)
            at.given, at.known = case.given, case.searched_for
            found = _choose(at)
            score = _likelihood(at, found)
            # No reading is set aside that a scatter explains about as well.
            kept_more = len(found[2]) < len(best[1][2])
            if score < _likelihood(*best) + (WITHIN if kept_more else 0.0):
                best = at, found
            if score >= last - SAME_LIKELIHOOD:
                break
            f, bad, last = found[1].fit, found[2], score
            del found  # columns of many rows, unless it is the best
    return best


def _likelihood(case: Case, choice: Choice) -> float:
    """-2 ln L of a choice with all that it costs, comparable between weights of the readings."""
    _, found, bad = choice
    n = len(case.rows)
    used = np.flatnonzero(kept_rows(n, bad))
    score = float(case.floor.deviance(found.rss, case.plain.dof)) + found.penalty
    weights = price(case, used) + price_of_wander(case.without(bad))
    return score + out.outlier_penalty(n) * _choices(case, bad) + weights


def _ordinary(case: Case) -> tuple[Case, Choice | None, bool]:
    """Explain about the set-up's own values; no choice where that does not do, and whether it does.

    It does not where residuals are no stationary noise; where the noise was estimated beside
    something else than what the causes leave; or where the data are far from the set-up, and the
    causes, all simulated together, are not what was fitted, or not all. Where it is not all, a fit
    near the data may hold it all.
    """
    model = case.model
    if case.dependent:
        return case, None, False
    choice = _choose(case)
    if _worse(case, choice):
        return case, None, False
    found = choice[1]
    exact = _to_first_order(case, found.fit)
    if (found.terms or not exact) and model.near() is not model:
        return case, None, False
    # What sums of chords are not may order sets otherwise, or be what is left.
    left = found.terms and not case.wandering  # beside a wander a term is no sign of other causes
    linear = not left and _is_linear(case, found.fit)
    if linear or (about := model.near(always=True)) is model:
        return case, choice, True
    again = case_of(about)
    other = _choose(again)
    if _score(case, again, other) > _score(case, case, choice):
        return case, choice, False
    again.given = plain_fit(model)
    return again, other, not (again.dependent or other[1].terms)


def _score(given: Case, case: Case, choice: Choice) -> float:
    """Score of a choice whose causes are simulated together, by the noise of the given case."""
    found = choice[1].fit
    left = rms(case.model.exact_residuals(found.nuisance, found.effects))
    rss = len(case.rows) * left**2
    return float(given.floor.deviance(rss, given.plain.dof)) + choice[1].penalty


def _off(case: Case, found: Fit) -> float:
    """Rms of what a fit's causes, simulated together, leave otherwise than linearised."""
    exact = case.model.exact_residuals(found.nuisance, found.effects)
    return rms(exact - found.residuals)


def _is_linear(case: Case, found: Fit) -> bool:
    """Whether what is left to the second order could order no sets of causes otherwise."""
    share = _off(case, found) / max(rms(found.residuals), case.least_rms)
    return len(found.residuals) * share**2 <= WITHIN


def _to_first_order(case: Case, found: Fit) -> bool:
    """Whether a fit's causes, simulated together, leave about what they leave linearised."""
    return _off(case, found) <= MAX_NONLINEAR * max(rms(found.residuals), case.least_rms)


def _settled(given: Fit, case: Case, choice: Choice) -> tuple[Case, Choice]:
    """Linearise the candidates anew about what was found until that is the same to first order.

    ``given``: plain fit of the model that was given.
    """
    for _ in range(MAX_POINTS):
        found = choice[1].fit
        if _to_first_order(case, found) and case.model.inside <= found.effects.keys():
            break
        at = case.model.about(found.nuisance, found.effects)
        case = case_of(at, dependent=True)
        choice = _choose(case)
    case.given = given
    return case, choice


def _of_noise(case: Case, choice: Choice) -> tuple[Case, Choice]:
    """Explain again where what is left about a settled fit is stationary noise after all.

    About the set-up's own values it may be none only for what is not linear there.
    """
    again = case_of(case.model)
    if again.dependent:
        return case, choice
    again.given = case.given
    other = _choose(again)
    sound = not other[1].terms and _to_first_order(again, other[1].fit)
    return (again, other) if sound and not _worse(again, other) else (case, choice)


def _worse(case: Case, choice: Choice) -> bool:
    """Whether causes leave a larger rms of the readings of a unit than the plain model, as printed.

    Not by rounding alone: what is printed is larger, or it is by more than `MAX_WORSE`. Of readings
    that wander the rms says nothing: causes are judged by what no wander makes. Of several
    measurements, each of its own noise, one may be fitted a little worse for what another shows;
    from there on they contradict each other.
    """
    rows = kept_rows(len(case.rows), choice[2])
    for wandering in case.wandering:
        rows[wandering] = False
    _, index = units_of(case.model.readings)
    plain, found = case.given or case.without(choice[2]).plain, choice[1].fit
    units = [rows & (index == i) for i in range(index.max() + 1)]
    if isinstance(case.whiten, Whiteners):
        squares = case.whiten(found.residuals) ** 2 - case.whiten(plain.residuals) ** 2
        return any(float(np.sum(squares[u])) > MAX_WORSE_OF_ONE for u in units)
    sizes = [(rms(plain.residuals[u]), rms(found.residuals[u])) for u in units if np.any(u)]
    return any(
        after > MAX_WORSE * before or float(f"{after:.3g}") > float(f"{before:.3g}")
        for before, after in sizes
    )


def _by_number_alone(case: Case, choice: Choice) -> bool:
    """Whether causes leave next to nothing and tell readings worse from others than none does.

    So many causes as there are places fit whatever is measured there.
    """
    found, share = choice[1].fit, LINEAR_ERROR**2
    # The plain fit of all readings leaves no less than that of those that are kept.
    if not found.effects or case.dependent or found.rss >= share * case.plain.rss:
        return False
    kept = case.without(choice[2])
    left = found.rss < share * kept.plain.rss
    if not left:
        return False
    before, after = (kept.cross_validated(one) for one in (kept.plain, found))
    return not better(case.model, kept.rows, before, after)


def _without_causes(case: Case, choice: Choice, why: str) -> tuple[Case, Choice]:
    """Return the plain model alone, and say that nothing improves on it."""
    if case.given is not None:
        case = case_of(case.model.about(case.given.nuisance, {}), dependent=True)
    kept = case.without(choice[2])
    nothing = replace(
        choice[1], fit=kept.plain, rss=kept.plain.rss, penalty=0.0, sets=[], terms=[], note=why
    )
    return case, (choice[0], nothing, choice[2])


def _with_noise_of(case: Case, choice: Choice) -> Case | None:
    """Weigh errors of rounding against the noise that a choice leaves; None: there are none.

    Rounding is simulated on the machine of its causes, is there another one? And on the machine
    without the weakest of them: is it one?
    """
    grid = case.grid
    found = choice[1].fit
    if grid is not None and grid.follows:
        likely = _without_the_weakest(case, found, choice[2])
        return replace(case, found=found, likely=likely, minor=set())
    if grid is None or case.model.whitener(case.plain.residuals) is not identity:
        return None
    used = kept_rows(len(case.rows), choice[2])
    left = np.where(used, found.residuals, 0.0)
    weights = np.where(used, weights_of(case.whiten), 0.0)
    noise = grid.without(choice[2]).noise(left, found.dof, found.jacobian, weights)
    whiten = white_beside(grid, noise)
    if whiten is identity and case.whiten is identity and not grid.matters(noise):
        return None
    again = whitened(case.model, case.plain, grid, whiten)
    again.found, again.likely = found, _without_the_weakest(case, found, choice[2])
    again.given = case.given
    return again


def _without_the_weakest(case: Case, found: Fit, dropped: Integers) -> Fit:
    """Fit without the cause that explains least beside the others; of one cause, that fit."""
    kept = case.without(dropped)
    named = [e for e in case.effects if e.id in found.effects]
    if len(named) < 2:
        return found
    fewer = [
        fit(
            case.model,
            kept.rows,
            [e for e in named if e is not weak],
            found.nuisance,
            {e.id: found.effects[e.id] for e in named if e is not weak},
            kept.whiten,
            kept.plain.judged,
        )
        for weak in named
    ]
    return min(fewer, key=lambda f: f.rss)


# --- which readings to set aside


def _choose(case: Case) -> Choice:
    """Choose which readings to set aside, and explain the others: the best score wins."""
    none = np.zeros(0, dtype=np.intp)
    if not case.model.allows_outliers:
        return 0.0, explain(case), none
    aside = none if case.exact(case.plain) else far_out(case, case.plain)
    if len(aside) and (whole := exactly(case)) is not None:
        # Without noise, a cause of a few readings looks like outliers.
        return 0.0, whole, none
    best = _explained_without(case, aside)
    tried = [aside, best[2]]
    if len(aside) and (case.exact(best[1].fit) or best_score(case) < best[0]):
        # Perhaps the readings set aside are good ones, and show a cause.
        best = min(best, _explained_without(case, none), key=lambda c: c[0])
        tried.append(none)
    # A robust fit may follow a bad reading that weighs much, and blame those that check it.
    snooped = none
    if len(aside):
        snooped = out.one_by_one(case.plain.basis, case.plain.white, case.least_noise)
    elif (best[1].sets or best[1].terms) and not case.exact(best[1].fit):
        # Something is wrong: perhaps a reading that is not far enough out to say so by itself.
        snooped = far_out(case, case.plain, out.SUSPECT_LEVEL)
    for bad in (snooped, *proposals(case, best[1], best[2], aside)):
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


def _explained_without(case: Case, bad: Integers) -> Choice:
    """Explain without these readings, or those of them that stay bad."""
    n = len(case.rows)
    without = explain(case.without(bad))
    LOG.debug("%d set aside: %s", len(bad), ", ".join(without.fit.effects) or "no cause")
    for _ in range(MAX_REVISIONS if len(bad) else 0):
        late = case.rows[kept_rows(n, bad)][far_out(case, without.fit)]
        revised = np.union1d(_still_out(case, without, bad), late)
        if np.array_equal(revised, bad) or len(revised) > out.MAX_SHARE * n:
            break
        bad = revised
        without = explain(case.without(bad))
    score = float(case.floor.deviance(without.rss, case.plain.dof)) + without.penalty
    return score + out.outlier_penalty(n) * len(bad), without, bad


def _with_same_direction(case: Case, bad: Integers) -> Integers:
    """Add readings that bend the fit as a bad one does: no data tell which of them it is."""
    return np.unique(np.concatenate([bad, *_same_direction(case, bad)])).astype(np.intp)


def _same_direction(case: Case, bad: Integers) -> list[Integers]:
    """Of each of some readings, all that bend the fit as it does; it is one of them."""
    q = case.plain.basis
    size = np.sqrt(np.maximum(1.0 - np.einsum("ij,ij->i", q, q), TINY))
    found = []
    for i in bad:
        cosine = -(q @ q[i]) / (size * size[i])
        cosine[i] += 1.0 / size[i] ** 2
        found.append(np.flatnonzero(np.abs(cosine) > SAME_DIRECTION_COSINE))
    return found


def _choices(case: Case, bad: Integers) -> int:
    """Count readings set aside by choice: those that bend the fit alike go together."""
    return len(
        {int(same.min(initial=i)) for i, same in zip(bad, _same_direction(case, bad), strict=True)}
    )


def _still_out(case: Case, e: Explanation, bad: Integers) -> Integers:
    """Drop from the readings set aside those that the explanation found without them fits."""
    sigma = float(np.sqrt(case.floor.noise(e.fit.rss, e.fit.dof)))
    size = np.abs(np.asarray(case.without(bad).whiten(e.fit.residuals))[bad])
    return np.asarray(bad[size > INLIER_SIGMAS * sigma])
