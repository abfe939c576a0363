"""Find the sets of causes that explain some readings, and structure that none of them makes."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from trunnion.base.resolution import Floor
from trunnion.diagnosis.alarms import CAUSE_LEVEL, Alarm, scatter
from trunnion.diagnosis.alike import Alike, sums_of_causes
from trunnion.diagnosis.behind import behind, differing_instead, expand
from trunnion.diagnosis.cancelling import cancelling
from trunnion.diagnosis.candidates import NAMING_LEVEL, Candidates
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.effect import Effect
from trunnion.diagnosis.explanation import Explanation, Sets
from trunnion.diagnosis.fit import Fit, fit
from trunnion.diagnosis.in_steps import by_probability, chance_as_read
from trunnion.diagnosis.nearer import search_between
from trunnion.diagnosis.part_of_wander import part_of_wander
from trunnion.diagnosis.probability import NEAR_ODDS, Behind, Only, Probabilities
from trunnion.diagnosis.processes import processes
from trunnion.diagnosis.scan import SCAN_LEVEL, UNNAMED_TERM_PENALTY
from trunnion.diagnosis.selection import WITHIN, Found, Search, search
from trunnion.diagnosis.structure import idle_beside, predicts_worse, why_stated
from trunnion.diagnosis.term import Term
from trunnion.diagnosis.terms import (
    Competing,
    best_terms,
    by_rounding,
    jumps_instead,
    one_term_score,
    promising,
    standing_at_once,
    stands_for_causes,
    with_places,
)
from trunnion.diagnosis.whitening import Whiteners, correlated

MAX_EXACT = 16  # sets that are tried for an exact fit
LINEAR_ERROR = 2e-3  # of the plain model's residuals, what columns linearised there miss
FEW_LEFT = 0.1  # the same where moments and durations are not fitted yet
FORMULA_ERROR = 1e-4  # the same, what formulas to first order miss; instruments resolve no less
ASSUMED_ERRORS = (1e-2, 2e-3, 2e-4)  # of these, for data without noise: the fewest causes first
TINY = 1e-300
STAND_IN = 0.9  # correlation of two effects of which one can take the other's place
EXPECTED_P = 0.05  # of an effect that costs nothing to name
MIN_EXPLAINED = 0.05  # of what is left, that a cause explains beside an incomplete model
UNDETERMINED_P = 0.5  # of an effect beside the others of its set, times the candidates
NOTHING = Only(frozenset({frozenset()}), none=1.0)
UNNAMED = 0.5  # probability of structure without a name from which it is stated


def explain(case: Case) -> Explanation:
    """Find the sets of causes, and structure that none of them makes."""
    found = _explained(case)
    if _sound(case):  # what is left is rounding: no test of it says anything
        return replace(found, alarm=1.0, probabilities=NOTHING)
    if isinstance(case.whiten, Whiteners) and case.whiten.known:  # some of the readings have noise
        return found
    # A set may be next to exact as linearised, or when its moments and durations are fitted.
    near = min(found.least, found.fit.rss) < LINEAR_ERROR**2 * case.plain.rss
    return (_exactly(case) if near else None) or found


def _sound(case: Case) -> bool:
    """Whether the plain model, or the machine of the set-up, gives the readings as they are."""
    return case.exact(case.plain) or case.as_described


def exactly(case: Case) -> Explanation | None:
    """Explain data without noise; None: they have noise, or no set leaves next to nothing."""
    if _sound(case) or case.dependent:
        return None
    top = search_between(case).top
    left = top.rss
    if FEW_LEFT**2 * case.plain.rss > left:
        left = min(left, _fit_set(case, case.candidates, top).rss)
    return _exactly(case) if left < LINEAR_ERROR**2 * case.plain.rss else None


def _exactly(case: Case) -> Explanation | None:
    """Explain data without noise; None: they have noise.

    What columns linearised at the plain fit miss is then larger than the noise, and would want
    causes of its own. Sets are searched as if it were noise, and kept if they fit exactly, with no
    cause too many.
    """
    for share in ASSUMED_ERRORS:
        found = _exact_among(case, _with_errors(case, share))
        if found is not None:
            return found
    # The readings come from other formulas, which agree with these to first order.
    noisy = _with_errors(case, FORMULA_ERROR)
    found = replace(_explained(noisy), assumed=noisy.floor.variance)
    left = found.fit.rss / max(case.plain.rss, TINY)
    return found if found.sets and left < (2 * FORMULA_ERROR) ** 2 else None


def _with_errors(case: Case, share: float) -> Case:
    """Case of readings with at least this noise, as a share of the plain model's residuals."""
    variance = share**2 * case.plain.rss / max(case.plain.dof, 1)
    return replace(case, floor=Floor(max(variance, case.floor.variance)))


