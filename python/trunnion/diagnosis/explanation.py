"""What readings were explained by."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.probability import Weighed
from trunnion.diagnosis.term import Term

Sets: TypeAlias = list[tuple[dict[int, int], float, float]]
"""Candidate: variant; distance to the best set; RSS."""


@dataclass
class Explanation:
    """What one choice of readings leads to.

    Attributes
    ----------
    fit, rss:
        The model with the named causes, and what they leave.
    penalty:
        Of causes and terms.
    sets:
        Candidate → variant, distance to the best set, RSS.
    terms:
        Unexplained structure, and the share of the variance; terms that say it about as well.
    alarm:
        p-value over all tests.
    probabilities:
        Of all sets that the search looked at.
    values:
        Of each candidate, the parameter values of its variants, which the sets count.
    note:
        What repeats or the stated noise say against the model.
    least:
        Sum of squares that the best set of causes leaves, as linearised.
    behind:
        Finds sets with an effect behind those of others, which only a report asks for.
    instead:
        Finds sets in which what kinds of measurement share differs instead of a named cause, too.
    assumed:
        Variance of a white reading that sets were searched with; 0: what they leave.
    """

    fit: Fit
    rss: float
    penalty: float
    sets: Sets
    terms: list[tuple[Term, float]]
    alarm: float
    candidates: Candidates
    probabilities: Weighed
    values: list[list[Values]]
    note: str | None = None
    least: float = np.inf
    behind: Callable[[], Sets] | None = None
    instead: Callable[[], Sets] | None = None
    assumed: float = 0.0
