"""Reports: tables of numbers, and the base class of every public result.

A result holds data (numbers, texts, arrays, mappings, other results), never a model. A class says
what it has to say in `sentences` and `tables`; text, HTML, JSON, data frames, comparison and
pickling follow from the fields and are written here, once.
"""

from __future__ import annotations

import html
import importlib
import io
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeAlias, TypeVar

import numpy as np

from trunnion.base.errors import FileFormatError, InputError, TrunnionError
from trunnion.base.output import write_text
from trunnion.base.read_files import as_read
from trunnion.base.record import Record, hold_files, hold_record, record_of
from trunnion.base.saved import Columns, Saved, dataframe
from trunnion.base.stored import fitting, plain, read_json, structured

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table as RichTable

C = TypeVar("C")

SHOWN = 1e-3
"""µm and arcsec: less is no number for people."""
ROUNDING = 1e-9
"""A value without uncertainty below this is what rounding of the computer leaves of 0."""
MAX_DECIMALS = 9
LONG = 1e9
"""From here on a number is shorter with an exponent, and of no ordinary size."""
MAX_NAME_WIDTH = 44  # of a first column that does not wrap

Cell: TypeAlias = str | float | int | bool | None
"""What stands in a cell: text, a number (formatted when shown), or nothing."""


def number(value: float | None, digits: int = 4) -> str:
    """Return a number as text: fixed decimals, "–" for nothing, infinity as "not identifiable"."""
    if value is None:
        return "–"
    if value == float("inf"):
        return "not identifiable"
    text = f"{value:.{digits}f}"
    return text.replace("-", "−") if float(text) != 0 else f"{0:.{digits}f}"


def rough(value: float, digits: int = 2, *, signed: bool = False) -> str:
    """Return a number to so many digits as people write it: 0.012, −1.6, 270, 56200.

    signed: With + before what is above 0.
    """
    text = f"{value:.{digits}g}"
    short = f"{float(text):.0f}" if "e+" in text and abs(value) < LONG else text
    plus = "+" if signed and value > 0 else ""
    return plus + (short if "e-" in short else short.replace("-", "−"))


def left_text(size: float) -> str:
    """Return an error that is left, µm or arcsec, as text: rounding of the computer is none."""
    return f"less than {SHOWN:g}" if size < SHOWN else rough(size, 3)


class Shown(float):
    """A number of a table that is shown as a text of its own: "4.82", "< 0.001"."""

    text: str

    def __new__(cls, value: float, text: str) -> Self:
        """Return the number with its text."""
        made = super().__new__(cls, value)
        made.text = text
        return made


def significant(value: float, digits: int = 3) -> Shown:
    """Return a number shown to so many digits."""
    return Shown(value, rough(value, digits))


def position(value: float) -> Shown:
    """Return a nominal number (a target, a place) shown without zeros at its end."""
    return Shown(value, f"{value:.10g}".replace("-", "−"))


def measured(value: float, std: float | None) -> tuple[Cell, Cell]:
    """Return a value and its standard error: two significant digits of this, both to its place.

    So the GUM has it (7.2.6); every value with its uncertainty is shown by this function.
    """
    if std is None or std <= 0:
        return significant(0.0 if std is not None and abs(value) < ROUNDING else value, 4), std
    if not np.isfinite(std):
        return Shown(value, "–"), std
    rounded = float(f"{std:.1e}")  # 0.0996 is 0.10: rounding may add a place
    digits = min(1 - int(np.floor(np.log10(rounded))), MAX_DECIMALS)
    shown, error = (Shown(x, number(round(x, digits), max(digits, 0))) for x in (value, std))
    return shown, error


def uncertainty(std: float) -> str:
    """Say a standard error or an expanded uncertainty alone: two significant digits."""
    return plus_minus(std, std).partition(" ")[0]


