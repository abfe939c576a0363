"""The machine as a `pinocchio` model: an outside check of the kinematics, and a way to its tools.

Written from the conventions, only names come from the core: location errors are the
placements of the joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import optional_module
from trunnion.base.units import ARCSEC
from trunnion.machine.chain import Chain
from trunnion.reference.chain import LETTERS, Axes, RotaryAxis

if TYPE_CHECKING:
    from trunnion.setup import Setup

MM_PER_UM = 1e-3


def _errors(setup: Setup, errors: Mapping[str, float]) -> dict[str, float]:
    """Return every location error of the machine, mm and rad."""
    chain = Chain(setup)
    given = chain.named_errors(errors)
    factors = {"um": MM_PER_UM, "arcsec": ARCSEC}
    return {k: factors[unit] * given.get(k, 0.0) for k, unit in chain.location_errors.items()}


def _placed(pin: Any, axis: RotaryAxis, errors: Mapping[str, float]) -> Any:
    """Return the frame of an axis in the one that carries it: translate(offset) Rx Ry Rz."""
    *offset, alpha, beta, gamma = axis.amounts(errors)
    turns = (pin.utils.rotate(k, tilt) for k, tilt in zip("xyz", (alpha, beta, gamma), strict=True))
    rx, ry, rz = turns
    return pin.SE3(rx @ ry @ rz, axis.offset + np.array(offset))


def _joint(pin: Any, axis: RotaryAxis) -> Any:
    """Return a joint about the direction of an axis."""
    if np.array_equal(axis.direction, LETTERS[axis.letter]):
        return {"A": pin.JointModelRX, "B": pin.JointModelRY, "C": pin.JointModelRZ}[axis.letter]()
    return pin.JointModelRevoluteUnaligned(*axis.direction)


@checked
def pinocchio_model(setup: Setup, errors: Mapping[str, float] | None = None) -> Any:
    """Build a `pin.Model` of the machine, in mm and rad, with its errors as joint placements.

    Joints of one degree of freedom each, in the order of the configuration ``q``: X, Y, Z (mm, they
    carry the tool), then the rotary axes in the order of the machine (A and C on a ``trt-ca``; rad,
    right-handed turns, whatever the sense of the control). Joint C of a ``trt-ca`` is at
    ``T_A Rx(a) T_C Rz(c)``. Frames "table" (workpiece side) and "ball" (tool side) end the two
    chains. Axes of a head go through the pivot, ``setup.probe.length_mm`` above the ball, or where
    the set-up says.

    Parameters
    ----------
    setup
        Machine and probe length. Its known ``machine.errors`` hold where `errors` says nothing.
    errors
        Location errors, totals: µm for offsets, arcsec for tilts.

    Raises
    ------
    UnknownNameError
        For a location error that the machine has not.
    ImportError
        Without pinocchio.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> model = tn.pinocchio_model(setup, {"EX0C": 15.0})
    >>> list(model.names)[-2:]
    ['A', 'C']
    """
    pin = optional_module("pinocchio", "trunnion.pinocchio_model", "reference")
    axes, e = Axes.of(setup), _errors(setup, errors or {})
    model = pin.Model()
    model.name = setup.machine.name
    here = pin.SE3.Identity()
    tool = table = 0
    for name, joint in (("X", pin.JointModelPX), ("Y", pin.JointModelPY), ("Z", pin.JointModelPZ)):
        tool = model.addJoint(tool, joint(), here, name)
    for axis in axes.head:
        tool = model.addJoint(tool, _joint(pin, axis), _placed(pin, axis, e), axis.letter)
    for axis in axes.table:
        table = model.addJoint(table, _joint(pin, axis), _placed(pin, axis, e), axis.letter)
    # At zero of all axes both ends are in the origin of the machine frame.
    seat, ball = (
        pin.SE3(np.eye(3), -side[-1].origin) if side else here for side in (axes.table, axes.head)
    )
    for name, joint, place in (("table", table, seat), ("ball", tool, ball)):
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    return model
