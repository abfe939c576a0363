"""One description of a 2-D picture, drawn by matplotlib (papers) or by Plotly (reports).

A picture says what it shows (axes with units, series with their role); :meth:`Picture.draw` and
:meth:`Picture.to_plotly` say it in the language of each library.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.errors import InputError
from trunnion.base.units import Floats, Integers
from trunnion.plot.axes import axes_or_new
from trunnion.plot.style import BLUE as BLUE
from trunnion.plot.style import DIVERGING as DIVERGING
from trunnion.plot.style import GREEN as GREEN
from trunnion.plot.style import MUTED as MUTED
from trunnion.plot.style import OCHRE as OCHRE
from trunnion.plot.style import PALETTE as PALETTE
from trunnion.plot.style import PURPLE as PURPLE
from trunnion.plot.style import RED as RED
from trunnion.plot.style import SLATE as SLATE
from trunnion.plot.style import VERMILLION as VERMILLION

MATPLOTLIB_MARKERS = {"dot": "o", "cross": "x", "square": "s", "diamond": "D", "triangle": "^"}
PLOTLY_MARKERS = {"dot": "circle", "triangle": "triangle-up"}
DASHES = {"solid": "-", "dash": "--", "dot": ":"}
MAX_COLUMNS = 800
"""Pixel columns of a picture: of more readings the least and the largest in each are drawn."""

Marker: TypeAlias = Literal["dot", "cross", "square", "diamond", "triangle"]
Dash: TypeAlias = Literal["solid", "dash", "dot"]


class Kind(StrEnum):
    """How the axes of a picture are."""

    CARTESIAN = "cartesian"
    POLAR = "polar"  # x: angle in degrees, counter-clockwise from the right; y: radius
    MAP = "map"  # one scale for both axes


class Form(StrEnum):
    """How a series is drawn."""

    POINTS = "points"
    LINE = "line"  # nan breaks it
    BAND = "band"  # between y and high
    BARS = "bars"  # horizontal: length x at place y
    HEAT = "heat"  # z over x and y


@dataclass(frozen=True)
class Axis:
    """An axis: what it shows, in which unit.

    Attributes
    ----------
    label, unit
        Shown as "label (unit)".
    names
        What stands at 0, 1, 2, ... in place of numbers.
    limits
        From and to; found from the series without them.
    """

    label: str = ""
    unit: str = ""
    names: tuple[str, ...] = ()
    limits: tuple[float, float] | None = None

    @property
    def title(self) -> str:
        """Label with its unit in brackets."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


@dataclass(frozen=True, eq=False)
class Series:
    """What is drawn in one way: n points, a line, a band, bars or a heat map.

    Attributes
    ----------
    form
        How it is drawn.
    x, y
        Places, (n,) each.
    label
        In the legend; without one it is not there.
    colour
        One of `style.PALETTE`, or `style.MUTED`.
    high
        Upper edge of a band, (n,); `y` is the lower one.
    error
        Half length of an error bar along the readings (x of bars, y of points), (n,).
    z
        Of a heat map, (rows, columns).
    hover
        Text for each point, (n,); a newline breaks it.
    rows
        Data row of each point, (n,), by which pages highlight the same readings in all pictures.
    marker, size, dash, width, opacity
        Style; size in points.
    """

    form: Form
    x: Floats
    y: Floats
    label: str = ""
    colour: str = BLUE
    high: Floats | None = None
    error: Floats | None = None
    z: Floats | None = None
    hover: tuple[str, ...] = ()
    rows: Integers | None = None
    marker: Marker = "dot"
    size: float = 5.0
    dash: Dash = "solid"
    width: float = 1.6
    opacity: float = 1.0

    def __getitem__(self, index: Integers) -> Series:
        """Return the series of some of its points."""
        error = None if self.error is None else self.error[index]
        rows = None if self.rows is None else self.rows[index]
        hover = tuple(self.hover[i] for i in index) if self.hover else ()
        return replace(self, x=self.x[index], y=self.y[index], error=error, rows=rows, hover=hover)


