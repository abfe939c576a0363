"""An axis that grows with its recorded temperature, from a bearing that stands anywhere."""

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import axis

STEEL_PPM_K = 11.5
REFERENCE_C = 20.0


def stops(seed: int, ppm_k: float, bearing_mm: float, moves_um_k: float = 0.0) -> tn.Positioning:
    """Stops of an axis in a shop that warms up and cools; what holds the instrument moves, too."""
    rng = np.random.default_rng([66, seed])
    made = axis(rng, noise=0.4)
    hours = np.asarray(made.time_s) / 3600.0
    celsius = 20.4 + np.sin(9.0 * hours + rng.uniform(0.0, 6.28)) + rng.uniform(0.0, 1.5) * hours
    length = made.target - bearing_mm
    longer = length * (1.0 + 1e-6 * ppm_k * (celsius - REFERENCE_C)) - length
    longer += 1e-3 * moves_um_k * (celsius - REFERENCE_C)
    return made.with_columns(measured_mm=made.measured + longer, temperature_c=np.round(celsius, 2))


@pytest.mark.parametrize("bearing_mm", [250.0, 0.0, -100.0, 620.0])
def test_an_expansion_is_named_wherever_the_bearing_is(bearing_mm: float) -> None:
    """About the middle of the stops alone it left what depends on the temperature."""
    off = []
    for seed in range(8):
        data = stops(seed, STEEL_PPM_K, bearing_mm)
        d = tn.diagnose(data)
        assert d.unexplained is None
        cause = next(c for c in d.causes if c.id == "expansion")
        middle = 1e-3 * STEEL_PPM_K * (float(data.target.mean()) - bearing_mm)
        true = {"ppm_k": STEEL_PPM_K, "shift_um_k": middle}
        off += [(cause.parameters[k] - v) / cause.std_errors[k] for k, v in true.items()]
        assert "µm/K" in d.summary()
    assert np.sqrt(np.mean(np.square(off))) < 1.5


def test_what_does_not_grow_is_not_named_so() -> None:
    """A temperature that is recorded is no cause."""
    named = sum("expansion" in tn.diagnose(stops(seed, 0.0, 0.0)).named for seed in range(20))
    assert named <= 1


def test_a_zero_that_moves_with_the_temperature_is_explained() -> None:
    for seed in range(4):
        d = tn.diagnose(stops(seed, 0.0, 0.0, 6.0))
        assert d.unexplained is None
        assert any("expansion" in causes for causes in d.alternatives)


def test_angles_grow_about_the_middle_alone() -> None:
    data = stops(0, STEEL_PPM_K, 0.0)
    turned = tn.Positioning(
        target_deg=data.target,
        measured_deg=data.target + 1e-4 * (data.measured - data.target),
        direction=data.direction,
        cycle=data.cycle,
        temperature_c=data.temperature_c,
    )
    (found,) = (e for e in tn.catalogue(turned) if e.id == "expansion")
    assert [p.name for p in found.parameters] == ["ppm_k"]
