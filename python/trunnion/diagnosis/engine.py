"""Say whether a model is right, and if not, what is wrong with it.

1. Readings far out for the noise of the others are set aside (:mod:`.outliers`).
2. Every candidate is linearised at the plain fit and judged after what the nuisance parameters can
   absorb; sets of causes are searched (:mod:`.selection`).
3. The best set is fitted exactly; what is left is searched for structure without a name
   (:mod:`.scan`), which then competes with the causes.
4. Readings set aside are tried again as readings: a point or a face of its own looks like a few
   bad readings, and costs less to explain as what it is.

The levels add up to less than 5 %: causes 2 %, structure without a name 1 %, repeats 0.5 %,
scatter against the stated noise 0.5 %. Outliers take no share for any noise with finite variance
that the readings themselves show.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from trunnion.base.errors import DataError
from trunnion.base.units import Floats as Array
from trunnion.base.units import Integers as IntArray
from trunnion.diagnosis import outliers as out
from trunnion.diagnosis.effect import Effect, Values, lengths
from trunnion.diagnosis.fit import VISIBLE, Fit, fit, variants
from trunnion.diagnosis.model import Model, Uncertainty
from trunnion.diagnosis.records import Alternative, Cause, Gain, Residuals, units_of
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.scan import SCAN_LEVEL, Dictionary
from trunnion.diagnosis.selection import MOST_CAUSES, WITHIN, Candidates, Found, search

__all__ = ["diagnose"]

CAUSE_LEVEL = 0.02
REPEAT_LEVEL = 0.005
SCATTER_LEVEL = 0.005
MOST_TERMS = 10
NAMELESS = 10.0  # structure without a name has to explain exp(5) times better than causes do
BEYOND_DOUBT = 1e-7
PERMUTATIONS = 299
ORDINARY = 3.5  # a reading within so many sigma of a model that did not see it is no outlier
MOST_REVISIONS = 3
MOST_SUSPECTS = 12
TWINS = 0.999
TINY = 1e-300
ROUNDING = 1e-12  # of the largest reading
PERMUTATION_SEED = 1
MOST_ALTERNATIVES = 50
LOST = "only the outliers identify it: measure them again"
UNSEEN = "these data do not determine it"
ABSORBED = "what is always fitted absorbs it"
BEHIND = (1.0, 2.0, 4.0)  # times its least size, an effect that may hide behind named causes


@dataclass
class _Case:
    """A model and the readings of it that are used."""

    model: Model
    rows: IntArray
    whiten: Callable[[Array], Array]
    plain: Fit
    values: list[list[Values]]
    columns: list[Array]  # of each candidate, whitened, all readings: (v, n, k)

    @property
    def effects(self) -> tuple[Effect, ...]:
        return self.model.effects

    def exact(self, f: Fit) -> bool:
        """Whether a fit leaves no more than rounding: there is nothing to explain then."""
        size = float(np.max(np.abs(self.model.readings.values), initial=1.0))
        return _rms(f.residuals[self.rows]) < ROUNDING * size


@dataclass
class _Explanation:
    """What one choice of readings leads to."""

    fit: Fit
    rss: float
    price: float  # penalties of causes and terms
    sets: list[tuple[dict[int, int], float, float]]  # candidate: variant; distance; rss
    terms: list[tuple[str, float]]  # sentence, share of variance
    alarm: float  # p-value over all tests
    candidates: Candidates
    note: str | None = None


def diagnose(model: Model) -> Diagnosis:
    """Say whether the model explains its data, and if not, what does.

    Raises
    ------
    DataError
        Fewer readings than unknowns, or readings that are not finite.
    """
    n, p = len(model.readings), len(model.nuisance)
    if not np.all(np.isfinite(model.readings.values)):
        bad = model.readings.rows[~np.isfinite(model.readings.values)]
        raise DataError(f"readings of row {bad[0]} are not finite; a number is wanted")
    if n <= p:
        raise DataError(f"{n} readings for {p} unknowns; more readings than unknowns are wanted")
    rows = np.arange(n)
    start = np.asarray(model.start, dtype=np.float64)
    rough = fit(model, rows, (), start, {}, lambda a: a)
    whiten = model.whitener(rough.residuals)
    plain = fit(model, rows, (), rough.nuisance, {}, whiten)
    values, columns = [], []
    for e in model.effects:
        v, x = variants(model, e, plain.nuisance)
        values.append(v)
        columns.append(np.asarray(whiten(x.transpose(1, 0, 2))).transpose(1, 0, 2))
    case = _Case(model, rows, whiten, plain, values, columns)

    chosen, dropped = _choose(case)
    return _report(case, chosen, dropped)


def _choose(case: _Case) -> tuple[_Explanation, IntArray]:
    """Choose which readings to set aside, and explain the others: the best score wins."""
    n = len(case.rows)
    none = np.zeros(0, dtype=np.intp)
    dof = case.plain.dof
    if not case.model.single_faults:
        return _explain(case), none

    def explain(bad: IntArray) -> tuple[float, _Explanation, IntArray]:
        """Explain without these readings, or those of them that stay bad; with the score."""
        without = _explain(_leave_out(case, bad) if len(bad) else case)
        for _ in range(MOST_REVISIONS if len(bad) else 0):
            late = case.rows[without_rows(n, bad)][_far_out(without.fit)]
            revised = np.union1d(_still_out(without, case.whiten, bad), late)
            if np.array_equal(revised, bad):
                break
            bad = revised
            without = _explain(_leave_out(case, bad) if len(bad) else case)
        score = dof * np.log(max(without.rss, TINY)) + without.price
        return score + out.outlier_penalty(n) * len(bad), without, bad

    aside = none if case.exact(case.plain) else _far_out(case.plain)
    best = explain(aside)
    tried = [aside, best[2]]
    if len(aside) and _bound(case) < best[0]:
        # Perhaps the readings set aside are good ones, and show a cause.
        best = min(best, explain(none), key=lambda e: e[0])
        tried.append(none)
    proposals = []
    if not len(best[2]) and best[1].sets and not case.exact(best[1].fit):
        proposals.append(_far_out(best[1].fit))
    suspects = np.union1d(aside, proposals[0] if proposals else none)
    if 0 < len(suspects) <= MOST_SUSPECTS:
        proposals.append(_among_causes(case, suspects))
    # A robust fit may follow a bad reading that weighs much, and blame those that check it.
    snooped = out.one_by_one(case.plain.basis, case.plain.white) if len(aside) else none
    proposals.insert(0, snooped)
    for bad in proposals:
        if not any(np.array_equal(bad, t) for t in tried):
            tried.append(bad)
            other = explain(bad)
            fewer = not other[1].sets and not other[1].terms and set(other[2]) < set(best[2])
            # Without a cause to show for it, a suspect stays set aside, but for those that only
            # checked a bad one.
            if not fewer or np.array_equal(other[2], snooped):
                best = min(best, other, key=lambda e: e[0])
    bad = _with_twins(case, best[2])
    if len(bad) > len(best[2]):
        return _explain(_leave_out(case, bad)), bad
    return best[1], best[2]


def _with_twins(case: _Case, bad: IntArray) -> IntArray:
    """Add readings that bend the fit as a bad one does: no data tell which of them it is."""
    q = case.plain.basis
    size = np.sqrt(np.maximum(1.0 - np.einsum("ij,ij->i", q, q), TINY))
    alike = (np.eye(len(q))[bad] - q[bad] @ q.T) / np.outer(size[bad], size)
    return np.union1d(bad, np.flatnonzero(np.any(np.abs(alike) > TWINS, axis=0))).astype(np.intp)


def _bound(case: _Case) -> float:
    """Score of the best causes, or of the best term, for all readings."""
    found = search(Candidates(case.columns, case.plain.basis), case.plain.white)
    dictionary = Dictionary(case.model, case.rows)
    dictionary.columns = _whiten_rows(case, dictionary.columns)
    return min(found[0].score, _one_term_score(dictionary, case.plain))


def _among_causes(case: _Case, suspects: IntArray) -> IntArray:
    """Let a few suspect readings compete with the causes, each as a cause of its own."""
    n = len(case.model.readings)
    alone = np.asarray(case.whiten(np.eye(n)[:, suspects])).T[:, :, None]
    count = len(case.effects)
    both = Candidates(
        [*case.columns, *(x[None] for x in alone)],
        case.plain.basis,
        own_level=np.append(np.zeros(count), np.full(len(suspects), out.OUTLIER_LEVEL / n)),
    )
    top = search(both, case.plain.white, most=MOST_CAUSES + len(suspects))[0]
    return np.sort(suspects[[m - count for m in top.members if m >= count]])


def _still_out(e: _Explanation, whiten: Callable[[Array], Array], bad: IntArray) -> IntArray:
    """Drop from the readings set aside those that the explanation found without them fits."""
    sigma = np.sqrt(e.fit.rss / max(e.fit.dof, 1))
    size = np.abs(np.asarray(whiten(e.fit.residuals))[bad])
    return np.asarray(bad[size > ORDINARY * sigma])


def without_rows(n: int, bad: IntArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Mask of the readings that stay."""
    mask = np.ones(n, dtype=bool)
    mask[bad] = False
    return mask


