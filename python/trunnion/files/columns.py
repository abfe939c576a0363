"""Columns of a table: what each kind holds, how it is checked, in which words it is refused.

A column is a descriptor: declared in the class of a kind of data, it gives the column's array as an
attribute of its tables.
"""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from typing import Any, ClassVar, Generic, Never, Protocol, Self, TypeGuard, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trunnion.base.checks import shown
from trunnion.base.units import Flags, Floats, unit_of

Int = NDArray[np.int64]
Labels = NDArray[np.int64] | NDArray[np.str_]
T = TypeVar("T", bound=NDArray[Any] | None)


class HasColumns(Protocol):
    """What a column is an attribute of: something with columns by name, a table."""

    @property
    def columns(self) -> Mapping[str, NDArray[Any]]:
        """Arrays by column name."""
        ...


# A whole number that is written as Python writes it; 007 is a name.
_WHOLE = re.compile(r"0|-?[1-9][0-9]{0,18}")
# Digits that a number would not keep: leading zeros, or more than a float has.
_DIGITS = re.compile(r"[+-]?(?:0[0-9].*|[0-9]{16,})")
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
# 15.3 as spreadsheets show it, or keep it, once they took it for a day.
_DAY = re.compile(r"\d{1,2}[.-] ?[^\W\d]{3}\.?|[^\W\d]{3}-\d{2}|\d{4}-\d{2}-\d{2} 00:00:00")
_BREAK = re.compile(r"[\n\r\0]")
_STAMP = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}[T ][0-9]{2}:[0-9]{2}.*")


LARGEST = {
    **{"mm": 1e6, "µm": 1e9, "deg": 1e6, "s": 1e12, "mm/min": 1e9, "µm/m": 1e6, "1/min": 1e7},
    "": 1e12,
}
"""Beyond these no machine is meant, and an angle would lose its arcseconds to rounding."""

SMALLEST = 1e-9
"""Where numbers have one sign: one nearer to 0 is of no machine, either."""


BELOW_SHARE = 0.1
"""Of lengths: so many below 0 are no slips, but deviations from a nominal length."""


class ColumnError(Exception):
    """A value that its column does not take, with its row (from 0; None: the whole column).

    It stays inside: the constructor of a table makes an InputError of it, the reader of a file a
    FileFormatError with line and column.
    """

    def __init__(self, column: str, row: int | None, got: str, expected: str) -> None:
        where = column if row is None else f"{column} (row {row})"
        super().__init__(f"{where}: got {got}, expected {expected}")
        self.said = f"{column}: got {got}, expected {expected}"
        self.column, self.row = column, row


# --- columns


