"""What no reading of a measurement distinguishes from a named cause is said with it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import trunnion as tn
from power.measured_twin import make_points
from power.pairs import bar, stops, touches
from power.study import ground

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
