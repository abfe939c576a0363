"""Part programs of numerical controls: read, written, followed.

Dialects: ``"paper-um"`` (whole numbers in µm, X a diameter: Figs. 12 and 14 of Park and Park 1990),
``"linuxcnc"`` (mill), ``"linuxcnc-lathe"``, ``"fanuc-lathe"`` (G-code system A).

>>> program = Program.from_blocks("linuxcnc", [
...     [("G", 21), ("G", 90)],
...     "PROBEOPEN touches.txt",
...     [("G", 38.2), ("X", 12.5), ("F", 600)],
... ])
>>> print(program.text(), end="")
G21 G90
(PROBEOPEN touches.txt)
G38.2 X12.5 F600
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from trunnion._core import Program
from trunnion.base.arguments import checked
from trunnion.base.units import Floats

__all__ = ["DIALECTS", "Moves", "Program", "follow"]

DIALECTS = ("paper-um", "linuxcnc", "linuxcnc-lathe", "fanuc-lathe")

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Moves:
    """The moves of a program, one row each, as the control would make them.

    Positions are X (radius on a lathe), Y, Z in mm and A, B, C in degrees.

    Attributes
    ----------
    begin : ndarray, shape (6,)
        Where the moves begin: the start given, or the first place at which every axis that the
        program names has been commanded. Axes it never names are 0.
    start, end : ndarray, shape (n, 6)
        Ends of each move.
    code : ndarray of int, shape (n,)
        0 rapid, 1 straight at feed, 2 clockwise arc, 3 counter-clockwise arc, 38 probing.
    plane : ndarray of int, shape (n,)
        17 (X to Y), 18 (Z to X), 19 (Y to Z) on arcs, else 0.
    centre_mm : ndarray, shape (n, 2)
        Centre of an arc, first and second axis of its plane; 0 on other moves.
    feed : ndarray, shape (n,)
        mm/min, mm/rev or 1/min; 0 on rapids.
    feed_mode : ndarray of int, shape (n,)
        93 moves a minute, 94 mm a minute, 95 mm a revolution.
    side : ndarray of int, shape (n,)
        40 none, 41 tool left of the contour, 42 right.
    block, line, column : ndarray of int, shape (n,)
        Index of the block, and where it stood in the file.
    """

    begin: Floats
    start: Floats
    end: Floats
    code: IntArray
    plane: IntArray
    centre_mm: Floats
    feed: Floats
    feed_mode: IntArray
    side: IntArray
    block: IntArray
    line: IntArray
    column: IntArray

    def __len__(self) -> int:
        return len(self.code)


@checked
def follow(
    program: Program,
    *,
    blocks: tuple[int, int] | None = None,
    start: tuple[float, float, float, float, float, float] | None = None,
    feed: float | None = None,
    machine_codes: Sequence[tuple[str, float]] = (),
) -> Moves:
    """Follow a program as its control would.

    Parameters
    ----------
    program
        The program.
    blocks
        First block and the one behind the last, counted from 0; modes are taken from the blocks
        before. By default all, up to M2 or M30. ``program.contour_blocks()`` gives the finishing
        contour of a G71 P Q.
    start
        X, Y, Z (mm), A, B, C (degrees) before the first block, if known.
    feed
        Feed in force before the first block, if one is set outside the program.
    machine_codes
        Codes of this machine that move no axis, such as ``("G", 4503)``.

    Raises
    ------
    trunnion.ProgramError
        With line and column, for whatever cannot be followed for certain: unknown codes and
        addresses, feed moves without a feed or from an unknown place, arcs without radius or that
        do not close, cycles, subprograms, shifts of the origin.
    """
    span: Any = None if blocks is None else tuple(blocks)  # a list will do
    got: dict[str, Any] = program.path(
        blocks=span,
        start=start,
        feed=feed,
        machine_codes=list(machine_codes),
    )
    return Moves(
        begin=got["begin"],
        start=got["start"],
        end=got["end"],
        code=got["code"],
        plane=got["plane"],
        centre_mm=got["centre"],
        feed=got["feed"],
        feed_mode=got["feed_mode"],
        side=got["side"],
        block=got["block"].astype(np.int64),
        line=got["line"],
        column=got["column"],
    )
