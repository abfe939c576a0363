"""Pictures of a diagnosis: each cause over what it depends on, and what the model leaves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.statistics import factor_of
from trunnion.base.units import Flags, Floats, capital, parameter_words, unit_of
from trunnion.diagnosis.joint_ids import JointId
from trunnion.diagnosis.model import Covariate, Model
from trunnion.diagnosis.records import (
    NO_CAUSE,
    WITHOUT_DATA,
    Cause,
    Residuals,
    labelled,
    percent,
    with_unit,
)
from trunnion.diagnosis.result import Diagnosis
from trunnion.machine.effects import Owner
from trunnion.machine.estimate import Estimate
from trunnion.plot.coordinates import (
    TIMES,
    Coordinate,
    Wave,
    Weight,
    coordinate_of,
    positions,
    unit_beside,
    weights_of,
)
from trunnion.plot.picture import (
    BLUE,
    GREEN,
    MUTED,
    PALETTE,
    PURPLE,
    VERMILLION,
    Axis,
    Form,
    Picture,
    Series,
    band,
    bars,
    line,
    points,
)
from trunnion.plot.statistics import NORMAL, correlation_picture, normal_picture, order_picture
from trunnion.plot.style import SENSES
from trunnion.setup.names import error_label, fitted_in_words

COVERAGE = 2.0
TOUCHED = 0.02  # of the largest change: readings that a cause changes
LIMIT = 1.15
NARROW = 0.02  # of the largest reading: a narrower band is hidden by its curve
CLASS_WIDTH = 0.3
MAX_SETS = 8
MAX_PARAMETERS = 6  # of a cause: more are a curve
MAX_CORRELATED, MIN_CORRELATED = 40, 0.3  # how many, and from which size they are drawn


def plot_diagnosis(d: Diagnosis, *, ax: Any = None, cause: str | None = None) -> Any:
    """Draw a cause (the strongest) over what it depends on, with the fitted curve and U (k = 2).

    Readings are corrected for the other causes. Without a cause: what the model leaves.
    """
    return diagnosis_picture(d, cause).draw(ax)


def diagnosis_picture(d: Diagnosis, cause: str | None = None) -> Picture:
    """Return the picture of a cause, of the strongest, or without one of the residuals."""
    if cause is None:
        return cause_picture(d, d.causes[0].id) if d.causes else residual_picture(d)
    if cause not in d.named:
        known = ", ".join(sorted(d.named)) or "none"
        raise InputError(f"cause: got {cause!r}, expected one of the named causes: {known}")
    return cause_picture(d, cause)


def plot_residuals(d: Diagnosis, covariate: Covariate, *, ax: Any = None) -> Any:
    """Draw residuals before and after against one covariate; outliers as crosses at the edge."""
    return residual_picture(d, covariate).draw(ax)


# --- a cause


@dataclass(frozen=True, eq=False)
class Explained:
    """A cause with its readings: what a picture of it needs.

    Attributes
    ----------
    d, cause
        The diagnosis and the cause.
    record
        Its readings.
    change
        What the cause changes, (n,).
    rows
        Readings drawn: used, and in the unit of most of the change, (n,).
    unit
        That unit.
    """

    d: Diagnosis
    cause: Cause
    record: Residuals
    change: Floats
    rows: Flags
    unit: str

    @classmethod
    def of(cls, d: Diagnosis, id_: str) -> Explained:
        """Return the cause of this id."""
        record = record_of(d)
        change = record.changes[id_]
        power = np.bincount(record.unit_index, change**2, len(record.units))
        unit = int(np.argmax(power / np.maximum(np.bincount(record.unit_index), 1)))
        cause = next(c for c in d.causes if c.id == id_)
        rows = record.kept & (record.unit_index == unit)
        acting = np.flatnonzero(change)
        if JointId.of(id_).happened is not None and len(acting):
            rows[: acting[0]] = rows[acting[-1] + 1 :] = False  # where it had not happened
        return cls(d, cause, record, change, rows, record.units[unit])

    @cached_property
    def model(self) -> Model | None:
        """The model of the data, None without them."""
        return self.d.rebuilt_model() if self.d.data is not None else None

    @cached_property
    def coordinate(self) -> Coordinate | None:
        """What it depends on."""
        weights = [Weight("deviation of the reading", self.unit, np.ones(len(self.change)))]
        if self.model is not None:
            nuisance = np.array(list(self.d.nuisance_after.values()))
            labels = {x.name: fitted_in_words(x.name, error_label) for x in self.model.nuisance}
            weights = weights_of(self.model, nuisance, self.unit, labels)
        return coordinate_of(
            self.change, self.record.covariates, weights, self.rows, timed=self._timed
        )

    @property
    def _timed(self) -> bool:
        """Whether it acts by time: by what it needs, what it belongs to and by its parameters."""
        needs: tuple[str, ...] = ()
        owner = Owner.MACHINE
        if self.model is not None and self.cause.id in {e.id for e in self.model.effects}:
            effect = self.model.effect(self.cause.id)
            needs, owner = effect.needs, effect.owner
        units = [unit_of(name) for name in self.cause.parameters]
        rated = any(u in TIMES or u.endswith(("/h", "/min", "/s")) for u in units)
        began = not {"row", "tau_mm"}.isdisjoint(self.cause.parameters)
        return "time_s" in needs or owner is Owner.TIME or rated or began

    def curves(self, where: Coordinate) -> list[tuple[str, Floats, Floats]]:
        """Curves of the fitted change and of its spread over what it depends on, by class."""
        wave = Wave.of(self.cause.id, self.cause.parameters)
        return where.curve(np.column_stack([self.change, self.spread]), self.rows, wave)

    @cached_property
    def spread(self) -> Floats:
        """Columns (n, k) of the fitted change by one standard uncertainty in each direction."""
        values = dict(self.cause.parameters)
        if self.model is not None and self.cause.id in {e.id for e in self.model.effects}:
            nuisance = np.array(list(self.d.nuisance_after.values()))
            effect = self.model.effect(self.cause.id)
            columns = self.model.effect_jacobian(nuisance, effect, values)
            return np.asarray(columns @ root_of(self.d, self.cause))
        return np.zeros((len(self.change), 0))


def root_of(d: Diagnosis, cause: Cause) -> Floats:
    """Root of the covariance of a cause's parameters, (k, k); of their variances alone without."""
    names = [f"{cause.id}.{name}" for name in cause.parameters]
    std = np.array([s if np.isfinite(s) else 0.0 for s in cause.std_errors.values()])
    model = d.model
    if isinstance(model, Estimate) and set(names) <= set(model.names):
        at = [model.names.index(name) for name in names]
        return factor_of(model.covariance[np.ix_(at, at)])
    return np.diag(std)


