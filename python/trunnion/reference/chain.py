"""The chain of a set-up, read independently for the models that check the core's.

Only the names of the machine's location errors come from the core.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

LETTERS = dict(zip("ABC", np.eye(3), strict=True))
COMPONENTS = ("X", "Y", "Z", "A", "B", "C")


@dataclass(frozen=True)
class RotaryAxis:
    """A rotary axis at zero of all axes, machine frame.

    direction: Unit vector of its line.
    origin: Origin of its frame, mm: the point of its line nearest to the origin of the machine
        frame, on a head to the nominal pivot.
    offset: From the origin of the frame that carries it, mm.
    relative: For X, Y, Z, A, B, C its own error less that of the axis nearest below it that has one
        of this component: names, None where it has none itself.
    """

    letter: str
    direction: Floats
    origin: Floats
    offset: Floats
    relative: tuple[tuple[str, str | None] | None, ...]

    def amounts(self, errors: Mapping[str, float]) -> list[float]:
        """Offsets and tilts of its frame against the one that carries it."""
        out = []
        for pair in self.relative:
            own = 0.0 if pair is None else errors[pair[0]]
            below = 0.0 if pair is None or pair[1] is None else errors[pair[1]]
            out.append(own - below)
        return out


@dataclass(frozen=True)
class Axes:
    """Rotary axes of the head and of the table, each from the bed outwards."""

    head: tuple[RotaryAxis, ...]
    table: tuple[RotaryAxis, ...]

    @classmethod
    def of(cls, setup: Setup) -> Axes:
        """Axes of a set-up."""
        known = setup.description()
        work, tool = re.sub(r"\(.*?\)", "", known.chain).split("b")
        names = set(Chain(setup).location_errors)
        pivot = np.array([0.0, 0.0, setup.probe.length_mm])

        def side(letters: str, near: Floats) -> tuple[RotaryAxis, ...]:
            axes: list[RotaryAxis] = []
            for letter in (x for x in letters if x in LETTERS):
                direction = np.array(known.directions.get(letter, LETTERS[letter]), float)
                direction = direction / np.linalg.norm(direction)
                point = np.array(known.points_mm.get(letter, near), float)
                origin = point - direction * (direction @ (point - near))
                before = axes[-1].origin if axes else np.zeros(3)
                relative: list[tuple[str, str | None] | None] = []
                for component in COMPONENTS:
                    own = f"E{component}0{letter}"
                    below = (f"E{component}0{axis.letter}" for axis in reversed(axes))
                    carried = next((name for name in below if name in names), None)
                    relative.append((own, carried) if own in names else None)
                made = RotaryAxis(letter, direction, origin, origin - before, tuple(relative))
                axes.append(made)
            return tuple(axes)

        return cls(head=side(tool, pivot), table=side(work[::-1], np.zeros(3)))
