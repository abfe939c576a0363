"""Points that linear axes made or approached, measured outside the machine: ``points.csv``."""

from os import PathLike

from trunnion.base.units import Floats
from trunnion.files.columns import Number, OptionalLabel, OptionalNumber, OptionalTime, stack
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table


class Points(Table):
    """Nominal and measured coordinates, mm, in the plane (X, Y) or in space (X, Y, Z).

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.Points(nominal_x_mm=[0, 10], nominal_y_mm=[0, 0], x_mm=[0, 10.01], y_mm=[0, 0])
    Points(2 rows: nominal_x_mm, nominal_y_mm, x_mm, y_mm)
    """

    nominal_x_mm = Number("programmed X", commanded=True)
    nominal_y_mm = Number("programmed Y", commanded=True)
    nominal_z_mm = OptionalNumber("programmed Z", commanded=True)
    x_mm = Number("measured X", observed=True)
    y_mm = Number("measured Y", observed=True)
    z_mm = OptionalNumber("measured Z", observed=True)
    time_s = OptionalTime("time since the start, of making or approaching the point")
    group = OptionalLabel("set-up of the part on the instrument, one rigid placement each")

    @property
    def dimension(self) -> int:
        """2 for points in the plane, 3 in space."""
        return 2 if self.z_mm is None else 3

    @property
    def nominal_mm(self) -> Floats:
        """Programmed coordinates, (n, 2) or (n, 3)."""
        return stack(self.nominal_x_mm, self.nominal_y_mm, self.nominal_z_mm)

    @property
    def measured_mm(self) -> Floats:
        """Measured coordinates, (n, 2) or (n, 3)."""
        return stack(self.x_mm, self.y_mm, self.z_mm)

    def _check(self) -> None:
        self.all_or_none("nominal_z_mm", "z_mm")


def read_points(path: str | PathLike[str]) -> Points:
    """Read ``points.csv``: columns as in `Points`, any order.

    Raises
    ------
    FileFormatError
        If the file is not as it should be; the message has file, line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> len(tn.read_points(tn.sample_path("plate/first.csv")))
    90
    """
    return read_table(path, Points)
