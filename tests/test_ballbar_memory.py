"""Ball-bar lengths whose noise has a memory: neighbouring readings err alike.

Circles by formulas of their own. The noise is white noise through a filter, as a recorder has one
(of first order, or the mean of the last readings), beside white noise of the transmitter.
"""

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import trunnion as tn
from trunnion.base.units import Floats
from trunnion.diagnosis.noise import Whitener
from trunnion.diagnosis.whitening import identity
from trunnion.models.ballbar.model import BallbarModel

RADIUS_MM = 100.0
COUNT = 360
WHITE_UM = 0.05
BACKLASH_UM = {"backlash_x": 3.0, "backlash_y": -2.0}
SQUARENESS_ARCSEC = 8.0
ACTING = {*BACKLASH_UM, "squareness_xy"}
SURE = 0.9
SEEDS = range(6)


def slow(rng: np.random.Generator, memory: float, last: int) -> Floats:
    """Noise of size 1: white noise of which ``memory`` stays, or the mean of the last so many."""
    fresh = rng.standard_normal(COUNT + 200)
    if last:
        return np.asarray(np.convolve(fresh, np.ones(last) / last**0.5)[200 : 200 + COUNT])
    return np.asarray(lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], fresh)[200:])


def circles(
    seed: int,
    memory: float,
    size_um: float,
    *,
    last: int = 0,
    white_um: float = WHITE_UM,
    false_um: float = 0.0,
    jump_um: float = 0.0,
    wave_um: float = 0.0,
    drift_um: float = 0.0,
    step_um: float = 0.0,
) -> tn.Ballbar:
    """Two circles, one each way; ``size_um``: of noise of which ``memory`` stays in the next one.

    ``false_um``: by how much a single length is false. ``jump_um``, ``wave_um``, ``drift_um``: what
    the bar reads more from a reading on, in five waves a turn, and at the end. ``step_um``: in
    which lengths are read.
    """
    rng = np.random.default_rng(seed)
    parts = []
    for sense in (1.0, -1.0):
        angle = sense * 2 * np.pi * (np.arange(COUNT) + 0.5) / COUNT
        x, y = RADIUS_MM * np.cos(angle), RADIUS_MM * np.sin(angle)
        travel = sense * np.stack([-np.sin(angle), np.cos(angle)])
        play = 5e-4 * np.array([[*BACKLASH_UM.values()]]).T * np.sign(travel)
        tool_x = x - play[0] - np.radians(SQUARENESS_ARCSEC / 3600) * y - 0.012
        length = np.hypot(tool_x, y - play[1] + 0.008)
        noise_um = size_um * slow(rng, memory, last) + white_um * rng.standard_normal(COUNT)
        noise_um += wave_um * np.sin(5 * angle + 1.0)
        parts.append((x, y, length + 1e-3 * noise_um, np.full(COUNT, sense)))
    x, y, length, way = (np.concatenate(one) for one in zip(*parts, strict=True))
    length[100] += 1e-3 * false_um
    length[int(rng.integers(120, 600)) :] += 1e-3 * jump_um
    length += 1e-3 * drift_um * (np.arange(2 * COUNT) / (2 * COUNT)) ** 3
    if step_um:
        length = np.round(length / (1e-3 * step_um)) * (1e-3 * step_um)
    time = np.arange(2 * COUNT) * 0.1 + 20.0 * (way < 0)
    setup = np.ones(2 * COUNT, dtype=int)
    return tn.Ballbar(setup=setup, x_mm=x, y_mm=y, length_mm=length, sense=way, time_s=time)


def wrong_causes(found: tn.Diagnosis) -> set[str]:
    return {c.id for c in found.causes if c.probability > SURE} - ACTING