def plus_minus(value: float, std: float | None) -> str:
    """Say a value with its standard error: ``4.82 ± 0.31``."""
    if std is None or std <= 0:
        return significant(value).text
    if not np.isfinite(std):
        return number(std)
    return " ± ".join(x.text for x in measured(value, std) if isinstance(x, Shown))


def cell_text(cell: Cell, digits: int = 4) -> str:
    """Return a cell as text, a number without a text of its own to so many decimals."""
    if isinstance(cell, str):
        return cell
    if isinstance(cell, Shown):
        return cell.text
    if isinstance(cell, bool | np.bool_):
        return "yes" if cell else "no"
    if isinstance(cell, int | np.integer):
        return str(cell).replace("-", "−")
    return number(None if cell is None else float(cell), digits)


@dataclass(frozen=True)
class Table:
    """A titled table; the first column is text, the others are numbers or text.

    Attributes
    ----------
    title
        What it shows, with units where all columns share them.
    columns
        Headings.
    rows
        Cells, one row each; numbers stay numbers until they are shown.
    digits
        Decimals of numbers.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    digits: int = 4

    @classmethod
    def of(
        cls, title: str, columns: Sequence[str], rows: Sequence[Sequence[Cell]], *, digits: int = 4
    ) -> Table:
        """Return a table from any sequences."""
        return cls(title, tuple(columns), tuple(tuple(row) for row in rows), digits)

    def cells(self) -> tuple[tuple[str, ...], ...]:
        """Return every cell as text."""
        return tuple(tuple(cell_text(cell, self.digits) for cell in row) for row in self.rows)

    def to_rich(self) -> RichTable:
        """Return it for a rich console, without its title, which rich breaks at its width.

        Cells and headings are shown as they are: a name may have brackets or colons in it.
        """
        from rich import box
        from rich.table import Table as RichTable
        from rich.text import Text

        table = RichTable(box=box.SIMPLE_HEAD)
        cells = self.cells()
        for index, column in enumerate(self.columns):
            if index:
                table.add_column(Text(column), justify="right")
                continue
            # Names stay whole on a narrow terminal: the numbers beside them wrap.
            short = max((len(row[0]) for row in cells), default=0) <= MAX_NAME_WIDTH
            width = None if short else MAX_NAME_WIDTH
            table.add_column(Text(column), no_wrap=short, max_width=width)
        for row in cells:
            table.add_row(*map(Text, row))
        return table

    def text(self, width: int = 110) -> str:
        """Return it as plain text."""
        from rich.console import Console

        buffer = io.StringIO()
        # In a notebook rich would display the table there and then, and leave the text empty.
        console = Console(
            file=buffer, width=width, color_system=None, highlight=False, force_jupyter=False
        )
        console.print(self.to_rich())
        lines = [self.title, *buffer.getvalue().splitlines()]
        return "\n".join(line.rstrip() for line in lines)

    def html(self) -> str:
        """Return it as an HTML table."""

        def cells(tag: str, row: Sequence[str]) -> str:
            style = ' style="text-align:right"'
            return "".join(
                f"<{tag}{style if index else ''}>{html.escape(cell)}</{tag}>"
                for index, cell in enumerate(row)
            )

        body = "".join(f"<tr>{cells('td', row)}</tr>" for row in self.cells())
        return (
            f"<table><caption>{html.escape(self.title)}</caption>"
            f"<thead><tr>{cells('th', self.columns)}</tr></thead><tbody>{body}</tbody></table>"
        )

    def to_columns(self) -> Columns:
        """Return cells by heading, numbers as numbers; a heading that comes again is numbered."""
        found: dict[str, list[Cell]] = {}
        for j, column in enumerate(self.columns):
            name = column or "name"
            again = sum(each == column for each in self.columns[:j])
            cells = (row[j] for row in self.rows)
            found[f"{name} ({again + 1})" if again else name] = [
                float(cell) if isinstance(cell, Shown) else cell for cell in cells
            ]
        return found

    def to_dataframe(self) -> pd.DataFrame:
        """Return it as a pandas DataFrame, numbers as numbers; pandas is imported here."""
        return dataframe(self.to_columns())


def same(first: Any, second: Any) -> bool:
    """Whether two values are equal, arrays and nan included."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        a, b = np.asarray(first), np.asarray(second)
        numeric = a.dtype.kind in "fc" and b.dtype.kind in "fc"
        return a.dtype == b.dtype and bool(np.array_equal(a, b, equal_nan=numeric))
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(same(first[k], second[k]) for k in first)
    if isinstance(first, list | tuple) and isinstance(second, list | tuple):
        return (
            type(first) is type(second)
            and len(first) == len(second)
            and all(same(a, b) for a, b in zip(first, second, strict=True))
        )
    if isinstance(first, float) and isinstance(second, float):
        return first == second or (np.isnan(first) and np.isnan(second))
    if is_dataclass(first) and type(first) is type(second) and not isinstance(first, Result | type):
        return _same_fields(first, second)
    return bool(first == second)


