"""Every move of a probing program, swept by plain numpy: what ball and stem come near to.

Nothing here is the planner's: poses are the twin's, distances those of points to boxes, spheres and
cylinders, and the artefact stands where a draw within its tolerance puts it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

import trunnion as tn
from trunnion.base.units import Floats
from trunnion.nc import follow
from trunnion.probing.program import ProbingProgram
from twin.machines import Layout

STEP_MM = 0.7
"""Between two samples of a move."""
STEM_STEP_MM = 2.0
BODY_STEP_MM, BODY_EVERY = 6.0, 4
"""Along the probe's body, and of which samples of a move: it is wide."""
FAR_MM = 400.0
"""How far along the stem a way down is swept: beyond everything on a table."""


@dataclass(frozen=True)
class Draw:
    """How the artefact really stands: shift (mm, table's frame) and turn (rad) from nominal."""

    shift_mm: Floats
    turn_rad: float

    @classmethod
    def within(cls, artefact: tn.Artefact, rng: np.random.Generator) -> Draw:
        """Half of the draws are at the end of the tolerance."""
        size = artefact.tolerance_mm * rng.choice([1.0, rng.uniform()])
        direction = rng.normal(size=3)
        turn = np.radians(artefact.tolerance_deg) * rng.choice([-1.0, 1.0, rng.uniform(-1, 1)])
        return cls(size * direction / np.linalg.norm(direction), float(turn))


