"""Do the intervals of location errors hold the truth beside a warm-up of any shape?

python -m power.warming [--runs 12] [--seed 5] [--sizes 3 10 30 60] [--plan paper] [--out FILE]

Touches of the independent generator (`tests/twin`) on a machine that moves along one axis as a
curve of time which begins at 0: shapes of the catalogue, and others that fit nearly as well.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import trunnion as tn
from power import report
from power.study import ground
from twin.forward import Truth
from twin.generator import Unknown, measure, random_errors, random_placement

Floats = NDArray[np.float64]
Rng = np.random.Generator
NOISE_UM = 0.3
SIZES = (3.0, 10.0, 30.0, 60.0)
MOVED = {"x": "EX0C", "y": "EY0C", "z": "EZ0A"}
"""Location error that a tool which stands off along an axis at the start is taken for."""
HEAD = """# Do the uncertainties of location errors hold beside a warm-up of any shape?

Made by `make power-warming`: touches of the independent generator (`tests/twin`) on a machine that
moves along one axis as a curve of time which begins at 0; the catalogue has the steady one, and one
exponential along Z. *Size*: the largest displacement, in noises of a touch. Counted is how often
the hidden location error (its value at the start) lies within 2 u of the estimate
(`d.errors_after`, `d.errors_std`): of *all* eight, and of the one that is *moved* (EX0C, EY0C or
EZ0A, by the axis of the curve). *Worst*: the largest error of all, in u. *u*: the median of u of
the moved one, over that of `identify` on the same touches of the machine that stands still.

*Named*: a drift or warm-up is named, and nothing is unexplained. *Unexplained*: the verdict is.
*Not seen*: neither. Location errors are those of the mean of the measurement then, and a curve that
has come to its end before the second turn of an axis leaves nothing else to see.
"""


def _settling(t: Floats, share: float) -> Floats:
    return np.asarray(-np.expm1(-t / share))


SHAPES: dict[str, Callable[[Rng, Floats], Floats]] = {
    "steady": lambda _, t: t,
    "one exponential": lambda rng, t: _settling(t, rng.uniform(0.15, 1.0)),
    "square root": lambda _, t: np.sqrt(t),
    "hyperbola": lambda rng, t: t / (t + rng.uniform(0.1, 1.0)),
    "two exponentials": lambda rng, t: (
        _settling(t, rng.uniform(0.05, 0.2))
        + rng.uniform(0.5, 2.0) * _settling(t, rng.uniform(0.5, 2.0))
    ),
    "cubic": lambda rng, t: t + rng.uniform(-1, 1) * t**2 + rng.uniform(-1, 1) * t**3,
    "late": lambda rng, t: t ** rng.uniform(1.2, 2.0),
    "room": lambda rng, t: _cycle(t, rng.uniform(0.8, 3.0), rng.uniform(0, 2 * np.pi)),
}
"""Curves of the share of the measurement's time, 0 at its start."""


def _cycle(t: Floats, period: float, phase: float) -> Floats:
    return np.asarray(np.sin(2 * np.pi * t / period + phase) - np.sin(phase))


@dataclass(frozen=True)
class Run:
    """One diagnosis: errors of location errors over their standard uncertainties, by name."""

    shape: str
    size: float
    plan: str
    verdict: str
    named: tuple[str, ...]
    axis: str
    off: dict[str, float]
    wider: dict[str, float]


def run(shape: str, size: float, plan: str, seed: int) -> Run:
    """Hide a curve, touch and diagnose; and the same touches without it."""
    rng = np.random.default_rng([seed, *shape.encode(), *plan.encode(), int(size)])
    made, setup, _, read = ground(plan)
    gone = made.conditions.time_s - made.conditions.time_s[0]
    share = np.asarray(gone / gone[-1])
    curve = SHAPES[shape](rng, share)
    curve *= rng.choice([-1.0, 1.0]) * size * NOISE_UM / np.abs(curve).max()
    axis = int(rng.choice(3, p=(0.25, 0.25, 0.5)))
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng))
    extra = Unknown("time", "time_s", "xyz"[axis], curve[:, None] * np.eye(3)[axis])
    number = int(rng.integers(1 << 31))
    m, still = (
        measure(made, setup, truth, noise_um=NOISE_UM, tick_um=0.1, unknown=u, seed=number)
        for u in (extra, None)
    )
    d = tn.diagnose(tn.Touches(m.columns), read)
    plain = tn.identify(tn.Touches(still.columns), read)
    known = {k: std for k, std in d.errors_std.items() if np.isfinite(std)}
    return Run(
        shape,
        size,
        plan,
        d.verdict,
        tuple(sorted(d.named)),
        "xyz"[axis],
        {k: float((d.errors_after[k] - truth.errors[k]) / std) for k, std in known.items()},
        {k: float(std / plain.std_errors[k]) for k, std in known.items()},
    )


SAID = ("named", "unexplained", "not seen")


def said(r: Run) -> str:
    """What a diagnosis says of the curve."""
    if r.verdict == "unexplained":
        return "unexplained"
    return "named" if any(n.startswith(("drift_", "warmup_")) for n in r.named) else "not seen"


def _held(runs: Sequence[Run]) -> str:
    off = np.abs([v for r in runs for v in r.off.values()])
    own = [(r.off[k], r.wider[k]) for r in runs if (k := MOVED[r.axis]) in r.off]
    if not own:
        return f"| {len(runs)} | | | | "
    moved, wider = np.abs(own).T
    return (
        f"| {len(runs)} | {100 * np.mean(off < 2):.0f} % | {100 * np.mean(moved < 2):.0f} % "
        f"| {off.max():.1f} | {np.median(wider):.1f} "
    )


def lines(runs: Sequence[Run]) -> list[str]:
    """Return the table: one line a plan, shape and size."""
    out = [
        "| plan | shape | size " + "".join(f"| {k} | all | moved | worst | u " for k in SAID) + "|",
        "|---" * (3 + 5 * len(SAID)) + "|",
    ]
    groups: dict[tuple[str, str, str], list[Run]] = {}
    for r in runs:
        whole = "**steady**" if r.shape == "steady" else "**not steady**"
        for shape, size in ((r.shape, f"{r.size:g}"), (whole, "all")):
            groups.setdefault((r.plan, shape, size), []).append(r)
    for cell, some in sorted(groups.items(), key=lambda one: one[0][1][0] == "*"):
        row = "".join(_held([r for r in some if said(r) == k]) for k in SAID)
        out.append("| " + " | ".join(cell) + f" {row}|")
    return out


def main() -> int:
    """Make the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--sizes", type=float, nargs="+", default=SIZES)
    parser.add_argument("--plan", choices=["paper", "rich"], action="append")
    parser.add_argument("--shape", choices=[*SHAPES], action="append")
    parser.add_argument("--store", type=Path, help="where runs are kept, one a line")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    runs = [
        run(shape, size, plan, 1000 * given.seed + i)
        for plan in given.plan or ["paper", "rich"]
        for shape in given.shape or SHAPES
        for size in given.sizes
        for i in range(given.runs)
    ]
    if given.store:
        given.store.write_text("".join(json.dumps(asdict(r)) + "\n" for r in runs))
    report.write([HEAD, *lines(runs), "", f"Seed {given.seed}."], given.out)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
