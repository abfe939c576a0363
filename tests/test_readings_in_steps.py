"""Readings that are recorded in steps: the tick of a control, the digits of an instrument."""

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

import trunnion as tn
from power import ticks
from promise import kept, needed_runs
from trunnion.base.recognition import recognised
from trunnion.base.resolution import Coordinates, Floor, Grid, inflation
from trunnion.diagnosis.effect import linear
from trunnion.diagnosis.linear_model import LinearModel
from trunnion.diagnosis.model import Nuisance, Readings
from trunnion.models.kinds import diagnose as diagnose_model
from trunnion.setup import Artefact, Probe, Setup

LINUXCNC = Setup(artefact=Artefact("cross"), probe=Probe(servo_period_ms=1.0))


def rounded(values: np.ndarray, step: float) -> np.ndarray:
    """Round to the nearest step."""
    return step * np.ceil(values / step - 0.5)


# --- the noise of a reading


def test_the_deviance_is_smooth_where_the_floor_begins() -> None:
    floor, n = Floor(2.0), 40
    at = 2.0 * n
    around = floor.deviance(np.array([at - 1e-4, at, at + 1e-4]), n)
    assert np.diff(around) == pytest.approx(1e-4 / 2.0, rel=1e-3)
    # below the floor the variance is known: half a unit of -2 ln L a unit of the sum of squares
    assert floor.deviance(at, n) - floor.deviance(0.5 * at, n) == pytest.approx(0.5 * n)
    assert floor.noise(0.1 * at, n) == 2.0


@pytest.mark.parametrize("noise", [0.03, 0.1, 0.2, 0.4])
def test_repeats_on_one_grid_share_their_error(noise: float) -> None:
    """The covariance that is used, against rounding done a hundred thousand times."""
    rng = np.random.default_rng(3)
    base = rng.uniform(0, 1, (100_000, 1))
    readings = rounded(base + noise * rng.standard_normal((100_000, 3)), 1.0) - base
    grid = Grid(np.ones(3), np.zeros(3, dtype=np.intp))
    errors = grid.errors(noise)
    assert errors is not None
    total = noise**2 + 1 / 12
    assert np.cov(readings.T) == pytest.approx(
        total * errors.covariance(np.eye(3)), abs=0.03 * total
    )
    white = errors(np.eye(3)) @ np.cov(readings.T) @ errors(np.eye(3)).T
    assert white == pytest.approx(total * np.eye(3), abs=0.06 * total)


@pytest.mark.parametrize("noise", [0.03, 0.1, 0.2, 0.4])
def test_repeats_of_rounded_coordinates_share_their_errors(noise: float) -> None:
    """An oblique approach of which each coordinate is rounded, a hundred thousand times."""
    rng = np.random.default_rng(11)
    way = np.array([0.0, 0.8, -0.6])
    base = rng.uniform(0, 1, (100_000, 1, 3))
    off = noise * rng.standard_normal((100_000, 4, 1)) * way
    readings = (rounded(base + off, 1.0) - base) @ way
    parts, alike = np.tile(way, (4, 1)), np.zeros(4, dtype=np.intp)
    grid = Grid(np.ones(4), alike, parts)
    errors = grid.errors(noise)
    assert errors is not None
    total = noise**2 + 1 / 12
    assert np.cov(readings.T) == pytest.approx(
        total * errors.covariance(np.eye(4)), abs=0.03 * total
    )
    many = Grid(np.ones(400_000), np.repeat(np.arange(100_000), 4), np.tile(way, (400_000, 1)))
    assert many.noise(readings.reshape(-1), 300_000, np.ones((400_000, 1))) == pytest.approx(
        noise, rel=0.03
    )


