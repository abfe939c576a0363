"""What the set-up states of an artefact enters the fit: certificate, temperature, expansion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import trunnion as tn
from test_artefacts import CUBE, twin_travel

PROBE = tn.Probe(repeatability_um=0.3)
HEIGHT = "artefact_height.dh_um"
LENGTH = "artefact_length.dl_um"


def cross(**certificate: float) -> tn.Setup:
    return tn.Setup(artefact=tn.Artefact("cross", **certificate), probe=PROBE)  # type: ignore[arg-type]


def test_a_prior_reduces_the_uncertainty_as_the_formula_says() -> None:
    """C' = C - C e eᵀ C / (u² + eᵀ C e) (Sherman and Morrison), from the fit without one."""
    data = tn.simulate(tn.plan(cross()), cross(), noise_um=0.3, seed=1)
    loose = tn.identify(data, cross(), ("artefact_length",))
    k, before = loose.names.index(LENGTH), loose.covariance
    without = tn.identify(data, cross())
    for u in (1e-3, 0.05, 0.2, 1.0):
        fit = tn.identify(data, cross(calibration_um=u), ("artefact_length",))
        expected = before - np.outer(before[k], before[k]) / (u**2 + before[k, k])
        assert fit.covariance == pytest.approx(expected, rel=1e-5, abs=1e-9)
        moved = before[k] * loose[LENGTH] / (u**2 + before[k, k])
        values = np.array([loose[name] - d for name, d in zip(loose.names, moved, strict=True)])
        assert [fit[name] for name in fit.names] == pytest.approx(values, abs=2e-4)
    tight = tn.identify(data, cross(calibration_um=1e-3), ("artefact_length",))
    for name in without.names:
        assert tight.std_errors[name] == pytest.approx(without.std_errors[name], rel=1e-3)


def test_what_readings_cannot_see_is_known_as_well_as_the_certificate() -> None:
    """The height: not identifiable from touches alone, so its uncertainty is the certificate's."""
    setup = cross(calibration_um=0.4)
    plan = tn.plan(setup)
    seen = tn.observability(plan, setup, ("artefact_height",))
    assert seen.not_identifiable == ()
    assert tn.observability(plan, cross(), ("artefact_height",)).not_identifiable != ()
    data = tn.simulate(plan, setup, noise_um=0.3, seed=2)
    fit = tn.identify(data, setup, ("artefact_height",))
    for name in fit.names:
        assert seen.std_errors[name] == pytest.approx(fit.std_errors[name], rel=1e-3), name
    assert fit.std_errors[HEIGHT] == pytest.approx(0.4, rel=1e-6)
    # A wrong height moves its place: the budget without the effect says the same.
    fixed = tn.identify(data, setup)
    for name in ("EZ0A", "EX0C", "EY0A"):
        assert fit.budget()[name].std == pytest.approx(fixed.budget()[name].std, rel=1e-4)


def test_a_budget_counts_a_certificate_once() -> None:
    setup = cross(calibration_um=0.2)
    data = tn.simulate(tn.plan(setup), setup, noise_um=0.3, seed=3)
    fit = tn.identify(data, setup, ("artefact_length",))
    for name in (LENGTH, "EZ0A", "EC0A"):
        lines = {line.source: line.contribution for line in fit.budget([name])[name].lines}
        length = lines.pop("calibration of the artefact length")
        for other in ("artefact width", "artefact height", "steps of the A axis"):
            lines = {k: v for k, v in lines.items() if other not in k}
        rest = {k: v for k, v in lines.items() if not k.startswith("steps")}
        total = np.hypot(length, np.sqrt(sum(v**2 for v in rest.values())))
        assert total == pytest.approx(fit.std_errors[name], rel=1e-6), name


