"""Measurements of one machine that say otherwise than each other, and those that agree."""

from __future__ import annotations

import re

import numpy as np
import pytest

import trunnion as tn
from ballbar_twin import cartesian_lengths, columns_of, record
from positioning_twin import axis

Rng = np.random.Generator


def circle(
    rng: Rng, scale: tuple[float, float], backlash: tuple[float, float], square: float
) -> tn.Ballbar:
    """An XY circle: scales in ppm, backlashes in µm, squareness in arcsec."""
    spot = rng.uniform(-200, 200, 3)
    rec = record(spot, step_deg=8.0, arcs=(("XY", 0, 360),))
    place = rec.points - spot
    ahead = np.zeros_like(place)
    along = np.column_stack([-place[:, 1], place[:, 0]]) * rec.sense[:, None]
    ahead[:, :2] = 1e-6 * place[:, :2] * scale - 0.5e-3 * np.sign(along) * backlash
    ahead[:, 0] -= np.pi / 648000 * square * place[:, 1]
    lengths = cartesian_lengths(rec, rng, sigma_um=0.3, motion=lambda _: ahead)
    return tn.Ballbar(columns_of(rec, lengths))


def stops(rng: Rng, letter: str, ppm: float, backlash: float) -> tn.Positioning:
    data = axis(rng, noise=0.5)
    error = 1e-3 * ppm * data.target - backlash / 2 * data.direction
    return data.with_columns(
        measured_mm=data.measured + 1e-3 * error, axis=[letter.upper()] * len(data)
    )


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("size", [3.0, -5.0])
def test_a_contradiction_is_said_with_both_values(swapped: bool, size: float) -> None:
    rng = np.random.default_rng([61, swapped, size > 0])
    data = [circle(rng, (0, 0), (size, 0), 0.0), stops(rng, "x", 0.0, 1.5)]
    d = tn.diagnose(data[::-1] if swapped else data)
    assert d.verdict == "unexplained"
    assert d.unexplained is not None
    assert "the measurements contradict each other: backlash_x is" in d.unexplained
    said = dict(re.findall(r"([−\d.]+) ± [\d.]+ µm in (\w+)", d.unexplained))
    values = {kind: float(text.replace("−", "-")) for text, kind in said.items()}
    assert values == pytest.approx({"ballbar": size, "positioning": 1.5}, abs=0.5)
    assert all("backlash_x" in cause for cause in d.named)
    assert not set(d.named) & {"positioning:drift", "reversal_of_position_of_x"}
    # neither value is handed to a compensation
    assert d.named <= d.model.not_compensable.keys()
    assert tn.Diagnosis.from_json(d.to_json()).to_dict() == d.to_dict()


def test_measurements_that_agree_never_contradict_each_other() -> None:
    """At most 1 % of pairs: of so many none or one is likely, three are not."""
    alarms = 0
    for k in range(100):
        rng = np.random.default_rng([62, k])
        scale, backlash = rng.normal(0, 8, 2), rng.normal(0, 2, 2)
        data: list[object] = [circle(rng, tuple(scale), tuple(backlash), float(rng.normal(0, 5)))]
        data += [stops(rng, a, scale[i], backlash[i]) for i, a in enumerate("xy"[: 1 + k % 2])]
        d = tn.diagnose(data)
        alarms += any("differs" in cause for causes in d.alternatives for cause in causes)
    assert alarms <= 3