def test_coordinates_are_what_is_rounded_where_only_they_lie_on_a_grid() -> None:
    rng = np.random.default_rng(2)
    way = np.array([0.0, 0.8, -0.6])
    places = np.round(rng.uniform(-300, 300, (12, 3)))
    places[1], step = places[0] + [0.0, 3.0, -2.0], np.ones(12)
    parts, groups = np.tile(way, (12, 1)), np.zeros(12, dtype=np.intp)
    jacobian = np.arange(12.0)[:, None] // 2
    coordinates = Coordinates(places, parts)
    grid = Grid.of(places @ way, step, jacobian, groups, (), coordinates)
    assert grid.parts is parts
    assert list(np.flatnonzero(grid.label == grid.label[0])) == list(range(12))[:2]
    ways = np.round(rng.uniform(-300, 300, 12))
    assert Grid.of(ways, step, jacobian, groups, (), coordinates).parts is None
    assert Grid.of(places @ way, step, jacobian, groups, (ways,), coordinates).parts is None
    off = Coordinates(places + 0.3 * rng.uniform(size=(12, 3)), parts)
    assert Grid.of(places @ way, step, jacobian, groups, (), off).parts is None


def test_machines_that_round_each_coordinate_are_drawn_so() -> None:
    """Errors of draws, against the rounding of places that are drawn here."""
    way, n = np.array([0.0, 0.8, -0.6]), 400
    rng = np.random.default_rng(4)
    values = (np.round(rng.uniform(-300, 300, (n, 3))) @ way).astype(float)
    grid = Grid(np.ones(n), np.full(n, -1), np.tile(way, (n, 1)))
    jacobian, covariance = np.ones((n, 1)), np.array([[0.2**2]])
    drawn = grid.draws(values, np.zeros(n), jacobian, covariance, 0.1)
    assert drawn is not None
    machine = 0.2 * rng.standard_normal(100_000)
    off = machine + 0.1 * rng.standard_normal(100_000)
    error = np.round(off[:, None] * way) @ way - machine
    assert np.sqrt(np.mean(drawn**2)) == pytest.approx(np.sqrt(np.mean(error**2)), rel=0.1)


def test_the_noise_beside_the_steps_is_seen_in_repeats() -> None:
    rng = np.random.default_rng(5)
    base = np.repeat(rng.uniform(-50, 50, 400), 4)
    for noise in (0.05, 0.15, 0.3):
        off = rounded(base + noise * rng.standard_normal(1600), 1.0) - base
        grid = Grid(np.ones(1600), np.repeat(np.arange(400), 4))
        assert grid.noise(off, 1600, np.ones((1600, 1))) == pytest.approx(noise, rel=0.15)


@pytest.mark.parametrize(("mean", "scatter"), [(0.0, 1.5), (3.0, 0.2), (2.0, 1.0), (0.5, 0.3)])
def test_a_cause_is_judged_by_what_rounding_gains_along_it(mean: float, scatter: float) -> None:
    # What simulated errors gain at this level along one column.
    level, rng = 1e-3, np.random.default_rng(5)
    column = np.array([0.6, 0.8, 0.0])
    along = mean + scatter * rng.standard_normal(4000)
    errors = column[:, None] * along + np.array([0.8, -0.6, 1.0])[:, None]
    chance = np.array([NormalDist().inv_cdf(1 - level / 2) ** 2])

    factor = inflation(lambda e: (column @ e)[None] ** 2, errors, np.array([1]), chance)[0]

    many = np.quantile((mean + scatter * rng.standard_normal(400_000)) ** 2, 1 - level)
    assert factor == pytest.approx(max(many / chance[0], 1.0), rel=0.12)
    assert factor >= 0.95 * many / chance[0]


# --- steps that nobody stated


def test_steps_are_recognised() -> None:
    rng = np.random.default_rng(2)
    truth = rng.uniform(-300, 300, 200)
    assert recognised(rounded(truth, 10.0)) == pytest.approx(10.0)
    assert recognised(rounded(truth, 5 / 3) + 0.123) == pytest.approx(5 / 3)
    assert recognised(np.round(truth, 2)) == pytest.approx(0.01)
    assert recognised(truth) == 0.0
    assert recognised(np.full(9, 4.2)) == 0.0


