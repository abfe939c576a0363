"""Does the further test that is advised settle the doubt? ``python -m power.further``.

python -m power.further [--cases 110] [--seed 2] [--out ../docs/results/power-further.md]

A machine with causes drawn at random is measured by touches, by circles of a ball-bar in one
plane, or by touches and stops of a linear axis together. Where the diagnosis is in doubt,
`tn.next_measurement` advises a further test; which instrument is quick to mount is drawn. The test
is made on the same machine, by formulas of the independent generators, and all measurements are
diagnosed together.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import from_twin
import trunnion as tn
from power import report
from power.measured_twin import size_of
from power.study import draw_effects, ground
from trunnion.base.errors import TrunnionError
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

Rng = np.random.Generator
Floats = NDArray[np.float64]
Values = Mapping[str, Mapping[str, float]]
Sets = frozenset[frozenset[str]]
NOISE_UM = 0.5  # of a ball-bar and of stops of an axis, as is foreseen
QUICK, SLOW = 2.0, 60.0  # minutes to mount what is drawn to be at hand, and the others
MAX_DRAWN = 40  # times the cases that are wanted
INSTRUMENTS = ("touches", "ballbar", "positioning")
BINS = (0.0, 0.5, 0.8, 0.95, 1.0)
OF_CIRCLE = ("scale_x", "scale_y", "backlash_x", "backlash_y", "squareness_xy", "ballbar_length")


@dataclass(frozen=True)
class Machine:
    """What is true: of the twin's machine, of a ball-bar's length, and the noise of touches."""

    truth: Truth
    noise: float
    longer_um: float = 0.0

    @property
    def hidden(self) -> frozenset[str]:
        """Causes that act."""
        return frozenset(self.truth.effects) | ({"ballbar_length"} if self.longer_um else set())


def moved(place: Floats, sense: Floats, hidden: Values) -> Floats:
    """How far a three-axis machine misses a commanded place, mm, by the notes' formulas, (n, 3)."""
    of = {name: next(iter(values.values())) for name, values in hidden.items()}
    out = np.zeros_like(place)
    for i, axis in enumerate("xyz"):
        out[:, i] += 1e-6 * of.get(f"scale_{axis}", 0.0) * place[:, i]
        out[:, i] -= 1e-3 * of.get(f"backlash_{axis}", 0.0) / 2 * sense[:, i]
    for (i, j), name, sign in (((0, 1), "xy", -1), ((0, 2), "xz", 1), ((1, 2), "yz", -1)):
        out[:, i] += sign * np.radians(of.get(f"squareness_{name}", 0.0) / 3600) * place[:, j]
    return out


def lengths(place: Floats, machine: Machine, rng: Rng) -> Floats:
    """What a ball-bar about a centre that is a little off reads at commanded places, mm."""
    step = np.sign(np.round(np.gradient(place, axis=0), 9))
    tip = place + moved(place, step, machine.truth.effects) - rng.uniform(-0.02, 0.02, 3)
    noise = 1e-3 * NOISE_UM * rng.standard_normal(len(place))
    return np.asarray(np.linalg.norm(tip, axis=1) + 1e-3 * machine.longer_um + noise)


def done(plan: Any, machine: Machine, rng: Rng) -> Any:
    """What the instrument of a test reads on the machine."""
    if isinstance(plan, tn.Touches):
        way, seed = from_twin.twin_plan(plan), int(rng.integers(1 << 31))
        made = measure(
            way, ground("paper")[1], machine.truth, noise_um=machine.noise, tick_um=0.1, seed=seed
        )
        return tn.Touches(made.columns)
    if isinstance(plan, tn.Positioning):
        i = "XYZ".index(plan.columns["axis"][0])
        place, sense = np.zeros((2, len(plan), 3))
        place[:, i], sense[:, i] = plan.target, plan.direction
        off = moved(place, sense, machine.truth.effects)[:, i]
        noise = 1e-3 * NOISE_UM * rng.standard_normal(len(plan))
        return plan.with_columns(measured_mm=plan.target + off + noise)
    return plan.with_columns(length_mm=lengths(np.asarray(plan.position_mm), machine, rng))


def again(d: tn.Diagnosis, more: Any) -> tn.Diagnosis:
    """Diagnose what was measured and the further test together.

    Touches follow those that there are: the artefact is where it was.
    """
    measured = d.data if isinstance(d.data, tuple) else (d.data,)
    if isinstance(more, tn.Touches) and isinstance(measured[0], tn.Touches):
        whole = measured[0].followed_by(more)
        return tn.diagnose([whole, *measured[1:]] if measured[1:] else whole, d.setup)
    return tn.diagnose([*measured, more], d.setup or ground("paper")[3])