def cause_picture(d: Diagnosis, id_: str) -> Picture:
    """Readings corrected for the other causes over what this one depends on, with the fit."""
    of = Explained.of(d, id_)
    where = of.coordinate
    title = f"{capital(of.cause.label or labelled(id_, ''))}, {percent(of.cause.probability)}"
    reading = of.record.after + of.change
    if where is None:
        return _against_change(of, title, reading)
    drawn = of.rows & where.clear()
    places, names = positions(where.x)
    amount = np.divide(
        reading, where.weight.enters, out=np.zeros_like(reading), where=where.weight.enters != 0
    )
    curves = of.curves(where)
    series: list[Series] = []
    largest = float(np.abs(amount[drawn]).max(initial=0.0))
    for i, (name, x, fitted) in enumerate(curves):
        colour = SENSES.get(name, PALETTE[i % len(PALETTE)]) if len(curves) > 1 else BLUE
        mine = drawn if where.split is None else drawn & (where.split == _index(where, name))
        shift = 0.12 * np.sin(2.4 * np.arange(int(mine.sum()))) if names else 0.0
        rows = of.record.rows[mine]
        label = name or "reading"
        faint = {"colour": colour, "opacity": 0.8}
        series.append(points(places[mine] + shift, amount[mine], label, rows=rows, **faint))
        drawn_in = PURPLE if len(curves) == 1 else colour
        series += _fitted(x, fitted, drawn_in, i == 0, classes=bool(names), beside=largest)
    clear = int(drawn.sum())
    left = int(of.rows.sum()) - clear
    like = where.weight.like
    said = [f"Given as the {like} that would change the readings as much."] if like else []
    said += [f"Not drawn: {left} readings that it changes little."] if left else []
    if not names and not any(s.form is Form.BAND for s in series):
        said.append("U (k = 2) of the curve is narrower than its line.")
    said += ["The other causes are taken off."] if len(d.causes) > 1 else []
    lost = [parameter_words(k) for k, s in of.cause.std_errors.items() if not np.isfinite(s)]
    if lost:
        said.append(f"Not identifiable one by one: {', '.join(lost)}; drawn is one fit of many.")
    y = Axis(capital(where.weight.name), where.weight.unit)
    x_unit = unit_beside(where.x.unit, where.weight.unit)
    x_unit = "°" if x_unit == "deg" else x_unit
    x_axis = Axis(capital(where.x.name), x_unit, names)
    return Picture(title, x_axis, y, tuple(series), note=" ".join(said), key=id_)


