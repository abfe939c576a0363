"""Measurements of every kind with causes drawn at random: which, how many, how large.

Data come from the independent generators of each kind. A case is made from its number alone. In
one of eight an error is hidden that is no cause of the catalogue.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import axis_log_twin
import ballbar_study
import levels_twin
import positioning_twin
import rotary_test_twin
import trunnion as tn
import turning_blind
from power.measured_twin import (
    POINT_EFFECTS,
    SPACE_EFFECTS,
    SWEEP_EFFECTS,
    make_points,
    make_sweep,
    size_of,
)
from power.study import ALIKE, draw_effects, draw_unknown, ground
from trunnion import contouring as ct
from trunnion.setup import Artefact, Setup
from twin.forward import Truth
from twin.generator import VISIBLE_UM, measure, random_errors, random_placement

Rng = np.random.Generator
Left = Callable[[NDArray[np.float64]], NDArray[np.float64]]
NOT_ALIKE_SHARE = 0.15  # of positioning runs, whose cycles are not alike
IN_CYCLES = {
    "scale_change": {"screw_warmup"},
    "zero_of_cycle": {"cycle_drift", "warmup"},
    "scale_of_cycle": {"cycle_drift", "warmup", "screw_warmup"},
}  # what is in these, too: of both together only one has a name
UNKNOWN_SHARE = 1 / 8
COUNTS = (0.25, 0.35, 0.25, 0.15)  # of no cause, one, two, three
BATCH = 20
LEFT = (5.0, 50.0)  # a cause alone is named from about 3.5 on
SMOOTH = 2.0  # times that: a smooth shape without a name, which has a dozen parameters
CHATTER = 1.8  # times that: two amplitudes a pass at any of 200 pitches, named from about 6 on
SAME = 0.999  # correlation of what two causes leave, above which they are one to these readings
ANY_UM = 1e-3  # of an effect of 1 µm, arcsec, ... is left: it is drawn, however large it must be
VISIBLE = 0.1  # of a cause is left at least, beside what is always fitted
SAME_OF_ONE_TARGET = {"tilt_1": "axial_2", "tilt_2": "axial_3"}
HYBRID = (*ballbar_study.HYBRID, *ballbar_study.HYBRID_DRIFTS)


@dataclass(frozen=True)
class Drawn:
    """A measurement with its set-up, and what is hidden in it."""

    data: Any
    setup: Any
    hidden: frozenset[str]
    unknown: bool


def _left(rng: Rng, count: int) -> list[float]:
    """Draw what each cause leaves in the readings: root of the sum of squares, in noises."""
    return [float(rng.choice([-1.0, 1.0])) * size_of(rng, *LEFT) for _ in range(count)]


def _some(rng: Rng, names: tuple[str, ...]) -> tuple[str, ...]:
    count = int(rng.choice(len(COUNTS), p=COUNTS))
    return tuple(map(str, rng.choice(names, min(count, len(names)), replace=False)))


def _differing(
    rng: Rng, made: Mapping[str, NDArray[np.float64]], left: Left, noise: float
) -> tuple[frozenset[str], NDArray[np.float64] | float]:
    """Scale what causes change in the readings, to leave so much as is drawn; names and sum.

    left: what is left of a change beside what is always fitted. One of which hardly anything is, or
    that is the same as another, is not taken.
    """
    kept: dict[str, NDArray[np.float64]] = {}
    change: NDArray[np.float64] | float = 0.0
    for (name, own), want in zip(made.items(), _left(rng, len(made)), strict=True):
        seen = left(own)
        long = float(np.linalg.norm(seen))
        if long < VISIBLE * np.linalg.norm(own):
            continue
        if all(abs(seen @ o) < SAME * long * np.linalg.norm(o) for o in kept.values()):
            kept[name] = seen
            more = SMOOTH if name == "field" else 1.0
            change = change + own * (more * want * noise / long)
    return frozenset(kept), change


def touches_of(
    rng: Rng, name: str, alike: float = ALIKE, least: float = VISIBLE_UM
) -> tuple[Drawn, Truth]:
    """Touches of a cross by a plan of `ground`, 0.1 to 2 µm of noise, and what is true.

    ``alike``: correlation of what two effects leave, from which on they are not drawn together;
    ``least``: what one of 1 µm, arcsec, ... leaves at least.
    """
    plan, setup, _, read = ground(name)
    noise = size_of(rng, 0.1, 2.0)
    rms = noise * (size_of(rng, 0.7, 7.0) if name == "paper" else size_of(rng, 0.3, 3.0))
    count = int(rng.choice(len(COUNTS), p=COUNTS))
    hidden = draw_effects(rng, name, count, rms, alike=alike, least=least) if count else {}
    unknown = bool(rng.random() < UNKNOWN_SHARE)
    extra = draw_unknown(rng, name, rms) if unknown else None
    truth = Truth(errors=random_errors(rng), placement=random_placement(rng), effects=hidden)
    seed = int(rng.integers(1 << 31))
    m = measure(plan, setup, truth, noise_um=noise, tick_um=0.1, unknown=extra, seed=seed)
    return Drawn(tn.Touches(m.columns), read, frozenset(hidden), unknown), truth


def touches(rng: Rng, number: int, least: float = VISIBLE_UM) -> Drawn:  # noqa: ARG001
    """Touches of a cross, the paper's plan or a rich one; ``least``: as of `touches_of`."""
    return touches_of(rng, str(rng.choice(["paper", "rich"])), SAME, least)[0]


