"""The long run of the fuzzers: ``make fuzz``, or ``python fuzz.py`` in ``tests``.

``--out ../docs/results/fuzz.md`` keeps its counts.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from hostile import attack, calls
from hostile_core import REFUSALS, core_calls
from mutated_files import diagnoses, mutations
from power.report import write

HEAD = """# Hostile arguments and mutated files

Made by `make fuzz`: arguments that do not fit for every public function and for the extension
module, sample files of every kind with bytes, numbers and lines changed at random, read, and some
of them diagnosed. *Wrong* is what is not an error of the package's own with a place: another
exception, a panic, a warning, no end within the time, a nan in a result.

| what | how many | a second | wrong |
|---|---|---|---|"""

ROWS: list[str] = []


def report(what: str, found: Iterator[str], count: int) -> int:
    """Print what went wrong, each kind once, and the rate; return how often it did."""
    begin, seen = time.monotonic(), Counter[str]()
    for line in found:
        kind = f"{line.split('(')[0]} {line.rpartition('): ')[2][:40]}"
        seen[kind] += 1
        if seen[kind] == 1:
            print(line, flush=True)
    seconds = time.monotonic() - begin
    total = seen.total()
    print(f"{what}: {count:,} in {seconds:.0f} s ({count / seconds:.0f} a second), {total} wrong")
    ROWS.append(f"| {what} | {count:,} | {count / seconds:.0f} | {total} |")
    return total


def main() -> None:
    """Run files, public functions and the extension module; exit with 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=1_000_000)
    parser.add_argument("--diagnoses", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    public, core = calls(), core_calls()
    wrong = report(
        "calls of the extension module",
        attack(core, 4 * given.rounds, given.seed, REFUSALS),
        4 * given.rounds * len(core),
    )
    wrong += report(
        "calls of public functions",
        attack(public, given.rounds, given.seed),
        given.rounds * len(public),
    )
    wrong += report(
        "diagnoses of mutated data", diagnoses(given.diagnoses, given.seed), given.diagnoses
    )
    wrong += report("mutated files", mutations(given.files, given.seed), given.files)
    if given.out:
        write([HEAD, *ROWS, "", f"Seed {given.seed}."], given.out)
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
