"""No generated move enters an obstacle, wherever within its tolerance the artefact stands."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import trunnion as tn
import trunnion._core as _core
from sweep_moves import Draw, Scene, highest_when_turning, swept, twin_of
from trunnion.machine.chain import Chain, standing_artefact
from twin import forward

SPHERE = tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(0.0, 0.0, 60.0))
CROSS = tn.Setup(artefact=tn.Artefact("cross"))


def random_setup(rng: np.random.Generator) -> tn.Setup:
    """A machine, an artefact somewhere on its table, a probe and a clearance from 2 mm."""
    preset = str(rng.choice(["trt-ca", "trt-bc"]))
    tilting = "A" if preset == "trt-ca" else "B"
    x, y, z = rng.uniform(-60, 60, 3)
    clearance = float(rng.uniform(2.0, 8.0))
    tolerance = float(rng.uniform(0.0, 0.6) * clearance)
    standing: dict[str, Any] = {
        "place_mm": (*rng.uniform(-40, 40, 2), float(rng.choice([0.0, rng.uniform(0, 30)]))),
        "turn_deg": float(rng.choice([0.0, 90.0, rng.uniform(-180, 180)])),
        "tolerance_mm": tolerance,
        "tolerance_deg": float(rng.uniform(0.0, 0.8)),
    }
    kind = str(rng.choice(["cross", "cuboid", "sphere", "spheres", "ring"]))
    if rng.uniform() < 0.2:
        standing["base_mm"] = (*rng.uniform(20, 120, 2), float(rng.uniform(5, 25)))
    size: dict[str, Any]
    if kind == "ring":
        bore = float(rng.uniform(25, 80))
        size = {"diameter_mm": bore, "outer_diameter_mm": bore + float(rng.uniform(10, 30))}
        size["height_mm"] = float(rng.uniform(12, 30))
    elif kind == "spheres":
        along = np.cumsum(rng.uniform(35, 60, int(rng.integers(2, 5))))
        size = {"diameter_mm": float(rng.uniform(15, 25))}
        size["spheres_mm"] = [(x, *rng.uniform(-8, 8, 1), rng.uniform(40, 70)) for x in along - 80]
    elif kind == "sphere":
        centre = (*rng.uniform(-20, 20, 2), float(rng.uniform(40, 100)))
        size = {"diameter_mm": float(rng.uniform(15, 40)), "centre_mm": centre}
        if rng.uniform() < 0.3:
            size["stem_diameter_mm"] = float(rng.uniform(0, 14))
    else:
        length, width, height = rng.uniform(80, 160), rng.uniform(20, 60), rng.uniform(20, 60)
        size = {"length_mm": length, "width_mm": width, "height_mm": height}
    ball = float(rng.uniform(0.5, 3.0))
    known = {"EZ0A" if tilting == "A" else "EZ0B": float(rng.uniform(-900, 900))}
    return tn.Setup(
        artefact=tn.Artefact(kind, **size, **standing),
        machine=tn.Machine(preset, known if rng.uniform() < 0.5 else {}),
        axes={tilting: tn.AxisSetup(int(rng.choice([-1, 1])), (x, y, z))},
        probe=tn.Probe(ball, length_mm=150.0, stem_radius_mm=float(rng.uniform(0.3, 0.9)) * ball),
        table=tn.TableSetup(float(rng.uniform(60, 160)), float(rng.uniform(10, 40))),
        plan=tn.PlanSetup(clearance_mm=clearance, overtravel_mm=clearance + 2.0),
    )


def random_plan(setup: tn.Setup, rng: np.random.Generator) -> tn.Touches | None:
    """A plan of random positions; None where a clearance is refused or nothing can be reached."""
    letter = next(iter(setup.axes)).lower()
    tilt = rng.choice([-90.0, -60.0, 35.0, 90.0, rng.uniform(-110, 110)], 2, replace=False)
    try:
        return tn.plan(
            setup,
            c_deg=rng.uniform(0, 360, 2).tolist(),
            **{f"{letter}_deg": tilt.tolist()},
            positions_deg=[(float(rng.uniform(-100, 100)), float(rng.uniform(0, 360)))],
            all_faces=bool(rng.uniform() < 0.5),
        )
    except tn.TrunnionError as error:
        if not any(word in str(error) for word in ("plan.clearance_mm: got", "no face of the art")):
            raise
    return None


def sweep(count: int, seed: int) -> tuple[int, int]:
    """Sweep the programs of random machines; return how many had one, and their touches."""
    rng = np.random.default_rng(seed)
    machines, touches = 0, 0
    for _ in range(count):
        setup = random_setup(rng)
        plan = random_plan(setup, rng)
        if plan is None:
            continue
        program = tn.probing_program(plan, setup)
        scene = Scene(setup, Draw.within(setup.artefact, rng))
        swept(program, plan, setup, scene)
        highest = highest_when_turning(setup, scene, rng)
        assert highest < program.cycle.swing - setup.probe.ball_radius_mm
        machines, touches = machines + 1, touches + len(plan)
    return machines, touches


@pytest.mark.parametrize("seed", range(4))
def test_no_move_of_any_program_enters_an_obstacle(seed: int) -> None:
    _, touches = sweep(8, seed)
    assert touches > 50


@pytest.mark.power
def test_no_move_on_five_hundred_machines_enters_an_obstacle() -> None:
    machines, touches = sweep(700, 100)
    print(f"{machines} machines with a program, {touches} touches")
    assert machines >= 500
    assert touches > 20_000


def test_a_sphere_is_never_probed_through_its_stem() -> None:
    """With no stem the pole is touched from below; with one nothing near it is."""
    on_stem = tn.Setup(artefact=SPHERE, probe=tn.Probe(3.0))
    bare = replace(on_stem, artefact=replace(SPHERE, stem_diameter_mm=0.0))
    lowest = {}
    for name, setup in (("stem", on_stem), ("bare", bare)):
        plan = tn.plan(setup, a_deg=(90, -90, 60))
        rotation, shift = _table_poses(plan, setup)
        centre = np.einsum("nji,nj->ni", rotation, plan.position_mm - shift)
        lowest[name] = float((centre - [0.0, 0.0, 60.0])[:, 2].min())
    assert lowest["bare"] == pytest.approx(-15.5, abs=1e-3)
    assert lowest["stem"] > -1.0


def _table_poses(plan: tn.Touches, setup: tn.Setup) -> tuple[np.ndarray, np.ndarray]:
    a, c = (np.asarray(angle) for angle in plan.rotary_deg.values())
    poses = forward.table_pose(a, c, twin_of(setup), forward.Truth())
    return poses[:, :3, :3], poses[:, :3, 3]


@pytest.mark.parametrize(
    ("key", "plan", "artefact"),
    [
        ("plan.clearance_mm: got 2", {"clearance_mm": 2.0}, {}),
        ("plan.overtravel_mm: got 1", {"overtravel_mm": 1.0}, {}),
        ("plan.clearance_mm: got 5", {}, {"tolerance_mm": 4.5}),
        ("plan.clearance_mm: got 5", {}, {"tolerance_deg": 10.0}),
    ],
)
def test_a_clearance_within_the_tolerance_is_refused_with_what_would_do(
    key: str, plan: dict[str, float], artefact: dict[str, float]
) -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross", **artefact), plan=tn.PlanSetup(**plan))  # type: ignore[arg-type]
    with pytest.raises(tn.InputError, match=key + r".*expected more than .*tolerance_mm"):
        tn.plan(setup)


def test_a_small_clearance_will_do_for_an_artefact_that_is_placed_well() -> None:
    artefact = tn.Artefact("cross", tolerance_mm=0.5, tolerance_deg=0.3)
    setup = tn.Setup(artefact=artefact, plan=tn.PlanSetup(clearance_mm=2.0))
    assert len(tn.plan(setup)) == 72


def test_a_program_of_a_plan_that_does_not_fit_the_set_up_is_refused() -> None:
    """Another tolerance, place or stem than the plan was made for; a touch of the user's own."""
    plan = tn.plan(CROSS)
    loose = replace(CROSS, artefact=replace(CROSS.artefact, tolerance_mm=4.9))
    with pytest.raises(tn.DataError, match=r"within 4\.9 mm and 1 deg .* number 1, 2, .* more;"):
        tn.probing_program(plan, loose)
    moved = replace(CROSS, artefact=replace(CROSS.artefact, place_mm=(0.0, 12.0, 0.0)))
    with pytest.raises(tn.DataError, match="run into something or find nothing"):
        tn.probing_program(plan, moved)
    bare = tn.Setup(artefact=replace(SPHERE, stem_diameter_mm=0.0))
    through_the_stem = tn.plan(bare, c_deg=(), a_deg=(90,))
    tn.probing_program(through_the_stem, bare)
    with pytest.raises(tn.DataError, match=r"number \d;"):
        tn.probing_program(through_the_stem, replace(bare, artefact=SPHERE))