def points(rng: Rng, number: int) -> Drawn:
    """Features in a plane or in space."""
    space = bool(rng.random() < 0.4)
    names = tuple(n for n in (SPACE_EFFECTS if space else POINT_EFFECTS) if n != "field")
    hidden = _some(rng, names)
    made = make_points(900_000 + number, hidden, space=space, left=_left(rng, len(hidden))).columns
    unknown = bool(rng.random() < UNKNOWN_SHARE)
    if unknown:  # one after the other is off, and back again
        n = len(made["x_mm"])
        wave = np.sin(2 * np.pi * rng.uniform(1.5, 4) * np.arange(n) / n + rng.uniform(0, 6.28))
        made["y_mm"] = made["y_mm"] + 2e-3 * size_of(rng, 0.5, 4.0) * wave
    return Drawn(tn.Points(**made), None, frozenset(hidden), unknown)


def sweep(rng: Rng, number: int) -> Drawn:
    """Three targets on a turning axis, or one, which sees no axial motion once a turn.

    One target does not tell a tilt from an axial motion: both are drawn as often, not together.
    """
    one = {"targets": 1, "step_deg": 5.0} if rng.random() < 0.4 else {}
    names = (*(n for n in SWEEP_EFFECTS if n != "axial_1"), "tilt_1") if one else SWEEP_EFFECTS
    hidden = _some(rng, names)
    hidden = tuple(n for n in hidden if not one or SAME_OF_ONE_TARGET.get(n) not in hidden)
    made = make_sweep(900_000 + number, hidden, size_of(rng, 0.7, 7.0), **one).columns  # type: ignore[arg-type]
    unknown = bool(rng.random() < UNKNOWN_SHARE)
    if unknown:  # a sharp dip at one position
        far = (made["angle_deg"] - made["angle_deg"].mean()) / rng.uniform(8, 15)
        made["z_mm"] = made["z_mm"] + 4e-3 * size_of(rng, 0.5, 4.0) * np.exp(-(far**2))
    return Drawn(tn.Sweep(**made), None, frozenset(hidden), unknown)


def diameters(rng: Rng, number: int) -> Drawn:
    """Two or three turned passes, some with one more on a warm tool."""
    hidden = _some(rng, tuple(turning_blind.LAWS))
    unknown = bool(rng.random() < UNKNOWN_SHARE)
    passes, warm = int(rng.integers(2, 4)), bool(rng.random() < 0.3)
    more = [CHATTER if name == "chatter" else 1.0 for name in (*hidden, *["unknown"] * unknown)]
    left = [k * abs(x) for k, x in zip(more, _left(rng, len(more)), strict=True)]
    data, setup = turning_blind.measured(
        900_000 + number, hidden, passes, warm=warm, left=left, unknown=unknown
    )
    return Drawn(data, setup, frozenset(hidden), unknown)


