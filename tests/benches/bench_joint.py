"""Time of a joint diagnosis over that of its measurements one by one, processor time, one thread.

Each is read, too: its summary and all that JSON holds of it, which nothing may put off unnoticed.

Run by ``make bench-joint``. Measurements are those of one machine (`power.one_machine`): what they
share acts in all of them. ``--apart`` draws each measurement's machine by itself instead, with none
to three causes (`power.random_cases`): what they say then contradicts, and nobody measures so.
"""

import argparse
import dataclasses
import os
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import trunnion as tn
from power.one_machine import TOGETHER, drawn
from power.random_cases import draw

ALL = ("touches", "ballbar", "axislog", "positioning")  # that one machine is measured with
APART = 1000  # numbers between the cases of a joint one


def apart(kinds: tuple[str, ...], number: int, seed: int) -> tuple[list[Any], Any]:
    """Draw a measurement of each kind, each of a machine of its own, and the set-up of all."""
    numbers = [number + (0 if kind == "axislog" else APART * i) for i, kind in enumerate(kinds)]
    made = [draw(kind, n, seed) for kind, n in zip(kinds, numbers, strict=True)]
    setups = {kind: one.setup for kind, one in zip(kinds, made, strict=True) if one.setup}
    setup: Any = next(iter(setups.values()), None)
    if "axislog" in setups:
        setup = dataclasses.replace(setup, servo=setups["axislog"].servo)
    return [one.data for one in made], setup


def read(data: Any, setup: Any) -> None:
    """Diagnose, and read all that is said of it."""
    found = tn.diagnose(data, setup)
    found.summary()
    found.to_dict()


def least(works: Sequence[Callable[[], Any]], rounds: int) -> list[float]:
    """Least processor time of each call: what else the machine does only adds to it.

    They take turns, so that what is going on beside them slows all of them.
    """
    times: list[list[float]] = [[] for _ in works]
    for _ in range(rounds):
        for work, own in zip(works, times, strict=True):
            begun = time.process_time()
            work()
            own.append(time.process_time() - begun)
    return [min(own) for own in times]


def main() -> None:
    """Print each case, and the median of all."""
    ask = argparse.ArgumentParser(description=__doc__)
    ask.add_argument("--cases", type=int, default=2, help="of each combination of kinds")
    ask.add_argument("--rounds", type=int, default=3, help="of which the quickest counts")
    ask.add_argument("--apart", action="store_true", help="a machine for each measurement")
    ask.add_argument("--seed", type=int, default=5)
    given = ask.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        if os.environ.get(name) != "1":
            ask.error(f"{name}: got {os.environ.get(name)}, expected 1 (make bench-joint)")
    print(f"{'measurements':44} {'one by one':>10} {'together':>10}   ratio")
    ratios, spent = [], [0.0, 0.0]
    for kinds in (*TOGETHER, ALL):
        for number in range(given.cases):
            if given.apart:
                data, setup = apart(kinds, number, given.seed)
            else:
                made = drawn(kinds, number, given.seed)
                data, setup = made.data, made.setup
            works = [partial(read, one, setup) for one in (*data, data)]
            *each, together = least(works, given.rounds)
            alone = sum(each)
            ratios.append(together / alone)
            spent = [spent[0] + alone, spent[1] + together]
            said = f"{alone * 1e3:7.0f} ms {together * 1e3:7.0f} ms {ratios[-1]:7.2f}"
            print(f"{', '.join(kinds):44} {said}", flush=True)
    median, worst = statistics.median(ratios), max(ratios)
    print(f"{'median of all, largest':44} {median:29.2f} {worst:.2f}")
    print(f"{'sum of all':44} {spent[1] / spent[0]:29.2f}")


if __name__ == "__main__":
    main()
