"""Measurements drawn of one machine show what it is in each of them."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from power import one_machine
from twin.generator import random_errors


@pytest.mark.parametrize("kind", sorted(one_machine.SEEN_BY))
def test_measurements_of_one_machine_show_its_errors(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scale that acts in all of them is found in each by itself, in its size."""
    monkeypatch.setattr(one_machine, "OWN_SHARE", 0.0)
    monkeypatch.setattr(one_machine, "UNKNOWN_SHARE", 0.0)
    rng = np.random.default_rng(43)
    errors = random_errors(rng)
    machine = one_machine.Machine(errors, {"scale_x": {"ppm": 60.0}}, seed=44)
    for one in one_machine.MEASURED[kind](machine, rng, 2):
        d = tn.diagnose(one.data, one.setup)
        cause = next(c for c in d.causes if c.id in {"scale", "scale_x"})
        (found,), (std,) = cause.parameters.values(), cause.std_errors.values()
        assert abs(found - 60.0) < 4 * std < 30.0
