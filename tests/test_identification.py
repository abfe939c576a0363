"""Identification: any plan and artefact; uncertainty holds; what is not identifiable is named."""

from dataclasses import replace
from typing import Literal, get_args

import numpy as np
import pytest
from scipy import stats

import trunnion as tn
from from_twin import setup as from_twin_setup
from from_twin import touches as from_twin_touches
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement, standard

CROSS = tn.Setup(artefact=tn.Artefact("cross"))
CUBOID = tn.Setup(artefact=tn.Artefact("cuboid", length_mm=80.0, width_mm=60.0, height_mm=40.0))
SPHERE = tn.Setup(artefact=tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(60.0, 20.0, 45.0)))
NAMES = ("EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EB0C", "EX0C", "EY0C")


def random_errors_of(rng: np.random.Generator, size: float) -> dict[str, float]:
    return dict(zip(NAMES, rng.uniform(-size, size, 8).tolist(), strict=True))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_converges_from_zero_for_one_millimetre_and_one_degree(sign: float) -> None:
    truth = {
        "EA0A": 3600.0,
        "EB0A": -3600.0,
        "EC0A": 3600.0,
        "EY0A": 1000.0,
        "EZ0A": -1000.0,
        "EB0C": 3600.0,
        "EX0C": -1000.0,
        "EY0C": 1000.0,
    }
    truth = {name: sign * value for name, value in truth.items()}
    data = tn.simulate(tn.plan(CROSS), CROSS, truth)
    result = tn.identify(data, CROSS)
    assert result.converged
    for name, value in truth.items():
        assert result.errors[name] == pytest.approx(value, abs=1e-6), name


@pytest.mark.parametrize("setup", [CROSS, CUBOID, SPHERE], ids=["cross", "cuboid", "sphere"])
def test_efficient_and_covering_on_every_artefact(setup: tn.Setup) -> None:
    """Spread against the Cramér-Rao bound and coverage of 95 % intervals over 2,000 cases."""
    cases, noise = 2000, 0.3
    plan = tn.plan(setup)
    rng = np.random.default_rng(11)
    errors = random_errors_of(rng, 60.0)
    clean = tn.simulate(plan, setup, errors)
    along = rng.normal(0.0, noise * 1e-3, (cases, len(plan), 1))
    positions = clean.position_mm + along * clean.direction
    names, values, spread, converged = tn.identify_many(plan, setup, positions)
    assert converged.all()
    truth = np.array([errors.get(name, 0.0) for name in names])
    bound = tn.observability(clean, setup, noise_um=noise).std_errors
    quantile = stats.t.ppf(0.975, len(plan) - len(bound))
    for k, name in enumerate(names):
        if name not in bound:  # the rotation of a sphere
            assert not values[:, k].any(), name
            assert not spread[:, k].any(), name
            continue
        if not np.isfinite(bound[name]):
            assert np.all(np.isinf(spread[:, k])), name
            continue
        left = values[:, k] - truth[k]
        efficiency = (bound[name] / left.std()) ** 2
        assert efficiency > 0.98 - 2 * np.sqrt(2 / cases), (name, efficiency)
        covered = np.mean(np.abs(left) < quantile * spread[:, k])
        assert 0.93 < covered < 0.97, (name, covered)


def test_many_are_the_same_as_one_on_any_number_of_threads() -> None:
    plan = tn.plan(CROSS)
    data = [tn.simulate(plan, CROSS, noise_um=0.3, seed=5, sample=i) for i in range(20)]
    positions = np.stack([touches.position_mm for touches in data])
    _, values, spread, _ = tn.identify_many(plan, CROSS, positions, threads=1)
    again = tn.identify_many(plan, CROSS, positions, threads=2)
    assert np.array_equal(values, again[1])
    one = tn.identify(data[7], CROSS)
    assert list(one.values.values()) == values[7].tolist()
    # One by singular values, many by the Cholesky factor of the same matrix.
    np.testing.assert_allclose(list(one.std_errors.values()), spread[7], rtol=1e-12)


