"""CSV export of Beckhoff's TwinCAT Scope.

A block of channels in columns (``Name``, ``SampleTime`` in ms, ``Unit``, ...), a blank line, then
rows that begin with the time: a file time (units of 100 ns since 1601) or ms since the start. A
channel may have a column of time of its own ("Timelines: All"); the rows then have to agree.
Source: infosys.beckhoff.com, TE13xx TC3 Scope View, "Export to CSV".
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from trunnion.base.units import Floats
from trunnion.files.foreign.channels import Channels, numbers
from trunnion.files.text import Source

NAME = "TwinCAT Scope CSV"
FILE_TIME_FROM = 1e14
"""Times above this are file times: 1e14 ms would be three thousand years."""
_FILE_TIME = re.compile(r"[0-9]{15,18}")
MAX_HEAD_LINES = 200
_SAMPLE_TIME = re.compile(r"SampleTime(?:\[ms\])?([;,\t])")


def matches(source: Source) -> bool:
    """Whether the block of channels is there."""
    return _block_at(source) is not None


def _block_at(source: Source) -> tuple[int, str] | None:
    """Return the index of the block's first line and the separator; None where there is none."""
    begin = None
    for i, line in enumerate(source.lines[:MAX_HEAD_LINES]):
        if line[:4] == "Name":
            begin = i
        found = _SAMPLE_TIME.match(line)
        if found and begin is not None:
            return begin, found[1]
    return None


def _block(source: Source, begin: int, mark: str) -> tuple[dict[str, list[str]], int]:
    """Return the block of channels by key, and the index of the line after it."""
    block, i = {}, begin
    while i < len(source.lines) and source.lines[i].strip(mark + " "):
        key, *values = [text.strip() for text in source.lines[i].split(mark)]
        block[key.removesuffix("[ms]")] = values
        i += 1
    return block, i


def read(source: Source, wanted: Sequence[str] | None, period_s: float | None) -> Channels:
    """Return the channels with their common clock."""
    del wanted, period_s
    begin, mark = _block_at(source) or (0, ";")
    block, at = _block(source, begin, mark)
    names = [name for name in block.get("Name", []) if name]
    if len(set(names)) != len(names):  # the symbol's path is unique where a name is not
        names = block.get("SymbolName", names)[: len(names)]
    rows = [
        i
        for i in range(at, len(source.lines))
        if source.lines[i].strip(mark + " ") and source.lines[i].strip() != "EOF"
    ]
    if not names or not rows or len(set(names)) != len(names):
        raise source.error(at, 0, f"got channels {names} and {len(rows)} rows, expected both")
    count = len(source.lines[rows[0]].rstrip(mark + " ").split(mark))
    own = count == 2 * len(names) and len(names) > 1
    heads = [h for n in names for h in ("time", n)] if own else ["time", *names]
    decimal = "," if mark != "," and any("," in source.lines[i] for i in rows) else "."
    table = np.array(
        [
            numbers(
                source,
                i,
                source.lines[i].rstrip(mark + " ").replace(decimal, ".").split(mark),
                heads,
                mark,
            )
            for i in rows
        ]
    )
    times = table[:, ::2] if own else table[:, :1]
    if np.ptp(times, axis=1).max() > 0:
        row = int(np.argmax(np.ptp(times, axis=1) > 0))
        raise source.error(
            rows[row], 0, "got channels at different times, expected channels of one sample time"
        )
    time_s, clock = _clock(source, rows, times[:, 0])
    values = table[:, 1::2] if own else table[:, 1:]
    units = block.get("Unit", [])
    return Channels(
        dict(zip(names, values.T, strict=True)),
        [i + 1 for i in rows],
        {n: u for n, u in zip(names, units, strict=False) if u not in ("", "(None)")},
        time_s,
        clock,
        mark,
        decimal,
    )


def _clock(source: Source, rows: Sequence[int], times: Floats) -> tuple[Floats, str]:
    """Return seconds since the first row, and where they are from."""
    if times[0] < FILE_TIME_FROM:
        return (times - times[0]) * 1e-3, "ms of the export"
    # a float does not hold a file time to 100 ns: whole numbers do
    texts = [re.split(r"[;,\t]", source.lines[i], maxsplit=1)[0].strip() for i in rows]
    if not all(map(_FILE_TIME.fullmatch, texts)):
        return (times - times[0]) * 1e-7, "file times of the export"
    exact = np.array([int(text) - int(texts[0]) for text in texts], dtype=np.float64)
    return exact * 1e-7, "file times of the export (100 ns)"
