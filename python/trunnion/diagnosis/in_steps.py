"""Sets of causes weighed by the probability of readings in steps.

Where the noise is small beside the step a reading says that the machine lay within half a step of
it, and nothing more. A sum of squares says otherwise: a bow of the slope of a guideway, read in
steps of its own size, is exactly a kink, which leaves nothing, while the bow that was there leaves
a twelfth of a squared step at each place, though it rounds to the same readings. And what moves
readings by less than a step may be seen by where they change from one step to the next. Sets near
the best, each cause alone and none are therefore scored anew, by the probability of the readings
(:func:`trunnion.base.rounded.log_probability`) in place of the sum of squares. What noise gains by
a cause is gained here too, and what rounding alone would gain is not: it costs no more. Causes of
different prices that round to the same readings are all named, at equal odds: none of them can gain
more.
"""

from dataclasses import replace
from operator import itemgetter
from typing import TypeAlias

import numpy as np

from trunnion.base.errors import DataError, KinematicsError
from trunnion.base.rounded import Place, gained, log_of, log_probability
from trunnion.base.units import Floats
from trunnion.diagnosis.candidates import NAMING_LEVEL
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.fit import Fit, variant_columns
from trunnion.diagnosis.of_some import OfSome
from trunnion.diagnosis.scorer import cost
from trunnion.diagnosis.selection import WITHIN, Search
from trunnion.diagnosis.terms import Competing
from trunnion.diagnosis.whitening import identity

Blocks: TypeAlias = tuple[int, ...]

MAX_NOISE = 0.15  # of a reading, in steps, from which sums of squares say most of it
PLACES = 3  # values of nonlinear parameters, of each cause, that are tried
SAME = 1.0  # of ln P, by which readings do not tell two sets
REACH = 12.0  # above the best score, from which sets are as good as impossible
MOST = 40  # sets of several causes that are tried


def by_probability(case: Case, searched: Search, picked: tuple[Competing, ...] = ()) -> Search:
    """Score the sets of a search by the probability of readings in steps, where that says more.

    ``picked``: terms of structure that are candidates after the causes.
    """
    if not _says_more(case, searched):
        return searched
    columns = _Columns(case, searched, picked)
    logs, scores = dict[Blocks, float](), dict[Blocks, float]()
    most = np.inf
    for price, blocks in _priced(searched):
        if price > most:  # no probability is above one
            continue
        logs[blocks] = columns.log_probability(blocks)
        scores[blocks] = price - 2.0 * logs[blocks]
        most = min(most, scores[blocks] + REACH)
    if not scores or (len(scores) == 1 and not searched.top.members):
        return searched
    best, alike = min(scores, key=scores.__getitem__), set[Blocks]()
    for blocks, score in scores.items():
        named = len(blocks) <= len(best) and score < scores[()] - WITHIN
        if named and logs[blocks] > logs[best] - SAME:
            scores[blocks] = min(score, scores[best] + WITHIN)
            alike.add(blocks)
    return searched.scored(scores, alike)


def chance_as_read(case: Case, searched: Search) -> float:
    """Probability that sound readings gain as much by some cause; 1: sums of squares say it.

    What a cause costs is gained by chance at the level at which it is named, and what is gained
    beyond it, over all places (:func:`trunnion.base.rounded.gained`), with the tail of chi².
    Squares see no gain by where readings change from step to step.
    """
    top, nothing = searched.top, searched.nothing
    if not searched.more or not top.members or top.score >= nothing.score:
        return 1.0
    columns = _Columns(case, searched, ())
    gain = 2.0 * (columns.log_probability(top.blocks) - columns.log_probability(()))
    over_all = gained(columns.left, columns.always, columns.of(top.blocks), columns.step)
    beyond = nothing.score - top.score - gain + over_all
    return min(NAMING_LEVEL * float(np.exp(-beyond / 2)), 1.0)


def as_read(case: Case, f: Fit) -> tuple[Fit, bool]:
    """Return a fit at the middle of all machines that were read so, with their covariance (kept).

    And whether readings say where these lie: not where rounding is as good as random. The middle
    lies nearer to the machine than least squares, for which readings that share their errors of
    rounding are many. Where what was read is no more probable there (a model is no straight line
    that far) the fit stays, with how far the middle is off.
    """
    place, variance = case.place(f), float(case.floor.noise(f.rss, f.dof))
    if place is None or variance <= 0:
        return f, False
    if f not in case.read:
        case.read[f] = _in_the_middle(case, f, place, variance)
    return case.read[f], True