def _far_out(f: Fit) -> IntArray:
    """Find readings far out under a fit (indices into the readings it used)."""
    leverage = np.einsum("ij,ij->i", f.basis, f.basis)
    size = np.abs(f.white) / np.sqrt(np.maximum(1 - leverage, 0.05))
    typical = np.median(size) / 0.6745
    if f.dof < 5 or typical <= 0 or size.max() < 4.0 * typical:
        return np.zeros(0, dtype=np.intp)
    r = out.robust_residuals(f.basis, f.white)
    return out.far_out(r, leverage)


def _leave_out(case: _Case, bad: IntArray) -> _Case:
    rows = case.rows[without_rows(len(case.rows), bad)]
    plain = fit(case.model, rows, (), case.model.start, {}, case.whiten)
    return _Case(case.model, rows, case.whiten, plain, case.values, case.columns)


def _explain(case: _Case) -> _Explanation:
    """Find the sets of causes, and structure that none of them makes."""
    plain = case.plain
    n_all = len(case.model.readings)
    taken = case.columns if len(case.rows) == n_all else [x[:, case.rows] for x in case.columns]
    candidates = Candidates(taken, plain.basis)
    found = search(candidates, plain.white)
    nothing, named = found[-1], found[:-1]
    alarm_cause = _Alarm.of_causes(candidates, plain)
    # Which readings to leave out is a choice of its own, and takes half of the level.
    level = CAUSE_LEVEL if len(case.rows) == n_all else CAUSE_LEVEL / 2
    demanded = (
        bool(named)
        and not case.exact(plain)
        and (
            named[0].score < nothing.score - 2 * WITHIN
            or (alarm_cause.p < level and alarm_cause.holds(level))
        )
    )
    best = named[0] if demanded else nothing
    extended = _fit_set(case, candidates, best) if demanded else plain

    dictionary = Dictionary(case.model, case.rows)
    dictionary.columns = _whiten_rows(case, dictionary.columns)
    terms: list[tuple[str, float]] = []
    alarm_scan = _Alarm.of_terms(dictionary, extended)
    if not case.exact(extended) and (
        (alarm_scan.p < SCAN_LEVEL and alarm_scan.holds(SCAN_LEVEL))
        or (len(best.members) > 1 and _one_term_score(dictionary, plain) < best.score)
    ):
        best, terms, extended = _with_terms(case, candidates, dictionary, extended, taken)
        demanded = bool(best.members)
        named = [best] if terms else [f for f in named if f.members != best.members]
        named = named if terms else [best, *named]

    sets = []
    if demanded:
        for f in named:
            if f.score <= best.score + WITHIN:
                distance = max(f.score - best.score, 0.0)
                sets += [(m, distance, f.rss) for m in _expand(candidates, f)]
        if not terms:
            sets += _behind(case, candidates, best.score, sets)
            sets.sort(key=lambda s: s[1])
    note, p_rest = _rest(case, extended)
    alarm = min(1.0, 0.05 * min(alarm_cause.p / CAUSE_LEVEL, alarm_scan.p / SCAN_LEVEL, p_rest))
    price = best.score - plain.dof * np.log(max(best.rss, TINY))
    return _Explanation(extended, best.rss, price, sets, terms, alarm, candidates, note)


