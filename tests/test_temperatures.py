"""A scale that changes with the recorded temperature: by how many K, and as which expansion."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn


def run_of(seed: int, ppm: float, celsius: float | None) -> tn.Positioning:
    """Five cycles of stops of X over 500 mm."""
    rng, there = np.random.default_rng(seed), np.linspace(0.0, 500.0, 11)
    target = np.tile(np.concatenate([there, there[::-1]]), 5)
    n = len(target)
    off = 1e-3 * ppm * target + rng.normal(0.0, 0.4, n)
    run = tn.Positioning(
        target_mm=target,
        measured_mm=target + 1e-3 * off,
        direction=np.tile(np.repeat([1, -1], 11), 5),
        cycle=np.repeat(np.arange(1, 6), 22),
        axis=["X"] * n,
        time_s=np.arange(n) * 10.0,
    )
    return run if celsius is None else run.with_columns(temperature_c=np.full(n, celsius))


def notes(found: tn.Diagnosis) -> list[str]:
    return [note for note in found.notes if "temperature" in note]


@pytest.mark.parametrize(("kelvin", "more"), [(4.0, "4.0 K more"), (-4.0, "4.0 K less")])
def test_a_change_of_scale_is_stated_as_an_expansion(kelvin: float, more: str) -> None:
    ppm = 30.0 + 11.5 * kelvin
    first, second = run_of(0, 30.0, 20.0), run_of(20, ppm, 20.0 + kelvin)
    said = notes(tn.diagnose([first, second]))
    assert len(said) == 1
    assert more in said[0]
    assert "would be 11." in said[0]
    assert "ppm/K" in said[0]
    assert more in tn.compare(first, second).summary()


def test_a_change_that_no_material_makes_is_said_to_be_none_of_temperature_alone() -> None:
    said = notes(tn.diagnose([run_of(0, 30.0, 20.0), run_of(20, 130.0, 20.5)]))
    assert "temperature alone does not make it" in said[0]


@pytest.mark.parametrize("celsius", [(20.0, 20.0), (None, None), (20.0, None)])
def test_nothing_is_said_without_a_difference(celsius: tuple[float | None, float | None]) -> None:
    found = tn.diagnose([run_of(0, 30.0, celsius[0]), run_of(20, 76.0, celsius[1])])
    assert any("change_scale" in cause.id for cause in found.causes)
    assert not notes(found)


def test_the_report_says_that_temperatures_are_recorded(tmp_path: Path) -> None:
    """It said that nothing is stated of temperature, which stood in every row."""
    found = tn.diagnose([run_of(0, 30.0, 20.0), run_of(20, 76.0, 24.0)])
    text = found.to_html(tmp_path / "page.html").read_text("utf-8")
    page = re.sub(r"<[^>]+>", "", text[: text.index("<script")])
    assert "alignment and temperature are not in it: nothing is stated" not in page
    assert "20.0 to 24.0 °C" in page
    assert "4.0 K more" in page


def turned(run: tn.Positioning) -> tn.Positioning:
    """The same stops and deviations as of a rotary axis, in degrees."""
    return tn.Positioning(
        target_deg=run.target * 0.7,
        measured_deg=run.target * 0.7 + (run.measured - run.target),
        direction=run.direction,
        cycle=run.columns["cycle"],
        axis=["C"] * len(run),
        temperature_c=run.columns["temperature_c"],
    )


def test_a_uniform_temperature_changes_no_angle() -> None:
    first, second = (turned(run_of(0, 30.0, 20.0)), turned(run_of(20, 76.0, 24.0)))
    found = tn.diagnose([first, second])
    assert any("change_scale" in cause.id for cause in found.causes)
    assert not notes(found)
    assert "thermal expansion" not in tn.compare(first, second).summary()


@pytest.mark.parametrize("seed", range(3))
def test_a_rotary_axis_beside_silences_no_note_of_a_linear_one(seed: int) -> None:
    """Both axes change; of C alone, whose runs differ by 9 K, nothing is said."""
    runs = [run_of(seed, 30.0, 20.0), turned(run_of(seed + 40, 30.0, 18.0))]
    runs += [run_of(seed + 20, 76.0, 24.0), turned(run_of(seed + 60, 76.0, 27.0))]
    found = tn.diagnose(runs)
    changed = [cause.id for cause in found.causes if "change_" in cause.id]
    assert len(changed) == 2, changed
    said = notes(found)
    assert len(said) == 1
    assert "20.0 °C in positioning, 24.0 °C in positioning 3, 4.0 K more" in said[0]
    assert "would be 11." in said[0]


def test_kelvin_are_asked_about() -> None:
    first, second = run_of(0, 30.0, 293.2), run_of(20, 76.0, 297.2)
    assert "are these K, not °C?" in notes(tn.diagnose([first, second]))[0]
    assert "are these K, not °C?" in tn.compare(first, second).summary()
    assert "are these K" not in tn.compare(run_of(0, 30.0, 20.0), run_of(2, 76.0, 24.0)).summary()
