"""Turned passes with hidden causes, made without the core: numbers from the formulas of the notes.

Run as a script it makes the whole table: ``python tests/turning_blind.py 200 --out docs/x.md``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from power import report
from trunnion import Artefact, Diameters, Setup

FloatArray = npt.NDArray[np.float64]
Rng = np.random.Generator


@dataclass(frozen=True)
class Pass:
    """One pass: feed towards the chuck (-1) or away, depth, feed speed, where it was read.

    ``warm_s``: how long the tool had been cutting when it began.
    """

    sign: int
    depth_mm: float
    speed_mm_s: float
    z: FloatArray
    warm_s: float = 0.0

    def length(self, overhang: float) -> FloatArray:
        return overhang - self.z if self.sign < 0 else self.z

    def time(self, overhang: float) -> FloatArray:
        return self.warm_s + self.length(overhang) / self.speed_mm_s


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


def cubic(rng: Rng) -> Law:
    """A smooth error that is no cause of the catalogue: a cubic along the bar, without a line."""
    size = rng.uniform(3, 12) * rng.choice([-1, 1])

    def law(p: Pass, o: float) -> FloatArray:
        s = 2 * p.z / o - 1
        return np.asarray(size * (5 * s**3 - 3 * s) / 2)

    return law


def growing(rng: Rng) -> Law:
    """A cubic in the cutting time: about a barrel and a tool that heats up together."""
    size = rng.uniform(5, 20) * rng.choice([-1, 1])
    return lambda p, o: size * (p.length(o) / o) ** 3


def hump(rng: Rng) -> Law:
    """A bell in the cutting time, which waves of a few lengths describe."""
    size = rng.uniform(5, 20) * rng.choice([-1, 1])
    place, width = rng.uniform(0.3, 0.7), rng.uniform(0.08, 0.2)
    return lambda p, o: size * np.exp(-0.5 * ((p.length(o) / o - place) / width) ** 2)


LAWS: Mapping[str, Callable[[Rng], Law]] = {
    "tool_heating": heating,
    "tool_wear": wear,
    "taper": taper,
    "bending": bending,
    "chuck_tilt": chuck_tilt,
    "barrel": barrel,
    "chatter": chatter,
}


def measured(
    seed: int,
    hidden: tuple[str, ...],
    passes: int,
    *,
    warm: bool = False,
    left: Sequence[float] = (),
    unknown: bool | Callable[[Rng], Law] = False,
    exact: bool = False,
    count: int | None = None,
) -> tuple[Diameters, Setup]:
    """Measured passes with these causes: the second with reversed feed, the third deeper.

    ``warm``: one more, like the first, right behind four of its kind. ``left``: what each cause,
    and the unknown error last, leaves beside a tool setting in each pass instead of its usual size:
    the root of the sum of squares of all readings in noises. ``unknown``: with an error that is no
    cause of the catalogue, by default a cubic along the bar. ``exact``: neither noise nor the steps
    of a gauge. ``count``: readings of a pass, by default 80 to 199.
    """
    rng = np.random.default_rng(seed)
    overhang = float(rng.uniform(55, 120))
    count = int(rng.integers(80, 200)) if count is None else count
    noise = float(rng.uniform(0.4, 1.0))
    speed = float(rng.uniform(1.4, 2.2))
    z = np.linspace(overhang - 0.5, rng.uniform(2, 6), count)
    plan = [Pass(-1, 1.0, speed, z), Pass(1, 1.0, speed, z), Pass(-1, 2.0, speed, z)][:passes]
    plan += [Pass(-1, 1.0, speed, z, 4 * overhang / speed)] * warm
    laws = [LAWS[name](rng) for name in hidden]
    if unknown:
        laws.append(cubic(rng) if unknown is True else unknown(rng))
    shares = [1.0] * len(laws)
    if left:
        of_noise = float(np.hypot(noise, 1.0 / np.sqrt(12.0)))
        shares = [
            want * of_noise / _beside_settings([law(one, overhang) for one in plan])
            for want, law in zip(left, laws, strict=True)
        ]
    columns: dict[str, list[FloatArray]] = {}
    for number, one in enumerate(plan, start=1):
        error = rng.normal(0, 20) + sum(
            (share * law(one, overhang) for share, law in zip(shares, laws, strict=True)),
            np.zeros(count),
        )
        # The gauge: half a micrometre of the stylus is a micrometre of the diameter.
        read = error if exact else np.round(error + rng.normal(0, noise, count))
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


def _beside_settings(passes: Sequence[FloatArray]) -> float:
    """Root of the sum of squares of errors of passes less the mean of each."""
    return float(np.linalg.norm(np.concatenate([one - one.mean() for one in passes])))


def outcome(seed: int, hidden: tuple[str, ...], passes: int, *, warm: bool = False) -> str:
    """Diagnose: found, alternative, missed (less was named), wrong."""
    from trunnion.models.kinds import diagnose

    got = diagnose(*measured(seed, hidden, passes, warm=warm))
    truth = frozenset(hidden)
    if not hidden:
        return "quiet" if got.verdict == "consistent" else "alarm"
    if got.verdict == "explained" and got.named == truth:
        return "found"
    if truth in got.alternatives:
        return "alternative"
    if got.verdict in ("unexplained", "ambiguous"):
        return got.verdict
    return "missed" if got.named < truth else "wrong"


def draw(seed: int, how_many: int) -> tuple[str, ...]:
    """Causes of a case."""
    rng = np.random.default_rng(10_000 + seed)
    return tuple(sorted(rng.choice(list(LAWS), size=how_many, replace=False).tolist()))


HEAD = """# How often a diagnosis of diameters is right

