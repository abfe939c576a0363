"""Axis logs of which the actual positions are recorded late: the log is late, not a loop slow.

Logs of the independent twin, with other causes beside the delay. The servos of the twin are those
of the set-up, but for what is hidden.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import axis_log_twin as twin
import trunnion as tn
from trunnion import contouring as ct
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.axis_log.model import AxisLogModel
from trunnion.setup import Artefact, Setup

Floats = NDArray[np.float64]
Hide = Callable[[twin.Cases], None]

SETUP = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
X, Y = 0, 1


@cache
def commands() -> tuple[Floats, ...]:
    return tuple(twin.commanded(feed) for feed in (100.0, 200.0))


def diagnosed(delay_ms: float, hide: Hide, axes: str, seed: int = 0) -> Diagnosis:
    cases = twin.Cases(1)
    cases.log_delay[0] = 1e-3 * delay_ms
    hide(cases)
    actual = [twin.actual(c, cases)[0] for c in commands()]
    log = twin.log(commands(), actual, np.random.default_rng(seed))
    names = ["time_s", "run", *(f"{x}_{what}_mm" for x in axes for what in ("cmd", "act"))]
    return tn.diagnose(tn.AxisLog(**{name: np.asarray(log[name]) for name in names}), SETUP)


def nothing(cases: twin.Cases) -> None:
    pass


def friction(cases: twin.Cases) -> None:
    cases.friction[0, X] = 3e-3


def backlash(cases: twin.Cases) -> None:
    cases.backlash[0, X] = 5e-3


def gain(cases: twin.Cases) -> None:
    cases.gain[0, Y] *= 1.03


def gains(cases: twin.Cases) -> None:
    cases.gain[0] *= 0.8


@pytest.mark.parametrize("delay_ms", [0.5, 1.0, 2.0])
@pytest.mark.parametrize(
    ("hide", "truth"),
    [
        (nothing, {}),
        (friction, {"friction_x": 3.0}),
        (backlash, {"backlash_x": 5.0}),
        (gain, {"gain_y": 3.0}),
        (gains, {"gain_x": -20.0, "gain_y": -20.0}),
    ],
)
def test_a_late_log_is_named_beside_other_causes(
    delay_ms: float, hide: Hide, truth: dict[str, float]
) -> None:
    d = diagnosed(delay_ms, hide, "xy")
    assert frozenset.intersection(*d.alternatives) >= {"log_delay", *truth}
    errors = {c.id: next(iter(c.std_errors.values())) for c in d.causes}
    for name, size in {"log_delay": delay_ms, **truth}.items():
        (found,) = d.effects[name].values()
        assert found == pytest.approx(size, abs=5 * errors[name] + 1e-3 * abs(size))
    # Beside the truth nothing of a size that matters: what costs nothing may be off by little.
    assert not {n for n in d.named - truth.keys() if n.startswith(("gain", "loop_delay"))}


@pytest.mark.parametrize("hide", [nothing, gains])
def test_of_one_axis_a_late_log_is_named_or_stands_beside_what_looks_like_it(hide: Hide) -> None:
    d = diagnosed(1.0, hide, "x", seed=1)
    assert any("log_delay" in names for names in d.alternatives)


@pytest.mark.parametrize("axes", ["x", "xz"])
@pytest.mark.parametrize("seed", [0, 1])
def test_strong_gain_and_friction_have_finite_standard_errors(axes: str, seed: int) -> None:
    def hide(cases: twin.Cases) -> None:
        cases.gain[0] *= 1.2
        cases.friction[0, X] = 10e-3

    d = diagnosed(0.0, hide, axes, seed)
    assert d.alternatives[0] >= {"friction_x", *(f"gain_{axis}" for axis in axes)}
    errors = [s for c in d.causes for s in c.std_errors.values()]
    assert np.all(np.isfinite(errors) & (np.array(errors) > 0))


def test_what_a_servo_that_runs_away_recorded_stays_as_it_is() -> None:
    """A search for a servo far from its log may pass one: there a spline of it was an error."""
    time = 0.008 * np.arange(40)
    log = tn.AxisLog(time_s=time, x_cmd_mm=np.sin(time), x_act_mm=np.sin(time - 0.02))
    axis = AxisLogModel(log, SETUP)._signals.axes[0]
    runaway = np.full(40, np.inf)
    np.testing.assert_array_equal(axis._earlier(runaway, 1.0), runaway)
