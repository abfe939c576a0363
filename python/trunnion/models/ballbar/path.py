"""How the machine travels in a ball-bar test: runs, senses, reversals, speed."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from trunnion.base.units import Flags, Floats, Integers
from trunnion.data.ballbar import Ballbar
from trunnion.data.circles import check_sense, check_travel, paths_round
from trunnion.data.meant import out_of_order
from trunnion.data.times import elapsed_s
from trunnion.hybrid.readings import setup_index
from trunnion.machine.linear_axes import Travel

AXES = "xyz"
#: Travel slower than this fraction of the change from one reading to the next is a standstill.
STANDSTILL = 0.2
#: Cosine between two steps below which the machine has turned back, where no sense is given.
TURNS_BACK = -0.7
#: A step so many times as long as they are, and longer by so many times their scatter, that turns
#: by more than 90° is no travel: the machine returned to where the next run starts.
RETURN_STEPS, RETURN_SIGMAS = 1.5, 6.0
MAD_TO_SIGMA = 1.4826
MIN_TRAVEL_MM = 1e-3
#: Share of a run's readings that may be left out as at reversals: of a coarse circle they are many.
MAX_LEFT_OUT = 0.2
TINY = 1e-300


class Path:
    """How the machine travels: runs, tangents, standstills. Everything (n, ...).

    travel: Of X, Y and Z, about the middle of which guides are bent; None: that of the readings.
    """

    def __init__(self, data: Ballbar, tips: Floats, travel: Travel | None = None) -> None:
        index, _ = setup_index(data)
        step = np.linalg.norm(np.diff(tips, axis=0), axis=1)
        typical = float(np.median(step[step > 1e-9])) if (step > 1e-9).any() else 1.0
        change = (np.diff(index) != 0) | (step > 8 * typical) | _returns(tips)
        for name in ("sense", "circle", "run"):
            column = data.columns.get(name)
            if column is not None:
                change |= np.asarray(column)[1:] != np.asarray(column)[:-1]
        if data.sense is None:
            change |= _turns_back(tips)
        self.runs: Integers = np.concatenate([[0], np.cumsum(change)]).astype(np.intp)
        self._check_time(data)
        self._check_sense(data, tips, index)
        self.along = np.zeros(len(tips))
        for rows in self.each():
            gone = np.linalg.norm(np.diff(tips[rows], axis=0), axis=1)
            self.along[rows] = np.concatenate([[0.0], np.cumsum(gone)])
        self.tips = tips
        self.used = Travel.of(tips) if travel is None else travel
        self._time_s = None if data.time_s is None else np.asarray(data.time_s, dtype=np.float64)
        self._feed_mm_min = data.feed_mm_min
        self.tangent = self.rate(tips)
        self.tangent /= np.maximum(np.linalg.norm(self.tangent, axis=1), 1e-12)[:, None]

    def _check_time(self, data: Ballbar) -> None:
        """Refuse rows out of the order of time: where the machine travels is taken from it."""
        if data.time_s is None:
            return
        back = np.flatnonzero((np.diff(data.time_s) < 0) & (np.diff(self.runs) == 0))
        if len(back):
            row = int(back[0]) + 1
            raise out_of_order(
                f"time_s ({data.place(row)}): got {data.time_s[row]:g} after "
                f"{data.time_s[row - 1]:g}, "
                "expected the readings in the order in which they were taken"
            )

    def _check_sense(self, data: Ballbar, tips: Floats, index: Integers) -> None:
        """Refuse circles whose rows go the other way than they say: travel is that of the rows."""
        if data.sense is None:
            return
        runs = self.each()
        setup_of = [index[rows[0]] for rows in runs]
        for setup in dict.fromkeys(setup_of):
            mine = [rows for rows, of in zip(runs, setup_of, strict=True) if of == setup]
            for plane, paths in paths_round(tips, mine).items():
                check_travel(data, plane, paths)
                check_sense(data, plane, paths)

    @property
    def moving(self) -> list[int]:
        """Numbers of the axes along which the tool point moves."""
        return [a for a in range(3) if np.ptp(self.tips[:, a]) > MIN_TRAVEL_MM]

    @cached_property
    def hours(self) -> Floats | None:
        """Time since the first reading, h."""
        time = self._time_s
        return None if time is None else elapsed_s(time) / 3600.0

    @cached_property
    def speed_mm_s(self) -> Floats | None:
        """Speed along the path: from the feed, else from the times, else None."""
        if self._feed_mm_min is not None:
            return np.asarray(self._feed_mm_min) / 60.0
        if self._time_s is None:
            return None
        pace = self.rate(self._time_s)
        good = pace > 1e-9
        if not good.any():
            return None
        return np.where(good, 1.0 / np.where(good, pace, 1.0), float(np.median(1.0 / pace[good])))

    def each(self) -> list[Integers]:
        """Rows of each run."""
        return np.split(np.arange(len(self.runs)), np.flatnonzero(np.diff(self.runs)) + 1)

    def rate(self, values: Floats) -> Floats:
        """Change per mm of path of a quantity along each run, second order at the ends too."""
        out = np.zeros_like(values)
        for rows in self.each():
            place = self.along[rows]
            # readings where the machine stood count once
            kept = np.flatnonzero(np.diff(place, prepend=-np.inf) > 1e-9)
            which = np.searchsorted(kept, np.arange(len(rows)), side="right") - 1
            moved = rows[kept]
            if len(moved) == 2:
                out[rows] = values[moved[1]] - values[moved[0]]
            elif len(moved) > 2:
                slope = np.gradient(values[moved], place[kept], axis=0, edge_order=2)
                out[rows] = slope[which]
        return out

    def travel(self, values: Floats) -> Floats:
        """Sign of travel of a quantity; 0 where it stands still between two signs, or all the run.

        Readings beside a gap, such as that of those left out at a reversal, stand no longer there.
        """
        rate = self.rate(values)
        out = np.sign(rate)
        for rows in self.each():
            if np.ptp(values[rows]) < MIN_TRAVEL_MM:
                out[rows] = 0.0
            elif len(rows) > 2:
                step = np.maximum(np.diff(self.along[rows]), TINY)
                change = np.abs(np.diff(rate[rows])) * np.minimum(1.0, np.median(step) / step)
                least = STANDSTILL * float(np.max(change, initial=0.0))
                out[rows] = np.where(np.abs(rate[rows]) < least, 0.0, out[rows])
        return out

    def both_ways(self, axis: int) -> Floats | None:
        """Sign of travel of X, Y or Z by its number; None: it travels one way only."""
        sign = self.travel(self.tips[:, axis])
        return sign if np.any(sign > 0) and np.any(sign < 0) else None

    def steps_of_backlash(self, direction: Floats) -> Iterator[tuple[int, Floats]]:
        """What 1 µm makes that a backlash has more behind the middle and less before it, by axis.

        ``direction``: of the bar, (n, 3).
        """
        for axis in self.moving:
            sign, off = self.both_ways(axis), self.tips[:, axis] - self.used.middle_mm[axis]
            if sign is not None:
                yield axis, -0.5 * sign * np.sign(off) * direction[:, axis]

    def between_reversals(self) -> Integers:
        """Rows where no axis that travels both ways stands still between them, in order.

        All rows of a run of which that would leave out more than `MAX_LEFT_OUT`.
        """
        still = np.zeros(len(self.tips), dtype=bool)
        signs = [self.both_ways(axis) for axis in self.moving]
        for rows in self.each():
            for sign in signs:
                if sign is not None and sign[rows].any():
                    still[rows] |= sign[rows] == 0.0
            still[rows] &= np.count_nonzero(still[rows]) <= MAX_LEFT_OUT * len(rows)
        return np.flatnonzero(~still)

    def since_reversal(self, axis: int, sign: Floats) -> Floats:
        """Path (mm) since X, Y or Z last reversed in the run; inf before the first time.

        A reversal between two readings is where the rate between them, taken as linear, vanishes.
        """
        out = np.full(len(sign), np.inf)
        rate = self.rate(self.tips[:, axis])
        for rows in self.each():
            last, since = 0.0, np.inf
            for k, row in enumerate(rows):
                now = sign[row]
                if now == 0.0 and last != 0.0:
                    since = self.along[row]
                elif now != 0.0:
                    if (last != 0.0 and now != last and not np.isfinite(since)) or (
                        last != 0.0 and now != last and self._older(since, rows, k, sign)
                    ):
                        before, after = abs(rate[rows[k - 1]]), abs(rate[row])
                        start, end = self.along[rows[k - 1]], self.along[row]
                        since = start + (end - start) * before / max(before + after, TINY)
                    last = now
                if np.isfinite(since):
                    out[row] = self.along[row] - since
        return out

    def since_start(self, sign: Floats) -> Floats:
        """Path (mm) since a full circle began, up to the first reversal, where it began at one.

        The sign at its end is the other: the machine came to the beginning on the circle, or along
        its radius, and turned back there. It did so half a step before, or where it stands still.
        Else inf.
        """
        out = np.full(len(sign), np.inf)
        for rows in self.each():
            moving = rows[sign[rows] != 0.0]
            if len(moving) < 2 or sign[moving[0]] == sign[moving[-1]]:
                continue
            step = float(np.max(np.diff(self.along[rows])))
            gap = float(np.linalg.norm(self.tips[rows[0]] - self.tips[rows[-1]]))
            if gap > 1.5 * step:
                continue
            turned = np.flatnonzero(sign[rows] == -sign[moving[0]])[0]
            before = 0.0 if sign[rows[0]] == 0.0 else gap / 2
            out[rows[:turned]] = self.along[rows[:turned]] + before
        return out

    def _older(self, since: float, rows: Integers, k: int, sign: Floats) -> bool:
        """Whether the reversal noted is not the one that ends at this reading."""
        return bool(sign[rows[k - 1]] != 0.0 or since < self.along[rows[k - 1]] - 1e-9)


def _steps(tips: Floats) -> tuple[Floats, Floats, Integers]:
    """Steps (n - 1, 3), their lengths, and with which of them the machine moves."""
    step = np.diff(tips, axis=0)
    size = np.linalg.norm(step, axis=1)
    return step, size, np.flatnonzero(size > 1e-9)


def _returns(tips: Floats) -> Flags:
    """Steps (n - 1,) with which the machine returns to a start, along a path that is not logged.

    They say nothing about the travel at either end. Gaps of readings left out go forward.
    """
    step, size, moving = _steps(tips)
    out = np.zeros(len(step), dtype=bool)
    if len(moving) < 2:
        return out
    moved = size[moving]
    typical = float(np.median(moved))
    scatter = MAD_TO_SIGMA * float(np.median(np.abs(moved - typical)))
    large = moved > max(RETURN_STEPS * typical, typical + RETURN_SIGMAS * scatter)
    way = step[moving]
    out[moving[1:][large[1:] & (np.einsum("ij,ij->i", way[:-1], way[1:]) < 0.0)]] = True
    return out


def _turns_back(tips: Floats) -> Flags:
    """Steps (n - 1,) with which the machine goes back where it came from: a new run.

    Standstill before such a step belongs to the new run but for its first reading.
    """
    step, size, moving = _steps(tips)
    way = step[moving] / size[moving, None]
    out = np.zeros(len(step), dtype=bool)
    for k in np.flatnonzero(np.einsum("ij,ij->i", way[:-1], way[1:]) < TURNS_BACK) + 1:
        out[min(moving[k - 1] + 1, moving[k])] = True
    return out
