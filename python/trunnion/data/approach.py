"""Whether the sense of approach of an axis' stops is what the order of its targets shows."""

import numpy as np

from trunnion.data.positioning import Positioning

MIN_STEPS = 4
"""From target to target in either sense, that say which way the axis went."""


def approach_doubts(data: Positioning) -> list[str]:
    """Ask about a sense of approach that is the other one in every pass, else nothing.

    From stop to stop of a pass the axis goes the way that it approaches. A run with steps back
    (ISO 230-2, pilgrim steps) has none of one sense, and rows in order of the targets agree in one.
    """
    rows = data.in_time
    step = np.diff(data.target[rows])
    sense, cycle = data.direction[rows], data.cycle[rows]
    same = (sense[1:] == sense[:-1]) & (cycle[1:] == cycle[:-1]) & (step != 0)
    along = np.sign(step[same]) * sense[1:][same]
    enough = all(np.sum(sense[1:][same] == one) >= MIN_STEPS for one in (1, -1))
    if not enough or np.any(along > 0):
        return []
    return [
        "direction: the targets fall in every pass with direction 1 and rise in every pass with "
        "-1. Is its sign the other one? A reversal (backlash) has the other sign then."
    ]