@dataclass(frozen=True, eq=False)
class Picture:
    """A 2-D picture.

    Attributes
    ----------
    title
        What it shows, for people.
    x, y
        The axes.
    series
        In the order in which they are drawn.
    kind
        How the axes are.
    note
        What a reader needs beside it: a magnification, what is left out.
    alt
        What a reader who does not see it should know; the title and the note without it.
    notes_at
        Texts in the picture: (x, y, text).
    key
        What it belongs to (the id of a cause); highlighting of pages follows it.
    """

    title: str
    x: Axis
    y: Axis
    series: tuple[Series, ...]
    kind: Kind = Kind.CARTESIAN
    note: str = ""
    alt: str = ""
    notes_at: tuple[tuple[float, float, str], ...] = ()
    key: str = ""

    @property
    def description(self) -> str:
        """Alternative text."""
        axes = f"{self.y.title} over {self.x.title}" if self.kind is not Kind.POLAR else ""
        return self.alt or ". ".join(part for part in (self.title, axes, self.note) if part)

    def thinned(self, columns: int = MAX_COLUMNS) -> Picture:
        """Return it with at most the least and the largest reading of each pixel column drawn."""
        thin = tuple(_thinned(s, columns) for s in self.series)
        drawn, whole = (sum(len(s.x) for s in of) for of in (thin, self.series))
        if drawn == whole:
            return self
        note = (
            f"Of {whole} points the least and the largest in each of {columns} columns are drawn."
        )
        return replace(self, series=thin, note=" ".join(filter(None, (self.note, note))))

    def draw(self, ax: Any = None, *, width: float = 7.0, height: float = 3.8) -> Any:
        """Draw it by matplotlib; return the axes.

        ``ax``: axes to draw on, polar ones for a polar picture; those of a new figure of ``width``
        by ``height`` inches unless given.
        """
        polar = self.kind is Kind.POLAR
        if ax is not None and polar != (ax.name == "polar"):
            raise InputError(
                f"ax: got {ax.name} axes, expected {'polar' if polar else 'rectilinear'} ones"
            )
        ax = axes_or_new(
            ax, *((5.6, 5.6) if polar else (width, height)), "polar" if polar else None
        )
        for series in self.series:
            _draw(ax, series, polar=polar)
        _set_axes(ax, self)
        for x, y, text in self.notes_at:
            ax.annotate(text, (np.radians(x) if polar else x, y), fontsize="small")
        ax.set_title(self.title, loc="left", fontsize="medium", wrap=True)
        if any(series.label for series in self.series):
            ax.legend(frameon=False, fontsize="small")
        return ax

    def to_plotly(self) -> dict[str, Any]:
        """Return ``{"data": [...], "layout": {...}}``, what ``plotly.graph_objects.Figure`` takes.

        Backgrounds are transparent and texts have no colour of their own: pages give them theirs.
        """
        polar = self.kind is Kind.POLAR
        data = [trace for series in self.series for trace in _traces(series, polar=polar)]
        layout = _layout(self)
        return {"data": data, "layout": layout}


# --- series made of arrays


def points(x: ArrayLike, y: ArrayLike, label: str = "", **style: Any) -> Series:
    """Return points; ``style``: attributes of :class:`Series`."""
    return Series(Form.POINTS, _floats(x), _floats(y), label, **style)


def line(x: ArrayLike, y: ArrayLike, label: str = "", **style: Any) -> Series:
    """Return a line; nan breaks it."""
    return Series(Form.LINE, _floats(x), _floats(y), label, **style)


def band(x: ArrayLike, low: ArrayLike, high: ArrayLike, label: str = "", **style: Any) -> Series:
    """Return a band between two curves."""
    style = {"opacity": 0.22, **style}
    return Series(Form.BAND, _floats(x), _floats(low), label, high=_floats(high), **style)


def bars(length: ArrayLike, label: str = "", **style: Any) -> Series:
    """Return horizontal bars at 0, 1, 2, ...; the y axis names them."""
    lengths = _floats(length)
    return Series(Form.BARS, lengths, np.arange(len(lengths), dtype=np.float64), label, **style)


def heat(z: ArrayLike, x: ArrayLike | None = None, y: ArrayLike | None = None) -> Series:
    """Return a heat map of values about 0, (rows, columns), over x (columns) and y (rows)."""
    values = _floats(z)
    across = np.arange(values.shape[1]) if x is None else x
    down = np.arange(values.shape[0]) if y is None else y
    return Series(Form.HEAT, _floats(across), _floats(down), z=values)


