# The public names in pipeline order; read at run time, too (lazy_loader), so each stands once.

# --- errors
# --- the other machines, part programs, pictures, samples
from . import contouring as contouring
from . import datasets as datasets
from . import hybrid as hybrid
from . import nc as nc
from . import plot as plot
from . import turning as turning
from ._core import __version__ as __version__
from .base.conformity import Conformity as Conformity
from .base.errors import DataError as DataError
from .base.errors import FileFormatError as FileFormatError
from .base.errors import InputError as InputError
from .base.errors import KinematicsError as KinematicsError
from .base.errors import ProgramError as ProgramError
from .base.errors import TrunnionError as TrunnionError
from .base.errors import UnknownNameError as UnknownNameError

# --- compensation
from .compensation import CncParameters as CncParameters
from .compensation import ErrorMap as ErrorMap
from .compensation import InverseCompensation as InverseCompensation
from .compensation import ModelCompensation as ModelCompensation
from .compensation import VolumetricError as VolumetricError
from .compensation import cnc_parameters as cnc_parameters
from .compensation import error_fields as error_fields
from .compensation import error_map as error_map
from .compensation import inverse_compensation as inverse_compensation
from .compensation import printed_zeros as printed_zeros
from .compensation import read_error_map as read_error_map
from .compensation import remeasure as remeasure
from .compensation import residual_interval as residual_interval
from .compensation import volumetric_budget as volumetric_budget
from .compensation import volumetric_error as volumetric_error

# --- measured data
from .data.axis_log import AxisLog as AxisLog
from .data.axis_log import read_axis_log as read_axis_log
from .data.ballbar import Ballbar as Ballbar
from .data.ballbar import read_ballbar as read_ballbar
from .data.clocks import ClockOffset as ClockOffset
from .data.clocks import align_clocks as align_clocks
from .data.diameters import Diameters as Diameters
from .data.diameters import read_diameters as read_diameters
from .data.flatness import Flatness as Flatness
from .data.flatness import Straightness as Straightness
from .data.flatness import Twist as Twist
from .data.iso230_2 import CompensationTable as CompensationTable
from .data.iso230_2 import Iso2302 as Iso2302
from .data.iso230_2 import Iso2302Rotary as Iso2302Rotary
from .data.iso230_4 import Iso2304 as Iso2304
from .data.iso230_4 import iso230_4 as iso230_4
from .data.levels import Levels as Levels
from .data.levels import read_levels as read_levels
from .data.linuxcnc_log import read_probe_log as read_probe_log
from .data.points import Points as Points
from .data.points import read_points as read_points
from .data.positioning import Positioning as Positioning
from .data.positioning import read_positioning as read_positioning
from .data.sweep import Sweep as Sweep
from .data.sweep import read_sweep as read_sweep
from .data.touches import Touches as Touches
from .data.touches import read_touches as read_touches
from .diagnosis.catalogues import installed_effects as installed_effects
from .diagnosis.catalogues import read_effects as read_effects
from .diagnosis.catalogues import write_effects as write_effects
from .diagnosis.contributions import Contribution as Contribution
from .diagnosis.contributions import Ladder as Ladder
from .diagnosis.formula import FormulaEffect as FormulaEffect
from .diagnosis.records import Alternative as Alternative
from .diagnosis.records import Cause as Cause
from .diagnosis.records import Gain as Gain
from .diagnosis.result import Diagnosis as Diagnosis
from .diagnosis.structure import Structure as Structure
from .machine.budget import Budget as Budget
from .machine.effects import EffectInfo as EffectInfo

# --- the machine: kinematics, effects, what a measurement says of it
from .machine.effects import UserEffect as UserEffect
from .machine.estimate import Estimate as Estimate
from .machine.estimate import read_estimate as read_estimate
from .machine.kinematics import forward_kinematics as forward_kinematics
from .machine.kinematics import inverse_kinematics as inverse_kinematics
from .machine.kinematics import kinematic_jacobian as kinematic_jacobian
from .models.axis_log import AxisLogModel as AxisLogModel
from .models.axis_log import ExtendedServo as ExtendedServo
from .models.ballbar import BallbarModel as BallbarModel
from .models.changes import MachineComparison as MachineComparison
from .models.compare import compare as compare
from .models.diameters import DiameterLaw as DiameterLaw
from .models.instruments import InstrumentComparison as InstrumentComparison
from .models.instruments import whose_error as whose_error

# --- diagnosis of any kind of data
from .models.kinds import catalogue as catalogue
from .models.kinds import diagnose as diagnose
from .models.many import DiagnosisBatch as DiagnosisBatch
from .models.many import FailedDiagnosis as FailedDiagnosis
from .models.many import diagnose_many as diagnose_many
from .models.next_passes import NextPass as NextPass
from .models.next_passes import next_passes as next_passes
from .models.next_touches import ExpectedDiscrimination as ExpectedDiscrimination
from .models.next_touches import expected_discrimination as expected_discrimination
from .models.next_touches import next_touches as next_touches
from .models.points import ExtendedPoints as ExtendedPoints
from .models.points import RepeatablePart as RepeatablePart
from .models.points import repeatable_part as repeatable_part
from .models.read import read as read
from .models.rotary import Circle as Circle
from .models.rotary import ExtendedSweep as ExtendedSweep
from .models.rotary import circles as circles
from .models.rotary import fit_circles as fit_circles
from .models.turned_passes import simulate_diameters as simulate_diameters

# --- probing an artefact: plan, simulate, identify
from .probing.closed_form import closed_form as closed_form
from .probing.identify import identify as identify
from .probing.identify import identify_many as identify_many
from .probing.length import smallest_length_mm as smallest_length_mm
from .probing.notes import plan_notes as plan_notes
from .probing.observability import Observability as Observability
from .probing.observability import observability as observability
from .probing.plan import plan as plan
from .probing.program import ProbingProgram as ProbingProgram
from .probing.program import probing_program as probing_program
from .probing.result import ClosedFormResult as ClosedFormResult
from .probing.result import IdentificationResult as IdentificationResult
from .probing.simulate import simulate as simulate

# --- outside checks
from .reference import casadi_baseline as casadi_baseline
from .reference.comparison import Comparison as Comparison
from .reference.comparison import compare_methods as compare_methods
from .reference.pinocchio_model import pinocchio_model as pinocchio_model
from .samples import sample_path as sample_path

# --- the set-up: machine, artefact, probe
from .setup import Artefact as Artefact
from .setup import AxisSetup as AxisSetup
from .setup import ControlSetup as ControlSetup
from .setup import Machine as Machine
from .setup import PlanSetup as PlanSetup
from .setup import Probe as Probe
from .setup import ReportSetup as ReportSetup
from .setup import Resolution as Resolution
from .setup import Setup as Setup
from .setup import TableSetup as TableSetup
from .setup import read_setup as read_setup
from .setup.names import canonical_error_name as canonical_error_name

# --- parameter studies
from .studies import open_sweep as open_sweep
from .studies import sweep as sweep