def test_a_measurement_given_twice_counts_once_and_is_said() -> None:
    rng = np.random.default_rng(63)
    one, other = circle(rng, (0, 0), (0, 0), 4.0), stops(rng, "x", 0.0, 0.0)
    alone = tn.diagnose(one)
    twice = tn.diagnose([one, one])
    assert twice.named == alone.named == {"squareness_xy"}
    assert twice.causes[0].std_errors == alone.causes[0].std_errors
    assert "Measurement 2 is left out" in twice.notes[0]
    later = one.with_columns(time_s=one["time_s"] + 3600.0)
    beside = tn.diagnose([one, other, later[: len(later) // 2]])
    assert "Measurement 3 is left out: measurement 1 has" in beside.notes[0]
    assert beside.causes == tn.diagnose([one, other]).causes
    assert not any("Measurement" in note for note in tn.diagnose([one, other]).notes)


@pytest.mark.parametrize("digits", [5, 4])
def test_a_copy_with_another_placement_or_fewer_digits_counts_once(digits: int) -> None:
    rng = np.random.default_rng(67)
    one, other = circle(rng, (0, 0), (0, 0), 4.0), stops(rng, "x", 0.0, 0.0)
    renamed = one.with_columns(setup=["again"] * len(one))
    rounded = one.with_columns(length_mm=np.round(one["length_mm"], digits))
    for copy in (renamed, rounded):
        for data in ([one, other, copy], [copy, other, one]):
            d = tn.diagnose(data)
            assert "is left out: measurement" in d.notes[0]
            assert d.named == {"squareness_xy"}
    (first, left) = [n.split()[1] for n in tn.diagnose([rounded, one, other]).notes[0].split(": ")]
    assert (first, left) == ("1", "2")  # the one with more digits stays


def test_an_honest_run_that_is_rounded_is_no_copy() -> None:
    for seed in range(10):
        rng = np.random.default_rng([68, seed])
        run = stops(rng, "x", 0.0, 2.0)
        again = run.measured + 0.3e-3 * rng.standard_normal(len(run))
        d = tn.diagnose([run, run.with_columns(measured_mm=np.round(again, 3))])
        assert isinstance(d.data, tuple)
        assert not any("left out: measurement" in note for note in d.notes)


def test_rows_pasted_into_one_of_several_measurements_are_said() -> None:
    rng = np.random.default_rng(64)
    one, other = circle(rng, (0, 0), (0, 0), 4.0), stops(rng, "x", 0.0, 0.0)
    pasted = tn.Ballbar.concatenate([one, one[:20]])
    d = tn.diagnose([other, pasted])
    assert any(n.startswith("ballbar: 20 of") and "repeat others" in n for n in d.notes)
    plain = tn.diagnose([other, one])
    assert d.named == plain.named == {"squareness_xy"}
    assert d.effects["squareness_xy"] == pytest.approx(plain.effects["squareness_xy"])


def test_two_runs_in_steps_are_two_runs() -> None:
    """Readings in steps are often the same again: that alone is no copy."""
    rng = np.random.default_rng(65)
    runs: list[tn.Positioning] = []
    for _ in range(2):
        run = stops(rng, "x", 0.0, 2.0)
        target = runs[0].target if runs else np.tile(np.round(run.target[:22]), 5)
        error = 1e-3 * np.round(1e3 * (run.measured - run.target))
        runs.append(run.with_columns(target_mm=target, measured_mm=target + error))
    d = tn.diagnose(runs)
    assert isinstance(d.data, tuple)
    assert not any("left out" in note for note in d.notes)


def test_labels_of_the_machine_are_those_of_their_ids_in_any_order() -> None:
    rng = np.random.default_rng(66)
    data = [
        stops(rng, "x", 10.0, 2.0),
        stops(rng, "y", -12.0, 0.0),
        circle(rng, (10, -12), (2, 0), 6.0),
    ]
    for some in (data, data[::-1], data[:2]):
        d = tn.diagnose(some)
        assert {"scale_x", "scale_y", "backlash_x"} <= d.named
        assert d.labels["scale_x"] == "scale of the X axis"
        assert d.labels["scale_y"] == "scale of the Y axis"
        assert d.labels["backlash_x"] == "backlash of the X axis"
        assert d.effects["backlash_x"]["b_um"] == pytest.approx(2.0, abs=0.4)
        assert d.labels.get("squareness_xy", "squareness of Y to X") == "squareness of Y to X"


def plate(
    rng: Rng,
    half_mm: float,
    middle_mm: float,
    curvature_um_m2: float,
    ppm: tuple[float, float] = (0.0, 0.0),
) -> tn.Points:
    """A grid of bores on a plate that lies somehow, on a machine whose X guide is an arc.

    ppm: Scales of X and Y.
    """
    step = np.linspace(-half_mm, half_mm, 9)
    x, y = (a.ravel() for a in np.meshgrid(step + middle_mm, step))
    radius = 1e9 / curvature_um_m2  # mm
    bent = radius - np.sqrt(radius**2 - x**2)
    turn, dx, dy = rng.uniform(-1e-4, 1e-4), *rng.uniform(-0.02, 0.02, 2)
    noise = rng.normal(0.0, 0.3e-3, (2, len(x)))
    return tn.Points(
        nominal_x_mm=x,
        nominal_y_mm=y,
        x_mm=x * (1 + 1e-6 * ppm[0]) + dx - turn * y + noise[0],
        y_mm=y * (1 + 1e-6 * ppm[1]) + dy + turn * x + bent + noise[1],
    )


FLAT = 1e-9  # µm/m²


@pytest.mark.parametrize("seed", [91, 92, 93])
def test_a_run_by_a_wrong_instrument_gives_the_machine_no_scale(seed: int) -> None:
    """A machine of just its scale and a part that grew by as much would do the same."""
    rng = np.random.default_rng(seed)
    bores = plate(rng, 150.0, 0.0, FLAT, (20.0, 0.0))
    d = tn.diagnose([bores, stops(rng, "x", 45.0, 0.0)])
    assert d.named == {"scale_x", "positioning:differs_scale_x"}
    said = re.search(r"scale_x is (\S+) ± \S+ ppm in points, (\S+) ± ", d.unexplained or "")
    assert said is not None
    assert [float(x) for x in said.groups()] == pytest.approx([20.0, 45.0], abs=3.0)


@pytest.mark.parametrize("seed", [101, 102, 103])
def test_nor_does_it_beside_a_calibrated_bar(seed: int) -> None:
    rng = np.random.default_rng(seed)
    d = tn.diagnose([circle(rng, (0, 0), (0, 0), 0.0), stops(rng, "x", 25.0, 0.0)])
    assert d.named == {"positioning:differs_scale_x"}
    long = rng.normal(0.0, 8.0, 2) + 25.0
    both = [stops(rng, letter, ppm, 0.0) for letter, ppm in zip("xy", long, strict=True)]
    agree = tn.diagnose([circle(rng, tuple(long), (0, 0), 0.0), *both])
    assert not [cause for cause in agree.named if "differs" in cause]


@pytest.mark.parametrize("seed", [94, 95, 96])
def test_runs_by_one_wrong_instrument_are_wrong_alike(seed: int) -> None:
    rng = np.random.default_rng(seed)
    runs = [stops(rng, letter, 25.0, 0.0) for letter in "xy"]
    d = tn.diagnose([plate(rng, 150.0, 0.0, FLAT), *runs])
    assert d.named == {"positioning:differs_scale_xy"}
    said = re.search(r"scale_xy is (\S+) ± \S+ ppm in points, (\S+) ± ", d.unexplained or "")
    assert said is not None
    values = [float(x.replace("−", "-")) for x in said.groups()]
    assert values == pytest.approx([0.0, 25.0], abs=3.0)


@pytest.mark.parametrize("seed", [97, 98, 99])
def test_a_part_that_grew_is_no_wrong_instrument(seed: int) -> None:
    rng = np.random.default_rng(seed)
    runs = [stops(rng, letter, ppm, 0.0) for letter, ppm in (("x", 30.0), ("y", 12.0))]
    d = tn.diagnose([plate(rng, 150.0, 0.0, FLAT, (10.0, -8.0)), *runs])
    assert {"scale_x", "scale_y", "points:expansion"} <= d.named
    assert not [cause for cause in d.named if "differs" in cause]


@pytest.mark.parametrize("seed", [81, 82, 83])
@pytest.mark.parametrize(("half", "middle"), [(100.0, 0.0), (100.0, 80.0), (150.0, -30.0)])
def test_one_bent_guide_is_one_on_plates_of_different_size(
    half: float, middle: float, seed: int
) -> None:
    """Its sizes are of the travel of both: of k µm/m² over 400 mm, k 0.2²/3."""
    rng = np.random.default_rng(seed)
    plates = [plate(rng, 200.0, 0.0, 90.0), plate(rng, half, middle, 90.0)]
    for d in (tn.diagnose(plates), tn.diagnose(plates[::-1])):
        assert d.verdict in ("explained", "ambiguous")
        assert "straightness_y_of_x" in d.named
        assert not [name for name in d.named if "change" in name]
        (cause,) = [c for c in d.causes if c.id == "straightness_y_of_x"]
        error = cause.parameters["a2_um"] - 90.0 * 0.2**2 / 3
        assert abs(error) < 4 * cause.std_errors["a2_um"]


def test_outliers_of_data_without_files_say_in_which_measurement_they_are() -> None:
    rng = np.random.default_rng(111)
    run = stops(rng, "x", 0.0, 0.0)
    measured = run.measured.copy()
    measured[33] += 0.05
    data = [circle(rng, (0, 0), (0, 0), 5.0), run.with_columns(measured_mm=measured)]
    assert (
        "Outlier, left out: row 33 (counted from 0) of measurement 2."
        in tn.diagnose(data).summary()
    )


def test_runs_of_two_axes_are_no_change_of_one() -> None:
    """One of them one way only: that was said to be, perhaps, the reversal of the axis."""
    rng = np.random.default_rng(112)
    x, y = stops(rng, "x", 5.0, 2.0), stops(rng, "y", 5.0, 0.0)
    one_way = y[y.direction > 0]
    assert not [n for n in tn.diagnose([x, one_way]).notes if "different directions" in n]
    same = one_way.with_columns(axis=["X"] * len(one_way))
    assert [n for n in tn.diagnose([x, same]).notes if "different directions" in n]
