"""One description of a 2-D picture, drawn by matplotlib (papers) or by Plotly (reports).

A picture says what it shows (axes with units, series with their role); :meth:`Picture.draw` and
:meth:`Picture.to_plotly` say it in the language of each library.
"""

from __future__ import annotations

import html
import importlib
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.units import Floats, Integers
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
    ticks
        Values with what stands there, in place of numbers at round values.
    log
        Whether it is logarithmic.
    """

    label: str = ""
    unit: str = ""
    names: tuple[str, ...] = ()
    limits: tuple[float, float] | None = None
    ticks: tuple[tuple[float, str], ...] | None = None
    log: bool = False

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
    z, scale
        Of a heat map: values (rows, columns); least and largest of the colours. Without a scale the
        colours are symmetrical about 0; the label is that of the colour bar.
    log
        Whether the colours of a heat map are logarithmic.
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
    scale: tuple[float, float] | None = None
    log: bool = False
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

    def draw(
        self,
        ax: Any = None,
        *,
        width: float | None = None,
        height: float | None = None,
        **style: Any,
    ) -> Any:
        """Draw it by matplotlib; return the axes.

        Parameters
        ----------
        ax
            Axes to draw on, polar ones for a polar picture; those of a new figure unless given.
        width, height
            Of that figure, inches; by what the picture holds unless given.
        **style
            ``title=``, ``legend=False``; all else goes to the points and lines, such as ``alpha``,
            ``color``, ``markersize``, ``linewidth``.
        """
        static = importlib.import_module("trunnion.plot.static")
        return static.draw_picture(self, ax, (width, height), style)

    def to_plotly(self) -> dict[str, Any]:
        """Return ``{"data": [...], "layout": {...}}``, what ``plotly.graph_objects.Figure`` takes.

        Backgrounds are transparent and texts have no colour of their own: pages give them theirs.
        """
        interactive = importlib.import_module("trunnion.plot.interactive")
        described: dict[str, Any] = interactive.plotly_picture(self)
        return described

    def figure(self) -> Any:
        """Return it as a Plotly figure, with its title; notebooks show it."""
        from plotly import graph_objects

        described = self.to_plotly()
        described["layout"] |= {
            "title": {"text": html.escape(self.title, quote=False), "y": 0.98, "yanchor": "top"},
            "font": {"color": MUTED},
        }
        described["layout"]["margin"] |= {"t": 70}
        return graph_objects.Figure(described)


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


def heat(
    z: ArrayLike, x: ArrayLike | None = None, y: ArrayLike | None = None, **style: Any
) -> Series:
    """Return a heat map of values (rows, columns) over x (columns) and y (rows)."""
    values = _floats(z)
    across = np.arange(values.shape[1]) if x is None else x
    down = np.arange(values.shape[0]) if y is None else y
    return Series(Form.HEAT, _floats(across), _floats(down), z=values, **style)


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


def heat_range(s: Series) -> tuple[float, float]:
    """Return the least and the largest value of the colours of a heat map."""
    assert s.z is not None
    if s.scale is not None:
        return s.scale
    most = float(np.nanmax(np.abs(s.z), initial=0.0)) or 1.0
    return -most, most
