"""Readings at the row of another position, times in another unit: named, and only then."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import trunnion as tn
from trunnion.base.units import Floats
from trunnion.data.pace import pace_doubts
from trunnion.data.shifted import displaced, displaced_rows

SEEDS = (11, 12, 13, 14)
TARGETS = np.array([0.0, 41.3, 79.8, 121.1, 160.4, 199.7, 240.9, 279.2, 320.6, 361.0, 400.0])
SETUP = tn.read_setup(tn.sample_path("contour/setup.toml"))


def run(seed: int, cycles: int = 5) -> tuple[tn.Positioning, Floats]:
    """Stops there and back, 8 s apart, and their measured positions."""
    rng = np.random.default_rng(seed)
    target = np.tile(np.concatenate([TARGETS, TARGETS[::-1]]), cycles)
    direction = np.tile(np.repeat([1, -1], len(TARGETS)), cycles)
    measured = target + 1e-3 * (2.0 * direction + rng.normal(0.0, 0.6, len(target))) + 7.0
    data = tn.Positioning(
        target_mm=target,
        measured_mm=measured,
        direction=direction,
        cycle=np.repeat(np.arange(1, cycles + 1), 2 * len(TARGETS)),
        time_s=8.0 * np.arange(len(target)),
    )
    return data, measured


def sweep(seed: int) -> tn.Sweep:
    rng = np.random.default_rng(seed)
    angle = np.repeat(np.arange(0.0, 360.0, 10.0), 3)
    target = np.tile([1, 2, 3], 36)
    radius, start, height = np.array([[80.0, 60.0, 70.0], [0.0, 2.1, 4.2], [10.0, 40.0, -30.0]])
    turned = np.radians(angle) + start[target - 1]
    place = np.column_stack(
        [
            radius[target - 1] * np.cos(turned),
            radius[target - 1] * np.sin(turned),
            height[target - 1],
        ]
    )
    place += rng.normal(0.0, 5e-4, place.shape)
    return tn.Sweep(
        angle_deg=angle, target=target, x_mm=place[:, 0], y_mm=place[:, 1], z_mm=place[:, 2]
    )


def plate(seed: int) -> dict[str, Floats]:
    rng = np.random.default_rng(seed)
    x, y = (c.ravel() for c in np.meshgrid(np.arange(7) * 50.0, np.arange(6) * 50.0))
    noise = rng.normal(0.0, 1e-3, (2, len(x)))
    return {"nominal_x_mm": x, "nominal_y_mm": y, "x_mm": x + noise[0], "y_mm": y + noise[1]}


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("by", [1, -1])
@pytest.mark.parametrize("sense", [1, -1])
def test_a_pass_that_is_shifted_by_a_row_is_named_with_rows_and_cycle(
    seed: int, by: int, sense: int
) -> None:
    data, measured = run(seed)
    rows = np.flatnonzero((data.cycle == 3) & (data.direction == sense))
    given = measured.copy()
    given[rows] = np.roll(measured[rows], -by)
    with pytest.raises(tn.DataError) as caught:
        tn.diagnose(data.with_columns(measured_mm=given))
    said = str(caught.value)
    assert "other rows" in said
    assert "µm?" not in said  # no deviations
    assert f"cycle 3, direction {sense:+d}" in said
    assert f"that of the row {'after' if by > 0 else 'before'}" in said
    assert data.displaced == ""


@pytest.mark.parametrize("seed", SEEDS)
def test_two_exchanged_stops_are_named_by_the_diagnosis_and_the_standard(seed: int) -> None:
    data, measured = run(seed)
    i, j = np.random.default_rng(seed).choice(len(TARGETS), 2, replace=False)
    given = measured.copy()
    given[[i, j]] = measured[[j, i]]
    mixed = data.with_columns(measured_mm=given)
    said = [x for x in tn.diagnose(mixed).mistakes if "exchanged" in x]
    assert len(said) == 1
    first, second = sorted((int(i), int(j)))
    assert f"row {first} (cycle 1" in said[0]
    assert f"row {second} (cycle 1" in said[0]
    assert any("exchanged" in note for note in mixed.iso230_2().notes)
    assert not tn.diagnose(data).mistakes


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("left_out", [5, 13, 30])
def test_a_station_of_a_sweep_that_was_left_out_is_named(seed: int, left_out: int) -> None:
    data = sweep(seed)
    assert displaced_rows(data) == ""
    columns = {}
    for name in ("x_mm", "y_mm", "z_mm"):
        by_station = np.array(data[name]).reshape(-1, 3)
        columns[name] = np.vstack(
            [np.delete(by_station, left_out, axis=0), by_station[-1:]]
        ).ravel()
    with pytest.raises(tn.DataError, match="Likely cause") as caught:
        tn.diagnose(data.with_columns(**columns))
    said = str(caught.value)
    assert f"from row {3 * left_out} to" in said
    assert "row after" in said
    for name in columns:
        by_station = np.array(data[name]).reshape(-1, 3)
        columns[name] = np.insert(by_station, left_out, by_station[left_out], axis=0)[:-1].ravel()
    with pytest.raises(tn.DataError, match=f"from row {3 * left_out + 3} to .* row before"):
        tn.diagnose(data.with_columns(**columns))


@pytest.mark.parametrize("seed", SEEDS)
def test_rows_of_points_that_are_shifted_or_exchanged_are_named(seed: int) -> None:
    sound = plate(seed)
    assert displaced_rows(tn.Points(sound)) == ""
    shifted = {k: np.array(v) for k, v in sound.items()}
    for name in ("x_mm", "y_mm"):
        shifted[name][20:-1] = sound[name][21:]
    with pytest.raises(tn.DataError, match="from row 20 to row 40 each reading is that of the row"):
        tn.diagnose(tn.Points(shifted))
    mixed = {k: np.array(v) for k, v in sound.items()}
    for name in ("x_mm", "y_mm"):
        mixed[name][[10, 17]] = sound[name][[17, 10]]
    with pytest.raises(tn.DataError, match="row 10 is that of row 17"):
        tn.diagnose(tn.Points(mixed))


@pytest.mark.parametrize("seed", range(60))
def test_sound_and_random_readings_are_not_of_other_rows(seed: int) -> None:
    rng = np.random.default_rng(seed)
    even = np.asarray(20.0 * np.arange(60), dtype=np.float64)
    assert displaced(even + 20.0 + rng.normal(0.0, 0.1, 60), even, str) == ""
    meant = rng.uniform(0.0, 400.0, 60)
    for size in (1e-3, 1.0, 100.0):
        read = meant + rng.normal(0.0, size, 60)
        assert displaced(read, meant, str) == ""
    far = meant.copy()
    far[rng.choice(60, 3, replace=False)] += 250.0
    assert displaced(far, meant, str) == ""


@pytest.mark.parametrize(
    ("factor", "asked"), [(1 / 86400, "days"), (1 / 60, "min"), (1000.0, "ms"), (1.0, "")]
)
def test_stops_that_follow_each_other_impossibly_fast_are_asked_about(
    factor: float, asked: str
) -> None:
    data, _ = run(1)
    said = pace_doubts(data.with_columns(time_s=factor * np.array(data.time_s)))
    assert bool(said) == bool(asked)
    assert all(asked in text for text in said)
    if asked:
        assert (
            said[0]
            in tn.diagnose(data.with_columns(time_s=factor * np.array(data.time_s))).sentences()
        )


@pytest.mark.parametrize(
    ("column", "factor", "asked"),
    [
        ("time_s", 1000.0, "time_s in ms"),
        ("time_s", 1 / 60, "time_s in min"),
        ("feed_mm_min", 1e-3, "feed in m/min"),
        ("feed_mm_min", 1.5, ""),
        ("time_s", 1.0, ""),
    ],
)
def test_times_and_feeds_that_contradict_each_other_are_asked_about(
    column: str, factor: float, asked: str
) -> None:
    data = tn.read_ballbar(tn.sample_path("ballbar/circle.csv"))
    given = data.with_columns(**{column: factor * np.array(data[column])})
    said = [x for x in tn.diagnose(given).mistakes if "contradict" in x]
    assert len(said) == bool(asked)
    assert all(asked in x for x in said)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "µs")])
def test_a_log_in_other_times_is_asked_about(factor: float, unit: str) -> None:
    log = tn.read_axis_log(tn.sample_path("contour/axislog.csv"))
    with pytest.raises(tn.DataError, match=f"are these times in {unit}"):
        tn.diagnose(log.with_columns(time_s=factor * np.array(log.time_s)), SETUP)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("off_mm", [0.05, 1.0, -10.0])
def test_results_of_the_standard_name_a_stop_that_is_far_from_the_others(
    seed: int, off_mm: float
) -> None:
    data, measured = run(seed)
    assert data.iso230_2().notes == ()
    given = measured.copy()
    given[33] += off_mm
    (note,) = data.with_columns(measured_mm=given).iso230_2().notes
    assert "row 33" in note
    keep = np.arange(len(data)) != 33
    without = data[keep].iso230_2().accuracy_um
    assert f"A is {without:.2g}," in note


def bent(seed: int) -> tn.Diameters:
    """Three passes of other depths on a part that bends, places from the chuck (own formula)."""
    rng = np.random.default_rng(seed)
    place = np.tile(np.arange(1.5, 65.0, 1.5), 3)
    each = len(place) // 3
    which, depth = np.repeat([1, 2, 3], each), np.repeat([0.5, 0.25, 0.1], each)
    error = 20.0 * depth / 0.5 * (place / 65.0) ** 3 + 3.0 * which
    return tn.Diameters(
        z_mm=place,
        error_um=error + rng.normal(0.0, 0.4, len(place)),
        depth_mm=depth,
        feed_sign=np.full(len(place), -1),
        time_s=np.tile(0.75 * np.arange(each), 3),
        **{"pass": which},
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_places_from_the_free_end_of_a_part_are_named(seed: int) -> None:
    turning = {"overhang_mm": 65.0, "feed_mm_rev": 0.1, "spindle_rpm": 1200.0}
    setup = tn.Setup(tn.Artefact("none"), turning=turning)
    data = bent(seed)
    assert not tn.diagnose(data, setup).mistakes
    found = tn.diagnose(data.with_columns(z_mm=65.0 - np.array(data.z_mm)), setup)
    assert found.verdict == "unexplained"
    assert any("free end" in text for text in found.mistakes)


def level(seed: int, slope: Callable[[Floats], Floats], *, changed: bool) -> tn.Levels:
    rng = np.random.default_rng(seed)
    place = np.arange(50.0, 1600.0, 100.0)
    place = np.concatenate([place, place[::-1]])
    sense = np.repeat([1.0, -1.0], len(place) // 2)
    along = sense * (slope(place) + 100.0) + 15.0 + rng.normal(0.0, 0.8, len(place))
    across = sense * (0.5 * slope(place) - 60.0) - 8.0 + rng.normal(0.0, 0.8, len(place))
    shown = sense if changed else np.ones_like(sense)
    return tn.Levels(
        position_mm=place,
        along_um_m=shown * along,
        across_um_m=shown * across,
        turn_deg=np.where(sense < 0, 180.0, 0.0),
        time_s=25.0 * np.arange(len(place)),
    )


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    "slope", [lambda p: 0.02 * p, lambda p: 8 * np.sin(p / 100.0)], ids=["linear", "wave"]
)
def test_signs_of_a_turned_level_that_were_changed_already_are_asked_about(
    seed: int, slope: Callable[[Floats], Floats]
) -> None:
    said = tn.diagnose(level(seed, slope, changed=True)).mistakes
    assert [x for x in said if "changed already" in x]
    assert not tn.diagnose(level(seed, slope, changed=False)).mistakes


def test_a_run_from_one_direction_is_refused_with_what_is_missing() -> None:
    data, _ = run(1)
    with pytest.raises(tn.DataError, match="in every row, expected stops with direction"):
        data[np.array(data.direction) > 0].iso230_2()


def test_a_column_that_ends_in_another_unit_is_converted() -> None:
    data, measured = run(1)
    given = {name: np.array(data[name]) for name in data.columns if name != "measured_mm"}
    given["measured_um"] = 1e3 * measured
    with pytest.raises(tn.TrunnionError, match="by its name in µm, expected measured_mm"):
        tn.read(given)
    made = tn.read(
        given, columns={n: n for n in given if n != "measured_um"} | {"measured_mm": "measured_um"}
    )
    np.testing.assert_allclose(made["measured_mm"], measured)


def test_a_missing_column_lists_those_that_were_found() -> None:
    data, _ = run(1)
    given = {name: np.array(data[name]) for name in data.columns}
    given["Target mm"], given["Measured mm"] = given.pop("target_mm"), given.pop("measured_mm")
    with pytest.raises(tn.TrunnionError, match="Target mm, Measured mm"):
        tn.read(given, kind="positioning")
