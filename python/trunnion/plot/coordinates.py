"""The coordinate that a cause depends on, found from its model: one rule for every effect.

What a cause does to reading i is written as ``w_i g(x_i)``: w, how something enters the readings
(as it is, along a direction, or like a parameter that is always fitted), x a recorded quantity (an
angle, a time, a direction of approach), g a curve over it, one for each class where it needs some.
Of all pairs of w and x the simplest that explains the change is taken. So a positioning error of a
rotary axis is drawn as an angle over an angle, a drift as a displacement over time, a backlash over
the direction, and readings with either sign fall on one curve.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import median_filter

from trunnion.base.units import Flags, Floats, Integers, unit_of
from trunnion.diagnosis.model import Covariate, Model
from trunnion.diagnosis.ways import directions

ORDER, LAST = re.compile(r"[ab](\d+)_"), re.compile(r"_(\d+)$")
ALONG = "deviation along "
TURNED = "actual less commanded"
ENOUGH = 0.95
"""Share of a change that a coordinate explains, at least."""
AS_GOOD = 0.002
"""Share by which a simpler coordinate may explain less."""
AS_GOOD_AS_OWN = 0.02
"""Share by which time, of what acts by time, or what is no time, of all else, may explain less."""
TIMES = ("s", "min", "h")
FEW, MOST_OF_FEW = 0.2, 0.8
"""A change is narrow where so few readings hold so much of its mean square.

