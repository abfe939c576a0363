"""The twin's set-ups, plans and measurements as trunnion's own: the only file that knows both."""

from __future__ import annotations

from typing import Any

import numpy as np

from trunnion.data.touches import Touches
from trunnion.setup import Artefact, AxisSetup, Machine, Probe, Resolution, Setup
from twin import forward, generator


def setup(theirs: forward.Setup) -> Setup:
    a = theirs.artefact
    standing: dict[str, Any] = {"place_mm": theirs.place_mm, "turn_deg": theirs.turn_deg}
    artefact = (
        Artefact("sphere", diameter_mm=a.diameter_mm, centre_mm=a.centre_mm, **standing)
        if a.kind == "sphere"
        else Artefact(a.kind, a.length_mm, a.width_mm, a.height_mm, **standing)
    )
    axes = {letter: AxisSetup(sense) for letter, sense in theirs.sense.items()}
    if theirs.tilt_point_mm is not None:
        letter = theirs.tilt_letter
        axes[letter] = AxisSetup(theirs.sense.get(letter, 1), theirs.tilt_point_mm)
    probe = Probe(
        theirs.ball_radius_mm,
        theirs.repeatability_um,
        theirs.tick_um,
        theirs.probe_length_mm,
    )
    return Setup(
        artefact,
        Machine(theirs.preset, theirs.known_errors),
        axes,
        probe,
        Resolution(theirs.linear_um, theirs.rotary_arcsec),
    )


def touches(measurement: generator.Measurement) -> Touches:
    columns: dict[str, Any] = dict(measurement.columns)
    return Touches(**columns)


def plan(theirs: generator.Plan, twin_setup: forward.Setup, expected_mm: float) -> Touches:
    """A plan that starts exactly where the twin does; contact is expected after `expected_mm`."""
    k = theirs.conditions
    letter = twin_setup.tilt_letter.lower()
    expected = theirs.start_mm + expected_mm * k.direction
    columns: dict[str, Any] = {
        f"{letter}_deg": k.a_deg,
        "c_deg": k.c_deg,
        f"{letter}_dir": k.a_dir.astype(int),
        "c_dir": k.c_dir.astype(int),
        "feed_mm_min": k.feed_mm_min,
        "time_s": k.time_s,
        "point": theirs.point,
        "cycle": theirs.cycle,
    }
    for i, name in enumerate("xyz"):
        columns[f"{name}_mm"] = expected[:, i]
        columns[f"dir_{name}"] = k.direction[:, i]
        columns[f"start_{name}_mm"] = theirs.start_mm[:, i]
    return Touches(**columns)


def twin_plan(planned: Touches, approach_mm: float = 3.0) -> generator.Plan:
    """A plan of trunnion's as the twin has it."""
    n = len(planned)
    senses = planned.rotary_dir
    conditions = forward.Conditions(
        planned.rotary_deg["a"],
        planned.rotary_deg["c"],
        planned.direction,
        np.asarray(planned.feed_mm_min),
        np.asarray(planned.time_s),
        np.asarray(senses["a"], dtype=float),
        np.asarray(senses["c"], dtype=float),
    )
    start = planned.position_mm - approach_mm * planned.direction
    none = np.zeros(n, dtype=np.int64)
    return generator.Plan(conditions, start, none, none, ("",) * n)
