"""The machine in a posture: rotary axes, table, artefact, linear axes, probe.

Where an axis is follows from the poses of the chain alone, whatever its letter and direction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats
from trunnion.machine.chain import Chain
from trunnion.plot.scenes.traces import (
    Trace,
    annulus,
    arrows,
    ball,
    circle,
    edges_of,
    lines,
    mesh,
    prism,
    tube,
    words,
)
from trunnion.plot.style import BLUE, BODY, GREEN, MUTED, OCHRE, VERMILLION
from trunnion.setup import Setup

QUARTER = 90.0
TURN_DEG = 70.0  # of the curved arrow about an axis
AXIS_COLOURS = (VERMILLION, BLUE, GREEN)
STEM_MM = 40.0
TABLE = "#c3ccd3"
GAP = 0.4  # mm between the table top and what is drawn on it


@dataclass(frozen=True)
class AxisLine:
    """Where a rotary axis is: a point of it (mm) and the direction of its positive turn."""

    letter: str
    point: Floats
    direction: Floats


@dataclass(frozen=True)
class Posture:
    """The machine at rest: rotary positions in machine order, and the pose of the table."""

    chain: Chain
    rotary_deg: Floats

    @property
    def label(self) -> str:
        """Positions as the control counts them."""
        at = self.chain.to_control(self.rotary_deg[None])
        return ", ".join(f"{letter} {value[0]:g}°" for letter, value in at.items())

    def pose(self, row: Floats | None = None) -> tuple[Floats, Floats]:
        """Rotation and shift of the table here, or at other positions."""
        turn, shift = self.chain.table_pose((self.rotary_deg if row is None else row)[None])
        return turn[0], shift[0]

    def of_table(self, points: Floats) -> Floats:
        """Points of the table, machine frame."""
        turn, shift = self.pose()
        return np.asarray(points) @ turn.T + shift

    def to_table(self, points: Floats) -> Floats:
        """Points of the machine frame on the table."""
        turn, shift = self.pose()
        return (np.asarray(points) - shift) @ turn

    def axes(self) -> list[AxisLine]:
        """Every rotary axis, machine frame."""
        found = []
        for index, letter in enumerate(self.chain.letters):
            turned = self.rotary_deg.copy()
            turned[index] += QUARTER
            line = self._of_table_axis(turned) or self._of_head_axis(index)
            if line is not None:
                point, direction = line
                sense = float(self.chain.senses[index])
                found.append(AxisLine(letter, point, sense * direction))
        return found

    def _of_table_axis(self, turned: Floats) -> tuple[Floats, Floats] | None:
        """Axis of the motion from here to other positions; None if the table does not move."""
        (r0, t0), (r1, t1) = self.pose(), self.pose(turned)
        turn = r1 @ r0.T
        spin = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        if np.linalg.norm(spin) < 1e-6:
            return None
        shift = t1 - turn @ t0
        point = np.asarray(np.linalg.lstsq(np.eye(3) - turn, shift, rcond=None)[0], dtype=float)
        return point, np.asarray(spin / np.linalg.norm(spin))

    def _of_head_axis(self, index: int) -> tuple[Floats, Floats] | None:
        """Axis about which the tool point turns; None if it does not turn."""
        rows = np.zeros((3, 3 + len(self.rotary_deg)))
        rows[:, 3:] = self.rotary_deg
        rows[:, 3 + index] += [0.0, QUARTER, 2 * QUARTER]
        work = self.chain.machine({}).forward(rows)[:, :3]
        tips = self.of_table(work)
        across = np.cross(tips[1] - tips[0], tips[2] - tips[1])
        size = float(np.linalg.norm(across))
        return None if size < 1e-6 else ((tips[0] + tips[2]) / 2, across / size)


def posture(setup: Setup, positions: Mapping[str, float] | None = None) -> Posture:
    """Return a posture by letter, as the control counts; axes that are not given are at zero."""
    chain = Chain(setup)
    given = {letter.upper(): value for letter, value in (positions or {}).items()}
    whole = {letter: given.pop(letter, 0.0) for letter in chain.letters} | given
    return Posture(chain, chain.to_machine(whole, 1)[0])


def on_table(setup: Setup, points: Floats) -> Floats:
    """Points of the artefact's frame on the table, where the artefact nominally stands."""
    angle = np.radians(setup.artefact.turn_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    placed: Floats = points @ turn.T + np.asarray(setup.artefact.effective_place_mm)
    return placed


def artefact_outline(setup: Setup) -> Floats:
    """Outline of a cross or a cuboid, (n, 2), mm, artefact frame."""
    artefact = setup.artefact
    a, b = 0.5 * artefact.length_mm, 0.5 * artefact.width_mm
    if artefact.kind == "cuboid":
        return np.array([(-a, -b), (a, -b), (a, b), (-a, b)])
    corners = [
        (b, -a), (b, -b), (a, -b), (a, b), (b, b), (b, a),
        (-b, a), (-b, b), (-a, b), (-a, -b), (-b, -b), (-b, -a),
    ]  # fmt: skip
    return np.array(corners)


def artefact_traces(setup: Setup, at: Posture) -> list[Trace]:
    """The artefact in its true shape."""
    artefact = setup.artefact

    def placed(points: Floats) -> Floats:
        return at.of_table(on_table(setup, points))

    if artefact.kind == "none":
        return []
    if artefact.kind == "ring":
        radii = 0.5 * (artefact.diameter_mm or 0.0), 0.5 * (artefact.outer_diameter_mm or 0.0)
        points, faces = annulus(*radii, artefact.height_mm)
        return [mesh(placed(points), faces, colour=BODY)]
    shown = []
    for centre in map(np.array, artefact.centres_mm):
        points, faces = ball(centre, 0.5 * (artefact.diameter_mm or 0.0))
        shown.append(mesh(placed(points), faces, flatshading=False))
        if (stem := artefact.effective_stem_diameter_mm) > 0:
            points, faces = tube(centre * [1.0, 1.0, 0.0], centre, 0.5 * stem)
            shown.append(mesh(placed(points), faces, colour=MUTED))
    if shown:
        return shown
    outline = artefact_outline(setup)
    points, faces = prism(outline, 0.0, artefact.height_mm)
    rims = edges_of(outline, 0.0, artefact.height_mm, upright=True)
    return [
        mesh(placed(points), faces, colour=BODY),
        lines([placed(rim) for rim in rims], colour=MUTED, width=2),
    ]


def table_traces(setup: Setup, at: Posture) -> list[Trace]:
    """The table as a disc, with a notch line towards its own +X that shows how it is turned."""
    radius, thickness = setup.table.radius_mm, setup.table.thickness_mm
    points, faces = prism(circle(radius), -thickness, -GAP)
    rims = edges_of(circle(radius, 96), -thickness, 0.0, upright=False)
    notch = np.array([[0.75 * radius, 0.0, 0.0], [radius, 0.0, 0.0], [radius, 0.0, -thickness]])
    return [
        mesh(at.of_table(points), faces, colour=TABLE, opacity=0.75),
        lines([at.of_table(rim) for rim in rims], colour=MUTED, width=1.5),
        lines([at.of_table(notch)], colour=OCHRE, width=5, name="+X of the table"),
    ]


def axis_traces(at: Posture, reach: float) -> list[Trace]:
    """Each rotary axis as a dash-dotted line with its letter and a curved arrow of its + turn."""
    shown: list[Trace] = []
    for k, axis in enumerate(at.axes()):
        colour = AXIS_COLOURS[k % len(AXIS_COLOURS)]
        half = reach * axis.direction
        ends = np.array([axis.point - half, axis.point + half])
        shown.append(lines([ends], colour=colour, line={"dash": "longdashdot"}, width=4))
        shown.append(words(ends[1:] + 0.06 * half, [axis.letter], colour=colour, size=18))
        helper = [0.0, 0.0, 1.0] if abs(axis.direction[2]) < 0.9 else [1.0, 0.0, 0.0]
        x = np.cross(axis.direction, helper)
        x /= np.linalg.norm(x)
        y = np.cross(axis.direction, x)
        angle = np.radians(np.linspace(0.0, TURN_DEG, 24))[:, None]
        arc = axis.point + 0.88 * half + 0.16 * reach * (np.cos(angle) * x + np.sin(angle) * y)
        shown.append(lines([arc], colour=colour, width=4))
        last = arc[-1:] - arc[-2:-1]
        tip = 0.06 * reach * last / np.linalg.norm(last)
        shown += arrows(arc[-1:], tip, size_mm=4 * reach, colour=colour, width=4)
    return shown


def linear_traces(corner: Floats, reach: float) -> list[Trace]:
    """Directions of X, Y and Z at a corner of the scene."""
    ends = reach * np.eye(3)
    tails = np.tile(corner, (3, 1))
    return [
        *arrows(tails, ends, size_mm=6 * reach, colour=MUTED, width=4),
        words(tails + 1.15 * ends, ["X", "Y", "Z"], size=15),
    ]


def probe_traces(setup: Setup, centre: Floats) -> list[Trace]:
    """Ball and stem of the probe, the spindle along +Z."""
    probe = setup.probe
    points, faces = ball(centre, probe.ball_radius_mm)
    up = centre + np.array([0.0, 0.0, STEM_MM])
    stem_points, stem_faces = tube(centre, up, probe.effective_stem_radius_mm)
    return [
        mesh(points, faces, colour=VERMILLION, flatshading=False),
        mesh(stem_points, stem_faces, colour=MUTED),
    ]


def machine_traces(setup: Setup, at: Posture) -> list[Trace]:
    """Table, artefact and rotary axes of a posture."""
    return [
        *table_traces(setup, at),
        *artefact_traces(setup, at),
        *axis_traces(at, 1.2 * setup.table.radius_mm),
    ]
