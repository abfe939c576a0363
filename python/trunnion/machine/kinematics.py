"""Forward and inverse kinematics of the machine, nominal or with its location errors.

The tool pose is the tool point in mm and the direction of the tool, a unit vector from its point to
the spindle, both in the workpiece's frame. Axis positions are X, Y, Z in mm and the rotary
positions in degrees in the order of the machine's preset (A, C; B, C), with the contract's signs
(`sense` of the set-up file is not applied).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.arguments import checked
from trunnion.base.checks import array, choose
from trunnion.base.errors import InputError
from trunnion.base.units import Flags, Floats
from trunnion.machine.chain import Chain
from trunnion.setup import Setup


class AxisSolution(NamedTuple):
    """Axis positions for tool poses.

    Attributes
    ----------
    axes
        (n, 5): X, Y, Z in mm, rotary positions in degrees.
    singular
        (n,): the tool is parallel to the second rotary axis (A = 0 on a `trt-ca`), whose position
        is then free and was left at the reference.
    """

    axes: Floats
    singular: Flags


@checked
def forward_kinematics(
    setup: Setup, axes: ArrayLike, errors: Mapping[str, float] | None = None
) -> tuple[Floats, Floats]:
    """Tool point and direction in the workpiece's frame.

    Parameters
    ----------
    axes
        (n, 5) or (5,): X, Y, Z in mm and the rotary positions in degrees.
    errors
        Location errors, µm and arcsec; {} for the nominal machine, None for the set-up's.

    Returns
    -------
    point_mm, direction
        (n, 3) each.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> point, direction = tn.forward_kinematics(setup, [10.0, 0.0, 50.0, 0.0, 90.0])
    >>> point.round(6) + 0.0
    array([[  0., -10.,  50.]])
    """
    machine = Chain(setup).machine(errors)
    tools = machine.forward(array("axes", axes, 3 + len(machine.letters)))
    return tools[:, :3], tools[:, 3:]


@checked
def kinematic_jacobian(
    setup: Setup, axes: ArrayLike, errors: Mapping[str, float] | None = None
) -> Floats:
    """Exact derivative of the tool pose.

    Returns
    -------
    numpy.ndarray
        (n, 6, 5): rows are the tool point (mm) and direction, columns X, Y, Z (per mm) and the
        rotary axes (per degree).

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> tn.kinematic_jacobian(setup, [10.0, 0.0, 50.0, 0.0, 90.0]).shape
    (1, 6, 5)
    """
    machine = Chain(setup).machine(errors)
    width = 3 + len(machine.letters)
    return machine.jacobian(array("axes", axes, width)).reshape(-1, 6, width)


@checked
def inverse_kinematics(
    setup: Setup,
    point_mm: ArrayLike,
    direction: ArrayLike,
    *,
    branch: Literal["positive", "negative", "nearest"] = "positive",
    reference_deg: ArrayLike | None = None,
    errors: Mapping[str, float] | None = None,
) -> AxisSolution:
    """Axis positions that reach tool poses.

    Parameters
    ----------
    point_mm, direction
        (n, 3) each: tool point and unit direction in the workpiece's frame.
    branch
        Of the two solutions the one with the tilting axis on its positive or negative side, or
        the one whose rotary positions are nearest to `reference_deg`.
    reference_deg
        Rotary positions to stay near to and to keep where a pose is singular; zeros unless given.
    errors
        Location errors of the machine; {} for the nominal one, None for the set-up's. With errors
        the axes are those of the erroneous machine, found from the nominal branch.

    Raises
    ------
    KinematicsError
        A direction the machine cannot take, for instance inside the cone around the second rotary
        axis that a squareness error makes unreachable.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> found = tn.inverse_kinematics(setup, [0.0, 0.0, 50.0], [0.0, 0.6, 0.8])
    >>> found.axes.round(3) + 0.0
    array([[  0.  , -30.  ,  40.  ,  36.87,   0.  ]])
    """
    machine = Chain(setup).machine(errors)
    axes_count = len(machine.letters)
    points = array("point_mm", point_mm, 3)
    directions = array("direction", direction, 3)
    if len(points) != len(directions):
        raise InputError(
            f"direction: got {len(directions)} rows, expected {len(points)}, one a tool point"
        )
    reference = np.zeros(axes_count)
    if reference_deg is not None:
        reference = array("reference_deg", reference_deg, axes_count, rows=1)[0]
    tools = np.hstack([points, directions])
    both, singular = machine.inverse(tools, reference)
    both = both.reshape(-1, 2, 3 + axes_count)
    choose("branch", branch, ("positive", "negative", "nearest"))
    if branch == "nearest":
        turns = (both[:, :, 3:] - reference + 180.0) % 360.0 - 180.0
        nearest = np.argmin(np.abs(turns).sum(axis=2), axis=1)
        chosen = both[np.arange(len(both)), nearest]
    else:
        chosen = both[:, 0 if branch == "positive" else 1]
    chosen = np.ascontiguousarray(chosen)
    if (errors is None and setup.machine.errors) or errors:
        chosen = machine.inverse_exact(tools, chosen)
    return AxisSolution(chosen, singular)
