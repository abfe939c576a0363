"""A large wave on a plate is structure of its own, no error that neighbouring features share."""

import numpy as np
import pytest

import trunnion as tn

NOISE_UM = 0.5


def plate(seed: int, count: int, step_mm: float, size_um: float, period_mm: float) -> tn.Points:
    """A square grid measured in random order; X has a wave along Y."""
    rng = np.random.default_rng(seed)
    x, y = (a.ravel() for a in np.meshgrid(*[np.arange(count) * step_mm] * 2))
    order = rng.permutation(len(x))
    x, y = x[order], y[order]
    wave = size_um * np.sin(2 * np.pi * y / period_mm + rng.uniform(0, 6.28))
    noise = NOISE_UM * rng.standard_normal((2, len(x)))
    turn = rng.normal(0.0, 5e-5)
    return tn.Points(
        nominal_x_mm=x,
        nominal_y_mm=y,
        x_mm=x + 1e-3 * (wave + noise[0]) - turn * y + 0.013,
        y_mm=y + 1e-3 * noise[1] + turn * x - 0.021,
        time_s=20.0 * np.arange(len(x)),
    )


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