def test_recovers_the_twins_truth_with_effects() -> None:
    plan, setup, _ = standard("rich")
    rng = np.random.default_rng(3)
    effects = {
        "drift_z": {"rate_um_h": 4.0},
        "squareness_xy": {"arcsec": 5.0},
        "c_positioning_2": {"a2_arcsec": 6.0, "b2_arcsec": -4.0},
        "warmup_z": {"amplitude_um": 6.0, "tau_min": 15.0},
        "setup_shift": {"dx_um": 3.0, "dy_um": -2.0, "dz_um": 1.5, "t0_s": 2500.0},
    }
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=effects)
    m = measure(plan, setup, truth, noise_um=0.1, tick_um=0.1, seed=9)
    result = tn.identify(from_twin_touches(m), from_twin_setup(setup), tuple(effects))
    assert result.converged
    for name, value in m.truth.errors.items():
        assert abs(result.errors[name] - value) < 4.5 * result.std_errors[name], name
    for effect, parameters in effects.items():
        for name, value in parameters.items():
            limit = 4.5 * result.std_errors[f"{effect}.{name}"]
            assert abs(result.effects[effect][name] - value) < limit, (effect, name)


@pytest.mark.parametrize(
    ("effect", "partner"),
    [
        ("artefact_height", "dz_um"),
        ("backlash_z", "EZ0A"),
        ("squareness_xz", "EX0C"),
        ("a_twist", "EC0A"),
    ],
)
def test_what_cannot_be_seen_is_named_and_given_no_number(effect: str, partner: str) -> None:
    rng = np.random.default_rng(17)
    placement = {"dx_um": 80.0, "dz_um": -40.0, "ra_arcsec": 70.0}
    data = tn.simulate(
        tn.plan(CROSS), CROSS, random_errors_of(rng, 60.0), placement, noise_um=0.3, seed=1
    )
    result = tn.identify(data, CROSS, (effect,))
    assert result.converged
    name = next(name for name in result.std_errors if name.startswith(effect))
    assert result.std_errors[name] == np.inf
    assert result.std_errors[partner] == np.inf
    assert result.effects[effect] == {name.split(".")[1]: 0.0}
    assert any(partner in line and name in line for line in result.not_identifiable)
    assert "not identifiable" in result.summary()
    assert result.to_dict()["std_errors"][name] == "inf"
    others = [n for n in NAMES if not any(n in line for line in result.not_identifiable)]
    plain = tn.identify(data, CROSS)
    for other in others:
        assert result.errors[other] == pytest.approx(plain.errors[other], abs=0.1)


def test_a_prior_of_a_known_dimension_parts_what_looked_alike() -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"), probe=tn.Probe(repeatability_um=0.3))
    data = tn.simulate(
        tn.plan(setup), setup, effects={"artefact_height": {"dh_um": 4.0}}, noise_um=0.3, seed=2
    )
    blind = tn.identify(data, setup, ("artefact_height",))
    assert blind.std_errors["dz_um"] == np.inf
    known = tn.identify(
        data, setup, ("artefact_height",), priors={"artefact_height.dh_um": (4.0, 0.2)}
    )
    assert known.std_errors["artefact_height.dh_um"] == pytest.approx(0.2, rel=1e-6)
    assert abs(known.placement["dz_um"]) < 4 * known.std_errors["dz_um"]  # type: ignore[index]
    with pytest.raises(tn.InputError, match=r"repeatability_um"):
        tn.identify(data, CROSS, ("artefact_height",), priors={"artefact_height.dh_um": (4, 0.2)})


def test_hubers_loss_resists_a_chip() -> None:
    data = tn.simulate(tn.plan(CROSS), CROSS, noise_um=0.3, seed=4)
    x = data.z_mm.copy()
    x[0] += 0.05
    spoiled = data.with_columns(z_mm=x)
    plain = tn.identify(spoiled, CROSS).errors["EZ0A"]
    robust = tn.identify(spoiled, CROSS, loss="huber")
    assert abs(robust.errors["EZ0A"]) < 0.5 < abs(plain)
    assert robust.weights is not None
    assert robust.weights[0] < 0.1


