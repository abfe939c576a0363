"""Volumetric errors: sections with vectors on one scale, over the poses, as shares."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trunnion.base.checks import choose
from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.compensation.maps import ErrorMap
from trunnion.compensation.volumetric import PoseField, VolumetricError
from trunnion.plot.picture import Axis, Kind, Picture, Series, arrows, heat, line
from trunnion.plot.style import PALETTE

_PLANES = {"xy": (0, 1, 2), "xz": (0, 2, 1), "yz": (1, 2, 0)}
_ARROWS = 9
ARROW_SHARE = 0.11
"""Of the size of the section: an arrow as long as the top of the colour scale."""
INK = "#101418"  # on colours
MIN_SHARE_UM = 1e-6


def at_pose(
    field: VolumetricError, pose: Mapping[str, float] | None
) -> tuple[tuple[int, ...], str]:
    """Index of the pose nearest to an expected one (the worst one unless given), and its words."""
    expected = (
        field.worst_pose_deg if pose is None else {k.upper(): float(v) for k, v in pose.items()}
    )
    for letter in expected:
        choose("pose", letter, field.rotary_deg)
    index = {
        letter: int(np.argmin(np.abs(nodes - expected.get(letter, nodes[0]))))
        for letter, nodes in field.rotary_deg.items()
    }
    said = ", ".join(f"{letter} = {field.rotary_deg[letter][i]:g}°" for letter, i in index.items())
    return tuple(index.values()), said


def vectors_at(field: VolumetricError, pose: Mapping[str, float] | None) -> tuple[Floats, str]:
    """Error vectors (nx, ny, nz, 3) at the pose nearest to one, µm, and its words."""
    index, said = at_pose(field, pose)
    poses = (len(nodes) for nodes in field.rotary_deg.values())
    return field.field_um.reshape(*poses, *field.grid_shape, 3)[index], said


def plot_volumetric(
    field: VolumetricError,
    *,
    plane: str = "xz",
    at_mm: float | None = None,
    pose: Mapping[str, float] | None = None,
    scale_um: float | tuple[float, float] | None = None,
    colorbar: bool = True,
    ax: Any = None,
    **style: Any,
) -> Any:
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
        of this field unless given. Arrows follow it: one as long as its upper end has one length in
        every plot, which the title states.
    colorbar, ax
        Whether to draw one beside the section; where to draw (None: a new figure).
    **style
        As :meth:`trunnion.plot.picture.Picture.draw` takes it.
    """
    p = volumetric_picture(
        field, plane=plane, at_mm=at_mm, pose=pose, scale_um=scale_um, colorbar=colorbar
    )
    return p.draw(ax, width=6.4, height=4.4, **style)


def volumetric_picture(
    field: VolumetricError,
    *,
    plane: str = "xz",
    at_mm: float | None = None,
    pose: Mapping[str, float] | None = None,
    scale_um: float | tuple[float, float] | None = None,
    colorbar: bool = True,
) -> Picture:
    """Return a section through a field; arguments as for `plot_volumetric`."""
    whole, said = vectors_at(field, pose)
    axes = (field.x_mm, field.y_mm, field.z_mm)
    low, top, log = _scale(field.max_um, scale_um)
    label = "error (µm)" if colorbar else ""
    return section_picture(
        axes, whole, said, (low, top), plane=plane, at_mm=at_mm, log=log, label=label
    )


def section_picture(
    axes: tuple[Floats, Floats, Floats],
    vectors: Floats,
    said: str,
    scale: tuple[float, float],
    *,
    plane: str = "xz",
    at_mm: float | None = None,
    log: bool = False,
    label: str = "",
    unit: str = "mm",
) -> Picture:
    """Return a section through vectors (nx, ny, nz, 3), µm, at the nodes of three axes.

    said: the pose in words; scale: least and largest of the colours; unit: of the nodes.
    """
    u, v, w = _PLANES[choose("plane", plane, _PLANES)]
    if at_mm is not None and not axes[w].min() <= at_mm <= axes[w].max():
        raise InputError(
            f"at_mm: got {at_mm:g}, expected {axes[w].min():g} to {axes[w].max():g} (the field's "
            f"{'xyz'[w]})"
        )
    at = len(axes[w]) - 1 if at_mm is None else int(np.argmin(np.abs(axes[w] - at_mm)))
    section = np.take(vectors, at, axis=w)
    length = np.linalg.norm(section, axis=-1)
    colours = heat(length.T, axes[u], axes[v], scale=scale, log=log, label=label)
    arrow, shown = _arrows((axes[u], axes[v]), section[..., [u, v]], scale[1])
    name = "xyz"
    size = "" if log else f"; longest arrow {shown:.3g} µm"
    where = f"{axes[w][at]:g} mm" if unit == "mm" else f"{unit} {axes[w][at]:g}"
    place = ", ".join(filter(None, (f"{name[w]} = {where}", said)))
    return Picture(
        f"{place}: largest {length.max():.3g} µm{size}",
        Axis(name[u].upper(), unit),
        Axis(name[v].upper(), unit),
        (colours, *arrow),
        Kind.MAP,
    )


