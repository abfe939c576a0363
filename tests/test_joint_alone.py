"""What is asked of each of several measurements, before they are diagnosed together."""

from __future__ import annotations

import numpy as np
import pytest

import trunnion as tn
from power.one_machine import drawn
from power.random_cases import draw
from trunnion.diagnosis.engine import leave
from trunnion.diagnosis.plain import case_of, plain_fit
from trunnion.diagnosis.whitening import Whiteners
from trunnion.models.joint import JointModel
from trunnion.models.kinds import model_of

SAME_NOISE = 0.1  # of its size: where structure stands for causes, these leave about as much


@pytest.mark.parametrize("kind", ["touches", "points", "sweep", "ballbar", "positioning"])
def test_a_measurement_leaves_what_its_diagnosis_says(kind: str) -> None:
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
            assert np.allclose(left.after, d.residuals.after, rtol=0.0, atol=1e-6 * of_d)


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