def test_lack_of_fit_where_touches_repeat() -> None:
    plan = tn.plan(CROSS, repeats=3)
    good = tn.identify(tn.simulate(plan, CROSS, noise_um=0.3, seed=1), CROSS)
    bad = tn.identify(
        tn.simulate(plan, CROSS, effects={"scale_x": {"ppm": 30.0}}, noise_um=0.3, seed=1), CROSS
    )
    assert good.lack_of_fit is not None
    assert bad.lack_of_fit is not None
    assert good.lack_of_fit.p_value > 1e-3
    assert bad.lack_of_fit.p_value < 1e-6
    assert bad.lack_of_fit.pure_error_um == pytest.approx(0.3, rel=0.2)
    assert tn.identify(tn.simulate(tn.plan(CROSS), CROSS), CROSS).lack_of_fit is None


class Step:
    """A user's own effect: the +X arm is higher."""

    id = "plus_x_arm"
    parameters = ("step_um",)

    def change(self, data: tn.Touches, values: dict[str, float]) -> np.ndarray:
        on_arm = np.isin(data.point if data.point is not None else [], [13])
        return values["step_um"] * on_arm


def test_a_users_own_effect_is_simulated_and_estimated() -> None:
    effect = Step()
    data = tn.simulate(
        tn.plan(CROSS), CROSS, effects={effect: {"step_um": 4.0}}, noise_um=0.1, seed=1
    )
    result = tn.identify(data, CROSS, (effect,))
    name = "plus_x_arm.step_um"
    assert abs(result.effects["plus_x_arm"]["step_um"] - 4.0) < 4 * result.std_errors[name]


class SteppedStep(Step):
    """The same in steps of 0.01 µm, with a derivative of its own."""

    def change(self, data: tn.Touches, values: dict[str, float]) -> np.ndarray:
        return super().change(data, {"step_um": round(values["step_um"], 2)})

    def jacobian(self, data: tn.Touches, values: dict[str, float]) -> np.ndarray:
        assert np.isfinite(values["step_um"])
        return super().change(data, {"step_um": 1.0})[:, None]


def test_a_users_own_derivative_is_used() -> None:
    """Differences over 1e-4 µm of a change in steps of 0.01 µm would be zero."""
    effect = SteppedStep()
    data = tn.simulate(tn.plan(CROSS), CROSS, effects={effect: {"step_um": 4.0}})
    result = tn.identify(data, CROSS, (effect,))
    assert result.effects[effect.id]["step_um"] == pytest.approx(4.0, abs=0.01)
    assert np.isfinite(result.std_errors["plus_x_arm.step_um"])


def test_known_errors_are_part_of_the_totals() -> None:
    known = tn.Setup(artefact=tn.Artefact("cross"), machine=tn.Machine(errors={"EX0C": 30.0}))
    data = tn.simulate(tn.plan(CROSS), CROSS, {"EX0C": 42.0})
    assert tn.identify(data, known).errors["EX0C"] == pytest.approx(42.0, abs=1e-6)
    assert tn.closed_form(data, known).errors["EX0C"] == pytest.approx(42.0, abs=1e-5)


def test_the_controls_sign_of_an_axis_changes_nothing_but_the_sign() -> None:
    turned = tn.Setup(artefact=tn.Artefact("cross"), axes={"C": tn.AxisSetup(sense=-1)})
    errors = {"EX0C": 20.0, "EB0C": 10.0, "EY0A": -8.0}
    data = tn.simulate(tn.plan(turned), turned, errors)
    straight = tn.simulate(tn.plan(CROSS), CROSS, errors)
    quarter = (np.round(data.rotary_deg["c"]) == 90) & (np.asarray(data.point) == 3)
    # The control's 90 degrees are -90 degrees of the table: the arm lies on the other side.
    assert data.x_mm[quarter][0] == pytest.approx(-straight.x_mm[quarter][0], abs=0.1)
    found = tn.identify(data, turned).errors
    for name in NAMES:
        assert found[name] == pytest.approx(errors.get(name, 0.0), abs=1e-6)


@pytest.mark.parametrize("preset", ["trt-bc", "table-c-head-b"])
def test_other_machines_are_identified_by_the_same_code(preset: str) -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross"), machine=tn.Machine(preset=preset))
    plan = tn.plan(setup, b_deg=(60, -60) if preset != "trt-bc" else (90, -90))
    errors = {"EX0C": 20.0, "EA0C": 10.0, "EX0B": -8.0, "EC0B": 15.0}
    result = tn.identify(tn.simulate(plan, setup, errors), setup)
    assert result.converged
    seen = [n for n in result.errors if np.isfinite(result.std_errors[n])]
    for name in seen:
        assert result.errors[name] == pytest.approx(errors.get(name, 0.0), abs=1e-6), name
    if preset == "trt-bc":
        assert len(seen) == 8
    else:
        assert result.not_identifiable


