"""Log of LinuxCNC's halscope ("Save log file").

``Sampling period is 1000000 nSec`` (newer: ``ns``), then one line a sample: ``NAME +1.234 ...``
for each channel. The program writes one sample more than it has recorded
(``src/hal/utils/scope_files.c``, a loop to ``n <= samples``): the last line is left out.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from trunnion.files.foreign.channels import Channels, numbers
from trunnion.files.text import Source

NAME = "LinuxCNC halscope log"
_PERIOD = re.compile(r"Sampling period is (\d{1,15}) n(?:Sec|s)\s*")


def matches(source: Source) -> bool:
    """Whether the first line is that of the program."""
    return _PERIOD.match(source.lines[0]) is not None


def read(source: Source, wanted: Sequence[str] | None, period_s: float | None) -> Channels:
    """Return the channels, the first sample at time 0."""
    del wanted, period_s
    period = _PERIOD.match(source.lines[0])
    rows = [i for i, line in enumerate(source.lines) if i and line.strip()]
    if period is None or len(rows) < 2:
        raise source.error(0, 0, f"got {len(rows)} samples, expected at least 2")
    names = source.lines[rows[0]].split()[::2]
    if len(set(names)) != len(names):
        raise source.error(rows[0], 0, f"got channels {', '.join(names)}, expected each once")
    table = []
    for i in rows[:-1]:
        fields = source.lines[i].split()
        if fields[::2] != names:
            raise source.error(
                i, 0, f"got channels {', '.join(fields[::2])}, expected {', '.join(names)}"
            )
        table.append(numbers(source, i, fields[1::2], names))
    step = int(period[1]) * 1e-9
    times = step * np.arange(len(table), dtype=np.float64)
    return Channels(
        dict(zip(names, np.array(table).T, strict=True)),
        [i + 1 for i in rows[:-1]],
        time_s=times,
        clock=f"sampling period of {1e3 * step:g} ms in the first line",
        notes=("The last line was left out: halscope writes one sample more than it recorded.",),
    )