def _in_the_middle(case: Case, f: Fit, place: Place, variance: float) -> Fit:
    """The same, at a place; ``variance``: of a white reading."""
    assert case.grid is not None
    moved, rows = place.along @ place.at, case.rows
    first = len(f.nuisance)
    effects = {name: Values(values) for name, values in f.effects.items()}
    for (effect, parameter), more in zip(f.names, moved[first:].tolist(), strict=True):
        effects[effect][parameter] += more
    nuisance = f.nuisance + moved[:first]
    covariance = place.along @ place.covariance @ place.along.T
    step = case.grid.step[rows]
    try:
        residuals = case.model.readings.values - case.model.predict(nuisance, effects)
        after = log_of(residuals[rows], step, place.noise)
    except (DataError, KinematicsError):  # no machine: a shift of 12 mm half a second later
        after = -np.inf
    if not after >= log_of(f.residuals[rows], step, place.noise):
        return replace(f, covariance=(covariance + np.outer(moved, moved)) / variance)
    return replace(
        f,
        nuisance=nuisance,
        effects=effects,
        residuals=residuals,
        covariance=covariance / variance,
    )


def _says_more(case: Case, searched: Search) -> bool:
    """Whether readings are in steps, and what the best set leaves is little beside them."""
    grid = case.grid
    if grid is None or not case.by_reading:
        return False
    c, every = searched.c, searched.nothing.rss
    left = [(f.rss, f.columns) for f in searched.known.values()]
    left += [(every - gain, int(k)) for gain, k in zip(_gains(searched), c.rank, strict=True)]
    least = min(rss / max(c.dof - k, 1) for rss, k in left)
    return bool(least - grid.rounding < MAX_NOISE**2 * grid.rounding * 12)


def _priced(s: Search) -> list[tuple[float, Blocks]]:
    """No cause, each alone at its best places, and the best sets of several, with their prices."""
    c, gain = s.c, _gains(s)
    paid = np.isfinite(c.penalty)
    sets: list[Blocks] = [(), tuple(map(int, np.flatnonzero(c.penalty == 0)))]
    for j in np.unique(c.owner[paid]).tolist():
        own = np.flatnonzero((c.owner == j) & paid)
        sets += [(int(b),) for b in own[np.argsort(-gain[own])[:PLACES]]]
    near = sorted((f for f in s.known.values() if len(f.members) > 1), key=lambda f: f.score)
    sets += [f.blocks for f in near[:MOST] if np.all(paid[list(f.blocks)])]
    out = []
    for blocks in dict.fromkeys(sets):
        b = list(blocks)
        rank = int(c.rank[b].sum())
        if rank < c.dof - 2:
            by_noise = float(np.sum(c.penalty[b] - (c.inflation[b] - 1.0) * c.chance[b]))
            out.append((float(cost(by_noise, rank, c.dof)), blocks))
    return sorted(out, key=itemgetter(0))


def _gains(s: Search) -> Floats:
    """What each block alone explains of the squared residuals, shape (b,)."""
    gain = np.zeros(len(s.owner))
    for _, blocks, columns in s.c.by_rank:
        gain[blocks] = np.sum(s.residual[columns] ** 2, axis=1)
    return gain


class _Columns:
    """Columns of sets of blocks as they are read, not white, beside what is always fitted."""

    def __init__(self, case: Case, s: Search, picked: tuple[Competing, ...]) -> None:
        self.case, self.c, self.picked = case, s.c, picked
        assert case.grid is not None
        self.step: Floats = case.grid.step[case.rows]
        self.left: Floats = case.plain.residuals[case.rows]
        self.always: Floats = case.plain.jacobian[case.rows]
        self._known: dict[int, Floats] = {}

    def of(self, blocks: Blocks) -> Floats:
        """Columns of what is always fitted and of a set, shape (n, p + k)."""
        return np.concatenate([self.always, *map(self._block, blocks)], axis=1)

    def log_probability(self, blocks: Blocks) -> float:
        """Log of the probability of what was read, beside a set."""
        return log_probability(self.left, self.of(blocks), self.step)

    def _block(self, block: int) -> Floats:
        if block not in self._known:
            j, v = int(self.c.owner[block]), int(self.c.variant[block])
            self._known[block] = (
                self._cause(j, v) if j < len(self.case.effects) else self._term(j, v)
            )
        return self._known[block]

    def _cause(self, j: int, v: int) -> Floats:
        case, effect = self.case, self.case.effects[j]
        some = [case.values[j][v]]
        columns = variant_columns(case.model, effect, case.plain.nuisance, some)[0]
        return np.asarray(columns[case.rows])

    def _term(self, j: int, v: int) -> Floats:
        term = self.picked[j - len(self.case.effects)]
        white = self.case.whiten is identity
        of = self.case.dictionary if white else self.case.dictionary_as_read
        found = of.variants(*term)
        return found.made(v, len(self.always)) if isinstance(found, OfSome) else found[v]
