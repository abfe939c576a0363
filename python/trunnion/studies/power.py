"""How small an effect is still found: hidden effects of a known size, then the diagnosis."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.units import Floats
from trunnion.data.times import begin_and_span_s
from trunnion.data.touches import Touches
from trunnion.models.kinds import diagnose
from trunnion.probing.model import TouchModel
from trunnion.probing.simulate import simulate
from trunnion.setup import Artefact, Setup
from trunnion.studies.setting import PLAN, Setting, effect_parameters, setup_parameters
from trunnion.studies.study import TRUTH, Block, Output, Parameter, Seeds, Value, Values, guarded

NONE = "none"


PLANS: Mapping[str, Mapping[str, Value]] = {
    "paper": {},
    "rich": {
        "plan.c_deg": "0:330:30",
        "plan.tilt_deg": "-90,-60,-30,30,60,90",
        "plan.feeds_mm_min": "600,200",
        "plan.both_senses": True,
    },
}
"""What the plans of this name are, unless the grid or `fixed` say otherwise."""


@dataclass(frozen=True)
class DiagnosisPowerStudy:
    """A hidden effect in a simulated measurement, and what the diagnosis reports.

    Its parameters are drawn at random and scaled so that `rms_um` of it is left in the readings
    after the location errors and the placement have been fitted. Exactly one of four outputs is 1:
    ``found`` (it is the first explanation), ``among_alternatives`` (another that explains the data
    as well comes first), ``missed`` (nothing is found) or ``wrong`` (something else). With effect
    "none", or `rms_um` 0, reporting nothing counts as found.
    """

    setup: Setup = field(default_factory=lambda: Setup(artefact=Artefact("cross")))
    name: str = "diagnosis-power"
    chunk: int = 4
    processes: bool = True
    parameters: Mapping[str, Parameter] = field(init=False)

    def __post_init__(self) -> None:
        """Collect what can be varied: of the set-up any key, and of the plan."""
        known = setup_parameters(self.setup)
        known |= {name: replace(each, optional=True) for name, each in PLAN.items()}
        found = {
            **known,
            "effect": Parameter("drift_z", choices=(NONE, *effect_parameters())),
            "rms_um": Parameter(0.5, "µm", low=0.0),
            "noise_um": Parameter(0.3, "µm", low=0.0),
            "tick_um": Parameter(0.1, "µm", low=0.0),
            "plan": Parameter("rich", choices=("paper", "rich")),
            **TRUTH,
        }
        object.__setattr__(self, "parameters", found)

    def outputs(self, values: Values) -> tuple[Output, ...]:  # noqa: ARG002
        """Which of the four it was."""
        return tuple(
            Output(name, "1") for name in ("found", "among_alternatives", "missed", "wrong")
        )

    def run(
        self,
        values: Values,
        seeds: Seeds,
        first: int,
        count: int,
        threads: int | None,  # noqa: ARG002
    ) -> Block:
        """One measurement and one diagnosis a sample."""
        return guarded(count, lambda index: _one(values, seeds.generator(first + index)), 4)


def _measurement(values: Values) -> tuple[Setup, Touches, Floats]:
    """Set-up, plan, and an orthonormal basis of what the plain fit takes away."""
    plan = {name: each.default for name, each in PLAN.items() if each.default is not None}
    tick = {"probe.tick_um": values["tick_um"]}
    return _basis(Setting.of({**plan, **PLANS[str(values["plan"])], **tick, **values}))


@functools.lru_cache(maxsize=8)
def _basis(setting: Setting) -> tuple[Setup, Touches, Floats]:
    setup, touches = setting.setup, setting.touches
    model = TouchModel(setup)
    _, jacobian = model.core.linearise(model.moves(touches), model.values())
    return setup, touches, np.linalg.qr(jacobian)[0]


def _one(values: Values, rng: np.random.Generator) -> list[float]:
    setup, touches, plain = _measurement(values)
    effect = str(values["effect"])
    hidden: dict[str, dict[str, float]] = {}
    if effect != NONE and float(values["rms_um"]) > 0:
        hidden = {effect: _hidden(setup, touches, plain, effect, float(values["rms_um"]), rng)}
    model = TouchModel(setup)
    errors = {
        name: rng.uniform(-1, 1)
        * float(values["errors_um" if name[1] in "XYZ" else "errors_arcsec"])
        for name in model.error_names
    }
    placement = {
        name: rng.uniform(-1, 1)
        * float(values["placement_um" if name.endswith("_um") else "placement_arcsec"])
        for name in model.names[len(errors) :]
    }
    data = simulate(
        touches,
        setup,
        errors,
        placement,
        dict(hidden),
        noise_um=float(values["noise_um"]),
        seed=int(rng.integers(2**62)),
    )
    diagnosis = diagnose(data, setup)
    named = frozenset(cause.id for cause in diagnosis.causes)
    true = frozenset(hidden)
    found = named == true and diagnosis.verdict != "unexplained"
    among = not found and true in diagnosis.alternatives
    missed = not found and not among and diagnosis.verdict == "consistent"
    return [float(found), float(among), float(missed), float(not (found or among or missed))]


def _hidden(
    setup: Setup,
    touches: Touches,
    plain: Floats,
    effect: str,
    rms_um: float,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Random parameters of an effect, scaled to what it leaves after the plain fit."""
    model = TouchModel(setup, (effect,))
    own = [k for k, name in enumerate(model.names) if "." in name]
    values = model.values()
    begin, span = begin_and_span_s(touches)
    for k in own:
        kind = model.kinds[k]
        if kind == "moment":
            values[k] = begin + rng.uniform(0.1, 0.9) * span
        elif kind == "duration":
            values[k] = rng.uniform(0.1, 0.5) * span / 60
        else:
            values[k] = rng.normal()
    moves = model.moves(touches)
    linear = [k for k in own if model.kinds[k] == "linear"]
    without = values.copy()
    without[linear] = 0.0
    change = model.core.residuals(moves, without) - model.core.residuals(moves, values)
    residual = change - plain @ (plain.T @ change)
    size = float(np.sqrt(np.mean(residual**2)))
    if size < 1e-3 * max(1e-3, float(np.abs(change).max())):
        raise DataError(
            f"effect {effect!r}: got nothing left of it after the plain fit, expected an "
            "effect that is identifiable with the plan"
        )
    values[linear] *= rms_um / size
    return {model.names[k].split(".", 1)[1]: float(values[k]) for k in own}
