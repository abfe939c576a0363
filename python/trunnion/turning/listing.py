"""What a corrected listing says of the error behind it: where it crossed (k ± 1/2) units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trunnion._core import Program
from trunnion.base.arguments import checked
from trunnion.base.checks import finite, positive
from trunnion.base.errors import DataError
from trunnion.base.report import Result, Table
from trunnion.nc import follow


@dataclass(frozen=True, eq=False, repr=False)
class Crossing(Result):
    """The window mean passed a half unit between two windows.

    Attributes
    ----------
    z_mm : tuple of float
        Middle of the window before and of the window at which it had passed.
    level_um : float
        What it passed, on the diameter.
    """

    z_mm: tuple[float, float]
    level_um: float

    def sentences(self) -> Sequence[str]:
        """Where, and at which level."""
        before, after = self.z_mm
        return (f"{self.level_um:g} µm passed between z {before:.3f} and {after:.3f} mm.",)

    def tables(self) -> tuple[Table, ...]:
        """One row."""
        columns = ("", "from z mm", "to z mm", "level µm")
        return (Table.of("Crossing", columns, [("1", *self.z_mm, self.level_um)], digits=3),)


@checked
def crossings(
    listing: Program,
    *,
    unit_um: float,
    window_mm: float,
    nominal_mm: float,
    machine_codes: Sequence[tuple[str, float]] = (),
) -> tuple[Crossing, ...]:
    """Read the crossings out of a listing corrected on one cylinder by the paper's rule.

    A block that changes X by one unit stands at the middle of the first window of the new k: the
    mean lay on one side of the half unit in the window before and on the other in this one. The end
    of the line has the last window's k; where that window stood is not in the listing, and a
    change there gives no crossing.

    Parameters
    ----------
    listing
        The corrected program.
    unit_um
        CU.
    window_mm
        Distance from window to window, N times the pitch of the readings.
    nominal_mm
        Diameter of the cylinder.

    Raises
    ------
    trunnion.DataError
        If a block changes by other than one unit.
    """
    positive("unit_um", unit_um)
    moves = follow(listing, machine_codes=machine_codes)
    found: list[Crossing] = []
    before = 0
    runs = (moves.code == 1) & (moves.start[:, 2] != moves.end[:, 2])
    places = np.flatnonzero(runs)
    for place in places[:-1]:
        diameter = 2 * moves.end[place, 0]
        k = round(finite("units of unit_um", (nominal_mm - diameter) * 1e3 / unit_um))
        if abs(k - before) > 1:
            raise DataError(
                f"line {moves.line[place]}: got a change of {k - before} units, expected one: the "
                "readings between are not in the listing"
            )
        if k != before:
            z = float(moves.end[place, 2])
            found.append(Crossing((z + window_mm, z), (k + before) / 2 * unit_um))
        before = k
    return tuple(found)
