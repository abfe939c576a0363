"""Machines whose owners knew the answer; skipped where their files are not at hand."""

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from measured import FOLDER, needs_files

pytestmark = needs_files


@cache
def diagnosis(name: str) -> tn.Diagnosis:
    return tn.diagnose(tn.datasets.load(name, FOLDER))


def cause(name: str, effect: str) -> dict[str, Any]:
    return next(dict(c.parameters) for c in diagnosis(name).causes if c.id == effect)


def test_the_page_has_its_figures_and_its_code_runs() -> None:
    page = Path(__file__).parents[1] / "docs" / "results" / "real-machines.md"
    text = page.read_text(encoding="utf-8")
    for figure in re.findall(r"\]\((../figures/.*?)\)", text):
        assert (page.parent / figure).is_file()
    for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(code, {})
    for name in tn.datasets.names():
        assert f"### `{name}`" in text or name == "servos"


def test_resolver_second_harmonic_and_whose_it_is_stays_open() -> None:
    """Owner: a fault in the resolver's coils; harmonics 0.26, 1.54, 0.08, 0.16 degrees."""
    found = diagnosis("resolver")
    assert found.contributions[0].id == "harmonic_2"
    for n, size, doubt in ((1, 0.26, 0.02), (2, 1.54, 0.02), (3, 0.08, 0.02), (4, 0.16, 0.02)):
        wave = np.hypot(*list(cause("resolver", f"harmonic_{n}").values())) / 3600
        assert wave == pytest.approx(size, abs=doubt)
    assert "whether the axis or the instrument has the error, the data do not say" in str(found)


def test_reflectors_drift_together() -> None:
    """Owner: 51, 41 and 50 µm in x, alike for all three."""
    found = diagnosis("reflectors")
    assert found.contributions[0].id == "common_drift"
    drift = cause("reflectors", "common_drift")
    total = 2 * sum(drift[f"x{k}_um"] for k in (1, 3, 5))  # from first to last
    assert total == pytest.approx(-47.0, abs=10.0)
    data = tn.datasets.load("reflectors", FOLDER)
    rows = [np.sum(np.all(data.nominal_mm == place, axis=1)) for place in _places(data)]
    assert sorted(1000 - np.array(rows)) == [0, 2, 16]


def _places(data: tn.Points) -> np.ndarray:
    return np.unique(data.nominal_mm, axis=0)


@pytest.mark.parametrize("step", [1, 10, 20])
def test_one_axis_does_not_explain_the_robot(step: int) -> None:
    """Owner: the last wrist joint turned, too."""
    with pytest.raises(tn.DataError, match=r"one axis does not explain it. A second rotation"):
        tn.diagnose(tn.datasets.load("ur5", FOLDER)[::step])


@pytest.mark.parametrize("joint", [1, 2, 5, 6])
def test_real_axes_are_not_refused(joint: int) -> None:
    assert diagnosis(f"arm_j{joint}").causes


@pytest.mark.parametrize(
    ("name", "reversal", "drift"),
    [("ess_x", 25.4, -1.4), ("ess_z", 1.6, None), ("muts_y", 10.6, -10.6)],
)
def test_target_drives(name: str, reversal: float, drift: float | None) -> None:
    assert abs(cause(name, "reversal")["b_um"]) == pytest.approx(reversal, abs=0.3)
    if drift is not None:
        assert cause(name, "cycle_drift")["rate_um_cycle"] == pytest.approx(drift, abs=0.1)


def test_the_report_of_the_x_drive() -> None:
    """Printed: B 33.58, mean reversal 25.37, M 93.65, A 135.27 µm."""
    got = tn.datasets.load("ess_x", FOLDER).iso230_2()
    assert got.reversal_um == pytest.approx(33.58, abs=0.01)
    assert got.mean_systematic_um == pytest.approx(93.65, abs=0.01)
    assert got.accuracy_um == pytest.approx(135.27, abs=0.01)


def test_the_granite_plate() -> None:
    """With the level turned its zero is distinguished; from one orientation it is not."""
    both = tn.datasets.load("surface_plate", FOLDER)
    assert len(both) == 108
    by_hand = (both["along_um_m"][:54] + both["along_um_m"][54:][::-1]).mean() / 2
    zero = both.flatness().instrument_zero_um_m
    assert zero is not None
    assert zero[0] == pytest.approx(by_hand, abs=0.5)
    assert "instrument_zero" in tn.diagnose(both[:54]).not_identifiable


def test_an_axis_against_its_own_counter() -> None:
    assert "reference and axis look like the same counter" in str(diagnosis("self_reference"))


def test_tank_backlash_differs_with_position() -> None:
    """Owner: 0.031, 0.027, 0.021, 0.030, 0.027 degrees at 0, 10, ... 40."""
    data = tn.datasets.load("tank", FOLDER)
    got = data.iso230_2()
    backlash = np.abs(got.mean_forward - got.mean_backward) / 3600
    np.testing.assert_allclose(backlash, [0.031, 0.027, 0.021, 0.030, 0.027], atol=0.0006)
    assert "reversal_of_position" in diagnosis("tank").named