def arrows(
    x: ArrayLike, y: ArrayLike, u: ArrayLike, v: ArrayLike, label: str = "", **style: Any
) -> Series:
    """Return arrows from (x, y) by (u, v), in the unit of the axes, as one broken line."""
    start = np.stack([_floats(x), _floats(y)], axis=1)
    by = np.stack([_floats(u), _floats(v)], axis=1)
    tip, side = start + by, np.stack([-by[:, 1], by[:, 0]], axis=1)
    gap = np.full_like(start, np.nan)
    barbs = (tip - 0.25 * by + 0.12 * side, tip, tip - 0.25 * by - 0.12 * side)
    path = np.stack([start, tip, barbs[0], barbs[1], barbs[2], gap], axis=1).reshape(-1, 2)
    return Series(Form.LINE, path[:, 0], path[:, 1], label, **style)


def _floats(values: ArrayLike) -> Floats:
    return np.asarray(values, dtype=np.float64)


def _thinned(s: Series, columns: int) -> Series:
    """Keep the least and the largest of each column, in the order that they have."""
    if s.form not in (Form.POINTS, Form.LINE) or len(s.x) <= 4 * columns:
        return s
    low, high = np.nanmin(s.x), np.nanmax(s.x)
    place = np.nan_to_num((s.x - low) / max(high - low, 1e-300) * columns)
    column = np.minimum(place.astype(np.intp), columns - 1)
    order = np.lexsort((s.y, column))  # nan is last in its column
    last = np.append(np.flatnonzero(np.diff(column[order])), len(order) - 1)
    first = np.append(0, last[:-1] + 1)
    return s[np.unique(np.concatenate([order[first], order[last]]))]


# --- matplotlib


def _draw(ax: Any, s: Series, *, polar: bool) -> None:
    x = np.radians(s.x) if polar else s.x
    label = s.label or None
    match s.form:
        case Form.POINTS:
            marker = MATPLOTLIB_MARKERS[s.marker]
            style = {"color": s.colour, "alpha": s.opacity, "label": label, "ms": s.size}
            if s.error is not None:
                ax.errorbar(x, s.y, s.error, fmt=marker, capsize=2, lw=1, **style)
            else:
                ax.plot(x, s.y, marker, mew=1 if s.marker == "cross" else 0, **style)
        case Form.LINE:
            style = {"color": s.colour, "alpha": s.opacity, "label": label}
            ax.plot(x, s.y, DASHES[s.dash], lw=s.width, **style)
        case Form.BAND:
            assert s.high is not None
            ax.fill_between(x, s.y, s.high, color=s.colour, alpha=s.opacity, lw=0, label=label)
        case Form.BARS:
            bars_ = {"color": s.colour, "alpha": s.opacity, "label": label, "height": 0.7}
            ax.barh(s.y, s.x, xerr=s.error, **bars_)
        case Form.HEAT:
            from matplotlib.colors import LinearSegmentedColormap

            assert s.z is not None
            most = float(np.nanmax(np.abs(s.z), initial=0.0)) or 1.0
            colours = LinearSegmentedColormap.from_list("diverging", DIVERGING)
            drawn = ax.pcolormesh(s.x, s.y, s.z, cmap=colours, vmin=-most, vmax=most)
            ax.figure.colorbar(drawn, ax=ax)


def _set_axes(ax: Any, p: Picture) -> None:
    if p.y.limits is not None:
        ax.set_ylim(*p.y.limits)
    if p.kind is Kind.POLAR:
        ax.set_rlabel_position(90)
        ax.set_xlabel(p.y.title)
        ax.grid(alpha=0.4, lw=0.5)
        return
    ax.set_xlabel(p.x.title)
    ax.set_ylabel(p.y.title)
    ax.grid(alpha=0.25, lw=0.5)
    if p.x.limits is not None:
        ax.set_xlim(*p.x.limits)
    if p.x.names:
        turn = 60 if max(map(len, p.x.names)) > 4 else 0
        ax.set_xticks(np.arange(len(p.x.names)), p.x.names, rotation=turn)
    if p.y.names:
        ax.set_yticks(np.arange(len(p.y.names)), p.y.names)
        ax.invert_yaxis()
    if p.kind is Kind.MAP:
        ax.set_aspect("equal", adjustable="datalim")


# --- Plotly


def _text(text: str) -> str:
    """Return a text as Plotly shows it as it is: it takes some HTML."""
    return html.escape(text, quote=False).replace("\n", "<br>")


def _short(values: Floats) -> list[float | None]:
    """Return numbers to seven digits: what a screen shows, at half the size."""
    return [float(f"{v:.7g}") if np.isfinite(v) else None for v in values.tolist()]


