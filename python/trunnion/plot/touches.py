"""Pictures of touches and estimates."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from trunnion.base.errors import InputError
from trunnion.base.units import Floats, unit_of
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.plot.axes import axes_or_new
from trunnion.plot.picture import Axis, Kind, Picture, Series, arrows, bars, line, points
from trunnion.plot.scenes.machine import artefact_outline
from trunnion.plot.static import panels
from trunnion.plot.style import BLUE, BODY, GREEN, MUTED, PALETTE, PURPLE, VERMILLION, round_number
from trunnion.probing.observability import Observability
from trunnion.probing.result import IdentificationResult
from trunnion.setup import Artefact, Machine, Setup
from trunnion.setup.machines import presets

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ARROW_MM = 12.0
LONGEST_MM = 15.0
APPROACH_SHARE = 0.05  # of the size of the picture
EDGE = "#5f6b75"
SEEN = 0.5  # percent: a shorter bar is not seen


def plot_artefact(
    touches: Touches,
    setup: Setup,
    *,
    residuals_um: Floats | None = None,
    magnification: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the artefact in its true shape with its touches, in its own frame.

    Parameters
    ----------
    touches
        A plan, or touches.
    setup
        Machine and artefact.
    residuals_um
        Deviations along the approach to draw as arrows, (n,), coloured by their sign; approach
        directions if None.
    magnification
        Of the deviation arrows; a round number so that the largest is some 15 mm if None. The
        legend states the scale in µm.
    ax
        Three-dimensional axes; new ones if None.

    Raises
    ------
    InputError
        Axes that are not of projection "3d".
    """
    ax = axes_or_new(ax, 7.0, 6.0, "3d")
    if getattr(ax, "name", "") != "3d":
        raise InputError("ax: got flat axes, expected axes of projection '3d'")
    axes: Any = ax
    _draw_solid(axes, setup)
    chain = Chain(setup)
    rotation, shift = chain.table_pose(chain.to_machine(touches.rotary_deg, len(touches)))
    centre = np.einsum("nji,nj->ni", rotation, touches.position_mm - shift)
    direction = np.einsum("nji,nj->ni", rotation, touches.direction)
    angle = np.radians(setup.artefact.turn_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    centre, direction = (centre - setup.artefact.effective_place_mm) @ turned, direction @ turned
    contact = centre + direction * setup.probe.ball_radius_mm
    axes.scatter(*contact.T, s=13, color=VERMILLION, depthshade=False, label="touch", zorder=5)
    if residuals_um is None:
        _arrows(axes, contact - ARROW_MM * direction, ARROW_MM * direction, BLUE, "approach")
    else:
        residuals = np.asarray(residuals_um, dtype=float)
        largest = float(np.abs(residuals).max(initial=1e-9))
        times = magnification or round_number(1e3 * LONGEST_MM / largest)
        unit = round_number(largest)
        arrows = 1e-3 * times * residuals[:, None] * direction
        for sign, colour in ((1, GREEN), (-1, PURPLE)):
            mine = np.sign(residuals) == sign
            _arrows(axes, contact[mine], arrows[mine], colour, f"deviation {'−+'[sign > 0]}")
        axes.plot([], [], " ", label=f"{unit:g} µm drawn as {1e-3 * times * unit:.3g} mm")
    reach = float(np.abs(contact[:, :2]).max()) + 14.0
    low = min(0.0, float(contact[:, 2].min()))
    top = float(contact[:, 2].max()) + 14.0
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(low, top))
    axes.set_box_aspect((2 * reach, 2 * reach, top - low), zoom=1.05)
    axes.set_xlabel("X (mm)", labelpad=8)
    axes.set_ylabel("Y (mm)", labelpad=8)
    axes.set_zlabel("Z (mm)", labelpad=4)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5))
    axes.zaxis.set_major_locator(MaxNLocator(3))
    axes.view_init(elev=32, azim=-58)
    axes.legend(loc="upper left", frameon=False, fontsize="small")
    places = len(np.unique(np.round(np.hstack([contact, direction]), 0), axis=0))
    title = f"{len(touches)} touches at {places} places of the {setup.artefact.kind}, in its frame"
    axes.set_title(title, fontsize="medium")
    return axes  # type: ignore[no-any-return]


