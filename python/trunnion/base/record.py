"""The record of a result: software, the call that made it, input files with their checksums.

JSON and the report state the same record. It is made once, when a result is first written, and
comes back with a result that is read from JSON. Size, date and checksum of a file are those of what
was read: a file that changed since, or another folder to work in, does not change them.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any

from trunnion._core import __version__
from trunnion.base.call import COMMAND
from trunnion.base.read_files import RecordedFile, as_read

CALLS = {
    "Diagnosis": "trunnion.diagnose",
    "DiagnosisBatch": "trunnion.diagnose_many",
    "IdentificationResult": "trunnion.identify",
    "ClosedFormResult": "trunnion.closed_form",
    "MachineComparison": "trunnion.compare",
    "Comparison": "trunnion.compare_methods",
    "Iso2302": "iso230_2",
    "Iso2302Rotary": "iso230_2",
    "Iso2304": "trunnion.iso230_4",
    "CncParameters": "trunnion.cnc_parameters",
    "CompensationForecast": "trunnion.compensation.compensation_forecast",
    "VolumetricError": "trunnion.volumetric_error",
    "ResidualInterval": "trunnion.residual_interval",
    "BallVerification": "trunnion.verify_ball",
}
"""Class of a result → function that makes it."""


@dataclass(frozen=True)
class Record:
    """What a result was made with, and of which files.

    software: Name and version of the program.
    python: Version of Python.
    written: Date and time of the record.
    made_by: The command or call.
    by_command: Whether it is a command.
    files: Input files as they were when they were read: data, further ones, effects, the set-up.
    """

    software: str
    python: str
    written: str
    made_by: str
    by_command: bool = False
    files: tuple[RecordedFile, ...] = ()

    @classmethod
    def of(
        cls, result: Any, data: Any = None, setup: Any = None, by: str = "", inputs: Any = ()
    ) -> Record:
        """Return the record of a result; data and set-up by default those that it holds itself.

        inputs: Further files: paths, or files as they were read.
        """
        found = [*files_of(data, setup), *files_of(result), *_paths(data), *_paths(inputs)]
        order = ("data", "input", "effects", "set-up")
        found.sort(key=lambda one: order.index(one.what) if one.what in order else len(order))
        files = tuple({(one.file, one.sha256): one for one in reversed(found)}.values())[::-1]
        return cls(
            f"trunnion {__version__}",
            platform.python_version(),
            datetime.now(UTC).astimezone().isoformat(" ", "seconds"),
            by or COMMAND.get() or _call(result, data, files),
            bool(COMMAND.get()),
            files,
        )


def files_of(*things: Any) -> Iterator[RecordedFile]:
    """Files that were read for data, set-ups, effects and results, those in a list among them."""
    for one in things:
        if isinstance(one, list | tuple):
            plain = bool(one) and isinstance(one[0], int | float | str)  # may be very many
            yield from () if plain else files_of(*one)
        elif (origin := getattr(one, "origin", None)) is not None and hasattr(origin, "as_read"):
            yield from origin.as_read()
        elif hasattr(one, "read_as"):  # a set-up
            if one.source:
                yield one.read_as or RecordedFile.unknown(one.source, "set-up")
        elif hasattr(one, "__dict__"):
            held = vars(one)
            yield from files_of(*(held.get(k) for k in ("data", "candidates", "setup", "results")))
            yield from held.get("_made_of", ())


def hold_files(made: Any, files: Iterable[RecordedFile]) -> None:
    """Let a result, or an effect, know of which files it was made; it is no field."""
    if found := tuple(dict.fromkeys(files)):
        object.__setattr__(made, "_made_of", found)  # results are frozen


def _paths(given: Any) -> Iterator[RecordedFile]:
    for one in given if isinstance(given, list | tuple) else [given]:
        if isinstance(one, RecordedFile):
            yield one
        elif isinstance(one, str | PathLike):
            yield as_read(one, "input") or RecordedFile.now(one, "input")


def held_record(result: Any) -> Record | None:
    """Return the record that a result carries: of what was written, or read from JSON."""
    found: Record | None = vars(result).get("_record") if hasattr(result, "__dict__") else None
    return found


def hold_record(result: Any, record: Record) -> None:
    """Let a result carry a record; it is no field, and results without it are equal to it."""
    object.__setattr__(result, "_record", record)  # results are frozen


def record_of(result: Any, **made_of: Any) -> Record:
    """Return the record that a result carries, else make the one that it carries from now on.

    made_of: Arguments of `Record.of`.
    """
    known = held_record(result)
    if known is None:
        known = Record.of(result, **made_of)
        hold_record(result, known)
    return known


def _call(result: Any, data: Any, files: Sequence[RecordedFile]) -> str:
    """Return the Python call that makes such a result of such data."""
    name = type(result).__name__
    called = next((CALLS[k.__name__] for k in type(result).__mro__ if k.__name__ in CALLS), name)
    data = getattr(result, "data", None) if data is None else data
    tables = data if isinstance(data, list | tuple) else [data]
    known = [one for one in tables if hasattr(one, "origin")]
    given = [f'"{one.file}"' for one in files if one.what in ("data", "input")]
    given += [type(one).__name__ for one in known if one.origin is None]
    listed = len(given) > 1 and called not in ("trunnion.compare", "trunnion.compare_methods")
    effects = [f'"{one.file}"' for one in files if one.what == "effects"]
    parts = [f"[{', '.join(given)}]" if listed else ", ".join(given)]
    set_ups = [f'"{one.file}"' for one in files if one.what == "set-up"]
    if set_ups:
        several = f"[{', '.join(set_ups)}]" if len(set_ups) > 1 else set_ups[0]
        parts.append(several if called == "trunnion.diagnose" else f"setup={several}")
    parts += [f"effects=[{', '.join(effects)}]"] if effects else []
    script = Path(sys.argv[0]).name if sys.argv and sys.argv[0] else "an interactive session"
    return f"{called}({', '.join(filter(None, parts))})  # Python, in {script}"
