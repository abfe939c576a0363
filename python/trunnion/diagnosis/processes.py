"""Smooth processes that may act instead of causes of the best set, or beside it."""

import itertools
from collections.abc import Iterable, Sequence

import numpy as np
from scipy.linalg import orth

from trunnion.base.resolution import Floor
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.coloured import InProcess
from trunnion.diagnosis.columns import DEPENDENT
from trunnion.diagnosis.likely_terms import beside_a_term
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.probability import Beside
from trunnion.diagnosis.quantities import Said, saying, smooth_functions
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.selection import REACH, WITHIN, Found, search
from trunnion.diagnosis.smooth import Along, Sums, mean_deviance
from trunnion.diagnosis.whitening import Whiten

MAX_QUANTITIES = 7  # along which there may be a process: each is compared with sets by itself
MAX_REPLACED = 5  # causes of a set, of which any number may be a process instead
FEW_REPLACED = 2  # of more causes at a time, or all


def processes(case: Case, best: Found, least: float) -> list[Beside]:
    """Return smooth processes that may act instead of causes of the best set, or beside it.

    ``least``: the best score of all sets, with structure too: what is far above is not searched.
    A process is weighed as a cause is: it is one among all candidates, along one of the quantities.
    """
    c, plain = case.candidates, case.plain
    every = _competing(case) if len(case.rows) < MANY_ROWS else []
    if not every:
        return []
    price = 2.0 * float(np.log(max(c.multiplicity, 1.0) * len(every)))
    quantities = [Along(x, plain.basis, plain.white, case.floor) for x in every]
    beside, *instead = _compared(case, quantities, best)
    found = [(instead, REACH), ([beside], WITHIN)] if instead else [([beside], REACH)]
    out = []
    for sets, most in found:
        score, deviances, i = min(sets, key=lambda one: one[0])
        if score + price < min(best.score + most, least + REACH):
            process = quantities[i].process(deviances)
            white = np.asarray(process.whiten(plain.white))
            searched = search(InProcess(c, process.whiten), white, floor=case.floor)
            out.append(Beside(searched, process.cost + price, i))
    return out


def _competing(case: Case) -> list[Floats]:
    """Smooth functions of quantities, white, (n, m): what a candidate makes has its name.

    Unless an error along the quantity is another one than the candidate (`Covariate.apart`).
    """
    known = case.dictionary.quantities
    if known is None:
        known = list(saying(case.model.covariates, case.model.components, case.rows))
    out: list[Floats] = []
    for apart in (False, True):
        own = [x for x in known if x.covariate.apart == apart]
        found = smooth_functions(case.model, case.rows, MAX_QUANTITIES, competing=True, known=own)
        white = map(case.white, found)
        out += [x for x in white if apart or not case.candidates.makes_any(x, case.plain.basis)]
    return out


def share_of_noise(
    model: Model,
    left: Floats,
    jacobian: Floats,
    whiten: Whiten,
    floor: Floor,
    terms: Dictionary | None,
    known: Iterable[Said] | None = None,
) -> float:
    """Share of the mean square of residuals (n,) that is noise, and no structure.

    The likeliest process takes its part where it is likelier than that there is none; else, if they
    show some of the ``terms``, the likeliest of these. ``jacobian``: by what is always fitted,
    (n, p); ``floor``: of the variance of a white reading; ``known``: what all covariates say of
    these readings, where that was asked before.
    """
    n, every = len(left), list[Floats]()
    if n < MANY_ROWS:
        every = smooth_functions(model, np.arange(n), MAX_QUANTITIES, known=known)
    white, fitted = whiten(left), whiten(jacobian)
    size = np.linalg.norm(fitted, axis=0)
    basis = orth(fitted[:, size > 0] / size[size > 0], rcond=DEPENDENT)
    white = white - basis @ (basis.T @ white)
    dof, rss = n - basis.shape[1], float(white @ white)
    if dof < 1 or rss <= 0.0:
        return 1.0
    noise = floor.noise(rss, dof)
    if every:
        none = np.zeros((n, 0))
        along = (Along(np.asarray(whiten(x)), basis, white, floor).beside(none) for x in every)
        best = min(along, key=lambda process: process.deviance)
        if best.deviance + 2.0 * float(np.log(len(every))) < float(floor.deviance(rss, dof)):
            beside = np.asarray(best.whiten(white))
            return min(float(floor.noise(float(beside @ beside), dof) / noise), 1.0)
    if terms is None:
        return 1.0
    rss, dof, _ = beside_a_term(terms, white, basis, floor)
    return min(float(floor.noise(rss, dof) / noise), 1.0)


def _compared(
    case: Case, quantities: Sequence[Along], best: Found
) -> list[tuple[float, Floats, int]]:
    """Compare processes beside the best set, and beside sets of some of its causes.

    Of each set the score of the likeliest process, -2 ln L of all along its quantity, and which
    that is. The best set is first. Of many causes some are left out at a time, or all.
    """
    c, blocks = case.candidates, best.blocks
    none, many = np.zeros((len(case.rows), 0)), len(blocks) > MAX_REPLACED
    own = _independent(c, blocks)
    columns = np.concatenate([none, *own], axis=1)
    widths = [x.shape[1] for x in own]
    whole = Sums.together([q.sums(columns) for q in quantities])
    places = np.split(np.arange(sum(widths)), np.cumsum(widths)[:-1])
    sets = _left_out(len(blocks), FEW_REPLACED if many else len(blocks))
    found = [whole.without([j for i in gone for j in places[i].tolist()]) for gone in sets]
    if many:
        nothing = Sums.together([q.sums(none) for q in quantities])
        sets.append(tuple(range(len(blocks))))
        found.append(nothing.without())
    left, log_det = (np.stack(x) for x in zip(*found, strict=True))
    deviances = quantities[0].deviances(left, log_det)
    scores, penalty = mean_deviance(deviances), c.penalty[list(blocks)]
    scores += np.array([np.sum(np.delete(penalty, gone)) for gone in sets])[:, None]
    least = np.argmin(scores, axis=1).tolist()
    return [(float(s[i]), x[i], i) for s, x, i in zip(scores, deviances, least, strict=True)]


def _independent(c: Candidates, blocks: Sequence[int]) -> list[Floats]:
    """Columns of blocks (n, k); of one that those before make in part, what they leave of it.

    A drift and a slow motion of the axis both hold a straight line where the axis turns steadily.
    """
    every = [np.asarray(c.columns(b).T, dtype=np.float64) for b in blocks]
    if not every or np.linalg.eigvalsh(c.gram(blocks))[0] > c.dependent:
        return every
    made, out = np.zeros((len(every[0]), 0)), list[Floats]()
    for own in every:
        turned, size, _ = np.linalg.svd(own - made @ (made.T @ own), full_matrices=False)
        left = turned[:, size**2 > c.dependent]
        out.append(own if left.shape[1] == own.shape[1] else left)
        made = np.concatenate([made, left], axis=1)
    return out


def _left_out(count: int, most: int) -> list[tuple[int, ...]]:
    """Which of so many causes may go, at most so many at a time; none of them first."""
    sizes = range(most + 1)
    return [gone for k in sizes for gone in itertools.combinations(range(count), k)]
