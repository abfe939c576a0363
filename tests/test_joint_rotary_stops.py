"""Stops of a rotary axis beside touches: its reversal and its positioning are those of the machine.

Touches come from the independent twin, stops from the formulas of ISO 230-2 here.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

import trunnion as tn
from power.study import ground
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

Rng = np.random.Generator
NOISE_UM, NOISE_ARCSEC = 0.3, 0.5
Causes = Mapping[str, Mapping[str, float]]


def touches(effects: Causes, rng: Rng) -> tuple[tn.Touches, tn.Setup]:
    plan, setup, _, read = ground("rich")
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=effects)
    seed = int(rng.integers(1 << 31))
    made = measure(plan, setup, truth, noise_um=NOISE_UM, tick_um=0.01, seed=seed)
    return tn.Touches(made.columns), read


def stops(rng: Rng, ahead: float = 0.0, once: tuple[float, float] = (0.0, 0.0)) -> tn.Positioning:
    """Stops of C every 30°, approached from both sides; ``ahead``: forward less backward."""
    up = np.arange(0.0, 360.0, 30.0)
    target = np.tile(np.concatenate([up, up[::-1]]), 4)
    sense = np.tile(np.repeat([1, -1], len(up)), 4)
    turn = np.radians(target)
    off = ahead / 2 * sense + once[0] * np.cos(turn) + once[1] * np.sin(turn)
    off = off + NOISE_ARCSEC * rng.standard_normal(len(target)) + 3.0
    return tn.Positioning(
        target_deg=target,
        measured_deg=target + off / 3600,
        direction=sense,
        cycle=np.repeat(np.arange(1, 5), 2 * len(up)),
        axis=np.full(len(target), "C"),
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_backlash_and_positioning_of_c_are_shared(seed: int) -> None:
    rng = np.random.default_rng([811, seed])
    effects: Causes = {
        "c_backlash": {"b_arcsec": 6.0},
        "c_positioning": {"a1_arcsec": 5.0, "b1_arcsec": -7.0},
    }
    first, setup = touches(effects, rng)
    d = tn.diagnose([first, stops(rng, -6.0, (5.0, -7.0))], setup)
    assert d.named == {"c_backlash", "c_positioning"}
    assert d.effects["c_backlash"]["b_arcsec"] == pytest.approx(6.0, abs=0.4)
    assert d.effects["c_positioning"]["a1_arcsec"] == pytest.approx(5.0, abs=0.4)
    assert d.effects["c_positioning"]["b1_arcsec"] == pytest.approx(-7.0, abs=0.4)
    assert d.labels["c_backlash"] == "backlash of the C axis"
    assert not any("One instrument on a turning axis" in note for note in d.notes)


@pytest.mark.parametrize("seed", range(3))
def test_an_instrument_that_is_off_centre_is_not_the_axis(seed: int) -> None:
    """It reads an error once a turn that touches do not see: the measurements contradict."""
    rng = np.random.default_rng([812, seed])
    first, setup = touches({}, rng)
    d = tn.diagnose([first, stops(rng, 0.0, (9.0, 4.0))], setup)
    assert "c_positioning" not in d.named
    assert d.unexplained is not None
    assert "contradict each other: c_positioning.a1_arcsec is" in d.unexplained


def test_stops_of_c_alone_say_it_once_a_turn() -> None:
    rng = np.random.default_rng(813)
    d = tn.diagnose(stops(rng, 4.0, (5.0, -7.0)))
    assert d.named == {"reversal", "harmonic_1"}
    assert any("One instrument on a turning axis" in note for note in d.notes)
    two = tn.diagnose([stops(rng, 4.0, (5.0, -7.0)), stops(rng, 4.0, (5.0, -7.0))])
    assert two.named == {"c_backlash", "c_positioning"}
    assert two.effects["c_backlash"]["b_arcsec"] == pytest.approx(-4.0, abs=0.5)


@pytest.mark.parametrize("seed", range(3))
def test_an_error_of_the_first_date_alone_has_ended(seed: int) -> None:
    """As two causes that cancel, an error and its change, it was "unexplained" or a wander."""
    rng = np.random.default_rng([814, seed])
    d = tn.diagnose([stops(rng, -6.0, (4.0, -3.0)), stops(rng, -6.0)])
    ended = "positioning 2:change_c_positioning_ended"
    assert d.named == {"c_backlash", ended}
    assert d.labels["c_backlash"] == "backlash of the C axis"
    assert d.labels[ended].endswith("ended before positioning 2")
    assert d.effects[ended]["a1_arcsec"] == pytest.approx(4.0, abs=0.5)
    other = tn.diagnose([stops(rng, -6.0), stops(rng, -6.0, (4.0, -3.0))])
    assert other.named == {"c_backlash", "positioning 2:change_c_positioning"}


def test_what_one_measurement_shows_another_may_be_fitted_a_little_worse() -> None:
    """Touches see 1.2 arcsec with 0.3: a set was refused where their rms rose at all."""
    for seed in range(6):
        rng = np.random.default_rng([815, seed])
        first, setup = touches({}, rng)
        d = tn.diagnose([first, stops(rng, 0.0, (1.2, -0.9))], setup)
        assert d.causes or "contradict each other" in (d.unexplained or ""), seed
        assert "larger rms" not in (d.unexplained or "")


def test_stops_of_which_the_sense_is_reversed_are_asked_about() -> None:
    rng = np.random.default_rng(817)
    first, setup = touches({"c_backlash": {"b_arcsec": 6.0}}, rng)
    right = stops(rng, -6.0)
    d = tn.diagnose([first, right.with_columns(direction=-right.direction)], setup)
    assert "as of a direction or a sense of approach that is reversed" in str(d.unexplained)


def test_angles_within_one_turn_are_refused_and_axes_of_other_names_are_said() -> None:
    rng = np.random.default_rng(816)
    made = stops(rng, -6.0)
    low = made.with_columns(measured_deg=np.asarray(made.measured) - 6.0 / 3600)
    within = low.with_columns(measured_deg=np.mod(low.measured, 360.0))
    with pytest.raises(
        tn.DataError, match=r"measured_deg \(row 0\): got 359\.99.* within one turn"
    ):
        tn.diagnose(within)
    first, setup = touches({}, rng)
    for name, said in (("U", True), (" c ", False)):
        other = made.with_columns(axis=np.full(len(made), name))
        d = tn.diagnose([first, other], setup)
        assert any("errors once and twice per turn" in note for note in d.notes) == said
