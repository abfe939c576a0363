"""Measurements whose truth is known: plans, random errors, hidden effects, noise, outliers.

    measurement = measure(rich_plan(), Setup(), truth, noise_um=0.3, tick_um=0.1, seed=1)
    measurement.columns["x_mm"] ...; write_touches(measurement, path); setup_toml(setup)

Readings are solved, not stepped, so a rich plan of 500 touches takes a few milliseconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.contact import distance, ticks_after, way_to_contact
from twin.forward import (
    EFFECTS,
    LOCATION_ERRORS,
    MM_PER_UM,
    PLACEMENT,
    Artefact,
    Conditions,
    Effects,
    Floats,
    Setup,
    Truth,
    approach_lines,
    nominal_placement,
    table_pose,
)

VISIBLE_UM = 0.05  # left of an effect of 1 µm, arcsec, ... that is seen
APPROACH_MM = 2.0
STEM_RADIUS_MM = 0.75
STEM_LENGTH_MM = 60.0
TABLE_RADIUS_MM = 150.0


# --- points on the artefact -----------------------------------------------------------------------


@dataclass(frozen=True)
class Point:
    """A nominal contact: where (mm) and outward normal, both in the artefact's frame."""

    label: int
    at: tuple[float, float, float]
    normal: tuple[float, float, float]
    face: str


def cross_points(artefact: Artefact) -> dict[int, Point]:
    """Labels 1..16: arms -Y, -X, +Y, +X seen from above, on each the top, left, end, right face."""
    L, w, h = artefact.length_mm, artefact.width_mm, artefact.height_mm
    out = (L - h) / 2
    points = {}
    for j, (name, arm) in enumerate(
        (("-Y", (0, -1)), ("-X", (-1, 0)), ("+Y", (0, 1)), ("+X", (1, 0)))
    ):
        ax, ay = arm
        lx, ly = -ay, ax  # left of the outward direction, seen from above
        on_arm = np.array([ax, ay]) * out
        left = np.array([lx, ly])
        first = 4 * j + 1
        made = (
            ((*on_arm, h), (0, 0, 1), f"top {name}"),
            ((*(on_arm + left * w / 2), h / 2), (lx, ly, 0), f"{name} left"),
            ((ax * L / 2, ay * L / 2, h / 2), (ax, ay, 0), f"{name} end"),
            ((*(on_arm - left * w / 2), h / 2), (-lx, -ly, 0), f"{name} right"),
        )
        for label, (at, normal, face) in enumerate(made, start=first):
            points[label] = Point(
                label,
                (float(at[0]), float(at[1]), float(at[2])),
                (float(normal[0]), float(normal[1]), float(normal[2])),
                face,
            )
    return points


def tilted_points(artefact: Artefact, a_deg: float, layout: str = "sides") -> dict[int, Point]:
    """Labels 17..20 at A = ±90: on the faces that look up, and the raised arm's top."""
    of = cross_points(artefact)
    up = a_deg > 0
    raised = (9, 11) if up else (1, 3)
    if layout == "sides":
        side = (8, 14) if up else (6, 16)  # the +Y faces of the X arms, or their -Y faces
    elif layout == "top":
        side = (5, 13)
    else:
        raise KeyError(f"no layout is called {layout!r}")
    chosen = {17: side[0], 18: raised[0], 19: raised[1], 20: side[1]}
    return {label: replace(of[source], label=label) for label, source in chosen.items()}


def cuboid_points(artefact: Artefact, per_face: int = 4) -> dict[int, Point]:
    """Four points on each of the five free faces, labels 1.. in face order top, +X, -X, +Y, -Y."""
    half = np.array([artefact.length_mm, artefact.width_mm, artefact.height_mm]) / 2
    points: dict[int, Point] = {}
    faces = {"top": (0, 0, 1), "+X": (1, 0, 0), "-X": (-1, 0, 0), "+Y": (0, 1, 0), "-Y": (0, -1, 0)}
    spots = [(-0.6, -0.5), (0.6, -0.5), (0.6, 0.5), (-0.6, 0.5)][:per_face]
    for face, normal in faces.items():
        n = np.array(normal, dtype=float)
        u = np.roll(np.abs(n), 1)
        v = np.roll(np.abs(n), 2)
        for p, q in spots:
            at = (n + p * u + q * v) * half + (0, 0, half[2])
            label = len(points) + 1
            points[label] = Point(
                label, (float(at[0]), float(at[1]), float(at[2])), (n[0], n[1], n[2]), face
            )
    return points


