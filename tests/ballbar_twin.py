"""A ball-bar test as it might have happened: for the blind tests, shares no code with trunnion.

Hybrid machine: loops closed by Gauss-Newton with differenced derivatives, from the equations of the
notes. Three-axis machine: the tool goes where its errors send it. Random errors, centres, noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ARCSEC = np.pi / 648000


def rx(a: Array) -> Array:
    c, s, o, i = np.cos(a), np.sin(a), np.zeros_like(a), np.ones_like(a)
    return np.stack([i, o, o, o, c, -s, o, s, c], axis=-1).reshape(*a.shape, 3, 3)


def ry(a: Array) -> Array:
    c, s, o, i = np.cos(a), np.sin(a), np.zeros_like(a), np.ones_like(a)
    return np.stack([c, o, s, o, i, o, -s, o, c], axis=-1).reshape(*a.shape, 3, 3)


def rz(a: Array) -> Array:
    c, s, o, i = np.cos(a), np.sin(a), np.zeros_like(a), np.ones_like(a)
    return np.stack([c, -s, o, s, c, o, o, o, i], axis=-1).reshape(*a.shape, 3, 3)


@dataclass
class HybridTwin:
    """Dimensions and errors in mm and rad; poses (n, 5) in mm and rad."""

    e: Array = field(
        default_factory=lambda: np.array(
            [0, 0, 0, 350, 0, 0, 0, 600, 200, 130, 200, 0, 200, 0, 250, 0, 0], dtype=float
        )
    )
    a3: Array = field(default_factory=lambda: np.zeros(3))
    squareness: float = 0.0
    sag: float = 0.0  # of a level leg of 1000 mm, square to the leg, downwards

    def _sag(self, along: Array, length: Array) -> Array:
        """Bending of a leg by weight: the part of -Z square to it, with the cube of its length."""
        down = np.array([0.0, 0.0, -1.0])
        square = down - along * np.sum(along * down, axis=-1, keepdims=True)
        return np.asarray(self.sag * (length / 1000.0) ** 3 * square)

    def _parts(self, y: Array, legs: Array) -> tuple[Array, Array, Array]:
        e = self.e
        u1, v1, u2, v2, phi, w2, u3, v3 = y.T
        down = np.array([0.0, 0.0, 1.0])
        r2 = rx(u2) @ ry(v2)
        p = np.array([0, e[3], 0]) - e[1] * (rx(u2) @ down) - legs[:, 1:2] * (r2 @ down)
        p = p + self._sag(r2[..., 2], legs[:, 1:2])
        rp = r2 @ rz(phi) @ rx(w2)
        p = p - rp @ np.array([0, e[9], e[11]])
        out = []
        for base, e_off, u, v, length, seat in (
            (np.array([-e[7], 0, 0]), e[0], u1, v1, legs[:, 0:1], p - e[8] * rp[..., 0]),
            (np.array([e[7], 0, 0]) + self.a3, e[2], u3, v3, legs[:, 2:3], p + e[10] * rp[..., 0]),
        ):
            turn = rx(u) @ ry(v)
            end = base - e_off * (rx(u) @ down) - length * turn[..., 2]
            end = end + self._sag(turn[..., 2], length)
            across = rp[..., 1]
            out += [
                seat - end,
                1000 * np.sum(across * turn[..., 2], axis=-1, keepdims=True),
                1000 * np.sum(across * turn[..., 0], axis=-1, keepdims=True),
            ]
        return np.concatenate(out, axis=-1), p, rp

    def tips(self, joints: Array) -> Array:
        legs = joints[:, :3] + self.e[4:7]
        y = np.tile([-0.3, -0.36, -0.6, 0.0, 0.0, 0.3, -0.3, 0.36], (len(joints), 1))
        for _ in range(12):
            g, _, _ = self._parts(y, legs)
            jac = np.empty((len(y), 10, 8))
            for k in range(8):
                step = np.zeros(8)
                step[k] = 1e-6
                up, down = self._parts(y + step, legs)[0], self._parts(y - step, legs)[0]
                jac[:, :, k] = (up - down) / 2e-6
            change = np.einsum("nij,nj->ni", np.linalg.pinv(jac), g)
            y = y - change
            if np.abs(change).max() < 1e-11:
                break
        _, p, rp = self._parts(y, legs)
        e = self.e
        r4 = rp @ rz(joints[:, 3] + e[15])
        w = p - e[12] * rp[..., 2] + e[13] * r4[..., 1]
        tilt = ry(np.full(len(joints), self.squareness))
        rt = r4 @ tilt @ rx(joints[:, 4] + e[16])
        return np.asarray(w - e[14] * rt[..., 2])


def nominal_joints(points: Array, direction: Array) -> Array:
    """Closed form of the notes for the example's dimensions, branch q5 ≥ 0."""
    t = np.broadcast_to(np.asarray(direction, dtype=float), points.shape)
    w = points - 250.0 * t
    u = np.arctan2(w[:, 1], -w[:, 2])
    a2 = np.array([0.0, 350.0, 0.0])
    psi = np.arctan(w[:, 0] / np.sum(rx(u)[..., 2] * (w - a2), axis=-1))
    rp = rx(u) @ ry(psi)
    p = w + 200.0 * rp[..., 2]
    l1 = np.linalg.norm(p - 200 * rp[..., 0] - [-600, 0, 0], axis=1)
    l2 = np.linalg.norm(p + 130 * rp[..., 1] - a2, axis=1)
    l3 = np.linalg.norm(p + 200 * rp[..., 0] - [600, 0, 0], axis=1)
    tp = np.einsum("nji,nj->ni", rp, t)
    q5 = np.arctan2(np.hypot(tp[:, 0], tp[:, 1]), -tp[:, 2])
    q4 = np.arctan2(-tp[:, 0], tp[:, 1])
    return np.column_stack([l1, l2, l3, q4, q5])


