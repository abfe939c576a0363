"""A model with the readings of it that are used, and what they were explained by."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trunnion.diagnosis.fit import Fit, Flags, fit
from trunnion.diagnosis.protocol import Array, Effect, IntArray, Model, Values
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.selection import Candidates

__all__ = ["Case", "Explanation", "kept_rows", "rms"]

EXACT = 1e-12  # of the largest reading: rounding


@dataclass
class Case:
    """A model and the readings of it that are used.

    Attributes
    ----------
    model, rows, whiten:
        The model, the readings that are used, and the map of all readings to white noise.
    plain:
        Fit without effects.
    values:
        Of each candidate, the parameter values of its variants.
    columns:
        Of each candidate, whitened, all readings: (v, n, k).
    """

    model: Model
    rows: IntArray
    whiten: Callable[[Array], Array]
    plain: Fit
    values: list[list[Values]]
    columns: list[Array]

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The candidates."""
        return self.model.effects

    @property
    def complete(self) -> bool:
        """Whether all readings are used."""
        return len(self.rows) == len(self.model.readings)

    @cached_property
    def candidates(self) -> Candidates:
        """The candidates beside the plain fit."""
        taken = self.columns if self.complete else [x[:, self.rows] for x in self.columns]
        return Candidates(taken, self.plain.basis)

    @cached_property
    def dictionary(self) -> Dictionary:
        """Structure without a name, whitened."""
        return Dictionary(self.model, self.rows, self.whiten)

    def white(self, column: Array) -> Array:
        """Whiten a column of all readings and take those that are used."""
        return np.asarray(self.whiten(column))[self.rows]

    def without(self, bad: IntArray) -> "Case":
        """Return the case with these readings left out as well."""
        if not len(bad):
            return self
        rows = self.rows[kept_rows(len(self.rows), bad)]
        plain = fit(self.model, rows, (), self.model.start, {}, self.whiten)
        return Case(self.model, rows, self.whiten, plain, self.values, self.columns)

    def exact(self, f: Fit) -> bool:
        """Whether a fit leaves no more than rounding: there is nothing to explain then."""
        size = float(np.max(np.abs(self.model.readings.values), initial=1.0))
        return rms(f.residuals[self.rows]) < EXACT * size


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
        Unexplained structure: sentence, share of the variance.
    alarm:
        p-value over all tests.
    note:
        What repeats or the stated noise say against the model.
    """

    fit: Fit
    rss: float
    penalty: float
    sets: list[tuple[dict[int, int], float, float]]
    terms: list[tuple[str, float]]
    alarm: float
    candidates: Candidates
    note: str | None = None


def kept_rows(n: int, bad: IntArray) -> Flags:
    """Mask of the readings that stay."""
    mask = np.ones(n, dtype=bool)
    mask[bad] = False
    return mask


def rms(r: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(r * r)))
