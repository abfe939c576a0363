"""Made-up points and sweeps with hidden effects; shares no code and no formula with the package.

Everything is written out from the geometry: where a drill goes when its axes err, and where a
target goes when its axis does. Displacements are finite, not linearised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
SECOND = np.pi / 180 / 3600


@dataclass(frozen=True)
class Made:
    """Columns of a file, and the effects hidden in it."""

    columns: dict[str, Any]
    hidden: frozenset[str]


def _about(axis: int, angle: Float | float) -> Float:
    """Rotation matrices about x, y or z."""
    a = np.atleast_1d(np.asarray(angle, dtype=float))
    out = np.tile(np.eye(3), (len(a), 1, 1))
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    out[:, i, i] = out[:, j, j] = np.cos(a)
    out[:, i, j], out[:, j, i] = -np.sin(a), np.sin(a)
    return out


def _wave(rng: np.random.Generator, s: Float, degree: int) -> Float:
    """A smooth curve of s in -1..1 with unit rms: a parabola, or a mix with a cubic.

    Beside the least-squares line of the whole travel, as a straightness is (ISO 230-1), wherever
    the features lie: that line's angle is a squareness.
    """
    powers = [0.0, 0.0, rng.normal(), rng.normal() if degree > 2 else 0.0]
    travel = np.linspace(-1.0, 1.0, 1001)
    line = np.polyfit(travel, np.polynomial.polynomial.polyval(travel, powers), 1)
    curve = np.polynomial.polynomial.polyval(s, powers) - np.polyval(line, s)
    return np.asarray(curve / np.sqrt(np.mean(curve**2)))


POINT_EFFECTS = (
    "scale_x",
    "scale_y",
    "squareness_xy",
    "straightness_y_of_x",
    "straightness_x_of_y",
    "angular_z_of_x",
    "angular_z_of_y",
    "periodic_x",
    "periodic_y",
    "expansion",
    "drift_x",
    "drift_y",
    "warmup_x",
    "warmup_y",
    "screw_warmup_x",
    "screw_warmup_y",
    "part_warmup",
    "field",
)
OF_TIME = ("drift_x", "drift_y", *(x for x in POINT_EFFECTS if "warmup" in x))
SPACE_EFFECTS = (
    "scale_z",
    "squareness_xz",
    "squareness_yz",
    "straightness_z_of_x",
    "straightness_x_of_z",
    "angular_y_of_x",
    "angular_x_of_y",
    "angular_x_of_z",
    "periodic_z",
)


def make_points(
    seed: int,
    hidden: tuple[str, ...] = (),
    size: float = 1.5,
    *,
    space: bool = False,
    groups: int = 1,
    noise_um: float = 2.0,
    heavy: bool = False,
    left: Sequence[float] = (),
    features: int | None = None,
) -> Made:
    """Measure a part; each hidden effect moves the features by ``size`` noises rms.

    ``left``: of each hidden effect instead what it leaves beside a motion of the part, the root of
    the sum of squares of all readings in noises, with its sign. ``features``: how many there are,
    anywhere, by default 60 to 159.
    """
    rng = np.random.default_rng([seed, 11])
    n = int(rng.integers(60, 160)) if features is None else features
    half = rng.uniform(100, 300, size=3)
    kind = rng.integers(3)
    if kind == 0 and not space and features is None:  # a grid
        k = int(np.sqrt(n))
        x, y = np.meshgrid(np.linspace(-1, 1, k), np.linspace(-1, 1, k))
        q = np.column_stack([x.ravel(), y.ravel(), np.zeros(k * k)])
    else:
        q = rng.uniform(-1, 1, size=(n, 3))
        q = 2 * (q - q.min(axis=0)) / np.ptp(q, axis=0) - 1  # the travel is that of the features
    q = np.round(q * half, 3)
    if not space:
        q[:, 2] = 0.0
    if rng.random() < 0.5:
        q = q[rng.permutation(len(q))]
    n = len(q)
    time = np.arange(n) * rng.uniform(5, 40) + rng.uniform(0, 2, n)
    d = 3 if space else 2
    error = np.zeros((n, 3))
    for i, name in enumerate(hidden):
        e = _point_error(rng, name, q, time, half)
        gain = left[i] / _beside_motion(e, q, d) if left else size / np.sqrt(np.mean(e[:, :d] ** 2))
        error += e * gain * noise_um * 1e-3
    columns: dict[str, list[Float]] = {}
    for g in range(groups):
        noise = rng.standard_t(4, (n, 3)) / np.sqrt(2) if heavy else rng.normal(size=(n, 3))
        turn = _about(2, rng.uniform(-3, 3) * 1e-3)[0]
        if space:
            turn = turn @ _about(0, rng.normal() * 1e-3)[0] @ _about(1, rng.normal() * 1e-3)[0]
        m = (q + error) @ turn.T + rng.normal(size=3) + noise * noise_um * 1e-3
        for i, a in enumerate("xyz"[:d]):
            columns.setdefault(f"nominal_{a}_mm", []).append(q[:, i])
            columns.setdefault(f"{a}_mm", []).append(m[:, i])
        columns.setdefault("time_s", []).append(time + g * 1e5)
        columns.setdefault("group", []).append(np.full(n, float(g)))
    flat = {k: np.concatenate(v) for k, v in columns.items()}
    if groups == 1:
        del flat["group"]
    if rng.random() < 0.3 and not set(hidden) & set(OF_TIME):
        del flat["time_s"]
    return Made(flat, frozenset(hidden))


def _beside_motion(e: Float, q: Float, d: int) -> float:
    """Root of the sum of squares of what no small motion of the part makes of displacements."""
    motions = [np.tile(np.eye(3)[i], (len(q), 1)) for i in range(d)]
    motions += [np.cross(np.eye(3)[i], q) for i in (range(3) if d == 3 else (2,))]
    columns = np.stack([m[:, :d].ravel() for m in motions], axis=1)
    flat = e[:, :d].ravel()
    return float(np.linalg.norm(flat - columns @ np.linalg.lstsq(columns, flat, rcond=None)[0]))


def size_of(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number, logarithmically uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _heated(time: Float, lasts: float) -> Float:
    """Temperature at some times of a body that takes and loses heat, 0 at first, (n,).

    In small steps of the balance of heat. ``lasts``: the time after which it would have got two
    thirds of all, of that of the measurement.
    """
    span = float(np.ptp(time))
    every, body = np.linspace(time.min(), time.max(), 4001), np.zeros(4001)
    for i in range(4000):
        body[i + 1] = body[i] + (1.0 - body[i]) * (span / 4000) / (lasts * span)
    return np.interp(time, every, body)


def _point_error(rng: np.random.Generator, name: str, q: Float, time: Float, half: Float) -> Float:
    e = np.zeros_like(q)
    axis = {a: i for i, a in enumerate("xyz")}
    match name.split("_"):
        case ["scale", a]:
            e[:, axis[a]] = q[:, axis[a]]
        case ["squareness", pair]:
            e[:, axis[pair[0]]] = q[:, axis[pair[1]]]
        case ["straightness", a, "of", b]:
            e[:, axis[a]] = _wave(rng, q[:, axis[b]] / half[axis[b]], 3)
        case ["angular", a, "of", b]:
            s = q[:, axis[b]] / half[axis[b]]
            angle = 1e-5 * (s if rng.random() < 0.5 else s**2 - 1 / 3)
            lever = q.copy()
            lever[:, axis[b]] = 0.0
            e = np.einsum("nij,nj->ni", _about(axis[a], angle), lever) - lever
        case ["periodic", a]:
            pitch = rng.uniform(0.12, 0.4) * 2 * half[axis[a]]
            e[:, axis[a]] = np.cos(2 * np.pi * q[:, axis[a]] / pitch + rng.uniform(0, 6.28))
        case ["expansion"]:
            e = q.copy()
        case ["drift", a]:
            e[:, axis[a]] = time - time.mean()
        case ["warmup", a]:
            e[:, axis[a]] = _heated(time, size_of(rng, 0.1, 1.0))
        case ["screw", "warmup", a]:
            held = rng.uniform(-1.2, 1.2) * half[axis[a]]
            e[:, axis[a]] = (q[:, axis[a]] - held) * _heated(time, size_of(rng, 0.1, 4.0))
        case ["part", "warmup"]:
            held = rng.uniform(-1, 1, 3) * half * np.any(q, axis=0)
            e = (q - held) * _heated(time, size_of(rng, 0.1, 4.0))[:, None]
        case ["field"]:
            for i in range(2):
                for _ in range(12):
                    middle = rng.uniform(-1, 1, 2) * half[:2]
                    far = np.sum((q[:, :2] - middle) ** 2, axis=1)
                    e[:, i] += rng.normal() * np.exp(-far / (2 * (0.45 * half[0]) ** 2))
        case _:
            raise ValueError(name)
    return e


SWEEP_EFFECTS = (
    "radial_2",
    "radial_3",
    "axial_1",
    "axial_2",
    "axial_3",
    "tilt_2",
    "positioning_1",
    "positioning_2",
    "positioning_4",
    "drift",
)


def make_sweep(
    seed: int,
    hidden: tuple[str, ...] = (),
    size: float = 1.5,
    *,
    targets: int = 3,
    range_deg: float = 360.0,
    step_deg: float = 10.0,
    radius_mm: tuple[float, float] = (60.0, 200.0),
    noise_um: float = 1.0,
    heavy: bool = False,
) -> Made:
    """Turn targets about an axis; each hidden effect moves them by ``size`` noises rms.

    Tilts are about the height 0; where there is one target, it is there: about another height a
    tilt moves it like a radial error motion, too.
    """
    rng = np.random.default_rng([seed, 23])
    start = rng.uniform(-180, 0)
    angle = np.round(start + np.arange(0, range_deg - 1e-9, step_deg), 4)
    frame = _about(0, rng.uniform(-3, 3))[0] @ _about(1, rng.uniform(-1, 1))[0]
    origin = rng.uniform(-500, 500, 3)
    radius = rng.uniform(*radius_mm, size=targets)
    phase = rng.uniform(0, 2 * np.pi, targets)
    height = rng.uniform(-80, 80, targets) * (targets > 1)
    theta, target = np.tile(angle, targets), np.repeat(np.arange(targets), len(angle))
    time = np.linspace(0.0, 20.0 * (len(theta) - 1), len(theta))
    v = np.column_stack([radius * np.cos(phase), radius * np.sin(phase), height])[target]
    still = np.einsum("nij,nj->ni", _about(2, np.radians(theta)), v)
    place = still.copy()
    for name in hidden:
        unit = _sweep_place(np.random.default_rng([seed, len(name)]), name, theta, v, time, 1e-6)
        big = np.sqrt(np.mean((unit - still) ** 2)) / 1e-6
        gain = size * noise_um * 1e-3 / big
        moved = _sweep_place(np.random.default_rng([seed, len(name)]), name, theta, v, time, gain)
        place += moved - still
    noise = rng.standard_t(4, place.shape) / np.sqrt(2) if heavy else rng.normal(size=place.shape)
    p = origin + place @ frame.T + noise * noise_um * 1e-3
    columns: dict[str, Any] = {"angle_deg": theta, "target": target + 1.0, "time_s": time}
    columns |= {f"{a}_mm": p[:, i] for i, a in enumerate("xyz")}
    if rng.random() < 0.4 and "drift" not in hidden:
        del columns["time_s"]
    return Made(columns, frozenset(hidden))


def _sweep_place(
    rng: np.random.Generator, name: str, theta: Float, v: Float, time: Float, size: float
) -> Float:
    """Where targets v go at positions theta under one error motion of this size (mm, rad/100)."""
    t = np.radians(theta)
    kind, _, number = name.partition("_")
    n = int(number or 0)
    one = rng.normal() * np.cos(n * t) + rng.normal() * np.sin(n * t)
    two = rng.normal() * np.cos(n * t) + rng.normal() * np.sin(n * t)
    turn, tilt, shift = t.copy(), np.tile(np.eye(3), (len(t), 1, 1)), np.zeros_like(v)
    match kind:
        case "radial":
            shift[:, 0], shift[:, 1] = size * one, size * two
        case "axial":
            shift[:, 2] = size * one
        case "tilt":
            tilt = _about(0, size * one / 100) @ _about(1, size * two / 100)
        case "positioning":
            turn = turn + size * one / 100
        case "drift":
            shift = size * np.outer(time / time.max(), rng.normal(size=3))
    turned = np.einsum("nij,nj->ni", _about(2, turn), v)
    return np.asarray(shift + np.einsum("nij,nj->ni", tilt, turned))