@pytest.mark.parametrize("tick", [0.0, 0.1])
def test_uncertainties_hold_for_dimensions_that_are_drawn_from_their_certificates(
    tick: float,
) -> None:
    """Squared deviations over their variances, of 120 artefacts: χ² of 120, within 1 in 10⁵."""
    probe = replace(PROBE, tick_um=tick)
    setup = replace(cross(calibration_um=0.3, temperature_std_k=0.5), probe=probe)
    ids = ("artefact_height", "artefact_length", "artefact_expansion")
    plan, rng, runs = tn.plan(setup), np.random.default_rng(0), 120
    squares = dict.fromkeys((HEIGHT, LENGTH, "artefact_expansion.ppm", "EZ0A"), 0.0)
    for seed in range(runs):
        h, length, ppm = (float(s * rng.normal()) for s in (0.3, 0.3, 11.5 * 0.5))
        hidden = {"artefact_height": {"dh_um": h}, "artefact_length": {"dl_um": length}}
        hidden["artefact_expansion"] = {"ppm": ppm}
        data = tn.simulate(plan, setup, effects=hidden, noise_um=0.3, tick_um=tick, seed=seed)
        fit = tn.identify(data, setup, ids)
        truth = {HEIGHT: h, LENGTH: length, "artefact_expansion.ppm": ppm, "EZ0A": 0.0}
        for name, value in truth.items():
            squares[name] += ((fit[name] - value) / fit.std_errors[name]) ** 2
    low, high = chi2.ppf(1e-5, runs), chi2.ppf(1 - 1e-5, runs)
    assert all(low < total < high for total in squares.values()), squares


def test_an_artefact_grows_with_its_temperature() -> None:
    """Against the twin's contact with a cube that is larger by 115 ppm."""
    hot = replace(CUBE, expansion_ppm_k=11.5, temperature_c=30.0)
    grown = (1 + 115e-6) * np.array([CUBE.length_mm, CUBE.width_mm, CUBE.height_mm])
    larger = replace(CUBE, **dict(zip(("length_mm", "width_mm", "height_mm"), grown, strict=True)))
    plan = tn.plan(tn.Setup(artefact=CUBE))
    made = tn.simulate(plan, tn.Setup(artefact=hot))
    assert plan.start_mm is not None
    travel = np.einsum("ij,ij->i", made.position_mm - plan.start_mm, plan.direction)
    expected = twin_travel(plan, tn.Setup(artefact=larger), {}, errors={}, placement={})
    assert np.abs(travel - expected).max() < 1e-9
    assert np.abs(tn.identify(made, tn.Setup(artefact=hot)).residuals_um).max() < 1e-6
    assert np.abs(tn.identify(made, tn.Setup(artefact=CUBE)).residuals_um).max() > 0.5


def test_the_casadi_baseline_knows_the_temperature() -> None:
    hot = tn.Setup(artefact=tn.Artefact("cross", temperature_c=35.0))
    data = tn.simulate(tn.plan(hot), hot, {"EX0C": 12.0})
    assert tn.casadi_baseline.identify(data, hot)["EX0C"] == pytest.approx(12.0, abs=1e-3)


def test_what_contradicts_a_certificate_or_cannot_use_it_is_said() -> None:
    setup = cross(calibration_um=0.2)
    plan = tn.plan(setup)
    wrong = {"artefact_length": {"dl_um": 6.0}}
    fit = tn.identify(tn.simulate(plan, setup, effects=wrong, seed=1), setup, ("artefact_length",))
    assert "The readings contradict the calibration of the artefact length" in fit.summary()
    right = tn.simulate(plan, setup, noise_um=0.3, seed=1)
    assert tn.identify(right, setup, ("artefact_length",)).notes == ()
    unknown = replace(setup, probe=tn.Probe())
    said = tn.identify(right, unknown, ("artefact_length",)).notes
    assert said == (
        f"{LENGTH} is fitted without the calibration of the artefact length, 0.2: that needs "
        "[probe] repeatability_um.",
    )


def named(d: tn.Diagnosis) -> list[str]:
    return [cause.id for cause in d.causes]


