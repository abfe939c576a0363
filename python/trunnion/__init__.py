"""trunnion: the geometric accuracy of machine tools.

A model says what an instrument would read; an effect is a named group of parameters that changes
it; identification estimates parameters; diagnosis decides which effects the data demand;
compensation turns parameters into corrected commands.
"""

from trunnion import casadi_baseline, contouring, hybrid, nc, turning
from trunnion._core import __version__
from trunnion.closed_forms import closed_form
from trunnion.comparison import Comparison, compare_methods
from trunnion.compensation import (
    CncParameters,
    ErrorMap,
    InverseCompensation,
    ModelCompensation,
    VolumetricError,
    cnc_parameters,
    error_fields,
    error_map,
    inverse_compensation,
    printed_zeros,
    read_error_map,
    remeasure,
    residual_interval,
    volumetric_error,
)
from trunnion.data.axis_log import AxisLog, read_axis_log
from trunnion.data.ballbar import Ballbar, read_ballbar
from trunnion.data.diameters import Diameters, read_diameters
from trunnion.data.linuxcnc_log import read_probe_log
from trunnion.data.points import Points, read_points
from trunnion.data.sweep import Sweep, read_sweep
from trunnion.data.touches import Touches, read_touches
from trunnion.diagnosis import Alternative, Cause, Diagnosis, Gain, diagnose
from trunnion.errors import (
    DataError,
    FileFormatError,
    InputError,
    KinematicsError,
    ProgramError,
    TrunnionError,
    UnknownNameError,
)
from trunnion.identification import identify, identify_many
from trunnion.kinematics import forward_kinematics, inverse_kinematics, kinematic_jacobian
from trunnion.models.axis_log import AxisLogModel, ExtendedServo
from trunnion.models.ballbar import BallbarModel
from trunnion.models.diameters import DiameterLaw
from trunnion.models.next_passes import NextPass, next_passes
from trunnion.models.next_touches import Prospect, next_touches, prospect
from trunnion.models.points import ExtendedPoints, RepeatablePart, repeatable_part
from trunnion.models.sweep import Circle, ExtendedSweep, circles
from trunnion.names import canonical_error_name
from trunnion.observability import Observability, observability
from trunnion.pinocchio_model import pinocchio_model
from trunnion.planning import plan
from trunnion.results import ClosedFormResult, IdentificationResult
from trunnion.samples import sample_path
from trunnion.setup import (
    Artefact,
    AxisSetup,
    Machine,
    PlanSetup,
    Probe,
    Resolution,
    Setup,
    TableSetup,
    read_setup,
)
from trunnion.simulation import simulate
from trunnion.sweeps import open_sweep, smallest_length_mm, sweep
from trunnion.touch_model import EffectInfo, UserEffect, catalogue

__all__ = [
    "DataError",
    "FileFormatError",
    "InputError",
    "KinematicsError",
    "ProgramError",
    "TrunnionError",
    "UnknownNameError",
    "__version__",
]

# --- data
__all__ += [
    "Artefact",
    "AxisLog",
    "AxisSetup",
    "Ballbar",
    "Diameters",
    "Machine",
    "PlanSetup",
    "Points",
    "Probe",
    "Resolution",
    "Setup",
    "Sweep",
    "TableSetup",
    "Touches",
    "canonical_error_name",
    "read_axis_log",
    "read_ballbar",
    "read_diameters",
    "read_points",
    "read_probe_log",
    "read_setup",
    "read_sweep",
    "read_touches",
]

# --- references
__all__ += [
    "Comparison",
    "casadi_baseline",
    "compare_methods",
    "pinocchio_model",
]

# --- compensation
__all__ += [
    "CncParameters",
    "ErrorMap",
    "InverseCompensation",
    "ModelCompensation",
    "VolumetricError",
    "cnc_parameters",
    "error_fields",
    "error_map",
    "inverse_compensation",
    "printed_zeros",
    "read_error_map",
    "remeasure",
    "residual_interval",
    "volumetric_error",
]

# --- trunnion (paper 000), in the order of the main job
__all__ += [
    "ClosedFormResult",
    "EffectInfo",
    "IdentificationResult",
    "Observability",
    "UserEffect",
    "catalogue",
    "closed_form",
    "forward_kinematics",
    "identify",
    "identify_many",
    "inverse_kinematics",
    "kinematic_jacobian",
    "observability",
    "plan",
    "sample_path",
    "simulate",
]

# --- diagnosis
__all__ += [
    "Alternative",
    "Cause",
    "Diagnosis",
    "Gain",
    "Prospect",
    "diagnose",
    "next_touches",
    "prospect",
]

# --- turning (paper 001)
__all__ += [
    "DiameterLaw",
    "NextPass",
    "nc",
    "next_passes",
    "turning",
]

# --- hybrid machine and ball-bar (paper 004)
__all__ += [
    "BallbarModel",
    "hybrid",
]

# --- sweeps
__all__ += [
    "open_sweep",
    "smallest_length_mm",
    "sweep",
]

# --- measured
__all__ += [
    "Circle",
    "ExtendedPoints",
    "ExtendedSweep",
    "RepeatablePart",
    "circles",
    "repeatable_part",
]
# --- contouring (paper 003)
__all__ += ["AxisLogModel", "ExtendedServo", "contouring"]