def _traces(s: Series, *, polar: bool) -> list[dict[str, Any]]:
    names = ("theta", "r") if polar else ("x", "y")
    out: dict[str, Any] = {
        "type": "scatterpolar" if polar else "scatter",
        names[0]: _short(s.x),
        names[1]: _short(s.y),
        "name": _text(s.label),
        "showlegend": bool(s.label),
        "opacity": s.opacity,
        "hoverinfo": "text" if s.hover else ("skip" if s.form is Form.BAND else "x+y+name"),
    }
    if polar and not s.hover:
        out["hoverinfo"] = "skip"
    if s.hover:
        out["text"] = [_text(one) for one in s.hover]
    if s.rows is not None:
        out["customdata"] = s.rows.tolist()
    match s.form:
        case Form.POINTS:
            symbol = {"cross": "x-thin-open"}.get(s.marker, PLOTLY_MARKERS.get(s.marker, s.marker))
            mark = {"color": s.colour, "size": 1.25 * s.size, "symbol": symbol}
            out |= {
                "mode": "markers",
                "marker": {**mark, "line": {"width": 1.5 * (symbol[0] == "x")}},
            }
            if s.error is not None:
                error = {"type": "data", "array": _short(s.error), "thickness": 1, "width": 2}
                out["error_y"] = error
        case Form.LINE:
            dash = {"color": s.colour, "width": 1.25 * s.width, "dash": s.dash}
            out |= {"mode": "lines", "line": dash, "connectgaps": False}
        case Form.BAND:
            assert s.high is not None
            edge = {
                names[0]: _short(np.concatenate([s.x, s.x[::-1]])),
                names[1]: _short(np.concatenate([s.y, s.high[::-1]])),
            }
            fill = {"fill": "toself", "fillcolor": s.colour, "line": {"width": 0}}
            out |= {**edge, **fill, "mode": "lines"}
        case Form.BARS:
            out |= {"type": "bar", "orientation": "h", "marker": {"color": s.colour}, "width": 0.7}
            if s.error is not None:
                out["error_x"] = {"type": "data", "array": _short(s.error), "thickness": 1}
        case Form.HEAT:
            return [_heat(s)]
    return [out]


def _heat(s: Series) -> dict[str, Any]:
    assert s.z is not None
    most = float(np.nanmax(np.abs(s.z), initial=0.0)) or 1.0
    scale = [[at, colour] for at, colour in zip((0, 0.5, 1), DIVERGING, strict=True)]
    values = [_short(row) for row in s.z]
    drawn = {"type": "heatmap", "x": _short(s.x), "y": _short(s.y), "z": values}
    return {**drawn, "zmin": -most, "zmax": most, "colorscale": scale, "hoverinfo": "x+y+z"}


def _layout(p: Picture) -> dict[str, Any]:
    clear = "rgba(0,0,0,0)"
    out: dict[str, Any] = {
        "paper_bgcolor": clear,
        "plot_bgcolor": clear,
        "margin": {"l": 64, "r": 16, "t": 12, "b": 48},
        "hovermode": "closest",
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        "barmode": "overlay",
        "annotations": [
            {"x": x, "y": y, "text": _text(text), "showarrow": False, "yshift": 8}
            for x, y, text in p.notes_at
            if p.kind is not Kind.POLAR
        ],
    }
    if p.kind is Kind.POLAR:
        radial = {"title": {"text": _text(p.y.title)}, "angle": 90, "tickangle": 90}
        if p.y.limits is not None:
            radial["range"] = list(p.y.limits)
        around = {"direction": "counterclockwise", "rotation": 0, "ticksuffix": "°"}
        return {**out, "polar": {"bgcolor": clear, "radialaxis": radial, "angularaxis": around}}
    x, y = _plotly_axis(p.x), _plotly_axis(p.y)
    if p.y.names:
        y["autorange"] = "reversed"
    if p.kind is Kind.MAP:
        y |= {"scaleanchor": "x", "scaleratio": 1}
    return {**out, "xaxis": x, "yaxis": y}


def _plotly_axis(axis: Axis) -> dict[str, Any]:
    out: dict[str, Any] = {"title": {"text": _text(axis.title)}, "automargin": True}
    if axis.limits is not None:
        out["range"] = list(axis.limits)
    if axis.names:
        places: Sequence[int] = range(len(axis.names))
        out |= {"tickvals": list(places), "ticktext": [_text(name) for name in axis.names]}
    return out
