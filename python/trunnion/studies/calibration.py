"""Virtual calibrations: simulate, closed forms, identification; whole in the core, on all cores."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

import trunnion._core as _core
from trunnion.base.units import Floats
from trunnion.probing.model import TouchModel
from trunnion.probing.plan import plan
from trunnion.probing.simulate import OFF_SURFACE_MM
from trunnion.setup import Artefact, Machine, Probe, Resolution, Setup
from trunnion.studies.study import TRUTH, Block, Output, Parameter, Seeds, Value, Values

CALIBRATION_PARAMETERS: Mapping[str, Parameter] = MappingProxyType(
    {
        "length_mm": Parameter(100.0, "mm", low=1e-3),
        "width_mm": Parameter(25.0, "mm", low=1e-3),
        "height_mm": Parameter(25.0, "mm", low=1e-3),
        "ball_radius_mm": Parameter(1.0, "mm", low=1e-3),
        "noise_um": Parameter(0.3, "µm", low=0.0),
        "tick_um": Parameter(0.1, "µm", low=0.0),
        "linear_um": Parameter(0.1, "µm", low=0.0),
        "rotary_arcsec": Parameter(0.36, "arcsec", low=0.0),
        "layout": Parameter("side", choices=("side", "top")),
        "repeats": Parameter(1, low=1, high=1000),
        **TRUTH,
    }
)
"""What a virtual calibration has."""


@dataclass(frozen=True)
class Bench:
    """Plan and model of one node."""

    setup: Setup
    model: TouchModel
    moves: _core.Moves
    labels: list[int]
    reach_mm: float
    half_widths: Floats
    """Of location errors and placement, in the model's order."""

    def truths(self, seeds: Seeds, first: int, count: int) -> Floats:
        """True location errors and placements, (count, 14)."""
        return (2 * seeds.uniform(first, count, len(self.half_widths)) - 1) * self.half_widths

    def estimates(
        self,
        truths: Floats,
        noise_um: float,
        seeds: Seeds,
        first: int,
        identify: bool,
        threads: int | None,
    ) -> tuple[Floats, list[tuple[int, str]]]:
        """Rows of the core's calibrations, and the samples that failed."""
        measurements = self.measurements(noise_um, seeds)
        return measurements.calibrations(
            truths, first_sample=first, identify=identify, threads=threads
        )

    def measurements(self, noise_um: float, seeds: Seeds) -> _core.Measurements:
        """The core's virtual measurements."""
        return _core.Measurements(
            self.model.core,
            self.moves,
            self.labels,
            reach_mm=self.reach_mm,
            noise_um=noise_um,
            seed=seeds.whole(),
        )

    def described(
        self, truths: Floats, failures: list[tuple[int, str]]
    ) -> tuple[tuple[int, str], ...]:
        """Failures of the core, each with the true values of its sample."""
        return tuple((index, f"{why} (truth {truths[index].tolist()})") for index, why in failures)


@functools.lru_cache(maxsize=64)
def _bench(items: tuple[tuple[str, Value], ...]) -> Bench:
    values: dict[str, float] = {k: v for k, v in items if not isinstance(v, str)}
    setup = Setup(
        machine=Machine(),
        artefact=Artefact(
            "cross",
            length_mm=values["length_mm"],
            width_mm=values["width_mm"],
            height_mm=values["height_mm"],
            # The placements that are drawn are far below the clearance, however long the cross is.
            tolerance_mm=0.0,
            tolerance_deg=0.0,
        ),
        probe=Probe(ball_radius_mm=values["ball_radius_mm"], tick_um=values["tick_um"]),
        resolution=Resolution(linear_um=values["linear_um"], rotary_arcsec=values["rotary_arcsec"]),
    )
    touches = plan(setup, layout=str(dict(items)["layout"]), repeats=int(values["repeats"]))
    model = TouchModel(setup)
    way = np.linalg.norm(touches.position_mm - np.asarray(touches.start_mm), axis=1)
    errors = [
        values["errors_um" if name[1] in "XYZ" else "errors_arcsec"] for name in model.error_names
    ]
    placement = [values["placement_um"]] * 3 + [values["placement_arcsec"]] * 3
    return Bench(
        setup,
        model,
        model.moves(touches, from_start=True),
        [] if touches.point is None else [int(label) for label in touches.point],
        OFF_SURFACE_MM + float(way.max()),
        np.array(errors + placement),
    )


def bench_of(values: Values) -> Bench:
    """Plan and model of a node; kept, because its blocks share them."""
    own = tuple((name, values[name]) for name in CALIBRATION_PARAMETERS if name != "noise_um")
    return _bench(own)


def _unit(name: str) -> str:
    linear = name.endswith("_um") or (name[0] == "E" and name[1] in "XYZ")
    return "µm" if linear else "arcsec"


@dataclass(frozen=True)
class CalibrationStudy:
    """The paper's 72 touches, simulated and estimated: estimate minus truth for each method.

    Machine `trt-ca`, cross. Outputs: ``separating_error`` (14 parameters), ``printed_error`` (8
    location errors, equations (13) to (20) with the placement left in), and with ``identify``
    ``identified_error``, its standard errors, and ``converged``.
    """

    name: str = "calibration"
    chunk: int = 20_000
    parameters: Mapping[str, Parameter] = field(
        default_factory=lambda: {
            **CALIBRATION_PARAMETERS,
            "identify": Parameter(True, in_grid=False),
        }
    )

    def outputs(self, values: Values) -> tuple[Output, ...]:
        """Errors of the estimates by method."""
        names = bench_of(values).model.names
        units = tuple(_unit(name) for name in names)
        every = ("parameter", names)
        closed = (
            Output("separating_error", units, *every, label="separating forms minus truth"),
            Output("printed_error", units[:8], "error", names[:8], "printed forms minus truth"),
        )
        if not values["identify"]:
            return closed
        return (
            *closed,
            Output("identified_error", units, *every, label="least squares minus truth"),
            Output("identified_std_error", units, *every, label="standard errors as estimated"),
            Output("converged", "1"),
        )

    def run(
        self, values: Values, seeds: Seeds, first: int, count: int, threads: int | None
    ) -> Block:
        """One call of the core."""
        bench = bench_of(values)
        truths = bench.truths(seeds, first, count)
        rows, failures = bench.estimates(
            truths, float(values["noise_um"]), seeds, first, bool(values["identify"]), threads
        )
        p = truths.shape[1]
        rows[:, :p] -= truths
        rows[:, p : p + 8] -= truths[:, :8]
        if values["identify"]:
            rows[:, p + 8 : 2 * p + 8] -= truths
        return Block(rows, bench.described(truths, failures))
