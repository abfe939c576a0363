"""What no reading of a measurement distinguishes from a named cause is said with it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import trunnion as tn
from power.measured_twin import make_points
from power.pairs import bar, stops, touches
from power.study import ground
from test_joint_agreement import plate
from test_joint_agreement import stops as run

ALL_AXES = "axes that are all wrong by the same share"
Rng = np.random.Generator
MADE: dict[str, Callable[[Rng], object]] = {
    "ballbar_length": lambda rng: bar(rng, 0.0, 3.0),
    "artefact_expansion": lambda rng: touches(rng, {"artefact_expansion": {"ppm": 60.0}}, "rich"),
    "expansion": lambda _: tn.Points(**make_points(7, ("expansion",)).columns),
}


@pytest.mark.parametrize("cause", MADE)
def test_a_wrong_length_may_be_that_of_all_axes(cause: str) -> None:
    data = MADE[cause](np.random.default_rng(41))
    d = tn.diagnose(data, ground("rich")[3] if cause == "artefact_expansion" else None)
    assert cause in d.named
    assert [ALL_AXES in note for note in d.notes].count(True) == 1


def test_nothing_is_said_where_nothing_is_named_or_an_axis_was_measured() -> None:
    rng = np.random.default_rng(42)
    assert not any(ALL_AXES in note for note in tn.diagnose(bar(rng, 0.0, 0.0)).notes)
    joint = tn.diagnose([bar(rng, 0.0, 3.0), stops(rng, "x", {})])
    assert joint.named == {"ballbar:ballbar_length"}
    assert not any(ALL_AXES in note for note in joint.notes)


@pytest.mark.parametrize("count", [2, 3])
def test_parts_that_are_all_larger_may_be_of_a_warm_machine(count: int) -> None:
    """Two: an expansion of each is named; three: both scales. Neither is known."""
    rng = np.random.default_rng(43)
    parts = [plate(rng, 150.0, 0.0, 1e-9, (25.0, 25.0)) for _ in range(count)]
    d = tn.diagnose(parts)
    (said,) = (note for note in d.notes if "do not distinguish" in note)
    assert "A positioning run of one axis" in said
    assert (ALL_AXES in said) == ("points:expansion" in d.named)
    for more in ([run(rng, "x", 25.0, 0.0)], [run(rng, "x", 0.0, 0.0)]):
        assert not any("do not distinguish" in note for note in tn.diagnose([*parts, *more]).notes)
    unlike = [plate(rng, 150.0, 0.0, 1e-9, (25.0, 5.0)) for _ in range(3)]
    assert not any("do not distinguish" in note for note in tn.diagnose(unlike).notes)