Made by `make power-turning` on passes of the independent generator `tests/turning_blind.py`:
overhang 55 to 120 mm, 80 to 199 readings a pass, noise of 0.4 to 1.0 µm unknown to the code,
rounded to 1 µm of the diameter, a tool setting of its own for each pass. Sizes: heating 10 to 45 µm
with a time constant of 15 to 60 s, wear 3 to 12 µm over a pass of usual speed, taper 4 to 15",
bending 5 to 30 µm and tilt of the chuck 5 to 20 µm at the free end, a bent slide 3 to 10 µm,
chatter 1.5 to 4 µm. The second pass has reversed feed, the third twice the depth; "+ warm" is one
more like the first, right behind four of its kind. Expected: named or among the alternatives in at
least 95 %, a verdict without an effect in at most 5 %.

*found*: named without a doubt. *among*: one of several alternatives. *in doubt*: several
alternatives, the truth not among them. *unexplained*: "no known cause". *less*: a part of the truth
named without a doubt. *wrong*: something else named without a doubt.
"""


@dataclass(frozen=True)
class Row:
    """A row of the table: what is hidden (causes, or how many are drawn), and the passes."""

    hidden: int | tuple[str, ...]
    passes: int
    warm: bool = False


ROWS = (
    *(Row(count, passes) for count in (0, 1, 2) for passes in (2, 3)),
    *(
        Row(hidden, *plan)
        for hidden in (("tool_heating",), ("tool_heating", "tool_wear"))
        for plan in ((2,), (3,), (2, True))
    ),
)
KINDS = ("found", "alternative", "ambiguous", "unexplained", "missed", "wrong")


def table(runs: int) -> str:
    """Diagnose all cases; return the document."""
    lines = [HEAD]
    head = "hidden | passes | runs | **named or among** | found | among | in doubt | unexplained"
    lines.append(f"| {head} | less | wrong |\n|{'---|' * 10}")
    quiet, bad = [], []
    for row in ROWS:
        tally: dict[str, int] = {}
        for seed in range(runs):
            hidden = draw(seed, row.hidden) if isinstance(row.hidden, int) else row.hidden
            result = outcome(seed, hidden, row.passes, warm=row.warm)
            tally[result] = tally.get(result, 0) + 1
            if result in KINDS[2:] and isinstance(row.hidden, int):
                bad.append(f"| {' + '.join(hidden)} | {row.passes} | {seed} | {result} |")
        share = {kind: 100 * tally.get(kind, 0) / runs for kind in (*KINDS, "alarm")}
        if row.hidden == 0:
            quiet.append(
                f"No cause at all, {row.passes} passes, {runs} runs: a verdict other than "
                f"*consistent* in {share['alarm']:.1f} %."
            )
            continue
        one = {1: "one cause", 2: "two causes"}
        name = one[row.hidden] if isinstance(row.hidden, int) else " + ".join(row.hidden)
        good = share["found"] + share["alternative"]
        rest = " | ".join(f"{share[kind]:.1f} %" for kind in KINDS)
        passes = f"{row.passes}{' + warm' * row.warm}"
        lines.append(f"| {name} | {passes} | {runs} | **{good:.1f} %** | {rest} |")
    lines += ["", "\n\n".join(quiet)]
    if bad:
        lines += ["\nThe cases of the drawn causes that miss:\n"]
        lines += ["| hidden | passes | seed | outcome |\n|---|---|---|---|", *bad]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", type=int, nargs="?", default=100)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    report.write([table(asked.runs)], asked.out)
