"""Circles by one ball-bar, each a measurement of its own: its length is wrong once, not thrice."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from ballbar_twin import cartesian_lengths, record
from positioning_twin import axis
from trunnion.models.kinds import model_of
from trunnion.setup import Artefact, Setup

Rng = np.random.Generator
PLANES = ("XY", "YZ", "XZ")
LONGER_UM = 10.0
SIGMA_UM = 0.3
BAR, ALIKE = "ballbar:ballbar_length", "scale_xyz"
SCALES = {"scale_x", "scale_y", "scale_z"}


def circle(
    rng: Rng, plane: str, longer_um: float, ppm: tuple[float, ...], radius: float = 150.0
) -> tn.Ballbar:
    """Both senses of a circle by a bar that is longer than stated, on a machine of these scales."""
    spot = rng.uniform(-100, 100, 3)
    rec = record(spot, step_deg=8.0, arcs=((plane, 0, 360),), radius=radius)
    error = 1e-6 * np.array(ppm) * (rec.points - spot)
    lengths = cartesian_lengths(rec, rng, sigma_um=SIGMA_UM, motion=lambda _: error)
    x, y, z = rec.points.T
    columns: dict[str, Any] = {"setup": rec.setup, "x_mm": x, "y_mm": y, "z_mm": z}
    return tn.Ballbar(
        **columns, length_mm=lengths + 1e-3 * longer_um, sense=rec.sense, time_s=rec.time_s
    )


def circles(
    rng: Rng, longer_um: float = 0.0, ppm: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> list[object]:
    """Three circles in the three planes."""
    return [circle(rng, plane, longer_um, ppm) for plane in PLANES]


def stops(rng: Rng, name: str, ppm: float) -> tn.Positioning:
    """Stops of an axis of this scale, by a laser."""
    made = axis(rng, noise=SIGMA_UM)
    read = made.measured + 1e-6 * ppm * made.target
    return made.with_columns(measured_mm=read, axis=[name] * len(made))


@pytest.mark.parametrize("seed", range(3))
def test_one_wrong_bar_is_one_cause_beside_the_scale_of_all_axes_alike(seed: int) -> None:
    d = tn.diagnose(circles(np.random.default_rng([91, seed]), LONGER_UM))
    assert d.named == {BAR}
    assert d.verdict == "ambiguous"
    assert {BAR} in d.alternatives
    assert {ALIKE} in d.alternatives
    assert not any(SCALES & set(one) for one in d.alternatives[:2])
    cause = d.causes[0]
    assert abs(cause.parameters["dl_um"] - LONGER_UM) < 5 * cause.std_errors["dl_um"] < 0.2
    assert cause.label == "length of the ball-bar"


def test_a_machine_that_is_long_in_all_axes_is_not_told_from_a_long_bar() -> None:
    d = tn.diagnose(circles(np.random.default_rng([92]), ppm=(60.0, 60.0, 60.0)))
    assert d.verdict == "ambiguous"
    (same,) = [a for a in d.evidence if a.causes == {ALIKE}]
    assert same.probability > 0.4
    assert d.model.not_compensable.keys() == set(d.model.effects)


def test_a_scale_of_one_axis_is_found_beside_a_long_bar() -> None:
    d = tn.diagnose(circles(np.random.default_rng([93]), LONGER_UM, (20.0, 0.0, 0.0)))
    assert d.named == {BAR, "scale_x"}
    (cause,) = [c for c in d.causes if c.id == "scale_x"]
    assert abs(cause.parameters["ppm"] - 20.0) < 5 * cause.std_errors["ppm"] < 5.0


@pytest.mark.parametrize("of_machine", [False, True])
def test_the_axes_own_tests_settle_which_it_is(*, of_machine: bool) -> None:
    rng = np.random.default_rng([94, of_machine])
    ppm = 60.0 if of_machine else 0.0
    made = circles(rng, 0.0 if of_machine else LONGER_UM, (ppm, ppm, ppm))
    d = tn.diagnose([*made, *(stops(rng, name, ppm) for name in "XYZ")])
    hidden = {ALIKE} if of_machine else {BAR}
    assert d.named == hidden
    assert all(hidden <= set(one) for one in d.alternatives)
    assert all(c.probability > 0.99 for c in d.causes)


@pytest.mark.parametrize("of_machine", [False, True])
@pytest.mark.parametrize("axis", "XZ")
def test_what_is_recommended_of_the_doubt_settles_it(axis: str, *, of_machine: bool) -> None:
    """The other two axes have no test of their own: the bar compares them with the first."""
    rng = np.random.default_rng([98, ord(axis), of_machine])
    ppm = 60.0 if of_machine else 0.0
    made = circles(rng, 0.0 if of_machine else LONGER_UM, (ppm, ppm, ppm))[:2]
    d = tn.diagnose(made)
    assert {frozenset({BAR}), frozenset({ALIKE})} <= set(d.alternatives)
    other = ({BAR, ALIKE} - d.named).pop()
    apart = {one.label: one.apart[frozenset({other})] for one in tn.next_measurement(d)}
    assert apart[f"a positioning run of {axis}"] > 6
    assert apart["a circle of a ball-bar in ZX, both senses"] < 0.1
    after = tn.diagnose([*made, stops(rng, axis, ppm)])
    hidden, excluded = (ALIKE, BAR) if of_machine else (BAR, ALIKE)
    assert hidden in after.named
    assert all(hidden in one and excluded not in one for one in after.alternatives)
    assert after.unexplained is None


def test_a_run_whose_axis_is_not_known_is_said_to_share_nothing() -> None:
    rng = np.random.default_rng(99)
    made, run = circle(rng, "XY", 0.0, (30.0, 0.0, 0.0)), stops(rng, "X", 30.0)
    for given, said in (
        (run.with_columns(axis=None), "positioning: there is no column axis: scale and reversal"),
        (run.with_columns(axis=["Q"] * len(run)), "positioning: axis is 'Q': scale and reversal"),
    ):
        d = tn.diagnose([made, given])
        assert {"scale_x"} < d.named
        assert any(note.startswith(said) for note in d.notes)
    for some in (
        [made, run],
        [run.with_columns(axis=None), stops(rng, "X", 30.0).with_columns(axis=None)],
    ):
        assert not any("not shared" in note for note in tn.diagnose(some).notes)


def test_bars_of_other_lengths_have_lengths_of_their_own() -> None:
    rng = np.random.default_rng([95])
    none = (0.0, 0.0, 0.0)
    d = tn.diagnose([circle(rng, "XY", 0.0, none), circle(rng, "XZ", 8.0, none, 100.0)])
    assert d.named == {"ballbar 2:ballbar_length"}


def test_a_set_up_can_say_that_bars_are_several() -> None:
    several = replace(Setup(artefact=Artefact("none")), ballbar={"one_bar": False})
    model = model_of(circles(np.random.default_rng([96]), LONGER_UM), several)
    ids = {e.id for e in model.effects}
    assert {BAR, "ballbar 2:ballbar_length", "ballbar 3:ballbar_length"} <= ids
    assert ALIKE not in ids


def test_a_bar_that_changed_between_two_dates_is_found() -> None:
    rng = np.random.default_rng([97])
    none = (0.0, 0.0, 0.0)
    d = tn.diagnose([circle(rng, "XY", 0.0, none), circle(rng, "XY", LONGER_UM, none)])
    assert {"ballbar 2:change_ballbar_length"} in d.alternatives


@pytest.mark.parametrize("axes", ["X", "XY"])
def test_a_warm_machine_is_no_contradiction_and_no_two_wrong_instruments(axes: str) -> None:
    """All axes 20 ppm long, two circles and stops of some axes; other seeds than the others."""
    for seed in range(4):
        rng = np.random.default_rng([99, seed])
        made = [circle(rng, plane, 0.0, (20.0, 20.0, 20.0)) for plane in ("XY", "YZ")]
        d = tn.diagnose([*made, *(stops(rng, name, 20.0) for name in axes)])
        assert d.verdict != "unexplained"
        assert d.named == {ALIKE}
        assert not d.model.not_compensable
        assert d.model.effects[ALIKE]["ppm"] == pytest.approx(20.0, abs=0.5)


def test_scales_that_differ_are_not_named_alike() -> None:
    rng = np.random.default_rng([98])
    ppm = (30.0, -12.0, 0.0)
    d = tn.diagnose([circle(rng, "XY", 0.0, ppm), stops(rng, "X", 30.0), stops(rng, "Y", -12.0)])
    assert d.named == {"scale_x", "scale_y"}
    assert not any(one >= {"scale_xy"} for one in d.alternatives)
