"""Plots of the hybrid machine: transformed cube, ball-bar view, what a plan determines."""

from __future__ import annotations

from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D

from trunnion.base.errors import InputError
from trunnion.hybrid.cube import EDGES, CubeChange, CubeStudy
from trunnion.hybrid.identifiability import Identifiability
from trunnion.hybrid.identify import BallbarIdentification
from trunnion.hybrid.results import Sensitivity
from trunnion.plot.axes import axes_or_new, new_figure


def plot_cube(
    change: CubeChange, *, magnification: float | None = None, ax: Axes | None = None
) -> Axes:
    """Draw the cube before (grey) and after (dark), displacements magnified, as in Fig. 2.

    Parameters
    ----------
    magnification
        By default so that the largest displacement is a third of the side.
    ax
        Axes of projection "3d"; new ones if None.
    """
    drawn = axes_or_new(ax, 4.0, 4.0, "3d")
    if not isinstance(drawn, Axes3D):
        raise InputError("ax: got flat axes, expected axes of projection '3d'")
    shift = change.moved_mm - change.nominal_mm
    side = float(np.ptp(change.nominal_mm[:, 0]))
    largest = float(np.linalg.norm(shift, axis=1).max())
    if magnification is None:
        magnification = _round_down(side / 3 / largest) if largest > 0 else 1.0
    moved = change.nominal_mm + magnification * shift
    for i, j in EDGES:
        drawn.plot(*change.nominal_mm[[i, j]].T, color="0.55", linewidth=0.8)
        drawn.plot(*moved[[i, j]].T, color="C0", linewidth=1.3)
    middle = (change.nominal_mm.max(axis=0) + change.nominal_mm.min(axis=0)) / 2
    reach = 0.9 * side
    for axis, value in zip("xyz", middle, strict=True):
        getattr(drawn, f"set_{axis}lim")(value - reach, value + reach)
        getattr(drawn, f"set_{axis}ticks")([value - side / 2, value + side / 2])
        getattr(drawn, f"set_{axis}label")(axis.upper(), fontsize=7, labelpad=-8)
    drawn.set_box_aspect((1, 1, 1))
    drawn.tick_params(labelsize=6, pad=-2)
    drawn.tick_params(axis="z", pad=2)
    drawn.set_title(
        f"{_label(change)}, × {magnification:g}\n"
        f"centre {change.shift_um:.1f} µm, edges {change.largest_edge_um:.1f} µm",
        fontsize=8,
        pad=0,
    )
    return cast(Axes, drawn)


def plot_cubes(study: CubeStudy, *, magnification: float | None = None) -> Figure:
    """Draw every cube of a study, one panel an error."""
    count = len(study.changes)
    columns = min(count, 6)
    rows = -(-count // columns)
    figure = new_figure(2.6 * columns, 2.7 * rows)
    for k, change in enumerate(study.changes):
        ax = figure.add_subplot(rows, columns, k + 1, projection="3d")
        plot_cube(change, magnification=magnification, ax=ax)
    return figure


def plot_ballbar_view(change: CubeChange, *, ax: Axes | None = None) -> Axes:
    """Draw what a ball-bar sees of an error: radial change along three circles, centre removed."""
    ax = axes_or_new(ax, 4.6, 4, "polar")
    angle = np.radians(np.arange(361.0))
    for plane, values in zip(("XY", "YZ", "ZX"), change.circles_um, strict=True):
        ax.plot(angle, np.append(values, values[0]), label=plane, linewidth=1.2)
    largest = max(float(np.abs(change.circles_um).max()), 1e-3)
    ax.set_ylim(-2.5 * largest, 1.3 * largest)
    ax.set_yticks([-largest, 0, largest], [f"{v:+.2f}" for v in (-largest, 0, largest)])
    ax.tick_params(labelsize=7)
    ax.set_title(f"{_label(change)}: radius change, µm", fontsize=9)
    ax.legend(fontsize=7, loc="lower left", bbox_to_anchor=(-0.12, -0.08), frameon=False)
    return ax


def plot_identifiability(result: Identifiability, *, ax: Axes | None = None) -> Axes:
    """Draw the standard error of each combination of errors, best determined first."""
    ax = axes_or_new(ax, 5.5, 3.2)
    determined = result.direction_errors[: result.rank]
    ax.semilogy(np.arange(1, len(determined) + 1), determined, "o-", markersize=4, linewidth=1)
    ax.set_xlabel("combination of errors")
    ax.set_ylabel("standard error, µm or arcsec")
    ax.set_xticks(range(1, len(result.parameters) + 1, 2))
    ax.grid(visible=True, alpha=0.3)
    return ax


def plot_ballbar_residuals(result: BallbarIdentification, *, ax: Axes | None = None) -> Axes:
    """Draw the residuals of an identification in the order of the readings, with ± 2 σ."""
    ax = axes_or_new(ax)
    ax.plot(result.residuals_um, ".", markersize=3)
    for sign in (-2, 2):
        ax.axhline(sign * result.sigma_um, color="0.4", linewidth=0.8, linestyle="--")
    ax.set_xlabel("reading")
    ax.set_ylabel("measured less modelled length, µm")
    ax.grid(visible=True, alpha=0.3)
    return ax


def plot_sensitivity(result: Sensitivity, *, pose: int = 0, ax: Axes | None = None) -> Axes:
    """Draw how far each error moves the tool point at one pose."""
    ax = axes_or_new(ax)
    ax.bar(result.parameters, np.linalg.norm(result.tip[pose], axis=0), color="C0")
    ax.set_ylabel("tool point, µm per µm or arcsec")
    ax.tick_params(axis="x", labelrotation=90, labelsize=7)
    ax.grid(visible=True, axis="y", alpha=0.3)
    return ax


def _label(change: CubeChange) -> str:
    stem, unit = change.error.rsplit("_", 1)
    return f"{stem} {change.amount:g} {'µm' if unit == 'um' else unit}"


def _round_down(value: float) -> float:
    """To one significant digit: 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step for step in (1, 2, 5) if step * power <= value) * power)
