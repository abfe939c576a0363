"""One style for every picture: colours, sizes, numbers with units.

The colours are those of Okabe and Ito (2008), which readers with any colour vision tell apart; each
has enough contrast on white and on black. Text, frames and grids take the colours of the theme.
"""

from __future__ import annotations

import numpy as np

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"
AMBER, SKY, PURPLE = "#e69f00", "#56b4e9", "#cc79a7"
GREY = "#808080"
CYCLE = (BLUE, ORANGE, GREEN, PURPLE, AMBER, SKY)
BODY = "#9fb4c4"
"""Solid things: artefact, part, table."""

MAGNITUDES = "viridis"
"""Colour map of sizes from zero up; readable in grey and without colour vision."""


def round_number(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above a number."""
    if value <= 0 or not np.isfinite(value):
        return 1.0
    power = 10.0 ** np.floor(np.log10(value) + 1e-12)
    return float(max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-12)) * power)
