"""Pictures of a diagnosis."""

from textwrap import fill
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from trunnion.base.errors import InputError
from trunnion.base.units import Flags, Floats
from trunnion.diagnosis.model import Covariate
from trunnion.diagnosis.records import Residuals
from trunnion.diagnosis.result import Diagnosis
from trunnion.plot.axes import axes_or_new

BEFORE, AFTER, OUT = "#c1272d", "#1f5fa8", "#7a7a7a"
BINS = 16
JITTER = 0.006
MAX_CAUSES = 4
TITLE_WIDTH = 60  # characters a line


def plot_diagnosis(d: Diagnosis, *, ax: Axes | None = None, cause: str | None = None) -> Axes:
    """Draw residuals before and after against what a cause (the strongest) depends on.

    Readings that the cause does not change are drawn pale.
    """
    record = _record(d)
    if cause is None:
        cause = d.causes[0].id if d.causes else None
    change = None if cause is None else record.changes.get(cause)
    if change is None:
        covariate = _named_covariate(d, record)
        touched = np.ones(len(record.values), dtype=bool)
        title = "Residuals" if d.verdict == "consistent" else "What the model does not explain"
    else:
        touched = np.abs(change) > 0.02 * np.max(np.abs(change))
        covariate = _covariate_of(change[touched], record, touched)
        label = next((c.called() for c in d.causes if c.id == cause), cause)
        title = f"{label}: residuals before and after"
    axes = plot_residuals(d, covariate, touched=touched, ax=ax)
    axes.set_title(fill(title, TITLE_WIDTH))
    return axes


def plot_residuals(
    d: Diagnosis,
    covariate: Covariate,
    *,
    touched: Flags | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw residuals before and after against one covariate; outliers as crosses at the edge."""
    record = _record(d)
    ax = cast(Axes, axes_or_new(ax))
    n = len(record.values)
    strong = np.ones(n, dtype=bool) if touched is None else touched
    kept = record.kept
    x, ticks = _positions(covariate)
    spread = np.ptp(x[kept]) or 1.0
    limit = 1.15 * np.max(np.abs(np.concatenate([record.before[kept], record.after[kept]])))
    limit = limit or 1.0
    few = len(np.unique(x)) < 0.5 * n
    series = [
        ("before", record.before, BEFORE, -1.0),
        ("after", record.after, AFTER, 1.0),
    ]
    if d.verdict == "consistent":
        series = [("residual", record.after, AFTER, 0.0)]
    for name, r, colour, side in series:
        shift = side * JITTER * spread if few else 0.0
        for mask, alpha in ((kept & ~strong, 0.15), (kept & strong, 0.75)):
            if mask.any():
                ax.plot(
                    x[mask] + shift,
                    r[mask],
                    ".",
                    ms=5,
                    mew=0,
                    color=colour,
                    alpha=alpha,
                    label=name if mask[strong].any() else None,
                )
    if (~kept).any():
        edge = np.clip(record.before[~kept], -limit, limit)
        ax.plot(x[~kept], edge, "x", ms=6, color=OUT, label="left out (at the edge)")
    ax.axhline(0, color="black", lw=0.6)
    ax.set_ylim(-1.05 * limit, 1.05 * limit)
    ax.set_ylabel(f"residual ({record.unit})" if record.unit else "residual")
    c = f" ({covariate.unit})" if covariate.unit else ""
    ax.set_xlabel(f"{covariate.name}{c}")
    if ticks is not None:
        ax.set_xticks(np.arange(len(ticks)), ticks, rotation=60 if max(map(len, ticks)) > 4 else 0)
    ax.grid(alpha=0.25, lw=0.5)
    ax.legend(frameon=False, fontsize="small", ncols=3, loc="upper right", markerscale=2)
    return ax


def _record(d: Diagnosis) -> Residuals:
    if d.residuals is None:
        raise InputError("plot: got a diagnosis without its residuals, expected one with them")
    return d.residuals


def _positions(v: Covariate) -> tuple[Floats, list[str] | None]:
    if not v.classes:
        return np.asarray(v.values, dtype=np.float64), None
    labels, index = np.unique(v.values, return_inverse=True)
    return index.astype(np.float64), [str(x) for x in labels]


def _share(y: Floats, v: NDArray[np.generic]) -> float:
    """Share of the variance of |y| and y between bins of a covariate, less what chance gives."""
    distinct, index = np.unique(v, return_inverse=True)
    if len(distinct) > BINS:
        rank = np.argsort(np.argsort(v, kind="stable"), kind="stable")
        index = rank * BINS // len(v)
    count = np.bincount(index)
    mean = np.bincount(index, y) / np.maximum(count, 1)
    total = float(np.sum((y - y.mean()) ** 2))
    between = float(np.sum(count * (mean - y.mean()) ** 2))
    bins = int(np.sum(count > 0))
    if total <= 0 or len(y) <= bins:
        return 0.0
    return 1 - (1 - between / total) * (len(y) - 1) / (len(y) - bins)


def _covariate_of(change: Floats, record: Residuals, rows: Flags) -> Covariate:
    """Return the covariate that says most of how a change varies."""
    best, top = record.covariates[0], -np.inf
    sizes = np.abs(change)
    for v in record.covariates:
        values = np.asarray(v.values)[rows]
        if len(np.unique(values)) < 2:
            continue
        share = max(_share(change, values), _share(sizes, values) if np.ptp(sizes) > 0 else 0.0)
        if share > top + 0.02:
            best, top = v, share
    return best


def _named_covariate(d: Diagnosis, record: Residuals) -> Covariate:
    text = d.unexplained or ""
    named = [v for v in record.covariates if v.name in text]
    if named:
        return min(named, key=lambda v: text.index(v.name))
    ordered = [v for v in record.covariates if v.sequence]
    return ordered[0] if ordered else record.covariates[0]


def diagnosis_figures(d: Diagnosis) -> list[Figure]:
    """Return the pictures of its page: residuals by cause, then all readings in order."""
    record = _record(d)
    shown: list[str | None] = [c.id for c in d.causes[:MAX_CAUSES]]
    axes = [plot_diagnosis(d, cause=cause, ax=_own_axes()) for cause in shown or [None]]
    order = next((v for v in record.covariates if v.sequence), None)
    if order is not None:
        axes.append(plot_residuals(d, order, ax=_own_axes()))
        axes[-1].set_title("All readings in order")
    return [cast(Figure, ax.figure) for ax in axes]


def _own_axes() -> Axes:
    """Return axes of a figure that no window knows."""
    return Figure(figsize=(7, 3.6), layout="constrained").add_subplot()
