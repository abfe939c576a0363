"""R-test and ball-bar tests of rotary axes: against the twin's table, and back to the errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn
from promise import kept, needed_runs
from trunnion.base.units import Floats
from trunnion.machine.chain import Chain
from trunnion.probing import rotary_readings
from trunnion.probing.rotary_readings import RotaryReadings
from twin import forward

SETUP = tn.Setup(artefact=tn.Artefact("none"))
ERRORS = {"EA0A": 12.0, "EB0A": -9.0, "EC0A": 7.0, "EY0A": 21.0, "EZ0A": -14.0}
ERRORS |= {"EB0C": 8.0, "EX0C": 15.0, "EY0C": -11.0}
BALL = (90.0, 20.0, 60.0)
TURNS = {"A": np.repeat([0.0, 60.0, -60.0, 90.0], 8), "C": np.tile(np.arange(0.0, 360.0, 45.0), 4)}


def twin_displacement(plan: tn.RotaryTest, ball: tuple[float, float, float]) -> Floats:
    """Ball on the twin's table minus commanded point, (n, 3), mm."""
    table = forward.table_pose(
        np.asarray(plan.a_deg), np.asarray(plan.c_deg), forward.Setup(), forward.Truth(ERRORS)
    )
    there: Floats = np.einsum("nij,j->ni", table[:, :3, :3], ball) + table[:, :3, 3]
    return there - plan.position_mm


def bars(direction: tuple[float, float, float]) -> tn.RotaryTest:
    return tn.plan_rotary_test(SETUP, BALL, TURNS, bar_mm=100.0 * np.array(direction))


def test_displacements_are_the_twins() -> None:
    plan = tn.plan_rotary_test(SETUP, BALL, TURNS)
    made = tn.simulate_rotary_test(plan, SETUP, BALL, ERRORS)
    assert made.displacement_um is not None
    assert np.abs(made.displacement_um - 1e3 * twin_displacement(plan, BALL)).max() < 1e-8


@pytest.mark.parametrize("frame", ["machine", "work"])
def test_lengths_are_the_twins(frame: str) -> None:
    bar = (60.0, 0.0, 80.0)
    plan = tn.plan_rotary_test(SETUP, BALL, TURNS, bar_mm=bar, frame=frame)  # type: ignore[arg-type]
    nominal = tn.simulate_rotary_test(plan, SETUP, BALL, {}, bar=True)
    assert nominal.length_mm == pytest.approx(np.full(32, 100.0), abs=1e-10)
    made = tn.simulate_rotary_test(plan, SETUP, BALL, ERRORS, bar=True)
    expected = np.linalg.norm(twin_displacement(plan, BALL), axis=1)
    assert made.length_mm == pytest.approx(expected, abs=1e-10)


def test_many_rows_have_the_derivatives_of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Derivatives are made some rows at a time."""
    plan = tn.plan_rotary_test(SETUP, BALL, TURNS)
    made = tn.simulate_rotary_test(plan, SETUP, BALL, ERRORS)
    whole = RotaryReadings.of(made, SETUP, BALL)
    expected, readings = whole.jacobian(whole.start), whole.modelled(whole.start)
    monkeypatch.setattr(rotary_readings, "ROWS_AT_ONCE", 7)
    parts = RotaryReadings.of(made, SETUP, BALL)
    np.testing.assert_allclose(parts.jacobian(parts.start), expected, atol=1e-12)
    np.testing.assert_allclose(parts.modelled(parts.start), readings, atol=1e-12)
    step = np.eye(len(parts.start))[0]
    ahead, behind = (whole.modelled(whole.start + d) for d in (step, -step))
    np.testing.assert_allclose(expected[:, 0], (ahead - behind).ravel() / 2, atol=1e-9)


def test_stops_that_are_gone_to_again_are_worked_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit; each ball has stops of its own."""
    plan = tn.plan_rotary_test(SETUP, BALL, TURNS)
    other = tn.plan_rotary_test(SETUP, (BALL[0], -BALL[1], BALL[2]), TURNS)
    rng = np.random.default_rng(4)
    columns = {k: np.concatenate([v, other.columns[k]]) for k, v in plan.columns.items()}
    columns["ball"] = np.repeat(["one", "two"], len(plan))
    rows = rng.integers(0, 2 * len(plan), 400)
    again = tn.RotaryTest({k: v[rows] for k, v in columns.items()})
    measured = {name: rng.normal(0.0, 5.0, 400) for name in ("dx_um", "dy_um", "dz_um")}
    places: dict[str | int, tuple[float, float, float]] = {
        "one": BALL,
        "two": (BALL[0], -BALL[1], BALL[2]),
    }
    made = again.with_columns(**measured)
    plainly = RotaryReadings.of(made, SETUP, places)
    monkeypatch.setattr(rotary_readings, "MANY_ROWS", 1000)
    at_stops = RotaryReadings.of(made, SETUP, places)
    x = plainly.start + rng.normal(0.0, 10.0, len(plainly.start))
    assert at_stops._stops is not None
    assert len(at_stops._stops[0].data) == 2 * len(plan)
    assert np.array_equal(at_stops.modelled(x), plainly.modelled(x))
    assert np.array_equal(at_stops.jacobian(x), plainly.jacobian(x))


