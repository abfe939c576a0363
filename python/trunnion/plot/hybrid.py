"""Pictures of the hybrid machine: transformed cube, ball-bar view, what a plan determines."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D

from trunnion.base.errors import InputError
from trunnion.hybrid.cube import EDGES, CubeChange, CubeStudy
from trunnion.hybrid.identifiability import Identifiability
from trunnion.hybrid.identify import BallbarIdentification
from trunnion.hybrid.results import ClosureDependence, Constraint, Forward, Sensitivity
from trunnion.hybrid.spectrum import combination
from trunnion.plot.axes import axes_or_new, new_figure
from trunnion.plot.picture import Axis as PictureAxis
from trunnion.plot.picture import Kind, Marker, Picture, bars, line, points
from trunnion.plot.statistics import order_picture
from trunnion.plot.style import BLUE, MUTED, PALETTE, VERMILLION, near_number, round_number

SHARE = 0.35
LEVELS = (-2, -1, 0, 1, 2)
COLUMNS = 4
TOOL_MM, TOOL_SHARE = 100.0, 0.2  # of the size of the picture: length of a tool
ZERO = 1e-9  # of the largest singular value
HEAVY = 0.45  # of a combination: components that name it


def plot_cube(
    change: CubeChange, *, magnification: float | None = None, ax: Axes | None = None
) -> Axes:
    """Draw the cube before (grey) and after (blue), displacements magnified, as in Fig. 2.

    Parameters
    ----------
    magnification
        By default so that the largest displacement is a third of the side.
    ax
        Axes of projection "3d"; new ones if None.
    """
    drawn = axes_or_new(ax, 4.4, 4.4, "3d")
    if not isinstance(drawn, Axes3D):
        raise InputError("ax: got flat axes, expected axes of projection '3d'")
    shift = change.moved_mm - change.nominal_mm
    side = float(np.ptp(change.nominal_mm[:, 0]))
    largest = float(np.linalg.norm(shift, axis=1).max())
    if magnification is None:
        magnification = round_number(side / 3 / largest) if largest > 0 else 1.0
    moved = change.nominal_mm + magnification * shift
    for i, j in EDGES:
        drawn.plot(*change.nominal_mm[[i, j]].T, color=MUTED, linewidth=0.8)
        drawn.plot(*moved[[i, j]].T, color=BLUE, linewidth=1.4)
    middle = (change.nominal_mm.max(axis=0) + change.nominal_mm.min(axis=0)) / 2
    reach = 0.9 * side
    for axis, value in zip("xyz", middle, strict=True):
        getattr(drawn, f"set_{axis}lim")(value - reach, value + reach)
        getattr(drawn, f"set_{axis}ticks")([value - side / 2, value + side / 2])
        getattr(drawn, f"set_{axis}label")(f"{axis.upper()} (mm)", fontsize=8, labelpad=-2)
    drawn.set_box_aspect((1, 1, 1), zoom=0.88)
    drawn.tick_params(labelsize=8, pad=-1)
    drawn.set_title(
        f"{_label(change)}, × {magnification:,.0f}\n"
        f"centre {change.shift_um:.1f} µm, edges {change.largest_edge_um:.1f} µm",
        fontsize=9,
    )
    return cast(Axes, drawn)


def plot_cubes(study: CubeStudy, *, magnification: float | None = None) -> Figure:
    """Draw every cube of a study, one panel an error, all at one magnification."""
    count = len(study.changes)
    columns = min(count, COLUMNS)
    rows = -(-count // columns)
    figure = new_figure(3.4 * columns, 3.7 * rows)
    largest = max(
        float(np.linalg.norm(c.moved_mm - c.nominal_mm, axis=1).max()) for c in study.changes
    )
    one = magnification or (round_number(study.side_mm / 3 / largest) if largest > 0 else 1.0)
    for k, change in enumerate(study.changes):
        ax = figure.add_subplot(rows, columns, k + 1, projection="3d")
        plot_cube(change, magnification=one, ax=ax)
    return figure


def cube_study_picture(study: CubeStudy) -> Picture:
    """Return displacement of the centre and largest change of an edge for each error."""
    changes = sorted(study.changes, key=lambda c: -max(c.shift_um, c.largest_edge_um))
    return Picture(
        f"What each error does to a cube of {study.side_mm:g} mm",
        PictureAxis("Change", "µm"),
        PictureAxis(names=tuple(_label(c) for c in changes)),
        (
            bars([c.shift_um for c in changes], "the centre moves", colour=BLUE),
            points(
                [c.largest_edge_um for c in changes],
                np.arange(len(changes)),
                "an edge changes, at most",
                colour=VERMILLION,
                marker="diamond",
                size=6.0,
            ),
        ),
    )


def plot_ballbar_view(change: CubeChange, *, ax: Any = None, **style: Any) -> Any:
    """Draw what a ball-bar sees of an error: radial change along three circles, centre removed."""
    return ballbar_view_picture(change).draw(ax, **style)


def ballbar_view_picture(change: CubeChange) -> Picture:
    """Return the radial change along circles in three planes, magnified."""
    angle = np.arange(361.0)
    largest = max(float(np.abs(change.circles_um).max()), 1e-3)
    step = near_number(largest / 2)
    scale = SHARE / largest
    series = [
        line(angle, np.full_like(angle, 1 + scale * step * k), colour=MUTED, width=0.6 + (k == 0))
        for k in LEVELS
    ]
    for k, (plane, values) in enumerate(zip(("XY", "YZ", "ZX"), change.circles_um, strict=True)):
        radius = 1 + scale * np.append(values, values[0])
        label = f"{plane}, 0° at +{plane[0]}"
        series.append(line(angle, radius, label, colour=PALETTE[k]))
    return Picture(
        f"{_label(change)}: change of radius",
        PictureAxis("angle", "°"),
        PictureAxis(limits=(0.0, 1 + 1.2 * SHARE), ticks=()),
        tuple(series),
        Kind.POLAR,
        note=f"Largest {largest:.3g} µm; {step:g} µm a line.",
    )


def identifiability_picture(result: Identifiability) -> Picture:
    """Return the standard errors of combinations; what is not identifiable is named at the end."""
    names = [
        f"{k + 1}: {combination(row, result.parameters, HEAVY)}"
        for k, row in enumerate(result.directions)
    ]
    shown = np.where(np.isfinite(result.direction_errors), result.direction_errors, np.nan)
    lost = len(shown) - result.rank
    names = [
        name if k < result.rank else f"{name} (not identifiable)" for k, name in enumerate(names)
    ]
    title = f"{result.rank} of {len(shown)} combinations are identifiable"
    return Picture(
        title if lost else "Standard errors of combinations of errors",
        PictureAxis("Standard error", "µm or arcsec", log=True),
        PictureAxis(names=tuple(names)),
        (bars(shown),),
    )


def ballbar_residuals_picture(result: BallbarIdentification) -> Picture:
    """Return the residuals in the order of the readings."""
    title = "Ball-bar: measured less modelled length"
    return order_picture(result.residuals_um, "µm", title=title)


def sensitivity_picture(result: Sensitivity, *, pose: int = 0) -> Picture:
    """Return how far each error moves the tool point."""
    size = np.linalg.norm(result.tip[pose], axis=0)
    order = np.argsort(-size, kind="stable")
    return Picture(
        "Displacement of the tool point by each error",
        PictureAxis("Tool point", "µm per µm or arcsec"),
        PictureAxis(names=tuple(result.parameters[k] for k in order)),
        (bars(size[order]),),
    )


def forward_pictures(result: Forward) -> list[Picture]:
    """Return the tool points from above and from the front, with the tool's direction."""
    size = max(float(np.ptp(result.tip_mm, axis=0).max()), TOOL_MM)
    found = []
    for i, j, view in ((0, 1, "from above"), (0, 2, "from the front")):
        x, y = result.tip_mm[:, i], result.tip_mm[:, j]
        u, v = -TOOL_SHARE * size * result.direction[:, [i, j]].T
        gap = np.full_like(x, np.nan)
        ends = [np.stack([a, a + b, gap], axis=1).ravel() for a, b in ((x, u), (y, v))]
        series = (
            line(ends[0], ends[1], "tool", colour=MUTED),
            points(x, y, "tool point", colour=BLUE),
        )
        title = f"Tool points of {len(result)} poses, {view}"
        axes = [PictureAxis("XYZ"[k], "mm") for k in (i, j)]
        found.append(Picture(title, axes[0], axes[1], series, Kind.MAP))
    return found


