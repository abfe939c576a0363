"""Pictures of a diagnosis, and the page that goes into a workshop's records."""

import html
import io
from string import Template

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from trunnion.base.errors import InputError
from trunnion.base.units import Floats as Array
from trunnion.diagnosis.model import Covariate, Model
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.words import opening, table, unit

__all__ = ["page", "plot_diagnosis", "plot_residuals"]

BEFORE, AFTER, OUT = "#c1272d", "#1f5fa8", "#7a7a7a"
BINS = 16
JITTER = 0.006


def plot_diagnosis(d: Diagnosis, *, ax: Axes | None = None, cause: str | None = None) -> Axes:
    """Draw residuals before and after against what a cause (the strongest) depends on.

    Readings that the cause does not change are drawn pale.
    """
    model = _model(d)
    if cause is None:
        cause = d.causes[0].id if d.causes else None
    change = _change(d, model, cause)
    if change is None:
        covariate = _named_covariate(d, model)
        touched = np.ones(len(model.readings), dtype=bool)
        title = "What is left" if d.verdict == "consistent" else "What the model does not explain"
    else:
        touched = np.abs(change) > 0.02 * np.max(np.abs(change))
        covariate = _covariate_of(change[touched], model, touched)
        title = f"{cause}: residuals before and after"
    axes = plot_residuals(d, covariate, touched=touched, ax=ax)
    axes.set_title(title)
    return axes


def plot_residuals(
    d: Diagnosis,
    covariate: Covariate,
    *,
    touched: NDArray[np.bool_] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw residuals before and after against one covariate; outliers as crosses at the edge."""
    model = _model(d)
    ax = _axes(ax)
    n = len(model.readings)
    strong = np.ones(n, dtype=bool) if touched is None else touched
    kept = np.zeros(n, dtype=bool)
    kept[d.kept] = True
    x, ticks = _positions(covariate)
    spread = np.ptp(x[kept]) or 1.0
    limit = 1.15 * np.max(
        np.abs(np.concatenate([d.residuals_before[kept], d.residuals_after[kept]]))
    )
    limit = limit or 1.0
    few = len(np.unique(x)) < 0.5 * n
    series = [
        ("before", d.residuals_before, BEFORE, -1.0),
        ("after", d.residuals_after, AFTER, 1.0),
    ]
    if d.verdict == "consistent":
        series = [("residual", d.residuals_after, AFTER, 0.0)]
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
        edge = np.clip(d.residuals_before[~kept], -limit, limit)
        ax.plot(x[~kept], edge, "x", ms=6, color=OUT, label="left out (at the edge)")
    ax.axhline(0, color="black", lw=0.6)
    ax.set_ylim(-1.05 * limit, 1.05 * limit)
    u = f" ({unit(d)})" if unit(d) else ""
    ax.set_ylabel(f"residual{u}")
    c = f" ({covariate.unit})" if covariate.unit else ""
    ax.set_xlabel(f"{covariate.name}{c}")
    if ticks is not None:
        ax.set_xticks(np.arange(len(ticks)), ticks, rotation=60 if max(map(len, ticks)) > 4 else 0)
    ax.grid(alpha=0.25, lw=0.5)
    ax.legend(frameon=False, fontsize="small", ncols=3, loc="upper right")
    return ax


def _model(d: Diagnosis) -> Model:
    if d.source is None:
        raise InputError("this diagnosis has no model to draw residuals of")
    return d.source


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    figure = Figure(figsize=(7, 3.6), layout="constrained")
    return figure.add_subplot()


def _change(d: Diagnosis, model: Model, cause: str | None) -> Array | None:
    """Return what one named effect changes in each reading."""
    if cause is None or cause not in d.effects:
        return None
    without = {k: v for k, v in d.effects.items() if k != cause}
    return np.asarray(
        model.predict(d.nuisance_after, d.effects) - model.predict(d.nuisance_after, without)
    )


def _positions(v: Covariate) -> tuple[Array, list[str] | None]:
    if not v.classes:
        return np.asarray(v.values, dtype=np.float64), None
    labels, index = np.unique(v.values, return_inverse=True)
    return index.astype(np.float64), [str(x) for x in labels]


def _share(y: Array, v: NDArray[np.generic]) -> float:
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


def _covariate_of(change: Array, model: Model, rows: NDArray[np.bool_]) -> Covariate:
    """Return the covariate that tells most of how a change varies."""
    best, top = model.covariates[0], -np.inf
    sizes = np.abs(change)
    for v in model.covariates:
        values = np.asarray(v.values)[rows]
        if len(np.unique(values)) < 2:
            continue
        share = max(_share(change, values), _share(sizes, values) if np.ptp(sizes) > 0 else 0.0)
        if share > top + 0.02:
            best, top = v, share
    return best


def _named_covariate(d: Diagnosis, model: Model) -> Covariate:
    text = d.unexplained or ""
    named = [v for v in model.covariates if v.name in text]
    if named:
        return min(named, key=lambda v: text.index(v.name))
    ordered = [v for v in model.covariates if v.sequence]
    return ordered[0] if ordered else model.covariates[0]


def _svg(figure: Figure) -> str:
    buffer = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "trunnion"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


_PAGE = Template(
    """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>Diagnosis: $verdict</title>
<style>
body { font-family: system-ui, sans-serif; max-width: 52rem; margin: 2rem auto; padding: 0 1rem;
       color: #1a1a1a; line-height: 1.45; }
h1 { font-size: 1.4rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
table { border-collapse: collapse; } td { padding: .15rem 1.2rem .15rem 0; vertical-align: top; }
tr:nth-child(even) { background: #f4f4f4; }
svg { max-width: 100%; height: auto; }
</style>
</head>
<body>
<h1>Diagnosis: $verdict</h1>
$words
<h2>Pictures</h2>
$pictures
<h2>Numbers</h2>
<table>$rows</table>
<p>$method</p>
</body>
</html>
"""
)

_METHOD = (
    "Sets of causes are compared by -2 ln L, penalised for their size; every set within 6 of the "
    "best is listed. Held out: each group of readings predicted from the others. "
    "± is one standard error."
)


def page(d: Diagnosis) -> str:
    """Write the diagnosis as one HTML page with its pictures inside."""
    model = _model(d)
    figures: list[Figure] = []
    shown: list[str | None] = [c.id for c in d.causes[:4]]
    for cause in shown or [None]:
        ax = plot_diagnosis(d, cause=cause)
        figures.append(ax.figure)  # type: ignore[arg-type]
    order = next((v for v in model.covariates if v.sequence), None)
    if order is not None:
        ax = plot_residuals(d, order)
        ax.set_title("All readings in order")
        figures.append(ax.figure)  # type: ignore[arg-type]
    return _PAGE.substitute(
        verdict=html.escape(d.verdict),
        words="\n".join(f"<p>{html.escape(line)}</p>" for line in opening(d).splitlines()),
        pictures="\n".join(f"<figure>{_svg(f)}</figure>" for f in figures),
        rows="\n".join(
            f"<tr><td>{html.escape(a)}</td><td>{html.escape(b)}</td></tr>" for a, b in table(d)
        ),
        method=_METHOD,
    )
