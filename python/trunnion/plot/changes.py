"""What changed: each quantity beside its interval; of three and more measurements over time."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from trunnion.models.changes import MachineComparison
from trunnion.plot.axes import axes_or_new, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_SHOWN = 16
MOST_PANELS = 6
LABEL_WIDTH = 34
REACH = 12.0  # half widths of the interval; what changed more stands at the edge


def plot_changes(comparison: MachineComparison, *, ax: Axes | None = None) -> Axes:
    """Draw each change in half widths of its 95 % interval: within ±1 it may be none."""
    shown = comparison.quantities[:MOST_SHOWN][::-1]
    ax = axes_or_new(ax, 7.5, 1.2 + 0.3 * len(shown))
    for row, q in enumerate(shown):
        half = (q.high - q.change) or 1.0
        size = float(np.clip(q.change / half, -REACH, REACH))
        colour = "tab:red" if q.changed else "0.5"
        ax.errorbar(size, row, xerr=1.0, fmt="o", color=colour, ms=4, capsize=2)
        text = f"{q.change:+.3g} {q.unit}".replace("-", "−")
        ax.annotate(
            text, (size + 1.0, row), (6, 0), textcoords="offset points", va="center", fontsize=8
        )
    ax.axvspan(-1, 1, color="0.9", zorder=0)
    ax.set_yticks(range(len(shown)), [fill(q.called, LABEL_WIDTH) for q in shown], fontsize=8)
    ax.set_xlim(-REACH - 1.5, REACH + 5.0)
    ax.set_xlabel("change in half widths of its 95 % interval (red: changed)")
    ax.set_title(f"{comparison.names[0]} to {comparison.names[-1]}", loc="left")
    return ax


def plot_comparison(comparison: MachineComparison) -> Axes | Figure:
    """Draw changes; of three and more measurements the values over time with control limits."""
    if not comparison.trends:
        return plot_changes(comparison)
    first = [q.name for q in comparison.quantities]
    trends = sorted(
        (t for t in comparison.trends if t.name in first), key=lambda t: first.index(t.name)
    )[:MOST_PANELS]
    figure = new_figure(7.5, 1.6 * len(trends) + 0.8)
    panels: Any = figure.subplots(len(trends), 1, sharex=True, squeeze=False)
    for ax, t in zip(panels[:, 0], trends, strict=True):
        values = np.asarray(comparison.values[t.name])
        std = np.asarray(comparison.std_errors[t.name])
        ax.errorbar(comparison.days, values, yerr=2 * std, fmt="o-", ms=4, lw=1, capsize=2)
        days = np.asarray(comparison.days)
        ax.plot(days, t.centre + t.rate * (days - days.mean()), color="tab:orange", lw=1)
        for level in (t.lower, t.upper):
            ax.axhline(level, color="0.5", lw=0.8, ls="--")
        ax.set_title(t.called, loc="left", fontsize=9)
        ax.set_ylabel(t.unit)
    panels[-1, 0].set_xlabel("days" if comparison.dated else "measurement")
    return figure
