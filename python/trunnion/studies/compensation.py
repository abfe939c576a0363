"""What compensation leaves: virtual calibrations, then the volumetric error of what they missed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trunnion.studies.calibration import CALIBRATION_PARAMETERS, bench_of
from trunnion.studies.study import Block, Output, Parameter, Seeds, Values

METHODS = ("identified", "separating", "printed")
GRID_MM = tuple(
    np.linspace(low, high, count).tolist()
    for low, high, count in ((-150, 150, 31), (-120, 120, 25), (0, 150, 16))
)
"""The paper's volume, with the nodes of :func:`trunnion.volumetric_error`."""


@dataclass(frozen=True)
class CompensationStudy:
    """Volumetric error before compensation, and left after it with the estimated errors.

    The control puts the tool point right, with the linear axes, for the machine of the estimates:
    :class:`trunnion.ModelCompensation`, over the paper's volume at one position of A and C. The
    whole of it runs in the core on all cores.
    """

    name: str = "compensation"
    chunk: int = 20_000
    parameters: Mapping[str, Parameter] = field(
        default_factory=lambda: {
            **CALIBRATION_PARAMETERS,
            "method": Parameter("identified", choices=METHODS),
            "a_deg": Parameter(0.0, "deg"),
            "c_deg": Parameter(0.0, "deg"),
        }
    )

    def outputs(self, values: Values) -> tuple[Output, ...]:  # noqa: ARG002
        """Largest and root-mean-square volumetric error, before and after."""
        return (
            Output("before_max_um", "µm", label="largest volumetric error before compensation"),
            Output("before_rms_um", "µm", label="rms volumetric error before compensation"),
            Output("left_max_um", "µm", label="largest volumetric error left"),
            Output("left_rms_um", "µm", label="rms volumetric error left"),
        )

    def run(
        self, values: Values, seeds: Seeds, first: int, count: int, threads: int | None
    ) -> Block:
        """One call of the core."""
        bench = bench_of(values)
        truths = bench.truths(seeds, first, count)
        method: Any = values["method"]  # one of METHODS, as the study checks
        measurements = bench.measurements(float(values["noise_um"]), seeds)
        rows, failures = measurements.compensations(
            truths,
            first_sample=first,
            method=method,
            grid=GRID_MM,
            rotary_deg=[float(values["a_deg"]), float(values["c_deg"])],
            threads=threads,
        )
        return Block(rows, bench.described(truths, failures))
