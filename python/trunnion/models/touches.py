"""Touches on the diagnosis engine.

A reading is the recorded coordinate along the approach, in µm. Location errors belong to the
machine and are kept on other touches; the placement of the artefact is fitted anew. Candidates are
the whole catalogue of effects for which the touches have the columns, and a user's own. Readings
and derivatives are the core's, exact.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.arguments import checked
from trunnion.base.errors import DataError, InputError
from trunnion.base.rows import repeats
from trunnion.base.units import Floats, Integers
from trunnion.data.times import elapsed_s
from trunnion.data.touches import Touches
from trunnion.diagnosis.effect import ALL_AXES, Effect, EffectLike, EffectValues, Parameter, Values
from trunnion.diagnosis.jumps import moments_tried
from trunnion.diagnosis.model import Covariate, Model, Nuisance, Readings, Uncertainty
from trunnion.diagnosis.one_effect import OneEffect
from trunnion.diagnosis.own_effects import with_own
from trunnion.diagnosis.ways import angles
from trunnion.machine.budget import Input
from trunnion.machine.chain import Chain
from trunnion.machine.effects import PLACEMENT, EffectInfo, Owner
from trunnion.machine.estimate import Estimate
from trunnion.machine.geometry import made_with
from trunnion.models.breaks import ZeroShift, break_of, zero_shifts
from trunnion.models.slips import SLIP, TURN, SlipTurn, show_a_turn, turned_apart
from trunnion.models.touch_description import TouchDescription, nominal_mm
from trunnion.models.warming import settled
from trunnion.probing.identify import mistakes_in
from trunnion.probing.inputs import OnMachine, inputs_of, stated_of, turning
from trunnion.probing.lateness import DELAYS
from trunnion.probing.model import (
    UNKNOWN_TICK,
    TouchModel,
    known_sigma_um,
    seen_steps_um,
    steps_um,
    stops_of,
)
from trunnion.probing.recorded import coordinates_um, readings_um, recorded_um
from trunnion.setup import Setup

MAX_KEPT = 1_000_000
"""Numbers of derivatives that are kept beside the last."""
MAX_FITS = 16
"""Residuals that are kept."""
MINUTES = 1.0  # time constant at which an effect with one is linearised
DURATIONS = 10
MIN_BESIDE_SLIP = 5  # touches; fewer of them look like outliers
MAX_DISTANCE_UM = 5000.0
UNITS = {"um": "µm", "um/h": "µm/h"}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ExtendedTouchModel(Estimate):
    """What a diagnosis of touches says of the machine, ready for the other functions.

    ``tn.identify(data, m.setup, effects=m)``, ``tn.simulate(plan, m.setup, m)`` and
    ``tn.volumetric_error(m.setup, m)`` take it.

    Attributes
    ----------
    setup
        The set-up of the measurement.
    """

    setup: Setup

    def simulate(self, plan: Touches, **more: Any) -> Touches:
        """Simulate a plan on this machine; ``more`` goes to :func:`trunnion.simulate`."""
        from trunnion.probing.simulate import simulate

        return simulate(plan, self.setup, self, **more)


class TouchDiagnosisModel(Model):
    """Touches of an artefact, as the diagnosis engine asks for them.

    Parameters
    ----------
    data
        Measured touches.
    setup
        Machine, artefact and probe.
    effects
        Further candidates: a user's own effects, or ids.
    """

    def __init__(
        self, data: Touches, setup: Setup, effects: Sequence[EffectLike | str] = ()
    ) -> None:
        self.data = data
        self.setup = setup
        chain = Chain(setup)
        known = chain.catalogue()
        infos = [i for i in known if all(getattr(data, n, None) is not None for n in i.needs)]
        self._ids = [i.id for i in infos]
        self._full = TouchModel(setup, self._ids, chain=chain)
        self._moves = self._full.moves(data)
        self._plain = self._full.names.index("rc_arcsec") + 1
        self._unknown = np.flatnonzero(self._full.unknown[: self._plain])
        place = {name: n for n, name in enumerate(self._full.names)}
        self._columns = {i.id: [place[f"{i.id}.{p.name}"] for p in i.parameters] for i in infos}
        self._turns = SLIP in self._columns and bool(self._full.unknown[place[TURN]])
        if self._turns:
            self._columns[SLIP].insert(-1, place[TURN])
        kinds = self._full.kinds
        self._linear = {k: [c for c in v if kinds[c] == "linear"] for k, v in self._columns.items()}
        self._searched = {
            k: kinds[c] for k, v in self._columns.items() for c in v if kinds[c] != "linear"
        }
        self.nuisance = tuple(
            Nuisance(
                name,
                UNITS.get(unit, unit),
                Owner.MACHINE if name in self._full.error_names else Owner.PLACEMENT,
            )
            for name, unit in (
                (self._full.names[i], self._full.units[i]) for i in self._unknown.tolist()
            )
        )
        self.readings = Readings(
            readings_um(data),
            np.arange(len(data)),
            "µm",
            np.full(len(data), sigma) if (sigma := known_sigma_um(setup, data)) else None,
            steps if np.any(steps := steps_um(setup, data)) else None,
            recorded_um(data),
            coordinates_um(data),
            hint=UNKNOWN_TICK,
            clocked=seen if np.any(seen := seen_steps_um(setup, data)) else None,
        )
        self._start = self._full.values()[self._unknown]
        self._models: dict[tuple[str, ...], TouchModel] = {}
        self._at: dict[bytes, Floats] = {}
        self._left: dict[tuple[tuple[str, ...], bytes], Floats] = {}
        self._given = tuple(effects)
        self._stated = stated_of(setup)
        self._zeros = zero_shifts(data) if "drift_x" in self._columns else {}
        named = [*map(self._effect, infos), *map(self._zero, self._zeros.values())]
        self.effects = with_own(named, effects, data, known=[i.id for i in known], described=self)
        self._own = self.effects[len(infos) :]
        self._check_on_surface()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what it is made of: the core's model is made anew."""
        return type(self), (self.data, self.setup, self._given)

    # --- the model

    def mistakes(self, causes: EffectValues) -> tuple[str, ...]:
        """Likely mistakes of the measurement, beside what these causes change."""
        known = [e for e in self.effects if e.id in causes and e.id not in DELAYS]
        own = [self.effect_jacobian(self.start, e, causes[e.id]) for e in known]
        beside = np.hstack([np.empty((len(self.data), 0)), *own])
        return mistakes_in(self._model(()), self.data, self._moves, beside)

    @property
    def start(self) -> Floats:
        """Location errors known beforehand, artefact where it should be."""
        return self._start.copy()

    def predict(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Return readings, µm; built-in effects act together in the core, a user's own is added."""
        ids, values = self._vector(nuisance, effects)
        left = self._residuals(ids, values)
        slip = effects.get(SLIP, {})
        if turned := slip.get(TURN, 0.0):
            values = values.copy()
            after = np.asarray(self.data.time_s) >= slip["t0_s"]
            values[self._plain - 1] += turned * show_a_turn(after)
            left = np.where(after, self._residuals(ids, values), left)
        out: Floats = self.readings.values - left
        for e in self._own:
            if e.id in effects:
                out = out + np.asarray(e.change(Values(effects[e.id])), dtype=np.float64)
        return out

    def _residuals(self, ids: tuple[str, ...], values: Floats) -> Floats:
        """Residuals under built-in effects; several ask for those of one fit: they are kept."""
        key = ids, values.tobytes()
        if key not in self._left:
            left = np.asarray(self._model(ids).core.residuals(self._moves, values))
            while len(self._left) > min(MAX_KEPT // max(left.size, 1), MAX_FITS):
                del self._left[next(iter(self._left))]
            self._left[key] = left
        return self._left[key]

    def jacobian(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Exact derivative by location errors and placement."""
        ids, values = self._vector(nuisance, effects)
        known = self._at.get(nuisance.tobytes())
        if known is not None and not values[self._plain :].any():
            return np.asarray(known[self._unknown].T)
        return np.asarray(self._rates(self._model(ids), values, self._unknown.tolist()).T)

    def effect_jacobian(
        self, nuisance: Floats, effect: Effect, values: Mapping[str, float]
    ) -> Floats:
        """Exact derivative by an effect's parameters."""
        if effect.id not in self._columns:
            return effect.columns(values)
        if self._searched.get(effect.id) == "duration":
            ids, at = self._vector(nuisance, {effect.id: values})
            every = range(self._plain, len(at))
            return np.asarray(self._rates(self._model(ids), at, every).T)
        columns = self._all_columns(nuisance)[self._columns[effect.id]]
        return self._in_force(effect, columns, values).T

    def derivatives(
        self, nuisance: Floats, effects: Sequence[Effect], values: EffectValues
    ) -> list[Floats]:
        """Exact derivatives of a fit; unless those of the catalogue are known, of it alone."""
        named = {e.id for e in effects}
        ids = tuple(i for i in self._ids if i in named and self._searched.get(i) != "duration")
        if not ids or nuisance.tobytes() in self._at:
            return super().derivatives(nuisance, effects, values)
        model = self._model(ids)
        first = self._plain - 1  # that of a turn
        rates = self._of_catalogue(model, nuisance, range(first, len(model.names)))
        found = [self.jacobian(nuisance, values)]
        for e in effects:
            if e.id in ids:
                names = [self._full.names[c] for c in self._columns[e.id]]
                at = [model.names.index(name) - first for name in names]
                found.append(self._in_force(e, rates[at], values[e.id]).T)
            else:
                found.append(self.effect_jacobian(nuisance, e, values[e.id]))
        return found

    def linear_columns(
        self, nuisance: Floats, effect: Effect, values: Sequence[Mapping[str, float]]
    ) -> Floats:
        """Exact derivative by an effect's linear parameters, a column a row, (v, k, n)."""
        if effect.id not in self._columns:
            return super().linear_columns(nuisance, effect, values)
        columns = self._all_columns(nuisance)[self._linear[effect.id]]
        if effect.id in self._searched:
            share = self._share(effect, values)
            return self._turned(effect, columns * share, share)
        return columns[None] if len(values) == 1 else np.repeat(columns[None], len(values), axis=0)

    def _in_force(self, effect: Effect, columns: Floats, values: Mapping[str, float]) -> Floats:
        """Columns (k, n) of an effect from its moment on, where it has one."""
        if self._searched.get(effect.id) != "moment":
            return columns
        share = self._share(effect, [values])
        return np.asarray(self._turned(effect, columns * share, share)[0])

    def _turned(self, effect: Effect, columns: Floats, share: Floats) -> Floats:
        """Columns (v, k, n) of a slip, which turns where touches on both sides show it."""
        if effect.id == SLIP and self._turns:
            at = self._columns[SLIP].index(self._plain - 1)
            columns[:, at] *= [[show_a_turn(one[0])] for one in share]
        return columns

    def _share(self, effect: Effect, values: Sequence[Mapping[str, float]]) -> Floats:
        """What is there at each touch of an effect that begins or comes to its end, (v, 1, n).

        From each of its moments on all of it, or by each of its time constants.
        """
        searched = next(p.name for p in effect.parameters if not p.linear)
        at = np.array([one[searched] for one in values])[:, None, None]
        if self._searched[effect.id] == "moment":
            return np.asarray(np.asarray(self.data.time_s) >= at, dtype=np.float64)
        return settled(self._minutes, at)

    def _vector(self, nuisance: Floats, effects: EffectValues) -> tuple[tuple[str, ...], Floats]:
        """Built-in effects among these, and the core's parameter vector for them."""
        ids = tuple(i for i in self._ids if i in effects)
        every = [self._full.names[c] for i in ids for c in self._columns[i] if c >= self._plain]
        names = [name.split(".", 1) for name in every]
        own = [float(effects[i][name]) for i, name in names]
        return ids, np.concatenate([self._whole(nuisance), own])

    def _whole(self, nuisance: Floats) -> Floats:
        """Location errors and placement, 0 where the placement is no unknown."""
        values = np.zeros(self._plain)
        values[self._unknown] = nuisance
        return values

    def _all_columns(self, nuisance: Floats) -> Floats:
        """Return the derivative by every parameter of the catalogue, no effect acting, (p, n).

        A search goes back and forth between a few states: their derivatives are kept.
        """
        key = nuisance.tobytes()
        if key not in self._at:
            jac = self._of_catalogue(self._full, nuisance, range(len(self._full.names)))
            while len(self._at) > MAX_KEPT // max(jac.size, 1):
                del self._at[next(iter(self._at))]
            self._at[key] = jac
        return self._at[key]

    def _of_catalogue(self, model: TouchModel, nuisance: Floats, columns: Sequence[int]) -> Floats:
        """Return the derivative by some parameters of a model, no effect acting, (k, n).

        Those of effects with a moment or a time constant are as of effects that are all there.
        """
        values = np.zeros(len(model.names))
        values[: self._plain] = self._whole(nuisance)
        for n, kind in enumerate(model.kinds):
            if kind == "duration":
                values[n] = MINUTES
            elif kind == "moment":
                values[n] = float(self._times[0]) - 1.0
        rates = self._rates(model, values, columns)
        at = {column: row for row, column in enumerate(columns)}
        for id_, kind in self._searched.items():
            if kind == "duration" and id_ in model.effect_ids:
                share = settled(self._minutes, MINUTES)
                rows = [at[model.names.index(self._full.names[c])] for c in self._linear[id_]]
                rates[rows] /= np.where(share == 0.0, 1.0, share)  # nothing is there yet
        return rates

    def _rates(self, model: TouchModel, values: Floats, columns: Sequence[int]) -> Floats:
        """Return the derivative by some parameters of a model at some values, (k, n)."""
        return np.asarray(model.core.rates(self._moves, values[None], columns))

    def _model(self, ids: tuple[str, ...]) -> TouchModel:
        if ids not in self._models:
            self._models[ids] = TouchModel(self.setup, ids, chain=self._full.chain)
        return self._models[ids]

    def _effect(self, info: EffectInfo) -> Effect:
        """Present an entry of the catalogue to the engine."""
        bound = OneEffect(self, info.id)
        parameters = [self._parameter(p.name, p.unit, p.kind) for p in info.parameters]
        if info.id == SLIP and self._turns:
            parameters.insert(-1, Parameter(TURN, "arcsec"))
        return Effect(
            info.id,
            tuple(parameters),
            bound.change,
            bound.jacobian,
            label=info.label,
            owner=info.owner,
            needs=info.needs,
            stated=self._stated.get(info.id),
            looks_like=ALL_AXES if info.id == "artefact_expansion" else "",
        )

    def _zero(self, shift: ZeroShift) -> Effect:
        """Present the shifted zero of an axis to the engine."""
        machine = OnMachine(self._model(()), self.data, self._whole(self.start))
        return shift.bound(self.data, machine)

    @cached_property
    def _times(self) -> Floats:
        """Distinct times of the touches, s."""
        return np.unique(np.asarray(self.data.time_s))

    @property
    def _minutes(self) -> Floats:
        """Time of each touch since the first, min."""
        return elapsed_s(np.asarray(self.data.time_s)) / 60.0

    def _parameter(self, name: str, unit: str, kind: str) -> Parameter:
        unit = UNITS.get(unit, unit)
        if kind == "linear":
            return Parameter(name, unit)
        times = self._times
        if kind == "moment":
            between = (times[1:] + times[:-1]) / 2
            if (
                len(between) > 4 * MIN_BESIDE_SLIP
            ):  # among the first or last touches it looks like bad ones
                between = between[MIN_BESIDE_SLIP - 1 : -(MIN_BESIDE_SLIP - 1)]
            moments = moments_tried(between, len(self.data), break_of(times))
            return Parameter(name, unit, moments or (float(times[0]),))
        minutes = max(float(times[-1] - times[0]), 1.0) / 60.0
        grid = np.geomspace(minutes / 20, 1.5 * minutes, DURATIONS)
        return Parameter(name, unit, tuple(map(float, grid)), (minutes / 100, 20 * minutes))

    def inputs(self, nuisance: Floats, effects: EffectValues) -> tuple[Input, ...]:
        """Calibration of probe and artefact, temperature, steps of the rotary axes."""
        ids, values = self._vector(nuisance, effects)
        return inputs_of(self._model(ids), self._moves, self.data, values)

    # --- what the engine looks for structure in

    @cached_property
    def covariates(self) -> tuple[Covariate, ...]:
        """Axis positions, senses, time or order, feed, place, direction, face, point."""
        faces = Covariate("face", self._faces, classes=True)
        plain = TouchDescription(self.data).covariates
        at = len(plain) - (self.data.point is not None)
        return (*plain[:at], faces, *plain[at:])

    tool_sense = -1.0

    @cached_property
    def components(self) -> Mapping[str, Floats]:
        """A displacement along a machine axis, and the angle of a rotary one."""
        return {**TouchDescription(self.data).components, **angles(self.turning)}

    @cached_property
    def turning(self) -> Mapping[str, Floats]:
        """As each rotary axis stands further, from the model of the machine."""
        return turning(self._model(()), self._moves, self._whole(self.start))

    @cached_property
    def groups(self) -> Integers:
        """One position of the rotary axes is left out at a time."""
        return stops_of(self.data)

    @cached_property
    def replicates(self) -> Integers | None:
        """Touches of the same place from the same side, at the same feed and sense of turning."""
        data = self.data
        parts = [
            *(np.round(x, 3) for x in data.rotary_deg.values()),
            *(np.asarray(x, dtype=float) for x in data.rotary_dir.values()),
            *np.round(data.direction.T, 6),
            *np.round(nominal_mm(data).T, 1),
        ]
        if data.feed_mm_min is not None:
            parts.append(np.asarray(data.feed_mm_min))
        return repeats(parts)

    @property
    def _faces(self) -> NDArray[np.str_]:
        """Name of the touched face, from the nominal pose: "+X arm, top", "+Y side", ..."""
        return np.array(self._full.core.faces(self._moves))

    # --- what a user gets

    def bind(self, data: Any) -> TouchDiagnosisModel:
        """Return the same model on other touches of the same set-up."""
        if not isinstance(data, Touches):
            raise InputError(f"other data: got {type(data).__name__}, expected trunnion.Touches")
        return TouchDiagnosisModel(data, self.setup, self._given)

    def extended(
        self, nuisance: Floats, effects: EffectValues, uncertainty: Uncertainty | None = None
    ) -> ExtendedTouchModel:
        """Return errors, placement and effects by name, with the set-up."""
        named = {n.name: float(v) for n, v in zip(self.nuisance, nuisance, strict=True)}
        given = [x for x in self._given if not isinstance(x, str) and isinstance(x, Hashable)]
        own: dict[str, Any] = {**{x.id: x for x in given}, **self._zeros}
        fixed = [e.id for e in self._own if e.motion is None]
        known: dict[Any, dict[str, float]] = {own.get(k, k): dict(v) for k, v in effects.items()}
        owners = {e.id: e.owner for e in self.effects if e.id in effects}
        if TURN in known.get(SLIP, {}):  # the core's slip is a shift
            turn = SlipTurn(known[SLIP]["t0_s"])
            known[turn] = {TURN: known[SLIP].pop(TURN)}
            owners[turn.id] = turn.owner
        return ExtendedTouchModel(
            setup=self.setup,
            errors={n.name: named[n.name] for n in self.nuisance if n.owner is Owner.MACHINE},
            placement={name: named.get(name, 0.0) for name in PLACEMENT},
            effects=known,
            owners=owners,
            not_compensable={k: "it has no motion(pose, values)" for k in fixed if k in effects},
            **made_with(self.setup, self.data),
            **({} if uncertainty is None else turned_apart(uncertainty.fields())),
        )

    def _check_on_surface(self) -> None:
        off = np.abs(self.readings.values - self.predict(self._start, {}))
        worst = int(np.argmax(off))
        if off[worst] > MAX_DISTANCE_UM:
            raise DataError(
                f"touch of {self.data.place(worst)}: got a point {off[worst] / 1e3:.1f} mm from "
                f"the modelled surface, expected at most {MAX_DISTANCE_UM / 1e3:.0f} mm"
            )


described = TouchDescription


@checked
def build(
    data: Touches, setup: Setup | None, effects: Sequence[EffectLike | str] = ()
) -> TouchDiagnosisModel:
    """Build the model of touches; the set-up is needed."""
    if setup is None:
        raise InputError(
            "setup: missing, expected a set-up (TOML) with the machine, the artefact and the probe "
            "of these touches (trunnion init writes one)"
        )
    if not isinstance(setup, Setup):
        raise InputError(f"setup: got {type(setup).__name__}, expected the Setup of these touches")
    return TouchDiagnosisModel(data, setup, effects)
