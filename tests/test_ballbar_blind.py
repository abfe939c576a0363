"""Blind tests: causes hidden by a generator of its own are named, and nothing else is.

`make test` holds the rate of right answers over all cases of a machine together; `make power` the
false alarms and the hidden causes each by itself. The table: docs/results/power-ballbar.md.
"""

import numpy as np
import pytest

from ballbar_study import CARTESIAN, HYBRID, run
from promise import kept, needed_runs

CAUSES = {"hybrid": HYBRID, "cartesian": CARTESIAN}


@pytest.mark.parametrize("kind", CAUSES)
def test_the_answer_is_right(kind: str) -> None:
    """No cause every other time, else every cause in turn."""
    runs = needed_runs(0.95)
    hidden = [cause for c in CAUSES[kind] for cause in (None, c)]
    missed = [o for s in range(runs) if not (o := run(kind, hidden[s % len(hidden)], s)).found]
    assert kept(runs - len(missed), runs, 0.95), missed


@pytest.mark.power
@pytest.mark.parametrize("kind", CAUSES)
def test_a_hidden_cause_is_named_or_in_the_alias_group(kind: str) -> None:
    runs, causes = needed_runs(0.97), CAUSES[kind]
    missed = [o for s in range(runs) if not (o := run(kind, causes[s % len(causes)], s)).found]
    assert kept(runs - len(missed), runs, 0.97), missed


@pytest.mark.power
@pytest.mark.parametrize("kind", CAUSES)
def test_nothing_is_named_without_an_effect(kind: str) -> None:
    runs = needed_runs(0.95)
    alarms = [o for seed in range(runs) if not (o := run(kind, None, seed)).found]
    assert kept(runs - len(alarms), runs, 0.95), alarms


@pytest.mark.parametrize(
    ("kind", "hidden", "names", "size_um"),
    [
        ("cartesian", "backlash", ("b_um",), 3.0),
        ("hybrid", "lost_motion", ("b_um",), 6.0),
        ("hybrid", "screw_cyclic", ("a_um", "b_um"), 2.0),
    ],
)
def test_named_causes_have_their_size(
    kind: str, hidden: str, names: tuple[str, ...], size_um: float
) -> None:
    for seed in range(3):
        found = run(kind, hidden, seed).parameters
        size = np.linalg.norm([found[name] for name in names])
        assert size == pytest.approx(size_um, rel=0.1), seed
