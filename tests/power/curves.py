"""Do uncertainties hold beside curves of a guide, and are short waves on a plate seen?

python -m power.curves [--count 24] (`make power-curves`)

Touches of the independent generator, in which one axis moves the tool along another (or along
itself) by a dent, a kink or a wave that no cause makes; of those in which structure is stated it is
counted how many have a location error off by more than 2.5 standard errors. Square plates of which
X has a wave along Y, of two steps of the grid and a little more, in noise of 0.5 µm; and plates of
noise alone. Right: unexplained, no cause is named, a function of Y is in the extended model, and
the noise is within a quarter.
"""

from __future__ import annotations

import argparse
import itertools
import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import trunnion as tn
from power.study import ground
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

Floats = NDArray[np.float64]
Rng = np.random.Generator
SIZES_UM = (1.5, 3.0, 6.0)
FAR = 2.5  # standard errors
NOISE_UM = 0.5  # of a plate
STEP_MM = 20.0
PLACES = (9, 13, 25)  # in a row
STEPS = (2.0, 2.1, 2.3, 2.6)
WAVES_UM = (1.0, 2.0, 4.0)


def _dent(rng: Rng, s: Floats) -> Floats:
    return np.asarray(np.exp(-(((s - rng.uniform()) / rng.uniform(0.06, 0.25)) ** 2)))


def _kink(rng: Rng, s: Floats) -> Floats:
    return np.asarray(2.0 * np.abs(s - rng.uniform(0.2, 0.8)))


def _wave(rng: Rng, s: Floats) -> Floats:
    return np.asarray(np.sin(2 * np.pi * (s / rng.uniform(0.3, 1.5) + rng.uniform())))


CURVES: dict[str, Callable[[Rng, Floats], Floats]] = {"dent": _dent, "kink": _kink, "wave": _wave}


def of_a_guide(plan: str, curve: str, seed: int) -> tuple[bool, bool]:
    """Whether structure is stated in touches with a curve, and whether an error is far off then."""
    rng = np.random.default_rng([seed, 77])
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects={})
    made, twin, _, setup = ground(plan)
    measured = measure(made, twin, truth, noise_um=0.3, tick_um=0.1, seed=seed)
    columns = {k: np.array(v) for k, v in measured.columns.items()}
    along, moves = rng.choice(list("xyz")), rng.choice(list("xyz"))
    place = columns[f"{along}_mm"]
    share = (place - place.min()) / np.ptp(place)
    moved_um = SIZES_UM[seed % len(SIZES_UM)] * CURVES[curve](rng, share)
    read = columns[f"dir_{moves}"] * moved_um * 1e-3  # what of it a touch reads
    for axis in "xyz":
        columns[f"{axis}_mm"] -= read * columns[f"dir_{axis}"]
    d = tn.diagnose(tn.Touches(columns), setup)
    off = [
        abs(d.errors_after[name] - true) > FAR * d.errors_std[name]
        for name, true in truth.errors.items()
    ]
    return d.structure is not None, any(off)


def plate(
    seed: int,
    count: int,
    step_mm: float,
    size_um: float,
    period_mm: float,
    *,
    meander: bool = False,
    noise_um: tuple[float, float] = (NOISE_UM, NOISE_UM),
) -> tn.Points:
    """A square grid measured in random order or row by row, to and fro; X has a wave along Y."""
    rng = np.random.default_rng(seed)
    x, y = (a.ravel() for a in np.meshgrid(*[np.arange(count) * step_mm] * 2))
    rows = np.arange(len(x)).reshape(count, count)
    rows[1::2] = rows[1::2, ::-1]
    order = rows.ravel() if meander else rng.permutation(len(x))
    x, y = x[order], y[order]
    phase = rng.uniform(0, 6.28) if period_mm > 2 * step_mm else np.pi / 2
    wave = size_um * np.sin(2 * np.pi * y / period_mm + phase)
    noise = np.array(noise_um)[:, None] * rng.standard_normal((2, len(x)))
    turn = rng.normal(0.0, 5e-5)
    return tn.Points(
        nominal_x_mm=x,
        nominal_y_mm=y,
        x_mm=x + 1e-3 * (wave + noise[0]) - turn * y + 0.013,
        y_mm=y + 1e-3 * noise[1] + turn * x - 0.021,
        time_s=20.0 * np.arange(len(x)),
    )


def right(d: tn.Diagnosis) -> bool:
    """Whether the diagnosis of a plate with a wave is right."""
    if d.verdict != "unexplained" or d.named or d.structure is None:
        return False
    effect = d.structure.effect
    along = (effect.covariate, effect.component) == ("Y position", "X")
    return along and abs(d.sigma / NOISE_UM - 1) < 0.25


def main() -> None:
    """Print how many of each are right."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=24, help="of curves of each shape and plan")
    count = parser.parse_args().count
    warnings.simplefilter("ignore")
    ways = itertools.product(("paper", "rich"), CURVES, range(count))
    found = [of_a_guide(*way) for way in ways]
    off = sum(far for stated, far in found if stated)
    print(
        f"structure stated in {sum(stated for stated, _ in found)} of {len(found)} sets of touches"
    )
    print(f"of these with a location error off by more than {FAR:g} u: {off}")
    waves = itertools.product(PLACES, (False, True), STEPS, WAVES_UM, (1, 2))
    good = [
        right(tn.diagnose(plate(seed, n, STEP_MM, size, steps * STEP_MM, meander=way)))
        for n, way, steps, size, seed in waves
    ]
    print(f"plates with a short wave that are right: {sum(good)} of {len(good)}")
    plain = itertools.product(PLACES[:2], (False, True), (1.0, 3.0), range(60))
    quiet = [
        tn.diagnose(
            plate(seed, n, STEP_MM, 0.0, STEP_MM, meander=way, noise_um=(x * NOISE_UM, NOISE_UM))
        )
        for n, way, x, seed in plain
    ]
    sound = sum(d.verdict == "consistent" for d in quiet)
    print(f"plates of noise alone that are consistent: {sound} of {len(quiet)}")


if __name__ == "__main__":
    main()
