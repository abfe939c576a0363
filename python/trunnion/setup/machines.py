"""Machines: the entries of ``machines.toml``, and the core's machine of a description."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import ClassVar

import trunnion._core as _core
from trunnion.base.checks import choose
from trunnion.base.errors import InputError, UnknownNameError
from trunnion.base.frozen import FrozenMapping
from trunnion.setup.fields import COORDINATE, Number, Part, Vector, key

Triple = tuple[float, float, float]
DIRECTION = Vector(3, Number(-1e6, 1e6))
UPRIGHT = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class _Code:
    """A kinematic code."""

    words: str = "a kinematic code of ISO 10791-6 such as \"[w C' A' b X Y Z (C) t]\""

    def __call__(self, what: str, value: object) -> str:
        if not isinstance(value, str):
            raise InputError(f"{what}: got {value!r}, expected {self.words}")
        return _core.Machine(value, 1.0, []).chain


CHAIN = _Code()


@dataclass(frozen=True)
class Description(Part):
    """Where the axes of a machine are, as far as they are not where their letters say."""

    table: ClassVar[str] = "machine"
    chain: str = key(..., CHAIN, "axes from the workpiece to the tool")
    meaning: str = ""
    table_normal: tuple[float, float, float] = key(
        UPRIGHT, DIRECTION, "of the table top at zero of all axes"
    )
    directions: Mapping[str, Triple] = FrozenMapping({})
    points_mm: Mapping[str, Triple] = FrozenMapping({})

    def core(self, length_mm: float, errors: Sequence[tuple[str, float]] = ()) -> _core.Machine:
        """Return the core's machine with location errors by canonical name, µm and arcsec."""
        return _core.Machine(
            self.chain,
            length_mm,
            list(errors),
            directions=list(self.directions.items()),
            points_mm=list(self.points_mm.items()),
            table_normal=self.table_normal,
        )


@dataclass(frozen=True)
class _Line(Part):
    """One axis of an entry."""

    table: ClassVar[str] = "axes"
    direction: tuple[float, float, float] | None = key(None, DIRECTION, "of a rotary axis")
    point_mm: tuple[float, float, float] | None = key(
        None, Vector(3, COORDINATE), "of a rotary axis"
    )


@cache
def presets() -> Mapping[str, Description]:
    """Return the machines that come with the package, by name."""
    text = files("trunnion.setup").joinpath("machines.toml").read_text(encoding="utf-8")
    return descriptions(text)


def descriptions(text: str) -> Mapping[str, Description]:
    """Return the machines of a text like ``machines.toml``."""
    made = {}
    for name, entry in tomllib.loads(text).items():
        lines = {letter: _Line(**line) for letter, line in entry.pop("axes", {}).items()}
        directions = {k: line.direction for k, line in lines.items() if line.direction is not None}
        points = {k: line.point_mm for k, line in lines.items() if line.point_mm is not None}
        made[name] = Description(directions=directions, points_mm=points, **entry)
    return made


def check_error(what: str, name: str, machine: _core.Machine) -> str:
    """Return the name of a location error of a machine.

    Raises UnknownNameError: it has none of this name; a redundant one says why.
    """
    known = [error for error, _ in machine.location_errors]
    reason = dict(machine.redundant_errors).get(name)
    if reason is not None:
        raise UnknownNameError(
            f"{what}: got {name!r}, which is redundant: {reason}; expected one of "
            f"{', '.join(known)}"
        )
    return choose(what, name, known)