def test_a_sweep_beyond_the_tolerance_finds_the_collision() -> None:
    """The sweep of these tests is not blind."""
    rng = np.random.default_rng(1)
    plan = tn.plan(CROSS)
    program = tn.probing_program(plan, CROSS)
    far = Draw(np.array([6.5, 0.0, 0.0]), 0.0)
    with pytest.raises(AssertionError):
        swept(program, plan, CROSS, Scene(CROSS, far))
    swept(program, plan, CROSS, Scene(CROSS, Draw.within(CROSS.artefact, rng)))


def test_a_plan_says_what_it_assumes_and_what_it_cannot_tell() -> None:
    sphere = tn.Setup(artefact=SPHERE, probe=tn.Probe(3.0))
    notes = tn.plan_notes(tn.plan(sphere), sphere)
    assert "within 2 mm and 1 deg" in notes[0]
    assert "a table of radius 150 mm and thickness 30 mm is assumed" in notes[1]
    assert "on a stem of 8.33 mm" in notes[2]
    assert notes[3].startswith("These touches cannot tell EA0A, EB0C, EX0C, EY0C.")
    assert "EA0A (+1 arcsec) together with EY0C" in notes[3]
    head = tn.probing_program(tn.plan(sphere), sphere).text()
    assert all(f"({note})" in head for note in notes[:3])
    stated = replace(CROSS, table=tn.TableSetup(150.0, 30.0))
    assert len(tn.plan_notes(tn.plan(stated), stated)) == 1


def test_a_table_without_size_is_refused_not_a_panic() -> None:
    for radius, thickness in ((-1.0, 30.0), (150.0, -30.0), (float("nan"), 30.0)):
        with pytest.raises(tn.InputError, match=r"of the table in mm|table_(radius|thickness)_mm"):
            _core.Arrangement(
                Chain(CROSS).machine(),
                standing_artefact(CROSS),
                ball_radius_mm=1.0,
                stem_radius_mm=0.5,
                stem_length_mm=100.0,
                table_radius_mm=radius,
                table_thickness_mm=thickness,
                clearance_mm=5.0,
                overtravel_mm=5.0,
            )
