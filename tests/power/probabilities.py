"""Are the probabilities of a diagnosis true? ``python -m power.probabilities``.

python -m power.probabilities [--share 1.0] [--seed 3] [--store FOLDER] [--kind sweep ...]
    [--stored] [--out ../docs/results/power-probabilities.md]

Diagnoses measurements of every kind with causes drawn at random (`power.random_cases`) and compares
what is stated with what is true. With ``--store`` cases are kept, a file for each kind and seed: a
run that was stopped goes on, kinds can be made by several runs side by side, and with ``--stored``
the page is made of all that is there, of all seeds.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import zip_longest
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib import pyplot as plt
from numpy.typing import NDArray
from scipy import stats

from power import report
from power.random_cases import draw
from trunnion.base.errors import TrunnionError
from trunnion.models.kinds import diagnose

RUNS = {
    "touches": 1000,
    "points": 700,
    "sweep": 700,
    "diameters": 2000,
    "ballbar": 800,
    "hybrid ballbar": 800,
    "positioning": 1000,
    "levels": 1500,
    "rotarytest": 1500,
    "axislog": 800,
}
BINS = 10
SHOWN = 10  # cases of a bin, from which the picture shows it
LIMIT = 0.02  # of the expected calibration error
PERFECT_RUNS = 400  # draws of what true probabilities would show by chance
HEAD = """# Are the probabilities of a diagnosis true?

Made by `make power-probabilities` on measurements of the independent generators of each kind
(`tests/power/random_cases.py`): no cause in 25 % of the cases, one in 35 %, two in 25 %, three in
15 %, drawn at random, with sizes over a decade, logarithmically uniform, from about the smallest
that can be named: points, ball-bar tests (hybrid ones, too), diameters, levels, tests of rotary
axes and axis logs are changed by 5 to 50 noises (root of the sum of squares, beside what is always
fitted; a smooth shape of levels, which has a dozen parameters, by 10 to 100, chatter, which has two
amplitudes a pass at any of 200 pitches, by 9 to 90), touches by 6 to 70, the others by a share of a
usual size; causes that look alike are drawn together, too (a drift and a warm-up of an axis, a
curve of targets and a wave that is one of these), but not effects on axis logs with a correlation
above 0.7, nor those on touches, levels and tests of rotary axes with one above 0.999; of a tilt and
an axial motion that one target of a sweep does not tell apart one is drawn, either as often; of
what touches or the log of an axis that moves one way do not (positioning, scale, sag and backlash
of an A axis; its friction, backlash or a constant force) any. In one
of eight cases an error is hidden that is no cause of the catalogue (hybrid ball-bar: none). The
cycles of 15 % of positioning runs are not alike: beside the other causes zero or scale is another
one in each, or the scale changes in the course of the run. Of levels, cycles of the room's air last
nearly a pass, a half or a third of it (1, 2 or 3 a pass, 0.2 more or less at most): with half a
cycle more the level that is turned for the second pass reads what a surface of that shape would
give.

A diagnosis states, for sets of causes and for none, how probable it is that just these causes of
the catalogue act. *Stated* and *true*: the mean probability of the most probable set and how often
it is the hidden one. *ECE*: expected calibration error, the mean distance between stated and true
over ten bins of probability, of the most probable set, of all stated sets (alternatives, and that
there is none), and of each named cause. *By chance*: what true probabilities would show of each
with so many cases; only what is above is an error of the probabilities.

With an unknown error stated probabilities are too high: they are of sets of the catalogue, beside
at most one term of structure, in one direction or in all that are read at an instant, of a size of
its own in each. Where the error is noticed (verdict *unexplained*) what that term leaves of it is
explained by further causes; where it is not, causes of the catalogue imitate it (a level that was
knocked by few noises has drifted), and the readings hardly say otherwise.

![Stated and true probability](../figures/probabilities.png)

