"""What the page of joint diagnoses counts: hidden causes by the names of a joint diagnosis."""

from __future__ import annotations

import trunnion as tn
from power import joint
from power.one_machine import drawn
from trunnion.models.kinds import model_of


def test_hidden_causes_are_called_as_a_joint_diagnosis_calls_them() -> None:
    kinds = ("ballbar", "positioning", "positioning")
    seen: set[str] = set()
    for number in range(12):
        made = drawn(kinds, number, 5)
        ids = {effect.id for effect in model_of(made.data, made.setup).effects}
        hidden = joint.ids_of(made, kinds, ids)
        assert made.shared <= hidden <= ids
        assert len(hidden) >= len(made.shared) + sum(map(len, made.own.values()))
        seen |= hidden
    assert {"positioning:drift", "positioning 2:drift"} <= seen  # of each date
    assert {"scale_x", "backlash_x"} <= seen


def test_shared_causes_are_large_enough_to_be_found() -> None:
    """What is drawn leaves 5 to 50 noises: where nothing else is hidden each is named."""
    kinds, drawn_of_all, named = ("points", "points"), 0, 0
    for number in range(16):
        made = joint.seen(kinds, number, 5)
        if not made.unknown:
            found = tn.diagnose(made.data).named
            drawn_of_all += len(made.shared)
            named += len(made.shared & found)
    assert drawn_of_all >= 8
    assert named >= 0.9 * drawn_of_all