@pytest.mark.parametrize(
    ("memory", "last"), [(0.5, 0), (0.8, 0), (0.9, 0), (0.0, 4), (0.0, 10)], ids=str
)
def test_noise_with_a_memory_is_no_cause(memory: float, last: int) -> None:
    wrong, pulls = [], []
    for seed in SEEDS:
        found = tn.diagnose(circles(seed, memory, 0.1, last=last))
        causes = {c.id: c for c in found.causes}
        assert causes.keys() >= ACTING, (seed, found.summary())
        wrong += [(seed, wrong_causes(found))] if wrong_causes(found) else []
        for id_, size in BACKLASH_UM.items():
            error = next(iter(causes[id_].std_errors.values()))
            pulls.append((next(iter(causes[id_].parameters.values())) - size) / error)
    assert len(wrong) <= 1, wrong
    assert np.max(np.abs(pulls)) < 4


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"jump_um": 1.0},
        {"jump_um": 5.0},
        {"wave_um": 0.5},
        {"wave_um": 5.0},
        {"drift_um": 5.0},
        {"step_um": 0.1},
        {"step_um": 1.0},
    ],
    ids=str,
)
def test_white_noise_has_no_memory_whatever_is_beside_it(more: dict[str, Any]) -> None:
    made = [_whitener(circles(seed, 0.0, 0.0, white_um=0.1, **more)) for seed in range(12)]
    assert all(one is identity for one in made)


def test_exact_lengths_have_no_memory() -> None:
    assert _whitener(circles(1, 0.0, 0.0, white_um=0.0)) is identity


def test_lengths_in_steps_have_the_memory_of_their_noise() -> None:
    made = [_whitener(circles(seed, 0.8, 0.1, step_um=0.1)) for seed in SEEDS]
    assert all(isinstance(one, Whitener) for one in made)


def test_a_jump_beside_such_noise_is_none_of_it() -> None:
    """The slow part of the noise is as large as without the jump, within a factor of two."""
    for seed in SEEDS:
        quiet, jumped = (
            _whitener(circles(seed, 0.8, 0.1, jump_um=jump_um)) for jump_um in (0.0, 2.0)
        )
        assert isinstance(quiet, Whitener)
        assert isinstance(jumped, Whitener)
        assert 0.5 < _slow_part(jumped) / _slow_part(quiet) < 2.0


def test_little_has_changed_between_circles_of_such_noise() -> None:
    """In 12 of 12 pairs causes had changed that neither machine has."""
    changed = {}
    for seed in range(20, 36, 2):
        found = tn.compare(circles(seed, 0.8, 0.1), circles(seed + 1, 0.8, 0.1))
        if names := [q.name for q in found.quantities if q.changed]:
            changed[seed] = names
    assert len(changed) <= 2, changed


def test_the_noise_is_that_of_a_reading() -> None:
    for seed in SEEDS:
        found = tn.diagnose(circles(seed, 0.8, 0.1))
        assert found.sigma == pytest.approx(np.hypot(0.1, WHITE_UM), rel=0.3)


def test_a_reading_that_is_left_out_acts_on_no_other() -> None:
    whiten = _whitener(circles(1, 0.8, 0.1))
    assert isinstance(whiten, Whitener)
    rng = np.random.default_rng(3)
    rows = whiten.filters[0][0]
    kept = whiten.without(rows[[4, 40]])
    r = rng.standard_normal((2 * COUNT, 2))
    other = r.copy()
    other[rows[[4, 40]]] = 1e3
    good = np.setdiff1d(np.arange(2 * COUNT), rows[[4, 40]])
    assert np.array_equal(kept(r)[good], kept(other)[good])
    assert np.allclose(kept(r)[rows[:4]], whiten(r)[rows[:4]], rtol=1e-12)
    assert np.all(np.abs(kept(other)[rows[[4, 40]]]) > 999.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_false_length_beside_such_noise_is_set_aside(seed: int) -> None:
    found = tn.diagnose(circles(seed, 0.8, 0.1, false_um=8.0))
    assert found.outliers == (100,)
    assert {c.id for c in found.causes if c.probability > SURE} == ACTING


def _whitener(data: tn.Ballbar) -> object:
    model = BallbarModel(data)
    plain = model.readings.values - model.predict(model.start, {})
    jacobian = model.jacobian(model.start, {})
    left = plain - jacobian @ np.linalg.lstsq(jacobian, plain, rcond=None)[0]
    return model.whitener(left)


def _slow_part(whiten: Whitener) -> float:
    """Root of the spectral density of the noise at rest."""
    noise = whiten.filters[0][1]
    return float(noise.sizes[-1] / (1.0 - noise.predictors[-1].sum()))
