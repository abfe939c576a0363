"""Readings where an axis just turns: nobody knows on which side of its play it stands there."""

import numpy as np
import pytest

import trunnion as tn

ARCSEC = np.pi / 180 / 3600
RADIUS_MM = 150.0
BEFORE_AFTER_BETWEEN = (-1.0, 1.0, 0.0)


def circle(seed: int, count: int, start_deg: float, side: float) -> tn.Ballbar:
    """A circle of a machine with a squareness of 6 arcsec and 4 µm of backlash of Y, both senses.

    side: Where an axis stands just as it turns: -1 as before, +1 as after, 0 in the middle.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for sense in (1, -1):
        for k in range(count):
            at = sense * np.radians(start_deg + 360.0 * k / count)
            x, y = RADIUS_MM * np.cos(at), RADIUS_MM * np.sin(at)
            way = np.round(sense * np.cos(at), 9) or side * np.sign(-sense * np.sin(at)) * sense
            real = np.array([x - 6 * ARCSEC * y, y - 2e-3 * np.sign(way)])
            length = np.linalg.norm(real - (0.02, -0.03)) + 1.5e-4 * rng.standard_normal()
            rows.append((x, y, length, sense))
    x, y, length, sense = np.array(rows).T
    return tn.Ballbar(
        {"setup": np.ones(len(x)), "x_mm": x, "y_mm": y, "length_mm": length, "sense": sense}
        | {"feed_mm_min": np.full(len(x), 1000.0), "time_s": 0.5 * np.arange(len(x))}
    )


@pytest.mark.parametrize("side", BEFORE_AFTER_BETWEEN)
@pytest.mark.parametrize(("count", "start_deg"), [(360, 0.0), (90, 2.0), (72, 0.0)])
def test_a_circle_that_is_read_where_axes_turn(count: int, start_deg: float, side: float) -> None:
    for seed in (3, 4):
        found = tn.diagnose(circle(seed, count, start_deg, side))
        assert {cause.id for cause in found.causes} == {"backlash_y", "squareness_xy"}
        (backlash,) = (c for c in found.causes if c.id == "backlash_y")
        assert backlash.parameters["b_um"] == pytest.approx(4.0, abs=0.2)
        assert any("where an axis just turns" in note for note in found.notes)
        residuals = found.residuals
        assert residuals is not None
        assert len(residuals.after) < len(residuals.rows) + 1 <= 2 * count
        still = [0] if start_deg == 0.0 else [(90 - int(start_deg)) * count // 360]
        assert not np.isin(still, residuals.rows).any()


def test_a_coarse_circle_keeps_all_its_readings() -> None:
    """Of eight readings four are where axes turn."""
    model = tn.BallbarModel(circle(5, 8, 0.0, 0.0))
    assert len(model.readings) == 16
    assert not model.remarks


def test_lengths_of_a_plan_are_of_all_its_rows() -> None:
    data = circle(6, 360, 0.0, -1.0)
    found = tn.diagnose(data)
    lengths = found.model.lengths_mm(data)
    assert len(lengths) == len(data)
    off = np.asarray(data.length_mm) - lengths
    assert np.std(np.delete(off, [0, 90, 180, 270, 360, 450, 540, 630])) < 2e-4


def sticking(seed: int, start_deg: float, came: float) -> tn.Ballbar:
    """A circle of axes that stick by 3 µm where they turn, and are free again 6° later (1/e).

    came: Share of that with which X sticks where the circle begins: 0 after a rest.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for sense in (1, -1):
        for k in range(360):
            at = start_deg + k  # of the way, deg
            x, y = np.cos(np.radians(at)), sense * np.sin(np.radians(at))
            real = RADIUS_MM * np.array([x, y])
            for axis, turns in enumerate((0.0, 90.0)):
                gone = (at - turns) % 180.0
                behind = -np.array([-y, x])[axis] * sense  # against its travel
                share = came if at - gone < start_deg else 1.0
                real[axis] += 3e-3 * share * np.sign(behind) * np.exp(-gone / 6.0)
            length = np.linalg.norm(real - (0.02, -0.03)) + 4e-4 * rng.standard_normal()
            rows.append((RADIUS_MM * x, RADIUS_MM * y, length, sense, 0.1571 * k))
    x, y, length, sense, time = np.array(rows).T
    return tn.Ballbar(
        {"setup": np.ones(len(x)), "x_mm": x, "y_mm": y, "length_mm": length, "sense": sense}
        | {"feed_mm_min": np.full(len(x), 1000.0), "time_s": time}
    )


@pytest.mark.parametrize(("start_deg", "came"), [(0.5, 1.0), (0.5, 0.6), (0.5, 0.0), (30.0, 1.0)])
def test_an_axis_sticks_at_the_start_of_a_circle_as_much_as_it_came(
    start_deg: float, came: float
) -> None:
    """On a circle of more than a turn it turns back just before the readings begin."""
    for seed in (7, 8, 9):
        found = tn.diagnose(sticking(seed, start_deg, came))
        assert found.named == {"reversal_spike_x", "reversal_spike_y"}
        x, y = (next(c for c in found.causes if c.id == f"reversal_spike_{a}") for a in "xy")
        for cause in (x, y):
            off = cause.parameters["a_um"] - 3.0
            assert abs(off) < 3.5 * cause.std_errors["a_um"]
        assert set(y.parameters) == {"a_um", "decay_ms"}
        if start_deg < 1.0:
            off = x.parameters["start_um"] - 3.0 * came
            assert abs(off) < 3.5 * x.std_errors["start_um"]
        else:
            assert set(x.parameters) == {"a_um", "decay_ms"}
