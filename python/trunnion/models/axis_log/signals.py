"""What an axis log and its servo model give: responses of each axis, and means over blocks.

A reading is the mean over a block of samples in a row (as many as keep some thousand readings).
Readings are in order of channels: the axes of the log, then the three coordinates of the tool tip.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

import trunnion._core as _core
from trunnion.base.errors import DataError
from trunnion.base.units import Floats, Integers
from trunnion.contouring.servo import ROTARY, Axis, Feedback, Servo, numbers
from trunnion.data.axis_log import AxisLog
from trunnion.machine.chain import Chain
from trunnion.models.axis_log.beginnings import MIN_SAMPLES, MOVING, first_state
from trunnion.setup import Setup

MAX_READINGS = 4500
MAX_SUBSTEPS = 100  # control periods between two samples
START_STEP = 0.1  # µm and µm/ms, arcsec and arcsec/ms, over which the free response is differenced
MAX_BATCH = 2_000_000  # numbers in one batch of responses: 16 MB
TIP_COLUMNS = ("tip_x_mm", "tip_y_mm", "tip_z_mm")


@dataclass(frozen=True)
class Run:
    """Rows of one run, evenly sampled, each a whole number of control periods after the last.

    ``left_out``: rows of the log before them that are of the same run (:mod:`.beginnings`).
    """

    rows: slice
    period_s: float
    substeps: int
    left_out: int = 0

    @property
    def control_s(self) -> float:
        """Control period."""
        return self.period_s / self.substeps

    @property
    def count(self) -> int:
        """Number of rows."""
        return int(self.rows.stop - self.rows.start)

    def by_period(self, values: Floats) -> Floats:
        """Values (..., count) by control period: between samples a cubic spline."""
        if self.substeps == 1:
            return values
        fine = np.arange((self.count - 1) * self.substeps + 1) / self.substeps
        return np.asarray(CubicSpline(np.arange(self.count), values, axis=-1)(fine))


@dataclass(frozen=True)
class Units:
    """Units of an axis: of its positions, of small quantities, and how many of these are in one."""

    large: str
    small: str
    scale: float

    @classmethod
    def of(cls, letter: str) -> "Units":
        """Return mm and µm for X, Y, Z; deg and arcsec for A, B, C."""
        return cls("deg", "arcsec", 3600.0) if letter in ROTARY else cls("mm", "um", 1e3)

    def name(self, template: str) -> str:
        """Fill ``{small}`` and ``{large}`` in the name of a parameter."""
        return template.format(small=self.small, large=self.large)

    @property
    def small_symbol(self) -> str:
        """Unit of the axis's readings, as printed."""
        return "µm" if self.small == "um" else self.small


