"""Where a machine is looked at: a box of the work, and positions of the rotary axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.checks import floats, shown, whole
from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.machine.chain import Chain
from trunnion.setup import Setup


class Where(TypedDict, total=False):
    """Fields of a :class:`Workspace` as arguments."""

    x_mm: ArrayLike
    y_mm: ArrayLike
    z_mm: ArrayLike
    a_deg: ArrayLike | None
    b_deg: ArrayLike | None
    c_deg: ArrayLike | None
    points: tuple[int, int, int]


STEPS_DEG = (10.0, 20.0)
"""Of a work space, tilting and turning: it has places between the nodes of a map of 15°."""
MAX_REACH_MM = 1e7  # of a box of the work: beyond it is a typo


@dataclass(frozen=True)
class Workspace:
    """A box of the work and positions of the rotary axes.

    x_mm, y_mm, z_mm: Each (low, high), or more than two nodes; workpiece's frame: the box turns
        with the table.
    a_deg, b_deg, c_deg: Positions of the rotary axes, control's sign: numbers, or sequences that
        span a grid.
    points: Nodes along x, y, z of each axis given as (low, high).
    """

    x_mm: ArrayLike = (-150, 150)
    y_mm: ArrayLike = (-120, 120)
    z_mm: ArrayLike = (0, 150)
    a_deg: ArrayLike | None = 0
    c_deg: ArrayLike | None = 0
    b_deg: ArrayLike | None = None
    points: tuple[int, int, int] = (31, 25, 16)

    def nodes(self) -> tuple[Floats, Floats, Floats]:
        """Nodes along x, y, z, mm."""
        x, y, z = (
            _axis_nodes(name, getattr(self, name), count)
            for name, count in zip(("x_mm", "y_mm", "z_mm"), self.points, strict=True)
        )
        return x, y, z

    def ends(self) -> tuple[Floats, Floats, Floats]:
        """Lowest and highest x, y, z, (2,) each, mm."""
        x, y, z = (
            _axis_nodes(name, getattr(self, name), 2)[[0, -1]] for name in ("x_mm", "y_mm", "z_mm")
        )
        return x, y, z

    def arguments(self) -> dict[str, Any]:
        """Return box and rotary positions as arguments; nodes between the ends are not set."""
        named: dict[str, Any] = {"x_mm": self.x_mm, "y_mm": self.y_mm, "z_mm": self.z_mm}
        named |= {"a_deg": self.a_deg, "c_deg": self.c_deg}
        return named if self.b_deg is None else {**named, "b_deg": self.b_deg}

    def in_words(self, setup: Setup) -> str:
        """Say box and ranges: ``X −150 to 150, ... mm on the table; A −90 to 90°``."""
        box = ", ".join(_span(x, ends) for x, ends in zip("XYZ", self.ends(), strict=True))
        turned = ", ".join(_span(k, q) for k, q in self.rotary(setup, spare=True)[0].items())
        return f"{box} mm on the table" + (f"; {turned} °" if turned else "")

    def rotary(
        self, setup: Setup, *, spare: bool = False
    ) -> tuple[dict[str, Floats], tuple[int, ...]]:
        """Positions of each rotary axis by letter (control's sign) and the shape of their grid.

        An axis that is not given stands at zero; a number takes no part in the shape. Positions of
        an axis that the machine lacks are refused unless `spare`.
        """
        given = {"A": self.a_deg, "B": self.b_deg, "C": self.c_deg}
        chain = Chain(setup)
        for letter, value in given.items() if not spare else ():
            if letter not in chain.letters and value is not None and np.any(np.asarray(value) != 0):
                raise InputError(
                    f"{letter.lower()}_deg: got {value!r}, expected none: machine "
                    f"{setup.machine.name} has the rotary axes {', '.join(chain.letters)}"
                )
        nodes: dict[str, Floats] = {}
        shape: list[int] = []
        for letter in chain.letters:
            value = given.get(letter)
            positions = floats(f"{letter.lower()}_deg", 0.0 if value is None else value)
            if positions.ndim > 1 or positions.size == 0:
                raise InputError(
                    f"{letter.lower()}_deg: got {value!r}, expected a number or a sequence"
                )
            shape.extend(positions.shape)
            nodes[letter] = np.atleast_1d(positions)
        return nodes, tuple(shape)


def work_space(setup: Setup) -> Workspace:
    """Return the work space of forecasts: the box on the table, the ranges of the rotary axes.

    Ranges are those that the set-up states, else ±90°, and a turn of the table.
    """
    ranges, chain = setup.axis_ranges(), Chain(setup)
    at: dict[str, Any] = {"a_deg": 0, "b_deg": None}
    for letter in chain.letters:
        low, high = ranges.get(letter, (0.0, 360.0) if letter == chain.turning else (-90.0, 90.0))
        step = STEPS_DEG[letter == chain.turning]
        count = 2 * int(np.ceil((high - low) / (2 * step))) + 1
        at[f"{letter.lower()}_deg"] = tuple(np.linspace(low, high, count).tolist())
    return Workspace(**at)


def _span(name: str, values: Floats) -> str:
    return f"{name} {values[0]:g} to {values[-1]:g}".replace("-", "−")


def pose_grid(setup: Setup, nodes: Mapping[str, Floats]) -> Floats:
    """Every combination of positions, contract's sign, shape (m, axes), last axis fastest."""
    chain = Chain(setup)
    if not chain.letters:
        return np.zeros((1, 0))
    axes = np.meshgrid(*(nodes[letter] for letter in chain.letters), indexing="ij")
    return np.stack(axes, axis=-1).reshape(-1, chain.count) * chain.senses


def _axis_nodes(name: str, given: ArrayLike, count: int) -> Floats:
    """Nodes of an axis: `count` from a pair (low, high), or more than two nodes as they are."""
    nodes = np.atleast_1d(floats(name, given))
    if np.any(np.abs(nodes) > MAX_REACH_MM):
        most = f"from -{MAX_REACH_MM:g} to {MAX_REACH_MM:g} mm"
        raise InputError(f"{name}: got {shown(given)}, expected numbers {most}")
    if nodes.shape == (2,) and nodes[0] < nodes[1]:
        return np.linspace(nodes[0], nodes[1], whole(f"points along {name}", count, 2, 100_000))
    if nodes.ndim != 1 or len(nodes) == 0 or np.any(np.diff(nodes) <= 0):
        raise InputError(f"{name}: got {shown(given)}, expected (low, high) or rising nodes, in mm")
    return nodes
