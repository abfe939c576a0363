"""Commanded and actual axis positions over time: ``axislog.csv``.

The servo model (gain and time constant of each axis) is in the set-up file.
"""

from os import PathLike

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.units import Floats
from trunnion.files.columns import ColumnError, OptionalLabel, OptionalNumber, Time
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table

UNIT_OF_AXIS = {"x": "mm", "y": "mm", "z": "mm", "a": "deg", "b": "deg", "c": "deg"}


class AxisLog(Table):
    """Samples of the position loop, in order of time within each run.

    Every axis that is there has its commanded and its actual position.

    Examples
    --------
    >>> import trunnion as tn
    >>> log = tn.AxisLog(time_s=[0, 0.001], x_cmd_mm=[0, 0.01], x_act_mm=[0, 0.009])
    >>> log.commanded("x"), log.actual("x")
    (array([0.  , 0.01]), array([0.   , 0.009]))
    """

    slight_moves = True
    choice = "x_cmd_mm, x_act_mm or those of another axis"

    time_s = Time("time of the sample, rising within a run")
    x_cmd_mm = OptionalNumber("commanded X", commanded=True)
    x_act_mm = OptionalNumber("actual X", observed=True)
    y_cmd_mm = OptionalNumber("commanded Y", commanded=True)
    y_act_mm = OptionalNumber("actual Y", observed=True)
    z_cmd_mm = OptionalNumber("commanded Z", commanded=True)
    z_act_mm = OptionalNumber("actual Z", observed=True)
    a_cmd_deg = OptionalNumber("commanded A", commanded=True)
    a_act_deg = OptionalNumber("actual A", observed=True)
    b_cmd_deg = OptionalNumber("commanded B", commanded=True)
    b_act_deg = OptionalNumber("actual B", observed=True)
    c_cmd_deg = OptionalNumber("commanded C", commanded=True)
    c_act_deg = OptionalNumber("actual C", observed=True)
    run = OptionalLabel("which run of the program; rows of one run follow each other")
    tip_x_mm = OptionalNumber(
        "actual X of the tool point, measured in the frame of the table", observed=True
    )
    tip_y_mm = OptionalNumber("actual Y of the tool point", observed=True)
    tip_z_mm = OptionalNumber("actual Z of the tool point", observed=True)

    @property
    def axes(self) -> tuple[str, ...]:
        """Letters of the axes that the log has, in the order x y z a b c."""
        return tuple(axis for axis in UNIT_OF_AXIS if _name(axis, "cmd") in self.columns)

    @checked
    def commanded(self, axis: str) -> Floats:
        """Return the commanded positions of an axis, mm or deg."""
        return self.columns[_name(axis, "cmd")]

    @checked
    def actual(self, axis: str) -> Floats:
        """Return the actual positions of an axis, mm or deg."""
        return self.columns[_name(axis, "act")]

    def _check(self) -> None:
        for axis in UNIT_OF_AXIS:
            self.all_or_none(_name(axis, "cmd"), _name(axis, "act"))
        self.all_or_none("tip_x_mm", "tip_y_mm", "tip_z_mm")
        if not self.axes:
            raise ColumnError(
                "time_s",
                None,
                f"no axis among the columns {', '.join(self.columns)}",
                "x_cmd_mm and x_act_mm, or the pair of another axis",
            )
        same_run = np.ones(max(len(self) - 1, 0), dtype=bool)
        if self.run is not None:
            same_run = self.run[1:] == self.run[:-1]
        back = same_run & (np.diff(self.time_s) <= 0.0)
        if back.any():
            row = int(np.argmax(back)) + 1
            raise ColumnError(
                "time_s",
                row,
                f"{self.time_s[row]:.9g} after {self.time_s[row - 1]:.9g}",
                "a later time in each row of a run (column run: a label for each)",
            )


def _name(axis: str, what: str) -> str:
    return f"{axis}_{what}_{UNIT_OF_AXIS[axis]}"


def read_axis_log(path: str | PathLike[str]) -> AxisLog:
    """Read ``axislog.csv``: columns as in `AxisLog`, any order.

    Raises
    ------
    FileFormatError
        If the file is not as it should be; the message has file, line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.read_axis_log(tn.sample_path("contour/axislog.csv")).axes
    ('x', 'y', 'z', 'a', 'c')
    """
    return read_table(path, AxisLog)
