"""The judge of rates judges as it says."""

import numpy as np
import pytest

from promise import DROP, POWER, RISK, kept, needed_runs


@pytest.mark.parametrize("promise", [0.9, 0.95, 0.97, 0.99])
def test_a_promise_is_held_and_a_drop_is_seen(promise: float) -> None:
    runs = needed_runs(promise)
    rng = np.random.default_rng(1)
    as_promised = rng.binomial(runs, promise, 4000)
    dropped = rng.binomial(runs, promise - DROP, 4000)
    # Three standard errors of a share counted 4000 times.
    assert np.mean([not kept(int(n), runs, promise) for n in as_promised]) < RISK + 0.005
    assert np.mean([not kept(int(n), runs, promise) for n in dropped]) > POWER - 0.015


def test_too_few_runs_are_refused() -> None:
    with pytest.raises(AssertionError, match="12 runs hold nothing of a promise of 95%"):
        kept(12, 12, 0.95)
