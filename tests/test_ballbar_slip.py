"""A ball that slips on the table in the middle of a ball-bar test."""

import numpy as np
import pytest

import trunnion as tn

RADIUS_MM = 100.0
LATER_S = 6.0  # the second sense begins


def slipped(seed: int, share: float, by_um: tuple[float, float], *, timed: bool) -> tn.Ballbar:
    """Two senses of a circle; from a share of the readings on the ball stands elsewhere.

    Each slip is along the bar where it happens: across it, its moment would not show.
    """
    rng = np.random.default_rng([41, seed])
    rows = []
    for sense in (1, -1):
        for k in range(180):
            at = sense * np.radians(45.3 + 2.0 * k)
            rows.append((RADIUS_MM * np.cos(at), RADIUS_MM * np.sin(at), sense, 0.2 * k))
    x, y, sense, time = np.array(rows).T
    time[180:] += time[179] + LATER_S
    ball = np.tile((0.012, -0.007), (360, 1))
    ball[int(share * 360) :] += 1e-3 * np.array(by_um)
    length = np.hypot(x - ball[:, 0], y - ball[:, 1]) + 4e-4 * rng.standard_normal(360)
    columns = {"setup": np.ones(360), "x_mm": x, "y_mm": y, "length_mm": length, "sense": sense}
    return tn.Ballbar(columns | ({"time_s": time} if timed else {}))


@pytest.mark.parametrize(("share", "by_um"), [(0.35, (1.0, -3.0)), (0.5, (-2.0, 0.0))])
@pytest.mark.parametrize("timed", [True, False])
def test_a_slip_is_named_with_its_moment(
    share: float, by_um: tuple[float, float], *, timed: bool
) -> None:
    for seed in (1, 2, 3):
        data = slipped(seed, share, by_um, timed=timed)
        found = tn.diagnose(data)
        assert found.named == {"setup_shift"}
        (slip,) = found.causes
        assert found.verdict in ("explained", "ambiguous")
        for name, true in zip(("dx_um", "dy_um"), by_um, strict=True):
            assert abs(slip.parameters[name] - true) < 3.5 * slip.std_errors[name]
        when = np.asarray(data.time_s) if timed else np.arange(360.0)
        first = int(share * 360)
        moment = slip.parameters["t0_s" if timed else "row"]
        assert when[first - 4] < moment <= when[first + 3]


def test_a_ball_that_stays_slips_nowhere() -> None:
    found = [tn.diagnose(slipped(seed, 0.5, (0.0, 0.0), timed=True)) for seed in range(20)]
    assert sum(d.verdict == "consistent" for d in found) >= 18
    assert sum("setup_shift" in d.named for d in found) <= 1
