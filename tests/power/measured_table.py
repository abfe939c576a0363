"""The blind tests of points and sweeps in full: ``python -m power.measured_table``.

Rates with their counts, as Markdown; seeds from 1, a sample of other seeds is in the tests.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import trunnion as tn
from power import report
from power.measured_twin import (
    POINT_EFFECTS,
    SPACE_EFFECTS,
    SWEEP_EFFECTS,
    Made,
    make_points,
    make_sweep,
)

Make = Callable[[int, tuple[str, ...]], Made]

CASES: list[tuple[str, type[tn.Points] | type[tn.Sweep], tuple[str, ...], Make]] = [
    ("points in a plane", tn.Points, POINT_EFFECTS, lambda s, h: make_points(s, h)),
    ("points in space", tn.Points, SPACE_EFFECTS, lambda s, h: make_points(s, h, space=True)),
    ("two set-ups", tn.Points, (), lambda s, h: make_points(s, h, groups=2)),
    ("plane, heavy tails", tn.Points, (), lambda s, h: make_points(s, h, heavy=True)),
    ("full turn, three targets", tn.Sweep, SWEEP_EFFECTS, lambda s, h: make_sweep(s, h)),
    (
        "full turn, one target",
        tn.Sweep,
        SWEEP_EFFECTS,
        lambda s, h: make_sweep(s, h, targets=1, step_deg=5.0),
    ),
    (
        "arc of 100 deg, one target",
        tn.Sweep,
        (),
        lambda s, h: make_sweep(s, h, targets=1, range_deg=100.0, step_deg=5.0),
    ),
    (
        "arc of 150 deg, heavy tails",
        tn.Sweep,
        (),
        lambda s, h: make_sweep(s, h, range_deg=150.0, step_deg=5.0, heavy=True),
    ),
]


def _tally(effect: str, said: list[tn.Diagnosis]) -> str:
    """What the diagnoses of one row said, with counts."""
    found_any = sum(d.verdict != "consistent" for d in said)
    if not effect:
        return f"not consistent: {found_any}"
    found = sum(any(effect in a for a in d.alternatives) for d in said)
    if effect == "field":
        # A random field has every error of the axes in it, and is made of them where they do.
        return f"not consistent: {found_any}, a field by name: {found}"
    stated = sum("absorbs it" in d.not_identifiable.get(effect, "") for d in said)
    return f"stated as not identifiable: {stated}" if stated else f"named or alternative: {found}"


def main() -> None:
    """Measure every rate and print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    lines = [
        "# How often a diagnosis of points and sweeps is right",
        "",
        "Made by `make power` on measurements of the independent generator in "
        "`tests/power/measured_twin.py`: random placements, noise unknown to the code; an effect "
        "leaves 1.5 times the noise in the residuals of the plain model.",
        "",
        "| measurement | hidden (1.5 σ) | runs | result |",
        "|---|---|---|---|",
    ]
    for name, kind, effects, make in CASES:
        for effect in ("", *effects):
            said = [
                tn.diagnose(kind(**make(s, (effect,) if effect else ()).columns))
                for s in range(1, given.runs + 1)
            ]
            lines.append(
                f"| {name} | {effect or 'nothing'} | {given.runs} | {_tally(effect, said)} |"
            )
            sys.stderr.write(lines[-1] + "\n")
    report.write(lines, given.out)


if __name__ == "__main__":
    main()
