"""Scatter of touches by the direction of their approach, in the uncertainty of estimates.

The estimates are those of all touches alike, and right on average; how far they are off depends on
which touches scatter. Without a stated repeatability the residuals say it.
"""

from __future__ import annotations

import numpy as np

from trunnion.base.scatter import variances_by_direction
from trunnion.base.statistics import basis_of_all
from trunnion.base.units import Floats
from trunnion.data.touches import Touches
from trunnion.probing.model import steps_um
from trunnion.setup.parts import Setup

NO_SCATTER_UM = 1e-3  # scatter that is none


def scatter_um(
    setup: Setup, data: Touches, jacobian: Floats, residuals_um: Floats
) -> tuple[Floats, str] | None:
    """Standard deviation of each touch (n,), and it in words; None: touches that scatter alike.

    None, too, where steps are what limits touches. ``jacobian`` (n, p), ``residuals_um`` (n,): of a
    least-squares fit of all touches alike, where the set-up does not state their repeatability.
    """
    shares = np.square(data.direction)
    felt = shares.sum(axis=0) > 0
    if felt.sum() < 2:
        return None
    basis = basis_of_all(jacobian)
    free = 1.0 - np.einsum("ij,ij->i", basis, basis)
    found = variances_by_direction(shares[:, felt], residuals_um, free, NO_SCATTER_UM**2)
    if found is None or np.sqrt(found.min()) < np.max(steps_um(setup, data), initial=0.0):
        return None
    names = np.array(["X", "Y", "Z"])[felt]
    sizes = ", ".join(f"{k} {size:.2g} µm" for k, size in zip(names, np.sqrt(found), strict=True))
    note = f"Touches scatter by direction (1 σ): {sizes}. The uncertainties allow for it."
    return np.sqrt(shares[:, felt] @ found), note
