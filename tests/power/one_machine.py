"""Several measurements of one machine, drawn at random: what they share acts in all of them.

None to three causes that kinds share (scale, squareness, backlash); of each kind none or one of its
own (of diameters, logs and sweeps up to three), the same on every date of it, and none that another
kind would see: their measurements would contradict each other. Placements and noise are each
measurement's own. In one of eight measurements an error is hidden that is no cause of the
catalogue.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ballbar_study
import positioning_twin
import trunnion as tn
from power.further import moved
from power.measured_twin import POINT_EFFECTS, SWEEP_EFFECTS, make_points, make_sweep, size_of
from power.random_cases import COUNTS, HYBRID, LEFT, UNKNOWN_SHARE, axislog, diameters
from power.study import draw_effects, draw_unknown, ground, visible
from twin.forward import Truth
from twin.generator import measure, random_errors, random_placement

Rng = np.random.Generator
Floats = NDArray[np.float64]
Effects = dict[str, dict[str, float]]

SHARED = {"scale": ("ppm", 10.0), "squareness": ("arcsec", 2.0), "backlash": ("b_um", 1.0)}
"""What kinds share: the parameter, and how much of it makes about 1 µm in 100 mm."""
SHARED_UM = (1.0, 8.0)
SEEN_BY = {  # axes of which a kind sees each of them
    "touches": {"scale": "xyz", "squareness": "xyz", "backlash": "xyz"},
    "points": {"scale": "xy", "squareness": "xy"},
    "ballbar": {"scale": "xy", "squareness": "xy", "backlash": "xy"},
    "positioning": {"scale": "x", "backlash": "x"},
}
TWO_OF = {"xyz": ("xy", "xz", "yz"), "xy": ("xy",)}
OWN_SHARE = 0.5
BAR_NOISE_UM, HYBRID_NOISE_UM = 0.3, 0.5
NEARLY_NONE_UM = 1e-6
NO_SHARES: Mapping[str, float] = {}
TOGETHER: tuple[tuple[str, ...], ...] = (
    ("touches", "touches"),
    ("touches", "points"),
    ("touches", "sweep"),
    ("touches", "ballbar"),
    ("touches", "positioning", "positioning"),
    ("touches", "axislog"),
    ("touches", "ballbar", "positioning", "positioning"),
    ("touches", "points", "sweep"),
    ("points", "points"),
    ("points", "ballbar"),
    ("points", "diameters"),
    ("sweep", "sweep"),
    ("sweep", "positioning"),
    ("diameters", "positioning"),
    ("ballbar", "ballbar"),
    ("ballbar", "positioning", "positioning"),
    ("hybrid ballbar", "hybrid ballbar"),
    ("hybrid ballbar", "positioning"),
    ("positioning", "positioning"),
    ("positioning", "axislog"),
)
"""Kinds of measurements that are made of one machine."""
BALLBAR_OWN = tuple(
    name for name in ballbar_study.CARTESIAN if name not in {"scale", "squareness", "backlash"}
)
POSITIONING_OWN = ("cycle_drift", "curve", "drift", "warmup", "periodic", "reversal_of_position")


@dataclass(frozen=True)
class Made:
    """One measurement: what was read, its set-up, its kind's own causes, and if it hides more."""

    data: Any
    setup: Any = None
    own: frozenset[str] = frozenset()
    unknown: bool = False


@dataclass(frozen=True)
class Together:
    """Measurements of one machine, the set-up of all, and what is hidden in them.

    shared: causes that kinds share. own: of each kind its own. unknown: whether one of them hides
    an error that is no cause.
    """

    data: list[Any]
    setup: Any
    shared: frozenset[str]
    own: dict[str, frozenset[str]]
    unknown: bool


@dataclass(frozen=True)
class Machine:
    """What is true of a machine, and the seed of what is a kind's own; ``bare``: without that
    in kinds that share causes."""

    errors: dict[str, float]
    shared: Effects
    seed: int
    bare: bool = False

    def own(self, kind: str) -> Rng:
        """Generator of what each date of a kind has in common."""
        return np.random.default_rng([self.seed, *kind.encode()])