@dataclass(frozen=True)
class Scene:
    """What stands in the way, in the table's frame, with the artefact where it really is."""

    setup: tn.Setup
    draw: Draw

    @property
    def _turned(self) -> Floats:
        angle = np.radians(self.setup.artefact.turn_deg) + self.draw.turn_rad
        cos, sin = np.cos(angle), np.sin(angle)
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    @property
    def _place(self) -> Floats:
        """Where its origin is; in a holder it sits `grip_mm` below the top unless stated."""
        a = self.setup.artefact
        place = np.array(a.place_mm)
        for held in (a.vise, a.chuck, a.plate):
            if isinstance(held, Mapping) and place[2] == 0.0:
                place[2] = held["height_mm"] - held.get("grip_mm", 0.0)
        return np.asarray(place + self.draw.shift_mm)

    def on_table(self, points: Floats) -> Floats:
        """Points (..., 3) of the artefact's frame in the table's."""
        return np.asarray(points @ self._turned.T + self._place)

    def _in_artefact(self, points: Floats) -> Floats:
        return np.asarray((points - self._place) @ self._turned)

    def artefact(self, points: Floats) -> Floats:
        """Distance of points (..., 3) to what is touched; negative inside a sphere."""
        a, local = self.setup.artefact, self._in_artefact(points)
        if a.centres_mm:
            assert a.diameter_mm is not None
            away = local[..., None, :] - np.array(a.centres_mm)
            return np.asarray(np.linalg.norm(away, axis=-1).min(axis=-1) - a.diameter_mm / 2)
        if a.kind == "ring":
            assert a.diameter_mm is not None
            assert a.outer_diameter_mm is not None
            out = np.hypot(local[..., 0], local[..., 1])
            beside = np.maximum(a.diameter_mm / 2 - out, out - a.outer_diameter_mm / 2)
            over = np.maximum(-local[..., 2], local[..., 2] - a.height_mm)
            return np.hypot(np.maximum(beside, 0.0), np.maximum(over, 0.0))
        sizes = [(a.length_mm, a.width_mm)]
        if a.kind == "cross":
            sizes.append((a.width_mm, a.length_mm))
        found = []
        for x, y in sizes:
            low, high = np.array([-x / 2, -y / 2, 0.0]), np.array([x / 2, y / 2, a.height_mm])
            found.append(np.linalg.norm(local - np.clip(local, low, high), axis=-1))
        return np.asarray(np.min(found, axis=0))

    def others(self, points: Floats) -> Floats:
        """Distance of points to the table and to the stem of a sphere."""
        t, a = self.setup.table, self.setup.artefact
        x, y, z = np.moveaxis(points, -1, 0)
        found = cylinder(np.hypot(x, y) - t.radius_mm, z, -t.thickness_mm, 0.0)
        stem = a.effective_stem_diameter_mm / 2
        for centre in self.on_table(np.array(a.centres_mm)) if stem > 0 and a.centres_mm else ():
            out = np.hypot(x - centre[0], y - centre[1]) - stem
            found = np.minimum(found, cylinder(out, z, 0.0, centre[2]))
        if self.chuck is not None:
            place = self.on_table(np.zeros(3))
            out = np.hypot(x - place[0], y - place[1]) - self.chuck[0] / 2
            found = np.minimum(found, cylinder(out, z, 0.0, self.chuck[1]))
        for middle_x, middle_y, x_mm, y_mm, z_mm in self.boxes:
            local = self._in_artefact(points) - [middle_x, middle_y, 0.0]
            local[..., 2] = z
            low, high = np.array([-x_mm / 2, -y_mm / 2, 0.0]), np.array([x_mm / 2, y_mm / 2, z_mm])
            nearest = np.clip(local, low, high)
            found = np.minimum(found, np.linalg.norm(local - nearest, axis=-1))
        return found

    @property
    def boxes(self) -> list[tuple[float, ...]]:
        """What holds the artefact: X and Y of the middle, lengths along X and Y, height."""
        a = self.setup.artefact
        found: list[tuple[float, ...]] = [] if a.base_mm is None else [(0.0, 0.0, *a.base_mm)]
        if isinstance(a.plate, Mapping):
            x, y = (2 * (half + a.plate["margin_mm"]) for half in self._half_mm)
            found.append((0.0, 0.0, x, y, a.plate["height_mm"]))
        if isinstance(a.vise, Mapping):
            v = a.vise
            found.append((0.0, 0.0, v["jaw_mm"], v["length_mm"], v["bed_mm"]))
            face = v["opening_mm"] / 2 if "opening_mm" in v else self._half_mm[1]
            for sign in (-1.0, 1.0):
                middle = sign * (face + v["thickness_mm"] / 2)
                found.append((0.0, middle, v["jaw_mm"], v["thickness_mm"], v["height_mm"]))
        return [*found, *(a.clamps_mm or ())]

    @property
    def chuck(self) -> tuple[float, float] | None:
        """Diameter and height of a chuck."""
        a = self.setup.artefact
        if isinstance(a.chuck, Mapping):
            return a.chuck["diameter_mm"], a.chuck["height_mm"]
        return a.chuck_mm

    @property
    def _half_mm(self) -> tuple[float, float]:
        """How far the artefact reaches from its origin along its X and Y."""
        a = self.setup.artefact
        if a.centres_mm:
            assert a.diameter_mm is not None
            along, across, _ = np.max(np.abs(a.centres_mm), axis=0) + a.diameter_mm / 2
            return float(along), float(across)
        if a.kind == "ring":
            assert a.outer_diameter_mm is not None
            return a.outer_diameter_mm / 2, a.outer_diameter_mm / 2
        return a.length_mm / 2, (a.length_mm if a.kind == "cross" else a.width_mm) / 2


def cylinder(out: Floats, z: Floats, low: float, high: float) -> Floats:
    """Distance to an upright cylinder, from the distance to its mantle and the height."""
    axial = np.maximum(np.maximum(low - z, z - high), 0.0)
    return np.asarray(np.hypot(np.maximum(out, 0.0), axial))


@dataclass(frozen=True)
class Move:
    """A straight move of the ball's centre as the control has it, the rotary axes at rest (deg)."""

    start: Floats
    end: Floats
    rotary: tuple[float, ...]
    is_approach: bool