def test_a_tick_that_nobody_stated_is_recognised_and_said() -> None:
    plan = tn.plan(LINUXCNC, dither=False)
    data = tn.simulate(plan, LINUXCNC, {"EX0C": 15.3, "EA0A": 11.0}, {"dx_um": 130.0})
    unstated = replace(LINUXCNC, probe=Probe())
    said = tn.diagnose(data, unstated)
    (note,) = [one for one in said.notes if "in steps of" in one]
    assert "steps of 10 µm (recognised in the data)" in note
    assert "probe.servo_period_ms" in note
    assert said.sigma >= 10 / np.sqrt(12) * (1 - 1e-9)
    stated = tn.diagnose(data, LINUXCNC)
    assert "as the set-up states" in stated.notes[0]
    # half a tick is in EZ0A and dz together, unless the tick is stated
    fits = [tn.identify(data, setup) for setup in (unstated, LINUXCNC)]
    height = [fit["EZ0A"] + fit["dz_um"] for fit in fits]
    assert abs(height[1] - height[0]) == pytest.approx(5.0, abs=0.5)


@pytest.mark.parametrize("stated", [0.0, 0.1])
def test_a_tick_is_recognised_on_the_way_from_the_start(stated: float) -> None:
    """Starts are dithered, so that coordinates are on no grid; the set-up says nothing, or less."""
    control = Setup(Artefact("cross"), probe=Probe(servo_period_ms=1.0))  # 10 µm at F600
    errors = {"EZ0A": 20.0, "EA0A": 10.0}
    touches = tn.simulate(tn.plan(control), control, errors, noise_um=0.3, seed=3)
    given = Setup(Artefact("cross"), probe=Probe(tick_um=stated))
    for notes in (tn.diagnose(touches, given).notes, tn.identify(touches, given).notes):
        said = [note for note in notes if "in steps of 10 µm" in note]
        assert said
        assert "half of it is in EZ0A" in said[0]
    assert tn.diagnose(touches, given).sigma >= 10.0 / np.sqrt(12.0)
    assert not [n for n in tn.identify(touches, control).notes if "in steps" in n]


ERRORS = ("EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EB0C", "EX0C", "EY0C")


@pytest.mark.parametrize("starts", [True, False])
def test_a_log_in_whole_micrometres_is_recognised(*, starts: bool) -> None:
    """Places are on a grid, ways from dithered starts are not; a fit takes much of the rounding."""
    bare = Setup(Artefact("cross"), probe=Probe())
    rng = np.random.default_rng(7)
    z = []
    for seed in range(6):
        errors = {name: float(rng.uniform(-25, 25)) for name in ERRORS}
        placed = {"dx_um": 130.0, "dy_um": -88.0, "rc_arcsec": 90.0}
        data = tn.simulate(tn.plan(bare), bare, errors, placed, noise_um=0.1, seed=seed + 1)
        whole = np.round(data.position_mm, 3)
        columns = dict(zip(("x_mm", "y_mm", "z_mm"), whole.T, strict=True))
        without = {} if starts else {f"start_{axis}_mm": None for axis in "xyz"}
        d = tn.diagnose(data.with_columns(**columns, **without), bare)
        assert d.verdict == "consistent"
        assert not d.outliers
        assert any("in steps of 1 µm (recognised in the data)" in note for note in d.notes)
        assert d.sigma >= 1 / np.sqrt(12) * (1 - 1e-9)
        z += [(d.errors_after[name] - errors[name]) / d.errors_std[name] for name in errors]
    assert np.sqrt(np.mean(np.square(z))) < 1.5
    assert np.abs(z).max() < 4.5


def test_a_coarser_step_than_the_stated_tick_is_seen_in_few_values() -> None:
    """One error, coordinates in whole 10 µm, a tick of 0.1 µm: EX0C was 459 standard errors off."""
    fine = Setup(Artefact("cross"), probe=Probe(tick_um=0.1))
    data = tn.simulate(tn.plan(fine), fine, {"EX0C": 15.0})
    whole = dict(zip(("x_mm", "y_mm", "z_mm"), np.round(data.position_mm, 2).T, strict=True))
    fit = tn.identify(data.with_columns(**whole), fine)
    assert abs(fit["EX0C"] - 15.0) < 4 * fit.std_errors["EX0C"]


