"""Pictures of touches and estimates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from trunnion.base.units import Floats, unit_of
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.plot.axes import axes_or_new
from trunnion.probing.observability import Observability
from trunnion.probing.result import IdentificationResult
from trunnion.setup import Setup

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK = "#24425c"
ACCENT = "#c8502d"
FACE = "#c9d6df"


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
        Deviations along the approach to draw as arrows, (n,); approach directions if None.
    magnification
        Of the deviation arrows; chosen so that the largest is 15 mm if None.
    ax
        Three-dimensional axes; new ones if None.

    """
    ax = axes_or_new(ax, 7.5, 6.5, "3d")
    axes: Any = ax
    _draw_solid(axes, setup)
    chain = Chain(setup)
    rotation, shift = chain.table_pose(chain.to_machine(touches.rotary_deg, len(touches)))
    centre = np.einsum("nji,nj->ni", rotation, touches.position_mm - shift)
    direction = np.einsum("nji,nj->ni", rotation, touches.direction)
    angle = np.radians(setup.artefact.turn_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    centre, direction = (centre - setup.artefact.place_mm) @ turned, direction @ turned
    contact = centre + direction * setup.probe.ball_radius_mm
    if residuals_um is None:
        tails, arrows, colour = contact - 12.0 * direction, 12.0 * direction, INK
        label = "approach"
    else:
        residuals = np.asarray(residuals_um, dtype=float)
        largest = float(np.abs(residuals).max(initial=1e-9))
        scale = 15.0 / largest if magnification is None else magnification * 1e-3
        tails, arrows, colour = contact, residuals[:, None] * scale * direction, ACCENT
        label = f"deviation × {scale * 1e3:.0f}"
    axes.scatter(*contact.T, s=14, color=ACCENT, depthshade=False, label="touch", zorder=5)
    axes.quiver(*tails.T, *arrows.T, color=colour, linewidth=1.0, arrow_length_ratio=0.25)
    axes.plot([], [], color=colour, label=label)
    reach = float(np.abs(contact[:, :2]).max()) + 14.0
    low = min(0.0, float(contact[:, 2].min()))
    top = float(contact[:, 2].max()) + 14.0
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(low, top))
    axes.set_box_aspect((2 * reach, 2 * reach, top - low), zoom=0.95)
    axes.set(xlabel="X (mm)", ylabel="Y (mm)", zlabel="Z (mm)")
    axes.zaxis.set_major_locator(MaxNLocator(3))
    axes.view_init(elev=32, azim=-58)
    axes.legend(loc="upper left", frameon=False)
    axes.set_title(f"{len(touches)} touches on the {setup.artefact.kind}, in its frame")
    return axes  # type: ignore[no-any-return]


def _draw_solid(axes: Any, setup: Setup) -> None:
    artefact = setup.artefact
    if artefact.kind == "sphere":
        radius = 0.5 * (artefact.diameter_mm or 0.0)
        u, v = np.mgrid[0 : 2 * np.pi : 40j, 0 : np.pi : 20j]
        x, y, z = np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)
        cx, cy, cz = artefact.centre_mm or (0.0, 0.0, 0.0)
        axes.plot_surface(
            cx + radius * x, cy + radius * y, cz + radius * z, color=FACE, alpha=0.6, linewidth=0
        )
        return
    length, width, height = artefact.length_mm, artefact.width_mm, artefact.height_mm
    a, b = 0.5 * length, 0.5 * width
    corners = [(-a, -b), (a, -b), (a, b), (-a, b)]
    if artefact.kind != "cuboid":
        corners = [
            (b, -a), (b, -b), (a, -b), (a, b), (b, b), (b, a),
            (-b, a), (-b, b), (-a, b), (-a, -b), (-b, -b), (-b, -a),
        ]  # fmt: skip
    faces = [[(x, y, height) for x, y in corners]]
    for (x1, y1), (x2, y2) in zip(corners, corners[1:] + corners[:1], strict=True):
        faces.append([(x1, y1, 0.0), (x2, y2, 0.0), (x2, y2, height), (x1, y1, height)])
    solid = Poly3DCollection(faces, facecolor=FACE, edgecolor=INK, linewidth=0.6, alpha=0.35)
    axes.add_collection3d(solid)


def plot_estimates(
    results: IdentificationResult | Mapping[str, IdentificationResult],
    injected: Mapping[str, float] | None = None,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Draw estimates of the location errors, beside the injected values where those are known.

    Parameters
    ----------
    results
        One result, or several by name.
    injected
        True values by ISO name, µm and arcsec.
    """
    named = {results.method: results} if isinstance(results, IdentificationResult) else results
    names = list(next(iter(named.values())).errors)
    ax = axes_or_new(ax, 8.0, 4.2)
    place = np.arange(len(names), dtype=float)
    if injected is not None:
        ax.hlines(
            [injected.get(name, 0.0) for name in names],
            place - 0.42,
            place + 0.42,
            color="black",
            linewidth=1.6,
            label="injected",
        )
    offsets = np.linspace(-0.25, 0.25, len(named)) if len(named) > 1 else np.zeros(1)
    colours = [INK, ACCENT, "#4f8f5b", "#8a6bb0", "#b08a2e"]
    for index, (label, result) in enumerate(named.items()):
        spread = np.array([result.std_errors.get(name, 0.0) for name in names])
        # An infinite bar says nothing a hollow marker does not say better.
        seen = np.isfinite(spread)
        values = np.array([result.errors[name] for name in names])
        ax.errorbar(
            place[seen] + offsets[index],
            values[seen],
            yerr=2 * spread[seen],
            fmt="o",
            markersize=5,
            capsize=3,
            color=colours[index % len(colours)],
            label=f"{label} (± 2 std. errors)",
        )
    ax.set_xticks(place, [f"{name}\n{unit_of(name)}" for name in names])
    ax.axhline(0.0, color="0.7", linewidth=0.8, zorder=0)
    ax.set_ylabel("location error (µm or arcsec)")
    ax.legend(frameon=False, loc="best")
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def plot_observability(seen: Observability, *, ax: Axes | None = None) -> Axes:
    """Draw how much of each effect a plan leaves beside the errors and the placement."""
    shares = dict(sorted(seen.share_left.items(), key=lambda pair: pair[1]))
    ax = axes_or_new(ax, 7.0, 0.22 * len(shares) + 1.2)
    values = np.array(list(shares.values()))
    alike = set().union(*seen.alike) if seen.alike else set()
    colours = [
        "0.8" if name in seen.not_identifiable_effects else ACCENT if name in alike else INK
        for name in shares
    ]
    ax.barh(list(shares), 100 * values, color=colours)
    for name, colour in (
        ("identifiable beside all others", INK),
        ("another effect can take its place", ACCENT),
        ("not identifiable", "0.8"),
    ):
        ax.barh([0], [0], color=colour, label=name)
    ax.set_xlabel("share of the effect left once errors and placement are fitted (%)")
    ax.set_ylim(-0.6, len(shares) - 0.4)
    ax.legend(frameon=False, loc="lower right")
    ax.spines[["top", "right"]].set_visible(False)
    return ax
