"""The diagram of ISO 230-2: deviations at the targets from both directions, its figures marked."""

from __future__ import annotations

from typing import Any

import numpy as np

from trunnion.base.units import Floats
from trunnion.data.iso230_2 import Iso2302, Iso2302Rotary
from trunnion.data.positioning import Positioning
from trunnion.plot.picture import Axis, Picture, Series, band, line, points
from trunnion.plot.style import GREEN, MUTED, PURPLE, SENSES

FIGURES = {
    "A": "accuracy",
    "E": "systematic",
    "M": "mean_systematic",
    "R": "repeatability",
    "B": "reversal",
}
BRACKET = 0.015  # half width of the ends, of the length of the axis
ROOM = 0.2
"""Of the length of the axis, for brackets at its right end."""


def plot_positioning(
    results: Iso2302 | Iso2302Rotary | Positioning, *, ax: Any = None, **style: Any
) -> Any:
    """Draw mean deviations with ± 2 s from each direction, and mark A, E, M, R and B."""
    return positioning_picture(results).draw(ax, height=4.6, **style)


def positioning_picture(results: Iso2302 | Iso2302Rotary | Positioning) -> Picture:
    """Return the diagram; brackets show the figures where they are largest."""
    r = results.iso230_2() if isinstance(results, Positioning) else results
    unit = "arcsec" if isinstance(r, Iso2302Rotary) else "µm"
    place = "°" if isinstance(r, Iso2302Rotary) else "mm"
    at = np.asarray(r.targets)
    up, down = r.mean_forward, r.mean_backward
    mean = (up + down) / 2
    paths = (
        (up, 2 * r.spread_forward, "forward ↑"),
        (down, 2 * r.spread_backward, "backward ↓"),
    )
    series: list[Series] = []
    for m, s, label in paths:
        colour = SENSES[label]
        series += [
            band(at, m - s, m + s, colour=colour, opacity=0.15),
            line(at, m, colour=colour),
            points(at, m, f"{label}, mean ± 2 s", colour=colour),
        ]
    series.append(line(at, mean, "mean of both", colour=PURPLE, dash="dash"))
    low = np.minimum(up - 2 * r.spread_forward, down - 2 * r.spread_backward)
    high = np.maximum(up + 2 * r.spread_forward, down + 2 * r.spread_backward)
    spans, notes = _figures(at, (up, down, mean), (low, high))
    for level in (low.min(), high.max()):
        ends = [at[0], at[-1] + ROOM * float(np.ptp(at))]
        series.append(line(ends, [level, level], colour=MUTED, dash="dot", width=1.0))
    return Picture(
        ", ".join(f"{letter} = {_value(r, name, unit)}" for letter, name in FIGURES.items()),
        Axis("Target position", place),
        Axis("Deviation", unit),
        (*series, *spans),
        notes_at=tuple(notes),
    )


def _value(r: Any, figure: str, unit: str) -> str:
    return f"{getattr(r, f'{figure}_{r.unit_name()}'):.3g} {unit}"


def _figures(
    at: Floats, means: tuple[Floats, ...], zone: tuple[Floats, Floats]
) -> tuple[list[Series], list[tuple[float, float, str]]]:
    """Brackets and words of A, E, M at the right, of R and B where they are largest."""
    up, down, mean = means
    low, high = zone
    length = float(np.ptp(at))
    both = np.concatenate([up, down])
    worst_r, worst_b = int(np.argmax(high - low)), int(np.argmax(np.abs(up - down)))
    ends = [
        ("A", at[-1] + 0.16 * length, low.min(), high.max(), MUTED),
        ("E", at[-1] + 0.11 * length, both.min(), both.max(), MUTED),
        ("M", at[-1] + 0.06 * length, mean.min(), mean.max(), PURPLE),
    ]
    if (high - low)[worst_r] > 0:
        place = at[worst_r] - 0.018 * length
        ends.append(("R", place, low[worst_r], high[worst_r], GREEN))
    if up[worst_b] != down[worst_b]:
        place = at[worst_b] + 0.018 * length
        pair = sorted((up[worst_b], down[worst_b]))
        ends.append(("B", place, pair[0], pair[1], GREEN))
    spans, notes = [], []
    for letter, x, bottom, top, colour in ends:
        spans.append(_bracket(float(x), float(bottom), float(top), BRACKET * length, colour))
        notes.append((float(x), float(top), letter))
    return spans, notes


def _bracket(x: float, low: float, high: float, half: float, colour: str) -> Series:
    path_x = [x - half, x + half, x, x, x - half, x + half]
    path_y = [low, low, low, high, high, high]
    return line(path_x, path_y, colour=colour, width=1.4)
