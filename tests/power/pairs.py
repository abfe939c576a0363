"""Measurements that leave a doubt alone, and none beside stops of the axes of the same machine."""

from __future__ import annotations

from typing import Any

import numpy as np

import trunnion as tn
from ballbar_twin import cartesian_lengths, record
from positioning_twin import axis
from power.study import ground
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

Rng = np.random.Generator
Causes = dict[str, dict[str, float]]
Measured = tuple[list[Any], set[str]]
"""What was measured, and the causes that act as a joint diagnosis calls them."""

MACHINE = ("scale_x", "scale_y", "backlash_x", "backlash_y")
OWN = ("probe_radius", "artefact_length", "artefact_width", "artefact_expansion")
NAMES = {
    "scale": "ppm",
    "backlash": "b_um",
    "probe_radius": "dr_um",
    "artefact_length": "dl_um",
    "artefact_width": "dw_um",
    "artefact_expansion": "ppm",
}


def settled(d: tn.Diagnosis, hidden: set[str]) -> bool:
    """Whether the hidden causes are in every set that is left: nothing can take their place."""
    return bool(d.alternatives) and all(hidden <= causes for causes in d.alternatives)


def hidden_cause(rng: Rng, name: str) -> Causes:
    sign = rng.choice([-1.0, 1.0])
    size = rng.uniform(4, 8) if "scale" in name or "expansion" in name else rng.uniform(0.7, 1.2)
    parameter = NAMES.get(name) or NAMES[name.partition("_")[0]]
    return {name: {parameter: float(sign * size)}}


def touches(rng: Rng, effects: Causes, plan: str = "paper", **more: float) -> tn.Touches:
    """Touches of the twin; ``more``: location errors."""
    planned, setup, _, _ = ground(plan)
    truth = Truth(
        errors={**random_errors(rng), **more}, placement=random_placement(rng), effects=effects
    )
    made = measure(
        planned, setup, truth, noise_um=0.3, tick_um=0.1, seed=int(rng.integers(1 << 31))
    )
    return tn.Touches(made.columns)


def stops(rng: Rng, letter: str, effects: Causes) -> tn.Positioning:
    """Stops of an axis of the same machine: it goes further by its scale, and lags by backlash."""
    data = axis(rng, noise=0.5)
    ppm = effects.get(f"scale_{letter}", {}).get("ppm", 0.0)
    b = effects.get(f"backlash_{letter}", {}).get("b_um", 0.0)
    error = 1e-3 * ppm * data.target - b / 2 * data.direction
    return data.with_columns(
        measured_mm=data.measured + 1e-3 * error, axis=[letter.upper()] * len(data)
    )


def bar(rng: Rng, ppm: float, longer_um: float) -> tn.Ballbar:
    """An XY circle of a machine with this scale of X and Y, by a bar that is longer than stated."""
    spot = rng.uniform(-200, 200, 3)
    rec = record(spot, step_deg=8.0, arcs=(("XY", 0, 360),))
    error = 1e-6 * ppm * (rec.points - spot) * [1.0, 1.0, 0.0]
    lengths = cartesian_lengths(rec, rng, sigma_um=0.3, motion=lambda _: error)
    return tn.Ballbar(
        setup=rec.setup,
        x_mm=rec.points[:, 0],
        y_mm=rec.points[:, 1],
        length_mm=lengths + 1e-3 * longer_um,
        sense=rec.sense,
        time_s=rec.time_s,
    )


def scaled_or_slack(rng: Rng) -> Measured:
    """Touches by the paper's plan, and stops of X and Y: a scale or a backlash of one of these."""
    name = str(rng.choice(MACHINE))
    effects = hidden_cause(rng, name)
    return [touches(rng, effects), *(stops(rng, a, effects) for a in "xy")], {name}


def of_probe_or_artefact(rng: Rng) -> Measured:
    """The same of a machine without such errors: probe or artefact have some, or none."""
    own = {k: v for name in OWN for k, v in hidden_cause(rng, name).items() if rng.random() < 0.4}
    return [touches(rng, own), *(stops(rng, a, {}) for a in "xy")], set(own)


def long_bar_or_machine(rng: Rng, *, of_machine: bool) -> Measured:
    """A circle that reads too large, and stops of X and Y: by both scales alike, or by the bar."""
    size = float(rng.uniform(10, 30) * rng.choice([-1, 1]))
    data = bar(rng, size, 0.0) if of_machine else bar(rng, 0.0, 0.15 * size)
    scale: Causes = {f"scale_{a}": {"ppm": size * of_machine} for a in "xy"}
    hidden = {"scale_xy"} if of_machine else {"ballbar:ballbar_length"}
    return [data, *(stops(rng, a, scale) for a in "xy")], hidden


def two_dates(rng: Rng, *, changed: bool) -> Measured:
    """Touches by the rich plan on two dates: one location error has changed in between, or none.

    Not EZ0A: to touches a backlash of Z that has changed looks the same.
    """
    truth = random_errors(rng)
    name = str(rng.choice(sorted(set(truth) - {"EZ0A"})))
    by = float(rng.choice([-1, 1]) * rng.uniform(2, 8)) if changed else 0.0
    later = {**truth, name: truth[name] + by}
    hidden = {f"touches 2:change_{name}"} if changed else set()
    return [touches(rng, {}, "rich", **truth), touches(rng, {}, "rich", **later)], hidden
