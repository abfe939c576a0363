"""What the control does: from programmed poses to the commands of the axes.

A program asks for a tool point in the workpiece's frame with the rotary axes at given positions
(and means the tool direction that the nominal machine has there). Without compensation the control
sends what the nominal machine needs. Each compensation is a class with one method, `commands`,
which says what is sent instead. :func:`control_commands` is the one place where a control's
behaviour is put together, rounding included.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

import trunnion._core as _core
from trunnion.base.arguments import checked
from trunnion.base.checks import array, positive, shown
from trunnion.base.errors import InputError
from trunnion.base.units import Flags, Floats
from trunnion.compensation.machine import NOMINAL, Effects, Known, MachineErrors
from trunnion.machine.chain import Chain
from trunnion.setup import Setup


@runtime_checkable
class Compensation(Protocol):
    """What a control sends for programmed poses."""

    def commands(self, setup: Setup, points_mm: Floats, rotary_deg: Floats) -> Floats:
        """Commands (n, 3 + axes) for points (n, 3), rotary positions (n, axes), contract's sign."""
        ...


@runtime_checkable
class ControlModel(Protocol):
    """A compensation that is the machine which the control assumes, with zeros of its axes."""

    def control_model(self, setup: Setup) -> tuple[_core.MachineModel, list[float]]:
        """Return the assumed machine and the zeros added to rotary positions, arcsec."""
        ...


@dataclass(frozen=True)
class ModelCompensation:
    """Exact compensation by the linear axes alone: the control knows the identified machine.

    The tool point comes where it should be at every pose; the tool direction keeps its error. This
    is the limit of an error map with infinitely fine nodes.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> errors = {"EX0C": 15.0}
    >>> known = tn.ModelCompensation(tn.compensation.MachineErrors(errors))
    >>> round(tn.volumetric_error(setup, errors, compensation=known).max_um, 3)
    0.0
    """

    known: MachineErrors

    @classmethod
    @checked
    def of(cls, setup: Setup, errors: Known, effects: Effects = None) -> ModelCompensation:
        """Make it from errors and effects, or from a result that has them."""
        return cls(MachineErrors.to_compensate(setup, errors, effects))

    def control_model(self, setup: Setup) -> tuple[_core.MachineModel, list[float]]:
        """Return the identified machine; no zeros are changed."""
        return self.known.core(setup), [0.0] * Chain(setup).count

    @checked
    def commands(self, setup: Setup, points_mm: Floats, rotary_deg: Floats) -> Floats:
        """X, Y, Z of the identified machine, rotary axes as commanded."""
        linear = self.known.core(setup).linear_commands(points_mm, rotary_deg, None)
        if self.known.own:
            linear = linear - self.known.motion_mm(setup, linear, rotary_deg)
        return np.hstack([linear, rotary_deg])


@dataclass(frozen=True)
class InverseCompensation:
    """Exact compensation by all axes: point and direction right on the identified machine.

    Where no rotary positions within `largest_turn_deg` of the commanded ones give the direction
    (around A = 0 on a ``trt-ca``: the tilt errors make a cone of directions that no A and C reach,
    and beside it an arcsec of tilt costs degrees of C), only the tilting axis is corrected, and the
    linear axes still put the point right.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> errors = {"EX0C": 15.0}
    >>> known = tn.InverseCompensation(tn.compensation.MachineErrors(errors))
    >>> round(tn.volumetric_error(setup, errors, compensation=known).max_um, 3)
    0.0
    """

    known: MachineErrors
    largest_turn_deg: float = 1.0

    @classmethod
    @checked
    def of(
        cls, setup: Setup, errors: Known, effects: Effects = None, *, largest_turn_deg: float = 1.0
    ) -> InverseCompensation:
        """Make it from errors and effects, or from a result that has them."""
        positive("largest_turn_deg", largest_turn_deg)
        known = MachineErrors.to_compensate(setup, errors, effects)
        known.refuse_own(
            "its motion says nothing of the tool direction; use ModelCompensation or error_map"
        )
        return cls(known, largest_turn_deg)

    @checked
    def solve(
        self, setup: Setup, points_mm: Floats, rotary_deg: Floats, threads: int | None = None
    ) -> tuple[Floats, Floats, Flags]:
        """Commands, direction left in arcsec, and where the rotary axes were held back."""
        core = self.known.core(setup)
        return core.commands(points_mm, rotary_deg, self.largest_turn_deg, threads)

    @checked
    def commands(self, setup: Setup, points_mm: Floats, rotary_deg: Floats) -> Floats:
        """Return the positions of all axes on the identified machine."""
        return self.solve(setup, points_mm, rotary_deg)[0]