def _exact_among(case: Case, noisy: Case) -> Explanation | None:
    """Explain by the sets of fewest causes that fit exactly, found in a case with so much noise.

    Of as many causes those of fewest parameters.
    """
    found = _explained(noisy)
    case = replace(case, linearised=noisy.linearised)  # at the places that were found there
    tried = found.sets[:MAX_EXACT]
    fits = [_fit_members(case, members) for members, _, _ in tried]
    exact: dict[frozenset[int], tuple[dict[int, int], Fit]] = {}
    for (members, _, _), f in zip(tried, fits, strict=True):
        if case.exact(f):
            few, least = _pruned(case, members, f)
            exact.setdefault(frozenset(few), (few, least))
    if not exact:
        return None
    fewest = min(exact.values(), key=_size)
    exact = {members: one for members, one in exact.items() if _size(one) == _size(fewest)}
    sets = [(members, 0.0, f.rss) for members, f in exact.values()]
    first = next(iter(exact.values()))[1]
    only, rss = Only(frozenset(exact)), case.least_rss
    return replace(
        found,
        fit=first,
        rss=rss,
        sets=sets,
        terms=[],
        probabilities=only,
        behind=None,
        instead=None,
        assumed=noisy.floor.variance,
    )


def _size(found: tuple[dict[int, int], Fit]) -> tuple[int, int]:
    """Count of the causes of a set, and of their parameters."""
    members, f = found
    return len(members), len(f.names)


def _pruned(case: Case, members: dict[int, int], f: Fit) -> tuple[dict[int, int], Fit]:
    """Leave out causes without which a set fits exactly, too."""
    for j in list(members):
        fewer = {k: v for k, v in members.items() if k != j}
        again = _fit_members(case, fewer)
        if fewer and case.exact(again):
            members, f = fewer, again
    return members, f


def _fit_members(case: Case, members: dict[int, int]) -> Fit:
    """Fit a set exactly: candidates and their variants. The last fit of a case is kept."""
    key = tuple(members.items())
    if key in case.fits:
        return case.fits[key]
    effects = [case.effects[j] for j in members]
    start = {case.effects[j].id: case.values[j][v] for j, v in members.items()}
    plain = case.plain
    f = fit(case.model, case.rows, effects, plain.nuisance, start, case.whiten, plain.judged)
    case.fits.clear()
    case.fits[key] = f
    return f


