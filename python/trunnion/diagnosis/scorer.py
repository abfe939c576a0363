"""What a set of causes is scored by: -2 ln L and what its size costs (:mod:`.selection`)."""

import numpy as np

from trunnion.base.resolution import Floor
from trunnion.base.units import Floats, Integers

SCORE_DIGITS = 6
BANNED = 1e100  # of a penalty, which is infinite for a cause that no set may have
MAX_BEYOND = 0.9  # of the series of the penalty, where it does not converge


def cost(penalty: Floats | float, columns: Integers | int, dof: int) -> Floats:
    """What m ln(RSS / RSS(S)) gains with the chance with which chi² gains the penalties."""
    size = dof - np.asarray(columns) / 2 - 1.0
    beyond = (columns - 2) * (np.minimum(penalty, BANNED) + columns + 2) / (24.0 * size**2)
    return np.asarray(penalty * dof / size / (1.0 - np.minimum(beyond, MAX_BEYOND)))


class Scorer:
    """-2 ln L of a set, penalised for its size."""

    def __init__(self, dof: int, floor: Floor, least: float) -> None:
        self.dof = dof
        self.floor = floor
        self.least = least  # of a sum of squares: rounding

    def __call__(
        self, rss: Floats | float, columns: Integers | int, penalty: Floats | float
    ) -> Floats:
        """Score of sets of these sums of squares, counts of columns and sums of penalties."""
        score = self.floor.deviance(np.maximum(rss, self.least), self.dof)
        full = columns > self.dof - 2
        score = score + cost(penalty, np.minimum(columns, self.dof - 2), self.dof)
        # Sets that explain the same are ordered by the catalogue, not by rounding.
        return np.where(full, np.inf, np.round(score, SCORE_DIGITS))