def moves_of(program: ProbingProgram, plan: tn.Touches) -> Iterator[Move]:
    """The moves of a program at rest of its rotary axes, but for the ways back from a contact.

    Raises
    ------
    AssertionError
        An axis turns below the level of swinging; an approach is not there.
    """
    starts = plan.start_mm
    assert starts is not None
    moves = follow(program.moves)
    letters = [3 + "abc".index(letter) for letter in sorted(plan.rotary_deg)]
    row, is_back = 0, False
    looks = [np.array(look.start) for look in program.cycle.looks]  # approaches before all others
    for start, end, code in zip(moves.start, moves.end, moves.code, strict=True):
        if np.any(start[3:] != end[3:]):
            assert min(start[2], end[2]) >= program.cycle.swing - 1e-9
            continue
        at = looks[0] if looks else starts[row] if row < len(plan) else start[:3] + np.inf
        is_approach = code == 38 and np.abs(start[:3] - at).max() < 1e-4
        if not is_back:
            yield Move(start[:3], end[:3], tuple(end[letters].tolist()), bool(is_approach))
        is_back = bool(is_approach)
        if is_approach and looks:
            looks.pop(0)
        else:
            row += is_back
    assert row == len(plan)


def rotary_of(plan: tn.Touches) -> list[tuple[float, ...]]:
    """Positions of the rotary axes at each touch, A before B before C."""
    columns = [plan.rotary_deg[letter] for letter in sorted(plan.rotary_deg)]
    return [tuple(row) for row in np.reshape(columns, (len(columns), len(plan))).T.tolist()]


def approaches_of(plan: tn.Touches, twin: Twin, overtravel_mm: float) -> Iterator[Move]:
    """Every approach of a plan, and before it the way along the stem from above everything."""
    starts = plan.start_mm
    assert starts is not None
    ends = plan.position_mm + overtravel_mm * plan.direction
    for start, end, at in zip(starts, ends, rotary_of(plan), strict=True):
        yield Move(start + FAR_MM * twin.posture(at).stem, start, at, is_approach=False)
        yield Move(start, end, at, is_approach=True)


@dataclass(frozen=True)
class Posture:
    """The table's frame in the machine's (its Z square to the top), the stem's direction, and where
    the ball is from its commanded place."""

    rotation: Floats
    origin: Floats
    stem: Floats
    off: Floats


class Twin:
    """The twin's machine of a set-up, with its known errors."""

    def __init__(self, setup: tn.Setup) -> None:
        known = setup.description()
        self._layout = Layout(
            known.chain,
            known.directions,
            known.points_mm,
            known.table_normal,
            setup.probe.length_mm,
        )
        self._letters = sorted(self._layout.letters)
        self._sense = [setup.sense(letter) for letter in self._letters]
        self._errors = setup.machine.errors
        self.axes = len(self._sense)
        self.posture = cache(self._posture)

    def _posture(self, rotary_deg: tuple[float, ...]) -> Posture:
        """The machine with its axes at these positions of the control, A before B before C."""
        machine = np.radians(rotary_deg) * self._sense
        angles = dict(zip(self._letters, machine, strict=True))
        rotation, origin = self._layout.end(False, angles, self._errors)
        lean, _ = self._layout.seat({}, (0.0, 0.0, 0.0), 0.0)
        head, ball = self._layout.end(True, angles, self._errors)
        off = ball - self._layout.end(True, angles, {})[1]
        return Posture(rotation @ lean, origin, head[:, 2], off)


