"""What the engine needs to know of a measurement, and nothing else.

::

    reading = predict(nuisance, effects) + noise
    residual = reading - predict

A *model* is bound to one set of data. It says what each reading would be, given its *nuisance*
parameters (always fitted: location errors, placement, a circle, a ball centre) and a set of
*effects* (candidate causes, absent unless the data demand them). The engine decides which effects
the data demand. It knows no unit, no machine and no instrument: those are carried by the model.

A new kind of data is one file with one class: subclass :class:`BaseModel`, or fill a
:class:`LinearModel` from arrays.

A user's own effect is any object with ``id``, ``parameters`` and ``change(data, values)``; see
:class:`EffectLike`. :func:`as_effect` completes it.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trunnion.base.errors import DataError, InputError
from trunnion.base.statistics import RANK_TOLERANCE
from trunnion.base.units import Floats, Integers, unit_of

__all__ = [
    "BaseModel",
    "Covariate",
    "Effect",
    "EffectLike",
    "EffectScope",
    "LinearModel",
    "Model",
    "Nuisance",
    "NuisanceScope",
    "Parameter",
    "Readings",
    "Uncertainty",
    "Values",
    "as_effect",
    "identity",
]

Array: TypeAlias = Floats
IntArray: TypeAlias = Integers
NuisanceScope: TypeAlias = Literal["setup", "machine"]
EffectScope: TypeAlias = Literal["machine", "instrument", "workpiece"]
EffectValues: TypeAlias = Mapping[str, Mapping[str, float]]

EXACT_TOLERANCE = 1e-9


def identity(columns: Array) -> Array:
    """Whiten noise that is white already."""
    return columns


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name:
        Name with its unit (``rate_um_h``).
    unit:
        How the unit is printed; by default read from the name.
    grid:
        Empty for a parameter on which the reading depends linearly. Otherwise the values from
        which the search starts (a slip's time, a time constant, a pitch): close enough together
        that the best one lies in the valley of the optimum.
    bounds:
        Smallest and largest possible value.
    """

    name: str
    unit: str = ""
    grid: tuple[float, ...] = ()
    bounds: tuple[float, float] = (-np.inf, np.inf)

    def __post_init__(self) -> None:
        """Read the unit from the name."""
        if not self.unit:
            object.__setattr__(self, "unit", unit_of(self.name))

    @property
    def linear(self) -> bool:
        """Whether the reading is linear in this parameter."""
        return not self.grid


class Values(dict[str, float]):
    """Parameter values by name (``values["k_um"]``), or by position (``values[0]``)."""

    def __missing__(self, key: object) -> float:
        """Value at this position."""
        if isinstance(key, int):
            return list(self.values())[key]
        raise KeyError(key)


@runtime_checkable
class EffectLike(Protocol):
    """What a user has to write: a name, parameters, and the change of each reading.

    Optional members, used when present: ``jacobian(data, values) -> (n, k)``, the derivative of
    ``change`` by each parameter (else ``change`` is differenced, which is exact where it is
    linear); ``motion(pose, values)``, the motion of the machine, without which the effect can be
    diagnosed but not compensated; ``scope`` ("machine", "instrument" or "workpiece"); ``words``,
    how a sentence calls it ("the Z axis drifts").
    """

    @property
    def id(self) -> str:
        """Unique name."""
        ...

    @property
    def parameters(self) -> Sequence[str | Parameter]:
        """Parameter names with units, or :class:`Parameter` where one is not linear."""
        ...

    def change(self, data: Any, values: Mapping[str, float]) -> ArrayLike:
        """Change of each reading, shape (n,), in the reading's own unit."""
        ...


