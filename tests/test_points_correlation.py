"""Plates whose errors are alike at neighbouring places: standard errors and names stay honest.

The fields are sums of cosines of random direction and wavelength (Rahimi and Recht 2007), beside a
scale and a squareness written out here: no formula of the package makes them.
"""

import numpy as np
import pytest

import trunnion as tn
from trunnion.diagnosis.whitening import Correlated
from trunnion.models.points.correlation import correlated

SCALE_PPM, SQUARENESS_ARCSEC, NOISE_UM = 60.0, 8.0, 2.0
WAVES = 300
SAID = "neighbouring features is alike"


def random_field(rng: np.random.Generator, places: np.ndarray, range_mm: float) -> np.ndarray:
    """A smooth field of rms 1, correlated as exp(-(distance / range)² / 2)."""
    along = places @ (rng.normal(size=(2, WAVES)) / range_mm)
    waves = np.cos(along + rng.uniform(0, 2 * np.pi, WAVES))
    return np.asarray(np.sqrt(2 / WAVES) * waves @ rng.normal(size=WAVES))


def plate(seed: int, range_mm: float, share: float, count: int = 160) -> tn.Points:
    """A plate with scale, squareness, noise and a field of ``share`` noises in each coordinate."""
    rng = np.random.default_rng([seed, 2024])
    q = np.round(rng.uniform(-1, 1, (count, 2)) * [220, 160], 3)
    error = NOISE_UM * rng.normal(size=q.shape)
    error[:, 0] += 1e-3 * SCALE_PPM * q[:, 0]
    error[:, 0] -= SQUARENESS_ARCSEC * np.pi / 648 * q[:, 1]
    for i in range(2):
        error[:, i] += share * NOISE_UM * random_field(rng, q, range_mm)
    turn = np.exp(1j * rng.uniform(-0.01, 0.01))
    m = (q + 1e-3 * error) @ np.array([1, 1j]) * turn + (3 - 5j)
    return tn.Points(nominal_x_mm=q[:, 0], nominal_y_mm=q[:, 1], x_mm=m.real, y_mm=m.imag)


def said(d: tn.Diagnosis) -> bool:
    return any(SAID in note for note in d.notes)


def test_estimates_are_as_uncertain_as_the_field_makes_them() -> None:
    deviations, others, named = [], 0, 0
    cases = [(seed, r) for seed in range(5) for r in (20.0, 60.0)]
    for seed, range_mm in cases:
        d = tn.diagnose(plate(seed, range_mm, 1.0))
        assert said(d)
        true = {"scale_x": ("ppm", SCALE_PPM), "squareness_xy": ("arcsec", SQUARENESS_ARCSEC)}
        for c in d.causes:
            if c.id in true:
                name, value = true[c.id]
                deviations.append((c.parameters[name] - value) / c.std_errors[name])
        named += "scale_x" in {c.id for c in d.causes}
        others += bool({c.id for c in d.causes} - {"scale_x", "squareness_xy", "field"})
    assert named == len(cases)  # the noise eats no cause that is there
    assert np.mean(np.abs(deviations) < 2) > 0.85  # of independent features: 0.5 to 0.8
    assert np.sqrt(np.mean(np.square(deviations))) < 1.3  # 1.7 to 4
    assert others <= 2  # a bow, an angle: 6 to 12 of 12


def test_independent_features_are_explained_as_ever() -> None:
    assert not any(said(tn.diagnose(plate(seed, 50.0, 0.0))) for seed in range(4))


def test_a_reading_set_aside_acts_on_no_other() -> None:
    points = plate(3, 40.0, 1.5)
    x = np.array(points.x_mm)
    x[41] += 0.5  # a chip below the probe
    d, clean = tn.diagnose(points.with_columns(x_mm=x)), tn.diagnose(points)
    assert said(d)
    assert d.outliers == (41,)
    assert d.verdict == clean.verdict
    assert {c.id for c in d.causes} == {c.id for c in clean.causes}
    scale, other = (next(c for c in a.causes if c.id == "scale_x") for a in (d, clean))
    sigma = other.std_errors["ppm"]
    assert scale.parameters["ppm"] == pytest.approx(other.parameters["ppm"], abs=0.1 * sigma)
    assert scale.std_errors["ppm"] == pytest.approx(sigma, rel=0.1)
    assert abs(scale.parameters["ppm"] - SCALE_PPM) < 2 * sigma


def test_a_bump_is_a_field_and_no_scale_or_bow() -> None:
    rng = np.random.default_rng(1)
    q = np.round(rng.uniform(-200, 200, (120, 2)), 3)
    bump = 5.0 * np.exp(-((q[:, 0] - 80) ** 2 + (q[:, 1] + 40) ** 2) / (2 * 60.0**2))
    m = q + 1e-3 * (np.column_stack([bump, 0 * bump]) + 0.2 * rng.normal(size=q.shape))
    d = tn.diagnose(
        tn.Points(nominal_x_mm=q[:, 0], nominal_y_mm=q[:, 1], x_mm=m[:, 0], y_mm=m[:, 1])
    )
    assert {c.id for c in d.causes} == {"field"}
    assert d.gain.rms_after_um < 0.25
    assert d.gain.heldout_rms_after_um < 0.6 * d.gain.heldout_rms_before_um


def test_the_whitener_makes_smooth_combinations_as_loud_as_they_are() -> None:
    ratios = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        q = rng.uniform(-100, 100, (150, 2))
        columns = np.zeros((150, 2, 6))
        for i in range(2):
            columns[:, i, 3 * i : 3 * i + 3] = np.column_stack([np.ones(150), q])
        left = np.stack([random_field(rng, q, 20.0) for _ in range(2)], axis=1)
        left += 0.5 * rng.normal(size=left.shape)
        white = correlated(q, left, columns.reshape(300, 6), 1.25, np.arange(150))
        assert isinstance(white, Correlated)
        slope = np.column_stack([q[:, 0], np.zeros(150)]) / np.linalg.norm(q[:, 0])
        apart = np.linalg.norm(q[:, None] - q, axis=2)
        noise = np.exp(-((apart / 20.0) ** 2) / 2) + 0.25 * np.eye(150)
        true = slope[:, 0] @ noise @ slope[:, 0] / 1.25
        ratios.append(1.0 / np.linalg.norm(white(slope.reshape(-1))) ** 2 / true)
        one = np.eye(300)[:, 4]
        assert white.without(np.array([4, 5]))(one) == pytest.approx(one)
    assert 0.7 < np.median(ratios) < 2.0


def test_noise_that_is_taken_for_correlated_is_no_verdict() -> None:
    # A weak field without causes: weights alone make no plain model worse than itself.
    for seed in range(4):
        rng = np.random.default_rng([seed, 7])
        q = np.round(rng.uniform(-1, 1, (160, 2)) * [220, 160], 3)
        error = 2.0 * rng.normal(size=q.shape)
        for i in range(2):
            error[:, i] += random_field(rng, q, 30.0)
        m = q + 1e-3 * error
        d = tn.diagnose(
            tn.Points(nominal_x_mm=q[:, 0], nominal_y_mm=q[:, 1], x_mm=m[:, 0], y_mm=m[:, 1])
        )
        assert said(d)
        assert d.unexplained is None or "plain model" not in str(d.unexplained)