def drawn(
    kinds: Sequence[str],
    number: int,
    seed: int,
    shares: Mapping[str, float] = NO_SHARES,
    *,
    own: bool = True,
) -> Together:
    """Draw a machine and measure it by each kind, several of a kind one after the other.

    ``shares``: of what is drawn of a cause that kinds share; 0 leaves it out. ``own``: whether
    causes of the kinds' own act in those that share some.
    """
    rng = np.random.default_rng([seed, number, *",".join(kinds).encode()])
    errors, drawn_of_all = random_errors(rng), _shared(rng, kinds)
    shared = {
        name: {unit: shares.get(name, 1.0) * value for unit, value in values.items()}
        for name, values in drawn_of_all.items()
        if shares.get(name, 1.0)
    }
    machine = Machine(errors, shared, int(rng.integers(1 << 31)), bare=not own)
    made = {k: MEASURED[k](machine, rng, kinds.count(k)) for k in dict.fromkeys(kinds)}
    left = {kind: iter(dates) for kind, dates in made.items()}
    some = [next(left[kind]) for kind in kinds]
    setup: Any = next((one.setup for one in some if one.setup is not None), None)
    if "axislog" in kinds:
        setup = replace(setup, servo=made["axislog"][0].setup.servo)
    return Together(
        [one.data for one in some],
        setup,
        frozenset(machine.shared),
        {kind: dates[0].own for kind, dates in made.items()},
        any(one.unknown for one in some),
    )


def _shared(rng: Rng, kinds: Sequence[str]) -> Effects:
    """Draw causes that some kinds share."""
    names: set[str] = set()
    for what, axes in (one for kind in kinds for one in SEEN_BY.get(kind, {}).items()):
        of = TWO_OF[axes] if what == "squareness" else tuple(axes)
        names |= {f"{what}_{one}" for one in of}
    if "axislog" in kinds:  # logs come from a servo without it
        names = {name for name in names if not name.startswith("backlash")}
    count = min(int(rng.choice(len(COUNTS), p=COUNTS)), len(names))
    out: Effects = {}
    for name in rng.choice(sorted(names), count, replace=False) if count else ():
        unit, factor = SHARED[str(name).partition("_")[0]]
        value = float(rng.choice([-1.0, 1.0])) * size_of(rng, *SHARED_UM) * factor
        out[str(name)] = {unit: value}
    return out


def _one(rng: Rng, names: Sequence[str]) -> tuple[str, ...]:
    return (str(rng.choice(names)),) if rng.random() < OWN_SHARE else ()


def _hides(rng: Rng) -> bool:
    return bool(rng.random() < UNKNOWN_SHARE)


def _touches(machine: Machine, rng: Rng, count: int) -> list[Made]:
    own = machine.own("touches")
    name = str(own.choice(["paper", "rich"]))
    plan, setup, _, read = ground(name)
    noise = size_of(own, 0.1, 2.0)
    rms = noise * (size_of(own, 0.7, 7.0) if name == "paper" else size_of(own, 0.3, 3.0))
    names = [effect for effect in visible(name) if not effect.startswith(tuple(SHARED))]
    hidden = () if machine.bare else _one(own, names)
    effects = draw_effects(own, name, 1, rms, hidden) if hidden else {}
    out = []
    for _ in range(count):
        unknown = _hides(rng)
        extra = draw_unknown(rng, name, rms) if unknown else None
        truth = Truth(
            errors=machine.errors,
            placement=random_placement(rng),
            effects={**effects, **machine.shared},
        )
        made = measure(
            plan,
            setup,
            truth,
            noise_um=noise,
            tick_um=0.1,
            unknown=extra,
            seed=int(rng.integers(1 << 31)),
        )
        out.append(Made(tn.Touches(made.columns), read, frozenset(effects), unknown))
    return out


