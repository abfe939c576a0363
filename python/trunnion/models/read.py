"""`read`: measured data of any kind from a file of any format that is known."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, positive
from trunnion.base.errors import FileFormatError, InputError, TrunnionError
from trunnion.base.units import conversion, unit_of
from trunnion.data.linuxcnc_log import refuse_probe_log
from trunnion.files.columns import (
    ColumnError,
    is_numeric,
    parse_number,
    scaled,
    shown_field,
)
from trunnion.files.csv_file import Options, options_in_force, read_table
from trunnion.files.delimited import Delimited
from trunnion.files.foreign import FORMATS, Channels
from trunnion.files.recognised import Recognised
from trunnion.files.table import Table
from trunnion.files.text import Source
from trunnion.models.kinds import Kind, kind_of_columns

Given: TypeAlias = str | tuple[str, str | float] | float | ArrayLike
"""What a column is made of: a channel, a channel with its unit (or a factor), or values."""

MAX_TITLE_LINES = 20
"""Lines above a header among which it is looked for, for the message."""


@checked
def read(
    data: Any,
    *,
    columns: Mapping[str, Any] | None = None,
    kind: str | None = None,
    units: str = "mm",
    separator: str | None = None,
    decimal: str | None = None,
    sheet: str | None = None,
    period_s: float | None = None,
) -> Any:
    """Read measured data, whatever their kind and the format of their file.

    What it was taken for is the table's `recognised`. Nothing is guessed: what can be read in two
    ways is refused, and the message names the argument that decides. docs/reference/files.md
    lists the formats.

    Parameters
    ----------
    data
        A file, a pandas DataFrame, or arrays by name.
    columns
        Where the names are not those of a kind of data: column → channel of the file
        (``{"x_cmd_mm": "Ref"}``), in the unit of the column's name; with its unit or a factor
        (``("Ref", "m")``, ``"Ref [m]"``, ``("Ref", 0.001)``); or the values themselves, one number
        for all rows or one each. Where these are given, other columns of the file are left out
        unless the kind of data knows them by name.
    kind
        Kind of data ("touches", "points", "axislog", ...), where the columns do not say.
    units
        Unit of the file's lengths: "mm" or "inch".
    separator, decimal
        Marks of a CSV file, where they cannot be found: ``","``, ``";"`` or a tab; ``"."`` or
        ``","``.
    sheet
        Sheet of a workbook (xlsx).
    period_s
        Time between two samples, where the file does not say.

    Returns
    -------
    Touches, Points, Sweep, Diameters, Ballbar, Positioning, AxisLog, ...
        The class of the kind.

    Raises
    ------
    FileFormatError
        The file is of no format that is known, or not as its format says; with file, line, column.
    UnknownNameError
        A channel, kind or unit that there is not.
    InputError
        Columns of no kind, or of several; a period that is not above 0.

    Examples
    --------
    >>> import trunnion as tn
    >>> log = tn.read({"t": [0.0, 1.0], "Ref": [0.0, 0.001], "Enc": [0.0, 0.001]},
    ...               columns={"time_s": "t", "x_cmd_mm": ("Ref", "m"), "x_act_mm": "Enc [m]"})
    >>> log
    AxisLog(2 rows: time_s, x_cmd_mm, x_act_mm)
    """
    options = options_in_force(Options(separator, decimal, units, sheet))
    if period_s is not None:
        positive("period_s", period_s)
    if not isinstance(data, str | PathLike):
        return _of_arrays(data, columns, kind, options)
    if Path(data).suffix.lower() == ".toml":
        raise InputError(f"{data}: got a set-up (.toml), expected measured data (tn.read_setup)")
    source = Source.of(data, options.sheet)
    refuse_probe_log(source)
    _refuse_stored(source)
    found = next((each for each in FORMATS if each.matches(source)), None)
    if found is None and columns is None:
        return _plain(data, source, kind, options)
    wanted = None if columns is None else [n for g in columns.values() if (n := _name_in(g))]
    channels = (
        _delimited(source, options) if found is None else found.read(source, wanted, period_s)
    )
    if period_s is not None and channels.time_s is None:
        times = period_s * np.arange(len(channels.lines), dtype=np.float64)
        channels = replace(channels, time_s=times, clock=f"period_s = {period_s:g}")
    if columns is not None:
        columns = {t: _number_unless(g, channels.columns) for t, g in columns.items()}
    name = found.NAME if found else "CSV"
    if columns is None:
        raise FileFormatError(
            f"{source.name}:1:1: got {name} with the channels {', '.join(channels.columns)}, "
            "expected columns= that says which column of a kind of data each is: {COLUMN: "
            f'"{next(iter(channels.columns))}", ...}}; as a command: trunnion read '
            f'{source.name} --column "COLUMN={next(iter(channels.columns))}" -o data.csv'
        )
    return _Mapped(name, source, channels, columns, options).table(kind)


def _plain(path: Any, source: Source, kind: str | None, options: Options) -> Table:
    """Return a file whose columns have the names of a kind of data."""
    file = Delimited(source, options)
    found = _kind(file, kind)
    if options == Options():
        return found.read(path)  # type: ignore[no-any-return]
    return read_table(source, resolve_name(found.data), options)  # type: ignore[no-any-return]


def _kind(file: Delimited, kind: str | None) -> Kind:
    if kind is not None:
        return kind_of_columns(file.header, kind)
    try:
        return kind_of_columns([column for column in file.header if column])
    except InputError as error:
        raise file.error(file.header_line, 0, _title(file) or str(error)) from None


def _title(file: Delimited) -> str:
    """Say that names of columns stand in a later line; empty where they do not."""
    for line in file.data_lines[:MAX_TITLE_LINES]:
        with suppress(TrunnionError):
            kind = kind_of_columns(Delimited(file.source, first=line).header)
            first = shown_field(file.lines[file.header_line].strip(" ,;\t"))
            return (
                f"got {first}, expected names of columns; line {line + 1} has those of "
                f"{kind.name}: delete the lines above it, or begin them with #"
            )
    return ""


def _delimited(source: Source, options: Options) -> Channels:
    """Return the columns of a file with a header of any names."""
    file = Delimited(source, options)
    columns = file.columns()
    return Channels(
        columns,
        [i + 1 for i in file.data_lines],
        separator=file.separator,
        decimal=file.decimal,
        notes=tuple(file.notes),
    )


def _of_arrays(
    data: Any, columns: Mapping[str, Any] | None, kind: str | None, options: Options
) -> Table:
    """Return arrays by name as data of a kind."""
    if not hasattr(data, "items"):
        raise InputError(
            f"data: got {type(data).__name__}, expected a file, a DataFrame or arrays by name"
        )
    given = {str(name): np.asarray(values) for name, values in data.items()}
    length = len(next(iter(given.values()), ()))
    channels = Channels(given, range(1, length + 1))
    mapping = {n: n for n in given} if columns is None else columns
    return _Mapped(type(data).__name__, None, channels, mapping, options).table(kind)


@dataclass
class _Mapped:
    """Channels on their way to a table.

    format: What the channels were read as.
    source: Their file; None: arrays.
    """

    format: str
    source: Source | None
    channels: Channels
    columns: Mapping[str, Any]
    options: Options
    units: dict[str, str] = field(default_factory=dict)

    def table(self, name: str | None) -> Table:
        """Return the table of its kind, with what was recognised."""
        for target, given in self.columns.items():
            self._channel(target, given)
        known = [n for n in self.channels.columns if n not in self.columns]
        times = self.channels.time_s
        time = [] if times is None else ["time_s"]
        try:
            kind = kind_of_columns([*self.columns, *known, *time], name)
        except InputError as error:
            if self.source is None:
                raise
            why = self._no_clock if "time_s" in str(error) else ""
            raise FileFormatError(f"{self.source.name}:1:1: {error}{why}") from None
        made: type[Table] = resolve_name(kind.data)
        given = {**{n: n for n in known if n in made.kinds}, **self.columns}
        columns = {target: self._values(made, target, g) for target, g in given.items()}
        clock = ""
        if "time_s" in made.kinds and "time_s" not in columns and times is not None:
            columns["time_s"] = times
            clock = self.channels.clock
        try:
            found = made.checked(columns)
        except ColumnError as fault:
            raise self._located(fault) from None
        source = self.source
        recognised = Recognised(
            format=self.format,
            kind=made.__name__,
            encoding=source.encoding if source else "arrays",
            separator=self.channels.separator,
            decimal=self.channels.decimal,
            columns={t: _said(g) for t, g in given.items() if not (isinstance(g, str) and g == t)},
            units=self.units,
            clock=clock,
            notes=self.channels.notes,
        )
        if source is None:
            return found
        return found.read_from(source.name, self.channels.lines, recognised)

    def _values(self, made: type[Table], target: str, given: Any) -> NDArray[Any]:
        """Return the values of a column, in its unit."""
        name = self._channel(target, given)
        if name is None:
            values = np.asarray(given)
            rows = len(self.channels.lines)
            return np.full(rows, values) if values.ndim == 0 else values
        values = self.channels.columns[name]
        if target in made.kinds and not is_numeric(made.kinds[target]):
            return values
        factor = self._factor(target, name, given)
        try:
            return values if factor == 1.0 else scaled(target, values, factor)
        except ColumnError as fault:
            raise self._located(fault) from None

    def _channel(self, target: str, given: Any) -> str | None:
        """Return the channel that a column is made of, which must be there; None: values."""
        name = _name_in(given, self.channels.columns)
        if name is None or name in self.channels.columns:
            return name
        where = "" if self.source is None else f"{self.source.name}:1:1: "
        if target in self.channels.columns:
            raise InputError(
                f"{where}columns: got {target!r} made of {name!r}, expected the column's name "
                f"first, then the channel's: {name}={target}"
            )
        return choose(f"{where}columns[{target!r}]", name, self.channels.columns)

    def _factor(self, target: str, name: str, given: Any) -> float:
        """Return what takes a channel to the unit of its column, and note it."""
        wanted = unit_of(target)
        unit = given[1] if isinstance(given, tuple) else None
        if isinstance(given, str) and given != name:
            unit = given.removeprefix(name).strip(" []")
        elif isinstance(given, str) and name.endswith("]"):  # a header that states its unit
            stated = name[name.rfind("[") + 1 : -1]
            unit = stated if conversion(stated, wanted) is not None else None
        if isinstance(unit, int | float):
            self.units[target] = f"{name} × {unit:g}"
            return float(unit)
        unit = unit or self.channels.units.get(name) or _unit_in(name, wanted)
        if unit is None and self.options.units == "inch" and wanted in ("mm", "mm/min"):
            unit = "inch" if wanted == "mm" else "inch/min"
        if unit is None or not wanted:
            if wanted and name != target:
                self.units[target] = f"taken as {wanted}"
            return 1.0
        factor = conversion(unit, wanted)
        if factor is None:
            where = "" if self.source is None else f"{self.source.name}:1:1: "
            raise InputError(
                f"{where}columns[{target!r}]: got {name!r} in {unit!r}, expected a unit that goes "
                f"into {wanted} (or a factor)"
            )
        if factor != 1.0:
            self.units[target] = f"{unit} → {wanted}"
        return factor

    def _located(self, fault: ColumnError) -> Exception:
        """Return the error of the file, or of the arrays."""
        if self.source is None:
            return InputError(str(fault))
        line = 1 if fault.row is None else self.channels.lines[fault.row]
        why = self._no_clock if fault.column == "time_s" and fault.row is None else ""
        return FileFormatError(f"{self.source.name}:{line}:1: {fault.said}{why}")

    @property
    def _no_clock(self) -> str:
        """What to say where times may be missing."""
        if self.channels.time_s is not None or "time_s" in {*self.columns, *self.channels.columns}:
            return ""
        return " (no times were found: period_s= gives the time between two samples)"


def _unit_in(name: str, wanted: str) -> str | None:
    """Return the unit in which the name of a channel ends, if it goes into the wanted one."""
    unit = unit_of(name)
    return unit if unit and conversion(unit, wanted) is not None else None


def _number_unless(given: Any, there: Mapping[str, Any]) -> Any:
    """Return the number that a text is, unless there is a channel of this name."""
    if not isinstance(given, str) or given in there:
        return given
    value = parse_number(given)
    return given if value is None else int(value) if value.is_integer() else value


def _name_in(given: Any, there: Mapping[str, Any] | None = None) -> str | None:
    """Return the channel that a column is made of; None: it is made of values.

    there: The channels; without them a text "NAME [unit]" is NAME.
    """
    if isinstance(given, tuple) and len(given) == 2 and isinstance(given[0], str):
        return str(given[0])
    if not isinstance(given, str):
        return None
    if (there is None or given not in there) and given.endswith("]") and "[" in given:
        short = given[: given.rindex("[")].strip()
        return short if there is None or short in there else given
    return given


def _said(given: Any) -> str:
    """Return what a column was made of, in words."""
    if isinstance(given, str):
        return given
    if isinstance(given, tuple) and len(given) == 2 and isinstance(given[0], str):
        return given[0]
    values = np.asarray(given)
    return f"{values.item()!r} in every row" if values.ndim == 0 else "values of the call"


def _refuse_stored(source: Source) -> None:
    """Raise FileFormatError for JSON of a result or of data, which other readers bring back."""
    if not source.lines or not source.lines[0].lstrip().startswith("{"):
        return
    try:
        values = json.loads("\n".join(source.lines))
    except (ValueError, RecursionError):
        return  # what it is then is said by the reader of columns
    kind = str(values.get("result") or values.get("data") or "")
    if not kind.isidentifier():
        return
    what = "a stored result" if "result" in values else "stored data"
    page = ', its method to_html("report.html") writes the report' if "result" in values else ""
    raise source.error(
        0,
        0,
        f"got {what} ({kind}), expected measured data: "
        f'trunnion.{kind}.from_json("{source.name}") brings it back{page}',
    )
