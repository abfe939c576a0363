"""Compensation: from errors to corrected commands, and the volumetric error before and after.

- `volumetric`: the volumetric error of a machine over a box of the work, compensated or not;
- `control`: what a control sends, exact compensation by the linear axes and by all axes;
- `maps`: corrections as a table, computed, written, read;
- `parameters`: zeros and centres of the axes, the paper's equations (22) to (24);
- `uncertainty`: what an uncertain identification will leave;
- `measuring`: a measurement of the compensated machine.
"""

from trunnion.compensation.control import (
    AxisCommands,
    Compensation,
    InverseCompensation,
    ModelCompensation,
    control_commands,
    inverse_compensation,
)
from trunnion.compensation.machine import MachineErrors
from trunnion.compensation.maps import ErrorMap, error_map, read_error_map
from trunnion.compensation.measuring import remeasure
from trunnion.compensation.parameters import (
    CncParameters,
    PrintedZeros,
    Removable,
    cnc_parameters,
    printed_zeros,
)
from trunnion.compensation.uncertainty import ResidualInterval, residual_interval
from trunnion.compensation.volumetric import (
    PoseField,
    VolumetricError,
    error_fields,
    volumetric_error,
)
from trunnion.machine.effects import MotionPose

__all__ = [
    "AxisCommands",
    "CncParameters",
    "Compensation",
    "ErrorMap",
    "InverseCompensation",
    "MachineErrors",
    "ModelCompensation",
    "MotionPose",
    "PoseField",
    "PrintedZeros",
    "Removable",
    "ResidualInterval",
    "VolumetricError",
    "cnc_parameters",
    "control_commands",
    "error_fields",
    "error_map",
    "inverse_compensation",
    "printed_zeros",
    "read_error_map",
    "remeasure",
    "residual_interval",
    "volumetric_error",
]