def _explained(case: Case, after: Search | None = None) -> Explanation:
    """Find the sets of causes by the noise that they leave.

    ``after``: search to begin with, of candidates that are not banned.
    """
    first, chances, extended, alarm_cause = _demanded(case, after or search_between(case))
    plain, candidates = case.plain, case.candidates
    top, named = chances.search.top, chances.likeliest
    demanded = extended is not plain
    best = named[0] if demanded else chances.search.nothing

    terms: list[tuple[Term, float]] = []
    alarm_scan = Alarm.of_terms(case, extended)
    if case.dependent or correlated(case.whiten) is not None:
        # What a model that is not complete leaves competes with no cause: it is stated.
        if alarm_scan.p < SCAN_LEVEL:
            terms = best_terms(case, extended)
    elif not case.exact(extended) and not case.rounds_to_readings(extended):
        unexplained = alarm_scan.p < SCAN_LEVEL and alarm_scan.holds(SCAN_LEVEL)
        picked = _competing(case, best, extended, unexplained)
        both, searched = _searched_with(case, picked, chances.search)
        weighed = (unexplained or demanded) and not chances.search.more
        smooth = processes(case, best, searched.best) if weighed else []
        if unexplained or picked or smooth:
            chances = Probabilities(searched, candidates, processes=smooth)
            tried, terms, extended = _with_structure(case, both, chances)
            idle = idle_beside(
                case, terms, extended, UNDETERMINED_P / max(candidates.multiplicity, 1)
            )
            bad = {j for j, e in enumerate(case.effects) if e.id in idle}
            if bad := bad or _in_doubt_beside(case, terms, tried, extended):
                candidates.ban(bad)
                return _explained(case, first.without(bad))
            best, demanded = tried[0], bool(tried[0].members)
            known = {f.members for f in tried}
            named = [best] if terms else [*tried, *(f for f in named if f.members not in known)]

    noise = chances.of_noise(best) if demanded and not (terms or case.dependent) else 0.0
    if noise > 1:
        named, best, extended = [chances.search.nothing, *named], chances.search.nothing, plain
    elif noise > 1 / NEAR_ODDS:
        named = [*named, chances.search.nothing]
    least = min(best.score, chances.search.top.score)
    sets = _alternatives(case, named, least) if demanded else []
    later = partial(behind, case, least, sets) if sets and not terms else None
    instead = partial(differing_instead, case, least, sets) if sets and not terms else None
    note, p_scatter = scatter(case, extended)
    alarm = min(1.0, 0.05 * min(alarm_cause.p / CAUSE_LEVEL, alarm_scan.p / SCAN_LEVEL, p_scatter))
    penalty = best.score - float(case.floor.deviance(best.rss, plain.dof))
    return Explanation(
        fit=extended,
        rss=best.rss,
        penalty=penalty,
        sets=sets,
        terms=terms,
        alarm=alarm,
        candidates=candidates,
        probabilities=chances,
        values=case.values,
        note=note,
        least=top.rss,
        behind=later,
        instead=instead,
    )


def with_behind(e: Explanation) -> Explanation:
    """Return an explanation with the sets that only a report asks for, sought now."""
    behind = [] if e.behind is None else e.behind()
    instead = [] if e.instead is None else e.instead()
    if not (behind or instead):
        return e
    known = [Behind(frozenset(m), [*m][-1], distance) for m, distance, _ in behind]
    known += [Behind(frozenset(m), None, distance) for m, distance, _ in instead]
    return replace(
        e,
        sets=[*e.sets, *behind, *instead] if e.sets else [],
        probabilities=e.probabilities.with_behind(known),
        behind=None,
        instead=None,
    )


def _demanded(case: Case, first: Search) -> tuple[Search, Probabilities, Fit, Alarm]:
    """Weigh the sets of causes of a search: the search, those, and the fit of the likeliest.

    The plain fit where no cause is demanded; with the test of all candidates. Causes are demanded
    where the plain model does not explain the readings about as well as they do. An effect that
    nothing determines when its set is fitted exactly is no cause: the search is repeated without.
    """
    # Which readings to leave out is a choice of its own, and takes half of the level.
    level = CAUSE_LEVEL if case.complete else CAUSE_LEVEL / 2
    plain, candidates = case.plain, case.candidates
    while True:
        alarm = Alarm.of_causes(case)
        searched = by_probability(case, first)
        chances = Probabilities(searched, candidates)
        demanded = (not searched.more and searched.top.score < searched.nothing.score - WITHIN) or (
            alarm.p < level and alarm.holds(level)
        )
        if not demanded:
            as_read = chance_as_read(case, searched)
            demanded = as_read < level
            alarm.p = min(alarm.p, as_read)
        if not searched.top.members or _sound(case) or not demanded:
            return first, chances, plain, alarm
        extended = _fit_set(case, candidates, chances.likeliest[0])
        # The probability of readings in steps says by itself whether a cause is there.
        bad = set() if searched.more else _undetermined(case, extended, searched)
        if not (bad := bad or cancelling(case, extended)):
            return first, chances, extended, alarm
        candidates.ban(bad)
        first = first.without(bad)