def _behind(
    case: _Case, c: Candidates, best: float, sets: Sequence[tuple[dict[int, int], float, float]]
) -> list[tuple[dict[int, int], float, float]]:
    """Sets that explain the data as well with one more effect beside them, of a size that matters.

    Nothing demands the effect, but the others take its share where it is there: a tool that wears
    while it heats up looks like one that heats up less and sooner. The size is supposed and not
    fitted, so that it costs no penalty.
    """
    known = {frozenset(m) for m, _, _ in sets}
    out: dict[frozenset[int], tuple[dict[int, int], float, float]] = {}
    hidden = {j for j, effect in enumerate(case.effects) if effect.least is not None}
    for j, effect in enumerate(case.effects):
        if effect.least is None:
            continue
        change = np.asarray(effect.change(effect.least), dtype=np.float64)
        white = np.asarray(case.whiten(change))[case.rows]
        own = white - case.plain.basis @ (case.plain.basis.T @ white)
        for times in BEHIND:
            for f in search(c, case.plain.white - times * own)[:-1]:
                if f.score > best + WITHIN:
                    break
                for members in _expand(c, f):
                    with_it = frozenset(members) | {j}
                    # Where it can take another's place, that is said already.
                    swapped = any(with_it > k and j in k and len(with_it - k) == 1 for k in known)
                    if j in members or with_it in known or swapped:
                        continue
                    one = ({**members, j: 0}, max(f.score - best, 0.0), f.rss)
                    if with_it not in out or one[1] < out[with_it][1]:
                        out[with_it] = one
    # A set that holds a smaller one of the kind says it again.
    small = [k for k in (*known, *out) if k & hidden]
    fresh = [one for with_it, one in out.items() if not any(with_it > k for k in small)]
    return sorted(fresh, key=lambda one: one[1])


