"""Circular tests by ISO 230-4, against values known from how the paths were made."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from scipy.optimize import minimize

import trunnion as tn

Floats = npt.NDArray[np.float64]
Law = Callable[[Floats, npt.NDArray[np.intp]], Floats]
R = 150.0


def made(
    law: Law,
    centre_um: tuple[float, float] = (0.0, 0.0),
    plane: tuple[int, int] = (0, 1),
    n: int = 180,
) -> tn.Ballbar:
    """Lengths whose radial deviation at an angle and sense is a law's, µm."""
    angle = np.tile(np.arange(n) * 2 * np.pi / n, 2)
    sense = np.repeat([1, -1], n)
    points = np.zeros((2 * n, 3))
    points[:, plane[0]], points[:, plane[1]] = R * np.cos(angle), R * np.sin(angle)
    actual = points.copy()
    radial = 1 + law(angle, sense) * 1e-3 / R
    actual[:, plane[0]], actual[:, plane[1]] = (
        points[:, plane[0]] * radial + 1e-3 * centre_um[0],
        points[:, plane[1]] * radial + 1e-3 * centre_um[1],
    )
    return tn.Ballbar(
        {
            "setup": np.full(2 * n, "a"),
            "x_mm": points[:, 0], "y_mm": points[:, 1], "z_mm": points[:, 2],
            "length_mm": np.linalg.norm(actual, axis=1), "sense": sense,
        }
    )  # fmt: skip


def test_a_circle_without_deviations_has_none() -> None:
    """Its centre takes no part."""
    data = made(lambda angle, _: 0.0 * angle, centre_um=(40.0, -25.0))
    (found,) = tn.iso230_4(data)
    assert found.plane == "XY"
    assert found.radius_mm == R
    for value in (found.circular_um, found.hysteresis_um, found.radial_max_um):
        assert value == pytest.approx(0.0, abs=0.02)  # second order of the centre: 47² / 2R


def test_squareness_is_an_ellipse() -> None:
    """Deviation a sin 2θ: F = ±a, G = 2a, both senses alike."""
    (found,) = tn.iso230_4(made(lambda angle, _: 6.0 * np.sin(2 * angle), (10.0, 5.0)))
    assert found.radial_max_um == pytest.approx(6.0, abs=0.01)
    assert found.radial_min_um == pytest.approx(-6.0, abs=0.01)
    for value in (found.circular_um, found.circular_cw_um, found.circular_ccw_um):
        assert value == pytest.approx(12.0, abs=0.02)
    assert found.hysteresis_um == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("plane", [(0, 1), (1, 2), (2, 0)])
def test_hysteresis_is_the_difference_of_the_senses(plane: tuple[int, int]) -> None:
    (found,) = tn.iso230_4(
        made(lambda angle, sense: 4.0 + 2.5 * sense + 3.0 * np.cos(3 * angle), plane=plane)
    )
    assert found.plane == {(0, 1): "XY", (1, 2): "YZ", (2, 0): "ZX"}[plane]
    assert found.hysteresis_um == pytest.approx(5.0, abs=0.01)
    assert found.radial_max_um == pytest.approx(4 + 2.5 + 3, abs=0.01)
    assert found.radial_min_um == pytest.approx(4 - 2.5 - 3, abs=0.01)
    assert found.circular_um == pytest.approx(11.0, abs=0.05)
    assert found.circular_cw_um == pytest.approx(6.0, abs=0.05)


def test_minimum_zone_is_not_larger_than_about_the_least_squares_centre() -> None:
    random = np.random.default_rng(3)
    noise = random.normal(0, 1.0, 360)
    (found,) = tn.iso230_4(made(lambda _, __: noise))
    assert found.circular_um <= float(np.ptp(found.deviation_um)) + 1e-9
    assert found.circular_um > 0.8 * float(np.ptp(found.deviation_um))


def test_what_is_no_circle_is_refused() -> None:
    data = made(lambda angle, _: 0.0 * angle)
    columns = {k: np.array(v) for k, v in data.columns.items()}
    columns["x_mm"] = columns["x_mm"] * 1.2
    with pytest.raises(tn.DataError, match="no set-up whose commanded points lie on a circle"):
        tn.iso230_4(tn.Ballbar(columns))


def test_the_picture_shows_both_paths() -> None:
    circles = tn.iso230_4(tn.read_ballbar(tn.sample_path("ballbar/circle.csv")))
    ax = circles[0].plot()
    legend = ax.get_legend()
    assert legend is not None
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["counter-clockwise", "clockwise"]
    assert "G(b) = " in ax.get_title(loc="left")


def _figures(angle: Floats, lengths: Floats) -> tuple[float, ...]:
    """G(b), H, F of a circle read both ways at the same angles, (2, n) µm, by brute force."""

    def less(centre: Floats) -> Floats:
        return np.asarray(lengths - centre[0] * np.cos(angle) - centre[1] * np.sin(angle))

    def width(centre: Floats) -> float:
        return float(np.ptp(less(centre)))

    first: Floats = 2 * np.mean(
        lengths * np.array([np.cos(angle), np.sin(angle)])[:, None], axis=(1, 2)
    )
    zone = float(minimize(width, first, method="Nelder-Mead").fun)
    fitted = less(first)
    return zone, float(np.abs(lengths[0] - lengths[1]).max()), fitted.max(), fitted.min()


def test_the_uncertainty_is_the_scatter_from_test_to_test() -> None:
    """Backlash of Y, squareness, noise: 150 tests of one machine, their figures by other means."""
    random, noise = np.random.default_rng(11), 0.4
    once, stated = [], []
    for number in range(150):
        drawn = random.normal(0, noise, (2, 180))

        def law(angle: Floats, sense: npt.NDArray[np.intp], drawn: Floats = drawn) -> Floats:
            away = np.sign(np.round(np.cos(angle), 9)) * sense  # of Y
            return 2.5 * np.sin(2 * angle) - away * np.sin(angle) + drawn.ravel()

        data = made(law)
        once.append(
            _figures(np.arange(180) * np.pi / 90, 1e3 * (data.length_mm.reshape(2, -1) - R))
        )
        if number % 10 == 0:
            (found,) = tn.iso230_4(data)
            names = ("circular_um", "hysteresis_um", "radial_max_um", "radial_min_um")
            stated.append([found.std_errors[name] for name in names])
    # The scatter of 150 tests is known to 6 %, what a test says of it comes from its own noise.
    assert np.mean(stated, axis=0) == pytest.approx(np.std(once, axis=0), rel=0.25)
    off = np.array(stated) / np.std(once, axis=0) - 1
    assert np.sqrt(np.mean(off**2)) < 0.3
