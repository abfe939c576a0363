"""Error maps: corrections of the linear axes in a table, at the control's resolution.

The table is over positions of the machine's axes (X, Y, Z and rotary), as in the spatial
compensation of commercial controls, not over points of the work: location errors of the axes then
do not depend on the position of the last table axis at all, and only smoothly on the other.
Corrections are *added* to the commanded linear positions. In between, multilinear interpolation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trunnion.base import report
from trunnion.base.arguments import checked
from trunnion.base.checks import array, count_of, floats, positive, within
from trunnion.base.errors import InputError
from trunnion.base.output import write_text
from trunnion.base.saved import Gridded
from trunnion.base.units import Floats
from trunnion.compensation.control import ModelCompensation, nominal_commands
from trunnion.compensation.machine import NOMINAL, Effects, Known, MachineErrors
from trunnion.compensation.map_file import read_rows, text_of_rows
from trunnion.compensation.workspace import Workspace, pose_grid
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

LARGEST_MAP = 5_000_000
# Corrections that differ by less along a rotary axis do not depend on it: rounding noise.
_CONSTANT_UM = 1e-7
_EDGE_MM = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class ErrorMap(report.Result):
    """Corrections of X, Y, Z at the nodes of a grid over the positions of all axes.

    Attributes
    ----------
    rotary_deg
        Letter → nodes, control's sign. A single node: the corrections do not depend on the axis.
        C nodes that span 360° are used periodically.
    x_mm, y_mm, z_mm
        Nodes of the linear axes, machine frame.
    steps
        Corrections as whole numbers of `resolution_um`, shape (rotary ..., nx, ny, nz, 3).
    resolution_um
        Least step of a correction; 0: `steps` holds µm, not rounded.
    interpolation_error_um
        Largest length of (table − exact correction) found at nodes and in the middles of all cells,
        rounding included; None for a map that was read from a file.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> found = tn.error_map(
    ...     setup, {"EX0C": 15.0}, linear_step_mm=150.0, rotary_step_deg=90.0
    ... )
    >>> print(found.headline())
    Error map: corrections of X, Y, Z up to 15 µm, least step 0.1 µm.
    """

    rotary_deg: Mapping[str, Floats]
    x_mm: Floats
    y_mm: Floats
    z_mm: Floats
    steps: NDArray[Any]
    resolution_um: float
    interpolation_error_um: float | None = None

    @property
    def corrections_um(self) -> Floats:
        """Corrections at the nodes, µm, shape (rotary ..., nx, ny, nz, 3)."""
        scale = self.resolution_um if self.resolution_um > 0 else 1.0
        corrections: Floats = self.steps * scale
        return corrections

    def _axes(self) -> dict[str, Floats]:
        rotary = {f"{letter.lower()}_deg": nodes for letter, nodes in self.rotary_deg.items()}
        return {**rotary, "x_mm": self.x_mm, "y_mm": self.y_mm, "z_mm": self.z_mm}

    @checked
    def correction_um(self, position_mm: ArrayLike, rotary_deg: Mapping[str, ArrayLike]) -> Floats:
        """Correction at axis positions: linear (n, 3) in mm, rotary by letter, control's sign.

        Raises
        ------
        InputError
            If a position lies outside the map; a map is not extrapolated.
        """
        linear = array("position_mm", position_mm, 3)
        missing = [letter for letter in self.rotary_deg if letter not in rotary_deg]
        if missing:
            raise InputError(f"rotary_deg: got no axis {missing[0]}, expected its position")
        columns = [np.broadcast_to(np.asarray(rotary_deg[letter], float), len(linear))
                   for letter in self.rotary_deg]  # fmt: skip
        queries = np.column_stack([*columns, linear])
        axes = self._axes()
        used, grid = [], []
        for i, (name, nodes) in enumerate(axes.items()):
            if len(nodes) == 1:
                continue
            values = queries[:, i]
            if name == "c_deg" and np.isclose(nodes[-1] - nodes[0], 360.0, rtol=0, atol=1e-9):
                inside = (values >= nodes[0]) & (values <= nodes[-1])
                values = np.where(inside, values, nodes[0] + (values - nodes[0]) % 360.0)
            slack = _EDGE_MM * (nodes[-1] - nodes[0])
            outside = (values < nodes[0] - slack) | (values > nodes[-1] + slack)
            if outside.any():
                row = int(np.argmax(outside))
                raise InputError(
                    f"error map: got {name} = {values[row]:g} (row {row}), expected "
                    f"{nodes[0]:g} to {nodes[-1]:g}: the map is not extrapolated"
                )
            queries[:, i] = np.clip(values, nodes[0], nodes[-1])
            used.append(i)
            grid.append(nodes)
        table = self.corrections_um
        table = table.reshape([n for n in table.shape[:-1] if n > 1] + [3])
        if not grid:
            return np.broadcast_to(table, (len(linear), 3)).copy()
        from scipy.interpolate import RegularGridInterpolator  # takes 0.1 s to load

        found: Floats = RegularGridInterpolator(tuple(grid), table)(queries[:, used])
        return found

    @checked
    def commands(self, setup: Setup, points_mm: Floats, rotary_deg: Floats) -> Floats:
        """Nominal commands plus the correction at them, rounded to the map's resolution."""
        chain = Chain(setup)
        if set(chain.letters) != set(self.rotary_deg):
            raise InputError(
                f"error map: got one for axes {', '.join(self.rotary_deg) or 'none'}, expected "
                f"{', '.join(chain.letters)} (machine {setup.machine.name})"
            )
        commands = nominal_commands(setup, points_mm, rotary_deg)
        correction = self.correction_um(commands[:, :3], chain.to_control(rotary_deg))
        if self.resolution_um > 0:
            correction = np.rint(correction / self.resolution_um) * self.resolution_um
        commands[:, :3] += 1e-3 * correction
        return commands

    # --- files

    def gridded(self) -> Gridded:
        """Return the corrections over the positions of all axes."""
        axes = {**self._axes(), "direction": list("xyz")}
        return Gridded(axes, {"correction_um": (tuple(axes), self.corrections_um)}, {})

    def to_csv(self, path: str | PathLike[str] | None = None) -> str | None:
        """Write the map, or return it as text; `read_error_map` gives back an equal map."""
        axes = self._axes()
        nodes = np.meshgrid(*axes.values(), indexing="ij")
        columns = {name: values.ravel() for name, values in zip(axes, nodes, strict=True)}
        text = text_of_rows(columns, self.corrections_um.reshape(-1, 3), self.resolution_um)
        if path is None:
            return text
        write_text(path, text)
        return None

    def __eq__(self, other: object) -> bool:
        """Whether grid and steps are equal: a file does not hold `interpolation_error_um`."""
        if isinstance(other, ErrorMap):
            other = replace(other, interpolation_error_um=self.interpolation_error_um)
        return super().__eq__(other)

    __hash__ = report.Result.__hash__

    # --- what it says

    def sentences(self) -> Sequence[str]:
        """Largest correction, resolution, how exact the table is."""
        largest = float(np.abs(self.corrections_um).max())
        lines = [
            f"Error map: corrections of X, Y, Z up to {largest:.4g} µm, least step "
            f"{self.resolution_um:g} µm."
        ]
        if self.interpolation_error_um is not None:
            lines.append(
                "Deviation from the exact correction at the nodes and in the middle of the cells: "
                f"{self.interpolation_error_um:.3g} µm at most."
            )
        constant = [letter for letter, nodes in self.rotary_deg.items() if len(nodes) == 1]
        if constant:
            lines.append(f"The corrections do not depend on {' and '.join(constant)}.")
        return lines

    def tables(self) -> tuple[report.Table, ...]:
        """Range and nodes of each axis; no range where the corrections do not depend on it."""
        rows: list[tuple[report.Cell, ...]] = []
        for name, nodes in self._axes().items():
            ends = (nodes[0], nodes[-1]) if len(nodes) > 1 else (None, None)
            rows.append((name, *ends, len(nodes)))
        return (report.Table.of("Nodes of the error map", ("", "from", "to", "nodes"), rows),)

    def derived(self) -> Mapping[str, Any]:
        """Corrections at the nodes, µm."""
        return {"corrections_um": self.corrections_um}


