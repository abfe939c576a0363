"""Output of EPICS' camonitor: ``NAME YYYY-MM-DD HH:MM:SS.ffffff VALUE [STATUS SEVERITY]`` a line.

Each channel is posted when it changes, at times of its own. The rows are the posts of the channel
that is posted most of those wanted; the others are interpolated linearly to its times, where both
have been posted.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import datetime

import numpy as np

from trunnion.base.checks import choose
from trunnion.base.units import Floats
from trunnion.files.columns import parse_number
from trunnion.files.foreign.channels import Channels
from trunnion.files.text import Source

NAME = "EPICS camonitor output"
_POST = re.compile(
    r"(?P<name>\S+)\s+(?P<time>\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{1,9})\s+(?P<value>\S+)"
)
_EPOCH = datetime(1970, 1, 1)


def matches(source: Source) -> bool:
    """Whether the first line that is not empty is a post."""
    first = next((line for line in source.lines if line.strip()), "")
    return _POST.match(first) is not None


def read(source: Source, wanted: Sequence[str] | None, period_s: float | None) -> Channels:
    """Return the wanted channels at common times; without any, one row each, to be listed."""
    del period_s
    posts, names, skipped = _posts(source)
    if wanted is None:
        return Channels({name: np.array([v[0][1]]) for name, v in posts.items()}, [1])
    wanted = [name for name in wanted if name in posts or parse_number(name) is None]
    for name in wanted:
        choose(f"{source.name}:1:1: channel", name, names)
    series = {name: np.array(sorted(set(posts.get(name, [])))) for name in wanted}
    few = [name for name, s in series.items() if len(s) < 2]
    if few:
        raise source.error(
            0, 0, f"{few[0]}: got {len(series[few[0]])} posted numbers, expected at least 2"
        )
    return _merged(source, series, skipped)


def _posts(source: Source) -> tuple[dict[str, list[tuple[float, float, int]]], list[str], int]:
    """Return time, value and line of every post of a number; all names; posts of no number."""
    posts: dict[str, list[tuple[float, float, int]]] = {}
    names: dict[str, None] = {}
    skipped = 0
    for i, line in enumerate(source.lines):
        if not line.strip():
            continue
        match = _POST.match(line)
        if match is None:
            if "***" in line:  # "*** Not connected (PV not found)"
                skipped += 1
                continue
            raise source.error(
                i, 0, f"got {line.strip()[:60]!r}, expected NAME, date, time and value"
            )
        names[match["name"]] = None
        value = parse_number(match["value"])
        if value is None or not np.isfinite(value):
            skipped += 1
            continue
        posts.setdefault(match["name"], []).append((_seconds(source, i, match), value, i + 1))
    return posts, list(names), skipped


def _seconds(source: Source, line: int, match: re.Match[str]) -> float:
    whole, _, part = match["time"].partition(".")
    try:
        return (datetime.fromisoformat(whole) - _EPOCH).total_seconds() + float(f"0.{part}")
    except ValueError as error:
        raise source.error(line, match.start("time"), f"got {match['time']!r}: {error}") from None


def _merged(source: Source, series: Mapping[str, Floats], skipped: int) -> Channels:
    """Return the channels at the times of the one that is posted most."""
    leader = max(series, key=lambda name: len(series[name]))
    begin = max(s[0, 0] for s in series.values())
    end = min(s[-1, 0] for s in series.values())
    lead = series[leader]
    lead = lead[np.append(True, np.diff(lead[:, 0]) > 0)]
    lead = lead[(lead[:, 0] >= begin) & (lead[:, 0] <= end)]
    if len(lead) < 2:
        raise source.error(
            0, 0, f"got {', '.join(series)} posted at no common time, expected an overlap"
        )
    notes = [
        f"{name}: interpolated linearly to the times of {leader}; "
        f"up to {np.diff(s[:, 0]).max():.3g} s between two posts."
        for name, s in series.items()
        if name != leader
    ]
    if skipped:
        notes.append(f"{skipped} lines without a number were left out.")
    time = lead[:, 0] - lead[0, 0]
    return Channels(
        {n: np.interp(lead[:, 0], s[:, 0], s[:, 1]) for n, s in series.items()},
        lead[:, 2].astype(int).tolist(),
        time_s=time,
        clock=f"time stamps of {leader}, from its first post in common",
        notes=tuple(notes),
    )
