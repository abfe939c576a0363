"""Compensation: from errors to corrected commands, and the volumetric error before and after.

- `volumetric`: the volumetric error of a machine over a box of the work, compensated or not;
- `control`: what a control sends, exact compensation by the linear axes and by all axes;
- `maps`: corrections as a table, computed, written, read;
- `parameters`: zeros and centres of the axes, the paper's equations (22) to (24);
- `forecast`: what each way to compensate leaves, over one work space;
- `uncertainty`: what an uncertain identification will leave;
- `measuring`: a measurement of the compensated machine;
- `verification`: a ball on the table, found at every posture before and after.
"""

from trunnion.compensation.control import AxisCommands as AxisCommands
from trunnion.compensation.control import Compensation as Compensation
from trunnion.compensation.control import InverseCompensation as InverseCompensation
from trunnion.compensation.control import ModelCompensation as ModelCompensation
from trunnion.compensation.control import control_commands as control_commands
from trunnion.compensation.control import inverse_compensation as inverse_compensation
from trunnion.compensation.forecast import CompensationForecast as CompensationForecast
from trunnion.compensation.forecast import compensation_forecast as compensation_forecast
from trunnion.compensation.machine import MachineErrors as MachineErrors
from trunnion.compensation.maps import ErrorMap as ErrorMap
from trunnion.compensation.maps import error_map as error_map
from trunnion.compensation.maps import read_error_map as read_error_map
from trunnion.compensation.measuring import remeasure as remeasure
from trunnion.compensation.parameters import CncParameters as CncParameters
from trunnion.compensation.parameters import Removable as Removable
from trunnion.compensation.parameters import cnc_parameters as cnc_parameters
from trunnion.compensation.printed_zeros import PrintedZeros as PrintedZeros
from trunnion.compensation.printed_zeros import printed_zeros as printed_zeros
from trunnion.compensation.uncertainty import ResidualInterval as ResidualInterval
from trunnion.compensation.uncertainty import residual_interval as residual_interval
from trunnion.compensation.uncertainty import volumetric_budget as volumetric_budget
from trunnion.compensation.verification import BallVerification as BallVerification
from trunnion.compensation.verification import verify_ball as verify_ball
from trunnion.compensation.volumetric import PoseField as PoseField
from trunnion.compensation.volumetric import VolumetricError as VolumetricError
from trunnion.compensation.volumetric import error_fields as error_fields
from trunnion.compensation.volumetric import volumetric_error as volumetric_error
from trunnion.machine.effects import MotionPose as MotionPose