@dataclass
class _Alarm:
    """A test of all candidates (or all terms) together, for residuals of a fit.

    ``p``: the smallest F-test p-value times the count of candidates. Where it is not beyond doubt
    the residuals are permuted: F tests of many columns, some of which rest on a few readings, are
    too sure of themselves when the noise has heavy tails.
    """

    gains: Callable[[Array], Array]
    rank: IntArray
    weight: Array  # independent places of each block
    count: float
    fit: Fit
    p: float = 1.0

    @classmethod
    def of_causes(cls, c: Candidates, f: Fit) -> "_Alarm":
        return cls(c.gains, c.rank, c.places, max(c.multiplicity, 1.0), f).measured()

    @classmethod
    def of_terms(cls, d: Dictionary, f: Fit) -> "_Alarm":
        rank = d.gains(f.white, f.basis)[1]
        n = len(d.terms)
        return cls(lambda r: d.gains(r, f.basis)[0], rank, np.ones(n), max(n, 1), f).measured()

    def measured(self) -> "_Alarm":
        """Fill in p."""
        if len(self.rank) and self.fit.rss > 0:
            gain = self.gains(self.fit.white)
            self.p = min(1.0, self.count * float(self._smallest(gain[:, None], self.fit.rss)[0]))
        return self

    def _smallest(self, gain: Array, rss: Array | float) -> Array:
        """Smallest p-value, times its places, of each column of gains (b, s)."""
        out = np.ones(gain.shape[1])
        for k, w in np.unique(np.stack([self.rank, self.weight]), axis=1).T:
            if k < 1 or k >= self.fit.dof:
                continue
            top = gain[(self.rank == k) & (self.weight == w)].max(axis=0)
            d2 = max(self.fit.dof - int(k), 1)
            left = np.maximum(rss - top, 1e-14 * np.asarray(rss))
            out = np.minimum(out, w * special.fdtrc(k, d2, top / k / (left / d2)))
        return out

    def holds(self, level: float) -> bool:
        """Whether it stands against permutations of the residuals."""
        if self.p < BEYOND_DOUBT:
            return True
        rng = np.random.default_rng(PERMUTATION_SEED)
        q = self.fit.basis
        leverage = np.einsum("ij,ij->i", q, q)
        even = self.fit.white / np.sqrt(np.maximum(1.0 - leverage, 0.05))
        r = rng.permuted(np.tile(even, (PERMUTATIONS, 1)), axis=1).T
        r = r - q @ (q.T @ r)
        rss = np.einsum("ij,ij->j", r, r)
        chance = self._smallest(self.gains(r), rss) * self.count
        return (1 + int(np.sum(chance <= self.p))) <= level * (PERMUTATIONS + 1)


