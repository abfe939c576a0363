"""Readings of R-tests and ball-bar tests of rotary axes as a function of what is unknown.

A reading is where the ball on the table is from the tool's point, in the machine's directions:
p - F(q), with F the machine's forward kinematics with its errors; a ball-bar reads its length.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

import trunnion._core as _core
from trunnion.base.checks import point
from trunnion.base.errors import DataError, InputError
from trunnion.base.rows import equal_rows
from trunnion.base.statistics import MANY_ROWS, RANK_TOLERANCE, in_columns
from trunnion.base.units import Floats, Integers
from trunnion.data.rotary_test import READINGS, RotaryTest
from trunnion.machine.chain import Chain
from trunnion.machine.effects import EffectInfo, Owner
from trunnion.setup import Setup
from trunnion.setup.fields import COORDINATE, Flag, Number, Section, Vectors, key

MAX_DEVIATION_MM = 5.0
MAX_BALLS = 1000
MIN_ALIKE = 8  # readings that are the same only where nothing is measured
STEP = 1.0
"""Of every parameter, µm and arcsec, over which readings are differenced."""
ROWS_AT_ONCE = 8192
NO_PLACEMENT = (0.0,) * 6
OFFSETS = ("dx_um", "dy_um", "dz_um")
TOOL = "tool_offset"
BAR_LENGTH = "ballbar_length_um"


@dataclass(frozen=True)
class RotaryTestSettings:
    """The table ``[rotary_test]`` of a set-up."""

    balls_mm: tuple[tuple[float, ...], ...] = key(
        (),
        Vectors(3, 0, MAX_BALLS, COORDINATE),
        "about where each ball is on the table, in the order of their labels; a ball-bar needs it",
    )
    calibrated: bool = key(True, Flag(), "the length of the ball-bar is known")
    tool_is_known: bool = key(
        True, Flag(), "the tool's point is on the spindle's axis, its length known"
    )
    repeatability_um: float = key(0.0, Number(0.0), "standard deviation; 0: to be estimated")

    @classmethod
    def from_setup(cls, setup: Setup) -> RotaryTestSettings:
        """Read the table.

        Raises FileFormatError, InputError: a key that is none of them, or a value of the wrong
            kind; with its place in the file.
        """
        return Section.of("rotary_test", setup.rotary_test).build(cls)


@dataclass(frozen=True, eq=False)
class Relation:
    """How tool and balls stand to each other at each position.

    Attributes
    ----------
    tool_mm
        The tool's point in the table's frame, (n, 3).
    directions
        The machine's directions X, Y, Z there, one a row, (n, 3, 3).
    """

    tool_mm: Floats
    directions: Floats

    @classmethod
    def of(
        cls,
        chain: Chain,
        axes: Floats,
        errors: Mapping[str, float],
        effects: Sequence[tuple[str, Sequence[float]]] = (),
    ) -> Relation:
        """Return that of a machine with location errors and effects, senses of travel left out.

        axes: Where the axes stand, as of :func:`commanded`.
        """
        plain, step = tool_mm(chain, axes, errors), np.eye(3, axes.shape[1])
        ahead = [tool_mm(chain, axes + one, errors) - plain for one in step]
        tool = tool_mm(chain, axes, errors, effects) if effects else plain
        return cls(tool, np.stack(ahead, axis=1))

    def apart_um(self, balls_mm: Floats) -> Floats:
        """Ball's centre minus tool's point in the machine's directions, (n, 3)."""
        found: Floats = 1e3 * np.einsum("nki,ni->nk", self.directions, balls_mm - self.tool_mm)
        return found

    def ball_mm(self, apart_um: Floats) -> Floats:
        """Where the balls are in the table's frame, (n, 3); the opposite of `apart_um`."""
        found: Floats = self.tool_mm + 1e-3 * np.einsum("nki,nk->ni", self.directions, apart_um)
        return found


