"""The smallest artefact for given resolutions: equation (21) of Kang, Kim and Jee (2022)."""

from __future__ import annotations

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import positive
from trunnion.base.errors import InputError
from trunnion.base.units import ARCSEC


@checked
def smallest_length_mm(linear_um: float = 0.1, rotary_arcsec: float = 0.36) -> float:
    """Smallest length of the artefact, L > λ_LR csc λ_RR (Kang, Kim and Jee 2022, equation (21)).

    One step of the linear axes across the length L tilts the artefact by λ_LR / L: from this length
    on the step of the linear axes is no coarser than that of the rotary axes. It is a rule of
    resolution alone: noise, and how many touches share it, do not enter. What the length buys with
    noise is the Cramér-Rao bound of :func:`trunnion.observability`.

    Parameters
    ----------
    linear_um
        Resolution of the linear axes, λ_LR.
    rotary_arcsec
        Resolution of the rotary axes, λ_RR.

    Returns
    -------
    float
        Length in mm; 57.3 for the paper's 0.1 µm and 0.36″.

    Raises
    ------
    InputError
        A resolution that is not a positive number, or 90° and more.

    Examples
    --------
    >>> import trunnion as tn
    >>> round(tn.smallest_length_mm(0.1, 0.36), 2)
    57.3
    """
    step_mm = positive("linear_um", linear_um) * 1e-3
    if positive("rotary_arcsec", rotary_arcsec) >= 90 * 3600:
        raise InputError(f"rotary_arcsec: got {rotary_arcsec!r}, expected less than 90°")
    return float(step_mm / np.sin(rotary_arcsec * ARCSEC))
