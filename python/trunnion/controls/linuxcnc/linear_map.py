"""Motions of the linear axes as a grid in the kinematics: straightness, angles, a field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats
from trunnion.compensation.machine import MachineErrors, OwnMotion
from trunnion.controls.files import Setting
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

GOOD_UM = 0.05
"""What interpolation may leave before the grid is made finer."""
MAX_NODES = 4096
SAME_UM = 1e-6
PLACES = 4
SAMPLES = 2000


@dataclass(frozen=True)
class LinearMap:
    """Displacement of the tool on a grid of positions of the linear axes, machine frame.

    axes: Positions of the nodes along X, Y, Z, mm; a single one where nothing changes along it.
    error_um: At the nodes, (nx, ny, nz, 3).
    left_um: Largest error that interpolation leaves.
    effects: Ids that it holds.
    """

    axes: tuple[Floats, Floats, Floats]
    error_um: Floats
    left_um: float
    effects: tuple[str, ...]

    def setting(self, where: str) -> Setting:
        """Row for people: the largest displacement."""
        holds = ", ".join(
            f"{letter} {nodes[0]:g} to {nodes[-1]:g}"
            for letter, nodes in zip("XYZ", self.axes, strict=True)
            if len(nodes) > 1
        )
        largest = float(np.linalg.norm(self.error_um, axis=-1).max())
        count = " × ".join(str(len(nodes)) for nodes in self.axes)
        return Setting(
            "map", where, "µm", None, largest,
            f"largest displacement on {count} nodes: {', '.join(self.effects)}",
            "the tool comes further in + than it is sent", "", f"{holds} mm of the machine frame",
        )  # fmt: skip


def linear_map(setup: Setup, known: MachineErrors) -> tuple[LinearMap | None, dict[str, str]]:
    """Return the grid for what moves with the linear axes alone, and why others have none."""
    reasons: dict[str, str] = {}
    mine: list[OwnMotion] = []
    for one in known.own:
        reason = _reason(setup, one)
        if reason is None:
            mine.append(one)
        else:
            reasons[one.id] = reason
    return (_grid(setup, mine) if mine else None), reasons


def _at(setup: Setup, own: Sequence[OwnMotion], points: Floats, rotary_deg: float = 0.0) -> Floats:
    """Displacement at points, µm, (n, 3)."""
    rotary = np.full((len(points), Chain(setup).count), rotary_deg)
    return 1e3 * MachineErrors(own=tuple(own)).motion_mm(setup, points, rotary)


def _reason(setup: Setup, one: OwnMotion) -> str | None:
    """Return why a motion has no place in a grid; None: it has."""
    random = np.random.default_rng(0)
    points = random.uniform(-300, 300, (50, 3))
    here = _at(setup, [one], points)
    if Chain(setup).count and np.abs(_at(setup, [one], points, 40.0) - here).max() > SAME_UM:
        return "it changes with the rotary axes"
    ranges = setup.axis_ranges()
    for letter in _changes_along(setup, [one]):
        if letter not in ranges:
            return f"its map needs [axes.{letter}] range_mm, or --range"
    return None


def _changes_along(setup: Setup, own: Sequence[OwnMotion]) -> list[str]:
    """Linear axes on whose position the displacement depends."""
    random = np.random.default_rng(0)
    points = random.uniform(-300, 300, (50, 3))
    here = _at(setup, own, points)
    found = []
    for i, letter in enumerate("XYZ"):
        moved = points.copy()
        moved[:, i] = random.uniform(-300, 300, 50)
        if np.abs(_at(setup, own, moved) - here).max() > SAME_UM:
            found.append(letter)
    return found


def _grid(setup: Setup, own: Sequence[OwnMotion]) -> LinearMap:
    ranges = setup.axis_ranges()
    along = _changes_along(setup, own)
    ends = [ranges[letter] if letter in along else (0.0, 0.0) for letter in "XYZ"]
    counts = [2 if letter in along else 1 for letter in "XYZ"]
    while True:
        axes = [np.linspace(*end, count) for end, count in zip(ends, counts, strict=True)]
        errors = _at(setup, own, _mesh(axes)).reshape(*counts, 3)
        bends = [_bend(setup, own, axes, errors, i) for i in range(3)]
        worst = int(np.argmax(bends))
        finer = [2 * n - 1 if i == worst else n for i, n in enumerate(counts)]
        if bends[worst] < GOOD_UM or np.prod(finer) > MAX_NODES:
            break
        counts = finer
    made = (axes[0], axes[1], axes[2])
    random = np.random.default_rng(0)
    low, high = np.array(ends).T
    points = low + (high - low) * random.uniform(size=(SAMPLES, 3))
    off = np.linalg.norm(_at(setup, own, points) - interpolated(made, errors, points), axis=-1)
    left = max(float(off.max()), float(np.sum(bends)))
    return LinearMap(made, errors, left, tuple(one.id for one in own))


def _mesh(axes: Sequence[Floats]) -> Floats:
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _bend(
    setup: Setup, own: Sequence[OwnMotion], axes: Sequence[Floats], errors: Floats, axis: int
) -> float:
    """Largest error half way between neighbours along an axis, µm."""
    nodes = axes[axis]
    if len(nodes) < 2:
        return 0.0
    between = [0.5 * (nodes[1:] + nodes[:-1]) if i == axis else a for i, a in enumerate(axes)]
    shape = [len(values) for values in between]
    there = _at(setup, own, _mesh(between)).reshape(*shape, 3)
    moved = np.moveaxis(errors, axis, 0)
    mean = np.moveaxis(0.5 * (moved[1:] + moved[:-1]), 0, axis)
    return float(np.linalg.norm(there - mean, axis=-1).max())


def interpolated(axes: Sequence[Floats], errors: Floats, points: Floats) -> Floats:
    """Trilinear between nodes, constant beyond them; µm, (n, 3)."""
    found = errors[None]
    for i, nodes in enumerate(axes):
        at = np.interp(points[:, i], nodes, np.arange(len(nodes)))
        low = np.clip(at.astype(int), 0, max(len(nodes) - 2, 0))
        high = np.minimum(low + 1, len(nodes) - 1)
        each = np.arange(len(points)) if found.shape[0] > 1 else np.zeros(len(points), dtype=int)
        share = (at - low).reshape(-1, *[1] * (found.ndim - 2))
        found = found[each, low] * (1 - share) + found[each, high] * share
    return np.asarray(found)


def map_words(grid: LinearMap | None) -> dict[str, str]:
    """Words of the component's source."""
    axes = ([np.zeros(1)] * 3) if grid is None else list(grid.axes)
    errors = np.zeros((1, 1, 1, 3)) if grid is None else grid.error_um
    steps = [nodes[1] - nodes[0] if len(nodes) > 1 else 1.0 for nodes in axes]
    rows = [", ".join(f"{value:.{PLACES}f}" for value in row) for row in errors.reshape(-1, 3)]
    return {
        "NODES": ", ".join(str(len(nodes)) for nodes in axes),
        "START": ", ".join(f"{nodes[0]:.6f}" for nodes in axes),
        "STEP": ", ".join(f"{step:.9f}" for step in steps),
        "MAP": ",\n".join(f"    {{{row}}}" for row in rows),
    }