def ballbar(rng: Rng, number: int) -> Drawn:
    """Circle tests of a three-axis machine."""
    kinds = _some(rng, ballbar_study.CARTESIAN)
    unknown = bool(rng.random() < UNKNOWN_SHARE)
    drawn = [*kinds, "unknown"] if unknown else [*kinds]
    left = _left(rng, len(drawn))
    data, names = ballbar_study.cartesian_cases(drawn, 900_000 + number, left=left)
    return Drawn(data, None, frozenset(n for n in names if n), unknown)


def hybrid_ballbar(rng: Rng, number: int) -> Drawn:
    """Circle tests of a hybrid machine; nothing unknown."""
    hidden = _some(rng, HYBRID)
    usual = ballbar_study.hybrid_left(hidden, 900_000 + number)
    left = zip(hidden, _left(rng, len(hidden)), strict=True)
    shares = {name: abs(want) / usual[name] for name, want in left}
    data = ballbar_study.hybrid_cases(shares, 900_000 + number)
    return Drawn(data, None, frozenset(hidden), unknown=False)


def positioning(rng: Rng, number: int) -> Drawn:  # noqa: ARG001
    """Stops of an axis, 11 or 15 targets, 3 to 5 cycles; in some runs these are not alike."""
    alike = tuple(n for n in positioning_twin.HIDDEN if n not in {"unknown", *IN_CYCLES})
    hidden, apart = _some(rng, alike), ""
    if rng.random() < NOT_ALIKE_SHARE:
        apart = str(rng.choice([*IN_CYCLES]))
        hidden = tuple(n for n in hidden if n not in IN_CYCLES[apart])
    unknown = bool(rng.random() < UNKNOWN_SHARE)
    data = positioning_twin.axis(
        rng, targets=int(rng.choice([11, 15])), cycles=int(rng.integers(3, 6))
    )
    change = np.zeros(len(data))
    for name in [*hidden, "unknown"] if unknown else hidden:
        change += size_of(rng, 0.5, 3.0) * positioning_twin.HIDDEN[name](data, rng)
    if apart:
        hidden = (*hidden, apart)
        change += positioning_twin.HIDDEN[apart](data, rng)
    data = data.with_columns(measured_mm=data.measured + 1e-3 * change)
    return Drawn(data, None, frozenset(hidden), unknown)


def levels(rng: Rng, number: int) -> Drawn:  # noqa: ARG001
    """A line or a grid, read twice with the level turned in between."""
    way = levels_twin.drawn_way(rng)
    laws = levels_twin.ON_A_GRID if way.grid else levels_twin.ON_A_LINE
    noise = size_of(rng, 0.3, 3.0)
    made = {name: laws[name](way, rng) for name in _some(rng, tuple(laws))}
    hidden, change = _differing(rng, made, way.left, noise)
    read = way.sense[:, None] * rng.uniform(-60, 60, 2) + change
    unknown = bool(rng.random() < UNKNOWN_SHARE)
    if unknown:
        read = read + _differing(rng, {"": levels_twin.unknown(way, rng)}, way.left, noise)[1]
    return Drawn(way.data(read + noise * rng.standard_normal(read.shape)), None, hidden, unknown)


def rotarytest(rng: Rng, number: int) -> Drawn:  # noqa: ARG001
    """An R-test, or bars in five directions, about balls on a tilting rotary table."""
    test = rotary_test_twin.drawn_test(rng)
    noise = size_of(rng, 0.2, 2.0)
    names = _some(rng, tuple(rotary_test_twin.causes_of(test)))
    made = {name: rotary_test_twin.cause(test, name, rng) for name in names}
    hidden, change = _differing(rng, made, test.left, noise)
    unknown = bool(rng.random() < UNKNOWN_SHARE)
    if unknown:
        extra = {"": rotary_test_twin.unknown(test, rng)}
        change = change + _differing(rng, extra, test.left, noise)[1]
    read = test.readings(rotary_test_twin.Hidden(random_errors(rng), {})) + change
    data = test.data(read + noise * rng.standard_normal(read.shape))
    return Drawn(data, test.setup(), hidden, unknown)


@cache
def _commands() -> list[NDArray[np.float64]]:
    return [axis_log_twin.commanded(1000 / 60), axis_log_twin.commanded(3000 / 60)]


