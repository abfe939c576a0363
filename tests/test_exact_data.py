"""Data without any noise get the set that made them, in whatever number and size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import axis_log_twin
import ballbar_study
import from_twin
import trunnion as tn
import turning_blind
from positioning_twin import HIDDEN, axis
from power import ticks
from power.measured_twin import (
    POINT_EFFECTS,
    SPACE_EFFECTS,
    SWEEP_EFFECTS,
    make_points,
    make_sweep,
)
from power.study import draw_effects, ground
from trunnion import contouring as ct
from trunnion.files.table import Table
from trunnion.models.kinds import diagnose
from trunnion.setup import Artefact, Setup
from twin.forward import LOCATION_ERRORS, PLACEMENT, Truth
from twin.generator import measure, random_errors, random_placement


def exact(plan: str, seed: int) -> tuple[tn.Diagnosis, frozenset[str]]:
    """Diagnose touches of the independent generator without noise or ticks; what is hidden."""
    rng = np.random.default_rng([5, seed, *plan.encode()])
    made, twin, _, read = ground(plan)
    while True:
        hidden = draw_effects(rng, plan, 1 + seed % 3, 1.0)
        # What is always fitted absorbs a part of a sag, which comes back in second order.
        if "a_sag" not in hidden:
            break
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=hidden)
    m = measure(made, twin, truth, noise_um=0.0, tick_um=0.0, seed=seed)
    setup = replace(read, probe=replace(read.probe, tick_um=0.0))
    return tn.diagnose(tn.Touches(m.columns), setup), frozenset(hidden)


@pytest.mark.parametrize("seed", range(9))
def test_a_rich_plan_gets_the_right_set(seed: int) -> None:
    d, hidden = exact("rich", seed)
    assert (d.verdict, d.named) == ("explained", hidden)
    assert d.gain.rms_after_um < 1e-6
    assert not d.outliers


@pytest.mark.parametrize("plan", ["rich", "paper"])
def test_exact_touches_of_a_machine_without_causes_say_so(plan: str) -> None:
    """What is left of them is the rounding of the arithmetic, which no test may judge."""
    rng = np.random.default_rng([6, *plan.encode()])
    made, twin, _, read = ground(plan)
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects={})
    m = measure(made, twin, truth, noise_um=0.0, tick_um=0.0, seed=1)
    setup = replace(read, probe=replace(read.probe, tick_um=0.0))
    d = tn.diagnose(tn.Touches(m.columns), setup)
    assert (d.verdict, d.p_value, d.none_probability) == ("consistent", 1.0, 1.0)


@pytest.mark.parametrize("seed", range(9))
def test_a_short_plan_gets_the_sets_that_fit_exactly(seed: int) -> None:
    """The paper's plan does not distinguish a ball radius from a delay: every set fits exactly."""
    d, hidden = exact("paper", seed)
    assert d.verdict in ("explained", "ambiguous")
    assert hidden in d.alternatives
    assert not d.outliers
    assert all(len(a) <= len(hidden) for a in d.alternatives)
    for one in d.alternatives:
        fit = tn.identify(d.data, d.setup, effects=tuple(sorted(one)))
        assert fit.rms_um < 1e-6


Exact = tuple[Table, Setup | None, frozenset[str]]


def points(hidden: tuple[str, ...], seed: int) -> Exact:
    space = not set(hidden) <= set(POINT_EFFECTS)
    made = make_points(seed, hidden, 2e9, noise_um=1e-9, space=space)
    return tn.Points(**made.columns), None, made.hidden


def sweep(hidden: tuple[str, ...], seed: int) -> Exact:
    made = make_sweep(seed, hidden, 2e9, noise_um=1e-9)
    return tn.Sweep(**made.columns), None, made.hidden


def positioning(hidden: tuple[str, ...], seed: int) -> Exact:
    rng = np.random.default_rng([8, seed])
    data = axis(rng, noise=0.0)
    change = sum((HIDDEN[name](data, rng) for name in hidden), np.zeros(len(data)))
    return data.with_columns(measured_mm=data.measured + 1e-3 * change), None, frozenset(hidden)


def diameters(hidden: tuple[str, ...], seed: int) -> Exact:
    return *turning_blind.measured(seed, hidden, 3, exact=True), frozenset(hidden)


def ballbar(hidden: tuple[str, ...], seed: int) -> Exact:
    data, names = ballbar_study.cartesian_cases(hidden, seed, sigma_um=0.0)
    return data, None, frozenset(n for n in names if n)


