"""Values as JSON holds them, and back: a fault is an error of the package that names its place."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import cache
from math import isfinite
from numbers import Real
from os import PathLike
from types import UnionType
from typing import TYPE_CHECKING, Any, TypeVar, Union, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from trunnion.base.errors import FileFormatError, InputError, TrunnionError
from trunnion.base.input import file_bytes
from trunnion.base.saved import Saved

if TYPE_CHECKING:
    from cattrs import Converter

C = TypeVar("C")

DOUBLE = np.dtype(np.float64).itemsize


def read_json(source: str | PathLike[str]) -> tuple[Any, str]:
    """Return what JSON text, or a file of it, holds, and what messages call its place.

    Raises
    ------
    FileFormatError
        It is not JSON; the message names line and column.
    """
    text, where = str(source), "JSON"
    if not isinstance(source, str | PathLike):
        raise InputError(f"source: got {type(source).__name__}, expected JSON text or a path")
    if isinstance(source, PathLike) or not text.lstrip().startswith(("{", "[", '"')):
        if "\n" in text or "\0" in text or len(text) > MAX_PATH:
            raise FileFormatError(f"{where}:1:1: got {text[:20]!r}, expected a table {{...}}")
        where = text
        raw = file_bytes(source)
        try:
            text = raw.decode("utf-8")
        except UnicodeDecodeError as error:
            line = raw.count(b"\n", 0, error.start) + 1
            column = error.start - raw.rfind(b"\n", 0, error.start)
            raise FileFormatError(
                f"{where}:{line}:{column}: got the byte 0x{raw[error.start]:02x}, expected UTF-8"
            ) from None
    try:
        return json.loads(text, parse_constant=_no_constant), where
    except json.JSONDecodeError as error:
        raise FileFormatError(
            f"{where}:{error.lineno}:{error.colno}: got text ({error.msg}), expected JSON"
        ) from error
    except (ValueError, RecursionError) as error:  # nan, thousands of digits, of brackets
        raise FileFormatError(f"{where}:1:1: {error}") from None


MAX_PATH = 4000
"""Characters of a path; more is text."""


def _no_constant(name: str) -> float:
    raise ValueError(f"got {name}, expected JSON: numbers are finite there")


@contextmanager
def fitting(what: str) -> Iterator[None]:
    """Make an InputError of what stored values of another shape lead to, whatever it is."""
    try:
        yield
    except TrunnionError:
        raise
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        raise InputError(f"{what}: got values that do not fit its fields: {error}") from error


@cache
def _converter() -> Converter:
    """Return what turns results into plain values and back, "inf" and "nan" as text."""
    from cattrs import Converter
    from cattrs.gen import make_dict_structure_fn

    converter = Converter()
    converter.register_unstructure_hook(float, plain)
    converter.register_unstructure_hook_func(
        lambda kind: isinstance(kind, type) and issubclass(kind, np.ndarray | np.generic), plain
    )
    converter.register_structure_hook(float, lambda value, _: _stored_number(value))
    converter.register_structure_hook(bool, lambda value, _: _stored_switch(value))
    # A field that has defaults for all would be read from an empty list as they are.
    converter.register_structure_hook_factory(
        lambda kind: isinstance(kind, type) and is_dataclass(kind),
        lambda kind: _from_table(make_dict_structure_fn(kind, converter)),
    )
    converter.register_structure_hook_func(
        lambda kind: getattr(kind, "__origin__", kind) is np.ndarray, _array
    )
    converter.register_structure_hook_func(
        lambda kind: sum(map(is_dataclass, _options(kind))) > 1,
        lambda value, kind: converter.structure(value, _fitting(value, kind)),
    )
    converter.register_structure_hook_func(_is_plain_choice, lambda value, _: value)
    converter.register_structure_hook_func(
        lambda kind: hasattr(kind, "from_description"),  # measured data
        lambda value, kind: kind.from_description(value),
    )
    return converter


def _is_plain_choice(kind: Any) -> bool:
    """Whether a field takes a word, a switch or a mapping: as stored, and checked by its class."""
    options = [get_origin(o) or o for o in _options(kind)]
    return Mapping in options and not any(map(is_dataclass, options))


def _options(kind: Any) -> tuple[Any, ...]:
    """Return the types of a union; none for any other type."""
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else ()


def _fitting(value: Any, kind: Any) -> Any:
    """Return the dataclass of a union that the values name, or whose fields they have."""
    for option in _options(kind) if isinstance(value, Mapping) else ():
        if not (isinstance(option, type) and is_dataclass(option)):
            continue
        names = {field.name for field in fields(option)}
        if value.get("result") == option.__name__ or set(value) == names:
            return option
    raise InputError(f"got {value!r:.60}, expected the fields of one of {kind}")


def _array(value: Any, kind: Any) -> Any:
    """Return nested lists as an array of the annotated type of number."""
    scalar = next(iter(get_args(get_args(kind)[-1])), None) if get_args(kind) else None
    dtype = scalar if isinstance(scalar, type) and issubclass(scalar, np.generic) else None
    found = np.asarray(value, dtype=None if dtype is np.generic else dtype)
    if found.dtype.kind == "f" and np.isnan(found).any():
        raise InputError("got nan, expected numbers")
    return found


def _stored_number(value: Any) -> float:
    """Return a number as `plain` stores it."""
    infinite = isinstance(value, str) and value in ("inf", "-inf")
    if not infinite and (isinstance(value, bool) or not isinstance(value, Real)):
        raise InputError(f"got {value!r:.60}, expected a number")
    number = float(value)
    if number != number:
        raise InputError("got nan, expected a number")
    return number


def _stored_switch(value: Any) -> bool:
    """Return true or false; 0, 1 and words are none."""
    if not isinstance(value, bool):
        raise InputError(f"got {value!r:.60}, expected true or false")
    return value


def _from_table(made: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return what makes a dataclass of a table of its fields, and refuses all else."""

    def structure(value: Any, kind: Any) -> Any:
        if not isinstance(value, Mapping):
            raise InputError(f"got {value!r:.60}, expected the fields of {kind.__name__}")
        return made(value, kind)

    return structure