class Column(Generic[T]):
    """A column of a kind of data: name, meaning, check. T is what the attribute returns."""

    required: ClassVar[bool] = True
    name: str
    observed: bool = False  # a reading, what the measurement was made for
    commanded: bool = False  # a position that readings were to be taken at

    def __init__(self, meaning: str) -> None:
        self.meaning = meaning
        self.__doc__ = meaning

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name.rstrip("_")  # pass_, as pass is a word of Python

    @overload
    def __get__(self, table: None, owner: type) -> Self: ...
    @overload
    def __get__(self, table: HasColumns, owner: type) -> T: ...
    def __get__(self, table: HasColumns | None, owner: type) -> Any:
        return self if table is None else table.columns.get(self.name)

    def __set__(self, table: HasColumns, value: Never) -> None:
        raise AttributeError(f"{type(table).__name__}.{self.name} is read-only")

    def convert(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values in the column's type, or raise `ColumnError`."""
        raise NotImplementedError

    def refuse(self, values: NDArray[Any], bad: Flags, expected: str) -> None:
        """Raise `ColumnError` at the first bad row, if there is one."""
        if bad.any():
            row = int(np.argmax(bad))
            raise ColumnError(self.name, row, shown_field(values[row]), expected)


class _Numeric(Column[T]):
    """Finite numbers, optionally restricted: above 0, from a minimum on, or to some values.

    A column is ``observed``, ``commanded``, or neither: a time, a feed, a temperature.
    """

    expected_type: ClassVar[str] = "a finite number"

    def __init__(
        self,
        meaning: str,
        *,
        positive: bool = False,
        minimum: float | None = None,
        among: Sequence[float] | None = None,
        observed: bool = False,
        commanded: bool = False,
    ) -> None:
        super().__init__(meaning)
        self.observed = observed
        self.commanded = commanded
        self.positive = positive
        self.minimum = minimum
        self.among = among
        self.expected = self.expected_type
        if positive:
            self.expected += " above 0"
        if minimum is not None:
            self.expected += f", {minimum:g} or above"
        if among is not None:
            self.expected = "one of " + ", ".join(f"{value:g}" for value in among)

    def convert(self, values: NDArray[Any]) -> NDArray[Any]:
        numbers = _floats(values)
        if numbers is None:
            bad = np.array([parse_number(value) is None for value in values], dtype=bool)
            likely = _likely(values[int(np.argmax(bad))]) if bad.any() else ""
            self.refuse(values, bad, self.expected + likely)
            numbers = np.array([parse_number(value) for value in values], dtype=np.float64)
        bad = ~np.isfinite(numbers)
        most = LARGEST.get(unit_of(self.name), np.inf)
        likely = " (are these µm?)" if unit_of(self.name) == "mm" else ""
        far = ~bad & (np.abs(numbers) > most)
        self.refuse(values, far, f"a number within ±{most:g}{likely}")
        if self.positive:
            bad |= ~(numbers > 0.0)
        if self.positive or self.minimum == 0.0:
            zero = "" if self.positive else "0 or "
            tiny = ~bad & (numbers > 0.0) & (numbers < SMALLEST)
            self.refuse(values, tiny, f"{zero}at least {SMALLEST:g}")
        if self.minimum is not None:
            bad |= ~(numbers >= self.minimum)
        if self.among is not None:
            bad |= ~np.isin(numbers, self.among)
        self.refuse(values, bad, self.expected + self._likely_deviations(numbers))
        return numbers

    def _likely_deviations(self, numbers: Floats) -> str:
        """Ask about readings of both signs where lengths are expected."""
        below = float(np.mean(numbers < 0.0)) if len(numbers) and self.positive else 0.0
        if not self.observed or below < BELOW_SHARE or not np.isfinite(numbers).all():
            return ""
        return " (are these deviations? Then the length is the nominal length plus the deviation)"


class Number(_Numeric[Floats]):
    """A required column of finite numbers."""


class OptionalNumber(_Numeric[Floats | None]):
    """A column of finite numbers that may be missing (None)."""

    required = False


class _Time(_Numeric[T]):
    """Seconds, or dates with times (ISO 8601), which become seconds since the first row's."""

    expected_type = "a finite number of seconds, or a date with a time as in 2026-11-22T10:30:00"

    def convert(self, values: NDArray[Any]) -> NDArray[Any]:
        stamped = np.array([is_time_stamp(value) for value in values.tolist()], dtype=bool)
        if not stamped.any():
            return super().convert(values)
        self.refuse(values, ~stamped, "a date with a time in every row, as in others")
        times: list[datetime] = []
        for row, text in enumerate(values.tolist()):
            try:
                times.append(datetime.fromisoformat(text.strip()))
                times[-1] - times[0]
            except ValueError:
                expected = "a date with a time that there is, as in 2026-11-22T10:30:00"
                raise ColumnError(self.name, row, shown_field(text), expected) from None
            except TypeError:
                expected = "a time zone in every row, or in none"
                raise ColumnError(self.name, row, shown_field(text), expected) from None
        return np.array([(time - times[0]).total_seconds() for time in times])


class Time(_Time[Floats]):
    """A required column of times."""


class OptionalTime(_Time[Floats | None]):
    """A column of times that may be missing (None)."""

    required = False


class _Whole(_Numeric[T]):
    expected_type = "a whole number"

    def convert(self, values: NDArray[Any]) -> NDArray[Any]:
        numbers = super().convert(values)
        # Beyond 2**53 neighbouring whole numbers are the same float.
        bad = (numbers != np.round(numbers)) | (np.abs(numbers) > 2.0**53)
        self.refuse(values, bad, self.expected)
        return numbers.astype(np.int64)


class Integer(_Whole[Int]):
    """A required column of whole numbers."""


class OptionalInteger(_Whole[Int | None]):
    """A column of whole numbers that may be missing (None)."""

    required = False


class _Name(Column[T]):
    """Names of classes: whole numbers if all of them are, text otherwise."""

    def convert(self, values: NDArray[Any]) -> NDArray[Any]:
        if values.dtype.kind in "fO":
            missing = [value is None or value != value for value in values.tolist()]
            self.refuse(values, np.array(missing, dtype=bool), "a name or a whole number")
        if values.dtype.kind == "f" and np.all(np.abs(values) < 2.0**53):
            whole = values.astype(np.int64)
            values = whole if np.array_equal(whole, values) else values
        labels = natural(values, self.name, decimals=False)
        if labels.dtype.kind == "U":
            self.refuse(values, np.char.str_len(labels) == 0, "a name or a whole number")
        return labels


class Label(_Name[Labels]):
    """A required column of names."""


class OptionalLabel(_Name[Labels | None]):
    """A column of names that may be missing (None)."""

    required = False


def is_time_stamp(value: object) -> TypeGuard[str]:
    """Whether a value is written as a date with a time (ISO 8601)."""
    return isinstance(value, str) and _STAMP.fullmatch(value.strip()) is not None


def first_stamp(values: Sequence[object]) -> datetime | None:
    """Return the first value as a date with a time; None if it is none."""
    first = values[0] if values else None
    return datetime.fromisoformat(first.strip()) if is_time_stamp(first) else None


def is_numeric(column: Column[Any] | None) -> bool:
    """Whether a column holds numbers."""
    return isinstance(column, _Numeric)


def scaled(name: str, values: NDArray[Any], factor: float) -> Floats:
    """Return ``factor * values`` of a column of numbers or of text that are numbers.

    Raises ColumnError: a value is no finite number.
    """
    found = Number("")
    found.name = name
    return factor * np.asarray(found.convert(values), dtype=np.float64)


def shown_field(value: object) -> str:
    """Return a field of a file as a message shows it."""
    return "an empty field" if isinstance(value, str) and not value.strip() else shown(value)


def parse_number(value: object) -> float | None:
    """Return the number that a value is; None for what is none, 1_000 and nan among it."""
    if isinstance(value, str):
        text = value.strip()
        return float(text) if _DECIMAL.fullmatch(text) else None
    if isinstance(value, bool | np.bool_) or value is None:
        return None
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return None


def _likely(value: object) -> str:
    """Say what a field that is no number probably was; empty where nothing is known."""
    text = str(value).strip()
    if _DAY.fullmatch(text):
        return " (a number that a spreadsheet took for a date?)"
    return " (a decimal comma?)" if _DECIMAL.fullmatch(text.replace(",", ".", 1)) else ""


def _floats(values: NDArray[Any]) -> Floats | None:
    """Convert all values at once; None if one of them may not be a number."""
    if values.dtype.kind in "fiu":
        return values.astype(np.float64)
    if values.dtype.kind == "b":
        return None
    fields = values.tolist()
    try:
        # float() alone would take 1_000 and digits of other scripts, which are no CSV numbers.
        text = ",".join(fields)
        if "_" in text or not text.isascii():
            return None
        return np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))
    except (TypeError, ValueError):
        return None


