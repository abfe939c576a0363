"""Pictures of statistics: residuals in order and against the noise, correlations, shares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from trunnion.base.units import Floats, Integers
from trunnion.plot.picture import (
    BLUE,
    MUTED,
    PALETTE,
    PURPLE,
    VERMILLION,
    Axis,
    Kind,
    Picture,
    Series,
    bars,
    heat,
    line,
    points,
)

MAX_CODE = 6
"""Characters of names that are codes."""
ROOM = 0.14
"""Of the length of the longest bar, for the number beside it."""

NORMAL = "Are the residuals normal noise?"


def order_picture(
    residuals: Floats,
    unit: str,
    *,
    rows: Integers | None = None,
    title: str = "Residuals, in the order of measurement",
) -> Picture:
    """Residuals (n,) one after the other, with ± 2 standard deviations."""
    n = len(residuals)
    at = np.arange(1, n + 1, dtype=np.float64)
    two = 2 * float(np.sqrt(np.mean(residuals**2))) if n else 0.0
    ends = np.array([1.0, max(n, 2)])
    return Picture(
        title,
        Axis("Reading, in the order of measurement"),
        Axis("Residual", unit),
        (
            points(at, residuals, "reading", rows=rows),
            line(ends, [two, two], "± 2 standard deviations", colour=MUTED, dash="dash"),
            line(ends, [-two, -two], colour=MUTED, dash="dash"),
        ),
    )


def normal_picture(
    residuals: Floats, unit: str, *, rows: Integers | None = None, title: str = NORMAL
) -> Picture:
    """Quantiles of residuals (n,) against those of normal noise: a straight line if they are."""
    order = np.argsort(residuals, kind="stable")
    n = len(order)
    expected = ndtri((np.arange(n) + 0.5) / max(n, 1))
    size = float(np.std(residuals)) if n else 0.0
    mean = float(np.mean(residuals)) if n else 0.0
    ends = np.array([expected[0], expected[-1]]) if n else np.zeros(2)
    mine = None if rows is None else rows[order]
    return Picture(
        title,
        Axis("Expected of normal noise", "standard deviations"),
        Axis("Residual", unit),
        (
            points(expected, residuals[order], "reading", rows=mine),
            line(ends, mean + size * ends, "normal noise", colour=PURPLE, dash="dash"),
        ),
        note="Points on the line: they are; ends that leave the line: outliers.",
    )


def correlation_picture(names: Sequence[str], covariance: Floats) -> Picture:
    """Correlation of k estimates, covariance (k, k), as a map with the names."""
    size = np.sqrt(np.diag(covariance))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    correlation = covariance * np.outer(scale, scale)
    down = across = tuple(names)
    said = ""
    if max(map(len, names)) > MAX_CODE:  # words are longer than a row is high: below, by number
        numbered = [(str(k), name) for k, name in enumerate(names, 1)]
        down = tuple(f"{k} {name}" if len(name) <= MAX_CODE else k for k, name in numbered)
        across = tuple(k for k, _ in numbered)
        said = f" {'; '.join(f'{k}: {name}' for k, name in numbered if len(name) > MAX_CODE)}."
    upper = np.triu(np.abs(correlation), 1)
    first, second = map(int, np.unravel_index(int(np.argmax(upper)), upper.shape))
    strongest = f"{names[first]} and {names[second]}: {correlation[first, second]:+.2f}"
    return Picture(
        "Correlation of the estimates",
        Axis(names=across),
        Axis(names=down),
        (heat(correlation),),
        Kind.MAP,
        note=f"Strongest: {strongest.replace('-', '−')}. Near ±1 the data hardly distinguish them."
        f"{said}",
    )


def bars_picture(
    title: str,
    label: str,
    unit: str,
    values: Mapping[str, float],
    *,
    std: Mapping[str, float] | None = None,
    digits: int = 0,
    note: str = "",
) -> Picture:
    """Bars with names, in the order given; with U (k = 2) where there are standard uncertainties.

    digits: Significant ones that stand beside each bar; 0: none.
    """
    size = np.array(list(values.values()), dtype=np.float64)
    error = None if std is None else np.array([2 * std.get(name, np.nan) for name in values])
    if error is not None:
        error = np.where(np.isfinite(error), error, np.nan)
    ends = [(float(v), float(k), number_text(float(v), digits)) for k, v in enumerate(size)]
    high, low = float(np.max(size, initial=0.0)), float(np.min(size, initial=0.0))
    room = ROOM * (high - low)
    limits = (low - room * (low < 0), high + room) if digits and room > 0 else None
    return Picture(
        title,
        Axis(label, unit, limits=limits),
        Axis(names=tuple(values)),
        (bars(size, error=error),),
        note=note,
        notes_at=tuple((max(x, 0.0), y, text) for x, y, text in ends) if digits else (),
    )


def change_picture(
    title: str,
    label: str,
    unit: str,
    before: Mapping[str, float],
    after: Mapping[str, float],
    said: tuple[str, str] = ("before", "after"),
) -> Picture:
    """Bars of what was and diamonds of what is, by name; what was not known has no bar."""
    names = tuple(after)
    was = np.array([before.get(name, np.nan) for name in names], dtype=np.float64)
    now = points(
        list(after.values()),
        np.arange(len(names)),
        said[1],
        colour=VERMILLION,
        marker="diamond",
        size=7.0,
    )
    return Picture(
        title, Axis(label, unit), Axis(names=names), (bars(was, said[0], colour=BLUE), now)
    )


def percent_picture(
    title: str, label: str, names: Sequence[str], percents: Floats, series: Sequence[Series] = ()
) -> Picture:
    """Bars in percent, each with its number beside it; series: the bars, where not of one kind."""
    return Picture(
        title,
        Axis(label, "%", limits=(0.0, 110.0)),  # room for the last text
        Axis(names=tuple(names)),
        tuple(series) or (bars(percents),),
        notes_at=tuple((float(v), float(k), f"{v:.0f} %") for k, v in enumerate(percents)),
    )


def with_limit(p: Picture, at: float, label: str, **style: Any) -> Picture:
    """Return horizontal bars with a limit, a line across all of them."""
    ends = [-0.5, len(p.y.names) - 0.5]
    return replace(p, series=(*p.series, line([at, at], ends, label, **style)))


def stacked_picture(
    title: str,
    label: str,
    names: Sequence[str],
    shares: Mapping[str, ArrayLike],
    colours: Mapping[str, str] = MappingProxyType({}),
) -> Picture:
    """Shares (n,) in percent, by what they are due to, as bars one behind the other."""
    total = np.zeros(len(names))
    stacked: list[Series] = []
    for k, (name, values) in enumerate(shares.items()):
        total = total + np.asarray(values, dtype=np.float64)
        stacked.append(bars(total, name, colour=colours.get(name, PALETTE[k % len(PALETTE)])))
    x = Axis(label, "%", limits=(0.0, 100.0))
    return Picture(title, x, Axis(names=tuple(names)), tuple(reversed(stacked)))


def number_text(value: float, digits: int) -> str:
    """Return a number to so many digits, with the sign that people print."""
    return f"{value:.{max(digits, 1)}g}".replace("-", "−")


def estimates_picture(
    names: Sequence[str], values: Mapping[str, float], std: Mapping[str, float], unit: str
) -> Picture:
    """Estimates of one unit with U (k = 2); what is not identifiable is left out."""
    known = [n for n in names if np.isfinite(std.get(n, 0.0))]
    series: list[Series] = [
        bars(
            [values[n] for n in known],
            error=np.array([2 * std.get(n, 0.0) for n in known]),
            colour=VERMILLION if unit == "arcsec" else BLUE,
        )
    ]
    return Picture(
        f"Location errors with U (k = 2), {unit}",
        Axis("Location error", unit),
        Axis(names=tuple(known)),
        tuple(series),
    )
