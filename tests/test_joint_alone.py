"""What is asked of each of several measurements, before they are diagnosed together."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import HIDDEN, axis
from power.one_machine import drawn
from power.random_cases import draw
from trunnion.diagnosis.engine import leave
from trunnion.diagnosis.left import left_one_by_one
from trunnion.diagnosis.plain import case_of, plain_fit
from trunnion.diagnosis.whitening import Whiteners
from trunnion.models.joint import JointModel
from trunnion.models.kinds import model_of

SAME_PROBABILITY = 0.03  # the noise of one of two is known a little otherwise
SAME_NOISE = 0.1  # of its size: sets of causes that explain about as well leave about as much
NOISE_UM = 0.3


@pytest.mark.parametrize("kind", ["touches", "points", "sweep", "ballbar", "positioning"])
def test_a_measurement_leaves_as_much_as_its_diagnosis_says(kind: str) -> None:
    for number in range(4):
        one = draw(kind, number, 83)
        d = tn.diagnose(one.data, one.setup)
        left = leave(model_of(one.data, one.setup))
        assert left.outliers == d.outliers
        assert d.residuals is not None
        assert np.allclose(left.before, d.residuals.before, rtol=0.0, atol=1e-9)
        of_d = float(np.std(d.residuals.after))
        assert np.std(left.after) == pytest.approx(of_d, rel=SAME_NOISE)
        if d.unexplained is None:
            assert left.unexplained is None


@pytest.mark.parametrize("number", [3, 6, 8, 9, 10])
def test_beside_a_sound_axis_causes_are_as_probable_as_alone(number: int) -> None:
    """A test that says nothing of the cause of another makes it no more and no less probable."""
    one = draw("diameters", number, 91)
    sound = stops(number, ()).with_columns(axis=np.full(len(stops(number, ())), "Z"))
    alone, joint = tn.diagnose(one.data, one.setup), tn.diagnose([one.data, sound], one.setup)
    together = {a.causes: a.probability for a in joint.evidence}
    nothing = tn.diagnose(sound).none_probability
    for a in alone.evidence:
        if a.probability > SAME_PROBABILITY:
            expected = a.probability * nothing
            assert together.get(a.causes, 0.0) == pytest.approx(expected, abs=SAME_PROBABILITY)


def stops(seed: int, causes: Iterable[str]) -> tn.Positioning:
    """Stops of an axis with some causes, of the noise `NOISE_UM`."""
    rng = np.random.default_rng([86, seed])
    made = axis(rng, noise=NOISE_UM)
    change = sum((HIDDEN[name](made, rng) for name in causes), np.zeros(len(made)))
    return made.with_columns(measured_mm=made.measured + 1e-3 * change)


@pytest.mark.parametrize("causes", [(), ("scale",), ("scale", "reversal", "warmup")])
def test_the_noise_of_a_measurement_is_that_it_was_made_with(causes: tuple[str, ...]) -> None:
    found = []
    for seed in range(8):
        model = model_of(stops(seed, causes))
        left = left_one_by_one(case_of(model))
        assert left is not None
        dof = len(left.after) - left.parameters - len(model.nuisance)
        found.append(float(left.after @ left.after) / dof)
    count = 8 * 100  # degrees of freedom, about
    assert np.mean(found) == pytest.approx(NOISE_UM**2, rel=4 * np.sqrt(2 / count))


def bad(data: tn.Positioning) -> tn.Positioning:
    measured = data.measured.copy()
    measured[17] += 0.05
    return data.with_columns(measured_mm=measured)


def knocked(data: tn.Positioning) -> tn.Positioning:
    at = np.linspace(-1.0, 1.0, len(data))
    return data.with_columns(measured_mm=data.measured + 8e-3 * np.exp(-((at / 0.2) ** 2)))


def in_steps(data: tn.Positioning) -> tn.Positioning:
    return data.with_columns(measured_mm=np.round(data.measured, 3))


def without_noise(data: tn.Positioning) -> tn.Positioning:
    once = data[np.arange(22)]  # a cycle: others would say the same
    return once.with_columns(measured_mm=once.target * (1 + 2e-5))


def test_structure_is_taken_from_what_causes_leave() -> None:
    """A bump along the axis and no cause: the noise is that beside it, as in its own diagnosis."""
    for seed in range(6):
        model = model_of(knocked(stops(seed, ("scale",))))
        d, left = tn.diagnose(model), leave(model)
        assert left.unexplained is not None
        assert d.unexplained is not None
        dof = len(left.after) - left.parameters - len(model.nuisance)
        assert left.after @ left.after / dof == pytest.approx(NOISE_UM**2, rel=0.5)


@pytest.mark.parametrize("spoilt", [bad, in_steps, without_noise])
def test_more_than_noise_is_left_to_the_own_diagnosis(
    spoilt: Callable[[tn.Positioning], tn.Positioning],
) -> None:
    data = spoilt(stops(0, ("scale",)))
    assert left_one_by_one(case_of(model_of(data))) is None
    d, left = tn.diagnose(data), leave(model_of(data))
    assert d.residuals is not None
    assert (left.outliers, left.unexplained) == (d.outliers, d.unexplained)
    assert np.allclose(left.after, d.residuals.after, rtol=0.0, atol=1e-9)


def test_several_are_fitted_once_by_the_noise_of_each() -> None:
    """Residuals that weigh by their noise are orthogonal to what is fitted; others are not."""
    made = drawn(("touches", "touches"), 0, 84)
    (first, loud), setup = made.data, made.setup
    rng = np.random.default_rng(84)
    columns = {f"{a}_mm": loud[f"{a}_mm"] + 1e-2 * rng.normal(size=len(loud)) for a in "xyz"}
    model = model_of([first, loud.with_columns(**columns)], setup)
    assert isinstance(model, JointModel)
    assert isinstance(model.known_noise, Whiteners)
    case = case_of(model)
    assert case.whiten is model.known_noise
    shares = []
    for f in (case.plain, plain_fit(model)):
        white = model.known_noise(f.jacobian)
        basis = np.linalg.qr(white[:, np.any(white != 0, axis=0)])[0]
        left = model.known_noise(f.residuals)
        shares.append(np.linalg.norm(basis.T @ left) / np.linalg.norm(left))
    by_noise, alike = shares
    assert by_noise < 1e-5
    assert alike > 1e-2
