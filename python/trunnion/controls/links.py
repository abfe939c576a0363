"""Rotary axes of a machine as frames that carry each other, from the bed outwards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

COMPONENTS = ("X", "Y", "Z", "A", "B", "C")
AXIS = {"A": (1.0, 0.0, 0.0), "B": (0.0, 1.0, 0.0), "C": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Link:
    """A rotary axis in the frame that carries it: shifts, turns about X, Y, Z, its own turn.

    Location errors are absolute: an axis acts by the difference to what carries it.

    letter, sense: Of the axis.
    direction: Unit vector of its line.
    offset: Nominal origin of its frame, mm; of the first axis of a head less the tool's reach.
    errors: Component (X to C) → its location error and the one that it is the difference to.
    """

    letter: str
    sense: float
    direction: Floats
    offset: Floats
    errors: Mapping[str, tuple[str, str | None]]


@dataclass(frozen=True)
class Links:
    """Axes of the head and of the table, each from the bed outwards.

    seat: From the frame of the table's last axis to the centre of the table top, mm.
    nose: From that of the head's last axis to the tool point, less the tool's reach along -Z.
    """

    head: tuple[Link, ...]
    table: tuple[Link, ...]
    seat: Floats
    nose: Floats


def links(setup: Setup) -> Links:
    """Nominal frames of a machine; points of a head count from a tool point at its zero."""
    chain = Chain(setup)
    reach = np.array([0.0, 0.0, setup.probe.length_mm])
    head, nose = _side(setup, [x for x in chain.letters if chain.sides[x] == "head"], reach)
    table, seat = _side(setup, [x for x in chain.letters if chain.sides[x] == "table"], np.zeros(3))
    return Links(head, table, seat, nose)


def table_centre(setup: Setup) -> Floats:
    """Centre of the table top in machine coordinates, mm, (3,).

    Raises InputError: the set-up does not say it.
    """
    if setup.control.centre_mm is None:
        raise InputError(
            "control.centre_mm: not given, expected the origin of the machine frame (the centre of "
            "the table top) in machine coordinates, as X, Y, Z of the work offset"
        )
    return np.array(setup.control.centre_mm)


def pivot_mm(setup: Setup) -> float | None:
    """From the pivot of a head to the gauge line of the spindle; None without a head.

    Raises InputError: a head, and the set-up does not say it.
    """
    if "head" not in Chain(setup).sides.values():
        return None
    if setup.control.pivot_mm is None:
        raise InputError(
            "control.pivot_mm: not given, expected the distance from the head's pivot to where "
            "the tool length is 0: probe.length_mm less the probe's length in the tool table"
        )
    return setup.control.pivot_mm


def _side(setup: Setup, letters: list[str], near: Floats) -> tuple[tuple[Link, ...], Floats]:
    """Return the axes of one side and the vector that ends it; `near` is subtracted from points."""
    known, chain = setup.description(), Chain(setup)
    made: list[Link] = []
    before = np.zeros(3)
    for letter in letters:
        direction = np.array(known.directions.get(letter, AXIS[letter]), dtype=float)
        direction /= np.linalg.norm(direction)
        point = np.array(known.points_mm.get(letter, near), dtype=float) - near
        origin = point - direction * (direction @ point)
        errors = {}
        for key in COMPONENTS:
            if (own := f"E{key}0{letter}") in chain.location_errors:
                below = (f"E{key}0{link.letter}" for link in reversed(made))
                errors[key] = (own, next((x for x in below if x in chain.location_errors), None))
        made.append(Link(letter, chain.sense_of(letter), direction, origin - before, errors))
        before = origin
    return tuple(made), -before