def _whiten_rows(case: _Case, columns: Array) -> Array:
    """Whiten columns given for the readings in use; they come back with unit length."""
    n = len(case.model.readings)
    if len(case.rows) == n:
        white = np.asarray(case.whiten(columns))
    else:
        full = np.zeros((n, columns.shape[1]))
        full[case.rows] = columns
        white = np.asarray(case.whiten(full))[case.rows]
    return white / lengths(white)


def _fit_set(case: _Case, c: Candidates, f: Found) -> Fit:
    """Fit a set exactly, from the variants that the search chose."""
    chosen = [(int(c.owner[b]), int(c.variant[b])) for b in f.blocks]
    chosen = [(j, v) for j, v in chosen if j < len(case.effects)]
    return fit(
        case.model,
        case.rows,
        [case.effects[j] for j, _ in chosen],
        case.plain.nuisance,
        {case.effects[j].id: case.values[j][v] for j, v in chosen},
        case.whiten,
    )


def _term_price(d: Dictionary, rank: IntArray) -> Array:
    """Penalty of terms, on the scale of the penalties of causes."""
    level = SCAN_LEVEL / max(len(d.terms), 1)
    return np.asarray(special.chdtri(np.maximum(rank, 1), level) + NAMELESS)


def _one_term_score(d: Dictionary, plain: Fit) -> float:
    """Score of the best single term on the plain model."""
    gain, rank = d.gains(plain.white, plain.basis)
    m = plain.dof
    left = np.maximum(plain.rss - gain, 1e-14 * plain.rss)
    price = _term_price(d, rank) * m / np.maximum(m - rank - 1, 1)
    return float(np.min(np.where(rank > 0, m * np.log(left) + price, np.inf), initial=np.inf))


def _with_terms(
    case: _Case,
    c: Candidates,
    d: Dictionary,
    extended: Fit,
    taken: Sequence[Array],
) -> tuple[Found, list[tuple[str, float]], Fit]:
    """Let structure without a name compete with the causes."""
    plain = case.plain
    picked: list[int] = []
    for f in (extended, plain):
        gain, rank = d.gains(f.white, f.basis)
        value = _evidence(d, gain, rank, f)
        per: dict[tuple[str, str], int] = {}
        for i in np.argsort(-value):
            t = d.terms[int(i)]
            key = (t.covariate, t.kind)
            if per.get(key, 0) < 2 and int(i) not in picked:
                per[key] = per.get(key, 0) + 1
                picked.append(int(i))
            if sum(per.values()) >= MOST_TERMS:
                break
    count = len(case.effects)
    own = np.zeros(count)
    both = Candidates(
        [*taken, *(d.block(i)[None] for i in picked)],
        plain.basis,
        own_level=np.append(own, np.full(len(picked), SCAN_LEVEL / max(len(d.terms), 1))),
        own_price=np.append(own, np.full(len(picked), NAMELESS)),
    )
    top = search(both, plain.white)[0]
    causes = Found(
        frozenset(m for m in top.members if m < count),
        top.score,
        top.rss,
        top.columns,
        tuple(b for b in top.blocks if both.owner[b] < count),
    )
    fitted = _fit_set(case, both, causes)
    if causes.members == top.members and _Alarm.of_terms(d, fitted).p >= SCAN_LEVEL:
        return _same(c, both, causes), [], fitted
    # Quantities that explain the unnamed part about as well, best first
    gain, rank = d.gains(fitted.white, fitted.basis)
    value = _evidence(d, gain, rank, fitted)
    sentences: dict[str, tuple[str, float]] = {}
    for i in np.argsort(-value):
        if value[i] < value.max() - WITHIN or len(sentences) >= 3:
            break
        t = d.terms[int(i)]
        share = min(1.0, float(gain[i] / max(fitted.rss, TINY)))
        sentences.setdefault(t.covariate, (t.sentence(), share))
    return _same(c, both, causes), list(sentences.values()), fitted


