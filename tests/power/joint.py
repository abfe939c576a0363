"""Is a joint diagnosis of several measurements right? ``python -m power.joint``.

python -m power.joint [--cases 50] [--runs 300] [--seed 2] [--out ../docs/results/power-joint.md]

Machines with causes drawn at random (`power.one_machine`), each measured by two to four tests that
are diagnosed together; and measurements that leave a doubt alone (`power.pairs`).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import trunnion as tn
from power import pairs, report
from power.measured_twin import size_of
from power.one_machine import TOGETHER, Together, drawn
from power.probabilities import Pairs, Stated, by_chance, calibration_error
from power.random_cases import LEFT, SAME, VISIBLE
from power.study import ground
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.plain import case_of
from trunnion.models.kinds import model_of

SURE = 0.95
TINY = 1e-300
ENLARGED = 4.0  # a cause whose size is sought, so that it stands out of rounded readings
Rng = np.random.Generator
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Said:
    """What a joint diagnosis stated of a machine, and what is true.

    taken: causes of the machine that are named without a doubt, and do not act.
    """

    stated: Stated
    among: bool
    taken: frozenset[str]


def ids_of(made: Together, kinds: Sequence[str], ids: Set[str]) -> frozenset[str]:
    """Return the hidden causes as the candidates of a joint diagnosis are called.

    A curve of an axis is one for each date where its targets are others.
    """
    hidden = set(made.shared)
    for kind, names in made.own.items():
        label = kind.rpartition(" ")[2]
        dates = [label, *(f"{label} {i}" for i in range(2, 1 + kinds.count(kind)))]
        for name in names:
            hidden |= {name, f"{name}_of_x", *(f"{date}:{name}" for date in dates)} & ids
    return frozenset(hidden)


@dataclass(frozen=True)
class Ground:
    """What causes change is seen beside what is always fitted and the causes that act already."""

    model: Model
    case: Case

    def left(self, other: Model) -> tuple[Floats, float]:
        """What the readings of another measurement leave beside these, in noises; share that is."""
        here, there = self.model.readings, other.readings
        both = np.isin(here.rows, there.rows)  # the others are outliers in one of them
        change = np.zeros(len(here.values))
        change[both] = there.values[np.isin(there.rows, here.rows)] - here.values[both]
        white = self.case.whiten(change)
        basis = self.case.plain.basis
        left = white - basis @ (basis.T @ white)
        return left, float(np.linalg.norm(left)) / max(float(np.linalg.norm(white)), TINY)


def seen(kinds: Sequence[str], number: int, seed: int) -> Together:
    """Draw a machine; each cause that kinds share leaves 5 to 50 noises in all that is read.

    One of which hardly anything is left beside what is always fitted, or that looks the same as
    what acts already, does not act.
    """
    rng = np.random.default_rng([seed, number, 63])

    def model(shares: dict[str, float], *, own: bool = True) -> Model:
        made = drawn(kinds, number, seed, none | shares, own=own)
        return model_of(made.data, made.setup)

    none = dict.fromkeys(drawn(kinds, number, seed).shared, 0.0)
    bare = model({}, own=False)
    ground = Ground(bare, case_of(bare))
    acting = [ground.left(model({}))[0]]
    shares = {}
    for name in sorted(none):
        left, share = ground.left(model({name: ENLARGED}, own=False))
        long = float(np.linalg.norm(left))
        same = any(abs(left @ o) > SAME * long * np.linalg.norm(o) for o in acting if np.any(o))
        if share > VISIBLE and not same:
            acting.append(left)
            shares[name] = ENLARGED * size_of(rng, *LEFT) / long
    return drawn(kinds, number, seed, none | shares)


def state(kinds: tuple[str, ...], number: int, seed: int) -> Said:
    """Draw a machine, measure it and diagnose all together."""
    made = seen(kinds, number, seed)
    candidates = {effect.id for effect in model_of(made.data, made.setup).effects}
    hidden = ids_of(made, kinds, candidates)
    began = time.process_time()
    d = tn.diagnose(made.data, made.setup)
    spent = time.process_time() - began
    sets = [(d.none_probability, not hidden)]
    sets += [(a.probability, a.causes == hidden) for a in d.evidence if a.causes]
    causes = tuple((c.probability, c.id in hidden) for c in d.causes)
    stated = Stated(", ".join(kinds), number, made.unknown, d.verdict, tuple(sets), causes, spent)
    among = d.named == hidden or hidden in d.alternatives
    sure = {c.id for c in d.causes if c.probability > SURE and ":" not in c.id}
    return Said(stated, among, frozenset(sure - hidden))


# --- page

HEAD = """# Is a joint diagnosis of several measurements right?

Made by `make power-joint` with the independent generators of each kind.

## Machines with causes drawn at random

None to three causes that kinds share (scale, squareness, backlash) act in all measurements of a
machine, and in half of the measurements causes of their kind (`tests/power/one_machine.py`), none
that another kind would see; diameters and logs are drawn as those of the
[page of probabilities](power-probabilities.md), logs without backlash. In one of eight measurements
an error is hidden that is no cause of the catalogue; such cases are in a row of their own. *Stated*
and *true*: the mean probability of the most probable set of causes, and how often it is the hidden
one. *ECE*: expected calibration error of all stated sets, *by chance* what true probabilities
would show of so many cases. *Among*: the hidden set is the one that is named, or one of those that
are left. *Given to the machine*: a cause of the machine is stated with more than 95 % that does not
act.

