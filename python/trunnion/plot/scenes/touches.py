"""Touches in space, posture by posture: probe path, approach vectors, residuals as arrows."""

from __future__ import annotations

from dataclasses import replace
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np

from trunnion.base.checks import floats
from trunnion.base.errors import InputError
from trunnion.base.units import Floats, Integers
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.plot.scenes.machine import Posture, linear_traces, machine_traces, probe_traces
from trunnion.plot.scenes.traces import Trace, arrows, colour_axis, dots, lines
from trunnion.plot.scenes.view import View, arrow_scale, extent, scale_bar, thinned, titled
from trunnion.plot.style import BLUE, GREEN, OCHRE, VERMILLION
from trunnion.probing.steps import arrangement
from trunnion.setup import Setup
from trunnion.setup.write import size_of

MAX_POSTURES = 24
"""Steps of the slider: of more postures some are shown, and the title says so."""
NEAR = 1.25  # of the farthest touch: where the table is cut beside residuals
LONG = 2.0  # times as long as arrows of other views: they stand beside an artefact
ORDINARY, CUT = 0.9, 1.5
"""Of residuals: arrows are cut at so many times this quantile, so that outliers do not hide all."""


def machine_view(setup: Setup, at: Posture) -> View:
    """Return the machine in a posture: table, artefact, rotary and linear axes."""
    reach = 1.4 * setup.table.radius_mm
    view = View(titled(f"Machine {setup.machine.name}, {at.label}", _standing(setup)), zoom=1.1)
    view.add(machine_traces(setup, at))
    view.add(linear_traces(np.array([-reach, -reach, -reach]), 0.3 * reach))
    return view


def _standing(setup: Setup) -> str:
    artefact = setup.artefact
    if artefact.kind == "none":
        return ""
    return f"{artefact.kind} {size_of(artefact)}, table ∅ {2 * setup.table.radius_mm:g} mm"


def touches_view(
    touches: Touches,
    setup: Setup,
    *,
    residuals_um: Floats | None = None,
    magnification: float | None = None,
    probe_path: bool = True,
) -> View:
    """Return touches in the machine's frame, one posture of the rotary axes at a time.

    residuals_um: deviations along the approach (n,), drawn as arrows on one scale; else none.
    magnification: of these arrows; chosen so that the largest is well seen if None.
    probe_path: whether the way between touches is drawn, above all that swings.
    """
    if not len(touches):
        raise InputError("scene: got no touches, expected at least one")
    chain = Chain(setup)
    rotary = chain.to_machine(touches.rotary_deg, len(touches))
    found, first, which = np.unique(
        np.round(rotary, 6), axis=0, return_index=True, return_inverse=True
    )
    which = which.ravel()
    order = np.argsort(first)
    shown = [int(order[k]) for k in thinned(len(found), MAX_POSTURES)]
    values = None if residuals_um is None else floats("residuals_um", residuals_um)
    if values is not None and values.shape != (len(touches),):
        raise InputError(
            f"residuals_um: got shape {values.shape}, expected one a touch, ({len(touches)},)"
        )
    if values is not None:  # the table as far as it matters
        near = NEAR * float(np.max(np.linalg.norm(touches.position_mm, axis=1)))
        small = replace(setup.table, radius_mm=min(near, setup.table.radius_mm))
        setup = replace(setup, table=small)
    reach = setup.table.radius_mm
    _, size = extent(touches.position_mm)
    drawing = _Drawing(touches, setup, values, 0.0, size, probe_path)
    title, below = f"{len(touches)} touches, machine frame", ""
    bar: list[Trace] = []
    if values is not None:
        lengths = np.abs(values)
        largest = float(lengths.max(initial=0.0))
        drawing.top = min(largest, CUT * float(np.quantile(lengths, ORDINARY)))
        if magnification is not None or drawing.top == 0:
            drawing.top = largest
        drawing.scale = arrow_scale(drawing.top, LONG * size, magnification)
        corner = np.array([-reach, -1.25 * reach, touches.position_mm[:, 2].min()])
        bar, below = scale_bar(corner, drawing.scale, drawing.top)
        if more := int(np.sum(lengths > drawing.top)):
            below += f"; {more} beyond {drawing.top:.2g} µm no longer than that"
        title = f"Residuals of {len(touches)} touches, largest {largest:.3g} µm"
    if len(shown) < len(found):
        below += f"{'; ' if below else ''}{len(shown)} of {len(found)} postures"
    view = View(titled(title, below), step_name="Posture", zoom=1.3 if values is None else 1.15)
    view.add(bar)
    if values is not None:
        view.axes = False
        view.add(linear_traces(np.array([-reach, -1.25 * reach, -1.3 * reach]), 0.3 * reach))
    at_each = [Posture(chain, rotary[first[k]]) for k in shown]
    for k, at in zip(shown, at_each, strict=True):
        label = at.label if at.label not in view.steps else f"{at.label} ({len(view.steps)})"
        view.steps[label] = drawing.posture(at, np.flatnonzero(which == k))
    if values is not None:
        view.layout["coloraxis"] = colour_axis("residual (µm)", max(drawing.top, 1e-9))
    return view


