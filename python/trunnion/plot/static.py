"""Pictures as matplotlib draws them: for papers, notebooks and the docs."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from trunnion.base.errors import InputError
from trunnion.plot.axes import axes_or_new, new_figure
from trunnion.plot.picture import Axis, Form, Kind, Picture, Series, heat_range
from trunnion.plot.style import DIVERGING, MAGNITUDES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARKERS = {"dot": "o", "cross": "x", "square": "s", "diamond": "D", "triangle": "^"}
DASHES = {"solid": "-", "dash": "--", "dot": ":"}
CHARACTERS = 13.0
"""Of a title or a legend in an inch of the axes."""
LEGEND_POINTS = 14.5
"""Height of a row of a legend."""
HANDLE = 7  # characters that a line or marker of a legend takes
ROW_INCHES = 0.29  # of a bar with a name
MAX_NAME = 44
MIN_NAMES = 2.5
MIN_INCHES = 2.3  # height of a picture of few bars


def size_of(p: Picture) -> tuple[float, float]:
    """Return width and height of a figure of its own, inches."""
    if p.kind is Kind.POLAR:
        return 5.6, 6.0
    if p.kind is Kind.MAP:
        return 6.4, 5.2
    return 7.0, max(MIN_INCHES, 1.5 + ROW_INCHES * len(p.y.names)) if p.y.names else 3.8


def draw_picture(
    p: Picture, ax: Any, size: tuple[float | None, float | None], style: dict[str, Any]
) -> Any:
    """Draw a picture on axes, or on those of a new figure; return the axes."""
    polar = p.kind is Kind.POLAR
    if ax is not None and polar != (getattr(ax, "name", "") == "polar"):
        found = getattr(ax, "name", type(ax).__name__)
        raise InputError(
            f"ax: got {found} axes, expected {'polar' if polar else 'rectilinear'} ones"
        )
    own = size_of(p)
    ax = axes_or_new(ax, size[0] or own[0], size[1] or own[1], "polar" if polar else None)
    title, legend = style.pop("title", p.title), style.pop("legend", True)
    for series in p.series:
        _draw(ax, series, polar=polar, style=style)
    _set_axes(ax, p)
    for x, y, text in p.notes_at:
        at = (np.radians(x) if polar else x, y)
        beside = {"xytext": (4, 0), "va": "center"} if p.y.names else {"xytext": (3, 3)}
        ax.annotate(text, at, textcoords="offset points", fontsize="small", **beside)
    _head(ax, title, p, legend=legend)
    return ax


def panels(
    pictures: Sequence[Picture],
    *,
    columns: int = 1,
    size: tuple[float, float] | None = None,
    figure: Figure | None = None,
    **style: Any,
) -> Figure:
    """Draw several pictures side by side; return the figure.

    size: Of each, inches; by what the pictures hold if None. figure: Where to draw; else a new one.
    """
    rows = -(-len(pictures) // columns)
    own = [size_of(p) for p in pictures]
    width, height = size or (max(w for w, _ in own), max(h for _, h in own))
    drawn = new_figure(width * columns, height * rows) if figure is None else figure
    for k, p in enumerate(pictures):
        kind = "polar" if p.kind is Kind.POLAR else None
        p.draw(drawn.add_subplot(rows, columns, k + 1, projection=kind), **style)
    return drawn


def draw_all(
    pictures: Sequence[Picture],
    ax: Any,
    *,
    columns: int = 2,
    size: tuple[float, float] | None = None,
    **style: Any,
) -> Any:
    """Draw one picture, or the first on axes given: return the axes; several: return the figure."""
    if len(pictures) == 1 or ax is not None:
        return pictures[0].draw(ax, **style)
    return panels(pictures, columns=min(len(pictures), columns), size=size, **style)


def _head(ax: Any, title: str, p: Picture, *, legend: bool) -> None:
    """Put the legend above the axes and the title above it, so that neither covers data."""
    labels = [s.label for s in p.series if s.label and s.form is not Form.HEAT]
    box = ax.get_position()
    inches = ax.figure.get_size_inches()[0] * box.width
    room = max(20, int(CHARACTERS * inches))
    rows = 0
    if labels and legend:
        each = max(map(len, labels)) + HANDLE
        columns = max(1, min(len(labels), int(1.15 * room) // each))
        rows = -(-len(labels) // columns)
        ax.legend(
            frameon=False,
            fontsize="small",
            ncols=columns,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0 if p.kind is not Kind.POLAR else 1.06),
            borderaxespad=0.1,
            columnspacing=1.2,
            handlelength=1.6,
        )
    lines = [fill(title, room)]
    if p.note and p.kind in (Kind.POLAR, Kind.MAP):
        lines.append(fill(p.note, room))
    base = 26.0 if p.kind is Kind.POLAR else 4.0
    ax.set_title("\n".join(lines), loc="left", fontsize="medium", pad=base + LEGEND_POINTS * rows)


def _draw(ax: Any, s: Series, *, polar: bool, style: dict[str, Any]) -> None:
    x = np.radians(s.x) if polar else s.x
    label = s.label or None
    match s.form:
        case Form.POINTS:
            look = _with(style, color=s.colour, alpha=s.opacity, label=label, markersize=s.size)
            if s.error is not None:
                ax.errorbar(x, s.y, s.error, fmt=MARKERS[s.marker], capsize=2, elinewidth=1, **look)
            else:
                edge = 1 if s.marker == "cross" else 0
                ax.plot(x, s.y, MARKERS[s.marker], markeredgewidth=edge, **look)
        case Form.LINE:
            look = _with(style, color=s.colour, alpha=s.opacity, label=label, linewidth=s.width)
            ax.plot(x, s.y, DASHES[s.dash], **look)
        case Form.BAND:
            assert s.high is not None
            colour = style.get("color", s.colour)
            ax.fill_between(x, s.y, s.high, color=colour, alpha=s.opacity, lw=0, label=label)
        case Form.BARS:
            look = _with(style, color=s.colour, alpha=s.opacity, label=label, height=0.7)
            bar = {k: v for k, v in look.items() if k in ("color", "alpha", "label", "height")}
            ax.barh(s.y, s.x, xerr=s.error, ecolor="0.5", **bar)
        case Form.HEAT:
            _draw_heat(ax, s)


def _with(style: dict[str, Any], **own: Any) -> dict[str, Any]:
    """Return the own style, overridden by what was given (in any spelling of matplotlib)."""
    from matplotlib.cbook import normalize_kwargs
    from matplotlib.lines import Line2D

    return {**own, **normalize_kwargs(style, Line2D)}


def _draw_heat(ax: Any, s: Series) -> None:
    from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize

    assert s.z is not None
    low, high = heat_range(s)
    colours: Any = MAGNITUDES
    if s.scale is None:
        colours = LinearSegmentedColormap.from_list("diverging", DIVERGING)
    shade = "gouraud" if s.scale is not None and not np.isnan(s.z).any() else "auto"
    norm = LogNorm(low, high, clip=True) if s.log else Normalize(low, high)
    drawn = ax.pcolormesh(s.x, s.y, s.z, cmap=colours, norm=norm, shading=shade, rasterized=True)
    if s.label:
        ax.figure.colorbar(drawn, ax=ax, label=s.label, shrink=0.85)


def _set_axes(ax: Any, p: Picture) -> None:
    if p.y.limits is not None:
        ax.set_ylim(*p.y.limits)
    if p.kind is Kind.POLAR:
        ax.set_rlabel_position(90)
        ax.set_xlabel(p.y.title)
        ax.grid(alpha=0.4, lw=0.5)
        if p.y.ticks is not None:
            ground = {"facecolor": ax.get_facecolor(), "edgecolor": "none", "pad": 0.6}
            values, texts = zip(*p.y.ticks, strict=True) if p.y.ticks else ((), ())
            ax.set_yticks(values, texts, fontsize="small", bbox=ground)
            ax.yaxis.set_zorder(3)  # labels before the lines
        return
    ax.set_xlabel(p.x.title)
    ax.set_ylabel(p.y.title)
    ax.grid(alpha=0.25, lw=0.5)
    ax.spines[["top", "right"]].set_visible(False)
    if p.x.limits is not None:
        ax.set_xlim(*p.x.limits)
    for one, axis in (("x", p.x), ("y", p.y)):
        _set_ticks(ax, one, axis)
    if p.kind is Kind.MAP:
        filled = any(s.form is Form.HEAT for s in p.series)
        fixed = filled or p.x.limits is not None or p.y.limits is not None
        ax.set_aspect("equal", adjustable="box" if fixed else "datalim")


def _set_ticks(ax: Any, one: str, axis: Axis) -> None:
    if axis.log:
        getattr(ax, f"set_{one}scale")("log")
    ticks = getattr(ax, f"set_{one}ticks")
    if axis.ticks is not None:
        ticks([v for v, _ in axis.ticks], [t for _, t in axis.ticks])
    if not axis.names:
        return
    places = np.arange(len(axis.names))
    if one == "x":
        turn = 60 if max(map(len, axis.names)) > 4 else 0
        ticks(places, axis.names, rotation=turn)
        return
    ticks(places, [fill(name, MAX_NAME) for name in axis.names], fontsize="small")
    room = max(0.0, MIN_NAMES - len(axis.names)) / 2 + 0.5  # few bars are no blocks
    ax.set_ylim(len(axis.names) - 1 + room, -room)
