"""Virtual measurements of anything a set-up holds: simulate, identify, compare with the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from trunnion.base.errors import TrunnionError
from trunnion.base.units import Floats, unit_of
from trunnion.probing.identify import identify_many
from trunnion.probing.model import TouchModel
from trunnion.probing.simulate import simulate
from trunnion.setup import Artefact, Setup
from trunnion.studies.grid import Grid
from trunnion.studies.setting import Setting, effect_parameters, setup_parameters
from trunnion.studies.study import TRUTH, Block, Output, Parameter, Seeds, Values

NAMES_DEPEND_ON = ("machine.preset", "estimate", "artefact.kind")


@dataclass(frozen=True)
class IdentificationStudy:
    """Touches of any plan, machine and artefact, simulated with effects and identified.

    Parameters: every key of the set-up (``artefact.length_mm``, ``machine.preset``,
    ``axes.C.sense``, ...), the plan's (``plan.c_deg``, ...), true effects
    (``drift_z.rate_um_h``), the effects that are estimated (``estimate``, ids with commas), noise
    and the ranges that true errors and placements are drawn from. Outputs: ``error`` (estimate
    minus truth) and ``std_error`` along ``parameter``, ``converged``; a parameter that a node's
    machine does not have is missing there.
    """

    setup: Setup = field(default_factory=lambda: Setup(artefact=Artefact("cross")))
    name: str = "identification"
    chunk: int = 100
    labels: tuple[str, ...] = ()
    parameters: Mapping[str, Parameter] = field(init=False)

    def __post_init__(self) -> None:
        """Collect what can be varied."""
        effects = {
            f"{effect}.{name}": Parameter(None, unit_of(name), optional=True)
            for effect, parameters in effect_parameters().items()
            for name in parameters
        }
        found = {
            **setup_parameters(self.setup),
            **effects,
            "estimate": Parameter(""),
            "noise_um": Parameter(0.3, "µm", low=0.0),
            **TRUTH,
        }
        object.__setattr__(self, "parameters", found)

    def all_outputs(self, grid: Grid) -> tuple[Output, ...]:
        """Errors of all parameters that any node has."""
        axes = [
            [(name, value) for value in grid.axes[name]]
            for name in NAMES_DEPEND_ON
            if name in grid.axes
        ]
        known: dict[str, str] = {}
        first: TrunnionError | None = None
        for choice in product(*axes):
            try:
                known |= _parameters({**grid.at(0), **dict(choice)})
            except TrunnionError as error:  # its nodes fail alone
                first = first or error
        if not known and first is not None:
            raise first
        return _outputs(known)

    def outputs(self, values: Values) -> tuple[Output, ...]:
        """Errors of the parameters of one node."""
        return _outputs(_parameters(values))

    def of_outputs(self, outputs: tuple[Output, ...]) -> IdentificationStudy:
        """Return the study with these parameters in its outputs, at every node."""
        return replace(self, labels=outputs[0].labels)

    def run(
        self, values: Values, seeds: Seeds, first: int, count: int, threads: int | None
    ) -> Block:
        """Simulate sample by sample; identify all of them in one call of the core."""
        setting, estimated = Setting.of(values), names(str(values["estimate"]))
        model = TouchModel(setting.setup)
        widths = np.array([_half_width(model, name, values) for name in model.names])
        truths = (2 * seeds.uniform(first, count, len(widths)) - 1) * widths
        positions = np.full((count, len(setting.touches), 3), np.nan)
        failures = []
        for index, truth in enumerate(truths):
            try:
                positions[index] = _measured(setting, model, truth, values, seeds, first + index)
            except TrunnionError as error:
                failures.append((index, f"{type(error).__name__}: {error}"))
        good = np.isfinite(positions).all(axis=(1, 2))
        true = _true_effects(values)
        columns = np.full((count, 2 * len(self.labels) + 1), np.nan)
        if good.any():
            found, estimates, std, converged = identify_many(
                setting.touches, setting.setup, positions[good], estimated, threads=threads
            )
            known = {name: truths[good, j] for j, name in enumerate(model.names)}
            at = [self.labels.index(name) for name in found]
            effects = [true.get(e, {}).get(p, 0.0) for e, _, p in (n.partition(".") for n in found)]
            truth = np.column_stack(
                [known.get(n, np.full(good.sum(), e)) for n, e in zip(found, effects, strict=True)]
            )
            some = np.full((int(good.sum()), columns.shape[1]), np.nan)
            some[:, at] = estimates - truth
            some[:, [len(self.labels) + j for j in at]] = std
            some[:, -1] = converged
            columns[good] = some
        return Block(columns, tuple(failures))


def names(text: str) -> tuple[str, ...]:
    """Return ids separated by commas."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _parameters(values: Values) -> dict[str, str]:
    """Return the parameters that a node estimates, with their units."""
    model = TouchModel(Setting.of(values).setup, names(str(values["estimate"])))
    return {name: _unit(model, name) for name in model.names}


def _unit(model: TouchModel, name: str) -> str:
    unit = model.units[model.names.index(name)]
    return {"um": "µm"}.get(unit, unit)


def _outputs(known: Mapping[str, str]) -> tuple[Output, ...]:
    labels, units = tuple(known), tuple(known.values())
    return (
        Output("error", units, "parameter", labels, "least squares minus truth"),
        Output("std_error", units, "parameter", labels, "standard errors as estimated"),
        Output("converged", "1"),
    )


def _half_width(model: TouchModel, name: str, values: Values) -> float:
    """Return the half-width of the uniform distribution that a true value is drawn from."""
    unit = "arcsec" if _unit(model, name) == "arcsec" else "um"
    what = "errors" if name in model.error_names else "placement"
    return float(values[f"{what}_{unit}"])


def _true_effects(values: Values) -> dict[str, dict[str, float]]:
    """Return the effects that a node simulates."""
    found: dict[str, dict[str, float]] = {}
    for key, value in values.items():
        effect, dot, parameter = key.partition(".")
        if dot and parameter in effect_parameters().get(effect, ()):
            found.setdefault(effect, {})[parameter] = float(value)
    return found


def _measured(
    setting: Setting,
    model: TouchModel,
    truth: Floats,
    values: Values,
    seeds: Seeds,
    sample: int,
) -> Floats:
    """Return the positions (n, 3) of one simulated measurement."""
    by_name = dict(zip(model.names, truth.tolist(), strict=True))
    return simulate(
        setting.touches,
        setting.setup,
        {name: by_name[name] for name in model.error_names},
        {name: value for name, value in by_name.items() if name not in model.error_names},
        _true_effects(values),
        noise_um=float(values["noise_um"]),
        seed=seeds.whole(),
        sample=sample,
    ).position_mm
