"""Arguments of public functions, checked against their annotations in one place.

::

    @checked
    def simulate(plan: Touches, noise_um: float = 0.0, seed: int | None = None) -> Touches: ...

`checked` holds every call to the annotations: a `float` is a finite number, an `int` a whole
number, an `ArrayLike` finite real numbers, a class one of its objects, and so on through unions,
sequences and mappings. What does not fit is an `InputError` that names the argument. Ranges are the
function's own. A message about measured data names their file, and its line in place of a row.
What comes out holds no nan; numbers so extreme that they cannot be computed with are an
`InputError`, too.
"""

from __future__ import annotations

import functools
import inspect
import re
import sys
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from os import PathLike
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.checks import choose, entry, finite, floats, mapping, shown, whole, with_article
from trunnion.base.errors import DataError, InputError, TrunnionError, UnknownNameError
from trunnion.base.record import files_of, hold_files
from trunnion.base.report import Result

__all__ = ["Take", "check_fields", "checked", "holds_nan", "name_place", "renumber", "taker"]

P = ParamSpec("P")
R = TypeVar("R")

Take = Callable[[str, Any], Any]
"""Returns the value if it fits; raises InputError that begins with the name otherwise."""

_ARRAY_LIKE = frozenset(get_args(ArrayLike))
_EVERYTHING = (Any, object, inspect.Parameter.empty)


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Return the function with its arguments and what it returns checked."""
    name = function.__name__

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        signature, takes = _takes(function)
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError as error:  # in Python's own words, which do not say of what
            raise TypeError(f"{name}() {error}") from None
        for argument, value in bound.arguments.items():
            if argument in takes:
                with entry(argument):
                    bound.arguments[argument] = takes[argument](argument, value)
        try:
            with np.errstate(all="ignore"):  # what overflows is found in what comes out
                found = function(*bound.args, **bound.kwargs)
            if holds_nan(found):
                raise ArithmeticError("the result is not a number")
        except TrunnionError as error:
            name_place(error, bound.arguments.values())
            raise
        except (ArithmeticError, MemoryError, np.linalg.LinAlgError) as error:
            why = f"{name}: {_TOO_EXTREME} ({error or type(error).__name__})"
            raise InputError(_in_file(why, bound.arguments.values())) from error
        results = found if isinstance(found, tuple | list) else (found,)
        given = bound.arguments.values()
        for one in results:
            if isinstance(one, Result) and not any(one is each for each in given):
                hold_files(one, files_of(*given, one))
        return found

    return call


_NAMED = "names with values, as in {'name': 1.0}"
_TOO_EXTREME = "got numbers too large or too small to compute with, expected smaller ones"


def name_place(error: TrunnionError, arguments: Iterable[Any]) -> None:
    """Name the file of measured data in an error about them, and its line in place of a row."""
    given = list(arguments)
    message = str(error)
    if data := _from_files(given):
        message = _ROW.sub(lambda found: str(data[0].place(int(found[1]))), message)
    error.args = (_in_file(message, given) if isinstance(error, DataError) else message,)


def renumber(error: TrunnionError, rows: Sequence[int]) -> None:
    """Let an error about some rows speak of the data that they were taken from.

    rows: Of these data, in order; an error that has been given its place is left as it is.
    """
    message = _ROW.sub(lambda found: f"row {rows[int(found[1])]}", str(error))
    error.args = (message,)


def _in_file(message: str, arguments: Iterable[Any]) -> str:
    """Return a message about measured data with the name of the first file, unless one is there."""
    files = [each.origin.names for each in _from_files(arguments)]
    if not files or any(name in message for names in files for name in names):
        return message
    return f"{' and '.join(files[0])}: {message}"


def _from_files(arguments: Iterable[Any]) -> list[Any]:
    """Return the measured data among arguments that were read from files."""
    return [each for each in arguments if getattr(each, "origin", None) and hasattr(each, "place")]


_ROW = re.compile(r"\brow (\d+)\b")


def check_fields(made: Any) -> None:
    """Check the fields of a dataclass against their annotations; for ``__post_init__``.

    Raises
    ------
    InputError
        A field holds what its annotation does not allow.
    """
    kind: Any = type(made)
    if kind not in _FIELDS:
        _FIELDS[kind] = _field_takes(kind)
    for name, take in _FIELDS[kind].items():
        value = getattr(made, name)
        found = take(f"{type(made).__name__}.{name}", value)
        if found is not value:
            object.__setattr__(made, name, found)


@functools.cache
def _takes(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Take]]:
    signature = inspect.signature(function)
    room = sys.modules[function.__module__]
    takes = {}
    for name, parameter in signature.parameters.items():
        take = taker(_resolved(parameter.annotation, room))
        if take is None:
            continue
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            take = _items(take, "")
        elif parameter.kind is inspect.Parameter.VAR_KEYWORD:
            continue
        takes[name] = _with_default(take, parameter.default)
    return signature, takes


_FIELDS: dict[Any, dict[str, Take]] = {}


def _field_takes(kind: Any) -> dict[str, Take]:
    room = sys.modules[kind.__module__]
    found = {}
    for each in fields(kind):
        take = taker(_resolved(each.type, room))
        if take is not None:
            found[each.name] = _with_default(take, each.default)
    return found


def _with_default(take: Take, default: Any) -> Take:
    """Return the check that takes None or infinity where that is the default."""
    if default is None:
        return _or_none(take)
    if isinstance(default, float) and default == float("inf"):
        return lambda what, value: (
            value if isinstance(value, float) and value == default else take(what, value)
        )
    return take


def _resolved(annotation: Any, room: types.ModuleType) -> Any:
    """Return what an annotation means; Any where it names what only a type checker imports."""
    if not isinstance(annotation, str):
        return annotation
    try:
        return eval(annotation, vars(room))
    except NameError:
        return Any


def taker(hint: Any) -> Take | None:
    """Return the check of an annotation; None if it allows everything."""
    if hint in _EVERYTHING or isinstance(hint, TypeVar):
        return None
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return _union(args)
    if origin is Literal:
        return lambda what, value: choose(what, value, args)
    if hint in _PLAIN:
        return _PLAIN[hint]
    if origin is np.ndarray or hint is np.ndarray:
        return _array(args)
    if origin is tuple:
        return _tuple(args)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _mapping(*map(taker, args))
    if isinstance(origin, type) and issubclass(origin, Iterable):
        return _items(taker(args[0]), origin.__name__)
    kind = origin or hint
    if not isinstance(kind, type) or getattr(kind, "_is_protocol", False):
        return _callable if kind is Callable else None
    return functools.partial(_instance, kind=kind)


def _number(what: str, value: Any) -> float:
    finite(what, value)
    return value if isinstance(value, int) and abs(value) < 2**53 else float(value)


def _flag(what: str, value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{what}: got {shown(value)}, expected True or False")
    return bool(value)


def _text(what: str, value: Any) -> str:
    if not isinstance(value, str):
        raise InputError(f"{what}: got {shown(value)}, expected text")
    return value


def _path(what: str, value: Any) -> Any:
    if not isinstance(value, str | PathLike) or "\0" in str(value):
        raise InputError(f"{what}: got {shown(value)}, expected the path of a file")
    return value


def _callable(what: str, value: Any) -> Any:
    if not callable(value):
        raise InputError(f"{what}: got {shown(value)}, expected a function")
    return value


_PLAIN: dict[Any, Take] = {
    float: _number,
    int: lambda what, value: whole(what, value, -(2**63), 2**63 - 1),
    bool: _flag,
    str: _text,
    PathLike: _path,
    type(None): lambda what, value: None if value is None else _refused(what, value, "None"),
}


def _refused(what: str, value: Any, expected: str) -> Any:
    raise InputError(f"{what}: got {shown(value)}, expected {expected}")


def _instance(what: str, value: Any, *, kind: type) -> Any:
    if isinstance(value, kind):
        return value
    if hasattr(kind, "of_columns"):  # a table of data: a DataFrame, a Dataset or a dict is one, too
        return kind.of_columns(value, what)
    return _refused(what, value, with_article(kind))


def _numbers(what: str, value: Any) -> Any:
    floats(what, value)
    return value


def _array(args: tuple[Any, ...]) -> Take:
    """Return the check of an array: converted to numbers where it holds numbers."""
    held = next(iter(get_args(args[-1])), None) if args else None
    if held is np.float64:
        return floats
    return lambda what, value: _instance(what, value, kind=np.ndarray)


def _or_none(take: Take) -> Take:
    return lambda what, value: None if value is None else take(what, value)


def _union(args: tuple[Any, ...]) -> Take | None:
    options = set(args)
    takes: list[Take | None] = []
    if options >= _ARRAY_LIKE:
        options -= _ARRAY_LIKE
        takes.append(_numbers)
    if str in options and any(get_origin(option) is PathLike for option in options):
        options = {o for o in options if o is not str and get_origin(o) is not PathLike}
        takes.append(_path)
    none = type(None) in options
    takes = [taker(option) for option in args if option in options - {type(None)}] + takes
    known = [take for take in takes if take is not None]
    if len(known) < len(takes):
        return None
    one = known[0] if len(known) == 1 else functools.partial(_first, takes=tuple(known))
    return _or_none(one) if none else one


def _first(what: str, value: Any, *, takes: tuple[Take, ...]) -> Any:
    """Return the value as the first that takes it; the error names what each expects."""
    refused: list[InputError] = []
    for take in takes:
        try:
            return take(what, value)
        except InputError as error:
            refused.append(error)
    for one in refused:  # about a part of the value: says more
        if not str(one).startswith(f"{what}: "):
            raise one
    words = dict.fromkeys(str(one).rpartition(", expected ")[2] for one in refused)
    named = isinstance(value, str) and any(isinstance(e, UnknownNameError) for e in refused)
    kind = UnknownNameError if named else InputError
    raise kind(f"{what}: got {shown(value)}, expected {' or '.join(words)}")


def _items(take: Take | None, name: str) -> Take:
    def check(what: str, value: Any) -> Any:
        if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
            return _refused(what, value, "a list")
        if name == "Sequence" and not isinstance(value, Sequence | np.ndarray):
            return _refused(what, value, "a list")
        if isinstance(value, np.ndarray) and value.ndim == 0:
            return _refused(what, value, "a list")
        found = value if isinstance(value, Sequence | np.ndarray | set | frozenset) else (*value,)
        if take is not None:
            for index, item in enumerate(found):
                take(f"{what}[{index}]", item)
        return found

    return check


def _tuple(args: tuple[Any, ...]) -> Take:
    if args[-1:] == (...,):
        return _items(taker(args[0]), "tuple")
    takes = [taker(arg) for arg in args]

    def check(what: str, value: Any) -> Any:
        listed = isinstance(value, tuple | list) or (isinstance(value, np.ndarray) and value.ndim)
        if not listed or len(value) != len(takes):
            return _refused(what, value, f"{len(takes)} values")
        for index, (take, item) in enumerate(zip(takes, value, strict=True)):
            if take is not None:
                take(f"{what}[{index}]", item)
        return value

    return check


def _mapping(key: Take | None, item: Take | None) -> Take:
    def check(what: str, value: Any) -> Any:
        for name, one in mapping(what, value, _NAMED).items():
            if key is not None:
                key(f"{what}: name", name)
            if item is not None:
                item(f"{what}.{name}", one)
        return value

    return check


def holds_nan(value: Any) -> bool:
    """Whether a result holds a number that is not one; infinity is a number here."""
    if isinstance(value, float | np.floating):
        return bool(value != value)
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "fc" and bool(np.isnan(value).any())
    if value is None or isinstance(value, str | int):  # most of a result: asked before classes are
        return False
    if isinstance(value, tuple | list):
        return any(map(holds_nan, value))
    if isinstance(value, Mapping):
        return any(map(holds_nan, value.values()))
    if isinstance(value, Result):
        return any(holds_nan(getattr(value, each.name)) for each in fields(value))
    return False
