"""Section 3 of the paper: what an error does to a cube of commanded tool points.

The corners of a cube are commanded with the nominal inverse, the machine with the error goes there,
and the moved corners are compared: a rigid part, which a ball-bar cannot see because its ball's
centre is unknown, and the changes of the edges, which it can.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, finite, point, positive
from trunnion.base.errors import InputError
from trunnion.base.report import Result, Table
from trunnion.base.units import Floats
from trunnion.hybrid.mechanism import Mechanism
from trunnion.hybrid.parameters import PAPER_ERRORS, error_name

CORNERS: Floats = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
#: Pairs of corners that an edge joins: those that differ in one coordinate.
EDGES = tuple(
    (i, j)
    for i, j in itertools.combinations(range(8), 2)
    if np.count_nonzero(CORNERS[i] != CORNERS[j]) == 1
)


@dataclass(frozen=True, eq=False, repr=False)
class CubeChange(Result):
    """A cube before and after one error.

    Attributes
    ----------
    error, amount
        Name with unit, and size in that unit.
    nominal_mm, moved_mm
        Corners, machine frame, (8, 3).
    centre_um
        Displacement of the cube's centre, (3,).
    translation_um, rotation_arcsec
        Rigid part: the motion (about the centre) that fits the corners' displacements best.
    remainder_um
        What the rigid part leaves at each corner, (8, 3).
    edges_um
        Change of length of each edge, (12,), in the order of `EDGES`.
    circles_um
        Ball-bar view: change of distance from the centre along circles of half the cube's side in
        the planes XY, YZ, ZX through the centre, less the best circle centre, (3, 360).
    """

    error: str
    amount: float
    nominal_mm: Floats
    moved_mm: Floats
    centre_um: Floats
    translation_um: Floats
    rotation_arcsec: Floats
    remainder_um: Floats
    edges_um: Floats
    circles_um: Floats

    GRID: ClassVar = {
        "nominal_mm": ("corner", "direction"),
        "moved_mm": ("corner", "direction"),
        "remainder_um": ("corner", "direction"),
        "edges_um": ("edge",),
        "circles_um": ("plane", "degree"),
    }

    @property
    def shift_um(self) -> float:
        """How far the centre moves."""
        return float(np.linalg.norm(self.centre_um))

    @property
    def largest_edge_um(self) -> float:
        """Largest change of an edge."""
        return float(np.abs(self.edges_um).max())

    @property
    def turn_arcsec(self) -> float:
        """Angle of the rigid part."""
        return float(np.linalg.norm(self.rotation_arcsec))

    @property
    def ratio(self) -> float:
        """Largest change of an edge over the shift of the centre."""
        return self.largest_edge_um / self.shift_um if self.shift_um > 0 else np.inf

    def sentences(self) -> Sequence[str]:
        """Motion of the centre beside the change of the edges."""
        return (
            f"{self.error} = {self.amount:g}: centre {self.shift_um:.3f} µm, largest change of an "
            f"edge {self.largest_edge_um:.3f} µm, turn {self.turn_arcsec:.3f} arcsec.",
        )

    def tables(self) -> tuple[Table, ...]:
        """Displacement of each corner, and what the rigid motion leaves of it."""
        shift = (self.moved_mm - self.nominal_mm) * 1e3
        values = np.column_stack([self.nominal_mm, shift, self.remainder_um]).tolist()
        moved = ("dx µm", "dy µm", "dz µm", "residual x µm", "residual y µm", "residual z µm")
        columns = ("corner", "x mm", "y mm", "z mm", *moved)
        rows = [(str(k + 1), *row) for k, row in enumerate(values)]
        return (Table.of(f"Cube under {self.error} = {self.amount:g}", columns, rows, digits=3),)


@dataclass(frozen=True, eq=False, repr=False)
class CubeStudy(Result):
    """The transformed cube for several errors.

    Attributes
    ----------
    side_mm, centre_mm, direction
        The cube, and the tool's direction at every corner.
    changes
        One an error.
    """

    side_mm: float
    centre_mm: tuple[float, float, float]
    direction: tuple[float, float, float]
    changes: tuple[CubeChange, ...]

    def __getitem__(self, error: str) -> CubeChange:
        """Return the change under one error, by any spelling of its name."""
        changes = {change.error: change for change in self.changes}
        return changes[choose("error", error_name(error), changes)]

    @checked
    def below(self, ratio: float = 0.2) -> int:
        """Count the errors whose edges change by less than this fraction of the rigid motion."""
        return sum(change.ratio < ratio for change in self.changes)

    def tables(self) -> tuple[Table, ...]:
        """One row an error."""
        rows = [
            (
                c.error,
                int(c.amount) if c.amount == int(c.amount) else c.amount,
                c.shift_um,
                c.largest_edge_um,
                c.ratio,
                c.turn_arcsec,
                float(np.abs(c.circles_um).max()),
            )
            for c in self.changes
        ]
        place = ", ".join(f"{v:g}" for v in self.centre_mm)
        title = (
            f"Cube of {self.side_mm:g} mm at ({place}) mm, tool along "
            f"({', '.join(f'{v:.3g}' for v in self.direction)})"
        )
        columns = ("error", "amount", "centre µm", "edge µm", "share", "turn arcsec", "circle µm")
        return (Table.of(title, columns, rows, digits=3),)

    def sentences(self) -> Sequence[str]:
        """What it says of the paper's conclusion."""
        return (
            f"{self.below()} of {len(self.changes)} errors change no edge by one fifth of the "
            "rigid motion.",
        )