def _same(c: Candidates, other: Candidates, f: Found) -> Found:
    """Return a set found among other candidates with its blocks numbered as in c."""
    key = {(int(o), int(v)): i for i, (o, v) in enumerate(zip(c.owner, c.variant, strict=True))}
    blocks = tuple(key[int(other.owner[b]), int(other.variant[b])] for b in f.blocks)
    return Found(f.members, f.score, f.rss, f.columns, blocks)


def _evidence(d: Dictionary, gain: Array, rank: IntArray, f: Fit) -> Array:
    """Drop of -2 ln L of each term less its penalty."""
    left = np.maximum(f.rss - gain, 1e-14 * f.rss)
    drop = f.dof * np.log(max(f.rss, TINY) / np.maximum(left, TINY))
    return np.asarray(np.where(rank > 0, drop - _term_price(d, rank), -np.inf))


def _rest(case: _Case, f: Fit) -> tuple[str | None, float]:
    """Test the scatter against repeats and the stated noise: note, p in units of its level."""
    note, worst = None, np.inf
    repeats = case.model.replicates
    if repeats is not None:
        labels = np.asarray(repeats)[case.rows]
        _, group = np.unique(labels[labels >= 0], return_inverse=True)
        w = f.white[labels >= 0]
        if len(w):
            count = np.bincount(group)
            mean = np.bincount(group, w) / count
            pure = float(np.sum((w - mean[group]) ** 2))
            dof_pure = int(len(w) - len(count))
            dof_rest = f.dof - dof_pure
            if dof_pure > 2 and dof_rest > 0 and pure > 0:
                ratio = (f.rss - pure) / dof_rest / (pure / dof_pure)
                p = float(special.fdtrc(dof_rest, dof_pure, max(ratio, 0.0)))
                worst = min(worst, p / REPEAT_LEVEL)
                if p < REPEAT_LEVEL:
                    note = (
                        f"repeats agree to {np.sqrt(pure / dof_pure):.3g}, but the model misses "
                        f"their means by {np.sqrt(max(ratio, 0)):.2g} times that; no recorded "
                        "quantity explains it"
                    )
    sigma = case.model.readings.sigma
    if sigma is not None and note is None:
        s = np.asarray(sigma)[case.rows]
        chi2 = float(np.sum((f.residuals[case.rows] / s) ** 2))
        p = float(special.chdtrc(f.dof, chi2))
        worst = min(worst, p / SCATTER_LEVEL)
        if p < SCATTER_LEVEL:
            note = (
                f"the scatter is {np.sqrt(chi2 / f.dof):.2g} times the stated noise; no "
                "recorded quantity explains it"
            )
    return note, worst


def _expand(c: Candidates, f: Found) -> list[dict[int, int]]:
    """List all sets that a set of leaders stands for: candidate and its variant."""
    out: list[dict[int, int]] = [{}]
    for b in f.blocks:
        alike = c.alike[int(c.owner[b])]
        out = [{**o, i: int(c.variant[b])} for o in out for i in alike]
    return out[:MOST_ALTERNATIVES]


