"""The column `sense` of a ball-bar test and the order of its rows have to say the same travel."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn
from trunnion.models.ballbar.path import Path as Travelled

RADIUS_MM, BACKLASH_UM = 100.0, 6.0
PLANES = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0), "XZ": (0, 2)}


def circle(plane: str = "XY", senses: tuple[int, ...] = (1, -1)) -> tn.Ballbar:
    """Lengths of a machine whose second axis of the plane has backlash, in the order of travel."""
    first, second = PLANES[plane]
    angle = np.concatenate([s * np.radians(np.arange(1.0, 361.0, 5.0)) for s in senses])
    sense = np.repeat(senses, 72)
    at = np.zeros((len(angle), 3))
    at[:, first], at[:, second] = RADIUS_MM * np.cos(angle), RADIUS_MM * np.sin(angle)
    actual = at.copy()
    actual[:, second] -= 1e-3 * BACKLASH_UM / 2 * np.sign(np.cos(angle)) * sense
    noise = np.random.default_rng(1).normal(0, 2e-4, len(angle))
    x, y, z = at.T
    length = np.linalg.norm(actual, axis=1) + noise
    return tn.Ballbar(
        setup=np.ones(len(x), int), x_mm=x, y_mm=y, z_mm=z, length_mm=length, sense=sense
    )


def by_angle(test: tn.Ballbar, plane: str = "XY") -> tn.Ballbar:
    """Rows sorted by angle, one sense after the other."""
    first, second = PLANES[plane]
    at = np.asarray(test.position_mm).T
    angle = np.mod(np.arctan2(at[second], at[first]), 2 * np.pi)
    return test[np.lexsort((angle, -np.asarray(test.sense)))]


def inverted(test: tn.Ballbar) -> tn.Ballbar:
    return test.with_columns(sense=-np.asarray(test.sense))


@pytest.mark.parametrize("plane", PLANES)
def test_rows_in_the_order_of_travel_are_taken(plane: str) -> None:
    axis = "xyz"[PLANES[plane][1]]
    (cause,) = tn.diagnose(circle(plane)).causes
    assert cause.id == f"backlash_{axis}"
    assert cause.parameters["b_um"] == pytest.approx(BACKLASH_UM, abs=0.3)


@pytest.mark.parametrize("plane", PLANES)
def test_rows_sorted_by_angle_are_refused(plane: str, tmp_path: Path) -> None:
    by_angle(circle(plane), plane).to_csv(tmp_path / "circle.csv")
    with pytest.raises(tn.DataError, match=r"sense \(line \d+ of circle\.csv\): got") as error:
        tn.diagnose(tn.read_ballbar(tmp_path / "circle.csv"))
    text = str(error.value)
    assert text.endswith(
        "Were rows sorted by angle? Then sort the rows of each path along its travel."
    )
    if plane == "XY":
        assert "line 75 of circle.csv): got -1 (clockwise) where the rows go counter-cl" in text
    # Its figures are of each path by itself, in whichever order its rows stand.
    here, there = tn.iso230_4(circle(plane))[0], tn.iso230_4(by_angle(circle(plane), plane))[0]
    assert there.hysteresis_um == pytest.approx(here.hysteresis_um)


@pytest.mark.parametrize("plane", ["XY", "YZ"])
@pytest.mark.parametrize("evaluate", [tn.diagnose, tn.iso230_4])
def test_a_sense_that_counts_the_other_way_is_refused(
    plane: str, evaluate: Callable[[tn.Ballbar], object]
) -> None:
    with pytest.raises(tn.DataError, match=r"^sense \(row 1\): got -1 .* the other way\?$"):
        evaluate(inverted(circle(plane)))


def test_of_one_path_either_may_be_wrong() -> None:
    one = inverted(circle(senses=(-1,)))
    with pytest.raises(tn.DataError, match=r"the other way, or were rows sorted by angle\?$"):
        tn.diagnose(one)
    timed = one.with_columns(time_s=np.arange(72.0))
    with pytest.raises(tn.DataError, match=r"counted the other way\?$"):
        tn.diagnose(timed)


def test_rows_in_no_order_are_refused() -> None:
    test = circle()
    mixed = test[np.random.default_rng(2).permutation(len(test))]
    with pytest.raises(tn.DataError, match=r"Were rows sorted, or put together from several"):
        tn.diagnose(mixed)


def test_a_machine_that_trembles_before_it_starts_is_taken() -> None:
    """Logged positions at a standstill go to and fro by what a scale shows."""
    test = circle()
    x, y = np.asarray(test.x_mm).copy(), np.asarray(test.y_mm).copy()
    still = np.r_[np.zeros(20, int), np.arange(len(x))]
    x, y = x[still], y[still]
    x[:20] += np.random.default_rng(3).normal(0, 1e-4, 20)
    y[:20] += np.random.default_rng(4).normal(0, 1e-4, 20)
    columns = {name: np.asarray(values)[still] for name, values in test.columns.items()}
    tn.diagnose(tn.Ballbar(columns | {"x_mm": x, "y_mm": y}))


def arcs(
    paths: list[tuple[float, float, float]], plane: str = "XY", trembles_deg: float = 0.0
) -> tn.Ballbar:
    """Lengths of a machine with backlash, its paths from one angle to another by steps, °."""
    first, second = PLANES[plane]
    rng = np.random.default_rng(5)
    angles = [np.arange(a, b + np.sign(b - a) * 1e-9, np.sign(b - a) * s) for a, b, s in paths]
    sense = np.repeat([int(np.sign(b - a)) for a, b, _ in paths], [len(one) for one in angles])
    angle = np.radians(np.concatenate(angles) + rng.normal(0, trembles_deg, len(sense)))
    at = np.zeros((len(angle), 3))
    at[:, first], at[:, second] = RADIUS_MM * np.cos(angle), RADIUS_MM * np.sin(angle)
    actual = at.copy()
    actual[:, second] -= 1e-3 * BACKLASH_UM / 2 * np.sign(np.cos(angle)) * sense
    length = np.linalg.norm(actual, axis=1) + rng.normal(0, 2e-4, len(angle))
    x, y, z = at.T
    return tn.Ballbar(
        setup=np.ones(len(x), int), x_mm=x, y_mm=y, z_mm=z, length_mm=length, sense=sense
    )


def travel(test: tn.Ballbar) -> Travelled:
    """How the machine travels, or the error about its rows."""
    return Travelled(test, np.asarray(test.position_mm))


@pytest.mark.parametrize("plane", ["XY", "ZX"])
@pytest.mark.parametrize("step", [10.0, 15.0, 20.0, 30.0])
@pytest.mark.parametrize(
    ("start", "end"), [(0, 90), (0, 120), (0, 180), (-20, 220), (-45, 405), (-90, 450)]
)
@pytest.mark.parametrize("way", ["ccw", "cw", "both"])
def test_coarse_arcs_run_several_times_are_taken(
    way: str, start: float, end: float, step: float, plane: str
) -> None:
    """The return to the start of an arc is no travel: a run begins there."""
    end = start + step * np.floor((end - start) / step)
    there, back = (start, end, step), (end, start, step)
    test = arcs(
        {"ccw": [there] * 5, "cw": [back] * 5, "both": [there] * 3 + [back] * 3}[way], plane
    )
    runs = travel(test).each()
    rows = len(test) // len(runs)
    if (end - start) % 360 <= 180:  # a return that goes on the short way round is as a gap
        assert [len(run) for run in runs] == [rows] * (6 if way == "both" else 5)


def test_a_run_ends_where_the_machine_returns() -> None:
    """Also without a sense: travel there was taken from the way back."""
    test = arcs([(0.0, 180.0, 15.0)] * 5)
    for data in (test, test.with_columns(sense=None)):
        path = travel(data)
        assert [len(run) for run in path.each()] == [13] * 5
        # tangents of a coarse circle at its ends, to the second order
        x, y, _ = np.asarray(test.position_mm).T
        np.testing.assert_allclose(path.tangent[:, 0], -y / RADIUS_MM, atol=0.05)
        np.testing.assert_allclose(path.tangent[:, 1], x / RADIUS_MM, atol=0.05)


@pytest.mark.parametrize("plane", ["XY", "ZX"])
def test_a_fine_log_that_trembles_is_taken(plane: str) -> None:
    """Steps of 1.7 µm, positions to 2 µm: half of the path goes back."""
    travel(arcs([(0.0, 20.0, 0.001), (20.0, 0.0, 0.001)], plane, trembles_deg=0.00116))
    travel(arcs([(0.0, 360.0, 1.0), (360.0, 0.0, 1.0)], plane, trembles_deg=0.5))


@pytest.mark.parametrize("step", [5.0, 15.0, 30.0])
def test_coarse_arcs_in_another_order_are_refused(step: float) -> None:
    there, back = (0.0, 120.0, step), (120.0, 0.0, step)
    good = arcs([there] * 3 + [back] * 3)
    with pytest.raises(tn.DataError, match="counted the other way"):
        travel(inverted(good))
    rows = np.arange(len(good)).reshape(6, -1)
    rows[3:] = rows[3:, ::-1]  # each path by angle
    with pytest.raises(tn.DataError, match="Were rows sorted by angle"):
        travel(good[rows.ravel()])


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("turned_deg", [0.0, 2.0])
def test_rows_of_both_senses_sorted_by_angle_are_refused(turned_deg: float, plane: str) -> None:
    """A run of one row shows no travel: backlash of 6 µm was "consistent"."""
    test = arcs([(0.5, 359.0, 5.0), (359.0 - turned_deg, 0.0, 5.0)], plane)
    first, second = PLANES[plane]
    at = np.asarray(test.position_mm).T
    angle = np.mod(np.arctan2(at[second], at[first]), 2 * np.pi)
    with pytest.raises(
        tn.DataError, match=r"it changes 1\d\d times .* Were rows sorted by angle\?"
    ):
        tn.diagnose(test[np.argsort(np.round(angle, 6), kind="stable")])


def test_short_paths_of_both_senses_are_taken() -> None:
    """Arcs to and fro, rows that repeat, paths of one row at the ends, a column that numbers."""
    pendulum = arcs([(0.0, 90.0, 30.0), (90.0, 0.0, 30.0)] * 5)
    travel(pendulum)
    travel(arcs([(0.0, 90.0, 45.0), (90.0, 0.0, 45.0)] * 8))
    travel(pendulum[np.repeat(np.arange(len(pendulum)), 3)])
    whole = circle()
    ends = np.asarray(whole.sense).copy()
    ends[0], ends[-1] = -ends[0], -ends[-1]
    travel(whole.with_columns(sense=ends))
    travel(whole.with_columns(run=np.arange(len(whole))))
