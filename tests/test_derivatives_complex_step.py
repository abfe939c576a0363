"""The core's derivatives against the complex step in the twin: exact to rounding, no difference.

A parameter moved by ih moves the gap between ball and artefact by an imaginary part that is h times
its derivative; how far the reading moves follows from the slope of the gap along the approach.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import from_twin
from trunnion.probing.model import TouchModel, catalogue
from twin import forward, generator
from twin.contact import Ball, Box, Solid, solids, way_to_contact
from twin.forward import EFFECTS, PLACEMENT, Lines, Truth

H = 1e-30
Complex = NDArray[np.complex128]


def gap(lines: Lines, solid: Solid, way: Complex) -> Complex:
    """Distance of the ball from a part that it does not cut; signs are those of real parts."""
    points = lines.start + way[:, None] * lines.step
    if isinstance(solid, Ball):
        away = points - solid.centre
    else:
        assert isinstance(solid, Box)
        cos, sin = np.cos(solid.turned), np.sin(solid.turned)
        local = points @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        local = local - np.array([0.0, 0.0, 1.0]) * solid.half
        beyond = np.where(local.real < 0, -local, local) - solid.half
        away = np.where(beyond.real > 0, beyond, 0)
    length = np.sqrt(np.sum(away * away, axis=1))
    if isinstance(solid, Ball):
        length = length - solid.radius
    return np.asarray(length - lines.radius, dtype=complex)


def rates(real: Lines, way: Complex, moved: Lines) -> Complex:
    """Derivative of the way to contact; in ``moved`` a parameter has iH added."""
    parts = [
        (gap(real, still, way), gap(moved, solid, way), gap(real, still, way + 1j * H))
        for still, solid in zip(solids(real.artefact), solids(moved.artefact), strict=True)
    ]
    touched = np.argmin([at.real for at, _, _ in parts], axis=0)
    change = np.choose(touched, [by.imag for _, by, _ in parts])
    slope = np.choose(touched, [along.imag for _, _, along in parts])
    return np.asarray(-change / slope)


def shifted(truth: Truth, name: str) -> Truth:
    """Truth with the parameter moved by iH."""
    shift: Any = 1j * H
    id_, _, parameter = name.partition(".")
    if parameter:
        values = {**truth.effects[id_], parameter: truth.effects[id_][parameter] + shift}
        return replace(truth, effects={**truth.effects, id_: values})
    if name in PLACEMENT:
        return replace(truth, placement={**truth.placement, name: truth.placement[name] + shift})
    return replace(truth, errors={**truth.errors, name: truth.errors[name] + shift})


@pytest.mark.parametrize("where", ["through the origin", "off it"])
@pytest.mark.parametrize("kind", ["cross", "cuboid", "sphere"])
@pytest.mark.parametrize("preset", ["trt-ca", "trt-bc", "table-c-head-b"])
def test_derivatives_are_those_of_the_complex_step(preset: str, kind: str, where: str) -> None:
    rng = np.random.default_rng([len(preset), len(kind), len(where)])
    artefact = forward.Artefact(kind, diameter_mm=22.0, centre_mm=(20.0, -10.0, 60.0))
    twin = forward.Setup(preset=preset, artefact=artefact, probe_length_mm=140.0)
    if where == "off it":
        twin = generator.stand_off(rng, twin)
    setup = from_twin.setup(twin)
    known = [info.id for info in catalogue(setup)]
    ids = [id_ for id_ in EFFECTS if id_ in known]
    drawn = generator.random_effects(rng, share=1.0)
    effects = {id_: {**dict.fromkeys(EFFECTS[id_], 0.0), **drawn[id_]} for id_ in ids}
    truth = Truth(
        generator.random_errors(rng, preset, 20, 20),
        generator.random_placement(rng, 20, 20),
        effects,
    )
    plan = generator.random_touches(rng, twin, 200, reach_mm=1.0)
    data = from_twin.touches(generator.measure(plan, twin, truth, noise_um=0.0, tick_um=0.0))
    model = TouchModel(setup, ids)
    residuals, slope = model.core.linearise(
        model.moves(data), model.values(truth.errors, truth.placement, effects)
    )
    assert np.abs(residuals).max() < 1e-6

    def lines(truth: Truth) -> Lines:
        return forward.approach_lines(plan.conditions, plan.start_mm, twin, truth)

    real = lines(truth)
    way = way_to_contact(real).astype(complex)
    names = [name for name in model.names if name != "setup_shift.t0_s"]
    assert len(names) > 30
    for name in names:
        # µm of reading per µm, arcsec, ppm ... of the parameter
        moved = lines(shifted(truth, name))
        exact = rates(real, way, moved) * 1e3
        ours = slope[:, model.names.index(name)]
        scale = max(1.0, float(np.abs(exact).max()))
        assert np.abs(ours - exact).max() < 1e-9 * scale, name
