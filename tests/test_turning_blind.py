"""Hidden causes of diameter errors are found: a seeded sample of ``turning_blind.py``.

The whole table is in docs/power-turning.md: 95 % are asked for, with one cause and with two. Wear
beside a heating tool is a case of its own: one to three passes from a cold tool leave it in doubt,
and one more with a warm tool does not.
"""

import pytest

from turning_blind import draw, outcome

GOOD = {"found", "alternative"}


@pytest.mark.parametrize("passes", [2, 3])
def test_no_cause_no_alarm(passes: int) -> None:
    results = [outcome(seed, (), passes) for seed in range(3)]
    assert results.count("alarm") <= 1, results


@pytest.mark.parametrize(("how_many", "passes", "runs"), [(1, 2, 8), (2, 3, 8)])
def test_hidden_causes_are_named_or_among_the_alternatives(
    how_many: int, passes: int, runs: int
) -> None:
    results = [outcome(seed, draw(seed, how_many), passes) for seed in range(runs)]
    assert sum(result in GOOD for result in results) >= runs - 1, results


@pytest.mark.parametrize("passes", [2, 3])
def test_wear_beside_a_heating_tool_is_never_left_out(passes: int) -> None:
    both = ("tool_heating", "tool_wear")
    results = [outcome(seed, both, passes) for seed in range(6)]
    assert sum(result in GOOD for result in results) >= 5, results
    assert "missed" not in results
    warm = [outcome(seed, both, 2, warm=True) for seed in range(3)]
    assert warm.count("found") >= 2, warm
