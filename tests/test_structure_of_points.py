"""A wave on a plate is structure of its own: no error that neighbours share, no scatter."""

import numpy as np
import pytest

import trunnion as tn
from power.curves import NOISE_UM, plate


@pytest.mark.parametrize("size_um", [2.0, 4.0])
@pytest.mark.parametrize(
    ("count", "step_mm", "period_mm"), [(13, 20.0, 70.0), (9, 30.0, 97.0), (11, 25.0, 80.0)]
)
def test_the_larger_a_wave_the_surer_it_is(
    count: int, step_mm: float, period_mm: float, size_um: float
) -> None:
    for seed in (1, 2):
        d = tn.diagnose(plate(seed, count, step_mm, size_um, period_mm))
        assert d.verdict == "unexplained"
        assert not d.named
        assert d.structure is not None
        assert d.structure.effect.covariate == "Y position"
        assert d.structure.effect.component == "X"
        period = d.structure.parameters["period_mm"]
        assert period == pytest.approx(period_mm, rel=0.02)
        assert f"period {period:.4g} mm" in (d.unexplained or "")
        size = np.hypot(d.structure.parameters["a_um"], d.structure.parameters["b_um"])
        assert size == pytest.approx(size_um, abs=0.4)
        assert d.sigma == pytest.approx(NOISE_UM, rel=0.2)


@pytest.mark.parametrize("meander", [False, True])
@pytest.mark.parametrize("steps", [2.0, 2.1, 2.3, 2.6])
@pytest.mark.parametrize("count", [9, 13, 25])
def test_a_wave_of_few_steps_is_structure(count: int, steps: float, meander: bool) -> None:
    for seed, size_um in ((1, 2.0), (2, 4.0)):
        d = tn.diagnose(plate(seed, count, 20.0, size_um, 20.0 * steps, meander=meander))
        assert d.verdict == "unexplained"
        assert not d.named
        assert not [note for note in d.notes if note.startswith("Readings scatter")]
        assert d.structure is not None
        assert d.structure.effect.covariate == "Y position"
        assert d.structure.effect.component == "X"
        assert d.sigma == pytest.approx(NOISE_UM, rel=0.2)
        if steps > 2.0:
            period, u = d.structure.parameters["period_mm"], d.structure.std_errors["period_mm"]
            assert period == pytest.approx(20.0 * steps, abs=3 * u)


@pytest.mark.parametrize("count", [8, 13])
def test_rows_that_alternate_have_one_amplitude(count: int) -> None:
    for seed in range(5):
        d = tn.diagnose(plate(seed, count, 20.0, 1.0, 40.0))
        assert d.structure is not None
        assert d.structure.effect.shape == "alternating"
        assert (d.unexplained or "").startswith(
            "the residual depends on Y position (periodic, period 40 mm in X)"
        )
        size, u = d.structure.parameters["a_um"], d.structure.std_errors["a_um"]
        assert size == pytest.approx(1.0, abs=4 * u)
        assert u < 0.1


@pytest.mark.parametrize("meander", [False, True])
def test_a_noisier_direction_stays_scatter(meander: bool) -> None:
    ds = [
        tn.diagnose(plate(seed, 9, 20.0, 0.0, 40.0, meander=meander, noise_um=(1.5, 0.5)))
        for seed in range(20)
    ]
    assert sum(d.verdict == "consistent" for d in ds) >= 16
    assert sum(any(n.startswith("Readings scatter") for n in d.notes) for d in ds) >= 18
