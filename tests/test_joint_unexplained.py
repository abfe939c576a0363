"""What no cause makes of one measurement says nothing of another that is diagnosed with it."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import axis

SOUND = range(24)
AT_MOST = 2  # of these with causes at a level of 2 %; 3 or more with a probability of 1 %


def stops(rng: np.random.Generator, name: str, *, hump: float = 0.0, b: float = 0.0) -> object:
    """Stops of an axis with a hump in the order of measurement and a reversal, µm."""
    made = axis(rng, noise=0.3)
    at = np.linspace(0.0, 1.0, len(made))
    change = hump * np.exp(-0.5 * ((at - 0.5) / 0.12) ** 2) + b * made.direction
    return made.with_columns(
        measured_mm=made.measured + 1e-3 * change, axis=np.full(len(made), name)
    )


def test_a_hump_of_one_axis_makes_no_cause_of_another() -> None:
    named = []
    for seed in SOUND:
        rng = np.random.default_rng([56, seed])
        d = tn.diagnose([stops(rng, "X", hump=8.0), stops(rng, "Y")])
        assert d.verdict == "unexplained"
        named.append(d.named)
    assert sum(map(bool, named)) <= AT_MOST, named


@pytest.mark.parametrize("seed", range(3))
def test_a_cause_beside_a_hump_of_another_axis_is_as_certain_as_alone(seed: int) -> None:
    rng = np.random.default_rng([57, seed])
    x, y = stops(rng, "X", hump=8.0), stops(rng, "Y", b=0.4)
    alone, joint = tn.diagnose(y), tn.diagnose([x, y])
    assert joint.named == {"backlash_y"}
    (own,), (one,) = alone.causes, joint.causes
    assert abs(one.parameters["b_um"]) == pytest.approx(abs(own.parameters["b_um"]), rel=1e-6)
    assert one.std_errors["b_um"] == pytest.approx(own.std_errors["b_um"], rel=0.1)