def _circles(radius_mm: float) -> tuple[Floats, Floats]:
    """Points of the three circles about the origin and their radial directions, (3, 360, 3)."""
    angle = np.radians(np.arange(360.0))
    units = np.zeros((3, 360, 3))
    for k, (i, j) in enumerate(((0, 1), (1, 2), (2, 0))):
        units[k, :, i], units[k, :, j] = np.cos(angle), np.sin(angle)
    return units * radius_mm, units


@checked
def cube_study(
    mechanism: Mechanism,
    errors: Sequence[str] | Mapping[str, float] = PAPER_ERRORS,
    *,
    side_mm: float = 200.0,
    centre_mm: ArrayLike = (0.0, -350.0, -1400.0),
    direction: ArrayLike = (0.0, 0.0, -1.0),
    amount: float = 10.0,
    wrist: int = 1,
) -> CubeStudy:
    """Move a cube by each error in turn, exactly (no linearisation).

    Parameters
    ----------
    mechanism
        The machine; errors that it already has act on both cubes.
    errors
        Names, each then of size `amount` (µm or arcsec), or names with sizes.
    side_mm, centre_mm, direction
        The cube, and the direction from spindle to tool point, kept at every corner.
    wrist
        Branch of the wrist, +1 or -1.

    Raises
    ------
    KinematicsError
        A corner out of reach.
    """
    centre, way = point("centre_mm", centre_mm), point("direction", direction)
    positive("side_mm", side_mm)
    if finite("amount", amount) == 0:
        raise InputError(f"amount: got {amount!r}, expected a number other than 0")
    given = errors if isinstance(errors, Mapping) else dict.fromkeys(errors, amount)
    sizes = {error_name(name): finite(name, size) for name, size in given.items()}
    points, units = _circles(side_mm / 2)
    arms = np.vstack([CORNERS * side_mm / 2, np.zeros((1, 3)), points.reshape(-1, 3)])
    commands = mechanism.nominal.inverse(arms + centre, way, wrist=wrist)
    before = mechanism.forward(commands).tip_mm
    changes = []
    for name, value in sizes.items():
        total = dict(mechanism.errors)
        total[name] = total.get(name, 0.0) + value
        after = mechanism.with_errors(total).forward(commands).tip_mm
        changes.append(_change(name, value, arms, before, after, units))
    return CubeStudy(side_mm, centre, way, tuple(changes))


@checked
def transformed_cube(
    mechanism: Mechanism, error: str, amount: float = 10.0, **cube: Any
) -> CubeChange:
    """Move one cube by one error; keywords as in :func:`cube_study`."""
    return cube_study(mechanism, {error: amount}, **cube).changes[0]


def _change(
    name: str, value: float, arms: Floats, before: Floats, after: Floats, units: Floats
) -> CubeChange:
    shift_um = (after - before) * 1e3
    corners = shift_um[:8]
    # Displacement = t + ω × arm, in µm, mm and mrad: linear least squares over the corners.
    design = np.zeros((8, 3, 6))
    design[:, :, :3] = np.eye(3)
    for k in range(3):
        design[:, :, 3 + k] = np.cross(np.eye(3)[k], arms[:8])
    rigid, *_ = np.linalg.lstsq(design.reshape(24, 6), corners.reshape(24), rcond=None)
    remainder = corners - design @ rigid
    edges = [
        np.linalg.norm(after[i] - after[j]) - np.linalg.norm(before[i] - before[j])
        for i, j in EDGES
    ]
    circles = np.zeros((3, 360))
    for k in range(3):
        circle = slice(9 + 360 * k, 9 + 360 * (k + 1))
        moved, start = (after[circle] - after[8]) * 1e3, (before[circle] - before[8]) * 1e3
        growth = np.linalg.norm(moved, axis=1) - np.linalg.norm(start, axis=1)
        # The centre of the circle is unknown to a ball-bar.
        centre, *_ = np.linalg.lstsq(units[k], growth, rcond=1e-9)
        circles[k] = growth - units[k] @ centre
    return CubeChange(
        error=name,
        amount=value,
        nominal_mm=before[:8],
        moved_mm=after[:8],
        centre_um=shift_um[8],
        translation_um=np.asarray(rigid[:3]),
        rotation_arcsec=np.asarray(rigid[3:] * 1e-3 * (648000 / np.pi)),
        remainder_um=remainder,
        edges_um=np.array(edges) * 1e3,
        circles_um=circles,
    )