Nodes are wider than it: it is drawn over an angle, whatever share of it they explain.
"""
MAX_LEVELS = 48
"""Distinct values, up to which each has a place of its own."""
NODES = (24, 160)
"""Nodes of a curve over more values; the second where the first is too coarse."""
MAX_CLASSES = 6
MAX_READINGS = 4000
"""For the search; the curve uses all."""
MAX_HARMONIC = 12
EXACT = 1e-3
DENSE, MAX_DENSE = 241, 4801
COARSE = 0.05  # of the largest amount: by so much a curve of DENSE points may be off
PER_WAVE = 24  # points of a curve
GAP, GAP_SHARE = 12.0, 0.03  # of the usual step, of the range: where a curve is broken
QUIET = 20  # windows of the running median, of all values
AS_PARAMETER = 12.0
"""What it costs a reader that an amount is given as one of a parameter."""
MIN_WEIGHT = 0.25
"""Of the largest: readings that feel less say too little of the amount."""


@dataclass(frozen=True)
class Wave:
    """The wave that a cause is, by its parameters.

    order: Of the harmonic of a turn, 0 where it is none.
    length, unit: Of a wave with a pitch, 0 where it has none; that of its pitch.
    """

    order: int = 0
    length: float = 0.0
    unit: str = ""

    @classmethod
    def of(cls, id_: str, parameters: Mapping[str, float]) -> Wave:
        """Return that of a cause: `a3_um` is of the third harmonic, so is `radial_3`."""
        found = [ORDER.match(name) for name in parameters]
        orders = {int(match[1]) for match in found if match}
        if not orders and (match := LAST.search(id_)):
            orders = {int(match[1])}
        pitch = [(n, p) for n, p in parameters.items() if n.startswith(("pitch_", "period_"))]
        name, length = pitch[0] if pitch else ("", 0.0)
        return cls(orders.pop() if len(orders) == 1 else 0, length, unit_of(name) if name else "")

    def laws(self, v: Covariate) -> list[_Harmonic]:
        """Return what the wave is over a quantity, nothing where that is not what it depends on."""
        if self.length > 0 and v.unit == self.unit:
            return [_Harmonic(self.length, 1)]
        return [_Harmonic(v.period, self.order)] if self.order and v.period else []


@dataclass(frozen=True, eq=False)
class Weight:
    """How an amount enters each reading, (n,); its name, unit and cost, what it acts like.

    sense: -1 where it enters the readings with the opposite of their direction.
    """

    name: str
    unit: str
    enters: Floats
    cost: float = 0.0
    like: str = ""
    sense: float = 1.0

    def only(self, readings: Flags) -> Weight:
        """Return the same for some readings: the amount does not enter the others, (n,)."""
        return replace(self, enters=np.where(readings, self.enters, 0.0))


@dataclass(frozen=True, eq=False)
class Coordinate:
    """What a cause is drawn over.

    Attributes
    ----------
    x
        The recorded quantity, each (n,).
    weight
        How the amount enters.
    split
        Class of each reading, (n,), where each class has its own curve; None: one curve.
    names
        Of the classes.
    share
        Of the change (mean square) that such a curve explains.
    """

    x: Covariate
    weight: Weight
    split: Integers | None
    names: tuple[str, ...]
    share: float

    @cached_property
    def positions(self) -> Floats:
        """Place of each reading on the x axis, (n,)."""
        return positions(self.x)[0]

    def clear(self) -> Flags:
        """Whether each reading feels enough of the amount to be drawn, (n,)."""
        size = np.abs(self.weight.enters)
        return np.asarray(size >= MIN_WEIGHT * size.max(initial=0.0)) & (size > 0)

    def curve(
        self, columns: Floats, rows: Flags, wave: Wave | None = None
    ) -> list[tuple[str, Floats, Floats]]:
        """Curves through columns (n, k) of changes: class, x (m,) and amounts (m, k).

        wave: That the cause is, where it is one: at few places others go through the same amounts.
        """
        split = np.zeros(len(columns), dtype=np.intp) if self.split is None else self.split
        out = []
        for index, name in enumerate(self.names or ("",)):
            mine = rows & (split == index) & self.clear()
            if mine.any():
                place = self.positions[mine]
                dense, amounts = _curve(
                    place, self.weight.enters[mine], columns[mine], self.x, wave
                )
                out.append((name, dense, amounts))
        return out


def coordinate_of(
    change: Floats,
    covariates: Sequence[Covariate],
    weights: Sequence[Weight],
    rows: Flags,
    *,
    timed: bool = False,
) -> Coordinate | None:
    """Return the coordinate that explains a change (n,) of readings; None where none does.

    Parameters
    ----------
    rows
        Readings that count, (n,).
    timed
        Whether the cause acts by time: it is drawn over time where that explains it about as well
        as anything else; all other causes over a place, an angle or a class.
    """
    at = np.flatnonzero(rows)
    if not len(at) or not np.any(change[at]):
        return None
    if len(at) > MAX_READINGS:
        at = at[:: -(-len(at) // MAX_READINGS)]
    every = _pairs([*covariates, *_joined(covariates), *_directions(weights)], weights)
    pairs = [(made, cost) for made, cost in every if _varies(made.x, at[made.clear()[at]])]
    for nodes in NODES:
        found = []
        for made, cost in pairs:
            share, used = _explained(change, made, at, nodes)
            if made.weight.cost >= AS_PARAMETER:  # of these the one that most readings feel
                cost += 10 * float(1 - made.clear()[at].mean())
            found.append((share, cost + used, made))
        enough = [entry for entry in found if entry[0] >= ENOUGH]
        # The order of things explains much by chance: it stands back where it needs classes.
        plain = [e for e in enough if e[2].split is None or not e[2].x.sequence]
        if enough:
            return _simplest(plain or enough, timed)
    angles = [e for e in found if e[2].x.period and e[2].weight.cost < 1]
    by_class = [e for e in angles if e[2].split is not None]  # the sense of travel, as a rule
    return _simplest(by_class or angles, timed) if angles and _is_narrow(change[at]) else None


def _simplest(found: Sequence[tuple[float, float, Coordinate]], timed: bool) -> Coordinate:
    """Return the simplest that explains about as much as the best.

    Of what acts by time one over time, of all else another: places that are read in turn have the
    order of their times.
    """
    best = max(share for share, _, _ in found)
    clock = [e for e in found if e[2].x.unit in TIMES]
    order = [e for e in found if e[2].x.sequence]
    other = [e for e in found if e not in clock and e not in order]
    for own in (clock, order) if timed else (other,):
        best_of_own = max((share for share, _, _ in own), default=-np.inf)
        if best_of_own >= best - AS_GOOD_AS_OWN:
            found, best = own, best_of_own
            break
    good = [entry for entry in found if entry[0] >= best - AS_GOOD]
    share, _, made = min(good, key=lambda entry: entry[1])
    return replace(made, share=share)


def _is_narrow(change: Floats) -> bool:
    """Whether few readings hold most of a change (n,): no curve of equal nodes resolves it."""
    power = np.sort(change**2)[::-1]
    few = max(int(FEW * len(power)), 1)
    return bool(power[:few].sum() >= MOST_OF_FEW * power.sum())


def _joined(covariates: Sequence[Covariate]) -> Iterator[Covariate]:
    """Quantities that several measurements have, each of its own: "Target position of ..."."""
    alike: dict[Any, list[Covariate]] = {}
    for v in covariates:
        if v.readings is not None and not v.sequence and not v.classes:
            alike.setdefault((v.name.rpartition(" of ")[0], v.unit, v.period), []).append(v)
    for (name, *_), of in alike.items():
        if len(of) > 1 and name:
            values, known = np.zeros(len(of[0].values)), np.zeros(len(of[0].values), dtype=bool)
            for v in of:
                first, end = v.readings or (0, len(values))
                mine = np.zeros(len(values), dtype=bool)
                mine[first:end] = True if v.known is None else v.known[first:end]
                values[mine], known = np.asarray(v.values)[mine], known | mine
            yield replace(of[0], name=name, values=values, known=known, readings=None)


def _varies(v: Covariate, at: Integers) -> bool:
    """Whether a quantity takes more than one value in readings that have it."""
    known = at if v.known is None else at[v.known[at]]
    values = np.asarray(v.values)[known]
    return bool(len(values)) and bool(np.any(values != values[0]))


def _pairs(
    covariates: Sequence[Covariate], weights: Sequence[Weight]
) -> list[tuple[Coordinate, float]]:
    """Every pair of a weight and a quantity, whole and by classes, with what it costs a reader."""
    splits = [s for v in covariates if (s := _split(v)) is not None]
    out = []
    for weight in weights:
        for v in covariates:
            own = weight if v.known is None else weight.only(v.known)
            cost = weight.cost + _clumsiness(v)
            out.append((Coordinate(v, own, None, (), 0.0), cost))
            for of, index, names in splits:
                if not v.classes and of is not v:
                    by = Coordinate(v, own, index, names, 0.0)
                    out.append((by, cost + 10 * (len(names) - 1)))
    return out


def weights_of(
    model: Model, nuisance: Floats, unit: str, labels: Mapping[str, str]
) -> list[Weight]:
    """Return how something may enter the readings of a model, the simplest first.

    unit: Of the readings. labels: What a parameter that is always fitted is called, by name.
    """
    out = []
    for name, enters in directions(model.components).items():
        if name:
            along = f"{ALONG}{name}" if len(name) == 1 else f"deviation, {name}"
            sense = model.tool_sense
            column = sense * np.asarray(enters, dtype=np.float64)
            out.append(Weight(along, unit, column, sense=sense))
    out.append(Weight("deviation of the reading", unit, np.ones(len(model.readings)), 0.1))
    for letter, enters in model.turning.items():
        name = f"angle of {letter.upper()}, {TURNED}"
        out.append(Weight(name, "arcsec", enters, 0.2))
    columns = model.jacobian(nuisance, {})
    for j, one in enumerate(model.nuisance):
        kind = "angular deviation" if one.unit == "arcsec" else "deviation"
        like = labels.get(one.name, one.name)
        cost = AS_PARAMETER + 0.01 * (len(model.nuisance) - j)
        out.append(Weight(kind, one.unit, np.asarray(columns[:, j]), cost, like))
    return [w for w in out if np.any(w.enters)]


def unit_beside(unit: str, reading: str) -> str:
    """Return the unit of a place stated as "mm or deg/s", beside readings of one axis."""
    linear, both, rotary = unit.partition(" or ")
    if not both:
        return unit
    return rotary if reading == "arcsec" else linear + rotary.removeprefix("deg")


def positions(v: Covariate) -> tuple[Floats, tuple[str, ...]]:
    """Return places on an axis (n,), and what stands at 0, 1, 2, ... of classes."""
    if not (v.classes or v.words):
        return np.asarray(v.values, dtype=np.float64), ()
    index, names = _classes(v)
    return index.astype(np.float64), names


def _classes(v: Covariate) -> tuple[Integers, tuple[str, ...]]:
    """Return the class of each reading, (n,), and their names."""
    labels, index = np.unique(v.values, return_inverse=True)
    words = dict(v.words)
    names = [words.get(one) or str(one) for one in labels.tolist()]
    return index.reshape(-1).astype(np.intp), tuple(names)


def _directions(weights: Sequence[Weight]) -> list[Covariate]:
    """Sense in which a reading was approached, along each direction that has both."""
    out = []
    for weight in weights:
        sense = np.sign(weight.sense * weight.enters)
        if weight.name.startswith(ALONG) and {-1.0, 1.0} <= set(np.unique(sense)):
            name = f"direction along {weight.name.removeprefix(ALONG)}"
            words = np.array(["towards −", "across", "towards +"])[sense.astype(int) + 1]
            out.append(Covariate(name, words, classes=True))
    return out


def _split(v: Covariate) -> tuple[Covariate, Integers, tuple[str, ...]] | None:
    """Return a quantity of few classes, the class of each reading, and their names."""
    if not (v.classes or v.words):
        return None
    index, labels = _classes(v)
    if not 2 <= len(labels) <= MAX_CLASSES:
        return None
    named = dict(v.words).values()
    return v, index, tuple(label if label in named else f"{v.name} {label}" for label in labels)


def _clumsiness(v: Covariate) -> float:
    """How much simpler another coordinate would be: names of places say little of a law."""
    many = len(np.unique(v.values)) > MAX_CLASSES
    return 30.0 * (v.classes and many) + 5.0 * (v.sequence and not v.unit)


def _explained(change: Floats, made: Coordinate, at: Integers, nodes: int) -> tuple[float, int]:
    """Share of a change that a curve over a covariate explains, corrected for what it uses."""
    c, w, x = change[at], made.weight.enters[at], made.positions[at]
    which = np.zeros(len(at), dtype=np.intp) if made.split is None else made.split[at]
    left, used = 0.0, 0
    for index in range(max(len(made.names), 1)):
        mine = which == index
        if mine.any():
            fitted, size = _fitted(x[mine], w[mine], c[mine], made.x, nodes)
            left += float(np.sum((c[mine] - fitted) ** 2))
            used += size
    free = len(at) - used
    total = float(np.sum(c * c))
    return (1 - left / free / (total / len(at)) if free > 0 else -np.inf), used


def _fitted(x: Floats, w: Floats, c: Floats, v: Covariate, nodes: int) -> tuple[Floats, int]:
    """Return w g(x) fitted to c, each (n,), and how many values g has."""
    levels, index = np.unique(x, return_inverse=True)
    if len(levels) <= MAX_LEVELS or v.classes:
        top = np.bincount(index, w * c)
        under = np.bincount(index, w * w)
        g = np.divide(top, under, out=np.zeros_like(top), where=under > 0)
        return w * g[index], len(levels)
    low, step = float(levels[0]), float(levels[-1] - levels[0]) / (nodes - 1)
    place = (x - low) / step
    left = np.minimum(place.astype(np.intp), nodes - 2)
    part = place - left
    a, b = w * (1 - part), w * part
    own = np.bincount(left, a * a, nodes) + np.bincount(left + 1, b * b, nodes)
    beside = np.bincount(left, a * b, nodes)
    top = np.bincount(left, a * c, nodes) + np.bincount(left + 1, b * c, nodes)
    bands = np.stack([np.append(0.0, beside[:-1]), own + 1e-9 * (own.max() or 1.0)])
    g = solveh_banded(bands, top)
    return a * g[left] + b * g[left + 1], nodes


def _curve(
    x: Floats, w: Floats, columns: Floats, v: Covariate, wave: Wave | None
) -> tuple[Floats, Floats]:
    """Return amounts (m, k) at places (m,): dense where they follow a known law, else where read.

    A quantity with a period takes one harmonic, any other a parabola, where that is exact; that of
    the cause first.
    """
    levels, index = np.unique(x, return_inverse=True)
    under = np.bincount(index, w * w)
    steps = np.diff(levels)
    usual = float(np.median(steps)) if len(steps) else 0.0
    wide = np.flatnonzero(steps > max(GAP * usual, GAP_SHARE * np.ptp(levels)))
    amounts = np.stack([np.bincount(index, w * c) / under for c in columns.T], axis=1)
    if v.classes or v.words or len(levels) < 3:
        return levels, amounts
    turn = v.period
    end = levels[-1] if turn is None else levels[0] + turn
    dense = np.linspace(levels[0], end, DENSE)
    laws: list[Callable[[Floats], Floats]] = [] if wave is None else [*wave.laws(v)]
    for basis in laws + _laws(turn, len(levels)):
        at = basis(levels)
        values, *_ = np.linalg.lstsq(at, amounts, rcond=1e-10)
        size = np.abs(amounts).max(initial=0.0)
        if np.abs(at @ values - amounts).max(initial=0.0) <= EXACT * size + 1e-12:
            if isinstance(basis, _Harmonic):
                count = PER_WAVE * basis.order * (end - levels[0]) / basis.turn
                dense = np.linspace(levels[0], end, int(np.clip(count, DENSE, MAX_DENSE)))
            return dense, basis(dense) @ values
    amounts = _quiet(amounts, index, w, columns[:, 0])
    if len(levels) > DENSE:
        made = np.stack([np.interp(dense, levels, a) for a in amounts.T], axis=1)
        seen = np.interp(levels, dense, made[:, 0])
        if np.abs(seen - amounts[:, 0]).max() > COARSE * np.abs(amounts[:, 0]).max():
            dense = levels[:: -(-len(levels) // MAX_DENSE)]  # narrower than the steps
            made = np.stack([np.interp(dense, levels, a) for a in amounts.T], axis=1)
        for k in wide:  # no reading says what is between
            made[(dense > levels[k]) & (dense < levels[k + 1])] = np.nan
        return dense, made
    between = (levels[wide] + levels[wide + 1]) / 2
    return np.insert(levels, wide + 1, between), np.insert(amounts, wide + 1, np.nan, axis=0)


def _quiet(amounts: Floats, index: Integers, w: Floats, change: Floats) -> Floats:
    """Return amounts (m, k) by their running median, where that explains the change as well.

    A change that depends on a little more than the quantity (what follows a reversal) jumps from
    value to value; a median keeps the steps of its curve.
    """
    size = len(amounts) // QUIET | 1
    if size < 3:
        return amounts
    smooth = median_filter(amounts, size=(size, 1), mode="nearest")
    left = float(np.sum((change - w * smooth[index, 0]) ** 2))
    return smooth if left <= (1 - ENOUGH) * float(np.sum(change**2)) else amounts


@dataclass(frozen=True)
class _Harmonic:
    turn: float
    order: int

    def __call__(self, x: Floats) -> Floats:
        angle = 2 * np.pi * self.order * x / self.turn
        return np.stack([np.ones_like(x), np.cos(angle), np.sin(angle)], axis=1)


def _parabola(x: Floats) -> Floats:
    middle, half = (x.max() + x.min()) / 2, max(float(np.ptp(x)) / 2, 1e-12)
    return np.vander((x - middle) / half, 3)


def _laws(turn: float | None, levels: int) -> list[Callable[[Floats], Floats]]:
    if turn is None:
        return [_parabola] if levels > 3 else []
    return [_Harmonic(turn, order) for order in range(1, MAX_HARMONIC + 1)]
