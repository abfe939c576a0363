"""How often a diagnosis of axis logs is right: ``python -m power.axis_logs --runs 90 --seed 1``.

Single hidden effects in turn, two feeds, 0.2 µm and 1 arcsec of white noise, made by the twin.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

import axis_log_twin as twin
from trunnion import contouring as ct
from trunnion.diagnosis import diagnose
from trunnion.setup import Artefact, Setup

BATCH = 18


def main() -> None:
    """Print a line for each miss and the rates."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=90)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    setup = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
    rng = np.random.default_rng(options.seed)
    commands = [twin.commanded(1000 / 60), twin.commanded(3000 / 60)]
    done: Counter[str] = Counter()
    right: Counter[str] = Counter()
    alone: Counter[str] = Counter()
    for _ in range(0, options.runs, BATCH):
        cases, truth = twin.draw(BATCH, rng)
        actual = [twin.actual(c, cases) for c in commands]
        for i, hidden in enumerate(truth):
            log = twin.log(commands, [a[i] for a in actual], rng)
            d = diagnose(log, setup)
            kind = "nothing" if hidden is None else hidden.rsplit("_", 1)[0]
            named = [c.id for c in d.causes]
            found = any(hidden == c.id or hidden in c.aliases for c in d.causes)
            good = d.verdict == "consistent" if hidden is None else found
            done[kind] += 1
            right[kind] += good
            alone[kind] += good and len(named) <= 1 and d.unexplained is None
            if not good:
                print(f"missed {hidden}: {d.verdict}, {named}, {d.unexplained}", flush=True)
    print(f"{'hidden':<16} {'runs':>5} {'right':>6} {'nothing else':>13}")
    for kind in done:
        print(f"{kind:<16} {done[kind]:>5} {right[kind]:>6} {alone[kind]:>13}")
    effects = [k for k in done if k != "nothing"]
    share = sum(right[k] for k in effects) / max(sum(done[k] for k in effects), 1)
    print(f"named or in its alias group: {100 * share:.1f} %")


if __name__ == "__main__":
    main()
