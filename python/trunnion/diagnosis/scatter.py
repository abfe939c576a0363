"""Readings of some directions may scatter more than others.

A probe repeats otherwise along its stylus than across it, an axis otherwise than another, a level
along otherwise than across. With one noise for all, the quiet readings weigh too little, scatter of
the loud ones is taken for causes and outliers, and uncertainties are those of neither. The
directions are those in which a disturbance enters the readings (`Model.components`): a reading that
feels the components c_k of independent disturbances has the variance sum of c_k² v_k.

What an explanation leaves says how much each direction scatters (:mod:`trunnion.base.scatter`). The
likelihood of all readings then says whether the explanation found with these weights is better.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import special

from trunnion.base.scatter import LEVEL, MIN_FREEDOM, variances_by_direction
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.ways import directions
from trunnion.diagnosis.whitening import Scaling


@dataclass(frozen=True, eq=False)
class Scatter(Scaling):
    """Divide each reading by its own scatter.

    ``sizes``: of each direction, in units of the rms of all readings.
    """

    sizes: Mapping[str, float]


@dataclass(frozen=True)
class Directions:
    """Shares with which readings feel the variance of each direction, (n, k), and their names."""

    names: tuple[str, ...]
    shares: Floats

    @classmethod
    def of(cls, model: Model) -> "Directions | None":
        """Return those of a model's readings; None: all feel the same."""
        ways = directions(model.components)
        felt = {k: np.square(c) for k, c in ways.items() if np.ptp(np.abs(c)) > 0}
        used = {k: c for k, c in felt.items() if c.sum() >= MIN_FREEDOM}
        if len(used) < 2 or np.any(sum(used.values()) == 0):
            return None
        shares = np.stack(list(used.values()), axis=1)
        return cls(tuple(used), shares) if np.linalg.matrix_rank(shares) == len(used) else None

    def scatter(self, case: Case, f: Fit, rows: Integers) -> Scatter | None:
        """Return the scatter that a fit of a case leaves; None: directions that are all alike.

        ``rows``: readings that the fit used.
        """
        left = f.white * case.whiten.scale[rows] if isinstance(case.whiten, Scatter) else f.white
        free = 1.0 - np.einsum("ij,ij->i", f.basis, f.basis)
        return self.of_residuals(left, free, rows, case.floor.variance)

    def of_residuals(
        self, left: Floats, free: Floats, rows: Integers, least: float = 0.0
    ) -> Scatter | None:
        """Return the scatter of residuals; None: directions that are all alike.

        ``left``, ``free``: residual of each of ``rows``, and the share of it that the fit leaves
        free. ``least``: variance. The mean square of all readings is 1.
        """
        found = variances_by_direction(self.shares[rows], left, free, least)
        if found is None:
            return None
        mean = float(np.mean(self.shares @ found))
        sizes = dict(zip(self.names, np.sqrt(found / mean).tolist(), strict=True))
        return Scatter(np.sqrt(self.shares @ found / mean), sizes)


def price(case: Case, rows: Integers) -> float:
    """What the weights of a case cost, of -2 ln L, for the readings used; 0 without weights."""
    if not isinstance(case.whiten, Scatter):
        return 0.0
    weights = 2.0 * case.plain.dof * float(np.mean(np.log(case.whiten.scale[rows])))
    return weights + float(special.chdtri(len(case.whiten.sizes) - 1, LEVEL))
