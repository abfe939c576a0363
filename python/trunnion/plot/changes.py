"""What changed: each quantity beside its interval; of three and more measurements over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from trunnion.base.report import number
from trunnion.models.changes import MachineComparison
from trunnion.plot.picture import Axis, Picture, band, bars, line, points
from trunnion.plot.static import panels
from trunnion.plot.style import BLUE, MUTED, VERMILLION

MAX_SHOWN = 16
MAX_PANELS = 6
MIN_REACH = 1.5
REACH = 12.0  # half widths of the interval; what changed more stands at the edge


def plot_changes(comparison: MachineComparison, *, ax: Any = None, **style: Any) -> Any:
    """Draw each change in half widths of its 95 % interval: within ±1 it may be none."""
    return changes_picture(comparison).draw(ax, width=8.0, **style)


def changes_picture(comparison: MachineComparison) -> Picture:
    """Return the changes as bars, in half widths of their 95 % intervals."""
    shown = comparison.quantities[:MAX_SHOWN]
    half = np.array([(q.high - q.change) or 1.0 for q in shown])
    size = np.clip(np.array([q.change for q in shown]) / half, -REACH, REACH)
    reach = 1.15 * max(float(np.max(np.abs(size), initial=0.0)), MIN_REACH)
    digits = np.clip(1 - np.floor(np.log10(np.abs(half))), 0, 6).astype(int)
    names = tuple(
        f"{q.called}: {number(q.change, d)} {q.unit}" for q, d in zip(shown, digits, strict=True)
    )
    changed = np.array([q.changed for q in shown], dtype=bool)
    series = [band([-1.0, 1.0], [-0.6] * 2, [len(shown) - 0.4] * 2, colour=MUTED)]
    for mask, label, colour in ((changed, "changed", VERMILLION), (~changed, "may be none", MUTED)):
        if mask.any():
            series.append(bars(np.where(mask, size, np.nan), label, colour=colour))
    return Picture(
        f"Changes from {comparison.names[0]} to {comparison.names[-1]}",
        Axis("Change / half interval", limits=(-reach, reach)),
        Axis(names=names),
        tuple(series),
        note="Each change over the half width of its 95 % interval: within ±1 it may be none.",
    )


def trend_pictures(comparison: MachineComparison) -> list[Picture]:
    """Return the values over time with control limits; the changes where there are but two."""
    if not comparison.trends:
        return [changes_picture(comparison)]
    first = [q.name for q in comparison.quantities]
    trends = sorted(
        (t for t in comparison.trends if t.name in first), key=lambda t: first.index(t.name)
    )[:MAX_PANELS]
    days = np.asarray(comparison.days, dtype=np.float64)
    found = []
    for t in trends:
        values = np.asarray(comparison.values[t.name])
        std = np.asarray(comparison.std_errors[t.name])
        fitted = t.centre + t.rate * (days - days.mean())
        limits = [
            line(days, np.full_like(days, level), colour=MUTED, dash="dash")
            for level in (t.lower, t.upper)
        ]
        found.append(
            Picture(
                t.called,
                Axis("days" if comparison.dated else "measurement"),
                Axis("Value", t.unit),
                (
                    line(days, fitted, "trend", colour=VERMILLION),
                    line(days, values, colour=BLUE, width=1.0),
                    points(days, values, "value, U (k = 2)", error=2 * std),
                    *limits,
                ),
                note="Dashed: control limits.",
            )
        )
    return found


def plot_comparison(comparison: MachineComparison, *, ax: Any = None, **style: Any) -> Any:
    """Draw changes; of three and more measurements the values over time with control limits."""
    if not comparison.trends or ax is not None:
        return plot_changes(comparison, ax=ax, **style)
    return panels(trend_pictures(comparison), size=(7.5, 2.4), **style)
