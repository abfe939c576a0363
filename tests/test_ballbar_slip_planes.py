"""A slip in one of several planes: the bar shows nothing of it along the axis it does not reach."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn

SLIP_UM = 10.0


def test_a_slip_along_an_axis_that_the_bar_does_not_reach_is_not_identifiable() -> None:
    """It was dy = 210000 ± 330000 µm, in the direction that the fitted centre leaves of the bar."""
    points, senses = [], []
    for (first, second), span in (((0, 1), 360.0), ((1, 2), 220.0), ((2, 0), 220.0)):
        there = np.radians(np.arange(0.0, span + 1.0, 4.0))
        angle = np.r_[there, there[::-1]]
        at = np.zeros((len(angle), 3))
        at[:, first], at[:, second] = 100.0 * np.cos(angle), 100.0 * np.sin(angle)
        points.append(at)
        senses.append(np.repeat([1, -1], len(there)))
    position, sense = np.concatenate(points), np.concatenate(senses)
    slipped = np.arange(len(position)) > len(position) - 100  # in the last plane, ZX
    actual = position - 1e-3 * np.outer(slipped, [SLIP_UM, 0.0, 0.0])
    noise = np.random.default_rng(2).normal(0, 2e-4, len(position))
    x, y, z = position.T
    test = tn.Ballbar(
        setup=np.ones(len(x), int),
        x_mm=x,
        y_mm=y,
        z_mm=z,
        length_mm=np.linalg.norm(actual, axis=1) + noise,
        sense=sense,
    )
    found = tn.diagnose(test)
    (slip,) = [cause for cause in found.causes if cause.id == "setup_shift"]
    assert slip.parameters["dx_um"] == pytest.approx(SLIP_UM, abs=0.3)
    assert slip.std_errors["dx_um"] < 0.1
    assert np.isinf(slip.std_errors["dy_um"])
    assert abs(slip.parameters["dy_um"]) < 1.0
    assert "dy not identifiable" in found.sentences()[0]
