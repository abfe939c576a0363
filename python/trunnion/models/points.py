"""Points on the diagnosis engine: features made by linear axes and measured outside the machine.

A feature programmed at q (mm, machine frame) lies at ``q + e(q)`` on the part, and the instrument
reads ::

    m = T_g R_g (q + e(q)) + noise

with one rigid placement T_g R_g a set-up (``group``), which is nuisance. A reading is one measured
coordinate, in µm, turned back into the machine frame by the placement of the plain fit. Effects
are what the axes do, ``e``; formulas and units are in docs/effects.md. Derivatives are exact.

What the axes of one machine do alike on every part is *named*; what is left but changes slowly from
place to place is *field*; what belongs to one hole and is there again when the hole is measured
again is *hole by hole*; the rest is the measurement. :func:`repeatable_part` tells them apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations, permutations
from typing import Any, cast

import numpy as np
from scipy import special

from trunnion.base.errors import DataError, InputError
from trunnion.base.smooth import Modes, SmoothField
from trunnion.data.points import Points
from trunnion.diagnosis.protocol import (
    Array,
    BaseModel,
    Covariate,
    Effect,
    EffectLike,
    EffectValues,
    IntArray,
    Nuisance,
    Parameter,
    Readings,
    Uncertainty,
    Values,
    lengths,
)
from trunnion.diagnosis.result import Diagnosis
from trunnion.machine.estimate import Estimate
from trunnion.machine.linear_axes import FieldMotion, LinearMotion, Travel, angular, bow
from trunnion.models.candidates import (
    effect_of_columns,
    for_compensation,
    own_effects,
    periodic_effect,
)

__all__ = ["ExtendedPoints", "FeatureScatter", "PointsModel", "RepeatablePart", "repeatable_part"]

AXES = "xyz"
FAR_OFF_MM = 5.0
FOLDS = 10
FOLD_SEED = 1
SAME_PLACE_MM = 1e-3
ARCSEC = np.pi / 648000
SHORTEST_PITCH_MM = 4.0
MOST_PITCHES = 400
MOST_MOMENTS = 48
OF_TIME = ("drift_x", "drift_y", "drift_z", "setup_shift")
#: Effects that are in the machine's own catalogue.
RIGID = ("scale_x", "scale_y", "scale_z", "squareness_xy", "squareness_xz", "squareness_yz")


# --- the model


class PointsModel(BaseModel):
    """Points, as the diagnosis engine wants them.

    Readings are row by row: X, Y (and Z) of row 0, then of row 1, ...

    Parameters
    ----------
    data
        Measured points.
    effects
        Further candidates: a user's own effects, or ids. ``change(data, values)`` gives the change
        of every reading, µm, in the machine frame.
    source
        The model whose smooth field and travel this one shares (``bind``); None: found here.
    """

    def __init__(
        self,
        data: Points,
        effects: Sequence[EffectLike | str] = (),
        source: PointsModel | None = None,
    ) -> None:
        self.data = data
        self.dimension = data.dimension
        nominal = data.nominal_mm
        self._labels, self._group = _groups(data)
        self._frames = [
            _Frame.of(nominal[self._group == g], data.measured_mm[self._group == g], str(label))
            for g, label in enumerate(self._labels)
        ]
        back = np.empty_like(nominal)
        for g, frame in enumerate(self._frames):
            mine = self._group == g
            back[mine] = frame.back(data.measured_mm[mine])
        deviation = (back - nominal) * 1e3
        self._check_near(deviation)
        n, d = nominal.shape
        self.readings = Readings(deviation.reshape(-1), np.repeat(np.arange(n), d), "µm")
        names = [f"d{a}_um" for a in AXES[:d]]
        names += ["rz_arcsec"] if d == 2 else ["rx_arcsec", "ry_arcsec", "rz_arcsec"]
        several = len(self._labels) > 1
        self.nuisance = tuple(
            Nuisance(f"{name} of {label}" if several else name, unit)
            for label in self._labels
            for name, unit in ((x, "arcsec" if "arcsec" in x else "µm") for x in names)
        )
        self._travel: _Travel = _Travel.of(nominal) if source is None else source._travel
        self._places = _places(nominal)
        catalogue = [_with_motion(e, self._travel.used) for e in _catalogue(data, self._travel)]
        self.field: _Field | None = (
            source.field if source is not None else self._field(deviation, catalogue)
        )
        if self.field is not None:
            catalogue.append(_field_effect(self.dimension, self.field))
        given = effects if source is None else source._own
        self._own: tuple[Effect, ...] = own_effects(given, [e.id for e in catalogue])
        self.effects = (*catalogue, *self._own)

    def _check_near(self, deviation: Array) -> None:
        off = np.linalg.norm(deviation, axis=1) * 1e-3
        worst = int(np.argmax(off))
        if off[worst] > FAR_OFF_MM:
            raise DataError(
                f"point of {self.data.place(worst)}: got a place {off[worst]:.1f} mm from where "
                f"the placement puts it, expected at most {FAR_OFF_MM:.0f} mm"
            )

    def _field(self, deviation: Array, catalogue: Sequence[Effect]) -> _Field | None:
        """Smooth field: sized on what no named linear effect explains, and orthogonal to those.

        So a straight line, a bow or a twist keeps its name, and the field is what has none.
        """
        start = np.zeros(len(self.nuisance))
        named = [e for e in catalogue if e.linear and e.id not in OF_TIME]
        columns = [e.columns(self.data, _zeros(e)) for e in named]
        base = np.concatenate([self.jacobian(start, {}), *columns], axis=1)
        size = lengths(base)
        left = deviation.reshape(-1)
        left = left - base @ (np.linalg.lstsq(base / size, left, rcond=1e-9)[0] / size)
        at = _first_of(self._places)
        mean = self._at_places(left.reshape(deviation.shape))
        modes = Modes.of(self._travel.field_places(self.data.nominal_mm[at]), mean)
        if modes is None:
            return None
        raw = _in_every_coordinate(
            modes.at(self._travel.field_places(self.data.nominal_mm)), self.dimension
        )
        k = len(start)
        taken = np.linalg.lstsq(base / size, raw, rcond=1e-9)[0] / size[:, None]
        parts = np.split(taken[k:], np.cumsum([x.shape[1] for x in columns])[:-1])
        return _Field(self._travel, modes, tuple(named), tuple(parts))

    def _at_places(self, x: Array) -> Array:
        """Mean of rows (n, d) over the features at each programmed place, (m, d)."""
        total = np.stack([np.bincount(self._places, c) for c in x.T], axis=1)
        return np.asarray(total / np.bincount(self._places)[:, None])

    # --- readings and derivatives

    def predict(self, nuisance: Array, effects: EffectValues) -> Array:
        """Return the readings, µm: errors of the axes, then the placement."""
        return self._placed(nuisance, self._shifted(effects))[0]

    def jacobian(self, nuisance: Array, effects: EffectValues) -> Array:
        """Exact derivative by the placement of each group."""
        return self._placed(nuisance, self._shifted(effects))[1]

    def effect_jacobian(
        self, nuisance: Array, effect: Effect, values: Mapping[str, float]
    ) -> Array:
        """Exact derivative by an effect's parameters: its columns, turned by the placement."""
        n, d = self.data.nominal_mm.shape
        columns = effect.columns(self.data, values).reshape(n, d, -1)
        out = np.empty_like(columns)
        for g in range(len(self._frames)):
            mine = self._group == g
            turn = _turn(self._own_part(nuisance, g)[d:])[0]
            out[mine] = np.einsum("ij,njk->nik", turn, columns[mine])
        return out.reshape(n * d, -1)

    def _shifted(self, effects: EffectValues) -> Array:
        """Where the features are on the part, mm."""
        e = np.zeros(len(self.readings))
        for name, values in effects.items():
            e += np.asarray(self.effect(name).change(self.data, Values(values)), dtype=float)
        return np.asarray(self.data.nominal_mm + 1e-3 * e.reshape(self.data.nominal_mm.shape))

    def _own_part(self, nuisance: Array, group: int) -> Array:
        k = len(self.nuisance) // len(self._frames)
        return nuisance[group * k : (group + 1) * k]

    def _placed(self, nuisance: Array, at: Array) -> tuple[Array, Array]:
        """Readings and their derivative by the nuisance, for features at ``at`` on the part."""
        n, d = at.shape
        k = len(self.nuisance) // len(self._frames)
        out = np.empty((n, d))
        jac = np.zeros((n, d, len(self.nuisance)))
        for g, frame in enumerate(self._frames):
            mine = np.flatnonzero(self._group == g)
            part = self._own_part(nuisance, g)
            turn, by_angle = _turn(part[d:])
            arm = at[mine] - frame.middle
            moved = arm @ turn.T + frame.middle - self.data.nominal_mm[mine]
            out[mine] = 1e3 * moved + part[:d]
            first = g * k
            for i in range(d):
                jac[mine, i, first + i] = 1.0
            for j, derivative in enumerate(by_angle):
                jac[mine, :, first + d + j] = 1e3 * arm @ derivative.T
        return out.reshape(-1), jac.reshape(n * d, -1)

    # --- what the engine looks for structure in

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Programmed place, time or order, set-up."""
        d = self.dimension
        nominal = self.data.nominal_mm
        out = [
            Covariate(f"{AXES[i].upper()} position", np.repeat(nominal[:, i], d), "mm")
            for i in range(d)
        ]
        if self.data.time_s is not None:
            out.append(Covariate("time", np.repeat(self.data.time_s, d), "s", sequence=True))
        rows = self.readings.rows.astype(float)
        out.append(Covariate("order of measurement", rows, sequence=True))
        if len(self._labels) > 1:
            out.append(Covariate("set-up", np.repeat(self._group, d), classes=True))
        return tuple(out)

    @property
    def components(self) -> Mapping[str, Array]:
        """One coordinate each."""
        d = self.dimension
        at = np.arange(len(self.readings)) % d
        return {AXES[i].upper(): (at == i).astype(float) for i in range(d)}

    @property
    def groups(self) -> IntArray:
        """Ten folds of features; a feature measured again is in the same fold."""
        count = int(self._places.max()) + 1
        fold = np.random.default_rng(FOLD_SEED).permutation(count) % min(FOLDS, count)
        return np.repeat(fold[self._places], self.dimension).astype(np.intp)

    @property
    def replicates(self) -> IntArray | None:
        """Features at the same programmed place, measured again."""
        several = np.bincount(self._places)[self._places] > 1
        if not several.any():
            return None
        d = self.dimension
        label = np.where(several, self._places, -1)
        return np.where(
            np.repeat(several, d), np.repeat(label, d) * d + np.tile(np.arange(d), len(label)), -1
        ).astype(np.intp)

    def whitener(self, residuals: Array) -> Callable[[Array], Array]:
        """Features measured again share what belongs to the feature: counted once, not twice.

        With variance b between features and w of a measurement, the mean of k measurements of a
        feature has variance b + w / k, and is brought to w / k. Without repeats, or where b is
        not there (F test, 0.5 %), nothing is done.
        """
        feature = features_apart(residuals, self.replicates)
        if feature is None:
            return lambda a: a
        label, between, within = feature
        count = np.bincount(label)
        mine = np.where(count > 1, np.sqrt(within / (within + count * between)), 1.0)

        def whiten(a: Array) -> Array:
            flat = np.asarray(a, dtype=float).reshape(len(label), -1)
            mean = np.stack([np.bincount(label, c) for c in flat.T], axis=1) / count[:, None]
            return np.asarray((flat - ((1.0 - mine)[:, None] * mean)[label]).reshape(a.shape))

        return whiten

    # --- what a user gets

    def bind(self, data: Any) -> PointsModel:
        """Return the same model, with the same smooth field, on other points."""
        if not isinstance(data, Points):
            raise InputError(f"other data: got {type(data).__name__}, wanted trunnion.Points")
        if data.dimension != self.dimension:
            raise InputError(
                f"other data: got points with {data.dimension} coordinates, "
                f"wanted {self.dimension} as in the diagnosed ones"
            )
        return PointsModel(data, source=self)

    def extended(
        self,
        nuisance: Array,
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,
    ) -> ExtendedPoints:
        """Return the error of the machine as a function of the programmed place."""
        named = {k: dict(v) for k, v in effects.items() if k != "field"}
        left = self.readings.values - self.predict(nuisance, named)
        left = left.reshape(-1, self.dimension)
        at = _first_of(self._places)
        mean = self._at_places(left)
        nominal = self.data.nominal_mm[at]
        smooth = None
        if "field" in effects and len(at) > 2 * (self.dimension + 1):
            smooth = SmoothField.of(self._travel.field_places(nominal), mean)
            mean = mean - smooth.at(smooth.places)
        apart = features_apart(
            self.readings.values - self.predict(nuisance, effects), self.replicates
        )
        scatter = None
        if apart is not None:
            scatter = FeatureScatter(*(float(np.sqrt(v)) for v in apart[1:]))
        return ExtendedPoints(
            effects={k: dict(v) for k, v in effects.items()},
            smooth=smooth,
            features_mm=nominal,
            features_um=mean,
            features=scatter,
            source=self,
            **self._for_compensation(effects, smooth),
            **({} if uncertainty is None else uncertainty.fields()),
        )

    def _for_compensation(
        self, effects: EffectValues, smooth: SmoothField | None
    ) -> dict[str, Any]:
        """Scale and squareness are the machine's own effects; the others move the linear axes."""
        why_not = "it changes with time, or has no motion(pose, values)"
        fields = for_compensation(self.effects, effects, RIGID, why_not)
        if "field" in effects and smooth is None:
            fields["not_compensable"]["field"] = "too few places to predict others from"
        elif smooth is not None:
            fields["motions"]["field"] = FieldMotion(
                smooth.places, smooth.readings, smooth.smoothing, smooth.freedom, self._travel.used
            )
        return fields


