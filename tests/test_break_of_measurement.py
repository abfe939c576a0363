"""A run that was aborted and begun again: what comes after the break has another zero."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import axis
from power.study import ground
from promise import kept, needed_runs
from trunnion.models.breaks import break_of, passes_of, restart_of
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

RATE = 0.9
NOISE_UM = 0.4
SURE = 0.9
OF_TIME = ("drift_", "warmup_", "zero_shift_", "setup_shift")


def sure(d: tn.Diagnosis) -> set[str]:
    """Causes that are named with more than 90 %."""
    return {c.id for c in d.causes if (c.probability or 0.0) > SURE}


def of_time(d: tn.Diagnosis) -> set[str]:
    """Causes of time that are named, in doubt or not."""
    return {c.id for c in d.causes if c.id.startswith(OF_TIME)}


def begun_again(
    seed: int, hours: float, rate_um_h: float | None = None, plan: str = "rich"
) -> tuple[tn.Touches, tn.Setup, tuple[float, ...]]:
    """Touches of two parts; in the second the tool stands elsewhere by a constant, which is stated.

    ``rate_um_h``: it drifts along X instead.
    """
    made, twin, _, read = ground(plan)
    rng = np.random.default_rng([41, seed])
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng))
    data = measure(made, twin, truth, noise_um=NOISE_UM, tick_um=0.1, seed=seed)
    columns = {k: np.array(v) for k, v in data.columns.items()}
    n = len(data)
    late = np.arange(n) >= int(rng.integers(n // 3, 2 * n // 3))
    columns["time_s"] = columns["time_s"] + np.where(late, 3600.0 * hours, 0.0)
    zero = rng.choice([-1.0, 1.0], 3) * rng.uniform(4.0, 8.0, 3)
    away = np.where(late[:, None], zero, 0.0)
    if rate_um_h is not None:
        away = np.outer(columns["time_s"] / 3600.0, [rate_um_h, 0.0, 0.0])
    direction = np.stack([columns[f"dir_{x}"] for x in "xyz"], axis=1)
    # the faces stand across the approach: the tool stops where it touches them
    back = 1e-3 * np.sum(away * direction, axis=1)[:, None] * direction
    columns |= {f"{x}_mm": columns[f"{x}_mm"] - back[:, i] for i, x in enumerate("xyz")}
    return tn.Touches(columns), read, tuple(map(float, zero))


def plate(seed: int, gap_s: float, shift_um: tuple[float, float] | None) -> tn.Points:
    """A plate of 11 by 11 points with a scale of X of 20 ppm, begun again after a gap.

    ``shift_um``: of what comes after it; None: X drifts by 5 µm over all of the gap.
    """
    rng = np.random.default_rng([42, seed])
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(-200.0, 200.0, 11)] * 2))
    late = np.arange(len(x)) >= int(rng.integers(40, 80))
    time = 20.0 * np.arange(len(x)) + np.where(late, gap_s, 0.0)
    dx, dy = (5.0 * time / gap_s, 0.0) if shift_um is None else np.outer(shift_um, late)
    ex = 20e-6 * x + 1e-3 * (dx + 0.6 * rng.standard_normal(len(x)))
    ey = 1e-3 * (dy + 0.6 * rng.standard_normal(len(x)))
    turn = rng.normal(0.0, 2e-3)
    columns = {"nominal_x_mm": x, "nominal_y_mm": y, "time_s": time}
    columns["x_mm"] = (x + ex) - turn * (y + ey)
    columns["y_mm"] = turn * (x + ex) + (y + ey)
    return tn.Points(columns)


@pytest.mark.parametrize("plan", ["rich", "paper"])
def test_touches_that_were_begun_again_have_not_drifted(plan: str) -> None:
    """After a night drifts of X and Y were > 99 %, in 8 of 8."""
    runs = needed_runs(RATE)
    right, seen = 0, 0
    for seed in range(runs):
        d = tn.diagnose(*begun_again(seed, 20.0, plan=plan)[:2])
        right += not [name for name in sure(d) if not name.startswith("zero_shift_")]
        seen += len(of_time(d)) > 1
    assert kept(right, runs, RATE)
    assert kept(seen, runs, RATE)


def test_after_minutes_a_shift_is_no_drift() -> None:
    """A drift over ten minutes shows within the parts: the zeros are named, with their sizes."""
    runs = needed_runs(RATE)
    right, inside = 0, 0
    for seed in range(runs):
        data, setup, zero = begun_again(seed, 1.0 / 6.0)
        d = tn.diagnose(data, setup)
        drifts = [name for name in sure(d) if "drift" in name]
        right += sure(d) >= {"zero_shift_x", "zero_shift_y"} and not drifts
        for cause in d.causes:
            if cause.id.startswith("zero_shift_"):
                off = cause.parameters["d_um"] - zero["xyz".index(cause.id[-1])]
                inside += abs(off) < 3.0 * cause.std_errors["d_um"]
    assert kept(right, runs, RATE)
    assert inside > 1.5 * runs


def test_a_drift_over_a_night_is_not_a_shift_for_sure() -> None:
    """What happened in between no reading says."""
    runs = needed_runs(RATE)
    right = 0
    for seed in range(runs):
        d = tn.diagnose(*begun_again(seed, 20.0, rate_um_h=0.3)[:2])
        right += not sure(d) & {"zero_shift_x", "setup_shift"}
    assert kept(right, runs, RATE)


@pytest.mark.parametrize("gap_s", [900.0, 72000.0])
def test_a_plate_that_was_begun_again_has_not_drifted(gap_s: float) -> None:
    """It was a drift > 95 % after a night."""
    runs = needed_runs(RATE)
    right, inside = 0, 0
    for seed in range(runs):
        rng = np.random.default_rng([43, seed])
        shift = tuple(rng.choice([-1.0, 1.0], 2) * rng.uniform(3.0, 8.0, 2))
        d = tn.diagnose(plate(seed, gap_s, shift))
        right += not [name for name in sure(d) if "drift" in name] and bool(of_time(d))
        scale = next((c for c in d.causes if c.id == "scale_x"), None)
        if scale is not None:
            inside += abs(scale.parameters["ppm"] - 20.0) < 3.0 * scale.std_errors["ppm"]
    assert kept(right, runs, RATE)
    assert kept(inside, runs, RATE)


def test_a_plate_that_drifts_over_a_night_has_not_shifted_for_sure() -> None:
    runs = needed_runs(RATE)
    right = sum(
        not sure(tn.diagnose(plate(seed, 72000.0, None))) & {"zero_shift_x", "setup_shift"}
        for seed in range(runs)
    )
    assert kept(right, runs, RATE)


def test_a_break_is_long_beside_what_is_usual() -> None:
    time = 2.0 * np.arange(60.0)
    assert break_of(time) is None
    assert break_of(time + np.where(time > 50.0, 170.0, 0.0)) is None  # a tool change
    assert break_of(time + np.where(time > 50.0, 600.0, 0.0)) == pytest.approx(351.0)
    assert break_of(time + np.where(time > 3.0, 600.0, 0.0)) is None  # two readings before
    assert break_of(100.0 * time + np.where(time > 50.0, 600.0, 0.0)) is None  # slow readings


def test_a_measurement_in_one_go_has_no_such_cause() -> None:
    data, setup, _ = begun_again(0, 0.0)
    assert not [e for e in tn.catalogue(data, setup) if e.id.startswith("zero_shift")]
    assert len([e for e in tn.catalogue(begun_again(0, 1.0)[0], setup) if "zero_" in e.id]) == 3


def test_the_model_has_the_zeros() -> None:
    """It simulates and identifies, is read again, and is scored on data without a break."""
    data, setup, _ = begun_again(3, 1.0 / 6.0)
    d = tn.diagnose(data, setup)
    assert {"zero_shift_x", "zero_shift_y"} <= d.named
    assert d.model is not None
    again = tn.identify(data, setup, effects=d.model)
    assert again.rms_um == pytest.approx(d.gain.rms_after_um, rel=0.02)
    simulated = tn.simulate(data, setup, d.model)
    off = np.sum((simulated.position_mm - data.position_mm) * data.direction, axis=1)
    assert np.std(off) < 1.5e-3 * NOISE_UM
    assert tn.Diagnosis.from_json(d.to_json()) == d
    whole = begun_again(3, 0.0, rate_um_h=0.0)[0]
    assert d.score(whole).rms_after_um == pytest.approx(NOISE_UM, rel=0.2)


def test_the_model_of_a_plate_says_the_error_of_other_points() -> None:
    d = tn.diagnose(plate(1, 900.0, (5.0, -6.0)))
    assert any(name.startswith("zero_shift_") for name in d.named)
    other = plate(2, 900.0, (0.0, 0.0)).with_columns(time_s=20.0 * np.arange(121))
    assert d.model is not None
    error = d.model.error_um(other, features=False)
    # over 400 mm, without the shift
    assert np.ptp(error[:, 0]) == pytest.approx(0.4 * d.effects["scale_x"]["ppm"], abs=1e-6)
    assert d.score(other).rms_after_um == pytest.approx(0.6, rel=0.25)


def test_a_pause_that_is_usual_between_cycles_is_no_break() -> None:
    cycle = np.repeat(np.arange(5), 20)
    time = 10.0 * np.arange(100.0)
    assert break_of(time + 600.0 * cycle) is not None
    assert break_of(time + 600.0 * cycle, cycle) is None
    night = np.where(cycle > 2, 36000.0, 0.0)
    assert break_of(time + 600.0 * cycle + night, cycle) == pytest.approx(595.0 + 1500.0 + 18000.0)
    assert break_of(time + np.where(cycle > 0, 3600.0, 0.0), cycle) == pytest.approx(1995.0)


def test_a_cycle_that_was_left_begins_again() -> None:
    way = np.r_[np.arange(8), 20 + np.arange(8)[::-1]]
    cycle, stop = np.repeat([1, 2, 3], 16), np.tile(way, 3)

    def left(at: int, first: int) -> int | None:
        """A run that is left before a row, and goes on from another."""
        return restart_of(np.r_[cycle[:at], cycle[first:]], np.r_[stop[:at], stop[first:]])

    assert left(48, 48) is None
    assert left(9, 0) == 9
    assert left(40, 32) == 40  # in its last cycle, of which that was made again
    assert left(40, 0) == 40  # or all
    assert left(3, 0) is None  # too few to tell
    assert left(16, 0) is None  # a whole cycle: its number is another's
    assert restart_of(np.ones(48, dtype=int), stop) is None  # cycles without numbers
    assert restart_of(np.ones(96, dtype=int), np.repeat(stop, 2)) is None  # stops read twice
    by_place = np.lexsort((cycle, stop))
    assert restart_of(cycle[by_place], stop[by_place]) is None
    assert restart_of(np.delete(cycle, [15, 31]), np.delete(stop, [15, 31])) is None


def run_begun_again(seed: int, shift: float, timed: bool, turns: bool = False) -> tn.Positioning:
    """Stops with a reversal of 2; the zero of the first attempt is off by so many µm or arcsec."""
    rng = np.random.default_rng([45, seed])
    whole, again = axis(rng, noise=0.3), axis(rng, noise=0.3)
    rows = int(rng.integers(5, 20))
    target = np.r_[whole.target[:rows], whole.target]
    error = np.r_[again.deviation[:rows] + shift, whole.deviation]
    sense = np.r_[whole.direction[:rows], whole.direction]
    error += 1.0 * sense
    unit, per_unit = ("deg", 1 / 3600) if turns else ("mm", 1e-3)
    columns = {f"target_{unit}": target, f"measured_{unit}": target + per_unit * error}
    columns |= {"direction": sense, "cycle": np.r_[whole.cycle[:rows], whole.cycle]}
    if timed:
        assert whole.time_s is not None
        late = whole.time_s + 15.0 * rows + rng.uniform(60.0, 900.0)
        columns["time_s"] = np.r_[whole.time_s[:rows], late]
    return tn.Positioning(columns)


@pytest.mark.parametrize(("timed", "turns"), [(True, False), (False, False), (True, True)])
def test_a_run_that_was_begun_again_has_not_warmed_up(timed: bool, turns: bool) -> None:
    """It was a warm-up of the screw, with more than 90 % in most."""
    runs = needed_runs(RATE)
    right, inside, calm = 0, 0, 0
    for seed in range(runs):
        shift = (-1) ** seed * (2.5 + 0.1 * (seed % 20))
        d = tn.diagnose(run_begun_again(seed, shift, timed, turns))
        right += sure(d) <= {"zero_shift", "reversal"} and any(
            "zero_shift" in causes for causes in d.alternatives
        )
        for cause in d.causes:
            if cause.id == "zero_shift":
                size, std = *cause.parameters.values(), *cause.std_errors.values()
                inside += abs(size + shift) < 3.0 * std
        calm += tn.diagnose(run_begun_again(seed, 0.0, timed, turns)).named == {"reversal"}
    assert kept(right, runs, RATE)
    assert kept(inside, runs, RATE)
    assert kept(calm, runs, RATE)


def test_the_model_of_a_run_has_the_zero() -> None:
    d = tn.diagnose(run_begun_again(2, 4.0, timed=False))
    assert d.named == {"zero_shift", "reversal"}
    assert d.gain.heldout_rms_after_um < 0.4
    assert tn.Diagnosis.from_json(d.to_json()) == d
    whole = axis(np.random.default_rng(46), noise=0.3, change=4.0)  # the zero of the first attempt
    other = whole.with_columns(measured_mm=whole.measured + 1e-3 * whole.direction)
    assert d.score(other).rms_after_um == pytest.approx(0.3, rel=0.25)


PASSES = {
    "one way, twice": [(1, 1), (1, 1)],
    "there and back": [(1, 1), (-1, 1)],
    "three times": [(1, 1)] * 3,
    "both ways, twice": [(1, 1), (1, -1)] * 2,
}
"""Each there (1) or back (-1), and the sense of the level."""


def level(
    seed: int, plan: str, shift: float, *, break_s: float = 0.0, rate_um_m_h: float = 0.0
) -> tuple[tn.Levels, tuple[float, float], int]:
    """A level on a straight line; from a pass on it shows so much more, up or down, in both.

    The last of the passes before the shift ends with a break. Also: the shift, the first reading
    after it.
    """
    rng = np.random.default_rng([47, seed, *plan.encode()])
    passes, places = PASSES[plan], int(rng.integers(12, 26))
    where = 50.0 + 100.0 * np.arange(places)
    position = np.concatenate([where[::way] for way, _ in passes])
    number = np.repeat(np.arange(len(passes)), places)
    sense = np.array([float(s) for _, s in passes])[number]
    first = int(rng.integers(1, len(passes)))
    time = 20.0 * np.arange(len(number)) + 60.0 * number + break_s * (number >= first)
    size = rng.choice([-1.0, 1.0], 2) * shift * rng.uniform(0.7, 1.4, 2)
    inclined = rng.uniform(-60.0, 60.0, 2)
    more = (number >= first) * size[:, None] + rate_um_m_h * time / 3600.0
    read = inclined[:, None] * sense + more + rng.standard_normal(more.shape)
    data = tn.Levels(
        position_mm=position,
        along_um_m=read[0],
        across_um_m=read[1],
        turn_deg=np.where(sense > 0, 0, 180),
        time_s=time,
    )
    return data, (float(size[0]), float(size[1])), places * first


def test_a_level_that_was_set_to_zero_again_has_not_drifted() -> None:
    """It was unexplained, or after a break of an hour a drift (> 90 % in 22 of 40)."""
    runs = needed_runs(RATE)
    right, inside, calm, later = 0, 0, 0, 0
    for seed in range(runs):
        plan = list(PASSES)[seed % len(PASSES)]
        data, size, _ = level(seed, plan, 6.0)
        d = tn.diagnose(data)
        right += sure(d) <= {"zero_shift"} and all("zero_shift" in s for s in d.alternatives)
        found = next((c for c in d.causes if c.id == "zero_shift"), None)
        if found is not None:
            off = [found.parameters[f"d_{c}_um_m"] for c in ("along", "across")]
            std = [found.std_errors[f"d_{c}_um_m"] for c in ("along", "across")]
            inside += bool(np.all(np.abs(np.subtract(off, size)) < 3.5 * np.array(std)))
        calm += "zero_shift" not in sure(tn.diagnose(level(seed, plan, 0.0)[0]))
        broken = tn.diagnose(level(seed, plan, 6.0, break_s=3600.0)[0])
        later += not sure(broken) - {"zero_shift"}
    for count in (right, inside, calm, later):
        assert kept(count, runs, RATE)


def test_a_level_that_drifts_has_no_other_zero_for_sure() -> None:
    runs = needed_runs(RATE)
    right = 0
    for seed in range(runs):
        plan = list(PASSES)[seed % len(PASSES)]
        d = tn.diagnose(level(seed, plan, 0.0, rate_um_m_h=90.0)[0])
        right += "zero_shift" not in sure(d)
    assert kept(right, runs, RATE)


def test_two_passes_with_the_level_turned_do_not_show_another_zero() -> None:
    """It is a zero of the level and an inclination; of more passes each may begin with another."""
    data = level(1, "both ways, twice", 6.0)[0]
    half = len(data) // 2
    assert "zero_shift" not in {e.id for e in tn.catalogue(data[np.arange(half)])}
    found = next(e for e in tn.catalogue(data) if e.id == "zero_shift")
    assert [p.name for p in found.parameters] == ["d_along_um_m", "d_across_um_m", "t0_s"]
    assert "zero_shift" in {e.id for e in tn.catalogue(level(1, "there and back", 6.0)[0])}


def test_the_model_of_levels_has_the_zero() -> None:
    """It is read again, and other readings without another zero are as good."""
    data, _, first = level(3, "three times", 6.0)
    d = tn.diagnose(data)
    assert d.named == {"zero_shift"}
    time = np.asarray(data.time_s)
    assert time[first - 1] < d.effects["zero_shift"]["t0_s"] < time[first]
    assert tn.Diagnosis.from_json(d.to_json()) == d
    for plan in PASSES:
        other = level(3, plan, 0.0)[0]
        assert d.score(other).rms_after_um == pytest.approx(1.0, rel=0.25)


def test_a_pass_begins_where_a_place_comes_again() -> None:
    way = np.arange(8)
    assert passes_of(way).tolist() == []
    assert passes_of(np.tile(way, 3)).tolist() == [8, 16]
    assert passes_of(np.r_[way, way[::-1]]).tolist() == [8]
    assert passes_of(np.repeat(way, 2)).tolist() == []  # read twice at once
    assert passes_of(np.repeat(np.r_[way, way[::-1]], 2)).tolist() == [16]
    assert passes_of(np.r_[way, way[-2::-1]]).tolist() == [8]  # its end was read once
    assert passes_of(np.r_[way[:3], way, way]).tolist() == [11]  # three readings are no pass
    assert passes_of(np.r_[way[:6], way]).tolist() == [6]
    assert passes_of(np.insert(np.tile(way, 2), 3, 2)).tolist() == [9]  # one was repeated
