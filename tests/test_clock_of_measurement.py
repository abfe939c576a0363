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
    if kind.name != "diameters"  # their times are those within a pass: below
    for example in kind.examples
]
NOTE = "time_s begins at "
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
    begin_s = float(np.min(data["time_s"]))
    for one, other in zip(first.causes, then.causes, strict=True):
        for name, value in one.parameters.items():
            moved = begin_s if name == "t0_s" else 0.0
            assert other.parameters[name] == pytest.approx(value - moved, rel=1e-6, abs=1e-6)
    np.testing.assert_allclose(left(then), left(first), atol=1e-6)
    # Nothing that is said or kept is by the clock of the rows, which one note names.
    assert len([note for note in then.notes if NOTE in note]) == 1
    assert not any(NOTE in note for note in first.notes)
    assert np.min(then.data["time_s"]) == 0.0
    assert f"{UNIX_S:.0f}"[:4] not in then.summary().replace(said(then), "")


def left(found: tn.Diagnosis) -> Any:
    """What the extended model leaves of each reading."""
    assert found.residuals is not None
    return found.residuals.after


def said(found: tn.Diagnosis) -> str:
    """The note about the clock."""
    return next(note for note in found.notes if NOTE in note)


def slipped(rng: np.random.Generator, kind: str) -> tuple[Any, Any, float]:
    """A measurement in which the part, or the ball, slips; its set-up and the moment, s."""
    if kind == "points":
        place = np.array([(x, y) for x in range(0, 250, 50) for y in range(0, 250, 50)], float)
        after = (np.arange(25) >= rng.integers(8, 17)).astype(float)
        off = rng.normal(0.0, 0.4, (25, 2)) + after[:, None] * rng.uniform(12.0, 20.0, 2)
        columns = {"nominal_x_mm": place[:, 0], "nominal_y_mm": place[:, 1]}
        points = tn.Points(
            {
                **columns,
                "x_mm": place[:, 0] + 1e-3 * off[:, 0],
                "y_mm": place[:, 1] + 1e-3 * off[:, 1],
            }
        )
        times = 40.0 + 30.0 * np.arange(25)
        return points.with_columns(time_s=times), None, 30.0 * float(np.argmax(after)) - 15.0
    plan = tn.plan(SETUP)
    seconds = np.asarray(plan.time_s)
    at = int(rng.integers(len(plan) // 3, 2 * len(plan) // 3))
    moment = (seconds[at] + seconds[at - 1]) / 2
    slip = {"dx_um": 30.0, "dy_um": -20.0, "dz_um": 0.0, "t0_s": moment}
    made = tn.simulate(
        plan, SETUP, effects={"setup_shift": slip}, noise_um=0.3, seed=int(rng.integers(1000))
    )
    return made, SETUP, moment - float(seconds[0])


@pytest.mark.parametrize("kind", ["points", "touches"])
@pytest.mark.parametrize("seed", range(3))
def test_a_moment_counts_from_the_first_reading_everywhere(kind: str, seed: int) -> None:
    data, setup, moment = slipped(np.random.default_rng([seed, 61]), kind)
    step = float(np.median(np.diff(data["time_s"])))
    found = tn.diagnose(from_(data, UNIX_S), setup)
    assert "setup_shift" in found.named
    at = found.effects["setup_shift"]["t0_s"]
    assert abs(at - moment) < 4 * step
    assert found.model.effects["setup_shift"]["t0_s"] == at
    assert tn.Diagnosis.from_json(found.to_json()).effects["setup_shift"]["t0_s"] == at
    assert f"{UNIX_S:.0f}"[:4] not in found.summary().replace(said(found), "")
    # What is predicted is as of the same rows by their own clock.
    own = tn.diagnose(data, setup)
    np.testing.assert_allclose(left(found), left(own), atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_of_several_each_counts_from_its_own_first_reading(seed: int) -> None:
    rng = np.random.default_rng([seed, 62])
    one, setup, moment = slipped(rng, "touches")
    other, _, later = slipped(rng, "touches")
    found = tn.diagnose([from_(one, UNIX_S), from_(other, UNIX_S + 3e5)], setup)
    step = float(np.median(np.diff(one["time_s"])))
    for name, at in (("touches", moment), ("touches 2", later)):
        assert abs(found.effects[f"{name}:setup_shift"]["t0_s"] - at) < 4 * step
    notes = [note for note in found.notes if NOTE in note]
    assert [note.partition(":")[0] for note in notes] == ["touches", "touches 2"]


def turned(seed: int) -> tuple[tn.Diameters, tn.Setup]:
    """Three passes of a tool that grows by 12 µm as it heats up, each from cold."""
    rng, z = np.random.default_rng([seed, 63]), np.linspace(100.0, 0.0, 40)
    gone = np.linspace(0.0, 120.0, 40)
    off = -12.0 * (1.0 - np.exp(-gone / 30.0))
    columns = {
        "z_mm": np.tile(z, 3),
        "error_um": np.concatenate([off + rng.normal(0.0, 0.3, 40) for _ in range(3)]),
        "pass": np.repeat(["1", "2", "3"], 40),
        "time_s": np.tile(gone, 3),
    }
    return tn.Diameters(columns), tn.Setup(tn.Artefact("cross"), turning={"overhang_mm": 100.0})


@pytest.mark.parametrize("seed", range(3))
def test_each_pass_of_a_tool_counts_from_its_first_reading(seed: int) -> None:
    """By a clock from 1970 the tool was warm for decades: nothing that it does is of it."""
    data, setup = turned(seed)
    paused = 900.0 * np.repeat(np.arange(3), 40)
    absolute = data.with_columns(time_s=UNIX_S + paused + np.asarray(data.time_s))
    plain, found = tn.diagnose(data, setup), tn.diagnose(absolute, setup)
    assert "tool_heating" in plain.named
    assert found.named == plain.named
    for id_, values in plain.effects.items():
        assert found.effects[id_] == pytest.approx(values, rel=1e-6)
    assert NOTE in found.notes[0]
    assert "first reading of its pass" in found.notes[0]
    # A clock that runs on from pass to pass is one of a tool that was warm before.
    running = data.with_columns(time_s=paused / 7.5 + np.asarray(data.time_s))
    assert not any(NOTE in note for note in tn.diagnose(running, setup).notes)


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


@pytest.mark.parametrize("begin_s", [0.0, 3600.0, UNIX_S])
def test_a_slip_is_stated_by_the_clock_of_the_data(begin_s: float) -> None:
    """One that begins a day or more from 0 counts from the first touch."""
    plan = from_(touched(3), begin_s)
    seconds, half = np.asarray(plan.time_s), len(plan) // 2
    seconds = seconds - (seconds[0] if begin_s == UNIX_S else 0.0)
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
