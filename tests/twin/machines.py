"""Any machine in numpy, written from the conventions: no code of the package, none of the core.

Frames of the machine are parallel at zero of all axes, where tool point and table top are in the
origin. An axis is translate(its place in the frame of its carrier) R(tilts) Rot(direction, angle);
location errors are absolute: an axis acts by the difference to the axis nearest below it, on the
same side, that has the same component. Everything is analytic, so that complex steps go through.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
LETTERS = {"A": (1.0, 0.0, 0.0), "B": (0.0, 1.0, 0.0), "C": (0.0, 0.0, 1.0)}
ARCSEC = np.pi / 648_000.0
PLACEMENT = ("dx_um", "dy_um", "dz_um", "ra_arcsec", "rb_arcsec", "rc_arcsec")


def turn(direction: Any, angle: Any) -> Array:
    """Rotation about a unit vector by Rodrigues' formula."""
    x, y, z = direction
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * (skew @ skew))


def tilts(a: Any, b: Any, c: Any) -> Array:
    """Rx(a) Ry(b) Rz(c)."""
    return turn(LETTERS["A"], a) @ turn(LETTERS["B"], b) @ turn(LETTERS["C"], c)


@dataclass(frozen=True)
class Layout:
    """A machine: kinematic code, and what is not where the letters say."""

    code: str
    directions: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    points: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    length: float = 150.0

    def side(self, tool: bool) -> list[str]:
        """Letters of the rotary axes of one side, from the bed outwards."""
        work, head = re.sub(r"\([^)]*\)", "", self.code).split("b")
        letters = head if tool else work[::-1]
        return [letter for letter in letters if letter in LETTERS]

    @property
    def letters(self) -> list[str]:
        """Rotary axes in the order of their positions."""
        return [*self.side(True), *self.side(False)]

    def line(self, letter: str) -> tuple[Array, Array]:
        """Unit direction, and the point of the line nearest to the origin (head: the pivot)."""
        d = np.array(self.directions.get(letter, LETTERS[letter]), float)
        d /= np.linalg.norm(d)
        near = np.array([0.0, 0.0, self.length if letter in self.side(True) else 0.0])
        p = np.array(self.points.get(letter, near), float)
        return d, p - d * (d @ (p - near))

    def end(
        self, tool: bool, angles: Mapping[str, Any], errors: Mapping[str, Any]
    ) -> tuple[Array, Array]:
        """Rotation and position of the end of a side: of the table, or of the tool point."""
        rotation, position = np.eye(3), np.zeros(3)
        before, below = np.zeros(3), dict.fromkeys("XYZABC", 0.0)
        for letter in self.side(tool):
            d, p = self.line(letter)
            own = dict.fromkeys("XYZABC", 0.0)
            for component in "XYZABC":
                name = f"E{component}0{letter}"
                if name in errors:
                    unit = 1e-3 if component in "XYZ" else ARCSEC
                    own[component] = errors[name] * unit - below[component]
                    below[component] = errors[name] * unit
            position = position + rotation @ (p - before + np.array([own[k] for k in "XYZ"]))
            rotation = rotation @ tilts(*(own[k] for k in "ABC")) @ turn(d, angles[letter])
            before = p
        return rotation, position - rotation @ before

    def tool(self, axes: Any, errors: Mapping[str, Any]) -> Array:
        """Tool point and direction in the table's frame; axes: X, Y, Z in mm, rad."""
        angles = dict(zip(self.letters, axes[3:], strict=True))
        rotation, origin = self.end(False, angles, errors)
        head, offset = self.end(True, angles, errors)
        point = rotation.T @ (axes[:3] + offset - origin)
        return np.concatenate([point, rotation.T @ head[:, 2]])

    def seat(self, placement: Mapping[str, Any], place: Any, turned: float) -> tuple[Array, Array]:
        """Rotation and position of the artefact in the table's frame."""
        x, y, z = np.array(self.normal, float) / np.linalg.norm(self.normal)
        lean = np.arctan2(-y, z), np.arcsin(x), turned
        shift = tilts(lean[0], lean[1], 0.0) @ np.array(place)
        moved = [placement.get(name, 0.0) for name in PLACEMENT]
        angles = (nominal + ARCSEC * more for nominal, more in zip(lean, moved[3:], strict=True))
        return tilts(*angles), shift + 1e-3 * np.array(moved[:3])


def way_to_box(
    layout: Layout,
    angles: Mapping[str, float],
    ball: Array,
    approach: Array,
    values: Mapping[str, Any],
    *,
    sizes: tuple[float, float, float],
    place: tuple[float, float, float],
    turned: float,
    radius: float,
) -> Any:
    """Way along the approach, mm, at which the ball touches a face of a box that stands on z = 0.

    ball: Its centre as the control records it: with the nominal head.
    values: Location errors and placement, µm and arcsec.
    """
    rotation, origin = layout.end(False, angles, values)
    seat, shift = layout.seat(values, place, turned)
    rotation, origin = rotation @ seat, origin + rotation @ shift
    head = layout.end(True, angles, values)[1] - layout.end(True, angles, {})[1]
    u = rotation.T @ (ball + head - origin) - np.array([0.0, 0.0, sizes[2] / 2])
    v = rotation.T @ approach
    axis = int(np.argmax(np.abs(v.real)))
    side = -np.sign(v[axis].real)
    return (side * (sizes[axis] / 2 + radius) - u[axis]) / v[axis]