def _report(case: _Case, e: _Explanation, dropped: IntArray) -> Diagnosis:
    model, f = case.model, e.fit
    ids = [x.id for x in model.effects]
    alternatives: list[Alternative] = []
    for members, distance, rss in e.sets:
        s = frozenset(ids[m] for m in members)
        if all(s != a.causes for a in alternatives):
            rms = np.sqrt(max(rss, 0.0) / max(len(f.white), 1))
            start = {ids[m]: case.values[m][v] for m, v in members.items()}
            alternatives.append(Alternative(s, float(distance), float(rms), start))
    n = len(model.readings)
    keep = without_rows(n, dropped)
    rows = np.flatnonzero(keep)
    plain = case.plain if len(rows) == n else fit(model, rows, (), model.start, {}, case.whiten)
    unexplained = _unexplained(e)
    if unexplained is not None:
        verdict = "unexplained"
    elif len(alternatives) > 1:
        verdict = "ambiguous"
    elif alternatives or len(dropped):
        verdict = "explained"
    else:
        verdict = "consistent"
    if verdict == "consistent":
        f = plain
    variance = f.rss / max(f.dof, 1)
    causes = _causes(case, e, f, variance, alternatives)
    outlier_rows = sorted({int(r) for r in model.readings.rows[dropped]})
    std, std_all = (_errors_std(model, of, variance) for of in (f, case.plain))
    names = [x.name for x in model.nuisance]
    gain = _gain(model, rows, plain, f, case.whiten)
    sigma = float(np.sqrt(variance))
    if not isinstance(model.readings.unit, str):
        # Where units are mixed the fit is in units of the noise of each reading.
        sigma = gain.rms_after_um * float(np.sqrt(len(rows) / max(f.dof, 1)))
    invisible = {ids[i] for i in e.candidates.invisible if i < len(ids)}
    said = invisible.union(f.effects, *(a.causes for a in alternatives))
    return Diagnosis(
        verdict=verdict,  # type: ignore[arg-type]
        causes=causes,
        evidence=tuple(alternatives),
        gain=gain,
        unexplained=unexplained,
        errors_before=model.location_errors(case.plain.nuisance, {}),
        errors_after=model.location_errors(f.nuisance, f.effects),
        errors_std=std,
        outliers=tuple(outlier_rows),
        not_identifiable={
            **{
                k: LOST if np.isfinite(std_all[k]) else UNSEEN
                for k, s in std.items()
                if np.isinf(s)
            },
            **{x: ABSORBED for x in ids if x in invisible},
        },
        model=model.extended(f.nuisance, f.effects, _uncertainty(model, f, variance, sigma)),
        p_value=e.alarm,
        sigma=sigma,
        nuisance_before=dict(zip(names, map(float, case.plain.nuisance), strict=True)),
        nuisance_after=dict(zip(names, map(float, f.nuisance), strict=True)),
        units={x.name: x.unit for x in model.nuisance},
        labels={x.id: x.label for x in model.effects if x.id in said},
        residuals=Residuals.of(
            model, case.plain.residuals, f.residuals, rows, f.nuisance, f.effects
        ),
    )


def _errors_std(model: Model, f: Fit, variance: float) -> dict[str, float]:
    """Return standard errors of the machine's errors that are nuisance parameters themselves."""
    known = model.location_errors(f.nuisance, f.effects)
    std = f.std() * np.sqrt(variance)
    return {x.name: float(s) for x, s in zip(model.nuisance, std, strict=False) if x.name in known}


def _uncertainty(model: Model, f: Fit, variance: float, sigma: float) -> Uncertainty:
    names = (*(x.name for x in model.nuisance), *(f"{i}.{name}" for i, name in f.names))
    std = f.std() * np.sqrt(variance)
    return Uncertainty(
        names,
        dict(zip(names, map(float, std), strict=True)),
        f.covariance * variance,
        sigma,
        f.dof,
    )


def _unexplained(e: _Explanation) -> str | None:
    if e.terms:
        (first, share), *others = e.terms
        text = f"the residual depends on {first}: {100 * share:.0f} % of its variance"
        if others:
            text += "; equally consistent with " + " or ".join(s for s, _ in others)
        return text
    return e.note


def _causes(
    case: _Case, e: _Explanation, f: Fit, variance: float, alternatives: list[Alternative]
) -> tuple[Cause, ...]:
    p = len(case.model.nuisance)
    named = alternatives[0].causes if alternatives else frozenset()
    c = e.candidates
    ids = [x.id for x in case.effects]
    out = []
    for effect in case.effects:
        if effect.id not in f.effects:
            continue
        at = [p + i for i, (name, _) in enumerate(f.names) if name == effect.id]
        b = np.array([f.effects[effect.id][q.name] for q in effect.parameters])
        std = f.std()[at] * np.sqrt(variance)
        linear = np.array([q.linear for q in effect.parameters])
        cov = f.covariance[np.ix_(at, at)][np.ix_(linear, linear)]
        size = np.sqrt(np.maximum(np.diag(cov), TINY))
        inverse = np.linalg.pinv(cov / np.outer(size, size), rcond=1e-8, hermitian=True)
        wald = float(b[linear] / size @ inverse @ (b[linear] / size))
        k = int(np.linalg.matrix_rank(inverse, hermitian=True))
        d = max(f.dof, 1)
        places = 1.0
        owned = np.flatnonzero(c.owner == ids.index(effect.id))
        if len(owned):
            places = float(c.places[owned[0]])
        pv = float(special.fdtrc(max(k, 1), d, wald / max(k, 1) / max(variance, TINY)))
        aliases = sorted(
            {
                next(iter(a.causes - named))
                for a in alternatives[1:]
                if len(a.causes) == len(named) and named - a.causes == {effect.id}
            }
        )
        names = [q.name for q in effect.parameters]
        out.append(
            (
                wald,
                Cause(
                    effect.id,
                    dict(zip(names, map(float, b), strict=True)),
                    dict(zip(names, map(float, np.where(std >= 0, std, np.inf)), strict=True)),
                    min(1.0, pv * c.multiplicity * places),
                    tuple(aliases),
                    effect.label,
                ),
            )
        )
    out.sort(key=lambda t: -t[0])
    return tuple(cause for _, cause in out)


