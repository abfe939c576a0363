"""Axis logs of a loop that is closed on the load: it makes good what lies before the load.

Drawn with the independent twin; a resonance is in `test_resonance_and_friction`.
"""

from dataclasses import replace

import numpy as np
import pytest

import axis_log_twin as twin
import trunnion as tn
from trunnion import contouring as ct
from trunnion._core import contour_axis_responses
from trunnion.contouring.servo import numbers
from trunnion.models.axis_log import AxisLogModel
from trunnion.setup import Artefact, Setup

AMPLITUDES = (1.0, 2.0, 3.0)  # µm


def test_a_cyclic_error_has_the_size_that_it_has_before_the_load() -> None:
    rng = np.random.default_rng(84)
    cases = twin.Cases(len(AMPLITUDES))
    cases.cyclic[:, 0] = np.array(AMPLITUDES) * twin.SMALL[0]
    cases.pitch[:, 0] = pitches = rng.uniform(5.0, 12.0, len(AMPLITUDES))
    cases.phase[:, 0] = rng.uniform(0.0, 2 * np.pi, len(AMPLITUDES))
    commands = [twin.commanded(feed / 60) for feed in (1000, 3000)]
    actual = [twin.actual(c, cases, feedback="load") for c in commands]
    servo = {**ct.Servo.paper().to_table(), "feedback": "load"}
    setup = Setup(artefact=Artefact("none"), servo=servo)
    for i, (amplitude, pitch) in enumerate(zip(AMPLITUDES, pitches.tolist(), strict=True)):
        d = tn.diagnose(twin.log(commands, [a[i] for a in actual], rng), setup)
        assert [c.id for c in d.causes] == ["cyclic_x"], d.summary()
        found = d.causes[0].parameters
        size = np.hypot(found["cosine_um"], found["sine_um"])
        assert size == pytest.approx(amplitude, abs=0.1)
        assert found["pitch_mm"] == pytest.approx(pitch, rel=0.01)


@pytest.mark.parametrize("period_ms", [1.0, 0.5])
def test_a_disturbance_goes_through_the_loop_as_the_core_simulates_it(period_ms: float) -> None:
    setup = tn.read_setup(tn.sample_path("contour/setup.toml"))
    setup = replace(setup, servo={**setup.servo, "period_ms": period_ms})
    model = AxisLogModel(tn.read_axis_log(tn.sample_path("contour/axislog.csv")), setup)
    axis = model._signals.axes[0]
    time = np.arange(len(axis.commanded)) * 1e-3
    disturbance = 3.0 + np.sin(40.0 * time) + np.cos(11.0 * time)
    found = axis.through_loop(np.stack([disturbance, 2.0 * disturbance]))
    plain = type(axis.servo)(axis.servo.gain_per_s, axis.servo.time_constant_ms)
    for run in axis.runs:
        fine = np.ascontiguousarray(run.by_period(disturbance[run.rows]))
        expected = contour_axis_responses(
            "X", numbers([plain]), run.control_s, "motor", fine, stride=run.substeps,
            starts=np.zeros((1, 2)),
        )[0]  # fmt: skip
        np.testing.assert_allclose(found[0, run.rows], expected, atol=1e-11)
        np.testing.assert_allclose(found[1, run.rows], 2.0 * expected, atol=1e-11)
