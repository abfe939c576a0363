"""trunnion: the geometric accuracy of machine tools.

A model says what an instrument would read; an effect is a named group of parameters that changes
it; identification estimates parameters; diagnosis decides which effects the data demand;
compensation turns parameters into corrected commands.

The public names and where each lives stand in ``__init__.pyi``. They are imported when they are
used, so that ``import trunnion`` costs next to nothing. ``dir(trunnion)`` lists what one begins
with, `MAIN`; everything else is on the page of its subject in the documentation.
"""

from typing import Any

import lazy_loader

from trunnion.base.interrupts import held_interrupts

MAIN = (
    # samples and measured data of others
    *("sample_path", "datasets"),
    # the set-up
    *("read_setup", "Setup", "Machine", "AxisSetup", "Artefact", "Probe"),
    # measured data
    *("read", "Touches", "Points", "Sweep", "Diameters", "Ballbar", "Positioning", "Levels"),
    *("AxisLog", "read_probe_log"),
    # measure
    *("observability", "plan", "plan_for", "probing_program", "simulate"),
    # estimate
    *("identify", "closed_form", "Estimate", "read_estimate"),
    # diagnose
    *("diagnose", "diagnose_many", "catalogue", "next_measurement", "next_touches"),
    *("next_passes", "compare"),
    # compensate
    *("volumetric_error", "cnc_parameters", "error_map", "ModelCompensation", "residual_interval"),
    # studies, other processes, pictures
    *("sweep", "open_sweep", "turning", "contouring", "hybrid", "nc", "plot"),
    *("TrunnionError", "__version__"),
)

_public, _, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Import a public name: Ctrl-C comes after it."""
    with held_interrupts():
        return _public(name)


def __dir__() -> list[str]:
    """List the names that one begins with, in the order of the work."""
    return list(MAIN)
