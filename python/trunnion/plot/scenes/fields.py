"""Errors over a space: the volumetric error before and after, measured points, ball-bar circles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.compensation.volumetric import VolumetricError
from trunnion.data.flatness import Flatness
from trunnion.data.points import Points
from trunnion.data.sweep import Sweep
from trunnion.models.rotary.geometry import fit_circles, targets_of
from trunnion.plot.points import deviations_um
from trunnion.plot.scenes.traces import Trace, arrows, colour_axis, dots, lines, mesh
from trunnion.plot.scenes.view import (
    View,
    arrow_scale,
    base_layout,
    extent,
    scale_bar,
    scene_axes,
    thinned,
    titled,
)
from trunnion.plot.style import MUTED
from trunnion.plot.volumetric import vectors_at

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MAX_ALONG = 7
"""Nodes an axis that are drawn."""
MAX_POINTS = 2000


def volume_figure(
    fields: Sequence[VolumetricError],
    *,
    names: Sequence[str] = (),
    pose: Mapping[str, float] | None = None,
    magnification: float | None = None,
) -> Figure:
    """Return error vectors over the work space, side by side with one scale and one colour bar.

    names: one a field; "before" and "after compensation" for two. pose: rotary positions, the
    nearest ones; those of the largest error of the first field if None.
    """
    from plotly import graph_objects

    given = list(names) or (["before", "after compensation"] if len(fields) == 2 else [""])
    if len(given) != len(fields):
        raise InputError(f"names: got {len(given)}, expected one a field, {len(fields)}")
    pose = fields[0].worst_pose_deg if pose is None else pose
    largest = max(float(np.linalg.norm(vectors_at(f, pose)[0], axis=-1).max()) for f in fields)
    nodes = [np.asarray(n) for n in (fields[0].x_mm, fields[0].y_mm, fields[0].z_mm)]
    low = np.array([n.min() for n in nodes])
    size = float(np.linalg.norm([np.ptp(n) for n in nodes])) or 1.0
    scale = arrow_scale(largest, size, magnification)
    data: list[Trace] = []
    layout: dict[str, Any] = {}
    notes: list[dict[str, Any]] = []
    bar, said = scale_bar(low - [0.0, 0.12 * size, 0.0], scale, largest)
    for k, (field, name) in enumerate(zip(fields, given, strict=True)):
        scene = f"scene{k + 1 if k else ''}"
        values, at = vectors_at(field, pose)
        shown = _volume(field, values, scale, size) + bar
        data += [{**trace, "scene": scene} for trace in shown]
        left, right = k / len(fields), (k + 1) / len(fields)
        layout[scene] = {
            **scene_axes(shown, zoom=0.85),
            "domain": {"x": [left, right], "y": [0.0, 0.94]},
        }
        top = float(np.linalg.norm(values, axis=-1).max())
        text = f"<b>{name}</b> largest {top:.3g} µm".strip()
        note = {
            "x": (left + right) / 2,
            "y": 0.98,
            "text": text,
            "showarrow": False,
            "xanchor": "center",
        }
        notes.append({**note, "xref": "paper", "yref": "paper", "font": {"size": 14}})
    title = titled(f"Volumetric error over the work space at {at}", said)
    layout |= {"annotations": notes, "coloraxis": colour_axis("error (µm)", largest)}
    return graph_objects.Figure({"data": data, "layout": {**base_layout(title), **layout}})


def _volume(field: VolumetricError, values: Floats, scale: float, size: float) -> list[Trace]:
    nodes = (field.x_mm, field.y_mm, field.z_mm)
    picks = [thinned(len(n), MAX_ALONG) for n in nodes]
    grid = np.meshgrid(*(n[p] for n, p in zip(nodes, picks, strict=True)), indexing="ij")
    points = np.stack([g.ravel() for g in grid], axis=1)
    vectors = values[np.ix_(*picks)].reshape(-1, 3)
    length = np.linalg.norm(vectors, axis=1)
    texts = [
        f"x {p[0]:g}, y {p[1]:g}, z {p[2]:g} mm<br><b>{n:.3g} µm</b> "
        f"({v[0]:.3g}, {v[1]:.3g}, {v[2]:.3g})"
        for p, v, n in zip(points, vectors, length, strict=True)
    ]
    hover = {"text": texts, "hovertemplate": "%{text}<extra></extra>"}
    marker = {"color": length, "coloraxis": "coloraxis"}
    drawn = arrows(points, scale * vectors, size_mm=size, values=length, texts=texts, width=4)
    return [dots(points, size=2.5, marker=marker, **hover), *drawn, _box(nodes)]


def _box(nodes: Sequence[Floats]) -> Trace:
    """The edges of the work space."""
    low, high = np.array([n[0] for n in nodes]), np.array([n[-1] for n in nodes])
    corners = np.array(list(np.ndindex(2, 2, 2)))
    edges = [
        np.where(corners[[i, j]] == 1, high, low)
        for i in range(8)
        for j in range(i + 1, 8)
        if np.abs(corners[i] - corners[j]).sum() == 1
    ]
    return lines(edges, colour=MUTED, width=1.5)


def points_view(points: Points, *, magnification: float | None = None) -> View:
    """Return nominal places with the deviation of the measured ones as arrows on one scale.

    Place and turn of each group (a set-up) are fitted first.
    """
    away = _in_space(deviations_um(points))
    title = f"Deviations of {len(points)} points after best fit of place and turn"
    texts = [f"{escape(points.place(row))}: " for row in range(len(points))]
    return _vectors(_in_space(points.nominal_mm), away, title, texts, magnification)


def sweep_view(sweep: Sweep, *, magnification: float | None = None) -> View:
    """Return the positions of targets with their distance from the plain circle of each."""
    away = np.empty_like(sweep.position_mm)
    labels, target = targets_of(sweep)
    for k, (label, circle) in enumerate(fit_circles(sweep).items()):
        assert labels[k] == label
        mine = target == k
        out = sweep.position_mm[mine] - circle.centre_mm
        out -= (out @ circle.normal)[:, None] * circle.normal
        out /= np.linalg.norm(out, axis=1)[:, None]
        away[mine] = circle.radial_um[:, None] * out + circle.axial_um[:, None] * circle.normal
    title = f"Distance of {len(sweep)} positions from the circle of their target"
    texts = [f"target {t}, {a:g}°: " for t, a in zip(target, sweep.angle_deg, strict=True)]
    return _vectors(sweep.position_mm, away, title, texts, magnification)


def _vectors(
    places: Floats, away: Floats, title: str, texts: Sequence[str], magnification: float | None
) -> View:
    """Return vectors (n, 3), µm, at places (n, 3), mm."""
    rows = thinned(len(places), MAX_POINTS)
    length = np.linalg.norm(away, axis=1)
    low, size = extent(places)
    largest = float(length.max(initial=0.0))
    scale = arrow_scale(largest, size, magnification)
    bar, said = scale_bar(low - [0.0, 0.1 * size, 0.0], scale, largest)
    some = f"; {len(rows)} of {len(places)}" if len(rows) < len(places) else ""
    view = View(titled(f"{title}, largest {largest:.3g} µm", said + some))
    view.layout["coloraxis"] = colour_axis("deviation (µm)", largest)
    view.add(bar)
    said_at = [f"{texts[k]}<b>{length[k]:.3g} µm</b>" for k in rows]
    hover = {"text": said_at, "hovertemplate": "%{text}<extra></extra>"}
    shown = length[rows]
    view.add(dots(places[rows], size=2.5, **hover))
    view.add(
        arrows(places[rows], scale * away[rows], size_mm=size, values=shown, texts=said_at, width=4)
    )
    return view


def _in_space(points: Floats) -> Floats:
    """Points of a plane or of space as (n, 3)."""
    flat = np.zeros((len(points), 3))
    flat[:, : points.shape[1]] = points
    return flat


def flatness_view(result: Flatness, *, magnification: float | None = None) -> View:
    """Return heights over the surface, magnified."""
    from scipy.spatial import Delaunay

    x, y, z = result.x_mm, result.y_mm, result.heights_um
    places = np.column_stack([x, y])
    _, size = extent(_in_space(places))
    scale = arrow_scale(float(np.abs(z).max(initial=0.0)), size, magnification)
    points = np.column_stack([x, y, scale * z])
    texts = [f"x {a:g}, y {b:g} mm<br><b>{c:+.3g} µm</b>" for a, b, c in zip(x, y, z, strict=True)]
    axis = colour_axis("height (µm)", float(z.max()), low=float(z.min()))
    paint: dict[str, Any] = {"intensity": z, "coloraxis": "coloraxis", "flatshading": False}
    hover: dict[str, Any] = {"hoverinfo": "text", "text": texts}
    view = View(
        titled(
            f"Flatness {result.flatness_um:.3g} µm",
            f"heights × {scale * 1e3:,.0f} above the plane of least squares",
        )
    )
    view.layout["coloraxis"] = axis
    view.add(mesh(points, Delaunay(places).simplices, **paint, **hover), dots(points, size=2))
    return view