@dataclass(frozen=True)
class Effect:
    """A candidate cause: a named group of parameters that changes readings.

    Attributes
    ----------
    id, parameters, change:
        As in :class:`EffectLike`, with every parameter a :class:`Parameter`.
    jacobian:
        Derivative of ``change`` by each parameter, shape (n, k). By default the difference of
        ``change`` over one unit, which is exact for the linear parameters.
    scope:
        Where it lives. Effects of the machine are kept on other data, as are those of the
        instrument; those of the workpiece are fitted anew.
    motion:
        The machine's motion under this effect, or None: diagnosed but not compensated.
    words:
        How a sentence calls it: subject and verb, "the Z axis drifts".
    least:
        Parameters at the least size that matters, or None. An effect that has them is looked for
        behind the named causes: a set that explains the data as well with the effect beside it,
        at this size or a few times it, is among the alternatives together with the effect.
    """

    id: str
    parameters: tuple[Parameter, ...]
    change: Callable[[Any, Mapping[str, float]], ArrayLike]
    jacobian: Callable[[Any, Mapping[str, float]], ArrayLike] | None = None
    scope: EffectScope = "machine"
    motion: Callable[[Any, Mapping[str, float]], Any] | None = None
    words: str = ""
    least: Mapping[str, float] | None = None

    @property
    def linear(self) -> bool:
        """Whether every parameter is linear."""
        return all(p.linear for p in self.parameters)

    def values(self, numbers: Iterable[float]) -> Values:
        """Numbers, in the order of the parameters, as values by name."""
        return Values(zip((p.name for p in self.parameters), numbers, strict=True))

    def columns(self, data: Any, values: Mapping[str, float]) -> Array:
        """Jacobian at ``values``, shape (n, k): as given, or by differences of ``change``."""
        if self.jacobian is not None:
            return np.asarray(self.jacobian(data, values), dtype=np.float64)
        numbers = [float(values[p.name]) for p in self.parameters]
        out = []
        for j, p in enumerate(self.parameters):
            step = 1.0 if p.linear else 1e-5 * max(abs(numbers[j]), 1e-3)
            up, down = list(numbers), list(numbers)
            up[j] += step
            down[j] -= step
            out.append(
                np.asarray(self.change(data, self.values(up)), dtype=np.float64)
                - np.asarray(self.change(data, self.values(down)), dtype=np.float64)
            )
            out[-1] /= 2 * step
        return np.stack(out, axis=-1)


def lengths(columns: Array) -> Array:
    """Length of each column, infinite for columns of rounding noise (sin 180°) beside the others.

    Dividing by it leaves unit columns, and zeros where there was nothing.
    """
    size: Array = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    return np.where(size > 1e-10 * np.max(size, initial=0.0), size, np.inf)


def as_effect(thing: EffectLike | Effect) -> Effect:
    """Complete a user's effect: parameters as :class:`Parameter`, optional members as None.

    Raises
    ------
    InputError
        The object has no ``id``, ``parameters`` or ``change``, or no parameter.
    """
    if isinstance(thing, Effect):
        return thing
    missing = [n for n in ("id", "parameters", "change") if not hasattr(thing, n)]
    if missing:
        raise InputError(
            f"an effect needs id, parameters and change(data, values); "
            f"{type(thing).__name__} has no {', '.join(missing)}"
        )
    parameters = tuple(p if isinstance(p, Parameter) else Parameter(p) for p in thing.parameters)
    if not parameters:
        raise InputError(f"effect {thing.id!r} has no parameter; at least one is wanted")
    return Effect(
        id=thing.id,
        parameters=parameters,
        change=thing.change,
        jacobian=getattr(thing, "jacobian", None),
        scope=getattr(thing, "scope", "machine"),
        motion=getattr(thing, "motion", None),
        words=getattr(thing, "words", ""),
    )


