"""Reversal spikes of a few readings: their sizes, and that nothing else is named for them."""

import numpy as np
import pytest

import trunnion as tn

RADIUS_MM = 100.0
PERIOD_S = 0.004
NOISE_UM = 0.15


def circle(
    seed: int,
    feed_mm_min: float,
    spikes: tuple[tuple[float, float], tuple[float, float]],
    backlash_um: tuple[float, float] = (0.0, 2.0),
    turns: float = 1.01,
    squareness_arcsec: float = 0.0,
) -> tn.Ballbar:
    """Both senses at 250 Hz, shown in steps of 0.1 µm.

    spikes: Size (µm) and decay (s) of X and Y: where an axis turns it lags by the size, which falls
    off exponentially from the moment at which it turns, be that between two readings.
    """
    rng = np.random.default_rng(seed)
    rate = feed_mm_min / 60.0 / RADIUS_MM
    columns = []
    for sense in (1.0, -1.0):
        time = np.arange(int(2 * np.pi * turns / rate / PERIOD_S)) * PERIOD_S
        begin = -0.005 * 2 * np.pi
        gone = begin + rate * time  # of the angle; X turns at every multiple of 180°, Y 90° later
        x, y = RADIUS_MM * np.cos(gone), sense * RADIUS_MM * np.sin(gone)
        real = np.stack([x, y])
        real[0] -= np.radians(squareness_arcsec / 3600) * y
        for axis, way in enumerate((-np.sin(gone), sense * np.cos(gone))):
            half = (gone - axis * np.pi / 2) / np.pi
            since = (half - np.floor(half)) * np.pi / rate
            since[half < np.floor((begin - axis * np.pi / 2) / np.pi) + 1] = np.inf
            size, decay = spikes[axis]
            lag = backlash_um[axis] / 2 + size * np.exp(-since / decay)
            real[axis] -= 1e-3 * np.sign(way) * lag
        length = np.hypot(real[0] - 3e-3, real[1] + 2e-3)
        length += 1e-3 * NOISE_UM * rng.standard_normal(len(time))
        at = time + (sense < 0) * (time[-1] + 20.0)
        columns.append((x, y, np.round(length, 4), np.full(len(x), sense), at))
    x, y, length, sense, time = np.concatenate(columns, axis=1)
    return tn.Ballbar(
        {"setup": np.ones(len(x)), "x_mm": x, "y_mm": y, "length_mm": length, "sense": sense}
        | {"feed_mm_min": np.full(len(x), feed_mm_min), "time_s": time}
    )


@pytest.mark.parametrize(
    ("feed_mm_min", "size_um", "decay_s"),
    [(1000.0, 10.0, 0.012), (1000.0, 4.0, 0.020), (2000.0, 4.0, 0.010), (2000.0, 3.0, 0.020)],
)
def test_a_spike_of_a_few_readings_has_its_size(
    feed_mm_min: float, size_um: float, decay_s: float
) -> None:
    """And the error of a wrong decay is no cyclic error, no scale and no outliers."""
    off = []
    for seed in range(20, 26):
        data = circle(seed, feed_mm_min, ((0.0, 1.0), (size_um, decay_s)))
        found = tn.diagnose(data)
        sure = {c.id for c in found.causes if c.probability > 0.9}
        assert sure == {"backlash_y", "reversal_spike_y"}
        assert not len(found.outliers)
        (spike,) = (c for c in found.causes if c.id == "reversal_spike_y")
        hidden = {"a_um": size_um, "decay_ms": 1e3 * decay_s}
        off += [(spike[k] - v) / spike.std_errors[k] for k, v in hidden.items()]
        assert all(spike.std_errors[k] < 0.08 * v for k, v in hidden.items())
    assert np.max(np.abs(off)) < 3.5
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 1.7


def test_of_a_spike_of_one_reading_the_size_is_not_said_to_be_known() -> None:
    """Ten µm that are gone after a millisecond, of readings 4 ms apart."""
    for seed in range(50, 54):
        found = tn.diagnose(circle(seed, 2000.0, ((0.0, 1.0), (10.0, 0.001))))
        (spike,) = (c for c in found.causes if c.id == "reversal_spike_y")
        assert np.isinf(spike.std_errors["decay_ms"])
        (note,) = (note for note in found.notes if "do not determine decay" in note)
        assert "reversal_spike_y" in note
        assert "2 ms, the lowest value that is looked for. a with the standard error" in note
        assert "decay not identifiable" in spike.size()
    known = tn.diagnose(circle(54, 2000.0, ((0.0, 1.0), (10.0, 0.010))))
    assert not any("do not determine" in note for note in known.notes)


def test_a_reading_beside_those_left_out_at_a_reversal_stands_not_still() -> None:
    """It has the backlash of its side: those beside the gap were outliers."""
    for seed in range(30, 34):
        data = circle(seed, 2000.0, ((0.0, 1.0), (3.0, 0.02)), turns=2.01)
        for begin in range(4):  # readings fall otherwise beside the turn
            some = data[np.arange(begin, len(data))]
            model = tn.BallbarModel(some)
            assert model.remarks
            for axis in (0, 1):
                assert not np.any(model.path.travel(model.path.tips[:, axis]) == 0)


def test_of_many_readings_sets_are_weighed_at_the_decays_beside_their_causes() -> None:
    """What a grid loses of large spikes is no cause and no structure; 19,000 readings."""
    for seed in range(40, 43):
        spikes = ((30.0, 0.05), (20.0, 0.05))
        data = circle(seed, 1000.0, spikes, (2.0, 1.0), squareness_arcsec=3.0)
        found = tn.diagnose(data)
        hidden = {f"{kind}_{axis}" for kind in ("backlash", "reversal_spike") for axis in "xy"}
        assert found.named == {*hidden, "squareness_xy"}
        assert all(cause.probability > 0.99 for cause in found.causes)
        assert not found.unexplained
        assert found.sigma < 1.02 * np.hypot(NOISE_UM, 0.1 / np.sqrt(12))