def swept(moves: Iterable[Move], setup: tn.Setup, scene: Scene, twin: Twin) -> None:
    """Sweep every move.

    Raises
    ------
    AssertionError
        Ball or stem touch something, but for the ball on the artefact in an approach; an approach
        that does not touch.
    """
    probe = setup.probe
    end = probe.stem_length_mm or probe.length_mm
    along = np.arange(0.0, end, STEM_STEP_MM)
    body = np.arange(end, probe.length_mm, BODY_STEP_MM)
    for move in moves:
        at = twin.posture(move.rotary)
        where = f"{move.start.round(2)} to {move.end.round(2)} at {np.round(move.rotary, 2)}"
        count = max(2, int(np.ceil(np.linalg.norm(move.end - move.start) / STEP_MM)) + 1)
        ball = move.start + np.linspace(0.0, 1.0, count)[:, None] * (move.end - move.start)
        stem = ball[:, None] + at.off + along[:, None] * at.stem
        stem_table = (stem - at.origin) @ at.rotation
        ball_table = stem_table[:, 0]
        gap = scene.artefact(ball_table) - probe.ball_radius_mm
        if move.is_approach:
            assert gap.min() < 0.0, f"touches nothing: {where}"
            until = int(np.argmax(gap < 0.0))  # the last sample in front of the contact
            assert until > 0, f"starts in the artefact: {where}"
            stem_table, ball_table, gap = stem_table[:until], ball_table[:until], gap[:until]
        assert gap.min() > 0.0, f"ball in the artefact: {where}"
        assert scene.others(ball_table).min() > probe.ball_radius_mm, f"ball: {where}"
        near = np.minimum(scene.artefact(stem_table), scene.others(stem_table))
        assert near.min() > probe.effective_stem_radius_mm, f"stem: {where}"
        if probe.body_diameter_mm > 0 and len(body):
            rim = circles(body, 0.5 * probe.body_diameter_mm, at.stem)
            around = ball[: len(ball_table) : BODY_EVERY, None] + at.off + rim
            around = (around - at.origin) @ at.rotation
            near = np.minimum(scene.artefact(around), scene.others(around))
            assert near.min() > 0.0, f"body: {where}"


def circles(along: Floats, radius: float, axis: Floats) -> Floats:
    """Points of a cylinder's mantle and of its front face, (n, 3), from where it begins."""
    across = np.linalg.svd(axis[None, :])[2][1:]
    angle = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle)]) @ across
    mantle = (along[:, None, None] * axis + radius * ring).reshape(-1, 3)
    front = [along[0] * axis + share * radius * ring for share in (0.3, 0.7)]
    return np.concatenate([mantle, *front])


def highest_when_turning(
    setup: tn.Setup, scene: Scene, twin: Twin, rng: np.random.Generator
) -> float:
    """Highest point of artefact, its stem and table over many positions of the axes, mm."""
    a, t = setup.artefact, setup.table
    angle = rng.uniform(0, 2 * np.pi, 200)
    rim = t.radius_mm * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = [rim, rim - [0.0, 0.0, t.thickness_mm]]
    if a.centres_mm:
        assert a.diameter_mm is not None
        out = rng.normal(size=(300, 3))
        out *= a.diameter_mm / 2 / np.linalg.norm(out, axis=1, keepdims=True)
        points += [out + np.array(centre) for centre in a.centres_mm]
    elif a.kind == "ring":
        assert a.outer_diameter_mm is not None
        circle = a.outer_diameter_mm / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points.append(np.column_stack([circle, np.full(len(circle), a.height_mm)]))
    else:
        half = np.array([a.length_mm, a.width_mm]) / 2
        for x, y in (half, half[::-1]) if a.kind == "cross" else (half,):
            corners = np.array(
                [[i * x, j * y, k] for i in (-1, 1) for j in (-1, 1) for k in (0, 1)]
            )
            points.append(corners * [1.0, 1.0, a.height_mm])
    held = [scene.on_table(np.concatenate(points[2:]))]
    for x, y, x_mm, y_mm, z_mm in scene.boxes:
        ends = [[x + i * x_mm / 2, y + j * y_mm / 2, 0.0] for i in (-1, 1) for j in (-1, 1)]
        corners = scene.on_table(np.array(ends))
        corners[:, 2] = z_mm
        held.append(corners)
    if scene.chuck is not None:
        out = scene.chuck[0] / 2 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        rim = out + scene.on_table(np.zeros(3))
        rim[:, 2] = scene.chuck[1]
        held.append(rim)
    everything = np.concatenate([*points[:2], *held])
    positions = rng.uniform(-180, 180, (500, twin.axes))
    positions[:50] = rng.choice([-90.0, 0.0, 90.0, 180.0], (50, twin.axes))
    poses = [twin.posture(tuple(row)) for row in positions.tolist()]
    return max(float((everything @ at.rotation[2] + at.origin[2]).max()) for at in poses)
