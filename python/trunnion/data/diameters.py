"""Diameters of a turned part: ``diameters.csv``. The overhang is in the set-up file."""

from os import PathLike

import numpy as np

from trunnion.files.columns import (
    ColumnError,
    Number,
    OptionalInteger,
    OptionalLabel,
    OptionalNumber,
)
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table

BEFORE_S = 1e-3
"""How far before the cut a time may be by rounding."""


class Diameters(Table):
    """Errors of a turned diameter along the part.

    The label of the pass is the attribute `pass_`, as ``pass`` is a word of Python; the column is
    ``pass``, in a file and in a mapping.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.Diameters(z_mm=[10, 20, 30], error_um=[1.0, 2.1, 2.9]).error_um
    array([1. , 2.1, 2.9])
    """

    in_order = False
    clock = "pass"

    z_mm = Number("position along the part, from the chuck face outward", commanded=True)
    error_um = Number("measured minus nominal diameter", observed=True)
    pass_ = OptionalLabel("which pass of the tool")
    time_s = OptionalNumber("cutting time within the pass")
    feed_sign = OptionalInteger("direction of feed, -1 towards the chuck", among=(-1, 1))
    depth_mm = OptionalNumber("depth of cut", minimum=0.0)
    diameter_mm = OptionalNumber("nominal diameter", positive=True)
    spindle_rpm = OptionalNumber("speed of the spindle", minimum=0.0)
    coolant = OptionalLabel("class of cooling, such as on and off")

    def _check(self) -> None:
        before = np.zeros(0) if self.time_s is None else self.time_s < -BEFORE_S
        if before.any():
            row = int(np.argmax(before))
            got = f"{self.columns['time_s'][row]:g}"
            raise ColumnError("time_s", row, got, "the cutting time within the pass, 0 or above")


def read_diameters(path: str | PathLike[str]) -> Diameters:
    """Read ``diameters.csv``: columns as in `Diameters`, any order.

    Raises
    ------
    FileFormatError
        If the file is not as it should be; the message has file, line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.read_diameters(tn.sample_path("turning/diameters.csv"))
    Diameters(111 rows: z_mm, error_um, pass, feed_sign, depth_mm)
    """
    return read_table(path, Diameters)
