"""Hidden causes of diameter errors are found at the rates of docs/results/power-turning.md.

`make test` holds the rate of right answers over all cases together; `make power` each by itself.
Wear beside a heating tool is a case of its own: one to three passes from a cold tool leave it in
doubt, and one more with a warm tool does not.
"""

from collections.abc import Callable

import pytest

from promise import kept, needed_runs
from trunnion.models.kinds import diagnose
from turning_blind import LAWS, Law, Rng, draw, growing, hump, measured, outcome

GOOD = {"quiet", "found", "alternative"}
BOTH = ("tool_heating", "tool_wear")


def rate(good: set[str], results: list[str], promise: float) -> bool:
    return kept(sum(result in good for result in results), len(results), promise)


def answer(seed: int, how_many: int) -> str:
    """None and one cause under two passes or three, two causes under three."""
    return outcome(seed, draw(seed, how_many), 3 if how_many == 2 else 2 + seed % 2)


def test_the_answer_is_right() -> None:
    """No cause, one and two in turn: nothing is named, or what is hidden is among the answers."""
    results = [answer(seed, seed % 3) for seed in range(needed_runs(0.95))]
    assert rate(GOOD, results, 0.95), results


def test_a_smooth_error_of_no_cause_is_no_sum_of_wrong_names() -> None:
    """A cubic along the bar is the sum of a taper, a tilted chuck and a bent bar that cancel."""
    runs = needed_runs(0.95)
    said = [diagnose(*measured(7000 + i, (), 2 + i % 2, unknown=True)).verdict for i in range(runs)]
    assert kept(said.count("unexplained"), runs, 0.95), said


def sure_of_a_wrong_name(
    seed: int, hidden: tuple[str, ...], law: Callable[[Rng], Law], passes: int
) -> bool:
    got = diagnose(*measured(seed, hidden, passes, unknown=law, count=60))
    wrong = [c for c in got.causes if c.id not in hidden]
    return any(c.probability > 0.95 for c in wrong) or bool(got.verdict == "explained" and wrong)


def test_a_smooth_error_may_be_no_sum_of_causes_that_fits_it() -> None:
    """A barrel and a heating tool fit a cubic in time to the noise: it may be either."""
    wrong = [s for s in range(9000, 9012) if sure_of_a_wrong_name(s, (), growing, 2 + s % 2)]
    assert len(wrong) <= 1, wrong


@pytest.mark.power
@pytest.mark.parametrize("law", [growing, hump])
def test_no_smooth_error_is_for_sure_what_it_is_not(law: Callable[[Rng], Law]) -> None:
    runs = needed_runs(0.9)
    seeds = range(9100, 9100 + runs)
    wrong = [s for s in seeds if sure_of_a_wrong_name(s, (), law, 1 + s % 3)]
    assert kept(runs - len(wrong), runs, 0.9), wrong


@pytest.mark.power
@pytest.mark.parametrize("hidden", ["bending", "tool_heating", "chatter"])
def test_nor_is_it_beside_a_cause(hidden: str) -> None:
    runs = needed_runs(0.8)
    laws, seeds = (growing, hump), range(9500, 9500 + runs)
    wrong = [s for s in seeds if sure_of_a_wrong_name(s, (hidden,), laws[s % 2], 2 + s // 2 % 2)]
    assert kept(runs - len(wrong), runs, 0.8), wrong


@pytest.mark.power
def test_it_is_none_beside_a_cause_either() -> None:
    runs, causes = needed_runs(0.9), list(LAWS)
    said = [
        diagnose(*measured(8000 + i, (causes[i % len(causes)],), 2 + i % 2, unknown=True)).verdict
        for i in range(runs)
    ]
    assert kept(said.count("unexplained"), runs, 0.9), said


@pytest.mark.power
@pytest.mark.parametrize("how_many", [0, 1, 2])
def test_the_answer_is_right_of_each_number_of_causes(how_many: int) -> None:
    results = [answer(seed, how_many) for seed in range(needed_runs(0.95))]
    assert rate(GOOD, results, 0.95), results


@pytest.mark.power
def test_wear_beside_a_heating_tool_is_not_left_out() -> None:
    results = [outcome(seed, BOTH, 2 + seed % 2) for seed in range(needed_runs(0.95))]
    assert rate(GOOD, results, 0.95), results
    assert "missed" not in results


@pytest.mark.power
def test_a_pass_with_a_warm_tool_distinguishes_wear_from_heating() -> None:
    results = [outcome(seed, BOTH, 2, warm=True) for seed in range(needed_runs(0.85))]
    assert rate(GOOD, results, 0.95), results
    assert rate({"found"}, results, 0.85), results
