"""The set-up: machine, artefact and probe of a measurement, read from ``setup.toml`` or built."""

from trunnion.setup.parts import (
    Artefact,
    AxisSetup,
    ControlSetup,
    Machine,
    PlanSetup,
    Probe,
    Resolution,
    Setup,
    TableSetup,
)
from trunnion.setup.read import read_setup

__all__ = [
    "Artefact",
    "AxisSetup",
    "ControlSetup",
    "Machine",
    "PlanSetup",
    "Probe",
    "Resolution",
    "Setup",
    "TableSetup",
    "read_setup",
]
