"""Checks of arguments: a value in its final type, or an error that says what was expected.

Every message reads ``<what>: got <value>, expected <what it takes>``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from importlib import import_module
from numbers import Integral, Real
from typing import Any, SupportsFloat, SupportsInt, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.errors import InputError, TrunnionError, UnknownNameError
from trunnion.base.units import Floats

T = TypeVar("T")

MAX_SHOWN = 60
"""Characters of a value that a message shows."""


def with_article(kind: type) -> str:
    """Return the name of a type with its article: ``a Setup``, ``an Artefact``."""
    return f"{'an' if kind.__name__[0] in 'AEIO' else 'a'} {kind.__name__}"


def shown(value: object) -> str:
    """Return a value as a message shows it: one line, the type beside what is no plain value."""
    if isinstance(value, np.generic):
        value = value.item()
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # Python writes no integer of more than 4300 digits
        return "a whole number of thousands of digits" if isinstance(value, int) else "such a value"
    if not isinstance(value, str | int | float | list | tuple | Mapping | None):
        text = f"{type(value).__name__} {' '.join(text.split())}"
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."


def instance(what: str, value: object, kind: type[T], expected: str) -> T:
    """Return the value if it is of that kind.

    Raises InputError: anything else, in the words of `expected`.
    """
    if not isinstance(value, kind):
        raise InputError(f"{what}: got {shown(value)}, expected {expected}")
    return value


def mapping(what: str, value: object, expected: str = "a table") -> Mapping[Any, Any]:
    """Return names with values."""
    if not isinstance(value, Mapping):
        raise InputError(f"{what}: got {shown(value)}, expected {expected}")
    return value


def named(what: str, value: object, expected: str) -> Mapping[Any, Any]:
    """Return names with values; None is none of them."""
    return {} if value is None else mapping(what, value, expected)


def numbers(what: str, value: object) -> dict[str, float]:
    """Return names with finite numbers; None is none of them."""
    given = named(what, value, "names with numbers")
    return {str(name): finite(f"{what}.{name}", size) for name, size in given.items()}


def finite(what: str, value: object, expected: str = "a finite number") -> float:
    """Return a number as float; text, flags and what is not finite are refused."""
    if type(value) is float and math.isfinite(value):  # nearly all are: no class is asked
        return value
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            number = float(cast(SupportsFloat, value))
        except OverflowError:  # an integer beyond 1.8e308
            number = math.inf
        if math.isfinite(number):
            return number
    raise InputError(f"{what}: got {shown(value)}, expected {expected}")


def positive(what: str, value: object) -> float:
    """Return a finite number above 0."""
    expected = "a finite number above 0"
    number = finite(what, value, expected)
    if number <= 0.0:
        raise InputError(f"{what}: got {shown(value)}, expected {expected}")
    return number


def within(what: str, value: object, low: float, high: float = math.inf, unit: str = "") -> float:
    """Return a finite number from `low` to `high`, both allowed; `unit` is for the message."""
    expected = f"a finite number, {low:g} or above"
    if high < math.inf:
        expected = f"a number from {low:g} to {high:g} {unit}".rstrip()
    number = finite(what, value, expected)
    if not low <= number <= high:
        raise InputError(f"{what}: got {shown(value)}, expected {expected}")
    return number


def whole(what: str, value: object, low: int, high: int | None = None) -> int:
    """Return a whole number, from `low` to `high` (None: without a limit)."""
    if isinstance(value, Integral) and not isinstance(value, bool):
        number = int(cast(SupportsInt, value))
        if number >= low and (high is None or number <= high):
            return number
    bounds = f" from {low}" + ("" if high is None else f" to {high:g}")
    if high == 2**63 - 1:  # what a computer holds
        bounds = " of 64 bits" if isinstance(value, Integral) else ""
    raise InputError(f"{what}: got {shown(value)}, expected a whole number{bounds}")


def array(what: str, value: ArrayLike, columns: int, *, rows: int | None = None) -> Floats:
    """Return finite numbers as an array of shape (n, `columns`); one row may be given flat.

    Raises InputError: another shape (or, with `rows`, another n), or a number that is not finite,
        with its row.
    """
    shape = f"({'n' if rows is None else rows}, {columns})"
    try:
        given = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what}: got {shown(value)}, expected numbers of shape {shape}") from None
    found = np.atleast_2d(given)
    if found.ndim != 2 or found.shape[1] != columns or rows not in (None, len(found)):
        raise InputError(f"{what}: got shape {given.shape}, expected {shape}")
    finite = np.isfinite(found)
    if not finite.all():  # row by row takes ten times as long
        row = int(np.argmin(finite.all(axis=1)))
        raise InputError(f"{what}, row {row}: got {found[row]}, expected finite numbers")
    return np.ascontiguousarray(found)


def point(what: str, value: ArrayLike) -> tuple[float, float, float]:
    """Return three finite numbers."""
    x, y, z = array(what, value, 3, rows=1)[0].tolist()
    return x, y, z


def floats(what: str, value: object) -> Floats:
    """Return finite numbers as an array of their shape."""
    try:
        given = np.asarray(value)
        found = given.astype(np.float64) if given.dtype.kind in "fiuO" else None
    except (TypeError, ValueError, OverflowError):
        found = None
    if found is None:
        raise InputError(f"{what}: got {shown(value)}, expected numbers")
    bad = ~np.isfinite(found)
    if bad.any() and found.ndim == 2:
        row = int(np.argmax(bad.any(axis=1)))
        raise InputError(f"{what}, row {row}: got {found[row]}, expected finite numbers")
    if bad.any():
        at = f"[{int(np.argmax(bad))}]" if found.ndim == 1 and found.size > 1 else ""
        raise InputError(f"{what}{at}: got {shown(value)}, expected finite numbers")
    return found


def line(what: str, value: object) -> Floats:
    """Return finite numbers as an array of shape (n,); a number is one of them."""
    found = np.atleast_1d(floats(what, value))
    if found.ndim != 1:
        raise InputError(f"{what}: got shape {found.shape}, expected (n,)")
    return found


def count_of(what: str, length: float, step: float, most: int = 5_000_000) -> int:
    """Return how many steps of a size go into a length, whole ones.

    Raises
    ------
    InputError
        More than `most`, or none that is a number.
    """
    count = length / positive(what, step)
    if not 0 <= count <= most:
        raise InputError(
            f"{what}: got {shown(step)}, {count:.3g} steps in {length:g}, expected at most {most:,}"
        )
    return int(count + 1e-9)


def choose(what: str, name: object, known: Iterable[str]) -> str:
    """Return the name if it is one of the known.

    Raises UnknownNameError: it is not; the message has the list and, if one is near, the name that
        was likely meant.
    """
    names = tuple(known)
    if isinstance(name, str) and name in names:
        return name
    raise UnknownNameError(
        f"{what}: got {shown(name)}, expected one of {', '.join(names)}{did_you_mean(name, names)}"
    )


def nearest(name: object, known: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Return the known name that is near; None: there is none.

    cutoff: Least likeness, 1 where names are the same but for the case of letters.
    """
    if not isinstance(name, str):
        return None
    spellings = {each.lower(): each for each in known}
    text = name.lower()
    # Without its unit: the shortest, as "accuracy" is rather accuracy_um than accuracy_forward_um.
    near = [each for each in spellings if text and each.startswith(text + "_")]
    near = sorted(near, key=len) or get_close_matches(text, spellings, 1, cutoff)
    return spellings[near[0]] if near else None


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return "; did you mean x?" if a known name is near, an empty text otherwise."""
    near = nearest(name, known)
    return "" if near is None else f"; did you mean {near}?"


def optional_module(name: str, user: str, extra: str) -> Any:
    """Import a module that an extra of the package installs.

    Raises ImportError: it is not installed; the message names the extra.
    """
    try:
        return import_module(name)
    except ImportError as error:
        hint = f"pip install 'trunnion[{extra}]'"
        raise ImportError(f"{name} is not installed; expected for {user}: {hint}") from error


@contextmanager
def entry(*keys: str | int) -> Iterator[None]:
    """Note on errors raised inside that they are about this entry of a table (`error.entry`)."""
    try:
        yield
    except TrunnionError as error:
        error.entry = (*keys, *error.entry)
        raise
