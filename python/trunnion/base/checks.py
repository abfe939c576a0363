"""Arguments that are not what a call takes: an error that says what they are instead."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real
from typing import Any, TypeVar

from trunnion.base.errors import InputError

__all__ = ["finite", "instance", "named"]

T = TypeVar("T")


def instance(what: str, value: object, kind: type[T], wanted: str) -> T:
    """Return the value if it is of that kind.

    Raises
    ------
    InputError
        Anything else, in the words of `wanted`.
    """
    if not isinstance(value, kind):
        raise InputError(f"{what}: got {_shown(value)}, wanted {wanted}")
    return value


def named(what: str, value: object, wanted: str) -> Mapping[Any, Any]:
    """Return names with values; None is none of them."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise InputError(f"{what}: got {_shown(value)}, wanted {wanted}")
    return value


def finite(what: str, value: object, wanted: str = "a finite number") -> float:
    """Return a number as float; text, flags and what is not finite are refused."""
    if isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    raise InputError(f"{what}: got {value!r}, wanted {wanted}")


def _shown(value: object) -> str:
    text = repr(value)
    return text if isinstance(value, str | int | float) else f"{type(value).__name__} {text:.40}"