def _fitted(
    x: Floats, fitted: Floats, colour: str, first: bool, *, classes: bool, beside: float
) -> list[Series]:
    """Return curve and band, where it is seen beside such readings; over classes short lines."""
    y = fitted[:, 0]
    half = COVERAGE * np.sqrt(np.sum(fitted[:, 1:] ** 2, axis=1))
    label, edge = ("fitted", "U (k = 2)") if first else ("", "")
    if not classes:
        made = [line(x, y, label, colour=colour, width=2.2)]
        seen = half.max(initial=0.0) > NARROW * beside
        return [band(x, y - half, y + half, edge, colour=colour), *made] if seen else made
    ends = np.stack([x - CLASS_WIDTH, x + CLASS_WIDTH, np.full_like(x, np.nan)], axis=1).ravel()
    flat = [line(ends, np.repeat(y, 3), label, colour=colour, width=2.2)]
    if half.any():
        for sign in (-1, 1):
            named = edge if sign == 1 else ""
            at = np.repeat(y + sign * half, 3)
            flat.append(line(ends, at, named, colour=colour, dash="dot", width=1.2))
    return flat


def _against_change(of: Explained, title: str, reading: Floats) -> Picture:
    """Readings over what the fitted cause makes of them: on the line where it is right."""
    x, y, rows = of.change[of.rows], reading[of.rows], of.record.rows[of.rows]
    ends = np.array([x.min(), x.max()])
    return Picture(
        title,
        Axis("Change of a reading by the fitted cause", of.unit),
        Axis("Reading, other causes taken off", of.unit),
        (
            points(x, y, "reading", colour=BLUE, opacity=0.8, rows=rows),
            line(ends, ends, "fitted", colour=PURPLE, width=2.2),
        ),
        note="It depends on no single recorded quantity.",
        key=of.cause.id,
    )


def _index(where: Coordinate, name: str) -> int:
    return where.names.index(name) if name in where.names else 0


def touched(d: Diagnosis, id_: str) -> Flags:
    """Whether a cause changes each reading, (n,)."""
    change = np.abs(record_of(d).changes[id_])
    return np.asarray(change > TOUCHED * change.max(initial=0.0))


# --- residuals


def residual_picture(d: Diagnosis, covariate: Covariate | None = None) -> Picture:
    """Residuals before and after against a covariate: one that `unexplained` names, or the order.

    Outliers are crosses, at the edge where they are further out. Of several measurements those of
    the one that has the covariate.
    """
    record = record_of(d)
    v = _named_covariate(d, record) if covariate is None else covariate
    x, names = positions(v)
    recorded = np.ones(len(x), dtype=bool) if v.known is None else v.known
    kept, left_out = record.kept & recorded, ~record.kept & recorded
    most = np.max(np.abs(np.concatenate([record.before[kept], record.after[kept]])), initial=0.0)
    limit = LIMIT * float(most) or 1.0
    shown = [("residual", record.after, BLUE)]
    if d.causes or d.verdict != "consistent":
        shown = [
            ("without the causes", record.before, VERMILLION),
            ("with the causes", record.after, BLUE),
        ]
    series = [
        points(x[kept], r[kept], name, colour=colour, opacity=0.6, rows=record.rows[kept])
        for name, r, colour in shown
    ]
    if left_out.any():
        edge = np.clip(record.before[left_out], -limit, limit)
        out = {"colour": MUTED, "marker": "cross", "size": 7.0, "rows": record.rows[left_out]}
        series.append(points(x[left_out], edge, "left out (at the edge)", **out))
    title = f"Residuals of the readings: {v.name}"
    if d.unexplained and covariate is None:
        title = f"What the model does not explain: {v.name}"
    y = Axis("Residual", record.unit, limits=(-1.05 * limit, 1.05 * limit))
    return Picture(title, Axis(capital(v.name), v.unit, names), y, tuple(series))


