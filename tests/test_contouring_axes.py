"""One axis with friction, backlash, cyclic error, delay, resonance against the plain-numpy twin."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import axis_log_twin as twin
from trunnion import contouring as ct
from trunnion._core import contour_axis_response, contour_axis_responses
from trunnion.base.errors import InputError

SERVO = ct.Servo.paper()

# Axis, what it has, the same in the twin, agreement in µm or arcsec: rounding where both are
# exact; the twin's sub-steps where they are not.
EXTRAS = [
    ("X", {}, {}, 1e-8),
    ("X", {"coulomb_um": 3.0, "breakaway_um": 3.0}, {"friction": 3e-3}, 1e-8),
    ("C", {"coulomb_arcsec": 8.0, "breakaway_arcsec": 8.0}, {"friction": 8 / 3600}, 1e-8),
    ("Y", {"backlash_um": 4.0}, {"backlash": 4e-3}, 1e-8),
    ("Z", {"delay_ms": 1.25}, {"delay": 1.25e-3}, 1e-8),
    ("A", {"cyclic_arcsec": 1.0, "pitch_deg": 5.0, "phase_deg": 60.0},
     {"cyclic": 1 / 3600, "pitch": 5.0, "phase": np.pi / 3}, 1e-8),
    ("A", {"resonance_hz": 38.7, "damping": 0.06}, {"frequency": 38.7, "damping": 0.06}, 0.03),
    ("Z", {"resonance_hz": 53.2, "damping": 0.045}, {"frequency": 53.2, "damping": 0.045}, 1e-3),
]  # fmt: skip


@pytest.mark.parametrize(("letter", "own", "other", "within"), EXTRAS)
def test_response_agrees_with_the_twin(
    letter: str, own: dict[str, float], other: dict[str, float], within: float
) -> None:
    i = "XYZAC".index(letter)
    command = twin.commanded(50.0)
    cases = twin.Cases(1)
    for name, value in other.items():
        getattr(cases, name)[0, i] = value
    expected = twin.actual(command, cases)[0, :, i]
    axis = replace(SERVO.axes[letter], **own)  # type: ignore[arg-type]
    row = ct.Servo({letter: axis}).row(letter)
    found = contour_axis_response(letter, row, 1e-3, "motor", np.ascontiguousarray(command[:, i]))
    assert np.abs(found - expected).max() / twin.SMALL[i] < within


# Axis, what it has, by how much half the sub-step may change it, in µm or arcsec: by rounding where
# the twin is exact, else by an error that falls with the sub-step.
@pytest.mark.parametrize(
    ("letter", "name", "size", "within"),
    [
        ("X", "friction", 3e-3, 1e-8),
        ("Z", "friction", 0.2e-3, 1e-8),
        ("C", "friction", 8 / 3600, 1e-8),
        ("X", "backlash", 4e-3, 1e-8),
        ("A", "delay", 0.6e-3, 0.02),
        ("A", "frequency", 38.7, 0.02),
    ],
)
def test_the_twin_converges_under_refinement_of_its_sub_steps(
    letter: str, name: str, size: float, within: float
) -> None:
    i = "XYZAC".index(letter)
    command = _zigzag(i) if name == "friction" else twin.commanded(50.0)[:500]
    cases = twin.Cases(1)
    getattr(cases, name)[0, i] = size
    coarse, fine, finest = (twin.actual(command, cases, n)[0, :, i] for n in (4, 8, 16))
    first = np.abs(coarse - fine).max() / twin.SMALL[i]
    second = np.abs(fine - finest).max() / twin.SMALL[i]
    assert first < within
    assert second < max(0.5 * first, 1e-8)


def _zigzag(i: int) -> NDArray[np.float64]:
    """Commands of an axis that turns often and at once, at speeds of every size."""
    t = np.arange(0.0, 0.6, twin.PERIOD)
    out = np.zeros((len(t), 5))
    out[:, i] = 0.4 * np.sin(2 * np.pi * 4 * t) + 0.02 * np.sin(2 * np.pi * 43.3 * t)
    return out


def test_a_loop_closed_on_the_load_takes_the_cyclic_error_out() -> None:
    command = np.ascontiguousarray(np.linspace(0.0, 5.0, 6000))
    axis = ct.LinearAxis(81.28, 5.76, cyclic_um=2.0, pitch_mm=5.0)
    row = ct.Servo({"X": axis}).row("X")
    plain = ct.Servo({"X": ct.LinearAxis(81.28, 5.76)}).row("X")
    exact = contour_axis_response("X", plain, 1e-3, "motor", command)
    ripple = {
        feedback: np.ptp((contour_axis_response("X", row, 1e-3, feedback, command) - exact)[1000:])
        for feedback in ("motor", "load")
    }
    assert ripple["motor"] == pytest.approx(4e-3, rel=0.01)
    assert ripple["load"] < 0.05 * ripple["motor"]


def test_an_axis_sticks_below_breakaway_and_moves_above() -> None:
    axis = ct.LinearAxis(80.0, 5.0, coulomb_um=2.0, breakaway_um=4.0, stribeck_mm_min=60.0)
    row = ct.Servo({"X": axis}).row("X")
    for step_um, moves in ((3.9, False), (4.1, True)):
        command = np.r_[0.0, np.full(400, step_um * 1e-3)]
        y = contour_axis_response("X", row, 1e-3, "motor", command)
        assert bool(y[-1] != 0.0) is moves
        # It comes to rest short of the target, by no more than friction holds.
        assert abs(command[-1] - y[-1]) <= 4.0e-3 + 1e-12


def test_that_breakaway_is_at_least_the_coulomb_level_is_stated_where_it_is_refused() -> None:
    for axis, unit, stated in (
        (ct.LinearAxis, "um", "Where there is a Coulomb level, the breakaway must be at least"),
        (ct.RotaryAxis, "arcsec", "breakaway at least the Coulomb level"),
    ):
        with pytest.raises(InputError, match=rf"breakaway_{unit}: .*at least coulomb_{unit} = 3"):
            axis(80.0, 5.0, **{f"coulomb_{unit}": 3.0})
        assert stated in " ".join((axis.__doc__ or "").split())


@pytest.mark.parametrize(("letter", "stride"), [("Y", 1), ("Y", 4), ("C", 7)])
def test_many_responses_are_those_of_single_calls(letter: str, stride: int) -> None:
    command = 3.0 * np.sin(np.linspace(0.0, 7.0, 1001))
    rows = np.tile(ct.Servo.paper().row(letter), (5, 1))
    rows[:, 10] = [0.0, 20.0, 35.0, 35.0, 80.0]  # Hz
    rows[:, 11] = 0.05
    found = contour_axis_responses(letter, rows, 1e-3, "motor", command, stride=stride)
    single = [contour_axis_response(letter, row, 1e-3, "motor", command)[::stride] for row in rows]
    np.testing.assert_array_equal(found, single)


def test_many_responses_of_a_wrong_shape_are_refused() -> None:
    rows, command = np.tile(ct.Servo.paper().row("X"), (2, 1)), np.zeros(30)
    with pytest.raises(InputError, match="stride: got 0"):
        contour_axis_responses("X", rows, 1e-3, "motor", command, stride=0)
    with pytest.raises(InputError, match=r"axes: got shape \(2, 16\)"):
        contour_axis_responses("X", rows[:, 1:].copy(), 1e-3, "motor", command, stride=1)
    command[3] = np.nan
    with pytest.raises(InputError, match="command, row 3"):
        contour_axis_responses("X", rows, 1e-3, "motor", command, stride=1)
