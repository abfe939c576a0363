"""What the engine needs to know of a measurement, and nothing else.

A *model* is bound to one set of data. It predicts what each reading would be without noise, given
its *nuisance* parameters (always fitted: location errors, placement, a ball centre) and a set of
*effects* (candidate causes, absent unless the data demand them). The engine decides which effects
the data demand. It knows no unit, no machine and no instrument: those are carried by the model.

A new kind of data is one file with one class: subclass :class:`Model`, or fill a
:class:`.linear_model.LinearModel` from arrays. Effects are in :mod:`trunnion.diagnosis.effect`.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from trunnion.base.checks import choose
from trunnion.base.resolution import Coordinates, Grid
from trunnion.base.statistics import RANK_TOLERANCE
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.effect import Effect, EffectValues, Values
from trunnion.diagnosis.of_some import OfSome, Orthonormal
from trunnion.diagnosis.whitening import Correlated, Whiten, identity
from trunnion.machine.budget import Input, Source
from trunnion.machine.effects import Owner

if TYPE_CHECKING:
    from trunnion.diagnosis.scan import Dictionary

FINEST_NOISE = 1e-3  # µm, arcsec, µm/m: no instrument resolves less, nor formulas say more


@dataclass(frozen=True)
class Nuisance:
    """A parameter that is always fitted: what is the machine's is kept, others anew on new data."""

    name: str
    unit: str = ""
    owner: Owner = Owner.PLACEMENT


@dataclass(frozen=True)
class Readings:
    """The readings of a measurement; one to several a data row.

    Attributes
    ----------
    values:
        Shape (n,).
    rows:
        Data row (counted from 0) of each reading, shape (n,).
    unit:
        Unit of all readings, or one a reading.
    sigma:
        Noise of each reading (1 σ), if it is known beforehand; None: one noise for all, estimated.
        Readings of different noise or unit are brought to one noise by ``Model.whitener``.
    step:
        In which each reading is recorded, 0: none; None: not known. Its noise is at least step/√12.
    recorded:
        The numbers that were recorded, in the unit of the readings, where these are something else:
        in them a step is recognised. Each of shape (n,) or (n, k), the first dimension a reading.
    coordinates:
        Those of which a reading is a sum, and each of which may be recorded in steps.
    planned:
        What was to be recorded, where known: its steps are no resolution. Shape as ``values``.
    hint:
        What to do about a step that is recognised in the readings.
    clocked:
        Steps that the model recognises where none is stated, shape (n,): of a clock, as the feeds.
    least:
        Noise that no reading goes below (1 σ), of all readings or of each: finer than instruments
        of the kind resolve, and than formulas to first order say. What is smaller is no evidence.
    """

    values: Floats
    rows: Integers
    unit: str | tuple[str, ...] = "µm"
    sigma: Floats | None = None
    step: Floats | None = None
    recorded: tuple[Floats, ...] = ()
    coordinates: Coordinates | None = None
    planned: Floats | None = None
    hint: str = ""
    clocked: Floats | None = None
    least: Floats | float = 0.0

    @property
    def numbers(self) -> tuple[Floats, ...]:
        """All that was recorded of each reading, the readings if it was these."""
        more = () if self.coordinates is None else (self.coordinates.places,)
        return (*(self.recorded or (self.values,)), *more)

    def __len__(self) -> int:
        """Count of readings."""
        return len(self.values)


@dataclass(frozen=True)
class Covariate:
    """A recorded quantity in which structure is looked for when no known cause fits.

    Attributes
    ----------
    name:
        As a sentence calls it: "C position".
    values:
        Shape (n,). For classes: integers, or any labels that ``np.unique`` can sort.
    unit:
        Unit of the values.
    period:
        Length of a turn for a periodic quantity (360 for a rotary axis in degrees), else None.
    classes:
        The values are labels (a face, a point, a direction), not a scale.
    sequence:
        The values order the readings (time, row): jumps are looked for, too.
    words:
        What people call values that are few, as pairs: -1 → "clockwise".
    known:
        Which readings have it, shape (n,): nothing in the others depends on it. None: all.
    comes_back:
        The same places come again along it: of smooth functions what does not repeat competes.
    readings:
        First and end of those of the measurement that it is recorded in, of several; None: one.
    turns:
        The angle of a rotary axis may depend on it (components by :mod:`.ways`).
    apart:
        A smooth error along it is no candidate even where one makes the same: it competes with all.
    """

    name: str
    values: NDArray[Any]
    unit: str = ""
    period: float | None = None
    classes: bool = False
    sequence: bool = False
    words: tuple[tuple[float, str], ...] = ()
    known: Flags | None = None
    comes_back: bool = False
    readings: tuple[int, int] | None = None
    turns: bool = False
    apart: bool = False


