"""How often a diagnosis of axis logs is right: ``python -m power.axis_logs``.

python -m power.axis_logs [--runs 50] [--seed 1] [--out ../docs/results/power-axis-logs.md]
    [--only NAME]

Logs of an independent twin at two feeds, 0.2 µm and 1 arcsec of noise: nothing hidden, the same
with noise that has a memory, and each kind of effect by itself on an axis and of a size drawn anew.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

import axis_log_twin as twin
from power import report
from trunnion import contouring as ct
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.kinds import diagnose
from trunnion.setup import Artefact, Setup

BATCH = 20
NOTHING = {
    "nothing": 0.0,
    "nothing, memory 0.9": 0.9,
    "nothing, memory 0.97": 0.97,
    "nothing, memory 0.99": 0.99,
}
"""Rows without an effect: correlation of the noise from one sample (1 ms) to the next."""
EFFECTS = twin.KINDS[1:]
TOGETHER = {
    " + ".join(kinds): kinds
    for kinds in (
        ("friction", "resonance"),
        ("friction", "gain"),
        ("friction", "loop_delay"),
        ("backlash", "resonance"),
        ("backlash", "gain"),
        ("backlash", "loop_delay"),
        ("gain", "resonance"),
    )
}
"""Rows with two effects on one axis."""
RIGHT, QUIET = 0.97, 0.95
HEAD = """\
# How often a diagnosis of axis logs is right

Made by `make power-axis-logs` on logs of the independent twin in `tests/axis_log_twin.py`: the path
of Byun and Jee at 1 and 3 m/min, noise of 0.2 µm and 1" unknown to the code, one effect on an axis
drawn at random, of a size drawn from 0.5 to 3 % of gain, 5 to 20 % of time constant, 0.25 to 1.5 ms
of delay in the loop, 0.2 to 2 ms in the log, 1 to 5 µm of friction, 1 to 8 µm of backlash, 0.5 to
3 µm of cyclic error (rotary axes: twice the number in arcsec), a resonance at 25 to 60 Hz.

Right: verdict "consistent" where nothing is hidden (promised for white noise: at least 95 %), else
the effect named or in the alias group of a cause (promised for all alone: at least 97 %), of two
on one axis both of them. Nothing else: no further cause and nothing unexplained. Wrong without a
doubt: verdict "explained" by something else. Memory: correlation of the noise from one sample
(1 ms) to the next.

"""


@dataclass
class Tally:
    """What came of the runs of one row."""

    runs: int = 0
    right: int = 0
    alone: int = 0
    wrong: int = 0
    named: int = 0
    seconds: float = 0.0

    def add(self, d: Diagnosis, hidden: Sequence[str], seconds: float) -> bool:
        """Count a diagnosis; return whether it is right."""
        hit = all(any(h == c.id or h in c.aliases for c in d.causes) for h in hidden)
        good = hit if hidden else d.verdict == "consistent"
        self.runs += 1
        self.right += good
        self.alone += good and len(d.causes) <= len(hidden) and d.unexplained is None
        self.wrong += d.verdict == "explained" and bool(d.causes) and not hit
        self.named += bool(d.causes)
        self.seconds += seconds
        return good


def logs(kind: str, runs: int, seed: int) -> Iterator[tuple[list[str], object]]:
    """Hidden effects and log of each run; a row's logs depend on its name and the seed only."""
    rows = [*NOTHING, *EFFECTS, *TOGETHER]
    rng = np.random.default_rng([seed, rows.index(kind)])
    commands = [twin.commanded(1000 / 60), twin.commanded(3000 / 60)]
    memory = NOTHING.get(kind, 0.0)
    plain = None
    for start in range(0, runs, BATCH):
        count = min(BATCH, runs - start)
        if kind in NOTHING:
            if plain is None:
                plain = [twin.actual(c, twin.Cases(1))[0] for c in commands]
            for _ in range(count):
                yield [], twin.log(commands, plain, rng, memory=memory)
            continue
        cases, truth = twin.draw_together(count, rng, TOGETHER.get(kind, (kind,)))
        actual = [twin.actual(c, cases) for c in commands]
        for i, hidden in enumerate(truth):
            yield [h for h in hidden if h], twin.log(commands, [a[i] for a in actual], rng)


def share(count: int, of: int) -> str:
    """Percentage with its 95 % interval (Clopper and Pearson)."""
    ci = binomtest(count, of).proportion_ci(0.95)
    return f"{100 * count / of:.1f} % ({100 * ci.low:.1f} to {100 * ci.high:.1f})"


def main() -> int:
    """Print a line a row, each miss on standard error; return 1 where a rate is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50, help="of each row; of nothing, four times")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", nargs="*", default=[], help="rows by name")
    options = parser.parse_args()
    setup = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
    lines = [
        "| hidden | runs | right (95 % interval) | nothing else | wrong without a doubt | CPU s |",
        "|---|---|---|---|---|---|",
    ]
    total = Tally()
    quiet = Tally()
    for kind in [*NOTHING, *EFFECTS, *TOGETHER]:
        if options.only and kind not in options.only:
            continue
        tally = Tally()
        for hidden, log in logs(kind, options.runs * (4 if kind == "nothing" else 1), options.seed):
            began = time.process_time()
            d = diagnose(log, setup)
            spent = time.process_time() - began
            good = tally.add(d, hidden, spent)
            if kind in EFFECTS:
                total.add(d, hidden, spent)
            elif kind == "nothing":
                quiet.add(d, hidden, spent)
            if not good:
                named = ", ".join(c.id for c in d.causes) or "no cause"
                sys.stderr.write(
                    f"{' + '.join(hidden) or kind}: {d.verdict}, {named}; {d.unexplained}\n"
                )
        lines.append(_line(kind, tally))
        sys.stderr.write(lines[-1] + "\n")
    if total.runs:
        lines.append(_line(f"**all effects** (≥ {100 * RIGHT:g} %)", total))
    text = "\n".join(lines) + "\n"
    if options.out:
        report.write([HEAD + text, f"Seed {options.seed}."], options.out)
    sys.stdout.write(text)
    missed = (total.runs and total.right < RIGHT * total.runs) or (
        quiet.runs and quiet.right < QUIET * quiet.runs
    )
    return 1 if missed else 0


def _line(kind: str, t: Tally) -> str:
    return (
        f"| {kind} | {t.runs} | {share(t.right, t.runs)} | {t.alone} | {t.wrong} "
        f"| {t.seconds / t.runs:.1f} |"
    )


if __name__ == "__main__":
    sys.exit(main())