def test_a_diagnosis_estimates_a_cause_with_its_certificate() -> None:
    """C' = C - C e eᵀ C / (u² + eᵀ C e), from the diagnosis without one; as `identify` has it."""
    made = {"artefact_length": {"dl_um": 3.0}}
    data = tn.simulate(tn.plan(cross()), cross(), effects=made, noise_um=0.3, seed=1)
    loose = tn.diagnose(data, cross()).model
    k, before = loose.names.index(LENGTH), loose.covariance
    for u in (2.0, 4.0):
        setup = cross(calibration_um=u)
        d = tn.diagnose(data, setup)
        assert named(d) == ["artefact_length"]
        expected = before - np.outer(before[k], before[k]) / (u**2 + before[k, k])
        assert d.model.covariance == pytest.approx(expected, rel=1e-6, abs=1e-12)
        fit = tn.identify(data, setup, ("artefact_length",))
        found = d.causes[0].parameters["dl_um"]
        assert found == pytest.approx(fit[LENGTH], abs=0.02 * fit.std_errors[LENGTH])
        for name, value in fit.errors.items():
            assert d.model.errors[name] == pytest.approx(value, abs=0.02 * fit.std_errors[name])


def test_a_certificate_decides_between_causes_that_readings_do_not_distinguish() -> None:
    """A sphere that is larger by 6 µm is a ball larger by 3: what is calibrated is not named."""
    sphere = tn.Artefact(
        "sphere", diameter_mm=25.0, centre_mm=(60.0, 10.0, 60.0), calibration_um=0.1
    )
    known = replace(sphere, temperature_std_k=0.01, calibration_um=0.0)
    ball = tn.Probe(2.0, repeatability_um=0.3)
    calibrated = replace(ball, calibration_um=0.1)
    plan = tn.plan(tn.Setup(known, probe=ball), a_deg=(60, -60), c_deg=range(0, 360, 60))
    effects = {"artefact_diameter": {"dd_um": 6.0}}
    data = tn.simulate(plan, tn.Setup(known, probe=ball), effects=effects, noise_um=0.3, seed=3)
    sets = {
        name: {cause for one in tn.diagnose(data, setup).alternatives for cause in one}
        for name, setup in {
            "nothing": tn.Setup(known, probe=ball),
            "the ball": tn.Setup(known, probe=calibrated),
            "the sphere": tn.Setup(replace(sphere, temperature_std_k=0.01), probe=ball),
        }.items()
    }
    assert {"probe_radius", "artefact_diameter"} <= sets["nothing"]
    assert "artefact_diameter" in sets["the ball"]
    assert "probe_radius" not in sets["the ball"]
    assert "probe_radius" in sets["the sphere"]
    assert "artefact_diameter" not in sets["the sphere"]
    assert all("artefact_expansion" not in causes for causes in sets.values())


def test_a_deviation_within_the_certificate_costs_a_cause_little_and_a_large_one_much() -> None:
    """-2 ln L grows by v² / (u² + C): its odds fall by exp of half of that."""
    made = {"artefact_length": {"dl_um": 1.0}}
    data = tn.simulate(tn.plan(cross()), cross(), effects=made, noise_um=0.3, seed=1)

    def odds(u: float) -> float:
        d = tn.diagnose(data, cross(calibration_um=u))
        by_set = {one.causes: one.probability for one in d.evidence}
        pair = (frozenset({"artefact_length"}), frozenset({"artefact_expansion"}))
        return by_set.get(pair[0], 0.0) / by_set[pair[1]]

    loose = tn.diagnose(data, cross()).model
    variance = loose.std_errors[LENGTH] ** 2
    for u, v in ((0.5, 2.0), (0.7, 4.0)):
        cost = [loose.effects["artefact_length"]["dl_um"] ** 2 / (s**2 + variance) for s in (u, v)]
        expected = np.exp(-0.5 * (cost[0] - cost[1]))
        assert odds(u) / odds(v) == pytest.approx(expected, rel=0.15)


def test_a_diagnosis_says_what_contradicts_the_certificate() -> None:
    tight = cross(calibration_um=1.0, temperature_std_k=0.01)
    wrong = {"artefact_length": {"dl_um": 8.0}}
    data = tn.simulate(tn.plan(tight), tight, effects=wrong, noise_um=0.1, seed=1)
    d = tn.diagnose(data, tight)
    assert "artefact_length" in named(d)
    assert "The readings contradict the calibration of the artefact length" in d.summary()
