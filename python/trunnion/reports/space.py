"""The view in space of a report: touches with their residuals as arrows, error fields."""

from __future__ import annotations

import html
import json
import re
from dataclasses import dataclass
from typing import Any

from trunnion.base.errors import InputError
from trunnion.base.report import Result
from trunnion.data.touches import Touches
from trunnion.plot.scenes.scene import VIEWS, scene
from trunnion.reports.document import Item
from trunnion.reports.source import Source

MAX_CHARACTERS = 2_000_000
TURN = "Drag to turn, wheel to zoom."
TITLES = {"VolumetricError": "Error field"}
WITH_DATA = ("IdentificationResult", "ClosedFormResult")
RESIDUALS = "Touches with what the model leaves of them"


@dataclass(frozen=True)
class Space:
    """A view in space that one can turn."""

    title: str
    note: str
    figure: dict[str, Any]

    @property
    def description(self) -> str:
        """Alternative text."""
        return f"{self.title}, in space. The numbers are in the tables of this page. {self.note}"

    def to_plotly(self) -> dict[str, Any]:
        """Traces and layout, as plain values."""
        return self.figure


def in_space(result: Result, source: Source) -> list[Item]:
    """Return the view in space of a result where there is one, with its data and set-up."""
    names = [kind.__name__ for kind in type(result).__mro__ if kind.__name__ in VIEWS]
    touched = len(source.data) == 1 and isinstance(source.data[0], Touches)
    if not names or (names[0] == "Diagnosis" and not touched):
        return []
    known = [one for one in (*source.data, source.setup) if one is not None]
    context = known if names[0] in WITH_DATA else []
    options = {"probe_path": False} if names[0] in (*WITH_DATA, "Diagnosis") else {}
    try:
        text = scene(result, *context, **options).to_json()
    except InputError:  # without its data or its set-up
        return []
    if len(text) > MAX_CHARACTERS:
        return ["The view in space would make this page heavy: `trunnion view FILES` shows it."]
    figure = json.loads(text)
    layout = {k: v for k, v in figure["layout"].items() if k not in ("title", "template", "height")}
    layout["margin"] = {"l": 10, "r": 10, "t": 5, "b": 5}  # the title stands above it
    said = (figure["layout"].get("title") or {}).get("text", "")
    said = html.unescape(re.sub(r"<[^>]*>", "", said.replace("<br>", ": ")))
    note = f"{said}. {TURN}" if said else TURN
    title = TITLES.get(names[0], RESIDUALS)
    return [Space(title, note, {"data": figure["data"], "layout": layout})]
