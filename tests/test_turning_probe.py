"""The probe's path: no move gouges, checked by points along it that know nothing of the core."""

import numpy as np
import pytest

from trunnion import InputError
from trunnion.nc import follow
from trunnion.plot import plot_probe_path
from trunnion.turning import Corner, Profile, TurningProbe, probe_path
from turning_shapes import outline, random_points

SAMPLE_MM = 0.5


def probe_points(probe: TurningProbe) -> np.ndarray:
    """Points of the probe's outline around the ball's centre, z and x."""
    ball, half = probe.ball_diameter_mm / 2, probe.body_diameter_mm / 2
    turn = np.linspace(0, 2 * np.pi, 240)
    points = [ball * np.c_[np.cos(turn), np.sin(turn)]]
    angle = np.radians(probe.contact_angle_deg / 2)
    z, x = ball * np.cos(angle), -ball * np.sin(angle)
    if half > z:
        shoulder = x + (half - z) / np.tan(angle)
        share = np.linspace(0, 1, 30)
        for side in (-1, 1):
            points.append(np.c_[side * (z + share * (half - z)), x + share * (shoulder - x)])
            points.append(np.c_[np.full(80, side * half), shoulder + np.linspace(0, 60, 80)])
    return np.concatenate(points)


@pytest.mark.parametrize("seed", range(14))
def test_no_move_gouges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = random_points(rng)
    probe = TurningProbe(
        ball_diameter_mm=float(rng.uniform(1.0, 10.0)),
        contact_angle_deg=float(rng.uniform(40.0, 130.0)),
        body_diameter_mm=float(rng.uniform(2.0, 14.0)),
    )
    allowance = float(rng.choice([0.0, 0.1, 0.3]))
    path = probe_path(
        Profile.from_points(corners), probe, allowance_mm=allowance, chuck_radius_mm=0.0
    )
    part = outline(corners, 0.02)
    # The part's radius over z, and the stock on it as a distance.
    order = np.argsort(part[:, 0], kind="stable")
    z_part, x_part = part[order].T
    steep = np.gradient(x_part, z_part + 1e-9 * np.arange(len(part)))
    shape = probe_points(probe)
    program = follow(path.program("linuxcnc-lathe", feed=100, head=[[("G", 7)]]))
    assert len(program) >= 2 * len(path.intervals)
    for start, end in zip(program.start[:, [2, 0]], program.end[:, [2, 0]], strict=True):
        count = max(2, int(np.hypot(*(end - start)) / SAMPLE_MM))
        for share in np.linspace(0, 1, count):
            centre = start + share * (end - start)
            # Ball: distance of its centre from the outline.
            near = np.abs(part[:, 0] - centre[0]) < 30
            if near.any():
                gap = np.hypot(*(part[near] - centre).T).min()
                # Rounding of the program, and of the outline between its points.
                assert gap > probe.ball_diameter_mm / 2 + allowance - 2e-3
            # Everything: no point of the probe below the surface.
            at = shape + centre
            inside = (at[:, 0] > z_part[0]) & (at[:, 0] < z_part[-1])
            surface = np.interp(at[inside, 0], z_part, x_part)
            wall = np.interp(at[inside, 0], z_part, steep)
            free = at[inside, 1] - surface
            assert (free[np.abs(wall) < 5] > -0.02).all()


def test_measured_stretches_touch_the_stock() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        profile = Profile.from_points(random_points(rng))
        path = probe_path(profile, TurningProbe(), allowance_mm=0.2, chuck_radius_mm=0.0)
        assert np.abs(path.clearance_mm[path.measures, 0]).max(initial=0) < 1e-6
        assert (path.clearance_mm > -1e-6).all()


def test_contact_on_a_cone() -> None:
    profile = Profile.from_points([(190, 15), (155, 25), (100, 25)])
    path = probe_path(
        profile, TurningProbe(ball_diameter_mm=10.0, body_diameter_mm=12.0), chuck_radius_mm=0.0
    )
    assert path.contact_z_mm(0, 180.0)[0] - 180.0 == pytest.approx(-1.3736, abs=5e-5)
    stations = path.stations_mm(1.0)
    assert stations[0, 1] == path.intervals[0].start_mm[0]
    on_cylinder = stations[:, 0] == 1
    assert np.allclose(stations[on_cylinder, 1], stations[on_cylinder, 2])


def test_what_is_left_out_is_told() -> None:
    profile = Profile.from_points(
        [
            Corner(100, 10),
            Corner(70, 10, "relief", 3.0),
            Corner(70, 20),
            Corner(60, 33),
            Corner(40, 33, "arc-out", 40.0),
            Corner(20, 34, "arc-in"),
            Corner(0, 34),
        ]
    )
    path = probe_path(
        profile, TurningProbe(ball_diameter_mm=4.0, body_diameter_mm=6.0), chuck_radius_mm=0.0
    )
    assert path.left_out[1] == "a wall: not measured"
    assert "slope" in path.left_out[2]
    assert path.left_out[4] == "an arc: not measured"
    # Nothing of the relief is measured.
    assert path.intervals[0].end_mm[0] >= 73.0
    assert "element 4" in path.summary()


def test_bad_probes_and_heights_are_refused() -> None:
    profile = Profile.from_points([(100, 20), (0, 20)])
    with pytest.raises(InputError, match="ball_diameter_mm"):
        probe_path(profile, TurningProbe(ball_diameter_mm=0.0), chuck_radius_mm=0.0)
    with pytest.raises(InputError, match="retract radius"):
        probe_path(profile, retract_x_mm=20.0, chuck_radius_mm=0.0)
    with pytest.raises(InputError, match="allowance"):
        probe_path(profile, allowance_mm=-1.0, chuck_radius_mm=0.0)


def test_the_picture_draws() -> None:
    path = probe_path(
        Profile.from_points(random_points(np.random.default_rng(3))), chuck_radius_mm=0.0
    )
    ax = plot_probe_path(path)
    assert ax.get_xlabel().startswith("Z")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 0.0, -1.0])
def test_a_pitch_that_cannot_be_is_refused(value: float) -> None:
    path = probe_path(Profile.from_points([(100, 20), (0, 20)]), chuck_radius_mm=0.0)
    with pytest.raises(InputError, match="pitch_mm"):
        path.stations_mm(value)


def test_places_that_are_no_finite_numbers_are_refused() -> None:
    path = probe_path(Profile.from_points([(100, 20), (0, 20)]), chuck_radius_mm=0.0)
    with pytest.raises(InputError, match="z_mm"):
        path.contact_z_mm(0, [np.nan])
