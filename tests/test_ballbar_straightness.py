"""A bent guide on ball-bar lengths, calculated from its circle: every plane, and partial arcs."""

from pathlib import Path

import numpy as np
import pytest

import trunnion as tn
from trunnion.machine.effects import MotionPose

RADIUS_MM = 1.2e6  # of a guide: 9.4 µm of height over 300 mm
PLANES = ((0, 1), (0, 2), (1, 2))


def round_about(
    planes: tuple[tuple[int, int], ...], first_deg: float, last_deg: float, radius: float = 150.0
) -> np.ndarray:
    """Places there and back on arcs about (30, -80, 40), exact."""
    turn = np.radians(np.arange(first_deg, last_deg + 1.0, 2.0))
    turn = np.concatenate([turn, turn[::-1]])
    out = np.tile([30.0, -80.0, 40.0], (len(planes) * len(turn), 1))
    for k, (i, j) in enumerate(planes):
        rows = slice(k * len(turn), (k + 1) * len(turn))
        out[rows, i] += radius * np.cos(turn)
        out[rows, j] += radius * np.sin(turn)
    return out


def bent(place: np.ndarray, into: int, along: int, rng: np.random.Generator) -> tn.Ballbar:
    """Lengths on a machine of which one guide is a circle of RADIUS_MM, 0.3 µm of noise."""
    u = place[:, along] - (place[:, along].max() + place[:, along].min()) / 2
    tip = place.copy()
    tip[:, into] += RADIUS_MM - np.sqrt(RADIUS_MM**2 - u**2)
    length = np.linalg.norm(tip - [30.02, -80.01, 40.01 if np.ptp(place[:, 2]) else 40.0], axis=1)
    return tn.Ballbar(
        setup=np.zeros(len(place), int),
        **{f"{a}_mm": place[:, i] for i, a in enumerate("xyz")},
        length_mm=length + rng.normal(0, 3e-4, len(place)),
        feed_mm_min=np.full(len(place), 1000.0),
    )


@pytest.mark.parametrize("along", range(3))
@pytest.mark.parametrize("step", [1, 2])
@pytest.mark.parametrize("last_deg", [360.0, 190.0])
def test_a_bent_guide_has_the_curvature_of_its_circle(
    along: int, step: int, last_deg: float
) -> None:
    into = (along + step) % 3
    name = f"straightness_{'xyz'[into]}_of_{'xyz'[along]}"
    places = round_about(PLANES, 0.0 if last_deg == 360.0 else -10.0, last_deg)
    d = tn.diagnose(bent(places, into, along, np.random.default_rng(11)))
    assert d.named == {name}
    u = d.model.std_errors[f"{name}.curvature_um_m2"]
    found = d.causes[0].parameters["curvature_um_m2"]
    assert found == pytest.approx(1e9 / RADIUS_MM, abs=4 * u)
    assert u < 0.03 * found
    there = MotionPose(places, {})
    moved = d.model.motions[name](there, d.causes[0].parameters)
    exact = (places[:, along] - np.mean([places[:, along].min(), places[:, along].max()])) ** 2
    exact *= 1e3 / (2 * RADIUS_MM)
    assert moved[:, into] - moved[0, into] == pytest.approx(exact - exact[0], abs=0.5)
    assert not np.delete(moved, into, axis=1).any()


def test_a_bow_in_one_plane_may_be_of_the_other_axis_positioning() -> None:
    rng = np.random.default_rng(12)
    flat = tn.diagnose(bent(round_about(PLANES[:1], 0.0, 360.0), 1, 0, rng))
    assert flat.named == {"straightness_y_of_x"}
    assert sum("positioning error of the Y axis" in note for note in flat.notes) == 1
    every = tn.diagnose(bent(round_about(PLANES, 0.0, 360.0), 1, 0, rng))
    assert not any("positioning error" in note for note in every.notes)


def test_bars_of_two_lengths_share_the_curvature_of_a_guide() -> None:
    rng = np.random.default_rng(13)
    two = [bent(round_about(PLANES[:1], 0.0, 360.0, r), 0, 1, rng) for r in (100.0, 250.0)]
    d = tn.diagnose(two)
    assert d.named == {"straightness_x_of_y"}
    found = d.causes[0].parameters["curvature_um_m2"]
    u = d.model.std_errors["straightness_x_of_y.curvature_um_m2"]
    assert found == pytest.approx(1e9 / RADIUS_MM, abs=4 * u)