"""
OF_DOUBTS = """## Doubts that another test settles

*Settled*: the hidden causes are in every set that is left, so that nothing can take their place.
Goal: together at least 95 %. A change of EZ0A is not drawn: to touches it looks the same as a
change of the backlash of Z.
"""
COLUMNS = (
    "| measured | cases | stated | true | among | ECE | by chance | given to the machine |",
    "|---|---|---|---|---|---|---|---|",
)


def _row(name: str, cases: Sequence[Said]) -> str:
    top: Pairs = [c.stated.top for c in cases]
    every: Pairs = [pair for c in cases for pair in c.stated.sets]
    said, true = np.mean(np.array(top, dtype=float), axis=0)
    chance = by_chance([c.stated for c in cases])[1]
    among = np.mean([c.among for c in cases])
    taken = np.mean([bool(c.taken) for c in cases])
    return (
        f"| {name} | {len(cases)} | {100 * said:.1f} % | {100 * true:.1f} % | {100 * among:.1f} % "
        f"| {100 * calibration_error(every):.1f} % | {100 * chance:.1f} % | {100 * taken:.1f} % |"
    )


def _random(cases: Sequence[Said]) -> list[str]:
    known = [c for c in cases if not c.stated.unknown]
    lines = [*COLUMNS, _row("**all**", cases), _row("without an unknown error", known)]
    odd = [c for c in cases if c.stated.unknown]
    lines += [_row("with an unknown error", odd)] if odd else []
    for kinds in TOGETHER:
        some = [c for c in known if c.stated.kind == ", ".join(kinds)]
        lines += [_row(", ".join(kinds), some)] if some else []
    return lines


def _by_axes(rng: Rng, number: int) -> pairs.Measured:
    return pairs.long_bar_or_machine(rng, of_machine=bool(number % 2))


DOUBTS: Mapping[str, Callable[[Rng, int], pairs.Measured]] = {
    "touches (paper) and stops of X and Y: scale or backlash of one of these": (
        lambda rng, _: pairs.scaled_or_slack(rng)
    ),
    "circle and stops of X and Y: both axes too long, or the bar": _by_axes,
    "touches (rich) on two dates: a location error but EZ0A changed by 2 to 8 µm or arcsec": (
        lambda rng, _: pairs.two_dates(rng, changed=True)
    ),
}
SOUND: Mapping[str, Callable[[Rng], pairs.Measured]] = {
    "touches (paper) and stops of X and Y: radius of the probe or sizes of the artefact, or none": (
        pairs.of_probe_or_artefact
    ),
    "touches (rich) on two dates: nothing changed": lambda rng: pairs.two_dates(rng, changed=False),
}


def _setup(data: Sequence[Any], plan: str) -> Any:
    return ground(plan)[3] if isinstance(data[0], tn.Touches) else None


def _doubts(runs: int, seed: int) -> Iterator[str]:
    yield "| measured, and what acts | runs | settled by the first alone | together |"
    yield "|---|---|---|---|"
    for i, (name, draw) in enumerate(DOUBTS.items()):
        alone = together = 0
        for k in range(runs):
            data, hidden = draw(np.random.default_rng([seed, 61, i, k]), k)
            setup = _setup(data, "rich" if "rich" in name else "paper")
            together += pairs.settled(tn.diagnose(data, setup), hidden)
            plain = {cause.rpartition(":")[2] for cause in hidden}
            alone += pairs.settled(tn.diagnose(data[0], setup), plain)
        first = "no" if "dates" in name else f"{100 * alone / runs:.1f} %"
        yield f"| {name} | {runs} | {first} | {100 * together / runs:.1f} % |"


def _sound(runs: int, seed: int) -> Iterator[str]:
    yield "| measured, and what acts | runs | a cause or change of the machine is named |"
    yield "|---|---|---|"
    for i, (name, draw) in enumerate(SOUND.items()):
        taken = 0
        for k in range(runs):
            data, _ = draw(np.random.default_rng([seed, 62, i, k]))
            d = tn.diagnose(data, _setup(data, "rich" if "rich" in name else "paper"))
            taken += any(":" not in cause or "change_" in cause for cause in d.named)
        yield f"| {name} | {runs} | {100 * taken / runs:.1f} % |"


def page(cases: Sequence[Said], runs: int, seed: int) -> list[str]:
    """Return the page's lines."""
    return [HEAD, *_random(cases), "", OF_DOUBTS, *_doubts(runs, seed), "", *_sound(runs, seed)]


def main() -> None:
    """Print the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=50, help="of each combination of kinds")
    parser.add_argument("--runs", type=int, default=300, help="of each doubt")
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    began = time.process_time()
    cases = []
    for kinds in TOGETHER:
        for number in range(given.cases):
            one = state(kinds, number, given.seed)
            cases.append(one)
            sys.stderr.write(f"{one}\n")
    lines = page(cases, given.runs, given.seed)
    spent = time.process_time() - began
    report.write([*lines, "", f"Seed {given.seed}, {spent:.0f} s of one core."], given.out)


if __name__ == "__main__":
    main()
