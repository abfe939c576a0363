"""Turned passes with hidden causes, made without the core: numbers from the formulas of the notes.

Run as a script it prints the whole table: ``python tests/turning_blind.py 200``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trunnion import Artefact, Diameters, Setup

FloatArray = npt.NDArray[np.float64]
Rng = np.random.Generator


@dataclass(frozen=True)
class Pass:
    """One pass: feed towards the chuck (-1) or away, depth, feed speed, and where it was read."""

    sign: int
    depth_mm: float
    speed_mm_s: float
    z: FloatArray

    def length(self, overhang: float) -> FloatArray:
        return overhang - self.z if self.sign < 0 else self.z

    def time(self, overhang: float) -> FloatArray:
        return self.length(overhang) / self.speed_mm_s


Law = Callable[[Pass, float], FloatArray]


def heating(rng: Rng) -> Law:
    size, tau = rng.uniform(10, 45), rng.uniform(15, 60)
    return lambda p, o: -size * (1 - np.exp(-p.time(o) / tau))


def wear(rng: Rng) -> Law:
    whole = rng.uniform(3, 12)
    return lambda p, o: whole * p.time(o) / (o / 1.8)


def taper(rng: Rng) -> Law:
    angle = rng.uniform(4, 15) * rng.choice([-1, 1]) * np.pi / 648000
    return lambda p, _: 2e3 * angle * p.z


def bending(rng: Rng) -> Law:
    tip = rng.uniform(5, 30)
    return lambda p, o: tip * (p.z / o) ** 3 * p.depth_mm


def chuck_tilt(rng: Rng) -> Law:
    tip = rng.uniform(5, 20)
    return lambda p, o: tip * (p.z / o) ** 2 * p.depth_mm


def barrel(rng: Rng) -> Law:
    middle = rng.uniform(3, 10) * rng.choice([-1, 1])
    return lambda p, o: 4 * middle * p.z / o * (1 - p.z / o)


def chatter(rng: Rng) -> Law:
    size, pitch = rng.uniform(1.5, 4), rng.uniform(5, 15)
    phase = rng.uniform(0, 2 * np.pi)
    return lambda p, o: size * np.sin(2 * np.pi * p.length(o) / pitch + phase)


LAWS: Mapping[str, Callable[[Rng], Law]] = {
    "tool_heating": heating,
    "tool_wear": wear,
    "taper": taper,
    "bending": bending,
    "chuck_tilt": chuck_tilt,
    "barrel": barrel,
    "chatter": chatter,
}


def measured(seed: int, hidden: tuple[str, ...], passes: int) -> tuple[Diameters, Setup]:
    """Measured passes with these causes: the second with reversed feed, the third deeper."""
    rng = np.random.default_rng(seed)
    overhang = float(rng.uniform(55, 120))
    count = int(rng.integers(80, 200))
    noise = float(rng.uniform(0.4, 1.0))
    speed = float(rng.uniform(1.4, 2.2))
    z = np.linspace(overhang - 0.5, rng.uniform(2, 6), count)
    plan = [Pass(-1, 1.0, speed, z), Pass(1, 1.0, speed, z), Pass(-1, 2.0, speed, z)][:passes]
    laws = [LAWS[name](rng) for name in hidden]
    columns: dict[str, list[FloatArray]] = {}
    for number, one in enumerate(plan, start=1):
        error = rng.normal(0, 20) + sum((law(one, overhang) for law in laws), np.zeros(count))
        # The gauge: half a micrometre of the stylus is a micrometre of the diameter.
        read = np.round(error + rng.normal(0, noise, count))
        for name, values in {
            "z_mm": one.z,
            "error_um": read,
            "pass": np.full(count, number),
            "time_s": one.time(overhang),
            "feed_sign": np.full(count, one.sign),
            "depth_mm": np.full(count, one.depth_mm),
        }.items():
            columns.setdefault(name, []).append(values)
    data = Diameters({name: np.concatenate(parts) for name, parts in columns.items()})
    return data, Setup(artefact=Artefact("none"), turning={"overhang_mm": overhang})


def outcome(seed: int, hidden: tuple[str, ...], passes: int) -> str:
    """Diagnose: found, alternative, missed (less was named), wrong."""
    import trunnion.models.diameters  # registers
    from trunnion.diagnosis.registry import diagnose

    del trunnion
    got = diagnose(*measured(seed, hidden, passes))
    truth = frozenset(hidden)
    if not hidden:
        return "quiet" if got.verdict == "consistent" else "alarm"
    if got.verdict == "explained" and got.named == truth:
        return "found"
    if truth in got.alternatives:
        return "alternative"
    if got.verdict == "unexplained":
        return "unexplained"
    return "missed" if got.named < truth else "wrong"


def draw(seed: int, how_many: int) -> tuple[str, ...]:
    """Causes of a case."""
    rng = np.random.default_rng(10_000 + seed)
    return tuple(sorted(rng.choice(list(LAWS), size=how_many, replace=False).tolist()))


def main(runs: int) -> None:
    """Print the table."""
    for how_many in (0, 1, 2):
        for passes in (2, 3):
            tally: dict[str, int] = {}
            bad: dict[tuple[str, ...], int] = {}
            for seed in range(runs):
                hidden = draw(seed, how_many)
                result = outcome(seed, hidden, passes)
                tally[result] = tally.get(result, 0) + 1
                if result not in ("found", "alternative", "quiet"):
                    bad[hidden] = bad.get(hidden, 0) + 1
            print(how_many, "causes,", passes, "passes:", tally, bad)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
