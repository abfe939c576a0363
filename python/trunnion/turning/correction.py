"""Correction of a finishing program for a measured diameter error (section 3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from trunnion._core import Program, turning_change, turning_correct
from trunnion.base.arguments import checked
from trunnion.base.checks import floats, line, whole, within
from trunnion.base.errors import InputError
from trunnion.base.report import Result, Table
from trunnion.base.units import Flags, Floats
from trunnion.data.diameters import Diameters
from trunnion.turning.profile import Follows

Rule: TypeAlias = Literal["paper", "every-window", "mid-run", "bounded"]

LEAST_UNIT_UM = 1e-3
GAP_STEPS = 3.0  # a gap so many times as wide as readings are apart holds something unmeasured
PLACES_IN_A_GAP = 20


@dataclass(frozen=True, eq=False, repr=False)
class Correction(Result):
    """A corrected program and what it leaves of the error.

    Attributes
    ----------
    dialect, text, original_text : str
        The program after and before, in its dialect.
    inserted : ndarray of int
        Indices of the blocks put in, in the new program.
    window_z_mm, window_mean_um, window_k : ndarray
        The windows used: place of the middle reading, mean, mean in units.
    z_mm, error_um : ndarray, shape (n,)
        The readings, as given.
    remaining_um : ndarray, shape (n,)
        Error predicted at each reading if it repeats exactly: the reading plus the change of the
        diameter there, replayed from the text of the new program.
    covered : ndarray of bool, shape (n,)
        Does the program cut at this reading? Where not, the remaining error is the reading.
    between_z_mm, between_um : ndarray, shape (m,)
        Places between measured lines (curves, steep lines, gaps in the readings), and the error
        predicted there if it runs straight from window to window and repeats.
    bound_um : float or None
        No window mean is left with more; only the rule ``"bounded"`` has one. Between
        two means the error may leave their straight line by its own curvature, and so may what
        is left.
    """

    dialect: str
    text: str
    original_text: str
    rule: Rule
    unit_um: float
    window: int
    inserted: npt.NDArray[np.int64]
    window_z_mm: Floats
    window_mean_um: Floats
    window_k: npt.NDArray[np.int64]
    z_mm: Floats
    error_um: Floats
    remaining_um: Floats
    covered: Flags
    between_z_mm: Floats
    between_um: Floats
    bound_um: float | None

    GRID: ClassVar = {
        "window_mean_um": ("window_z_mm",),
        "window_k": ("window_z_mm",),
        "error_um": ("z_mm",),
        "remaining_um": ("z_mm",),
        "between_um": ("between_z_mm",),
    }

    @property
    def program(self) -> Program:
        """The corrected program."""
        return Program.parse(self.text, self.dialect)

    @property
    def original(self) -> Program:
        """The program before."""
        return Program.parse(self.original_text, self.dialect)

    def sentences(self) -> Sequence[str]:
        """Say what was done and what is left."""
        blocks = f"{len(self.inserted)} block{'s' if len(self.inserted) != 1 else ''}"
        lines = [
            f"{blocks} put in (rule {self.rule!r}, unit {self.unit_um:g} µm, windows of "
            f"{self.window}).",
        ]
        if self.bound_um is not None:
            lines.append(f"Bound: no window mean is left with more than {self.bound_um:.2f} µm.")
        if not self.covered.all():
            count = int((~self.covered).sum())
            lines.append(f"{count} readings lie where the program does not cut.")
        if len(self.between_um):
            lines.append(
                "Curves and steep lines are not measured: the correction runs linearly between "
                "the lines beside them."
            )
        return lines

    def tables(self) -> tuple[Table, ...]:
        """The error before, and what is left if it repeats."""
        on = self.covered
        rows = [
            _extent("before", self.error_um[on]),
            _extent("left if it repeats", self.remaining_um[on]),
        ]
        if len(self.between_um):
            rows.append(_extent("left where not measured", self.between_um))
        columns = ("", "least", "greatest", "rms")
        return (Table.of("Error of the diameter, µm", columns, rows, digits=2),)


def _extent(name: str, values: Floats) -> tuple[str, float, float, float]:
    rms = float(np.sqrt(np.mean(values**2)))
    return name, float(values.min()), float(values.max()), rms


@checked
def correct(
    program: Program,
    readings: Diameters | tuple[npt.ArrayLike, npt.ArrayLike],
    *,
    rule: Rule = "bounded",
    unit_um: float = 1.0,
    bound_um: float = 1.0,
    window: int = 5,
    look_ahead: bool = True,
    follows: Follows = "contour",
    nose_mm: float = 0.0,
    feed: float | None = None,
    machine_codes: Sequence[tuple[str, float]] = (),
    keep_numbers: bool = False,
) -> Correction:
    """Correct a finishing program so that the measured error does not come back.

    Readings are averaged over windows and the means rounded to whole units (k = trunc(mean/unit ±
    0.5), halves away from zero); X changes by -k units on the diameter. Rapids stay as they are,
    but one that ends above a plunge goes with it.

    Parameters
    ----------
    program
        In any lathe dialect, absolute positions. With a G71 P Q its finishing contour is corrected.
    readings
        `Diameters` of one pass, or (z_mm, error_um): place of contact from the chuck face, measured
        minus nominal diameter. Several readings at one z are averaged.
    rule
        Where blocks go. ``"paper"``: on a cylinder at the first window of every new k, on a cone at
        every window; the last window's k goes to the end of the line. ``"every-window"``.
        ``"mid-run"``: in the middle of every run of equal k. ``"bounded"``: the project's own, the
        fewest blocks that leave no window mean more than half a unit and `bound_um`.
    unit_um
        Smallest correction (CU of the paper: 10 µm).
    bound_um
        What the rule ``"bounded"`` may leave beyond half a unit.
    window
        Readings N in a window; the last of a line may have fewer.
    look_ahead
        For the paper's rules: the corner at which the first measured line begins has the k of its
        first block (Fig. 14) or, if False, none (Figs. 18 and 20).
    follows, nose_mm
        What the program holds, as in `Profile.from_program`; on cones the block that cuts at z then
        stands beside z. (Fig. 14 holds a nose centre but does not see to this.)
    feed, machine_codes
        As in `trunnion.nc.follow`.
    keep_numbers
        Leave N as it is. Otherwise, if every block is numbered evenly, all are numbered again.

    Raises
    ------
    trunnion.ProgramError
        With line and column, for a program that cannot be followed, or increments that would have
        to be corrected.
    trunnion.DataError
        If no reading lies on a feed move.
    trunnion.InputError
        For readings of several passes or numbers that are not usable.
    """
    z, error = _columns(readings)
    within("unit_um", unit_um, LEAST_UNIT_UM)
    within("bound_um", bound_um, 0.0)
    whole("window", window, 1)
    start: dict[str, Any] = {
        "follows": follows,
        "nose_mm": nose_mm,
        "feed": feed,
        "machine_codes": list(machine_codes),
    }
    got = turning_correct(
        program,
        z,
        error,
        unit_um=unit_um,
        window=window,
        rule=rule,
        bound_um=bound_um,
        look_ahead=look_ahead,
        position=None,
        keep_numbers=keep_numbers,
        **start,
    )
    after, change = got.pop("program"), got.pop("change_um")
    got["inserted"] = got["inserted"].astype(np.int64)
    between, expected = _between(z, got["window_z_mm"], got["window_mean_um"])
    replayed, cut = turning_change(program, after, between, position=None, **start)
    return Correction(
        dialect=program.dialect,
        text=after.text(),
        original_text=program.text(),
        rule=rule,
        unit_um=unit_um,
        window=window,
        z_mm=z,
        error_um=error,
        remaining_um=error + change,
        between_z_mm=between[cut],
        between_um=(expected + replayed)[cut],
        **got,
    )


def _between(z_mm: Floats, window_z_mm: Floats, mean_um: Floats) -> tuple[Floats, Floats]:
    """Places in wide gaps of the readings, and the error there, straight from window to window."""
    places = np.unique(z_mm)
    steps = np.diff(places)
    if not len(steps):
        return places[:0], places[:0]
    typical = float(np.median(steps))
    wide = np.flatnonzero(steps > GAP_STEPS * typical)
    inner = [np.linspace(places[i], places[i + 1], PLACES_IN_A_GAP + 2)[1:-1] for i in wide]
    found = np.concatenate([places[:0], *inner])
    order = np.argsort(window_z_mm)
    known = window_z_mm[order]
    found = found[(found > known[0]) & (found < known[-1])]
    return found, np.interp(found, known, mean_um[order])


@checked
def change_um(
    before: Program,
    after: Program,
    z_mm: npt.ArrayLike,
    *,
    follows: Follows = "contour",
    nose_mm: float = 0.0,
    feed: float | None = None,
    machine_codes: Sequence[tuple[str, float]] = (),
) -> tuple[Floats, Flags]:
    """How two programs differ: diameter of the second minus that of the first at each z.

    Add it to an error that repeats to see what the second program leaves. Also says where both cut;
    elsewhere the change is 0.
    """
    return turning_change(
        before,
        after,
        line("z_mm", z_mm),
        follows=follows,
        nose_mm=nose_mm,
        position=None,
        feed=feed,
        machine_codes=list(machine_codes),
    )


def _columns(
    readings: Diameters | tuple[npt.ArrayLike, npt.ArrayLike],
) -> tuple[Floats, Floats]:
    if isinstance(readings, Diameters):
        if readings.pass_ is not None and len(np.unique(readings.pass_)) > 1:
            raise InputError(
                "readings: got several passes, expected those of one: select them, or correct for "
                "the law of a diagnosis"
            )
        return np.array(readings.z_mm), np.array(readings.error_um)
    z, error = (
        np.atleast_1d(floats(f"readings[{i}]", column)) for i, column in enumerate(readings)
    )
    if z.ndim != 1 or z.shape != error.shape:
        raise InputError(
            f"readings: got z_mm of shape {z.shape} and error_um of shape {error.shape}, expected "
            "(n,) both"
        )
    return z, error
