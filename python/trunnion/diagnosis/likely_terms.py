"""Terms of structure that are likely in what is left, taken one by one as causes are."""

import numpy as np
from scipy.linalg import orth

from trunnion.base.resolution import Floor
from trunnion.base.units import Floats
from trunnion.diagnosis.columns import ROUNDING
from trunnion.diagnosis.functions import DEPENDENT
from trunnion.diagnosis.scan import UNNAMED_TERM_PENALTY, Dictionary


def beside_a_term(
    d: Dictionary, white: Floats, basis: Floats, floor: Floor
) -> tuple[float, int, int | None]:
    """Sum of squares that the likeliest term leaves of white residuals, its degrees of freedom.

    And its number. Of residuals (n,) that no term explains better than causes and chance do: their
    own. One term, as a diagnosis states one: further ones would take from the noise what causes are
    judged by. ``basis``: of what is fitted, orthonormal (n, q).
    """
    rss, dof = float(white @ white), len(white) - basis.shape[1]
    gain, rank = d.gains(white, basis)
    left = np.maximum(rss - gain, ROUNDING * rss)
    chance = d.chance_of(rank) + UNNAMED_TERM_PENALTY
    worth = floor.deviance(rss, dof) - floor.deviance(left, dof) - chance
    worth[(rank < 1) | (rank >= dof)] = -np.inf
    if np.max(worth, initial=-np.inf) <= 0:
        return rss, dof, None
    best = int(np.argmax(worth))
    return float(left[best]), dof - int(rank[best]), best


def terms_one_by_one(
    d: Dictionary, white: Floats, basis: Floats, floor: Floor, most: int
) -> tuple[list[tuple[int, float]], Floats, Floats]:
    """Numbers of terms that are likely one after the other, at most so many, each with its share.

    Of what those before it leave of white residuals (n,). Then what all leave, and the basis with
    them, orthonormal (n, q).
    """
    found: list[tuple[int, float]] = []
    while len(found) < most and (number := beside_a_term(d, white, basis, floor)[2]) is not None:
        block, before = d.block(number), float(white @ white)
        own = orth(block - basis @ (basis.T @ block), rcond=float(np.sqrt(DEPENDENT)))
        white, basis = white - own @ (own.T @ white), np.concatenate([basis, own], axis=1)
        found.append((number, 1.0 - float(white @ white) / before))
    return found, white, basis
