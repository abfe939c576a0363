"""Compare measurements of one machine: what changed, by how much, and what did not.

Two diagnoses may name different causes for what is alike. So each measurement is fitted again with
the causes that any of them names, nonlinear parameters (a pitch, a place, a time constant) held at
one value for all, and the same parameters are compared. Beside these stand the figures of the
standard that a kind of data has, and the machine's location errors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import InputError
from trunnion.base.report import Result
from trunnion.base.units import Floats, capital, unit_of
from trunnion.data.distinct import Distinct, distinct_rows, given_again
from trunnion.data.mistaken import of_each
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.records import WITHOUT_DATA, Cause
from trunnion.diagnosis.refit import Refit, refit
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.ways import directions
from trunnion.files.table import Table
from trunnion.machine.effects import Owner
from trunnion.machine.estimate import Estimate
from trunnion.machine.geometry import of_one_machine
from trunnion.models.changes import (
    MachineComparison,
    done_otherwise,
    meaning,
    not_compared,
)
from trunnion.models.dates import days_of, names_of
from trunnion.models.judged import Value, Vector, change_of, change_of_many, judged, trends_of
from trunnion.models.kinds import as_table, diagnose
from trunnion.models.temperatures import with_temperatures

MAX_COMPARED_PARAMETERS = 3  # of an effect; of one with more the rms of what it does is compared


@dataclass(frozen=True)
class _Source:
    """What is known of one measurement; `made`: the estimate, if it is one or has one."""

    kind: str
    values: dict[str, Value]
    diagnosis: Diagnosis | None = None
    made: Any = None


@checked
def compare(
    before: Any,
    after: Any,
    *more: Any,
    setup: Any = None,
    dates: Sequence[Any] | None = None,
    names: Sequence[str] | None = None,
    uncertainty: Mapping[str, float] | None = None,
    level: float = 0.05,
) -> MachineComparison:
    """Say what changed between measurements of one machine, by how much, and what did not.

    Parameters
    ----------
    before, after, *more
        Measurements of one kind, their diagnoses, estimates (identifications), or results with
        standard errors (``.iso230_2()``, ``.straightness()``), in order of time. Changes are from
        the first to the last; of three or more, trends too. Figures of a standard are of the places
        that all measurements have; without one, causes and errors are compared only.
    setup
        The set-up of measured data, where the kind needs one.
    dates
        Of each: ``date``, ``datetime``, text as ISO 8601, or days.
    names
        What sentences call each; by default the dates, or "before" and "after", or numbers.
    uncertainty
        Standard uncertainty by name of a quantity that its scatter does not show and that the
        measurements do not share (another artefact, another instrument): added to each. What they
        share cancels.
    level
        Chance that anything is said to have changed where nothing did (Holm, 1979).

    Raises
    ------
    InputError
        Measurements of different kinds, or dates out of order.
    DataError
        Estimates that were made with different axes in their set-ups.

    Examples
    --------
    >>> import trunnion as tn
    >>> axis = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    >>> worn = axis.with_columns(measured_mm=axis.measured + 2e-3 * axis.direction)
    >>> found = tn.compare(axis, worn)
    >>> round(found.changes["mean_reversal_um"][0], 1)
    4.0
    """
    if not 0 < level < 1:
        raise InputError(f"level: got {level:g}, expected a chance between 0 and 1")
    sources = [_source(item, setup) for item in (before, after, *more)]
    kinds = {s.kind: None for s in sources}
    if len(kinds) > 1:
        raise InputError(f"compare: got {' and '.join(kinds)}, expected measurements of one kind")
    days = days_of(dates, [s.diagnosis and s.diagnosis.data for s in sources])
    diagnosed = [s.diagnosis for s in sources if s.diagnosis is not None]
    notes = list(of_one_machine([s.made for s in sources]))
    shown = names_of(names, dates, len(sources))
    doubts = (getattr(s.diagnosis, "mistakes", ()) for s in sources)
    vectors: dict[str, tuple[Vector, ...]] = {}
    if diagnosed:
        found = _joined(_of_standard([d.data for d in diagnosed], notes))
        fitted, vectors = _fitted(shown, diagnosed, notes)
        found = {**found, **fitted}
        notes += done_otherwise(shown, [d.data for d in diagnosed])
    else:
        found = _joined([s.values for s in sources])
        stds = [{n: v.std for n, v in s.values.items()} for s in sources]
        stated = [getattr(s.made, "std_errors", None) for s in sources]
        notes += not_compared(shown, stds, stated)
    known = {
        name: tuple(_with(v, (uncertainty or {}).get(name, 0.0)) for v in values)
        for name, values in found.items()
    }
    if wrong := sorted(set(uncertainty or {}) - set(known)):
        raise InputError(f"uncertainty: got {wrong[0]!r}, expected one of {', '.join(known)}")
    tested = [change_of(name, v[0], v[-1]) for name, v in known.items()]
    tested += [change_of_many(name, v[0], v[-1]) for name, v in vectors.items()]
    made = MachineComparison(
        names=shown,
        quantities=judged(tested, level),
        trends=trends_of(known, days, level) if len(sources) > 2 else (),
        values={k: tuple(x.value for x in v) for k, v in known.items()},
        std_errors={k: tuple(x.std for x in v) for k, v in known.items()},
        days=days,
        dated=dates is not None,
        level=level,
        mistakes=(*_given_again(shown, sources), *of_each(dict(zip(shown, doubts, strict=True)))),
        notes=tuple(dict.fromkeys(notes)),
    )
    return with_temperatures(made, [d.data for d in diagnosed])


def _source(item: Any, setup: Any) -> _Source:
    """Quantities of one measurement that need no other."""
    item = as_table(item)
    if isinstance(item, Table):
        item = diagnose(item, setup)
    if isinstance(item, Diagnosis):
        if item.data is None:
            if isinstance(item.model, Estimate):
                return _Source("estimates", _of_estimate(item.model), made=item.model)
            raise InputError(f"compare: {WITHOUT_DATA}")
        return _Source(type(item.data).__name__, {}, item, item.model)
    if isinstance(item, Estimate):
        return _Source("estimates", _of_estimate(item), made=item)
    if isinstance(item, Result) and isinstance(getattr(item, "std_errors", None), Mapping):
        return _Source(type(item).__name__, _of_result(item))
    raise InputError(
        f"compare: got {type(item).__name__}, expected measured data, a diagnosis, an estimate or "
        "a result with standard errors"
    )


def _given_again(shown: Sequence[str], sources: Sequence[_Source]) -> Iterator[str]:
    """Say which measurements have the readings of another one, and which estimates are another."""
    data = [None if s.diagnosis is None else s.diagnosis.data for s in sources]
    for i, of in given_again(data).items():
        yield (
            f"{shown[i]} has the same readings as {shown[of]} in every row: was one file given "
            "twice? Then nothing is known of a change."
        )
    for i, s in enumerate(sources):
        alike = [of for of in range(i) if sources[of].values == s.values]
        if alike and any(math.isfinite(v.std) for v in s.values.values()):
            yield (
                f"{shown[i]} has the same values and standard errors as {shown[alike[0]]} to the "
                "last digit: was one given twice? Then nothing is known of a change."
            )


def _of_standard(data: Sequence[Any], notes: list[str]) -> list[dict[str, Value]]:
    """Figures of the standard for each measurement, of the places that all of them have."""
    if not all(hasattr(d, "results") for d in data):
        return [{} for _ in data]
    places = [d.stations[0] for d in data]
    shared = set.intersection(*({tuple(np.atleast_1d(x).tolist()) for x in p} for p in places))
    if len(shared) < 2:
        counts = " and ".join(map(_of_places, places))
        notes.append(
            f"The measurements have {'one' if shared else 'no'} place in common, of {counts}: "
            "figures of a standard that are of the same places are not compared; causes are."
        )
    elif any(not np.array_equal(p, places[0]) for p in places[1:]):
        notes.append(
            f"The measurements have other places ({', '.join(str(len(p)) for p in places)}): "
            "what depends on the stretch is compared over the places that all of them have."
        )
    return [
        {k: v for result in d.results(data) for k, v in _of_result(result).items()} for d in data
    ]


def _of_places(places: Floats) -> str:
    """Count and ends of places along a line; of a grid the count."""
    if places.ndim > 1 and places.shape[1] > 1:
        return f"{len(places)}"
    return f"{len(places)} from {float(places.min()):g} to {float(places.max()):g}"


def _of_result(result: Any) -> dict[str, Value]:
    labels = result.labels() if hasattr(result, "labels") else {}
    return {
        name: Value(
            float(getattr(result, name)), float(std), unit=unit_of(name), label=labels.get(name, "")
        )
        for name, std in result.std_errors.items()
    }


def _of_estimate(estimate: Estimate) -> dict[str, Value]:
    return {
        p.name: Value(
            p.value,
            math.inf if p.std_error is None else p.std_error,
            estimate.degrees_of_freedom,
            p.unit,
            p.owner.value,
        )
        for p in estimate.parameters
        if not p.owner.of_setup
    }


def _joined(values: Sequence[dict[str, Value]]) -> dict[str, tuple[Value, ...]]:
    """Quantities that every measurement has and knows."""
    names = [n for n in values[0] if all(n in v and np.isfinite(v[n].std) for v in values)]
    return {name: tuple(v[name] for v in values) for name in names}


def _with(v: Value, more: float) -> Value:
    if not more:
        return v
    std = math.hypot(v.std, more)
    return replace(v, std=std, free=v.free * (std / max(v.std, 1e-300)) ** 4)


# --- like with like


def surest_causes(diagnoses: Iterable[Diagnosis]) -> dict[str, Mapping[str, float]]:
    """Return the causes that any of them names: id → parameters, by the surest."""
    found: dict[str, Cause] = {}
    for c in (c for d in diagnoses for c in d.causes):
        if c.id not in found or c.p_value < found[c.id].p_value:
            found[c.id] = c
    return {name: c.parameters for name, c in found.items()}


def _fitted(
    shown: Sequence[str], diagnoses: Sequence[Diagnosis], notes: list[str]
) -> tuple[dict[str, tuple[Value, ...]], dict[str, tuple[Vector, ...]]]:
    """Every measurement with the causes of all of them: few parameters by name, many by effect."""
    own = [distinct_rows(d.data) for d in diagnoses]
    notes += [f"{name}: {said}" for name, d in zip(shown, own, strict=True) for said in d.notes]
    models = _models(diagnoses, own)
    effects = {}
    scatter = {e.id: e.label for m in models for e in m.effects if e.near_any}
    for name, values in surest_causes(diagnoses).items():
        if name in scatter:
            notes.append(f"{capital(scatter[name])}: taken as scatter, as standard errors have it.")
        elif all(name in {e.id for e in m.effects} for m in models) and not any(
            name in models[0].differing(m) for m in models[1:]
        ):
            effects[name] = values
        else:
            notes.append(f"Not compared, as not all measurements show it alike: {name}.")
    fits = [
        refit(m, effects, one.numbers(d.outliers))
        for m, d, one in zip(models, diagnoses, own, strict=True)
    ]
    owners = {e.id: e.owner for e in models[0].effects}
    few, many = _parts(models[0], effects, owners)
    among = _among(models[0], diagnoses)
    errors = set(models[0].location_errors(models[0].start, {}))
    named = [n for n in fits[0].names if n in errors or n in few]
    each = [
        {
            n: Value(
                float(f.values[i]),
                math.inf if f.not_identifiable[i] else math.sqrt(max(f.covariance[i, i], 0.0)),
                float(f.free[i]),
                unit_of(n),
                owners.get(n.partition(".")[0], Owner.MACHINE).value,
                _label(models[0], n, effects, few),
                among.get(n.partition(".")[0], 1.0),
            )
            for n in named
            for i in (f.names.index(n),)
        }
        for f in fits
    ]
    if named:
        stds = [{n: v.std for n, v in one.items()} for one in each]
        notes += not_compared(shown, stds, [None] * len(stds))
    vectors = {}
    for name in many:
        for part, mine in _split(models[0], fits[0], name).items():
            text = f"{name} (rms{f', {part}' if part else ''})"
            label = f"{models[0].effect(name).label}, rms{f' {part}' if part else ''}"
            made = (_vector(f, mine, models[0], label) for f in fits)
            vectors[text] = tuple(replace(v, among=among[name]) for v in made)
    return _joined(each), vectors


def _among(model: Model, diagnoses: Sequence[Diagnosis]) -> dict[str, float]:
    """Count of the candidates that each cause is one of; 1 where all diagnoses name it.

    One that a diagnosis alone names was chosen for being large there: by chance the largest of all
    candidates differs from the same on another date.
    """
    named = [{c.id for c in d.causes} for d in diagnoses]
    count = max(float(sum(e.ordinary for e in model.effects)), 1.0)
    return {i: 1.0 if all(i in own for own in named) else count for i in set.union(*named)}


def _label(model: Model, name: str, effects: Mapping[str, Any], few: Sequence[str]) -> str:
    """What people call a parameter: its effect where it is the only one of it."""
    effect, _, parameter = name.partition(".")
    if effect not in effects:
        return ""
    alone = sum(n.partition(".")[0] == effect for n in few) == 1
    named = [n.partition(".")[2] for n in few if n.partition(".")[0] == effect]
    return model.effect(effect).label + ("" if alone else f", {meaning(effect, parameter, named)}")


def _models(diagnoses: Sequence[Diagnosis], own: Sequence[Distinct]) -> list[Model]:
    """Models of the data that share what they take from the first (a field, a travel)."""
    first, setup = diagnoses[0].rebuilt_model(), diagnoses[0].setup
    others = zip(diagnoses[1:], own[1:], strict=True)
    return [
        first,
        *(first.bind(one.data) if d.setup == setup else d.rebuilt_model() for d, one in others),
    ]


def _parts(
    model: Model, effects: Mapping[str, Any], owners: Mapping[str, Owner]
) -> tuple[list[str], list[str]]:
    """Parameters that are compared by name, and effects that are compared as a whole."""
    few, many = [], []
    for name in effects:
        linear = [p.name for p in model.effect(name).parameters if p.linear]
        if owners[name].of_setup:
            continue
        if len(linear) > MAX_COMPARED_PARAMETERS:
            many.append(name)
        else:
            few += [f"{name}.{p}" for p in linear]
    return few, many


def _split(model: Model, f: Refit, effect: str) -> dict[str, list[int]]:
    """Parameters of an effect, by the component of the readings that each acts on alone.

    By that of the fewest readings: all have something of the X of an instrument.
    """
    at = [i for i, n in enumerate(f.names) if n.startswith(f"{effect}.")]
    own = {k: np.asarray(c) != 0 for k, c in directions(model.components).items()}
    parts: dict[str, list[int]] = {}
    for i in at:
        acts = f.columns[:, i] != 0
        count = {k: int(c.sum()) for k, c in own.items() if np.all(c[acts])}
        alone = [k for k, m in count.items() if m == min(count.values())]
        parts.setdefault(alone[0] if len(alone) == 1 else "", []).append(i)
    return {"": at} if "" in parts else parts


def _vector(f: Refit, at: list[int], model: Model, label: str) -> Vector:
    columns = f.columns[:, at]
    unit = model.readings.unit
    return Vector(
        f.values[at],
        f.covariance[np.ix_(at, at)],
        columns[np.any(columns != 0, axis=1)],
        float(f.free[at].min()),
        unit if isinstance(unit, str) else "",
        label,
    )
