"""Rotary axes as lines in space (of a table) and as elementary steps, in machine coordinates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Floats, unit_of
from trunnion.compensation.machine import MachineErrors
from trunnion.controls.links import AXIS, COMPONENTS, Link, links, pivot_mm, table_centre
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

TABLES = ("AC", "BC", "AB")
Side: TypeAlias = Literal["table", "head"]


def table_letters(setup: Setup, control: str) -> str:
    """Return the letters of the rotary axes, two that carry the table: AC, BC or AB.

    Raises InputError: another machine; a set-up that does not say where the table is.
    """
    chain = Chain(setup)
    if set(chain.sides.values()) != {"table"} or chain.letters not in TABLES:
        raise InputError(
            f"{control}: got machine {setup.machine.name}, expected rotary axes under the table "
            "only, A or B carrying C, or A carrying B"
        )
    check_directions(setup, control)
    return chain.letters


@dataclass(frozen=True)
class Screw:
    """Two axes of a table, the first carrying the second, and the table at zero of both.

    A point p of the work, in machine coordinates at zero of a machine without errors, is at
    turn(first) turn(second) zero p, each turn right-handed about its line for a positive position.

    Attributes
    ----------
    points
        Points of the lines nearest to those of the nominal axes, mm, (2, 3).
    directions
        Unit vectors, (2, 3).
    zero
        Displacement of the table at zero, (4, 4).
    """

    points: Floats
    directions: Floats
    zero: Floats


def screws(setup: Setup, known: MachineErrors, control: str) -> Screw:
    """Lines of the axes of a machine with errors, in machine coordinates of the control."""
    letters = table_letters(setup, control)
    chain = Chain(setup)
    machine = chain.machine(known.errors)
    mirror = np.diag(chain.linear_senses())
    centre = table_centre(setup)
    into = np.eye(4)
    into[:3, :3], into[:3, 3] = mirror, centre

    def pose(rotary: Floats) -> Floats:
        rows = machine.table_pose(np.ascontiguousarray(rotary[None])).reshape(3, 4)
        whole = np.vstack([rows, [0.0, 0.0, 0.0, 1.0]])
        return np.asarray(into @ whole @ np.linalg.inv(into))

    zero = pose(np.zeros(2))
    nominal = setup.axis_points()
    points, directions = [], []
    for i, letter in enumerate(letters):
        turned = np.zeros(2)
        turned[i] = 90.0 * chain.senses[i]
        move = pose(turned) @ np.linalg.inv(zero)
        turn, shift = move[:3, :3], move[:3, 3]
        near = centre + mirror @ np.array(nominal.get(letter, (0.0, 0.0, 0.0)))
        fixed = np.eye(3) - turn
        points.append(near + np.linalg.pinv(fixed, rcond=1e-6) @ (shift - fixed @ near))
        skew = 0.5 * (turn - turn.T)
        axis = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
        directions.append(axis / np.linalg.norm(axis))
    return Screw(np.array(points), np.array(directions), zero)


@dataclass(frozen=True)
class Step:
    """A step along or about an axis of the frame so far.

    `key` is X Y Z A B C, or the letter of an axis of the machine; `value` is in mm or degrees, for
    an axis of the machine its sense, 1 or -1.
    """

    key: str
    value: float
    is_axis: bool = False


def steps(setup: Setup, known: MachineErrors, side: Side = "table") -> Iterator[Step]:
    """Shift, turns about X, Y, Z and axis of each link, from the machine frame outwards.

    "table": to the centre of the table top. "head": from a tool point at zero of the head to where
    the tool length is 0, the tool length taken off on the way in and out: it comes on top.
    """
    chain = links(setup)
    pivot = (pivot_mm(setup) or 0.0) if side == "head" else 0.0
    first, last = np.array([0.0, 0.0, pivot]), chain.seat
    if side == "head":
        last = chain.nose - first
    for link in chain.table if side == "table" else chain.head:
        for key, shift in zip(COMPONENTS, [*(link.offset + first), 0.0, 0.0, 0.0], strict=True):
            yield Step(key, float(shift) + _amount(link, key, known))
        yield Step(link.letter, link.sense, is_axis=True)
        first = np.zeros(3)
    for key, shift in zip("XYZ", last, strict=True):
        if shift:
            yield Step(key, float(shift))


def check_directions(setup: Setup, control: str) -> None:
    """Raise InputError: an axis that is not along X, Y or Z; no place of the table."""
    for letter, direction in setup.description().directions.items():
        if direction != AXIS[letter]:
            raise InputError(
                f"{control}: got axis {letter} along {list(direction)}, expected it along its own "
                "direction: its kinematics turn about X, Y and Z"
            )
    table_centre(setup)


def _amount(link: Link, key: str, known: MachineErrors) -> float:
    """Error of a link against what carries it, mm or degrees."""
    own, carried = link.errors.get(key, (None, None))
    if own is None:
        return 0.0
    value = known.errors.get(own, 0.0) - known.errors.get(carried or "", 0.0)
    return value * (1e-3 if unit_of(own) == "µm" else 1 / 3600)
