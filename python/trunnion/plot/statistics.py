"""Pictures of statistics: residuals in order and against the noise, correlations, shares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import ndtri

from trunnion.base.units import Floats, Integers
from trunnion.plot.picture import (
    BLUE,
    MUTED,
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


def order_picture(
    residuals: Floats,
    unit: str,
    *,
    rows: Integers | None = None,
    hover: Sequence[str] = (),
    title: str = "Residuals in the order of measurement",
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
            points(at, residuals, "reading", rows=rows, hover=tuple(hover)),
            line(ends, [two, two], "± 2 rms", colour=MUTED, dash="dash"),
            line(ends, [-two, -two], colour=MUTED, dash="dash"),
        ),
    )


def normal_picture(
    residuals: Floats, unit: str, *, rows: Integers | None = None, hover: Sequence[str] = ()
) -> Picture:
    """Quantiles of residuals (n,) against those of normal noise: a straight line if they are."""
    order = np.argsort(residuals, kind="stable")
    n = len(order)
    expected = ndtri((np.arange(n) + 0.5) / max(n, 1))
    size = float(np.std(residuals)) if n else 0.0
    mean = float(np.mean(residuals)) if n else 0.0
    ends = np.array([expected[0], expected[-1]]) if n else np.zeros(2)
    texts = tuple(hover[i] for i in order) if hover else ()
    mine = None if rows is None else rows[order]
    return Picture(
        "Residuals against normal noise",
        Axis("Quantile of normal noise", "σ"),
        Axis("Residual", unit),
        (
            points(expected, residuals[order], "reading", rows=mine, hover=texts),
            line(ends, mean + size * ends, "normal noise", colour=PURPLE, dash="dash"),
        ),
        note="Points on the line: the residual is normal noise; ends that leave it: outliers.",
    )


def correlation_picture(names: Sequence[str], covariance: Floats) -> Picture:
    """Correlation of k estimates, covariance (k, k), as a map with the names."""
    size = np.sqrt(np.diag(covariance))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    correlation = covariance * np.outer(scale, scale)
    axis = Axis(names=tuple(names))
    upper = np.triu(np.abs(correlation), 1)
    first, second = map(int, np.unravel_index(int(np.argmax(upper)), upper.shape))
    strongest = f"{names[first]} and {names[second]}: {correlation[first, second]:+.2f}"
    return Picture(
        "Correlation of the estimates",
        axis,
        axis,
        (heat(correlation),),
        Kind.MAP,
        note=f"Strongest: {strongest.replace('-', '−')}. Near ±1 the data hardly tell them apart.",
    )


def ranked_picture(
    title: str, names: Sequence[str], values: Sequence[float], unit: str, label: str
) -> Picture:
    """Bars with names, in the order given."""
    return Picture(title, Axis(label, unit), Axis(names=tuple(names)), (bars(values, colour=BLUE),))


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
        Axis("error", unit),
        Axis(names=tuple(known)),
        tuple(series),
    )
