"""Numbers separated by spaces without a header: LinuxCNC's halsampler, lists of points.

Neither names nor the period are in such a file: channels are called by their place, "1", "2", ...
Of halsampler, ``-t`` writes the number of the sample first; ``overrun`` stands where samples were
lost.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trunnion.base.units import Floats
from trunnion.files.columns import parse_number
from trunnion.files.foreign.channels import Channels, numbers
from trunnion.files.text import Source

NAME = "numbers without a header (LinuxCNC halsampler, a list of points)"
OVERRUN = "overrun"
MOSTLY = 0.5
"""Share of steps of 1 that make whole numbers a count of samples."""
MAX_PLACES = 5
"""Gaps that a note names; of more it says how many."""


def matches(source: Source) -> bool:
    """Whether the first line, but those of lost samples, has only numbers, separated by spaces."""
    first = next((x for line in source.lines if (x := line.split()) and x != [OVERRUN]), [])
    return bool(first) and all(parse_number(text) is not None for text in first)


def read(source: Source, wanted: Sequence[str] | None, period_s: float | None) -> Channels:
    """Return the channels, with times where the period is given."""
    filled = [i for i, line in enumerate(source.lines) if line.strip()]
    lost = [i for i in filled if source.lines[i].strip() == OVERRUN]
    rows = [i for i in filled if source.lines[i].strip() != OVERRUN]
    width = len(source.lines[rows[0]].split())
    heads = [str(k + 1) for k in range(width)]
    cut = _cut(source, rows) if width > 1 and len(rows) > 2 else ""
    rows = rows[:-1] if cut else rows
    table = np.array([numbers(source, i, source.lines[i].split(), heads) for i in rows])
    is_channel = wanted is not None and heads[0] in wanted
    tagged = width > 1 and _counts_up(table[:, 0], rows, lost, is_channel=is_channel)
    if lost and not tagged:
        raise source.error(
            lost[0],
            0,
            "got 'overrun' (samples were lost here) in samples without numbers, expected those of "
            "halsampler -t: how many were lost is not in the file",
        )
    notes = (cut,) if cut else ()
    if tagged:
        gaps = _gaps(source, table[:, 0], rows, lost)
        counter = "The first value of each line counts up: it is the number of the sample."
        notes = (counter, *gaps, *notes)
    number = table[:, 0] - table[0, 0] if tagged else np.arange(len(table), dtype=np.float64)
    return Channels(
        dict(zip(heads, table.T, strict=True)),
        [i + 1 for i in rows],
        time_s=None if period_s is None else number * period_s,
        clock="" if period_s is None else f"period_s = {period_s:g}",
        notes=notes,
    )


def _cut(source: Source, rows: Sequence[int]) -> str:
    """Say that the last line is cut off; empty where it is whole.

    Without an end of line it was cut while it was written if it has fewer fields than the lines
    before, or not the space that halsampler writes behind each, or fewer decimals.
    """
    last, before = source.lines[rows[-1]], [source.lines[i] for i in rows[-3:-1]]
    if rows[-1] < len(source.lines) - 1:
        return ""
    fields, usual = last.split(), before[-1].split()
    if any(len(line.split()) != len(usual) for line in before) or len(fields) > len(usual):
        return ""
    decimals = {len(line.split()[-1].partition(".")[2]) for line in before}
    short = ""
    if len(fields) < len(usual):
        short = f"{len(fields)} of {len(usual)} fields"
    elif all(line.endswith(" ") for line in before) and not last.endswith(" "):
        short = "no space behind its last field, as the lines before have"
    elif len(decimals) == 1 and len(fields[-1].partition(".")[2]) < min(decimals):
        short = "fewer decimals in its last field than the lines before"
    where = f"Line {rows[-1] + 1}"
    return f"{where} is cut off ({short}, no end of line): it is left out." if short else ""


def _counts_up(
    first: Floats, rows: Sequence[int], lost: Sequence[int], *, is_channel: bool
) -> bool:
    """Whether the first value of each line is the number of the sample.

    A column that is data by the user's word counts only if nothing is missing but at an overrun.
    """
    if len(first) < 3 or np.any(first != np.round(first)):
        return False
    step = np.diff(first)
    after = np.isin(np.arange(1, len(rows)), np.searchsorted(rows, lost))
    if is_channel:
        return bool(np.all(np.where(after, step > 1, step == 1)))
    return bool(np.mean(step[~after] == 1) > MOSTLY) if (~after).any() else bool(np.all(step > 1))


def _gaps(
    source: Source, first: Floats, rows: Sequence[int], lost: Sequence[int]
) -> tuple[str, ...]:
    """Say where samples are missing; refuse numbers that do not rise."""
    step = np.diff(first)
    marked = {int(k) for k in np.searchsorted(rows, lost)}
    found = []
    for k in (np.flatnonzero(step != 1) + 1).tolist():
        if step[k - 1] < 1:
            raise source.error(
                rows[k], 0,
                f"sample {first[k]:.0f}: got it after sample {first[k - 1]:.0f}, expected a higher "
                "number: two recordings in one file? Read each by itself",
            )  # fmt: skip
        why = "overrun" if k in marked else "lines of the file were lost"
        last = f" to {first[k] - 1:.0f}" if step[k - 1] > 2 else ""
        found.append(f"line {rows[k] + 1}: {first[k - 1] + 1:.0f}{last} ({why})")
    if not found:
        return ()
    more = f"; and at {len(found) - MAX_PLACES} more places" if len(found) > MAX_PLACES else ""
    said = "; ".join(found[:MAX_PLACES]) + more
    return (f"Samples are missing before {said}. The times of the others are kept.",)
