"""Random turned parts, made without the core: what tests of the turned part are tried on."""

import itertools
import math

import numpy as np
import numpy.typing as npt

from trunnion.turning import Corner


def random_points(rng: np.random.Generator, *, grooves: bool = True) -> list[Corner]:
    """Corners of a part of 3 to 8 stretches: cylinders, cones, walls, grooves."""
    z = float(rng.uniform(150.0, 260.0))
    x = float(rng.uniform(8.0, 20.0))
    corners = [Corner(z, x)]
    for _ in range(int(rng.integers(3, 9))):
        kind = rng.choice(["cylinder", "cone", "wall", "groove" if grooves else "cone"])
        length = float(rng.uniform(8.0, 40.0))
        if kind == "cylinder":
            z -= length
            corners.append(Corner(z, x))
        elif kind == "cone":
            slope = float(rng.uniform(-0.15, 0.9))
            z -= length
            x = max(4.0, x + slope * length)
            corners.append(Corner(z, x))
        elif kind == "wall":
            z -= length
            corners.append(Corner(z, x))
            x += float(rng.uniform(1.0, 15.0))
            corners.append(Corner(z, x))
        else:
            depth = min(float(rng.uniform(0.5, 12.0)), x - 3.0)
            for step, fall in ((length, 0.0), (0.0, -depth), (1.5 * length, 0.0), (0.0, depth)):
                z -= step
                x += fall
                corners.append(Corner(z, x))
    corners.append(Corner(z - 10.0, x))
    return fillets(rng, corners)


def fillets(rng: np.random.Generator, corners: list[Corner]) -> list[Corner]:
    """Round some of the corners, as far as there is room."""
    out = list(corners)
    used = 0.0
    for i in range(1, len(corners) - 1):
        a, b, c = ((p.z_mm, p.x_mm) for p in corners[i - 1 : i + 2])
        before, after = math.dist(a, b), math.dist(b, c)
        angle = abs(math.atan2(a[1] - b[1], a[0] - b[0]) - math.atan2(b[1] - c[1], b[0] - c[0]))
        angle = min(angle, 2 * math.pi - angle)
        room = min(before - used, after) * 0.45
        used = 0.0
        if angle < 0.05 or room < 0.3 or rng.random() < 0.6:
            continue
        radius = float(rng.uniform(0.2, 1.0)) * room / math.tan(angle / 2)
        radius = min(radius, 12.0)
        used = radius * math.tan(angle / 2)
        out[i] = Corner(*b, kind="fillet", radius_mm=radius)
    return out


def outline(corners: list[Corner], step_mm: float) -> npt.NDArray[np.float64]:
    """Points z, x along the part, lines and fillets divided to `step_mm`."""
    ends = [np.array([c.z_mm, c.x_mm]) for c in corners]
    nodes = [ends[0]]
    for i in range(1, len(corners) - 1):
        at, radius = ends[i], corners[i].radius_mm
        if corners[i].kind == "sharp":
            nodes.append(at)
            continue
        u, v = ends[i - 1] - at, ends[i + 1] - at
        u, v = u / np.hypot(*u), v / np.hypot(*v)
        half = np.arccos(np.clip(u @ v, -1, 1)) / 2
        middle = (u + v) / np.hypot(*(u + v))
        centre = at + middle * radius / np.sin(half)
        first, last = (at + w * radius / np.tan(half) - centre for w in (u, v))
        turn = np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last)
        count = max(3, int(abs(turn) * radius / step_mm))
        for angle in np.linspace(0, turn, count + 1):
            c, s = np.cos(angle), np.sin(angle)
            rotated = np.array([c * first[0] - s * first[1], s * first[0] + c * first[1]])
            nodes.append(centre + rotated)
    nodes.append(ends[-1])
    points = [nodes[0][None]]
    for a, b in itertools.pairwise(nodes):
        count = max(1, int(np.ceil(np.hypot(*(b - a)) / step_mm)))
        points.append(a + np.linspace(0, 1, count + 1)[1:, None] * (b - a))
    return np.concatenate(points)
