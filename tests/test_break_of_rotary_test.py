"""Tests of rotary axes in two parts: what moved in the pause is a cause, what did not is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rotary_test_twin
import trunnion as tn
from promise import kept, needed_runs
from rotary_test_twin import Hidden, shifted
from trunnion.base.units import Floats
from trunnion.models.kinds import model_of
from twin import forward

RATE = 0.9
NOISE_UM = 0.4
SURE = 0.9
PAUSE_S, NIGHT_S = 900.0, 40000.0
"""Over minutes a drift shows within the parts."""
BALLS = np.array([[90.0, 20.0, 60.0], [40.0, -60.0, 120.0]])
TILTS, TURNS = np.meshgrid([0.0, 30.0, 60.0, 90.0, -30.0, -60.0], np.arange(0.0, 360.0, 30.0))
ONE_UM = {"y": np.array([0.0, 1.0, 0.0]), "z": np.array([0.0, 0.0, 1.0])}


def in_two(balls: int, pause: float = PAUSE_S) -> rotary_test_twin.Test:
    """Tilts and turns about one or two balls, a pause between the two halves."""
    test = rotary_test_twin.Test.of(TILTS.T.ravel(), TURNS.T.ravel(), BALLS[:balls])
    return replace(test, pause=pause)


def errors_of(rng: np.random.Generator) -> dict[str, float]:
    return {name: float(rng.normal(0.0, 12.0)) for name in forward.LOCATION_ERRORS["trt-ca"]}


def diagnosed(test: rotary_test_twin.Test, change: Floats | float, seed: int) -> tn.Diagnosis:
    """Diagnose a machine with errors at random and a change of its readings."""
    rng = np.random.default_rng([71, seed])
    read = test.readings(Hidden(errors_of(rng), {})) + change
    read = read + NOISE_UM * rng.standard_normal(read.shape)
    return tn.diagnose(test.data(read), test.setup())


def sure(d: tn.Diagnosis) -> set[str]:
    """Causes that are named with more than 90 %."""
    return {c.id for c in d.causes if c.probability > SURE}


def off(test: rotary_test_twin.Test, way: str, size_um: float) -> Floats:
    """The tool stands elsewhere after the pause: readings of an R-test have its opposite."""
    return np.asarray(-size_um * np.outer(test.late, ONE_UM[way]).ravel())


def moved(test: rotary_test_twin.Test, size: float) -> Floats:
    """The ball stands elsewhere on the table after the pause: along X, half as far along −Y."""
    way = 1e-3 * size * np.array([1.0, -0.5, 0.0])
    slipped = Hidden({}, {}, moved=np.outer(test.late, way))
    return np.asarray(test.readings(slipped) - test.readings(Hidden({}, {})))


MOVED: tuple[tuple[int, dict[str, float]], ...] = (
    (2, {"location_shift_c": 2.0}),
    (2, {"zero_shift_z": -6.0}),
    (2, {"zero_shift_z": -6.0, "location_shift_c": 4.0}),
    (1, {"setup_shift": 5.0}),
)
"""Balls, and sizes of what moved in the pause, µm."""


def test_what_moved_in_a_pause_is_named() -> None:
    """A table that grew was a turn of the sensors and an axial error motion of C, in 11 of 12."""
    runs = needed_runs(RATE)
    right = inside = 0
    for seed in range(runs):
        balls, sizes = MOVED[seed % len(MOVED)]
        test = in_two(balls)
        change = np.sum([_change(test, name, size) for name, size in sizes.items()], axis=0)
        d = diagnosed(test, change, seed)
        right += sure(d) == set(sizes)
        named = {c.id: c for c in d.causes}
        first = {name: next(iter(named[name].parameters)) for name in sizes if name in named}
        near = [abs(named[k][p] - sizes[k]) < 4 * named[k].std_errors[p] for k, p in first.items()]
        truth = errors_of(np.random.default_rng([71, seed]))
        near += [abs(d.errors_after[n] - v) < 4 * d.errors_std[n] for n, v in truth.items()]
        inside += all(near)
    assert kept(right, runs, RATE), right
    assert kept(inside, runs, RATE), inside


def _change(test: rotary_test_twin.Test, name: str, size: float) -> Floats:
    if name == "location_shift_c":
        return size * shifted(test, "EY0C")
    return moved(test, size) if name == "setup_shift" else off(test, name[-1], size)


def test_a_pause_alone_moves_nothing() -> None:
    runs = needed_runs(RATE)
    quiet = sum(not diagnosed(in_two(1 + seed % 2), 0.0, seed).named for seed in range(runs))
    assert kept(quiet, runs, RATE), quiet


@pytest.mark.power
def test_a_drift_over_a_night_is_not_a_shift_for_sure() -> None:
    """What happened in between no reading says."""
    runs = needed_runs(RATE)
    right = 0
    for seed in range(runs):
        test = in_two(1 + seed % 2, NIGHT_S)
        drift = np.outer(-5.0 * test.time / test.time[-1], ONE_UM["z"]).ravel()
        right += not any("shift" in name for name in sure(diagnosed(test, drift, seed)))
    assert kept(right, runs, RATE), right


@pytest.mark.parametrize("balls", [1, 2])
def test_shifts_are_the_twins(balls: int) -> None:
    """Each as the twin's machine has it, to second order in a length; by their columns."""
    test = in_two(balls)
    plain = test.readings(Hidden({}, {}))
    model = model_of(test.data(plain), test.setup())
    late = 1e-3 * test.late
    expected = {
        "zero_shift_y": {"d_um": test.readings(Hidden({}, {}, off=np.outer(late, ONE_UM["y"])))},
        "zero_shift_z": {"d_um": test.readings(Hidden({}, {}, off=np.outer(late, ONE_UM["z"])))},
        "location_shift_c": {"EY0C_um": plain + shifted(test, "EY0C")},
    }
    if balls == 1:
        expected["setup_shift"] = {
            f"d{x}_um": test.readings(Hidden({}, {}, moved=np.outer(late, row)))
            for x, row in zip("xyz", np.eye(3), strict=True)
        }
    shifts = {e.id for e in model.effects if "shift" in e.id}
    assert shifts == {*expected, "zero_shift_x"}
    for name, parameters in expected.items():
        effect = model.effect(name)
        assert [p.name for p in effect.parameters] == list(parameters)
        for parameter, read in parameters.items():
            ours = effect.change({**dict.fromkeys(parameters, 0.0), parameter: 1.0})
            assert np.allclose(np.asarray(ours), read - plain, atol=1e-4), (name, parameter)


def test_every_break_is_a_moment_and_a_test_in_one_go_has_none() -> None:
    balls = np.vstack([BALLS, [-80.0, 50.0, 90.0]])
    three = rotary_test_twin.Test.of(TILTS.T.ravel(), TURNS.T.ravel(), balls)
    data = three.data(three.readings(Hidden({}, {})))
    n = TILTS.size
    for pause, moments in ((100.0, ()), (600.0, (3.0 * n + 298.5, 6.0 * n + 898.5))):
        timed = data.with_columns(time_s=np.asarray(data.time_s) + pause * three.label)
        shifts = [e for e in model_of(timed, three.setup()).effects if "shift" in e.id]
        assert bool(shifts) == bool(moments)
        for effect in shifts:
            (at,) = (p for p in effect.parameters if p.grid)
            assert at.grid == pytest.approx(moments)
    untimed = model_of(data.with_columns(time_s=None), three.setup())
    assert not [e.id for e in untimed.effects if "shift" in e.id]