def plain(value: Any) -> Any:
    """Return a value as JSON can hold it: arrays as lists, numbers not finite as text."""
    if type(value) is float:  # nearly all there is
        return value if isfinite(value) else str(value)
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, np.ndarray) and _is_plain(value):
        return value.tolist()
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist())
    if isinstance(value, int):
        return value
    if isinstance(value, Real):
        return float(value) if np.isfinite(float(value)) else str(float(value))
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, set | frozenset):
        return sorted(plain(entry) for entry in value)
    if isinstance(value, Saved) and is_dataclass(value):  # a result
        return value.to_dict()
    if hasattr(value, "described"):  # measured data
        return value.described()
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return str(value)


def _is_plain(array: NDArray[Any]) -> bool:
    """Whether every entry of an array is one that JSON holds as it is."""
    kind = array.dtype.kind
    finite = kind == "f" and array.dtype.itemsize <= DOUBLE and bool(np.isfinite(array).all())
    return finite or kind in "biuU"


def _said(error: BaseException, kind: type | None) -> str:
    """Say what is wrong with a field."""
    from cattrs.v import format_exception

    return str(error) if isinstance(error, TrunnionError) else format_exception(error, kind)


def structured(values: Any, kind: type[C]) -> C:
    """Return plain values, as `plain` gives them, as a dataclass.

    Raises
    ------
    InputError
        The values are not those of this class.
    """
    try:
        return _converter().structure(values, kind)
    except Exception as error:  # cattrs raises groups of errors, one a field
        from cattrs import transform_error

        fields = transform_error(error, format_exception=_said)
        raise InputError(
            f"{kind.__name__}: got values that do not fit its fields: {'; '.join(fields)}"
        ) from error
