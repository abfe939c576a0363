"""Arguments that are not what a call takes: an error that says what they are instead."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from numbers import Integral, Real
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from trunnion.base.errors import InputError, TrunnionError

__all__ = ["entry", "finite", "floats", "instance", "named", "shown", "whole"]

T = TypeVar("T")
Floats: TypeAlias = NDArray[np.float64]


def instance(what: str, value: object, kind: type[T], wanted: str) -> T:
    """Return the value if it is of that kind.

    Raises
    ------
    InputError
        Anything else, in the words of `wanted`.
    """
    if not isinstance(value, kind):
        raise InputError(f"{what}: got {shown(value)}, wanted {wanted}")
    return value


def named(what: str, value: object, wanted: str) -> Mapping[Any, Any]:
    """Return names with values; None is none of them."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise InputError(f"{what}: got {shown(value)}, wanted {wanted}")
    return value


def finite(what: str, value: object, wanted: str = "a finite number") -> float:
    """Return a number as float; text, flags and what is not finite are refused."""
    if isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    raise InputError(f"{what}: got {value!r}, wanted {wanted}")


def whole(what: str, value: object, low: int, high: int | None = None) -> int:
    """Return a whole number, from `low` to `high` (None: without a limit)."""
    number = isinstance(value, Integral) and not isinstance(value, bool)
    if number and low <= int(value) and (high is None or int(value) <= high):  # type: ignore[call-overload]
        return int(value)  # type: ignore[call-overload,no-any-return]
    to = "" if high is None else f" to {high:g}"
    raise InputError(f"{what}: got {shown(value)}, wanted a whole number from {low}{to}")


def floats(what: str, value: object) -> Floats:
    """Return finite numbers as an array of their shape."""
    try:
        given = np.asarray(value)
        found = given.astype(np.float64) if given.dtype.kind in "fiuO" else None
    except (TypeError, ValueError, OverflowError):
        found = None
    if found is None:
        raise InputError(f"{what}: got {shown(value)}, wanted numbers")
    if not np.isfinite(found).all():
        raise InputError(f"{what}: got {shown(value)}, wanted finite numbers")
    return found


def shown(value: object) -> str:
    """Return a value as a message has it: numbers and text in full, the rest by type and start."""
    try:
        text = repr(value)
    except ValueError:  # Python writes no whole number of more than 4300 digits
        return "a whole number of thousands of digits"
    return text if isinstance(value, str | int | float) else f"{type(value).__name__} {text:.40}"


@contextmanager
def entry(*keys: str | int) -> Iterator[None]:
    """Note on errors raised inside that they are about this entry of a table (`error.entry`)."""
    try:
        yield
    except TrunnionError as error:
        error.entry = (*keys, *error.entry)
        raise