@dataclass(frozen=True)
class AxisCommands:
    """Commands of all axes.

    Attributes
    ----------
    linear_mm
        X, Y, Z, shape (n, 3).
    rotary_deg
        Letter → positions in the control's sign, shape (n,).
    direction_left_arcsec
        Angle between the tool direction reached and the one meant, on the machine that the
        commands were made for; None where it was not asked for.
    singular
        Where the rotary axes were held back; None where it was not asked for.
    """

    linear_mm: Floats
    rotary_deg: Mapping[str, Floats]
    direction_left_arcsec: Floats | None = None
    singular: Flags | None = None

    def __len__(self) -> int:
        return len(self.linear_mm)


def round_to(values: Floats, step: float) -> Floats:
    """To the nearest multiple of `step` (half to even: no drift); 0 leaves the values as they are.

    Rounded are absolute positions, never increments: a path that returns to its start ends exactly
    there.
    """
    return values if step == 0.0 else np.rint(values / step) * step


def rounded_commands(setup: Setup, commands: Floats) -> Floats:
    """Commands rounded to the resolution of the set-up, which is in µm and arcsec."""
    linear = round_to(commands[:, :3] * 1e3, setup.resolution.linear_um) * 1e-3
    rotary = round_to(commands[:, 3:] * 3600.0, setup.resolution.rotary_arcsec) / 3600.0
    return np.hstack([linear, rotary])


def nominal_commands(setup: Setup, points_mm: Floats, rotary_deg: Floats) -> Floats:
    """Return what is sent without compensation."""
    linear = NOMINAL.core(setup).linear_commands(points_mm, rotary_deg, None)
    return np.hstack([linear, rotary_deg])


def is_compensation(compensation: object) -> TypeGuard[Compensation]:
    """Whether there is one; what is neither one nor None is refused."""
    if compensation is not None and not isinstance(compensation, Compensation):
        raise InputError(f"compensation: got {shown(compensation)}, expected one or None")
    return compensation is not None


@checked
def control_commands(
    setup: Setup,
    compensation: Compensation | None,
    points_mm: Floats,
    rotary_deg: Floats,
    *,
    rounded: bool = False,
) -> Floats:
    """Return what the control sends for programmed poses: the whole behaviour of a control.

    Arguments and result as for `Compensation.commands`; without a compensation the commands are
    those of the nominal machine. `rounded`: to the control's resolution.
    """
    if is_compensation(compensation):
        commands = compensation.commands(setup, points_mm, rotary_deg)
    else:
        commands = nominal_commands(setup, points_mm, rotary_deg)
    return rounded_commands(setup, commands) if rounded else commands


@checked
def inverse_compensation(
    setup: Setup,
    errors: Known,
    points_mm: ArrayLike,
    rotary_deg: Mapping[str, ArrayLike],
    effects: Effects = None,
    *,
    axes: str = "all",
    largest_turn_deg: float = 1.0,
    rounded: bool = False,
    threads: int | None = None,
) -> AxisCommands:
    """Axis commands that put the tool right on the machine with these errors.

    Parameters
    ----------
    setup, errors, effects
        The machine as identified: errors by name, or a result.
    points_mm
        Tool points in the workpiece's frame, (n, 3).
    rotary_deg
        Letter of each rotary axis → commanded positions (a number or (n,)), control's sign. The
        tool direction meant is that of the nominal machine there.
    axes
        "all": point and direction; "linear": X, Y, Z alone, the point only.
    largest_turn_deg
        How far a rotary axis may be turned away from its commanded position; where that does not
        give the direction (near A = 0), `singular` is set and `direction_left_arcsec` says what
        is left.
    rounded
        Round to the resolution of the set-up.

    Raises
    ------
    InputError
        Points or rotary positions of another shape or not finite; unknown names.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> known, poses = {"EX0C": 15.0}, {"A": 0.0, "C": 0.0}
    >>> found = tn.inverse_compensation(setup, known, [[0.0, 0.0, 50.0]], poses)
    >>> found.linear_mm.round(3).tolist()
    [[0.015, 0.0, 50.0]]
    """
    points = array("points_mm", points_mm, 3)
    chain = Chain(setup)
    rotary = chain.to_machine(rotary_deg, len(points))
    left: Floats | None = None
    singular: Flags | None = None
    if axes == "all":
        inverse = InverseCompensation.of(setup, errors, effects, largest_turn_deg=largest_turn_deg)
        commands, left, singular = inverse.solve(setup, points, rotary, threads)
    elif axes == "linear":
        commands = ModelCompensation.of(setup, errors, effects).commands(setup, points, rotary)
    else:
        raise InputError(f'axes: got {axes!r}, expected "all" or "linear"')
    if rounded:
        commands = rounded_commands(setup, commands)
    return AxisCommands(commands[:, :3], chain.to_control(commands[:, 3:]), left, singular)