def _gain(
    model: Model, rows: IntArray, plain: Fit, f: Fit, whiten: Callable[[Array], Array]
) -> Gain:
    """Residual rms fitted and held out, on the readings that are no outliers."""
    before = plain.residuals[rows]
    after = f.residuals[rows]
    units, index = units_of(model.readings)
    return Gain.of(
        before,
        after,
        _held_out(model, rows, plain, whiten),
        _held_out(model, rows, f, whiten),
        units,
        index[rows],
    )


def _rms(r: Array) -> float:
    return float(np.sqrt(np.mean(r * r)))


def _held_out(model: Model, rows: IntArray, f: Fit, whiten: Callable[[Array], Array]) -> Array:
    """Errors of the readings of each group, predicted from all other groups, shape (m,).

    Linear in the parameters about the fit. What the other groups cannot see of the nuisance (the
    ball centre of a set-up that is left out) is fitted to the group itself; what they cannot see
    of an effect stays zero.
    """
    groups = np.asarray(model.groups)[rows]
    p = len(model.nuisance)
    raw = f.jacobian[rows]
    white = whiten(f.jacobian)[rows]
    own = np.zeros(raw.shape[1])
    own[p:] = [f.effects[i][name] for i, name in f.names]
    y_raw = f.residuals[rows] + raw @ own  # to first order: what the effects leave to explain
    y = whiten(f.residuals)[rows] + white @ own
    scale = lengths(white)
    white, raw = white / scale, raw / scale
    gram = white.T @ white
    rhs = white.T @ y
    frame = _frame(gram[:p, :p])
    miss = np.empty(len(rows))
    for g in np.unique(groups):
        held = groups == g
        a = white[held]
        matrix = gram - a.T @ a
        b = rhs - a.T @ y[held]
        seen, unseen = _pseudo_inverse(frame.T @ matrix[:p, :p] @ frame)
        seen, unseen = frame @ seen @ frame.T, frame @ unseen
        cross = matrix[:p, p:]
        rest = matrix[p:, p:] - cross.T @ seen @ cross
        effect = _pseudo_inverse(rest)[0] @ (b[p:] - cross.T @ seen @ b[:p])
        beta = np.concatenate([seen @ (b[:p] - cross @ effect), effect])
        if unseen.shape[1]:
            own_n = a[:, :p] @ unseen
            beta[:p] += unseen @ np.linalg.lstsq(own_n, y[held] - a @ beta, rcond=1e-6)[0]
        miss[held] = y_raw[held] - raw[held] @ beta
    return miss


def _frame(gram: Array) -> Array:
    """Directions in which all readings together see a unit, however weakly they see it.

    What a part of them sees is then judged by the share that it keeps.
    """
    w, v = np.linalg.eigh(gram)
    seen = w > ROUNDING * w.max(initial=0.0)
    return np.asarray(v[:, seen] / np.sqrt(w[seen]))


def _pseudo_inverse(matrix: Array) -> tuple[Array, Array]:
    """Inverse over what is seen of a Gram matrix of unit columns, and a basis of what is not."""
    if not matrix.size:
        return matrix, matrix
    w, v = np.linalg.eigh(matrix)
    seen = w > VISIBLE**2
    return (v[:, seen] / w[seen]) @ v[:, seen].T, v[:, ~seen]