@dataclass
class Recording:
    """Columns of a ball-bar test; joints in mm and rad, or coordinates."""

    setup: NDArray[np.int64]
    run: NDArray[np.int64]
    sense: NDArray[np.int64]
    time_s: Array
    points: Array
    velocity: Array
    radius: float
    direction: Array


#: Plane axes and angles of the runs: the XY circle there and back, two arcs, the first again.
ARCS = (("XY", 0, 360), ("XZ", -20, 200), ("YZ", -20, 200))
AXES = {"XY": (0, 1), "XZ": (0, 2), "YZ": (1, 2)}


def record(
    centres: Array,
    *,
    radius: float = 150.0,
    step_deg: float = 3.0,
    feed: float = 1000.0,
    arcs: tuple[tuple[str, float, float], ...] = ARCS,
    directions: Array | None = None,
) -> Recording:
    """Both senses of every arc round every centre, the first circle of each again at the end.

    Each row of ``centres`` is one set-up, with the tool's direction in that row of ``directions``.
    """
    keys = ("setup", "run", "sense", "t", "p", "v", "d")
    parts: dict[str, list[Array]] = {k: [] for k in keys}
    if directions is None:
        directions = np.tile([0.0, 0.0, -1.0], (len(np.atleast_2d(centres)), 1))
    clock, run = 0.0, 0
    omega = feed / 60 / radius
    for s, centre in enumerate(np.atleast_2d(centres)):
        plan = [(arc, way) for arc in arcs for way in (1, -1)]
        for (plane, first, last), way in [*plan, plan[0]]:
            i, j = AXES[plane]
            angle = np.radians(np.arange(first, last + step_deg / 2, step_deg))[::way]
            point = np.tile(centre, (len(angle), 1)).astype(float)
            point[:, i] += radius * np.cos(angle)
            point[:, j] += radius * np.sin(angle)
            velocity = np.zeros_like(point)
            velocity[:, i] = -way * feed / 60 * np.sin(angle)
            velocity[:, j] = way * feed / 60 * np.cos(angle)
            time = clock + np.abs(angle - angle[0]) / omega
            for key, value in (
                ("setup", np.full(len(angle), s)),
                ("run", np.full(len(angle), run)),
                ("sense", np.full(len(angle), way)),
                ("t", time),
                ("p", point),
                ("v", velocity),
                ("d", np.tile(directions[s], (len(angle), 1))),
            ):
                parts[key].append(value)
            clock, run = float(time[-1]) + 40.0, run + 1
    got = {k: np.concatenate(v) for k, v in parts.items()}
    return Recording(
        got["setup"].astype(int),
        got["run"].astype(int),
        got["sense"].astype(int),
        got["t"],
        got["p"],
        got["v"],
        radius,
        got["d"],
    )