@dataclass(frozen=True)
class Uncertainty:
    """How well a fit knows its parameters.

    Attributes
    ----------
    names:
        Nuisance parameters, then effects' as "id.parameter".
    std_errors:
        By name; inf for what the data cannot identify.
    covariance:
        In the order of the names, shape (k, k); of what can be identified.
    sigma:
        Noise of one reading, in the readings' unit.
    degrees_of_freedom:
        Of ``sigma``.
    sources:
        What the uncertainty comes from.
    """

    names: tuple[str, ...]
    std_errors: Mapping[str, float]
    covariance: Floats
    sigma: float
    degrees_of_freedom: int
    sources: tuple[Source, ...] = ()

    def fields(self) -> dict[str, Any]:
        """As fields of an :class:`~trunnion.machine.estimate.Estimate`."""
        return {
            "std_errors": dict(self.std_errors),
            "names": self.names,
            "covariance": self.covariance,
            "sigma_um": self.sigma,
            "degrees_of_freedom": float(self.degrees_of_freedom),
            "sources": self.sources,
        }


TURNED = ((1.0, "forward"), (0.0, "not turned"), (-1.0, "backward"))  # came to its place so


class Model:
    """A model bound to data, n readings and p nuisance parameters: everything the engine asks.

    A subclass gives ``data``, ``readings``, ``nuisance``, ``effects``, ``base(nuisance)``,
    ``base_jacobian(nuisance)`` and ``bind(data)``; all else has a default. Effects are added to the
    base; override ``predict`` and ``effect_jacobian`` where that is not exact enough.

    Attributes
    ----------
    data:
        The measurement.
    readings:
        The readings.
    nuisance:
        Parameters that are always fitted, p of them.
    effects:
        Candidate causes, bound to the data.
    known_noise:
        What makes the noise white, where no fit need say it, nor the steps (``grid``); else None.
    inside:
        Those that are linearised at a size, not where they vanish (:meth:`near`).
    tool_sense:
        -1 where a tool too far along an axis makes its readings smaller: a probe triggers early.
    """

    data: Any
    readings: Readings
    nuisance: tuple[Nuisance, ...]
    effects: tuple[Effect, ...]
    known_noise: Whiten | None = None
    inside: frozenset[str] = frozenset()
    tool_sense: float = 1.0
    cycles: Integers | None = None  # of each reading (n,), that each measure all; None: one
    together: bool = False  # how many causes act is not known: one makes others likelier

    def base(self, nuisance: Floats) -> Floats:
        """Return the readings without any effect, shape (n,)."""
        raise NotImplementedError

    def base_jacobian(self, nuisance: Floats) -> Floats:
        """Return the derivative of ``base``, shape (n, p)."""
        raise NotImplementedError

    def bind(self, data: Any) -> Model:
        """Return the same model on other data."""
        raise NotImplementedError

    def beside(self, others: Sequence[Model]) -> Model:  # noqa: ARG002
        """Return the same model, of effects that it shares with others in terms of them all."""
        return self

    def differing(self, other: Model) -> frozenset[str]:  # noqa: ARG002
        """Ids of effects whose parameters mean something else in a model of other data: none."""
        return frozenset()

    @property
    def reservation(self) -> str | None:
        """Why the data may say nothing of the machine, in a sentence; None: no reason."""
        return None

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of any diagnosis of these data should know, in sentences."""
        return ()

    @property
    def start(self) -> Floats:
        """Nuisance values to start from, shape (p,): zeros."""
        return np.zeros(len(self.nuisance))

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Quantities that the residuals may depend on: the order of the rows."""
        return (Covariate("order of measurement", self.readings.rows.astype(float), sequence=True),)

    @property
    def grid(self) -> Grid | None:
        """Steps of the readings, where the model knows them; None: they are sought in these."""
        return None

    @property
    def known_alone(self) -> tuple[Floats, Mapping[int, Values]]:
        """Values (p,) to begin a plain fit with; places of candidates beside grids, by number."""
        return self.start, {}

    def dictionary(self, whiten: Whiten) -> Dictionary | None:  # noqa: ARG002
        """Structure without a name in all readings, where it is known; None: it is to be made."""
        return None

    @property
    def allows_outliers(self) -> bool:
        """Whether single readings can be false (a chip, a false trigger) and may be set aside."""
        return True

    @property
    def components(self) -> Mapping[str, Floats]:
        """How an unknown disturbance enters the readings, by name, each (n,): in every one alike.

        Of a touch {"X": dir_x, "Y": dir_y, "Z": dir_z, "every touch alike": 1}: a bigger ball is 1.
        """
        return {"": np.ones(len(self.readings))}

    @property
    def turning(self) -> Mapping[str, Floats]:
        """Change of each reading as a rotary axis stands further by 1 arcsec, by its letter: none.

        Pictures give what acts like it as an angle of that axis.
        """
        return {}

    @property
    def groups(self) -> Integers:
        """Group of each reading for cross-validation, (n,), left out whole: five blocks of rows."""
        rank = np.unique(self.readings.rows, return_inverse=True)[1]
        return np.asarray(rank * 5 // (rank.max() + 1), dtype=np.intp)

    @property
    def replicates(self) -> Integers | None:
        """Equal labels for repeats of one reading, -1 for a reading without; None: no repeats."""
        return None

    @property
    def rank_tolerance(self) -> float:
        """Share of the largest singular value up to which a combination is not identifiable."""
        return RANK_TOLERANCE

    def shared(self, effect: Effect) -> tuple[str, float] | None:
        """Id by which measurements of the machine share an effect, its sign; None: they do not."""
        return (effect.id, 1.0) if effect.owner is Owner.MACHINE else None

    def left_by_places(self, _: EffectValues) -> Mapping[tuple[str, str], float]:
        """Standard uncertainty by the choice of places, by effect and parameter: none."""
        return {}

    supposed_of: ClassVar[Mapping[str, Sequence[str]]] = {}  # effects that are it themselves

    def supposed(self, _: EffectValues) -> Mapping[str, Floats]:
        """What may act and is no candidate, in words: columns of 1 sigma each, (n, k); nothing."""
        return {}

    def instrument_size(self, effect: Effect) -> float | None:  # noqa: ARG002
        """Size (mm) of the instrument of an effect: equal ones of a kind are one; None: its own."""
        return None

    def effect(self, name: str) -> Effect:
        """Return the effect of this id."""
        known = {effect.id: effect for effect in self.effects}
        return known[choose("effect", name, known)]

    def predict(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Return the readings under these values, shape (n,); effects not named are absent."""
        out = np.array(self.base(nuisance), dtype=np.float64)
        for name, values in effects.items():
            out += np.asarray(self.effect(name).change(Values(values)), dtype=np.float64)
        return out

    def jacobian(self, nuisance: Floats, effects: EffectValues) -> Floats:  # noqa: ARG002
        """Return the derivative of ``predict`` by the nuisance parameters, shape (n, p)."""
        return self.base_jacobian(nuisance)

    def effect_jacobian(
        self,
        nuisance: Floats,  # noqa: ARG002
        effect: Effect,
        values: Mapping[str, float],
    ) -> Floats:
        """Return the derivative of ``predict`` by one effect's parameters, shape (n, k)."""
        return effect.columns(values)

    def derivatives(
        self, nuisance: Floats, effects: Sequence[Effect], values: EffectValues
    ) -> list[Floats]:
        """Return ``jacobian`` with these effects, then ``effect_jacobian`` of each."""
        every = [self.jacobian(nuisance, values)]
        return every + [self.effect_jacobian(nuisance, e, values[e.id]) for e in effects]

    def linear_columns(
        self, nuisance: Floats, effect: Effect, values: Sequence[Mapping[str, float]]
    ) -> Floats:
        """Return the derivative by linear parameters at each of some values, (v, k, n)."""
        linear = [i for i, p in enumerate(effect.parameters) if p.linear]
        out = np.empty(
            (len(values), len(linear), len(self.readings))
        )  # a column in a row of memory
        as_it_is = type(self).effect_jacobian is Model.effect_jacobian
        for own, at in zip(out, values, strict=True):
            if as_it_is:
                effect.put_linear(at, own)
                continue
            rates = self.effect_jacobian(nuisance, effect, at)
            np.take(rates.T, linear, axis=0, out=own, mode="clip")
        return out

    def white_columns(
        self, nuisance: Floats, effect: Effect, values: Sequence[Values], whiten: Whiten
    ) -> Floats:
        """Return these whitened, (v, n, k)."""
        columns = self.linear_columns(nuisance, effect, values).transpose(2, 0, 1)
        return np.asarray(whiten(columns)).transpose(1, 0, 2)

    def white_piece(
        self, nuisance: Floats, effect: Effect, values: Sequence[Values], whiten: Whiten
    ) -> Floats | OfSome | Orthonormal:
        """Return the same, or of the readings only that the effect changes."""
        return self.white_columns(nuisance, effect, values, whiten)

    def whitener(self, residuals: Floats) -> Callable[[Floats], Floats]:  # noqa: ARG002
        """Linear map (n, ...) → (n, ...) after which the noise is white and of one size.

        Built from the residuals of the plain model. It must not mix readings of different groups.
        """
        return self.known_noise or identity

    def dependent(self, residuals: Floats) -> Callable[[Floats], Floats]:
        """Whitener of residuals that are no stationary noise (:mod:`.dependence`)."""
        return self.whitener(residuals)

    def correlated(
        self,
        nuisance: Floats,  # noqa: ARG002
        effects: EffectValues,  # noqa: ARG002
        used: Integers,  # noqa: ARG002
        variance: float,  # noqa: ARG002
        structure: Floats,  # noqa: ARG002
    ) -> Correlated | None:
        """Noise of neighbouring readings that is alike, as a fit leaves it, if it is.

        ``used``: readings; ``variance``: of what is left of each beside ``structure`` (n, k).
        """
        return None

    def near(self, *, always: bool = False) -> Model:  # noqa: ARG002
        """Return the model with its candidates linearised near the data; itself where it is so.

        Its readings are these less what is not linear: values of nuisance and effects mean the
        same. For a kind whose effects are strong: a servo that is 20 % off. ``always``: even if
        they are weak, for the model is not complete.
        """
        return self

    def about(self, nuisance: Floats, effects: EffectValues) -> Model:  # noqa: ARG002
        """Return the model with its candidates linearised about a fit; see :meth:`near`."""
        return self

    def exact_residuals(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Return reading minus what it would be under a fit, without any linearisation, (n,)."""
        return np.asarray(self.readings.values - self.predict(nuisance, effects))

    def inputs(self, nuisance: Floats, effects: EffectValues) -> tuple[Input, ...]:  # noqa: ARG002
        """What the set-up states an uncertainty of, for the budget of a fit: nothing."""
        return ()

    def location_errors(self, nuisance: Floats, effects: EffectValues) -> dict[str, float]:  # noqa: ARG002
        """Return the machine's errors (µm, arcsec, by name) for before and after."""
        values = zip(self.nuisance, nuisance.tolist(), strict=True)
        return {n.name: value for n, value in values if n.owner is Owner.MACHINE}

    def estimated(
        self,
        effects: EffectValues,
        uncertainty: Uncertainty | None,
        why_not: str,
        catalogued: Container[str] = (),
    ) -> dict[str, Any]:
        """Return effects that were found and how they act on the machine: fields of an estimate.

        Parameters
        ----------
        effects, uncertainty
            Those of :meth:`extended`.
        why_not
            Why an effect of the machine that has no ``motion`` cannot be compensated.
        catalogued
            Ids in the machine's catalogue under the same name and with the same parameters.
        """
        motions, not_compensable, owners = {}, {}, {}
        whose = {
            Owner.INSTRUMENT: "it belongs to the instrument",
            Owner.WORKPIECE: "it belongs to the part",
            Owner.PLACEMENT: "it belongs to this set-up",
        }
        for e in self.effects:
            if e.id not in effects:
                continue
            owners[e.id] = e.owner
            if e.motion is not None:
                motions[e.id] = e.motion
            elif e.id not in catalogued or e.owner is not Owner.MACHINE:
                not_compensable[e.id] = whose.get(e.owner, why_not)
        return {
            "effects": {k: dict(v) for k, v in effects.items()},
            "motions": motions,
            "not_compensable": not_compensable,
            "owners": owners,
            **({} if uncertainty is None else uncertainty.fields()),
        }

    def extended(
        self,
        nuisance: Floats,
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,  # noqa: ARG002
    ) -> Any:
        """Return the extended model, in the form its kind of data is used with.

        With what the fit says of the uncertainty; None: the values are exact.
        """
        return {
            "nuisance": {x.name: float(v) for x, v in zip(self.nuisance, nuisance, strict=True)},
            "effects": {k: dict(v) for k, v in effects.items()},
        }
