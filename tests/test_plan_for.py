"""Plans made for given errors: they identify them, within the limits, better than other plans."""

import re
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import trunnion as tn
from trunnion.base.units import Floats
from trunnion.cli import app
from trunnion.machine.chain import Chain
from trunnion.probing.design import candidates
from trunnion.probing.model import TouchModel

CROSS = tn.Setup(artefact=tn.Artefact("cross"))
SPHERE = tn.Setup(artefact=tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(60.0, 0.0, 80.0)))
ALL = ("EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EB0C", "EX0C", "EY0C")


def cost(plan: tn.Touches, setup: tn.Setup, names: tuple[str, ...]) -> float:
    """Sum of the variances at 1 µm a reading: the trace of the inverse of the information."""
    return float(np.trace(covariance(plan, setup, names)))


def covariance(plan: tn.Touches, setup: tn.Setup, names: tuple[str, ...]) -> Floats:
    model = TouchModel(setup)
    rows = model.core.linearise(model.moves(plan), model.values())[1]
    used = [n for n in model.names if setup.artefact.kind != "sphere" or n[0] != "r"]
    rows = rows[:, [model.names.index(n) for n in used]]
    information = rows.T @ rows + 1e-8 * np.eye(len(used))  # 1e8 where nothing is known
    at = [used.index(n) for n in names]
    return np.asarray(np.linalg.inv(information)[np.ix_(at, at)])


def minutes(plan: tn.Touches, setup: tn.Setup) -> float:
    return tn.probing_program(plan, setup).seconds / 60


@pytest.mark.parametrize("setup", [CROSS, SPHERE], ids=["cross", "sphere"])
@pytest.mark.parametrize("names", [ALL, ("EA0A", "EB0C"), ("EX0C",)])
def test_a_plan_for_errors_needs_less_time_than_the_papers(
    setup: tn.Setup, names: tuple[str, ...]
) -> None:
    """Variances times minutes: what a repetition of the plan costs for the same uncertainty."""
    usual, made = tn.plan(setup), tn.plan_for(setup, names)
    assert np.isfinite(cost(made, setup, names))
    assert cost(made, setup, names) * minutes(made, setup) < cost(usual, setup, names) * minutes(
        usual, setup
    )


@pytest.mark.parametrize("setup", [CROSS, SPHERE], ids=["cross", "sphere"])
def test_limits_hold_and_more_time_is_used(setup: tn.Setup) -> None:
    usual = tn.plan(setup)
    same = tn.plan_for(setup, ALL, max_minutes=minutes(usual, setup))
    assert minutes(same, setup) <= minutes(usual, setup)
    assert cost(same, setup, ALL) < cost(usual, setup, ALL)
    short = tn.plan_for(setup, ALL, max_touches=24)
    assert len(short) == 24
    rng = np.random.default_rng(1)
    pool = candidates(setup)
    drawn = [pool[np.sort(rng.permutation(len(pool))[:24])] for _ in range(50)]
    assert cost(short, setup, ALL) < min(cost(plan, setup, ALL) for plan in drawn)


def test_few_touches_are_nearly_the_best_of_all_there_are() -> None:
    """Every choice of four touches of a sphere at half a turn of C, tried."""
    ends = {"C": tn.AxisSetup(range_deg=(-6.0, 181.0)), "A": tn.AxisSetup(range_deg=(-1.0, 1.0))}
    setup = tn.Setup(artefact=SPHERE.artefact, axes=ends)
    pool = candidates(setup)
    pool = pool[np.abs(pool.dir_z) < 0.5]  # those along Z say nothing of EX0C
    made = cost(tn.plan_for(setup, ("EX0C",), max_touches=4), setup, ("EX0C",))
    model = TouchModel(setup)
    rows = model.core.linearise(model.moves(pool), model.values())[1]
    column = model.names.index("EX0C")
    found = np.inf
    for four in combinations(range(len(pool)), 4):
        # EX0C from four readings beside dx, dy and dz: exact, where they identify it.
        own = rows[list(four)]
        others = np.delete(own, column, axis=1)
        left = own[:, column] - others @ np.linalg.lstsq(others, own[:, column], rcond=1e-9)[0]
        size = float(left @ left)
        found = min(found, 1.0 / size) if size > 1e-9 else found
    assert made <= found * 1.0001


@pytest.mark.parametrize("most", [6, 9, 16])
def test_a_few_touches_of_a_cross_will_do_for_one_error(most: int) -> None:
    made = tn.plan_for(CROSS, ("EX0C",), max_touches=most)
    assert len(made) == most
    assert cost(made, CROSS, ("EX0C",)) < 10.0


def test_a_determinant_is_smaller_where_it_is_asked_for() -> None:
    a = tn.plan_for(SPHERE, ALL, max_touches=20)
    d = tn.plan_for(SPHERE, ALL, max_touches=20, criterion="D")
    volumes = [float(np.linalg.slogdet(covariance(plan, SPHERE, ALL))[1]) for plan in (a, d)]
    assert volumes[1] < volumes[0]
    assert cost(d, SPHERE, ALL) > cost(a, SPHERE, ALL)


