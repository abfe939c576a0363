"""Diagnosis of axis logs made by an independent twin: blind cases, aliases, bad input.

The full power table is made by ``tests/power/axis_logs.py``.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import axis_log_twin as twin
import trunnion as tn
from trunnion import contouring as ct
from trunnion.diagnosis import Diagnosis, diagnose
from trunnion.errors import DataError, InputError, UnknownNameError
from trunnion.models.axis_log import AxisLogModel
from trunnion.setup import Artefact, Setup

SETUP = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
BLIND_CASES = 9
SEED = 20


@cache
def commands() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return twin.commanded(1000 / 60), twin.commanded(3000 / 60)


@cache
def blind() -> tuple[list[str | None], list[tn.AxisLog]]:
    rng = np.random.default_rng(SEED)
    cases, truth = twin.draw(BLIND_CASES, rng)
    actual = [twin.actual(c, cases) for c in commands()]
    logs = [twin.log(commands(), [a[i] for a in actual], rng) for i in range(BLIND_CASES)]
    return truth, logs


def hits(d: Diagnosis, truth: str | None) -> bool:
    if truth is None:
        return d.verdict == "consistent"
    return any(truth == c.id or truth in c.aliases for c in d.causes)


@pytest.mark.parametrize("case", range(BLIND_CASES))
def test_blind_case_is_named(case: int) -> None:
    truth, logs = blind()
    assert hits(diagnose(logs[case], SETUP), truth[case])


def test_sizes_are_found_and_a_held_out_feed_gains() -> None:
    cases = twin.Cases(1)
    cases.gain[0, 1] *= 1.02
    rng = np.random.default_rng(3)
    log = twin.log(commands(), [twin.actual(c, cases)[0] for c in commands()], rng)
    d = diagnose(log, SETUP)
    assert [c.id for c in d.causes] == ["gain_y"]
    found, error = d.causes[0].parameters, d.causes[0].std_errors
    assert found["gain_percent"] == pytest.approx(2.0, abs=5 * error["gain_percent"])
    assert d.gain.heldout_rms_after_um < 0.5 * d.gain.heldout_rms_before_um
    servo = d.model.servo
    assert servo.axes["Y"].gain_per_s == pytest.approx(80.544 * 1.02, rel=1e-4)


def test_rotary_centre_shows_in_the_tool_tip_only() -> None:
    errors = {"EX0C": 12.0, "EZ0A": -8.0}
    run = ct.simulate(ct.Path.paper(offset_mm=(0, 0, 20)), 3000.0, controller="independent")
    log = run.axis_log(noise_um=0.2, noise_arcsec=1.0, seed=4)
    assert diagnose(log, SETUP).verdict == "consistent"
    real = ct.simulate(
        ct.Path.paper(offset_mm=(0, 0, 20)), 3000.0, controller="independent", errors=errors
    )
    noise = 2e-4 * np.random.default_rng(5).standard_normal(real.tip_mm.shape)
    tip = dict(zip(("tip_x_mm", "tip_y_mm", "tip_z_mm"), (real.tip_mm + noise).T, strict=True))
    d = diagnose(log.with_columns(**tip), SETUP)
    assert [c.id for c in d.causes] == ["rotary_centre"]
    for name, value in errors.items():
        assert d.causes[0].parameters[f"{name}_um"] == pytest.approx(value, abs=0.1)


def test_autocorrelated_noise_is_no_effect() -> None:
    rng = np.random.default_rng(6)
    alarms = 0
    plain = [twin.actual(c, twin.Cases(1))[0] for c in commands()]
    for _ in range(3):
        log = twin.log(commands(), plain, rng, memory=0.97)
        alarms += diagnose(log, SETUP).verdict != "consistent"
    # Of white noise 5 % may alarm; the memory of this noise has to be estimated.
    assert alarms <= 1


def test_a_users_own_effect_competes() -> None:
    class Thermal:
        id = "x_grows"
        parameters = ("rate_um_s",)

        def change(self, log: tn.AxisLog, values: Mapping[str, float]) -> NDArray[np.float64]:
            out = np.zeros((len(log), len(log.axes)))
            out[:, 0] = values["rate_um_s"] * log.time_s
            return out

    log = ct.simulate(ct.Path.paper(), 1000.0, controller="independent").axis_log(
        noise_um=0.2, noise_arcsec=1.0
    )
    drifted = log.with_columns(x_act_mm=log.actual("x") + 1e-3 * log.time_s)
    d = diagnose(drifted, SETUP, effects=(Thermal(),))
    assert [c.id for c in d.causes] == ["x_grows"]
    assert d.causes[0].parameters["rate_um_s"] == pytest.approx(1.0, abs=0.05)


def test_bad_input() -> None:
    log = ct.simulate(ct.Path.paper(), 3000.0, controller="independent").axis_log()
    with pytest.raises(InputError, match="Setup"):
        diagnose(log)
    with pytest.raises(InputError, match=r"\[servo\.X\]"):
        AxisLogModel(log, replace(SETUP, servo={}))
    with pytest.raises(DataError, match="even sampling"):
        AxisLogModel(log.with_columns(time_s=log.time_s**1.1), SETUP)
    with pytest.raises(DataError, match="at least 20"):
        AxisLogModel(log[:10], SETUP)
    with pytest.raises(UnknownNameError, match="gain_q"):
        AxisLogModel(log, SETUP, ("gain_q",))
    with pytest.raises(DataError, match="multiple of"):
        AxisLogModel(log, replace(SETUP, servo={**SETUP.servo, "period_ms": 0.7}))
