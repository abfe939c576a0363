"""A ball on the table that the tool follows while rotary axes turn: ``rotary_test.csv``."""

from collections.abc import Mapping
from os import PathLike

from trunnion.base.units import Floats
from trunnion.data.touches import by_axis
from trunnion.files.columns import (
    ColumnError,
    Number,
    OptionalLabel,
    OptionalNumber,
    OptionalTime,
    stack,
)
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table

READINGS = ("dx_um", "dy_um", "dz_um")


class RotaryTest(Table):
    """Readings of an R-test (`dx_um`, `dy_um`, `dz_um`) or of a ball-bar (`length_mm`).

    The linear axes follow the ball as the rotary axes turn, as in the interpolation tests of ISO
    10791-6. A plan has no readings.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.RotaryTest(a_deg=[0.0], c_deg=[90.0], x_mm=[0.0], y_mm=[100.0], z_mm=[50.0],
    ...               dx_um=[1.2], dy_um=[-0.4], dz_um=[0.0])
    RotaryTest(1 row: a_deg, c_deg, x_mm, y_mm, z_mm, dx_um, dy_um, dz_um)
    """

    smallest_mm = 12.0  # a ball on a stem stands farther from where the axes meet
    vector = READINGS
    choice = "those of a_deg, b_deg, c_deg whose axes the machine has"

    a_deg = OptionalNumber("commanded position of the A axis, deg", commanded=True)
    b_deg = OptionalNumber("commanded position of the B axis, deg", commanded=True)
    c_deg = OptionalNumber("commanded position of the C axis, deg", commanded=True)
    x_mm = Number("commanded position of the X axis", commanded=True)
    y_mm = Number("commanded position of the Y axis", commanded=True)
    z_mm = Number("commanded position of the Z axis", commanded=True)
    ball = OptionalLabel("which place of the ball on the table; one place without it")
    dx_um = OptionalNumber(
        "R-test: centre of the ball minus that of the sensors, machine's X", observed=True
    )
    dy_um = OptionalNumber("R-test: the same along the machine's Y", observed=True)
    dz_um = OptionalNumber("R-test: the same along the machine's Z", observed=True)
    length_mm = OptionalNumber(
        "ball-bar: distance of ball and tool's point", positive=True, observed=True
    )
    time_s = OptionalTime("time since the start")

    @property
    def position_mm(self) -> Floats:
        """Commanded positions of X, Y and Z, (n, 3)."""
        return stack(self.x_mm, self.y_mm, self.z_mm)

    @property
    def displacement_um(self) -> Floats | None:
        """Readings of the R-test, machine frame, (n, 3); None without them."""
        return stack(*(self.columns[name] for name in READINGS)) if self.dx_um is not None else None

    @property
    def rotary_deg(self) -> Mapping[str, Floats]:
        """Commanded positions of the rotary axes that the data have, by letter: a, b, c."""
        return by_axis(self, "deg")

    def _check(self) -> None:
        self.all_or_none(*READINGS)
        if self.dx_um is not None and self.length_mm is not None:
            got = "readings of an R-test and of a ball-bar"
            raise ColumnError("length_mm", None, got, f"{', '.join(READINGS)} or length_mm")


def read_rotary_test(path: str | PathLike[str]) -> RotaryTest:
    """Read ``rotary_test.csv``: columns as in `RotaryTest`, any order.

    Raises
    ------
    FileFormatError
        If the file is not as it should be; the message has file, line and column.

    Examples
    --------
    >>> import trunnion as tn, tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "rotary_test.csv"
    >>> tn.RotaryTest(c_deg=[0], x_mm=[1], y_mm=[2], z_mm=[3], length_mm=[100.0012]).to_csv(file)
    >>> tn.read_rotary_test(file).length_mm
    array([100.0012])
    """
    return read_table(path, RotaryTest)
