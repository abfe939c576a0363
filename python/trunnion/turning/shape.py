"""Shape files: the input points of a turned part, P_i: (z, x, TY, R) of Park and Park (1990)."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence

from trunnion.base.arguments import checked
from trunnion.base.errors import FileFormatError, InputError
from trunnion.base.input import file_bytes
from trunnion.files.text import decode
from trunnion.turning.profile import Corner, Kind, Profile

COLUMNS = ("z_mm", "x_mm", "type", "radius_mm")
TYPES: dict[str, Kind] = {
    "1": "sharp",
    "2": "sharp",
    "3": "fillet",
    "4": "fillet",
    "5": "arc-out",
    "6": "arc-in",
    "7": "arc-to-arc",
    "8": "relief",
}
"""The eight types of the paper. Its Fig. 3 is a drawing; its text says that 7 is 5 and 6 together
and that 8 is cut after finishing. The others are a reconstruction: 1 and 2 sharp, 3 and 4 with a
fillet, to either side (the side follows from the lines)."""


@checked
def read_shape(path: str | os.PathLike[str]) -> Profile:
    """Read a shape file.

    Parameters
    ----------
    path
        CSV with the columns ``z_mm`` and ``x_mm`` (radius) and, where they are needed, ``type``
        (1 to 8, or a kind of `Corner`; empty: sharp) and ``radius_mm`` (empty: 0), from the
        tailstock towards the chuck. Lines that start with ``#`` are comments.

    Raises
    ------
    FileFormatError
        Missing columns, a value that is no number, a type that is none; with the line. A contour
        that cannot be (see `Profile.from_points`); with its point.
    """
    name = str(path)
    lines = decode(name, file_bytes(path)).splitlines()
    kept = [(i, text) for i, text in enumerate(lines, 1) if text.strip() and text[0] != "#"]
    reader = csv.DictReader((text for _, text in kept), skipinitialspace=True)
    try:
        return _profile(name, kept, reader)
    except csv.Error as error:
        raise FileFormatError(f"{name}, line {kept[reader.line_num - 1][0]}: {error}") from None
    except InputError as error:
        raise FileFormatError(f"{name}: {error}") from None


def _profile(name: str, kept: Sequence[tuple[int, str]], reader: csv.DictReader[str]) -> Profile:
    """Return the contour of a file; ``kept``: number and text of its lines that are no comments."""
    columns = [column.strip() for column in reader.fieldnames or ()]
    reader.fieldnames = columns
    for column in COLUMNS[:2]:
        if column not in columns:
            where = f"{name}, line {kept[0][0]}" if kept else f"{name}"
            got = ", ".join(columns) or "no columns"
            raise FileFormatError(f"{where}: got {got}, expected {', '.join(COLUMNS)}")
    corners = []
    for row in reader:
        place = f"{name}, line {kept[reader.line_num - 1][0]}"
        z, x, radius = (_number(place, row, column) for column in ("z_mm", "x_mm", "radius_mm"))
        corners.append(Corner(z, x, _kind(place, row.get("type")), radius))
    return Profile.from_points(corners)


def _number(place: str, row: dict[str, str | None], column: str) -> float:
    text = (row.get(column) or "").strip()
    if not text and column == "radius_mm":
        return 0.0
    try:
        return float(text)
    except ValueError:
        raise FileFormatError(
            f"{place}, column {column}: got {text!r}, expected a number"
        ) from None


def _kind(place: str, text: str | None) -> Kind:
    given = (text or "").strip().lower() or "sharp"
    kinds = {kind: kind for kind in TYPES.values()} | TYPES
    if given not in kinds:
        raise FileFormatError(
            f"{place}, column type: got {given!r}, expected 1 to 8, or one of "
            f"{', '.join(dict.fromkeys(TYPES.values()))}"
        )
    return kinds[given]
