"""Small pictures: tables of corrections, tolerances, ladders, instruments, what repeats."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trunnion.base.conformity import Conformity, Decision
from trunnion.base.errors import InputError
from trunnion.base.units import parameter_words, unit_of
from trunnion.data.iso230_2 import CompensationTable
from trunnion.diagnosis.contributions import Ladder
from trunnion.diagnosis.records import Residuals
from trunnion.machine.budget import Budget
from trunnion.machine.estimate import Estimate
from trunnion.models.instruments import InstrumentComparison
from trunnion.models.points import RepeatablePart
from trunnion.models.rotary import Circle
from trunnion.plot.picture import Axis, Picture, Series, bars, line, points
from trunnion.plot.static import draw_all
from trunnion.plot.statistics import bars_picture, number_text, stacked_picture, with_limit
from trunnion.plot.style import BLUE, GREEN, MUTED, OCHRE, PALETTE, RED, VERMILLION
from trunnion.plot.touches import estimates_pictures, plot_estimates
from trunnion.probing.result import PerPosition
from trunnion.reference.comparison import Comparison

MAX_UNITS = 4
MAX_NAMES = 24
MIN_SHARE = 0.5  # percent: smaller sources are drawn together
DECISIONS = {Decision.PASS: GREEN, Decision.FAIL: RED, Decision.UNDECIDED: OCHRE}


def plot_methods(
    result: Comparison, *, unit: str | None = None, ax: Any = None, **style: Any
) -> Any:
    """Draw what each method makes of the location errors, beside the truth where it is known."""
    return plot_estimates(result.results, result.truth, unit=unit, ax=ax, **style)


def methods_pictures(result: Comparison) -> list[Picture]:
    """Return the estimates of each method, a picture for each unit."""
    return estimates_pictures(result.results, result.truth)


def plot_estimate(
    result: Estimate, *, ax: Any = None, unit: str | None = None, **style: Any
) -> Any:
    """Draw every parameter of an estimate with U (k = 2), a panel for each unit.

    Parameters
    ----------
    result
        An estimate.
    ax
        Axes for the parameters of one unit; a new figure unless given.
    unit
        Which unit is drawn on `ax`; the first unless given.
    **style
        As :meth:`trunnion.plot.picture.Picture.draw` takes it.
    """
    pictures = estimate_pictures(result)
    if unit is not None:
        pictures = [p for p in pictures if p.x.unit == unit]
    if not pictures:
        raise InputError(f"plot_estimate: got no parameter of unit {unit!r}, expected some")
    return draw_all(pictures, ax, **style)


def estimate_pictures(result: Estimate) -> list[Picture]:
    """Return the parameters of an estimate, a picture for each unit; at most `MAX_UNITS`."""
    return values_pictures("Estimates", result.values, result.std_errors)


def values_pictures(
    title: str, values: Mapping[str, float], std: Mapping[str, float], label: str = "Value"
) -> list[Picture]:
    """Return values with U (k = 2), a picture for each unit of their names; at most `MAX_UNITS`."""
    units = list(dict.fromkeys(unit_of(name) for name in values))[:MAX_UNITS]
    found = []
    for unit in units:
        names = [n for n in values if unit_of(n) == unit and np.isfinite(std.get(n, 0.0))]
        mine = {parameter_words(name): values[name] for name in names[:MAX_NAMES]}
        two = {
            parameter_words(name): std[name] for name in names[:MAX_NAMES] if name in std
        } or None
        if mine:
            head = f"{title}, {unit}" if unit and len(units) > 1 else title
            name = f"{label} with U (k = 2)" if two else label
            found.append(bars_picture(head, name, unit, mine, std=two))
    return found


def compensation_table_picture(table: CompensationTable) -> Picture:
    """Return the corrections over the targets."""
    series: list[Series] = []
    for values, label, colour in (
        (table.forward, "forward ↑", BLUE),
        (table.backward, "backward ↓", VERMILLION),
    ):
        series += [
            line(table.targets, values, colour=colour),
            points(table.targets, values, label, colour=colour),
        ]
    place = "°" if table.position_unit == "deg" else table.position_unit
    x, y = Axis("Target position", place), Axis("Correction", table.unit)
    return Picture("What is added to commanded positions", x, y, tuple(series))


def conformity_picture(result: Conformity) -> Picture:
    """Return each quantity as a share of its tolerance."""
    names = tuple(one.label or one.name for one in result.judged)
    size = np.array([100 * abs(one.value) / one.tolerance for one in result.judged])
    two = np.array([200 * one.std_error / one.tolerance for one in result.judged])
    series: list[Series] = []
    for decision, colour in DECISIONS.items():
        mine = np.array([one.decision is decision for one in result.judged], dtype=bool)
        if mine.any():
            error = np.where(mine, two, np.nan)
            label = decision.value
            series.append(bars(np.where(mine, size, np.nan), label, colour=colour, error=error))
    x = Axis("Share with U (k = 2)", "%")
    p = Picture("Quantities against their tolerances", x, Axis(names=names), tuple(series))
    return with_limit(p, 100.0, "tolerance", colour=MUTED)


def ladder_picture(ladder: Ladder) -> Picture:
    """Return the rms of the residual after each cause."""
    names = ("without a cause", *(f"+ {ladder.labels.get(c) or c}" for c in ladder.causes))
    x = Axis("rms of the residual", ladder.unit)
    return Picture("Residual rms after each cause", x, Axis(names=names), (bars(ladder.rms_um),))


def readings_picture(record: Residuals) -> Picture:
    """Return the residuals before and after by row; outliers as crosses."""
    kept = record.kept
    series = [
        points(record.rows[kept], values[kept], label, colour=colour, opacity=0.6, size=3.5)
        for values, label, colour in (
            (record.before, "plain model", VERMILLION),
            (record.after, "with the causes", BLUE),
        )
    ]
    if not kept.all():
        out = {"colour": MUTED, "marker": "cross"}
        series.append(points(record.rows[~kept], record.before[~kept], "left out", **out))
    x, y = Axis("Data row"), Axis("Residual", record.unit)
    return Picture("Residuals before and after", x, y, tuple(series))


def instruments_picture(result: InstrumentComparison) -> Picture:
    """Return the rms of each cause, one bar an instrument."""
    rows = [(one, name) for one in result.attributions for name in one.rms]
    names = tuple(f"{one.label or one.id}, {name}" for one, name in rows)
    series: list[Series] = []
    for k, name in enumerate(result.instruments):
        mine = np.array([other == name for _, other in rows], dtype=bool)
        size = np.array([one.rms[other] for one, other in rows])
        two = np.array([2 * one.std_error.get(other, np.nan) for one, other in rows])
        values = np.where(mine, size, np.nan)
        colour = PALETTE[k % len(PALETTE)]
        series.append(bars(values, name, colour=colour, error=np.where(mine, two, np.nan)))
    x = Axis("rms with U (k = 2)", result.unit)
    return Picture("Causes by instrument", x, Axis(names=names), tuple(series))


def repeatable_picture(result: RepeatablePart) -> Picture:
    """Return the rms of what repeats and its parts, and of what does not."""
    size = result.repeatable_um
    parts = {
        "repeatable": size,
        "  named causes": size * np.sqrt(max(result.named, 0.0)),
        "  smooth field": size * np.sqrt(max(result.smooth, 0.0)),
        "  from feature to feature": size * np.sqrt(max(result.hole_by_hole, 0.0)),
        "not repeatable": result.scatter_um,
    }
    x = Axis("rms a coordinate", "µm")
    values = bars(list(parts.values()))
    return Picture("What is there again", x, Axis(names=tuple(parts)), (values,))


def circle_picture(result: Circle) -> Picture:
    """Return radial and axial distances in the order of measurement."""
    at = np.arange(1, len(result.radial_um) + 1)
    series = (
        points(at, result.radial_um, f"radial, rms {result.radial_rms_um:.3g} µm", colour=BLUE),
        points(at, result.axial_um, f"axial, rms {result.axial_rms_um:.3g} µm", colour=VERMILLION),
    )
    title = f"Distances from the circle of radius {result.radius_mm:.4f} mm"
    return Picture(title, Axis("Position, in order"), Axis("Distance", "µm"), series)


def budget_pictures(budget: Budget) -> list[Picture]:
    """Return the share of each source in the variance of each quantity, stacked."""
    known = [m for m in budget.measurands if np.isfinite(m.std) and m.std > 0][:MAX_NAMES]
    size: dict[str, float] = {}
    shares: list[dict[str, float]] = []
    for m in known:
        square = sum(one.contribution**2 for one in m.lines) or 1.0
        shares.append({one.source: 100 * one.contribution**2 / square for one in m.lines})
        for source, share in shares[-1].items():
            size[source] = max(size.get(source, 0.0), share)
    ranked = sorted(size, key=lambda source: -size[source])
    named = [s for s in ranked if size[s] >= MIN_SHARE][: len(PALETTE) - 1]
    rates = {s: np.array([one.get(s, 0.0) for one in shares]) for s in named}
    others = 100.0 - np.sum(list(rates.values()), axis=0) if rates else np.zeros(0)
    if np.any(others >= MIN_SHARE):
        rates["others"] = others
    names = tuple(
        f"{m.name}: U = {number_text(budget.coverage_factor * m.std, 2)} {m.unit}" for m in known
    )
    if not known:
        return []
    title = f"What the uncertainties are due to, k = {budget.coverage_factor:g}"
    return [stacked_picture(title, "Share of the variance", names, rates)]


def per_position_pictures(result: PerPosition) -> list[Picture]:
    """Return the estimates over the positions of C and of A, a picture for each unit."""
    found = []
    for axis, rows in (("c", result.c), ("a", result.a)):
        at = np.array([row[f"{axis}_deg"] for row in rows])
        names = [name for name in (rows[0] if rows else {}) if name != f"{axis}_deg"]
        for unit, letters in (("µm", "XYZ"), ("arcsec", "ABC")):
            series = [
                points(at, [row[name] for row in rows], name, colour=PALETTE[k], size=6.0)
                for k, name in enumerate(n for n in names if n[1] in letters)
            ]
            if series:
                title = f"Estimates at each position of {axis.upper()}, {unit}"
                x, y = Axis(f"Position of {axis.upper()}", "°"), Axis("Estimate", unit)
                found.append(Picture(title, x, y, tuple(series)))
    return found
