"""Numbers separated by spaces without a header: LinuxCNC's halsampler, lists of points.

Neither names nor the period are in such a file: channels are called by their place, "1", "2", ...
Of halsampler, ``-t`` writes the number of the sample first; ``overrun`` stands where samples were
lost.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trunnion.files.columns import parse_number
from trunnion.files.foreign.channels import Channels, numbers
from trunnion.files.text import Source

NAME = "numbers without a header (LinuxCNC halsampler, a list of points)"
OVERRUN = "overrun"


def matches(source: Source) -> bool:
    """Whether the first line, but those of lost samples, has only numbers, separated by spaces."""
    first = next((x for line in source.lines if (x := line.split()) and x != [OVERRUN]), [])
    return bool(first) and all(parse_number(text) is not None for text in first)


def read(source: Source, wanted: Sequence[str] | None, period_s: float | None) -> Channels:
    """Return the channels, with times where the period is given."""
    del wanted
    filled = [i for i, line in enumerate(source.lines) if line.strip()]
    lost = [i for i in filled if source.lines[i].strip() == OVERRUN]
    rows = [i for i in filled if source.lines[i].strip() != OVERRUN]
    width = len(source.lines[rows[0]].split())
    heads = [str(k + 1) for k in range(width)]
    table = np.array([numbers(source, i, source.lines[i].split(), heads) for i in rows])
    after = np.isin(np.arange(len(rows))[1:], np.searchsorted(rows, lost))
    step = np.diff(table[:, 0])
    counts = np.all(table[:, 0] == np.round(table[:, 0]))
    tagged = (
        width > 1
        and len(rows) > 2
        and bool(counts and np.all(np.where(after, step > 1, step == 1)))
    )
    if lost and not tagged:
        raise source.error(
            lost[0],
            0,
            "got 'overrun' (samples were lost here) in samples without numbers, expected those of "
            "halsampler -t: how many were lost is not in the file",
        )
    notes = []
    if tagged:
        notes.append("The first value of each line counts up: it is the number of the sample.")
    if lost:
        notes.append(f"Samples were lost at {len(lost)} places (overrun); their times are kept.")
    number = table[:, 0] - table[0, 0] if tagged else np.arange(len(table), dtype=np.float64)
    return Channels(
        dict(zip(heads, table.T, strict=True)),
        [i + 1 for i in rows],
        time_s=None if period_s is None else number * period_s,
        clock="" if period_s is None else f"period_s = {period_s:g}",
        notes=tuple(notes),
    )