@dataclass(frozen=True)
class FeatureScatter:
    """Scatter of the features themselves, and of their measurement, µm rms of a coordinate."""

    feature_um: float
    measurement_um: float


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ExtendedPoints(Estimate):
    """What a diagnosis of points says of the machine and of the part.

    Attributes
    ----------
    effects
        Id → parameter → value; the field in the modes with which it was diagnosed.
    smooth
        What the named effects leave, smoothed: as much as predicts a feature best from the
        others. None if no field was found. It takes the field's place in :meth:`error_um`: a
        spline held back by its bending predicts better than free modes.
    features
        Scatter of the features themselves, where they were measured again and differ.
    features_mm, features_um
        Programmed places, (m, d), and what is left at each, (m, d): hole by hole, and noise.
    """

    smooth: SmoothField | None
    features_mm: Array
    features_um: Array
    features: FeatureScatter | None
    source: PointsModel = field(compare=False, repr=False)

    def error_um(
        self,
        points: Points,
        *,
        smooth: bool = True,
        features: bool = False,
    ) -> Array:
        """Error at the programmed places of points, µm in the machine frame, (n, d).

        A placement (shift and rotation) may be left in it: nobody can tell it from the part's own.
        What belongs to the part's set-up (a slip) counts at the diagnosed points only.

        Parameters
        ----------
        points
            Where; measured coordinates do not enter.
        smooth
            Add the smooth field to the named effects.
        features
            Add what was left at the same feature (within 1 µm), where it was measured before.
        """
        model = self.source.bind(points)
        nominal = points.nominal_mm
        out = np.zeros(nominal.size)
        for name, values in self.effects.items():
            e = model.effect(name)
            if name != "field" and (e.scope == "machine" or points is self.source.data):
                out += np.asarray(e.change(points, Values(values)), dtype=float)
        error = out.reshape(nominal.shape)
        if smooth and self.smooth is not None:
            error = error + self.smooth.at(self.source._travel.field_places(nominal))
        if features:
            error = error + self._of_features(nominal)
        return error

    def _of_features(self, nominal: Array) -> Array:
        key = {tuple(k): i for i, k in enumerate(_rounded(self.features_mm).tolist())}
        out = np.zeros(nominal.shape)
        for row, k in enumerate(map(tuple, _rounded(nominal).tolist())):
            if k in key:
                out[row] = self.features_um[key[k]]
        return out


