"""Targets on a turning axis, measured by an instrument at rest: ``sweep.csv``."""

from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np

from trunnion.base.units import Floats
from trunnion.files.columns import Label, Number, OptionalTime, stack
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table

MIN_COMMON = 3
"""Places of targets that say how one sweep is turned to another."""
SAME_SHAPE = 1e-3
"""Of the size of all places: what two sweeps of the same targets differ by, once turned."""
MIN_TURN_DEG = 1.0
"""By less an instrument is turned without making more than a few hundredths of an error another."""
ANGLE_DIGITS = 3


class Sweep(Table):
    """Position of each target at each angle of the axis that carries them all.

    Examples
    --------
    >>> import trunnion as tn
    >>> import numpy as np
    >>> angle = np.arange(0.0, 360.0, 30.0)
    >>> x, y = 100 * np.cos(np.radians(angle)), 100 * np.sin(np.radians(angle))
    >>> tn.Sweep(angle_deg=angle, target=["ball"] * 12, x_mm=x, y_mm=y, z_mm=0 * x)
    Sweep(12 rows: angle_deg, target, x_mm, y_mm, z_mm)
    """

    angle_deg = Number("commanded position of the axis", commanded=True)
    target = Label("which target, fixed to the axis")
    x_mm = Number("measured X, instrument frame", observed=True)
    y_mm = Number("measured Y, instrument frame", observed=True)
    z_mm = Number("measured Z, instrument frame", observed=True)
    time_s = OptionalTime("time since the start")

    @property
    def position_mm(self) -> Floats:
        """Measured positions, instrument frame, (n, 3)."""
        return stack(self.x_mm, self.y_mm, self.z_mm)

    def done_otherwise(self, other: "Sweep", names: Sequence[str]) -> str:
        """Say that targets of another sweep lie as these do, but turned; empty: they do not.

        names: Of both.
        """
        mine, theirs = self._places(), other._places()
        common = sorted(mine.keys() & theirs.keys(), key=str)
        if len(common) < MIN_COMMON:
            return ""
        one, two = (np.array([places[key] for key in common]) for places in (mine, theirs))
        one, two = one - one.mean(axis=0), two - two.mean(axis=0)
        left, size, right = np.linalg.svd(two.T @ one)
        if size[1] < SAME_SHAPE * size[0]:  # on one line
            return ""
        turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        off_mm, size_mm = (np.sqrt(np.mean(x**2) * 3) for x in (two - one @ turn.T, one))
        vector = np.array(
            [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        )
        angle = np.degrees(np.arctan2(np.linalg.norm(vector), np.trace(turn) - 1.0))
        if off_mm > SAME_SHAPE * size_mm or angle < MIN_TURN_DEG:
            return ""
        return (
            f"The targets of {names[1]} lie as those of {names[0]}, turned by {angle:.3g} deg in "
            f"the instrument's frame (to {1e3 * off_mm:.2g} µm): was the instrument turned, or its "
            "frame aligned otherwise, or were the targets mounted turned? Error motions are along "
            "X, Y and Z of the instrument: in another frame the same machine looks changed."
        )

    def _places(self) -> dict[tuple[float, Any], Floats]:
        """Mean place of each target at each angle, instrument frame, (3,), mm."""
        keys = zip(
            np.round(self.angle_deg, ANGLE_DIGITS).tolist(), self.target.tolist(), strict=True
        )
        rows: dict[tuple[float, Any], list[int]] = {}
        for row, key in enumerate(keys):
            rows.setdefault(key, []).append(row)
        return {key: self.position_mm[some].mean(axis=0) for key, some in rows.items()}


def read_sweep(path: str | PathLike[str]) -> Sweep:
    """Read ``sweep.csv``: columns as in `Sweep`, any order.

    Raises
    ------
    FileFormatError
        If the file is not as it should be; the message has file, line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> sorted(set(tn.read_sweep(tn.sample_path("axis/sweep.csv")).target.tolist()))
    [1, 2, 3]
    """
    return read_table(path, Sweep)
