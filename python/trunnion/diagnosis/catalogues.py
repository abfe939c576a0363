"""Catalogues of effects beside the package's own: files, and what other packages bring."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, fields
from importlib import import_module
from importlib.metadata import entry_points
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from trunnion.base.arguments import checked
from trunnion.base.checks import choose
from trunnion.base.errors import FileFormatError, InputError, UnknownNameError
from trunnion.base.output import write_text
from trunnion.base.read_files import as_read
from trunnion.base.record import hold_files
from trunnion.diagnosis.formula import FormulaEffect
from trunnion.diagnosis.formula_checks import needed, remember_places
from trunnion.diagnosis.own_effects import acting_in
from trunnion.files.toml import TomlText
from trunnion.machine.effects import Owner, UserEffect

T = TypeVar("T")
GROUP = "trunnion.effects"
"""Entry points of packages that bring effects: an effect, a list of them, a function that returns
one, or the path of a file of effects."""
_FIELDS = {f.name: f for f in fields(FormulaEffect)}
_TAKES: dict[Any, tuple[Any, str]] = {
    "float": (int | float, "a number"),
    "bool": (bool, "true or false"),
}
"""What a field takes, by its annotation; all others a text."""
HEAD = """# Effects of one's own, for `trunnion diagnose --effects` and `tn.read_effects`.
# `data` is the kind of readings that an effect changes, `covariate` what it depends on.
"""


@checked
def write_effects(path: str | PathLike[str], effects: Iterable[FormulaEffect]) -> Path:
    """Write effects by formulas to a file; return its path.

    Raises
    ------
    InputError
        Something else than effects by formulas, or two of one id.

    Examples
    --------
    >>> import trunnion as tn
    >>> wave = tn.FormulaEffect(
    ...     "rail_wave", "Touches", covariate="Y place", unit="mm", component="X",
    ...     shape="wave", number=31.0, low=-50.0, high=50.0,
    ... )
    >>> _ = tn.write_effects("effects.toml", [wave])
    >>> tn.read_effects("effects.toml") == (wave,)
    True
    """
    given = list(effects)
    for one in given:
        if not isinstance(one, FormulaEffect):
            got = type(one).__name__
            raise InputError(f"effects: got {got}, expected effects by formulas (draft_effect)")
    ids = [one.id for one in given]
    if len(set(ids)) < len(ids):
        raise InputError(f"effects: got the ids {', '.join(ids)}, expected each once")
    write_text(path, "\n".join([HEAD, *map(_toml, given)]))
    return Path(path)


def _toml(effect: FormulaEffect) -> str:
    lines = ["[[effect]]", f"# {effect.formula()}"]
    stated = {"component", *needed(effect)}  # whatever they are: a file without them is refused
    for name, f in _FIELDS.items():
        value = getattr(effect, name)
        if f.default is MISSING or name in stated or value != f.default:
            shown = str(value) if isinstance(value, Owner) else value
            lines.append(f"{name} = {json.dumps(shown, ensure_ascii=False)}")
    return "\n".join(lines) + "\n"


@checked
def read_effects(path: str | PathLike[str], data: Any = None) -> tuple[FormulaEffect, ...]:
    """Read effects from a file, as candidates for :func:`diagnose` (``effects=...``).

    Parameters
    ----------
    path
        File of effects, as :func:`write_effects` writes it.
    data
        Measured data: effects on data of other kinds are left out.

    Raises
    ------
    FileFormatError
        A file that is none; with line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> wave = tn.FormulaEffect(
    ...     "rail_wave", "Touches", covariate="Y place", unit="mm", component="X",
    ...     shape="wave", number=31.0, low=-50.0, high=50.0,
    ... )
    >>> _ = tn.write_effects("effects.toml", [wave])
    >>> [effect.id for effect in tn.read_effects("effects.toml")]
    ['rail_wave']
    """
    text = TomlText.read(path)
    tables = text.tables.get("effect")
    if set(text.tables) - {"effect"} or not isinstance(tables, list):
        got = ", ".join(text.tables) or "nothing"
        raise FileFormatError(f"{path}: got {got}, expected tables [[effect]]")
    found = [_effect(text, i, table) for i, table in enumerate(tables)]
    known = dict.fromkeys([*_data_classes(), *(type(one).__name__ for one in _several(data))])
    for i, one in enumerate(found):
        try:
            choose("data", one.data, known)
        except UnknownNameError as error:
            raise text.error(("effect", i, "data"), str(error), at_value=True) from error
    ids = [one.id for one in found]
    for i, name in enumerate(ids):
        if name in ids[:i]:
            where = ("effect", i, "id")
            raise text.error(where, f"got {name!r} twice, expected each id once", at_value=True)
    for one in found:
        hold_files(one, [read] if (read := as_read(path, "effects")) else [])
    return tuple(found) if data is None else _effects_on(found, data)


def _effects_on(effects: Sequence[T], data: Any) -> tuple[T, ...]:
    """Return those that may act in data, or in one of several; others state another class."""
    several = _several(data)
    return tuple(one for one in effects if any(acting_in([one], each) for each in several))


def _data_classes() -> tuple[str, ...]:
    """Names of the classes of all kinds of data."""
    kinds = import_module("trunnion.models.kinds").kinds()
    return tuple(kind.data.partition(":")[2] for kind in kinds)


def _several(data: Any) -> tuple[Any, ...]:
    if isinstance(data, list | tuple):
        return tuple(data)
    return () if data is None else (data,)


def _effect(text: TomlText, i: int, table: Any) -> FormulaEffect:
    values: dict[str, Any] = {}
    if not isinstance(table, Mapping):
        raise FileFormatError(f"{text.path}: effect: got {table!r}, expected tables [[effect]]")
    for name, value in table.items():
        where = ("effect", i, name)
        if name not in _FIELDS:
            known = ", ".join(_FIELDS)
            raise text.error(where, f"got key {name!r}, expected one of {known}", at_value=False)
        if name == "owner":
            if value not in list(Owner):
                expected = f"expected one of {', '.join(Owner)}"
                raise text.error(where, f"got {value!r}, {expected}", at_value=True)
            values[name] = Owner(value)
            continue
        kind, what = _TAKES.get(_FIELDS[name].type, (str, "a text"))
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            raise text.error(where, f"got {value!r}, expected {what}", at_value=True)
        values[name] = float(value) if what == "a number" else value
    missing = [k for k, f in _FIELDS.items() if f.default is MISSING and k not in values]
    if missing:
        raise text.error(("effect", i), f"got no {', '.join(missing)}, expected it", at_value=False)
    try:
        made = FormulaEffect(**values)
    except InputError as error:  # "number: got ...", "low, high: got ..."
        named = str(error).partition(":")[0].split(", ")
        keys = [k for k in named if k in table]
        gone = [k for k in named if k in _FIELDS and k not in table]
        said = f"{error}{f' (was the line {gone[0]} deleted?)' if gone else ''}"
        raise text.error(("effect", i, *keys[:1]), said, at_value=bool(keys)) from error
    if lacking := [name for name in needed(made) if name not in values]:
        older = ", ".join(f"{name} = {json.dumps(_FIELDS[name].default)}" for name in lacking)
        raise text.error(
            ("effect", i),
            f"effect {made.id!r}: got no {', '.join(lacking)}, expected {', '.join(needed(made))} "
            f"of the shape {made.shape!r} (was a line deleted? A file of an older version means "
            f"{older})",
            at_value=False,
        )
    places = {name: text.place(("effect", i, name), at_value=True) for name in values}
    remember_places(made, {"": text.place(("effect", i), at_value=False), **places})
    return made


@checked
def installed_effects(name: str | None = None, data: Any = None) -> tuple[UserEffect, ...]:
    """Return the effects that installed packages bring, as candidates for :func:`diagnose`.

    A package declares them in its ``pyproject.toml``::

        [project.entry-points."trunnion.effects"]
        our_lab = "our_package.effects:CATALOGUE"

    ``CATALOGUE``: an effect, a list of effects, a function that returns these, or the path of a
    file of effects.

    Parameters
    ----------
    name
        Entry point; None: all of them.
    data
        Measured data: effects that state another kind are left out.

    Raises
    ------
    UnknownNameError
        No entry point of this name.
    InputError
        One that cannot be loaded, or is no catalogue.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.installed_effects()
    ()
    """
    known = {point.name: point for point in entry_points(group=GROUP)}
    if name is not None and not known:
        raise UnknownNameError(
            f"effects: got {name!r}, expected the name of a catalogue that an installed package "
            "brings (there is none) or the path of a file that ends in .toml"
        )
    chosen = list(known) if name is None else [choose("catalogue of effects", name, known)]
    found: list[UserEffect] = []
    for one in chosen:
        try:
            loaded = known[one].load()
            if isinstance(loaded, type) or not isinstance(loaded, UserEffect):
                loaded = loaded() if callable(loaded) else loaded
        except Exception as error:  # a package's own code
            raise InputError(f"entry point {one!r} of {GROUP}: {error}") from error
        if isinstance(loaded, str | PathLike):
            loaded = read_effects(loaded)
        several = [loaded] if isinstance(loaded, UserEffect) else loaded
        if not isinstance(several, list | tuple) or not all(
            isinstance(e, UserEffect) for e in several
        ):
            got = type(loaded).__name__
            raise InputError(f"entry point {one!r} of {GROUP}: got {got}, expected effects")
        found += several
    return tuple(found) if data is None else _effects_on(found, data)