class Blocks:
    """Which samples make which reading.

    runs: Blocks do not go from one run into the next.
    axes, channels: Number of axes; number of channels, each with the same blocks.
    size: Samples in a block; by default so many that the axes have `MAX_READINGS` at most.

    starts: First row of each block, shape (blocks,).
    total: Count of rows, with those of no run.
    channel_of, run_of: Channel and run of each reading, shape (n,).
    groups: Runs; of a single run five blocks of time, shape (n,).
    """

    def __init__(
        self, runs: Sequence[Run], axes: int, channels: int, size: int | None = None
    ) -> None:
        total = sum(run.count for run in runs) * axes
        self.size = size or max(1, -(-total // MAX_READINGS))
        counts = [run.count // self.size for run in runs]
        self._used = [
            slice(run.rows.start, run.rows.start + self.size * count)
            for run, count in zip(runs, counts, strict=True)
        ]
        self._whole = [run.rows for run in runs]
        self.total = runs[-1].rows.stop
        self.starts: Integers = np.concatenate(
            [np.arange(rows.start, rows.stop, self.size) for rows in self._used]
        )
        run_of = np.repeat(np.arange(len(runs)), counts)
        groups = run_of if len(runs) > 1 else np.arange(len(run_of)) * 5 // max(len(run_of), 1)
        self.channels = channels
        self.channel_of: Integers = np.repeat(np.arange(channels), len(self))
        self.run_of: Integers = np.tile(run_of, channels).astype(np.intp)
        self.groups: Integers = np.tile(groups, channels).astype(np.intp)

    def __len__(self) -> int:
        """Count of blocks: readings of one channel."""
        return len(self.starts)

    @property
    def count(self) -> int:
        """Count of readings."""
        return self.channels * len(self)

    def rows(self, channel: int, channels: int = 1) -> slice:
        """Readings of a channel, or of several in a row."""
        return slice(channel * len(self), (channel + channels) * len(self))

    def mean(self, values: Floats, axis: int = 0) -> Floats:
        """Means of values by row of the log; ``axis``: the one of the rows."""
        last, ones = np.moveaxis(values, axis, -1), np.ones(self.size)
        parts = [last[..., rows].reshape(*last.shape[:-1], -1, self.size) for rows in self._used]
        # As a product with ones: numpy's mean is slow along a short axis.
        sums = np.concatenate([part @ ones for part in parts], axis=-1)
        return np.moveaxis(sums / self.size, -1, axis)

    def between(self, values: Floats) -> Floats:
        """By row of the log, what blocks of one channel are: linear between their middles."""
        middles = self.starts + (self.size - 1) / 2
        out, done = np.zeros(self.total), 0
        for rows, whole in zip(self._used, self._whole, strict=True):
            some = slice(done, done + (rows.stop - rows.start) // self.size)
            out[whole] = np.interp(np.arange(whole.start, whole.stop), middles[some], values[some])
            done = some.stop
        return out

    def mean_everywhere(self, values: Floats) -> Floats:
        """Means by row, the same for every channel, shape (n,)."""
        return np.tile(self.mean(values), self.channels)

    def place(self, rows: slice, values: Floats) -> Floats:
        """Values of some readings in their place, shape (n, ...); zero for the others."""
        out = np.zeros((self.count, *values.shape[1:]))
        out[rows] = values
        return out


@dataclass(frozen=True, eq=False)
class AxisSignal:
    """One axis of a log: its positions, and those that the servo model says.

    letter, channel: "X", and its place among the axes of the log.
    servo: Parameters about which effects are taken: those of the set-up, which may know of backlash
        and the like, or (:mod:`.near`) with strong effects in.
    nominal: Parameters of the set-up.
    feedback: Which position the loop is closed on.
    commanded, actual: Positions by row, mm or deg, shape (rows,).
    runs, blocks: Of the log.
    starts: How far the load is ahead of the first command where each run begins, and its speed
        then, µm (arcsec) and µm/ms, shape (runs, 2); None: as recorded (`begins`).
    command_step: Step that was taken off the commanded positions, mm or deg; 0: none.
    log_delay_ms: Actual positions are recorded as those of so much earlier.
    """

    letter: str
    channel: int
    servo: Axis
    nominal: Axis
    feedback: Feedback
    commanded: Floats
    actual: Floats
    runs: tuple[Run, ...]
    blocks: Blocks
    starts: Floats | None = None
    command_step: float = 0.0
    log_delay_ms: float = 0.0

    @property
    def units(self) -> Units:
        """Units of the axis."""
        return Units.of(self.letter)

    @property
    def rows(self) -> slice:
        """Readings of the axis."""
        return self.blocks.rows(self.channel)

    @cached_property
    def begins(self) -> Floats:
        """State that each run begins in, as `starts`: at rest, or as recorded where it moves.

        From rest the way to the motion would be simulated that play and friction have there.
        """
        if self.starts is not None:
            return self.starts
        lag, moving = 1.0 / self.nominal.gain_per_s, MOVING / self.units.scale
        states = [
            first_state(self.commanded[r.rows], self.actual[r.rows], r.period_s, lag, moving)
            for r in self.runs
        ]
        return self.units.scale * np.array(states) * [1.0, 1e-3]

    # --- the servo model

    @cached_property
    def predicted(self) -> Floats:
        """Positions recorded under these parameters, mm or deg, shape (rows,)."""
        return self.response(self.servo)

    def response(self, servo: Axis) -> Floats:
        """Positions under these parameters, by row, mm or deg."""
        return np.asarray(next(self.responses([servo]))[0])

    def responses(self, servos: Sequence[Axis]) -> Iterator[Floats]:
        """Positions under each of many parameters, simulated on all cores: in parts, (m, rows)."""
        batch = max(1, MAX_BATCH // len(self.commanded))
        for start in range(0, len(servos), batch):
            some = servos[start : start + batch]
            yield self._follow(some, self.begins)

    def readings_of(
        self, servos: Sequence[Axis], starts: Floats, delays_ms: Sequence[float]
    ) -> Floats:
        """Readings as positions under each of m parameters from starts (m, runs, 2): (m, blocks).

        In µm or arcsec, less the commanded positions. ``delays_ms``: of the log, for each.
        """
        y = self._moved(servos, starts)
        for i, delay_ms in enumerate(delays_ms):
            y[i] = self._earlier(y[i], delay_ms)
        return self.blocks.mean(self.units.scale * (y - self.commanded), axis=1)

    def change(self, servo: Axis) -> Floats:
        """Exact change of the response by other parameters, µm or arcsec, by row."""
        return np.asarray(self.units.scale * (self.response(servo) - self.predicted))

    def through_loop(self, disturbance: Floats) -> Floats:
        """What the loop makes of disturbances of its command, (..., rows): linear, from rest."""
        from scipy.signal import lfilter  # it imports scipy.stats

        out = disturbance.astype(np.float64)
        for run in self.runs:
            (a, b), (c, d) = self.step(run)
            # Of z: what a command adds to the position, over the loop's own motion.
            made = [0.0, 1.0 - a, b * -c - d * (1.0 - a)]
            own = run.by_period(disturbance[..., run.rows])
            first = own[..., :1]
            followed = lfilter(made, [1.0, -(a + d), a * d - b * c], own - first, axis=-1)
            out[..., run.rows] = first + followed[..., :: run.substeps]
        return self._earlier(out, self.log_delay_ms)

    @cached_property
    def _fine_commands(self) -> list[Floats]:
        """Commands of each run by control period."""
        return [np.ascontiguousarray(run.by_period(self.commanded[run.rows])) for run in self.runs]

    def _follow(self, servos: Sequence[Axis], starts: Floats) -> Floats:
        """Recorded load positions, shape (servos, rows).

        ``starts``: of all servos (runs, 2), or of each, (servos, runs, 2).
        """
        return self._earlier(self._moved(servos, starts), self.log_delay_ms)

    def _moved(self, servos: Sequence[Axis], starts: Floats) -> Floats:
        """The same, as they are at the time of each row."""
        each = numbers(servos)
        out = np.tile(self.commanded, (len(servos), 1))  # rows of no run: as commanded
        some = starts * [1.0, 1e3] / self.units.scale
        some = np.broadcast_to(some, (len(servos), len(self.runs), 2))
        for i, (run, command) in enumerate(zip(self.runs, self._fine_commands, strict=True)):
            out[:, run.rows] = _core.contour_axis_responses(
                self.letter,
                each,
                run.control_s,
                self.feedback,
                command,
                stride=run.substeps,
                starts=np.ascontiguousarray(some[:, i]),
            )
        return out

    def step(self, run: Run) -> Floats:
        """Position and velocity a control period later, commanded to 0, by those before: (2, 2)."""
        gain, tau = self.servo.gain_per_s, self.servo.time_constant_ms * 1e-3
        e = float(np.exp(-run.control_s / tau)) if tau > 0 else 0.0
        g = tau * (1 - e)
        return np.array([[1 - gain * (run.control_s - g), g], [-gain * (1 - e), e]])

    def free(self) -> Floats:
        """Free response to 1 µm (arcsec) and to 1 µm a ms at the start of a run, (rows, 2)."""
        out = np.zeros((len(self.commanded), 2))
        if self.starts is not None:
            moved = self.starts + START_STEP * np.eye(2)[:, None, :]
            y = self._follow([self.servo] * 2, moved)
            return np.asarray((self.units.scale / START_STEP * (y - self.predicted)).T)
        for run in self.runs:
            poles, vectors = np.linalg.eig(self.step(run).astype(complex))
            powers = poles ** (run.substeps * np.arange(run.count))[:, None]
            out[run.rows] = np.real((vectors[0] * powers) @ np.linalg.inv(vectors)) * [1.0, 1e3]
        return out

    # --- the modelled motion

    def earlier(self, delay_ms: float) -> Floats:
        """Change of the log if it shows positions of so much earlier, µm or arcsec, by row."""
        return self.units.scale * (self._earlier(self.predicted, delay_ms) - self.predicted)

    def _earlier(self, positions: Floats, delay_ms: float) -> Floats:
        """Positions (..., rows) of so much earlier; before a run and after it at constant speed.

        Positions of a servo that runs away stay as they are: no number lies between them.
        """
        if not delay_ms or not np.all(np.isfinite(positions)):
            return positions
        out = positions.copy()
        for run in self.runs:
            y = positions[..., run.rows]
            at = np.arange(run.count) - delay_ms * 1e-3 / run.period_s
            inside = np.clip(at, 0, run.count - 1)
            speed = np.where(at < 0, y[..., 1:2] - y[..., :1], y[..., -1:] - y[..., -2:-1])
            within = CubicSpline(np.arange(run.count), y, axis=-1)(inside)
            out[..., run.rows] = within + (at - inside) * speed
        return out

    def sense_and_speed(self) -> tuple[Floats, Floats]:
        """Sense of travel and speed of the modelled motion by row; rest keeps the last sense."""
        sense, speed = np.zeros(len(self.commanded)), np.zeros(len(self.commanded))
        moved = self._moved([self.servo], self.begins)[0]
        for run in self.runs:
            v = np.gradient(moved[run.rows], run.period_s)
            s = np.sign(np.where(np.abs(v) < 1e-6 * np.abs(v).max(initial=1e-30), 0.0, v))
            kept = np.maximum.accumulate(np.where(s != 0, np.arange(len(s)), 0))
            sense[run.rows], speed[run.rows] = s[kept], np.abs(v)
        return sense, speed

    @cached_property
    def typical_speed(self) -> float:
        """Mean of the commanded speed, mm/s or deg/s."""
        speeds = [np.abs(np.gradient(self.commanded[r.rows], r.period_s)) for r in self.runs]
        return float(np.mean(np.concatenate(speeds)))

    def kinematic(self, order: int) -> Floats:
        """Commanded position, speed or acceleration of each of its readings."""
        values = self.commanded.copy()
        for run in self.runs:
            for _ in range(order):
                values[run.rows] = np.gradient(values[run.rows], run.period_s)
        return self.blocks.mean(values)

    # --- readings

    def deviation(self) -> Floats:
        """Readings: actual less modelled positions, µm or arcsec, shape (blocks,)."""
        return self.mean(self.units.scale * (self.actual - self.predicted))

    def mean(self, values: Floats) -> Floats:
        """Means over blocks of values by row."""
        return self.blocks.mean(values)

    def between(self, values: Floats) -> Floats:
        """By row, what its readings are between the middles of their blocks, shape (rows,)."""
        return self.blocks.between(values)

    def place(self, values: Floats) -> Floats:
        """Means of values by row in the place of its readings, (n, ...); zero for the others."""
        return self.blocks.place(self.rows, self.mean(values))


@dataclass(frozen=True, eq=False)
class ToolTip:
    """Measured tool tip, and that of the set-up's machine at the actual axis positions.

    chain: Machine with its known location errors, sense of each axis, length from tip to pivot.
    measured: Table's frame, mm, shape (rows, 3).
    axes: Actual positions X, Y, Z (mm) and rotary (deg) in the machine's sense, shape (rows, 5).
    """

    chain: Chain
    measured: Floats
    axes: Floats = field(repr=False)

    @classmethod
    def of(cls, log: AxisLog, setup: Setup) -> "ToolTip":
        """From the tip's columns and the axes of a log.

        Raises DataError: the axes of the log are not those of the machine.
        """
        chain = Chain(setup)
        letters = f"XYZ{chain.letters}"
        if sorted(letter.lower() for letter in letters) != sorted(log.axes):
            raise DataError(
                f"tool tip in the log: got axes {', '.join(log.axes).upper()}, expected "
                f"{', '.join(letters)} (machine {setup.machine.name})"
            )
        measured = [np.asarray(log.columns[name], dtype=np.float64) for name in TIP_COLUMNS]
        linear = np.stack([log.actual(x) for x in "xyz"], axis=1) * chain.linear_senses()
        rotary = chain.to_machine({x: log.actual(x.lower()) for x in chain.letters})
        return cls(chain, np.stack(measured, axis=1), np.hstack([linear, rotary]))

    @property
    def offsets(self) -> tuple[str, ...]:
        """Location errors that are offsets of rotary axes, the last axis first: EX0C."""
        names = [name for name, unit in self.chain.location_errors.items() if unit == "um"]
        return tuple(n for x in reversed(self.chain.letters) for n in names if n[-1] == x)

    def deviation(self) -> Floats:
        """Measured less modelled tip, mm, shape (rows, 3)."""
        return self.measured - self._tip({})

    def change(self, error: str) -> Floats:
        """Change of the tip by 1 µm of an offset, mm, shape (rows, 3): exact and linear."""
        return self._tip({error: 1.0}) - self._tip({})

    def _tip(self, errors: dict[str, float]) -> Floats:
        """Tip under location errors beside those of the set-up, table's frame, mm."""
        known = self.chain.named_errors(None)
        for name, value in errors.items():
            known[name] = known.get(name, 0.0) + value
        return np.ascontiguousarray(self.chain.machine(known).forward(self.axes)[:, :3])


def runs_of(log: AxisLog, servo: Servo) -> tuple[Run, ...]:
    """Runs of a log, each evenly sampled.

    Raises DataError: a run is shorter than `MIN_SAMPLES` or not evenly sampled (1 %).
    """
    edges = [0, len(log)]
    if log.run is not None:
        edges = [0, *(np.flatnonzero(log.run[1:] != log.run[:-1]) + 1).tolist(), len(log)]
    return tuple(_run(log, servo, start, stop) for start, stop in pairwise(edges))


def _other_clock(period: float, control: float) -> str:
    """Ask for the unit of times by which samples are a few control periods apart; empty: none."""
    for unit, factor in (("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9)):
        steps = factor * period / control
        if 0.5 <= steps <= MAX_SUBSTEPS and abs(steps - round(steps)) <= 0.01 * steps:
            return f": are these times in {unit}? time_s is in s"
    return ""


def _run(log: AxisLog, servo: Servo, start: int, stop: int) -> Run:
    if stop - start < MIN_SAMPLES:
        raise DataError(
            f"axis log, run from {log.place(start)} on: got {stop - start} samples, expected at "
            f"least {MIN_SAMPLES}"
        )
    steps = np.diff(log.time_s[start:stop])
    period = float((log.time_s[stop - 1] - log.time_s[start]) / (stop - 1 - start))
    uneven = np.abs(steps - period)
    if uneven.max() > 0.01 * period:
        usual = float(np.median(steps))
        row = start + 1 + int(np.argmax(np.abs(steps - usual)))
        step = float(steps[row - start - 1])
        missing = round(step / usual) - 1
        lost = ""
        if missing > 0 and abs(step - (missing + 1) * usual) <= 0.01 * usual:
            lost = f" ({missing} samples missing: overrun of a sampler, or lines lost)"
        raise DataError(
            f"axis log, {log.place(row)}: got {step:.6g} s after the row before{lost}, expected "
            f"even sampling ({usual:.6g} s within 1 %); give each run its label (column run), and "
            "what stands before and behind a gap one of its own"
        )
    control = period if servo.period_ms is None else servo.period_ms * 1e-3
    substeps = max(1, round(period / control))
    if substeps > MAX_SUBSTEPS:
        raise DataError(
            f"axis log, {log.place(start)}: got samples every {period * 1e3:.6g} ms, expected at "
            f"most {MAX_SUBSTEPS} times servo.period_ms = {control * 1e3:.6g}"
            f"{_other_clock(period, control)}"
        )
    if abs(period - substeps * control) > 0.01 * period:
        raise DataError(
            f"axis log, {log.place(start)}: got samples every {period * 1e3:.6g} ms, expected a "
            f"multiple of servo.period_ms = {control * 1e3:.6g}"
        )
    return Run(slice(start, stop), period, substeps)
