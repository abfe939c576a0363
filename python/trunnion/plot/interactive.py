"""Pictures as Plotly draws them: plain values, so that nothing is imported to make them."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from trunnion.base.units import Flags, Floats
from trunnion.plot.picture import Axis, Form, Kind, Picture, Series, heat_range
from trunnion.plot.style import DIVERGING, MAGNITUDES

PLOTLY_MARKERS = {"dot": "circle", "triangle": "triangle-up"}


def plotly_picture(p: Picture) -> dict[str, Any]:
    """Return data and layout."""
    polar = p.kind is Kind.POLAR
    data = [trace for series in p.series for trace in _traces(series, polar=polar)]
    return {"data": data, "layout": _layout(p)}


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
        if s.form is Form.BARS:
            out["textposition"] = "none"  # it is for the pointer
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
                names[0]: _around(s.x, s.x, np.isfinite(s.y + s.high)),
                names[1]: _around(s.y, s.high, np.isfinite(s.y + s.high)),
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


def _around(low: Floats, high: Floats, known: Flags) -> list[float | None]:
    """Return each unbroken piece of a band forth and back, pieces apart."""
    out: list[float | None] = []
    pieces = np.split(np.arange(len(low)), np.flatnonzero(np.diff(known.astype(int))) + 1)
    for piece in pieces:
        if len(piece) and known[piece[0]]:
            out += [*([None] if out else []), *_short(low[piece]), *_short(high[piece[::-1]])]
    return out


def _heat(s: Series) -> dict[str, Any]:
    assert s.z is not None
    low, high = heat_range(s)
    symmetrical = [[at, colour] for at, colour in zip((0, 0.5, 1), DIVERGING, strict=True)]
    z = s.z
    bar: dict[str, Any] = {"title": {"text": _text(s.label), "side": "right"}}
    if s.log:
        at = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        bar |= {"tickvals": list(at), "ticktext": [f"{10.0**k:g}" for k in at]}
        z = np.log10(np.maximum(z, low))
        low, high = np.log10(low), np.log10(high)
    smooth = s.scale is not None and not s.log and not np.isnan(s.z).any()
    # Colours of a contour end at the outermost values, those of a heat map half a cell beyond.
    form: dict[str, Any] = {"type": "heatmap", "zsmooth": "best" if s.scale else False}
    if smooth:
        form = {"type": "contour", "contours": {"coloring": "heatmap"}, "line": {"width": 0}}
    return {
        **form,
        "x": _short(s.x),
        "y": _short(s.y),
        "z": [_short(row) for row in z],
        "zmin": low,
        "zmax": high,
        "colorscale": MAGNITUDES.capitalize() if s.scale else symmetrical,
        "colorbar": bar,
        "hoverinfo": "skip" if s.log else "x+y+z",
    }


def _layout(p: Picture) -> dict[str, Any]:
    clear = "rgba(0,0,0,0)"
    beside = {"xanchor": "left", "xshift": 3} if p.y.names else {"yshift": 8}
    out: dict[str, Any] = {
        "paper_bgcolor": clear,
        "plot_bgcolor": clear,
        "margin": {"l": 64, "r": 16, "t": 12, "b": 48},
        "hovermode": "closest",
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
        "barmode": "overlay",
        "annotations": [
            {"x": x, "y": y, "text": _text(text), "showarrow": False, **beside}
            for x, y, text in p.notes_at
            if p.kind is not Kind.POLAR
        ],
    }
    if p.kind is Kind.POLAR:
        out["legend"]["y"] = 1.07  # above the label of 90°
        radial = {"title": {"text": _text(p.y.title)}, "angle": 90, "tickangle": 90}
        if p.y.limits is not None:
            radial["range"] = list(p.y.limits)
        if p.y.ticks is not None:
            radial["tickvals"] = [value for value, _ in p.y.ticks]
            radial["ticktext"] = [_text(text) for _, text in p.y.ticks]
        around = {"direction": "counterclockwise", "rotation": 0, "ticksuffix": "°"}
        return {**out, "polar": {"bgcolor": clear, "radialaxis": radial, "angularaxis": around}}
    x, y = _plotly_axis(p.x), _plotly_axis(p.y)
    if p.y.names:
        y["autorange"] = "reversed"
    if p.kind is Kind.MAP:
        y |= {"scaleanchor": "x", "scaleratio": 1, "constrain": "domain"}
        x["constrain"] = "domain"
    return {**out, "xaxis": x, "yaxis": y}


def _plotly_axis(axis: Axis) -> dict[str, Any]:
    out: dict[str, Any] = {
        "title": {"text": _text(axis.title), "font": {"size": 13}},
        "automargin": True,
    }
    if axis.limits is not None:
        out["range"] = list(axis.limits)
    if axis.log:
        out |= {"type": "log", "dtick": "D2"}  # labels at 1, 2, 5
        if axis.limits is not None:
            out["range"] = np.log10(axis.limits).tolist()
    if axis.ticks is not None:
        out |= {
            "tickvals": [value for value, _ in axis.ticks],
            "ticktext": [_text(text) for _, text in axis.ticks],
        }
    if axis.names:
        out["zeroline"] = False  # the first name is no zero
        places: Sequence[int] = range(len(axis.names))
        out |= {"tickvals": list(places), "ticktext": [_text(name) for name in axis.names]}
    return out