@checked
def error_map(
    setup: Setup,
    errors: Known,
    effects: Effects = None,
    x_mm: ArrayLike = (-150, 150),
    y_mm: ArrayLike = (-120, 120),
    z_mm: ArrayLike = (0, 150),
    a_deg: ArrayLike = (-90, 90),
    c_deg: ArrayLike = (0, 360),
    *,
    b_deg: ArrayLike = (-90, 90),
    linear_step_mm: float = 50.0,
    rotary_step_deg: float = 15.0,
    resolution_um: float | None = None,
) -> ErrorMap:
    """Compute the error map that compensates a machine as identified, by its linear axes.

    Parameters
    ----------
    setup, errors, effects
        The machine as identified: errors by name, or a result.
    x_mm, y_mm, z_mm
        Box of the work (it turns with the table); the map covers every axis position that reaches
        it at the rotary positions below.
    a_deg, b_deg, c_deg
        Rotary range of the map: (low, high) in steps of at most `rotary_step_deg`, more than two
        nodes as they are, or one number. Control's sign.
    linear_step_mm
        Largest distance of nodes of X, Y, Z.
    resolution_um
        Least step of a correction; the set-up's unless given; 0: not rounded.

    Notes
    -----
    Exact corrections are affine in X, Y, Z at one set of rotary positions, so interpolation between
    linear nodes only averages their rounding (at most half a step a component). Between rotary
    nodes h apart a correction u errs by at most h²/8 max|u''|; with location errors alone u'' is
    about u, 0.9 % of it at 15°. What it is for this map is `interpolation_error_um`, rounding
    included; the control's own rounding of the interpolated value adds at most half a step.

    Raises
    ------
    InputError
        Ranges that are none, a map of more than five million nodes.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> found = tn.error_map(
    ...     setup, {"EX0C": 15.0}, linear_step_mm=150.0, rotary_step_deg=90.0
    ... )
    >>> found.to_csv("map.csv")
    >>> tn.read_error_map("map.csv") == found
    True
    """
    positive("linear_step_mm", linear_step_mm)
    positive("rotary_step_deg", rotary_step_deg)
    resolution = setup.resolution.linear_um if resolution_um is None else resolution_um
    least = within("resolution_um", resolution, 0.0)
    known = MachineErrors.to_compensate(setup, errors, effects)
    letters = Chain(setup).letters
    given = {"A": a_deg, "B": b_deg, "C": c_deg}
    spread = {
        letter: _stepped(f"{letter.lower()}_deg", given[letter], rotary_step_deg)
        for letter in letters
    }
    where = Workspace(x_mm, y_mm, z_mm, spread.get("A"), spread.get("C"), spread.get("B"))
    rotary, linear = _nodes(setup, where, linear_step_mm)
    exact = _corrections(setup, known, rotary, linear)
    for i, letter in enumerate(letters):
        if len(rotary[letter]) > 1 and np.ptp(exact, axis=i).max() < _CONSTANT_UM:
            exact = np.take(exact, [0], axis=i)
            rotary[letter] = rotary[letter][:1]
    steps = np.rint(exact / least).astype(np.int64) if least > 0 else exact
    x, y, z = linear
    made = ErrorMap(rotary, x, y, z, steps, least)
    return replace(made, interpolation_error_um=_interpolation_error(setup, known, made))