def hybrid(hidden: tuple[str, ...], seed: int) -> Exact:
    one = hidden[0] if hidden else None
    data, _ = ballbar_study.hybrid_case(one, seed, sigma_um=0.0)
    return data, None, frozenset(hidden)


def axis_log(hidden: tuple[str, ...], seed: int) -> Exact:
    rng = np.random.default_rng([8, seed])
    cases = axis_log_twin.Cases(1)
    names = [axis_log_twin.put(cases, 0, kind, rng) for kind in hidden]
    commands = [axis_log_twin.commanded(feed / 60) for feed in (1000, 3000)]
    actual = [axis_log_twin.actual(c, cases)[0] for c in commands]
    log = axis_log_twin.log(commands, actual, rng, noise_um=0.0, noise_arcsec=0.0)
    setup = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
    return log, setup, frozenset(n for n in names if n)


# In one cycle a drift looks like backlash that depends on position, and exact cycles are copies.
UNLIKE_OTHERS = ("scale", "reversal", "cycle_drift", "drift", "warmup")
OF_KINDS: dict[Callable[[tuple[str, ...], int], Exact], tuple[str, ...]] = {
    points: tuple(n for n in POINT_EFFECTS + SPACE_EFFECTS if n != "field"),
    sweep: SWEEP_EFFECTS,
    positioning: UNLIKE_OTHERS,
    diameters: tuple(turning_blind.LAWS),
    ballbar: ballbar_study.CARTESIAN,
    # its generator moves a leg at the reading of its reversal to one side, drawn by lot
    hybrid: tuple(n for n in ballbar_study.HYBRID if n != "lost_motion"),
    axis_log: axis_log_twin.KINDS[1:],
}
CASES = [(make, name) for make, names in OF_KINDS.items() for name in ("", *names)]


def squarenesses(hidden: frozenset[str]) -> set[str]:
    """What counts curves from another line: one about a line through other places is tilted."""
    curved = any(name.startswith(("straightness", "angular")) for name in hidden)
    return {"squareness_xy", "squareness_xz", "squareness_yz"} if curved else set()


@pytest.mark.parametrize(("make", "name"), CASES, ids=[f"{m.__name__}-{n}" for m, n in CASES])
def test_exact_data_of_each_kind_get_the_right_set(
    make: Callable[[tuple[str, ...], int], Exact], name: str
) -> None:
    data, setup, hidden = make((name,) if name else (), 70 + len(name))
    d = diagnose(data, setup)
    assert d.verdict == ("explained" if hidden else "consistent")
    assert hidden <= d.named <= hidden | squarenesses(hidden)
    assert not d.outliers


@pytest.mark.parametrize("make", [sweep, positioning, ballbar])
@pytest.mark.parametrize("seed", range(4))
def test_exact_data_with_several_causes_get_them(
    make: Callable[[tuple[str, ...], int], Exact], seed: int
) -> None:
    rng = np.random.default_rng([9, seed])
    names = [n for n in OF_KINDS[make] if not n.startswith(("warmup", "cycle"))]
    some = tuple(map(str, rng.choice(names, 2 + seed % 2, replace=False)))
    data, setup, hidden = make(some, 80 + seed)
    d = diagnose(data, setup)
    assert (d.verdict, d.named) == ("explained", hidden)
    assert not d.outliers


@pytest.mark.parametrize(
    ("make", "name"),
    [(points, "scale_x"), (sweep, "radial_2"), (positioning, "scale"), (ballbar, "backlash")],
)
def test_rows_pasted_twice_are_said(
    make: Callable[[tuple[str, ...], int], Exact], name: str
) -> None:
    data, _, hidden = make((name,), 80)
    twice = type(data)({name: np.concatenate([v, v]) for name, v in data.columns.items()})
    d = diagnose(twice)
    assert f"{len(data)} of {2 * len(data)} rows repeat others" in d.notes[0]
    assert d.named == hidden


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_exact_data_beside_others_keep_their_cause(noise: float) -> None:
    """A measurement without noise does not silence one that has some."""
    rng = np.random.default_rng([10, round(10 * noise)])
    exact_x, other_y = axis(rng, noise=0.0), axis(rng, noise=noise)
    x = exact_x.with_columns(
        measured_mm=exact_x.measured + 20e-6 * exact_x.target, axis=["X"] * len(exact_x)
    )
    y = other_y.with_columns(
        measured_mm=other_y.measured - 1e-3 * other_y.direction, axis=["Y"] * len(other_y)
    )
    d = diagnose([x, y])
    assert d.alternatives
    assert all({"scale_x", "backlash_y"} <= one for one in d.alternatives)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("shape", ["once a turn", "bump"])
