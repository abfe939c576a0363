"""Where a result comes from: machine, people, files, software, the call that made it."""

from __future__ import annotations

import platform
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any

import tomli_w

from trunnion._core import __version__
from trunnion.base.read_files import RecordedFile
from trunnion.base.record import Record, held_record, record_of
from trunnion.base.report import Result, Table
from trunnion.data.levels import Levels
from trunnion.data.points import Points
from trunnion.data.positioning import Positioning
from trunnion.data.sweep import Sweep
from trunnion.data.touches import Touches
from trunnion.files.table import Table as DataTable
from trunnion.reports.document import Item, Listing, Section
from trunnion.setup import ReportSetup, Setup
from trunnion.setup.write import tables_of

SINGLE = (Positioning, Levels, Points, Sweep)  # of an axis or a part alone
RECORD = ("machine", "serial", "operator", "date", "instrument")
"""What a record has, of the set-up's table [report]."""


@dataclass(frozen=True)
class Source:
    """What a result was made of.

    Attributes
    ----------
    data
        The measured data, or several.
    setup
        The set-up, or None.
    tolerance
        Largest sizes allowed, by name.
    record
        Software, call and input files; None for a document without a result.
    stored
        Whether the record was made before: it came with the result from JSON, or stands in one.
    inputs
        Files beside those of the data that it was made of: an estimate, a part program.
    """

    data: tuple[DataTable, ...] = ()
    setup: Setup | None = None
    tolerance: Mapping[str, float] = field(default_factory=dict)
    record: Record | None = None
    stored: bool = False
    inputs: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, result: Result, data: Any, setup: Any, tolerance: Mapping[str, float] | None, by: str
    ) -> Source:
        """Return what is known: as given, else what the result holds itself."""
        given = data is not None or setup is not None or by != ""
        stored = not given and held_record(result) is not None
        record = Record.of(result, data, setup, by) if given else record_of(result)
        data = getattr(result, "data", None) if data is None else data
        several = tuple(data) if isinstance(data, list | tuple) else (data,)
        tables = tuple(one for one in several if isinstance(one, DataTable))
        inputs = tuple(str(one) for one in several if isinstance(one, str | PathLike))
        setup = getattr(result, "setup", None) if setup is None else setup
        setup = setup if isinstance(setup, Setup) else None
        if tolerance is None:
            own = getattr(result, "tolerances", None)
            known = own if isinstance(own, Mapping) else {}
            tolerance = {**known, **(setup.machine.tolerance if setup else {})}
        return cls(tables, setup, dict(tolerance), record, stored, inputs)

    @property
    def machine(self) -> str:
        """The machine, for the heading: maker, serial number, chain of axes."""
        if self.setup is None:
            return ""
        said = self.setup.report
        serial = f"no. {said.serial}" if said.serial else ""
        return ", ".join(part for part in (said.machine, serial) if part)

    def subtitle(self) -> str:
        """Machine, date and data in one line."""
        said = self.setup.report if self.setup else None
        names = [name for _, name in self.files() if name]
        names += [Path(path).name for path in self.inputs]
        date, who = (said.date, said.operator) if said else ("", "")
        parts = (
            self.machine or "Machine not stated",
            str(date) if date else "date of measurement not stated",
            who or "by whom not stated",
            ", ".join(names),
        )
        return " · ".join(part for part in parts if part)

    def files(self) -> Iterator[tuple[str, str]]:
        """Path and name of each file of data."""
        seen: set[str] = set()
        for one in self.data:
            if one.origin is None:
                continue
            for path, name in zip(one.origin.files, one.origin.names, strict=True):
                if path not in seen:
                    seen.add(path)
                    yield path, name

    def section(self) -> Section:
        """Return what stands at the end of every report."""
        said = self.setup.report if self.setup else ReportSetup()
        meaning = {name: declared.meaning for name, declared in said.own_keys().items()}
        rows = [(meaning[n].capitalize(), str(v)) for n in meaning if (v := getattr(said, n))]
        if self.setup is not None and self._has_chain(self.setup):
            rows.append(("Chain of axes", self.setup.machine.name))
        times = [t for one in self.data if (t := _span(one))]
        rows += [("Time of the readings", text) for text in times]
        rows += [
            ("Report written", datetime.now(UTC).astimezone().isoformat(" ", "seconds")),
            ("Software", f"trunnion {__version__}, Python {platform.python_version()}"),
        ]
        if self.stored and self.record is not None:
            by = f"{self.record.software}, Python {self.record.python}"
            rows.append(("Result stored", f"{self.record.written}, by {by}"))
        items: list[Item] = [Table.of("Record", ("", "as stated or found"), rows)]
        if self.record is not None:
            items += [
                *self._checksums(self.record),
                f"Made by the {'command' if self.record.by_command else 'call'}:",
                Listing(self.record.made_by),
            ]
        if missing := [meaning[n] for n in RECORD if not getattr(said, n)]:
            items.append(f"Not stated, in table [report] of the set-up: {'; '.join(missing)}.")
        if self.setup is not None:
            stated = self._file_of(self.setup)
            head = (
                "Set-up, as its file states it; all else has its default:" if stated else "Set-up:"
            )
            items += [head, Listing(stated or self._set_up(self.setup))]
        return Section("Where this comes from", tuple(items))

    def _has_chain(self, setup: Setup) -> bool:
        """Whether the chain of axes is stated, or may be what the data were understood by."""
        stated = "machine" in self._tables_of_file(setup)
        single = bool(self.data) and all(isinstance(one, SINGLE) for one in self.data)
        return not setup.turning and (stated or not single)

    def _tables_of_file(self, setup: Setup) -> dict[str, Any]:
        """Tables of the file of the set-up; none where it is no longer what was read."""
        try:
            return tomllib.loads(self._file_of(setup))
        except tomllib.TOMLDecodeError:
            return {}

    def _file_of(self, setup: Setup) -> str:
        """Text of the file of the set-up; empty without one, or where it has changed since."""
        known = {one.sha256 for one in self.record.files} if self.record else set()
        if known and RecordedFile.now(setup.source, "set-up").sha256 not in known:
            return ""
        try:
            return Path(setup.source).read_text(encoding="utf-8-sig") if setup.source else ""
        except (OSError, UnicodeDecodeError):
            return ""

    def _set_up(self, setup: Setup) -> str:
        """Return the tables of the set-up that such data have a use for."""
        unused = {"machine"} if setup.turning else set()
        if self.data and not any(isinstance(one, Touches) for one in self.data):
            unused |= {"artefact", "probe", "plan", "control"}
        return tomli_w.dumps({k: v for k, v in tables_of(setup).items() if k not in unused})

    def _checksums(self, record: Record) -> list[Item]:
        """Files with size, date and checksum; lines that ``sha256sum -c`` takes."""
        found = record.files
        if not found:
            return []
        rows = [(one.file, one.what, one.bytes, one.changed) for one in found]
        title = "Files, as they were when they were read"
        sums = "\n".join(f"{one.sha256}  {one.file}" for one in found if one.sha256)
        listed: list[Item] = (
            ["SHA-256 checksums (sha256sum -c checks them):", Listing(sums)] if sums else []
        )
        return [Table.of(title, ("file", "what", "bytes", "changed"), rows), *listed]


def _span(data: DataTable) -> str:
    """Say how long a measurement took, where it has times."""
    time = data.columns.get("time_s")
    if time is None or not len(time):
        return ""
    return f"{len(data)} rows over {(float(time.max()) - float(time.min())) / 60:.3g} min"
