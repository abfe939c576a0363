"""Touches of a probe: ``touches.csv``; the plan of a measurement has the same columns."""

from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.data.frame import COLUMNS, SAME_FRAME_MM, ControlFrame, listed
from trunnion.files.columns import (
    ColumnError,
    Int,
    Number,
    OptionalInteger,
    OptionalLabel,
    OptionalNumber,
    OptionalTime,
    stack,
)
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table

ROTARY_AXES = ("a", "b", "c")
UNIT_TOLERANCE = 1e-6
BESIDE_MM = 0.5
"""How far a ball may be beside the line of its approach: no following error is so large."""


class Touches(Table):
    """Touches in the order of measurement, one row a touch.

    In a plan the position is where the ball centre is expected to be at the trigger, and
    `start_mm` where the approach begins.

    Examples
    --------
    >>> import trunnion as tn
    >>> touches = tn.Touches(a_deg=[0.0], c_deg=[90.0], x_mm=[1.0], y_mm=[2.0], z_mm=[26.0],
    ...                      dir_x=[0.0], dir_y=[0.0], dir_z=[-1.0], point=[1])
    >>> len(touches), touches.position_mm.shape, touches.feed_mm_min
    (1, (1, 3), None)
    """

    choice = "those of a_deg, b_deg, c_deg whose axes the machine has"

    a_deg = OptionalNumber("commanded position of the A axis, deg", commanded=True)
    b_deg = OptionalNumber("commanded position of the B axis, deg", commanded=True)
    c_deg = OptionalNumber("commanded position of the C axis, deg", commanded=True)
    x_mm = Number("recorded X of the ball centre at the trigger, machine frame", observed=True)
    y_mm = Number("recorded Y of the ball centre at the trigger, machine frame", observed=True)
    z_mm = Number("recorded Z of the ball centre at the trigger, machine frame", observed=True)
    dir_x = Number("X component of the unit approach direction, machine frame")
    dir_y = Number("Y component of the unit approach direction, machine frame")
    dir_z = Number("Z component of the unit approach direction, machine frame")
    cycle = OptionalLabel("which cycle of the plan the touch belongs to")
    point = OptionalInteger("label of the touched point, 1 to 20 in the paper's plan")
    feed_mm_min = OptionalNumber("feed of the approach", positive=True)
    time_s = OptionalTime("time of the touch; its clock may begin anywhere")
    a_dir = OptionalInteger("sense of A's last turn before the touch, 0 = none", among=(-1, 0, 1))
    b_dir = OptionalInteger("sense of B's last turn before the touch, 0 = none", among=(-1, 0, 1))
    c_dir = OptionalInteger("sense of C's last turn before the touch, 0 = none", among=(-1, 0, 1))
    start_x_mm = OptionalNumber("X of the ball centre at the start of the approach", commanded=True)
    start_y_mm = OptionalNumber("Y of the ball centre at the start of the approach", commanded=True)
    start_z_mm = OptionalNumber("Z of the ball centre at the start of the approach", commanded=True)
    wcs_x_mm = OptionalNumber("X of the work offset in machine coordinates, alike in all rows")
    wcs_y_mm = OptionalNumber("Y of the work offset in machine coordinates, alike in all rows")
    wcs_z_mm = OptionalNumber("Z of the work offset in machine coordinates, alike in all rows")
    wcs_a_deg = OptionalNumber("how far the work offset shifts A, alike in all rows")
    wcs_b_deg = OptionalNumber("how far the work offset shifts B, alike in all rows")
    wcs_c_deg = OptionalNumber("how far the work offset shifts C, alike in all rows")
    tool_length_mm = OptionalNumber("tool length in force, alike in all rows")
    control_corrected = OptionalInteger(
        "1: with the control's corrections on, 0: without, alike in all rows", among=(0, 1)
    )

    @cached_property
    def position_mm(self) -> Floats:
        """Ball centre at the trigger as recorded, machine frame, (n, 3)."""
        return stack(self.x_mm, self.y_mm, self.z_mm)

    @cached_property
    def direction(self) -> Floats:
        """Unit approach direction, machine frame, (n, 3)."""
        return stack(self.dir_x, self.dir_y, self.dir_z)

    @cached_property
    def start_mm(self) -> Floats | None:
        """Ball centre at the start of the approach, machine frame, (n, 3); None if not planned."""
        x, y, z = self.start_x_mm, self.start_y_mm, self.start_z_mm
        return None if x is None or y is None or z is None else stack(x, y, z)

    @cached_property
    def control_frame(self) -> ControlFrame | None:
        """Work offset, tool length and corrections of the control; None if nothing is said."""
        return ControlFrame.of_columns(self.columns) if len(self) else None

    @cached_property
    def rotary_deg(self) -> Mapping[str, Floats]:
        """Commanded positions of the rotary axes that the data have, by letter: a, b, c."""
        return by_axis(self, "deg")

    @cached_property
    def rotary_dir(self) -> Mapping[str, Int]:
        """Senses of the last turns that the data have, by the axis's letter: a, b, c."""
        return by_axis(self, "dir")

    def followed_by(self, later: "Touches") -> "Touches":
        """Put touches that were made later below these: one measurement, nothing having moved.

        Those of `next_touches` are meant so. Columns that only one of both has are left out.

        Raises
        ------
        InputError
            Their times begin before these end: expected are times of one clock. Or the control's
            frame was changed between them, or only one of both says it.

        Examples
        --------
        >>> import trunnion as tn
        >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
        >>> len(touches[:60].followed_by(touches[60:]))
        72
        """
        self._refuse_other_frame(later)
        both = (self, later)
        names = [name for name in self.columns if name in later.columns]
        parts = [one.with_columns(**dict.fromkeys({*one.columns} - {*names})) for one in both]
        if "time_s" in names and later["time_s"].min() < self["time_s"].max():
            raise InputError(
                f"time_s: got touches from {later['time_s'].min():g} s on that follow others up to "
                f"{self['time_s'].max():g} s, expected later ones of one clock: add the "
                "pause to their time_s"
            )
        return Touches.concatenate(parts)

    def _refuse_other_frame(self, later: "Touches") -> None:
        """Refuse touches of another frame than these, and a frame that only one of both says."""
        for one, other, which in ((self, later, "before"), (later, self, "that follow")):
            if lacking := [x for x in COLUMNS if x in other.columns and x not in one.columns]:
                file = f" ({' and '.join(one.origin.names)})" if one.origin else ""
                rest = "that follow" if which == "before" else "before"
                raise InputError(
                    f"{lacking[0]}: got none in the touches {which}{file}, expected the control's "
                    f"frame as in those {rest}: nothing is known of whether all were made in one. "
                    f"If it is known, add {', '.join(lacking)} there; if it is not, take these "
                    "columns out of the others"
                )
        first, then = self.control_frame or ControlFrame(), later.control_frame or ControlFrame()
        if found := first.differences(then):
            said = "{name}: got {after} in the touches that follow, expected {before} as in those "
            raise InputError(
                f"{listed(found, said + 'before')}: the control was changed between them, and they "
                "lie in two frames. Measure all of them with one work offset, tool length and "
                "kinematics"
            )

    def _check(self) -> None:
        for axis in self.rotary_dir:
            if axis not in self.rotary_deg:
                raise ColumnError(
                    f"{axis}_dir", None, f"no column {axis}_deg", "the axis's position too"
                )
        self.all_or_none("start_x_mm", "start_y_mm", "start_z_mm")
        self.all_or_none("wcs_x_mm", "wcs_y_mm", "wcs_z_mm")
        for name in (name for name in COLUMNS if name in self.columns):
            values = self.columns[name]
            other = np.abs(values - values[:1]) > SAME_FRAME_MM
            if other.any():
                row = int(np.argmax(other))
                raise ColumnError(
                    name,
                    row,
                    f"{values[row]:g}",
                    f"{values[0]:g} as in the first row: one measurement has one frame of the "
                    "control. Were two measurements put into one file?",
                )
        with np.errstate(over="ignore"):  # infinite is no unit length either
            length = np.sqrt(np.sum(self.direction**2, axis=1))
        bad = ~(np.abs(length - 1.0) <= UNIT_TOLERANCE)
        if bad.any():
            row = int(np.argmax(bad))
            x, y, z = self.direction[row].tolist()
            raise ColumnError(
                "dir_x",
                row,
                f"the approach direction ({x!r}, {y!r}, {z!r}) of length {length[row]:.9g}",
                f"a unit vector (to {UNIT_TOLERANCE:g})",
            )


def without_frame(touches: Touches) -> Touches:
    """Return touches that say no frame of the control, as those that none has made."""
    return touches.with_columns(**dict.fromkeys(COLUMNS))


def across_mm(way_mm: Floats, direction: Floats) -> Floats:
    """Return the part of ways that is across unit directions, both (n, 3); (n, 3)."""
    along = np.sum(way_mm * direction, axis=1, keepdims=True)
    return np.asarray(way_mm - along * direction)


def by_axis(data: Table, what: str) -> Mapping[str, NDArray[Any]]:
    """Return the columns that the data have of rotary axes (`a_deg`, ...), by letter: a, b, c."""
    names = {axis: f"{axis}_{what}" for axis in ROTARY_AXES}
    return MappingProxyType(
        {axis: data.columns[name] for axis, name in names.items() if name in data.columns}
    )


def read_touches(path: str | PathLike[str]) -> Touches:
    """Read ``touches.csv`` (measured touches, or a plan): columns as in `Touches`, any order.

    Raises
    ------
    FileFormatError
        If the file is not as it should be; the message has file, line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> len(touches)
    72
    >>> touches.x_mm[:2]
    array([ 0.    , 13.5795])
    """
    return read_table(path, Touches)
