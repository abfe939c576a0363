"""The linear algebra of the ball-bar: which combinations of errors readings determine, how well.

Another task than `trunnion.base.statistics.linear_fit`, which scales columns and holds a parameter
for each combination that is not identifiable. Many of the hybrid machine's combinations are weak
but not empty: they are listed by strength in µm and arcsec, unscaled, and estimates take the
smallest change from the nominal machine. That needs the directions themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats

#: Relative singular values below this are zero: those that are zero come out at 1e-13 and less.
EXACT_ZERO = 1e-9
#: The same for the columns of the ball centres.
CENTRE_TOLERANCE = 1e-10
#: A parameter with a larger share than this in what is not identifiable is not identifiable.
MAX_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Singular values and directions of a design with its ball centres eliminated.

    values: Singular values, largest first, padded with zeros to one for each parameter, (k,).
    directions: Right singular vectors, one a row, (k, k).
    rank: Combinations that are identifiable: the first so many directions.
    """

    values: Floats
    directions: Floats
    rank: int

    @classmethod
    def of(cls, design: Floats, errors: int) -> Spectrum:
        """From the derivatives of the readings: `errors` columns of the errors, then the centres'.

        Readings are in units of their noise, or all of the same noise.
        """
        own, centres = design[:, :errors], design[:, errors:]
        # Orthonormal basis of the centres' columns; what they explain is taken off.
        u, s, _ = np.linalg.svd(centres, full_matrices=False)
        basis = u[:, s > CENTRE_TOLERANCE * s[0]]
        _, values, directions = np.linalg.svd(own - basis @ (basis.T @ own), full_matrices=True)
        padded = np.zeros(errors)
        padded[: len(values)] = values
        rank = int(np.sum(padded > EXACT_ZERO * max(float(padded.max(initial=0.0)), 1e-300)))
        return cls(padded, directions, rank)

    def down_to(self, minimum: float) -> Spectrum:
        """Count only combinations with at least this singular value as identifiable."""
        return Spectrum(self.values, self.directions, int(np.sum(self.values > minimum)))

    def in_terms_of(self, outer: Spectrum) -> Spectrum:
        """From the coordinates of another spectrum's identifiable combinations to parameters."""
        directions = outer.directions.copy()
        directions[: outer.rank] = self.directions @ outer.directions[: outer.rank]
        return Spectrum(np.append(self.values, outer.values[outer.rank :]), directions, self.rank)

    def direction_errors(self, sigma: float) -> Floats:
        """Standard error of each combination at this noise of a reading; inf beyond the rank."""
        errors = np.full(len(self.values), np.inf)
        errors[: self.rank] = sigma / self.values[: self.rank]
        return errors

    def covariance(self, sigma: float) -> Floats:
        """Covariance of the identifiable part, (k, k)."""
        found = self.directions[: self.rank]
        return np.asarray((found.T / self.values[: self.rank] ** 2) @ found * sigma**2)

    def std_errors(self, sigma: float) -> Floats:
        """Standard error of each parameter; inf with a share in what is not identifiable."""
        errors = np.sqrt(np.diag(self.covariance(sigma)))
        share = np.abs(self.directions[self.rank :]).max(axis=0, initial=0.0)
        return np.where(share > MAX_SHARE, np.inf, errors)


def combination(vector: Floats, names: Sequence[str], min_share: float = 0.1) -> str:
    """Return a unit vector in parameters as text, largest first, without small shares."""
    order = np.argsort(-np.abs(vector))
    kept = [k for k in order if abs(vector[k]) >= min_share] or [order[0]]
    sign = np.sign(vector[kept[0]])
    terms = [f"{sign * vector[k]:+.2f} {names[k]}" for k in kept]
    return " ".join(terms).lstrip("+").replace("-", "− ").replace(" +", " + ")
