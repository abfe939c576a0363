"""A measurement that is too small for its verdict says so, in every form of the result."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import trunnion as tn

SETUPS = {kind: tn.Setup(tn.Artefact(kind)) for kind in ("cross", "cuboid")}
PARTIAL = (15, 18, 20)


@cache
def diagnosed(kind: str, count: int, noise_um: float) -> tuple[tn.Diagnosis, tn.Touches]:
    """The first touches of a plan; 0: all. A machine with errors of a usual size."""
    setup = SETUPS[kind]
    plan = tn.plan(setup)
    errors = {"EX0C": 15.0, "EY0A": -20.0, "EB0A": 10.0}
    touches = tn.simulate(plan, setup, errors, noise_um=noise_um, seed=len(plan) + count)
    touches = touches[: count or len(plan)]
    return tn.diagnose(touches, setup), touches


@pytest.mark.parametrize("kind", SETUPS)
@pytest.mark.parametrize("noise_um", [0.3, 1.0])
@pytest.mark.parametrize("count", PARTIAL)
def test_a_partial_log_is_too_little(kind: str, noise_um: float, count: int) -> None:
    d, _ = diagnosed(kind, count, noise_um)
    assert d.too_little is not None
    assert d.sentences()[0] == d.too_little
    assert "would stay unnoticed even at 50 µm" in d.too_little


@pytest.mark.parametrize("kind", SETUPS)
@pytest.mark.parametrize("noise_um", [0.3, 1.0])
def test_a_whole_plan_is_not(kind: str, noise_um: float) -> None:
    d, _ = diagnosed(kind, 0, noise_um)
    assert d.too_little is None
    assert "Too little" not in d.summary()


def test_it_is_said_in_every_form(tmp_path: Path) -> None:
    d, _ = diagnosed("cross", 15, 0.3)
    assert d.too_little is not None
    assert d.too_little in d.summary()
    assert d.to_dict()["too_little"] == d.too_little
    assert json.loads(d.to_json())["too_little"] == d.too_little
    assert "too little measured" in d.headline()
    d.to_html(tmp_path / "d.html")
    assert "Too little is measured to say which causes act" in (tmp_path / "d.html").read_text()
    assert type(d).from_dict(d.to_dict()).too_little == d.too_little


@pytest.mark.parametrize(
    "effect", [{"a_sag": {"kz_um": 50.0}}, {"squareness_yz": {"arcsec": 50.0}}]
)
def test_what_it_says_would_stay_unnoticed_does(effect: dict[str, dict[str, float]]) -> None:
    """Simulated at the stated size such a cause is not found in 15 touches, in the plan it is."""
    setup = SETUPS["cross"]
    plan = tn.plan(setup)
    touches = tn.simulate(plan, setup, {"EX0C": 15.0}, effects=effect, noise_um=0.3, seed=4)
    (name,) = effect
    few, many = tn.diagnose(touches[:15], setup), tn.diagnose(touches, setup)
    assert few.too_little is not None
    assert name not in few.named
    assert name in many.named or any(name in one for one in many.alternatives)
    assert np.isinf([few.errors_std[k] for k in few.errors_std]).all()


def plate(holes: int, seed: int, ppm: float) -> tn.Diagnosis:
    """Holes of a plate of 300 mm measured with a noise of 3 µm, X long by so much."""
    rng = np.random.default_rng([holes, seed])
    x, y = rng.uniform(0.0, 300.0, (2, holes))
    off_x, off_y = 3e-3 * rng.standard_normal((2, holes))
    return tn.diagnose(
        tn.Points(nominal_x_mm=x, nominal_y_mm=y, x_mm=x * (1 + 1e-6 * ppm) + off_x, y_mm=y + off_y)
    )


def test_three_holes_are_too_little() -> None:
    """Three degrees of freedom of the residual hardly say the noise: ten standard errors are few.

    They were "consistent, probability > 99 %". An X axis that is long by 100 ppm is not found.
    """
    few = [plate(3, seed, 100.0) for seed in range(20)]
    assert all(d.too_little is not None for d in few)
    assert not any(d.named for d in few)
    many = [plate(12, seed, 100.0) for seed in range(20)]
    assert all(d.too_little is None for d in many)
    assert sum("scale_x" in d.named for d in many) >= 15


def test_no_rows_of_a_ball_bar_are_a_clear_error() -> None:
    none = tn.read_ballbar(tn.sample_path("ballbar/circle.csv"))[:0]
    with pytest.raises(tn.DataError, match="ballbar: got no rows, expected readings to diagnose"):
        tn.diagnose(none)
