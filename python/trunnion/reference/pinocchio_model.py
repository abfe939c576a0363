"""The machine as a `pinocchio` model: an outside check of the kinematics, and a way to its tools.

Written from the conventions, only names come from the core: location errors are the
placements of the joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import trunnion._core as _core
from trunnion.base.arguments import checked
from trunnion.base.checks import choose, optional_module
from trunnion.base.units import ARCSEC, unit_of
from trunnion.setup.names import canonical_error_name

if TYPE_CHECKING:
    from trunnion.setup import Setup

MM_PER_UM = 1e-3


def _errors(setup: Setup, errors: Mapping[str, float]) -> dict[str, float]:
    """Return every location error of the machine, mm and rad."""
    preset = setup.machine.preset
    given = {canonical_error_name(name): size for name, size in errors.items()}
    presets = _core.presets()
    e = {name: 0.0 for name, _ in presets[choose("preset", preset, presets)][2]}
    for name, size in {**setup.machine.errors, **given}.items():
        factor = MM_PER_UM if unit_of(name) == "µm" else ARCSEC
        e[choose(f"errors of {preset}", name, e)] = float(size) * factor
    return e


def _placed(pin: Any, tilts: tuple[float, float, float], offset: tuple[float, float, float]) -> Any:
    """Return the pose translate(offset) Rx Ry Rz."""
    turns = (pin.utils.rotate(axis, tilt) for axis, tilt in zip("xyz", tilts, strict=True))
    alpha, beta, gamma = turns
    return pin.SE3(alpha @ beta @ gamma, np.array(offset))


@checked
def pinocchio_model(setup: Setup, errors: Mapping[str, float] | None = None) -> Any:
    """Build a `pin.Model` of the machine, in mm and rad, with its errors as joint placements.

    Joints of one degree of freedom each, in the order of the configuration ``q``: X, Y, Z (mm, they
    carry the tool), then A and C (B and C on the other machines; rad, right-handed turns of the
    table, whatever the sense of the control). Joint C is at ``T_A Rx(a) T_C Rz(c)``. Frames "table"
    (workpiece side, after C) and "ball" (tool side) end the two chains. On ``table-c-head-b`` the B
    joint is the head's, ``setup.probe.length_mm`` above the ball.

    Parameters
    ----------
    setup
        Machine and probe length. Its known ``machine.errors`` hold where `errors` says nothing.
    errors
        Location errors, totals: µm for offsets, arcsec for tilts.

    Raises
    ------
    UnknownNameError
        For a preset or a location error that is in no list.
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
    preset = setup.machine.preset
    e, placed = _errors(setup, errors or {}), partial(_placed, pin)
    model = pin.Model()
    model.name = preset
    here = ball = pin.SE3.Identity()
    tool = 0
    for name, joint in (("X", pin.JointModelPX), ("Y", pin.JointModelPY), ("Z", pin.JointModelPZ)):
        tool = model.addJoint(tool, joint(), here, name)
    # A point of the axis that tilts: the one whose coordinate along the axis is 0 is its frame.
    height = setup.probe.length_mm if preset == "table-c-head-b" else 0.0
    letter = "A" if preset == "trt-ca" else "B"
    x, y, z = setup.axis_points().get(letter, (0.0, 0.0, height))
    if preset == "trt-ca":
        T_A = placed((e["EA0A"], e["EB0A"], e["EC0A"]), (0.0, y + e["EY0A"], z + e["EZ0A"]))
        offset = (e["EX0C"], e["EY0C"] - e["EY0A"] - y, -z)
        T_C = placed((0.0, e["EB0C"] - e["EB0A"], 0.0), offset)
        cradle = model.addJoint(0, pin.JointModelRX(), T_A, "A")
        table = model.addJoint(cradle, pin.JointModelRZ(), T_C, "C")
    elif preset == "trt-bc":
        T_B = placed((e["EA0B"], e["EB0B"], e["EC0B"]), (x + e["EX0B"], 0.0, z + e["EZ0B"]))
        offset = (e["EX0C"] - e["EX0B"] - x, e["EY0C"], -z)
        T_C = placed((e["EA0C"] - e["EA0B"], 0.0, 0.0), offset)
        cradle = model.addJoint(0, pin.JointModelRY(), T_B, "B")
        table = model.addJoint(cradle, pin.JointModelRZ(), T_C, "C")
    else:
        T_B = placed((e["EA0B"], e["EB0B"], e["EC0B"]), (x + e["EX0B"], 0.0, z + e["EZ0B"]))
        T_C = placed((e["EA0C"], e["EB0C"], 0.0), (e["EX0C"], e["EY0C"], 0.0))
        tool = model.addJoint(tool, pin.JointModelRY(), T_B, "B")
        table = model.addJoint(0, pin.JointModelRZ(), T_C, "C")
        ball = placed((0.0, 0.0, 0.0), (-x, 0.0, -z))

    for name, joint, place in (("table", table, here), ("ball", tool, ball)):
        model.addFrame(pin.Frame(name, joint, place, pin.FrameType.OP_FRAME))
    return model
