"""The kinds of data: which class, which reader, which model. One line a kind.

A kind of one's own needs no entry here: :func:`add_kind` takes it from any package.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from os import PathLike
from pkgutil import resolve_name
from typing import Any, TypeAlias, cast

import numpy as np

from trunnion.base.arguments import checked, name_place
from trunnion.base.checks import choose, nearest
from trunnion.base.errors import DataError, InputError, TooFewReadingsError, TrunnionError
from trunnion.data.distinct import distinct_rows, given_again
from trunnion.data.frame import (
    frame_changes,
    frame_notes,
    taken_as_said,
)
from trunnion.data.times import check_order, clock_notes, from_first_reading, time_notes
from trunnion.data.touches import Touches
from trunnion.diagnosis.effect import EffectLike
from trunnion.diagnosis.engine import diagnose as diagnose_model
from trunnion.diagnosis.engine import leave
from trunnion.diagnosis.left import Left
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.own_effects import acting_in
from trunnion.diagnosis.result import Diagnosis
from trunnion.files.table import named_columns
from trunnion.machine.effects import EffectInfo
from trunnion.models.agreement import with_contradictions
from trunnion.models.given import check_list, refuse_mapping_of_data, refuse_other_frames
from trunnion.models.joint import JointModel
from trunnion.models.mistaken import refusal_explained, with_mistakes, with_mistakes_of_each
from trunnion.models.several import Measured, joined, joint_model
from trunnion.probing.model import catalogue as touch_catalogue
from trunnion.setup import Setup

FOLLOWING = (
    "Do they follow the others, the artefact left as it is? Then both are one measurement: "
    "first.followed_by(these), or trunnion touches --after"
)

Builder: TypeAlias = Callable[[Any, Any, Sequence[EffectLike | str]], Model]
"""``build(data, setup, effects)``: the set-up may be None; ``effects`` are further candidates."""


@dataclass(frozen=True)
class Kind:
    """A kind of data. Objects are named as "module:name" and imported when data of the kind come.

    Attributes
    ----------
    name
        As the command line calls it.
    data
        Class of the data.
    reader
        Function that reads a file of it.
    build
        Function that binds a model with its whole catalogue to the data, a `Builder`.
    columns
        Columns by which a file is known; ``one|other``: at least one of these.
    examples
        Functions that return a small measurement of the kind with every column that it may have,
        and its set-up: :func:`catalogue` lists the kind's effects from these.
    """

    name: str
    data: str
    reader: str
    build: str
    columns: tuple[str, ...]
    examples: tuple[str, ...] = ()

    def known_by(self) -> str:
        """Say by which columns a file is known."""
        return ", ".join(" or ".join(column.split("|")) for column in self.columns)

    def read(self, path: Any) -> Any:
        """Read a file of this kind."""
        return resolve_name(self.reader)(path)


_MORE_EXAMPLES = {
    "ballbar": ("hybrid_ballbar",),
    "levels": ("levels_read_again", "surface_levels"),
    "points": ("points_in_two_parts",),
    "positioning": ("positioning_in_two_parts",),
    "rotary_test": ("rotary_test_in_two_parts", "rotary_bars"),
    "touches": ("touches_in_two_parts",),
}


def _kind(name: str, data: str, module: str, model: str, *columns: str) -> Kind:
    """Return a kind that comes with the package."""
    files, models = f"trunnion.data.{module}", f"trunnion.models.{model}"
    examples = [module, *_MORE_EXAMPLES.get(module, ())]
    return Kind(
        name,
        f"{files}:{data}",
        f"{files}:read_{module}",
        f"{models}:build",
        columns,
        tuple(f"trunnion.models.examples:{example}" for example in examples),
    )


_AXES = "x_cmd_mm|y_cmd_mm|z_cmd_mm|a_cmd_deg|b_cmd_deg|c_cmd_deg"

_ROTARY_TEST = ("x_mm", "a_deg|b_deg|c_deg", "dx_um|length_mm")

_KINDS = [
    _kind("touches", "Touches", "touches", "touches", "dir_x", "dir_y", "dir_z"),
    _kind("points", "Points", "points", "points", "nominal_x_mm", "nominal_y_mm"),
    _kind("sweep", "Sweep", "sweep", "rotary", "angle_deg", "target"),
    _kind("diameters", "Diameters", "diameters", "diameters", "z_mm", "error_um"),
    _kind("ballbar", "Ballbar", "ballbar", "ballbar", "setup", "length_mm"),
    _kind("positioning", "Positioning", "positioning", "positioning", "direction", "cycle"),
    _kind("levels", "Levels", "levels", "levels", "along_um_m|across_um_m"),
    _kind("rotarytest", "RotaryTest", "rotary_test", "rotary_test", *_ROTARY_TEST),
    _kind("axislog", "AxisLog", "axis_log", "axis_log", "time_s", _AXES),
]


def kinds() -> tuple[Kind, ...]:
    """Return every kind of data, those added by :func:`add_kind` last."""
    return tuple(_KINDS)


def described(data: Any) -> Any:
    """Return what describes data without a set-up: their covariates and components.

    Raises
    ------
    InputError
        Data of no kind, or of one whose model needs a set-up.
    """
    for base in type(data).__mro__:
        for kind in _KINDS:
            if kind.data == f"{base.__module__}:{base.__qualname__}":
                made = getattr(import_module(kind.build.split(":")[0]), "described", None)
                return model_of(data) if made is None else made(data)
    return model_of(data)


def add_kind(kind: Kind) -> None:
    """Let :func:`diagnose` and the command line take a further kind of data.

    Raises
    ------
    InputError
        A kind of this name is there already, or one of its objects cannot be imported.
    """
    if any(kind.name == known.name for known in _KINDS):
        raise InputError(f"kind of data: got {kind.name!r}, expected a name not yet taken")
    for what in (kind.data, kind.reader, kind.build, *kind.examples):
        try:
            resolve_name(what)
        except (ImportError, AttributeError, ValueError) as error:
            raise InputError(
                f"kind of data {kind.name!r}: got {what!r}, expected module:name ({error})"
            ) from error
    _KINDS.append(kind)


def kind_of_columns(names: Collection[str], kind: str | None = None) -> Kind:
    """Return the kind of data with these columns: of several the one that asks for most.

    Raises
    ------
    InputError
        No kind has these columns, or several ask for as many of them (`kind` decides).
    UnknownNameError
        No kind of this name.
    """
    known = {each.name: each for each in _KINDS}
    if kind is not None:
        return known[choose("kind", kind, known)]
    there = {str(name).lower() for name in names}
    fitting = [e for e in _KINDS if all(there & set(one.split("|")) for one in e.columns)]
    most = max((len(each.columns) for each in fitting), default=0)
    best = [each for each in fitting if len(each.columns) == most]
    if len(best) == 1:
        return best[0]
    got = f"the columns {', '.join(map(str, names))}"
    if best:
        may = ", ".join(each.name for each in best)
        raise InputError(f"got {got}, which may be {may}, expected one of these as kind=")
    nearest, missing = _nearest(there)
    if missing:
        raise InputError(
            f"got {got} without {missing}, expected those of {nearest}, or columns= (trunnion read "
            "--column) that says which is which"
        )
    raise InputError(
        f"got {got}, expected those of a kind of data ("
        + "; ".join(f"{each.name}: {each.known_by()}, ..." for each in _KINDS)
        + "), or columns= (trunnion read --column) that says which is which"
    )


def _nearest(there: set[str]) -> tuple[str, str]:
    """Return what the kind with most of these columns needs, and what is missing of it.

    there: Names in lower case. Two empty texts where no kind has more of them than all others.
    """
    known = {each.name: getattr(resolve_name(each.data), "kinds", {}) for each in _KINDS}
    counts = sorted((len(there & columns.keys()), name) for name, columns in known.items())
    (second, _), (most, name) = counts[-2:]
    if most == second:
        return "", ""
    kind = next(each for each in _KINDS if each.name == name)
    missing = [one for one in kind.columns if not there & set(one.split("|"))]
    others = [each for each in there if each not in known[name]]
    near = ((each, nearest(each, others)) for each in missing)
    said = [f"{each} (is it {found}?)" if found else each for each, found in near]
    needed = resolve_name(kind.data).expected_columns()
    return f"{name} ({needed})", " and ".join(said)


def table_of(columns: Any, kind: str | None = None) -> Any:
    """Return arrays by column name as data of the kind that they are.

    Parameters
    ----------
    columns
        A mapping, a pandas DataFrame, an xarray Dataset: one array a column.
    kind
        Name of the kind; by default found from the names of the columns.
    """
    given = {name: np.asarray(values) for name, values in named_columns(columns).items()}
    return resolve_name(kind_of_columns(given, kind).data)(given)


@checked
def model_of(data: Any, setup: Any = None, effects: Sequence[EffectLike | str] = ()) -> Model:
    """Return the model of a measurement, or of several, with its whole catalogue of candidates."""
    if isinstance(data, list | tuple):
        return _joint(_measured(data, setup, effects), setup, effects)
    with refusal_explained(data, setup, _built):
        return _built(data, setup, effects)


def _built(data: Any, setup: Any, effects: Sequence[EffectLike | str] = ()) -> Model:
    """Return the model of one measurement."""
    for base in type(data).__mro__:
        for kind in _KINDS:
            if kind.data == f"{base.__module__}:{base.__qualname__}":
                if not len(data):
                    raise DataError(f"{kind.name}: got no rows, expected readings to diagnose")
                return cast(Model, resolve_name(kind.build)(data, setup, effects))
    if all(hasattr(data, name) for name in ("readings", "nuisance", "effects", "predict")):
        return cast(Model, data)
    raise InputError(_no_data("data", data))


def _no_data(name: str, given: Any) -> str:
    """Say that what was given is no kind of data."""
    known = ", ".join(sorted(kind.data.split(":")[1] for kind in _KINDS))
    read = " (trunnion.read reads a file)" if isinstance(given, str | PathLike) else ""
    return f"{name}: got {type(given).__name__}, expected {known}, or a diagnosis model{read}"


@checked
def catalogue(of: Any, setup: Setup | None = None) -> tuple[EffectInfo, ...]:
    """List the effects that a measurement is diagnosed for.

    Parameters
    ----------
    of
        Measured data: what is looked for in these. Or the name of a kind of data ("touches",
        "points", "sweep", "diameters", "ballbar", "axislog", ...): all that may be looked for.
        Or a set-up: all effects on touches of its artefact.
    setup
        The set-up of the data, or with the name "touches" that of the artefact; a cross on a
        ``trt-ca`` by default.

    Raises
    ------
    UnknownNameError
        No kind of this name.
    InputError, DataError
        As :func:`diagnose`.

    Examples
    --------
    >>> import trunnion as tn
    >>> [effect.id for effect in tn.catalogue("diameters")][:3]
    ['tool_heating', 'tool_wear', 'taper']
    """
    if isinstance(of, Setup):
        return touch_catalogue(of)
    if not isinstance(of, str):
        return tuple(e.info() for e in model_of(of, setup).effects)
    known = {kind.name: kind for kind in _KINDS}
    kind = known[choose("kind of data", of, known)]
    if of == "touches" and setup is not None:
        return touch_catalogue(setup)
    models = (model_of(*resolve_name(example)()) for example in kind.examples)
    return tuple({e.id: e.info() for model in models for e in model.effects}.values())


@checked
def diagnose(
    data: Any, setup: Any = None, *, effects: Sequence[EffectLike | str] = ()
) -> Diagnosis:
    """Say whether the model of a measurement explains it, and if not, what does.

    Parameters
    ----------
    data
        Any kind of data that trunnion reads (touches, points, sweep, diameters, axis log, ball-bar
        lengths), a DataFrame or a mapping with the columns of one, or a model of the protocol in
        :mod:`trunnion.diagnosis.model`. A list of them, in the order of time: several measurements
        of one machine, diagnosed together.
    setup
        The set-up, where the kind of data needs one.
    effects
        Further candidates, which compete with the whole catalogue on equal terms: a user's own
        effects (``id``, ``parameters``, ``change(data, values)``), or ids. One that states its
        ``data`` (the name of a class, "Touches") acts in these only of several measurements.

    Raises
    ------
    InputError
        No model is known for the data.
    UnknownNameError
        An effect's id is in no catalogue.
    DataError
        The data cannot belong to the model: too few readings, readings off the surface.

    Examples
    --------
    >>> import trunnion as tn
    >>> d = tn.diagnose(tn.read(tn.sample_path("plate/first.csv")))
    >>> d.verdict, [cause.id for cause in d.causes]
    ('explained', ['scale_x', 'straightness_y_of_x'])
    """
    data = as_table(data)
    if isinstance(data, list | tuple):
        return _of_several(data, setup, effects)
    return _alone(data, setup, effects)


def _alone(data: Any, setup: Any, effects: Sequence[EffectLike | str]) -> Diagnosis:
    """Diagnose one measurement, of which rows that repeat others count once."""
    clock, data = clock_notes(data), from_first_reading(data)
    used, first, _, repeated = distinct_rows(data)
    with refusal_explained(used, setup, _built):
        model = _built(used, setup, effects)
        found = diagnose_model(model)
    if model is data:
        return found
    found = replace(found, data=data, setup=setup, candidates=tuple(effects))
    found = replace(found, notes=(*frame_notes(data), *clock, *time_notes(data), *found.notes))
    found = with_mistakes(found, model, used, setup, _built)
    if isinstance(setup, Setup) and setup.machine.tolerance:
        tolerance = setup.machine.tolerance
        contributions = tuple(c.with_tolerance(tolerance) for c in found.contributions)
        found = replace(found, contributions=contributions)
    if first is not None:
        outliers = tuple(int(first[row]) for row in found.outliers)
        of = found.residuals
        of = None if of is None else replace(of, rows=first[of.rows])
        found = replace(found, outliers=outliers, residuals=of)
    return replace(found, notes=(*repeated, *found.notes))


def measured_of(found: Diagnosis) -> Measured:
    """Return the measurement that was diagnosed, with its model made anew.

    Raises
    ------
    InputError
        As `Diagnosis.rebuilt_model`.
    """
    model, first = found.rebuilt_model(), distinct_rows(found.data).rows
    return Measured(kind_name(found.data), found.data, first, Left.of(found) or leave(model), model)


def as_table(data: Any) -> Any:
    """Return data with named columns as data of their kind, anything else as it is."""
    refuse_mapping_of_data(data)
    named = isinstance(data, Mapping) or type(data).__name__ in ("DataFrame", "Dataset")
    return table_of(data) if named else data


def _of_several(data: Sequence[Any], setup: Any, effects: Sequence[EffectLike | str]) -> Diagnosis:
    """Diagnose several measurements of one machine, each once."""
    check_list(data, _no_data)
    tables = [as_table(one) for one in data]
    again = given_again(tables)
    notes = tuple(
        f"Measurement {i + 1} is left out: measurement {of + 1} has the same readings in every row "
        "(was it given twice?)."
        for i, of in again.items()
    )
    numbers = [i for i in range(len(tables)) if i not in again]
    own = [tables[i] for i in numbers]
    if len(own) == 1:
        found = _alone(own[0], setup, effects)
    else:
        measured = _measured(own, setup, effects, numbers)
        model = _joint(measured, setup, effects)
        given = {"setup": setup, "candidates": tuple(effects)}
        found = joined(with_contradictions(diagnose_model(model), model), model, measured, given)
        found = with_mistakes_of_each(found, model, measured, setup, _built)
    frames = [one.control_frame if isinstance(one, Touches) else None for one in tables]
    said = (*frame_changes(frames, ("tool_length_mm",)), *taken_as_said(tables))
    return replace(found, notes=(*notes, *said, *found.notes))


def _measured(
    data: Sequence[Any],
    setup: Any,
    effects: Sequence[EffectLike | str],
    numbers: Sequence[int] | None = None,
) -> list[Measured]:
    """Diagnose each of several measurements alone; ``numbers``: theirs in the list given."""
    check_list(data, _no_data)
    data = list(map(as_table, data))
    refuse_other_frames(data)
    check_order(data, numbers)
    for effect in effects:
        if not isinstance(effect, str) and not any(acting_in([effect], one) for one in data):
            got = ", ".join(dict.fromkeys(type(one).__name__ for one in data))
            wanted = getattr(effect, "data", "")
            raise InputError(f"effect {effect.id!r}: got {got}, expected {wanted} among them")
    measured = []
    for i, one in zip(numbers or range(len(data)), data, strict=True):
        try:
            measured.append(_one_of_several(one, setup, effects))
        except TrunnionError as error:
            said = str(error)
            name_place(error, [one])
            if str(error) == said:  # of no file
                error.args = (f"measurement {i + 1}: {said}",)
            few = isinstance(one, Touches) and isinstance(error, TooFewReadingsError)
            if few and any(isinstance(m.data, Touches) for m in measured):
                error.args = (f"{error}. {FOLLOWING}",)
            raise
    return measured


def _one_of_several(data: Any, setup: Any, effects: Sequence[EffectLike | str]) -> Measured:
    """Explain one measurement, of which rows that repeat others count once."""
    clock, data = clock_notes(data), from_first_reading(data)
    used, first, _, repeated = distinct_rows(data)
    model = model_of(used, setup, acting_in(effects, data))
    left = leave(model)
    if first is not None:
        outliers = tuple(int(first[row]) for row in left.outliers)
        left = replace(left, outliers=outliers, rows=first[left.rows])
    return Measured(kind_name(data), data, first, left, model, (*repeated, *clock))


def _joint(
    measured: Sequence[Measured], setup: Any, effects: Sequence[EffectLike | str]
) -> JointModel:
    """Return the model of several measurements of one machine."""
    model = partial(model_of, setup=setup, effects=effects)
    return joint_model(measured, model)


def kind_name(data: Any) -> str:
    """Name of the kind of data; of a model of one's own that of its class."""
    classes = {f"{base.__module__}:{base.__qualname__}" for base in type(data).__mro__}
    return next((kind.name for kind in _KINDS if kind.data in classes), type(data).__name__)
