"""Rotary axes of a table or a head as lines in space and as elementary steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

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
    """Axes of a side, each carrying the next, and what they carry at zero of all.

    A point p of the work (of the tool) at zero of a machine without errors is at
    turn(first) turn(second) zero p, each turn right-handed about its line for a positive position.

    Attributes
    ----------
    points
        Points of the lines nearest to those of the nominal axes, mm, (axes, 3).
    directions
        Unit vectors, (axes, 3).
    zero
        Displacement of the table (of the tool) at zero, (4, 4).
    """

    points: Floats
    directions: Floats
    zero: Floats


def screws(setup: Setup, known: MachineErrors, side: Side = "table") -> Screw:
    """Lines of the axes of a side of a machine with errors.

    "table": in machine coordinates of the control. "head": along them, from where the tool length
    is 0 at zero of the head of a machine without errors.
    """
    mirror = np.diag(Chain(setup).linear_senses())
    ways = {link.letter: link.direction for link in (*links(setup).head, *links(setup).table)}
    given = setup.description().points_mm
    origin, base, usual = np.zeros(3), np.zeros(3), np.zeros(3)
    if side == "head":
        usual = np.array([0.0, 0.0, pivot_mm(setup) or 0.0])
        base = usual - [0.0, 0.0, setup.probe.length_mm]
    else:
        origin = table_centre(setup)
    place = np.eye(4)
    points, directions = [], []
    for step in steps(setup, known, side):
        if not step.is_axis:
            place = place @ _displacement(step)
            continue
        way = step.value * np.linalg.det(mirror) * mirror @ place[:3, :3] @ ways[step.key]
        nominal = base + given[step.key] if step.key in given else usual
        at = mirror @ place[:3, 3]
        points.append(origin + at + way * (way @ (mirror @ nominal - at)))
        directions.append(way)
    into = np.eye(4)
    into[:3, :3], into[:3, 3] = mirror, origin
    zero = into @ place @ np.linalg.inv(into)
    return Screw(np.array(points).reshape(-1, 3), np.array(directions).reshape(-1, 3), zero)


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


def turned_round(setup: Setup) -> dict[str, float]:
    """1 or -1 by letter: a shift along X, Y, Z, a turn about them (A, B, C) as the control counts.

    Linear axes may count the other way; then an axis turns the other way about two of them, in a
    left-handed system of the control, too.
    """
    mirror = Chain(setup).linear_senses()
    return dict(zip(COMPONENTS, [*mirror, *(mirror.prod() * mirror)], strict=True))


def _displacement(step: Step) -> Floats:
    """Shift or turn of a step that is no axis of the machine, (4, 4)."""
    out, i = np.eye(4), "XYZABC".index(step.key) % 3
    if step.key in "XYZ":
        out[i, 3] = step.value
    else:
        out[:3, :3] = Rotation.from_euler("xyz"[i], step.value, degrees=True).as_matrix()
    return out


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
