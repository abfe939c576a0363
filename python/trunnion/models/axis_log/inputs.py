"""Further columns of a log as inputs of the loops: a force, a torque, a temperature.

A column acts on each axis as a force does: the loop's linear response to a position error in
proportion to it. Not every column is an input. What the control puts out (a drive's voltage, a
current command) follows at the same instant from following error and speed, as does what is motion
itself: it would explain friction by the force that overcomes it. Such columns are no candidates.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats
from trunnion.data.axis_log import AxisLog
from trunnion.diagnosis.effect import Effect, Parameter, linear
from trunnion.models.axis_log.columns import Signals
from trunnion.models.axis_log.signals import TIP_COLUMNS, AxisSignal

WINDOWS = (1, 5, 15, 25)  # samples, over which the measured motion is smoothed
ORDER = 2
OUTPUT_SHARE = 0.99  # of a column's variance, that follows from the motion of one axis


@dataclass(frozen=True)
class Inputs:
    """Columns that may be inputs, and those that follow from the motion of an axis.

    columns: By name, shape (rows,).
    outputs: Name → letter of the axis, share of the variance that follows from its motion.
    """

    columns: Mapping[str, Floats]
    outputs: Mapping[str, tuple[str, float]]

    @classmethod
    def of(cls, log: AxisLog, axes: Sequence[AxisSignal]) -> "Inputs":
        """Sort the further columns of a log that are numbers and change."""
        columns: dict[str, Floats] = {}
        outputs: dict[str, tuple[str, float]] = {}
        for name, values in _numbers(log):
            share, letter = max((_share(values, axis), axis.letter) for axis in axes)
            if share > OUTPUT_SHARE:
                outputs[name] = (letter, share)
            else:
                columns[name] = values
        return cls(columns, outputs)

    def remarks(self) -> tuple[str, ...]:
        """Say which columns are no inputs."""
        return tuple(
            f"Column {name} is not taken for an input: {100 * share:.1f} % of its variance follows "
            f"from following error and motion of {letter} at the same instant, as of what the "
            "control puts out."
            for name, (letter, share) in self.outputs.items()
        )

    def effects(self, signals: Signals) -> Iterator[Effect]:
        """One effect a column; its amounts are how far one of its unit pushes each axis."""
        blocks = signals.blocks
        for name, values in self.columns.items():
            parameters = [
                Parameter(
                    f"{axis.letter.lower()}_{axis.units.small}", f"{axis.units.small_symbol} for 1"
                )
                for axis in signals.axes
            ]
            columns = np.zeros((blocks.count, len(signals.axes)))
            for i, axis in enumerate(signals.axes):
                columns[axis.rows, i] = axis.mean(axis.through_loop(values))
            label = f"what column {name} acts with on the axes"
            yield linear(f"input_{name.lower()}", parameters, columns, label)


def _numbers(log: AxisLog) -> Iterator[tuple[str, Floats]]:
    for name, values in log.extra.items():
        if name in TIP_COLUMNS or not np.issubdtype(np.asarray(values).dtype, np.number):
            continue
        numbers = np.asarray(values, dtype=np.float64)
        if np.all(np.isfinite(numbers)) and np.ptp(numbers) > 0:
            yield name, numbers


def _share(values: Floats, axis: AxisSignal) -> float:
    """Share of a column's variance that follows from the motion of an axis at the same instant.

    The measured motion is smoothed over several windows, and the best counts: noise of the
    measurement, most of all in the speed, is not in what the control puts out.
    """
    shortest = min(run.count for run in axis.runs)
    windows = [w for w in WINDOWS if w <= shortest]
    return max((_share_of(values, axis, w) for w in windows), default=0.0)


def _share_of(values: Floats, axis: AxisSignal, window: int) -> float:
    """The same over one window of samples."""
    from scipy.signal import savgol_filter  # it imports scipy.stats: only where there is a column

    actual, commanded = axis.actual.copy(), axis.commanded
    speed, rate, acceleration = (np.zeros_like(actual) for _ in range(3))
    for run in axis.runs:
        rows, period = run.rows, run.period_s
        rate[rows] = np.gradient(commanded[rows], period)
        acceleration[rows] = np.gradient(rate[rows], period)
        speed[rows] = np.gradient(actual[rows], period)
        if window > 1:
            own = axis.actual[rows]
            actual[rows] = savgol_filter(own, window, ORDER)
            speed[rows] = savgol_filter(own, window, ORDER, deriv=1, delta=period)
    parts = [np.ones(len(values)), commanded, commanded - actual, speed, rate, acceleration]
    columns = np.stack(parts, axis=1)
    size = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    columns = columns / np.where(size > 0, size, 1.0)
    left = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return 1.0 - float(np.var(left) / np.var(values))