def _undetermined(case: Case, f: Fit, searched: Search) -> set[int]:
    """Effects of a fit that might as well not be in it; ``searched``: where its set is from."""
    variance = float(case.floor.noise(f.rss, f.dof))
    if not case.dependent:  # errors of rounding make some sizes far less certain
        growth = case.growth(f, variance)
        f = replace(f, covariance=f.covariance * np.outer(growth, growth))
    out: set[int] = set()
    lost: dict[int, tuple[float, float]] = {}  # with the count of what was tried
    for j, effect in enumerate(case.effects):
        if effect.id in f.effects:
            nonlinear = [not p.linear for p in effect.parameters]
            # The moment of a shift has no standard error either.
            if case.dependent and np.any(np.isinf(case.std(effect, f, variance)[nonlinear])):
                out.add(j)
                continue
            chance, wald = case.chance(effect, f, variance)
            places = case.candidates.places[case.candidates.owner == j]
            count = case.candidates.multiplicity * float(places.max(initial=1.0))
            if (
                case.dependent
                and not effect.expected
                and _share(case, f, effect, wald) < MIN_EXPLAINED
            ):
                case.minor.add(effect.id)
                out.add(j)
            elif effect.expected and chance > EXPECTED_P:
                out.add(j)
            elif not effect.expected and chance * count > UNDETERMINED_P:
                lost[j] = chance, count
    if lost:  # beside another one of them a cause may be undetermined that alone is not
        worst = max(lost, key=lambda j: lost[j][0])
        sole = case.effects[worst] if len(lost) == 1 else None
        if sole is None or case.chance_beside(sole, f, variance)[0] * lost[worst][1] > NAMING_LEVEL:
            out.add(worst)
    out = out or part_of_wander(case, f)
    # What is expected to differ gives way last, and first what can take its place.
    return (
        {j for j in out if not case.effects[j].expected}
        or {other for j in out if (other := _stand_in(case, f, j)) in _redundant(searched)}
        or out
    )


def _redundant(searched: Search) -> set[int]:
    """Causes of the best set without which, and none in their place, it explains about as well."""
    best = searched.top.members
    return {j for f in searched.found if f.members < best for j in best - f.members}


def _stand_in(case: Case, f: Fit, expected: int) -> int | None:
    """Effect of a fit that is not expected, and that does what an expected one would."""
    p = len(f.nuisance)
    spread = np.sqrt(np.maximum(np.diag(f.covariance), TINY))
    correlation = np.abs(f.covariance / np.outer(spread, spread))[p:, p:]
    names = [name for name, _ in f.names]
    own = names.index(case.effects[expected].id)
    ids = {e.id: j for j, e in enumerate(case.effects) if not e.expected}
    others = [i for i, name in enumerate(names) if name in ids]
    best = max(others, key=lambda i: float(correlation[own, i]), default=own)
    if best == own or correlation[own, best] < STAND_IN:
        return None
    return ids[names[best]]


def _share(case: Case, f: Fit, effect: Effect, wald: float) -> float:
    """Share of the variance of the readings that an effect changes, that it explains after all."""
    at = [len(f.nuisance) + i for i, (name, _) in enumerate(f.names) if name == effect.id]
    own = np.any(f.jacobian[case.rows][:, at] != 0, axis=1)
    left = float(f.white[own] @ f.white[own])
    return wald / max(left + wald, TINY)


def best_score(case: Case) -> float:
    """Score of the best causes, or of the best term."""
    found = search_between(case)
    return min(found.top.score, one_term_score(case, case.plain))


def _alternatives(case: Case, named: Sequence[Found], least: float) -> Sets:
    """List what may be instead, candidates and their variants, the named set first.

    least: The best score.
    """
    sets: Sets = []
    for f in named:
        if case.dependent and (f.members > named[0].members or f.score > least + WITHIN):
            continue  # readings that are not independent demand no more than the named set
        distance = max(f.score - least, 0.0)
        sets += [(m, distance, f.rss) for m in expand(case.candidates, f)]
    return sets


