"""Errors of single axes as tables over the position of an axis, for any control."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import ARCSEC, Floats
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

STEP = {"mm": 50.0, "deg": 5.0}
"""Largest step of nodes; two waves a turn leave 0.4 % of their amplitude between 5°."""
ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)
PER_DEG = 3600.0
SQUARENESS = {
    "squareness_xy": ("Y", "X", -1.0),
    "squareness_xz": ("Z", "X", 1.0),
    "squareness_yz": ("Z", "Y", -1.0),
}
"""Effect → axis that moves, axis that is displaced, sign: the entries of Λ."""


@dataclass(frozen=True)
class AxisTable:
    """Errors of axis `of` over the position of axis `over`, in the control's own coordinates.

    Attributes
    ----------
    over, of
        Axis that moves, and axis whose position is wrong; the same but for squareness.
    unit
        "mm" or "deg", of positions and errors.
    nodes, error
        Round positions, ascending, equally spaced, and where the axis really is there less where
        it was sent, the mean of both senses of travel, (n,).
    width
        Forward error less backward error, negated: what the axis loses at a reversal.
    left
        Largest error between the nodes that interpolation does not take off.
    effects
        Ids that it holds.
    """

    over: str
    of: str
    unit: str
    nodes: Floats
    error: Floats
    width: float
    left: float
    effects: tuple[str, ...]

    @property
    def name(self) -> str:
        """Name for files: "x", or "x_over_y"."""
        own = self.of.lower()
        return own if self.over == self.of else f"{own}_over_{self.over.lower()}"

    @property
    def step(self) -> float:
        """Distance of the nodes."""
        return float(self.nodes[1] - self.nodes[0])

    @property
    def forward(self) -> Floats:
        """Error when the position is reached in the positive sense."""
        return self.error - self.width / 2

    @property
    def reverse(self) -> Floats:
        """Error when it is reached in the negative sense."""
        return self.error + self.width / 2

    @property
    def holds(self) -> str:
        """The range it holds for."""
        return f"{self.over} {self.nodes[0]:g} to {self.nodes[-1]:g} {self.unit}"


@dataclass(frozen=True)
class AxisTables:
    """Tables, ids of the effects that they hold, and those without one, with the reason."""

    tables: tuple[AxisTable, ...]
    left: Mapping[str, str]

    @property
    def held(self) -> tuple[str, ...]:
        """Ids of effects that the tables hold."""
        return tuple(effect for table in self.tables for effect in table.effects)


def axis_tables(
    setup: Setup,
    effects: Mapping[str, Mapping[str, float]],
    *,
    max_rows: int,
    scales: bool,
    squareness: bool,
) -> AxisTables:
    """Tables for what effects say of single axes.

    max_rows: How many nodes the control takes in one table.
    scales, squareness: Whether those of X, Y, Z are put here (or elsewhere).

    Raises InputError: a linear axis, and no `[control] centre_mm`.
    """
    tables: list[AxisTable] = []
    left: dict[str, str] = {}
    ranges, chain = setup.axis_ranges(), Chain(setup)
    for over, of, mine in _groups(effects, "XYZ" + chain.letters, scales, squareness):
        limits = ranges.get(over, (0.0, 360.0) if over == chain.turning else None)
        linear = over in "XYZ"
        if limits is None:
            key = "range_mm" if linear else "range_deg"
            left |= dict.fromkeys(mine, f"its table needs [axes.{over}] {key}, or --range")
            continue
        low, high = limits
        if linear:
            sense = chain.sense_of(over)
            low, high = sorted(_origin(setup, over) + sense * limit for limit in limits)
        unit = "mm" if linear else "deg"
        # Rotary errors bend between nodes, so that their step stays; linear ones are straight.
        nodes = _round_nodes(low, high, unit, max_rows if linear else None)
        if len(nodes) > max_rows:
            reason = f"{over} {low:g} to {high:g} needs {len(nodes)} rows, it reads {max_rows}"
            left |= dict.fromkeys(mine, reason)
            continue
        tables.append(_table(setup, over, of, mine, nodes))
    return AxisTables(tuple(tables), left)


def _groups(
    effects: Mapping[str, Mapping[str, float]], letters: str, scales: bool, squareness: bool
) -> Iterator[tuple[str, str, Mapping[str, Mapping[str, float]]]]:
    """Axis that moves, axis that is wrong, effects of this pair."""
    for axis in letters:
        low = axis.lower()
        turns = ("positioning", "positioning_2", "scale", "backlash")
        names = {f"{low}_{name}" for name in turns}
        if axis in "XYZ":
            names = {f"backlash_{low}"} | ({f"scale_{low}"} if scales else set())
        if mine := {k: v for k, v in effects.items() if k in names}:
            yield axis, axis, mine
    for name, (over, of, _) in SQUARENESS.items():
        if squareness and name in effects:
            yield over, of, {name: effects[name]}


def _origin(setup: Setup, axis: str) -> float:
    """Place of the machine frame's origin along a linear axis of the control.

    Ranges are those of the ball's centre in the machine frame, the axis counts from its own zero.
    """
    if setup.control.centre_mm is None:
        raise InputError(
            "control.centre_mm: not given, expected the origin of the machine frame in machine "
            f"coordinates: the table of axis {axis} counts in them"
        )
    return setup.control.centre_mm["XYZ".index(axis)]


def _round_nodes(low: float, high: float, unit: str, max_rows: int | None) -> Floats:
    """Multiples of a round step that cover a range."""
    step = STEP[unit]
    if max_rows is not None:
        least = (high - low) / (max_rows - 2)
        power = 10.0 ** np.floor(np.log10(max(least, step)))
        step = next(power * r for r in ROUND if power * r >= max(least, step))
    first, last = np.floor(low / step + 1e-9), np.ceil(high / step - 1e-9)
    return np.arange(first, max(last, first + 1) + 1) * step


def _table(
    setup: Setup, over: str, of: str, effects: Mapping[str, Mapping[str, float]], nodes: Floats
) -> AxisTable:
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    dense = np.sort(np.concatenate([nodes, middle]))
    error, width = _errors(setup, over, of, effects, dense)
    at_nodes = error[::2]
    between = error[1::2] - np.array([0.5 * (a + b) for a, b in pairwise(at_nodes)])
    unit = "mm" if over in "XYZ" else "deg"
    left = float(np.abs(between).max())
    return AxisTable(over, of, unit, nodes, at_nodes, width, left, tuple(effects))


def _errors(
    setup: Setup, over: str, of: str, effects: Mapping[str, Mapping[str, float]], position: Floats
) -> tuple[Floats, float]:
    """Error at positions of the control and width of the reversal, in its sense, mm or degrees."""
    chain = Chain(setup)
    senses = {letter: chain.sense_of(letter) for letter in over + of}
    if over not in "XYZ":
        error, width = _rotary(effects, over, senses[over] * position)
        return senses[over] * error, width
    frame = senses[over] * (position - _origin(setup, over))
    if over == of:
        error, width = _linear(effects, over, frame)
        return senses[over] * error, width
    (name,) = effects
    tilt = SQUARENESS[name][2] * effects[name].get("arcsec", 0.0) * ARCSEC
    return senses[of] * tilt * frame, 0.0


def _linear(
    effects: Mapping[str, Mapping[str, float]], axis: str, position: Floats
) -> tuple[Floats, float]:
    ppm = effects.get(f"scale_{axis.lower()}", {}).get("ppm", 0.0)
    width = effects.get(f"backlash_{axis.lower()}", {}).get("b_um", 0.0)
    return 1e-6 * ppm * position, 1e-3 * width


def _rotary(
    effects: Mapping[str, Mapping[str, float]], axis: str, turn_deg: Floats
) -> tuple[Floats, float]:
    """Error of a rotary axis at turns of the machine's sense, degrees, and its reversal."""
    low, c = axis.lower(), np.radians(turn_deg)
    error = np.zeros_like(c)
    for n, name in ((1, f"{low}_positioning"), (2, f"{low}_positioning_2")):
        wave = effects.get(name, {})
        error += wave.get(f"a{n}_arcsec", 0.0) * (np.cos(n * c) - 1.0)
        error += wave.get(f"b{n}_arcsec", 0.0) * np.sin(n * c)
        error += wave.get("k_arcsec", 0.0) * np.sin(c)
    error += effects.get(f"{low}_scale", {}).get("k_arcsec", 0.0) * turn_deg / 90.0
    width = effects.get(f"{low}_backlash", {}).get("b_arcsec", 0.0)
    return error / PER_DEG, width / PER_DEG
