"""Shapes in space as plain Plotly traces: dictionaries, so that nothing is imported to make them.

Points are mm, (n, 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.units import Floats
from trunnion.plot.style import BODY, MAGNITUDES, MUTED

Trace: TypeAlias = dict[str, Any]

AROUND = 48
HEAD = 0.35  # of an arrow's length, at most
MAX_HEAD_SHARE = 0.022  # of the size of the scene
SIDES = 6
LIGHT = {"x": 4e4, "y": -6e4, "z": 1e5}


def _xyz(points: Floats) -> dict[str, Any]:
    # Seven digits are more than a picture shows, and keep pages small.
    x, y, z = np.asarray(points, dtype=np.float32).reshape(-1, 3).T
    return {"x": x, "y": y, "z": z}


def mesh(
    points: Floats, faces: ArrayLike, *, colour: str = BODY, opacity: float = 1.0, **more: Any
) -> Trace:
    """Return triangles (m, 3) over points."""
    i, j, k = np.asarray(faces, dtype=np.int32).reshape(-1, 3).T
    light = {"ambient": 0.6, "diffuse": 0.7, "specular": 0.05}
    return {
        "type": "mesh3d",
        **_xyz(points),
        "i": i,
        "j": j,
        "k": k,
        "color": colour,
        "opacity": opacity,
        "flatshading": True,
        "lighting": light,
        "lightposition": LIGHT,
        "hoverinfo": "skip",
        **more,
    }


def lines(parts: Sequence[Floats], *, colour: Any = MUTED, width: float = 3, **more: Any) -> Trace:
    """Return polylines, one a part, as one trace; drawn over what is behind them."""
    rows: list[Floats] = []
    for part in parts:
        rows += [np.asarray(part, dtype=np.float64).reshape(-1, 3), np.full((1, 3), np.nan)]
    line = {"color": colour, "width": width, **more.pop("line", {})}
    points = np.concatenate(rows[:-1]) if rows else np.zeros((0, 3))
    extra = {"hoverinfo": "skip"} if "text" not in more and "hovertemplate" not in more else {}
    return {
        "type": "scatter3d",
        "mode": "lines",
        **_xyz(points),
        "line": line,
        **extra,
        "showlegend": "name" in more,
        **more,
    }


def dots(points: Floats, *, colour: Any = MUTED, size: float = 4, **more: Any) -> Trace:
    """Return points."""
    marker = {"color": colour, "size": size, **more.pop("marker", {})}
    shown = {"showlegend": "name" in more, **more}
    return {"type": "scatter3d", "mode": "markers", **_xyz(points), "marker": marker, **shown}


def words(points: Floats, texts: Sequence[str], *, colour: str = MUTED, size: int = 13) -> Trace:
    """Return words at points."""
    return {
        "type": "scatter3d",
        "mode": "text",
        **_xyz(points),
        "text": list(texts),
        "textfont": {"color": colour, "size": size},
        "hoverinfo": "skip",
        "showlegend": False,
    }


def arrows(
    tails: Floats,
    vectors: Floats,
    *,
    size_mm: float,
    colour: str | None = None,
    values: Floats | None = None,
    texts: Sequence[str] = (),
    width: float = 3,
    **more: Any,
) -> list[Trace]:
    """Return arrows: shafts as one trace of lines, heads as one mesh.

    tails, vectors: (n, 3). size_mm: of the scene, which bounds the heads.
    colour: one for all; or values (n,) on a colour axis (``coloraxis=``). texts: one an arrow.
    """
    length = np.linalg.norm(vectors, axis=1)
    real = length > 1e-9
    tails, vectors, length = tails[real], vectors[real], length[real]
    texts = [text for text, there in zip(texts, real, strict=True) if there] if texts else []
    along = vectors / length[:, None]
    head = np.minimum(HEAD * length, MAX_HEAD_SHARE * size_mm)
    tips = tails + vectors
    base = tips - head[:, None] * along
    shaft = np.stack([tails, base, np.full_like(tails, np.nan)], axis=1).reshape(-1, 3)
    points, faces = _cones(base, along, head)
    group = {"legendgroup": more.get("name", "arrows")}
    line: dict[str, Any] = {"width": width}
    paint: dict[str, Any] = {}
    if values is None:
        line["color"] = colour
        paint["color"] = colour
    else:
        shown = np.asarray(values, dtype=np.float64)[real]
        axis = {"coloraxis": more.pop("coloraxis", "coloraxis")}
        line |= {"color": np.repeat(shown, 3), **axis}
        paint |= {"intensity": np.repeat(shown, SIDES + 2), **axis}
    return [
        {
            "type": "scatter3d",
            "mode": "lines",
            **_xyz(shaft),
            "line": line,
            "hoverinfo": "skip",
            **group,
            "showlegend": "name" in more,
            **more,
        },
        {
            "type": "mesh3d",
            **_xyz(points),
            **dict(zip("ijk", faces.T, strict=True)),
            **paint,
            "lighting": {"ambient": 0.85, "diffuse": 0.3},
            "hoverinfo": "text" if texts else "skip",
            "text": np.repeat(list(texts), SIDES + 2) if texts else None,
            "showlegend": False,
            **group,
        },
    ]


def _cones(base: Floats, along: Floats, head: Floats) -> tuple[Floats, Any]:
    """Return points and faces of cones: a tip, a ring and a middle each."""
    helper = np.where(np.abs(along[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    across = np.cross(along, helper)
    across /= np.linalg.norm(across, axis=1)[:, None]
    other = np.cross(along, across)
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = np.cos(angle)[:, None, None] * across + np.sin(angle)[:, None, None] * other
    ring = base + 0.38 * head[:, None] * ring
    tip = base + head[:, None] * along
    points = np.concatenate([tip[None], base[None], ring]).transpose(1, 0, 2).reshape(-1, 3)
    k = np.arange(SIDES)
    after = (k + 1) % SIDES
    one = np.concatenate(
        [
            np.column_stack([0 * k, 2 + k, 2 + after]),
            np.column_stack([0 * k + 1, 2 + after, 2 + k]),
        ]
    )
    first = (SIDES + 2) * np.arange(len(base))
    return points, (one[None] + first[:, None, None]).reshape(-1, 3)


# --- solids


def prism(outline: Floats, low: float, high: float) -> tuple[Floats, Floats]:
    """Return points and faces of an upright prism over a convex or star-shaped outline (n, 2)."""
    n = len(outline)
    middle = outline.mean(axis=0)
    ring = np.vstack([outline, middle])
    points = np.vstack([np.column_stack([ring, np.full(n + 1, z)]) for z in (low, high)])
    k = np.arange(n)
    after = (k + 1) % n
    top = n + 1
    faces = [
        np.column_stack([k, after, top + k]),
        np.column_stack([after, top + after, top + k]),
        np.column_stack([0 * k + n, after, k]),
        np.column_stack([0 * k + top + n, top + k, top + after]),
    ]
    return points, np.concatenate(faces)


def annulus(inner: float, outer: float, height: float) -> tuple[Floats, Floats]:
    """Return points and faces of what is between two upright cylinders on z = 0."""
    low, high = np.zeros(AROUND), np.full(AROUND, height)
    walls = [(circle(r), z) for r, z in ((outer, low), (outer, high), (inner, high), (inner, low))]
    points = np.vstack([np.column_stack([outline, z]) for outline, z in walls])
    k = np.arange(AROUND)
    after = (k + 1) % AROUND
    faces = []
    for wall in range(4):
        here, there = wall * AROUND, (wall + 1) % 4 * AROUND
        faces.append(np.column_stack([here + k, here + after, there + k]))
        faces.append(np.column_stack([here + after, there + after, there + k]))
    return points, np.concatenate(faces)


def edges_of(outline: Floats, low: float, high: float, *, upright: bool) -> list[Floats]:
    """Return the edges of a prism as polylines."""
    closed = np.vstack([outline, outline[:1]])
    rings = [np.column_stack([closed, np.full(len(closed), z)]) for z in (low, high)]
    posts = [np.array([[*p, low], [*p, high]]) for p in outline] if upright else []
    return rings + posts


def circle(radius: float, count: int = AROUND) -> Floats:
    """Return a circle as an outline (n, 2)."""
    angle = 2 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def ball(centre: ArrayLike, radius: float) -> tuple[Floats, Floats]:
    """Return points and faces of a sphere."""
    count, half = 24, 12
    u = 2 * np.pi * np.arange(count) / count
    v = np.pi * np.arange(half + 1) / half
    u, v = (g.ravel() for g in np.meshgrid(u, v))
    points = np.column_stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    row, k = (g.ravel() for g in np.meshgrid(np.arange(half), np.arange(count), indexing="ij"))
    here, there = count * row, count * (row + 1)
    after = (k + 1) % count
    faces = np.concatenate(
        [
            np.column_stack([here + k, there + k, there + after]),
            np.column_stack([here + k, there + after, here + after]),
        ]
    )
    return np.asarray(centre) + radius * points, faces


def tube(start: Floats, end: Floats, radius: float) -> tuple[Floats, Floats]:
    """Return points and faces of a round bar from one point to another."""
    along = np.asarray(end, dtype=np.float64) - start
    length = float(np.linalg.norm(along))
    points, faces = prism(circle(radius, 16), 0.0, length)
    z = along / length
    x = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return points @ np.array([x, np.cross(z, x), z]) + start, faces


def colour_axis(title: str, high: float, *, low: float = 0.0) -> dict[str, Any]:
    """Return a colour axis with its bar."""
    bar = {"title": {"text": title, "side": "right"}, "len": 0.7, "thickness": 14, "x": 1.0}
    return {"colorscale": MAGNITUDES, "cmin": low, "cmax": high or 1.0, "colorbar": bar}
