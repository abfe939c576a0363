"""Uncertainty budgets: the GUM's own example, an independent generator, and outside derivatives."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import trunnion as tn
from positioning_twin import axis
from power.study import ground
from promise import kept, needed_runs
from result_examples import diagnosis_of, with_outliers
from test_joint_agreement import circle
from trunnion.machine.budget import EMPTY, MODEL, READINGS, RESOLUTION, Source, measurand
from trunnion.probing.inputs import turning
from trunnion.probing.model import TouchModel
from trunnion.setup import AxisSetup
from twin.forward import Setup as TwinSetup
from twin.forward import Truth
from twin.generator import Plan, measure, random_errors, random_placement

COVERED = 0.95
OF_READINGS = (READINGS, RESOLUTION)
STATED: dict[str, Any] = {
    "calibration_um": 0.3,
    "calibration_arcsec": 1.0,
    "temperature_std_k": 1.0,
}
BOX: dict[str, Any] = {"a_deg": (-90.0, 0.0, 90.0), "c_deg": (0.0, 90.0)}


def test_the_gum_s_end_gauge_has_its_published_uncertainty() -> None:
    """JCGM 100:2008, H.1.7: 32 nm with 16 effective degrees of freedom."""
    nm = {
        "standard": (25, 18),
        "difference": (9.7, 25.6),
        "expansion": (2.9, 50),
        "temperature": (16.6, 2),
    }
    sources = [Source(k, 1e-3 * u, "µm", np.ones((1, 1)), dof) for k, (u, dof) in nm.items()]
    found = measurand("length_um", 50_000.838, np.ones(1), sources)
    assert 1e3 * found.std == pytest.approx(32, abs=0.5)
    assert int(found.degrees_of_freedom) == 16
    assert [line.source for line in found.lines] == [
        "standard",
        "temperature",
        "difference",
        "expansion",
    ]


def known_setup() -> tuple[Plan, TwinSetup, tn.Setup]:
    made, twin, _, read = ground("paper")
    artefact = replace(read.artefact, **STATED)
    return (
        made,
        twin,
        replace(
            read,
            artefact=artefact,
            probe=replace(read.probe, calibration_um=0.4, repeatability_um=0.2),
        ),
    )


def test_expanded_uncertainties_cover_what_calibration_and_temperature_do() -> None:
    made, twin, setup = known_setup()
    inside, runs = dict.fromkeys(("EZ0A", "EC0A", "EX0C"), 0), needed_runs(COVERED)
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        off = {
            "probe_radius": {"dr_um": rng.normal(0, 0.4)},
            "artefact_length": {"dl_um": rng.normal(0, 0.3)},
            "artefact_width": {"dw_um": rng.normal(0, 0.3)},
            "artefact_height": {"dh_um": rng.normal(0, 0.3)},
            "artefact_squareness": {"gamma_arcsec": rng.normal(0, 1.0)},
            "artefact_expansion": {"ppm": rng.normal(0, 11.5)},
        }
        truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=off)
        m = measure(made, twin, truth, noise_um=0.2, tick_um=0.1, seed=seed)
        budget = tn.identify(tn.Touches(m.columns), setup).budget(list(inside))
        for name in inside:
            inside[name] += abs(budget[name].value - truth.errors[name]) < budget.expanded[name]
        alone = next(x for x in budget["EZ0A"].lines if x.source == READINGS)
        assert alone.contribution < 0.5 * budget["EZ0A"].std
    for name, count in inside.items():
        assert kept(count, runs, COVERED), name


def test_expanded_uncertainties_cover_where_the_ball_stands() -> None:
    """A ball beside the spindle axis: the touch comes where it is, recorded where it should be."""
    made, twin, setup = known_setup()
    probe = replace(setup.probe, offset_std_um=2.0, length_std_um=1.0)
    inside, runs = dict.fromkeys(("EX0C", "EY0C", "EZ0A"), 0), needed_runs(COVERED)
    for seed in range(runs):
        rng = np.random.default_rng([11, seed])
        truth = Truth(errors=random_errors(rng), placement=random_placement(rng))
        touches = dict(measure(made, twin, truth, noise_um=0.2, seed=seed).columns)
        off_mm = rng.normal(0.0, [2e-3, 2e-3, 1e-3])
        along = made.conditions.direction @ off_mm
        for letter, way in zip("xyz", made.conditions.direction.T, strict=True):
            touches[f"{letter}_mm"] = touches[f"{letter}_mm"] - along * way
        fit = tn.identify(tn.Touches(touches), replace(setup, probe=probe))
        budget = fit.budget(list(inside))
        for name in inside:
            inside[name] += abs(budget[name].value - truth.errors[name]) < budget.expanded[name]
        assert budget["EX0C"].std > 1.9
        lines = {line.source: line.contribution for line in fit.budget(["EC0A"])["EC0A"].lines}
        assert lines["ball beside the spindle axis"] == pytest.approx(0.0, abs=1e-9)
    for name, count in inside.items():
        assert kept(count, runs, COVERED), name


def stands_off(made: Plan, rng: np.random.Generator, step_arcsec: float) -> Plan:
    """The plan as the axes stand: each position of an axis off by its own rounding."""
    k, off = made.conditions, {}
    for name in ("a_deg", "c_deg"):
        distinct, at = np.unique(getattr(k, name), return_inverse=True)
        rounding = rng.uniform(-0.5, 0.5, len(distinct)) * step_arcsec / 3600
        off[name] = getattr(k, name) + rounding[at]
    return replace(made, conditions=replace(k, **off))


def test_expanded_uncertainties_cover_where_rotary_axes_stand() -> None:
    """A stands at one place while C turns, and comes back to it."""
    made, twin, setup = known_setup()
    setup = replace(setup, resolution=replace(setup.resolution, rotary_arcsec=7.2))
    inside, runs = dict.fromkeys(("EA0A", "EZ0A", "EC0A"), 0), needed_runs(COVERED)
    for seed in range(runs):
        rng = np.random.default_rng([7, seed])
        truth = Truth(errors=random_errors(rng), placement=random_placement(rng))
        m = measure(stands_off(made, rng, 7.2), twin, truth, noise_um=0.2, seed=seed)
        k = made.conditions
        touches = tn.Touches({**m.columns, "a_deg": k.a_deg, "c_deg": k.c_deg})
        budget = tn.identify(touches, setup).budget(list(inside))
        for name in inside:
            inside[name] += abs(budget[name].value - truth.errors[name]) < budget.expanded[name]
    for name, count in inside.items():
        assert kept(count, runs, COVERED), name


def test_what_the_set_up_states_is_in_the_budget_of_several_measurements() -> None:
    """A circle says nothing of it; further touches of the same artefact have the same errors."""
    made, twin, setup = known_setup()
    setup = replace(setup, resolution=replace(setup.resolution, rotary_arcsec=7.2))
    truth = Truth(errors=random_errors(np.random.default_rng(3)))
    first, second = (
        tn.Touches(measure(made, twin, truth, noise_um=0.2, seed=seed).columns) for seed in (4, 5)
    )
    alone = tn.diagnose(first, setup).budget()
    for beside in (circle(np.random.default_rng(6), (0, 0), (0, 0), 0.0), second):
        joint = tn.diagnose([first, beside], setup).budget()
        for name in ("EX0C", "EZ0A", "EA0A", "EC0A"):
            lines, own = (
                {x.source: x.contribution for x in b[name].lines if x.source not in OF_READINGS}
                for b in (joint, alone)
            )
            assert len(own) > 5
            assert lines == pytest.approx(own, rel=0.05, abs=0.02), name


def test_the_monte_carlo_method_agrees_where_the_model_is_linear() -> None:
    made, twin, setup = known_setup()
    truth = Truth(errors=random_errors(np.random.default_rng(1)))
    m = measure(made, twin, truth, noise_um=0.2, tick_um=0.1, seed=1)
    setup = replace(setup, probe=replace(setup.probe, repeatability_um=0.0))
    fit = tn.identify(tn.Touches(m.columns), setup)
    linear, by_draws = fit.budget(), fit.budget(method="monte-carlo", seed=3)
    assert by_draws == fit.budget(method="monte-carlo", seed=3)
    for one, other in zip(linear.measurands, by_draws.measurands, strict=True):
        # The law of propagation leaves out that Student's t is wider.
        wide = np.sqrt(fit.degrees_of_freedom / (fit.degrees_of_freedom - 2))
        assert one.std * 0.97 < other.std < one.std * wide * 1.03
        assert other.interval is not None
        low, high = other.interval
        assert low < one.value < high
        assert high - low == pytest.approx(4 * other.std, rel=0.06)


def test_a_volumetric_budget_has_the_derivatives_of_the_volumetric_error() -> None:
    made, twin, setup = known_setup()
    truth = Truth(errors=random_errors(np.random.default_rng(2)))
    m = measure(made, twin, truth, noise_um=0.2, tick_um=0.1, seed=2)
    fit = tn.identify(tn.Touches(m.columns), setup)
    budget = tn.volumetric_budget(setup, fit, **BOX, tolerance_um=1000.0)
    assert budget["max_um"].value == pytest.approx(tn.volumetric_error(setup, fit, **BOX).max_um)
    gradient = np.zeros(len(fit.names))
    for name in fit.errors:
        ends = []
        for sign in (1.0, -1.0):
            moved = {**fit.errors, name: fit.errors[name] + 1e-3 * sign}
            ends.append(tn.volumetric_error(setup, moved, **BOX).max_um)
        gradient[fit.names.index(name)] = (ends[0] - ends[1]) / 2e-3
    total = np.sum([s.covariance() for s in fit.sources], axis=0)
    assert budget["max_um"].std == pytest.approx(
        float(np.sqrt(gradient @ total @ gradient)), rel=1e-4
    )
    assert budget.conformity is not None
    assert budget.conformity.decision == "pass"
    drawn = tn.volumetric_budget(setup, fit, **BOX, method="monte-carlo", draws=4000)
    assert drawn["rms_um"].std == pytest.approx(budget["rms_um"].std, rel=0.1)


def test_conformity_is_decided_by_iso_14253_1() -> None:
    made, twin, setup = known_setup()
    tolerance = {"EX0C": 100.0, "EY0C": 1e-3}
    limited = replace(setup, machine=replace(setup.machine, tolerance=tolerance))
    m = measure(made, twin, Truth(errors={"EX0C": 15.0, "EY0C": 9.0}), noise_um=0.2, seed=1)
    budget = tn.identify(tn.Touches(m.columns), limited).budget()
    assert budget.conformity is not None
    decided = {j.name: str(j.decision) for j in budget.conformity.judged}
    assert decided == {"EX0C": "pass", "EY0C": "fail"}
    # 1.645 u from the limit nothing is proved.
    edge = budget["EX0C"].value + 1.6 * budget["EX0C"].std
    near = tn.identify(tn.Touches(m.columns), limited).budget(tolerances={"EX0C": edge})
    assert near.conformity is not None
    assert near.conformity.decision == "undecided"


def test_a_tolerance_of_an_unknown_name_is_refused_with_the_known_ones() -> None:
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    fit = tn.identify(tn.read_touches(tn.sample_path("cross/touches.csv")), setup)
    said = "tolerance: got 'EXOC', expected one of EA0A, .*; did you mean EX0C?"
    with pytest.raises(tn.UnknownNameError, match=said):
        fit.budget(tolerances={"EXOC": 5.0})
    with pytest.raises(tn.UnknownNameError, match="got 'EY0C', expected one of EX0C"):
        fit.budget(["EX0C"], tolerances={"EY0C": 5.0})
    made = replace(fit.budget(), tolerances={"EXOC": 5.0})
    with pytest.raises(tn.UnknownNameError, match="quantity: got 'EXOC', expected one of EA0A"):
        _ = made.conformity


def test_the_doubt_between_causes_is_a_source() -> None:
    d = with_outliers()
    budget = d.budget()
    name = max(d.doubt, key=lambda k: d.doubt[k] / d.errors_std[k])
    (line,) = (x for x in budget[name].lines if x.source == MODEL)
    assert line.contribution == pytest.approx(d.doubt[name])
    own = sum(x.contribution**2 for x in budget[name].lines if not x.source.startswith("steps"))
    assert own == pytest.approx(d.errors_std[name] ** 2, rel=1e-6)
    assert tn.Diagnosis.from_json(d.to_json()).budget() == budget


def test_what_is_not_identifiable_has_no_budget() -> None:
    plan = tn.plan(known_setup()[2], a_deg=(), c_deg=(0, 90, 180, 270))
    fit = tn.identify(tn.simulate(plan, known_setup()[2], noise_um=0.2, seed=1), known_setup()[2])
    lost = [k for k in fit.errors if not np.isfinite(fit.std_errors[k])]
    assert lost
    assert all(np.isinf(fit.budget()[k].std) for k in lost)
    assert f"{lost[0]} is not identifiable." in fit.budget().sentences()


def test_the_model_of_every_kind_of_data_has_a_budget_of_its_effects() -> None:
    """What is always fitted (an offset, a placement) has a standard error, but is no estimate."""
    d = diagnosis_of("positioning")
    budget = d.model.budget()
    assert {one.name for one in budget.measurands} == {
        f"{c.id}.{p}" for c in d.causes for p in c.parameters
    }


def test_readings_change_as_touches_of_turned_axes_do() -> None:
    """The core turns the axes; here the touches are turned, C counted backwards."""
    setup = tn.Setup(tn.Artefact("cross"), axes={"C": AxisSetup(sense=-1)})
    data = tn.simulate(tn.plan(setup), setup, {"EX0C": 15.0}, noise_um=0.3, seed=1)
    model = TouchModel(setup)
    found = turning(model, model.moves(data), model.values({"EX0C": 15.0}))
    assert list(found) == ["a", "c"]
    for letter, change in found.items():
        angle = f"{letter}_deg"
        ahead, behind = (
            model.core.residuals(
                model.moves(data.with_columns(**{angle: data[angle] + step / 3600.0})),
                model.values({"EX0C": 15.0}),
            )
            for step in (20.0, -20.0)
        )
        np.testing.assert_allclose(change, (behind - ahead) / 40.0, atol=1e-6)
        assert np.abs(change).max() > 0.05, letter


def test_a_budget_of_nothing_says_so() -> None:
    made = tn.diagnose(axis(np.random.default_rng(5001))).budget()
    assert not made.measurands
    assert made.summary() == EMPTY
