"""The core's least squares against the CasADi identification, on the same readings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import from_twin
from trunnion import casadi_baseline
from trunnion.probing.identify import identify
from trunnion.probing.model import TouchModel, catalogue
from trunnion.setup import Artefact, Probe, Setup
from twin import forward, generator
from twin.forward import EFFECTS, Truth

pytest.importorskip("casadi")

AGREE = 1e-6  # µm and arcsec
TWIN = forward.Setup()
PLANS = {"paper": generator.paper_plan(), "rich": generator.rich_plan(step_deg=45.0)}
# Pairs and threes that the rich plan can tell apart from the fourteen and from each other.
SETS: tuple[tuple[str, ...], ...] = (
    (),
    ("drift_z",),
    ("artefact_length", "scale_x", "drift_x"),
    ("c_positioning", "c_axial_2", "backlash_y"),
    ("c_radial_2", "c_wobble_2"),
    ("a_positioning", "squareness_xy", "c_backlash"),
    ("artefact_squareness", "drift_y", "scale_z"),
    ("trigger_delay", "artefact_expansion", "c_axial"),
)


@pytest.mark.parametrize("where", ["through the origin", "off it"])
@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc", "table-c-head-b"])
@pytest.mark.parametrize("kind", ["cross", "cuboid", "sphere"])
def test_readings_and_exact_derivatives_agree(preset: str, kind: str, where: str) -> None:
    """With every effect of the catalogue at once, on faces, over edges and into corners."""
    rng = np.random.default_rng(len(preset) + len(kind))
    artefact = forward.Artefact(kind, diameter_mm=22.0, centre_mm=(20.0, -10.0, 60.0))
    twin_setup = replace(TWIN, preset=preset, artefact=artefact, probe_length_mm=140.0, tick_um=0.1)
    if where == "off it":
        twin_setup = generator.stand_off(rng, twin_setup)
    setup = from_twin.setup(twin_setup)
    known = {info.id for info in catalogue(setup)}
    ids = [id_ for id_ in EFFECTS if id_ in known]
    effects = {
        id_: {**dict.fromkeys(EFFECTS[id_], 0.0), **values}
        for id_, values in generator.random_effects(rng, share=1.0).items()
        if id_ in ids
    }
    truth = Truth(
        generator.random_errors(rng, preset, 20, 20), generator.random_placement(rng, 20, 20)
    )
    plan = generator.random_touches(rng, twin_setup, 300, reach_mm=1.0)
    data = from_twin.touches(generator.measure(plan, twin_setup, truth, noise_um=0.3))
    flat = {f"{id_}.{name}": v for id_, values in effects.items() for name, v in values.items()}
    values = {**truth.errors, **truth.placement, **flat}
    residuals, jacobian, names = casadi_baseline.linearise(data, setup, values, effects=ids)

    model = TouchModel(setup, ids)
    vector = model.values(truth.errors, truth.placement, effects)
    own, slope = model.core.linearise(model.moves(data), vector)
    assert np.abs(own - residuals).max() < 1e-7
    columns = [model.names.index(name) for name in names]
    scale = np.maximum(1.0, np.abs(jacobian).max(axis=0))
    assert np.abs((slope[:, columns] + jacobian) / scale).max() < 1e-9
    assert set(model.names) - set(names) <= {"setup_shift.t0_s"}


def same(one: Any, other: Any) -> None:
    assert one.converged
    assert other.converged
    assert one.errors == pytest.approx(other.errors, abs=AGREE)
    assert one.placement == pytest.approx(other.placement, abs=AGREE)
    for id_, values in other.effects.items():
        assert one.effects[id_] == pytest.approx(values, abs=AGREE)
    assert one.residuals_um == pytest.approx(other.residuals_um, abs=AGREE)
    for name, std in other.std_errors.items():
        assert one.std_errors[name] == pytest.approx(std, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("ids", SETS, ids="+".join)
def test_estimates_agree_on_noisy_readings(ids: tuple[str, ...], seed: int) -> None:
    rng = np.random.default_rng(seed)
    plan = PLANS["rich" if ids else ("paper", "rich")[seed % 2]]
    effects = {
        id_: {n: 5 * v for n, v in generator.random_effect(rng, id_, plan).items()} for id_ in ids
    }
    truth = Truth(generator.random_errors(rng), generator.random_placement(rng), effects)
    sigma = (0.0, 0.4)[seed % 2]
    setup = Setup(Artefact("cross"), probe=Probe(repeatability_um=sigma, tick_um=0.1))
    data = from_twin.touches(generator.measure(plan, TWIN, truth, noise_um=0.4, seed=seed))
    same(identify(data, setup, effects=ids), casadi_baseline.identify(data, setup, effects=ids))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("ids", [("setup_shift",), ("warmup_z",)], ids="+".join)
def test_times_inside_an_effect_agree(ids: tuple[str, ...], seed: int) -> None:
    rng = np.random.default_rng(seed)
    plan = PLANS["rich"]
    effects = {
        id_: {
            n: v if n in ("t0_s", "tau_min") else 4 * v
            for n, v in generator.random_effect(rng, id_, plan).items()
        }
        for id_ in ids
    }
    truth = Truth(generator.random_errors(rng), generator.random_placement(rng), effects)
    data = from_twin.touches(generator.measure(plan, TWIN, truth, noise_um=0.2, seed=seed))
    setup = Setup(Artefact("cross"), probe=Probe(tick_um=0.1))
    one = identify(data, setup, effects=ids)
    other = casadi_baseline.identify(data, setup, effects=ids)
    same(one, other)


@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc"])
@pytest.mark.parametrize("seed", range(4))
def test_cuboids_edges_and_other_machines_agree(preset: str, seed: int) -> None:
    """On odd seeds the tilting axis misses the origin and the artefact stands off centre."""
    rng = np.random.default_rng(seed)
    twin_setup = replace(TWIN, preset=preset, artefact=forward.Artefact("cuboid"), tick_um=0.1)
    if seed % 2:
        twin_setup = generator.stand_off(rng, twin_setup)
    plan = generator.random_touches(rng, twin_setup, 250, reach_mm=1.0)
    truth = Truth(
        generator.random_errors(rng, preset, 20, 20), generator.random_placement(rng, 20, 20)
    )
    data = from_twin.touches(generator.measure(plan, twin_setup, truth, noise_um=0.3, seed=seed))
    setup = from_twin.setup(twin_setup)
    same(identify(data, setup), casadi_baseline.identify(data, setup))


def test_what_one_calls_not_identifiable_the_other_does_too() -> None:
    rng = np.random.default_rng(5)
    truth = Truth(generator.random_errors(rng), generator.random_placement(rng))
    for id_ in EFFECTS:
        if id_ in ("setup_shift", "warmup_z"):
            continue
        data = from_twin.touches(generator.measure(PLANS["paper"], TWIN, truth, noise_um=0.3))
        setup = Setup(Artefact("cross"), probe=Probe(tick_um=0.1))
        one = identify(data, setup, effects=(id_,))
        other = casadi_baseline.identify(data, setup, effects=(id_,))
        not_found = {name for name, std in other.std_errors.items() if np.isinf(std)}
        found = {name for name, std in one.std_errors.items() if np.isinf(std)}
        # The core judges where the fit starts, the baseline at its estimate, where offsets of the
        # placement are dragged along by products with the errors (a twist turns rc, with it dx).
        assert found <= not_found, id_
        assert not_found - found <= {"dx_um", "dy_um"}, id_