def test_causes_that_fit_exactly_only_because_they_are_many_are_not_named(
    shape: str, seed: int
) -> None:
    """Exact readings with an error that is no cause: seven causes reproduce them at four angles."""
    setup = tn.Setup(tn.Artefact("cross"))
    plan = tn.plan(setup)
    rng = np.random.default_rng([21, seed])
    errors = {name: float(rng.uniform(-30, 30)) for name in ("EA0A", "EC0A", "EX0C", "EY0C")}
    data = tn.simulate(plan, setup, errors=errors, seed=seed)
    assert data.c_deg is not None
    turn = np.radians(data.c_deg)
    size = 1e-3 * rng.uniform(2, 6)
    error = {
        "once a turn": np.cos(turn + rng.uniform(0, 2 * np.pi)),
        "bump": np.exp(-(((data.c_deg - 180) / 40) ** 2)),
    }[shape]
    found = tn.diagnose(data.with_columns(x_mm=data.x_mm + size * error), setup)
    for cause in found.causes:
        for name, value in cause.parameters.items():
            assert cause.std_errors[name] > 1e-4 * abs(value), cause.id
    for name, std in found.errors_std.items():
        assert abs(found.errors_after[name] - errors.get(name, 0.0)) < 5 * std, name


@pytest.mark.parametrize("read", ["no", "commanded", "rounded"])
@pytest.mark.parametrize("plan", ticks.PLANS)
def test_a_machine_without_errors_on_a_grid_has_no_cause(plan: str, read: str) -> None:
    """Its contacts are just at looks of the control, or its coordinates just between two steps."""
    touched, setup, _, _ = ticks.ground(plan)
    truth = Truth(dict.fromkeys(LOCATION_ERRORS[setup.preset], 0.0), dict.fromkeys(PLACEMENT, 0.0))
    for seed in range(2):
        rng = np.random.default_rng([17, seed])
        start = ticks.starts(touched, False, rng)
        if read == "commanded":  # starts that lie back by steps of commands, a tenth of a tick
            back = 1e-4 * rng.integers(0, 10, len(touched))
            start = start - back[:, None] * touched.conditions.direction
        if read == "rounded":
            positions = ticks.rounded(touched, setup, truth, 0.0, rng)
        else:
            positions = ticks.recorded(touched, setup, truth, 0.0, start, rng)
        stated = from_twin.setup(replace(setup, tick_um=0.0) if read == "rounded" else setup)
        found = diagnose(ticks.touches(touched, positions), stated)
        assert found.verdict == "consistent"
        assert found.none_probability > 0.99


def test_standard_errors_without_a_scatter_are_said_to_mean_nothing() -> None:
    """Of exact touches, and of as many as parameters; not where the repeatability is known."""
    setup = Setup(Artefact("cross"))
    truth = {"EX0C": 15.37, "EA0A": -12.113, "EB0C": 7.31, "EZ0A": 3.3}
    made = tn.simulate(tn.plan(setup), setup, truth)
    noisy = tn.simulate(tn.plan(setup), setup, truth, noise_um=0.5, seed=3)
    few = noisy[enough_rows(noisy, setup)]
    known = replace(setup, probe=replace(setup.probe, repeatability_um=0.5))
    for data, why in ((made, "touches fit exactly"), (few, "no more touches than parameters")):
        found = tn.identify(data, setup)
        assert max(found.std_errors.values()) < 1e-6
        assert why in found.notes[-1]
        assert "[probe] repeatability_um" in found.notes[-1]
        stated = tn.identify(data, known)
        assert stated.notes == ()
        assert min(stated.std_errors.values()) > 0.01
    assert "touches fit exactly" in tn.closed_form(made, setup).notes[-1]
    assert tn.identify(noisy, setup).notes == ()


def enough_rows(data: tn.Touches, setup: Setup) -> list[int]:
    """As many rows as there are parameters, by which all are identified: each raises the rank."""
    rows: list[int] = []
    for row in range(len(data)):
        seen = tn.observability(data[[*rows, row]], setup)
        if seen.rank > len(rows):
            rows.append(row)
    return rows
