"""Tables of measured data: one container for every kind.

A kind of data is a subclass of `Table` whose class attributes are its columns; each is a descriptor
that says what the column holds and checks it, and gives the array back as an attribute::

    class Diameters(Table):
        z_mm = Number("from the chuck face outward")
        time_s = OptionalNumber("cutting time within the pass")

The same checks, with the same words, serve the constructor and the file reader.
"""

import html
import io
from collections.abc import Iterable, Iterator, Mapping
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, TextIO, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trunnion.base.errors import InputError
from trunnion.files.columns import Column, ColumnError, has_break, natural, raw_array
from trunnion.files.csv_file import write_columns

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ColumnMapping", "Table"]


class ColumnMapping(Protocol):
    """Columns by name: a dict of arrays, a pandas DataFrame."""

    def items(self) -> Iterable[tuple[Any, Any]]:
        """Return pairs of name and values."""
        ...


class Table:
    """Rows of a kind of data, frozen: one read-only array a column, of equal length.

    Made from a mapping (a dict, a pandas DataFrame), from keywords, or from both. Columns that the
    kind of data does not know are kept: numbers where all of them are finite, text otherwise.
    Rows are chosen by slice, boolean mask, index array or number, which gives the same type, not
    checked again; two tables are equal when they have the same columns with the same contents.

    Raises
    ------
    InputError
        If a column is missing, of another length, or holds what it must not; the message names
        column and row (from 0).
    """

    kinds: ClassVar[Mapping[str, Column[Any]]] = {}
    choice: ClassVar[str] = ""  # columns of which a table needs some, in words
    __slots__ = ("_columns",)
    __hash__ = None  # type: ignore[assignment]  # compared by contents, like an array

    _columns: Mapping[str, NDArray[Any]]

    def __init_subclass__(cls) -> None:
        own = (value for value in vars(cls).values() if isinstance(value, Column))
        cls.kinds = {**cls.kinds, **{column.name: column for column in own}}

    def __init__(self, columns: ColumnMapping | None = None, /, **more: ArrayLike | None) -> None:
        given: dict[str, Any] = {} if columns is None else dict(columns.items())
        more = {self._column_name(name): values for name, values in more.items()}
        for name in more:
            if name in given:
                raise InputError(f"{name}: got the column twice, expected it once")
        given |= {name: values for name, values in more.items() if values is not None}
        try:
            self._fill(given)
        except ColumnError as fault:
            raise InputError(str(fault)) from None

    def _fill(self, given: Mapping[str, Any]) -> None:
        made = {name: self._column(name, values) for name, values in given.items()}
        missing = [name for name in self.required() if name not in made]
        if missing:
            raise ColumnError(
                missing[0],
                None,
                f"no such column among {', '.join(given) or 'none'}",
                f"the columns {self.expected_columns()}",
            )
        lengths = {name: len(values) for name, values in made.items()}
        length = next(iter(lengths.values()), 0)
        for name, count in lengths.items():
            if count != length:
                first = next(iter(lengths))
                raise ColumnError(name, None, f"{count} values", f"{length}, as many as {first}")
        for values in made.values():
            values.flags.writeable = False
        object.__setattr__(self, "_columns", MappingProxyType(made))
        self._check()

    def _column(self, name: str, values: ArrayLike) -> NDArray[Any]:
        if not isinstance(name, str) or name != name.strip() or not name or has_break(name):
            raise ColumnError(str(name), None, f"the name {name!r}", "text on one line")
        kind = self.kinds.get(name)
        array = raw_array(values, name)
        return natural(array, name) if kind is None else kind.convert(array)

    @classmethod
    def checked(cls, columns: Mapping[str, NDArray[Any]]) -> Self:
        """Make a table as the constructor does; what is wrong is a `ColumnError`, with its row."""
        table = cls.__new__(cls)
        table._fill(columns)
        return table

    @classmethod
    def _column_name(cls, keyword: str) -> str:
        """Return the column that a keyword means: pass_ is the column pass."""
        column = keyword.removesuffix("_")
        return column if column in cls.kinds else keyword

    def _check(self) -> None:
        """Check what concerns several columns, or raise `ColumnError`; for a kind to define."""

    @classmethod
    def _of(cls, columns: Mapping[str, NDArray[Any]]) -> Self:
        """Make a table of columns that were checked before, as they are."""
        table = cls.__new__(cls)
        for values in columns.values():
            values.flags.writeable = False
        object.__setattr__(table, "_columns", MappingProxyType(dict(columns)))
        return table

    def all_or_none(self, *names: str) -> None:
        """Refuse the table, with `ColumnError`, if it has some of these columns but not all."""
        there = [name for name in names if name in self.columns]
        if 0 < len(there) < len(names):
            lacking = ", ".join(name for name in names if name not in there)
            raise ColumnError(there[0], None, f"the column without {lacking}", "all or none")

    @classmethod
    def required(cls) -> list[str]:
        """Names of the columns that every table of the kind has."""
        return [name for name, kind in cls.kinds.items() if kind.required]

    @classmethod
    def expected_columns(cls) -> str:
        """Say what columns a table of the kind needs, for messages."""
        return ", ".join(cls.required()) + (f" and {cls.choice}" if cls.choice else "")

    # --- frozen, picklable, compared by contents

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{type(self).__name__} is frozen: make another one")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"{type(self).__name__} is frozen: make another one")

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), dict(self._columns))

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        mine, theirs = self.columns, other.columns
        return mine.keys() == theirs.keys() and all(
            np.array_equal(mine[name], theirs[name]) for name in mine
        )

    # --- rows and columns

    @property
    def columns(self) -> Mapping[str, NDArray[Any]]:
        """Every column by name, extra ones too, in order."""
        return self._columns

    @property
    def extra(self) -> Mapping[str, NDArray[Any]]:
        """The columns that this kind of data does not know."""
        return MappingProxyType(
            {name: values for name, values in self._columns.items() if name not in self.kinds}
        )

    def __len__(self) -> int:
        return len(next(iter(self._columns.values()), ()))

    def __getitem__(self, rows: int | slice | ArrayLike) -> Self:
        """Choose rows: by number (one row), slice, boolean mask or array of numbers."""
        if isinstance(rows, slice):
            index: Any = rows
        else:
            index = np.atleast_1d(np.asarray(rows))
            if index.size == 0:
                index = index.astype(np.int64)
            if index.ndim != 1 or index.dtype.kind not in "biu":
                raise InputError(
                    f"rows: got {rows!r}, expected a number, a slice, a mask or row numbers"
                )
            if index.dtype.kind == "b" and len(index) != len(self):
                raise InputError(f"rows: got a mask of {len(index)}, expected {len(self)}")
            if index.dtype.kind != "b" and np.any((index < -len(self)) | (index >= len(self))):
                raise IndexError(f"rows: got {rows!r}, expected numbers below {len(self)}")
        return self._of({name: values[index] for name, values in self._columns.items()})

    def __iter__(self) -> Iterator[Self]:
        return (self[row] for row in range(len(self)))

    def with_columns(self, **columns: ArrayLike | None) -> Self:
        """Return the table with columns added or replaced; None takes one out."""
        columns = {self._column_name(name): values for name, values in columns.items()}
        kept = {name: values for name, values in self._columns.items() if name not in columns}
        order = {name: kept.get(name, columns.get(name)) for name in (*self._columns, *columns)}
        return type(self)({name: values for name, values in order.items() if values is not None})

    @classmethod
    def concatenate(cls, tables: Iterable[Self]) -> Self:
        """Put tables with the same columns one below the other."""
        parts = list(tables)
        if not parts:
            raise InputError("tables: got none, expected at least one")
        names = list(parts[0].columns)
        for part in parts[1:]:
            if set(part.columns) != set(names):
                raise InputError(
                    f"tables: got the columns {', '.join(part.columns)}, expected those of the "
                    f"first, {', '.join(names)}"
                )
        joined: dict[str, NDArray[Any]] = {}
        for name in names:
            columns = [part.columns[name] for part in parts]
            if any(column.dtype.kind == "U" for column in columns):
                columns = [column.astype(np.str_) for column in columns]
            joined[name] = np.concatenate(columns)
        return cls._of(joined)

    # --- out

    @overload
    def to_csv(self) -> str: ...
    @overload
    def to_csv(self, path: str | PathLike[str] | TextIO) -> None: ...
    def to_csv(self, path: str | PathLike[str] | TextIO | None = None) -> str | None:
        """Write the table to a file, or return it as text; it reads back as an equal table."""
        if path is None:
            buffer = io.StringIO()
            write_columns(self._columns, buffer)
            return buffer.getvalue()
        if isinstance(path, str | PathLike):
            with Path(path).open("w", encoding="utf-8", newline="\n") as file:
                write_columns(self._columns, file)
        else:
            write_columns(self._columns, path)
        return None

    def to_pandas(self) -> "pd.DataFrame":
        """Return a pandas DataFrame with the same columns (needs pandas)."""
        import pandas as pd

        return pd.DataFrame(dict(self._columns))

    def to_dict(self) -> dict[str, list[Any]]:
        """Return plain lists by column name, for JSON."""
        return {name: values.tolist() for name, values in self._columns.items()}

    def __repr__(self) -> str:
        count = len(self)
        return (
            f"{type(self).__name__}({count} row{'' if count == 1 else 's'}: "
            f"{', '.join(self._columns)})"
        )

    def _repr_html_(self) -> str:
        count = len(self)
        shown = list(range(count)) if count <= 12 else [*range(6), None, *range(count - 5, count)]
        head = "".join(f"<th>{html.escape(name)}</th>" for name in self._columns)
        body = "".join(f"<tr>{self._html_row(row)}</tr>" for row in shown)
        return (
            f"<table><caption>{type(self).__name__}, {count} rows</caption>"
            f"<thead><tr><th></th>{head}</tr></thead><tbody>{body}</tbody></table>"
        )

    def _html_row(self, row: int | None) -> str:
        if row is None:
            return "<td>…</td>" * (len(self._columns) + 1)
        fields = (_html_field(values[row]) for values in self._columns.values())
        return f"<th>{row}</th>" + "".join(f"<td>{field}</td>" for field in fields)


def _restored(kind: type[Table], columns: Mapping[str, NDArray[Any]]) -> Table:
    """Unpickle a table."""
    return kind._of(columns)


def _html_field(value: Any) -> str:
    return html.escape(f"{value:.10g}" if isinstance(value, np.floating) else str(value))
