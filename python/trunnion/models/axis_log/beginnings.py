"""How the runs of an axis log begin: at rest, or in motion as windows of longer logs do.

Of an axis in motion the play is taken up once it has gone some way in one direction. It turns later
than its command, by 1/K: just after a reversal the play may be taken up the other way, or be
crossed, and nothing in the log says how far. Such rows are left out. An axis that stands or starts
at the first row keeps all of its rows.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from trunnion.base.units import Flags, Floats
from trunnion.contouring.servo import Servo

if TYPE_CHECKING:
    from trunnion.models.axis_log.signals import Run

MIN_SAMPLES = 20  # of a run
BEGINNING = 9  # rows, from which a state is taken
MOVING = 10.0  # µm or arcsec behind its command, from which on the recorded speed is taken
TAKEN_UP = 25.0  # µm or arcsec in one direction, by which an axis has taken up its play
MAX_LEFT_OUT = 0.5  # of a run
START_SHARE = 0.5  # of a step, of which the one before is less where an axis starts from rest


def settled(
    runs: Iterable["Run"], commanded: Mapping[str, Floats], servo: Servo
) -> tuple["Run", ...]:
    """Return runs from where each axis stands, starts or has its play taken up.

    A run without such a row in its first half is as it was. ``commanded``: letter → positions, µm
    or arcsec, shape (rows,).
    """
    return tuple(_settled(run, commanded, servo) for run in runs)


def _settled(run: "Run", commanded: Mapping[str, Floats], servo: Servo) -> "Run":
    most = min(int(MAX_LEFT_OUT * run.count), run.count - MIN_SAMPLES)
    known = np.ones(most + 1, dtype=bool)
    for letter, positions in commanded.items():
        own = positions[run.rows]
        if np.ptp(own) > TAKEN_UP:
            lag = 1.0 / (servo.axes[letter].gain_per_s * run.period_s)
            known &= _taken_up(own[: most + BEGINNING], lag)
    first = int(np.argmax(known)) if known.any() else 0
    return replace(run, rows=slice(run.rows.start + first, run.rows.stop), left_out=first)


def _taken_up(commands: Floats, lag: float) -> Flags:
    """Whether the play of an axis is taken up at a row, as far as this and the next 8 rows say.

    ``commands``: µm or arcsec, shape (rows,). ``lag``: rows by which the axis is late. Shape
    (rows - 8,); the first row counts, too, where the axis stands or starts there.
    """
    windows = sliding_window_view(commands, BEGINNING)
    half_rate, speed, _ = np.linalg.pinv(np.vander(np.arange(BEGINNING), 3)) @ windows.T
    rate = 2.0 * half_rate
    own_speed = speed - rate * lag
    # since it turned, if it gets faster: speed² / (2 rate)
    gone = (own_speed * rate <= 0) | (0.5 * own_speed**2 > TAKEN_UP * np.abs(rate))
    known = (speed * own_speed > 0) & gone
    known |= np.ptp(windows, axis=1) == 0
    known[0] |= _starts_from_rest(commands)
    return np.asarray(known)


def _starts_from_rest(commands: Floats) -> bool:
    """Whether the first commands are those of an axis that stands, or starts there."""
    step, after = np.abs(np.diff(commands[:3]))
    return bool(step <= START_SHARE * after)


def first_state(
    commanded: Floats, actual: Floats, period: float, lag: float, moving: float
) -> tuple[float, float]:
    """Return how far an axis is ahead of its first command and its speed: 0 where it is at rest.

    As recorded in its first rows. Noise would say the sense of a slow axis: less than ``moving``
    behind its command, it has the speed that the servo model says.

    ``commanded``, ``actual``, ``moving``: One unit of length or angle; the first two by row.
    ``period``, ``lag``: Time from row to row, and by which the axis is late, s.
    """
    if _starts_from_rest(commanded):
        return 0.0, 0.0
    time = period * np.arange(min(len(commanded), BEGINNING))
    half_rate, speed, _ = np.polyfit(time, commanded[:BEGINNING], 2)
    _, recorded, at = np.polyfit(time, actual[:BEGINNING] - commanded[0], 2)
    slow = abs(speed) * lag < moving
    return float(at), float(speed - 2.0 * half_rate * lag if slow else recorded)