class _Drawing:
    """What is the same for every posture of one view."""

    def __init__(
        self,
        touches: Touches,
        setup: Setup,
        values: Floats | None,
        scale: float,
        size: float,
        probe_path: bool,
    ) -> None:
        self.touches, self.setup, self.values = touches, setup, values
        self.scale, self.size, self.probe_path = scale, size, probe_path
        self.top = np.inf  # µm; a longer arrow is cut

    def posture(self, at: Posture, rows: Integers) -> list[Trace]:
        centre = self.touches.position_mm[rows]
        direction = self.touches.direction[rows]
        contact = centre + self.setup.probe.ball_radius_mm * direction
        start = self._starts()[rows]
        shown = machine_traces(self.setup, at)
        shown += probe_traces(self.setup, start[0])
        texts = [self._text(int(row)) for row in rows]
        hover = {"text": texts, "hovertemplate": "%{text}<extra></extra>"}
        dot = 4.0 if self.values is None else 2.5
        shown.append(dots(contact, colour=VERMILLION, size=dot, name="touch", **hover))
        if self.values is None:
            back = contact - start - self.setup.probe.ball_radius_mm * direction
            shown += arrows(
                contact - back, back, size_mm=self.size, colour=BLUE, texts=texts, name="approach"
            )
        else:
            values = self.values[rows]
            drawn = (self.scale * np.clip(values, -self.top, self.top))[:, None] * direction
            # outside the body: towards its surface, or away from it
            shown += arrows(
                contact - np.where(values[:, None] > 0, drawn, 0.0),
                drawn,
                size_mm=self.size,
                values=np.abs(values),
                texts=texts,
                width=6,
            )
        if self.probe_path:
            shown += self._path(rows, start, centre)
        return shown

    def _starts(self) -> Floats:
        given = self.touches.start_mm
        if given is not None:
            return given
        back = self.setup.plan.clearance_mm * self.touches.direction
        return np.asarray(self.touches.position_mm - back)

    def _path(self, rows: Integers, start: Floats, centre: Floats) -> list[Trace]:
        """Down to the start, to the contact and back, up, across: as a probing program moves."""
        levels = self._levels(rows, start)
        parts = [
            np.array([[*s[:2], level], s, c, s, [*s[:2], level]])
            for s, c, level in zip(start, centre, levels, strict=True)
        ]
        ways = [np.vstack([one[-1], two[0]]) for one, two in pairwise(parts)]
        return [
            lines(parts, colour=GREEN, width=2, name="path of the ball's centre"),
            lines(ways, colour=OCHRE, width=2, name="rapid across"),
        ]

    def _levels(self, rows: Integers, start: Floats) -> Floats:
        """Height of the ways across, above everything at the posture; above the starts at least."""
        least = np.full(len(rows), float(start[:, 2].max()) + 2 * self.setup.plan.clearance_mm)
        if self.setup.artefact.kind == "none":
            return least
        chain = Chain(self.setup)
        rotary = chain.to_machine(self.touches.rotary_deg, len(self.touches))[rows]
        _, levels = arrangement(self.setup).safe_levels(np.ascontiguousarray(rotary))
        return np.asarray(np.maximum(levels, least))

    def _text(self, row: int) -> str:
        touches = self.touches
        parts: list[Any] = [escape(touches.place(row))]
        parts += [f"{k.upper()} {v[row]:g}°" for k, v in touches.rotary_deg.items()]
        if touches.point is not None:
            parts.append(f"point {touches.point[row]}")
        if self.values is not None:
            parts.append(f"<b>{self.values[row]:+.3g} µm</b>".replace("-", "−"))
        return ", ".join(parts)
