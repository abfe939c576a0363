"""Targets that a control reads back scatter about places; targets that are meant are kept."""

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import HIDDEN, axis
from promise import kept, needed_runs


def read_back(data: tn.Positioning, rng: np.random.Generator, scatter_um: float) -> tn.Positioning:
    """The same stops with targets as the control reads them: the axis moved with them."""
    off = np.round(1e-3 * scatter_um * rng.standard_normal(len(data)), 4)
    return data.with_columns(target_mm=data.target + off, measured_mm=data.measured + off)


@pytest.mark.parametrize("scatter_um", [0.1, 0.4, 2.0])
@pytest.mark.parametrize("cycles", [1, 2, 5])
def test_targets_that_scatter_are_their_places(scatter_um: float, cycles: int) -> None:
    """Each stop is of its place; and the place is called by the one decimal that targets had."""
    called = 0
    for seed in range(20):
        rng = np.random.default_rng([seed, cycles])
        plain = axis(rng, cycles=cycles, targets=int(rng.integers(3, 30)))
        lost = rng.random(len(plain)) > 0.05  # some rows are missing
        data = read_back(plain, rng, scatter_um)[lost]
        there, number = np.unique(plain.target[lost], return_inverse=True)
        places, found = data.stops
        assert np.array_equal(found, number)
        assert np.abs(places - there).max() < 5e-3 * scatter_um
        called += np.allclose(places, there, rtol=0, atol=1e-9)
    assert called >= 16


def test_what_is_found_is_what_nominal_targets_show() -> None:
    """Neither a wave shorter than the distance of places, nor a parameter for each target."""
    runs, good = needed_runs(0.9), 0
    for seed in range(runs):
        rng = np.random.default_rng([seed, 77])
        plain = axis(rng)
        change = HIDDEN["curve"](plain, rng) + 2.0 * plain.direction
        plain = plain.with_columns(measured_mm=plain.measured + 1e-3 * change)
        data = read_back(plain, rng, 0.4)
        found = tn.diagnose(data)
        assert "periodic" not in found.named
        assert "The targets scatter by up to" in found.summary()
        assert len(next(c for c in found.causes if c.id == "curve").parameters) == 9
        good += found.named == {"curve", "reversal"}
        figures, expected = data.iso230_2(), plain.iso230_2()
        assert figures.targets == pytest.approx(expected.targets, abs=1e-3)
        assert figures.accuracy_um == pytest.approx(expected.accuracy_um)
        assert "The targets scatter" in figures.summary()
        assert not expected.notes
    assert kept(good, runs, 0.9)


def meant(kind: str, rng: np.random.Generator) -> tn.Positioning:
    """Targets near to each other that are meant as they are."""
    plain = axis(rng, cycles=3)
    off = {
        "each direction has its own": 0.2 * (plain.direction < 0),
        "each direction has others": np.tile(np.round(rng.uniform(0, 0.4, 22), 3), 3),
        "each cycle is shifted": 0.1 * plain.cycle,
        "several in one pass": np.tile(np.round(0.01 * np.arange(22.0), 2), 3),
    }[kind]
    data = plain.with_columns(target_mm=plain.target + off, measured_mm=plain.measured + off)
    if kind != "several in one pass":
        return data
    fine = [data.with_columns(target_mm=data.target + x) for x in (0.0, 0.004, 0.008, 0.012)]
    return tn.Positioning.concatenate(fine)


@pytest.mark.parametrize(
    "kind",
    [
        "each direction has its own",
        "each direction has others",
        "each cycle is shifted",
        "several in one pass",
    ],
)
def test_targets_that_are_meant_are_kept(kind: str) -> None:
    for seed in range(20):
        data = meant(kind, np.random.default_rng(seed))
        assert data.stops[0] == pytest.approx(np.unique(np.round(data.target, 9)), abs=1e-8)
        assert not data.notes


def test_two_targets_of_every_pass_are_two() -> None:
    """2.8 mm apart beside others far from each other; not so where a pass stops at one of two."""
    rng = np.random.default_rng(8)
    plain = axis(rng)
    low = plain.target == plain.target.min()
    near = plain[low].with_columns(target_mm=plain[low].target + 2.8)
    data = tn.Positioning.concatenate([plain, near])
    assert len(data.stops[0]) == len(plain.stops[0]) + 1
    assert not data.notes
    one_of_two = plain.target + np.where(low, 0.001 * rng.integers(0, 2, len(plain)), 0.0)
    assert len(plain.with_columns(target_mm=one_of_two).stops[0]) == len(plain.stops[0])


def test_the_last_bit_of_a_number_makes_no_target() -> None:
    data = axis(np.random.default_rng(2))
    up = data.direction > 0
    stored = np.where(up, data.target, data.target + 0.1 - 0.1 + 1e-13)
    assert len(data.with_columns(target_mm=stored).stops[0]) == 11
    assert not data.with_columns(target_mm=stored).notes


def test_rotary_targets_too() -> None:
    rng = np.random.default_rng(6)
    plain = axis(rng)
    target = plain.target / 2 + 1e-4 * rng.standard_normal(len(plain))
    data = tn.Positioning(
        target_deg=target,
        measured_deg=target + plain.deviation / 3600,
        direction=plain.direction,
        cycle=plain.cycle,
    )
    assert len(data.stops[0]) == 11
    assert "arcsec about 11 places" in data.notes[0]