def constraint_picture(result: Constraint) -> Picture:
    """Return the singular values of the loop Jacobian; what is zero is redundant."""
    values = result.singular_values
    zero = values < ZERO * float(values.max(initial=1.0))
    names = tuple(f"{k + 1}{', redundant' if z else ''}" for k, z in enumerate(zero))
    return Picture(
        f"Loop Jacobian of rank {result.rank}: {result.mobility} degrees of freedom",
        PictureAxis("Singular value", "mm/rad", log=True),
        PictureAxis(names=names),
        (bars(np.where(zero, np.nan, values)),),
    )


def closure_picture(result: ClosureDependence) -> Picture:
    """Return the displacement of the tool point under each way to close the loops."""
    at = np.arange(len(result.closures), dtype=np.float64)
    markers: tuple[Marker, ...] = ("dot", "square", "diamond")
    series = [
        points(values, at, f"along {axis}", colour=PALETTE[k], marker=markers[k], size=6.5)
        for k, (axis, values) in enumerate(zip("XYZ", result.tip_um.T, strict=True))
    ]
    return Picture(
        f"Answers of the closures differ by {result.spread_um:.3g} µm",
        PictureAxis("Displacement of the tool point", "µm"),
        PictureAxis(names=result.closures),
        (line([0.0, 0.0], [-0.5, len(at) - 0.5], colour=MUTED, width=0.8), *series),
    )


def _label(change: CubeChange) -> str:
    stem, unit = change.error.rsplit("_", 1)
    return f"{stem} {change.amount:g} {'µm' if unit == 'um' else unit}"