def sphere_points(artefact: Artefact) -> dict[int, Point]:
    """Pole, four on the equator, four at 45 degrees."""
    centre, r = np.array(artefact.centre_mm), artefact.diameter_mm / 2
    normals = [(0.0, 0.0, 1.0)]
    normals += [(np.cos(t), np.sin(t), 0.0) for t in np.pi / 2 * np.arange(4)]
    s = np.sqrt(0.5)
    normals += [(s * np.cos(t), s * np.sin(t), s) for t in np.pi / 2 * (np.arange(4) + 0.5)]
    points = {}
    for label, normal in enumerate(normals, start=1):
        n = np.round(normal, 15)
        at = centre + r * n
        points[label] = Point(
            label, (float(at[0]), float(at[1]), float(at[2])), (n[0], n[1], n[2]), "sphere"
        )
    return points


# --- plans ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Plan:
    """What the control gets, one row a touch; starts are recorded positions in mm."""

    conditions: Conditions
    start_mm: Floats
    cycle: NDArray[np.int64]
    point: NDArray[np.int64]
    face: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.conditions)

    def rows(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> Plan:
        """Some of the rows, by mask or by number."""
        k = self.conditions
        kept = Conditions(*(getattr(k, item.name)[which] for item in fields(Conditions)))
        numbers = np.arange(len(self))[which]
        return Plan(
            kept,
            self.start_mm[which],
            self.cycle[which],
            self.point[which],
            tuple(self.face[i] for i in numbers),
        )


def clear(point: Point, a_deg: float, c_deg: float, setup: Setup, approach_mm: float) -> bool:
    """Whether ball and stem get there and back without meeting artefact or table."""
    pose = table_pose(np.array([a_deg]), np.array([c_deg]), setup, Truth())[0, :3, :3]
    normal = np.array(point.normal)
    if (pose @ normal)[2] < -1e-9:
        return False
    up = pose.T @ np.array([0.0, 0.0, 1.0])
    r = setup.ball_radius_mm
    approach = np.linspace(0.0, approach_mm, 9)
    stem = np.linspace(0.0, STEM_LENGTH_MM, 61)
    touching = np.array(point.at) + normal * r
    balls = touching + approach[:, None] * normal
    stems = (balls[:, None, :] + stem[None, :, None] * up).reshape(-1, 3)
    # At the contact the ball is r from the face it touches; anything nearer is a collision.
    if distance(balls, setup.artefact).min() < r - 1e-9:
        return False
    if distance(stems, setup.artefact).min() < STEM_RADIUS_MM:
        return False
    over_table = np.hypot(stems[:, 0], stems[:, 1]) < TABLE_RADIUS_MM
    return not np.any(over_table & (stems[:, 2] < STEM_RADIUS_MM)) and bool(np.all(balls[:, 2] > r))


Position = tuple[float, float, float, float, int]  # a_deg, c_deg, a_dir, c_dir, cycle


def make_plan(
    setup: Setup,
    visits: Sequence[tuple[Position, Sequence[Point]]],
    *,
    feeds_mm_min: Sequence[float] = (600.0,),
    approach_mm: float = APPROACH_MM,
    seconds_per_touch: float = 8.0,
    seconds_per_turn: float = 20.0,
    mirror_feeds: bool = False,
) -> Plan:
    """Rows for each visit (a position of the axes and the points touched there), with time stamps.

    Several feeds take turns from touch to touch; ``mirror_feeds`` starts every other visit with the
    next one, so that a feed belongs to no point.
    """
    rows = [
        (position, point, feeds_mm_min[(n + v * mirror_feeds) % len(feeds_mm_min)])
        for v, (position, points) in enumerate(visits)
        for n, point in enumerate(points)
    ]
    a, c, a_dir, c_dir, cycle = (
        np.array(col, dtype=float) for col in zip(*(r[0] for r in rows), strict=True)
    )
    turned = np.r_[True, (np.diff(a) != 0) | (np.diff(c) != 0)]
    time_s = np.cumsum(seconds_per_touch + seconds_per_turn * turned)
    pose = table_pose(a, c, setup, Truth(errors=setup.known_errors))
    normal = np.array([r[1].normal for r in rows])
    at = np.array([r[1].at for r in rows])
    nominal = table_pose(a, c, setup, Truth())[:, :3, :3]
    outward = np.round(np.einsum("nij,nj->ni", nominal, normal), 15)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    surface = np.einsum("nij,nj->ni", pose[:, :3, :3], at) + pose[:, :3, 3]
    start = surface + outward * (setup.ball_radius_mm + approach_mm)
    if setup.linear_um > 0:
        step = setup.linear_um * MM_PER_UM
        start = np.round(start / step) * step
    return Plan(
        conditions=Conditions(
            a_deg=a,
            c_deg=c,
            direction=-outward,
            feed_mm_min=np.array([r[2] for r in rows], dtype=float),
            time_s=time_s,
            a_dir=a_dir,
            c_dir=c_dir,
        ),
        start_mm=start,
        cycle=cycle.astype(np.int64),
        point=np.array([r[1].label for r in rows]),
        face=tuple(r[1].face for r in rows),
    )


def paper_plan(
    setup: Setup | None = None,
    *,
    layout: str = "sides",
    c_deg: Sequence[float] = (0.0, 90.0, 180.0, 270.0),
    a_dir: tuple[int, int] = (1, -1),
    feed_mm_min: float = 600.0,
    approach_mm: float = APPROACH_MM,
) -> Plan:
    """The paper's 72 touches: 16 at every C, then 4 at A = +90 and 4 at A = -90.

    C always turns in the positive sense, back to zero too; ``a_dir`` says from where A came.
    """
    setup = setup or Setup()
    points = list(cross_points(setup.artefact).values())
    visits: list[tuple[Position, Sequence[Point]]] = [
        ((0.0, c, 0.0, 0.0 if n == 0 else 1.0, 1 if n == 0 else 2), points)
        for n, c in enumerate(c_deg)
    ]
    for a, sense in zip((90.0, -90.0), a_dir, strict=True):
        tilted = list(tilted_points(setup.artefact, a, layout).values())
        visits.append(((a, 0.0, float(sense), 1.0, 3), tilted))
    return make_plan(setup, visits, feeds_mm_min=(feed_mm_min,), approach_mm=approach_mm)


def rich_plan(
    setup: Setup | None = None,
    *,
    step_deg: float = 30.0,
    both_senses: bool = True,
    feeds_mm_min: Sequence[float] = (600.0, 200.0),
    approach_mm: float = APPROACH_MM,
) -> Plan:
    """C every 30 degrees at A = 0, A every 30 degrees at C = 0: 16 points or as many as are free.

    C turns forward through its positions, then backward; then A likewise. An axis keeps the sense
    of its last turn (A has none until it first turns). Feeds alternate, not bound to a point.
    """
    setup = setup or Setup()
    kinds = {"cross": cross_points, "cuboid": cuboid_points, "sphere": sphere_points}
    points = list(kinds[setup.artefact.kind](setup.artefact).values())

    def free(a: float, c: float) -> list[Point]:
        return [p for p in points if clear(p, a, c, setup, approach_mm)]

    senses = (1, -1) if both_senses else (1,)
    positions: list[Position] = []
    for sense in senses:
        turns = np.arange(0.0, 360.0, step_deg)[::sense]
        positions += [(0.0, float(c), 0.0, float(sense), 1 + (sense < 0)) for c in turns]
    for sense in senses:
        turns = np.arange(-90.0, 91.0, step_deg)[::sense]
        positions += [
            (float(a), 0.0, float(sense), float(senses[-1]), 3 + (sense < 0)) for a in turns if a
        ]
    visits = [(position, free(position[0], position[1])) for position in positions]
    return make_plan(
        setup, visits, feeds_mm_min=feeds_mm_min, approach_mm=approach_mm, mirror_feeds=True
    )


def repeated(plan: Plan, times: int) -> Plan:
    """The whole plan several times over, time running on."""
    k = plan.conditions
    length = k.time_s[-1] + 20.0
    tile = np.concatenate([k.time_s + n * length for n in range(times)])
    return Plan(
        conditions=Conditions(
            a_deg=np.tile(k.a_deg, times),
            c_deg=np.tile(k.c_deg, times),
            direction=np.tile(k.direction, (times, 1)),
            feed_mm_min=np.tile(k.feed_mm_min, times),
            time_s=tile,
            a_dir=np.tile(k.a_dir, times),
            c_dir=np.tile(k.c_dir, times),
        ),
        start_mm=np.tile(plan.start_mm, (times, 1)),
        cycle=np.tile(plan.cycle, times),
        point=np.tile(plan.point, times),
        face=plan.face * times,
    )


# --- random truth ---------------------------------------------------------------------------------


def random_errors(
    rng: np.random.Generator, preset: str = "trt-ca", um: float = 60.0, arcsec: float = 60.0
) -> dict[str, float]:
    return {
        name: rng.uniform(-1, 1) * (um if name[1] in "XYZ" else arcsec)
        for name in LOCATION_ERRORS[preset]
    }


def random_placement(
    rng: np.random.Generator, um: float = 100.0, arcsec: float = 100.0
) -> dict[str, float]:
    return {
        name: rng.uniform(-1, 1) * (um if name.endswith("_um") else arcsec) for name in PLACEMENT
    }


def random_effect(rng: np.random.Generator, id_: str, plan: Plan) -> dict[str, float]:
    """Parameters of one effect in a random direction; times within the measurement."""
    end = float(plan.conditions.time_s[-1])
    values = {name: float(rng.normal()) for name in EFFECTS[id_]}
    if id_ == "setup_shift":
        values["t0_s"] = float(rng.uniform(0.2, 0.8) * end)
    if id_ == "warmup_z":
        values["tau_min"] = float(rng.uniform(0.1, 0.6) * end / 60.0)
    return values


# --- how much of an effect is left after the plain fit --------------------------------------------


def readings_um(plan: Plan, setup: Setup, truth: Truth, extra_um: Floats | None = None) -> Floats:
    """Exact readings (n,): the way from the planned start to the contact, in µm."""
    extra = 0.0 if extra_um is None else extra_um * MM_PER_UM
    lines = approach_lines(plan.conditions, plan.start_mm, setup, truth, extra)
    return way_to_contact(lines) / MM_PER_UM


def location_names(setup: Setup) -> tuple[str, ...]:
    return LOCATION_ERRORS[setup.preset]


def jacobian(plan: Plan, setup: Setup, truth: Truth | None = None, step: float = 1.0) -> Floats:
    """Central differences (n, p) of the readings by location errors, then by placement.

    Units are µm per µm or arcsec; on flat faces the readings are as good as linear over a step.
    """
    truth = truth or Truth()
    columns = []
    for name in (*location_names(setup), *PLACEMENT):
        group = "placement" if name in PLACEMENT else "errors"
        at = dict(getattr(truth, group))
        ends = []
        for sign in (1, -1):
            moved = {**at, name: at.get(name, 0.0) + sign * step}
            ends.append(readings_um(plan, setup, replace(truth, **{group: moved})))
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.stack(columns, axis=1)


def effect_change_um(plan: Plan, setup: Setup, effects: Effects) -> Floats:
    """What effects change in each reading of a perfect machine, µm along the approach."""
    return readings_um(plan, setup, Truth(effects=effects)) - readings_um(plan, setup, Truth())


def effect_columns(plan: Plan, setup: Setup, id_: str, **fixed: float) -> Floats:
    """One column a linear parameter of the effect; ``fixed`` are t0_s or tau_min."""

    def change(name: str, value: float) -> Floats:
        return effect_change_um(plan, setup, {id_: {**fixed, name: value}})

    columns = [
        (change(name, 1.0) - change(name, -1.0)) / 2 for name in EFFECTS[id_] if name not in fixed
    ]
    return np.stack(columns, axis=1)


def basis_of(design: Floats) -> Floats:
    """Orthonormal columns of all that a design's columns make."""
    scaled = design / np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(u[:, s > 1e-9 * s[0]])


def left_of(change_um: Floats, design: Floats) -> Floats:
    """What of a change no combination of the design's columns makes."""
    basis = basis_of(design)
    return np.asarray(change_um - basis @ (basis.T @ change_um))


class Sizing:
    """Scales effects to the rms (over all touches) that they leave after the plain fit.

    Made once for a plan and set-up: the plain design and the catalogue's columns are kept.
    """

    def __init__(self, plan: Plan, setup: Setup) -> None:
        self.plan, self.setup = plan, setup
        self.plain = jacobian(plan, setup)

    def rms_left_um(self, effects: Effects) -> float:
        change = left_of(effect_change_um(self.plan, self.setup, effects), self.plain)
        return float(np.sqrt(np.mean(change**2)))

    def scaled(self, id_: str, values: Mapping[str, float], rms_um: float) -> dict[str, float]:
        """The same effect, linear parameters scaled to rms_um; refused where nothing is left."""
        linear = [name for name in values if name not in ("t0_s", "tau_min")]
        now = self.rms_left_um({id_: values})
        size = max(abs(values[name]) for name in linear)
        if now < 1e-4 * size:
            raise ValueError(f"{id_} cannot be seen under this plan: it leaves {now:.2g} µm")
        return {n: v * rms_um / now if n in linear else v for n, v in values.items()}

    def visible(self, id_: str, rng: np.random.Generator, least: float = VISIBLE_UM) -> bool:
        values = random_effect(rng, id_, self.plan)
        size = max(abs(v) for n, v in values.items() if n not in ("t0_s", "tau_min"))
        return self.rms_left_um({id_: values}) > least * size

    @property
    def catalogue(self) -> Floats:
        """The plain design and every column the catalogue can add, but for slips."""
        if not hasattr(self, "_catalogue"):
            end = float(self.plan.conditions.time_s[-1])
            columns = [self.plain]
            for id_ in EFFECTS:
                if id_ == "setup_shift":
                    continue
                if id_ == "warmup_z":
                    columns += [
                        effect_columns(self.plan, self.setup, id_, tau_min=end / 60.0 * f)
                        for f in (0.1, 0.3, 0.6)
                    ]
                else:
                    columns.append(effect_columns(self.plan, self.setup, id_))
            self._catalogue = np.hstack(columns)
        return self._catalogue

    def change_um(self, extra_um: Floats) -> Floats:
        """Change of the readings by a displacement field (n, 3)."""
        with_it = readings_um(self.plan, self.setup, Truth(), extra_um)
        return np.asarray(with_it - readings_um(self.plan, self.setup, Truth()))

    def scaled_unknown(
        self, extra_um: Floats, rms_um: float, *, beyond: Floats | None = None
    ) -> Floats:
        """A displacement field (n, 3) scaled to leave rms_um in what the model cannot make.

        ``beyond`` is the design after which it is measured: the plain one if nothing is given, the
        ``catalogue`` for something that no combination of causes can make.
        """
        change = self.change_um(extra_um)
        rest = left_of(change, self.plain if beyond is None else beyond)
        left = float(np.sqrt(np.mean(rest**2)))
        if left < 1e-4 * np.abs(change).max():
            raise ValueError(f"the model absorbs this: {left:.2g} µm are left")
        return np.asarray(extra_um * (rms_um / left))

    @property
    def with_shift(self) -> list[Floats]:
        """Orthonormal columns of the catalogue with a shift of the artefact, of each of 24 moments.

        A jump of all touches at A = 0 is such a shift, and so, nearly, is what one C position has.
        """
        if not hasattr(self, "_with_shift"):
            self._with_shift = []
            for share in np.arange(1, 24) / 24:
                t0_s = float(share * self.plan.conditions.time_s[-1])
                slip = effect_columns(self.plan, self.setup, "setup_shift", t0_s=t0_s)
                self._with_shift.append(basis_of(np.hstack([self.catalogue, slip])))
        return self._with_shift

    def shift_makes(self, extra_um: Floats, rms_um: float) -> bool:
        """Whether a shift of the artefact makes most (3/4 of the variance) of what is left."""
        change = self.change_um(extra_um)
        left = [change - u @ (u.T @ change) for u in self.with_shift]
        return min(float(np.mean(x**2)) for x in left) < (rms_um / 2) ** 2

    def unknown(
        self, rng: np.random.Generator, kind: str, rms_um: float, *, at_most: float = 15.0
    ) -> Unknown:
        """A random effect outside the catalogue, of which rms_um are left beyond all of it.

        One that has to be larger than ``at_most`` times that, because known causes take most of it,
        is drawn again: what remains would be a matter of chance.
        """
        for _ in range(500):
            drawn = unknown_effect(rng, self.plan, kind)
            known = self.catalogue
            if drawn.t0_s is not None:
                slip = effect_columns(self.plan, self.setup, "setup_shift", t0_s=drawn.t0_s)
                known = np.hstack([known, slip])
            try:
                extra = self.scaled_unknown(drawn.extra_um, rms_um, beyond=known)
            except ValueError:
                continue
            if np.abs(extra).max() <= at_most * rms_um:
                return replace(drawn, extra_um=extra)
        raise ValueError(
            f"no effect of kind {kind!r} can be distinguished from the catalogue by this plan"
        )


# --- effects outside the catalogue ----------------------------------------------------------------


@dataclass(frozen=True)
class Unknown:
    """A displacement (n, 3) of the recorded position in µm that no known cause makes."""

    kind: str  # smooth, periodic, time, place, jump, face, point
    quantity: str  # on what it depends: c_deg, a_deg, time_s, x_mm, y_mm, z_mm, face, point
    component: str  # in which machine direction: x, y, z, or n for along each approach
    extra_um: Floats
    t0_s: float | None = None  # of a jump


def unknown_effect(rng: np.random.Generator, plan: Plan, kind: str) -> Unknown:
    """A random effect of the kind, of about 1 µm; ``Sizing.unknown`` gives one of a given size."""
    k = plan.conditions
    component = str(rng.choice(["x", "y", "z", "n"]))
    axis = {"x": 0, "y": 1, "z": 2}.get(component)
    t0_s = None
    tilts_enough = len(np.unique(k.a_deg)) > 4
    if kind in ("smooth", "periodic"):
        quantity = str(rng.choice(["c_deg", "a_deg"] if tilts_enough else ["c_deg"]))
        angle = np.radians(getattr(k, quantity))
        if kind == "periodic":
            order = int(rng.integers(3, 6))
            shape = np.cos(order * angle + rng.uniform(0, 2 * np.pi))
        else:
            reach = (0, 2 * np.pi) if quantity == "c_deg" else (-np.pi / 2, np.pi / 2)
            width = rng.uniform(0.35, 0.7)
            middle = rng.uniform(*reach)
            away = angle - middle
            if quantity == "c_deg":
                away = (away + np.pi) % (2 * np.pi) - np.pi
            shape = np.exp(-0.5 * (away / width) ** 2)
    elif kind == "time":
        quantity = "time_s"
        share = k.time_s / k.time_s[-1]
        shape = (
            np.sin(2 * np.pi * (rng.uniform(1.5, 4) * share + rng.uniform()))
            if rng.uniform() < 0.5
            else np.exp(-0.5 * ((share - rng.uniform(0.2, 0.8)) / rng.uniform(0.08, 0.2)) ** 2)
        )
    elif kind == "place":
        i = int(rng.integers(3)) if tilts_enough else int(rng.integers(2))
        quantity = ("x_mm", "y_mm", "z_mm")[i]
        place = plan.start_mm[:, i] / 50.0
        shape = np.cos(rng.uniform(1.5, 4) * place + rng.uniform(0, 2 * np.pi))
    elif kind == "jump":
        quantity = "time_s"
        t0_s = float(rng.uniform(0.25, 0.75) * k.time_s[-1])
        shape = (k.time_s >= t0_s).astype(float)
    elif kind in ("face", "point"):
        quantity = kind
        labels = np.array(plan.face) if kind == "face" else plan.point
        shape = (labels == rng.choice(np.unique(labels))).astype(float)
        axis, component = None, "n"
    else:
        raise KeyError(f"no unknown effect is of kind {kind!r}")
    way = -k.direction if axis is None else np.tile(np.eye(3)[axis], (len(k), 1))
    return Unknown(kind, quantity, component, shape[:, None] * way, t0_s)


# --- a measurement --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Measurement:
    """Recorded touches (``columns`` as in touches.csv) and what was hidden in them."""

    columns: dict[str, NDArray[np.generic]]
    plan: Plan
    setup: Setup
    truth: Truth
    noise_um: float
    tick_um: float
    outliers: tuple[int, ...] = ()
    unknown: Unknown | None = None
    seed: int = 0
    way_um: Floats = field(default_factory=lambda: np.zeros(0), repr=False)

    def __len__(self) -> int:
        return len(self.plan)


def measure(
    plan: Plan,
    setup: Setup,
    truth: Truth,
    *,
    noise_um: float = 0.3,
    noise: str = "gaussian",
    tick_um: float = 0.1,
    random_phase: bool = True,
    outlier_share: float = 0.0,
    outlier_sigma: tuple[float, float] = (10.0, 200.0),
    unknown: Unknown | None = None,
    seed: int = 0,
) -> Measurement:
    """Touch every row of the plan.

    The trigger fires at the exact contact plus noise (1 σ; "gaussian", or "heavy": Student's t with
    4 degrees of freedom and the same σ); what is recorded is the first tick after that, counted
    from the start. ``random_phase`` moves each start by a random part of the tick, as a
    free-running probe input does; otherwise ticks count from the plan's rounded start. Bad touches
    are moved by 10 to 200 σ either way; where there is no noise, σ is that of a tick.
    """
    rng = np.random.default_rng(seed)
    start = plan.start_mm
    k = plan.conditions
    tick = tick_um * MM_PER_UM
    if random_phase and tick > 0:
        start = start - rng.uniform(0, tick, len(plan))[:, None] * k.direction
    extra = None if unknown is None else unknown.extra_um
    way = readings_um(replace(plan, start_mm=start), setup, truth, extra)
    if noise == "gaussian":
        way = way + np.asarray(noise_um * rng.standard_normal(len(plan)))
    elif noise == "heavy":
        way = way + np.asarray(noise_um * rng.standard_t(4, len(plan)) / np.sqrt(2.0))
    else:
        raise KeyError(f"no noise is called {noise!r}")
    bad = np.sort(rng.permutation(len(plan))[: round(outlier_share * len(plan))])
    sigma = max(noise_um, tick_um / np.sqrt(12))
    size = rng.uniform(*outlier_sigma, len(bad)) * rng.choice([-1, 1], len(bad))
    way[bad] += size * sigma
    if tick > 0:
        way = np.multiply(ticks_after(way, tick_um), tick_um, dtype=np.float64)
    recorded = start + (way * MM_PER_UM)[:, None] * k.direction
    first = setup.tilt_letter.lower()
    columns: dict[str, NDArray[np.generic]] = {
        f"{first}_deg": k.a_deg,
        "c_deg": k.c_deg,
        "x_mm": recorded[:, 0],
        "y_mm": recorded[:, 1],
        "z_mm": recorded[:, 2],
        "dir_x": k.direction[:, 0],
        "dir_y": k.direction[:, 1],
        "dir_z": k.direction[:, 2],
        "cycle": plan.cycle,
        "point": plan.point,
        "feed_mm_min": k.feed_mm_min,
        "time_s": k.time_s,
        f"{first}_dir": k.a_dir.astype(np.int64),
        "c_dir": k.c_dir.astype(np.int64),
    }
    return Measurement(
        columns,
        plan,
        setup,
        truth,
        noise_um,
        tick_um,
        outliers=tuple(int(i) for i in bad),
        unknown=unknown,
        seed=seed,
        way_um=way,
    )


# --- files ----------------------------------------------------------------------------------------


def write_touches(measurement: Measurement, path: Path) -> None:
    """touches.csv of the contract; nothing is rounded."""
    columns = measurement.columns
    lines = [",".join(columns)]
    lines += [",".join(repr(v.item()) for v in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def setup_toml(setup: Setup) -> str:
    """setup.toml of the contract."""
    a = setup.artefact
    lines = ["[machine]", f'preset = "{setup.preset}"', "", "[machine.errors]"]
    lines += [f"{name} = {float(value)!r}" for name, value in setup.known_errors.items()]
    for letter, sense in setup.sense.items():
        lines += ["", f"[axes.{letter}]", f"sense = {sense}"]
    lines += ["", "[artefact]", f'kind = "{a.kind}"']
    if a.kind == "sphere":
        lines += [f"diameter_mm = {a.diameter_mm!r}", f"centre_mm = {list(a.centre_mm)!r}"]
    else:
        lines += [f"{n} = {getattr(a, n)!r}" for n in ("length_mm", "width_mm", "height_mm")]
    lines += ["", "[probe]", f"ball_radius_mm = {setup.ball_radius_mm!r}"]
    lines += [f"repeatability_um = {setup.repeatability_um!r}", f"tick_um = {setup.tick_um!r}"]
    lines += ["", "[resolution]", f"linear_um = {setup.linear_um!r}"]
    lines += [f"rotary_arcsec = {setup.rotary_arcsec!r}"]
    return "\n".join(lines) + "\n"


@lru_cache(maxsize=8)
def standard(plan_name: str) -> tuple[Plan, Setup, Sizing]:
    """("paper" or "rich") with the standard cross, and its sizing, made once a run."""
    setup = Setup(tick_um=0.1)
    plan = paper_plan(setup) if plan_name == "paper" else rich_plan(setup)
    return plan, setup, Sizing(plan, setup)


# --- touches anywhere -----------------------------------------------------------------------------


def random_touches(rng: np.random.Generator, setup: Setup, n: int, reach_mm: float = 0.3) -> Plan:
    """Touches at random A, C, from random sides: on faces, over edges and corners, into corners.

    They need not be reachable for a real probe; each starts about ``reach_mm`` before the nominal
    surface and meets the nominal artefact.
    """
    artefact, r = setup.artefact, setup.ball_radius_mm
    found: list[Floats] = []
    expected = n
    while expected > 0:
        m = 2 * expected + 16
        if artefact.kind == "sphere":
            normal = rng.normal(size=(m, 3))
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            at = np.array(artefact.centre_mm) + artefact.diameter_mm / 2 * normal
        else:
            half = np.array([artefact.length_mm, artefact.width_mm, artefact.height_mm]) / 2
            swap = rng.uniform(size=m) < (0.5 if artefact.kind == "cross" else 0.0)
            halves = np.where(swap[:, None], half[[1, 0, 2]], half)
            axis = rng.integers(3, size=m)
            normal = np.eye(3)[axis] * rng.choice([-1.0, 1.0], m)[:, None]
            normal[:, 2] = np.abs(normal[:, 2])
            spread = rng.uniform(-1, 1, (m, 3)) * (halves + 0.8 * r)
            edge = (rng.uniform(size=(m, 3)) < 0.3) * (halves + rng.uniform(-1.2, 1.2, (m, 3)) * r)
            spread = np.where(edge != 0, edge * rng.choice([-1.0, 1.0], (m, 3)), spread)
            if artefact.kind == "cross":
                near = halves[:, [1, 0, 2]] + rng.uniform(-1.5, 1.5, (m, 3)) * r
                inner = (rng.uniform(size=m) < 0.2)[:, None] & np.array([True, True, False])
                spread = np.where(inner, near * rng.choice([-1.0, 1.0], (m, 3)), spread)
            at = np.where(normal != 0, normal * halves, spread)
            at[:, 2] += half[2]
        way = -normal + rng.uniform(-0.5, 0.5, (m, 3)) * rng.choice([0.0, 1.0], m)[:, None]
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        start = at + normal * r - way * reach_mm
        before = distance(start, artefact)
        last = distance(start + way * 2 * reach_mm, artefact)
        # Past the nearest point a ball may have gone through: such rows are simply left out.
        good = (before > r + 0.2 * reach_mm) & (last < r - 0.2 * reach_mm)
        found.append(np.hstack([start, way])[good][:expected])
        expected -= len(found[-1])
    start, way = np.split(np.concatenate(found), 2, axis=1)
    a, c = rng.uniform(-100, 100, n), rng.uniform(0, 360, n)
    pose = table_pose(a, c, setup, Truth()) @ nominal_placement(setup)
    direction = np.einsum("nij,nj->ni", pose[:, :3, :3], way)
    return Plan(
        conditions=Conditions(
            a_deg=a,
            c_deg=c,
            direction=direction / np.linalg.norm(direction, axis=1, keepdims=True),
            feed_mm_min=rng.choice([200.0, 600.0], n),
            time_s=np.cumsum(rng.uniform(2, 10, n)),
            a_dir=rng.choice([-1.0, 0.0, 1.0], n),
            c_dir=rng.choice([-1.0, 0.0, 1.0], n),
        ),
        start_mm=np.einsum("nij,nj->ni", pose[:, :3, :3], start) + pose[:, :3, 3],
        cycle=np.zeros(n, dtype=np.int64),
        point=np.arange(n),
        face=("",) * n,
    )


def stand_off(rng: np.random.Generator, setup: Setup) -> Setup:
    """The set-up with its tilting axis off the origin, and the artefact off centre and turned."""
    x, y, z = rng.uniform(-60, 60, 3)
    return replace(
        setup,
        tilt_point_mm=(x, y, setup.probe_length_mm if setup.preset == "table-c-head-b" else z),
        place_mm=tuple(rng.uniform(-50, 50, 3)),
        turn_deg=float(rng.uniform(-180, 180)),
    )


def random_effects(rng: np.random.Generator, share: float = 0.3) -> dict[str, dict[str, float]]:
    """A random part of the catalogue, each parameter of the order of 3 µm, arcsec, ppm, ms/10."""
    effects = {}
    for id_, names in EFFECTS.items():
        if rng.uniform() < share:
            values = {name: float(rng.normal(0, 3)) for name in names}
            if id_ == "trigger_delay":
                values["tau_ms"] *= 0.1
            if id_ == "setup_shift":
                values["t0_s"] = float(rng.uniform(0, 2000))
            if id_ == "warmup_z":
                values["tau_min"] = float(rng.uniform(2, 20))
            effects[id_] = values
    return effects