def sign(values: Array) -> Array:
    """Sign with rounding noise taken as standstill."""
    return np.where(np.abs(values) < 1e-6 * np.abs(values).max(), 0.0, np.sign(values))


def arc(place: Array, height: float) -> Array:
    """How far a guide bent to an arc lies from the chord over the places used, all in mm."""
    half = np.ptp(place) / 2
    radius = (half**2 + height**2) / (2 * height)
    return np.asarray(np.sqrt(radius**2 - (place - place.min() - half) ** 2) - radius + height)


def leg_travel(rec: Recording) -> Array:
    """Sign of travel of each leg, from joints a little earlier and later on the way, (n, 3)."""
    ahead = nominal_joints(rec.points + 1e-3 * rec.velocity, rec.direction)
    behind = nominal_joints(rec.points - 1e-3 * rec.velocity, rec.direction)
    return sign((ahead - behind)[:, :3])


Legs = Callable[[Recording, Array], Array]


Motion = Callable[[Recording], Array]


def hybrid_lengths(
    rec: Recording,
    rng: np.random.Generator,
    *,
    sigma_um: float,
    size_um: float = 20.0,
    legs: Legs | None = None,
    motion: Motion | None = None,
    squareness_arcsec: float = 0.0,
    a3_um: tuple[float, float, float] = (0.0, 0.0, 0.0),
    sag_um: float = 0.0,
) -> tuple[Array, Array]:
    """Joints (mm, rad) and measured lengths (mm) with random errors and centres.

    ``legs``: by what the legs are longer, µm; ``motion``: how the tool moves beside them, mm.
    """
    joints = nominal_joints(rec.points, rec.direction)
    twin = HybridTwin()
    twin.e = twin.e + rng.normal(0, size_um * 1e-3, 17)
    twin.e[15:] = rng.normal(0, size_um * ARCSEC, 2)
    twin.squareness = squareness_arcsec * ARCSEC
    twin.a3 = np.array(a3_um) * 1e-3
    twin.sag = sag_um * 1e-3
    real = joints.copy()
    if legs is not None:
        real[:, :3] += legs(rec, joints) * 1e-3
    tips = twin.tips(real)
    if motion is not None:
        tips = tips + motion(rec)
    exact = np.array([_centre(rec, s) for s in np.unique(rec.setup)])
    first = [rec.direction[rec.setup == s][0] for s in np.unique(rec.setup)]
    centres = twin.tips(nominal_joints(exact, np.array(first)))
    centres = centres + rng.uniform(-0.05, 0.05, exact.shape)
    length = np.linalg.norm(tips - centres[rec.setup], axis=1)
    return joints, length + rng.normal(0, sigma_um * 1e-3, len(length))


def cartesian_lengths(
    rec: Recording, rng: np.random.Generator, *, sigma_um: float, motion: Motion | None = None
) -> Array:
    """Measured lengths (mm) of a three-axis machine; ``motion`` is its error, mm, (n, 3)."""
    tips = rec.points if motion is None else rec.points + motion(rec)
    exact = np.array([_centre(rec, s) for s in np.unique(rec.setup)])
    centres = exact + rng.uniform(-0.05, 0.05, exact.shape) * _moving(rec)
    length = np.linalg.norm(tips - centres[rec.setup], axis=1)
    return np.asarray(length + rng.normal(0, sigma_um * 1e-3, len(length)))


def _moving(rec: Recording) -> Array:
    return np.asarray(np.ptp(rec.points, axis=0) > 1e-6, dtype=float)


def _centre(rec: Recording, setup: int) -> Array:
    rows = rec.setup == setup
    first = rows & (rec.run == rec.run[rows].min())
    p = rec.points[first]
    return np.asarray((p.max(axis=0) + p.min(axis=0)) / 2)


def columns_of(rec: Recording, length_mm: Array) -> dict[str, NDArray[Any]]:
    """Columns of a recording in XY, with the lengths that the bar showed."""
    return {
        "setup": rec.setup,
        "x_mm": rec.points[:, 0],
        "y_mm": rec.points[:, 1],
        "length_mm": length_mm,
        "sense": rec.sense,
        "time_s": rec.time_s,
    }
