"""How often a sound machine is found sound by readings in steps that were taken several times.

python -m power.steps [--runs 40] [--seed 1] [--out ../docs/results/power-steps.md]

A measurement of each kind with repeats, made here by formulas of its own, of a machine with nothing
wrong but what is always fitted (a placement, a centre, an inclination) or stated in its row. The
readings have noise, and are then rounded to a step. What is placed by hand is off by tens of steps;
what stays small (a straight rail) is so. Counted are runs

* falsely named: a cause is named that is not there;
* called wrong: that, or structure is found that no cause explains.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy.stats import binomtest

import trunnion as tn
from power import report

Floats: TypeAlias = Any
Rng: TypeAlias = np.random.Generator
RATIOS = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0)
"""Noise (one standard deviation) over the step."""
REPEATS = 3


@dataclass(frozen=True)
class Read:
    """Rounds readings, with noise before: µm, or what the kind has."""

    rng: Rng
    noise: float
    step: float = 1.0

    def __call__(self, values: Floats) -> Floats:
        noisy = values + self.noise * self.step * self.rng.standard_normal(np.shape(values))
        return self.step * np.round(noisy / self.step)


def plate(read: Read, *, placed_once: bool) -> tn.Points:
    """A plate of 49 bores, measured three times, placed once for all or anew each time."""
    along = np.linspace(-150.0, 150.0, 7)
    x, y = (np.ravel(one) for one in np.meshgrid(along, along))
    columns: dict[str, list[Floats]] = {"x_mm": [], "y_mm": [], "group": []}
    shift, turn = np.zeros(2), 0.0
    for k in range(REPEATS):
        if not (k and placed_once):
            shift, turn = read.rng.uniform(-40, 40, 2), 1e-3 * read.rng.uniform(-0.3, 0.3)
        columns["x_mm"].append(x + 1e-3 * read(shift[0] - 1e3 * turn * y))
        columns["y_mm"].append(y + 1e-3 * read(shift[1] + 1e3 * turn * x))
        columns["group"].append(np.full(len(x), 0 if placed_once else k))
    made = {name: np.concatenate(values) for name, values in columns.items()}
    nominal = {"nominal_x_mm": np.tile(x, REPEATS), "nominal_y_mm": np.tile(y, REPEATS)}
    return tn.Points(**nominal, **made)


def rail(read: Read, *, turned: bool) -> tn.Levels:
    """A straight rail of 24 places, read three times, or four with the level turned for two."""
    place = 100.0 * (0.5 + np.arange(24))
    senses = (1, -1, 1, -1) if turned else (1,) * REPEATS
    sense = np.repeat(senses, len(place))
    slope = read.rng.uniform(-60, 60, 2)
    return tn.Levels(
        position_mm=np.tile(place, len(senses)),
        along_um_m=read(slope[0] * sense),
        across_um_m=read(slope[1] * sense),
        turn_deg=np.where(sense > 0, 0, 180),
        time_s=20.0 * np.arange(len(sense)),
    )


def r_test(read: Read) -> tn.RotaryTest:
    """A ball on the table, C turned three times in 24 positions; C off and tilted, nothing else."""
    turn = np.tile(np.linspace(0.0, 360.0, 24, endpoint=False), REPEATS)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    ball = np.array([120.0, 30.0, 80.0])
    off, axis = read.rng.uniform(-20, 20, 3), read.rng.uniform(-20, 20, 4)
    return tn.RotaryTest(
        a_deg=0 * turn,
        c_deg=turn,
        x_mm=c * ball[0] - s * ball[1],
        y_mm=s * ball[0] + c * ball[1],
        z_mm=np.full(len(turn), ball[2]),
        dx_um=read(axis[0] + c * off[0] - s * off[1]),
        dy_um=read(axis[1] + s * off[0] + c * off[1]),
        dz_um=read(off[2] + axis[2] * (c - 1) + axis[3] * s),
    )


def stops(read: Read, *, off_grid: bool) -> tn.Positioning:
    """An axis with a scale error and a reversal: 11 targets, both ways, five cycles."""
    up = np.linspace(0.0, 500.0, 11)
    if off_grid:
        up = np.round(up + read.rng.uniform(-8, 8, 11), 4)
    target = np.tile(np.concatenate([up, up[::-1]]), 5)
    sense = np.tile(np.repeat([1, -1], 11), 5)
    wrong = read.rng.uniform(-9, 9) + read.rng.uniform(-0.02, 0.02) * target
    wrong = wrong + read.rng.uniform(2, 8) * (sense > 0)
    return tn.Positioning(
        target_mm=target,
        measured_mm=1e-3 * read(1e3 * target + wrong),
        direction=sense,
        cycle=np.repeat(np.arange(1, 6), 22),
        time_s=15.0 * np.arange(len(target)),
    )


def circle(read: Read) -> tn.Ballbar:
    """Circles of a ball-bar about a centre that is off, both ways, twice."""
    turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    at = np.tile(np.concatenate([turn, turn[::-1]]), 2)
    x, y = 100 * np.cos(at), 100 * np.sin(at)
    u, v = read.rng.uniform(-0.03, 0.03, 2)
    return tn.Ballbar(
        setup=np.zeros(len(at), dtype=int),
        x_mm=x,
        y_mm=y,
        length_mm=1e-3 * read(1e3 * np.hypot(x - u, y - v)),
        sense=np.tile(np.repeat([1, -1], 90), 2),
    )


def passes(read: Read) -> tn.Diameters:
    """A sound part, turned in three passes, 30 diameters of each."""
    z = np.tile(np.linspace(20.0, 220.0, 30), REPEATS)
    return tn.Diameters(
        z_mm=z,
        error_um=read(np.full(len(z), read.rng.uniform(-9, 9))),
        **{"pass": np.repeat(np.arange(REPEATS), 30)},
    )


@dataclass(frozen=True)
class Row:
    """What is measured, and what is true of the machine beside what is always fitted."""

    make: Callable[[Read], Any]
    true: frozenset[str] = frozenset()
    setup: Any = None


TURNED = tn.Setup(artefact=tn.Artefact("cross"))
LATHE = tn.Setup(artefact=tn.Artefact("none"), turning={"overhang_mm": 240.0})
AXIS = frozenset({"scale", "reversal"})
ROWS = {
    "plate of 49 bores, 3 times": Row(lambda read: plate(read, placed_once=True)),
    "the same, placed anew each time": Row(lambda read: plate(read, placed_once=False)),
    "rail of 24 places, 3 times": Row(lambda read: rail(read, turned=False)),
    "the same, level turned": Row(lambda read: rail(read, turned=True)),
    "R-test of C, 3 turns": Row(r_test, setup=TURNED),
    "axis of 11 targets, 5 cycles": Row(lambda read: stops(read, off_grid=False), AXIS),
    "the same, targets between the steps": Row(lambda read: stops(read, off_grid=True), AXIS),
    "ball-bar, 2 circles each way": Row(circle),
    "diameters of 3 passes": Row(passes, setup=LATHE),
}


@dataclass
class Tally:
    """What came of the runs of one row and one ratio; see the head of the file."""

    runs: int = 0
    false: int = 0
    loud: int = 0
    seconds: float = 0.0

    def add(self, row: Row, d: tn.Diagnosis) -> str:
        """Count one diagnosis; what is wrong with it, in words."""
        wrong = d.named - row.true
        loud = bool(wrong or d.unexplained) or (not row.true and d.verdict != "consistent")
        self.runs += 1
        self.false += bool(wrong)
        self.loud += loud
        return f"{d.verdict} {sorted(wrong)} {d.unexplained or ''} sigma {d.sigma:.3g}"


def tally(name: str, ratio: float, runs: int, seed: int, *, said: bool = False) -> Tally:
    """Measure and diagnose so often."""
    row, out = ROWS[name], Tally()
    began = time.process_time()
    for run in range(runs):
        rng = np.random.default_rng([seed, list(ROWS).index(name), RATIOS.index(ratio), run])
        data = row.make(Read(rng, ratio))
        found = tn.diagnose(data) if row.setup is None else tn.diagnose(data, row.setup)
        before = out.false, out.loud
        text = out.add(row, found)
        if said and (out.false, out.loud) != before:
            sys.stderr.write(f"{name}, {ratio:g}, run {run}: {text} {found.notes}\n")
    out.seconds = time.process_time() - began
    return out


def share(count: int, of: int) -> str:
    """Percentage with its 95 % interval (Clopper and Pearson)."""
    ci = binomtest(count, of).proportion_ci(0.95)
    return f"{100 * count / of:.1f} % ({100 * ci.low:.1f} to {100 * ci.high:.1f})"


def line(name: str, every: list[Tally]) -> str:
    """One row of the table."""
    runs = sum(t.runs for t in every)
    cells = " | ".join(f"{t.false}/{t.loud}" for t in every)
    false, loud = (sum(getattr(t, what) for t in every) for what in ("false", "loud"))
    return f"| {name} | {cells} | {share(false, runs)} | {share(loud, runs)} |"


HEAD = f"""# Readings in steps that were taken several times

Made by `make power-steps`. A machine with nothing wrong is measured by each kind of data that has
repeats; the noise of a reading is a part of the step that it is then rounded to, or some steps. A
cell has two counts of its runs: a cause is named that is not there / the data are called wrong, by
that or by structure that no cause explains. `tests/power/steps.py` makes the readings, by formulas
of its own.

| noise / step: | {" | ".join(f"{r:g}" for r in RATIOS)} | named (95 %) | wrong (95 %) |
|---|{"---|" * (len(RATIOS) + 2)}
"""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", nargs="*", default=[], help="parts of names of rows")
    parser.add_argument("--said", action="store_true", help="say each false finding")
    options = parser.parse_args()
    rows = [n for n in ROWS if not options.only or any(part in n for part in options.only)]
    lines, seconds = [], 0.0
    for name in rows:
        every = [tally(name, r, options.runs, options.seed, said=options.said) for r in RATIOS]
        seconds += sum(t.seconds for t in every)
        lines.append(line(name, every))
    end = f"Seed {options.seed}, {options.runs} runs a cell, {seconds:.0f} s of one core."
    report.write([HEAD + "\n".join(lines), "", end], options.out)


if __name__ == "__main__":
    main()
