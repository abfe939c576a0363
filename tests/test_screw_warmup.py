"""A screw that warms up during a positioning test, and grows from the bearing that holds it."""

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import axis

GROWTH_PPM_K = 11.5  # of steel


def stops(seed: int, warm_k: float, bearing_mm: float, tau_min: float) -> tn.Positioning:
    """Stops of an axis with a reversal of 2 µm; its screw comes to so many kelvin."""
    rng = np.random.default_rng([64, seed])
    made = axis(rng, noise=0.4)
    warmth = warm_k * -np.expm1(-np.asarray(made.time_s) / (60 * tau_min))
    grown = GROWTH_PPM_K * 1e-3 * (made.target - bearing_mm) * warmth  # µm
    change = grown + 1.0 * np.asarray(made.direction)
    return made.with_columns(measured_mm=made.measured + 1e-3 * change)


@pytest.mark.parametrize("bearing_mm", [-60.0, 560.0])
@pytest.mark.parametrize("tau_min", [5.0, 15.0])
def test_a_screw_that_warms_up_is_named_with_its_growth(bearing_mm: float, tau_min: float) -> None:
    off = []
    for seed in range(4):
        data = stops(seed, 1.2, bearing_mm, tau_min)
        d = tn.diagnose(data)
        assert {"reversal", "screw_warmup"} <= d.named
        cause = next(c for c in d.causes if c.id == "screw_warmup")
        assert cause.probability > 0.9
        middle = GROWTH_PPM_K * 1e-3 * (float(np.mean(data.target)) - bearing_mm) * 1.2
        true = {"ppm": GROWTH_PPM_K * 1.2, "amplitude_um": middle, "tau_min": tau_min}
        off += [(cause.parameters[k] - v) / cause.std_errors[k] for k, v in true.items()]
        reversal = next(c for c in d.causes if c.id == "reversal")
        off.append((reversal.parameters["b_um"] - 2.0) / reversal.std_errors["b_um"])
    assert np.sqrt(np.mean(np.square(off))) < 1.6


def test_an_axis_that_only_moves_has_no_screw_that_grows() -> None:
    """The place where it is fixed moves, or nothing does: all targets by as much."""
    named = 0
    for seed in range(12):
        data = stops(seed, 0.0, 0.0, 5.0)
        moved = 4e-3 * -np.expm1(-np.asarray(data.time_s) / 300.0) * (seed % 2)
        named += (
            "screw_warmup"
            in tn.diagnose(data.with_columns(measured_mm=data.measured + moved)).named
        )
    assert named <= 1