def pose_field_picture(field: PoseField) -> Picture:
    """Return a section through the errors at one pose; the field knows its nodes by number only."""
    axes = [np.arange(1.0, n + 1) for n in field.field_um.shape[:3]]
    said = ", ".join(f"{letter} = {value:g}°" for letter, value in field.rotary_deg.items())
    scale = (0.0, field.max_um or 1.0)
    return section_picture(
        (axes[0], axes[1], axes[2]), field.field_um, said, scale, label="error (µm)", unit="node"
    )


def error_map_picture(made: ErrorMap) -> Picture:
    """Return a section through the corrections, where the rotary axes take the largest one."""
    table = made.corrections_um
    length = np.linalg.norm(table, axis=-1)
    poses = table.shape[:-4]
    worst = np.unravel_index(int(np.argmax(length)), length.shape)[: len(poses)]
    said = ", ".join(
        f"{letter} = {nodes[i]:g}°"
        for (letter, nodes), i in zip(made.rotary_deg.items(), worst, strict=True)
        if len(nodes) > 1
    )
    axes = (made.x_mm, made.y_mm, made.z_mm)
    scale = (0.0, float(length.max()) or 1.0)
    return section_picture(axes, table[worst], said, scale, label="correction (µm)")


def _scale(
    largest: float, scale_um: float | tuple[float, float] | None
) -> tuple[float, float, bool]:
    """Least and largest of the colours, and whether they are logarithmic."""
    if isinstance(scale_um, tuple):
        low, high = scale_um
        if not 0 < low < high:
            raise InputError(
                f"scale_um: got {scale_um!r}, expected (low, high) with 0 < low < high"
            )
        return low, high, True
    top = largest if scale_um is None else scale_um
    return 0.0, top if top > 0 else 1.0, False


def _arrows(
    nodes: tuple[Floats, Floats], vectors: Floats, top: float
) -> tuple[list[Series], float]:
    """Some of the vectors (n, m, 2) on the scale of the colours; the longest of them, µm."""
    picks = [
        np.unique(np.linspace(0, len(n) - 1, min(_ARROWS, len(n))).round().astype(int))
        for n in nodes
    ]
    shown = vectors[np.ix_(*picks)].reshape(-1, 2)
    longest = float(np.hypot(*shown.T).max(initial=0.0))
    size = max(float(np.ptp(n)) for n in nodes)
    x, y = (g.ravel() for g in np.meshgrid(nodes[0][picks[0]], nodes[1][picks[1]], indexing="ij"))
    drawn = shown * (ARROW_SHARE * size / top)
    return [
        arrows(x, y, *drawn.T, colour="#ffffff", width=2.6),
        arrows(x, y, *drawn.T, colour=INK, width=1.1),
    ], longest


def plot_over_poses(
    field: VolumetricError,
    *,
    scale_um: float | tuple[float, float] | None = None,
    colorbar: bool = True,
    ax: Any = None,
    **style: Any,
) -> Any:
    """Largest error in the box over the positions of both rotary axes.

    Parameters
    ----------
    field
        A volumetric error over a grid of two rotary axes.
    scale_um, colorbar, ax, **style
        As for `plot_volumetric`.
    """
    p = poses_picture(field, scale_um=scale_um, colorbar=colorbar)
    return p.draw(ax, width=6.4, height=3.6, **style)


def poses_picture(
    field: VolumetricError,
    *,
    scale_um: float | tuple[float, float] | None = None,
    colorbar: bool = True,
) -> Picture:
    """Return the largest error over both rotary axes as a map."""
    values = field.max_by_pose_um
    if values.ndim != 2:
        raise InputError(
            f"plot_over_poses: got {values.ndim} axes with several positions, expected two"
        )
    (first, rows), (second, columns) = field.rotary_deg.items()
    low, top, log = _scale(field.max_um, scale_um)
    label = "largest error (µm)" if colorbar else ""
    return Picture(
        f"largest {field.max_um:.3g} µm, least {values.min():.3g} µm, rms {field.rms_um:.3g} µm",
        Axis(second, "°"),
        Axis(first, "°"),
        (heat(values, columns, rows, scale=(low, top), log=log, label=label),),
    )


def plot_share(fields: Mapping[str, VolumetricError], *, ax: Any = None, **style: Any) -> Any:
    """How much of the box (and of the poses) has less error than this, one curve a field.

    Parameters
    ----------
    fields
        Name → volumetric error, before and after compensations.
    ax, **style
        As :meth:`trunnion.plot.picture.Picture.draw` takes them.
    """
    return share_picture(fields).draw(ax, **style)


def share_picture(fields: Mapping[str, VolumetricError]) -> Picture:
    """Return the share of the box with less error than this."""
    series = []
    for k, (name, field) in enumerate(fields.items()):
        values = np.sort(field.magnitude_um.ravel())
        share = 100.0 * (np.arange(len(values)) + 0.5) / len(values)
        # Zero has no place on a logarithmic axis; a picometre stands for it.
        label = f"{name}: {values[-1]:.3g} µm at most"
        colour = PALETTE[k % len(PALETTE)]
        series.append(line(np.maximum(values, MIN_SHARE_UM), share, label, colour=colour))
    return Picture(
        "Share of the work space and poses with less error",
        Axis("Error", "µm", log=True),
        Axis("Share with less", "%", limits=(0.0, 101.0)),
        tuple(series),
    )
