"""Hidden causes of diameter errors are found: a seeded sample of ``turning_blind.py``.

The whole table: ``python tests/turning_blind.py 200``. With one cause the rate asked for is 95 %,
with two 95 %; wear beside a heating tool is not told from a weaker heating tool by any pass, and
that pair is the part of the rest that stays.
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
