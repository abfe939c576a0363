"""Sheets of a workbook (xlsx) and Parquet files as lines of CSV.

The line of a row is its number in the sheet; of a Parquet file it is that of a CSV file of it.
"""

from __future__ import annotations

import io
from typing import Any

from trunnion.base.checks import optional_module
from trunnion.base.errors import FileFormatError


def sheet_lines(name: str, raw: bytes, sheet: str | None) -> tuple[list[str], str]:
    """Return the lines of a sheet and what to say of it.

    Raises
    ------
    FileFormatError
        No workbook, no sheet of this name, several sheets with data and none named, or openpyxl is
        not installed (``pip install 'trunnion[xlsx]'``).
    """
    try:
        openpyxl = optional_module("openpyxl", "xlsx files", "xlsx")
        book = openpyxl.load_workbook(io.BytesIO(raw), read_only=True, data_only=True)
        sheets = {s.title: [list(row) for row in s.values] for s in book.worksheets}
    except ImportError as error:
        raise FileFormatError(f"{name}:1:1: got a workbook: {error}") from None
    except Exception as error:  # a broken archive raises whatever the parser does
        raise FileFormatError(
            f"{name}:1:1: got a file that cannot be read as a workbook ({type(error).__name__}), "
            "expected xlsx or text"
        ) from None
    filled = [t for t, rows in sheets.items() if any(c is not None for r in rows for c in r)]
    if sheet is None and len(filled) == 1:
        (sheet,) = filled
    if sheet not in sheets:
        got = f"the sheets {', '.join(filled)}" if filled else "no sheet with data"
        raise FileFormatError(
            f"{name}:1:1: got {got}, expected one sheet, or sheet= (--sheet) with the name "
            "of one of them"
        )
    return [",".join(map(_field, row)) for row in sheets[sheet]], f"xlsx, sheet {sheet!r}"


def parquet_lines(name: str, raw: bytes) -> list[str]:
    """Return the columns of a Parquet file as lines of CSV; the numbers are the same.

    Raises
    ------
    FileFormatError
        No Parquet file, or pyarrow is not installed (``pip install 'trunnion[parquet]'``).
    """
    try:
        parquet = optional_module("pyarrow.parquet", "Parquet files", "parquet")
        table = parquet.read_table(io.BytesIO(raw))
        names = table.column_names
        columns = [column.to_pylist() for column in table.columns]
    except ImportError as error:
        raise FileFormatError(f"{name}:1:1: got a Parquet file: {error}") from None
    except Exception as error:  # whatever the parser raises of a broken file
        raise FileFormatError(
            f"{name}:1:1: got a file that cannot be read as Parquet ({type(error).__name__})"
        ) from None
    rows = [names, *zip(*columns, strict=True)]
    return [",".join(map(_field, row)) for row in rows]


def _field(cell: Any) -> str:
    text = "" if cell is None else " ".join(str(cell).split())
    return '"' + text.replace('"', '""') + '"' if set(text) & set(',"#;\t') else text
