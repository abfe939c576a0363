"""One of several measurements of a machine, as the joint model asks for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from trunnion.base.resolution import Grid
from trunnion.base.statistics import basis_of_all
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.effect import Effect, EffectValues, Parameter, Values
from trunnion.diagnosis.joint_ids import Happened
from trunnion.diagnosis.linearised import Linearised
from trunnion.diagnosis.model import Covariate, Model, Nuisance, Readings, Uncertainty
from trunnion.diagnosis.of_some import OfSome, Orthonormal
from trunnion.diagnosis.records import units_of
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.whitening import Scaled, Whiten, Whiteners
from trunnion.machine.budget import Input
from trunnion.machine.effects import Owner
from trunnion.machine.estimate import Estimate
from trunnion.machine.geometry import made_with
from trunnion.setup import Setup

MAX_KEPT = 8  # predictions of a part
UNIT_NAMES = {"µm": "um"}  # in names of parameters


@dataclass(frozen=True)
class Acts:
    """How a joint effect acts on one part: as that part's own effect, times ``sign``."""

    part: int
    effect: Effect
    sign: float

    @cached_property
    def signs(self) -> Floats:
        """Of each parameter: places and times have none."""
        return np.array([self.sign if p.linear else 1.0 for p in self.effect.parameters])

    def values(self, joint: Mapping[str, float]) -> Values:
        """Return the part's values for those of the joint effect."""
        sizes = zip(self.effect.parameters, joint.values(), strict=True)
        return Values({p.name: float(self.sign * v if p.linear else v) for p, v in sizes})


@dataclass(frozen=True)
class Change:
    """What happened to a shared error or effect at part ``since``; of an error ``effect`` is ''.

    Parts are in the order of time, of all kinds.
    """

    since: int
    happened: Happened
    error: str = ""
    effect: str = ""

    def acts_on(self, part: int, kinds: Sequence[str]) -> bool:
        """Whether it acts on a part; ``kinds``: of all parts."""
        match self.happened:
            case Happened.CHANGED:
                return part >= self.since
            case Happened.ENDED:
                return part < self.since
            case Happened.ONCE:
                return part == self.since
            case Happened.DIFFERS:
                return kinds[part] == kinds[self.since]


def may_have_happened(
    part: int, seeing: Sequence[int], kinds: Sequence[str]
) -> tuple[Happened, ...]:
    """What may have happened at a part to what some parts see, in order; of ``kinds`` each.

    Nothing where none of its kind saw it before. In the last part that sees it, another value in it
    alone is the same as a change before it.
    """
    before = [kinds[j] for j in seeing if j < part]
    if part not in seeing or kinds[part] not in before:
        return ()
    last = part == max(seeing)
    return (Happened.CHANGED,) if last else (Happened.CHANGED, Happened.ONCE)


