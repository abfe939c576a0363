"""Scatter of touches by the direction of their approach, in the uncertainty of estimates.

The estimates are those of all touches alike, and right on average; how far they are off depends on
which touches scatter. Without a stated repeatability the residuals say it.
"""

from __future__ import annotations

import numpy as np

from trunnion.base.scatter import variances_by_direction
from trunnion.base.statistics import linear_fit
from trunnion.base.units import Floats
from trunnion.data.touches import Touches
from trunnion.probing.model import known_sigma_um, ticks_um
from trunnion.setup.parts import Setup

LEAST_FREEDOM = 8.0  # degrees of freedom of a direction, from which its scatter is judged
LEAST_UM = 1e-3  # scatter that is none
MIN_FREE = 1e-6


def scatter_um(
    setup: Setup, data: Touches, jacobian: Floats, residuals_um: Floats
) -> tuple[Floats, str] | None:
    """Standard deviation of each touch (n,), and it in words; None: touches that scatter alike.

    None, too, where the set-up states the repeatability, or where ticks are what limits touches.
    ``jacobian`` (n, p), ``residuals_um`` (n,): of a least-squares fit of all touches alike.
    """
    if known_sigma_um(setup, data) > 0:
        return None
    basis = linear_fit(jacobian, np.zeros(len(jacobian)), basis=True).basis
    free = 1.0 - np.einsum("ij,ij->i", basis, basis)
    shares = np.square(data.direction)
    shares = shares[:, shares.sum(axis=0) > 0]
    kept = free > MIN_FREE
    if shares.shape[1] < 2 or np.any(shares.T @ np.maximum(free, 0.0) < LEAST_FREEDOM):
        return None
    square = np.square(residuals_um[kept]) / free[kept]
    found = variances_by_direction(shares[kept], square, free[kept], LEAST_UM**2)
    if found is None or np.sqrt(found.min()) < np.max(ticks_um(setup, data), initial=0.0):
        return None
    names = np.array(["X", "Y", "Z"])[np.square(data.direction).sum(axis=0) > 0]
    sizes = ", ".join(f"{k} {size:.2g} µm" for k, size in zip(names, np.sqrt(found), strict=True))
    note = f"Touches scatter by direction (1 σ): {sizes}. The uncertainties allow for it."
    return np.sqrt(shares @ found), note