def test_a_diagnosis_in_steps_stays_where_no_machine_is() -> None:
    """A shift of 12 mm before the last touches, moved by half a second, was an error."""
    assert ticks.run("paper", 0.1, "rounded", ticks.ANY, 100_753).verdict == "explained"


def test_a_stated_resolution_is_not_late() -> None:
    """Rounded to the nearest step, touches have no half tick in EZ0A; a tick has."""
    shown = Setup(Artefact("cross"), probe=Probe(resolution_um=5.0))
    data = tn.simulate(tn.plan(shown), shown, {"EX0C": 21.3, "EA0A": 8.0}, {"dx_um": 130.0})
    assert np.allclose(200 * data.position_mm, np.round(200 * data.position_mm), atol=1e-6)
    found, fit = tn.diagnose(data, shown), tn.identify(data, shown)
    assert found.verdict == "consistent"
    assert "steps of 5 µm (as the set-up states)" in found.notes[0]
    assert found.sigma >= 5 / np.sqrt(12) * (1 - 1e-9)
    assert not any("in steps" in note for note in fit.notes)
    assert abs(fit["EZ0A"] + fit["dz_um"]) < 1.0
    late = tn.identify(data, Setup(Artefact("cross"), probe=Probe(tick_um=5.0)))
    assert abs(late["EZ0A"] + late["dz_um"]) > 2.0


# --- the tick of a control


def test_the_tick_is_feed_times_servo_period() -> None:
    plan = tn.plan(LINUXCNC, feeds_mm_min=(600, 60), dither=False)
    data = tn.simulate(plan, LINUXCNC, {"EZ0A": 33.3})
    assert plan.start_mm is not None
    way = np.linalg.norm(data.position_mm - plan.start_mm, axis=1) * 1e3
    tick = np.where(np.asarray(plan.feed_mm_min) == 600, 10.0, 1.0)
    assert np.abs(way / tick - np.round(way / tick)).max() < 1e-6
    assert np.abs(way[tick == 1.0] / 10 - np.round(way[tick == 1.0] / 10)).max() > 0.05
    fit = tn.identify(data, LINUXCNC)
    assert abs(fit["EZ0A"] - 33.3) < 4 * fit.std_errors["EZ0A"]
    assert fit.sigma_um >= np.sqrt((100 + 1) / 24) - 1e-12


def test_casadi_takes_off_the_same_half_tick() -> None:
    plan = tn.plan(LINUXCNC, feeds_mm_min=(600, 60))
    data = tn.simulate(plan, LINUXCNC, {"EZ0A": 33.3}, noise_um=1.0, seed=2)
    fit, base = tn.identify(data, LINUXCNC), tn.casadi_baseline.identify(data, LINUXCNC)
    for name, value in fit.errors.items():
        assert base[name] == pytest.approx(value, abs=1e-5), name
    assert base.sigma_um == pytest.approx(fit.sigma_um)


def test_a_period_needs_feeds_and_stands_alone() -> None:
    data = tn.simulate(tn.plan(LINUXCNC), LINUXCNC)
    without = tn.Touches({k: v for k, v in data.columns.items() if k != "feed_mm_min"})
    for use in (tn.identify, tn.diagnose, tn.casadi_baseline.identify):
        with pytest.raises(tn.InputError, match="feed_mm_min"):
            use(without, LINUXCNC)
    with pytest.raises(tn.InputError, match="give one of the two"):
        Probe(tick_um=1.0, servo_period_ms=1.0)


def test_plans_start_at_many_phases_of_the_tick() -> None:
    even, dithered = tn.plan(LINUXCNC, dither=False), tn.plan(LINUXCNC)
    assert even.start_mm is not None
    assert dithered.start_mm is not None
    back = np.einsum("ij,ij->i", even.start_mm - dithered.start_mm, even.direction) * 1e3
    assert back.min() > -0.06  # commands are rounded to 0.1 µm
    assert back.max() < 10.06
    assert np.histogram(back, bins=4, range=(0, 10))[0].min() >= 9
    across = even.start_mm - dithered.start_mm - 1e-3 * back[:, None] * even.direction
    assert np.abs(across).max() < 1e-4
    assert np.array_equal(dithered.position_mm, even.position_mm)


