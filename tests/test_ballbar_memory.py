"""Ball-bar lengths whose noise has a memory: neighbouring readings err alike.

Circles by formulas of their own. The noise is white noise through a filter, as a recorder has one,
or a walk that goes back to its middle, as a machine on a soft floor makes.
"""

from itertools import product

import numpy as np
import pytest
from scipy.signal import lfilter

import trunnion as tn
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


def circles(seed: int, memory: float, size_um: float, *, false_um: float = 0.0) -> tn.Ballbar:
    """Two circles, one each way; ``size_um``: of noise of which ``memory`` stays in the next one.

    ``false_um``: by how much a single length is false.
    """
    rng = np.random.default_rng(seed)
    parts = []
    for sense in (1, -1):
        angle = sense * 2 * np.pi * (np.arange(COUNT) + 0.5) / COUNT
        x, y = RADIUS_MM * np.cos(angle), RADIUS_MM * np.sin(angle)
        travel = sense * np.stack([-np.sin(angle), np.cos(angle)])
        play = 5e-4 * np.array([[*BACKLASH_UM.values()]]).T * np.sign(travel)
        tool_x = x - play[0] - np.radians(SQUARENESS_ARCSEC / 3600) * y - 0.012
        length = np.hypot(tool_x, y - play[1] + 0.008)
        fresh = rng.standard_normal(COUNT + 200) * np.sqrt(1 - memory**2)
        slow = lfilter([1.0], [1.0, -memory], fresh)[200:]
        noise_um = size_um * slow + WHITE_UM * rng.standard_normal(COUNT)
        parts.append((x, y, length + 1e-3 * noise_um, np.full(COUNT, sense)))
    x, y, length, way = (np.concatenate(one) for one in zip(*parts, strict=True))
    length[100] += 1e-3 * false_um
    time = np.arange(2 * COUNT) * 0.1 + 20.0 * (way < 0)
    setup = np.ones(2 * COUNT, dtype=int)
    return tn.Ballbar(setup=setup, x_mm=x, y_mm=y, length_mm=length, sense=way, time_s=time)


def test_noise_with_a_memory_is_no_cause() -> None:
    wrong, pulls = set(), []
    for memory, seed in product((0.3, 0.6, 0.9), SEEDS):
        found = tn.diagnose(circles(seed, memory, 0.1))
        causes = {c.id: c for c in found.causes}
        assert causes.keys() >= ACTING, (memory, seed, found.summary())
        if any(c.probability > SURE and id_ not in ACTING for id_, c in causes.items()):
            wrong.add((memory, seed))
        for id_, size in BACKLASH_UM.items():
            error = next(iter(causes[id_].std_errors.values()))
            pulls.append((next(iter(causes[id_].parameters.values())) - size) / error)
    assert len(wrong) <= 1, wrong  # of 18
    assert np.max(np.abs(pulls)) < 4


def test_white_noise_leaves_the_readings_as_they_are() -> None:
    made = [_whitener(circles(seed, 0.0, 0.1)) for seed in range(12)]
    assert sum(one is identity for one in made) >= 11


def test_a_reading_that_is_left_out_acts_on_no_other() -> None:
    whiten = _whitener(circles(1, 0.8, 0.1))
    assert isinstance(whiten, Whitener)
    rng = np.random.default_rng(3)
    rows = whiten.filters[0][0]
    kept = whiten.without(rows[[4, 90]])
    r = rng.standard_normal((2 * COUNT, 2))
    other = r.copy()
    other[rows[[4, 90]]] = 1e3
    good = np.setdiff1d(np.arange(2 * COUNT), rows[[4, 90]])
    assert np.array_equal(kept(r)[good], kept(other)[good])
    assert np.array_equal(kept(r)[rows[:4]], whiten(r)[rows[:4]])
    assert np.all(np.abs(kept(other)[rows[[4, 90]]]) > 1e3)


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
