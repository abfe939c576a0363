"""Readings of one direction scatter more than those of another: no cause, no outliers."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from power.study import ground
from promise import kept, needed_runs
from trunnion.base.units import Floats
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

NOISE_UM = np.array([0.4, 0.4, 1.6])
"""Each axis repeats by its own: a touch feels the part along its approach."""
CONSISTENT = 0.95


def noisy(exact: tn.Touches, rng: np.random.Generator) -> tn.Touches:
    """Touches with independent noise of the axes, mm."""
    columns = {name: np.asarray(exact[name]) for name in exact.columns}
    along = np.stack([columns[f"dir_{a}"] for a in "xyz"], axis=1)
    moved = np.sum(along * rng.normal(0.0, 1e-3 * NOISE_UM, along.shape), axis=1)
    return tn.Touches(
        columns | {f"{a}_mm": columns[f"{a}_mm"] + moved * along[:, i] for i, a in enumerate("xyz")}
    )


@cache
def studied() -> list[tuple[tn.Diagnosis, dict[str, float]]]:
    """Diagnoses of machines with nothing hidden, and their location errors."""
    made, setup, _, read = ground("paper")
    found = []
    for seed in range(needed_runs(CONSISTENT)):
        rng = np.random.default_rng([seed, 23])
        truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects={})
        measured = measure(made, setup, truth, noise_um=0.0, tick_um=0.0, seed=seed)
        touches = noisy(tn.Touches(measured.columns), rng)
        found.append((tn.diagnose(touches, read), dict(truth.errors)))
    return found


def test_scatter_by_direction_is_taken_for_no_cause() -> None:
    good = [d.verdict == "consistent" for d, _ in studied()]
    assert kept(sum(good), len(good), CONSISTENT)


def test_uncertainties_are_those_of_the_direction() -> None:
    z: Floats = np.array(
        [
            [(d.errors_after[name] - true) / d.errors_std[name] for name, true in errors.items()]
            for d, errors in studied()
        ]
    )
    assert np.mean(np.abs(z) < 2) > 0.9  # by one noise for all: 0.63
    quiet = np.median([d.errors_std["EX0C"] for d, _ in studied()])
    loud = np.median([d.errors_std["EZ0A"] for d, _ in studied()])
    assert quiet < 0.6 * loud


@pytest.mark.parametrize("method", [tn.identify, tn.closed_form])
def test_estimates_allow_for_the_scatter_of_each_direction(method: Any) -> None:
    z = []
    for seed in range(60):
        rng = np.random.default_rng([seed, 29])
        made, setup, _, read = ground("paper")
        truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects={})
        measured = measure(made, setup, truth, noise_um=0.0, tick_um=0.0, seed=seed)
        fit = method(noisy(tn.Touches(measured.columns), rng), read)
        z += [(fit.errors[k] - true) / fit.std_errors[k] for k, true in truth.errors.items()]
    assert np.mean(np.abs(z) < 2) > 0.88  # by one noise for all: 0.81


def test_what_each_direction_scatters_is_said() -> None:
    said = [n for d, _ in studied() for n in d.notes if n.startswith("Readings scatter")]
    assert len(said) > 0.8 * len(studied())
    assert all("X" in n and "Y" in n and "Z" in n for n in said)


def test_a_level_that_rolls_more_than_it_pitches() -> None:
    rng = np.random.default_rng(4)
    place = np.arange(0.0, 1000.0, 25.0)
    data = {
        "position_mm": place,
        "along_um_m": rng.normal(0.0, 1.0, len(place)),
        "across_um_m": rng.normal(0.0, 6.0, len(place)),
    }
    found = tn.diagnose(tn.Levels(data))
    assert found.verdict == "consistent"
    (note,) = (n for n in found.notes if n.startswith("Readings scatter"))
    assert "along" in note
