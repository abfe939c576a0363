"""What compensation leaves: virtual calibrations, then the volumetric error of what they missed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from trunnion.compensation import volumetric_error
from trunnion.sweeps.calibration import CALIBRATION_PARAMETERS, Bench, bench_of
from trunnion.sweeps.study import Block, Floats, Output, Parameter, Seeds, Value, guarded

__all__ = ["CompensationStudy"]

METHODS = ("identified", "separating", "printed")


@dataclass(frozen=True)
class CompensationStudy:
    """Volumetric error before compensation, and left after it with the errors as estimated.

    What is left is the volumetric error of a machine whose location errors are truth minus
    estimate, exact but for products of errors (1e-4 of the result at 60 µm and 60″), over the
    paper's volume at one position of A and C.
    """

    name: str = "compensation"
    chunk: int = 500
    parameters: Mapping[str, Parameter] = field(
        default_factory=lambda: {
            **CALIBRATION_PARAMETERS,
            "method": Parameter("identified", choices=METHODS),
            "a_deg": Parameter(0.0, "deg"),
            "c_deg": Parameter(0.0, "deg"),
        }
    )

    def outputs(self, values: Mapping[str, Value]) -> tuple[Output, ...]:  # noqa: ARG002
        """Largest and root-mean-square volumetric error, before and after."""
        return (
            Output("before_max_um", "µm", words="largest volumetric error before compensation"),
            Output("before_rms_um", "µm", words="rms volumetric error before compensation"),
            Output("left_max_um", "µm", words="largest volumetric error left"),
            Output("left_rms_um", "µm", words="rms volumetric error left"),
        )

    def run(
        self,
        values: Mapping[str, Value],
        seeds: Seeds,
        first: int,
        count: int,
        threads: int | None,
    ) -> Block:
        """Calibrations in one call of the core, then a volume each."""
        bench = bench_of(values)
        truths = bench.truths(seeds, first, count)
        method = str(values["method"])
        rows, failures = bench.estimates(
            truths, float(values["noise_um"]), seeds, first, method == "identified", threads
        )
        begin = {"separating": 0, "printed": 14, "identified": 22}[method]
        left = truths[:, :8] - rows[:, begin : begin + 8]
        failed = dict(failures)
        kept = [index for index in range(count) if index not in failed]

        def one(index: int) -> list[float]:
            if index in failed:
                return [float("nan")] * 4
            return [*_size(bench, truths[index], values), *_size(bench, left[index], values)]

        block = guarded(count, one, 4)
        told = {index: why for index, why in block.failures if index in kept} | failed
        return Block(block.columns, tuple(sorted(told.items())))


def _size(bench: Bench, errors: Floats, values: Mapping[str, Value]) -> tuple[float, float]:
    names = bench.model.error_names
    named = {name: float(value) for name, value in zip(names, errors[: len(names)], strict=True)}
    found = volumetric_error(
        bench.setup, named, a_deg=float(values["a_deg"]), c_deg=float(values["c_deg"])
    )
    return found.max_um, found.rms_um
