"""The decision rule of ISO 14253-1 against the probability of conformity, from the error function.

With both limits in reach the probability that a value conforms has both tails: a guard band for one
of them would pass what conforms with 90 % only.
"""

from math import erf, inf, nan, sqrt

import numpy as np
import pytest

from trunnion.base.conformity import Conformity, Decision, decide
from trunnion.base.errors import InputError


def conforming(value: float, std: float, lower: float, upper: float) -> float:
    """Probability that a quantity lies within its limits."""
    below, above = (erf((limit - value) / (std * sqrt(2.0))) for limit in (lower, upper))
    return (above - below) / 2


@pytest.mark.parametrize("probability", [0.8, 0.95, 0.99])
def test_what_passes_conforms_with_that_probability_and_what_fails_does_not(
    probability: float,
) -> None:
    rng = np.random.default_rng(14253)
    seen = set()
    for _ in range(3000):
        std = float(rng.uniform(0.05, 1.0))
        lower = float(rng.uniform(-3.0, 0.0))
        upper = lower + float(rng.uniform(0.5, 6.0))
        value = float(rng.uniform(lower - 2.0, upper + 2.0))
        found = decide(value, std, upper=upper, lower=lower, probability=probability)
        inside = conforming(value, std, lower, upper)
        assert (found is Decision.PASS) == (inside >= probability)
        if found is Decision.FAIL:
            assert 1 - inside >= probability
        seen.add(found)
    assert seen == {*Decision}


@pytest.mark.parametrize("std", [nan, -1.0, -inf])
def test_an_uncertainty_that_is_none_decides_nothing(std: float) -> None:
    said = f"standard uncertainty: got {std:g}, expected 0 or above"
    with pytest.raises(InputError, match=f"^EX0C: {said}"):
        Conformity.of({"EX0C": 1.0}, {"EX0C": std}, {"EX0C": 5.0})
    with pytest.raises(InputError, match=f"^{said}"):
        decide(1.0, std, upper=5.0)


@pytest.mark.parametrize("value", [nan, inf])
def test_a_value_that_is_none_is_not_judged(value: float) -> None:
    with pytest.raises(InputError, match=f"EX0C: value: got {value:g}, expected a finite number"):
        Conformity.of({"EX0C": value}, {"EX0C": 1.0}, {"EX0C": 5.0})


def test_one_limit_alone_has_the_factor_of_one_tail() -> None:
    for k, expected in ((1.644, "undecided"), (1.646, "pass")):
        assert decide(10.0 - k, 1.0, upper=10.0) == expected
        assert decide(10.0 - k, 1.0, upper=10.0, lower=-inf) == expected
    assert decide(10.0 + 1.646, 1.0, upper=10.0) is Decision.FAIL


def test_a_tolerance_about_as_wide_as_its_uncertainty_is_kept_by_nothing() -> None:
    """In the middle of ±T the factor is 1.960."""
    for tolerance, expected in ((1.95, "undecided"), (1.97, "pass")):
        found = Conformity.of({"EX0C": 0.0}, {"EX0C": 1.0}, {"EX0C": tolerance})
        assert found.decision == expected
    (judged,) = found.judged
    assert 1.645 < judged.guard < 1.96
    # the size that just passes conforms with 95 %
    assert conforming(1.97 - judged.guard, 1.0, -1.97, 1.97) == pytest.approx(0.95, abs=1e-9)
    (certain,) = Conformity.of({"EX0C": 1.0}, {"EX0C": 0.0}, {"EX0C": 1.0}).judged
    assert certain.decision is Decision.PASS
    assert certain.guard == 0.0
    assert Conformity.of({"EX0C": 0.0}, {"EX0C": inf}, {"EX0C": 9.0}).decision == "undecided"
