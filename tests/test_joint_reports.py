"""Reports of several measurements: advice for what they share, pictures of the right readings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import trunnion as tn
from power.one_machine import TOGETHER, drawn
from trunnion.diagnosis.families import OTHER, family_of, meaning
from trunnion.diagnosis.joint_ids import Happened, JointId
from trunnion.models.kinds import model_of
from trunnion.plot.diagnosis import cause_picture, residual_picture

TWO = [i for i, kinds in enumerate(TOGETHER) if len(set(kinds)) == 1 or "axislog" in kinds]


def stops(seed: int, axis: str, noise_um: float) -> tn.Positioning:
    """Stops of an axis of which one target is off by 8 µm each time."""
    rng = np.random.default_rng(seed)
    target = np.tile(np.concatenate([np.linspace(0, 400, 9), np.linspace(400, 0, 9)]), 3)
    direction = np.tile(np.repeat([1, -1], 9), 3)
    cycle = np.repeat([1, 2, 3], 18)
    off = 8e-3 * (target == 150.0) + 1e-3 * noise_um * rng.standard_normal(len(target))
    return tn.Positioning(
        target_mm=target,
        measured_mm=target + off,
        direction=direction,
        cycle=cycle,
        axis=[axis] * len(target),
    )


@pytest.mark.parametrize("kinds", [TOGETHER[i] for i in TWO], ids=",".join)
def test_every_cause_of_several_measurements_has_an_advice(kinds: tuple[str, ...]) -> None:
    made = drawn(kinds, 0, 3)
    effects = model_of(made.data, made.setup).effects
    assert [e.id for e in effects if family_of(e.id, e.owner) is OTHER] == []


def test_what_happened_to_a_cause_has_words_of_its_own() -> None:
    for one in Happened:
        id_ = one.id("touches 2", "squareness_xy")
        assert JointId.of(id_) == ("touches 2", one, "squareness_xy")
        assert family_of(id_) is not family_of("squareness_xy")
        # larger than before is not larger than 90 degrees: its sign says nothing here
        assert meaning(id_, {"arcsec": 10.0}) == "15 µm over 300 mm"
    assert JointId.of("touches:drift_x") == ("touches", None, "drift_x")
    assert JointId.of("change_of_shift") == ("", None, "change_of_shift")
    assert "towards +X" in meaning("touches:drift_x", {"rate_um_h": 3.0})
    assert family_of("curve_of_x") is family_of("curve")
    assert family_of("straightness_x_of_y").name == "guide"


def test_a_picture_over_a_quantity_holds_the_readings_that_have_it(tmp_path: Path) -> None:
    loud, quiet = stops(1, "x", 3.0), stops(2, "y", 0.3)
    d = tn.diagnose([loud, quiet])
    assert d.residuals is not None
    for v in d.residuals.covariates:
        assert v.known is not None
        drawn_ = [s for s in residual_picture(d, v).series if s.rows is not None]
        assert {len(np.asarray(s.x)) for s in drawn_} == {len(loud)}
        first = 0 if "positioning 2" not in v.name else len(loud)
        assert set(np.asarray(drawn_[0].rows).tolist()) == set(range(first, first + len(loud)))
    (own,) = (c for c in d.causes if c.id == "curve_of_y")
    picture = cause_picture(d, own.id)
    assert len(np.asarray(picture.series[0].x)) == len(quiet)
    report = tmp_path / "report.html"
    d.to_html(report)
    text = report.read_text()
    assert "Deviations by target (positioning 2)" in text
    assert "positioning:offset" not in text
    assert "no advice is known" not in text


def stops_of(seed: int, scale_ppm: float) -> tn.Positioning:
    """Five cycles of stops of X over 500 mm."""
    rng, there = np.random.default_rng([7, seed]), np.linspace(0.0, 500.0, 11)
    target = np.tile(np.concatenate([there, there[::-1]]), 5)
    return tn.Positioning(
        target_mm=target,
        measured_mm=target * (1 + 1e-6 * scale_ppm) + 3e-4 * rng.standard_normal(len(target)),
        direction=np.tile(np.repeat([1, -1], 11), 5),
        cycle=np.repeat(np.arange(1, 6), 22),
        axis=["X"] * len(target),
    )


def test_a_cause_of_all_runs_is_drawn_over_what_each_of_them_records() -> None:
    """The scale of three runs "depends on no single recorded quantity": each has its targets."""
    d = tn.diagnose([stops_of(i, 30.0) for i in range(3)])
    picture = cause_picture(d, "scale_x")
    assert picture.x.label == "Target position"
    assert len(picture.series[0].x) == 330


def test_what_happened_in_one_measurement_is_drawn_over_what_varies_there() -> None:
    """EX0C of one date alone was drawn over its feed, 600 mm/min in every touch."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    plan = tn.plan(setup)
    dates = [
        tn.simulate(plan, setup, errors={"EX0C": size}, noise_um=0.3, seed=i)
        for i, size in enumerate((15.0, 21.0, 15.0, 15.0), start=1)
    ]
    d = tn.diagnose(dates, setup)
    once = [cause.id for cause in d.causes if cause.id == "touches 2:once_EX0C"]
    assert once
    picture = cause_picture(d, once[0])
    drawn = picture.series[0]
    assert len(set(np.round(drawn.x))) > 1
    assert "eed" not in picture.x.label
    assert len(drawn.x) <= len(dates[1])


def test_sizes_are_written_as_people_write_them() -> None:
    assert meaning("scale_x", {"ppm": 530.0}, 300.0).endswith("160 µm over 300 mm")
    assert meaning("scale_x", {"ppm": 5.3}, 300.0).endswith("1.6 µm over 300 mm")
