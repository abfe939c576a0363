"""Several measurements of one machine as one model for the diagnosis engine.

Readings, what is always fitted and candidates of the measurements stand below each other. What is
the machine's is one parameter that acts on every measurement: location errors of one name, and
effects that :meth:`~trunnion.diagnosis.model.Model.shared` calls alike. All else belongs to one
measurement and has its name in front ("touches:probe_radius"): placements, instruments, artefacts,
what changes with time. An instrument that several measurements of a kind have in common
(:meth:`~trunnion.diagnosis.model.Model.instrument_size`) has the name of the first of them. Each
measurement has the noise that is left of it alone, less what no cause makes.

Measurements are in the order of time, of one kind on several dates. For each error and effect that
they share there is a further candidate: it changed before a later one ("touches 2:change_EX0C"); of
an effect also that it ended there ("touches 2:change_backlash_y_ended"), as one that was repaired.
Of what measurements of different kinds share there are candidates that one kind says otherwise than
the rest ("ballbar:differs_squareness_xy"): the measurements contradict each other.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.resolution import Grid
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.effect import Effect, EffectValues, Parameter, Values
from trunnion.diagnosis.joint_ids import Happened, JointId
from trunnion.diagnosis.model import Covariate, Model, Nuisance, Uncertainty
from trunnion.diagnosis.of_some import OfSome, Orthonormal
from trunnion.diagnosis.one_effect import OneEffect
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.whitening import Whiten, Whiteners
from trunnion.machine.budget import Input
from trunnion.machine.effects import Owner, Together
from trunnion.models.agreement import APART, LEVEL, effects_apart, errors_apart
from trunnion.models.one_bar import Instruments, ScaleAlike
from trunnion.models.other_places import left_by_places
from trunnion.models.parts import (
    Acts,
    Change,
    ExtendedJoint,
    Part,
    are_alike,
    fitted_alone,
    fitted_of,
    joined_components,
    joined_covariates,
    joined_dictionary,
    joined_inputs,
    joined_labels,
    joined_noise,
    joined_readings,
    joined_replicates,
    may_have_happened,
    places_of,
    size_of,
    with_odds,
)
from trunnion.setup.names import shared_label


class JointModel(Model):
    """Several measurements of one machine, as the diagnosis engine asks for them.

    Parameters
    ----------
    parts
        The measurements, at least two.
    binder
        Makes this model of other measurements.
    before
        The model of the first of these parts: what several measurements may have in common or may
        differ in stays as it is there, whatever the further parts show.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        binder: Callable[[Sequence[Any]], Model] | None = None,
        before: JointModel | None = None,
    ) -> None:
        self.parts = tuple(parts)
        self.data = tuple(p.model.data for p in parts)
        self._binder = binder
        ends = np.cumsum([0, *(len(p.model.readings) for p in parts)])
        self._at = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self.readings = joined_readings(self.parts)
        self.known_noise = joined_noise(self.parts, self._at)
        self._join_nuisance()
        self._join_effects(before)

    def _join_nuisance(self) -> None:
        joined: dict[str, Nuisance] = {}
        start: list[float] = []
        index: list[Integers] = []
        for part in self.parts:
            mine = []
            for x, value in zip(part.model.nuisance, part.model.start, strict=True):
                name = x.name if x.owner is Owner.MACHINE else f"{part.name}:{x.name}"
                if name not in joined:
                    joined[name] = replace(x, name=name)
                    start.append(float(value))
                mine.append(list(joined).index(name))
            index.append(np.array(mine, dtype=np.intp))
        self.nuisance = tuple(joined.values())
        self._start = np.array(start)
        self._index = index
        self._fitted_alone = fitted_alone(index)

    def _join_effects(self, before: JointModel | None) -> None:
        self._acts: dict[str, list[Acts]] = {}
        instruments = Instruments()
        self._changes: dict[str, Change] = {}
        self._plain: dict[int, tuple[Floats, Floats]] = {}  # derivatives, where they were asked for
        made: dict[str, Effect] = {}
        for i, part in enumerate(self.parts):
            for own in part.model.effects:
                known = part.model.shared(own)
                id_, sign = (instruments.id_of(part, own), 1.0) if known is None else known
                if id_ in made and not are_alike(made[id_], own):
                    id_, sign = f"{part.name}:{own.id}", 1.0
                self._acts.setdefault(id_, []).append(Acts(i, own, sign))
                if id_ not in made:
                    label = own.label or own.id.replace("_", " ")
                    label = shared_label(id_, label) if ":" not in id_ else f"{label} ({part.name})"
                    made[id_] = self._effect(id_, own.parameters, label, own.owner, own)
        alike = instruments.scale_alike(self._acts, [part.kind for part in self.parts])
        self.alike: ScaleAlike = alike if before is None else before.alike
        for id_ in instruments.ids:
            first, one = self._acts[id_][0].effect, made[id_]
            label = first.label if len(self._acts[id_]) > 1 else one.label
            looks_like = "" if self.alike.axes else first.looks_like
            made[id_] = replace(one, label=label, looks_like=looks_like)
        self.apart: dict[str, tuple[str, str]] = {}  # which kind differs in what, by candidate
        if self.alike.axes:
            self._acts[self.alike.id] = self.alike.acts(self._acts)
            made[self.alike.id] = self._scale_alike([made[id_] for id_ in self.alike.scales])
        further = self._of_several(made) if before is None else self._kept(before)
        # Columns of the same readings one after the other: the engine works on them together.
        every = [*made.values(), *further]
        self._only = {effect.id: self._of_one_part(effect) for effect in every}
        every.sort(key=lambda effect: self._only[effect.id])
        self.effects = with_odds(every, self._acts, self.parts)

    def _scale_alike(self, scales: Sequence[Effect]) -> Effect:
        own = self._effect(self.alike.id, scales[0].parameters, self.alike.label, scales[0].owner)
        motions = tuple(e.motion for e in scales if e.motion is not None)
        moved = Together(motions) if motions else None
        return replace(own, motion=moved, instead_of=self.alike.scales)

    def _of_several(self, made: Mapping[str, Effect]) -> Iterator[Effect]:
        """What several measurements may differ in."""
        yield from self._possible_changes(made)
        yield from self._possible_differences(made)

    def _kept(self, before: JointModel) -> Iterator[Effect]:
        """What the first of the parts may differ in, as the model of them has it."""
        self.apart, self._changes = before.apart, before._changes
        for effect in before.effects:
            if effect.id in self._changes:
                bound = OneEffect(self, effect.id)
                yield replace(effect, change=bound.change, jacobian=bound.jacobian)

    def _effect(
        self,
        id_: str,
        parameters: tuple[Parameter, ...],
        label: str,
        owner: Owner,
        own: Effect | None = None,
        level: float = 0.0,
    ) -> Effect:
        own_fields = ("motion", "least", "stated", "near_any", "sought")
        known = {} if own is None else {k: getattr(own, k) for k in own_fields}
        f = OneEffect(self, id_)
        return Effect(id_, parameters, f.change, f.jacobian, label, owner, level=level, **known)

    def ids_of_part(self, i: int) -> dict[str, str]:
        """What this model calls the effects of one part, by their ids there."""
        own = {k: acts for k, acts in self._acts.items() if k != self.alike.id}
        return {a.effect.id: id_ for id_, acts in own.items() for a in acts if a.part == i}

    def _possible_changes(self, made: Mapping[str, Effect]) -> Iterator[Effect]:
        """Changes of what several measurements of a kind see, before or in a later one of them."""
        kinds = [part.kind for part in self.parts]
        for i, part in enumerate(self.parts):
            for k in sorted(set(self._index[i].tolist())):
                x, seeing = self.nuisance[k], [j for j, own in enumerate(self._index) if k in own]
                for one in may_have_happened(i, seeing, kinds):
                    size = (size_of("change", x),)
                    yield self._happened(Change(i, one, error=x.name), size, x.name, x.owner)
            for shared, acts in list(self._acts.items()):
                effect, count = made[shared], Counter(a.part for a in acts)
                # All axes alike: only where dates see several of them.
                least = 2 if shared == self.alike.id else 1
                seeing = [j for j in sorted(count) if count[j] >= least]
                changes = may_have_happened(i, seeing, kinds) if effect.linear else ()
                own = effect.parameters, effect.label, effect.owner
                for one in changes:
                    yield self._happened(Change(i, one, effect=shared), *own)
                if changes:
                    ended = self._happened(Change(i, Happened.ENDED, effect=shared), *own)
                    changed = Happened.CHANGED.id(part.name, JointId.of(shared).cause)
                    # Any two of the three are the same: a size on each date.
                    yield replace(ended, instead_of=(shared, changed))

    def _possible_differences(self, made: Mapping[str, Effect]) -> Iterator[Effect]:
        """What one kind of measurement sees otherwise than the others that share it."""
        kinds, happened = [part.kind for part in self.parts], Happened.DIFFERS
        for kind, k in errors_apart(self.parts, self._index):
            x = self.nuisance[k]
            change, size = Change(kinds.index(kind), happened, error=x.name), size_of("differs", x)
            yield self._happened(change, (size,), x.name, x.owner, LEVEL)
        acting = {shared: acts for shared, acts in self._acts.items() if made[shared].linear}
        for kind, shared, level in effects_apart(self.parts, acting, self.alike.id):
            change, one = Change(kinds.index(kind), happened, effect=shared), made[shared]
            yield self._happened(change, one.parameters, one.label, one.owner, level)

    def _happened(
        self,
        change: Change,
        parameters: tuple[Parameter, ...],
        label: str,
        owner: Owner,
        level: float = 0.0,
    ) -> Effect:
        """Candidate that something happened to an error or an effect, of a label."""
        part, differs = self.parts[change.since], change.happened is Happened.DIFFERS
        where, name = part.kind if differs else part.name, change.error or change.effect
        id_ = change.happened.id(where, JointId.of(name).cause)
        self._changes[id_] = change
        if differs:
            self.apart[id_] = where, name
        words = change.happened.label(label, where)
        return self._effect(id_, parameters, words, owner, level=level)

    # --- the model

    @property
    def start(self) -> Floats:
        """Values that the parts start from."""
        return self._start.copy()

    @property
    def known_alone(self) -> tuple[Floats, dict[int, Values]]:
        """What the diagnosis of each part found of what is its own."""
        places = places_of(self.parts, self.effects, self._acts)
        return fitted_of(self.parts, self._index, self.start), places

    def dictionary(self, whiten: Whiten) -> Dictionary | None:
        """Structure without a name: that of the parts, by the noise that these have."""
        return joined_dictionary(self, whiten, self.parts)

    def left_by_places(self, effects: EffectValues) -> Mapping[tuple[str, str], float]:
        """Of changes between measurements at other places, and differences of kinds."""
        return left_by_places(self, self._acts, self._changes, effects)

    def of_part(
        self, i: int, nuisance: Floats, effects: EffectValues
    ) -> tuple[Floats, dict[str, Values]]:
        """Nuisance and effects of one part."""
        at = np.array(nuisance[self._index[i]])
        own: dict[str, Values] = {}

        def add(id_: str, values: Mapping[str, float]) -> None:
            for acts in self._acts[id_]:
                if acts.part == i:
                    sizes = zip(acts.effect.parameters, values.values(), strict=True)
                    known: Mapping[str, float] = own.get(acts.effect.id, {})
                    own[acts.effect.id] = Values(
                        {
                            p.name: (acts.sign * v + known.get(p.name, 0.0)) if p.linear else v
                            for p, v in sizes
                        }
                    )

        for id_, values in effects.items():
            change = self._changes.get(id_)
            if change is None:
                add(id_, values)
            elif self._concerns(i, change):
                if change.effect:
                    add(change.effect, values)
                else:
                    at[self._position(i, change.error)] += next(iter(values.values()))
        return at, own

    def _concerns(self, i: int, change: Change) -> bool:
        """Whether a change acts on a part, if it has that."""
        has = not change.error or self._position(i, change.error) >= 0
        return has and change.acts_on(i, [part.kind for part in self.parts])

    def _position(self, i: int, error: str) -> int:
        return next((k for k, x in enumerate(self.parts[i].model.nuisance) if x.name == error), -1)

    def predict(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Return the readings of all parts, shape (n,)."""
        acting = {k: values for k, values in effects.items() if any(values.values())}
        own = (p.predicted(*self.of_part(i, nuisance, acting)) for i, p in enumerate(self.parts))
        return np.concatenate(list(own))

    def jacobian(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Return the derivative by what is always fitted, shape (n, p)."""
        out = np.zeros((len(self.readings), len(self.nuisance)))
        for i, part in enumerate(self.parts):
            at = self._at[i], self._index[i]
            out[at] = part.model.jacobian(*self.of_part(i, nuisance, effects))
        return out

    def effect_jacobian(
        self, nuisance: Floats, effect: Effect, values: Mapping[str, float]
    ) -> Floats:
        """Return the derivative by one effect's parameters, shape (n, k)."""
        out = np.zeros((len(self.readings), len(effect.parameters)))
        for some, own in self._of_error(nuisance, effect):
            out[some, 0] = own
        for acts in self._acting(effect):
            at, model = nuisance[self._index[acts.part]], self.parts[acts.part].model
            own = model.effect_jacobian(at, acts.effect, acts.values(values))
            out[self._at[acts.part]] += own * acts.signs
        return out

    def linear_columns(
        self, nuisance: Floats, effect: Effect, values: Sequence[Mapping[str, float]]
    ) -> Floats:
        """Return the derivative by linear parameters at each of some values, (v, k, n)."""
        count = sum(p.linear for p in effect.parameters)
        out = np.zeros((len(values), count, len(self.readings)))
        for some, own in self._of_error(nuisance, effect):
            out[:, 0, some] = own
        for acts in self._acting(effect):
            at, model = nuisance[self._index[acts.part]], self.parts[acts.part].model
            own = model.linear_columns(at, acts.effect, [acts.values(one) for one in values])
            out[:, :, self._at[acts.part]] += own * acts.sign
        return out

    def white_columns(
        self, nuisance: Floats, effect: Effect, values: Sequence[Values], whiten: Whiten
    ) -> Floats:
        """Return these whitened, (v, n, k): of each part what its own diagnosis had, if it may."""
        if not isinstance(whiten, Whiteners):
            return super().white_columns(nuisance, effect, values, whiten)
        count = sum(p.linear for p in effect.parameters)
        out = np.zeros((len(values), count, len(self.readings)))
        for some, own in self._white_of_parts(nuisance, effect, values, whiten):
            out[:, :, some] += own
        return out.transpose(0, 2, 1)

    def white_piece(
        self, nuisance: Floats, effect: Effect, values: Sequence[Values], whiten: Whiten
    ) -> Floats | OfSome | Orthonormal:
        """Return the same; what one part alone has, of its readings only."""
        if not isinstance(whiten, Whiteners) or len(self.readings) >= MANY_ROWS:
            return self.white_columns(nuisance, effect, values, whiten)

        def whole() -> OfSome:
            ((at, columns),) = self._white_of_parts(nuisance, effect, values, whiten)
            return OfSome(columns.transpose(0, 2, 1), at)

        i, acting = self._only[effect.id], list(self._acting(effect))
        if i < 0 or len(acting) > 1:
            return self.white_columns(nuisance, effect, values, whiten)
        known = acting and i in self._fitted_alone
        made = self.parts[i].orthonormal(acting[0], values, whole, self._at[i]) if known else None
        return whole() if made is None else made

    def _white_of_parts(
        self, nuisance: Floats, effect: Effect, values: Sequence[Values], whiten: Whiteners
    ) -> Iterator[tuple[slice, Floats]]:
        """White columns in each part that an effect changes: its readings, and theirs (v, k, m)."""
        own_of = {at.start: own for at, own in whiten.parts}
        for some, own in self._of_error(nuisance, effect):
            yield some, np.broadcast_to(own_of[some.start](own), (len(values), 1, len(own)))
        for acts in self._acting(effect):
            part = self.parts[acts.part]
            at = nuisance[self._index[acts.part]]
            alike = acts.effect.parameters is effect.parameters  # columns do not hang on sizes
            places = values if alike else [acts.values(one) for one in values]
            yield self._at[acts.part], part.white_columns(at, acts, places)

    def _of_one_part(self, effect: Effect) -> int:
        """The part that an effect or a change acts on; -1: several of them."""
        some = {acts.part for acts in self._acting(effect)}
        if (change := self._changes.get(effect.id)) is not None and change.error:
            some = {i for i in range(len(self.parts)) if self._concerns(i, change)}
        return some.pop() if len(some) == 1 else -1

    def _acting(self, effect: Effect) -> Iterator[Acts]:
        """How an effect, or the change of one, acts on each part that it concerns."""
        change = self._changes.get(effect.id)
        if change is None:
            yield from self._acts[effect.id]
        elif change.effect:
            yield from (a for a in self._acts[change.effect] if self._concerns(a.part, change))

    def _of_error(self, nuisance: Floats, effect: Effect) -> Iterator[tuple[slice, Floats]]:
        """Derivative by the change of an error: the rows of a part, and theirs; else nothing."""
        change = self._changes.get(effect.id)
        if change is None or not change.error:
            return
        for i, part in enumerate(self.parts):
            if self._concerns(i, change):
                at = nuisance[self._index[i]]
                known = self._plain.get(i)
                if known is None or not np.array_equal(known[0], at):
                    known = self._plain[i] = at, part.model.jacobian(at, {})
                yield self._at[i], known[1][:, self._position(i, change.error)]

    # --- what the engine asks

    @cached_property
    def grid(self) -> Grid | None:
        """The steps of each part, as its own diagnosis found them."""
        return Grid.joined([(p.grid, len(p.model.readings)) for p in self.parts])

    @property
    def allows_outliers(self) -> bool:
        """No: those of each part are set aside before."""
        return False

    @cached_property
    def covariates(self) -> tuple[Covariate, ...]:
        """Those of each part: what is left of one says nothing of another."""
        return joined_covariates(self.parts)

    @cached_property
    def components(self) -> Mapping[str, Floats]:
        """Those of each part."""
        return joined_components(self.parts)

    @property
    def groups(self) -> Integers:
        """The groups of each part."""
        return joined_labels([np.asarray(p.model.groups) for p in self.parts])

    @property
    def replicates(self) -> Integers | None:
        """The repeats of each part."""
        return joined_replicates(self.parts)

    @property
    def rank_tolerance(self) -> float:
        """The largest of the parts'."""
        return max(p.model.rank_tolerance for p in self.parts)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Of each part, with its name."""
        return tuple(f"{p.name}: {text}" for p in self.parts for text in p.model.remarks)

    def inputs(self, nuisance: Floats, effects: EffectValues) -> tuple[Input, ...]:
        """What the set-up states an uncertainty of, in all parts that it acts in."""
        own = [self.of_part(i, nuisance, effects) for i in range(len(self.parts))]
        return joined_inputs(self.parts, self._at, own)

    def bind(self, data: Any) -> Model:
        """Return the model of other measurements, in the same order."""
        if self._binder is None or not isinstance(data, list | tuple):
            raise InputError(
                f"other data: got {type(data).__name__}, expected a list of measurements"
            )
        return self._binder(data)

    def location_errors(self, nuisance: Floats, effects: EffectValues) -> dict[str, float]:  # noqa: ARG002
        """Return the machine's errors, by the first measurement that has them."""
        out: dict[str, float] = {}
        for i, part in enumerate(self.parts):
            out = {**part.model.location_errors(*self.of_part(i, nuisance, {})), **out}
        return {k: v for k, v in out.items() if k in {x.name for x in self.nuisance}}

    def extended(
        self, nuisance: Floats, effects: EffectValues, uncertainty: Uncertainty | None = None
    ) -> ExtendedJoint:
        """Return the machine by name, and what is each measurement's own."""
        found = [e for e in self.effects if e.id in effects]
        named = list(zip(self.nuisance, nuisance.tolist(), strict=True))
        idle = {e.id: why for e in found if (why := self._idle(e.id, effects))}
        return ExtendedJoint.of(self.parts, named, found, effects, idle, uncertainty)

    def _idle(self, id_: str, effects: EffectValues) -> str:
        """Why an effect, beside the others of a set, says nothing to a compensation; or nothing."""
        if ":" in id_:
            return f"it belongs to {id_.partition(':')[0]}"
        if id_ == self.alike.id:
            return self.alike.why_idle
        return APART if any(self.apart.get(i, ("", ""))[1] == id_ for i in effects) else ""