def _points(machine: Machine, rng: Rng, count: int) -> list[Made]:
    own = machine.own("points")
    shared = ("scale", "squareness", "field")
    names = [name for name in POINT_EFFECTS if not name.startswith(shared)]
    hidden = _one(own, names)
    left = [size_of(own, *LEFT) for _ in hidden]
    hidden, left = ((), []) if machine.bare else (hidden, left)
    made = make_points(int(own.integers(1 << 31)), hidden, groups=count, left=left).columns
    per_date = len(made["x_mm"]) // count
    out = []
    for date in range(count):
        some = slice(date * per_date, (date + 1) * per_date)
        columns = {k: np.array(v[some]) for k, v in made.items() if k != "group"}
        place = np.column_stack(
            [columns["nominal_x_mm"], columns["nominal_y_mm"], 0 * columns["x_mm"]]
        )
        off = moved(place, np.zeros_like(place), machine.shared)
        unknown = _hides(rng)
        if unknown:  # one after the other is off, and back again
            turns = rng.uniform(1.5, 4) * np.arange(per_date) / per_date
            wave = np.sin(2 * np.pi * turns + rng.uniform(0, 6.28))
            off[:, 1] += 2e-3 * size_of(rng, 0.5, 4.0) * wave
        columns |= {f"{a}_mm": columns[f"{a}_mm"] + off[:, i] for i, a in enumerate("xy")}
        out.append(Made(tn.Points(**columns), None, frozenset(hidden), unknown))
    return out


def _sweep(machine: Machine, rng: Rng, count: int) -> list[Made]:
    """Three targets each."""
    own = machine.own("sweep")
    hidden = tuple(
        map(str, own.choice(SWEEP_EFFECTS, int(own.choice(len(COUNTS), p=COUNTS)), replace=False))
    )
    seed, large = int(own.integers(1 << 31)), size_of(own, 0.7, 7.0) / NEARLY_NONE_UM
    made = make_sweep(seed, hidden, large, noise_um=NEARLY_NONE_UM).columns
    out = []
    for _ in range(count):
        columns = dict(made)
        for a in "xyz":
            columns[f"{a}_mm"] = made[f"{a}_mm"] + 1e-3 * rng.standard_normal(len(made["x_mm"]))
        unknown = _hides(rng)
        if unknown:  # a sharp dip at one position
            far = (columns["angle_deg"] - columns["angle_deg"].mean()) / rng.uniform(8, 15)
            columns["z_mm"] = columns["z_mm"] + 4e-3 * size_of(rng, 0.5, 4.0) * np.exp(-(far**2))
        out.append(Made(tn.Sweep(**columns), None, frozenset(hidden), unknown))
    return out


def _diameters(machine: Machine, _rng: Rng, _count: int) -> list[Made]:
    """One measurement, which shares no cause."""
    own = machine.own("diameters")
    one = diameters(own, int(own.integers(1 << 31)))
    return [Made(one.data, one.setup, one.hidden, one.unknown)]


def _bars(exact: Any, rng: Rng, noise_um: float, more: Floats | float = 0.0) -> Any:
    """Read the lengths of a recording without noise, and ``more``, mm."""
    lengths = np.asarray(exact["length_mm"]) + more
    return exact.with_columns(
        length_mm=lengths + 1e-3 * noise_um * rng.standard_normal(len(lengths))
    )


def _ballbar(machine: Machine, rng: Rng, count: int) -> list[Made]:
    own = machine.own("ballbar")
    hidden, seed = _one(own, BALLBAR_OWN), int(own.integers(1 << 31))
    left = [size_of(own, *LEFT) * BAR_NOISE_UM / NEARLY_NONE_UM for _ in hidden]
    hidden, left = ((), []) if machine.bare else (hidden, left)
    out = []
    for _ in range(count):
        odd = [size_of(rng, *LEFT) * BAR_NOISE_UM / NEARLY_NONE_UM] if _hides(rng) else []
        kinds = [*hidden, *(["unknown"] if odd else [])]
        exact, names = ballbar_study.cartesian_cases(
            kinds, seed, sigma_um=NEARLY_NONE_UM, left=[*left, *odd]
        )
        read = _bars(exact, rng, BAR_NOISE_UM, _along_bar(exact, machine.shared))
        out.append(Made(read, None, frozenset(filter(None, names)), bool(odd)))
    return out


