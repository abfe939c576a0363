"""No generated move enters an obstacle, wherever within its tolerance the artefact stands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trunnion as tn
import trunnion._core as _core
from sweep_moves import (
    Draw,
    Scene,
    Twin,
    approaches_of,
    highest_when_turning,
    moves_of,
    rotary_of,
    swept,
)
from trunnion.machine.chain import Chain
from trunnion.probing.notes import assumptions
from trunnion.setup.holders import CHUCKS, PLATES, VISES
from trunnion.setup.machines import presets
from twin.machines import Layout

LENGTH_MM = 150.0
SPHERE = tn.Artefact("sphere", diameter_mm=25.0, centre_mm=(0.0, 0.0, 60.0))
CROSS = tn.Setup(artefact=tn.Artefact("cross"))


def random_machine(rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, tn.AxisSetup]]:
    """A preset, or a chain of at most two rotary axes anywhere, with axes off their usual lines."""
    if rng.uniform() < 0.6:
        names = [*presets(), "trt-ca", "trt-bc", "nutating-table", "tt-ab"]
        named: dict[str, Any] = {"preset": str(rng.choice(names))}
        oblique = 0.0
    else:
        letters = rng.permutation([*"ABC"])[: int(rng.choice([1, 2, 2, 2]))].tolist()
        linear = rng.permutation([*"XYZ"]).tolist()
        below, carried = (int(rng.integers(0, len(x) + 1)) for x in (letters, linear))
        table = [f"{axis}'" for axis in (*letters[:below], *linear[:carried])]
        named = {"chain": f"[w {' '.join([*table, 'b', *linear[carried:], *letters[below:]])} t]"}
        named["table_normal"] = (*rng.uniform(-0.2, 0.2, 2), 1.0)
        oblique = float(rng.choice([0.0, 0.2, 0.6]))
    axes = {}
    known = tn.Machine(**named).description()
    layout = Layout(known.chain, known.directions, known.points_mm, length=LENGTH_MM)
    for letter in layout.letters:
        direction, point = layout.line(letter)
        off = rng.uniform(-60, 60, 3)
        if letter in layout.side(True)[-1:]:
            off[2] = 0.0  # the pivot is the probe's length above the ball
        if letter in layout.side(False)[-1:]:
            off *= 0.0 if abs(direction @ known.table_normal) > 0.97 else 1.0  # it turns the table
        line: dict[str, Any] = {"point_mm": tuple(point + off)}
        if oblique:
            line["direction"] = tuple(direction + rng.uniform(-oblique, oblique, 3))
        axes[letter] = tn.AxisSetup(int(rng.choice([-1, 1])), **line)
    return named, axes


def random_setup(rng: np.random.Generator) -> tn.Setup:
    """A machine, an artefact somewhere on its table, a probe and a clearance from 2 mm."""
    named, axes = random_machine(rng)
    ball = float(rng.uniform(0.5, 3.0))
    clearance = float(rng.uniform(2.0, 8.0))
    body: dict[str, float] = {}
    if rng.uniform() < 0.4:
        body = {"stem_length_mm": float(rng.uniform(30, 100))}
        body["body_diameter_mm"] = float(rng.uniform(20, 60))
    stem = float(rng.uniform(0.3, 0.9)) * ball
    setup = tn.Setup(
        artefact=random_artefact(rng, clearance),
        machine=tn.Machine(**named),
        axes=axes,
        probe=tn.Probe(ball, length_mm=LENGTH_MM, stem_radius_mm=stem, **body),
        table=tn.TableSetup(float(rng.uniform(60, 160)), float(rng.uniform(10, 40))),
        plan=tn.PlanSetup(clearance_mm=clearance, overtravel_mm=clearance + 2.0),
    )
    if rng.uniform() < 0.5:
        return setup
    sizes = {"um": 900.0, "arcsec": 60.0}
    units = Chain(setup).location_errors.items()
    known = {name: float(rng.uniform(-1, 1) * sizes[unit]) for name, unit in units}
    return replace(setup, machine=replace(setup.machine, errors=known))


def random_holder(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    """A vise, a chuck or a plate: of a usual size, or with some dimensions stated."""
    name = str(rng.choice(["vise", "chuck", "plate"]))
    stated: dict[str, Any] = (
        {"height_mm": float(rng.uniform(100, 125))} if rng.uniform() < 0.5 else {}
    )
    if name == "plate":
        stated = {"height_mm": float(rng.uniform(5, 40)), "margin_mm": float(rng.uniform(1, 40))}
    else:
        stated["size"] = str(rng.choice(["80", "125", "160"] if name == "vise" else ["100", "200"]))
    if name == "vise" and "sphere" in kind:
        stated["opening_mm"] = float(rng.uniform(20, 60))
    held = {name: stated if len(stated) > 1 or "size" not in stated else stated["size"]}
    return {**held, "place_mm": (*rng.uniform(-20, 20, 2), 0.0)}


def random_artefact(rng: np.random.Generator, clearance: float) -> tn.Artefact:
    """An artefact on the table, known to stand there to within less than the clearance."""
    tolerance = float(rng.uniform(0.0, 0.6) * clearance)
    standing: dict[str, Any] = {
        "place_mm": (*rng.uniform(-40, 40, 2), float(rng.choice([0.0, rng.uniform(0, 30)]))),
        "turn_deg": float(rng.choice([0.0, 90.0, rng.uniform(-180, 180)])),
        "tolerance_mm": tolerance,
        "tolerance_deg": float(rng.uniform(0.0, 0.8)),
    }
    kind = str(rng.choice(["cross", "cuboid", "sphere", "spheres", "ring"]))
    if rng.uniform() < 0.4:
        standing |= random_holder(rng, kind)
    elif rng.uniform() < 0.2:
        standing["base_mm"] = (*rng.uniform(20, 120, 2), float(rng.uniform(5, 25)))
    if rng.uniform() < 0.3:
        jaws = rng.uniform([-90, 55, 15, 8, 10], [90, 75, 60, 25, 45], (2, 5))
        jaws[1, 1] *= -1.0
        standing["clamps_mm"] = jaws.tolist()
    if "chuck" not in standing and rng.uniform() < 0.2:
        standing["chuck_mm"] = (float(rng.uniform(20, 90)), float(rng.uniform(5, 25)))
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
    return tn.Artefact(kind, **size, **standing)


def random_plan(setup: tn.Setup, rng: np.random.Generator) -> tn.Touches | None:
    """A plan of random positions; None where a clearance is refused or nothing can be reached."""
    chain = Chain(setup)
    tilts = rng.choice([-90.0, -60.0, 35.0, 90.0, rng.uniform(-110, 110)], 2, replace=False)
    angles: dict[str, Any] = {}
    if chain.turning is not None:
        angles[f"{chain.turning.lower()}_deg"] = rng.uniform(0, 360, 2).tolist()
    if chain.tilting is not None:
        angles[f"{chain.tilting.lower()}_deg"] = (chain.level_deg + tilts).tolist()
        pair = (chain.level_deg + float(rng.uniform(-100, 100)), float(rng.uniform(0, 360)))
        angles["positions_deg"] = [pair] if chain.turning else []
    try:
        return tn.plan(setup, **angles, all_faces=bool(rng.uniform() < 0.5))
    except tn.TrunnionError as error:
        if not any(word in str(error) for word in ("plan.clearance_mm: got", "no face of the art")):
            raise
    return None


def swept_machine(rng: np.random.Generator) -> tuple[str, int]:
    """Sweep what is planned for a random machine; return its family and how many touches.

    A program of a machine without a rotary head with all its moves; of the others, for which none
    is made, the approaches and the ways down to them.
    """
    setup = random_setup(rng)
    plan = random_plan(setup, rng)
    sides = "".join(sorted({side[0] for side in Chain(setup).sides.values()}))
    family = f"{len(Chain(setup).letters)}{sides}"
    if plan is None:
        return family, 0
    scene, twin = Scene(setup, Draw.within(setup.artefact, rng)), Twin(setup)
    if "h" in sides:
        swept(approaches_of(plan, twin, setup.plan.overtravel_mm), setup, scene, twin)
        return family, len(plan)
    program = tn.probing_program(plan, setup)
    swept(moves_of(program, plan), setup, scene, twin)
    highest = highest_when_turning(setup, scene, twin, rng)
    assert highest < program.cycle.swing - setup.probe.ball_radius_mm
    return family, len(plan)


def sweep(count: int, seed: int) -> dict[str, list[int]]:
    """Sweep random machines; return the touches of each with a plan, by family."""
    found: dict[str, list[int]] = {}
    for number in range(count):
        try:
            family, touches = swept_machine(np.random.default_rng([seed, number]))
        except (AssertionError, tn.TrunnionError) as error:
            raise AssertionError(f"machine {number} of seed {seed}: {error}") from error
        found.setdefault(family, []).extend([touches] if touches else [])
    return found


FAMILIES = {"0", "1h", "1t", "2h", "2t", "2ht"}
"""How many rotary axes, in head or table."""


def test_no_move_of_any_program_enters_an_obstacle() -> None:
    touches = sweep(40, 0)
    assert {"2t", "2ht", "2h"} <= set(touches)
    assert sum(map(sum, touches.values())) > 500


def test_known_errors_of_a_head_take_the_ball_along() -> None:
    """A bore whose place is known to 2 µm, and a head that is off by 0.7 mm."""
    family, touches = swept_machine(np.random.default_rng([100, 296]))
    assert (family, touches > 0) == ("2h", True)


@pytest.mark.power
def test_no_move_on_five_hundred_machines_enters_an_obstacle() -> None:
    touches = sweep(800, 100)
    machines = {family: len(each) for family, each in sorted(touches.items())}
    print(f"{machines} machines with a plan, {sum(map(sum, touches.values()))} touches")
    assert sum(machines.values()) >= 500
    assert {family for family, number in machines.items() if number >= 5} == FAMILIES
    assert sum(map(sum, touches.values())) > 15_000


def test_a_sphere_is_never_probed_through_its_stem() -> None:
    """With no stem the pole is touched from below; with one nothing near it is."""
    on_stem = tn.Setup(artefact=SPHERE, probe=tn.Probe(3.0))
    bare = replace(on_stem, artefact=replace(SPHERE, stem_diameter_mm=0.0))
    lowest = {}
    for name, setup in (("stem", on_stem), ("bare", bare)):
        plan = tn.plan(setup, a_deg=(90, -90, 60))
        twin = Twin(setup)
        at = [twin.posture(row) for row in rotary_of(plan)]
        points = zip(plan.position_mm, at, strict=True)
        centre = np.array([(point - x.origin) @ x.rotation for point, x in points])
        lowest[name] = float((centre - [0.0, 0.0, 60.0])[:, 2].min())
    assert lowest["bare"] == pytest.approx(-15.5, abs=1e-3)
    assert lowest["stem"] > -1.0


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
    with pytest.raises(tn.DataError, match=r"within 4\.9 mm and 1 deg .* rows 0, 1, .* more;"):
        tn.probing_program(plan, loose)
    moved = replace(CROSS, artefact=replace(CROSS.artefact, place_mm=(0.0, 12.0, 0.0)))
    with pytest.raises(tn.DataError, match="run into something or find nothing"):
        tn.probing_program(plan, moved)
    bare = tn.Setup(artefact=replace(SPHERE, stem_diameter_mm=0.0))
    through_the_stem = tn.plan(bare, c_deg=(), a_deg=(90,))
    tn.probing_program(through_the_stem, bare)
    with pytest.raises(tn.DataError, match=r": row \d"):
        tn.probing_program(through_the_stem, replace(bare, artefact=SPHERE))


def test_a_stem_beside_a_face_keeps_clear_of_it_on_a_table_that_leans() -> None:
    """Of a face along the stem: depth × lean must be less than what the ball stands out, 0.1 mm.

    That of C turns it about its own axis. Faces that the stem would meet are left out, which the
    notes on the plan and the head of its program say.
    """
    setup = tn.Setup(
        tn.Artefact("cuboid", length_mm=60.0, width_mm=60.0, height_mm=40.0, tolerance_mm=0.5),
        probe=tn.Probe(ball_radius_mm=1.0, stem_radius_mm=0.9),
    )

    def deepest(plan: tn.Touches) -> float:
        """How far the top is above a touch from the side while A is 0, mm; 0 without any."""
        aside = (plan["a_deg"] == 0) & (np.abs(plan["dir_z"]) < 0.5)
        return float(np.max(40.0 - plan["z_mm"][aside], initial=0.0))

    plan = tn.plan(setup)
    for offset_deg, is_clear in ((0.1, True), (0.3, False)):
        control = replace(setup.control, rotary_offset_deg=offset_deg)
        shifted = replace(setup, control=control)
        assert bool(deepest(plan) * np.tan(np.radians(offset_deg)) < 0.1) is is_clear
        kept = tn.plan(shifted)
        assert deepest(kept) == (deepest(plan) if is_clear else 0.0)
        taken = f"took {len(plan) - len(kept)} of the {len(plan)} touches"
        heads = tn.plan_notes(kept, shifted), (tn.probing_program(kept, shifted).text(),)
        for head in heads:
            assert any(taken in line for line in head) is not is_clear
        assert len(tn.probing_program(kept, shifted).cycle.steps) == len(kept) > 0
    with pytest.raises(tn.DataError, match=r"rotary axes within 0\.3 deg of theirs: rows"):
        tn.probing_program(plan, shifted)


def test_the_first_look_allows_for_axes_far_from_the_table() -> None:
    """An axis that is off by 0.3° moves a contact by that times its distance from the axis."""
    axes = {"A": tn.AxisSetup(point_mm=(0.0, 0.0, -200.0))}
    artefact = tn.Artefact("cuboid", length_mm=60.0, width_mm=60.0, height_mm=40.0)
    setup = tn.Setup(artefact, tn.Machine("trt-ca"), axes=axes)
    setup = replace(setup, plan=replace(setup.plan, clearance_mm=9.0, overtravel_mm=9.0))
    off = replace(setup, control=replace(setup.control, rotary_offset_deg=0.3))
    plan = tn.plan(off)
    allowed = []
    for given in (setup, off):
        cycle = tn.probing_program(plan, given).cycle
        allowed.append(cycle.look_mm(cycle.looks[0]))
    contact = np.array(cycle.looks[0].contact)
    by_a = np.linalg.norm(contact[1:] - (0.0, -200.0))  # A turns about X
    by_c = np.linalg.norm(contact[:2])
    assert allowed[1] - allowed[0] >= np.radians(0.3) * (by_a + by_c)


def test_a_refusal_by_the_offset_names_it() -> None:
    setup = tn.Setup(
        tn.Artefact("cuboid", length_mm=60.0, width_mm=60.0, height_mm=40.0),
        probe=tn.Probe(ball_radius_mm=1.0, stem_radius_mm=0.9),
    )
    setup = replace(setup, plan=replace(setup.plan, clearance_mm=20.0, overtravel_mm=20.0))
    off = replace(setup, control=replace(setup.control, rotary_offset_deg=5.0))
    assert len(tn.plan(setup, c_deg=(), a_deg=(90.0,)))
    with pytest.raises(tn.DataError, match=r"can be reached .* and control\.rotary_offset_deg"):
        tn.plan(off, c_deg=(), a_deg=(90.0,))


def test_a_sweep_beyond_the_tolerance_finds_the_collision() -> None:
    """The sweep of these tests is not blind."""
    rng = np.random.default_rng(1)
    plan = tn.plan(CROSS)
    program = tn.probing_program(plan, CROSS)
    far = Draw(np.array([6.5, 0.0, 0.0]), 0.0)
    twin = Twin(CROSS)
    with pytest.raises(AssertionError):
        swept(moves_of(program, plan), CROSS, Scene(CROSS, far), twin)
    near = Draw.within(CROSS.artefact, rng)
    swept(moves_of(program, plan), CROSS, Scene(CROSS, near), twin)


@pytest.mark.parametrize(
    ("held", "ball", "text"),
    [
        ({"vise": {"grip_mm": 15.0}}, 1.0, "a vise: jaw 125 mm, thickness 40 mm"),
        ({"chuck": {"grip_mm": 15.0}}, 1.0, "diameter 160 mm, height 110 mm, grip 15 mm"),
        ({"plate": "20"}, 13.0, "a plate: margin 20 mm, height 20 mm"),
    ],
)
def test_a_holder_that_the_plan_does_not_know_is_run_into(
    held: dict[str, Any], ball: float, text: str
) -> None:
    """The sweep sees each holder, and a plan that knows it is another one and says so."""
    probe = tn.Probe(ball)
    known = tn.Setup(tn.Artefact("cross", tolerance_mm=0.6, tolerance_deg=0.2, **held), probe=probe)
    place = known.artefact.effective_place_mm
    bare = tn.Setup(artefact=tn.Artefact("cross", place_mm=place), probe=probe)
    angles: dict[str, Any] = {"c_deg": (0.0, 90.0), "a_deg": (60.0, -90.0), "all_faces": True}
    scene, twin = Scene(known, Draw(np.zeros(3), 0.0)), Twin(known)
    plan = tn.plan(known, **angles)
    swept(approaches_of(plan, twin, known.plan.overtravel_mm), known, scene, twin)
    assert any(text in note for note in tn.plan_notes(plan, known))
    blind = approaches_of(tn.plan(bare, **angles), twin, known.plan.overtravel_mm)
    with pytest.raises(AssertionError):
        swept(blind, known, scene, twin)


def test_the_usual_sizes_of_holders_are_those_that_are_documented() -> None:
    page = Path(__file__).parent.parent.joinpath("docs/explanation/conventions.md").read_text()
    for sizes in (VISES, CHUCKS, PLATES):
        keys = [f"`{key}`" for key in next(iter(sizes.values()))]
        for name, one in sizes.items():
            row = f'| `"{name}"` | ' + " | ".join(f"{size:g}" for size in one.values()) + " |"
            assert row in page
        assert " | ".join(keys) in page


def test_a_plan_says_what_it_assumes_and_what_it_does_not_identify() -> None:
    sphere = tn.Setup(artefact=SPHERE, probe=tn.Probe(3.0))
    notes = tn.plan_notes(tn.plan(sphere), sphere)
    assert "within 2 mm and 1 deg" in notes[0]
    assert "a table of radius 150 mm and thickness 30 mm is assumed" in notes[1]
    assert "on a stem of 8.33 mm" in notes[2]
    assert "its body, the holder and the spindle nose are not" in notes[3]
    assert notes[4].startswith("These touches do not identify EA0A, EB0C, EX0C, EY0C.")
    assert "EA0A (+1 arcsec) together with EY0C" in notes[4]
    head = tn.probing_program(tn.plan(sphere), sphere).text()
    assert all(f"({note})" in head for note in notes[:4])
    probe = tn.Probe(stem_length_mm=140.0, body_diameter_mm=10.0)
    stated = replace(CROSS, table=tn.TableSetup(150.0, 30.0), probe=probe)
    assert len(tn.plan_notes(tn.plan(stated), stated)) == 1


def test_a_table_without_size_is_refused_not_a_panic() -> None:
    for radius, thickness in ((-1.0, 30.0), (150.0, -30.0), (float("nan"), 30.0)):
        with pytest.raises(tn.InputError, match=r"of the table in mm|table_(radius|thickness)_mm"):
            _core.Arrangement(
                Chain(CROSS).machine(),
                Chain(CROSS).artefact,
                ball_radius_mm=1.0,
                stem_radius_mm=0.5,
                stem_length_mm=100.0,
                body_radius_mm=0.0,
                body_length_mm=0.0,
                table_radius_mm=radius,
                table_thickness_mm=thickness,
                clearance_mm=5.0,
                overtravel_mm=5.0,
                rotary_offset_deg=0.0,
            )


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"centre_mm": (60.0, 0.0, 0.0)}, "12.5 mm below the top of the table"),
        ({"centre_mm": (60.0, 0.0, 40.0), "place_mm": (0.0, 0.0, -30.0)}, "2.5 mm below"),
        ({"centre_mm": (60.0, 0.0, 12.5)}, ""),  # it lies on the table
    ],
)
def test_a_sphere_in_the_table_is_said(keys: dict[str, Any], said: str) -> None:
    setup = tn.Setup(artefact=tn.Artefact("sphere", diameter_mm=25.0, **keys))
    plan = tn.plan(setup)
    notes = [note for note in tn.plan_notes(plan, setup) if "top of the table" in note]
    assert len(notes) == bool(said)
    head = tn.probing_program(plan, setup).text()
    assert ("top of the table, from which heights count" in head) == bool(said)
    for note in notes:
        assert said in note
        assert "is artefact.centre_mm right?" in note
        assert not any("stem_diameter_mm" in one for one in tn.plan_notes(plan, setup))


def test_a_cross_below_the_table_top_is_said() -> None:
    setup = tn.Setup(artefact=tn.Artefact("cross", place_mm=(0.0, 0.0, -20.0)))
    (note,) = (n for n in assumptions(setup) if "below the top" in n)
    assert "reaches 20 mm" in note
    assert "artefact.place_mm right" in note
