"""The set-up: machine, artefact and probe of a measurement, read from ``setup.toml`` or built."""

from trunnion.setup.artefact import Artefact as Artefact
from trunnion.setup.control import ControlSetup as ControlSetup
from trunnion.setup.machine import AxisSetup as AxisSetup
from trunnion.setup.machine import Machine as Machine
from trunnion.setup.parts import PlanSetup as PlanSetup
from trunnion.setup.parts import Probe as Probe
from trunnion.setup.parts import Resolution as Resolution
from trunnion.setup.parts import Setup as Setup
from trunnion.setup.parts import TableSetup as TableSetup
from trunnion.setup.read import read_setup as read_setup
from trunnion.setup.report import ReportSetup as ReportSetup