def touches_pictures(touches: Touches) -> list[Picture]:
    """Return where the ball's centre touched, machine frame, from above and from the front."""
    at, towards = touches.position_mm, touches.direction
    turned = np.column_stack(list(touches.rotary_deg.values())) if touches.rotary_deg else None
    _, pose = np.unique(turned, axis=0, return_inverse=True) if turned is not None else (0, None)
    several = f" in {int(pose.max()) + 1} postures" if pose is not None and len(pose) else ""
    size = max(float(np.ptp(at, axis=0).max(initial=0.0)), 1.0)
    found = []
    for i, j, view in ((0, 1, "from above"), (0, 2, "from the front")):
        x, y = at[:, i], at[:, j]
        u, v = APPROACH_SHARE * size * towards[:, [i, j]].T
        rows = np.arange(len(touches))
        series = (
            arrows(x - u, y - v, u, v, "approach", colour=MUTED, width=1.0),
            points(x, y, "centre of the ball", colour=VERMILLION, rows=rows, size=4.0),
        )
        title = f"{len(touches)} touches{several}, {view}"
        axes = [Axis("XYZ"[k], "mm") for k in (i, j)]
        found.append(Picture(title, axes[0], axes[1], series, Kind.MAP))
    return found


def _draw_solid(axes: Any, setup: Setup) -> None:
    artefact = setup.artefact
    radius = 0.5 * (artefact.diameter_mm or 0.0)
    u, v = np.mgrid[0 : 2 * np.pi : 40j, 0 : np.pi : 20j]
    if artefact.kind == "ring":
        x, y, z = radius * np.cos(u), radius * np.sin(u), artefact.height_mm * v / np.pi
        axes.plot_surface(x, y, z, color=BODY, alpha=0.35, linewidth=0)
        return
    x, y, z = np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)
    for cx, cy, cz in artefact.centres_mm:
        axes.plot_surface(
            cx + radius * x, cy + radius * y, cz + radius * z, color=BODY, alpha=0.35, linewidth=0
        )
    if artefact.centres_mm:
        return
    height, corners = artefact.height_mm, artefact_outline(setup).tolist()
    faces = [[(x, y, height) for x, y in corners]]
    for (x1, y1), (x2, y2) in zip(corners, corners[1:] + corners[:1], strict=True):
        faces.append([(x1, y1, 0.0), (x2, y2, 0.0), (x2, y2, height), (x1, y1, height)])
    solid = Poly3DCollection(faces, facecolor=BODY, edgecolor=EDGE, linewidth=0.6, alpha=0.3)
    axes.add_collection3d(solid)


def _arrows(axes: Any, tails: Floats, vectors: Floats, colour: str, label: str) -> None:
    if len(tails):
        axes.quiver(*tails.T, *vectors.T, color=colour, linewidth=1.0, arrow_length_ratio=0.25)
        axes.plot([], [], color=colour, label=label)


def plot_estimates(
    results: IdentificationResult | Mapping[str, IdentificationResult],
    injected: Mapping[str, float] | None = None,
    *,
    unit: str | None = None,
    ax: Any = None,
    **style: Any,
) -> Any:
    """Draw estimates of the location errors with U (k = 2), beside the injected values if known.

    Parameters
    ----------
    results
        One result, or several by name; of machines with other errors, too.
    injected
        True values by ISO name, µm and arcsec.
    unit
        "µm" or "arcsec": errors of this unit only; else a panel each.
    ax
        Axes for errors of one unit; a new figure unless given.
    **style
        As :meth:`trunnion.plot.picture.Picture.draw` takes it.
    """
    pictures = estimates_pictures(results, injected)
    if unit is not None:
        pictures = [p for p in pictures if p.y.unit == unit]
        if not pictures:
            raise InputError(f"unit: got {unit!r}, expected 'µm' or 'arcsec'")
    if ax is None and len(pictures) > 1:
        return panels(pictures, columns=2, size=(5.2, 4.0), **style)
    if len(pictures) > 1:
        raise InputError(
            "ax: got one pair of axes for errors in µm and arcsec, expected unit='µm' or "
            "unit='arcsec' beside it"
        )
    return pictures[0].draw(ax, **style)


