"""Times in another unit than s, known by the feed, or by how fast stops follow each other."""

from __future__ import annotations

from typing import Any

import numpy as np

from trunnion.base.report import rough
from trunnion.base.units import Floats, Integers
from trunnion.data.ballbar import Ballbar
from trunnion.data.levels import Levels
from trunnion.data.positioning import Positioning
from trunnion.files.table import Table

CONTRADICTS = 3.0
"""Speed over feed: so much slower or faster is no override and no acceleration."""
NEAR = 0.15
"""Of a factor between units, that a ratio differs by."""
OTHER = {
    1e-6: "is time_s in µs?",
    1e-3: "is time_s in ms, or the feed 1000 times too large?",
    1 / 25.4: "is the feed in mm/min, taken for inches?",
    25.4: "is the feed in inch/min?",
    60.0: "is time_s in min, or the feed in mm/s?",
    1e3: "is the feed in m/min?",
    3600.0: "is time_s in h?",
    86400.0: "is time_s in days, as a spreadsheet keeps times?",
}
"""Speed over feed, and what makes it so."""
MIN_STOP_S, MAX_STOP_S = 0.5, 1800.0
"""From stop to stop: an axis goes there, stands and is read; nobody waits for half an hour."""
MIN_STOPS = 8
STOPS = (Positioning, Levels)
"""Kinds that are read at rest."""


def pace_doubts(data: Any) -> tuple[str, ...]:
    """Ask whether times are in another unit; empty: nothing is doubtful, or no times."""
    time = data.columns.get("time_s") if isinstance(data, Table) else None
    if time is None or len(time) < MIN_STOPS or not np.ptp(time):
        return ()
    if isinstance(data, Ballbar):
        text = _against_feed(data, np.asarray(time, dtype=np.float64))
    elif isinstance(data, STOPS):
        text = _of_stops(np.asarray(time, dtype=np.float64))
    else:
        text = ""
    return (text,) if text else ()


def _against_feed(data: Ballbar, time: Floats) -> str:
    """Compare what the tool goes in the times with the feed."""
    feed, position = data.columns.get("feed_mm_min"), data.position_mm
    if feed is None or position is None:
        return ""
    rows = _in_one_run(data, time)
    passed = time[rows + 1] - time[rows]
    way = np.linalg.norm(position[rows + 1] - position[rows], axis=1)
    stated = np.asarray(feed, dtype=np.float64)[rows] / 60.0
    moves = (passed > 0) & (way > 0) & (stated > 0)
    if np.sum(moves) < MIN_STOPS:
        return ""
    ratio = float(np.median(way[moves] / passed[moves] / stated[moves]))
    if 1 / CONTRADICTS < ratio < CONTRADICTS:
        return ""
    why = next((text for f, text in OTHER.items() if abs(ratio / f - 1) < NEAR), "")
    gone = rough(60.0 * float(np.median(way[moves] / passed[moves])))
    said = rough(60.0 * float(np.median(stated[moves])))
    return (
        f"time_s and feed_mm_min contradict each other: by its times the tool goes at {gone} "
        f"mm/min, by feed_mm_min at {said} mm/min{': ' + why if why else '.'}"
    )


def _in_one_run(data: Ballbar, time: Floats) -> Integers:
    """Rows whose next one is of the same set-up and sense, and later."""
    same = np.diff(time) > 0
    for name in ("setup", "sense", "run"):
        column = data.columns.get(name)
        if column is not None:
            same &= column[1:] == column[:-1]
    return np.asarray(np.flatnonzero(same), dtype=np.intp)


def _of_stops(time: Floats) -> str:
    """Ask about stops that follow each other faster or slower than they are made."""
    apart = np.diff(np.sort(time))
    apart = apart[apart > 0]
    usual = float(np.median(apart)) if len(apart) >= MIN_STOPS - 1 else MIN_STOP_S
    if usual < MIN_STOP_S:
        days = usual * 86400.0 < MAX_STOP_S
        asked = "days, as a spreadsheet keeps times" if days else "min or h"
        return (
            f"time_s: stops are {usual:.2g} s apart (median), less than an axis takes to go there "
            f"and stand: are these times in {asked}? Drifts would be wrong by the same factor."
        )
    if usual > MAX_STOP_S:
        return (
            f"time_s: stops are {usual / 60.0:.3g} min apart (median): are these times in ms? "
            "Drifts would be wrong by the same factor."
        )
    return ""