@dataclass(frozen=True)
class Nuisance:
    """A parameter that is always fitted.

    ``scope`` "setup": fitted anew on other data (placement, a ball centre). "machine": kept (a
    location error).
    """

    name: str
    unit: str = ""
    scope: NuisanceScope = "setup"


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
        Readings of different noise or unit are brought to one noise by ``Model.whiten``.
    tick:
        Step to which readings are quantised; 0 if they are not.
    """

    values: Array
    rows: IntArray
    unit: str | tuple[str, ...] = "µm"
    sigma: Array | None = None
    tick: float = 0.0

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
    """

    name: str
    values: NDArray[Any]
    unit: str = ""
    period: float | None = None
    classes: bool = False
    sequence: bool = False


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
    """

    names: tuple[str, ...]
    std_errors: Mapping[str, float]
    covariance: Array
    sigma: float
    degrees_of_freedom: int

    def fields(self) -> dict[str, Any]:
        """As fields of an :class:`~trunnion.machine.estimate.Estimate`."""
        return {
            "std_errors": dict(self.std_errors),
            "names": self.names,
            "covariance": self.covariance,
            "sigma_um": self.sigma,
            "degrees_of_freedom": float(self.degrees_of_freedom),
        }


class Model(Protocol):
    """A model bound to data: everything the engine asks.

    ``n`` readings, ``p`` nuisance parameters.
    """

    @property
    def data(self) -> Any:
        """The measurement; handed to ``Effect.change``."""
        ...

    @property
    def readings(self) -> Readings:
        """The readings."""
        ...

    @property
    def nuisance(self) -> tuple[Nuisance, ...]:
        """Parameters that are always fitted, p of them."""
        ...

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Candidate causes."""
        ...

    @property
    def start(self) -> Array:
        """Nuisance values to start from, shape (p,)."""
        ...

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Quantities the rest may depend on."""
        ...

    @property
    def single_faults(self) -> bool:
        """Whether single readings can be false (a chip, a false trigger) and may be set aside."""
        ...

    @property
    def components(self) -> Mapping[str, Array]:
        """How an unknown disturbance enters the readings, by name, each of shape (n,).

        A displacement of the machine along X enters a touch with ``dir_x``, a bigger ball with 1:
        ``{"X": dir_x, "Y": dir_y, "Z": dir_z, "every touch alike": 1}``.
        """
        ...

    @property
    def groups(self) -> IntArray:
        """Group of each reading for cross-validation, shape (n,): left out as a whole."""
        ...

    @property
    def replicates(self) -> IntArray | None:
        """Equal labels for repeats of one reading, -1 for a reading without; None: no repeats."""
        ...

    @property
    def rank_tolerance(self) -> float:
        """Share of the largest singular value up to which a combination is not identifiable.

        Columns have unit length. :data:`trunnion.base.statistics.RANK_TOLERANCE` unless the model
        has a reason for another.
        """
        ...

    def predict(self, nuisance: Array, effects: EffectValues) -> Array:
        """Return the readings under these values, shape (n,); effects not named are absent."""
        ...

    def jacobian(self, nuisance: Array, effects: EffectValues) -> Array:
        """Return the derivative of ``predict`` by the nuisance parameters, shape (n, p)."""
        ...

    def effect_jacobian(
        self, nuisance: Array, effect: Effect, values: Mapping[str, float]
    ) -> Array:
        """Return the derivative of ``predict`` by one effect's parameters, shape (n, k)."""
        ...

    def whitener(self, residuals: Array) -> Callable[[Array], Array]:
        """Linear map (n, ...) → (n, ...) after which the noise is white and of one size.

        Built from the residuals of the plain model. It must not mix readings of different groups.
        """
        ...

    def bind(self, data: Any) -> "Model":
        """Return the same model on other data."""
        ...

    def location_errors(self, nuisance: Array, effects: EffectValues) -> dict[str, float]:
        """Return the machine's errors (µm, arcsec, by name) for before and after."""
        ...

    def extended(
        self, nuisance: Array, effects: EffectValues, uncertainty: Uncertainty | None = None
    ) -> Any:
        """Return the extended model, in the form its kind of data is used with.

        With what the fit says of the uncertainty; None: the values are exact.
        """
        ...


