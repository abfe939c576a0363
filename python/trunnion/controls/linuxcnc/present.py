"""Values that a LinuxCNC configuration has now: pins that are set, offsets of homing."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from trunnion.base.errors import FileFormatError, InputError
from trunnion.base.input import file_bytes, path_of
from trunnion.files.columns import parse_number
from trunnion.setup import Setup

MM = {"mm": 1.0, "inch": 25.4}
"""Millimetres of a machine unit."""
_UNITS = {"mm": "mm", "metric": "mm", "inch": "inch", "in": "inch", "imperial": "inch"}
"""Spellings of LINEAR_UNITS."""
_SETP = re.compile(r"^\s*setp\s+(\S+)\s+(\S+)", re.IGNORECASE)
_SECTION = re.compile(r"^\s*\[(\w+)\]")
_KEY = re.compile(r"^\s*(\w+)\s*=\s*(.*?)\s*$")


@dataclass(frozen=True)
class Present:
    """Pins by name, and keys of the INI file by (section, key), as numbers; LINEAR_UNITS."""

    pins: Mapping[str, float] = field(default_factory=dict)
    keys: Mapping[tuple[str, str], float] = field(default_factory=dict)
    units: str | None = None

    def check_units(self, setup: Setup) -> None:
        """Raise InputError where the set-up says other units than the INI file."""
        if self.units not in (None, setup.control.linear_units):
            raise InputError(
                f"control.linear_units: got {setup.control.linear_units!r}, expected "
                f"{self.units!r}: LINEAR_UNITS of the INI file"
            )


def read_present(paths: Iterable[str | Path]) -> Present:
    """Read .hal and .ini files; a later line wins over an earlier one.

    Raises
    ------
    InputError
        A file with another ending.
    FileFormatError
        A pin of a kinematics component, or an offset of homing, whose value is no number.
    """
    pins: dict[str, float] = {}
    keys: dict[tuple[str, str], float] = {}
    units = None
    for given in paths:
        path = path_of(given)
        suffix = path.suffix.lower()
        if suffix not in (".hal", ".ini", ".inc"):
            raise InputError(
                f"{path}: got a {suffix or 'file without ending'}, expected .hal or .ini"
            )
        section = ""
        lines = file_bytes(path).decode("utf-8", "replace").splitlines()
        for number, line in enumerate(lines, start=1):
            if suffix == ".hal":
                if (found := _SETP.match(line)) and "kins." in found[1]:
                    pins[found[1]] = _number(path, number, found[2])
            elif found := _SECTION.match(line):
                section = found[1].upper()
            elif (found := _KEY.match(line)) and found[1].upper() in ("HOME", "HOME_OFFSET"):
                keys[section, found[1].upper()] = _number(path, number, found[2])
            elif found and found[1].upper() == "LINEAR_UNITS":
                units = _UNITS.get(found[2].lower(), found[2])
    return Present(pins, keys, units)


def _number(path: Path, line: int, text: str) -> float:
    truth = {"true": 1.0, "false": 0.0}
    value = truth[text.lower()] if text.lower() in truth else parse_number(text)
    if value is None or not math.isfinite(value):
        raise FileFormatError(f"{path}, line {line}: got {text!r}, expected a number")
    return value
