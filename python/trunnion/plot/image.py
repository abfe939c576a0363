"""Pictures as images in a page: small in notebooks; in reports what is seen before Plotly runs."""

from __future__ import annotations

import base64
import html
import io
import re
from dataclasses import replace
from typing import Any

from trunnion.plot.picture import Kind, Picture
from trunnion.plot.static import size_of
from trunnion.plot.style import MUTED

THUMBNAIL_DPI = 62
PIXELS = 96.0  # of a page, in an inch
COLUMNS = 400
"""Of a still picture: of more readings the least and the largest in each are drawn."""
INK, SOFT = "#010203", "#010204"
"""Stand for the colours of the page's text and frames, which follow a dark screen."""
NOT_WRITTEN = {"png": ("Software",), "svg": ("Creator", "Date", "Format", "Type")}
THEMED = {
    **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.labelcolor", "ytick.labelcolor"), INK),
    **dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), SOFT),
    "axes.facecolor": "none",
    "grid.color": MUTED,
    "svg.fonttype": "none",
}
_OWN_STYLE = re.compile(r"<defs>\s*<style.*?</defs>", re.DOTALL)  # of every element of the page
_TAG = re.compile(r"<[^>]*>\s*")
_LONG = re.compile(r"(\.\d\d)\d+")  # digits of a place


def thumbnail_of(p: Picture) -> str:
    """Return a picture as a small image in HTML, dark on white whatever the style of a notebook."""
    image = base64.b64encode(_drawn(p, size_of(p), {}, format="png", dpi=THUMBNAIL_DPI)).decode()
    alt = html.escape(p.description, quote=True)
    return f'<img alt="{alt}" src="data:image/png;base64,{image}">'


def still(p: Picture, width: float, height: float, name: str) -> str:
    """Return a picture as SVG in a page that has its title and its text, in the page's colours.

    width, height: Pixels. name: Tells it from others of the page.
    """
    bare = replace(p.thinned(COLUMNS), title="", note="")
    look = {**THEMED, "svg.hashsalt": name}
    text = _drawn(bare, (width / PIXELS, height / PIXELS), look, format="svg").decode()
    text = _OWN_STYLE.sub("", text[text.index("<svg") :])
    text = _TAG.sub(lambda tag: _LONG.sub(r"\1", tag.group().strip()), text)
    text = re.sub(r'<g id="[^"]*"', "<g", text)  # the same in all pictures
    text = text.replace(INK, "var(--ink)").replace(SOFT, "var(--soft)")
    view = re.search(r'viewBox="[^"]*"', text)
    assert view is not None
    inner = text[text.index(">") + 1 :]
    kind = f"still {p.kind.value}"
    return f'<svg class="{kind}" aria-hidden="true" {view.group()}>{inner}'


def _drawn(p: Picture, size: tuple[float, float], look: Any, **kind: Any) -> bytes:
    """Return a file of a picture, drawn on a figure that is none of pyplot's, in no style."""
    from matplotlib import rc_context, rcParamsDefault
    from matplotlib.figure import Figure

    plain = {k: v for k, v in rcParamsDefault.items() if k.endswith("color")}
    buffer = io.BytesIO()
    with rc_context({**plain, **look}):
        figure = Figure(figsize=size, layout="constrained", facecolor="none" if look else "white")
        axes = figure.add_subplot(projection="polar" if p.kind is Kind.POLAR else None)
        p.draw(axes)
        figure.savefig(buffer, metadata=dict.fromkeys(NOT_WRITTEN[kind["format"]]), **kind)
    return buffer.getvalue()