def _nodes(
    setup: Setup, where: Workspace, linear_step_mm: float
) -> tuple[dict[str, Floats], list[Floats]]:
    """Nodes of the rotary and of the linear axes of a map."""
    rotary, _ = where.rotary(setup)
    low, high = _reach(setup, rotary, list(where.ends()))
    linear = [
        _spaced("linear_step_mm", lo, hi, linear_step_mm) for lo, hi in zip(low, high, strict=True)
    ]
    count = int(np.prod([len(nodes) for nodes in (*rotary.values(), *linear)]))
    if count > LARGEST_MAP:
        raise InputError(
            f"error map: got {count:,} nodes, expected at most {LARGEST_MAP:,}: take larger steps"
        )
    return rotary, linear


def _stepped(name: str, given: ArrayLike, step: float) -> Floats:
    nodes = np.atleast_1d(floats(name, given))
    if nodes.ndim != 1 or np.any(np.diff(nodes) <= 0):
        raise InputError(f"{name}: got {given!r}, expected (low, high), rising nodes or a number")
    if len(nodes) != 2:
        return nodes
    return _spaced(name, nodes[0], nodes[1], step)


def _spaced(what: str, low: float, high: float, step: float) -> Floats:
    """Return evenly spaced nodes, at most `step` apart."""
    count_of(what, high - low, step, LARGEST_MAP)
    return np.linspace(low, high, max(2, int(np.ceil((high - low) / step)) + 1))


