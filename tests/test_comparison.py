"""All methods beside each other: who is right, and who can see what."""

from __future__ import annotations

import numpy as np
import pytest

import from_twin
from trunnion.reference.comparison import compare_methods
from twin import forward, generator
from twin.forward import Truth

pytest.importorskip("casadi")


def test_every_method_on_the_papers_touches() -> None:
    rng = np.random.default_rng(1)
    truth = Truth(generator.random_errors(rng), generator.random_placement(rng))
    twin_setup = forward.Setup(tick_um=0.1)
    data = from_twin.touches(generator.measure(generator.paper_plan(), twin_setup, truth))
    compared = compare_methods(data, from_twin.setup(twin_setup), truth.errors)
    assert not compared.refused
    assert len(compared.results) == 4
    best = compared.results["least squares"]
    other = compared.results["least squares, CasADi"]
    assert other.errors == pytest.approx(best.errors, abs=1e-6)
    # A set-up that is off by 100 µm and 100 arcsec is what the printed forms do not know.
    printed = compared.results["closed form, printed"].errors
    assert max(abs(printed[n] - truth.errors[n]) for n in truth.errors) > 5.0
    text = compared.summary()
    assert "estimate − truth" in text
    assert "least squares, CasADi" in text


def test_a_method_that_does_not_fit_the_plan_is_reported() -> None:
    rng = np.random.default_rng(2)
    truth = Truth(generator.random_errors(rng), generator.random_placement(rng))
    twin_setup = forward.Setup(artefact=forward.Artefact("cuboid"))
    plan = generator.rich_plan(twin_setup, step_deg=90.0)
    data = from_twin.touches(generator.measure(plan, twin_setup, truth, tick_um=0.0))
    compared = compare_methods(data, from_twin.setup(twin_setup))
    assert set(compared.refused) == {"closed form, printed", "closed form, separating"}
    assert "closed form, printed: " in compared.summary()