@pytest.mark.parametrize("seed", range(12))
def test_too_few_positions_lead_nowhere_far(seed: int) -> None:
    """One cycle or one position: what is not seen stays put and is named, the rest fits."""
    truth = {"EA0A": 21.6, "EB0A": 18.0, "EC0A": 10.8, "EB0C": 25.2, "EX0C": 15.0, "EY0C": 21.0}
    placement = {"dx_um": 50.0, "rc_arcsec": 60.0}
    data = tn.simulate(tn.plan(CROSS), CROSS, truth, placement, noise_um=0.3, seed=seed)
    for rows in (data.rotary_deg["a"] == 0, np.arange(len(data)) < 16):
        result = tn.identify(data[rows], CROSS)
        assert result.converged
        assert result.rms_um < 0.6
        assert np.isinf(result.std_errors["EB0A"])
        assert all(abs(value) < 500 for value in result.values.values())
        assert result.not_identifiable


def test_residuals_are_judged_in_words() -> None:
    plan = tn.plan(CROSS)
    good = tn.identify(tn.simulate(plan, CROSS, noise_um=0.3, seed=1), CROSS)
    assert good.to_dict()["notes"] == []
    thick = tn.Setup(artefact=tn.Artefact("cross"), probe=tn.Probe(ball_radius_mm=1.1))
    wrong = tn.identify(tn.simulate(plan, CROSS), thick)
    assert "ball's radius" in wrong.summary()
    sure = tn.Setup(artefact=tn.Artefact("cross"), probe=tn.Probe(repeatability_um=0.01))
    small = tn.identify(tn.simulate(plan, CROSS, noise_um=0.3, seed=1), sure)
    assert "standard errors are too small" in small.summary()


def test_a_users_own_effect_with_a_prior_and_a_robust_loss() -> None:
    """The own effect is measured by one touch a cycle; a chip on another touch is held down."""
    probe = tn.Probe(repeatability_um=0.3)
    setup = tn.Setup(artefact=tn.Artefact("cross"), probe=probe)
    effect, name = Step(), "plus_x_arm.step_um"
    data = tn.simulate(
        tn.plan(setup), setup, effects={effect: {"step_um": 4.0}}, noise_um=0.3, seed=1
    )
    plain = tn.identify(data, setup, (effect,))
    known = tn.identify(data, setup, (effect,), priors={name: (0.0, 1e-3)})
    assert plain["plus_x_arm.step_um"] == pytest.approx(4.0, abs=4 * plain.std_errors[name])
    assert known["plus_x_arm.step_um"] == pytest.approx(0.0, abs=4e-3)
    assert known.std_errors[name] == pytest.approx(1e-3, rel=1e-3)
    assert known.degrees_of_freedom == plain.degrees_of_freedom + 1
    off = data.z_mm.copy()
    off[0] += 0.05
    chipped = data.with_columns(z_mm=off)
    robust = tn.identify(chipped, setup, (effect,), loss="huber")
    assert robust.weights is not None
    assert robust.weights[0] < 0.1
    squares = tn.identify(chipped, setup, (effect,))
    away = [abs(fit["EZ0A"] - plain["EZ0A"]) for fit in (robust, squares)]
    assert away[0] < 0.2 * away[1]