# --- an identification and a diagnosis stand on it


def test_repeats_on_one_grid_are_not_independent() -> None:
    """Standard errors of three rounds of one plan are those of one, and true."""
    plan = tn.plan(LINUXCNC, repeats=3, dither=False)
    once = tn.plan(LINUXCNC, dither=False)
    z = []
    rng = np.random.default_rng(4)
    names = tn.identify(tn.simulate(once, LINUXCNC), LINUXCNC)
    for seed in range(40):
        errors = {n: rng.uniform(-25, 25) for n in names.errors}
        place = {n: rng.uniform(-300, 300) for n in names.placement or {}}
        fit = tn.identify(
            tn.simulate(plan, LINUXCNC, errors, place, noise_um=0.2, seed=seed), LINUXCNC
        )
        z += [(fit[n] - v) / fit.std_errors[n] for n, v in errors.items()]
    single = tn.identify(tn.simulate(once, LINUXCNC, errors, place), LINUXCNC)
    assert fit.std_errors["EX0C"] > 0.85 * single.std_errors["EX0C"]
    assert 0.75 < np.sqrt(np.mean(np.square(z))) < 1.25


def test_standard_errors_of_dithered_touches_are_neither_too_small_nor_too_large() -> None:
    """Two ticks in one plan: 320 errors of estimates over their standard errors."""
    rng, z = np.random.default_rng(5), []
    plan = tn.plan(LINUXCNC, feeds_mm_min=(600, 60))
    for seed in range(40):
        errors = {n: float(rng.uniform(-25, 25)) for n in ("EX0C", "EY0C", "EC0A", "EB0A")}
        place = {n: float(rng.uniform(-50, 50)) for n in ("dx_um", "dy_um", "dz_um")}
        made = tn.simulate(plan, LINUXCNC, errors, place, noise_um=0.1, seed=seed)
        fit = tn.identify(made, LINUXCNC)
        z += [(v - errors.get(n, 0.0)) / fit.std_errors[n] for n, v in fit.errors.items()]
    assert len(z) == 320
    assert 0.9 < np.sqrt(np.mean(np.square(z))) < 1.1


def test_no_cause_with_a_vanishing_error_from_few_distinct_values() -> None:
    """Readings of a gauge with three values, and a candidate for each pair of rows."""
    rng = np.random.default_rng(8)
    values = np.round(0.4 * rng.standard_normal(24))
    readings = Readings(values, np.arange(24))
    pairs = [
        linear(f"pair_{i}", ("um",), np.eye(24)[:, [i, i + 1]].sum(axis=1, keepdims=True))
        for i in range(0, 24, 2)
    ]
    model = LinearModel(None, readings, (Nuisance("mean", "µm"),), np.ones((24, 1)), effects=pairs)
    found = diagnose_model(model)
    assert found.sigma >= 1 / np.sqrt(12)
    for cause in found.causes:
        assert all(s >= 0.2 for s in cause.std_errors.values())


@pytest.mark.parametrize("ratio", [0.0, 0.03, 0.1])
def test_nothing_is_found_where_nothing_is(ratio: float) -> None:
    runs = needed_runs(0.95)
    seen = [ticks.run("paper", ratio, "no", seed=s) for s in range(1000, 1000 + runs)]
    assert kept(sum(r.verdict == "consistent" for r in seen), runs, 0.95)
    assert not any(r.outliers for r in seen)


def test_what_is_hidden_is_found_on_the_grid() -> None:
    runs = needed_runs(0.97)
    seen = [ticks.run("paper", 0.03, "yes", ticks.ANY, seed=s) for s in range(2000, 2000 + runs)]
    found = [any(r.hidden in a for a in r.alternatives) for r in seen]
    assert kept(sum(found), runs, 0.97)


