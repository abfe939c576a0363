"""The machine as a `pinocchio` model: an outside check of the kinematics, and a way to its tools.

Written from the conventions, without the core: location errors are the placements of the joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.errors import UnknownNameError
from trunnion.setup.names import canonical_error_name

if TYPE_CHECKING:
    from trunnion.setup import Setup

__all__ = ["pinocchio_model"]

_MM_PER_UM = 1e-3
_RAD_PER_ARCSEC = np.pi / 648000.0
_ERRORS = {
    "trt-ca": ("EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EX0C", "EY0C", "EB0C"),
    "trt-bc": ("EB0B", "EA0B", "EC0B", "EX0B", "EZ0B", "EX0C", "EY0C", "EA0C"),
    "table-c-head-b": (
        *("EB0B", "EA0B", "EC0B", "EX0B", "EZ0B"),
        *("EX0C", "EY0C", "EA0C", "EB0C"),
    ),
}


def pinocchio_model(setup: Setup, errors: Mapping[str, float] | None = None) -> Any:
    """Build a `pin.Model` of the machine, in mm and rad, with its errors as joint placements.

    Joints of one degree of freedom each, in the order of the configuration ``q``: X, Y, Z (mm, they
    carry the tool), then A and C (B and C on the other machines; rad, right-handed turns of the
    table, whatever the sense of the control). With ``data = model.createData()`` after
    ``pin.forwardKinematics``, ``data.oMi[model.getJointId("C")]`` is ``T_A Rx(a) T_C Rz(c)``.
    Frames "table" (workpiece side, after C) and "ball" (tool side) end the two chains. On
    ``table-c-head-b`` the B joint is the head's, ``setup.probe.length_mm`` above the ball.

    Parameters
    ----------
    setup
        Machine and probe length. Its known ``machine.errors`` hold where `errors` says nothing.
    errors
        Location errors, totals: µm for offsets, arcsec for tilts.

    Returns
    -------
    pin.Model

    Raises
    ------
    UnknownNameError
        For a preset or a location error that is in no list.
    ImportError
        Without pinocchio.
    """
    try:
        import pinocchio as pin
    except ImportError as error:
        raise ImportError(
            "pinocchio is not installed; expected for trunnion.pinocchio_model: "
            "pip install 'trunnion[reference]'"
        ) from error

    preset = setup.machine.preset
    if preset not in _ERRORS:
        raise UnknownNameError(f"preset: got {preset!r}, expected one of {', '.join(_ERRORS)}")
    given = {canonical_error_name(name): size for name, size in (errors or {}).items()}
    e = dict.fromkeys(_ERRORS[preset], 0.0)
    for name, size in {**setup.machine.errors, **given}.items():
        if name not in e:
            known = ", ".join(e)
            raise UnknownNameError(f"{preset}: got error {name!r}, expected one of {known}")
        e[name] = float(size) * (_MM_PER_UM if name[1] in "XYZ" else _RAD_PER_ARCSEC)

    def placed(tilts: tuple[float, float, float], offset: tuple[float, float, float]) -> Any:
        """Return the pose translate(offset) Rx Ry Rz."""
        alpha, beta, gamma = tilts
        turn = pin.utils.rotate("x", alpha) @ pin.utils.rotate("y", beta)
        rotation: NDArray[np.float64] = turn @ pin.utils.rotate("z", gamma)
        return pin.SE3(rotation, np.array(offset))

    # A point of the axis that tilts; which one along the axis is free, its frame is where that is 0.
    height = setup.probe.length_mm if preset == "table-c-head-b" else 0.0
    letter = "A" if preset == "trt-ca" else "B"
    x, y, z = setup.axis_points().get(letter, (0.0, 0.0, height))

    model = pin.Model()
    model.name = preset
    here = pin.SE3.Identity()
    tool = 0
    for name, joint in (("X", pin.JointModelPX), ("Y", pin.JointModelPY), ("Z", pin.JointModelPZ)):
        tool = model.addJoint(tool, joint(), here, name)

    if preset == "trt-ca":
        T_A = placed((e["EA0A"], e["EB0A"], e["EC0A"]), (0.0, y + e["EY0A"], z + e["EZ0A"]))
        T_C = placed((0.0, e["EB0C"] - e["EB0A"], 0.0), (e["EX0C"], e["EY0C"] - e["EY0A"] - y, -z))
        cradle = model.addJoint(0, pin.JointModelRX(), T_A, "A")
        table = model.addJoint(cradle, pin.JointModelRZ(), T_C, "C")
        ball = here
    elif preset == "trt-bc":
        T_B = placed((e["EA0B"], e["EB0B"], e["EC0B"]), (x + e["EX0B"], 0.0, z + e["EZ0B"]))
        T_C = placed((e["EA0C"] - e["EA0B"], 0.0, 0.0), (e["EX0C"] - e["EX0B"] - x, e["EY0C"], -z))
        cradle = model.addJoint(0, pin.JointModelRY(), T_B, "B")
        table = model.addJoint(cradle, pin.JointModelRZ(), T_C, "C")
        ball = here
    else:
        T_B = placed((e["EA0B"], e["EB0B"], e["EC0B"]), (x + e["EX0B"], 0.0, z + e["EZ0B"]))
        T_C = placed((e["EA0C"], e["EB0C"], 0.0), (e["EX0C"], e["EY0C"], 0.0))
        tool = model.addJoint(tool, pin.JointModelRY(), T_B, "B")
        table = model.addJoint(0, pin.JointModelRZ(), T_C, "C")
        ball = placed((0.0, 0.0, 0.0), (-x, 0.0, -z))

    model.addFrame(pin.Frame("table", table, here, pin.FrameType.OP_FRAME))
    model.addFrame(pin.Frame("ball", tool, ball, pin.FrameType.OP_FRAME))
    return model
