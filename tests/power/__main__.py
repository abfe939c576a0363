"""Compute the power table and write it as Markdown: ``make power``.

python -m power [--runs 200] [--seed 1] [--out ../docs/results/power.md] [--only NAME ...]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

from power import report
from power.study import Case, Tally, part, run, visible

Measure = Callable[[Tally], float]
Expected = tuple[str, Measure, Callable[[float], bool], str]


def at_least(limit: float) -> tuple[Callable[[float], bool], str]:
    return (lambda x: x >= limit), f"≥ {100 * limit:g} %"


def at_most(limit: float) -> tuple[Callable[[float], bool], str]:
    return (lambda x: x <= limit), f"≤ {100 * limit:g} %"


ALARM: Expected = ("not consistent", lambda t: t.alarms, *at_most(0.05))
WRONG: Expected = ("wrong without a doubt", lambda t: t.rate("wrong"), *at_most(0.03))


def among(limit: float) -> Expected:
    return ("named or among the alternatives", lambda t: t.rate("among"), *at_least(limit))


FOUND: Expected = ("all found", lambda t: t.rate("outliers_found"), *at_least(0.95))
UNNAMED: Expected = ("no cause named", lambda t: 1 - t.named, *at_least(0.97))
QUANTITY: Expected = ("right quantity", lambda t: t.rate("quantity_named"), *at_least(0.90))
ANY_NOISE = (0.1, 2.0)
HEADING = [
    "# How often a diagnosis of touches is right",
    "",
    "Made by `make power` on measurements of the independent generator in `tests/twin`: random "
    "errors and placement, noise (0.3 µm, 0.1 to 2 µm where nothing is hidden) unknown to the "
    "code, ticks of 0.1 µm. Sizes are the rms that an effect leaves in the residuals of the plain "
    "model; effects drawn together correlate by less than 0.7. In brackets what is expected. The "
    "spread of the errors with outliers is that of the errors that are still determined, in "
    "runs where all outliers were found.",
    "",
]

TABLE: list[tuple[Case, float, list[Expected]]] = [
    # case, share of the runs (rates near 0 need more), what is expected
    (Case("no effect", "paper", noise_um=ANY_NOISE), 3.0, [ALARM]),
    (Case("no effect", "rich", noise_um=ANY_NOISE), 3.0, [ALARM]),
    (Case("no effect, heavy tails", "paper", noise_um=ANY_NOISE, noise="heavy"), 2.0, [ALARM]),
    (Case("no effect, heavy tails", "rich", noise_um=ANY_NOISE, noise="heavy"), 2.0, [ALARM]),
    (Case("one effect of 1 σ", "paper", 1, 1.0), 1.0, [among(0.99), WRONG]),
    (Case("one effect of 0.4 σ", "rich", 1, 0.4), 1.0, [among(0.99), WRONG]),
    (Case("two effects of 1 σ", "paper", 2, 1.0), 1.0, [among(0.95), WRONG]),
    (Case("two effects of 0.5 σ", "rich", 2, 0.5), 1.0, [among(0.97), WRONG]),
    (Case("three effects of 0.7 σ", "rich", 3, 0.7), 1.0, [among(0.95), WRONG]),
    (Case("four effects of 1 σ", "rich", 4, 1.0), 1.0, [among(0.90), WRONG]),
    (Case("outside the catalogue, 1 σ", "paper", size=1.0, unknown=True), 1.0, [QUANTITY]),
    (Case("outside the catalogue, 1 σ", "rich", size=1.0, unknown=True), 1.0, [QUANTITY]),
    (Case("5 % outliers", "paper", outliers=0.05), 1.0, [FOUND, UNNAMED]),
    (Case("5 % outliers", "rich", outliers=0.05), 1.0, [FOUND, UNNAMED]),
]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, default=8, help="runs of each effect")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", nargs="*", default=[])
    options = parser.parse_args()
    began = time.monotonic()
    lines = [
        *HEADING,
        "| hidden | plan | runs | measured | sets (median) | 95 % intervals cover | CPU ms |",
        "|---|---|---|---|---|---|---|",
    ]
    missed = 0
    clean: dict[str, dict[str, float]] = {}
    for case, share, expected in TABLE:
        if options.only and not any(o in f"{case.plan} {case.name}" for o in options.only):
            continue
        tally = run(case, max(1, int(options.runs * share)), options.seed)
        said = []
        for name, measure, good, text in expected:
            value = measure(tally)
            missed += not good(value)
            mark = "" if good(value) else " **missed**"
            said.append(f"{name} {100 * value:.1f} % ({text}){mark}")
        if case.effects == 0 and not case.unknown and not case.outliers:
            clean.setdefault(case.plan, _relative_spread(tally))
        if case.outliers and case.plan in clean:
            ratios = [v / clean[case.plan][k] for k, v in _relative_spread(tally).items()]
            said.append(
                f"spread of the errors, times the clean one: median {_median(ratios):.2f}, "
                f"largest {max(ratios):.2f} (≤ 1.2)"
            )
            lost = sum(
                any(name in o.diagnosis.not_identifiable for name in o.diagnosis.errors_after)
                for o in tally.outcomes
            ) / len(tally.outcomes)
            said.append(f"an error is not identifiable without them {100 * lost:.1f} %")
        coverage, intervals = tally.coverage
        lines.append(
            f"| {case.name} | {case.plan} | {len(tally.outcomes)} | {'; '.join(said)} "
            f"| {tally.alternatives:g} | "
            + (f"{100 * coverage:.1f} % of {intervals}" if intervals else "")
            + f" | {tally.milliseconds:.0f} |"
        )
        print(lines[-1], flush=True)
    if not options.only:
        lines += ["", *_parting(options.runs, options.seed)]
    if options.each and not options.only:
        lines += ["", *_each(options.each, options.seed)]
    lines += ["", f"Seed {options.seed}; {time.monotonic() - began:.0f} s."]
    if options.out:
        report.write(lines, options.out)
    return 1 if missed else 0


def _parting(count: int, seed: int) -> list[str]:
    """Promise of ``next_touches`` against what comes of it, where one effect is ambiguous."""
    tally = run(Case("ambiguous", "paper", 1, 1.0), count, seed)
    doubtful = [o for o in tally.outcomes if o.diagnosis.verdict == "ambiguous" and o.among]
    lines = [
        "Promise of `next_touches` against what came of it, single effects of 1 σ that are "
        "ambiguous under the paper's plan:",
        "",
        "| further touches | expected | cases | distinguished |",
        "|---|---|---|---|",
    ]
    for n in (8, 24):
        made = [part(o, n, seed=k) for k, o in enumerate(doubtful)]
        for low, high in ((0.0, 0.5), (0.5, 0.9), (0.9, 1.01)):
            came = [c for chance, c in made if low <= chance < high]
            if came:
                share = f"{sum(came) / len(came):.0%}"
                lines.append(f"| {n} | {low:.0%} to {min(high, 1):.0%} | {len(came)} | {share} |")
                print(lines[-1], flush=True)
    return lines


def _relative_spread(tally: Tally) -> dict[str, float]:
    """Rms error of each location error per µm of noise, where the diagnosis determines it.

    Runs in which a bad touch stayed are left out: they are counted as such.
    """
    total: dict[str, list[float]] = {}
    for o in tally.outcomes:
        if not o.outliers_found:
            continue
        for name, value in o.diagnosis.errors_after.items():
            if name in o.diagnosis.not_identifiable:
                continue
            miss = (value - o.measurement.truth.errors.get(name, 0.0)) / o.measurement.noise_um
            total.setdefault(name, []).append(miss * miss)
    return {k: (sum(v) / len(v)) ** 0.5 for k, v in total.items()}


def _median(values: list[float]) -> float:
    ordered = sorted(values)
    return ordered[len(ordered) // 2]


def _each(count: int, seed: int) -> list[str]:
    """Each effect by itself: found, aliased, missed, wrong."""
    lines = [
        f"Each effect by itself, {count} runs each: found (named without a doubt), aliased (among "
        "the alternatives), missed, wrong:",
        "",
        "| effect | plan | size | found | aliased | missed | wrong |",
        "|---|---|---|---|---|---|---|",
    ]
    for plan, sizes in (("paper", (0.5, 1.0)), ("rich", (0.2, 0.4))):
        for effect in visible(plan):
            for size in sizes:
                t = run(Case(effect, plan, size=size, only=(effect,)), count, seed)
                found = sum(o.among and o.diagnosis.verdict == "explained" for o in t.outcomes)
                aliased = sum(o.among and o.diagnosis.verdict != "explained" for o in t.outcomes)
                wrong = sum(o.wrong for o in t.outcomes)
                rest = count - found - aliased - wrong
                shares = " | ".join(f"{x / count:.0%}" for x in (found, aliased, rest, wrong))
                lines.append(f"| {effect} | {plan} | {size:g} σ | {shares} |")
                print(lines[-1], flush=True)
    return lines


if __name__ == "__main__":
    sys.exit(main())
