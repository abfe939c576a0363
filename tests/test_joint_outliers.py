"""Several measurements, one of which has outliers: of it the other readings are used."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from trunnion.diagnosis.effect import linear
from trunnion.diagnosis.engine import leave
from trunnion.diagnosis.linear_model import LinearModel
from trunnion.diagnosis.model import Nuisance, Readings
from trunnion.models.ballbar.model import BallbarModel
from trunnion.models.kinds import model_of
from trunnion.models.several import Measured, joint_model

ARCSEC = np.pi / 180 / 3600
NOISE_UM = 0.2
FAR_MM = 0.02
SHARE = 0.15  # of the noise, by which that of 150 readings may be known otherwise


def circles(seed: int, radius: float, count: int, outliers: int = 0) -> tn.Ballbar:
    """Both senses of a machine out of square by 6 arcsec, with 2 and 3 µm of backlash."""
    rng = np.random.default_rng([seed, count])
    at = np.radians(rng.uniform(0.0, 360.0) + 360.0 * (np.arange(count) + 0.5) / count)
    at = np.concatenate([at, at[::-1]])
    sense = np.repeat([1.0, -1.0], count)
    x, y = radius * np.cos(at), radius * np.sin(at)
    real = np.column_stack([x - 6 * ARCSEC * y, y])
    real -= 1e-3 * np.sign(np.column_stack([-y * sense, x * sense])) * (1.0, 1.5)
    length = np.hypot(*(real - (0.005, -0.003)).T)
    length += 1e-3 * NOISE_UM * rng.standard_normal(len(at))
    length[rng.choice(len(at), outliers, replace=False)] += FAR_MM
    time = np.arange(len(at)) * 2 * np.pi * radius / count / 1000.0 * 60.0
    columns = {"setup": np.ones(len(at)), "x_mm": x, "y_mm": y, "length_mm": length}
    feed = np.full(len(at), 1000.0)
    return tn.Ballbar(columns | {"sense": sense, "feed_mm_min": feed, "time_s": time})


def measured(data: tn.Ballbar) -> Measured:
    model = model_of(data, None, ())
    return Measured("ballbar", data, None, leave(model), model)


@pytest.mark.parametrize("seed", range(8))
def test_circles_of_which_readings_are_left_out_where_an_axis_turns(seed: int) -> None:
    """Without some readings the model left out others there, too: residuals were not of these."""
    first, second = circles(seed, 100.0, 180), circles(seed, 150.0, 250, 3)
    found = tn.diagnose([first, second])
    assert {"squareness_xy", "backlash_x", "backlash_y"} <= {c.id for c in found.causes}
    off = np.abs(np.asarray(second.length_mm) - 150.0) > FAR_MM / 2
    assert set(found.outliers) == set(np.flatnonzero(off) + len(first))


@pytest.mark.parametrize("seed", range(8))
def test_noise_is_that_of_the_readings_that_are_used(seed: int) -> None:
    both = [measured(circles(seed, 100.0, 180)), measured(circles(seed, 150.0, 250, 3))]
    joint = joint_model(both, lambda data: model_of(data, None, ()))
    for part, one in zip(joint.parts, both, strict=True):
        assert len(part.rows) == len(part.model.readings)
        assert not np.isin(one.rows[part.model.readings.rows], one.alone.outliers).any()
        assert np.isin(one.rows[part.model.readings.rows], one.alone.rows).all()
        assert part.whiten.size == pytest.approx(NOISE_UM, rel=SHARE)


def test_of_fewer_readings_none_is_used_that_was_left_out() -> None:
    """20 readings a run, 4 of them where an axis turns: of 19 these are too many to leave out."""
    at = np.radians(18.0 * np.arange(20))
    at = np.concatenate([at, at[::-1]])
    sense, rng = np.repeat([1.0, -1.0], 20), np.random.default_rng(3)
    x, y = 100.0 * np.cos(at), 100.0 * np.sin(at)
    length = np.hypot(x - 6 * ARCSEC * y, y) + 1e-3 * NOISE_UM * rng.standard_normal(40)
    length[3] += 10 * FAR_MM
    columns = {"setup": np.ones(40), "x_mm": x, "y_mm": y, "length_mm": length, "sense": sense}
    one = measured(tn.Ballbar(columns))
    assert one.alone.outliers == (3,)
    turning = np.setdiff1d(np.arange(40), one.alone.rows)
    assert len(turning) == 8
    bound = BallbarModel(one.data[np.delete(np.arange(40), 3)])
    assert np.isin(turning, np.delete(np.arange(40), 3)[bound.readings.rows]).any()
    used = one.rows[one.used.readings.rows]
    assert not np.isin(turning, used).any()
    assert 3 not in used


def arrays(seed: int, outliers: int) -> tuple[LinearModel, frozenset[int]]:
    """A slope of 2 µm in 60 readings, given as arrays."""
    rng = np.random.default_rng([seed, outliers])
    x = np.linspace(-1.0, 1.0, 60)
    values = 3.0 + 2.0 * x + NOISE_UM * rng.standard_normal(60)
    far = rng.choice(60, outliers, replace=False)
    values[far] += 1e3 * FAR_MM
    slope = linear("slope", ["s_um"], x[:, None])
    readings, mean = Readings(values, np.arange(60)), (Nuisance("mean", "µm"),)
    model = LinearModel(None, readings, mean, np.ones((60, 1)), effects=[slope])
    return model, frozenset(int(row) for row in far)


@pytest.mark.parametrize("seed", range(6))
def test_outliers_of_a_model_of_arrays_say_nothing(seed: int) -> None:
    """No data can be bound again without them."""
    (first, _), (second, far) = arrays(seed, 0), arrays(seed, 2)
    found = tn.diagnose([first, second])
    assert set(found.outliers) == {60 + row for row in far}
    (slope,) = found.causes
    assert slope.parameters["s_um"] == pytest.approx(2.0, abs=0.15)
    alone = tn.diagnose(first)
    assert slope.std_errors["s_um"] < alone.causes[0].std_errors["s_um"]