Bins of fewer than 10 are not shown.
"""


@dataclass(frozen=True)
class Stated:
    """What one diagnosis stated: probabilities, and whether they were of the truth."""

    kind: str
    number: int
    unknown: bool
    verdict: str
    sets: tuple[tuple[float, bool], ...]
    causes: tuple[tuple[float, bool], ...]
    seconds: float

    @property
    def top(self) -> tuple[float, bool]:
        return max(self.sets, key=lambda one: one[0])  # the first of equals, whichever is true


def state(kind: str, number: int, seed: int) -> Stated:
    """Draw a case and diagnose it."""
    case = draw(kind, number, seed, every=True)
    began = time.process_time()
    d = diagnose(case.data, case.setup)
    spent = time.process_time() - began
    sets = [(d.none_probability, not case.hidden)]
    sets += [(a.probability, a.causes == case.hidden) for a in d.evidence if a.causes]
    causes = tuple((c.probability, c.id in case.hidden) for c in d.causes)
    return Stated(kind, number, case.unknown, d.verdict, tuple(sets), causes, spent)


Pairs = Sequence[tuple[float, bool]]


def binned(pairs: Pairs) -> list[tuple[float, float, int]]:
    """Mean stated probability, share of the true ones and count of each bin that is not empty."""
    p, true = np.array(pairs, dtype=float).reshape(-1, 2).T
    index = np.minimum((p * BINS).astype(int), BINS - 1)
    some = (index == b for b in range(BINS))
    return [(float(p[m].mean()), float(true[m].mean()), int(m.sum())) for m in some if m.any()]


def calibration_error(pairs: Pairs) -> float:
    """Mean distance between stated and true over the bins."""
    p, true = np.array(pairs, dtype=float).reshape(-1, 2).T
    return _error(p, true > 0)


def by_chance(cases: Sequence[Stated]) -> tuple[float, float]:
    """Mean calibration errors, of the most probable set and of all, if probabilities were true.

    In each case one of the stated sets is drawn to be the true one, or none of them.
    """
    rng = np.random.default_rng(1)
    p = np.array([q for c in cases for q, _ in c.sets])
    count = np.array([len(c.sets) for c in cases])
    first = np.cumsum(count) - count
    own = np.repeat(np.arange(len(cases)), count)
    upper = np.cumsum(p)
    upper -= np.repeat(upper[first] - p[first], count)
    top = first + [int(np.argmax([q for q, _ in c.sets])) for c in cases]
    errors = np.zeros(2)
    for _ in range(PERFECT_RUNS):
        at = rng.random(len(cases))[own]
        true = (upper - p <= at) & (at < upper)
        errors += _error(p[top], true[top]), _error(p, true)
    one, every = errors / PERFECT_RUNS
    return float(one), float(every)


def causes_by_chance(cases: Sequence[Stated]) -> float:
    """Mean calibration error of named causes, each there as often as it is stated."""
    rng = np.random.default_rng(1)
    p = np.array([q for c in cases for q, _ in c.causes])
    return float(np.mean([_error(p, rng.random(len(p)) < p) for _ in range(PERFECT_RUNS)]))


def _error(p: NDArray[np.float64], true: NDArray[np.bool_]) -> float:
    """Calibration error of arrays (n,)."""
    index = np.minimum((p * BINS).astype(int), BINS - 1)
    return float(np.abs(np.bincount(index, p - true)).sum()) / max(len(p), 1)


def _row(name: str, cases: Sequence[Stated]) -> str:
    top = [c.top for c in cases]
    stated, true = np.mean(np.array(top, dtype=float), axis=0)
    every = calibration_error([s for c in cases for s in c.sets])
    causes = [s for c in cases for s in c.causes]
    one_by_chance, every_by_chance = by_chance(cases)
    errors = (
        calibration_error(top),
        one_by_chance,
        every,
        every_by_chance,
        calibration_error(causes),
        causes_by_chance(cases),
    )
    shown = " | ".join(f"{100 * e:.1f} %" for e in errors)
    return f"| {name} | {len(cases)} | {100 * stated:.1f} % | {100 * true:.1f} % | {shown} |"


def _unknown(cases: Sequence[Stated]) -> list[tuple[str, Sequence[Stated]]]:
    """Cases with an unknown error: all, those where it was noticed, those where not."""
    some = [c for c in cases if c.unknown]
    noticed = [c for c in some if c.verdict == "unexplained"]
    return [
        ("with an unknown error", some),
        ("- noticed", noticed),
        ("- taken for causes", [c for c in some if c not in noticed]),
    ]


def page(cases: Sequence[Stated], seeds: Sequence[str]) -> list[str]:
    """Return the page's lines."""
    known = [c for c in cases if not c.unknown]
    lines = [
        HEAD,
        "| cases | count | stated | true | ECE, most probable | by chance | ECE, all sets "
        "| by chance | ECE, causes | by chance |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    groups: list[tuple[str, Sequence[Stated]]] = [
        ("**all**", cases),
        ("without an unknown error", known),
        *_unknown(cases),
    ]
    lines += [_row(name, some) for name, some in groups if some]
    for kind in RUNS:
        mine = [c for c in cases if c.kind == kind]
        lines += [_row(kind, mine)] if mine else []
    seconds = sum(c.seconds for c in cases) / len(cases)
    lines += [
        "",
        "All sets that are stated, all cases:",
        "",
        "| stated | true | count |",
        "|---|---|---|",
        *(
            f"| {100 * p:.1f} % | {100 * t:.1f} % | {n} |"
            for p, t, n in binned([s for c in cases for s in c.sets])
        ),
        "",
        f"Seed {', '.join(seeds)}; {seconds:.2f} s CPU a diagnosis.",
    ]
    return lines


