"""What structure without a name leaves open of what is fitted beside it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, combinations

import numpy as np

from trunnion.base.report import uncertainty
from trunnion.base.units import Floats, capital
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.effect import Effect, NamedValues
from trunnion.diagnosis.evidence import Evidence
from trunnion.diagnosis.explanation import Explanation, Sets
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.formula import PERIODIC, FormulaEffect
from trunnion.diagnosis.functions import DEPENDENT
from trunnion.diagnosis.likely_terms import terms_one_by_one
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.probability import Probabilities, chance_in_doubt
from trunnion.diagnosis.records import MAX_WORST, MIN_DOUBT, labelled, with_unit
from trunnion.diagnosis.smooth import over_range
from trunnion.diagnosis.structure import DISTINGUISHED, wider
from trunnion.diagnosis.supposed import Supposed
from trunnion.machine.effects import Owner
from trunnion.setup.names import spoken

TINY = 1e-300
MAX_FURTHER = 3  # terms of structure beside the one that is stated
SEEN_AGAIN = 2.0  # periods, from which readings show that a wave comes back and has no slope
MIN_LISTED = 0.05  # probability of a set without a cause that is in doubt, to be stated
SURE = 0.9  # of what is seen of a cause, from which a constant leaves it as it is


@dataclass(frozen=True)
class LeftOpen:
    """What the structure of an explanation leaves open, mean squares, shapes (p + k, p + k).

    Attributes
    ----------
    every:
        Of all that is fitted.
    constant:
        The part of it that no set of causes was compared with: the constant of a smooth curve, as
        such a term is taken to be zero on average, the choice of places, what is supposed; and all
        of structure that is stated only, as the causes are fitted without it.
    places:
        The part of that which is the choice of places.
    supposed:
        The parts of it that are what may act and is no candidate, in words (`Model.supposed`).
    """

    every: Floats
    constant: Floats
    places: Floats
    supposed: Mapping[str, Floats]


def left_open(
    kept: Case,
    e: Explanation,
    f: Fit,
    source: FormulaEffect | None,
    variance: float,
    before: Case,
) -> LeftOpen:
    """Say what structure leaves open of the parameters of a fit.

    Structure that is stated and not fitted (``source``: None) may move them as if it were; one that
    is fitted may be wrong by all that it moves, where the data hardly distinguish the two. A smooth
    function of time or of a place has no known zero: errors of the machine are those of its mean
    line, and may be off by as much as is seen of it, as far as the readings do not tell (GUM, type
    B). ``variance``: of a white reading; ``before``: the case without structure in its model, of
    which further terms may be seen, as of several measurements each has structure of its own.
    """
    none, places = np.zeros_like(f.covariance), _by_places(kept, f)
    supposed = _supposed(kept, f, variance)
    known = np.sum([places, *supposed.values()], axis=0)
    if not e.terms or kept.dependent:
        return LeftOpen(known, known, places, supposed)
    d = before.dictionary
    further = terms_one_by_one(d, f.white, f.basis, kept.floor, MAX_FURTHER)[0]
    others = [FormulaEffect.of_term(d.term(number), kept.model) for number, _ in further]
    if source is None:
        stated = FormulaEffect.of_term(e.terms[0][0], kept.model)
        first, moved = _Term(kept, f, stated, variance), none
    else:
        off = _may_be_off(e.fit if e.sets else kept.plain, f)
        first = _Term(kept, f, source, variance, f.effects[source.id])
        moved = np.outer(off, off)
    terms = [first, *(_Term(kept, f, term, variance) for term in others)]
    every = moved + np.sum([x.left_open for x in terms], axis=0)
    constant = first.left_open if source is None else first.constant
    return LeftOpen(every + known, constant + known, places, supposed)


def _by_places(kept: Case, f: Fit) -> Floats:
    """Mean squares that the choice of places leaves open, (p + k, p + k)."""
    known = kept.model.left_by_places(f.effects)
    return np.diag([*np.zeros(len(f.nuisance)), *(known.get(name, 0.0) ** 2 for name in f.names)])


def _supposed(kept: Case, f: Fit, variance: float) -> dict[str, Floats]:
    """Mean squares that what may act and is no candidate leaves open, each (p + k, p + k)."""
    return {
        said: _unseen(kept, f, columns, 1.0, variance)
        for said, columns in kept.model.supposed(f.effects).items()
        if columns.shape[1] and variance > 0
    }


def _unseen(kept: Case, f: Fit, line: Floats, largest: float, variance: float) -> Floats:
    """Mean squares by columns (n, k), of sizes of about ``largest``, as far as none is seen.

    ``variance``: of a white reading.
    """
    line = kept.white(line)
    seen = line - f.basis @ (f.basis.T @ line)
    scale = max(variance, TINY)
    free = np.linalg.inv(seen.T @ seen / scale + np.eye(line.shape[1]) / max(largest, TINY) ** 2)
    mean = free @ (seen.T @ f.white) / scale
    off = kept.moved(f, line)
    return np.asarray(off @ (free + np.outer(mean, mean)) @ off.T)


def notes_of_open(
    kept: Case, f: Fit, open_: LeftOpen, std: Mapping[str, float], variance: float
) -> tuple[str, ...]:
    """Say of which errors and causes what is left open is most of the uncertainty."""
    causes = _mostly(kept, f, open_.places, variance)
    said = tuple(
        f"{capital(labelled(e.id, e.label))}: mostly uncertain by the choice of targets. What "
        "repeats at single targets may be a wave shorter than two steps between them, of which "
        "other targets show another slope; the same targets on both dates show the same."
        for e in causes
    )
    more = (
        f"{capital(labelled(e.id, e.label))}: mostly uncertain by {what}, which may make a part of "
        "it or all of it."
        for what, squares in open_.supposed.items()
        for e in _mostly(kept, f, squares, variance)
        if e.id not in kept.model.supposed_of.get(what, ())
    )
    return (*notes_of_structure(kept.model, open_.every, std), *said, *more)


def _mostly(kept: Case, f: Fit, squares: Floats, variance: float) -> list[Effect]:
    """Effects of a fit of which mean squares are larger than the variance by the noise."""
    first, own = len(f.nuisance), np.diag(f.covariance) * variance
    worst = (f.names[k - first] for k in np.flatnonzero(np.diag(squares) > own) if k >= first)
    return [kept.model.effect(id_) for id_ in dict.fromkeys(id_ for id_, _ in worst)]


def in_doubt(case: Case, e: Explanation, f: Fit, open_: LeftOpen, before: Case) -> Explanation:
    """Return an explanation with the probabilities of sets beside what is left open.

    ``before``: the case without structure in its model.
    """
    e, constant = _beside_supposed(before, e, f), open_.constant
    if isinstance(e.probabilities, Probabilities) and e.probabilities.supposed:
        always = before.model.supposed({})
        weighed = (x for said, x in open_.supposed.items() if said not in always)
        constant = constant - np.sum([*weighed], axis=0)
    stated = bool(e.terms) and case is before and not case.dependent
    return _with_constant(case, e, f, constant, stated=stated)


def _with_constant(
    case: Case, e: Explanation, f: Fit, constant: Floats, *, stated: bool
) -> Explanation:
    """Return an explanation with the probabilities of causes that a constant may be instead.

    ``constant``: the mean squares that it leaves open, of the parameters of the fit; ``stated``:
    of structure beside which sets were compared, and which is not in the fit.
    """
    if not np.any(constant):
        return e
    out: dict[int, float] = {}
    variance = float(case.floor.noise(f.rss, f.dof))
    for j, effect in enumerate(case.effects[: e.candidates.count]):
        if effect.id not in f.effects:
            continue
        linear = [q.linear for q in effect.parameters]
        at = np.array(case.columns_of(effect, f))[linear]
        size = np.array([f.effects[effect.id][q.name] for q in effect.parameters])[linear]
        own = f.covariance[np.ix_(at, at)] * variance
        both = own + constant[np.ix_(at, at)]
        if not np.all(np.isfinite(both)):  # nothing determines it
            continue
        certain, known = (float(np.sqrt(size @ np.linalg.pinv(x) @ size)) for x in (own, both))
        if certain > 0 and (known < SURE * certain or stated):
            out[j] = chance_in_doubt(e.candidates, j, certain, known)
    if not out:
        return e
    e = replace(e, probabilities=e.probabilities.in_doubt(out))
    return replace(e, sets=[*e.sets, *without_doubtful(e, out)])


def without_doubtful(e: Explanation, doubtful: Collection[int]) -> Sets:
    """Sets of an explanation without some causes that are in doubt, as far as they are probable."""
    known = {frozenset(members) for members, *_ in e.sets}
    searched = e.probabilities.search if isinstance(e.probabilities, Probabilities) else None
    out: Sets = []
    for members, distance, rss in e.sets:
        some = [j for j in doubtful if j in members]
        for gone in chain.from_iterable(combinations(some, k + 1) for k in range(len(some))):
            fewer = {j: v for j, v in members.items() if j not in gone}
            new = frozenset(fewer) not in known
            if new and e.probabilities.of_set(frozenset(fewer)) > MIN_LISTED:
                known.add(frozenset(fewer))
                left = rss if fewer or searched is None else searched.nothing.rss
                out.append((fewer, distance, left))
    return out


def _beside_supposed(case: Case, e: Explanation, f: Fit) -> Explanation:
    """Return an explanation with the probabilities of sets beside what effects leave open.

    ``case``: without structure in its model. Sets that are probable then are stated, too.
    """
    chances, variance = e.probabilities, float(case.floor.noise(f.rss, f.dof))
    if not isinstance(chances, Probabilities) or not e.sets or case.dependent or variance <= 0:
        return e
    numbers = {x.id: j for j, x in enumerate(case.effects[: e.candidates.count])}
    fitted = sum(1 << j for id_, j in numbers.items() if id_ in f.effects)
    basis, white, out = case.plain.basis, case.plain.white, list[Supposed]()
    for id_, columns in _of_effects(case, f).items():
        left = case.white(columns)
        left = left - basis @ (basis.T @ left)
        out.append(Supposed(chances.search, numbers[id_], fitted, left, white, variance))
    if not out:
        return e
    e = replace(e, probabilities=replace(chances, supposed=out))
    return replace(e, sets=[*e.sets, *_probable(e, out)])


def _probable(e: Explanation, supposed: Sequence[Supposed]) -> Sets:
    """Sets beside what is supposed that are probable and not among those of an explanation."""
    known: set[frozenset[int]] = {frozenset(members) for members, *_ in e.sets}
    out: Sets = []
    for one in supposed:
        s, c = one.search, one.search.c
        for mask, blocks in Evidence(s, one).near.items():
            members = {s.owner[b]: int(c.variant[b]) for b in blocks}
            new = max(members) < e.candidates.count and frozenset(members) not in known
            if new and e.probabilities.of_set(frozenset(members)) > MIN_LISTED:
                known.add(frozenset(members))
                far = s.scores.get(mask, np.inf) - s.best
                rss = s.nothing.rss - one.gain(blocks)
                out.append((members, far, rss))
    return out


def _of_effects(case: Case, f: Fit) -> dict[str, Floats]:
    """Columns (n, k) that are supposed beside each effect of a fit, and not without it."""
    always = case.model.supposed({}).keys()
    found = {id_: case.model.supposed({id_: values}) for id_, values in f.effects.items()}
    some = {id_: [x for said, x in own.items() if said not in always] for id_, own in found.items()}
    return {id_: np.column_stack(x) for id_, x in some.items() if any(y.shape[1] for y in x)}


def _may_be_off(without: Fit, found: Fit) -> Floats:
    """How far off structure may put the parameters of a fit: not, or by all that it moves them."""
    moved = np.zeros(len(found.covariance))
    if np.max(wider(without, found), initial=0.0) > DISTINGUISHED:
        before, after = (
            np.array([*f.nuisance, *(f.effects[i][name] for i, name in without.names)])
            for f in (without, found)
        )
        moved[: len(before)] = after - before
    return moved


@dataclass(frozen=True, eq=False)
class _Term:
    """Structure of a formula beside a fit.

    Attributes
    ----------
    variance:
        Of a white reading.
    fitted:
        The values of the formula, if it is in the fit.
    """

    kept: Case
    f: Fit
    source: FormulaEffect
    variance: float
    fitted: NamedValues | None = None

    @property
    def left_open(self) -> Floats:
        """What it leaves open."""
        timed = self.source.owner is Owner.TIME
        out = np.outer(self._made[2], self._made[2])
        if self.source.shape in ("jump", "class", *(() if timed else PERIODIC)):
            return out
        held = self.source.at_values(self.fitted or {})[0]
        return np.asarray(out + self._of(_line(held, self.kept.model, self._weight)))

    @property
    def constant(self) -> Floats:
        """What the constant of a smooth curve leaves open; of others nothing."""
        if self.source.shape != "polynomial":
            return np.zeros_like(self.f.covariance)
        return self._of(self._weight[:, None])

    @cached_property
    def _weight(self) -> Floats:
        return self.source.weights(self.kept.model)

    @cached_property
    def _made(self) -> tuple[Floats, Floats, Floats]:
        """Its columns (n, k), their sizes (k,), and what it moves that is not fitted (p + k,)."""
        kept, f, model = self.kept, self.f, self.kept.model
        held, values = self.source.at_values(self.fitted or {})
        effect = held.bound(model.data, model)
        columns = effect.columns(effect.values(0.0 for _ in effect.parameters))
        if self.fitted is not None:
            return columns, np.array(list(values.values())), np.zeros(len(f.covariance))
        white = kept.white(columns)
        left = white - f.basis @ (f.basis.T @ white)
        size = np.linalg.lstsq(left, f.white, rcond=float(np.sqrt(DEPENDENT)))[0]
        return columns, np.asarray(size), kept.moved(f, white @ size)

    def _of(self, line: Floats) -> Floats:
        """What a line (n, k) of sizes up to the largest that is seen leaves open."""
        kept, f, weight = self.kept, self.f, self._weight
        columns, size, _ = self._made
        used = kept.rows[np.abs(weight[kept.rows]) > np.abs(weight).max() / 2]
        largest = float(np.max(np.abs((columns @ size)[used] / weight[used]), initial=0.0))
        return _unseen(kept, f, line, largest, self.variance)


def _line(source: FormulaEffect, model: Model, weight: Floats) -> Floats:
    """A constant that enters as a formula does, and a slope where a wave may have one; (n, 1 or 2).

    A polynomial has its own, what is local none, and there is none along an angle that comes round,
    nor where a wave comes back.
    """
    v = next(v for v in model.covariates if v.name == source.covariate)
    back = source.high - source.low >= SEEN_AGAIN * source.number
    if source.shape != "wave" or v.period is not None or back:
        return weight[:, None]
    x = over_range(np.asarray(v.values, dtype=np.float64), source.low, source.high)
    return np.column_stack([weight, weight * x])


def notes_of_structure(
    model: Model, left: Floats, std: Mapping[str, float], what: str = "the unexplained structure"
) -> tuple[str, ...]:
    """Say of which errors of the machine what is left open is most of the uncertainty.

    left: mean squares, (p + k, p + k). std: By name of the error. what: leaves it open.
    """
    shares = {
        x.name: size / std[x.name]
        for x, size in zip(model.nuisance, np.sqrt(np.diag(left)).tolist(), strict=False)
        if size and np.isfinite(std.get(x.name, np.inf))
    }
    worst = [k for k in sorted(shares, key=lambda k: -shares[k]) if shares[k] > MIN_DOUBT]
    units = {x.name: x.unit for x in model.nuisance}
    said = ", ".join(
        f"{spoken(k)} ± {with_unit(uncertainty(std[k]), units[k])}" for k in worst[:MAX_WORST]
    )
    return (f"Mostly what {what} leaves open: {said}.",) if said else ()
