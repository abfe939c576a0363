"""What is another on one of several dates alone, and as before afterwards."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from power.pairs import touches
from power.study import ground
from trunnion.diagnosis.families import HAPPENED, family_of
from trunnion.diagnosis.joint_ids import Happened
from trunnion.models.kinds import model_of

PPM = 1e-6


def run(seed: int, scale_ppm: float, axis: str = "x") -> tn.Positioning:
    """Stops of an axis of this scale that has nothing else."""
    rng = np.random.default_rng([91, seed])
    target = np.tile(np.concatenate([np.linspace(0, 500, 11), np.linspace(500, 0, 11)]), 5)
    noise = 0.3e-3 * rng.standard_normal(len(target))
    return tn.Positioning(
        target_mm=target,
        measured_mm=target * (1 + scale_ppm * PPM) + noise,
        direction=np.tile(np.repeat([1, -1], 11), 5),
        cycle=np.repeat(np.arange(1, 6), 22),
        axis=[axis] * len(target),
    )


@pytest.mark.parametrize("seed", range(4))
def test_a_scale_of_one_date_is_no_change_that_stays_and_no_curve(seed: int) -> None:
    runs = [run(3 * seed + i, ppm) for i, ppm in enumerate((30.0, 41.5, 30.0))]
    found = tn.diagnose(runs)
    assert {"scale_x", "positioning 2:once_scale_x"} <= found.named
    (once,) = (c for c in found.causes if c.id == "positioning 2:once_scale_x")
    assert once["ppm"] == pytest.approx(11.5, abs=4 * once.std_errors["ppm"])
    assert once.label == "scale of the X axis, other in positioning 2 alone"
    assert family_of(once.id) is HAPPENED[Happened.ONCE]


@pytest.mark.parametrize("seed", range(4))
def test_a_location_error_of_one_date_is_not_given_to_the_probe(seed: int) -> None:
    """Where touches come from four sides, the two read alike: neither is said to be sure."""
    setup = ground("paper")[3]
    rng = np.random.default_rng([92, seed])
    errors = tn.identify(touches(rng, {}, "paper"), setup).errors
    other = {**errors, "EX0C": errors["EX0C"] + 4.0}
    dates = [touches(rng, {}, "paper", **one) for one in (errors, other, errors)]
    found = tn.diagnose(dates, setup)
    assert any("touches 2:once_EX0C" in causes for causes in found.alternatives)
    assert found.verdict == "ambiguous"


@pytest.mark.parametrize(("count", "between"), [(2, set()), (4, {"2", "3"})])
def test_only_dates_between_others_can_be_another_alone(count: int, between: set[str]) -> None:
    effects = model_of([run(i, 30.0) for i in range(count)]).effects
    once = {e.id.partition(":")[0] for e in effects if e.id.endswith(":once_scale_x")}
    assert once == {f"positioning {number}" for number in between}


@pytest.mark.parametrize("seed", range(2))
def test_a_run_of_another_axis_between_hides_no_change(seed: int) -> None:
    """X, Y, X, Y is the usual order of work."""
    several = [(30.0, "x"), (10.0, "y"), (45.0, "x"), (10.0, "y")]
    found = tn.diagnose([run(4 * seed + i, *one) for i, one in enumerate(several)])
    assert found.named == {"scale_x", "positioning 3:change_scale_x", "scale_y"}
    assert found.verdict == "explained"


def test_what_no_later_run_sees_changed_or_is_another_alone_alike() -> None:
    found = tn.diagnose([run(1, 30.0), run(2, 45.0), run(3, 10.0, "y")])
    assert found.named == {"scale_x", "positioning 2:change_scale_x", "scale_y"}
    assert found.verdict == "explained"
