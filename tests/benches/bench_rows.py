"""Seconds and memory of a diagnosis of many rows, each kind of data in a process of its own.

Run by ``make bench-rows``: processor time on one thread and the largest resident memory, the
measurement not counted in the time. Goal: 10^5 rows in 10 s and 2 GiB. ``small`` kinds are a
measurement of the usual size repeated with new noise, whose own noise is then structure that is
there again and again: the worst case, as the search looks for everything.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import axis_log_twin
import ballbar_study
import positioning_twin
import trunnion as tn
import turning_blind
from power.measured_twin import make_points, make_sweep
from power.random_cases import draw
from trunnion import contouring as ct
from trunnion.models import examples

ROWS = 100_000
GOAL_S, GOAL_GIB = 10.0, 2.0
NO_ARTEFACT = tn.Artefact("none")


def repeated(data: Any, rows: int, noise: Mapping[str, float], seed: int) -> Any:
    """Return so many rows of a measurement again and again, with noise and the time going on."""
    times, rng = -(-rows // len(data)), np.random.default_rng(seed)
    columns = {name: np.tile(values, times)[:rows] for name, values in data.columns.items()}
    for name, size in noise.items():
        columns[name] = columns[name] + size * rng.standard_normal(rows)
    if "time_s" in columns:
        again = np.repeat(np.arange(times), len(data))[:rows]
        columns["time_s"] = columns["time_s"] + again * (np.ptp(data.columns["time_s"]) + 30.0)
    return type(data)(columns)


def touches(rows: int, seed: int) -> tuple[Any, Any]:
    """Touches of a cross, small."""
    case = draw("touches", seed)
    noise = {n: 3e-4 for n in ("x_mm", "y_mm", "z_mm") if n in case.data.columns}
    return repeated(case.data, rows, noise, seed), case.setup


def points(rows: int, seed: int) -> tuple[Any, Any]:
    """Features anywhere in a plane."""
    hidden = ("scale_x", "straightness_y_of_x")
    return tn.Points(**make_points(seed, hidden, 0.05, features=rows).columns), None


def sweep(rows: int, seed: int) -> tuple[Any, Any]:
    """Three targets on a turning axis."""
    made = make_sweep(seed, ("radial_3", "tilt_2"), 0.1, targets=3, step_deg=360.0 * 3 / rows)
    return tn.Sweep(**made.columns), None


def diameters(rows: int, seed: int) -> tuple[Any, Any]:
    """Three turned passes, small."""
    data, setup = turning_blind.measured(seed, ("tool_wear",), 3)
    return repeated(data, rows, {"error_um": 0.3, "z_mm": 1e-3}, seed), setup


def passes(rows: int, seed: int) -> tuple[Any, Any]:
    """Three turned passes of many readings."""
    hidden = ("tool_heating", "chatter")
    return turning_blind.measured(seed, hidden, 3, count=rows // 3)


def ballbar(rows: int, seed: int) -> tuple[Any, Any]:
    """Circle tests of a three-axis machine."""
    flat = ballbar_study.cartesian_cases(["scale"], seed)[0]
    step = 2.0 * len(flat) / rows
    return ballbar_study.cartesian_cases(["backlash", "scale"], seed, 0.5, step_deg=step)[0], None


def hybrid(rows: int, seed: int) -> tuple[Any, Any]:
    """Circle tests of a hybrid machine."""
    hidden = {"screw_cyclic": 0.3, "drift_x": 0.3}
    step = 4.0 * len(ballbar_study.hybrid_cases(hidden, seed)) / rows
    return ballbar_study.hybrid_cases(hidden, seed, step_deg=step), None


def positioning(rows: int, seed: int) -> tuple[Any, Any]:
    """Stops of an axis in many cycles."""
    rng = np.random.default_rng(seed)
    data = positioning_twin.axis(rng, cycles=-(-rows // 22))
    change = sum(positioning_twin.HIDDEN[name](data, rng) for name in ("scale", "reversal"))
    return data.with_columns(measured_mm=data.measured + 1e-3 * change), None


def levels(rows: int, seed: int) -> tuple[Any, Any]:
    """A surface, small."""
    noise = {"along_um_m": 0.3, "across_um_m": 0.3}
    return repeated(examples.surface_levels()[0], rows, noise, seed), None


def rotarytest(rows: int, seed: int) -> tuple[Any, Any]:
    """An R-test of two balls, small."""
    data, setup = examples.rotary_test()
    return repeated(data, rows, {"dx_um": 0.3, "dy_um": 0.3, "dz_um": 0.3}, seed), setup


def axislog(rows: int, seed: int) -> tuple[Any, Any]:
    """Five axes at two feeds, again and again."""
    command = [axis_log_twin.commanded(feed / 60) for feed in (1000.0, 3000.0)]
    actual = [one[0] for one in (axis_log_twin.actual(c, axis_log_twin.Cases(1)) for c in command)]
    times = -(-rows // sum(map(len, command)))
    log = axis_log_twin.log(command * times, actual * times, np.random.default_rng(seed))
    return log[:rows], tn.Setup(artefact=NO_ARTEFACT, servo=ct.Servo.paper().to_table())


KINDS: Mapping[str, Callable[[int, int], tuple[Any, Any]]] = {
    "touches": touches,
    "points": points,
    "sweep": sweep,
    "diameters": diameters,
    "passes": passes,
    "ballbar": ballbar,
    "hybrid ballbar": hybrid,
    "positioning": positioning,
    "levels": levels,
    "rotarytest": rotarytest,
    "axislog": axislog,
}
OTHERS: Mapping[str, Callable[[Any, Any], object]] = {
    "observability": lambda data, setup: tn.observability(data, setup),
    "identify": lambda data, setup: tn.identify(data, setup),
    "closed form": lambda data, setup: tn.closed_form(data, setup, method="separating"),
}
"""Of touches, which have them."""


def one(kind: str, rows: int, seed: int) -> dict[str, Any]:
    """Do the work of a kind in this process: rows, seconds, GiB, what was found."""
    data, setup = KINDS["touches" if kind in OTHERS else kind](rows, seed)
    begun = time.process_time()
    found = OTHERS[kind](data, setup) if kind in OTHERS else tn.diagnose(data, setup)
    seconds = time.process_time() - begun
    said = f"{found.verdict}: {', '.join(c.id for c in found.causes)}" if kind in KINDS else ""  # type: ignore[attr-defined]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {"rows": len(data), "seconds": seconds, "gib": memory, "said": said}


def main() -> None:
    """Print a line for each kind, and how many miss the goal."""
    ask = argparse.ArgumentParser(description=__doc__)
    ask.add_argument("--rows", type=int, default=ROWS)
    ask.add_argument("--seed", type=int, default=5)
    ask.add_argument("--kinds", nargs="+", default=[*KINDS, *OTHERS], choices=[*KINDS, *OTHERS])
    ask.add_argument("--here", action="store_true", help="one kind in this process, as JSON")
    given = ask.parse_args()
    if given.here:
        print(json.dumps(one(given.kinds[0], given.rows, given.seed)))
        return
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        if os.environ.get(name) != "1":
            ask.error(f"{name}: got {os.environ.get(name)}, expected 1 (make bench-rows)")
    missed = 0
    for kind in given.kinds:
        words = ["--here", "--rows", str(given.rows), "--seed", str(given.seed), "--kinds", kind]
        run = subprocess.run(
            [sys.executable, "-W", "ignore", __file__, *words],
            capture_output=True,
            text=True,
            check=True,
        )
        found = json.loads(run.stdout)
        late = found["seconds"] > GOAL_S or found["gib"] > GOAL_GIB
        missed += late
        numbers = f"{found['rows']:8d} rows {found['seconds']:6.1f} s {found['gib']:5.2f} GiB"
        print(f"{kind:16} {numbers}{' *' if late else '  '}  {found['said']}", flush=True)
    print(f"{missed} of {len(given.kinds)} beyond {GOAL_S:g} s or {GOAL_GIB:g} GiB (*)")


if __name__ == "__main__":
    main()