def test_an_r_test_gives_the_errors_and_the_place_of_the_ball() -> None:
    plan = tn.plan_rotary_test(SETUP, BALL, TURNS)
    there = (BALL[0] + 0.31, BALL[1] - 0.12, BALL[2] + 0.05)
    fit = tn.identify_rotary_test(tn.simulate_rotary_test(plan, SETUP, there, ERRORS), SETUP, BALL)
    assert fit.errors == pytest.approx(ERRORS, abs=1e-5)
    assert fit.offsets_um["ball"] == pytest.approx((310.0, -120.0, 50.0), abs=1e-5)
    assert fit.converged
    assert fit.not_identifiable == ()


def test_bars_in_three_directions_give_what_an_r_test_gives() -> None:
    plans = [bars(direction) for direction in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    columns = {k: np.concatenate([np.asarray(p[k]) for p in plans]) for k in plans[0].columns}
    made = tn.simulate_rotary_test(tn.RotaryTest(columns), SETUP, BALL, ERRORS, bar=True)
    fit = tn.identify_rotary_test(made, SETUP, BALL)
    assert fit.errors == pytest.approx(ERRORS, abs=1e-5)


@pytest.mark.parametrize("errors", [{}, ERRORS])
def test_a_bar_is_blind_across_its_direction(errors: dict[str, float]) -> None:
    """Along X: what moves the ball along Y or Z; and EX0C, as the ball stays at one height of C."""
    made = tn.simulate_rotary_test(bars((1, 0, 0)), SETUP, BALL, errors, bar=True)
    fit = tn.identify_rotary_test(made, SETUP, BALL, sigma_um=1.0)
    open_ones = {name for name in fit.errors if not np.isfinite(fit.std_errors[name])}
    assert open_ones == {"EA0A", "EY0A", "EZ0A", "EB0C", "EX0C", "EY0C"}
    assert all(fit.std_errors[name] < 100 for name in set(fit.errors) - open_ones)


def test_a_test_with_c_alone_sees_the_four_location_errors_of_c() -> None:
    """Where its axis is along X and Y, and how it is tilted (ISO 230-1), not how A is."""
    hidden = {"EX0C": 15.0, "EY0C": -11.0, "EA0A": 12.0, "EB0C": 8.0}
    plan = tn.plan_rotary_test(SETUP, BALL, {"A": 0.0, "C": np.arange(0.0, 360.0, 30.0)})
    fit = tn.identify_rotary_test(tn.simulate_rotary_test(plan, SETUP, BALL, hidden), SETUP, BALL)
    seen = {name: fit[name] for name in fit.errors if np.isfinite(fit.std_errors[name])}
    assert seen == pytest.approx(hidden, abs=1e-6)


def test_an_offset_of_the_tool_is_not_told_from_a_shift_of_both_axes() -> None:
    plan = tn.plan_rotary_test(SETUP, BALL, TURNS)
    made = tn.simulate_rotary_test(plan, SETUP, BALL, ERRORS, tool_offset_um=(6.0, -3.0, 2.0))
    fit = tn.identify_rotary_test(made, SETUP, BALL, tool_is_known=False)
    open_ones = {name for name in fit.errors if not np.isfinite(fit.std_errors[name])}
    assert open_ones == {"EX0C", "EY0A", "EZ0A", "EY0C"}
    assert len(fit.combinations) == 3
    for name in set(ERRORS) - open_ones:
        assert fit[name] == pytest.approx(ERRORS[name], abs=1e-5), name
    assert fit["EY0C"] - fit["EY0A"] == pytest.approx(-32.0, abs=1e-5)
    wrong = tn.identify_rotary_test(made, SETUP, BALL)  # the offset is taken for errors
    assert wrong["EX0C"] == pytest.approx(15.0 - 6.0, abs=1e-3)


def test_intervals_hold_the_errors_as_often_as_they_say() -> None:
    plan = tn.plan_rotary_test(SETUP, BALL, TURNS)
    exact = tn.simulate_rotary_test(plan, SETUP, BALL, ERRORS)
    runs, inside = needed_runs(0.95), dict.fromkeys(ERRORS, 0)
    for seed in range(runs):
        noise = np.random.default_rng(seed).normal(0.0, 0.8, (3, len(plan)))
        given = {
            k: exact[k] + row for k, row in zip(("dx_um", "dy_um", "dz_um"), noise, strict=True)
        }
        fit = tn.identify_rotary_test(exact.with_columns(**given), SETUP, BALL, sigma_um=0.8)
        for name, value in ERRORS.items():
            inside[name] += abs(fit[name] - value) < 1.96 * fit.std_errors[name]
    for name, count in inside.items():
        assert kept(count, runs, 0.95), name


@pytest.mark.parametrize("preset", ["trt-bc", "tt-ab", "table-c-head-b", "nutating-table"])
def test_other_machines_are_identified_as_well(preset: str) -> None:
    setup = replace(SETUP, machine=tn.Machine(preset))
    chain, rng = Chain(setup), np.random.default_rng(1)
    turns = {letter: rng.uniform(-60, 60, 40) for letter in chain.letters}
    hidden = {name: float(rng.uniform(-20, 20)) for name in chain.location_errors}
    plan = tn.plan_rotary_test(setup, BALL, turns)
    made = tn.simulate_rotary_test(plan, setup, BALL, hidden)
    assert np.abs(tn.simulate_rotary_test(plan, setup, BALL, {})["dx_um"]).max() < 1e-8
    fit = tn.identify_rotary_test(made, setup, BALL)
    assert fit.rms_um < 1e-6
    seen = [name for name in fit.errors if np.isfinite(fit.std_errors[name])]
    assert len(seen) >= 6
    for name in seen:
        assert fit[name] == pytest.approx(hidden[name], abs=1e-4), name


def test_two_places_of_the_ball(tmp_path: Path) -> None:
    first = tn.plan_rotary_test(SETUP, BALL, TURNS).with_columns(ball=["low"] * 32)
    high = (-70.0, 40.0, 120.0)
    second = tn.plan_rotary_test(SETUP, high, TURNS).with_columns(ball=["high"] * 32)
    one = tn.simulate_rotary_test(first, SETUP, BALL, ERRORS)
    two = tn.simulate_rotary_test(second, SETUP, high, ERRORS)
    both = tn.RotaryTest({k: np.concatenate([one[k], two[k]]) for k in one.columns})
    both.to_csv(tmp_path / "both.csv")
    read = tn.read_rotary_test(tmp_path / "both.csv")
    fit = tn.identify_rotary_test(read, SETUP, {"low": BALL, "high": high})
    assert fit.errors == pytest.approx(ERRORS, abs=1e-4)
    assert set(fit.offsets_um) == {"ball_low", "ball_high"}


def test_what_is_wrong_with_a_test_is_said() -> None:
    plan = tn.plan_rotary_test(SETUP, BALL, TURNS)
    made = tn.simulate_rotary_test(plan, SETUP, BALL, ERRORS)
    with pytest.raises(tn.DataError, match="got no readings, expected dx_um, dy_um, dz_um or"):
        tn.identify_rotary_test(plan, SETUP, BALL)
    with pytest.raises(tn.DataError, match="got 9 readings, expected more than 11 unknowns"):
        tn.identify_rotary_test(made[:3], SETUP, BALL)
    with pytest.raises(tn.DataError, match=r"mm from the modelled one.*senses of the rotary axes"):
        tn.identify_rotary_test(made.with_columns(c_deg=-made["c_deg"]), SETUP, BALL)
    with pytest.raises(tn.InputError, match="got none of ball b, expected its place"):
        tn.identify_rotary_test(made.with_columns(ball=["b"] * 32), SETUP, {"a": BALL})
    with pytest.raises(tn.InputError, match="readings of an R-test and of a ball-bar"):
        made.with_columns(length_mm=np.full(32, 100.0))
    still = made.with_columns(**dict.fromkeys(("dx_um", "dy_um", "dz_um"), np.full(32, 3.0)))
    with pytest.raises(tn.DataError, match=r"3, 3, 3 in all 32 rows.*instrument stand still"):
        tn.diagnose(still, SETUP)
    with pytest.raises(tn.InputError, match="no noise without a seed"):
        tn.simulate_rotary_test(plan, SETUP, BALL, noise_um=1.0)


def test_its_estimate_compensates_and_simulates_as_any_other() -> None:
    plan = tn.plan_rotary_test(SETUP, BALL, TURNS)
    made = tn.simulate_rotary_test(plan, SETUP, BALL, ERRORS)
    fit = tn.identify_rotary_test(made, SETUP, BALL)
    cross = tn.Setup(artefact=tn.Artefact("cross"))
    touches = tn.simulate(tn.plan(cross), cross, fit)
    assert tn.identify(touches, cross).errors == pytest.approx(ERRORS, abs=1e-4)
    left = {name: ERRORS[name] - fit[name] for name in ERRORS}
    assert tn.volumetric_error(cross, left).max_um < 1e-3
    assert tn.volumetric_error(cross, fit).max_um > 10
    alone = tn.simulate_rotary_test(bars((1, 0, 0)), SETUP, BALL, ERRORS, bar=True)
    partial = tn.identify_rotary_test(alone, SETUP, BALL)
    with pytest.raises(tn.DataError, match="not identifiable"):
        tn.volumetric_error(cross, partial)
