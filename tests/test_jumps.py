"""A jump in the readings is where it is, and not at a place of a grid: nothing is named for it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import axis
from trunnion.diagnosis import terms

COUNT = 500  # readings in each sense: ten between two places of the scan
STEP_UM = 3.0
RADIUS_MM = 100.0


def circle(
    seed: int,
    jump_s: float,
    backlash_um: float,
    squareness_arcsec: float,
    *,
    step_um: float = STEP_UM,
    scale_x_ppm: float = 0.0,
) -> tn.Ballbar:
    """A circle in both senses, with noise of 0.1 µm; the bar reads longer from a time on."""
    rng = np.random.default_rng(seed)
    turn = 2 * np.pi * np.arange(COUNT) / COUNT
    angle, sense = np.r_[turn, -turn], np.repeat([1, -1], COUNT)
    time = np.r_[turn, turn + 2 * np.pi + 5.0] * RADIUS_MM / (1000 / 60)
    x, y = RADIUS_MM * np.cos(angle), RADIUS_MM * np.sin(angle)
    real_x = (1 + 1e-6 * scale_x_ppm) * x - np.pi / 648000 * squareness_arcsec * y
    real_y = y - 0.5e-3 * backlash_um * np.sign(np.round(sense * np.cos(angle), 9))
    length = np.hypot(real_x - 0.012, real_y + 0.007)
    length += 1e-3 * (step_um * (time > jump_s) + 0.1 * rng.standard_normal(2 * COUNT))
    columns = {"setup": np.ones(2 * COUNT), "x_mm": x, "y_mm": y, "length_mm": length}
    return tn.Ballbar(columns | {"sense": sense, "time_s": time})


@pytest.mark.parametrize("jump_s", [72.9, 78.3, 86.9, 95.6])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_jump_is_at_the_reading_at_which_it_is(seed: int, jump_s: float) -> None:
    data = circle(seed, jump_s, 2.0, 5.0)
    d = tn.diagnose(data)
    assert d.named == {"backlash_y", "squareness_xy"}
    assert d.effects["backlash_y"]["b_um"] == pytest.approx(2.0, abs=0.06)
    assert d.effects["squareness_xy"]["arcsec"] == pytest.approx(5.0, abs=0.15)
    assert d.structure is not None
    assert d.structure.effect.shape == "jump"
    first = data["time_s"][data["time_s"] > jump_s].min()
    assert d.structure.effect.number == pytest.approx(first, abs=0.2)
    assert d.structure.parameters["step_um"] == pytest.approx(STEP_UM, abs=0.06)
    assert f"a jump at {d.structure.effect.number:.4g} s" in (d.unexplained or "")
    assert d.gain.rms_after_um == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize("jump_s", [10.1, 17.3, 24.4, 31.6, 74.4])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_smaller_jump_gives_causes_no_share(seed: int, jump_s: float) -> None:
    d = tn.diagnose(circle(seed, jump_s, 2.0, 5.0, step_um=1.5))
    assert d.named == {"backlash_y", "squareness_xy"}
    assert d.structure is not None
    assert d.structure.parameters["step_um"] == pytest.approx(1.5, abs=0.06)
    assert d.effects["squareness_xy"]["arcsec"] == pytest.approx(5.0, abs=0.15)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_jump_of_the_bar_says_nothing_of_another_measurement(seed: int) -> None:
    """The noise of the circle is that beside the jump; stops of X have their scale and no more."""
    jumped = circle(seed, 74.4, 3.0, 6.0, step_um=2.0, scale_x_ppm=20.0)
    stops = axis(np.random.default_rng([62, seed]), noise=0.3)
    grown = stops.measured + 20e-6 * (stops.target - 250.0)
    columns = {"measured_mm": grown, "axis": np.full(len(stops), "X")}
    d = tn.diagnose([stops.with_columns(**columns), jumped])
    assert d.named == {"scale_x", "backlash_y", "squareness_xy"}
    assert d.effects["scale_x"]["ppm"] == pytest.approx(20.0, abs=0.5)
    assert "jump" in (d.unexplained or "")


def test_what_a_formula_changes_is_said_of_every_reading() -> None:
    """Also of those where an axis just turns, which a diagnosis leaves out."""
    data = circle(3, 78.3, 0.0, 0.0)
    d = tn.diagnose(data)
    assert any("where an axis just turns" in note for note in d.notes)
    assert d.structure is not None
    change = d.structure.effect.change(data, d.structure.parameters)
    assert change.shape == (len(data),)
    assert d.structure.effect.jacobian(data, d.structure.parameters).shape == (len(data), 1)
    after = data["time_s"] > 78.3
    assert np.abs(change - STEP_UM * after).max() < 0.1


def test_two_causes_that_begin_at_moments_share_a_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    """A jump that may be there instead of either was listed twice, and the search failed."""
    places = iter([[(7, 3.0)], [(7, 2.0), (8, 1.0)]])
    monkeypatch.setattr(terms, "moments_of", lambda *_: ["t0_s"])
    monkeypatch.setattr(terms, "without_one", lambda *_: (None, None))
    case: Any = SimpleNamespace(
        effects=[SimpleNamespace(id="one"), SimpleNamespace(id="two")],
        columns_of=lambda *_: [0],
        dictionary=SimpleNamespace(best_jumps=lambda *_: next(places)),
    )
    fit: Any = SimpleNamespace(effects={"one": {}, "two": {}}, jacobian=np.ones((3, 1)))
    found = terms.jumps_instead(case, fit)
    assert found == [terms.Competing(7, (2.0, 3.0)), terms.Competing(8, (1.0,))]
