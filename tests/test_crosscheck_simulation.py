"""Simulated touches against the twin, which looks at every tick."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import from_twin
from trunnion.data.touches import Touches
from trunnion.probing.simulate import simulate
from twin import contact, forward, generator
from twin.forward import Floats, Truth

TICK_MM = 1e-4
REACH_MM = 0.25


def hits(plan: generator.Plan, setup: forward.Setup, truth: Truth) -> generator.Plan:
    """Return the touches of a plan that also meet the true artefact, deep enough to be no graze."""
    seen = forward.approach_lines(plan.conditions, plan.start_mm, setup, truth)
    deep = seen.start + (REACH_MM + 0.4) * seen.step
    good = contact.distance(deep, seen.artefact) < seen.radius - 0.02
    good &= contact.distance(seen.start, seen.artefact) > seen.radius + 0.01
    return plan.rows(good)


def way_of(touches: Touches) -> Floats:
    assert touches.start_mm is not None
    return np.asarray(np.sum((touches.position_mm - touches.start_mm) * touches.direction, axis=1))


def random_case(
    seed: int, kind: str, preset: str = "trt-ca", n: int = 150
) -> tuple[generator.Plan, forward.Setup, Truth]:
    rng = np.random.default_rng(seed)
    setup = forward.Setup(preset=preset, artefact=forward.Artefact(kind))
    effects = {
        id_: values
        for id_, values in generator.random_effects(rng).items()
        if (preset == "trt-ca" or not id_.startswith("a_"))
        and (kind == "cross" or id_ != "artefact_squareness")
        and (kind != "sphere" or not id_.startswith("artefact_") or id_ == "artefact_expansion")
    }
    truth = Truth(
        generator.random_errors(rng, preset), generator.random_placement(rng, 60, 60), effects
    )
    plan = generator.random_touches(rng, setup, n, reach_mm=REACH_MM)
    return hits(plan, setup, truth), setup, truth


def simulated(plan: generator.Plan, setup: forward.Setup, truth: Truth, tick_um: float) -> Floats:
    effects: Any = truth.effects
    touches = simulate(
        from_twin.plan(plan, setup, REACH_MM),
        from_twin.setup(setup),
        truth.errors,
        truth.placement,
        effects,
        tick_um=tick_um,
    )
    return way_of(touches)


def test_ten_thousand_touches_trigger_at_the_tick_of_the_stepped_ones() -> None:
    wrong = total = 0
    for seed in range(100):
        kind = ("cross", "cross", "cuboid", "sphere")[seed % 4]
        plan, setup, truth = random_case(seed, kind)
        seen = forward.approach_lines(plan.conditions, plan.start_mm, setup, truth)
        stepped = contact.step_to_contact(seen, TICK_MM, REACH_MM + 1.0)
        way = simulated(plan, setup, truth, TICK_MM * 1e3)
        ticks = np.rint(way / TICK_MM)
        assert np.abs(way - ticks * TICK_MM).max() < 1e-11
        wrong += int(np.sum(ticks != stepped))
        total += len(ticks)
    assert total >= 10_000
    assert wrong == 0


@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc", "table-c-head-b"])
@pytest.mark.parametrize("kind", ["cross", "cuboid", "sphere"])
def test_contacts_without_ticks_agree_to_rounding(preset: str, kind: str) -> None:
    for seed in range(5):
        plan, setup, truth = random_case(seed, kind, preset)
        seen = forward.approach_lines(plan.conditions, plan.start_mm, setup, truth)
        way = contact.way_to_contact(seen)
        assert np.abs(simulated(plan, setup, truth, 0.0) - way).max() < 1e-10


@pytest.mark.parametrize("id_", forward.EFFECTS)
def test_every_effect_acts_where_the_twin_has_it(id_: str) -> None:
    rng = np.random.default_rng(len(id_))
    plan, setup = generator.rich_plan(approach_mm=REACH_MM), forward.Setup()
    values = generator.random_effect(rng, id_, plan)
    for name in values.keys() - {"t0_s", "tau_min", "tau_ms"}:
        values[name] += np.copysign(10.0, values[name])
    truth = Truth(effects={id_: values})
    ours, theirs = simulated(plan, setup, truth, 0.0), generator.readings_um(plan, setup, truth)
    assert np.abs(theirs - REACH_MM * 1e3).max() > 0.1
    assert np.abs(ours * 1e3 - theirs).max() < 1e-7