def test_what_bends_is_stored_and_bends_a_machine(tmp_path: Path) -> None:
    d = tn.diagnose(bent(round_about(PLANES[:1], 0.0, 360.0), 0, 1, np.random.default_rng(14)))
    name = "straightness_x_of_y"
    d.model.to_json(tmp_path / "bow.json")
    stored = tn.read_estimate(tmp_path / "bow.json")
    there = MotionPose(np.array([[0.0, 70.0, 0.0], [0.0, -80.0, 0.0], [0.0, 400.0, 0.0]]), {})
    end, middle, beyond = stored.motions[name](there, stored.effects[name])
    assert end[0] - middle[0] == pytest.approx(1e3 * 150.0**2 / (2 * RADIUS_MM), rel=0.1)
    assert beyond[0] == end[0]


def test_points_have_a_straightness_of_their_own() -> None:
    """Over the travel that they use: a parameter that a circle elsewhere does not share."""
    place = np.stack(np.meshgrid(*2 * [np.linspace(-150.0, 150.0, 7)]), axis=-1).reshape(-1, 2)
    rng = np.random.default_rng(15)
    read = place + rng.normal(0, 3e-4, place.shape)
    read[:, 1] += place[:, 0] ** 2 / (2 * RADIUS_MM)
    columns = {f"nominal_{a}_mm": place[:, i] for i, a in enumerate("xy")}
    points = tn.Points(**columns, x_mm=read[:, 0], y_mm=read[:, 1])
    bar = bent(round_about(PLANES[:1], 0.0, 360.0), 1, 0, rng)
    d = tn.diagnose([points, bar])
    assert d.named == {"straightness_y_of_x", "ballbar:straightness_y_of_x"}
    assert set(d.model.not_compensable) == {"ballbar:straightness_y_of_x"}


@pytest.mark.parametrize("centre", [(-150.0, 150.0), (0.0, 200.0)])
@pytest.mark.parametrize("seed", [16, 17])
def test_circles_at_two_places_of_a_bent_guide_are_of_one_machine(
    centre: tuple[float, float], seed: int
) -> None:
    """At another place of the guide it is out of square, too: no change, and one curvature."""
    rng = np.random.default_rng(seed)
    turn = np.radians(np.concatenate([np.arange(0.0, 361.0, 3.0), np.arange(360.0, -1.0, -3.0)]))
    circles = []
    for x in centre:
        place = np.stack([x + 100 * np.cos(turn), 100 * np.sin(turn), 0 * turn], axis=1)
        tip = place.copy()
        tip[:, 1] += RADIUS_MM - np.sqrt(RADIUS_MM**2 - place[:, 0] ** 2)
        length = np.linalg.norm(tip - [x + 0.02, -0.01, 0.0], axis=1)
        circles.append(
            tn.Ballbar(
                setup=np.zeros(len(place), int),
                **{f"{a}_mm": place[:, i] for i, a in enumerate("xyz")},
                length_mm=length + rng.normal(0, 3e-4, len(place)),
                feed_mm_min=np.full(len(place), 1000.0),
            )
        )
    d = tn.diagnose(circles)
    middle = np.mean(centre) / RADIUS_MM * 648000 / np.pi  # slope of the guide there, arcsec
    assert d.named == {"straightness_y_of_x"} | ({"squareness_xy"} if middle else set())
    found = {c.id: c for c in d.causes}["straightness_y_of_x"]
    u = d.model.std_errors["straightness_y_of_x.curvature_um_m2"]
    assert found.parameters["curvature_um_m2"] == pytest.approx(1e9 / RADIUS_MM, abs=4 * u)
    if middle:
        (square,) = [c.parameters["arcsec"] for c in d.causes if c.id == "squareness_xy"]
        assert abs(square) == pytest.approx(middle, abs=0.5)
    assert not tn.compare(*circles).changed


def test_lengths_elsewhere_on_a_bent_guide_are_predicted() -> None:
    """The guide is bent about the middle of what was measured, and out of square elsewhere."""
    places = round_about(PLANES[:1], 0.0, 360.0)
    d = tn.diagnose(bent(places, 1, 0, np.random.default_rng(18)))
    middle = (places[:, 0].max() + places[:, 0].min()) / 2
    there = places + np.array([250.0, 0.0, 0.0])
    tip = there.copy()
    tip[:, 1] += RADIUS_MM - np.sqrt(RADIUS_MM**2 - (there[:, 0] - middle) ** 2)
    plan = tn.Ballbar(
        setup=np.zeros(len(there), int),
        **{f"{a}_mm": there[:, i] for i, a in enumerate("xyz")},
        length_mm=np.linalg.norm(tip - [280.0, -80.0, 40.0], axis=1),
        feed_mm_min=np.full(len(there), 1000.0),
    )
    off = 1e3 * (d.model.lengths_mm(plan) - plan.length_mm)
    turn = np.arctan2(there[:, 1] + 80.0, there[:, 0] - 280.0)
    placed = np.stack([np.cos(turn), np.sin(turn), np.ones(len(turn))], axis=1)
    left = off - placed @ np.linalg.lstsq(placed, off, rcond=None)[0]
    assert np.abs(left).max() < 1.0  # µm; the slope alone makes 15
