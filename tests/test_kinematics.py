"""Kinematics for arrays of poses."""

import numpy as np
import pytest

import trunnion as tn

ERRORS = {
    "trt-ca": {"EA0A": 20.0, "EB0A": -15.0, "EX0C": 30.0, "EB0C": 25.0, "EY0A": 17.0},
    "trt-bc": {"EA0B": 20.0, "EC0B": -15.0, "EX0C": 30.0, "EA0C": 25.0},
    "table-c-head-b": {"EA0B": 20.0, "EX0B": -15.0, "EX0C": 30.0, "EA0C": 25.0},
}


def setup_of(preset: str) -> tn.Setup:
    return tn.Setup(artefact=tn.Artefact("cross"), machine=tn.Machine(preset))


def random_axes(rng: np.random.Generator, n: int) -> np.ndarray:
    axes = rng.uniform(-100, 100, (n, 5))
    axes[:, 3] = rng.uniform(5, 85, n)
    axes[:, 4] = rng.uniform(-179, 179, n)
    return axes


@pytest.mark.parametrize("preset", list(ERRORS))
@pytest.mark.parametrize("with_errors", [False, True])
def test_inverse_undoes_forward(preset: str, with_errors: bool) -> None:
    setup = setup_of(preset)
    errors = ERRORS[preset] if with_errors else {}
    axes = random_axes(np.random.default_rng(1), 200)
    point, direction = tn.forward_kinematics(setup, axes, errors)
    for branch in ("positive", "negative"):
        solved = tn.inverse_kinematics(setup, point, direction, branch=branch, errors=errors)
        again = tn.forward_kinematics(setup, solved.axes, errors)
        assert np.abs(again[0] - point).max() < 1e-9
        assert np.abs(again[1] - direction).max() < 1e-11
        assert not solved.singular.any()
    near = tn.inverse_kinematics(
        setup, point[:1], direction[:1], branch="nearest", reference_deg=axes[0, 3:], errors=errors
    )
    assert near.axes[0] == pytest.approx(axes[0], abs=1e-8)


def test_jacobian_is_the_derivative_of_forward() -> None:
    setup = setup_of("trt-ca")
    axes = random_axes(np.random.default_rng(2), 20)
    exact = tn.kinematic_jacobian(setup, axes, ERRORS["trt-ca"])
    assert exact.shape == (20, 6, 5)
    for k in range(5):
        step = np.zeros(5)
        step[k] = 1e-4
        ahead = np.hstack(tn.forward_kinematics(setup, axes + step, ERRORS["trt-ca"]))
        back = np.hstack(tn.forward_kinematics(setup, axes - step, ERRORS["trt-ca"]))
        assert np.abs((ahead - back) / 2e-4 - exact[:, :, k]).max() < 1e-6


def test_a_vertical_tool_is_told_as_singular() -> None:
    setup = setup_of("trt-ca")
    solved = tn.inverse_kinematics(
        setup, [[1.0, 2.0, 3.0]], [[0.0, 0.0, 1.0]], reference_deg=(0.0, 37.0)
    )
    assert solved.singular.tolist() == [True]
    assert solved.axes[0, 4] == 37.0


@pytest.mark.parametrize(
    ("point", "direction", "message"),
    [
        ([[0, 0, 0]], [[0, 0, 2]], "length of the tool direction: got 2"),
        ([[0, 0]], [[0, 0, 1]], r"point_mm: got shape \(1, 2\)"),
        ([[0, 0, np.inf]], [[0, 0, 1]], "point_mm, row 0"),
        ([[0, 0, 0]], [[0, 0, 1], [0, 0, 1]], "direction: got 2 rows"),
    ],
)
def test_bad_poses_are_refused(point: object, direction: object, message: str) -> None:
    with pytest.raises(tn.TrunnionError, match=message):
        tn.inverse_kinematics(setup_of("trt-ca"), point, direction)  # type: ignore[arg-type]