def _fit_set(case: Case, c: Candidates, f: Found) -> Fit:
    """Fit a set exactly, from the variants that the search chose."""
    chosen = {int(c.owner[b]): int(c.variant[b]) for b in f.blocks}
    return _fit_members(case, {j: v for j, v in chosen.items() if j < len(case.effects)})


# --- structure without a name


def _competing(case: Case, best: Found, extended: Fit, unexplained: bool) -> list[Competing]:
    """Terms that compete with the causes, as they may be there instead of some or beside them.

    ``unexplained``: the fit of the best set leaves structure; what a named cause alone makes
    competes only then.
    """
    picked: list[int] = []
    instead: list[Competing] = []
    if unexplained or stands_for_causes(case, best):
        picked = promising(case, best, (extended, case.plain), at_once=unexplained)
    if unexplained:
        instead = jumps_instead(case, extended)
        known = {one.term for one in instead}
        picked = [i for i in picked if i not in known]
    else:
        picked += standing_at_once(case, best)
    competing = [*with_places(case, picked, (extended, case.plain)), *instead]
    terms = [one.term for one in competing]
    alike = Alike(case, terms)
    excluded = sums_of_causes(case, terms, best) | alike.holding_causes() | alike.made_of_causes()
    if not unexplained:
        excluded |= alike.with_a_name()
    return [one for one in competing if one.term not in excluded]


def _searched_with(case: Case, picked: list[Competing], first: Search) -> tuple[Candidates, Search]:
    """Let some terms compete with the causes; ``first``: search of the causes alone."""
    d, c, white = case.dictionary, case.candidates, case.plain.white
    if not picked:
        return c, first
    both = c.beside(
        [d.variants(*one) for one in picked],
        np.full(len(picked), d.level),
        UNNAMED_TERM_PENALTY + by_rounding(case, [one.term for one in picked]),
    )
    searched = search(both, white, floor=case.floor, after=first)
    return both, by_probability(case, searched, tuple(picked))


def _with_structure(
    case: Case, both: Candidates, chances: Probabilities
) -> tuple[list[Found], list[tuple[Term, float]], Fit]:
    """Weigh sets of causes, terms and smooth processes: those of causes, best first, what is left.

    ``both``: the causes and the terms.
    """
    c, searched = case.candidates, chances.search
    likeliest = chances.likeliest or [chances.search.nothing]
    plainly = [f for f in likeliest if not _has_structure(c, f)]
    top = plainly[0] if plainly and chances.unnamed < UNNAMED else likeliest[0]
    sets: dict[frozenset[int], Found] = {}
    for f in (top, *likeliest):
        causes = _causes_of(c, f)
        sets.setdefault(causes.members, causes)
    named = list(sets.values())
    fitted = _fit_set(case, both, named[0])
    terms: list[tuple[Term, float]] = []
    # The probability of readings in steps has weighed terms beside causes already.
    beside = not (both is not c and searched.more) and Alarm.of_terms(case, fitted).p < SCAN_LEVEL
    if _has_structure(c, top) or beside:
        terms = best_terms(case, fitted)
    return named, terms, fitted


def _in_doubt_beside(
    case: Case, terms: Sequence[tuple[Term, float]], tried: Sequence[Found], f: Fit
) -> set[int]:
    """Causes of the first of some sets beside which structure predicts readings worse.

    A set without them is about as likely, and beside it the structure is fitted.
    """
    if not predicts_worse(case, terms, f):
        return set()
    for fewer in (one for one in tried if one.members < tried[0].members):
        if not why_stated(case, terms, _fit_set(case, case.candidates, fewer)):
            return set(tried[0].members - fewer.members)
    return set()


def _has_structure(c: Candidates, f: Found) -> bool:
    """Whether structure without a name is in a set."""
    return max(f.members, default=-1) >= c.count


def _causes_of(c: Candidates, f: Found) -> Found:
    """Return a set without the structure that is in it."""
    blocks = tuple(b for b in f.blocks if b < len(c.owner))
    return replace(f, members=frozenset(m for m in f.members if m < c.count), blocks=blocks)