def test_rows_that_were_pasted_twice_count_once() -> None:
    data = tn.read_touches(tn.sample_path("cross/touches.csv"))
    setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    once = tn.diagnose(data, setup)
    pasted = tn.Touches({k: np.concatenate([v, v]) for k, v in data.columns.items()})
    twice = tn.diagnose(pasted, setup)
    assert twice.verdict == once.verdict
    assert twice.errors_std == once.errors_std
    assert f"{len(data)} of {2 * len(data)} rows repeat others" in twice.summary()
    assert not once.notes


def test_a_regular_grid_of_places_is_no_step() -> None:
    x = np.linspace(90.0, 110.0, 60)
    length = np.hypot(x - 0.004, 0.007)  # exact: its values are as evenly spaced as the places
    zero = np.zeros(60)
    data = tn.Ballbar(setup=zero.astype(int), x_mm=x, y_mm=zero, length_mm=length)
    d = tn.diagnose(data)
    assert d.sigma < 0.1  # a step of the places would be 340 µm
    assert not d.notes


# --- readings that fit exactly


def whole(data: tn.Touches, step_um: float) -> tn.Touches:
    """Round coordinates as a display does."""
    step = step_um / 1e3
    x, y, z = (step * np.round(data.position_mm / step)).T
    return data.with_columns(x_mm=x, y_mm=y, z_mm=z)


@pytest.mark.parametrize("errors", [{"EX0C": 15.3}, {"EX0C": 15.3, "EA0A": 22.0, "EB0C": -31.0}])
def test_places_and_readings_on_one_grid_leave_no_vanishing_error(
    errors: dict[str, float],
) -> None:
    """Without noise the plain model fits such readings exactly: they may be off by half a step."""
    bare = Setup(Artefact("cross"), probe=Probe())
    data = whole(tn.simulate(tn.plan(bare), bare, errors), 10.0)
    for found in (tn.identify(data, bare), tn.closed_form(data, bare)):
        assert found.sigma_um >= 10.0 / np.sqrt(12.0) * (1 - 1e-9)
        assert found.std_errors["EX0C"] > 0.3
        assert any("recorded in steps of" in note for note in found.notes)
    d = tn.diagnose(data, bare)
    assert d.verdict == "consistent"
    assert d.errors_std["EX0C"] > 0.3
    assert any("recognised in the data" in note for note in d.notes)


def test_coordinates_are_in_steps_however_oblique_the_approach() -> None:
    """At every 30° of C an approach is along no axis; without errors rounding alone is seen."""
    bare = Setup(Artefact("cross"), probe=Probe())
    plan = tn.plan(bare, c_deg=range(0, 360, 30), dither=False)
    for step in (1.0, 10.0):
        d = tn.diagnose(whole(tn.simulate(plan, bare), step), bare)
        assert d.verdict == "consistent"
        assert any(f"in steps of {step:.0f} µm (recognised" in note for note in d.notes)


def test_places_of_a_plan_are_no_steps() -> None:
    bare = Setup(Artefact("cross"), probe=Probe())
    sound = tn.simulate(tn.plan(bare, dither=False), bare)
    assert not any("recorded in steps" in note for note in tn.identify(sound, bare).notes)
    assert not any("recorded in steps" in note for note in tn.diagnose(sound, bare).notes)
    exact = tn.simulate(tn.plan(bare, dither=False), bare, {"EX0C": 15.3172846})
    assert tn.identify(exact, bare).std_errors["EX0C"] < 0.05


def test_a_positioning_run_in_whole_micrometres_has_no_vanishing_error() -> None:
    """A scale error that makes exactly 1 µm between targets: no more is known than the digits."""
    at, zero = np.tile(np.arange(50.0, 601.0, 50.0), 2), np.zeros(24)
    way, runs = np.repeat([1, -1], 12), zero + 1
    run = tn.Positioning(target_mm=at, measured_mm=at + at / 5e4, direction=way, cycle=runs)
    d = tn.diagnose(run)
    assert d.sigma >= 1 / np.sqrt(12) * (1 - 1e-9)


