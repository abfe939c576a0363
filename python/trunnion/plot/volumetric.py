"""Plots of volumetric errors: sections as in the paper's Figs. 11 to 13, and over the poses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize

from trunnion.base.checks import choose
from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.compensation.volumetric import VolumetricError
from trunnion.plot.axes import axes_or_new

_PLANES = {"xy": (0, 1, 2), "xz": (0, 2, 1), "yz": (1, 2, 0)}
_COLOURS = "viridis"
_ARROWS = 8


def _at_pose(field: VolumetricError, pose: Mapping[str, float] | None) -> tuple[int, ...]:
    """Index of the pose nearest to an expected one; the worst one unless given."""
    expected = field.worst_pose_deg if pose is None else pose
    return tuple(
        int(np.argmin(np.abs(nodes - expected.get(letter, nodes[0]))))
        for letter, nodes in field.rotary_deg.items()
    )


def _norm(field: VolumetricError, scale_um: float | tuple[float, float] | None) -> Normalize:
    """Colour scale: linear from zero, or logarithmic between two values."""
    if isinstance(scale_um, tuple):
        low, high = scale_um
        if not 0 < low < high:
            raise InputError(
                f"scale_um: got {scale_um!r}, expected (low, high) with 0 < low < high"
            )
        return LogNorm(low, high, clip=True)
    top = field.max_um if scale_um is None else scale_um
    return Normalize(0.0, top if top > 0 else 1.0)


def plot_volumetric(
    field: VolumetricError,
    *,
    plane: str = "xz",
    at_mm: float | None = None,
    pose: Mapping[str, float] | None = None,
    scale_um: float | tuple[float, float] | None = None,
    colorbar: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Section through a field: colour is the length of the error, arrows its part in the plane.

    Parameters
    ----------
    field, plane
        A volumetric error; "xy", "xz" or "yz", workpiece's frame.
    at_mm
        Where the section lies on the third axis (the nearest node); its upper end unless given.
    pose
        Rotary positions (the nearest ones); those of the largest error unless given.
    scale_um
        Colour scale, to share one between plots: its upper end (linear from zero), or (low, high)
        for a logarithmic one, on which before and after can both be read. From zero to the largest
        of this field unless given.
    colorbar, ax
        Whether to draw one beside the section; where to draw (None: a new figure).
    """
    u, v, w = _PLANES[choose("plane", plane, _PLANES)]
    axes = (field.x_mm, field.y_mm, field.z_mm)
    at = len(axes[w]) - 1 if at_mm is None else int(np.argmin(np.abs(axes[w] - at_mm)))
    vectors = field.field_um
    vectors = vectors.reshape(*(len(n) for n in field.rotary_deg.values()), *field.grid_shape, 3)
    section = np.take(vectors[_at_pose(field, pose)], at, axis=w)
    ax = axes_or_new(ax, 5.6, 3.6)
    length = np.linalg.norm(section, axis=-1)
    image = ax.pcolormesh(
        axes[u],
        axes[v],
        length.T,
        shading="gouraud",
        norm=_norm(field, scale_um),
        cmap=_COLOURS,
    )
    if colorbar:
        ax.figure.colorbar(image, ax=ax, label="error (µm)", shrink=0.8)
    longest = _draw_arrows(ax, (axes[u], axes[v]), section[..., [u, v]])
    name = "xyz"
    title = f"{name[w]} = {axes[w][at]:g} mm: largest {length.max():.3g} µm"
    if longest > 0:
        title += f"\nlongest arrow {longest:.3g} µm"
    ax.set_aspect("equal")
    for nodes, limit in ((axes[u], ax.set_xlim), (axes[v], ax.set_ylim)):
        # Room for the arrows at the edges.
        room = 0.12 * float(max(np.ptp(axes[u]), np.ptp(axes[v])))
        limit(float(nodes[0]) - room, float(nodes[-1]) + room)
    ax.set_xlabel(f"{name[u]} (mm)")
    ax.set_ylabel(f"{name[v]} (mm)")
    ax.set_title(title, fontsize="medium")
    return ax


def _draw_arrows(ax: Axes, nodes: tuple[Floats, Floats], vectors: Floats) -> float:
    """Draw some of the vectors (n, m, 2) at their nodes; return the longest of them, µm."""
    picks = [
        np.unique(np.linspace(0, len(n) - 1, min(_ARROWS, len(n))).round().astype(int))
        for n in nodes
    ]
    shown = vectors[np.ix_(*picks)]
    longest = float(np.hypot(shown[..., 0], shown[..., 1]).max())
    if longest > 0:
        arrows = ax.quiver(
            *np.meshgrid(nodes[0][picks[0]], nodes[1][picks[1]], indexing="ij"),
            shown[..., 0],
            shown[..., 1],
            angles="xy",
            scale_units="xy",
            scale=longest / (0.11 * max(float(np.ptp(nodes[0])), float(np.ptp(nodes[1])))),
            color="white",
            edgecolor="black",
            linewidth=0.4,
            width=0.007,
            clip_on=False,
        )
        # Arrows may leave the section a little; they are no reason to make it smaller.
        arrows.set_in_layout(False)
    return longest


def plot_over_poses(
    field: VolumetricError,
    *,
    scale_um: float | tuple[float, float] | None = None,
    colorbar: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Largest error in the box over the positions of both rotary axes.

    Parameters
    ----------
    field
        A volumetric error over a grid of two rotary axes.
    scale_um, colorbar
        As for `plot_volumetric`.
    """
    if field.max_by_pose_um.ndim != 2:
        raise InputError(
            f"plot_over_poses: got {field.max_by_pose_um.ndim} axes with several positions, "
            "expected two"
        )
    (first, rows), (second, columns) = field.rotary_deg.items()
    ax = axes_or_new(ax, 5.6, 3.2)
    image = ax.pcolormesh(
        columns,
        rows,
        field.max_by_pose_um,
        shading="gouraud",
        norm=_norm(field, scale_um),
        cmap=_COLOURS,
    )
    if colorbar:
        ax.figure.colorbar(image, ax=ax, label="largest error (µm)", shrink=0.9)
    ax.set_xlabel(f"{second} (°)")
    ax.set_ylabel(f"{first} (°)")
    ax.set_title(f"largest {field.max_um:.3g} µm, rms {field.rms_um:.3g} µm", fontsize="medium")
    return ax


def plot_share(fields: Mapping[str, VolumetricError], *, ax: Axes | None = None) -> Axes:
    """How much of the box (and of the poses) has less error than this, one curve a field.

    Parameters
    ----------
    fields
        Name → volumetric error, before and after compensations.
    """
    ax = axes_or_new(ax, 5.6, 3.4)
    for name, field in fields.items():
        values = np.sort(field.magnitude_um.ravel())
        share = 100.0 * (np.arange(len(values)) + 0.5) / len(values)
        # Zero has no place on a logarithmic axis; a picometre stands for it.
        ax.plot(np.maximum(values, 1e-6), share, label=f"{name}: {values[-1]:.3g} µm at most")
    ax.set_xscale("log")
    ax.set_xlabel("error (µm)")
    ax.set_ylabel("share with less (%)")
    ax.grid(alpha=0.3)
    ax.legend(loc="best", fontsize="small")
    return ax