def natural(values: NDArray[Any], name: str, *, decimals: bool = True) -> NDArray[Any]:
    """Return whole numbers, finite numbers (`decimals`) or text: the first that loses nothing.

    `name` is the column's, for the `ColumnError` that text with a line break raises.
    """
    if values.dtype.kind == "i":
        return values.astype(np.int64)
    if decimals and values.dtype.kind == "f" and np.all(np.isfinite(values)):
        return values.astype(np.float64)
    texts = [value if isinstance(value, str) else str(value) for value in values.tolist()]
    if all(map(_WHOLE.fullmatch, texts)):
        with suppress(OverflowError):  # nineteen digits may be more than 64 bits
            return np.array(list(map(int, texts)), dtype=np.int64)
    if decimals and not any(map(_DIGITS.fullmatch, texts)):
        numbers = [parse_number(text) for text in texts]
        if None not in numbers and np.all(np.isfinite(floats := np.array(numbers, np.float64))):
            return floats
    for row, text in enumerate(texts):
        if has_break(text):
            raise ColumnError(name, row, shown_field(text), "text on one line")
    return np.array(texts, dtype=np.str_)


def has_break(text: str) -> bool:
    """Say whether a text has what a field of a line cannot hold."""
    return _BREAK.search(text) is not None


def raw_array(values: ArrayLike, name: str) -> NDArray[Any]:
    """Return a copy as an array of numbers or, if it has anything else in it, of objects."""
    try:
        array = np.array(values)
        if array.dtype.kind == "M":
            return np.datetime_as_string(array).astype(object)
        if array.dtype.kind not in "fiub":  # numpy would turn mixed values into text
            array = np.array(values, dtype=object)
            if array.ndim == 1:  # dates with a time zone are objects in pandas, too
                said = [v.isoformat() if isinstance(v, datetime) else v for v in array.tolist()]
                array = np.fromiter(said, dtype=object, count=len(said))
    except ValueError:
        raise ColumnError(name, None, "rows of different lengths", "one value a row") from None
    if array.ndim != 1:
        raise ColumnError(name, None, f"an array of shape {array.shape}", "one value a row")
    return array


def stack(*columns: Floats | None) -> Floats:
    """Put columns side by side, (n, number of columns), read-only; absent ones are left out."""
    stacked = np.stack([column for column in columns if column is not None], axis=1)
    stacked.flags.writeable = False
    return stacked
