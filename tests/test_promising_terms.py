"""Which terms of structure compete with causes."""

from typing import Any

import pytest

import trunnion as tn
from power.one_machine import drawn
from trunnion.diagnosis import explain, terms

ALL = ("touches", "ballbar", "axislog", "positioning")


@pytest.fixture
def picked(monkeypatch: pytest.MonkeyPatch) -> list[set[str]]:
    """Quantities of the terms that compete in each call."""
    found: list[set[str]] = []

    def promising(case: Any, *given: Any, **more: Any) -> list[int]:
        own = terms.promising(case, *given, **more)
        found.append({case.dictionary.term(i).covariate for i in own})
        return own

    monkeypatch.setattr(explain, "promising", promising)
    return found


def test_what_shows_nothing_in_its_measurement_competes_with_no_cause(
    picked: list[set[str]],
) -> None:
    made = drawn(ALL, 1, 11)  # an unknown error in the lengths of the ball-bar alone
    found = tn.diagnose(made.data, made.setup)
    assert found.verdict == "unexplained"
    names = set.union(*picked)
    assert any(name.endswith("of ballbar") for name in names)
    assert not any(name.endswith("of axislog") for name in names)


@pytest.mark.parametrize(("seed", "number"), [(11, 1), (11, 2), (12, 1), (19, 0), (20, 2), (21, 0)])
def test_structure_that_causes_imitate_competes_with_them(seed: int, number: int) -> None:
    made = drawn(("ballbar", "ballbar"), number, seed)
    assert made.unknown
    for data in made.data:
        found = tn.diagnose(data, made.setup)
        sure = {c.id for c in found.causes if c.probability > 0.95}
        assert sure <= made.shared | set.union(*map(set, made.own.values()))
