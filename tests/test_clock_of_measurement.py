"""What changes with time counts from the first reading, wherever the clock of the data begins."""

from __future__ import annotations

from pkgutil import resolve_name
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from trunnion.models.kinds import kinds

CASES = [
    pytest.param(example, id=example.split(":")[1])
    for kind in kinds()
    if kind.name != "diameters"  # their times are those within a pass, from 0
    for example in kind.examples
]
UNIX_S = float(2**30)  # about 2004
SETUP = tn.Setup(tn.Artefact("cross"))
RATE_UM_H = 24.0


def measured(example: str) -> tuple[Any, Any]:
    """A small measurement, with times that a float of seconds since 1970 has exactly."""
    data, setup = resolve_name(example)()[:2]
    return data.with_columns(time_s=np.round(np.asarray(data["time_s"]) * 2**20) / 2**20), setup


def from_(data: Any, begin_s: float) -> Any:
    """The same measurement by a clock that begins elsewhere."""
    return data.with_columns(time_s=np.asarray(data["time_s"]) + begin_s)


def touched(seed: int, **of_time: float) -> tn.Touches:
    """Touches of a machine whose C axis stands off in X, and whose Z axis moves with time.

    They are made 20 times as slow as planned.

    of_time: "rate", µm/h, or the "amplitude", µm, of a warm-up with a time constant of 10 minutes.
    """
    plan = tn.plan(SETUP)
    seconds = 20 * np.asarray(plan.time_s)
    gone = seconds - seconds[0]
    way = np.stack([plan.dir_x, plan.dir_y, plan.dir_z], axis=1)
    moved = np.tile([15.0, 0.0, 0.0], (len(plan), 1))
    moved[:, 2] -= of_time.get("rate", 0.0) * gone / 3600.0
    moved[:, 2] -= of_time.get("amplitude", 0.0) * (1 - np.exp(-gone / 600.0))
    noise = np.random.default_rng(seed).normal(0, 0.3, len(plan))
    along = np.sum(moved * way, axis=1) + noise
    at = np.stack([plan.x_mm, plan.y_mm, plan.z_mm], axis=1) + 1e-3 * along[:, None] * way
    return plan.with_columns(x_mm=at[:, 0], y_mm=at[:, 1], z_mm=at[:, 2], time_s=seconds)


@pytest.mark.parametrize("example", CASES)
def test_any_begin_of_the_clock_gives_the_same_diagnosis(example: str) -> None:
    data, setup = measured(example)
    first, then = tn.diagnose(data, setup), tn.diagnose(from_(data, UNIX_S), setup)
    assert then.verdict == first.verdict
    assert [c.id for c in then.causes] == [c.id for c in first.causes]
    for one, other in zip(first.causes, then.causes, strict=True):
        for name, value in one.parameters.items():
            moved = UNIX_S if name == "t0_s" else 0.0
            assert other.parameters[name] == pytest.approx(value + moved, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("begin_s", [0.0, 3600.0, UNIX_S])
def test_a_drift_of_touches_is_no_height_of_the_table(begin_s: float) -> None:
    data = from_(touched(1, rate=RATE_UM_H), begin_s)
    found = tn.diagnose(data, SETUP)
    assert [c.id for c in found.causes] == ["drift_z"]
    assert found.causes[0].parameters["rate_um_h"] == pytest.approx(RATE_UM_H, abs=1.5)
    assert abs(found.model["EZ0A"]) < 1.5
    assert found.errors_std["EZ0A"] < 1.0
    fit = tn.identify(data, SETUP, effects=["drift_z"])
    assert abs(fit["EZ0A"]) < 1.5
    # What is simulated with what was identified drifts from its own first touch, too.
    again = tn.identify(tn.simulate(data, SETUP, fit), SETUP, effects=["drift_z"])
    assert again["EZ0A"] == pytest.approx(fit["EZ0A"], abs=1e-6)


@pytest.mark.parametrize("begin_s", [0.0, UNIX_S])
def test_a_warm_up_of_touches_begins_with_the_first(begin_s: float) -> None:
    fit = tn.identify(from_(touched(2, amplitude=40.0), begin_s), SETUP, effects=["warmup_z"])
    found = fit.effects["warmup_z"]
    assert found["amplitude_um"] == pytest.approx(40.0, abs=3.0)
    assert found["tau_min"] == pytest.approx(10.0, abs=1.5)
    assert abs(fit["EZ0A"]) < 1.5
    assert not any("warmup_z.tau_min" in note for note in fit.notes)


@pytest.mark.parametrize("begin_s", [0.0, UNIX_S])
def test_a_slip_is_stated_by_the_clock_of_the_data(begin_s: float) -> None:
    plan = from_(touched(3), begin_s)
    seconds, half = np.asarray(plan.time_s), len(plan) // 2
    slip = {
        "setup_shift": {"dx_um": 30.0, "dy_um": 0.0, "dz_um": 0.0, "t0_s": float(seconds[half])}
    }
    data = tn.simulate(plan, SETUP, effects=slip, noise_um=0.3, seed=3)
    for effects in (
        tn.identify(data, SETUP, ["setup_shift"]).effects,
        tn.diagnose(data, SETUP).model.effects,
    ):
        assert effects["setup_shift"]["dx_um"] == pytest.approx(30.0, abs=1.0)
        # Touches beside it that look across the slip do not tell when it was.
        assert seconds[half - 4] < effects["setup_shift"]["t0_s"] < seconds[half + 4]


def test_dates_whose_clocks_begin_elsewhere_are_compared_alike() -> None:
    days = 30 * 86400.0
    one, other = touched(4, rate=RATE_UM_H), touched(5, rate=RATE_UM_H)
    plain = tn.diagnose([one, other], SETUP)
    moved = tn.diagnose([from_(one, days), from_(other, 12 * days)], SETUP)
    assert moved.verdict == plain.verdict
    assert [c.id for c in moved.causes] == [c.id for c in plain.causes]
    for name, value in plain.errors_after.items():
        assert moved.errors_after[name] == pytest.approx(value, abs=1e-4)


def test_a_plan_of_any_clock_shows_the_same() -> None:
    plan = tn.plan(SETUP)
    here, there = tn.observability(plan, SETUP), tn.observability(from_(plan, UNIX_S), SETUP)
    assert there.share_left == pytest.approx(here.share_left, abs=1e-6)
