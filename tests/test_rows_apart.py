"""Refused data of which some rows are no readings, and bars of another length than commanded."""

import re
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn


def circle(seed: int, radius: float = 100.0, bar: float = 100.0) -> dict[str, np.ndarray]:
    """A circle in XY both ways round on a machine with a squareness and a centre that is off."""
    rng = np.random.default_rng(seed)
    turn = np.radians(np.concatenate([np.arange(360.0), np.arange(360.0)[::-1]]))
    x, y = radius * np.cos(turn), radius * np.sin(turn)
    away = np.stack([x + 40e-6 * y - rng.uniform(-0.05, 0.05), y - rng.uniform(-0.05, 0.05)])
    length = np.hypot(*away) + bar - radius + 3e-4 * rng.standard_normal(len(turn))
    return {
        "setup": np.zeros(len(turn), dtype=int),
        "x_mm": x,
        "y_mm": y,
        "length_mm": np.round(length, 5),
        "sense": np.repeat([1, -1], 360),
        "feed_mm_min": np.full(len(turn), 1000.0),
    }


def cause_of(data: object) -> str:
    with pytest.raises(tn.DataError) as refused:
        tn.diagnose(data)
    return str(refused.value)


@pytest.mark.parametrize("held", [0.001, 999.0])
@pytest.mark.parametrize("count", [1, 3, 12])
def test_lengths_that_are_no_readings_are_counted(count: int, held: float) -> None:
    """The whole column was "deviations in µm" or "in inches"."""
    for seed in range(6):
        columns = circle(seed)
        rows = np.sort(np.random.default_rng([seed, 1]).permutation(720)[:count])
        columns["length_mm"][rows] = held
        said = cause_of(columns)
        assert f"Likely cause: {count} of 720 rows do" in said
        for row in rows[:3].tolist():
            assert re.search(rf"\b{row}\b", said.split("Likely cause:")[1])
        assert ("and 9 more" in said) == (count == 12)
        assert f"{held:g} in length_mm; without" in said
        assert "inches" not in said
        assert "deviations" not in said


def test_rows_of_a_file_are_its_lines(tmp_path: Path) -> None:
    columns = circle(1)
    columns["length_mm"][[5, 300]] = [0.001, 0.5]
    tn.Ballbar(columns).to_csv(tmp_path / "circle.csv")
    said = cause_of(tn.read(tmp_path / "circle.csv"))
    assert "2 of 720 rows do not go with the others" in said
    assert "lines 7 and 302 of circle.csv hold values of length_mm" in said


@pytest.mark.parametrize("count", [1, 4])
def test_holes_that_were_not_measured_are_counted(count: int) -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)
        nominal = np.stack(np.meshgrid(50.0 * np.arange(9), 50.0 * np.arange(7)), axis=-1)
        nominal = nominal.reshape(-1, 2) + np.array([30.0, 20.0])
        turned = np.array([[1.0, 1e-3], [-1e-3, 1.0 + 2e-5]])
        measured = nominal @ turned + rng.uniform(-1, 1, 2) + 2e-3 * rng.standard_normal((63, 2))
        rows = np.sort(rng.permutation(63)[:count])
        measured[rows] = 0.0
        columns = {f"nominal_{a}_mm": nominal[:, i] for i, a in enumerate("xy")}
        columns |= {f"{a}_mm": measured[:, i] for i, a in enumerate("xy")}
        said = cause_of(columns)
        assert f"Likely cause: {count} of 63 rows do" in said
        assert f"row{'s' if count > 1 else ''} {rows[0]}" in said.split("Likely cause:")[1]
        assert "0 in x_mm and 0 in y_mm; without" in said


@pytest.mark.parametrize(("radius", "bar"), [(100.0, 150.0), (150.0, 100.0), (100.0, 300.0)])
def test_a_bar_of_another_length_is_asked_about(radius: float, bar: float) -> None:
    for seed in range(4):
        said = cause_of(circle(seed, radius, bar))
        assert f"if the ball-bar is {bar:g} mm long where {radius:g} mm are commanded." in said


@pytest.mark.parametrize(("factor", "unit"), [(1 / 25.4, "inches"), (0.1, "cm"), (1000.0, "µm")])
def test_a_whole_column_in_another_unit_is_that(factor: float, unit: str) -> None:
    for seed in range(4):
        columns = circle(seed)
        columns["length_mm"] = columns["length_mm"] * factor
        said = cause_of(columns)
        assert f"in {unit}" in said
        assert "ball-bar is" not in said
        assert "rows do" not in said
