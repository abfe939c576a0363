"""Machines as data: presets and random chains against outside checks and an independent twin."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import trunnion as tn
from trunnion.compensation import ModelCompensation
from trunnion.machine.chain import Chain
from trunnion.probing.model import TouchModel
from trunnion.setup.machines import presets
from twin.machines import LETTERS, PLACEMENT, Layout, way_to_box

Floats = NDArray[np.float64]
SIZES = (90.0, 60.0, 40.0)
PLACE, TURN_DEG = (12.0, -8.0, 6.0), 20.0
NOISE_UM = 0.3
RUNS = 1200
CODES = (
    "[w C' A' b X Y Z (C) t]",
    "[w A' X' b Z Y B t]",
    "[w C' Y' b X Z B t]",
    "[w B' A' b X Y Z t]",
    "[w X' b Z Y C A t]",
    "[w C' B' Z' b Y X t]",
    "[w B' b Y X Z A t]",
    "[w Z' Y' X' b C B t]",
)


def random_layout(number: int) -> Layout:
    """A chain with every axis at an odd angle and off the others."""
    random = np.random.default_rng([19, number])
    layout = Layout(CODES[number])
    directions, points = {}, {}
    for letter in layout.letters:
        d = np.array(LETTERS[letter]) + random.uniform(-0.35, 0.35, 3)
        directions[letter] = tuple(d * random.choice([-1.0, 1.0]))
        near = np.array([0.0, 0.0, layout.length if letter in layout.side(True) else 0.0])
        points[letter] = tuple(near + random.uniform(-40, 40, 3))
    return replace(layout, directions=directions, points=points)


def preset_layout(name: str) -> Layout:
    """A preset; the twin is told what its entry says."""
    known = presets()[name]
    return Layout(known.chain, known.directions, known.points_mm, known.table_normal)


MACHINES = [*presets(), *range(len(CODES))]


@cache
def layout_of(machine: str | int) -> Layout:
    return preset_layout(machine) if isinstance(machine, str) else random_layout(machine)


@cache
def setup_of(machine: str | int) -> tn.Setup:
    layout = layout_of(machine)
    names: dict[str, Any] = {"preset": machine}
    axes = {}
    if isinstance(machine, int):
        names = {"chain": layout.code, "table_normal": layout.normal}
        for letter in layout.letters:
            line: dict[str, Any] = {
                "point_mm": layout.points[letter],
                "direction": layout.directions[letter],
            }
            axes[letter] = tn.AxisSetup(**line)
    artefact = tn.Artefact(
        "cuboid", *SIZES, place_mm=PLACE, turn_deg=TURN_DEG, tolerance_mm=0.5, tolerance_deg=0.2
    )
    return tn.Setup(
        artefact=artefact,
        machine=tn.Machine(**names),
        axes=axes,
        table=tn.TableSetup(70.0, 10.0),
        resolution=tn.Resolution(0.0, 0.0),
    )


def random_errors(machine: str | int, seed: int, um: float, arcsec: float) -> dict[str, float]:
    random = np.random.default_rng(seed)
    sizes = {"um": um, "arcsec": arcsec}
    units = Chain(setup_of(machine)).location_errors
    return {name: float(random.uniform(-1, 1) * sizes[unit]) for name, unit in units.items()}


def random_axes(machine: str | int, seed: int) -> Floats:
    """Positions in mm and rad."""
    random = np.random.default_rng(seed)
    count = len(layout_of(machine).letters)
    return np.asarray(np.r_[random.uniform(-200, 200, 3), random.uniform(-np.pi, np.pi, count)])


@pytest.mark.parametrize("machine", MACHINES)
def test_kinematics_and_derivatives(machine: str | int) -> None:
    """Against Pinocchio and the twin to 1e-12 of the lengths, derivatives by complex steps."""
    pin = pytest.importorskip("pinocchio")
    layout, setup = layout_of(machine), setup_of(machine)
    for seed in range(20):
        errors = random_errors(machine, seed, 1000.0, 3600.0)
        at = random_axes(machine, seed)
        axes = np.r_[at[:3], np.degrees(at[3:])][None, :]
        point, direction = tn.forward_kinematics(setup, axes, errors)
        scale = 1 + np.abs(at[:3]).max() + layout.length
        ours = np.r_[point[0], direction[0]]
        assert np.abs(ours - layout.tool(at, errors)).max() < 1e-12 * scale

        model = tn.pinocchio_model(setup, errors)
        data = model.createData()
        q = pin.neutral(model)
        for name, value in zip([*"XYZ", *layout.letters], at, strict=True):
            q[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, q)
        table, ball = (data.oMf[model.getFrameId(name)] for name in ("table", "ball"))
        theirs = np.r_[table.actInv(ball.translation), table.rotation.T @ ball.rotation[:, 2]]
        assert np.abs(ours - theirs).max() < 1e-12 * scale

        step = 1e-30
        slopes = [
            layout.tool(at + 1j * step * unit, errors).imag / step for unit in np.eye(len(at))
        ]
        per_unit = np.r_[np.ones(3), np.full(len(at) - 3, np.pi / 180)]
        exact = np.array(slopes).T * per_unit
        found = tn.kinematic_jacobian(setup, axes, errors)[0]
        assert np.abs(found - exact).max() < 1e-9


@pytest.mark.parametrize("machine", [m for m in MACHINES if len(layout_of(m).letters) == 2])
def test_inverse_kinematics_undoes_forward(machine: str | int) -> None:
    setup = setup_of(machine)
    errors = random_errors(machine, 5, 100.0, 60.0)
    for seed in range(10):
        at = random_axes(machine, 100 + seed)
        for known in ({}, errors):
            axes = np.r_[at[:3], np.degrees(at[3:])][None, :]
            point, direction = tn.forward_kinematics(setup, axes, known)
            reference = axes[0, 3:]
            found = tn.inverse_kinematics(
                setup, point, direction, branch="nearest", reference_deg=reference, errors=known
            )
            again = tn.forward_kinematics(setup, found.axes, known)
            assert np.abs(again[0] - point).max() < 1e-9
            assert np.abs(again[1] - direction).max() < 1e-11


@cache
def plan_of(machine: str | int) -> tn.Touches:
    """72 to 150 touches at many positions of the rotary axes."""
    setup = setup_of(machine)
    chain = Chain(setup)
    if not chain.letters:
        return tn.plan(setup, dither=False)
    level = chain.level_deg
    if chain.tilting is None or chain.turning is None:
        one: dict[str, Any] = {f"{chain.letters[0].lower()}_deg": tuple(range(-80, 81, 20))}
        made = tn.plan(setup, **one, dither=False, all_faces=True)
    else:
        pairs = [(level + t, c) for t in (-50, -25, 25, 50) for c in (0, 70, 130, 250, 310)]
        angles: dict[str, Any] = {
            f"{chain.turning.lower()}_deg": (0, 90, 180, 270),
            f"{chain.tilting.lower()}_deg": (level - 70, level + 70),
        }
        made = tn.plan(setup, **angles, positions_deg=pairs, dither=False, all_faces=True)
    if len(made) > 150:
        made = made[np.sort(np.random.default_rng(1).permutation(len(made))[:150])]
    return made


def twin_ways(machine: str | int, touches: tn.Touches, values: dict[str, Any]) -> Any:
    """Way of each touch from its recorded position to the contact, mm."""
    layout = layout_of(machine)
    columns = [np.radians(touches.rotary_deg[x.lower()]) for x in layout.letters]
    ways = []
    for row in range(len(touches)):
        angles = {x: column[row] for x, column in zip(layout.letters, columns, strict=True)}
        ways.append(
            way_to_box(
                layout,
                angles,
                touches.position_mm[row],
                touches.direction[row],
                values,
                sizes=SIZES,
                place=PLACE,
                turned=np.radians(TURN_DEG),
                radius=1.0,
            )
        )
    return np.array(ways)


def truth_of(machine: str | int) -> tuple[dict[str, float], dict[str, float]]:
    errors = random_errors(machine, 7, 60.0, 40.0)
    placed = dict(zip(PLACEMENT, (40.0, -30.0, 20.0, 15.0, -25.0, 30.0), strict=True))
    return errors, placed


@pytest.mark.parametrize("machine", MACHINES)
def test_simulated_touches_are_the_twin_s(machine: str | int) -> None:
    setup, plan = setup_of(machine), plan_of(machine)
    errors, placed = truth_of(machine)
    assert len(plan) >= (72 if layout_of(machine).letters else 10)
    touched = tn.simulate(plan, setup, errors, placed)
    assert np.abs(twin_ways(machine, touched, errors | placed)).max() < 1e-9
    assert np.abs(twin_ways(machine, tn.simulate(plan, setup), {})).max() < 1e-9


def twin_jacobian(machine: str | int, touches: tn.Touches, values: dict[str, float]) -> Floats:
    """Derivative of the readings (µm) by each value, by complex steps."""
    columns = []
    for name, value in values.items():
        moved: dict[str, Any] = {**values, name: value + 1e-30j}
        columns.append(twin_ways(machine, touches, moved).imag * 1e33)
    return np.array(columns).T


@pytest.mark.parametrize("machine", MACHINES)
def test_identification_is_at_the_cramer_rao_bound(machine: str | int) -> None:
    """Derivatives, standard errors, and the scatter of many measurements against the twin's bound.

    |J (estimate - truth)|² / σ² has the mean p, the rank of J, and the standard deviation
    sqrt(2 p): over RUNS runs the mean is known to sqrt(2 / (p RUNS)), with p >= 6 to 1.7 %.
    """
    setup = setup_of(machine)
    errors, placed = truth_of(machine)
    truth = errors | placed
    touched = tn.simulate(plan_of(machine), setup, errors, placed)
    jacobian = twin_jacobian(machine, touched, truth)
    model = TouchModel(setup)
    moves = model.moves(touched)
    values = np.array(list(truth.values()))
    _, ours = model.core.linearise(moves, values)
    assert np.abs(ours - jacobian).max() < 1e-9 * np.abs(jacobian).max()

    noise = NOISE_UM * np.random.default_rng(3).standard_normal((RUNS, len(touched)))
    points = touched.position_mm + 1e-3 * noise[:, :, None] * touched.direction
    found, _, converged = model.core.fit_many(
        moves, points.reshape(RUNS, -1), values, huber=None, sigma_um=NOISE_UM, priors=[],
        max_steps=20, threads=1,
    )  # fmt: skip
    assert converged.all()
    scale = np.linalg.norm(jacobian, axis=0)
    left, singular, _ = np.linalg.svd(jacobian / scale, full_matrices=False)
    rank = int((singular > 1e-9 * singular[0]).sum())
    off = (found - values) @ jacobian.T / NOISE_UM
    assert np.mean(np.sum(off**2, axis=1)) == pytest.approx(rank, rel=0.05)
    # Nothing along what the readings do not show, and no direction of them left out.
    spread = np.mean((off @ left[:, :rank]) ** 2, axis=0)
    assert np.abs(spread - 1).max() < 6 * np.sqrt(2 / RUNS)

    fit = tn.identify(touched, setup)
    unknown = [name for name in truth if np.isinf(fit.std_errors[name])]
    assert bool(unknown) == (rank < len(truth)), unknown
    if rank == len(truth):
        assert fit.errors == pytest.approx(errors, abs=1e-6)


@pytest.mark.parametrize("machine", MACHINES)
def test_redundant_location_errors_are_refused_by_name(machine: str | int) -> None:
    setup = setup_of(machine)
    letters = layout_of(machine).letters
    known = Chain(setup).location_errors
    every = {f"E{component}0{letter}" for component in "XYZABC" for letter in letters}
    assert set(known) < every or not letters
    for name in sorted(every - set(known)):
        with pytest.raises(tn.UnknownNameError, match=f"{name}.* redundant: .*expected one of"):
            replace(setup, machine=replace(setup.machine, errors={name: 1.0}))
        with pytest.raises(tn.UnknownNameError, match=f"{name}.* redundant: "):
            tn.forward_kinematics(setup, np.zeros(3 + len(letters)), {name: 1.0})


@pytest.mark.parametrize("machine", MACHINES)
def test_nothing_is_left_after_exact_compensation(machine: str | int) -> None:
    setup = setup_of(machine)
    errors, _ = truth_of(machine)
    angles: dict[str, Any] = {"a_deg": 0, "c_deg": 0}
    letters = layout_of(machine).letters
    angles |= {f"{letter.lower()}_deg": (-70.0, 0.0, 35.0, 110.0) for letter in letters}
    before = tn.volumetric_error(setup, errors, **angles, points=(3, 3, 3))
    made = ModelCompensation.of(setup, errors)
    after = tn.volumetric_error(setup, errors, **angles, compensation=made, points=(3, 3, 3))
    assert before.max_um > 1.0 or not errors
    assert after.max_um < 1e-9


def test_which_errors_are_redundant_follows_from_the_directions_in_the_set_up() -> None:
    """With these oblique axes EB0A is the zero position of C that carries A, and EC0A is not."""
    lean = {"A": (0.55, 0.59, 0.39), "C": (0.56, -0.27, 0.52)}
    axes = {letter: tn.AxisSetup(direction=direction) for letter, direction in lean.items()}
    machine = tn.Machine(chain="[w A' C' b X Y Z t]", errors={"EC0A": 5.0})
    setup = tn.Setup(tn.Artefact("none"), machine=machine, axes=axes)
    assert Chain(setup).named_errors(None)["EC0A"] == 5.0
    with pytest.raises(tn.UnknownNameError, match=r"EC0A.* redundant: "):
        tn.Setup(tn.Artefact("none"), machine=machine)
