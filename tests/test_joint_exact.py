"""Measurements without noise beside one that has some: neither silences the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import trunnion as tn
from ballbar_twin import cartesian_lengths, columns_of, record
from positioning_twin import axis
from power.measured_twin import make_points
from power.study import ground
from trunnion.setup import Setup
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

Rng = np.random.Generator
Causes = dict[str, dict[str, float]]
Case = tuple[list[object], set[str], set[str]]
"""Measurements; the hidden causes; those of them that only the noisy readings see."""
Make = Callable[[Rng, int], Case]

RADIUS: Causes = {"probe_radius": {"dr_um": 1.5}}


def rich() -> Setup:
    """Return the set-up of the touches, which are recorded in no steps."""
    read = ground("rich")[3]
    return replace(read, probe=replace(read.probe, tick_um=0.0))


def touches(rng: Rng, effects: Causes, noise_um: float) -> tn.Touches:
    planned, setup, _, _ = ground("rich")
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=effects)
    seed = int(rng.integers(1 << 31))
    return tn.Touches(
        measure(planned, setup, truth, noise_um=noise_um, tick_um=0.0, seed=seed).columns
    )


def exact_points_beside_touches(rng: Rng, seed: int) -> Case:
    """A part that has expanded, and a drift while it was measured."""
    made = make_points(seed, ("expansion", "drift_x"), 2e9, noise_um=1e-9)
    noisy = touches(rng, RADIUS, 0.3)
    own = {f"points:{name}" for name in made.hidden}
    return (
        [tn.Points(**made.columns), noisy],
        {*own, "touches:probe_radius"},
        {"touches:probe_radius"},
    )


def exact_touches_beside_ballbar(rng: Rng, seed: int) -> Case:
    """Scales that both see, and a bar longer than stated."""
    ppm = {"scale_x": 12.0, "scale_y": -8.0 - seed}
    exact = touches(rng, {name: {"ppm": size} for name, size in ppm.items()}, 0.0)
    spot = rng.uniform(-200, 200, 3)
    rec = record(spot, step_deg=8.0, arcs=(("XY", 0, 360),))
    error = 1e-6 * (rec.points - spot) * [ppm["scale_x"], ppm["scale_y"], 0.0]
    lengths = cartesian_lengths(rec, rng, sigma_um=0.3, motion=lambda _: error)
    noisy = tn.Ballbar(columns_of(rec, lengths + 2e-3))
    return [exact, noisy], {*ppm, "ballbar:ballbar_length"}, {"ballbar:ballbar_length"}


def exact_positioning_beside_touches(rng: Rng, seed: int) -> Case:
    """A scale and a backlash that both see, and a radius of the probe."""
    ppm, lost = 10.0 + seed, 2.0
    stops = axis(rng, noise=0.0)
    error = 1e-3 * ppm * stops.target - lost / 2 * stops.direction
    exact = stops.with_columns(measured_mm=stops.measured + 1e-3 * error, axis=["X"] * len(stops))
    machine: Causes = {"scale_x": {"ppm": ppm}, "backlash_x": {"b_um": lost}}
    noisy = touches(rng, machine | RADIUS, 0.3)
    return [noisy, exact], {*machine, "touches:probe_radius"}, {"touches:probe_radius"}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "make",
    [exact_points_beside_touches, exact_touches_beside_ballbar, exact_positioning_beside_touches],
)
def test_causes_of_exact_and_of_noisy_readings_are_named(make: Make, seed: int) -> None:
    data, hidden, noisy = make(np.random.default_rng([81, seed]), seed)
    d = tn.diagnose(data, rich())
    assert d.named == hidden
    others = set().union(*d.alternatives) - hidden
    assert all(sum(a.probability for a in d.evidence if x in a.causes) <= 0.5 for x in others)
    errors = [std for c in d.causes if c.id in noisy for std in c.std_errors.values()]
    assert np.all(np.isfinite(errors))
    assert min(errors) > 1e-3
