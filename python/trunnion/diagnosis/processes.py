"""Smooth processes that may act instead of causes of the best set, or beside it."""

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.linalg import orth

from trunnion.base.resolution import Floor
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.columns import DEPENDENT
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.probability import Beside
from trunnion.diagnosis.scan import smooth_functions
from trunnion.diagnosis.selection import REACH, WITHIN, Found, search
from trunnion.diagnosis.smooth import Along, Process
from trunnion.diagnosis.whitening import Whiten

MAX_QUANTITIES = 6  # along which there may be a process: each is compared with sets by itself
MAX_REPLACED = 5  # causes of a set, of which any number may be a process instead


def processes(case: Case, best: Found) -> list[Beside]:
    """Return smooth processes that may act instead of causes of the best set, or beside it.

    A process is weighed as a cause is: it is one among all candidates, along one of the quantities.
    """
    c, plain = case.candidates, case.plain
    few = len(case.rows) < MANY_ROWS
    sought = smooth_functions(case.model, case.rows, MAX_QUANTITIES, competing=True) if few else []
    every = [x for x in map(case.white, sought) if not c.makes_any(x, plain.basis)]
    if not every:
        return []
    price = 2.0 * float(np.log(max(c.multiplicity, 1.0) * len(every)))
    quantities = [Along(x, plain.basis, plain.white, case.floor) for x in every]
    instead, beside = (
        _likeliest(case, quantities, sets) for sets in (_replaced(best), [best.blocks])
    )
    found = [(instead, best.score + REACH), (beside, best.score + WITHIN)]
    out = []
    for (score, process, quantity), most in found[: 2 if best.blocks else 1]:
        if score + price < most:
            white = np.asarray(process.whiten(plain.white))
            searched = search(c.whitened(process.whiten), white, floor=case.floor)
            out.append(Beside(searched, process.cost + price, quantity))
    return out


def share_of_noise(
    model: Model, left: Floats, jacobian: Floats, whiten: Whiten, floor: Floor
) -> float:
    """Share of the mean square of residuals (n,) that is noise, and no smooth process.

    The likeliest process takes its part where it is likelier than that there is none.
    ``jacobian``: by what is always fitted, (n, p); ``floor``: of the variance of a white reading.
    """
    n = len(left)
    every = smooth_functions(model, np.arange(n), MAX_QUANTITIES) if n < MANY_ROWS else []
    white, fitted = whiten(left), whiten(jacobian)
    size = np.linalg.norm(fitted, axis=0)
    basis = orth(fitted[:, size > 0] / size[size > 0], rcond=DEPENDENT)
    white = white - basis @ (basis.T @ white)
    dof, rss = n - basis.shape[1], float(white @ white)
    if not every or dof < 1 or rss <= 0.0:
        return 1.0
    none = np.zeros((n, 0))
    along = (Along(np.asarray(whiten(x)), basis, white, floor).beside(none) for x in every)
    best = min(along, key=lambda process: process.deviance)
    if best.deviance + 2.0 * float(np.log(len(every))) >= float(floor.deviance(rss, dof)):
        return 1.0
    noise = np.asarray(best.whiten(white))
    return min(float(floor.noise(float(noise @ noise), dof) / floor.noise(rss, dof)), 1.0)


def _replaced(best: Found) -> list[tuple[int, ...]]:
    """Blocks of a set without some of its causes, and without all."""
    blocks, count = best.blocks, len(best.blocks)
    sizes = range(count) if count <= MAX_REPLACED else (0, count - 2, count - 1)
    return [some for k in sizes for some in itertools.combinations(blocks, k)] or [()]


def _likeliest(
    case: Case, quantities: Sequence[Along], sets: Sequence[tuple[int, ...]]
) -> tuple[float, Process, int]:
    """Return the score of the best process beside one of some sets, it, and its quantity."""
    c, found = case.candidates, []
    for blocks in sets:
        columns = [c.columns(b) for b in blocks] or [np.zeros((0, len(case.rows)))]
        fitted = np.linalg.qr(np.concatenate(columns).astype(np.float64).T)[0]
        paid = float(np.sum(c.penalty[list(blocks)]))
        made = [q.beside(fitted) for q in quantities]
        found += [(p.deviance + paid, p, i) for i, p in enumerate(made)]
    return min(found, key=lambda one: one[0])
