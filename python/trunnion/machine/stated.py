"""What is known of a parameter before anything is measured: a certificate, a temperature."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trunnion.base.report import rough
from trunnion.base.units import Floats

CONTRADICTION_SIGMAS = 3.0
MIN_GAINED = 1e-3
"""Share of the stated variance below which readings have nothing to say of it."""


class Stated(NamedTuple):
    """A parameter is zero within a standard uncertainty, as `what` states."""

    what: str
    std: float


def conditioned(
    values: Floats, covariance: Floats, stated: Mapping[int, float]
) -> tuple[Floats, Floats]:
    """Estimates and covariance with what is stated of some of them, uncorrelated with readings.

    stated: Standard uncertainty about zero, by place. Exact where readings are linear.
    """
    for place, std in stated.items():
        gain = covariance[:, place] / (std**2 + covariance[place, place])
        values = values - gain * values[place]
        covariance = covariance - np.outer(gain, covariance[place])
    return values, covariance


def contradiction(name: str, value: float, std_error: float, stated: Stated) -> str | None:
    """Say that an estimate, made with what is stated of it, is far from that; None: it is not."""
    # Of what is known beforehand, the part that the readings have determined.
    gained = stated.std**2 - std_error**2
    off = abs(value) / np.sqrt(gained) if gained > MIN_GAINED * stated.std**2 else 0.0
    if off <= CONTRADICTION_SIGMAS:
        return None
    return (
        f"The readings contradict the {stated.what}: {name} = {rough(value, 3)}, stated as 0 ± "
        f"{stated.std:g} (1 σ), {off:.1f} standard deviations away."
    )
