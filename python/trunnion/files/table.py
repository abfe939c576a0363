"""Tables of measured data: one container for every kind.

A kind of data is a subclass of `Table` whose class attributes are its columns; each is a descriptor
that says what the column holds and checks it, and gives the array back as an attribute::

    class Diameters(Table):
        z_mm = Number("from the chuck face outward", commanded=True)
        error_um = Number("measured minus nominal diameter", observed=True)
        time_s = OptionalNumber("cutting time within the pass")

`Table.readings` and `Table.set_positions` follow from these declarations. The same checks, with the
same words, serve the constructor and the file reader.
"""

import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from os import PathLike
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, TextIO, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trunnion.base.checks import did_you_mean, shown, with_article
from trunnion.base.errors import FileFormatError, InputError, TrunnionError, UnknownNameError
from trunnion.base.input import path_of
from trunnion.base.output import whole_file, write_text
from trunnion.base.saved import Columns, Gridded, Saved, dataframe
from trunnion.base.stored import fitting, plain, read_json
from trunnion.files.columns import Column, ColumnError, first_stamp, has_break, natural, raw_array
from trunnion.files.csv_file import TIME, write_columns
from trunnion.files.dates import clocks_apart, on_one_clock, with_dates
from trunnion.files.origin import FROM_0, Origin, places
from trunnion.files.recognised import Recognised
from trunnion.files.table_html import html_table

if TYPE_CHECKING:
    import pandas as pd

Rows: TypeAlias = int | slice | Sequence[int] | Sequence[bool] | NDArray[Any]
"""What chooses rows: a number, a slice, numbers, a mask."""


class ColumnMapping(Protocol):
    """Columns by name: a dict of arrays, a pandas DataFrame, an xarray Dataset."""

    def items(self) -> Iterable[tuple[Any, Any]]:
        """Return pairs of name and values."""
        ...


def named_columns(given: Any) -> dict[str, Any]:
    """Return columns by name of a dict, a DataFrame or a Dataset.

    Named levels of an index and coordinates of a Dataset are columns, too; a Dataset on a grid is
    taken node by node. What is called "index" numbers the rows and is none.
    """
    named = None
    if hasattr(given, "coords") and hasattr(given, "to_dataframe"):  # a Dataset
        named, given = set(given.coords), given.to_dataframe()
    for name in getattr(getattr(given, "index", None), "names", ()):
        if name is None or name == "index" or not (named is None or name in named):
            continue
        given = given.assign(**{name: given.index.get_level_values(name)})
    return dict(given.items())