def alternatives_picture(d: Diagnosis) -> Picture | None:
    """Probability of each set of causes; None where there is one only."""
    sets = d.evidence[:MAX_SETS]
    if len(sets) < 2:
        return None
    shared = frozenset.intersection(*(a.causes for a in sets))
    none = "no further cause" if shared else NO_CAUSE
    names = tuple(" + ".join(_called(d, a.causes - shared)) or none for a in sets)
    also = f"In all of them: {'; '.join(_called(d, shared))}." if shared else ""
    chances = [a.probability for a in sets]
    colours = bars([100 * p for p in chances], colour=GREEN)
    ends = tuple((100 * p, float(k), percent(p)) for k, p in enumerate(chances))
    return Picture(
        "Probability of each set of causes",
        Axis("Probability", "%", limits=(0.0, 110.0)),
        Axis(names=names),
        (colours,),
        note=also,
        notes_at=ends,
    )


def _called(d: Diagnosis, causes: frozenset[str]) -> list[str]:
    return sorted(d.labels.get(i) or i.replace("_", " ") for i in causes)


def diagnostics(d: Diagnosis, name: Callable[[str], str] = str) -> list[Picture]:
    """Return residuals in order and against normal noise, and the correlation of the estimates.

    Correlations only where there are some. name: What people call a parameter of an effect.
    """
    record = record_of(d)
    out: list[Picture] = []
    for i, unit in enumerate(record.units):
        mine = record.kept & (record.unit_index == i)
        if not mine.any():
            continue
        rows, left = record.rows[mine], record.after[mine]
        order = np.argsort(rows, kind="stable")
        several = f" ({with_unit('readings in', unit)})" if len(record.units) > 1 else ""
        title = f"Residuals, in the order of the file{several}"
        out += [
            order_picture(left[order], unit, rows=rows[order], title=title),
            normal_picture(left, unit, rows=rows, title=f"{NORMAL}{several}"),
        ]
    model = d.model
    if isinstance(model, Estimate) and model.names:
        size_of = Counter(one.partition(".")[0] for one in model.names)
        known = [
            i
            for i in np.flatnonzero(np.diag(model.covariance) > 0).tolist()
            if "." in model.names[i] or error_label(model.names[i]) != model.names[i]
            if size_of[model.names[i].partition(".")[0]] <= MAX_PARAMETERS
        ]
        covariance = model.covariance[np.ix_(known, known)]
        size = np.sqrt(np.diag(covariance))
        beside = np.abs(covariance / np.outer(size, size)) - np.eye(len(known))
        if beside.max(initial=0.0) > MIN_CORRELATED and len(known) <= MAX_CORRELATED:
            given = [model.names[i] for i in known]
            names = [one if one.startswith("E") else name(one) for one in given]
            out.append(correlation_picture(names, covariance))
    return out


def record_of(d: Diagnosis) -> Residuals:
    """Return the readings of a diagnosis."""
    if d.residuals is None:
        raise InputError(f"plot: {WITHOUT_DATA}")
    return d.residuals


def _named_covariate(d: Diagnosis, record: Residuals) -> Covariate:
    text = d.unexplained or ""
    named = [v for v in record.covariates if v.name in text]
    if named:
        return min(named, key=lambda v: text.index(v.name))
    ordered = [v for v in record.covariates if v.sequence]
    return ordered[0] if ordered else record.covariates[0]
