"""Results and data as files of others: CSV, JSON, workbooks (xlsx), Parquet, netCDF, HTML.

What there is to write says so in `sheets` (tables) and `gridded` (arrays over axes); the ending of
the file's name says as what.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from trunnion.base.checks import optional_module
from trunnion.base.errors import InputError
from trunnion.base.input import path_of
from trunnion.base.output import check_among, whole_file

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Columns: TypeAlias = Mapping[str, Sequence[Any] | NDArray[Any]]
"""Names of columns with their values, all of one length."""

MAX_SHEET_NAME = 31
MAX_SHEET_ROWS = 1_048_576  # of Excel, with the header


def dataframe(columns: Columns) -> pd.DataFrame:
    """Return columns as a pandas DataFrame; pandas is imported here.

    Raises ImportError: it is not installed.
    """
    made: pd.DataFrame = optional_module("pandas", "a DataFrame", "pandas").DataFrame(dict(columns))
    return made


@dataclass(frozen=True)
class Gridded:
    """Arrays over named axes.

    axes: Name → nodes, numbers or texts; a name ends in its unit (``x_mm``).
    arrays: Name → names of its axes and values; a name ends in its unit.
    attributes: What holds for all of it: numbers and texts.
    """

    axes: Mapping[str, Any]
    arrays: Mapping[str, tuple[tuple[str, ...], NDArray[Any]]]
    attributes: Mapping[str, float | str]


class Saved:
    """What can be written to a file by the ending of its name.

    A class whose fields are arrays over axes says so in `GRID`: name of an array → its axes, which
    are names of fields with the nodes, or names alone.
    """

    GRID: ClassVar[Mapping[str, tuple[str, ...]]] = {}

    def sheets(self) -> Mapping[str, Columns]:
        """Return tables by title, the most important one first."""
        raise NotImplementedError

    def gridded(self) -> Gridded | None:
        """Return arrays over axes, where this has some; by default those of `GRID`."""
        names = {axis: None for axes in self.GRID.values() for axis in axes}
        nodes = {axis: getattr(self, axis) for axis in names if hasattr(self, axis)}
        arrays = {n: (axes, np.asarray(getattr(self, n))) for n, axes in self.GRID.items()}
        return Gridded(nodes, arrays, {}) if arrays else None

    def plot(self, **options: Any) -> Any:
        """Draw it (see :mod:`trunnion.plot`); return the matplotlib axes, or figure, drawn on."""
        return import_module("trunnion.plot").draw(self, **options)

    def scene(self, *context: Any, **options: Any) -> Any:
        """Return its view in space as a Plotly figure (see :func:`trunnion.plot.scene`)."""
        return import_module("trunnion.plot").scene(self, *context, **options)

    def to_xarray(self) -> xr.Dataset:
        """Return what is on a grid as an xarray Dataset with units; xarray is imported here.

        Raises
        ------
        InputError
            Nothing of it is on a grid.
        ImportError
            xarray is not installed (``pip install 'trunnion[sweep]'``).
        """
        grid = self.gridded()
        if grid is None:
            raise InputError(
                f"{type(self).__name__}: nothing of it is on a grid; expected a result on one, or "
                "to_dataframe"
            )
        found: xr.Dataset = optional_module("xarray", "gridded results", "sweep").Dataset(
            {name: (axes, values, _units(name)) for name, (axes, values) in grid.arrays.items()},
            {name: (name, np.asarray(nodes), _units(name)) for name, nodes in grid.axes.items()},
            {"title": type(self).__name__, **grid.attributes},
        )
        return found

    def save(self, path: str | PathLike[str]) -> Path:
        """Write it to a file, whole or not at all, as the ending of its name says.

        Parameters
        ----------
        path
            ``.json``: everything, to be read back by `from_json`. ``.csv`` and ``.parquet``: the
            first table. ``.xlsx``: every table, a sheet each. ``.nc`` and ``.netcdf``: what is
            on a grid (`to_xarray`). ``.html``: the page of `to_html`.

        Returns
        -------
        pathlib.Path
            The file.

        Raises
        ------
        InputError
            Another ending, or one that this has nothing for.
        ImportError
            What writes the format is not installed: extras ``xlsx``, ``parquet``, ``sweep``.
        """
        target, made = path_of(path), writers(self)
        check_among(target, made)
        with whole_file(target) as draft:
            made[target.suffix.lower()](draft)
        return target


def writers(value: Saved) -> Mapping[str, Callable[[Path], object]]:
    """Return what writes it to a draft, by the ending of the name: those that it has."""
    made: dict[str, Callable[[Path], object]] = {
        ".csv": lambda draft: _write_csv(value, draft),
        ".xlsx": lambda draft: _write_workbook(value.sheets(), draft),
        ".parquet": lambda draft: _write_parquet(_first(value.sheets()), draft),
    }
    if value.gridded() is not None:
        made |= dict.fromkeys(
            (".nc", ".netcdf"), lambda draft: value.to_xarray().to_netcdf(draft, engine="scipy")
        )
    if hasattr(value, "to_json"):
        made[".json"] = lambda draft: value.to_json(draft, indent=2)
    if hasattr(value, "to_html"):
        made[".html"] = lambda draft: value.to_html(draft)
    return made


def _units(name: str) -> dict[str, str]:
    from trunnion.base.units import unit_of

    unit = unit_of(name)
    return {"units": unit} if unit else {}


def _first(sheets: Mapping[str, Columns]) -> Columns:
    return next(iter(sheets.values()), {})


def _rows(columns: Columns) -> list[tuple[Any, ...]]:
    lists = [c.tolist() if isinstance(c, np.ndarray) else list(c) for c in columns.values()]
    return list(zip(*lists, strict=True))


def _write_csv(value: Saved, path: Path) -> None:
    """Write the first table, or what the class itself writes as CSV."""
    if hasattr(value, "to_csv"):
        value.to_csv(path)
        return
    columns = _first(value.sheets())
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(_rows(columns))


def _write_parquet(columns: Columns, path: Path) -> None:
    arrow = optional_module("pyarrow", "Parquet files", "parquet")
    parquet = optional_module("pyarrow.parquet", "Parquet files", "parquet")
    parquet.write_table(arrow.table({name: _even(v) for name, v in columns.items()}), path)


def _even(values: Sequence[Any] | NDArray[Any]) -> Any:
    """Return values of one type: numbers and texts in one column become texts."""
    if isinstance(values, np.ndarray):
        return values.astype(object) if values.dtype.kind == "U" else values
    there = [value for value in values if value is not None]
    if all(isinstance(value, bool) for value in there):
        return list(values)
    if all(isinstance(v, int | float | np.number) and not isinstance(v, bool) for v in there):
        whole = all(isinstance(value, int | np.integer) for value in there)
        kind: type[int | float] = int if whole else float
        return [None if value is None else kind(value) for value in values]
    return [None if value is None else str(value) for value in values]


def _write_workbook(sheets: Mapping[str, Columns], path: Path) -> None:
    openpyxl = optional_module("openpyxl", "xlsx files", "xlsx")
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, columns in sheets.items():
        rows = _rows(columns)
        if len(rows) >= MAX_SHEET_ROWS:
            raise InputError(
                f"{path.name}: got {len(rows)} rows, expected fewer than {MAX_SHEET_ROWS} in a "
                "sheet: .csv and .parquet take any number"
            )
        sheet = book.create_sheet(_sheet_name(title, book.sheetnames))
        sheet.freeze_panes = "A2"
        for i, row in enumerate([tuple(columns), *rows], start=1):
            for j, value in enumerate(row, start=1):
                cell = sheet.cell(i, j)
                cell.value = _cell(value)
                if isinstance(value, str):
                    cell.data_type = "s"  # a text with "=" at its beginning is no formula
                if i == 1:
                    cell.font = openpyxl.styles.Font(bold=True)
    if not book.sheetnames:
        book.create_sheet("empty")
    book.save(path)


def _cell(value: Any) -> Any:
    """Return a value as a cell holds it: Excel has no infinity, and no control characters."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else str(float(value))
    return re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f]", "", value) if isinstance(value, str) else value


def _sheet_name(title: str, taken: Sequence[str]) -> str:
    """Return a title as Excel allows it, each once."""
    name = re.sub(r"[\[\]:*?/\\]", " ", title).strip(" '")[:MAX_SHEET_NAME].strip() or "table"
    known = {each.lower() for each in taken}
    found, count = name, 1
    while found.lower() in known:
        count += 1
        found = f"{name[: MAX_SHEET_NAME - 5]} ({count})"
    return found