def left_of_doubt(d: tn.Diagnosis, both: tn.Diagnosis) -> Sets:
    """Sets that were in doubt and are left; causes that only the further test shows may be beside.

    In a joint diagnosis causes of an instrument have its measurement's name before a colon.
    """
    before = frozenset(plain(d.alternatives))
    known = frozenset().union(*before)
    return frozenset(causes & known for causes in plain(both.alternatives)) & before


def plain(sets: Iterable[frozenset[str]]) -> list[frozenset[str]]:
    """Sets of causes without the names of their measurements."""
    return [frozenset(i.rpartition(":")[2] for i in causes) for causes in sets]


# --- cases


def by_touches(rng: Rng) -> tuple[Any, tn.Setup, Machine]:
    """Touches by the paper's plan."""
    plan, setup, _, read = ground("paper")
    noise = size_of(rng, 0.2, 1.0)
    effects = draw_effects(rng, "paper", int(rng.integers(1, 3)), noise * size_of(rng, 1.0, 6.0))
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=effects)
    seed = int(rng.integers(1 << 31))
    first = measure(plan, setup, truth, noise_um=noise, tick_um=0.1, seed=seed)
    return tn.Touches(first.columns), read, Machine(truth, noise)


def by_circles(rng: Rng) -> tuple[Any, tn.Setup, Machine]:
    """Circles in XY, one each way, in one place of the machine."""
    names = rng.choice(OF_CIRCLE, int(rng.integers(1, 4)), replace=False)
    sizes = {str(name): float(rng.choice([-1, 1])) * size_of(rng, 1.0, 8.0) for name in names}
    units = {"scale": "ppm", "backlash": "b_um", "squareness": "arcsec"}
    factors = {"scale": 10.0, "backlash": 1.0, "squareness": 2.0}  # 100 mm: 1 µm
    longer = sizes.pop("ballbar_length", 0.0)
    effects = {
        name: {units[name.partition("_")[0]]: value * factors[name.partition("_")[0]]}
        for name, value in sizes.items()
    }
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=effects)
    machine = Machine(truth, NOISE_UM, longer)
    turn = np.radians(np.arange(0.0, 363.0, 3.0))
    turn = np.concatenate([turn, turn[::-1]])
    place = 100.0 * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    data = tn.Ballbar(
        {f"{a}_mm": place[:, i] for i, a in enumerate("xyz")},
        setup=np.zeros(len(turn), dtype=int),
        length_mm=lengths(place, machine, rng),
        sense=np.repeat([1, -1], len(turn) // 2),
        feed_mm_min=np.full(len(turn), 1000.0),
        time_s=0.3 * np.arange(len(turn)),
    )
    return data, ground("paper")[3], machine


def by_both(rng: Rng) -> tuple[Any, tn.Setup, Machine]:
    """Touches, and stops of a linear axis."""
    data, setup, machine = by_touches(rng)
    axis = str(rng.choice(list("XYZ")))
    up = np.linspace(-120.0, 120.0, 9) + rng.uniform(-4.0, 4.0, 9)
    target = np.tile(np.concatenate([up, up[::-1]]), 3)
    stops = tn.Positioning(
        target_mm=target,
        measured_mm=target,
        direction=np.tile(np.repeat([1, -1], 9), 3),
        cycle=np.repeat([1, 2, 3], 18),
        axis=np.full(len(target), axis),
        time_s=5.0 * np.arange(len(target)),
    )
    return [data, done(stops, machine, rng)], setup, machine


MEASURED = (by_touches, by_circles, by_both)
SHARES = (0.45, 0.3, 0.25)  # of the machines


@dataclass(frozen=True)
class Advised:
    """One case: what was measured, what was advised, and what came of it."""

    measured: str
    test: str
    expected: float
    among: bool
    settled: bool
    right: bool
    said: str


def advised(number: int, seed: int) -> Advised | None:
    """Draw a machine; None where its measurement leaves no doubt."""
    rng = np.random.default_rng([seed, number, 97])
    make = MEASURED[int(rng.choice(len(MEASURED), p=SHARES))]
    data, setup, machine = make(rng)
    d = tn.diagnose(data) if make is by_circles else tn.diagnose(data, setup)
    if len(d.alternatives) < 2:
        return None
    quick = str(rng.choice(INSTRUMENTS))
    mounting = {name: QUICK if name == quick else SLOW for name in INSTRUMENTS}
    test = tn.next_measurement(d, setup, mounting_minutes=mounting)[0]
    try:
        left = left_of_doubt(d, again(d, done(test.plan, machine, rng)))
    except tn.DataError:  # a touch beside its face, as the artefact stands: nothing is settled
        left = frozenset()
    return Advised(
        make.__name__,
        test.kind,
        test.chance,
        machine.hidden in plain(d.alternatives),
        len(left) == 1,
        left == {machine.hidden},
        f"{test.label}: {_said(d.alternatives)}, left {_said(left)}, {_said([machine.hidden])}",
    )


def _said(sets: Iterable[frozenset[str]]) -> str:
    return " | ".join("+".join(sorted(causes)) for causes in sets)


def drawn(cases: int, seed: int) -> Iterator[Advised]:
    """So many cases of doubt; each is said."""
    found = 0
    for number in range(MAX_DRAWN * cases):
        if found == cases:
            return
        try:
            one = advised(number, seed)
        except TrunnionError as error:
            sys.stderr.write(f"{number}: {error}\n")
            continue
        if one is not None:
            found += 1
            sys.stderr.write(f"{number}: {one.expected:.2f} {one.settled} {one.right} {one.said}\n")
            yield one


HEAD = """# Does the further test that is advised settle the doubt?

Made by `make power-further` with the independent generators (`tests/power/further.py`). A machine
with one to three causes drawn at random is measured: by touches, by circles of a ball-bar in XY, or
by touches and stops of a linear axis, which are diagnosed together. Where several sets of causes
are left, `tn.next_measurement` advises a further test (one drawn instrument takes 2 minutes to
mount, the others 60). The test is made on the same machine, all measurements are diagnosed
together.

*Expected*: the mean probability of settling the doubt that was stated. *Settled*: one of the sets
that were in doubt is left, causes that only the further test shows beside it or not. *Rightly*: it
is the hidden one. What is expected is meant
for one of the sets in doubt being the hidden one: that is the lower table; in the others the first
measurement did not show a hidden cause.

More is settled than expected where a set in doubt has one cause more that only the first
measurement shows (a drift while the circles ran): the further test says nothing of it, but both
together have more candidates, so that each has to explain more, and it is dropped.

"""
COLUMNS = (
    "| measured, then | cases | expected | settled | rightly |",
    "|---|---|---|---|---|",
)


def _row(name: str, some: Sequence[Advised]) -> str:
    expected, settled, right = (
        np.mean([getattr(c, what) for c in some]) for what in ("expected", "settled", "right")
    )
    spread = np.sqrt(sum(c.expected * (1 - c.expected) for c in some)) / len(some)
    return (
        f"| {name} | {len(some)} | {100 * expected:.0f} % (± {200 * spread:.0f} by chance) "
        f"| {100 * settled:.0f} % | {100 * right:.0f} % |"
    )


def _table(cases: Sequence[Advised]) -> list[str]:
    lines = [*COLUMNS, _row("**all**", cases)]
    for make, measured in zip(MEASURED, ("touches", "circles", "touches and stops"), strict=True):
        for test in INSTRUMENTS:
            some = [c for c in cases if (c.measured, c.test) == (make.__name__, test)]
            name = f"{measured}, then {test}"
            lines += [_row(name, some)] if some else []
    for low, high in itertools.pairwise(BINS):
        some = [c for c in cases if low <= c.expected and (c.expected < high or high == 1.0)]
        name = f"expected {100 * low:.0f} to {100 * high:.0f} %"
        lines += [_row(name, some)] if some else []
    return lines


def page(cases: Sequence[Advised], seed: int, seconds: float) -> list[str]:
    """Return the page's lines."""
    return [
        HEAD + "All cases:\n",
        *_table(cases),
        "",
        "The hidden set is one of those in doubt:",
        "",
        *_table([c for c in cases if c.among]),
        "",
        f"Seed {seed}, {seconds:.0f} s of one core.",
    ]


def main() -> None:
    """Print the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=110)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    began = time.process_time()
    cases = list(drawn(given.cases, given.seed))
    report.write(page(cases, given.seed, time.process_time() - began), given.out)


if __name__ == "__main__":
    main()