@dataclass(frozen=True)
class _OfLog:
    """One cause of a log: which, and the seed of its axis, sign and place."""

    kind: str
    seed: int

    def put(self, cases: axis_log_twin.Cases, i: int, share: float) -> str:
        """Put it into a case, of this share of its usual size; return its id."""
        name = axis_log_twin.put(cases, i, self.kind, np.random.default_rng(self.seed), share)
        return str(name)


def _causes_of_logs(rng: Rng, kinds: tuple[str, ...]) -> list[list[tuple[_OfLog, float]]]:
    """Causes of each log of a batch with their shares: none that looks like another of its log.

    Each is simulated alone at its usual size, to leave so much as is drawn at its share.
    """
    wanted = [_some(rng, kinds) for _ in range(BATCH)]
    drawn = [[_OfLog(k, int(rng.integers(1 << 31))) for k in kinds] for kinds in wanted]
    flat = [one for some in drawn for one in some]
    alone = axis_log_twin.Cases(len(flat) + 1)
    for i, one in enumerate(flat, start=1):
        one.put(alone, i, 1.0)
    made = axis_log_twin.left([axis_log_twin.actual(c, alone) for c in _commands()])
    own = dict(zip(flat, made[1:], strict=True))
    out = []
    for some in drawn:
        kept: list[tuple[_OfLog, float]] = []
        for one, want in zip(some, _left(rng, len(some)), strict=True):
            long = float(np.linalg.norm(own[one]))
            others = [own[k] for k, _ in kept]
            if all(abs(own[one] @ o) < ALIKE * long * np.linalg.norm(o) for o in others):
                kept.append((one, abs(want) / long))
        out.append(kept)
    return out


@lru_cache(maxsize=1)
def _logs(batch: int, kinds: tuple[str, ...]) -> list[Drawn]:
    """A batch of logs, simulated together."""
    rng = np.random.default_rng([900_000, batch])
    cases = axis_log_twin.Cases(BATCH)
    setup = Setup(artefact=Artefact("none"), servo=ct.Servo.paper().to_table())
    truth = [
        frozenset(one.put(cases, i, share) for one, share in some)
        for i, some in enumerate(_causes_of_logs(rng, kinds))
    ]
    actual = [axis_log_twin.actual(c, cases) for c in _commands()]
    out = []
    for i, hidden in enumerate(truth):
        own = [a[i].copy() for a in actual]
        unknown = bool(rng.random() < UNKNOWN_SHARE)
        if unknown:  # an axis that wanders slowly, as no cause does
            for a in own:
                t = np.linspace(0, 2 * np.pi * rng.uniform(1.5, 4), len(a))
                a[:, 0] += 1e-3 * size_of(rng, 0.2, 2.0) * np.sin(t)
        log = axis_log_twin.log(_commands(), own, rng)
        out.append(Drawn(log, setup, hidden, unknown))
    return out


def axislog(
    rng: Rng,  # noqa: ARG001
    number: int,
    kinds: tuple[str, ...] = axis_log_twin.KINDS[1:],
) -> Drawn:
    """Logs of five axes at two feeds; ``kinds``: of causes that are drawn."""
    return _logs(number // BATCH, kinds)[number % BATCH]


KINDS: Mapping[str, Callable[[Rng, int], Drawn]] = {
    "touches": touches,
    "points": points,
    "sweep": sweep,
    "diameters": diameters,
    "ballbar": ballbar,
    "hybrid ballbar": hybrid_ballbar,
    "positioning": positioning,
    "levels": levels,
    "rotarytest": rotarytest,
    "axislog": axislog,
}


EVERY: Mapping[str, Callable[[Rng, int], Drawn]] = {
    **KINDS,
    "touches": partial(touches, least=ANY_UM),
    "axislog": partial(axislog, kinds=axis_log_twin.EVERY),
}


def draw(kind: str, number: int, seed: int = 1, *, every: bool = False) -> Drawn:
    """Draw case ``number`` of a kind; ``every``: with any of the causes that read alike."""
    rng = np.random.default_rng([seed, number, *kind.encode()])
    return (EVERY if every else KINDS)[kind](rng, number + 1_000_000 * seed)
