"""Separating forms over random cases: unbiased, and as precise as the Cramér-Rao bound allows."""

import numpy as np

import trunnion as tn
import trunnion._core as _core
from trunnion.probing.model import TouchModel

# Bounds of the plain model for 1 µm of noise, derived independently of the package.
BOUNDS = {
    "EA0A": 1.82,
    "EB0A": 2.75,
    "EC0A": 2.92,
    "EX0C": 0.236,
    "EY0A": 0.433,
    "EZ0A": 0.359,
}
DIFFERENCES = {("EB0C", "EB0A"): 3.37, ("EY0C", "EY0A"): 0.400}
CASES = 4000


def measurements(model: TouchModel, moves: _core.Moves, labels: list[int]) -> _core.Measurements:
    return _core.Measurements(model.core, moves, labels, reach_mm=15.0, noise_um=0.3, seed=7)


def test_spread_is_that_of_the_bound_and_the_mean_is_right() -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"))
    plan = tn.plan(setup)
    model = TouchModel(setup)
    rng = np.random.default_rng(2022)
    truths = np.hstack([rng.uniform(-60, 60, (CASES, 8)), rng.uniform(-100, 100, (CASES, 6))])
    moves = model.moves(plan, from_start=True)
    labels = [] if plan.point is None else list(plan.point)
    rows, failed = measurements(model, moves, labels).calibrations(
        truths, first_sample=0, identify=False, threads=None
    )
    assert not failed
    left = rows[:, :14] - truths
    noise = 0.3
    mean_limit = 3.5 * left.std(axis=0) / np.sqrt(CASES)
    assert np.all(np.abs(left.mean(axis=0)) < mean_limit)
    index = {name: k for k, name in enumerate(model.names)}
    for name, bound in BOUNDS.items():
        ratio = left[:, index[name]].std() / (noise * bound)
        assert 0.95 < ratio < 1.05, (name, ratio)
    for (first, second), bound in DIFFERENCES.items():
        ratio = (left[:, index[first]] - left[:, index[second]]).std() / (noise * bound)
        assert 0.95 < ratio < 1.05, (first, second, ratio)


def test_numbers_do_not_depend_on_threads_or_pieces() -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"), probe=tn.Probe(tick_um=0.1))
    plan = tn.plan(setup)
    model = TouchModel(setup)
    moves = model.moves(plan, from_start=True)
    labels = [] if plan.point is None else list(plan.point)
    truths = np.random.default_rng(1).uniform(-60, 60, (64, 14))
    core = measurements(model, moves, labels)
    whole = core.calibrations(truths, first_sample=0, identify=True, threads=1)
    for threads in (2, 3, None):
        again = core.calibrations(truths, first_sample=0, identify=True, threads=threads)
        assert np.array_equal(whole[0], again[0])
        assert not again[1]
    part = core.calibrations(truths[40:], first_sample=40, identify=True, threads=1)
    assert np.array_equal(whole[0][40:], part[0])