class Table(Saved):
    """Rows of a kind of data, frozen: one read-only array a column, of equal length.

    Made from a mapping (a dict, a pandas DataFrame), from keywords, or from both. Columns that the
    kind of data does not know are kept: numbers where all of them are finite, text otherwise.
    A column is an attribute, or ``table["x_mm"]``. Rows are chosen by slice, boolean mask, index
    array or number, which gives the same type, not checked again; they keep the line of the file
    that they were read from (`place`). Two tables are equal when they have the same columns with
    the same contents.

    Raises
    ------
    InputError
        If a column is missing, of another length, or holds what it must not; the message names
        column and row (from 0).
    """

    kinds: ClassVar[Mapping[str, Column[Any]]] = {}
    choice: ClassVar[str] = ""  # columns of which a table needs some, in words
    in_order: ClassVar[bool] = True  # rows stand in the order of measurement
    slight_moves: ClassVar[bool] = False  # positions may differ by fractions of a millimetre
    smallest_mm: ClassVar[float] = 1.0  # largest position, below which it is in another unit
    vector: ClassVar[tuple[str, ...]] = ()  # readings that an instrument turned by 180° has by -1
    clock: ClassVar[str] = ""  # column of what each has its own time from zero
    __slots__ = ("_began", "_columns", "_origin")

    _columns: Mapping[str, NDArray[Any]]
    _origin: Origin | None
    _began: datetime | None

    def __init_subclass__(cls) -> None:
        own = (value for value in vars(cls).values() if isinstance(value, Column))
        cls.kinds = {**cls.kinds, **{column.name: column for column in own}}

    def __init__(self, columns: ColumnMapping | None = None, /, **more: ArrayLike | None) -> None:
        given = {} if columns is None else named_columns(columns)
        more = {self._column_name(name): values for name, values in more.items()}
        for name in more:
            if name in given:
                raise InputError(f"{name}: got the column twice, expected it once")
        given |= {name: values for name, values in more.items() if values is not None}
        try:
            self._fill(given)
        except ColumnError as fault:
            raise InputError(str(fault)) from None

    @classmethod
    def of_columns(cls, data: Self | ColumnMapping, what: str = "data") -> Self:
        """Return a table of the kind as it is, or one made of a DataFrame, a Dataset or a dict.

        what: Name of the argument, for messages.
        """
        if isinstance(data, cls):
            return data
        if isinstance(data, Table) or not hasattr(data, "items"):
            raise InputError(
                f"{what}: got {shown(data)}, expected {with_article(cls)}, or a DataFrame, a "
                "Dataset or a dict with its columns"
            )
        return cls(data)

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
        object.__setattr__(self, "_origin", None)
        stamps = raw_array(given[TIME], TIME)[:1].tolist() if TIME in made else []
        object.__setattr__(self, "_began", first_stamp(stamps))
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
    def _of(
        cls,
        columns: Mapping[str, NDArray[Any]],
        origin: Origin | None = None,
        began: datetime | None = None,
    ) -> Self:
        """Make a table of columns that were checked before, as they are."""
        table = cls.__new__(cls)
        for values in columns.values():
            values.flags.writeable = False
        object.__setattr__(table, "_columns", MappingProxyType(dict(columns)))
        object.__setattr__(table, "_origin", origin)
        object.__setattr__(table, "_began", began)
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
        return " and ".join(filter(None, (", ".join(cls.required()), cls.choice)))

    # --- frozen, picklable, compared by contents

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{type(self).__name__} is frozen: make another one")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"{type(self).__name__} is frozen: make another one")

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), dict(self._columns), self._origin, self._began)

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        mine, theirs = self.columns, other.columns
        return mine.keys() == theirs.keys() and all(
            np.array_equal(mine[name], theirs[name]) for name in mine
        )

    def __hash__(self) -> int:
        """Hash of what is cheap to hash: kind, names of the columns, count of rows."""
        return hash((type(self), frozenset(self._columns), len(self)))

    # --- where the rows are from

    @property
    def origin(self) -> Origin | None:
        """File and line of each row; None for a table that was not read from a file."""
        return self._origin

    @property
    def recognised(self) -> "Recognised | None":
        """What the file was taken for; None for a table that was not read from one file."""
        known = () if self._origin is None else self._origin.recognised
        return known[0] if len(known) == 1 else None

    def read_from(
        self,
        file: str,
        lines: ArrayLike,
        recognised: "Recognised | None" = None,
        touches: ArrayLike | None = None,
    ) -> Self:
        """Return the table with its origin: a file and the line (from 1) of each row in it.

        touches: Number (from 1) of each row in the plan that a log is of.
        """
        line = np.asarray(lines, dtype=np.intp)
        if line.shape != (len(self),):
            raise InputError(f"lines: got {line.size}, expected one a row, {len(self)}")
        touch = None if touches is None else np.asarray(touches, dtype=np.intp)
        return self._of(self._columns, Origin.of(file, line, recognised, touch), self._began)

    @property
    def began(self) -> datetime | None:
        """Date and time at 0 of `time_s`; None where times were no dates."""
        return self._began

    def place(self, row: int) -> str:
        """Return where people find a row: "line 59 of touches.csv"; else "row 57" (from 0)."""
        return places(self, [row]).removesuffix(FROM_0)

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

    @property
    def readings(self) -> Mapping[str, NDArray[Any]]:
        """The columns that were observed, by name; in a plan of touches what is expected there."""
        return self._declared("observed")

    @property
    def set_positions(self) -> Mapping[str, NDArray[Any]]:
        """The columns with commanded, nominal or target positions, by name."""
        return self._declared("commanded")

    def _declared(self, role: str) -> Mapping[str, NDArray[Any]]:
        names = (name for name, kind in self.kinds.items() if getattr(kind, role))
        return MappingProxyType({n: self._columns[n] for n in names if n in self._columns})

    def __len__(self) -> int:
        return len(next(iter(self._columns.values()), ()))

    @overload
    def __getitem__(self, rows: str) -> NDArray[Any]: ...
    @overload
    def __getitem__(self, rows: Rows) -> Self: ...
    def __getitem__(self, rows: str | Rows) -> Self | NDArray[Any]:
        """Return a column by name, or rows by number, slice, boolean mask or array of numbers."""
        if isinstance(rows, str):
            return self._named(rows)
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
        origin = None if self._origin is None else self._origin[index]
        chosen = {name: values[index] for name, values in self._columns.items()}
        return self._of(chosen, origin, self._began)

    def _named(self, name: str) -> NDArray[Any]:
        if name not in self._columns:
            raise UnknownNameError(
                f"column: got {name!r}, expected one of {', '.join(self._columns)}"
                f"{did_you_mean(name, self._columns)}"
            )
        return self._columns[name]

    def __contains__(self, name: object) -> bool:
        """Whether there is a column of this name."""
        return name in self._columns

    def __iter__(self) -> Iterator[Self]:
        return (self[row] for row in range(len(self)))

    def with_columns(self, **columns: ArrayLike | None) -> Self:
        """Return the table with columns added or replaced; None takes one out."""
        columns = {self._column_name(name): values for name, values in columns.items()}
        kept = {name: values for name, values in self._columns.items() if name not in columns}
        order = {name: kept.get(name, columns.get(name)) for name in (*self._columns, *columns)}
        made = type(self)({name: values for name, values in order.items() if values is not None})
        began = made._began if TIME in columns else self._began
        return self._of(made._columns, self._origin, began) if len(made) == len(self) else made

    def counted_from(self, begin_s: ArrayLike) -> Self:
        """Return the table with times from a moment of its clock, s: one for all rows, or each."""
        columns = {**self._columns, TIME: self._columns[TIME] - np.asarray(begin_s)}
        first = timedelta(seconds=float(np.min(begin_s)))
        return self._of(columns, self._origin, self._began and self._began + first)

    @classmethod
    def concatenate(cls, tables: Iterable[Self]) -> Self:
        """Put tables with the same columns one below the other.

        Times of tables whose dates are all known count from 0 of the first one's clock.
        """
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
        began, begin_s = clocks_apart([part.began for part in parts])
        for name in names:
            columns = [part.columns[name] for part in parts]
            if any(column.dtype.kind == "U" for column in columns):
                columns = [column.astype(np.str_) for column in columns]
            if name == TIME and any(begin_s) and all(c.dtype.kind == "f" for c in columns):
                columns = on_one_clock(columns, begin_s)
            joined[name] = np.concatenate(columns)
        return cls._of(joined, Origin.joined(parts), began)

    # --- out

    def gridded(self) -> Gridded:
        """Return every column over the rows."""
        return Gridded({}, {name: (("row",), values) for name, values in self.columns.items()}, {})

    def sheets(self) -> Mapping[str, Columns]:
        """Return the columns as one table: what a workbook or Parquet holds."""
        return {type(self).__name__: with_dates(self._columns, self._began, TIME)}

    @overload
    def to_csv(self) -> str: ...
    @overload
    def to_csv(self, path: str | PathLike[str] | TextIO) -> None: ...
    def to_csv(self, path: str | PathLike[str] | TextIO | None = None) -> str | None:
        """Write the table to a file, or return it as text; it reads back as an equal table.

        Times that were dates are written as dates, and count from the first row when read.
        A file that is there already is replaced once the new one is whole.
        """
        columns = with_dates(self._columns, self._began, TIME)
        if path is None:
            buffer = io.StringIO()
            write_columns(columns, buffer)
            return buffer.getvalue()
        if not hasattr(path, "write"):
            path = path_of(path)
        if isinstance(path, str | PathLike):
            with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="\n") as file:
                write_columns(columns, file)
        else:
            write_columns(columns, path)
        return None

    def to_dataframe(self) -> "pd.DataFrame":
        """Return a pandas DataFrame with the same columns; pandas is imported here."""
        return dataframe(self._columns)

    def to_pandas(self) -> "pd.DataFrame":
        """Return a pandas DataFrame, as `to_dataframe`."""
        return self.to_dataframe()

    def to_dict(self) -> dict[str, list[Any]]:
        """Return plain lists by column name; a table of the kind is made of it again."""
        return {name: values.tolist() for name, values in self._columns.items()}

    def to_json(self, path: str | PathLike[str] | None = None, *, indent: int | None = None) -> str:
        """Return kind, columns and origin as JSON text, and write it to `path` if one is given."""
        text = json.dumps(self.described(), indent=indent, ensure_ascii=False, allow_nan=False)
        if path is not None:
            write_text(path, text + "\n")
        return text

    def described(self) -> dict[str, Any]:
        """Return everything, with the kind of data by name."""
        made: dict[str, Any] = {"data": type(self).__name__, "columns": self.to_dict()}
        if self._origin is not None:
            made["origin"] = plain(self._origin)
        if self._began is not None:
            made["began"] = self._began.isoformat()
        return made

    @classmethod
    def from_description(cls, values: Any) -> Self:
        """Return the table that `described` described."""
        if not isinstance(values, Mapping) or values.get("data") != cls.__name__:
            got = values.get("data") if isinstance(values, Mapping) else type(values).__name__
            raise InputError(f"data: got {got!r}, expected {cls.__name__!r}")
        with fitting(cls.__name__):
            made = cls(values.get("columns", {}))
            origin, began = values.get("origin"), first_stamp([values.get("began")])
            known = None if origin is None else Origin.from_dict(origin, len(made))
            return cls._of(made._columns, known, began)

    @classmethod
    def from_json(cls, source: str | PathLike[str]) -> Self:
        """Return the table written by `to_json`: from JSON text, or from a file.

        Raises
        ------
        FileFormatError
            The file or text is not JSON of this kind of data.
        """
        values, where = read_json(source)
        try:
            return cls.from_description(values)
        except TrunnionError as error:
            raise FileFormatError(f"{where}: {error}") from error

    def __repr__(self) -> str:
        count = len(self)
        return (
            f"{type(self).__name__}({count} row{'' if count == 1 else 's'}: "
            f"{', '.join(self._columns)})"
        )

    def _repr_html_(self) -> str:
        return html_table(type(self).__name__, self._columns, len(self))


def _restored(
    kind: type[Table],
    columns: Mapping[str, NDArray[Any]],
    origin: Origin | None = None,
    began: datetime | None = None,
) -> Table:
    """Unpickle a table."""
    return kind._of(columns, origin, began)
