"""Volumetric error: where the tool point is on the work, minus where the program wants it.

The points of the box are points of the work: they turn with the table. The error vector is given in
the workpiece's frame, tool relative to work, in µm; its length does not depend on the frame, and at
A = C = 0 it is the |p_machine − p| of Kang, Kim and Jee (2022) (Table 3, Figs. 11 to 13).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

import trunnion._core as _core
from trunnion.base.arguments import checked
from trunnion.base.checks import array
from trunnion.base.errors import InputError
from trunnion.base.report import Cell, Result, Table
from trunnion.base.saved import Gridded
from trunnion.base.units import Floats
from trunnion.compensation.control import (
    Compensation,
    ControlModel,
    ModelCompensation,
    control_commands,
    is_compensation,
)
from trunnion.compensation.machine import NOMINAL, Effects, Known, MachineErrors
from trunnion.compensation.workspace import Where, Workspace, pose_grid
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

LARGEST_FIELD = 20_000_000
"""Numbers (three a point) that `field_um` holds at most; beyond, poses are taken one by one."""


@dataclass(frozen=True, eq=False, repr=False)
class PoseField(Result):
    """The field at one set of rotary positions.

    Attributes
    ----------
    rotary_deg
        Letter → position, control's sign.
    field_um
        Error vectors, shape (nx, ny, nz, 3), workpiece's frame.
    direction_arcsec
        Largest angle between the tool direction on the work and the one that is meant.
    """

    rotary_deg: Mapping[str, float]
    field_um: Floats
    direction_arcsec: float

    @property
    def max_um(self) -> float:
        """Largest length."""
        return float(np.sqrt(np.max(np.einsum("...i,...i", self.field_um, self.field_um))))

    def sentences(self) -> Sequence[str]:
        """Pose and largest error."""
        return (f"Largest volumetric error {self.max_um:.4g} µm at {_pose(self.rotary_deg)}.",)

    def tables(self) -> tuple[Table, ...]:
        """Largest error and error of the tool direction."""
        return (_figures(self.direction_arcsec, largest=self.max_um),)

    def derived(self) -> Mapping[str, Any]:
        """Largest length."""
        return {"max_um": self.max_um}


def _pose(rotary_deg: Mapping[str, float]) -> str:
    return ", ".join(f"{letter} = {value:g}°" for letter, value in rotary_deg.items())


def _figures(direction_arcsec: float, **sizes_um: float) -> Table:
    rows: list[tuple[Cell, ...]] = [(name, size, "µm") for name, size in sizes_um.items()]
    rows.append(("tool direction, largest", direction_arcsec, "arcsec"))
    return Table.of("Volumetric error", ("", "value", "unit"), rows)


@dataclass(frozen=True, eq=False, repr=False)
class VolumetricError(Result):
    """Volumetric error over a box of the work at one or many positions of the rotary axes.

    Attributes
    ----------
    max_um
        Largest length of the error vector over box and poses. Without rounding and tables it is
        exact for the whole box, not only for the grid: the error is affine in the point, so the
        largest is in a corner.
    rms_um
        Root mean square of its length over the grid and the poses.
    max_by_pose_um, rms_by_pose_um
        The same at each pose, in the shape of the grid of rotary positions.
    direction_by_pose_arcsec
        Angle between the tool direction on the work and the one that is meant, the largest at each
        pose.
    rotary_deg
        Letter → positions, control's sign.
    x_mm, y_mm, z_mm
        Nodes of the grid in the workpiece's frame.
    ignored
        Ids of given effects that do not move the tool on the work.
    idle
        Ids of given effects of the machine that move nothing at these poses: lost motion without
        `approach` and `senses`, a harmonic at its zero.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> found = tn.volumetric_error(setup, {"EX0C": 15.0})
    >>> round(found.max_um, 1), round(found.rms_um, 1)
    (15.0, 15.0)
    """

    max_um: float
    rms_um: float
    max_by_pose_um: Floats
    rms_by_pose_um: Floats
    direction_by_pose_arcsec: Floats
    rotary_deg: Mapping[str, Floats]
    x_mm: Floats
    y_mm: Floats
    z_mm: Floats
    ignored: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()
    # What the field is computed from on demand; JSON does not hold the field.
    _fields: Floats | None = field(default=None, compare=False)
    _sampled: Floats | None = field(default=None, compare=False)

    @property
    def grid_shape(self) -> tuple[int, int, int]:
        """Number of nodes along x, y, z."""
        return len(self.x_mm), len(self.y_mm), len(self.z_mm)

    @property
    def field_um(self) -> Floats:
        """Error vectors, shape (poses ..., nx, ny, nz, 3), µm, workpiece's frame.

        Computed when asked for.

        Raises
        ------
        InputError
            If it does not fit in memory (take poses one by one with `error_fields`), or was read
            from JSON, which does not hold it.
        """
        shape = (*self.max_by_pose_um.shape, *self.grid_shape, 3)
        if self._sampled is not None:
            return self._sampled.reshape(shape)
        if np.prod(shape) > LARGEST_FIELD:
            raise InputError(
                f"field_um: got {' x '.join(map(str, shape))} numbers, expected at most "
                f"{LARGEST_FIELD:,}: take the poses one by one with error_fields"
            )
        if self._fields is None:
            raise InputError(
                "field_um: got a result read from JSON, which does not hold the field, expected "
                "one of volumetric_error"
            )
        grid = [axis.tolist() for axis in self._nodes()]
        parts = [_core.field_on_grid(field, grid, None) for field in self._fields]
        return np.stack(parts).reshape(shape)

    def gridded(self) -> Gridded:
        """Return the field over rotary positions and the box, and the largest error by pose."""
        letters = tuple(f"{letter.lower()}_deg" for letter in self.rotary_deg)
        rotary = map(np.atleast_1d, self.rotary_deg.values())
        nodes = dict(zip(letters, rotary, strict=True))
        shape = tuple(map(len, nodes.values()))
        nodes |= {"x_mm": self.x_mm, "y_mm": self.y_mm, "z_mm": self.z_mm}
        by_pose = ("max_by_pose_um", "rms_by_pose_um", "direction_by_pose_arcsec")
        arrays = {name: (letters, getattr(self, name).reshape(shape)) for name in by_pose}
        box = (*shape, *self.grid_shape, 3)
        arrays["field_um"] = ((*nodes, "direction"), self.field_um.reshape(box))
        return Gridded({**nodes, "direction": list("xyz")}, arrays, {"frame": "workpiece"})

    @property
    def magnitude_um(self) -> Floats:
        """Lengths of the error vectors, shape (poses ..., nx, ny, nz)."""
        return cast(Floats, np.linalg.norm(self.field_um, axis=-1))

    @checked
    def at(self, points_mm: ArrayLike, *, threads: int | None = 1) -> Floats:
        """Error vectors at points of the work (n, 3), shape (poses ..., n, 3), µm.

        Raises
        ------
        InputError
            If the field was sampled (rounding, tables, all axes): it is known at its nodes only;
            if the result was read from JSON, which does not hold the field.
        """
        if self._fields is None:
            raise InputError(
                "at: got a sampled field or a result read from JSON, expected one of "
                "volumetric_error without rounding and tables"
            )
        points = array("points_mm", points_mm, 3)
        if len(self._fields) == 1:
            values = _core.field_at(self._fields[0], points, threads)
            return values.reshape(*self.max_by_pose_um.shape, *values.shape)
        parts = [_core.field_at(field, points, threads) for field in self._fields]
        return np.stack(parts).reshape(*self.max_by_pose_um.shape, len(points), 3)

    @property
    def worst_pose_deg(self) -> dict[str, float]:
        """Rotary positions with the largest error."""
        index = np.unravel_index(
            int(np.argmax(self.max_by_pose_um)), [len(v) for v in self.rotary_deg.values()]
        )
        pairs = zip(self.rotary_deg.items(), index, strict=True)
        return {letter: float(nodes[i]) for (letter, nodes), i in pairs}

    def __eq__(self, other: object) -> bool:
        """Whether the figures are equal, and the fields where both hold one (JSON does not)."""
        equal = super().__eq__(other)
        if not isinstance(other, VolumetricError) or not equal:
            return equal
        pairs = ((self._fields, other._fields), (self._sampled, other._sampled))
        return all(a is None or b is None or np.array_equal(a, b) for a, b in pairs)

    __hash__ = Result.__hash__

    def sentences(self) -> Sequence[str]:
        """Largest error and where, rms, and effects that have no influence."""
        lines = [
            f"Largest volumetric error {self.max_um:.4g} µm at {_pose(self.worst_pose_deg)}; rms "
            f"{self.rms_um:.4g} µm."
        ]
        if self.ignored:
            lines.append(f"Do not move the tool on the work: {', '.join(self.ignored)}.")
        if self.idle:
            lines.append(f"Have no influence at these poses: {', '.join(self.idle)}.")
        return lines

    def tables(self) -> tuple[Table, ...]:
        """Largest and rms error, error of the tool direction; then grid and poses."""
        axes = {f"{axis} mm": n for axis, n in zip("xyz", self._nodes(), strict=True)}
        axes |= {f"{letter} deg": nodes for letter, nodes in self.rotary_deg.items()}
        rows = [(name, nodes[0], nodes[-1], len(nodes)) for name, nodes in axes.items()]
        grid = Table.of("Grid of the work and rotary positions", ("", "from", "to", "nodes"), rows)
        direction = float(np.max(self.direction_by_pose_arcsec))
        return _figures(direction, largest=self.max_um, rms=self.rms_um), grid

    def _nodes(self) -> tuple[Floats, Floats, Floats]:
        return self.x_mm, self.y_mm, self.z_mm


@checked
def volumetric_error(
    setup: Setup,
    errors: Known = None,
    effects: Effects = None,
    x_mm: ArrayLike = (-150, 150),
    y_mm: ArrayLike = (-120, 120),
    z_mm: ArrayLike = (0, 150),
    a_deg: ArrayLike = 0,
    c_deg: ArrayLike = 0,
    *,
    b_deg: ArrayLike | None = None,
    placement: Mapping[str, float] | None = None,
    compensation: Compensation | None = None,
    rounded: bool = False,
    points: tuple[int, int, int] = (31, 25, 16),
    approach: Sequence[float] = (0.0, 0.0, 0.0),
    senses: Mapping[str, float] | None = None,
) -> VolumetricError:
    """Volumetric error over a box of the work, at one pose or over a grid of poses.

    Parameters
    ----------
    setup
        Machine (and the resolution, where commands are rounded).
    errors
        Location errors of the machine as it is, µm and arcsec, totals, or a result that has them
        (all of them: one that is not identifiable is refused); those of the set-up where not
        given.
    effects
        Effects as id → parameter → value. Those of probe, artefact and time do not enter.
    x_mm, y_mm, z_mm
        Each (low, high), or more than two nodes; workpiece's frame: the box turns with the table.
    a_deg, b_deg, c_deg
        Positions of the rotary axes, control's sign: numbers, or sequences that span a grid.
    placement
        Placement of the work on the table, unknown to the control unless compensated.
    compensation
        What the control does about it; None: the control assumes the nominal machine.
    rounded
        Round commands to the resolution of the set-up.
    points
        Nodes along x, y, z of each axis given as (low, high).
    approach, senses
        Direction of travel of the linear axes (machine frame) and sense of the last turn by letter:
        reversal errors depend on them. Zero: none acts, the middle of the lost motion (`idle` then
        lists them).

    Notes
    -----
    At one pose the error is affine in the point (no effect of the catalogue depends on X, Y, Z
    beyond scale and squareness), so maximum and mean square are found without visiting the points.
    Tables, rounding, all-axes compensation and users' own effects are sampled, pose by pose.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(artefact=tn.Artefact("cross"))
    >>> round(tn.volumetric_error(setup, {"EX0C": 15.0, "EZ0A": 20.0}).max_um, 6)
    25.0
    """
    state = MachineErrors.of(setup, errors, effects, placement)
    box = Workspace(x_mm, y_mm, z_mm, a_deg, c_deg, b_deg, points)
    task = _Task.of(setup, state, box, compensation, rounded, approach, senses or {})
    return task.result()


@checked
def error_fields(
    setup: Setup,
    errors: Known = None,
    effects: Effects = None,
    *,
    placement: Mapping[str, float] | None = None,
    compensation: Compensation | None = None,
    rounded: bool = False,
    approach: Sequence[float] = (0.0, 0.0, 0.0),
    senses: Mapping[str, float] | None = None,
    threads: int | None = None,
    **where: Unpack[Where],
) -> Iterator[PoseField]:
    """Fields pose by pose, for grids that do not fit in memory; arguments as `volumetric_error`.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> fields = tn.error_fields(setup, {"EX0C": 15.0}, points=(3, 3, 2))
    >>> next(iter(fields)).field_um.shape
    (3, 3, 2, 3)
    """
    state, box = MachineErrors.of(setup, errors, effects, placement), Workspace(**where)
    task = _Task.of(setup, state, box, compensation, rounded, approach, senses or {})
    chain = Chain(setup)
    shape = (*(len(axis) for axis in task.nodes), 3)
    if task.is_affine:
        fields, directions = task.affine_fields()
        grid = [axis.tolist() for axis in task.nodes]
        each: Iterator[tuple[Floats, float]] = (
            (_core.field_on_grid(field, grid, threads), float(direction))
            for field, direction in zip(fields, directions, strict=True)
        )
    else:
        each = task.sampled_fields()
    for pose, (vectors, direction) in zip(task.poses, each, strict=True):
        rotary = {k: float(q) for k, q in chain.to_control(pose).items()}
        yield PoseField(rotary, vectors.reshape(shape), direction)


@dataclass(frozen=True)
class _Task:
    """What is to be computed, checked.

    approach, senses: How a pose is reached: direction of travel, sense of the last turn by letter.
    """

    setup: Setup
    state: MachineErrors
    truth: _core.MachineModel
    nodes: tuple[Floats, Floats, Floats]
    rotary: Mapping[str, Floats]
    shape: tuple[int, ...]
    poses: Floats
    compensation: Compensation | None
    rounded: bool
    approach: Sequence[float]
    senses: Mapping[str, float]

    @classmethod
    def of(
        cls,
        setup: Setup,
        state: MachineErrors,
        where: Workspace,
        compensation: Compensation | None,
        rounded: bool,
        approach: Sequence[float],
        senses: Mapping[str, float],
    ) -> _Task:
        positions, shape = where.rotary(setup)
        is_compensation(compensation)
        return cls(
            setup=setup,
            state=state,
            truth=state.core(setup, approach, senses),
            nodes=where.nodes(),
            rotary=positions,
            shape=shape,
            poses=pose_grid(setup, positions),
            compensation=compensation,
            rounded=rounded,
            approach=approach,
            senses=senses,
        )

    @property
    def is_affine(self) -> bool:
        known = getattr(self.compensation, "known", None)
        own = self.state.own or (known is not None and known.own)
        by_model = self.compensation is None or isinstance(self.compensation, ControlModel)
        return by_model and not self.rounded and not own

    def result(self) -> VolumetricError:
        """Largest, mean square and direction at each pose, and the fields that were needed."""
        fields: Floats | None = None
        sampled: Floats | None = None
        if self.is_affine:
            fields, directions = self.affine_fields()
            grid = [axis.tolist() for axis in self.nodes]
            largest, squares = _core.field_statistics(fields, grid)
        else:
            largest, squares, directions = (np.empty(len(self.poses)) for _ in range(3))
            count = int(np.prod([len(axis) for axis in self.nodes]))
            if len(self.poses) * count * 3 <= LARGEST_FIELD:
                sampled = np.empty((len(self.poses), count, 3))
            for i, (vectors, direction) in enumerate(self.sampled_fields()):
                lengths = np.einsum("ij,ij->i", vectors, vectors)
                largest[i], squares[i] = np.sqrt(lengths.max()), lengths.mean()
                directions[i] = direction
                if sampled is not None:
                    sampled[i] = vectors
        return VolumetricError(
            float(largest.max()),
            float(np.sqrt(squares.mean())),
            largest.reshape(self.shape),
            np.sqrt(squares).reshape(self.shape),
            directions.reshape(self.shape),
            self.rotary,
            *self.nodes,
            ignored=self.state.ignored,
            idle=self.idle(),
            _fields=fields,
            _sampled=sampled,
        )

    def idle(self) -> tuple[str, ...]:
        """Effects that have values and still move nothing at any of the poses."""
        nominal = ModelCompensation(NOMINAL).control_model(self.setup)
        found = []
        for name, values in self.state.effects.items():
            if not any(values.values()):
                continue
            effect = MachineErrors(effects={name: values})
            alone = effect.core(self.setup, self.approach, self.senses)
            fields, directions = alone.fields(*nominal, self.poses)
            if not np.any(fields) and not np.any(directions):
                found.append(name)
        return tuple(found)

    def affine_fields(self) -> tuple[Floats, Floats]:
        known = self.compensation
        control = known if isinstance(known, ControlModel) else ModelCompensation(NOMINAL)
        return self.truth.fields(*control.control_model(self.setup), self.poses)

    def sampled_fields(self) -> Iterator[tuple[Floats, float]]:
        grid = np.stack(np.meshgrid(*self.nodes, indexing="ij"), axis=-1).reshape(-1, 3)
        nominal = NOMINAL.core(self.setup)
        for pose in self.poses:
            rotary = np.broadcast_to(pose, (len(grid), len(pose)))
            commands = control_commands(
                self.setup, self.compensation, grid, rotary, rounded=self.rounded
            )
            reached = self.truth.reached(commands, None)
            expected = nominal.reached(np.concatenate([np.zeros(3), pose])[None], None)[0, 3:]
            sine = np.linalg.norm(np.cross(reached[:, 3:], expected), axis=1)
            angle = np.arctan2(sine, reached[:, 3:] @ expected)
            field = (reached[:, :3] - grid) * 1e3
            if self.state.own:
                moved = self.state.motion_mm(self.setup, commands[:, :3], commands[:, 3:])
                field = field + 1e3 * self._on_work(moved, commands[:, 3:])
            yield field, float(np.degrees(angle.max()) * 3600.0)

    def _on_work(self, moved: Floats, rotary_deg: Floats) -> Floats:
        """Displacements in the machine frame, in the frame of the nominal table."""
        turn, _ = Chain(self.setup).table_pose(rotary_deg)
        return cast(Floats, np.einsum("nji,nj->ni", turn, moved))
