"""Tool paths in space: of a contouring run, of a path, of a part program."""

from __future__ import annotations

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.contouring.paths import Path
from trunnion.contouring.simulation import ContourRun
from trunnion.nc import Program, follow
from trunnion.plot.scenes.traces import colour_axis, dots, lines
from trunnion.plot.scenes.view import View, arrow_scale, extent, scale_bar, thinned, titled
from trunnion.plot.style import BLUE, MUTED, OCHRE, VERMILLION

MAX_SAMPLES = 4000
TOOLS = 40
TOOL_SHARE = 0.15


def run_view(run: ContourRun, *, magnification: float | None = None) -> View:
    """Return the tool path with the contour error as colour, and magnified beside the path."""
    rows = thinned(len(run), MAX_SAMPLES)
    point, tip = run.point_mm[rows], run.tip_mm[rows]
    error = run.contour_um[rows]
    low, size = extent(point)
    largest = float(run.contour_um.max(initial=0.0))
    scale = arrow_scale(largest, size, magnification)
    foot = tip + 1e-3 * run.contour_vector_um[rows]
    drawn = foot - scale * run.contour_vector_um[rows]
    bar, said = scale_bar(low - [0.0, 0.1 * size, 0.0], scale, largest)
    title = f"Contour error, {run.controller} controller, largest {largest:.3g} µm"
    view = View(titled(title, said.replace("arrows", "contour error")))
    view.layout["coloraxis"] = colour_axis("contour error (µm)", largest)
    view.add(bar)
    time = run.time_s[rows]
    hover = {
        "customdata": np.column_stack([time, run.orientation_arcsec[rows]]),
        "hovertemplate": "t = %{customdata[0]:.3f} s<br>contour error %{line.color:.3g} µm<br>"
        "orientation error %{customdata[1]:.3g} arcsec<extra></extra>",
    }
    paint = {"coloraxis": "coloraxis"}
    view.add(
        lines([point], colour=MUTED, width=2, name="path"),
        lines([drawn], colour=error, line=paint, width=7, name="tool tip, magnified", **hover),
    )
    picks = thinned(len(rows), 3 * TOOLS)
    feet = [np.array([foot[k], drawn[k]]) for k in picks]
    view.add(lines(feet, colour=MUTED, width=1))
    return view


def path_view(path: Path) -> View:
    """Return a path with tool axes, frame of the part."""
    points = path.points_mm(path.at_length(np.linspace(0.0, path.length_mm, 500)))
    at = path.at_length(np.linspace(0.0, path.length_mm, TOOLS))
    feet, axes = path.points_mm(at), path.tools(at)
    _, size = extent(points)
    view = View(f"Path of {path.length_mm:.4g} mm with its tool axes")
    view.add(
        lines([points], colour=BLUE, width=6, name="path of the tool tip"),
        lines(
            [np.array([f, f + TOOL_SHARE * size * a]) for f, a in zip(feet, axes, strict=True)],
            colour=VERMILLION,
            width=3,
            name="tool axis",
        ),
        dots(points[:1], colour=VERMILLION, size=5, name="start"),
    )
    return view


def program_view(program: Program) -> View:
    """Return the moves of a part program, rapids apart; axes as programmed (X a radius if turned).

    Arcs are drawn as chords where they are not in a plane of two linear axes.
    """
    moves = follow(program)
    if not len(moves):
        raise InputError("scene: got a program without a move, expected at least one")
    start, end = moves.start[:, :3], moves.end[:, :3]
    kinds = (
        ("rapid", moves.code == 0, OCHRE, 2),
        ("at feed", (moves.code > 0) & (moves.code != 38), BLUE, 5),
        ("probing", moves.code == 38, VERMILLION, 4),
    )
    view = View(f"{len(moves)} moves of the program")
    for name, rows, colour, width in kinds:
        parts = [
            _arc(start[k], end[k], int(moves.code[k]), int(moves.plane[k]), moves.centre_mm[k])
            for k in np.flatnonzero(rows)
        ]
        if parts:
            view.add(lines(parts, colour=colour, width=width, name=name))
    return view


def _arc(start: Floats, end: Floats, code: int, plane: int, centre: Floats) -> Floats:
    """Points of a move: its ends, or an arc."""
    planes = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
    if code not in (2, 3) or plane not in planes:
        return np.array([start, end])
    i, j, _ = planes[plane]
    first = np.arctan2(start[j] - centre[1], start[i] - centre[0])
    last = np.arctan2(end[j] - centre[1], end[i] - centre[0])
    turn = (last - first) % (2 * np.pi) if code == 3 else -((first - last) % (2 * np.pi))
    turn = turn or (2 * np.pi if code == 3 else -2 * np.pi)
    share = np.linspace(0.0, 1.0, max(3, int(abs(turn) / 0.1)))
    radius = np.hypot(start[i] - centre[0], start[j] - centre[1])
    points = start + share[:, None] * (end - start)
    points[:, i] = centre[0] + radius * np.cos(first + share * turn)
    points[:, j] = centre[1] + radius * np.sin(first + share * turn)
    return points
