"""A view of traces: what all scenes share (axes, camera, scale of arrows, postures to choose)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from trunnion.base.units import Floats
from trunnion.plot.scenes.traces import Trace, lines, words
from trunnion.plot.style import MUTED, round_number

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

EYE = np.array([1.05, -1.3, 0.85])
ARROW_SHARE = 0.14
"""Of the size of the scene: the longest arrow, where no magnification is given."""
HEIGHT = 620
ROOM = 0.06
MIN_SPAN = 0.12  # of the longest axis
SIZE = 1.75  # diagonal of the box, in units of the camera


@dataclass
class View:
    """Traces on their way into a figure.

    title: What is shown. traces: always shown. steps: label → traces, of which one is chosen.
    layout: Further parts of Plotly's layout. zoom: of the camera; 1 shows the whole scene.
    axes: whether a box with scales in mm stands around it.
    """

    title: str
    traces: list[Trace] = field(default_factory=list)
    steps: dict[str, list[Trace]] = field(default_factory=dict)
    layout: dict[str, Any] = field(default_factory=dict)
    zoom: float = 1.0
    step_name: str = ""
    axes: bool = True

    def add(self, *traces: Trace | Iterable[Trace]) -> None:
        """Add traces, or lists of them."""
        for each in traces:
            self.traces += [each] if isinstance(each, dict) else list(each)

    def figure(self) -> Figure:
        """Return the Plotly figure."""
        from plotly import graph_objects

        shown = list(self.traces)
        for number, step in enumerate(self.steps.values()):
            shown += [{**trace, "visible": number == 0} for trace in step]
        layout = {
            **base_layout(self.title),
            "scene": scene_axes(shown, zoom=self.zoom, visible=self.axes),
            **self.layout,
        }
        if len(self.steps) > 1:
            layout["sliders"] = [self._slider()]
        return graph_objects.Figure({"data": shown, "layout": layout})

    def _slider(self) -> dict[str, Any]:
        fixed = [True] * len(self.traces)
        steps = []
        for label in self.steps:
            chosen = [label == other for other, t in self.steps.items() for _ in t]
            args = [{"visible": fixed + chosen}]
            steps.append({"label": label, "method": "update", "args": args})
        prefix = f"{self.step_name}: " if self.step_name else ""
        return {
            "steps": steps,
            "currentvalue": {"prefix": prefix},
            "pad": {"t": 8, "b": 8},
            "len": 0.9,
            "x": 0.05,
        }


def base_layout(title: str) -> dict[str, Any]:
    """Return what every scene's layout shares; colours of text and grid suit any theme."""
    return {
        "title": {"text": title, "x": 0.02, "y": 0.97, "yanchor": "top", "font": {"size": 16}},
        "margin": {"l": 10, "r": 10, "t": 60, "b": 5},
        "height": HEIGHT,
        "paper_bgcolor": "rgba(0,0,0,0)",
        "font": {"color": MUTED, "size": 13},
        "legend": {"x": 0.01, "y": 0.9, "itemsizing": "constant", "bgcolor": "rgba(0,0,0,0)"},
        "uirevision": "kept",
    }


def scene_axes(
    traces: Sequence[Trace], *, zoom: float = 1.0, visible: bool = True
) -> dict[str, Any]:
    """Return axes in mm around traces, at one scale whatever is shown of them.

    zoom: of the camera, which looks from the front, right and above; 1 shows the whole scene.
    """
    points = np.concatenate([np.column_stack([trace[x] for x in "xyz"]) for trace in traces])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    middle, span = (low + high) / 2, high - low
    whole = float(span.max()) or 1.0
    span = np.maximum((1 + ROOM) * span, MIN_SPAN * whole)
    look = {
        "backgroundcolor": "rgba(0,0,0,0)",
        "gridcolor": "rgba(128,128,128,0.3)",
        "zerolinecolor": "rgba(128,128,128,0.5)",
        "showspikes": False,
        "nticks": 6,
        "visible": visible,
    }
    axes: dict[str, Any] = {
        f"{x}axis": {
            "title": {"text": f"{x.upper()} (mm)"},
            "range": [float(middle[k] - span[k] / 2), float(middle[k] + span[k] / 2)],
            **look,
        }
        for k, x in enumerate("xyz")
    }
    ratio = SIZE * span / np.linalg.norm(span)
    return {
        **axes,
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", map(float, ratio), strict=True)),
        "camera": {"eye": dict(zip("xyz", map(float, EYE / zoom), strict=True))},
        "dragmode": "orbit",
    }


def extent(*points: Floats) -> tuple[Floats, float]:
    """Return the lowest corner and the size (diagonal) of the box around points."""
    whole = np.concatenate([np.asarray(p).reshape(-1, 3) for p in points])
    low, high = np.nanmin(whole, axis=0), np.nanmax(whole, axis=0)
    return low, float(np.linalg.norm(high - low)) or 1.0


def arrow_scale(largest_um: float, size_mm: float, magnification: float | None) -> float:
    """Return mm drawn for 1 µm: as magnified, or so that the longest arrow is well seen."""
    if magnification is not None:
        return magnification * 1e-3
    return round_number(ARROW_SHARE * size_mm / max(largest_um, 1e-9) * 1e3) * 1e-3


def scale_bar(at: Floats, scale: float, largest_um: float) -> tuple[list[Trace], str]:
    """Return a bar that shows a round number of µm at the scale of arrows, and the words for it."""
    length = round_number(largest_um) if largest_um > 0 else 1.0
    start = np.asarray(at, dtype=np.float64)
    end = start + np.array([length * scale, 0.0, 0.0])
    tick = np.array([0.0, 0.0, 0.15 * length * scale])
    ends = ((start - tick, start + tick), (start, end), (end - tick, end + tick))
    shown = lines([np.array(pair) for pair in ends], width=5)
    text = f"{length:g} µm"
    said = f"arrows × {scale * 1e3:,.0f}: {text} drawn as {length * scale:.3g} mm"
    return [shown, words(np.array([(start + end) / 2 - 2 * tick]), [text])], said


def titled(first: str, *more: str) -> str:
    """Return a title with smaller lines below it."""
    below = "".join(f"<br><sub>{line}</sub>" for line in more if line)
    return f"{first}{below}"


def thinned(count: int, most: int) -> Sequence[int]:
    """Return at most so many indices, evenly spread, the first and the last among them."""
    return list(np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)))
