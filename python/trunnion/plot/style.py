"""One style for every picture: colours, sizes, numbers with units.

The colours of `PALETTE` are distinguished with any colour vision and have a contrast of 3:1 or more
on white and on #16181d. Text, frames and grids take the colours of the theme.
"""

from __future__ import annotations

import numpy as np

PALETTE = ("#2a7fc0", "#d95f02", "#0a9470", "#b25aa0", "#a07a00", "#c8385a", "#5f7d95")
"""Blue, vermillion, green, purple, ochre, red, slate."""
BLUE, VERMILLION, GREEN, PURPLE, OCHRE, RED, SLATE = PALETTE
MUTED = "#80868e"
SKY = "#7fb8e6"
BODY = "#9fb4c4"
"""Solid things: artefact, part, table."""
SENSES = {
    **dict.fromkeys(("counter-clockwise", "forward", "forward ↑", "towards +"), BLUE),
    **dict.fromkeys(("clockwise", "backward", "backward ↓", "towards −"), VERMILLION),
}
"""Sense of a motion → its colour, in every picture."""
DIVERGING = ("#2a7fc0", "#f3f3f3", "#d95f02")
MAGNITUDES = "viridis"
"""Colour map of sizes from zero up; readable in grey and without colour vision."""


def round_number(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above a number."""
    if value <= 0 or not np.isfinite(value):
        return 1.0
    power = 10.0 ** np.floor(np.log10(value) + 1e-12)
    return float(max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-12)) * power)


def near_number(value: float) -> float:
    """Return the number among 1, 2, 5 times a power of ten that is nearest to one above 0."""
    if value <= 0 or not np.isfinite(value):
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(min((step * power for step in (1, 2, 5, 10)), key=lambda x: abs(x - value)))