@pytest.mark.parametrize("step_um", [1.0, 10.0])
def test_points_without_noise_are_known_to_their_digits_only(step_um: float) -> None:
    """A turned and shifted grid of points, rounded: what rounding makes is no cause."""
    along = np.arange(-150.0, 151.0, 50.0)
    x, y = (np.ravel(one) for one in np.meshgrid(along, along))
    rng, seen, runs = np.random.default_rng(29), [], needed_runs(0.95)
    for _ in range(runs):
        shift, turn = rng.uniform(-40, 40, 2), np.deg2rad(rng.uniform(-60, 60) / 3600)
        dx, dy = (
            rounded(d, step_um) for d in (shift[0] - 1e3 * turn * y, shift[1] + 1e3 * turn * x)
        )
        points = tn.Points(nominal_x_mm=x, nominal_y_mm=y, x_mm=x + 1e-3 * dx, y_mm=y + 1e-3 * dy)
        seen.append(tn.diagnose(points))
    assert kept(sum(d.verdict == "consistent" for d in seen), runs, 0.95)
    floor = step_um / np.sqrt(12) * (1 - 1e-9)
    assert kept(sum(d.sigma >= floor for d in seen), runs, 0.98)  # some are shifted, no more


def test_touches_at_two_feeds_have_two_steps() -> None:
    """The slow feed's repeats show the noise that the fast feed's steps hide."""
    feeds = replace(LINUXCNC, artefact=Artefact("cross"))
    plan = tn.plan(feeds, feeds_mm_min=(600, 60), repeats=2)
    runs = needed_runs(0.95)
    seen = [
        tn.diagnose(tn.simulate(plan, feeds, {"EX0C": 15.0}, noise_um=1.0, seed=s), feeds)
        for s in range(runs)
    ]
    assert kept(sum(d.verdict == "consistent" for d in seen), runs, 0.95)


@pytest.mark.parametrize("noise_um", [0.0, 0.1])
def test_a_ball_bar_in_whole_micrometres_is_consistent_on_a_sound_machine(noise_um: float) -> None:
    """Circles both ways about a centre that is tens of micrometres off, and nothing else."""
    rng, seen, runs = np.random.default_rng(31), [], needed_runs(0.95)
    turn = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    at = np.concatenate([turn, turn[::-1]])
    x, y, no = 100 * np.cos(at), 100 * np.sin(at), np.zeros(len(at), dtype=int)
    for _ in range(runs):
        u, v = rng.uniform(-0.03, 0.03, 2)
        length = np.hypot(x - u, y - v) + 1e-3 * noise_um * rng.standard_normal(len(x))
        data = tn.Ballbar(setup=no, x_mm=x, y_mm=y, length_mm=rounded(length, 1e-3))
        seen.append(tn.diagnose(data))
    assert kept(sum(d.verdict == "consistent" for d in seen), runs, 0.95)


@pytest.mark.parametrize("noise_um", [0.05, 0.1])
def test_repeats_of_a_positioning_run_on_one_grid_leave_nothing_unexplained(
    noise_um: float,
) -> None:
    """Five cycles in whole micrometres, with a reversal and a scale error: rounding repeats."""
    once = np.linspace(0, 500, 11)
    at, way = np.tile(np.r_[once, once[::-1]], 5), np.tile(np.repeat([1, -1], 11), 5)
    rng, seen, runs = np.random.default_rng(37), [], needed_runs(0.95)
    for _ in range(runs):
        off = rng.uniform(2, 9) * (way > 0) + rng.uniform(-1e-2, 1e-2) * at
        read = rounded(off + noise_um * rng.standard_normal(len(at)), 1.0)
        data = tn.Positioning(
            target_mm=at,
            measured_mm=at + 1e-3 * read,
            direction=way,
            cycle=np.repeat(range(1, 6), 22),
        )
        seen.append(tn.diagnose(data))
    assert kept(sum(d.unexplained is None for d in seen), runs, 0.95)