def _with_motion(e: Effect, travel: Travel) -> Effect:
    """Say what the linear axes do under an effect that the machine's catalogue lacks."""
    if e.scope != "machine" or e.id in OF_TIME or e.id in RIGID:
        return e
    return replace(e, motion=LinearMotion(e.id, travel))


# --- the catalogue


def _catalogue(data: Points, travel: _Travel) -> list[Effect]:
    """All named candidates for which these points have the columns."""
    d = data.dimension
    axes = range(d)
    name = [a.upper() for a in AXES]
    out = [
        effect_of_columns(
            f"scale_{AXES[i]}",
            ["ppm"],
            partial(_slope, i, i, 1e-3),
            f"the scale of {name[i]} is off",
        )
        for i in axes
    ]
    # Λ_xy −= g, Λ_xz += g, Λ_yz −= g
    out += [
        effect_of_columns(
            f"squareness_{AXES[i]}{AXES[j]}",
            ["arcsec"],
            partial(_slope, i, j, (1e3 if (i, j) == (0, 2) else -1e3) * ARCSEC),
            f"{name[i]} and {name[j]} are not square",
        )
        for i, j in combinations(axes, 2)
    ]
    out += [
        effect_of_columns(
            f"positioning_{AXES[i]}",
            ["a2_um", "a3_um"],
            partial(_bow, i, i, travel.used),
            f"the scale of {name[i]} changes along it",
        )
        for i in axes
    ]
    out += [
        effect_of_columns(
            f"straightness_{AXES[j]}_of_{AXES[i]}",
            ["a2_um", "a3_um"],
            partial(_bow, j, i, travel.used),
            f"{name[i]} is not straight in {name[j]}",
        )
        for i, j in permutations(axes, 2)
    ]
    out += [
        effect_of_columns(
            f"angular_{AXES[about]}_of_{AXES[i]}",
            ["a1_arcsec", "a2_arcsec"],
            partial(_angular, about, i, travel.used),
            f"{name[i]} turns about {name[about]} as it travels",
        )
        for i in axes
        for about in ((2,) if d == 2 else range(3))
    ]
    out += [
        periodic_effect(
            f"periodic_{AXES[i]}",
            Parameter("pitch_mm", grid=grid, bounds=(grid[-1] * 0.8, grid[0] * 1.25)),
            partial(_position, i),
            partial(_indicator, i),
            f"{name[i]} has a periodic error",
        )
        for i in axes
        if (grid := travel.pitches(i))
    ]
    out.append(
        effect_of_columns(
            "expansion", ["ppm"], _larger, "all is larger alike (expansion)", scope="workpiece"
        )
    )
    rate = "total_um" if data.time_s is None else "rate_um_h"
    out += [
        effect_of_columns(f"drift_{AXES[i]}", [rate], partial(_drift, i), f"{name[i]} drifts")
        for i in axes
    ]
    out += _slip(data)
    return out