def _along_bar(data: Any, shared: Effects) -> Floats:
    """What the machine's errors change in the lengths of a recording, mm."""
    x, y = np.asarray(data["x_mm"]), np.asarray(data["y_mm"])
    place = np.column_stack([x, y, np.asarray(data["z_mm"]) if "z_mm" in data.columns else 0 * x])
    fitted = np.column_stack([place, np.ones(len(x))])
    centre = np.linalg.lstsq(fitted, np.sum(place**2, axis=1), rcond=None)[0][:3] / 2
    centre = np.where(np.ptp(place, axis=0) > 0, centre, place[0])
    sense, begins = np.asarray(data["sense"]), np.asarray(data["time_s"])
    late = np.flatnonzero(
        (np.diff(sense) != 0) | (np.diff(begins) > 10 * np.median(np.diff(begins)))
    )
    step = np.zeros_like(place)
    for run in np.split(np.arange(len(x)), late + 1):
        step[run] = np.sign(np.round(np.gradient(place[run], axis=0), 9))
    ways = (place - centre) / np.linalg.norm(place - centre, axis=1)[:, None]
    return np.asarray(np.sum(ways * moved(place, step, shared), axis=1))


def _hybrid(machine: Machine, rng: Rng, count: int) -> list[Made]:
    own = machine.own("hybrid ballbar")
    hidden = tuple(
        map(str, own.choice(HYBRID, int(own.choice(len(COUNTS), p=COUNTS)), replace=False))
    )
    seed = int(own.integers(1 << 31))
    usual = ballbar_study.hybrid_left(hidden, seed)
    shares = {name: size_of(own, *LEFT) / usual[name] for name in hidden}
    exact = ballbar_study.hybrid_cases(shares, seed, sigma_um=0.0)
    return [Made(_bars(exact, rng, HYBRID_NOISE_UM), None, frozenset(hidden)) for _ in range(count)]


def _positioning(machine: Machine, rng: Rng, count: int) -> list[Made]:
    """Stops of X."""
    own = machine.own("positioning")
    hidden, seed, large = (
        _one(own, POSITIONING_OWN),
        int(own.integers(1 << 31)),
        size_of(own, 0.5, 3.0),
    )
    hidden = () if machine.bare else hidden
    out = []
    for _ in range(count):
        data = positioning_twin.axis(
            rng, targets=int(rng.choice([11, 15])), cycles=int(rng.integers(3, 6))
        )
        place, sense = np.zeros((2, len(data), 3))
        place[:, 0], sense[:, 0] = data.target, data.direction
        off = 1e3 * moved(place, sense, machine.shared)[:, 0]
        for name in hidden:
            off += large * positioning_twin.HIDDEN[name](data, np.random.default_rng(seed))
        unknown = _hides(rng)
        if unknown:
            off += size_of(rng, 0.5, 3.0) * positioning_twin.HIDDEN["unknown"](data, rng)
        measured = data.measured + 1e-3 * off
        read = data.with_columns(measured_mm=measured, axis=["X"] * len(data))
        out.append(Made(read, None, frozenset(hidden), unknown))
    return out


def _axislog(machine: Machine, rng: Rng, _count: int) -> list[Made]:
    """One log of a servo without backlash, which other measurements would see."""
    logs = (axislog(rng, number) for number in itertools.count(machine.seed % 1_000_000))
    one = next(log for log in logs if not any(id_.startswith("backlash") for id_ in log.hidden))
    return [Made(one.data, one.setup, one.hidden, one.unknown)]


MEASURED = {
    "touches": _touches,
    "points": _points,
    "sweep": _sweep,
    "diameters": _diameters,
    "ballbar": _ballbar,
    "hybrid ballbar": _hybrid,
    "positioning": _positioning,
    "axislog": _axislog,
}