def test_what_a_plan_lacks_is_found_by_trying() -> None:
    flat = tn.plan(CROSS, a_deg=())
    seen = tn.observability(flat, CROSS)
    assert seen.missing_positions == (
        "This plan does not identify EB0A, EC0A, EY0A, EZ0A: add A = ±60°.",
    )
    assert seen.missing_positions[0] in seen.summary()
    assert tn.observability(tn.plan(CROSS, a_deg=(60, -60)), CROSS).missing_positions == ()
    # Within a range that ends at ±50° another position is named.
    short = tn.Setup(artefact=CROSS.artefact, axes={"A": tn.AxisSetup(range_deg=(-50.0, 50.0))})
    (said,) = tn.observability(tn.plan(short, a_deg=()), short).missing_positions
    assert "add A = ±30°" in said
    # A trunnion that tilts to one side: that side.
    one_side = tn.Setup(artefact=CROSS.artefact, axes={"A": tn.AxisSetup(range_deg=(-120.0, 5.0))})
    (said,) = tn.observability(tn.plan(one_side, a_deg=()), one_side).missing_positions
    assert said == "This plan does not identify EB0A, EC0A, EY0A, EZ0A: add A = -60°."
    # No position helps an artefact that cannot tell: EC0A of a sphere on the axes' intersection.
    centre = tn.Setup(artefact=tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(0.0, 0.0, 60.0)))
    (said,) = tn.observability(tn.plan(centre), centre).missing_positions
    assert "EB0C" in said
    with pytest.raises(tn.DataError, match=r"errors: got EB0C"):
        tn.plan_for(centre, ("EB0C",))


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize(
    "preset", ["trt-ca", "trt-bc", "tt-ab", "nutating-table", "head-b-table-c"]
)
def test_what_is_said_of_any_tilting_axis_is_so(preset: str, sense: int) -> None:
    """The sentence names the axis, and touches with it identify what it says, and no less."""
    machine = tn.Machine(preset=preset)
    axes = {x: tn.AxisSetup(sense=sense) for x in machine.description().core(150.0).letters}
    setup = tn.Setup(artefact=CROSS.artefact, machine=machine, axes=axes)
    tilting = Chain(setup).tilting
    assert tilting is not None
    key = f"{tilting.lower()}_deg"
    level: dict[str, Any] = {key: ()}
    seen = tn.observability(tn.plan(setup, **level), setup)
    (said,) = seen.missing_positions
    words = (
        r"This plan does not identify ([\w, ]+): add (\w) = (.+)°(?:, which leaves ([\w, ]+))?\."
    )
    found = re.fullmatch(words, said)
    assert found is not None, said
    assert found[2] == tilting
    text, left = found[3], found[4]
    tilts = [float(text[1:]), -float(text[1:])] if text[0] == "±" else map(float, text.split(", "))
    more: dict[str, Any] = {key: list(tilts), "all_faces": True}
    then = tn.observability(tn.plan(setup, **more), setup)
    blind = [name for name in Chain(setup).location_errors if np.isinf(then.std_errors[name])]
    assert sorted(blind) == sorted(left.split(", ") if left else [])
    assert set(blind) < set(found[1].split(", "))


def test_the_rotation_of_a_sphere_is_no_unknown() -> None:
    seen = tn.observability(tn.plan(SPHERE), SPHERE)
    assert seen.not_identifiable == ()
    assert not {"ra_arcsec", "rb_arcsec", "rc_arcsec"} & set(seen.names)
    fit = tn.identify(tn.simulate(tn.plan(SPHERE), SPHERE, {"EX0C": 15.0}), SPHERE)
    assert fit.not_identifiable == ()
    assert fit["EX0C"] == pytest.approx(15.0, abs=1e-6)
    assert np.isfinite(fit.std_errors["dx_um"])
    assert fit.degrees_of_freedom == len(tn.plan(SPHERE)) - 11


def test_three_positions_of_each_axis_do_what_the_cycles_of_controls_do() -> None:
    """A sphere on the table off the axes: all eight errors, in less time than the cross takes."""
    plan = tn.plan_by_axis(SPHERE)
    assert len({(a, c) for a, c in zip(plan.a_deg, plan.c_deg, strict=True)}) == 5  # type: ignore[arg-type]
    assert tn.observability(plan, SPHERE).not_identifiable == ()
    assert minutes(plan, SPHERE) < minutes(tn.plan(CROSS), CROSS)
    with pytest.raises(tn.InputError, match="positions"):
        tn.plan_by_axis(SPHERE, 1)


def test_wrong_requests_are_refused() -> None:
    with pytest.raises(tn.InputError, match="errors: got none"):
        tn.plan_for(CROSS, ())
    with pytest.raises(tn.UnknownNameError, match="EB0B"):
        tn.plan_for(CROSS, ("EB0B",))
    with pytest.raises(tn.InputError, match="max_touches"):
        tn.plan_for(CROSS, ALL, max_touches=5)


def test_the_command_makes_one_and_warns(tmp_path: Path) -> None:
    file, out = tmp_path / "setup.toml", tmp_path / "plan.csv"
    file.write_text('[artefact]\nkind = "cross"\n')
    arguments = ["plan", str(file), "--for", "EA0A,EB0C", "--max-minutes", "2", "-o", str(out)]
    ran = CliRunner().invoke(app, arguments)
    assert ran.exit_code == 0, ran.output
    assert minutes(tn.read_touches(out), tn.read_setup(file)) <= 2
    ran = CliRunner().invoke(app, ["plan", str(file), "--tilt", "0"])
    assert "does not identify EB0A, EC0A, EY0A, EZ0A: add A" in ran.stderr
