"""The file of an error map: CSV, a comment line with the resolution, a header, one row a node.

Rows are in any order::

    # trunnion error map, corrections to add; resolution_um = 0.1
    a_deg,c_deg,x_mm,y_mm,z_mm,dx_um,dy_um,dz_um
    -90,0,-200,-250,-250,12.3,-4.5,0.1
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from os import PathLike
from typing import ClassVar

import numpy as np

from trunnion.base.errors import FileFormatError
from trunnion.base.input import file_bytes
from trunnion.base.units import Floats, Integers
from trunnion.files.columns import ColumnError, Number, OptionalNumber
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table
from trunnion.files.text import decode

_RESOLUTION = re.compile(r"#.*\bresolution_um\s*=\s*(\S+)")


class MapRows(Table):
    """Rows of the file of an error map."""

    a_deg = OptionalNumber("position of A, control's sign")
    b_deg = OptionalNumber("position of B, control's sign")
    c_deg = OptionalNumber("position of C, control's sign")
    x_mm = Number("position of X")
    y_mm = Number("position of Y")
    z_mm = Number("position of Z")
    dx_um = Number("correction to add to X")
    dy_um = Number("correction to add to Y")
    dz_um = Number("correction to add to Z")

    resolution_um: ClassVar[float] = 0.0

    def names(self) -> list[str]:
        """Columns that span the grid, rotary axes first."""
        rotary = [name for name in ("a_deg", "b_deg", "c_deg") if name in self.columns]
        return [*rotary, "x_mm", "y_mm", "z_mm"]

    def order(self) -> tuple[list[Floats], Integers]:
        """Nodes of each axis, and for each node the row that has it."""
        names = self.names()
        found = [np.unique(self.columns[name], return_inverse=True) for name in names]
        shape = [len(nodes) for nodes, _ in found]
        index = np.ravel_multi_index([inverse for _, inverse in found], shape)
        rows = np.full(int(np.prod(shape)), -1, dtype=np.intp)
        rows[index] = np.arange(len(index))
        first, counts = np.unique(index, return_index=True)[1], np.bincount(index)
        if len(first) < len(index):
            row = int(np.setdiff1d(np.arange(len(index)), first)[0])
            there = ", ".join(f"{name} = {self.columns[name][row]:g}" for name in names)
            raise ColumnError(names[0], row, f"the node {there} twice", "each node once")
        if counts.size < rows.size or np.any(rows < 0):
            at = np.unravel_index(int(np.argmin(rows)), shape)
            there = ", ".join(
                f"{n} = {f[0][i]:g}" for n, f, i in zip(names, found, at, strict=True)
            )
            raise ColumnError(
                names[0], None, f"no row for the node {there}", "a full grid: every combination"
            )
        return [nodes for nodes, _ in found], rows

    def _check(self) -> None:
        self.order()
        step = self.resolution_um
        for name in ("dx_um", "dy_um", "dz_um") if step > 0 else ():
            ratio = self.columns[name] / step
            bad = np.abs(ratio - np.rint(ratio)) > 1e-6 * np.maximum(1.0, np.abs(ratio))
            if bad.any():
                row = int(np.argmax(bad))
                raise ColumnError(
                    name, row, repr(float(self.columns[name][row])), f"a multiple of {step:g} µm"
                )


def text_of_rows(nodes: Mapping[str, Floats], corrections_um: Floats, resolution_um: float) -> str:
    """Return the text of a file: node (n,) of each axis, corrections (n, 3)."""
    decimals = _decimals(resolution_um)
    if decimals is not None:
        corrections_um = np.round(corrections_um, decimals) + 0.0
    head = (
        "# trunnion error map, corrections to add to commanded positions; "
        f"resolution_um = {resolution_um!r}\n"
    )
    by_axis = {f"d{axis}_um": corrections_um[:, i] for i, axis in enumerate("xyz")}
    return head + MapRows({**nodes, **by_axis}).to_csv()


def _decimals(step: float) -> int | None:
    """Decimals that write multiples of a step exactly, None if there are no such."""
    for decimals in range(10):
        if step > 0 and abs(round(step, decimals) - step) < 1e-12 * step:
            return decimals
    return None


def read_rows(path: str | PathLike[str]) -> MapRows:
    """Read the rows of a file, with its resolution.

    Raises FileFormatError: as `read_error_map` does.
    """
    step = _resolution(path)

    class Rows(MapRows):
        resolution_um = step

    return read_table(path, Rows)


def _resolution(path: str | PathLike[str]) -> float:
    """Resolution in the comments above the header."""
    name = str(path)
    for number, line in enumerate(decode(name, file_bytes(path)).split("\n"), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            break
        if match := _RESOLUTION.match(line.lstrip()):
            try:
                resolution = float(match[1])
            except ValueError:
                resolution = -1.0
            if np.isfinite(resolution) and resolution >= 0:
                return resolution
            raise FileFormatError(
                f"{name}:{number}:{match.start(1) + 1}: resolution_um: got {match[1]!r}, "
                "expected a finite number, 0 or above"
            )
    raise FileFormatError(
        f"{name}:1:1: resolution_um: got no such comment above the header, expected a line "
        '"# ... resolution_um = 0.1"'
    )
