"""Blind runs of ``tn.diagnose`` on measurements made by the twin, and what comes of them.

A case is a plan, what is hidden and how large it is; ``run`` gives one outcome a measurement. The
generator shares no code with the core: see ``tests/twin``.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import trunnion as tn
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.kinds import diagnose
from twin.forward import EFFECTS, Setup, Truth
from twin.generator import (
    VISIBLE_UM,
    Measurement,
    Plan,
    Sizing,
    Unknown,
    effect_change_um,
    left_of,
    measure,
    random_effect,
    random_errors,
    random_placement,
    setup_toml,
    standard,
    unknown_effect,
)

ALIKE = 0.7  # correlation of what two effects leave, above which they are not drawn together
UNKNOWN_KINDS = ("smooth", "periodic", "time", "place", "jump", "face", "point")
QUANTITIES = {
    "c_deg": "C position",
    "a_deg": "A position",
    "time_s": "time",
    "x_mm": "X place",
    "y_mm": "Y place",
    "z_mm": "Z place",
    "face": "face",
    "point": "point",
}


@dataclass(frozen=True)
class Case:
    """What is hidden: ``effects`` of ``size`` σ each, ``unknown`` of ``size`` σ, outliers."""

    name: str
    plan: str
    effects: int = 0
    size: float = 0.0
    unknown: bool = False
    outliers: float = 0.0
    noise_um: tuple[float, float] = (0.3, 0.3)
    noise: str = "gaussian"
    only: tuple[str, ...] = ()


@dataclass
class Outcome:
    """One blind run."""

    measurement: Measurement
    diagnosis: Diagnosis
    hidden: Mapping[str, Mapping[str, float]]
    seconds: float
    measurement_plan: str

    @property
    def truth(self) -> frozenset[str]:
        return frozenset(self.hidden)

    @property
    def among(self) -> bool:
        """The hidden set is named or among the alternatives."""
        return self.truth in self.diagnosis.alternatives

    @property
    def wrong(self) -> bool:
        """Something else is named without a doubt."""
        d = self.diagnosis
        return d.verdict == "explained" and bool(d.causes) and not self.among

    @property
    def quantity_named(self) -> bool:
        """What an unknown effect depends on is named."""
        unknown, text = self.measurement.unknown, self.diagnosis.unexplained
        return bool(unknown and text and QUANTITIES[unknown.quantity] in text)

    @property
    def outliers_found(self) -> bool:
        return set(self.measurement.outliers) <= set(self.diagnosis.outliers)

    def covered(self) -> list[bool]:
        """Whether each 95 % interval holds the truth, where the hidden set is the named one."""
        d = self.diagnosis
        if not d.alternatives or d.alternatives[0] != self.truth:
            return []
        return [
            abs(c.parameters[p] - self.hidden[c.id].get(p, 0.0)) <= 1.96 * c.std_errors[p]
            for c in d.causes
            for p in c.parameters
            if np.isfinite(c.std_errors[p])
        ]


@dataclass
class Tally:
    """Outcomes of a case."""

    case: Case
    outcomes: list[Outcome] = field(default_factory=list)

    def rate(self, what: str) -> float:
        return float(np.mean([bool(getattr(o, what)) for o in self.outcomes]))

    @property
    def alarms(self) -> float:
        """Share of diagnoses that are not consistent."""
        return float(np.mean([o.diagnosis.verdict != "consistent" for o in self.outcomes]))

    @property
    def alternatives(self) -> float:
        return float(np.median([len(o.diagnosis.alternatives) for o in self.outcomes]))

    @property
    def named(self) -> float:
        """Share of runs in which some cause is named."""
        return float(np.mean([bool(o.diagnosis.causes) for o in self.outcomes]))

    @property
    def coverage(self) -> tuple[float, int]:
        all_ = [c for o in self.outcomes for c in o.covered()]
        return (float(np.mean(all_)) if all_ else float("nan"), len(all_))

    @property
    def milliseconds(self) -> float:
        return float(np.median([o.seconds for o in self.outcomes])) * 1e3


@lru_cache(maxsize=4)
def ground(plan_name: str) -> tuple[Plan, Setup, Sizing, tn.Setup]:
    plan, setup, sizing = standard(plan_name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "setup.toml"
        path.write_text(setup_toml(setup), encoding="utf-8")
        read = tn.read_setup(path)
    return plan, setup, sizing, read


@lru_cache(maxsize=4)
def visible(plan_name: str, least: float = VISIBLE_UM) -> tuple[str, ...]:
    """Effects of which this plan sees so much, of one of 1 µm, arcsec, ..."""
    _, _, sizing, _ = ground(plan_name)
    return tuple(e for e in EFFECTS if sizing.visible(e, np.random.default_rng(1), least))


def draw_effects(
    rng: np.random.Generator,
    plan_name: str,
    count: int,
    rms_um: float,
    only: tuple[str, ...] = (),
    alike: float = ALIKE,
    least: float = VISIBLE_UM,
) -> dict[str, dict[str, float]]:
    """Effects of which no two are alike, each of this rms in the residuals of the plain model.

    ``alike``: the correlation from which on two are; ``least``: as of `visible`.
    """
    plan, setup, sizing, _ = ground(plan_name)
    while True:
        chosen = only or tuple(rng.choice(visible(plan_name, least), count, replace=False))
        try:
            hidden = {
                str(e): sizing.scaled(str(e), random_effect(rng, str(e), plan), rms_um)
                for e in chosen
            }
        except ValueError:  # a direction of the effect that this plan cannot see
            continue
        left = [
            left_of(effect_change_um(plan, setup, {e: v}), sizing.plain) for e, v in hidden.items()
        ]
        unit = np.stack([x / np.linalg.norm(x) for x in left]) if left else np.zeros((0, 1))
        likeness: NDArray[np.float64] = np.abs(unit @ unit.T) - np.eye(len(left))
        if np.all(likeness < alike):
            return hidden


def draw_unknown(rng: np.random.Generator, plan_name: str, rms_um: float) -> Unknown:
    """An effect of which this rms is left that no combination of the catalogue makes.

    Nor a shift of the artefact beside it, which is a cause by itself.
    """
    plan, _, sizing, _ = ground(plan_name)
    while True:
        u = unknown_effect(rng, plan, str(rng.choice(UNKNOWN_KINDS)))
        try:
            extra = sizing.scaled_unknown(u.extra_um, rms_um=rms_um, beyond=sizing.catalogue)
        except ValueError:  # the catalogue can make all of it
            continue
        if np.abs(extra).max() < 40 * rms_um and not sizing.shift_makes(extra, rms_um):
            return replace(u, extra_um=extra)


def run(case: Case, count: int, seed: int) -> Tally:
    """Hide, measure and diagnose ``count`` times."""
    plan, setup, _, read = ground(case.plan)
    rng = np.random.default_rng([seed, *case.name.encode(), *case.plan.encode()])
    tally = Tally(case)
    low, high = np.log(case.noise_um)
    for _ in range(count):
        noise = float(np.exp(rng.uniform(low, high)))
        drawn = case.effects or len(case.only)
        hidden = draw_effects(rng, case.plan, drawn, case.size * noise, case.only) if drawn else {}
        unknown = draw_unknown(rng, case.plan, case.size * noise) if case.unknown else None
        truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=hidden)
        m = measure(
            plan,
            setup,
            truth,
            noise_um=noise,
            noise=case.noise,
            tick_um=0.1,
            outlier_share=case.outliers,
            unknown=unknown,
            seed=int(rng.integers(1 << 31)),
        )
        touches = tn.Touches(m.columns)
        begin = time.process_time()
        d = diagnose(touches, read)
        tally.outcomes.append(Outcome(m, d, hidden, time.process_time() - begin, case.plan))
    return tally


def part(o: Outcome, n: int, seed: int) -> tuple[float, bool]:
    """Make the n touches of ``next_touches``: the chance that was promised, and whether it came.

    Distinguished: of the sets that the first diagnosis called alike, the hidden one alone is left.
    """
    setup = ground(o.measurement_plan)[3]
    promise = tn.expected_discrimination(o.diagnosis, n)
    truth = o.measurement.truth
    more = tn.simulate(
        promise.plan,
        setup,
        truth.errors,
        truth.placement,
        o.hidden,
        noise_um=o.measurement.noise_um,
        seed=seed,
    )
    both = {
        name: np.concatenate([values, more.columns[name]])
        for name, values in o.diagnosis.data.columns.items()
        if name in more.columns
    }
    again = diagnose(tn.Touches(both), setup)
    rivals = set(o.diagnosis.alternatives) - {o.truth}
    return promise.chance, o.truth in again.alternatives and not rivals & set(again.alternatives)
