"""What each cause explains of the readings, and what it had biased in the estimate.

The extended fit holds every cause; each is taken out again, the others and what is always fitted
fitted anew, linear at the extended fit. An rms is of residuals in the readings' own unit, however
they are weighed in the fit; readings of another unit have numbers of their own.

The *ladder* begins with the plain model and takes, at each step, the cause that explains most of
what is left. What a cause explains is the drop at its step: √ of the drop of the mean square, and
its share of the mean square of the plain model's residuals. The shares of all causes add up to what
they explain together. Beside it stand the drop of the cause alone and that of the cause taken last:
causes that can take each other's place have little of the latter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from trunnion.base.report import Cell, Result, Shown, Table, left_text, number, significant
from trunnion.base.statistics import MANY_ROWS, quick_factor
from trunnion.base.units import ARCSEC, Floats, Integers, unit_of
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.families import RADIUS_MM
from trunnion.diagnosis.fit import Fit, beside
from trunnion.diagnosis.records import labelled, units_of, with_unit
from trunnion.diagnosis.whitening import correlated, identity

Named: TypeAlias = frozenset[int]  # causes that are fitted, by number

DEPENDENT = 1e-9  # share of the largest singular value, columns of unit length
MIN_SHARE = 0.001  # of the variance, from which readings in another unit are shown
MAX_BIASES = 3  # of a cause in a table
ROUNDING = 1e-9  # µm, arcsec: data without noise have standard errors of 0
NO_STD = 1.0  # µm, arcsec: of errors that have no standard error
UM_PER_ARCSEC = RADIUS_MM * 1e3 * ARCSEC
NO_UNITS: Mapping[str, str] = {}
NOTHING = 1e-12  # of a mean square, of which one that differs less is the same: rounding
TINY = 1e-300


@dataclass(frozen=True, eq=False, repr=False)
class Contribution(Result):
    """What one cause explains, readings of one unit.

    Attributes
    ----------
    id, label:
        The cause.
    rms_um, share:
        Rms of what it explains at its step of the ladder, in `unit`, and its share (0 to 1) of the
        mean square of the plain model's residuals.
    alone_um, alone_share:
        The same of the cause alone.
    last_um, last_share:
        The same of the cause after all others.
    bias:
        How far the plain model's location errors are off because of it, by name, µm or arcsec;
        outliers left out of both fits.
    bias_in_tolerances:
        The same in units of the tolerance, where the set-up has one (``[machine.tolerance]``).
    unit:
        Unit of the readings.
    others:
        The same for the readings in other units, where the data mix them.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    >>> d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    >>> [(c.id, round(c.rms_um, 1)) for c in d.contributions]
    [('c_positioning_2', 0.7), ('drift_z', 0.5)]
    """

    id: str
    rms_um: float
    share: float
    alone_um: float
    alone_share: float
    last_um: float
    last_share: float
    bias: Mapping[str, float] = field(default_factory=dict)
    bias_in_tolerances: Mapping[str, float] = field(default_factory=dict)
    label: str = ""
    unit: str = "µm"
    others: tuple[Contribution, ...] = ()

    def by_unit(self) -> dict[str, Contribution]:
        """Return what it explains of the readings of each unit."""
        return {one.unit: one for one in (self, *self.others)}

    def with_tolerance(self, tolerance: Mapping[str, float]) -> Contribution:
        """Return it with its bias in units of a tolerance, by name of a location error."""
        ratio = {k: v / tolerance[k] for k, v in self.bias.items() if k in tolerance}
        return replace(self, bias_in_tolerances=ratio)

    def sentences(self) -> tuple[str, ...]:
        """Say what it explains."""
        parts = (
            f"{with_unit(f'{one.rms_um:.3g}', one.unit)} rms ({100 * one.share:.1f} %)"
            for one in (self, *self.others)
        )
        return (f"{labelled(self.id, self.label)} explains {', '.join(parts)}.",)

    def tables(self) -> tuple[Table, ...]:
        """What it explains, and the bias of the location errors."""
        biased = bias_table([self], dict.fromkeys(self.bias, 0.0))
        return (contributions_table([self]), *([biased] if biased.rows else []))


@dataclass(frozen=True, eq=False, repr=False)
class Ladder(Result):
    """Residual rms of the plain model and after each cause, readings of one unit.

    Attributes
    ----------
    causes:
        Ids, in the order of what they explain of what those before them leave.
    rms_um:
        Of the residual, in `unit`: of the plain model, then after each cause.
    labels:
        What people call the causes, by id.
    unit:
        Unit of the readings.
    others:
        The same for the readings in other units, where the data mix them.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    >>> d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    >>> [round(float(rms), 2) for rms in d.ladder.rms_um]
    [0.87, 0.57, 0.28]
    """

    causes: tuple[str, ...]
    rms_um: tuple[float, ...]
    labels: Mapping[str, str] = field(default_factory=dict)
    unit: str = "µm"
    others: tuple[Ladder, ...] = ()

    def sentences(self) -> tuple[str, ...]:
        """Say it in one line a unit: ``Residual rms 577 → 15.8 (gain of X) → 1.50 µm (...)``."""
        lines = []
        for one in (self, *self.others):
            steps = [left_text(one.rms_um[0])]
            for cause, rms in zip(one.causes, one.rms_um[1:], strict=True):
                steps.append(f"{left_text(rms)} ({self._called(cause)})")
            if one is not self and min(one.rms_um) > (1 - MIN_SHARE) * one.rms_um[0]:
                continue
            of_unit = f", {one.unit}" if one.unit else ""
            lines.append(f"Residual rms{of_unit}: {' → '.join(steps)}.")
        return tuple(lines)

    def _called(self, cause: str) -> str:
        return self.labels.get(cause) or labelled(cause, "")

    def tables(self) -> tuple[Table, ...]:
        """One step a row."""
        names = ["plain model", *map(self._called, self.causes)]
        units = (self, *self.others)
        rows: list[tuple[Cell, ...]] = [
            (name, *(significant(one.rms_um[i]) for one in units)) for i, name in enumerate(names)
        ]
        columns = ("after", *(with_unit("rms", one.unit and f"({one.unit})") for one in units))
        return (Table.of("Residual rms", columns, rows),)


def contributions_table(contributions: Sequence[Contribution]) -> Table:
    """Return what causes explain, one a row and unit."""
    rows: list[tuple[Cell, ...]] = []
    for cause in contributions:
        shown = (one for one in cause.others if max(one.share, one.alone_share) > MIN_SHARE)
        for one in (cause, *shown):
            name = one.label or labelled(one.id, "")
            percent = (
                Shown(s, f"{number(100 * s, 1)} %")
                for s in (one.share, one.alone_share, one.last_share)
            )
            rows.append((name, significant(one.rms_um), one.unit, *percent))
    columns = ("", "rms", "unit", "share", "alone", "last")
    return Table.of("What each cause explains, share of the variance", columns, rows)


def largest_biases(
    bias: Mapping[str, float], std: Mapping[str, float], units: Mapping[str, str] = NO_UNITS
) -> list[str]:
    """Names of the errors of the machine that are biased, the one that moves the tool most first.

    By more than their standard uncertainty (``std``); angles at a radius of `RADIUS_MM`. ``units``:
    of names that do not tell it.
    """

    def moves(name: str) -> float:
        unit = units.get(name) or unit_of(name)
        return abs(bias[name]) * (UM_PER_ARCSEC if unit == "arcsec" else 1.0)

    certain = [k for k, v in bias.items() if abs(v) >= max(std.get(k, NO_STD), ROUNDING)]
    return sorted(certain, key=moves, reverse=True)


def bias_table(contributions: Sequence[Contribution], std: Mapping[str, float]) -> Table:
    """Return the biases by each cause above a standard error (``std``): see `largest_biases`."""
    rows: list[tuple[Cell, ...]] = []
    toleranced = any(one.bias_in_tolerances for one in contributions)
    for cause in contributions:
        for name in largest_biases(cause.bias, std)[:MAX_BIASES]:
            called = cause.label or labelled(cause.id, "")
            row = (called, name, significant(cause.bias[name], 2), unit_of(name))
            ratio = cause.bias_in_tolerances.get(name)
            shown = None if ratio is None else significant(ratio, 2)
            rows.append((*row, shown) if toleranced else row)
    columns = ("", "error", "bias", "unit", *(("in tolerances",) if toleranced else ()))
    return Table.of("Bias of the plain model by each cause", columns, rows)


def contributions_of(
    kept: Case, plain: Fit, f: Fit, rows: Integers
) -> tuple[tuple[Contribution, ...], Ladder]:
    """Return what each cause of a fit explains, in descending order, and the ladder.

    ``kept``: the case without outliers; ``plain``: its fit without effects; ``rows``: readings that
    are used.
    """
    units, index = units_of(kept.model.readings)
    of_unit = [rows[index[rows] == i] for i in range(len(units))]
    pieces = [(unit, mine) for unit, mine in zip(units, of_unit, strict=True) if len(mine)]
    before = np.array([_mean_square(plain.residuals[mine]) for _, mine in pieces])
    labels = {e.id: e.label for e in kept.effects if e.id in f.effects}
    if not f.effects:
        return (), _ladder((), [before], {}, pieces)
    taken_out = _TakenOut(kept, f, [mine for _, mine in pieces])
    ids = taken_out.ids
    order, squares = _order(taken_out, before)
    every = frozenset(range(len(ids)))
    biases = taken_out.biases()
    found = []
    for step, j in enumerate(order):
        drops = np.stack(
            [
                squares[step] - squares[step + 1],
                before - taken_out.squares(frozenset({j})),
                taken_out.squares(every - {j}) - squares[-1],
            ]
        )
        drops = np.where(drops > NOTHING * before, drops, 0.0)
        shares, sizes = drops / np.maximum(before, TINY), np.sqrt(drops)
        parts = [
            Contribution(
                ids[j],
                *(float(sizes[0, u]), float(shares[0, u])),
                *(float(sizes[1, u]), float(shares[1, u])),
                *(float(sizes[2, u]), float(shares[2, u])),
                label=labels[ids[j]],
                unit=unit,
            )
            for u, (unit, _) in enumerate(pieces)
        ]
        found.append(replace(parts[0], bias=biases[j], others=tuple(parts[1:])))
    found.sort(key=lambda c: -sum(one.share for one in (c, *c.others)))
    return tuple(found), _ladder(tuple(ids[j] for j in order), squares, labels, pieces)


def _ladder(
    ids: tuple[str, ...],
    squares: Sequence[Floats],
    labels: Mapping[str, str],
    pieces: Sequence[tuple[str, Integers]],
) -> Ladder:
    """Return the ladder of mean squares, of each unit, after each cause."""
    units = [
        Ladder(ids, tuple(float(np.sqrt(s[u])) for s in squares), labels, unit)
        for u, (unit, _) in enumerate(pieces)
    ]
    return replace(units[0], others=tuple(units[1:]))


def _order(taken_out: _TakenOut, before: Floats) -> tuple[list[int], list[Floats]]:
    """Order of the causes by what each explains of what is left; mean squares after each step."""
    order: list[int] = []
    squares = [before]
    left = set(range(len(taken_out.ids)))
    while left:
        tried = {j: taken_out.squares(frozenset((*order, j))) for j in sorted(left)}
        best = min(tried, key=lambda j: float(np.sum(tried[j] / np.maximum(before, TINY))))
        left.remove(best)
        order.append(best)
        squares.append(tried[best])
    return order, squares


def _mean_square(r: Floats) -> float:
    return float(np.mean(r * r))


def _triangle(columns: Floats) -> Floats:
    """Triangular factor of columns: it has their inner products."""
    return np.asarray(np.linalg.qr(columns, mode="r"))


def _shortened(columns: Floats) -> Floats:
    """Columns, or of many rows their triangular factor: it has the same combinations."""
    if len(columns) < MANY_ROWS:
        return columns
    return quick_factor(columns[:, :-1], columns[:, -1])


def _left(
    along: Floats, all_: Floats, taken: Floats, pieces: Sequence[Integers]
) -> Iterator[Floats]:
    """What columns leave once their share ``taken`` of others is off, of each piece of rows."""
    if len(all_) < MANY_ROWS:
        left = all_ - along @ taken
        yield from (left[mine] for mine in pieces)
        return
    for mine in pieces:
        short = _shortened(np.column_stack([along[mine], all_[mine]]))
        yield short[:, along.shape[1] :] - short[:, : along.shape[1]] @ taken


class _TakenOut:
    """Residuals of an extended fit with some of its causes taken out, the others fitted anew.

    Columns and changes are freed of the nuisance once: what is left of them is small matrices.
    """

    def __init__(self, kept: Case, f: Fit, pieces: Sequence[Integers]) -> None:
        model, p = kept.model, len(kept.model.nuisance)
        self.ids = list(f.effects)
        self.model, self.nuisance = model, f.nuisance
        whole = model.predict(f.nuisance, f.effects)
        changes = [
            whole - model.predict(f.nuisance, {k: v for k, v in f.effects.items() if k != id_})
            for id_ in self.ids
        ]
        shared = kept.shared(f)
        if shared.any() and (noise := correlated(kept.whiten)) is not None:
            changes[self.ids.index(noise.cause)] += shared
        columns = f.jacobian[:, p:]
        size = np.sqrt(np.einsum("ij,ij->j", columns, columns))
        columns = columns / np.where(size > 0, size, 1.0)
        self.owner = [self.ids.index(name) for name, _ in f.names]
        self.of_unit = pieces
        all_ = np.column_stack([columns, *changes, f.residuals - shared])
        directions = f.directions[np.any(f.directions[:, :p] != 0, axis=1), :p]
        along = f.jacobian[:, :p] @ directions.T
        length = np.sqrt(np.einsum("ij,ij->j", along, along))
        along /= np.where(length > 0, length, 1.0)
        white = _shortened(kept.white(beside([along, all_])))
        base, rest = white[:, : along.shape[1]], white[:, along.shape[1] :]
        taken = np.asarray(np.linalg.lstsq(base, rest, rcond=DEPENDENT)[0], dtype=np.float64)
        self.shift = directions.T @ (taken / np.where(length > 0, length, 1.0)[:, None])
        self.white = _triangle(rest - base @ taken)
        if kept.whiten is identity and len(pieces) == 1:
            self.raw = [self.white / np.sqrt(len(pieces[0]))]
        else:
            lefts = zip(_left(along, all_, taken, pieces), pieces, strict=True)
            self.raw = [_triangle(left) / np.sqrt(len(mine)) for left, mine in lefts]
        self._known: dict[Named, Floats] = {}

    def squares(self, named: Named) -> Floats:
        """Mean square of the residual with these causes fitted, of each unit."""
        if named not in self._known:
            k = len(self.owner)
            mine = [c for c in range(k) if self.owner[c] in named]
            gone = [k + j for j in range(len(self.ids)) if j not in named]
            mixed = np.zeros(self.white.shape[1])
            mixed[[*gone, -1]] = 1.0
            if gone and mine:
                target = self.white @ mixed
                moved = np.linalg.lstsq(self.white[:, mine], target, rcond=DEPENDENT)[0]
                mixed[mine] = -moved
            self._known[named] = np.array([float(np.sum((r @ mixed) ** 2)) for r in self.raw])
        return self._known[named]

    def biases(self) -> list[dict[str, float]]:
        """Change of each location error of the plain model by each cause."""
        at = self.model.location_errors(self.nuisance, {})
        out = []
        for j in range(len(self.ids)):
            moved = self.nuisance + self.shift[:, len(self.owner) + j]
            there = self.model.location_errors(moved, {})
            out.append({name: float(there[name] - at[name]) for name in at})
        return out