def _reach(setup: Setup, rotary: Mapping[str, Floats], box: list[Floats]) -> tuple[Floats, Floats]:
    """Lowest and highest X, Y, Z that reach the box of the work; rounded outward on a range."""
    # Every degree: an arc of radius 300 mm rises 0.012 mm between two of them.
    dense = {
        letter: _spaced(f"{letter.lower()}_deg", nodes[0], nodes[-1], 1.0)
        for letter, nodes in rotary.items()
    }
    poses = pose_grid(setup, dense)
    ends = [axis[[0, -1]] for axis in box]
    corners = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, 3)
    core = NOMINAL.core(setup)
    all_poses = np.repeat(poses, len(corners), axis=0)
    reached = core.linear_commands(np.tile(corners, (len(poses), 1)), all_poses, None)
    if len(poses) == 1:
        return reached.min(axis=0), reached.max(axis=0)
    return np.floor(reached.min(axis=0) - 0.1), np.ceil(reached.max(axis=0) + 0.1)


def _corrections(
    setup: Setup, known: MachineErrors, rotary: Mapping[str, Floats], linear: list[Floats]
) -> Floats:
    """Exact corrections in µm on a grid of axis positions, (rotary ..., nx, ny, nz, 3)."""
    chain = Chain(setup)
    axes = [rotary[letter] for letter in chain.letters]
    shape = [len(nodes) for nodes in (*axes, *linear)]
    grid = np.stack(np.meshgrid(*axes, *linear, indexing="ij"), axis=-1).reshape(-1, len(shape))
    turned = np.ascontiguousarray(grid[:, : chain.count] * chain.senses)
    position = grid[:, chain.count :]
    point = NOMINAL.core(setup).reached(np.hstack([position, turned]), None)[:, :3]
    expected = ModelCompensation(known).commands(setup, np.ascontiguousarray(point), turned)[:, :3]
    corrections: Floats = ((expected - position) * 1e3).reshape(*shape, 3)
    return corrections


def _interpolation_error(setup: Setup, known: MachineErrors, table: ErrorMap) -> float:
    """Largest |table − exact| at nodes and middles of the rotary axes and of X, Y, Z."""

    def halved(nodes: Floats) -> Floats:
        return np.sort(np.concatenate([nodes, 0.5 * (nodes[1:] + nodes[:-1])]))

    linear = [halved(nodes) for nodes in (table.x_mm, table.y_mm, table.z_mm)]
    worst = 0.0
    first, *others = table.rotary_deg or ("",)
    # One position of the first axis at a time: the halved grid is 32 times the table.
    for position in halved(table.rotary_deg[first]) if first else (0.0,):
        rotary = {first: np.array([position])} if first else {}
        rotary |= {letter: halved(table.rotary_deg[letter]) for letter in others}
        exact = _corrections(setup, known, rotary, linear)
        axes = [*rotary.values(), *linear]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
        queries = {letter: grid[:, i] for i, letter in enumerate(rotary)}
        found = table.correction_um(grid[:, len(rotary) :], queries)
        worst = max(worst, float(np.linalg.norm(found - exact.reshape(-1, 3), axis=1).max()))
    return worst


@checked
def read_error_map(path: str | PathLike[str]) -> ErrorMap:
    """Read an error map; see `trunnion.compensation.map_file` for the file.

    Raises
    ------
    FileFormatError
        If the resolution is not stated, a column is missing or not a number, a node is missing or
        stands twice, or a correction is no multiple of the resolution; the message has file, line
        and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> found = tn.error_map(
    ...     setup, {"EX0C": 15.0}, linear_step_mm=150.0, rotary_step_deg=90.0
    ... )
    >>> found.to_csv("map.csv")
    >>> type(tn.read_error_map("map.csv")).__name__
    'ErrorMap'
    """
    rows = read_rows(path)
    resolution = rows.resolution_um
    nodes, order = rows.order()
    rotary = {n[0].upper(): v for n, v in zip(rows.names(), nodes, strict=True) if "deg" in n}
    values = np.stack([rows.dx_um, rows.dy_um, rows.dz_um], axis=1)[order]
    values = values.reshape(*(len(axis) for axis in nodes), 3)
    steps = np.rint(values / resolution).astype(np.int64) if resolution > 0 else values
    return ErrorMap(rotary, nodes[-3], nodes[-2], nodes[-1], steps, resolution)
