"""Targets on a turning axis, measured by an instrument at rest: ``sweep.csv``."""

from os import PathLike

from trunnion.base.units import Floats
from trunnion.files.columns import Label, Number, OptionalTime, stack
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table


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