class BaseModel:
    """Defaults for a :class:`Model`; a subclass gives what it has to.

    Wanted of a subclass: ``data``, ``readings``, ``nuisance``, ``effects``, ``base(nuisance)``,
    ``base_jacobian(nuisance)`` and ``bind(data)``. Effects are added to the base; override
    ``predict`` and ``effect_jacobian`` where that is not exact enough.
    """

    data: Any
    readings: Readings
    nuisance: tuple[Nuisance, ...]
    effects: tuple[Effect, ...]

    def base(self, nuisance: Array) -> Array:
        """Return the readings without any effect, shape (n,)."""
        raise NotImplementedError

    def base_jacobian(self, nuisance: Array) -> Array:
        """Return the derivative of ``base``, shape (n, p)."""
        raise NotImplementedError

    def bind(self, data: Any) -> Model:
        """Return the same model on other data."""
        raise NotImplementedError

    @property
    def start(self) -> Array:
        """Zeros."""
        return np.zeros(len(self.nuisance))

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """The order of the rows."""
        return (Covariate("order of measurement", self.readings.rows.astype(float), sequence=True),)

    @property
    def components(self) -> Mapping[str, Array]:
        """Every reading alike."""
        return {"": np.ones(len(self.readings))}

    @property
    def single_faults(self) -> bool:
        """Single readings may be false."""
        return True

    @property
    def groups(self) -> IntArray:
        """Five blocks of rows, in order."""
        rank = np.unique(self.readings.rows, return_inverse=True)[1]
        return np.asarray(rank * 5 // (rank.max() + 1), dtype=np.intp)

    @property
    def replicates(self) -> IntArray | None:
        """No repeats known."""
        return None

    @property
    def rank_tolerance(self) -> float:
        """That of all."""
        return RANK_TOLERANCE

    def effect(self, name: str) -> Effect:
        """Return the effect of this id."""
        for e in self.effects:
            if e.id == name:
                return e
        raise DataError(f"no effect {name!r}; known: {', '.join(e.id for e in self.effects)}")

    def predict(self, nuisance: Array, effects: EffectValues) -> Array:
        """Add the change of every effect to the base."""
        out = np.array(self.base(nuisance), dtype=np.float64)
        for name, values in effects.items():
            out += np.asarray(self.effect(name).change(self.data, Values(values)), dtype=np.float64)
        return out

    def jacobian(self, nuisance: Array, effects: EffectValues) -> Array:  # noqa: ARG002
        """Jacobian of the base: effects are additive."""
        return self.base_jacobian(nuisance)

    def effect_jacobian(
        self,
        nuisance: Array,  # noqa: ARG002
        effect: Effect,
        values: Mapping[str, float],
    ) -> Array:
        """Jacobian of the effect's own change."""
        return effect.columns(self.data, values)

    def whitener(self, residuals: Array) -> Callable[[Array], Array]:  # noqa: ARG002
        """Noise taken as white and of one size."""
        return identity

    def location_errors(self, nuisance: Array, effects: EffectValues) -> dict[str, float]:  # noqa: ARG002
        """Nuisance parameters of scope "machine", by name."""
        return {
            n.name: float(v)
            for n, v in zip(self.nuisance, nuisance, strict=True)
            if n.scope == "machine"
        }

    def extended(
        self,
        nuisance: Array,
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,  # noqa: ARG002
    ) -> Any:
        """Nuisance and effects by name."""
        names = (n.name for n in self.nuisance)
        return {
            "nuisance": dict(zip(names, map(float, nuisance), strict=True)),
            "effects": {k: dict(v) for k, v in effects.items()},
        }


class LinearModel(BaseModel):
    """A model from arrays: readings = design @ nuisance + effects + noise.

    Parameters
    ----------
    data:
        Handed to ``Effect.change``.
    readings, nuisance, design:
        n readings, p parameters, shape (n, p).
    effects:
        Candidate causes, or a user's own.
    covariates, components, groups, replicates:
        As in :class:`Model`; None: the defaults of :class:`BaseModel`.
    binder:
        Makes this model from other data.
    """

    def __init__(
        self,
        data: Any,
        readings: Readings,
        nuisance: Sequence[Nuisance],
        design: ArrayLike,
        *,
        effects: Sequence[Effect | EffectLike] = (),
        covariates: Sequence[Covariate] | None = None,
        components: Mapping[str, Array] | None = None,
        groups: ArrayLike | None = None,
        replicates: ArrayLike | None = None,
        binder: Callable[[Any], Model] | None = None,
    ) -> None:
        self.data = data
        self.readings = readings
        self.nuisance = tuple(nuisance)
        self.design = np.asarray(design, dtype=np.float64)
        self.effects = tuple(as_effect(e) for e in effects)
        self._covariates = covariates
        self._components = components
        self._groups = groups
        self._replicates = replicates
        self._binder = binder
        wanted = (len(readings), len(self.nuisance))
        if self.design.shape != wanted:
            raise InputError(f"design has shape {self.design.shape}; {wanted} is wanted")

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """As given, or the order of the rows."""
        return super().covariates if self._covariates is None else tuple(self._covariates)

    @property
    def components(self) -> Mapping[str, Array]:
        """As given, or every reading alike."""
        return super().components if self._components is None else self._components

    @property
    def groups(self) -> IntArray:
        """As given, or five blocks of rows."""
        return super().groups if self._groups is None else np.asarray(self._groups, dtype=np.intp)

    @property
    def replicates(self) -> IntArray | None:
        """As given, or none known."""
        return None if self._replicates is None else np.asarray(self._replicates, dtype=np.intp)

    @property
    def rank_tolerance(self) -> float:
        """Rounding: a design that is exact has no leftovers of second order."""
        return EXACT_TOLERANCE

    def base(self, nuisance: Array) -> Array:
        """Return design @ nuisance."""
        return self.design @ nuisance

    def base_jacobian(self, nuisance: Array) -> Array:  # noqa: ARG002
        """Return the design."""
        return self.design

    def bind(self, data: Any) -> Model:
        """Return the same model on other data."""
        if self._binder is None:
            raise InputError("this model cannot be bound to other data: it was given no binder")
        return self._binder(data)
