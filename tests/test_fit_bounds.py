"""A fit whose parameters have bounds leaves no more than it begins with, its sizes within them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

import turning_blind
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.fit import fit
from trunnion.diagnosis.plain import case_of
from trunnion.models.kinds import model_of

HIDDEN = ("tool_heating", "barrel", "bending")
FITTED = ("bending", "chuck_tilt", "tool_heating")


@pytest.mark.parametrize("seed", range(8))
def test_causes_of_one_sign_beside_a_time_constant(seed: int) -> None:
    """Non-negative least squares at any one time constant leaves no less."""
    data, setup = turning_blind.measured(seed, HIDDEN, 2, left=(30.0, 20.0, 15.0))
    model = model_of(data, setup)
    case = case_of(model)
    effects = [model.effect(name) for name in FITTED]
    tau = model.effect("tool_heating").parameters[1]
    start = {e.id: Values((p.name, 0.0) for p in e.parameters) for e in effects}
    start["tool_heating"]["tau_s"] = tau.grid[-1]
    nuisance = case.plain.nuisance
    signed, other, heats = (
        np.asarray(case.whiten(model.effect_jacobian(nuisance, e, start[e.id]))) for e in effects
    )
    free = np.column_stack([case.whiten(model.jacobian(nuisance, {})), heats[:, 0]])
    y = np.asarray(case.whiten(case.plain.residuals))
    most = nnls(np.column_stack([signed, other, free, -free]), y)[1] ** 2
    found = fit(model, case.rows, effects, nuisance, start, case.whiten)
    left = np.asarray(case.whiten(found.residuals))
    assert min(found.effects["bending"]["tip_um"], found.effects["chuck_tilt"]["tip_um"]) >= 0.0
    assert float(left @ left) <= most * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_a_fit_at_a_bound_explains_only_what_its_values_do(seed: int) -> None:
    """What a step beyond the longest time constant would explain is left."""
    data, setup = turning_blind.measured(seed, HIDDEN, 2, left=(30.0, 20.0, 15.0))
    model = model_of(data, setup)
    case = case_of(model)
    heats = model.effect("tool_heating").within_grids()
    grid = heats.parameters[1].grid
    start = {heats.id: Values(amplitude_um=0.0, tau_s=grid[-1])}
    found = fit(model, case.rows, [heats], case.plain.nuisance, start, case.whiten)
    left = np.asarray(case.whiten(found.residuals))
    assert min(grid) <= found.effects[heats.id]["tau_s"] <= max(grid)
    assert found.rss == pytest.approx(float(left @ left), rel=1e-3)
