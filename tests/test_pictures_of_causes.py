"""A cause is drawn over what it depends on, and what is in doubt is stated set by set."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from trunnion.base.units import Floats
from trunnion.diagnosis.model import Covariate
from trunnion.diagnosis.records import labelled, together
from trunnion.plot.coordinates import Weight, coordinate_of
from trunnion.plot.diagnosis import cause_picture
from trunnion.reports.advice import to_do
from trunnion.reports.causes import Found
from trunnion.reports.source import Source

SEEDS = (3, 4, 5)
PLACES = np.arange(50.0, 1600.0, 100.0)


def roll_of_a_level(seed: int, shape: Floats) -> tn.Levels:
    """Read a line there, and back with the instrument turned, of slopes (16,), µm/m."""
    rng = np.random.default_rng(seed)
    place = np.concatenate([PLACES, PLACES[::-1]])
    sense = np.repeat([1.0, -1.0], len(PLACES))
    slope = np.concatenate([shape, shape[::-1]])
    return tn.Levels(
        position_mm=place,
        along_um_m=np.round(sense * (slope + 100) + 15 + rng.normal(0, 0.8, len(place)), 1),
        across_um_m=np.round(sense * -60 - 8 + rng.normal(0, 0.8, len(place)), 1),
        turn_deg=np.repeat([0.0, 180.0], len(PLACES)),
        time_s=25.0 * np.arange(len(place)),
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_places_that_are_read_in_turn_are_not_drawn_as_times(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place = np.sort(rng.uniform(0, 300, 120))
    time = np.cumsum(rng.uniform(1, 3, 120))
    covariates = (
        Covariate("place", place, "mm"),
        Covariate("time", time, "s", sequence=True),
        Covariate("order", np.arange(120.0), sequence=True),
    )
    weights, every = [Weight("reading", "µm", np.ones(120))], np.ones(120, dtype=bool)
    for change in (place / 100, (place - 150) ** 2 / 1e4):
        for timed, name in ((False, "place"), (True, "time")):
            made = coordinate_of(change, covariates, weights, every, timed=timed)
            assert made is not None
            assert made.x.name == name


@pytest.mark.parametrize("seed", SEEDS)
def test_shapes_of_a_surface_are_drawn_over_the_place(seed: int) -> None:
    bent = 40.0 * (PLACES - PLACES.mean()) / np.ptp(PLACES)
    d = tn.diagnose(roll_of_a_level(seed, bent + np.where(PLACES > 700, 25.0, 0.0)))
    shapes = [c.id for c in d.causes if c.id in ("kink", "bow", "field")]
    assert shapes
    assert {cause_picture(d, id_).x.label for id_ in shapes} == {"Position"}


@pytest.mark.parametrize("decay", [0.4, 0.7, 1.2])
def test_a_spike_after_a_reversal_is_drawn_over_the_angle(decay: float) -> None:
    """It is narrower than any curve of equal nodes: 400 readings a turn, decay in degrees."""
    angle = np.concatenate([np.linspace(0, 360, 401)[:-1]] * 2)
    sense = np.repeat([1.0, -1.0], 400)
    since = np.where(sense > 0, angle - 180, 180 - angle)
    change = np.where(since > 0, -8.0 * np.exp(-np.clip(since, 0, 400) / decay), 0.0)
    covariates = (
        Covariate("angle", angle, "deg", period=360.0),
        Covariate("sense", sense, words=((1.0, "counter-clockwise"), (-1.0, "clockwise"))),
        Covariate("time", np.arange(800.0), "s", sequence=True),
    )
    weights, every = [Weight("length", "µm", np.ones(800))], np.ones(800, dtype=bool)
    made = coordinate_of(change, covariates, weights, every)
    assert made is not None
    assert made.x.name == "angle"
    curves = made.curve(change[:, None], every)
    assert {name for name, _, _ in curves} == {"counter-clockwise", "clockwise"}
    for _, _, fitted in curves:
        assert fitted.min() == pytest.approx(change.min(), rel=0.05)  # as high as it is
    rng = np.random.default_rng(1)
    assert coordinate_of(rng.standard_normal(800), covariates, weights, every) is None


def test_targets_are_called_as_in_the_file() -> None:
    sweep = tn.read_sweep(tn.sample_path("axis/sweep.csv"))
    d = tn.diagnose(sweep)
    assert d.residuals is not None
    targets = next(v for v in d.residuals.covariates if v.name == "target")
    assert set(targets.values.tolist()) == set(np.asarray(sweep.target).tolist())


def doubtful() -> tn.Diagnosis:
    """Return a diagnosis that is certain of some causes and in doubt about others."""
    dip = -25.0 * np.exp(-(((PLACES - 300) / 120) ** 2))
    for seed in range(10):
        d = tn.diagnose(roll_of_a_level(seed, dip))
        found = Found(d)
        if len(d.evidence) > 1 and found.certain and len(found.certain) < len(d.causes):
            return d
    raise AssertionError("no case of ten is in doubt")


def test_what_is_in_doubt_is_named_once_with_its_own_probability() -> None:
    d = doubtful()
    found = Found(d)
    said = found.in_doubt(len(d.evidence))
    for id_ in {i for a in d.evidence for i in a.causes} - found.certain:
        assert said.count(found.sized(id_)) == 1
    assert said.count("%") == len({i for a in d.evidence for i in a.causes} - found.certain)
    several = [a for a in d.evidence if len(a.causes - found.certain) > 1]
    assert ("together with" in said) == bool(several)


def test_certain_causes_stand_above_those_in_doubt() -> None:
    found = Found(doubtful())
    for table in found.tables():
        doubts = ["in doubt" in str(row[0]) for row in table.rows if row[3] is not None]
        assert doubts == sorted(doubts)


def test_causes_of_one_set_read_as_one() -> None:
    assert together(["A"]) == "A"
    assert together(["A", "B"]) == "A, and B, together"
    assert together([]) == ""


def test_a_ball_bar_is_not_cleaned_as_a_probe() -> None:
    data = tn.read_ballbar(tn.sample_path("ballbar/circle.csv"))
    length = np.array(data.length_mm)
    length[40] += 0.05
    d = tn.diagnose(data.with_columns(length_mm=length))
    assert d.outliers == (40,)
    lines = to_do(Found(d), Source(data=(data,))).sentences
    assert [x for x in lines if x.startswith("Clean the balls")]
    assert not [x for x in lines if "probe" in x]


def test_a_shape_is_not_uncertain_by_itself() -> None:
    """Of twelve such lines four said so."""
    dip, named = -25.0 * np.exp(-(((PLACES - 300) / 120) ** 2)), 0
    for seed in range(12):
        d = tn.diagnose(roll_of_a_level(seed, dip))
        named += "field" in d.named
        own = [note for note in d.notes if note.startswith("Smooth shape")]
        assert not [note for note in own if "by the smooth shape beside it" in note]
        (twist,) = [note for note in d.notes if "whole roll the twist is" in note]
        assert " ± " in twist
    assert named > 6


def test_ids_of_measurements_and_names_of_parameters_are_said_once_and_in_words() -> None:
    said = labelled("touches:drift_z", "drift of the Z axis (touches)")
    assert said == "drift of the Z axis (touches:drift_z)"
    assert labelled("drift_z", "drift of the Z axis") == "drift of the Z axis (drift_z)"
    expansion = tn.Cause(
        "expansion", {"ppm_k": 18.2, "lag_s": 60.0}, {"ppm_k": 0.4, "lag_s": 2.0}, 0.0
    )
    assert expansion.size().startswith("coefficient = 18.2")