def estimates_pictures(
    results: IdentificationResult | Mapping[str, IdentificationResult],
    injected: Mapping[str, float] | None = None,
) -> list[Picture]:
    """Return the location errors, a picture for each unit."""
    named = {results.method: results} if isinstance(results, IdentificationResult) else results
    names = list(dict.fromkeys(name for result in named.values() for name in result.errors))
    found = []
    for unit in ("µm", "arcsec"):
        mine = [name for name in names if unit_of(name) == unit]
        if mine:
            found.append(_estimates(named, injected or {}, mine, unit))
    return found


def _estimates(
    named: Mapping[str, IdentificationResult],
    injected: Mapping[str, float],
    names: list[str],
    unit: str,
) -> Picture:
    place = np.arange(len(names), dtype=np.float64)
    series: list[Series] = [line([-0.5, len(names) - 0.5], [0.0, 0.0], colour=MUTED, width=0.8)]
    known = [name for name in names if name in injected]
    if known:
        at = np.array([names.index(name) for name in known], dtype=np.float64)
        ends = np.stack([at - 0.42, at + 0.42, np.full_like(at, np.nan)], axis=1).ravel()
        values = np.repeat([injected[name] for name in known], 3)
        series.append(line(ends, values, "injected", colour=MUTED, width=2.4))
    shift = np.linspace(-0.25, 0.25, len(named)) if len(named) > 1 else np.zeros(1)
    for k, (label, result) in enumerate(named.items()):
        spread = np.array([result.std_errors.get(name, 0.0) for name in names])
        # An infinite bar says nothing; what is not identifiable is named in the note.
        seen = np.isfinite(spread) & np.array([name in result.errors for name in names])
        values = np.array([result.errors.get(name, 0.0) for name in names])
        style: dict[str, Any] = {"colour": PALETTE[k % len(PALETTE)], "error": 2 * spread[seen]}
        series.append(points(place[seen] + shift[k], values[seen], label, **style))
    lost = [n for n in names if any(np.isinf(r.std_errors.get(n, 0.0)) for r in named.values())]
    return Picture(
        f"Location errors with U (k = 2), {unit}",
        Axis(ticks=tuple((float(k), name) for k, name in enumerate(names))),
        Axis("Location error", unit),
        tuple(series),
        note=f"Not identifiable: {', '.join(lost)}." if lost else "",
    )


@cache
def effect_labels() -> Mapping[str, str]:
    """Id of every effect on touches → what people call it."""
    found: dict[str, str] = {}
    for preset in presets():
        setup = Setup(artefact=Artefact("cross"), machine=Machine(preset))
        found |= {id_: effect.label for id_, effect in Chain(setup).effects.items()}
    return found


def plot_observability(seen: Observability, *, ax: Any = None, **style: Any) -> Any:
    """Draw how much of each effect a plan leaves beside the errors and the placement."""
    return observability_picture(seen).draw(ax, width=8.0, **style)


def observability_picture(seen: Observability) -> Picture:
    """Return the share of each effect that is left once errors and placement are fitted."""
    shares = dict(sorted(seen.share_left.items(), key=lambda pair: -pair[1]))
    alike = set().union(*seen.alike) if seen.alike else set()
    labels = effect_labels()
    names = tuple(f"{labels[k]} ({k})" if k in labels else k for k in shares)
    values = 100 * np.array(list(shares.values()), dtype=np.float64)
    lost = set(seen.not_identifiable_effects)
    kinds = (
        ("identifiable beside all others", BLUE, set(shares) - lost - alike),
        ("another effect can take its place", VERMILLION, alike - lost),
        ("not identifiable", MUTED, lost),
    )
    series: list[Series] = []
    for label, colour, members in kinds:
        mine = np.array([k in members for k in shares], dtype=bool)
        if mine.any():
            named = label if np.any(values[mine] >= SEEN) else ""
            series.append(bars(np.where(mine, values, np.nan), named, colour=colour))
    none = [k for k, name in enumerate(shares) if name in lost]
    return Picture(
        f"What these touches show of {len(shares)} effects beside errors and placement",
        Axis("Share left", "%", limits=(0.0, 100.0)),
        Axis(names=names),
        tuple(series),
        notes_at=tuple((float(values[k]), float(k), "not identifiable") for k in none),
    )
