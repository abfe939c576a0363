"""Angles of a level along a line or on a grid: ``levels.csv``, one row a reading."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import choose
from trunnion.base.errors import DataError, InputError
from trunnion.base.recognition import displayed
from trunnion.base.repeats import shared_variance
from trunnion.base.report import Result
from trunnion.base.rows import equal_rows
from trunnion.base.units import Flags, Floats, Integers
from trunnion.data.flatness import Flatness, Straightness, Twist
from trunnion.data.mistaken import size_notes
from trunnion.data.slopes import Noise, Slopes, heights_of_line
from trunnion.files.columns import ColumnError, OptionalNumber, OptionalTime
from trunnion.files.csv_file import read_table
from trunnion.files.table import Table

COMPONENTS = ("along", "across")
NOT_REVERSED = (
    "The instrument was not turned: its zero and the inclination of the surface as a whole are not "
    "distinguished. The deviation from a straight line or a plane does not depend on them."
)
MIN_FREE = 4  # degrees of freedom from which repeats say what the noise is


class Levels(Table):
    """Readings of a level at places of a line or of a grid, in the instrument's own sign.

    Places are the middle between the feet. ``along`` is the slope along the line (on a grid in
    +x), positive where it rises; ``across`` the slope at right angles to it, to the left of the
    line (on a grid in +y). An instrument turned by 180 degrees shows both with the other sign, and
    its zero with the same.

    Examples
    --------
    >>> import trunnion as tn
    >>> bed = tn.read_levels(tn.sample_path("levels/bed.csv"))
    >>> round(bed.straightness().minimum_zone_um, 1)
    18.0
    """

    choice = "position_mm or x_mm, y_mm; along_um_m, across_um_m or both"
    smallest_mm = 20.0  # a level stands on feet farther apart

    position_mm = OptionalNumber("place along a line", commanded=True)
    x_mm = OptionalNumber("place on a grid", commanded=True)
    y_mm = OptionalNumber("place on a grid", commanded=True)
    along_um_m = OptionalNumber("slope along the line, or in x", observed=True)
    across_um_m = OptionalNumber("slope across the line, or in y", observed=True)
    turn_deg = OptionalNumber("0, or 180: the instrument turned about the vertical", among=(0, 180))
    time_s = OptionalTime("time since the start")

    @property
    def grid(self) -> bool:
        """Whether the places are on a grid, not on a line."""
        return self.position_mm is None

    @property
    def components(self) -> tuple[str, ...]:
        """Which of "along" and "across" was read."""
        return tuple(c for c in COMPONENTS if f"{c}_um_m" in self.columns)

    @property
    def sense(self) -> Floats:
        """How the slope enters a reading: 1, or -1 where the instrument was turned, (n,)."""
        turn = self.turn_deg
        return np.ones(len(self)) if turn is None else np.where(turn == 180.0, -1.0, 1.0)

    @property
    def places_mm(self) -> Floats:
        """Place of each row: (n, 1) of a line, (n, 2) of a grid."""
        names = ("x_mm", "y_mm") if self.grid else ("position_mm",)
        return np.stack([self.columns[name] for name in names], axis=1).astype(np.float64)

    @property
    def stations(self) -> tuple[Floats, Integers]:
        """Distinct places in ascending order, (m, d), and the number of each row's, (n,)."""
        places = self.places_mm
        label, first = equal_rows([*places.T])
        distinct, index = np.unique(places[first], axis=0, return_inverse=True)
        return distinct, index.reshape(-1)[label].astype(np.intp)

    @property
    def reversed(self) -> bool:
        """Whether a place was read with the instrument both ways: this shows its zero."""
        return bool(self._both_ways().any())

    def slopes(self, component: str) -> Slopes:
        """Mean slope of the surface at each place, the instrument's zero taken off if it is known.

        component: "along" or "across".
        """
        choose("component", component, self.components)
        values = np.asarray(self.columns[f"{component}_um_m"], dtype=np.float64)
        places, index = self.stations
        # Readings at a place share its slope, and all of them the zero: eliminated by hand.
        count = np.bincount(index).astype(np.float64)
        found = np.bincount(index, self.sense * values) / count
        turned = np.bincount(index, self.sense) / count  # how the zero enters a place's slope
        zero, zero_cofactor, free = 0.0, np.inf, len(self) - len(places)
        if self.reversed:
            zero_cofactor = 1.0 / float(len(self) - count @ turned**2)
            zero = zero_cofactor * float(values.sum() - (count * turned) @ found)
            found = found - turned * zero
            free -= 1
        left = values - self.sense * found[index] - zero
        known, rss = zero if self.reversed else None, float(left @ left)
        repeats = len(self) / len(np.unique(self.sense * (1 + index)))
        more = (rss, free, displayed(values), repeats)
        return Slopes(places, found, count, turned, known, zero_cofactor, *more)

    # --- results

    @checked
    def straightness(
        self, *, foot_mm: float | None = None, noise_um_m: float | None = None
    ) -> Straightness:
        """Return the profile of a line and its straightness (ISO 12780-1, ISO 230-1).

        Parameters
        ----------
        foot_mm
            Distance of the instrument's feet; the step of the places by default, where the
            instrument was moved by its own length. Then each reading is the rise between two
            feet; otherwise it counts as the slope at its place (trapezoidal rule), and what is
            shorter than the feet's distance is smoothed.
        noise_um_m
            Noise of a reading (1 σ); by default of repeats or, without these, of second
            differences along the line, in which short structure of the surface counts as noise.

        Raises
        ------
        DataError
            A grid, no slope along the line, or fewer than three places.
        """
        if self.grid:
            raise DataError("straightness: got places on a grid, expected a line: see flatness")
        self._need("straightness", "along", 3)
        slopes = self.slopes("along")
        noise = self._noise(slopes, noise_um_m)
        at, heights, chained = heights_of_line(slopes.places[:, 0], foot_mm)
        return Straightness.of(at, heights, slopes, noise, chained, self._notes())

    @checked
    def flatness(self, *, noise_um_m: float | None = None) -> Flatness:
        """Return the heights of a surface and its flatness (ISO 12781-1, ISO 1101).

        A reading is the slope at the middle between the feet, and neighbouring places differ in
        height by their mean slope times their distance, in the sense of least squares (Southwell,
        1980). What is shorter than the feet's distance is smoothed.

        noise_um_m: As for `straightness`.

        Raises
        ------
        DataError
            A line, one slope only, or places that are not connected along x and y.
        """
        if not self.grid:
            raise DataError("flatness: got places on a line, expected a grid: see straightness")
        for component in COMPONENTS:
            self._need("flatness", component, 4)
        slopes = [self.slopes(component) for component in COMPONENTS]
        noise = [self._noise(s, noise_um_m) for s in slopes]
        return Flatness.of(slopes, noise, self._notes())

    @checked
    def twist(self, *, noise_um_m: float | None = None) -> Twist:
        """Return how fast the slope across changes along the line, or over a grid.

        noise_um_m: As for `straightness`.

        Raises
        ------
        DataError
            No slope across the line, or fewer than three places.
        """
        names = COMPONENTS if self.grid else ("across",)
        for component in names:
            self._need("twist", component, 3)
        slopes = [self.slopes(component) for component in names]
        return Twist.of(slopes, [self._noise(s, noise_um_m) for s in slopes])

    def results(self, others: Sequence[Levels] = ()) -> tuple[Result, ...]:
        """Return every result for which the readings have what it takes.

        others: Measurements whose places count: straightness and flatness are of those that all
            have. A twist is of the whole.
        """
        common: Flags = np.all([self._among(one) for one in (self, *others)], axis=0)
        shared = self[common]
        out: list[Result] = []
        try:
            if self.grid and len(self.components) == 2:
                out.append(shared.flatness())
            elif not self.grid and "along" in self.components:
                out.append(shared.straightness())
            if "across" in self.components and (not self.grid or len(self.components) == 2):
                out.append(self.twist())
        except DataError:
            return tuple(out)
        return tuple(out)

    # --- parts

    def _among(self, other: Levels) -> Flags:
        """Whether the place of each row is one of the other's."""
        theirs = {tuple(p) for p in other.stations[0].tolist()}
        return np.array([tuple(p) in theirs for p in self.places_mm.tolist()], dtype=bool)

    def _need(self, what: str, component: str, least: int) -> None:
        if component not in self.components:
            raise DataError(f"{what}: got no column {component}_um_m, expected one")
        count = len(self.stations[0])
        if count < least:
            raise DataError(f"{what}: got {count} places, expected at least {least}")

    def _both_ways(self) -> Flags:
        """Whether each place was read with the instrument both ways, (m,)."""
        places, index = self.stations
        ways = [np.bincount(index, self.sense == s, len(places)) > 0 for s in (1.0, -1.0)]
        return np.asarray(ways[0] & ways[1])

    def _noise(self, slopes: Slopes, known: float | None) -> Noise:
        if known is not None:
            if known < 0:
                raise InputError(f"noise_um_m: got {known:g}, expected 0 or above")
            return Noise(known, "as stated")
        if slopes.free >= MIN_FREE:
            scatter = slopes.rss / slopes.free
            if together := slopes.repeats * shared_variance(scatter, slopes.step):
                return Noise(float(np.sqrt(scatter + together)), "of repeats and of their step")
            return Noise(float(np.sqrt(scatter)), "of repeats")
        found, least = Noise.of_neighbours(slopes.places, slopes.values), slopes.step / np.sqrt(12)
        return Noise(float(least), "of the step of readings") if found.sigma < least else found

    def _notes(self) -> str:
        """What a reader should know; empty: nothing."""
        said = [*size_notes(self)]
        if not self.reversed:
            said.append(NOT_REVERSED)
        return " ".join(said)

    def _check(self) -> None:
        self.all_or_none("x_mm", "y_mm")
        if (self.position_mm is None) == (self.x_mm is None):
            got = "neither" if self.x_mm is None else "both"
            raise ColumnError(
                "position_mm", None, f"{got} of position_mm and x_mm, y_mm", "one of them"
            )
        if not self.components:
            raise ColumnError(
                "along_um_m", None, "neither along_um_m nor across_um_m", "one of them or both"
            )


def read_levels(path: str | PathLike[str]) -> Levels:
    """Read ``levels.csv``: columns as in `Levels`, any order.

    Raises
    ------
    FileFormatError
        If the file is not as it should be; the message has file, line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.read_levels(tn.sample_path("levels/bed.csv"))
    Levels(48 rows: position_mm, along_um_m, across_um_m, turn_deg, time_s)
    """
    return read_table(path, Levels)
