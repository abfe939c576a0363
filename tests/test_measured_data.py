"""What was found in the measured files of others; skipped where they are not at hand."""

from pathlib import Path

import numpy as np
import pytest

import trunnion as tn

FOLDER = Path(__file__).resolve().parents[1] / ".." / "shared" / "measured"

pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason="the measured files of others are not part of the project"
)


@pytest.fixture(scope="module")
def plates() -> dict[int, tn.Points]:
    return {y: tn.read_points(FOLDER / f"plate1597a_{y}.csv") for y in (2003, 2010)}


@pytest.fixture(scope="module")
def diagnoses(plates: dict[int, tn.Points]) -> dict[int, tn.Diagnosis]:
    return {y: tn.diagnose(p) for y, p in plates.items()}


@pytest.mark.parametrize(
    ("joint", "radial", "axial"),
    [("j1", 5.2, 5.1), ("j2", 2.0, 21.2), ("j5", 5.1, 4.3), ("j6", 2.5, 0.9)],
)
def test_circles_leave_what_was_stated(joint: str, radial: float, axial: float) -> None:
    (circle,) = tn.fit_circles(tn.read_sweep(FOLDER / f"meca500_{joint}.csv")).values()
    assert circle.radial_rms_um == pytest.approx(radial, abs=0.05)
    assert circle.axial_rms_um == pytest.approx(axial, abs=0.05)


@pytest.mark.parametrize("joint", ["j1", "j2", "j5", "j6"])
def test_sweeps_gain_on_blocks_of_angle_left_out(joint: str) -> None:
    d = tn.diagnose(tn.read_sweep(FOLDER / f"meca500_{joint}.csv"))
    assert d.verdict != "consistent"
    assert d.gain.heldout_rms_after_um < d.gain.heldout_rms_before_um
    if joint == "j2":  # an arc of 95 deg
        assert d.verdict == "ambiguous"
        assert len(d.alternatives) > 3


@pytest.mark.parametrize(("year", "rms"), [(2003, 6.38), (2010, 6.60)])
def test_placement_alone_leaves_what_was_stated(
    diagnoses: dict[int, tn.Diagnosis], year: int, rms: float
) -> None:
    assert diagnoses[year].gain.rms_before_um == pytest.approx(rms, abs=0.01)


@pytest.mark.parametrize(("year", "other"), [(2003, 2010), (2010, 2003)])
def test_plate_of_one_year_predicts_the_other(
    plates: dict[int, tn.Points], diagnoses: dict[int, tn.Diagnosis], year: int, other: int
) -> None:
    d = diagnoses[year]
    part = tn.repeatable_part(d, plates[other])
    # What is alike at neighbouring places is in the smooth field, not in a scale or a bow.
    assert d.score(plates[other]).rms_after_um < part.left_named_um
    assert part.correlation["X"] == pytest.approx(0.80, abs=0.01)
    assert part.correlation["Y"] == pytest.approx(0.86, abs=0.01)
    assert part.left_smooth_um < 5.25
    assert part.left_hole_by_hole_um < 3.9
    assert part.left_hole_by_hole_um < part.left_smooth_um < part.left_named_um
    assert part.named > 0.4
    assert part.hole_by_hole > 0.25


def test_the_first_holes_of_2010_were_measured_elsewhere(
    plates: dict[int, tn.Points], diagnoses: dict[int, tn.Diagnosis]
) -> None:
    slip = next(c for c in diagnoses[2010].causes if c.id == "setup_shift")
    assert 45 < slip.parameters["row"] < 75
    assert slip.parameters["dx_um"] == pytest.approx(-9.5, abs=1.5)
    assert "setup_shift" not in {c.id for c in diagnoses[2003].causes}
    # without any model: what changed between the years, early and late holes
    change = plates[2010].measured_mm - plates[2003].measured_mm
    turned = tn.diagnose(plates[2003]).rebuilt_model()
    again = turned.bind(plates[2010])
    x = (again.readings.values - turned.readings.values)[::2]
    assert np.mean(x[:50]) - np.mean(x[70:]) > 8.0
    assert change.shape == (650, 2)