@dataclass(frozen=True, eq=False)
class Part:
    """One of the measurements.

    Attributes
    ----------
    name
        As results call it.
    kind
        Measurements of one kind are of several dates.
    model
        Of the readings that are no outliers.
    rows
        Data row of each reading, counted through all measurements, shape (n,).
    whiten
        Makes the noise of its readings white, of size 1.
    exact
        Whether its readings have no noise: the size of its white noise is then an assumed one.
    more_than_noise
        Whether its own diagnosis left structure that no cause makes.
    grid
        Steps of its readings, with what is known of their noise; None: they have none.
    linearised
        Candidates at the plain fit of its own diagnosis, if that had these readings and this
        whitener: the joint one need not make them again. Columns there and at the joint plain fit
        differ to second order in the errors of the machine, as those at a fit with causes do.
    terms
        Structure without a name that its own diagnosis looked for.
    candidates
        Count of those that a cause is one of in its own diagnosis; 0: all of its model.
    columns
        Those of ``linearised``, beside what is always fitted of this measurement.
    """

    name: str
    kind: str
    model: Model
    rows: Integers
    whiten: Scaled
    exact: bool = False
    more_than_noise: bool = False
    grid: Grid | None = None
    linearised: Linearised | None = None
    terms: Dictionary | None = None
    candidates: float = 0.0
    columns: Candidates | None = None
    _predicted: dict[tuple[object, ...], Floats] = field(default_factory=dict, repr=False)

    @cached_property
    def among(self) -> float:
        """How many candidates a cause of it is one of beforehand."""
        return max(self.candidates or sum(e.ordinary for e in self.model.effects), 1.0)

    @cached_property
    def white_jacobian(self) -> Floats:
        """Derivative of the white readings by what is always fitted, at its start, (n, p)."""
        return np.asarray(self.whiten(self.model.jacobian(self.model.start, {})))

    @cached_property
    def fitted(self) -> Floats:
        """Orthonormal basis of it, (n, r)."""
        return basis_of_all(self.white_jacobian)

    def white_columns(self, nuisance: Floats, acts: Acts, values: Sequence[Values]) -> Floats:
        """Return columns of linear parameters of an effect that acts here, (v, k, n).

        ``values``: of the part's own effect, some.
        """
        own = acts.effect
        made = None if self.linearised is None else self.linearised.columns(own, values)
        if made is None:
            made = self.model.white_columns(nuisance, own, values, self.whiten.whiten)
        return np.asarray(made.transpose(0, 2, 1) * (acts.sign / self.whiten.size))

    def orthonormal(
        self, acts: Acts, values: Sequence[Values], whole: Callable[[], OfSome], at: slice
    ) -> Orthonormal | None:
        """Return columns of its own diagnosis of an effect that acts here; None: it has none.

        ``values``: some of the effect, in order; ``whole``: makes its white columns; ``at``: its
        readings.
        """
        j = self._numbers.get(acts.effect.id)
        if self.columns is None or self.linearised is None or j is None:
            return None
        every = self.linearised.values[j]
        first = every.index(values[0]) if values[0] in every else 0
        some = slice(first, first + len(values))
        made = self.columns.orthonormal(j, some) if every[some] == values else None
        if made is None:
            return None
        array, rows, rank = made
        if acts.sign < 0:
            array, rows = -array[rows], slice(rows.stop - rows.start)
        curve = self.columns.curves.get(j) if len(values) == len(every) else None
        return Orthonormal(array, rows, rank, at, self.columns.fitted, whole, curve)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        known = () if self.linearised is None else self.linearised.model.effects
        return {effect.id: j for j, effect in enumerate(known)}

    @cached_property
    def dictionary(self) -> Dictionary:
        """Structure without a name in its readings: of its own diagnosis, if that had these."""
        return Dictionary.of_all(self.model, self.whiten.whiten, self.terms)

    def predicted(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Return the readings under these values: causes of other parts change nothing of it."""
        named = ((name, tuple(values.items())) for name, values in effects.items())
        key = (nuisance.tobytes(), *named)
        if key not in self._predicted:
            if len(self._predicted) >= MAX_KEPT:
                del self._predicted[next(iter(self._predicted))]
            self._predicted[key] = np.asarray(self.model.predict(nuisance, effects))
        return self._predicted[key]


def joined_noise(parts: Sequence[Part], at: Sequence[slice]) -> Whiteners:
    """Each part by the noise that is left of it alone.

    Exact readings beside others leave nothing: all of them together do not say what noise is.
    """
    exact = [part.exact for part in parts]
    own = tuple(zip(at, (part.whiten for part in parts), strict=True))
    apart = tuple(some for some, p in zip(at, parts, strict=True) if p.more_than_noise)
    return Whiteners(own, known=any(exact) and not all(exact), apart=apart)


def fitted_alone(index: Sequence[Integers]) -> list[int]:
    """Parts of which all that is always fitted is theirs alone, of the numbers of that in each."""
    count = np.bincount(np.concatenate(index))
    return [i for i, own in enumerate(index) if np.all(count[own] == 1)]


def joined_readings(parts: Sequence[Part]) -> Readings:
    """Return the readings of all parts, each with its unit."""
    own = [p.model.readings for p in parts]
    units = []
    for readings in own:
        names, index = units_of(readings)
        units += [names[i] for i in index]
    steps = [np.zeros(len(r)) if r.step is None else np.asarray(r.step) for r in own]
    return Readings(
        np.concatenate([r.values for r in own]),
        np.concatenate([p.rows for p in parts]),
        tuple(units),
        step=np.concatenate(steps),
        least=np.concatenate([np.broadcast_to(r.least, len(r)) for r in own]),
    )


def joined_labels(parts: Sequence[Integers]) -> Integers:
    """Labels that differ from part to part; -1 stays."""
    out, first = [], 0
    for labels in parts:
        known = np.unique(labels, return_inverse=True)[1].reshape(-1)
        out.append(np.where(labels >= 0, known + first, -1))
        first += len(labels) + 1
    return np.concatenate(out).astype(np.intp)


def joined_covariates(parts: Sequence[Part]) -> tuple[Covariate, ...]:
    """What the readings of each part may depend on: nothing in the others does."""
    made, first, n = [], 0, sum(len(p.rows) for p in parts)
    for part in parts:
        own = slice(first, first + len(part.rows))
        for v in part.model.covariates:
            every = np.full(n, v.values[0], dtype=np.asarray(v.values).dtype)  # labels as they are
            every[own] = v.values
            known = np.zeros(n, dtype=bool)
            known[own] = True if v.known is None else v.known
            name = f"{v.name} of {part.name}"
            readings = own.start, own.stop
            made.append(replace(v, name=name, values=every, known=known, readings=readings))
        first = own.stop
    return tuple(made)


def joined_replicates(parts: Sequence[Part]) -> Integers | None:
    """Labels of repeats, if all parts have them."""
    own = [p.model.replicates for p in parts]
    known = [np.asarray(labels) for labels in own if labels is not None]
    return joined_labels(known) if len(known) == len(own) else None


def joined_inputs(
    parts: Sequence[Part], at: Sequence[slice], own: Sequence[tuple[Floats, dict[str, Values]]]
) -> tuple[Input, ...]:
    """What the set-up states an uncertainty of: the same in all measurements that it acts in.

    ``own``: nuisance and effects of each part.
    """
    n = sum(len(p.model.readings) for p in parts)
    found: dict[str, tuple[Input, dict[float, Floats]]] = {}
    for part, some, (nuisance, effects) in zip(parts, at, own, strict=True):
        for one in part.model.inputs(nuisance, effects):
            columns = found.setdefault(one.name, (one, {}))[1]
            for i, key in enumerate(one.keys or map(float, range(one.columns.shape[1]))):
                columns.setdefault(key, np.zeros(n))[some] = one.columns[:, i]
    return tuple(
        replace(one, columns=np.column_stack([*columns.values()]), keys=tuple(columns))
        for one, columns in found.values()
    )


def joined_components(parts: Sequence[Part]) -> dict[str, Floats]:
    """How an unknown disturbance enters the readings, by name: not those of parts without it.

    That it enters all readings of a part alike has no name, as everywhere.
    """
    own = [p.model.components for p in parts]
    names = dict.fromkeys(name for components in own for name in components if name)
    none = [np.zeros(len(p.rows)) for p in parts]
    return {
        name: np.concatenate([x.get(name, zero) for x, zero in zip(own, none, strict=True)])
        for name in names
    }


def joined_dictionary(model: Model, whiten: Whiten, parts: Sequence[Part]) -> Dictionary | None:
    """Structure of each part, by the noise that it has; None: whitened otherwise."""
    if not isinstance(whiten, Whiteners):
        return None
    own = zip((at for at, _ in whiten.parts), (p.dictionary for p in parts), strict=True)
    return Dictionary.joined(model, whiten, list(own))


def fitted_of(parts: Sequence[Part], index: Sequence[Integers], start: Floats) -> Floats:
    """What is always fitted as the diagnosis of each part has it, the first of those that share it.

    ``index``: of each part, which of all that are; ``start``: where a part has no such diagnosis.
    """
    out = start.copy()
    for part, own in zip(reversed(parts), reversed(index), strict=True):
        if part.linearised is not None:
            out[own] = part.linearised.nuisance
    return out


def places_of(
    parts: Sequence[Part], effects: Sequence[Effect], acting: Mapping[str, Sequence[Acts]]
) -> dict[int, Values]:
    """Places of effects that act on one part, which that found beside those of their grids."""
    out: dict[int, Values] = {}
    for j, effect in enumerate(effects):
        acts = acting.get(effect.id, ())
        known = parts[acts[0].part].linearised if len(acts) == 1 else None
        place = None if known is None else known.place(acts[0].effect.id)
        if place is not None:
            out[j] = effect.values(place.values())
    return out


def with_odds(
    effects: Iterable[Effect], acts: Mapping[str, Sequence[Acts]], parts: Sequence[Part]
) -> tuple[Effect, ...]:
    """Return effects with the count of candidates that each is one of, and those it is not beside.

    The first of those of its own measurement, so that another one that says nothing of it makes it
    neither more nor less probable; where several see it, their geometric mean. A change between
    dates, which ``acts`` has not, is one of all candidates. The second as its measurement has them.
    And whether one kind alone shows each.
    """
    called: dict[tuple[int, str], str] = {}
    for id_, some in acts.items():
        for one in some:
            called.setdefault((one.part, one.effect.id), id_)
    out, kinds = [], {part.kind for part in parts}
    for effect in effects:
        seen = {one.part for one in acts.get(effect.id, ())}
        alone = len({parts[i].kind for i in seen}) == 1 < len(kinds)
        counts = [math.log(parts[i].among) for i in seen]
        among = math.exp(sum(counts) / len(counts)) if counts else 0.0
        own = {
            called[one.part, other]
            for one in acts.get(effect.id, ())
            for other in one.effect.instead_of
        }
        instead_of = (*effect.instead_of, *sorted(own))
        out.append(replace(effect, among=among, instead_of=instead_of, of_one_kind=alone))
    return tuple(out)


def size_of(what: str, error: Nuisance) -> Parameter:
    """Return the size of what happens to an error, as a parameter in its unit."""
    return Parameter(f"{what}_{UNIT_NAMES.get(error.unit, error.unit)}", error.unit)


def are_alike(first: Effect, other: Effect) -> bool:
    """Whether two effects have the same parameters, or one each in the same unit."""
    if len(first.parameters) == len(other.parameters) == 1:
        one, two = first.parameters[0], other.parameters[0]
        return one.linear and two.linear and one.unit == two.unit
    names = [p.name for p in first.parameters]
    return names == [p.name for p in other.parameters] and first.linear == other.linear


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ExtendedJoint(Estimate):
    """What several measurements say of one machine.

    Attributes
    ----------
    measurements
        Their names, which stand in front of what is one measurement's own.
    """

    measurements: tuple[str, ...]

    @classmethod
    def of(
        cls,
        parts: Sequence[Part],
        values: Iterable[tuple[Nuisance, float]],
        found: Iterable[Effect],
        effects: EffectValues,
        idle: Mapping[str, str],
        uncertainty: Uncertainty | None,
    ) -> ExtendedJoint:
        """Return the machine by name, and what is each measurement's own.

        ``values``: of what is always fitted; ``found``: the effects that have values; ``idle``: of
        some of them, why they say nothing to a compensation.
        """
        own: dict[bool, dict[str, float]] = {True: {}, False: {}}
        for x, value in values:
            own[x.owner is Owner.MACHINE][x.name] = value
        found = list(found)
        return cls(
            **fields_of(parts),
            errors=own[True],
            placement=own[False],
            effects={k: dict(v) for k, v in effects.items()},
            owners={e.id: e.owner for e in found},
            motions={e.id: e.motion for e in found if e.motion is not None},
            not_compensable=dict(idle),
            **({} if uncertainty is None else uncertainty.fields()),
        )


def fields_of(parts: Sequence[Part]) -> dict[str, Any]:
    """Return fields of :class:`ExtendedJoint`: names, and what the location errors refer to."""
    found: dict[str, Any] = {"measurements": tuple(p.name for p in parts)}
    for p in reversed(parts):
        setup = getattr(p.model, "setup", None)
        if isinstance(setup, Setup) and p.model.location_errors(p.model.start, {}):
            own = made_with(setup, p.model.data)
            frame, known = own["control_frame"], found.get("control_frame")
            if frame is not None and known is not None:
                own["control_frame"] = frame.beside(known)
            found |= {k: v for k, v in own.items() if v is not None}
    return found
