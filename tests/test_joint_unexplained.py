"""What no cause makes of one measurement says nothing of another that is diagnosed with it."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import axis
from power.one_machine import drawn
from power.study import ground
from twin.forward import Truth
from twin.generator import Unknown, measure, random_errors, random_placement

SOUND = range(24)
OF_STOPS = {"curve_of_z", "reversal_of_position_of_z", "periodic_of_z", "scale_z", "backlash_z"}
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
    """Nor one of the axis itself that it has not alone."""
    named = []
    for seed in SOUND:
        rng = np.random.default_rng([56, seed])
        x, y = stops(rng, "X", hump=8.0), stops(rng, "Y")
        d = tn.diagnose([x, y])
        assert d.verdict == "unexplained"
        named.append(d.named - {f"positioning:{cause}" for cause in tn.diagnose(x).named})
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


def touches(rng: np.random.Generator) -> tuple[tn.Touches, tn.Setup]:
    """Touches, 0.3 µm of noise, of a machine that errs by steps along Y as no cause does."""
    plan, setup, sizing, read = ground("rich")
    along = plan.start_mm[:, 1] / np.ptp(plan.start_mm[:, 1])
    width = rng.uniform(0.04, 0.08)
    shape = sum(rng.normal() * np.tanh((along - rng.uniform(-0.3, 0.3)) / width) for _ in range(3))
    field = np.zeros((len(plan), 3))
    field[:, int(rng.integers(2))] = shape
    field = sizing.scaled_unknown(field, rng.uniform(0.6, 2.4), beyond=sizing.catalogue)
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng))
    unknown = Unknown("smooth", "y_mm", "x or y", field)
    made = measure(plan, setup, truth, noise_um=0.3, unknown=unknown, seed=int(rng.integers(1000)))
    return tn.Touches(made.columns), read


@pytest.mark.parametrize("seed", range(6))
def test_an_error_along_an_axis_is_said_of_it_and_names_no_cause_of_sound_stops(seed: int) -> None:
    rng = np.random.default_rng([58, seed])
    touched, setup = touches(rng)
    d = tn.diagnose([touched, stops(rng, "Z")], setup)
    assert d.unexplained is not None
    assert " of touches" in d.unexplained
    assert not {i for i in d.named if i.startswith("positioning:") or i in OF_STOPS}, d.named


def test_structure_takes_no_cause_that_touches_name_alone() -> None:
    """A scale of X and a cycle in time; the axis log of the machine says nothing of either."""
    made = drawn(("touches", "axislog"), 0, 23)
    assert made.shared == {"scale_x"}
    assert "scale_x" in tn.diagnose(made.data[0], made.setup).named
    assert "scale_x" in tn.diagnose(made.data, made.setup).named