def picture(cases: Sequence[Stated], path: Path) -> None:
    """Draw stated against true probabilities."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 4.4), layout="constrained")
    shown: list[tuple[str, Callable[[Stated], Iterable[tuple[float, bool]]]]] = [
        ("sets of causes, and none", lambda c: c.sets),
        ("named causes", lambda c: c.causes),
    ]
    for ax, (title, of) in zip((left, right), shown, strict=True):
        for label, some in (
            ("all cases", list(cases)),
            ("without an unknown error", [c for c in cases if not c.unknown]),
        ):
            bins = [b for b in binned([s for c in some for s in of(c)]) if b[2] >= SHOWN]
            p, t, _ = np.array(bins).T
            ends = [
                stats.binomtest(round(share * n), n).proportion_ci(method="wilson")
                for _, share, n in bins
            ]
            low, high = np.array([(end.low, end.high) for end in ends]).T
            ways = np.maximum([t - low, high - t], 0.0)
            ax.errorbar(p, t, ways, fmt="o-", label=label, capsize=2)
        ax.plot([0, 1], [0, 1], "k:", linewidth=0.8)
        ax.set(xlabel="stated probability", ylabel="share that is true", title=title)
    left.legend()
    figure.savefig(path, dpi=90)
    plt.close(figure)


def _read(file: Path) -> Iterator[Stated]:
    """Cases that a file keeps."""
    for line in file.read_text(encoding="utf-8").splitlines():
        values = json.loads(line)
        for name in ("sets", "causes"):
            values[name] = tuple((p, t) for p, t in values[name])
        yield Stated(**values)


def _made(kind: str, numbers: Iterable[int], seed: int, store: Path | None) -> Iterator[Stated]:
    """Cases of a kind, those that are kept and new ones; nothing where one cannot be diagnosed."""
    file = store / f"{kind.replace(' ', '-')}-{seed}.jsonl" if store else None
    known = {c.number: c for c in _read(file)} if file and file.exists() else {}
    for n in numbers:
        if n in known:
            yield known[n]
            continue
        try:
            one = state(kind, n, seed)
        except TrunnionError as error:  # a case that cannot be diagnosed is stated, not hidden
            sys.stderr.write(f"{kind} {n}: {error}\n")
            continue
        if file:
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(asdict(one)) + "\n")
        yield one


def main() -> int:
    """Diagnose all cases; return 1 where the error of all stated sets is above the limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="of the cases of each kind")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--kind", choices=list(RUNS), action="append", help="only these kinds")
    parser.add_argument("--store", type=Path, help="folder where cases are kept")
    parser.add_argument("--stored", action="store_true", help="of what is kept, of all seeds")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    if given.stored and not given.store:
        parser.error("--stored: expected --store FOLDER")
    if given.store:
        given.store.mkdir(parents=True, exist_ok=True)
    if given.stored:
        files = sorted(given.store.glob("*.jsonl"))
        cases = [c for file in files for c in _read(file) if c.kind in (given.kind or RUNS)]
        seeds = sorted({file.stem.rpartition("-")[2] for file in files})
    else:
        counts = {kind: max(1, round(RUNS[kind] * given.share)) for kind in given.kind or RUNS}
        runs = [_made(kind, range(n), given.seed, given.store) for kind, n in counts.items()]
        cases = [c for some in zip_longest(*runs) for c in some if c]  # kinds progress together
        seeds = [str(given.seed)]
    report.write(page(cases, seeds), given.out)
    if given.out:
        picture(cases, given.out.parent.parent / "figures" / "probabilities.png")
    return 1 if calibration_error([s for c in cases for s in c.sets]) > LIMIT else 0


if __name__ == "__main__":
    sys.exit(main())
