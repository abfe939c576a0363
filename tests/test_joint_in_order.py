"""Measurements of several kinds are in the order of time: a change is in all that follow it."""

import re
from itertools import permutations

import numpy as np
import pytest

import trunnion as tn
from test_joint_agreement import circle, plate, stops
from trunnion.files.table import Table

SQUARE = 1e-9  # µm/m²: no bow
Rng = np.random.Generator


def out_of_square(rng: Rng, arcsec: float) -> tn.Points:
    """A plate that a machine drilled whose Y axis leans."""
    made = plate(rng, 150.0, 0.0, SQUARE)
    leans = made["nominal_y_mm"] * np.radians(arcsec / 3600)
    return made.with_columns(x_mm=made["x_mm"] - leans)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_circle_after_a_change_does_not_contradict_what_was_before(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, after = out_of_square(rng, 8.0), out_of_square(rng, 12.0)
    last = circle(rng, (0, 0), (0, 0), 12.0)
    d = tn.diagnose([before, after, last])
    assert d.verdict in ("explained", "ambiguous")
    assert {"squareness_xy", "points 2:change_squareness_xy"} <= d.named
    assert d.effects["squareness_xy"]["arcsec"] == pytest.approx(8.0, abs=0.5)
    change = next(iter(d.effects["points 2:change_squareness_xy"].values()))
    assert change == pytest.approx(4.0, abs=0.5)
    assert any("in the order of time" in note for note in d.notes)
    first = tn.diagnose([circle(rng, (0, 0), (0, 0), 8.0), before, after])
    assert {"squareness_xy", "points 2:change_squareness_xy"} <= first.named


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_a_run_after_a_backlash_was_made_smaller_agrees(seed: int) -> None:
    rng = np.random.default_rng(seed)
    dates = [circle(rng, (0, 0), (0, um), 0.0) for um in (6.0, 2.0)]
    d = tn.diagnose([*dates, stops(rng, "y", 0.0, 2.0)])
    assert not any("differs" in cause for cause in d.named)
    assert {"backlash_y", "ballbar 2:change_backlash_y"} <= d.named
    assert d.effects["backlash_y"]["b_um"] == pytest.approx(6.0, abs=0.4)
    none = tn.diagnose([*dates[:1], stops(rng, "y", 0.0, 6.0)])
    assert none.named == {"backlash_y"}
    assert not any("in the order of time" in note for note in none.notes)


def test_a_location_error_that_changed_stays_so_in_touches_alone() -> None:
    """A circle after it has no location errors; what to measure next adds one."""
    setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    plan = tn.plan(setup)
    before, after = (
        tn.simulate(plan, setup, {"EX0C": um}, noise_um=0.3, seed=seed)
        for seed, um in enumerate((0.0, 6.0))
    )
    last = circle(np.random.default_rng(7), (0, 0), (0, 0), 0.0)
    d = tn.diagnose([before, after, last], setup)
    assert any("touches 2:change_EX0C" in causes for causes in d.alternatives)
    ambiguous = tn.diagnose([before, after], setup)
    assert len(ambiguous.alternatives) > 1
    assert any(one.kind == "ballbar" for one in tn.next_measurement(ambiguous, setup))


def measured(kind: str, rng: Rng, ppm: float, lost: float) -> Table:
    """One of a machine whose X axis has a scale of ppm and loses µm at a reversal."""
    if kind == "circle":
        return circle(rng, (ppm, 0), (lost, 0), 0.0)
    if kind == "run":
        return stops(rng, "x", ppm, lost)
    if kind == "points":
        return plate(rng, 150.0, 0.0, SQUARE, (ppm, 0.0))
    setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    wrong = {"scale_x": {"ppm": ppm}, "backlash_x": {"b_um": lost}}
    return tn.simulate(
        tn.plan(setup), setup, effects=wrong, noise_um=0.3, seed=int(rng.integers(1000))
    )


KINDS = ("circle", "run", "points", "touches")


@pytest.mark.parametrize(("one", "other"), list(permutations(KINDS, 2)))
def test_a_change_is_named_with_another_kind_between_two_of_one(one: str, other: str) -> None:
    """Targets of a run are compared with those of runs alone; all others are at other places."""
    setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    for seed in range(2):
        rng = np.random.default_rng([71, seed])
        kinds, now = (one, other, one), ((0.0, 3.0), (0.0, 3.0), (60.0, 0.0))
        data = [measured(kind, rng, *wrong) for kind, wrong in zip(kinds, now, strict=True)]
        d = tn.diagnose(data, setup)
        assert any(re.search(r" 2:change_(scale|backlash)_x", cause) for cause in d.named)
