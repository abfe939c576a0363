"""A sample of docs/results/power-positioning.md: what the catalogue has no formula for."""

import pytest

from power.positioning import ROWS, tally
from promise import kept, needed_runs


@pytest.mark.parametrize(
    "row",
    [
        "axis: pitch of the screw wanders",
        "axis: backlash larger in the middle",
        "axis: lost motion builds up after a reversal",
        "level: bed sags between 4 or 5 supports",
        "level: bed sags between two supports",
        "axis, begun again: zero set again",
        "axis: homed before each cycle",
        "axis: compensation switched before a cycle",
        "axis, begun again: heat diffuses along the screw",
        "level, read again: zero set again",
    ],
)
def test_the_family_is_right_and_nothing_else_is_sure(row: str) -> None:
    runs = needed_runs(0.95)
    found = tally(row, runs, seed=2)
    assert kept(found.right, runs, 0.95)
    assert kept(runs - found.wrong, runs, 0.95)


def test_a_bed_that_a_foot_turns_is_twisted() -> None:
    """Or has a smooth shape: which, a step of the inclination and some noise do not always tell."""
    runs = needed_runs(0.75)
    found = tally("level: one foot turns the bed", runs, seed=2)
    assert kept(found.right, runs, 0.75)
    assert found.wrong == found.missed == 0


@pytest.mark.parametrize("row", [name for name, row in ROWS.items() if row.hidden is None])
def test_nothing_is_said_of_nothing(row: str) -> None:
    runs = needed_runs(0.95)
    assert kept(tally(row, runs, seed=2).right, runs, 0.95)
