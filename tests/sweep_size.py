"""What a sweep costs by its size, up to 10⁷ samples, and what follows for 10⁹.

python tests/sweep_size.py [--powers 4 5 6 7] [--out docs/results/sweep-size.md]

Each row is a sweep in a process of its own, one thread of the core. The model is fitted to all rows
but the largest first, which it then predicts: that is what its extrapolation is worth.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from power import report

ONE = """
import json, os, resource, sys, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import trunnion as tn

def main():
    samples, workers, path = int(sys.argv[1]), int(sys.argv[3]), sys.argv[4]
    fixed = {"identify": sys.argv[2] == "yes"}
    how = dict(fixed=fixed, path=path, progress=False, threads=1)
    begin = time.monotonic()
    if workers:
        with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
            tn.sweep("calibration", samples=samples, seed=1, executor=pool, **how)
    else:
        tn.sweep("calibration", samples=samples, seed=1, **how)
    print(json.dumps({
        "samples": samples,
        "wall_s": time.monotonic() - begin,
        "cpu_s": time.process_time(),
        "memory_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        "file_gb": os.path.getsize(path) / 1e9,
    }))

if __name__ == "__main__":
    main()
"""
GOAL = 10**9
PER_SWEEP = 10**7
"""Samples of one sweep on the way to the goal: all numbers of a sweep are held in memory."""


@dataclass(frozen=True)
class Row:
    """What one sweep cost the process that called it, its start and imports included."""

    samples: int
    wall_s: float
    cpu_s: float
    memory_gb: float
    file_gb: float


@dataclass(frozen=True)
class Line:
    """`first + each * samples`."""

    first: float
    each: float

    @classmethod
    def through(cls, rows: Sequence[Row], name: str) -> Line:
        """Fit by least squares of the relative deviations."""
        y = np.array([getattr(row, name) for row in rows])
        samples = np.array([row.samples for row in rows])
        a = np.stack([1 / y, samples / y], axis=1)
        first, each = np.linalg.lstsq(a, np.ones(len(y)), rcond=None)[0].tolist()
        return cls(first, each)

    def at(self, samples: int) -> float:
        """Return the value at a number of samples."""
        return self.first + self.each * samples


def measured(samples: int, identify: bool, workers: int = 0) -> Row:
    """Run one sweep in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "one.py"
        script.write_text(ONE)
        words = [str(samples), "yes" if identify else "no", str(workers), f"{folder}/a.nc"]
        run = subprocess.run(
            [sys.executable, str(script), *words], capture_output=True, text=True, check=True
        )
    return Row(**json.loads(run.stdout))


def table(rows: Sequence[Row]) -> list[str]:
    """Return the rows, and what the model says of them."""
    lines = [
        "| samples | CPU, s | wall, s | CPU of a sample, µs | memory, GB | file, GB |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        each = row.cpu_s / row.samples * 1e6
        lines.append(
            f"| {power(row.samples)} | {row.cpu_s:.1f} | {row.wall_s:.1f} | {each:.0f} | "
            f"{row.memory_gb:.2f} | {row.file_gb:.3f} |"
        )
    largest = rows[-1]
    off = []
    for what, name in (("CPU", "cpu_s"), ("memory", "memory_gb"), ("file", "file_gb")):
        predicted = Line.through(rows[:-1], name).at(largest.samples)
        off.append(f"{what} {predicted / getattr(largest, name) - 1:+.0%}")
    cpu, memory = Line.through(rows, "cpu_s"), Line.through(rows, "memory_gb")
    return [
        *lines,
        "",
        f"Model, n samples: CPU {cpu.first:.2f} s + n · {cpu.each * 1e6:.1f} µs, memory "
        f"{memory.first:.2f} GB + n · {memory.each * 1e9:.0f} bytes. Fitted without the last row, "
        f"it predicts that row with an error of {', '.join(off)}.",
    ]


def expected(rows: Sequence[Row], sent: Row) -> list[str]:
    """Return what the model says of the goal."""
    sweeps = GOAL // PER_SWEEP
    cpu = Line.through(rows, "cpu_s")
    hours = sweeps * cpu.at(PER_SWEEP) / 3600
    memory = Line.through(rows, "memory_gb").at(PER_SWEEP)
    disk = sweeps * Line.through(rows, "file_gb").at(PER_SWEEP)
    serving = (sent.cpu_s - cpu.first) / sent.samples
    return [
        f"{power(GOAL)} samples of the first table are {sweeps} sweeps of {power(PER_SWEEP)} with "
        f"seeds of their own: {hours:.1f} hours of one core, {memory:.1f} GB of memory each, "
        f"{disk:.0f} GB of disk (twice that of one sweep while it runs).",
        "",
        f"On an executor the calling process packs, receives and stores the blocks: "
        f"{sent.cpu_s:.1f} s of its CPU for {power(sent.samples)} samples, {serving * 1e6:.1f} µs "
        f"each beyond its start. It keeps at most {cpu.each / serving:.0f} cores busy with closed "
        "forms; a study that takes longer for a sample keeps more in proportion. Beyond that, run "
        "several sweeps with seeds of their own, each with its caller and its file.",
    ]


def power(samples: int) -> str:
    """Return "10⁶"."""
    return "10" + str(len(str(samples)) - 1).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))


def main() -> None:
    """Measure, fit, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--powers", type=int, nargs="+", default=[4, 5, 6, 7])
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    load = os.getloadavg()[0]
    closed = [measured(10**each, identify=False) for each in given.powers]
    fitted = [measured(10**each, identify=True) for each in given.powers[:-1]]
    sent = measured(10 ** given.powers[-2], identify=False, workers=2)
    lines = [
        "# What a sweep costs by its size",
        "",
        "Made by `make sweep-size`: the study `calibration` (72 touches simulated and estimated), "
        "each row in a process of its own with one thread of the core. The machine had "
        f"{os.cpu_count()} cores and a load of {load:.1f} from other work at the beginning, so "
        "wall times are those of a shared machine.",
        "",
        "## Closed forms only",
        "",
        "`identify = false`: 22 numbers a sample.",
        "",
        *table(closed),
        "",
        "## With least squares",
        "",
        "`identify = true`: 51 numbers a sample.",
        "",
        *table(fitted),
        "",
        "## At 10⁹ samples",
        "",
        *expected(closed, sent),
    ]
    report.write(lines, given.out)


if __name__ == "__main__":
    main()
