"""What a reader recognised in a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from trunnion.base.report import Result, Table

SEPARATORS: Mapping[str, str] = {
    ",": "commas",
    ";": "semicolons",
    "\t": "tabs",
    " ": "spaces",
}
"""Separator of columns → what people call it."""

PLAIN = "CSV with the names of its kind"
"""Format of a file whose columns have the names of a kind of data."""


@dataclass(frozen=True, eq=False, repr=False)
class Recognised(Result):
    """What a file was taken for.

    Attributes
    ----------
    format
        The file's format.
    kind
        Kind of data that was made of it: class of the table.
    encoding
        UTF-8, UTF-16, or the sheet of a workbook.
    separator, decimal
        Between columns; the decimal mark.
    columns
        Column of the table → what it was made of; only where it is not called the same.
    units
        Column of the table → how its values were converted.
    clock
        Where the times come from; empty where the file has a column of them.
    notes
        What else was decided, one sentence each.
    """

    format: str
    kind: str
    encoding: str = "UTF-8"
    separator: str = ","
    decimal: str = "."
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    clock: str = ""
    notes: tuple[str, ...] = ()

    def sentences(self) -> Sequence[str]:
        """Say format, kind and dialect, the columns, units and clock."""
        between = SEPARATORS.get(self.separator, repr(self.separator))
        mark = " and decimal commas" if self.decimal == "," else ""
        if self.encoding.startswith("UTF"):
            said = [f"Read as {self.kind} from {self.format}: {self.encoding}, {between}{mark}."]
        else:  # cells, which nothing separates
            form = (self.encoding, self.format.removeprefix("CSV").strip())
            said = [f"Read as {self.kind} from {', '.join(filter(None, form))}{mark}."]
        for what, pairs in (("Columns", self.columns), ("Units", self.units)):
            if pairs:
                equal = " = " if what == "Columns" else ": "
                each = "; ".join(f"{k}{equal}{v}" for k, v in pairs.items())
                said.append(f"{what}: {each}.")
        if self.clock:
            said.append(f"Clock: {self.clock}.")
        return (*said, *self.notes)

    @property
    def as_written(self) -> bool:
        """Whether the file is as the package itself writes it, so that nothing needs saying."""
        return self == Recognised(PLAIN, self.kind)

    def tables(self) -> tuple[Table, ...]:
        """Return nothing: the sentences say all."""
        return ()
