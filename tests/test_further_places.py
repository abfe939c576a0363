"""Places of candidates between those of their grids."""

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import axis
from promise import kept, needed_runs
from trunnion.base.units import Floats
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.grid import best_place


def test_candidates_with_a_place_more_are_those_made_with_it() -> None:
    rng = np.random.default_rng(3)
    widths = [(1, 2), (5, 1), (4, 2), (1, 1), (6, 1)]  # variants, columns
    every = [rng.standard_normal((v, 60, k)) for v, k in widths]
    basis = np.linalg.qr(rng.standard_normal((60, 4)))[0]
    left = rng.standard_normal(60)
    left -= basis @ (basis.T @ left)
    last = {1: 4, 2: 0, 4: 3}
    fewer = [np.delete(x, last[j], axis=0) if j in last else x for j, x in enumerate(every)]
    other = rng.standard_normal((1, 60, 1))
    fewer[4] = np.insert(fewer[4], 1, other, axis=0)  # which is left out again
    whole, part = Candidates(every, basis), Candidates(fewer, basis)
    part.gains(left)
    found = part.with_variants({j: (v, every[j][[v]]) for j, v in last.items()}, {4: 1})
    for name in ("owner", "variant", "rank"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
    np.testing.assert_allclose(found.penalty, whole.penalty, rtol=1e-12)
    np.testing.assert_allclose(found.gains(left), whole.gains(left), rtol=1e-10)
    np.testing.assert_allclose(found.gains(2 * left), 4 * whole.gains(left), rtol=1e-10)
    for block in range(len(whole.owner)):
        own = found.columns(block).T @ found.columns(block)
        np.testing.assert_allclose(own, whole.columns(block).T @ whole.columns(block), atol=1e-12)


@pytest.mark.parametrize("ratio", [1.2, 2.0, 4.0])
def test_the_best_place_is_found_between_those_of_a_grid(ratio: float) -> None:
    """Of a warm-up without noise it is its own time constant: no other column is parallel to it."""
    minutes, rng = np.linspace(0.0, 90.0, 200), np.random.default_rng(5)
    grid = 3.0 * ratio ** np.arange(np.ceil(np.log(40.0) / np.log(ratio)) + 1)
    for place in rng.uniform(3.0, 120.0, 20):
        shown = 1.0 - np.exp(-minutes / place)

        def gains(places: Floats, shown: Floats = shown) -> Floats:
            x = 1.0 - np.exp(-minutes / places[:, None])
            return np.asarray((x @ shown) ** 2 / np.sum(x**2, axis=1))

        assert best_place(gains, grid.tolist()) == pytest.approx(place, rel=1e-6)


@pytest.mark.parametrize("times", [20.0, 60.0])
def test_a_wave_many_times_the_noise_is_named_beside_a_scale(times: float) -> None:
    """By itself it fits best elsewhere: a curve of all targets took the place of what was missed.

    Where the curve of noise and wave is one by chance, as in 1 of 60, the curve may be named.
    """
    runs, good = needed_runs(0.9), 0
    for seed in range(runs):
        rng = np.random.default_rng([seed, int(times), 43])
        plain, pitch = axis(rng, noise=0.2), rng.uniform(105.0, 150.0)
        wave = 0.2 * times * np.sin(2 * np.pi * plain.target / pitch + rng.uniform(0.0, 6.28))
        off = plain.measured + 1e-3 * (wave + 0.015 * (plain.target - 250.0))
        causes = {c.id: c for c in tn.diagnose(plain.with_columns(measured_mm=off)).causes}
        if {"periodic", "scale"} <= causes.keys():
            found = causes["periodic"]
            off_by = abs(found.parameters["pitch_mm"] - pitch)
            good += off_by < 4 * found.std_errors["pitch_mm"]
    assert kept(good, runs, 0.9)


def plate(rng: np.random.Generator, pitch: float) -> tuple[tn.Points, Floats, Floats]:
    """Points about a grid of 37.5 mm with a wave of X, and their nominal X and error of X, µm."""
    grid = np.linspace(-150.0, 150.0, 9)
    x, y = (a.ravel() + rng.uniform(-5.0, 5.0, 81) for a in np.meshgrid(grid, grid))
    wave = 2.0 * np.sin(2 * np.pi * x / pitch + rng.uniform(0.0, 6.28))
    error = wave + rng.normal(0.0, 0.4, 81)
    other = rng.normal(0.0, 0.4, 81)
    columns = {"nominal_x_mm": x, "nominal_y_mm": y}
    return (
        tn.Points({**columns, "x_mm": x + 1e-3 * error, "y_mm": y + 1e-3 * other}),
        x,
        error,
    )


def test_a_pitch_near_twice_the_step_of_places_is_the_best_one() -> None:
    """Its peak is narrower than the grid; an alias at a third of it was said instead."""
    for seed in range(40):
        rng = np.random.default_rng([seed, 47])
        pitch = rng.uniform(74.0, 77.0)
        data, x, error = plate(rng, pitch)

        def left(pitch: float, x: Floats = x, error: Floats = error) -> float:
            turn = 2 * np.pi * x / pitch
            columns = np.stack([np.ones(81), np.cos(turn), np.sin(turn)], axis=1)
            r = error - columns @ np.linalg.lstsq(columns, error, rcond=None)[0]
            return float(r @ r)

        (found,) = (c for c in tn.diagnose(data).causes if c.id == "periodic_x")
        assert left(found.parameters["pitch_mm"]) < 1.05 * left(pitch)