def _slip(data: Points) -> list[Effect]:
    """Return the effect of a part that slips on the instrument, unless there is but one moment."""
    timed = data.time_s is not None
    moments = np.unique(_moments(data))
    between = (moments[1:] + moments[:-1]) / 2
    if len(between) < 2:
        return []
    grid = between[:: max(1, len(between) // MOST_MOMENTS)]
    d = data.dimension
    name = "t0_s" if timed else "row"
    shifts = tuple(Parameter(f"d{a}_um") for a in AXES[:d])
    moment = Parameter(name, grid=tuple(map(float, grid)), bounds=(moments[0], moments[-1]))

    return [
        Effect(
            "setup_shift",
            (*shifts, moment),
            partial(_slip_change, name),
            partial(_slip_jacobian, name),
            scope="workpiece",
            words="the part slips on the instrument",
        )
    ]


def _slip_jacobian(name: str, p: Points, values: Mapping[str, float]) -> Array:
    """Shift of all that comes later in the same set-up; the moment lies between rows."""
    _, group = _groups(p)
    when = _moments(p)
    after = when >= values[name]
    if after.any():
        after &= group == group[after][np.argmin(when[after])]
    d = p.dimension
    out = np.zeros((len(p), d, d + 1))
    for i in range(d):
        out[:, i, i] = after
    return out.reshape(-1, d + 1)


def _slip_change(name: str, p: Points, values: Mapping[str, float]) -> Array:
    shift = np.array([values[f"d{a}_um"] for a in AXES[: p.dimension]])
    return np.asarray(_slip_jacobian(name, p, values)[:, :-1] @ shift)


def _moments(p: Points) -> Array:
    """Times, or row numbers where there are none."""
    return np.arange(len(p), dtype=float) if p.time_s is None else np.asarray(p.time_s)


def _enter(p: Points, axis: int, change: Array) -> Array:
    """Readings, (n d,), changed in one coordinate by ``change`` (n,)."""
    out = np.zeros((len(p), p.dimension))
    out[:, axis] = change
    return out.reshape(-1)


def _slope(into: int, along: int, size: float, p: Points) -> Array:
    """Proportional to the programmed place along one axis, in one coordinate."""
    return _enter(p, into, size * p.nominal_mm[:, along])[:, None]


def _position(axis: int, p: Points) -> Array:
    return np.repeat(p.nominal_mm[:, axis], p.dimension)


def _indicator(axis: int, p: Points) -> Array:
    return _enter(p, axis, np.ones(len(p)))


def _larger(p: Points) -> Array:
    return np.asarray(p.nominal_mm.reshape(-1, 1) * 1e-3)


def _drift(axis: int, p: Points) -> Array:
    return _enter(p, axis, _elapsed(p))[:, None]


def _bow(into: int, axis: int, travel: Travel, p: Points) -> Array:
    return _readings(bow(into, axis, p.nominal_mm, travel), p)


def _angular(about: int, axis: int, travel: Travel, p: Points) -> Array:
    return _readings(angular(about, axis, p.nominal_mm, travel), p)


def _readings(moved: Array, p: Points) -> Array:
    """Displacements (n, 3, k) as columns of the readings, (n d, k)."""
    return np.ascontiguousarray(moved[:, : p.dimension]).reshape(-1, moved.shape[2])


def _elapsed(p: Points) -> Array:
    """Hours since the first point of the group; without times the order, 0 to 1 in the group."""
    _, group = _groups(p)
    out = np.zeros(len(p))
    for g in range(int(group.max()) + 1):
        mine = group == g
        if p.time_s is not None:
            out[mine] = (p.time_s[mine] - p.time_s[mine].min()) / 3600.0
        else:
            out[mine] = np.linspace(0.0, 1.0, int(mine.sum()))
    return out


@dataclass(frozen=True)
class _Field:
    """Modes of a smooth field in every coordinate, less what named effects make of them."""

    travel: _Travel
    modes: Modes
    named: tuple[Effect, ...]
    taken: tuple[Array, ...]

    def columns(self, p: Points) -> Array:
        """Shape (n d, d k), coordinate by coordinate."""
        out = _in_every_coordinate(
            self.modes.at(self.travel.field_places(p.nominal_mm)), p.dimension
        )
        for e, part in zip(self.named, self.taken, strict=True):
            out = out - e.columns(p, _zeros(e)) @ part
        return out


def _field_effect(dimension: int, f: _Field) -> Effect:
    return effect_of_columns(
        "field",
        [f"{a}{k + 1}_um" for a in AXES[:dimension] for k in range(f.modes.count)],
        f.columns,
        "a smooth field without a name is there",
    )


def _in_every_coordinate(f: Array, d: int) -> Array:
    """Functions of the place (n, k) as columns of the readings, (n d, d k)."""
    n, k = f.shape
    out = np.zeros((n, d, d, k))
    for i in range(d):
        out[:, i, i] = f
    return out.reshape(n * d, d * k)


def _zeros(e: Effect) -> Values:
    return e.values([0.0] * len(e.parameters))


# --- places and placements


@dataclass(frozen=True)
class _Travel:
    """Where the points are: middle and half length of the travel used along each axis, mm.

    ``smallest``: step along each axis between programmed places if they are on a grid, else 0.
    """

    middle: Array
    half: Array
    smallest: Array

    @classmethod
    def of(cls, nominal: Array) -> _Travel:
        low, high = nominal.min(axis=0), nominal.max(axis=0)
        half = (high - low) / 2
        if not np.any(half > 0):
            raise DataError("points: got all at one programmed place, wanted several places")
        return cls((low + high) / 2, half, np.array([_grid_step(x) for x in nominal.T]))

    @property
    def used(self) -> Travel:
        """Middle and half length as plain data."""
        return Travel(tuple(map(float, self.middle)), tuple(map(float, self.half)))

    def field_places(self, nominal: Array) -> Array:
        """Places for a smooth field: coordinates that vary, all on one scale."""
        return self.used.field_places(nominal)

    def pitches(self, axis: int) -> tuple[float, ...]:
        """Pitches to try, mm, longest first, evenly spaced in frequency.

        From half the travel down to 4 mm, or to twice the step of a grid of places: a shorter one
        looks like a longer one there. At most 400: what would need more is not looked for.
        """
        length = 2 * float(self.half[axis])
        shortest = max(SHORTEST_PITCH_MM, 2.0 * float(self.smallest[axis]))
        if length <= 2 * shortest:
            return ()
        step = 1.0 / (3.0 * length)
        count = int((1.0 / shortest - 2.0 / length) / step) + 1
        return tuple(1.0 / (2.0 / length + step * np.arange(min(count, MOST_PITCHES))))


def _grid_step(x: Array) -> float:
    """Step of places on a grid (1 % of it off at most), 0 if they are on none."""
    steps = np.diff(np.unique(np.round(x, 3)))
    if len(steps) == 0:
        return 0.0
    step = float(steps.min())
    off = np.abs(steps / step - np.round(steps / step))
    return step if np.all(off < 0.01) else 0.0


@dataclass(frozen=True)
class _Frame:
    """Rigid placement of a group by the plain fit: measured = turn (nominal − middle) + at."""

    middle: Array
    at: Array
    turn: Array

    @classmethod
    def of(cls, nominal: Array, measured: Array, label: str) -> _Frame:
        d = nominal.shape[1]
        if len(nominal) < d:
            raise DataError(
                f"group {label}: got {len(nominal)} points, wanted at least {d} for its placement"
            )
        middle, at = nominal.mean(axis=0), measured.mean(axis=0)
        u, _, vt = np.linalg.svd((measured - at).T @ (nominal - middle))
        mirror = np.ones(d)
        mirror[-1] = np.sign(np.linalg.det(u @ vt))
        return cls(middle, at, (u * mirror) @ vt)

    def back(self, measured: Array) -> Array:
        """Measured places in the machine frame, mm."""
        return np.asarray((measured - self.at) @ self.turn + self.middle)


def _turn(angles: Array) -> tuple[Array, list[Array]]:
    """Rotation by angles in arcsec (rz, or rx ry rz: Rx Ry Rz) and its derivative by each."""
    if len(angles) == 1:
        c, s = np.cos(angles[0] * ARCSEC), np.sin(angles[0] * ARCSEC)
        return np.array([[c, -s], [s, c]]), [np.array([[-s, -c], [c, -s]]) * ARCSEC]
    parts, slopes = [], []
    for axis, angle in enumerate(angles * ARCSEC):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        c, s = np.cos(angle), np.sin(angle)
        r, dr = np.eye(3), np.zeros((3, 3))
        r[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
        dr[[i, i, j, j], [i, j, i, j]] = -s, -c, c, -s
        parts.append(r)
        slopes.append(dr * ARCSEC)
    x, y, z = parts
    return x @ y @ z, [slopes[0] @ y @ z, x @ slopes[1] @ z, x @ y @ slopes[2]]


def features_apart(
    residuals: Array, replicates: IntArray | None
) -> tuple[IntArray, float, float] | None:
    """Label of each reading, and variance between features and of one measurement, µm².

    None where nothing was measured again, or where features do not differ (F test, 0.5 %).
    """
    if replicates is None:
        return None
    single = np.flatnonzero(replicates < 0)
    label = np.asarray(replicates).copy()
    label[single] = label.max() + 1 + np.arange(len(single))
    label = np.unique(label, return_inverse=True)[1].reshape(-1)
    count = np.bincount(label)
    mean = np.bincount(label, residuals) / count
    several = count > 1
    within_freedom = int(np.sum(count[several] - 1))
    between_freedom = int(np.sum(several))
    if within_freedom < 3:
        return None
    within = float(np.sum(((residuals - mean[label]) ** 2)[several[label]])) / within_freedom
    apart = float(np.sum((count * mean**2)[several])) / between_freedom
    if within <= 0 or special.fdtrc(between_freedom, within_freedom, apart / within) > 0.005:
        return None
    repeats = float(np.mean(count[several]))
    return label.astype(np.intp), (apart - within) / repeats, within


def _groups(data: Points) -> tuple[list[Any], IntArray]:
    """Labels of the set-ups and the group of each row."""
    if data.group is None:
        return [0], np.zeros(len(data), dtype=np.intp)
    labels, group = np.unique(np.asarray(data.group), return_inverse=True)
    return list(labels), group.reshape(-1).astype(np.intp)


def _rounded(nominal: Array) -> IntArray:
    return np.asarray(np.round(nominal / SAME_PLACE_MM), dtype=np.intp)


def _places(nominal: Array) -> IntArray:
    """Number of the programmed place of each row: equal where it is the same within 1 µm."""
    _, place = np.unique(_rounded(nominal), axis=0, return_inverse=True)
    return place.reshape(-1).astype(np.intp)


def _first_of(places: IntArray) -> IntArray:
    """First row of each place."""
    return np.unique(places, return_index=True)[1].astype(np.intp)


def build(
    data: Points,
    setup: Any = None,  # noqa: ARG001  points need none
    effects: Sequence[EffectLike | str] = (),
) -> PointsModel:
    """Build the model of points; no set-up is needed."""
    return PointsModel(data, effects)


# --- what is in the part, and what in the measurement


@dataclass(frozen=True)
class RepeatablePart:
    """What of one measurement of features is there again in another, and what it is made of.

    All rms values are per coordinate, in µm, under a placement fitted to the data they belong to.

    Attributes
    ----------
    rms_um, other_rms_um
        Residuals with the placement alone.
    correlation
        Of these residuals between the measurements, by axis.
    repeatable_um
        Rms of what repeats, from the covariance of both.
    scatter_um
        Rms of what does not repeat, of one measurement.
    named, smooth, hole_by_hole
        Shares of the variance that repeats; they add up to 1.
    left_named_um, left_smooth_um, left_hole_by_hole_um
        Rms left on the other measurement by the named causes of the first, by them and its smooth
        field, and by both and what was left at each feature.
    features
        How many features both have.
    """

    rms_um: float
    other_rms_um: float
    correlation: dict[str, float]
    repeatable_um: float
    scatter_um: float
    named: float
    smooth: float
    hole_by_hole: float
    left_named_um: float
    left_smooth_um: float
    left_hole_by_hole_um: float
    features: int

    def summary(self) -> str:
        """Say it as a table."""
        r = "\n".join
        by_axis = ", ".join(f"{c:.2f} in {a}" for a, c in self.correlation.items())
        return r(
            [
                f"{self.features} features measured twice; residuals correlate {by_axis}.",
                f"  placement alone     {self.rms_um:6.2f} µm rms, {self.other_rms_um:.2f} other",
                f"  repeats             {self.repeatable_um:6.2f} µm rms",
                f"    named causes      {100 * self.named:6.1f} % of its variance",
                f"    smooth, no name   {100 * self.smooth:6.1f} %",
                f"    hole by hole      {100 * self.hole_by_hole:6.1f} %",
                f"  does not repeat     {self.scatter_um:6.2f} µm rms (one measurement)",
                "  left on the other measurement:",
                f"    named causes      {self.left_named_um:6.2f} µm rms",
                f"    and smooth field  {self.left_smooth_um:6.2f} µm rms",
                f"    and hole by hole  {self.left_hole_by_hole_um:6.2f} µm rms",
            ]
        )

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain numbers."""
        return {k: dict(v) if isinstance(v, dict) else v for k, v in vars(self).items()}

    def __str__(self) -> str:
        """Return the summary."""
        return self.summary()


def repeatable_part(d: Diagnosis, other: Points) -> RepeatablePart:
    """Tell what is in the part from what is in the measurement.

    The noise of two measurements is independent, so that the covariance of what a model leaves of
    both is the variance of what repeats and the model does not have. The model is that of ``d``,
    from its own data alone; each measurement keeps its own placement.

    Parameters
    ----------
    d
        Diagnosis of points.
    other
        The same features measured again, in any order; others are ignored.

    Raises
    ------
    InputError
        ``d`` is not of points, or fewer than ten features are in both.
    """
    extended = d.model
    if not isinstance(d.data, Points) or not isinstance(extended, ExtendedPoints):
        raise InputError("repeatable_part: got a diagnosis of other data, expected one of points")
    model = cast(PointsModel, d.rebuilt_model())
    again = model.bind(other)
    first: dict[tuple[int, ...], int] = {}
    for i, k in enumerate(map(tuple, _rounded(model.data.nominal_mm).tolist())):
        first.setdefault(k, i)
    pairs = [
        (first[k], j)
        for j, k in enumerate(map(tuple, _rounded(other.nominal_mm).tolist()))
        if k in first
    ]
    if len(pairs) < 10:
        raise InputError(f"repeatable_part: got {len(pairs)} features in both, wanted at least 10")
    one, two = np.array(pairs).T

    def left(m: PointsModel, rows: IntArray, errors: Array) -> Array:
        """Readings less errors, with the placement of these data fitted anew; shared features."""
        y = m.readings.values - errors.reshape(-1)
        jac = m.jacobian(np.zeros(len(m.nuisance)), {})
        scale = np.linalg.norm(jac, axis=0)
        move = np.linalg.lstsq(jac / scale, y, rcond=None)[0]
        return np.asarray((y - jac / scale @ move).reshape(-1, m.dimension)[rows])

    def both(**parts: bool) -> tuple[Array, Array]:
        return (
            left(model, one, extended.error_um(model.data, **parts)),
            left(again, two, extended.error_um(other, **parts)),
        )

    a, b = left(model, one, _none(model)), left(again, two, _none(again))
    total = float(np.mean(a * b))
    named_a, named_b = both(smooth=False)
    smooth_a, smooth_b = both(smooth=True)
    _, features_b = both(smooth=True, features=True)
    after_named = float(np.mean(named_a * named_b))
    after_smooth = float(np.mean(smooth_a * smooth_b))
    return RepeatablePart(
        rms_um=_rms(a),
        other_rms_um=_rms(b),
        correlation={
            AXES[i].upper(): float(np.corrcoef(a[:, i], b[:, i])[0, 1])
            for i in range(model.dimension)
        },
        repeatable_um=float(np.sqrt(max(total, 0.0))),
        scatter_um=float(np.sqrt(np.mean((a - b) ** 2) / 2)),
        named=(total - after_named) / total,
        smooth=(after_named - after_smooth) / total,
        hole_by_hole=after_smooth / total,
        left_named_um=_rms(named_b),
        left_smooth_um=_rms(smooth_b),
        left_hole_by_hole_um=_rms(features_b),
        features=len(pairs),
    )


def _none(model: PointsModel) -> Array:
    return np.zeros(len(model.readings))


def _rms(r: Array) -> float:
    return float(np.sqrt(np.mean(r * r)))
