"""The record of a result: software, the call that made it, input files with their checksums.

JSON and the report state the same record. It is made once, when a result is first written, and
comes back with a result that is read from JSON: a file that changed since does not change it.
"""

from __future__ import annotations

import hashlib
import platform
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any

from trunnion._core import __version__
from trunnion.base.call import COMMAND
from trunnion.base.input import path_of

CALLS = {
    "Diagnosis": "trunnion.diagnose",
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
class RecordedFile:
    """An input file as it was when the record was made.

    file: Path, as it was given.
    what: "data", "input" or "set-up".
    bytes: Size; None where the file was not there any more.
    changed: Date of its last change.
    sha256: Checksum, in hexadecimal digits; empty where the file was not there any more.
    """

    file: str
    what: str
    bytes: int | None
    changed: str
    sha256: str

    @classmethod
    def of(cls, path: str, what: str) -> RecordedFile:
        """Return a file with its size, date of change and checksum."""
        try:
            about = Path(path).stat()
            if not Path(path).is_file():  # a pipe is read once only
                return cls(path, what, None, "no file", "")
            with path_of(path).open("rb") as opened:
                digest = hashlib.file_digest(opened, "sha256").hexdigest()
        except (OSError, ValueError):
            return cls(path, what, None, "not there any more", "")
        changed = datetime.fromtimestamp(about.st_mtime, UTC).astimezone()
        return cls(path, what, about.st_size, changed.isoformat(" ", "minutes"), digest)


@dataclass(frozen=True)
class Record:
    """What a result was made with, and of which files.

    software: Name and version of the program.
    python: Version of Python.
    written: Date and time of the record.
    made_by: The command or call.
    by_command: Whether it is a command.
    files: Input files: data, further ones, the set-up.
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
        """Return the record of a result; data and set-up by default those that it holds itself."""
        data = getattr(result, "data", None) if data is None else data
        setup = getattr(result, "setup", None) if setup is None else setup
        several = list(data) if isinstance(data, list | tuple) else [data]
        given = (*inputs, *(str(one) for one in several if isinstance(one, str | PathLike)))
        paths = [(path, "data") for path in dict.fromkeys(files_of(several))]
        paths += [(path, "input") for path in given]
        if source := getattr(setup, "source", ""):
            paths.append((str(source), "set-up"))
        return cls(
            f"trunnion {__version__}",
            platform.python_version(),
            datetime.now(UTC).astimezone().isoformat(" ", "seconds"),
            by or COMMAND.get() or _call(result, several, given, str(source)),
            bool(COMMAND.get()),
            tuple(RecordedFile.of(*one) for one in paths),
        )


def files_of(tables: Sequence[Any]) -> Iterator[str]:
    """Paths of the files that tables were read from."""
    for one in tables:
        origin = getattr(one, "origin", None)
        yield from () if origin is None else origin.files


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


def _call(result: Any, tables: Sequence[Any], inputs: Sequence[str], source: str) -> str:
    """Return the Python call that makes such a result of such data."""
    name = type(result).__name__
    called = next((CALLS[k.__name__] for k in type(result).__mro__ if k.__name__ in CALLS), name)
    known = [one for one in tables if hasattr(one, "origin")]
    given = [next((f'"{path}"' for path in files_of([one])), type(one).__name__) for one in known]
    given += [f'"{path}"' for path in inputs]
    many = f"[{', '.join(given)}]" if len(given) > 1 else "".join(given)
    parts = [part for part in (many, f'"{source}"' if source else "") if part]
    script = Path(sys.argv[0]).name if sys.argv and sys.argv[0] else "an interactive session"
    return f"{called}({', '.join(parts)})  # Python, in {script}"