def test_a_users_own_effect_takes_the_same_way_as_the_catalogue() -> None:
    """A copy of a built-in effect gives its numbers, and what both do is not identifiable."""

    class Drift:
        id = "my_drift"
        parameters = ("rate_um_h",)

        def change(self, data: tn.Touches, values: dict[str, float]) -> np.ndarray:
            seconds = np.asarray(data.time_s, dtype=float)
            hours: np.ndarray = (seconds - seconds.min()) / 3600
            return -hours * values["rate_um_h"] * data.dir_z

    data = tn.simulate(
        tn.plan(CROSS), CROSS, effects={"drift_z": {"rate_um_h": 6.0}}, noise_um=0.3, seed=2
    )
    theirs, ours = tn.identify(data, CROSS, ("drift_z",)), tn.identify(data, CROSS, (Drift(),))
    assert ours["my_drift.rate_um_h"] == pytest.approx(theirs["drift_z.rate_um_h"], rel=1e-4)
    assert ours.std_errors["my_drift.rate_um_h"] == pytest.approx(
        theirs.std_errors["drift_z.rate_um_h"], rel=1e-4
    )
    for name in NAMES:
        assert ours[name] == pytest.approx(theirs[name], abs=1e-3), name
    both = tn.identify(data, CROSS, ("drift_z", Drift()))
    assert both.converged
    assert {"drift_z.rate_um_h", "my_drift.rate_um_h"} == set().union(*both.combinations)


Method = Literal["least squares", "huber", "printed", "separating"]


def pasted(data: tn.Touches, *, cycle: bool = False) -> tn.Touches:
    """The rows twice, in the same order; with `cycle`, the second time as another cycle."""
    twice = {name: np.concatenate([v, v]) for name, v in data.columns.items()}
    if cycle:
        twice["cycle"] = np.repeat([1, 2], len(data))
        twice["time_s"] = np.arange(2.0 * len(data))
    return tn.Touches(twice)


@pytest.mark.parametrize("sigma_um", [0.0, 0.02])
@pytest.mark.parametrize("cycle", [False, True])
@pytest.mark.parametrize("method", get_args(Method))
def test_rows_pasted_twice_count_once(method: Method, cycle: bool, sigma_um: float) -> None:
    """Standard errors, scatter and doubts are those of the rows alone; arrays are of all rows."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    setup = replace(setup, probe=replace(setup.probe, repeatability_um=sigma_um))
    data = tn.read_touches(tn.sample_path("cross/touches.csv"))

    def estimated(touches: tn.Touches) -> tn.IdentificationResult:
        if method == "printed" or method == "separating":
            return tn.closed_form(touches, setup, method)
        return tn.identify(touches, setup, loss="huber" if method == "huber" else "squares")

    once, twice = estimated(data), estimated(pasted(data, cycle=cycle))
    count = len(data)
    note, *rest = twice.notes
    assert note.startswith(f"{count} of {2 * count} rows repeat others")
    assert tuple(rest) == once.notes
    assert twice.errors == once.errors
    assert twice.std_errors == once.std_errors
    assert twice.degrees_of_freedom == once.degrees_of_freedom
    assert (twice.rms_um, twice.lack_of_fit) == (once.rms_um, once.lack_of_fit)
    assert np.array_equal(twice.residuals_um, np.tile(once.residuals_um, 2))
    assert twice.weights is not None
    assert np.all(twice.weights[:count] > 0)
    assert not np.any(twice.weights[count:])
    assert twice.sentences()[0] == once.sentences()[0]
    assert twice.derived()["doubts"] == once.derived()["doubts"]


def test_rows_pasted_between_others_have_their_residuals() -> None:
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    data = tn.read_touches(tn.sample_path("cross/touches.csv"))
    order = [5, *range(len(data)), 7]
    once, more = tn.identify(data, setup), tn.identify(data[order], setup)
    assert more["EX0C"] == pytest.approx(once["EX0C"], abs=1e-9)
    assert more.residuals_um == pytest.approx(once.residuals_um[order], abs=1e-9)
    assert more.weights is not None
    assert np.flatnonzero(more.weights == 0).tolist() == [6, len(order) - 1]


def test_an_error_about_a_row_names_that_of_the_data_given() -> None:
    """Row 40 behind two rows that repeat row 3 is row 42."""
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    data = tn.read_touches(tn.sample_path("cross/touches.csv"))
    z = data.z_mm.copy()
    z[40] += 500.0
    data = tn.Touches(dict(data.columns)).with_columns(z_mm=z)
    with pytest.raises(tn.DataError, match="row 40"):
        tn.identify(data, setup)
    order = [3, 3, *range(len(data))]
    with pytest.raises(tn.DataError, match="row 42"):
        tn.identify(data[order], setup)