def tool_mm(
    chain: Chain,
    axes: Floats,
    errors: Mapping[str, float],
    effects: Sequence[tuple[str, Sequence[float]]] = (),
) -> Floats:
    """Tool's point of a machine with errors and effects, table's frame, (n, 3)."""
    if effects:
        return chain.model(errors, NO_PLACEMENT, effects).reached(axes, 1)[:, :3]
    return chain.machine(errors).forward(axes)[:, :3]


def machine_effects(chain: Chain) -> dict[str, EffectInfo]:
    """Effects that move the tool whatever the sense of travel, by id."""
    known = chain.effects.items()
    return {k: v for k, v in known if v.owner is Owner.MACHINE and "backlash" not in k}


def commanded(chain: Chain, data: RotaryTest) -> Floats:
    """Commanded positions in machine order and sense, (n, 3 + rotary axes)."""
    return np.hstack([data.position_mm, chain.to_machine(data.rotary_deg, len(data))])


@dataclass(frozen=True, eq=False)
class RotaryReadings:
    """Readings as a function of errors, places of the balls, the tool's point, the bar's length."""

    data: RotaryTest
    setup: Setup
    balls_mm: Floats
    index: Integers
    labels: tuple[str, ...]
    tool_is_known: bool
    bar_is_known: bool

    @classmethod
    def of(
        cls,
        data: RotaryTest,
        setup: Setup,
        ball_mm: ArrayLike | Mapping[str | int, ArrayLike] | None = None,
        *,
        tool_is_known: bool | None = None,
    ) -> RotaryReadings:
        """Check the readings, and put each at its ball; what is not given is the set-up's.

        Raises DataError, InputError: as `identify_rotary_test`.
        """
        known = RotaryTestSettings.from_setup(setup)
        names, index = np.unique(np.zeros(len(data), dtype=str), return_inverse=True)
        if data.ball is not None and (ball_mm is None or isinstance(ball_mm, Mapping)):
            names, index = np.unique(data.ball.astype(str), return_inverse=True)
        elif isinstance(ball_mm, Mapping):
            raise DataError("ball: got no such column, expected the label of each place")
        several = tuple(f"ball_{name}" if name else "ball" for name in names.tolist())
        index = index.reshape(-1)
        if ball_mm is None and known.balls_mm:
            ball_mm = dict(zip(names.tolist(), known.balls_mm, strict=False))
        if ball_mm is None:
            balls = _from_readings(data, setup, index)
        else:
            balls = _stated(ball_mm, names.tolist())
        tool = known.tool_is_known if tool_is_known is None else tool_is_known
        bar = known.calibrated or data.length_mm is None
        made = cls(data, setup, balls, index, several, tool, bar)
        made.check()
        return made

    def check(self) -> None:
        """Refuse readings that are too few, or of another test."""
        measured = self.measured
        if measured.size <= len(self.names):
            raise DataError(
                f"rotary test: got {measured.size} readings, expected more than "
                f"{len(self.names)} unknowns"
            )
        if len(measured) >= MIN_ALIKE and not np.any(np.ptp(measured, axis=0)):
            read = READINGS if self.data.length_mm is None else ("length_mm",)
            got = ", ".join(f"{self.data.columns[name][0]:g}" for name in read)
            raise DataError(
                f"{', '.join(read)}: got {got} in all {len(measured)} rows, expected readings that "
                "differ from position to position: does the instrument stand still?"
            )
        off = np.abs(measured - self.modelled(self.start)).max(axis=1)
        row = int(np.argmax(off))
        if off[row] > 1e3 * MAX_DEVIATION_MM:
            raise DataError(
                f"{self.data.place(row)}: got a reading {1e-3 * off[row]:.4g} mm from the modelled "
                f"one, expected within {MAX_DEVIATION_MM:g} mm: are the ball's place, the senses "
                "of the rotary axes and the units right?"
            )

    @cached_property
    def chain(self) -> Chain:
        """The machine."""
        return Chain(self.setup)

    @property
    def groups(self) -> tuple[str, ...]:
        """What has an offset of three components: each ball, an unknown tool's point."""
        return (*self.labels, *(() if self.tool_is_known else (TOOL,)))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns: location errors, offsets, the bar's length."""
        offsets = [f"{group}.{name}" for group in self.groups for name in OFFSETS]
        bar = () if self.bar_is_known else (BAR_LENGTH,)
        return (*self.chain.location_errors, *offsets, *bar)

    @property
    def start(self) -> Floats:
        """Errors as the set-up states them, balls and tool's point at their places."""
        known = self.chain.named_errors(None)
        return np.array([known.get(name, 0.0) for name in self.names])

    @cached_property
    def measured(self) -> Floats:
        """Readings in µm, (n, 3) or (n, 1)."""
        displacement, length = self.data.displacement_um, self.data.length_mm
        if displacement is not None:
            return displacement
        if length is None:
            raise DataError(
                f"rotary test: got no readings, expected {', '.join(READINGS)} or length_mm"
            )
        return 1e3 * length[:, None]

    @cached_property
    def axes(self) -> Floats:
        """Commanded positions."""
        return commanded(self.chain, self.data)

    def relation(self, x: Floats) -> Relation:
        """How tool and balls stand to each other with these unknowns: the location errors."""
        errors = dict(zip(self.names, x[: len(self.chain.location_errors)].tolist(), strict=False))
        return Relation.of(self.chain, self.axes, errors)

    def machine(self, x: Floats) -> _core.Machine:
        """The core's machine with these unknowns."""
        names = self.names[: len(self.chain.location_errors)]
        return self.chain.machine(dict(zip(names, x.tolist(), strict=False)))

    def apart_um(
        self, x: Floats, relation: Relation | None = None, machine: _core.Machine | None = None
    ) -> Floats:
        """Ball's centre minus tool's point in the machine's directions, (n, 3).

        ``machine``: That of these unknowns, where it is made already.
        """
        count = len(self.chain.location_errors)
        offsets = x[count : count + 3 * len(self.groups)].reshape(-1, 3)
        balls = (self.balls_mm + 1e-3 * offsets[: len(self.labels)])[self.index]
        if relation is None:
            apart = (machine or self.machine(x)).apart(self.axes, balls)
        else:
            apart = relation.apart_um(balls)
        return apart if self.tool_is_known else apart - offsets[-1]

    def modelled(self, x: Floats, machine: _core.Machine | None = None) -> Floats:
        """Readings of these unknowns, (n, 3) or (n, 1); ``machine``: as of `apart_um`."""
        machine = machine or self.machine(x)
        if self._stops is not None:
            there, stop = self._stops
            return np.asarray(there.modelled(x, machine)[stop])
        if len(self._parts) > 1:
            return np.concatenate([part.modelled(x, machine) for _, part in self._parts])
        apart = self.apart_um(x, machine=machine)
        if self.data.displacement_um is not None:
            return apart
        lengths: Floats = np.linalg.norm(apart, axis=1)[:, None]
        return lengths if self.bar_is_known else lengths + x[-1]

    def residuals(self, x: Floats) -> Floats:
        """Measured minus modelled, one after another."""
        return np.ravel(self.measured - self.modelled(x))

    def jacobian(self, x: Floats) -> Floats:
        """Derivative of the readings, (readings, unknowns), by central differences.

        What moves the ball across a bar changes its length in second order: no information.
        """
        steps = (STEP * np.isin(np.arange(len(x)), some) for some in self._together)
        beside = [(y, self.machine(y)) for d in steps for y in (x + d, x - d)]
        found = self._differenced(beside)
        size = np.sqrt(np.einsum("ij,ij->j", found, found) / len(found))
        found[:, size < RANK_TOLERANCE] = 0.0
        return found

    @cached_property
    def _together(self) -> list[list[int]]:
        """Unknowns that are moved together: offsets of all balls, of which a reading has one."""
        first = len(self.chain.location_errors)
        after = first + 3 * len(self.labels)
        alone = [[k] for k in (*range(first), *range(after, len(self.names)))]
        return [*alone, *(list(range(first + k, after, 3)) for k in range(3))]

    def _differenced(self, beside: Sequence[tuple[Floats, _core.Machine]]) -> Floats:
        """Return the derivative by central differences, (readings, unknowns).

        beside: Unknowns a step more and a step less of those of `_together`, with their machines.
        """
        each = self.measured.shape[1]
        if self._stops is not None:
            there, stop = self._stops
            readings = (each * stop[:, None] + np.arange(each)).ravel()
            return np.asarray(np.take(there._differenced(beside).T, readings, axis=1).T)
        found = in_columns(np.zeros((self.measured.size, len(self.names))))
        for rows, part in self._parts:
            part._difference(beside, found[each * rows.start : each * rows.stop])
        return found

    def _difference(self, beside: Sequence[tuple[Floats, _core.Machine]], out: Floats) -> None:
        """Put the same into an array of zeros."""
        changed = (self.modelled(x, machine).ravel() for x, machine in beside)
        ball = np.repeat(self.index, len(out) // len(self.data))
        for some, more, less in zip(self._together, changed, changed, strict=True):
            change = (more - less) / (2 * STEP)
            for number, k in enumerate(some):
                np.copyto(out[:, k], change, where=len(some) == 1 or ball == number)

    @cached_property
    def _stops(self) -> tuple[RotaryReadings, Integers] | None:
        """Readings at the different stops, and the stop of each; None: hardly fewer, or few.

        Runs go to the same positions again: what the machine does there is worked out once.
        """
        if self.measured.size < MANY_ROWS:
            return None
        stop, first = equal_rows([*self.axes.T, self.index])
        if 2 * len(first) > len(stop):
            return None
        return self._of(first), stop

    @cached_property
    def _parts(self) -> list[tuple[slice, RotaryReadings]]:
        """Some rows at a time, which a processor's cache holds with all that is made of them."""
        n, made = len(self.data), []
        for first in range(0, n, ROWS_AT_ONCE):
            rows = slice(first, min(first + ROWS_AT_ONCE, n))
            made.append((rows, self._of(rows) if n > ROWS_AT_ONCE else self))
        return made

    def _of(self, rows: slice | Integers) -> RotaryReadings:
        """Some of the readings, at stops of their own."""
        part = replace(self, data=self.data[rows], index=self.index[rows])
        vars(part).update(chain=self.chain, names=self.names, _stops=None)
        return part


def _stated(ball_mm: ArrayLike | Mapping[str | int, ArrayLike], names: list[str]) -> Floats:
    """Places of the balls of these labels as they are given, (balls, 3)."""
    if not isinstance(ball_mm, Mapping):
        return np.array([point("ball_mm", ball_mm)])
    given = {str(label): place for label, place in ball_mm.items()}
    if lacking := sorted(set(names) - set(given)):
        raise InputError(f"ball_mm: got none of ball {lacking[0]}, expected its place")
    return np.array([point("ball_mm", given[name]) for name in names])


def _from_readings(data: RotaryTest, setup: Setup, index: Integers) -> Floats:
    """Places of the balls where the readings of an R-test have them on average, (balls, 3)."""
    apart = data.displacement_um
    if apart is None:
        raise InputError(
            "rotary_test.balls_mm: got none, expected about where the ball is on the table, mm, "
            "[[x, y, z]] (in Python ball_mm): the readings of a ball-bar do not say it"
        )
    chain = Chain(setup)
    axes = commanded(chain, data)
    there = Relation.of(chain, axes, chain.named_errors(None)).ball_mm(apart)
    return np.array([there[index == number].mean(axis=0) for number in range(index.max() + 1)])
