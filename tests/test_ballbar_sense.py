"""The column `sense` of a ball-bar test and the order of its rows have to say the same travel."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn

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