def _same_fields(first: Any, second: Any) -> bool:
    """Whether two of one dataclass are equal in every field that counts."""
    names = [field.name for field in fields(first) if field.compare]
    return all(same(getattr(first, name), getattr(second, name)) for name in names)


def class_named(name: str, base: type[C]) -> type[C]:
    """Return the public subclass of this name, or one that is loaded.

    Raises
    ------
    InputError
        There is none.
    """
    public = getattr(importlib.import_module("trunnion"), name, None)
    if isinstance(public, type) and issubclass(public, base):
        return public
    left = [base]
    while left:
        for kind in left.pop().__subclasses__():
            if kind.__name__ == name:
                return kind
            left.append(kind)
    raise InputError(f"{base.__name__}: got {name!r}, expected the name of one")


@dataclass(frozen=True, eq=False, repr=False)
class Result(Saved):
    """Base of every public result.

    A subclass is a frozen dataclass (``@dataclass(frozen=True, eq=False, repr=False)``) of data.
    It gives `sentences` and `tables`; the rest follows. `to_dict` holds every field and, as
    `"result"`, the name of the class; a field with ``compare=False`` is code (a function, a model):
    it is neither compared nor stored. What a class derives from its fields and a reader of the
    JSON wants, it adds by overriding `derived`.
    """

    def sentences(self) -> Sequence[str]:
        """Return what is worth saying, most important first."""
        return ()

    def tables(self) -> tuple[Table, ...]:
        """Return the tables, most important first."""
        return ()

    def table(self) -> Table:
        """Return the first table."""
        tables = self.tables()
        return tables[0] if tables else Table(type(self).__name__, ("",), ())

    def derived(self) -> Mapping[str, Any]:
        """Return what `to_dict` holds beside the fields; ignored by `from_dict`."""
        return {}

    def summary(self) -> str:
        """Return sentences and tables as text, what is most important first."""
        return "\n".join([*self.sentences(), *(table.text() for table in self.tables())])

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain Python values; numbers that are not finite as text ("inf")."""
        found = {f.name: plain(getattr(self, f.name)) for f in fields(self) if f.compare}
        return {
            "result": type(self).__name__,
            **found,
            **{key: plain(value) for key, value in self.derived().items()},
        }

    def to_json(self, path: str | PathLike[str] | None = None, *, indent: int | None = None) -> str:
        """Return `to_dict` as JSON text, and write it to `path` where one is given.

        The key `"record"` holds the version of the software, the call or command, the date, and
        the input files with their SHA-256; `from_json` brings it back.
        """
        values = {**self.to_dict(), "record": plain(record_of(self))}
        text = json.dumps(values, indent=indent, ensure_ascii=False, allow_nan=False)
        if path is not None:
            write_text(path, text + "\n")
        return text

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Return the result that `to_dict` described.

        Raises
        ------
        InputError
            The values are not those of this class.
        """
        kind = values.get("result", cls.__name__) if isinstance(values, Mapping) else None
        if kind != cls.__name__:
            raise InputError(f"result: got {kind!r}, expected {cls.__name__!r}")
        return structured(dict(values), cls)

    @classmethod
    def from_json(cls, source: str | PathLike[str]) -> Self:
        """Return the result written by `to_json`: from JSON text, or from a file.

        Raises
        ------
        FileFormatError
            The file or text is not JSON of this result; the message names the place.
        """
        values, where = read_json(source)
        try:
            with fitting(cls.__name__), np.errstate(over="raise", invalid="raise"):
                found = cls.from_dict(values)
                # Arrays that do not fit each other, and no covariances, are found here.
                found.summary()
                if (read := as_read(where, "input")) and where != "JSON":
                    hold_files(found, [read])
                if "record" in values:  # an older version wrote none
                    hold_record(found, structured(values["record"], Record))
                return found
        except TrunnionError as error:
            raise FileFormatError(f"{where}: {error}") from error

    def to_columns(self) -> Columns:
        """Return the main table by column: what `to_dataframe`, CSV and Parquet hold."""
        return self.table().to_columns()

    def sheets(self) -> Mapping[str, Columns]:
        """Return the main table, then the others, by title: what a workbook holds."""
        others = {table.title: table.to_columns() for table in self.tables()[1:]}
        return {self.table().title: self.to_columns(), **others}

    def to_dataframe(self) -> pd.DataFrame:
        """Return the main table as a pandas DataFrame, numbers as numbers."""
        return dataframe(self.to_columns())

    def title(self) -> str:
        """Return the heading of its page: the name of its class in words, unless it has its own."""
        words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", type(self).__name__)
        return words[:1] + words[1:].lower()

    def to_html(
        self,
        path: str | PathLike[str],
        *,
        data: Any = None,
        setup: Any = None,
        tolerance: Mapping[str, float] | None = None,
        made_by: str = "",
    ) -> Path:
        """Write the measurement report: one page that needs no network and prints on A4.

        Parameters
        ----------
        path
            Of the page.
        data, setup
            What the result was made of, for the record at its end (machine, operator, date, files
            with checksums) and the old values; by default what the result holds itself. Paths
            among `data` are of other files it was made of: an estimate, a part program.
        tolerance
            Largest size allowed, by name, for pass, fail or undecided (ISO 14253-1); by default
            the set-up's ``[machine.tolerance]``.
        made_by
            What made the result, for the record; by default the command that runs, or the call.

        Returns
        -------
        Path
            The page.
        """
        reports = importlib.import_module("trunnion.reports")
        more = {"data": data, "setup": setup, "tolerance": tolerance, "made_by": made_by}
        written: Path = reports.write(self, path, **more)
        return written

    def __eq__(self, other: object) -> bool:
        """Whether it is the same class with equal fields."""
        if type(other) is not type(self):
            return NotImplemented
        return _same_fields(self, other)

    def __hash__(self) -> int:
        """Hash of what is cheap to hash: class, texts and whole numbers."""
        values = (getattr(self, field.name) for field in fields(self) if field.compare)
        return hash((type(self), *(v for v in values if isinstance(v, str | int | bool))))

    def headline(self) -> str:
        """Return the one thing to know; shown by ``repr``."""
        return next(iter(self.sentences()), "")

    def __repr__(self) -> str:
        """Class and headline."""
        return f"<{type(self).__name__}: {self.headline()}>"

    def __str__(self) -> str:
        """Return the summary."""
        return self.summary()

    def _repr_html_(self) -> str:
        lines = "".join(f"<p>{html.escape(line)}</p>" for line in self.sentences())
        picture: str = importlib.import_module("trunnion.plot").thumbnail(self)
        return lines + picture + "".join(table.html() for table in self.tables())
