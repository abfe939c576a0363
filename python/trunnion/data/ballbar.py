"""Lengths of a ball-bar: ``ballbar.csv``."""

from os import PathLike

from trunnion.base.units import Floats
from trunnion.files.columns import (
    ColumnError,
    Label,
    Number,
    OptionalInteger,
    OptionalNumber,
    OptionalTime,
    stack,
)
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table

JOINTS = ("l1_mm", "l2_mm", "l3_mm", "q4_deg", "q5_deg")


class Ballbar(Table):
    """Measured lengths with the commanded positions of the ball on the spindle side.

    The positions are coordinates (X and Y, or X, Y and Z) or the joints of the hybrid machine: leg
    lengths `l1_mm` to `l3_mm`, wrist angles `q4_deg` and `q5_deg`.

    Examples
    --------
    >>> import trunnion as tn
    >>> test = tn.read_ballbar(tn.sample_path("ballbar/circle.csv"))
    >>> test[test.sense > 0].length_mm[:2].round(3)
    array([99.984, 99.984])
    """

    choice = "x_mm, y_mm[, z_mm] or l1_mm, l2_mm, l3_mm, q4_deg, q5_deg"

    setup = Label("set-up, one unknown centre of the fixed ball each")
    x_mm = OptionalNumber("commanded X", commanded=True)
    y_mm = OptionalNumber("commanded Y", commanded=True)
    z_mm = OptionalNumber("commanded Z", commanded=True)
    l1_mm = OptionalNumber("commanded length of leg 1", commanded=True)
    l2_mm = OptionalNumber("commanded length of leg 2", commanded=True)
    l3_mm = OptionalNumber("commanded length of leg 3", commanded=True)
    q4_deg = OptionalNumber("commanded angle of wrist joint 4", commanded=True)
    q5_deg = OptionalNumber("commanded angle of wrist joint 5", commanded=True)
    length_mm = Number("measured distance of the two balls", positive=True, observed=True)
    sense = OptionalInteger(
        "direction of travel, in which the rows stand, +1 counter-clockwise", among=(-1, 1)
    )
    feed_mm_min = OptionalNumber("feed", positive=True)
    time_s = OptionalTime("time since the start")

    @property
    def position_mm(self) -> Floats | None:
        """Commanded coordinates, (n, 2) or (n, 3); None where the joints are commanded."""
        x, y = self.x_mm, self.y_mm
        return None if x is None or y is None else stack(x, y, self.z_mm)

    @property
    def joints(self) -> Floats | None:
        """Commanded joints, (n, 5): three lengths in mm, two angles in deg; None without them."""
        columns = [self.columns[name] for name in JOINTS if name in self.columns]
        return stack(*columns) if columns else None

    def _check(self) -> None:
        self.all_or_none("x_mm", "y_mm")
        self.all_or_none(*JOINTS)
        if self.z_mm is not None and self.x_mm is None:
            raise ColumnError("z_mm", None, "no column x_mm", "x_mm and y_mm with it")
        if self.x_mm is None and self.l1_mm is None:
            raise ColumnError(
                "setup",
                None,
                f"no commanded position among the columns {', '.join(self.columns)}",
                f"x_mm and y_mm, or {', '.join(JOINTS)}",
            )


def read_ballbar(path: str | PathLike[str]) -> Ballbar:
    """Read ``ballbar.csv``: columns as in `Ballbar`, any order.

    Raises
    ------
    FileFormatError
        If the file is not as it should be; the message has file, line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> len(tn.read_ballbar(tn.sample_path("ballbar/circle.csv")))
    720
    """
    return read_table(path, Ballbar)
