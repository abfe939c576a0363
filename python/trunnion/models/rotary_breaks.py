"""What moves in a break of a test of rotary axes.

Tool and ball shift from each other along X, Y or Z of the machine (a spindle, column or nest that
was warm before and cold after), a rotary axis on the axis that carries it, or the ball on the
table. Candidates are those that no place of a ball and no location error makes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.effect import Effect
from trunnion.diagnosis.neighbours import orthonormal
from trunnion.models.breaks import ZERO, breaks_of, shift_from
from trunnion.models.slips import SLIP
from trunnion.probing.rotary_readings import OFFSETS

MIN_LEFT = 1e-2
"""Of a shift, rms over the readings: what places of balls, location errors and other shifts leave.

A bar shows what moves it across in second order, which is no information.
"""
_WAY = "shift along {} between tool and ball in a break of the measurement"
_AXIS = "shift of the {} axis on the axis that carries it, in a break of the measurement"
_BALL = "shift of the ball on the table in a break of the measurement"


@dataclass(frozen=True, eq=False)
class Shifts:
    """Shifts of tool, axes and ball in a test.

    Attributes
    ----------
    time_s
        Of each row.
    each
        Readings of a row.
    fitted
        What is always fitted: derivatives, (readings, unknowns).
    """

    time_s: Floats
    each: int
    fitted: Floats

    def effects(
        self, ways: Mapping[str, Floats], carried: Mapping[str, Floats], table: Floats
    ) -> Iterator[Effect]:
        """Yield the candidates.

        ways: Columns of a displacement of the tool along each axis, by its letter. carried:
        Those of location errors of rotary axes, by their codes. table: Of the ball that moves along
        X, Y and Z of the table, (readings, 3).
        """
        sizes = [
            (f"zero_shift_{x}", ZERO, column, _WAY.format(x.upper())) for x, column in ways.items()
        ]
        sizes += [
            (f"location_shift_{code[-1].lower()}", f"{code}_um", column, _AXIS.format(code[-1]))
            for code, column in carried.items()
        ]
        sizes += [
            (SLIP, name, column, _BALL) for name, column in zip(OFFSETS, table.T, strict=True)
        ]
        columns = [column for _, _, column, _ in sizes]
        shown = [(t, self._shown(columns, t)) for t in breaks_of(self.time_s)]
        for id_, label in {id_: label for id_, _, _, label in sizes}.items():
            mine = [k for k, size in enumerate(sizes) if size[0] == id_]
            some = [k for k in mine if any(k in those for _, those in shown)]
            moments = [t for t, those in shown if some and those.issuperset(some)]
            if moments:
                names = [sizes[k][1] for k in some]
                enters = np.column_stack([sizes[k][2] for k in some])
                when = np.repeat(self.time_s, self.each)
                yield shift_from(id_, names, enters, when, moments, "t0_s", label)

    def _shown(self, columns: Sequence[Floats], moment: float) -> set[int]:
        """Which of some columns, from a moment on, are none of those before and what is fitted."""
        after = np.repeat(self.time_s > moment, self.each)
        kept, rank = orthonormal(self.fitted)
        kept, shown = kept[:, :rank], set[int]()
        for number, column in enumerate(columns):
            later = np.where(after, column, 0.0)
            left = later - kept @ (kept.T @ later)
            left -= kept @ (kept.T @ left)
            size = float(np.linalg.norm(left))
            if size > MIN_LEFT * np.sqrt(np.count_nonzero(after)):
                shown.add(number)
                kept = np.column_stack([kept, left / size])
        return shown
