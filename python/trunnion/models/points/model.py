"""The model of points that the diagnosis engine asks, and what a diagnosis says of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import DataError, InputError
from trunnion.base.rows import repeats
from trunnion.base.smooth import Modes, SmoothField
from trunnion.base.units import Flags, Floats, Integers
from trunnion.data.points import Points
from trunnion.diagnosis.columns import lengths
from trunnion.diagnosis.effect import Effect, EffectLike, EffectValues, Values
from trunnion.diagnosis.model import FINEST_NOISE, Covariate, Model, Nuisance, Readings, Uncertainty
from trunnion.diagnosis.own_effects import with_own
from trunnion.diagnosis.whitening import Correlated, identity
from trunnion.machine.estimate import Estimate
from trunnion.machine.linear_axes import FieldMotion
from trunnion.models.points.correlation import correlated, unlike_neighbours
from trunnion.models.points.effects import (
    CATALOGUED,
    OF_TIME,
    Field,
    catalogue,
    in_every_coordinate,
)
from trunnion.models.points.geometry import (
    AXES,
    Frame,
    Places,
    first_of,
    groups_of,
    places_of,
    rotation,
    rounded,
    turned,
)
from trunnion.models.points.variance import variance_components

MAX_DISTANCE_MM = 5.0
FOLDS = 10
FOLD_SEED = 1


class PointsModel(Model):
    """Points, as the diagnosis engine asks for them.

    Readings are row by row: X, Y (and Z) of row 0, then of row 1, ...

    data: Measured points.
    effects: Further candidates: a user's own effects, or ids. ``change(data, values)`` gives the
        change of every reading, µm, in the machine frame.
    source: The model whose smooth field and travel this one shares (``bind``); None: found here.
    travel: Over which the shapes of straightness, positioning and angular errors go, where it is
        longer than that of these points (``beside``).
    """

    def __init__(
        self,
        data: Points,
        effects: Sequence[EffectLike | str] = (),
        source: PointsModel | None = None,
        travel: Places | None = None,
    ) -> None:
        self.data = data
        self.dimension = data.dimension
        nominal = data.nominal_mm
        self._labels, self._group = groups_of(data)
        self._at: tuple[bytes, list[Floats]] | None = None
        self._frames = [
            Frame.of(nominal[self._group == g], data.measured_mm[self._group == g], str(label))
            for g, label in enumerate(self._labels)
        ]
        back = np.empty_like(nominal)
        for g, frame in enumerate(self._frames):
            mine = self._group == g
            back[mine] = frame.back(data.measured_mm[mine])
        deviation = (back - nominal) * 1e3
        self._check_near(deviation)
        n, d = nominal.shape
        self.readings = Readings(
            deviation.reshape(-1),
            np.repeat(np.arange(n), d),
            recorded=(1e3 * data.measured_mm.reshape(-1),),
            planned=1e3 * data.nominal_mm.reshape(-1),
            least=FINEST_NOISE,
        )
        names = [f"d{a}_um" for a in AXES[:d]]
        names += ["rz_arcsec"] if d == 2 else ["rx_arcsec", "ry_arcsec", "rz_arcsec"]
        several = len(self._labels) > 1
        self.nuisance = tuple(
            Nuisance(f"{name} of {label}" if several else name, unit)
            for label in self._labels
            for name, unit in ((x, "arcsec" if "arcsec" in x else "µm") for x in names)
        )
        found = source._travel if source is not None else travel
        self._travel: Places = Places.of(nominal) if found is None else found
        self._places = places_of(nominal)
        named = catalogue(data, self._travel)
        self._smooth = frozenset(e.id for e in named if e.linear and e.id not in OF_TIME)
        self.field: Field | None
        self.field, here = self._field(deviation, named) if source is None else (source.field, None)
        if self.field is not None:
            named.append(self.field.effect(data, named, here))
        given = effects if source is None else source._given
        self._given: tuple[EffectLike | str, ...] = tuple(given)
        self.effects = with_own(named, self._given, data)

    def _check_near(self, deviation: Floats) -> None:
        off = np.linalg.norm(deviation, axis=1) * 1e-3
        worst = int(np.argmax(off))
        if off[worst] > MAX_DISTANCE_MM:
            raise DataError(
                f"point of {self.data.place(worst)}: got a place {off[worst]:.1f} mm from where "
                f"the placement puts it, expected at most {MAX_DISTANCE_MM:.0f} mm"
            )

    def _field(
        self, deviation: Floats, catalogue: Sequence[Effect]
    ) -> tuple[Field, Floats] | tuple[None, None]:
        """Smooth field: sized on what no named linear effect explains, and orthogonal to those.

        So a straight line, a bow or a twist keeps its name, and the field is what has none. With
        its modes at the programmed places of the rows.
        """
        start = np.zeros(len(self.nuisance))
        named = [e for e in catalogue if e.linear and e.id not in OF_TIME]
        columns = [e.columns(e.values([0.0] * len(e.parameters))) for e in named]
        base = np.concatenate([self.jacobian(start, {}), *columns], axis=1)
        size = lengths(base)
        at = first_of(self._places)
        places = self._travel.used.field_places(self.data.nominal_mm[at])
        good = np.ones(len(places), dtype=bool)
        mean = self._left_of(base / size, deviation, good)
        if len(alone := unlike_neighbours(places, mean)):
            # A chip is no part of the field, and says nothing of how smooth that is.
            good[alone] = False
            mean = self._left_of(base / size, deviation, good)
        modes = Modes.of(places[good], mean[good])
        if modes is None:
            return None, None
        here = modes.at(self._travel.used.field_places(self.data.nominal_mm))
        raw = in_every_coordinate(here, self.dimension)
        taken = np.linalg.lstsq(base / size, raw, rcond=1e-9)[0] / size[:, None]
        parts = np.split(taken[len(start) :], np.cumsum([x.shape[1] for x in columns])[:-1])
        shares = {e.id: part for e, part in zip(named, parts, strict=True)}
        return Field(self._travel.used, modes, shares), here

    def _left_of(self, base: Floats, deviation: Floats, good: Flags) -> Floats:
        """Mean at each place of what columns leave that are fitted to the good places, (m, d)."""
        flat = deviation.reshape(-1)
        used = np.repeat(good[self._places], self.dimension)
        fitted = base @ np.linalg.lstsq(base[used], flat[used], rcond=1e-9)[0]
        return self._at_places((flat - fitted).reshape(deviation.shape))

    def _at_places(self, x: Floats) -> Floats:
        """Mean of rows (n, d) over the features at each programmed place, (m, d)."""
        total = np.stack([np.bincount(self._places, c) for c in x.T], axis=1)
        return np.asarray(total / np.bincount(self._places)[:, None])

    # --- readings and derivatives

    def predict(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Return the readings, µm: errors of the axes, then the placement."""
        return self._placed(nuisance, self._shifted(effects))[0]

    def jacobian(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Exact derivative by the placement of each group."""
        return self._placed(nuisance, self._shifted(effects))[1]

    def effect_jacobian(
        self, nuisance: Floats, effect: Effect, values: Mapping[str, float]
    ) -> Floats:
        """Exact derivative by an effect's parameters: its columns, turned by the placement."""
        d = self.dimension
        columns = np.ascontiguousarray(effect.columns(values).T)
        at = columns.reshape(-1, d)
        turns = self._turns(nuisance)
        out = turned(at, turns[0])
        for g, turn in enumerate(turns[1:], start=1):
            mine = np.tile(self._group == g, len(columns))
            out[mine] = turned(at[mine], turn)
        return np.asarray(out.reshape(columns.shape).T)

    def _turns(self, nuisance: Floats) -> list[Floats]:
        """Rotation of each group (d, d); the last ones are kept: all columns need them."""
        key = nuisance.tobytes()
        if self._at is None or self._at[0] != key:
            parts = (self._own_part(nuisance, g) for g in range(len(self._frames)))
            self._at = key, [rotation(part[self.dimension :])[0] for part in parts]
        return self._at[1]

    def _shifted(self, effects: EffectValues) -> Floats:
        """Where the features are on the part, mm."""
        e = np.zeros(len(self.readings))
        for name, values in effects.items():
            e += np.asarray(self.effect(name).change(Values(values)), dtype=float)
        return np.asarray(self.data.nominal_mm + 1e-3 * e.reshape(self.data.nominal_mm.shape))

    def _own_part(self, nuisance: Floats, group: int) -> Floats:
        k = len(self.nuisance) // len(self._frames)
        return nuisance[group * k : (group + 1) * k]

    def _placed(self, nuisance: Floats, at: Floats) -> tuple[Floats, Floats]:
        """Readings and their derivative by the nuisance, for features at ``at`` on the part."""
        n, d = at.shape
        k = len(self.nuisance) // len(self._frames)
        out = np.empty((n, d))
        jac = np.zeros((n, d, len(self.nuisance)))
        for g, frame in enumerate(self._frames):
            mine = np.flatnonzero(self._group == g)
            part = self._own_part(nuisance, g)
            turn, by_angle = rotation(part[d:])
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
    def components(self) -> Mapping[str, Floats]:
        """One coordinate each."""
        d = self.dimension
        at = np.arange(len(self.readings)) % d
        return {AXES[i].upper(): (at == i).astype(float) for i in range(d)}

    @property
    def groups(self) -> Integers:
        """Ten folds of features; a feature measured again is in the same fold."""
        count = int(self._places.max()) + 1
        fold = np.random.default_rng(FOLD_SEED).permutation(count) % min(FOLDS, count)
        return np.repeat(fold[self._places], self.dimension).astype(np.intp)

    @property
    def replicates(self) -> Integers | None:
        """Features at the same programmed place, measured again."""
        return repeats([self._places], self.dimension)

    def whitener(self, residuals: Floats) -> Callable[[Floats], Floats]:
        """Features measured again share what belongs to the feature: counted once, not twice.

        With variance b between features and w of a measurement, the mean of k measurements of a
        feature has variance b + w / k, and is brought to w / k. Without repeats, or where b is
        not there (F test, 0.5 %), nothing is done.
        """
        feature = variance_components(residuals, self.replicates)
        if feature is None:
            return identity
        label, between, within = feature
        count = np.bincount(label)
        mine = np.where(count > 1, np.sqrt(within / (within + count * between)), 1.0)

        def whiten(a: Floats) -> Floats:
            flat = np.asarray(a, dtype=float).reshape(len(label), -1)
            mean = np.stack([np.bincount(label, c) for c in flat.T], axis=1) / count[:, None]
            return np.asarray((flat - ((1.0 - mine)[:, None] * mean)[label]).reshape(a.shape))

        return whiten

    def correlated(
        self,
        nuisance: Floats,
        effects: EffectValues,
        used: Integers,
        variance: float,
        structure: Floats,
    ) -> Correlated | None:
        """Features near each other share errors that no cause makes (:mod:`.correlation`)."""
        smooth = [e for e in self.effects if e.id in self._smooth]
        named = {k: v for k, v in effects.items() if k not in self._smooth and k != "field"}
        left = (self.readings.values - self.predict(nuisance, named)).reshape(-1, self.dimension)
        columns = [
            self.effect_jacobian(nuisance, e, e.values([0.0] * len(e.parameters))) for e in smooth
        ]
        every = np.concatenate([self.jacobian(nuisance, {}), *columns, structure], axis=1)
        rows = np.flatnonzero(
            np.bincount(used // self.dimension, minlength=len(left)) == self.dimension
        )
        # A field tells of features among those measured, and of no others.
        shared = correlated(self.data.nominal_mm, left, every, variance, rows)
        if shared is None or "field" not in effects:
            return shared
        return replace(shared, groups=self.groups, cause="field")

    # --- what a user gets

    def beside(self, others: Sequence[Model]) -> Model:
        """Return the same model, its shapes over the travel of all: one bow has one size."""
        alike = [m for m in others if isinstance(m, PointsModel) and m.dimension == self.dimension]
        travel = self._travel.used.with_more(m._travel.used for m in alike)
        if travel == self._travel.used:
            return self
        return PointsModel(self.data, self._given, travel=self._travel.over(travel))

    def bind(self, data: Any) -> PointsModel:
        """Return the same model, with the same smooth field, on other points."""
        if not isinstance(data, Points):
            raise InputError(f"other data: got {type(data).__name__}, expected trunnion.Points")
        if data.dimension != self.dimension:
            raise InputError(
                f"other data: got points with {data.dimension} coordinates, "
                f"expected {self.dimension} as in the diagnosed ones"
            )
        return PointsModel(data, source=self)

    def extended(
        self,
        nuisance: Floats,
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,
    ) -> ExtendedPoints:
        """Return the error of the machine as a function of the programmed place."""
        named = {k: dict(v) for k, v in effects.items() if k != "field"}
        left = self.readings.values - self.predict(nuisance, named)
        left = left.reshape(-1, self.dimension)
        at = first_of(self._places)
        mean = self._at_places(left)
        nominal = self.data.nominal_mm[at]
        smooth = None
        if "field" in effects and len(at) > 2 * (self.dimension + 1):
            smooth = SmoothField.of(self._travel.used.field_places(nominal), mean)
            mean = mean - smooth.at(smooth.places)
        apart = variance_components(
            self.readings.values - self.predict(nuisance, effects), self.replicates
        )
        scatter = None
        if apart is not None:
            scatter = FeatureScatter(*(float(np.sqrt(v)) for v in apart[1:]))
        return ExtendedPoints(
            smooth=smooth,
            features_mm=nominal,
            features_um=mean,
            features=scatter,
            source=self,
            **self._estimated(effects, uncertainty, smooth),
        )

    def _estimated(
        self, effects: EffectValues, uncertainty: Uncertainty | None, smooth: SmoothField | None
    ) -> dict[str, Any]:
        """Scale and squareness are the machine's own effects; the others move the linear axes."""
        why_not = "it changes with time, or has no motion(pose, values)"
        fields = self.estimated(effects, uncertainty, why_not, CATALOGUED)
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

    Examples
    --------
    >>> import trunnion as tn
    >>> d = tn.diagnose(tn.read_points(tn.sample_path("plate/first.csv")))
    >>> round(d.model.effects["scale_x"]["ppm"])
    40
    """

    smooth: SmoothField | None
    features_mm: Floats
    features_um: Floats
    features: FeatureScatter | None
    source: PointsModel = field(compare=False, repr=False)

    @checked
    def error_um(
        self,
        points: Points,
        *,
        smooth: bool = True,
        features: bool = False,
    ) -> Floats:
        """Error at the programmed places of points, µm in the machine frame, (n, d).

        A placement (shift and rotation) may be left in it: it cannot be distinguished from the
        part's own. What belongs to the set-up (a shift of the part) counts at the diagnosed points
        only.

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
            owner = self.source.effect(name).owner
            if name != "field" and (not owner.of_setup or points is self.source.data):
                out += np.asarray(model.effect(name).change(Values(values)), dtype=float)
        error = out.reshape(nominal.shape)
        if smooth and self.smooth is not None:
            error = error + self.smooth.at(self.source._travel.used.field_places(nominal))
        if features:
            error = error + self._of_features(nominal)
        return error

    def _of_features(self, nominal: Floats) -> Floats:
        key = {tuple(k): i for i, k in enumerate(rounded(self.features_mm).tolist())}
        out = np.zeros(nominal.shape)
        for row, k in enumerate(map(tuple, rounded(nominal).tolist())):
            if k in key:
                out[row] = self.features_um[key[k]]
        return out


@checked
def build(
    data: Points,
    _: Any = None,
    effects: Sequence[EffectLike | str] = (),
) -> PointsModel:
    """Build the model of points; no set-up is needed."""
    return PointsModel(data, effects)
