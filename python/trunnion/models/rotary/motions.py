"""Error motions of a rotary axis that a diagnosis looks for, one entry each in `catalogue`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from trunnion.base.rotation import cosine_sine
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import ARCSEC, Floats
from trunnion.data.sweep import Sweep
from trunnion.data.times import elapsed_s
from trunnion.diagnosis.effect import Parameter, wave
from trunnion.machine.effects import Owner, senses

MOTIONS = ("EX", "EY", "EZ", "EA", "EB", "EC")  # µm, µm, µm, arcsec, arcsec, arcsec
MOTION_UNIT = np.array([1e-3, 1e-3, 1e-3, ARCSEC, ARCSEC, ARCSEC])  # to mm and rad
MAX_HARMONIC = 8
SAME_POSITION_DEG = 0.5
MAX_DEGREE = 4
MAX_PERIODS = 120  # evenly in frequency
MAX_TEETH = 360  # of a wheel, of which a period is sought
SAME_STEP = 0.2  # of the large steps, up to which positions are the same
PIVOTS = 25  # within the range of the targets' heights beyond them
FAR_PIVOTS = 6  # beyond these, on either side
MAX_PIVOT = 5.0  # times that range beyond the targets, that the pivot of a tilt may be
MIN_OF_A_SENSE = 3  # one row after a return shows nothing of reversal

_UNIT = ("um", "um", "um", "arcsec", "arcsec", "arcsec")
_KINDS = {"axial": (2,), "positioning": (5,), "radial": (0, 1), "tilt": (3, 4)}
_LABELS = {
    "radial": "radial error motion",
    "axial": "axial error motion",
    "tilt": "tilt error motion",
    "positioning": "positioning error",
}


@dataclass(frozen=True, eq=False)
class Conditions:
    """What error motions depend on: position, time or order, sense of turning. Shape (n,) each."""

    angle_deg: Floats
    elapsed: Floats
    sense: Floats
    instrument: Floats  # (3, 3): instrument axes in the frame of the axis, one a column
    timed: bool = False  # elapsed in hours; else the order, 0 to 1

    @classmethod
    def of(cls, data: Sweep, frame: Floats) -> Conditions:
        """Return those of a sweep; ``frame``: that of the axis, (3, 3)."""
        angle = np.asarray(data.angle_deg)
        if data.time_s is not None:
            elapsed = elapsed_s(data.time_s) / 3600.0
        else:
            elapsed = np.linspace(0.0, 1.0, len(angle))
        return cls(angle, elapsed, senses(angle), frame.T, data.time_s is not None)

    @property
    def in_turn(self) -> bool:
        """Whether positions were measured in their order: what is slow in them is slow in time."""
        steps = np.diff(self.angle_deg[np.argsort(self.elapsed, kind="stable")])
        return bool(np.all(steps >= -SAME_POSITION_DEG) or np.all(steps <= SAME_POSITION_DEG))

    @classmethod
    def at(cls, angle_deg: Floats) -> Conditions:
        """Return positions alone: no time passes, and nothing is reversed."""
        none = np.zeros(len(angle_deg))
        return cls(angle_deg, none, none, np.eye(3))


@dataclass(frozen=True)
class Motion:
    """A candidate error motion.

    ``columns(conditions, values)``: derivative of those of EX .. EC that it `acts` on (µm, arcsec)
    by each parameter, (n, acts, k). The motion is linear in the parameters that have no grid, and
    zero where those are.
    """

    parameters: tuple[Parameter, ...]
    acts: tuple[int, ...]
    columns: Callable[[Conditions, Floats], Floats]
    label: str
    owner: Owner = Owner.MACHINE
    slow: bool = False  # along the position

    def rates(self, conditions: Conditions, values: Mapping[str, float]) -> Floats:
        """Derivative of the motions it acts on, µm and arcsec, by each parameter (n, acts, k)."""
        return self.columns(conditions, np.array([values[p.name] for p in self.parameters]))

    def motion(self, conditions: Conditions, values: Mapping[str, float]) -> Floats:
        """Motion, mm and rad (n, 6)."""
        out = np.zeros((len(conditions.angle_deg), len(MOTIONS)))
        linear = np.array([p.linear for p in self.parameters])
        size = np.array([values[p.name] for p in self.parameters])[linear]
        if np.any(size):
            moved = self.rates(conditions, values)[:, :, linear] @ size
            out[:, self.acts] = moved * MOTION_UNIT[list(self.acts)]
        return out


def catalogue(
    conditions: Conditions, heights: Floats, asked: Sequence[Any] = ()
) -> dict[str, Motion]:
    """All candidates for these positions, and the harmonics that were asked for by name.

    Of causes that these targets do not distinguish the first is named: the simpler ones first.
    """
    positions = np.unique(np.round(conditions.angle_deg, 6))
    orders = harmonics(positions)
    out: dict[str, Motion] = {}
    for kind in _KINDS:
        for n in orders:
            out[f"{kind}_{n}"] = _harmonic(kind, n, heights)
    for name in asked:
        kind, _, number = name.rpartition("_") if isinstance(name, str) else ("", "", "")
        if kind in _KINDS and number.isdecimal() and int(number) > 0:
            out[str(name)] = _harmonic(kind, int(number), heights)
    out |= _trends(positions)
    scale = "scale of the positioning of the axis"
    out["positioning_scale"] = Motion((Parameter("ppm"),), (5,), _scale, scale)
    if grid := periods(positions):
        period = Parameter("period_deg", grid=grid, bounds=(grid[-1], grid[0] * 1.2))
        parameters = (Parameter("a_arcsec"), Parameter("b_arcsec"), period)
        out["positioning_cyclic"] = Motion(parameters, (5,), _cyclic, "cyclic positioning error")
    if min(np.sum(conditions.sense > 0), np.sum(conditions.sense < 0)) >= MIN_OF_A_SENSE:
        reversal = (Parameter("b_arcsec"),)
        out["backlash"] = Motion(reversal, (5,), _backlash, "backlash of the axis")
    rate = "um_h" if conditions.timed else "total_um"
    drifts = tuple(Parameter(f"d{a}_{rate}") for a in "xyz")
    out["drift"] = Motion(
        drifts, (0, 1, 2), _drift, "drift between instrument and axis", Owner.TIME
    )
    return out


# --- harmonics


def harmonics(positions: Floats) -> range:
    """Orders that three positions a period, or more, tell from lower ones, and always the first.

    A position a whole turn further is the same, and so is one nearer than `SAME_POSITION_DEG`: read
    from an encoder anew for each target, 8 positions are not 24.
    """
    turn = np.unique(positions % 360.0)
    last = max(int(np.searchsorted(turn, turn[0] + 360.0 - SAME_POSITION_DEG, "right")), 1)
    count, at = 0, 0
    while at < last:
        count += 1
        at = int(np.searchsorted(turn, turn[at] + SAME_POSITION_DEG))
    return range(1, min(MAX_HARMONIC, max(count // 3, 1)) + 1)


def _harmonic(kind: str, n: int, heights: Floats) -> Motion:
    """E = a cos nθ + b sin nθ for each motion of the kind; positioning a (cos nθ − 1) + b sin nθ.

    A tilt has a pivot on the axis: targets of different height distinguish it from radial motion.
    """
    motions = _KINDS[kind]
    unit = _UNIT[motions[0]]
    if len(motions) == 1:
        names = [f"a{n}_{unit}", f"b{n}_{unit}"]
    else:
        names = [f"{c}{a}_{unit}" for a in "xy" for c in "ab"]
    parameters = [Parameter(name) for name in names]
    low, high = float(heights.min()), float(heights.max())
    spread = high - low
    if kind == "tilt" and spread > 0:
        near = np.linspace(low - spread, high + spread, PIVOTS)
        far = spread * np.geomspace(1.0, MAX_PIVOT, FAR_PIVOTS + 1)[1:]
        grid = (*(low - far[::-1]).tolist(), *near.tolist(), *(high + far).tolist())
        bounds = (low - MAX_PIVOT * spread, high + MAX_PIVOT * spread)
        parameters.append(Parameter("pivot_mm", grid=grid, bounds=bounds, affine=True))
    often = {1: "once", 2: "twice"}.get(n, f"{n} times")
    pivoted = len(parameters) > len(names)
    return Motion(
        tuple(parameters),
        (0, 1, *motions) if pivoted else motions,
        partial(_pivoted if pivoted else _waves, motions, n),
        f"{_LABELS[kind]} of the axis, {often} a turn",
    )


def _waves(motions: tuple[int, ...], n: int, conditions: Conditions, _: Floats) -> Floats:
    turn = n * np.radians(conditions.angle_deg)
    cos, sin = cosine_sine(turn)
    if motions == (5,):
        cos = cos - 1.0
    out = _room(len(turn), len(motions), 2 * len(motions))
    for i in range(len(motions)):
        out[:, i, 2 * i], out[:, i, 2 * i + 1] = cos, sin
    return out


def _room(rows: int, acts: int, parameters: int) -> Floats:
    """Return zeros (rows, acts, parameters); each derivative of many rows in a row in memory."""
    if rows < MANY_ROWS:
        return np.zeros((rows, acts, parameters))
    return np.zeros((acts, parameters, rows)).transpose(2, 0, 1)


def _pivoted(motions: tuple[int, ...], n: int, conditions: Conditions, values: Floats) -> Floats:
    """EX, EY, EA, EB of a tilt about a point at height ``values[4]`` on the axis, and by it."""
    pivot = values[4]
    tilt = _waves(motions, n, conditions, values)
    out = _room(len(tilt), 4, 5)
    out[:, 2:, :4] = tilt
    # ω × (p − pivot z) = ω × p + pivot (−E_B, E_A, 0); arcsec and mm to µm
    lever = ARCSEC * 1e3
    out[:, 0, :4] = -lever * pivot * tilt[:, 1]
    out[:, 1, :4] = lever * pivot * tilt[:, 0]
    if len(tilt) >= MANY_ROWS and not np.any(values[:4]):
        return out
    total = tilt @ values[:4]
    out[:, 0, 4] = -lever * total[:, 1]
    out[:, 1, 4] = lever * total[:, 0]
    return out


# --- slow and other motions


def _trends(positions: Floats) -> dict[str, Motion]:
    """Slow error motions: polynomials over the range of positions."""
    travel = (float(positions[0] + positions[-1]) / 2, float(positions[-1] - positions[0]) / 2)
    degrees = range(1, min(MAX_DEGREE, len(positions) - 2) + 1)
    out = {}
    for kind, motions in _KINDS.items():
        # a shift of position is a shift of the zero; its slope has a name of its own
        mine = tuple(k for k in degrees if kind != "positioning" or k > 1)
        if mine:
            letters = [MOTIONS[m][1].lower() if len(motions) > 1 else "a" for m in motions]
            names = [
                f"{a}{k}_{_UNIT[m]}" for a, m in zip(letters, motions, strict=True) for k in mine
            ]
            out[f"{kind}_trend"] = Motion(
                tuple(Parameter(name) for name in names),
                motions,
                partial(_trend, motions, mine, travel),
                f"slow {_LABELS[kind]} of the axis",
                slow=True,
            )
    return out


def _trend(
    motions: tuple[int, ...],
    degrees: tuple[int, ...],
    travel: tuple[float, float],
    conditions: Conditions,
    _: Floats,
) -> Floats:
    """Legendre polynomials of the position, −1 to 1 over the range measured."""
    u = (conditions.angle_deg - travel[0]) / max(travel[1], 1e-9)
    p = np.polynomial.legendre.legvander(u, max(degrees))[:, list(degrees)]
    out = np.zeros((len(u), len(motions), len(motions) * len(degrees)))
    for i in range(len(motions)):
        out[:, i, i * len(degrees) : (i + 1) * len(degrees)] = p
    return out


def _scale(conditions: Conditions, _: Floats) -> Floats:
    return np.asarray(np.radians(conditions.angle_deg)[:, None, None] * 1e-6 / ARCSEC)


def _cyclic(conditions: Conditions, values: Floats) -> Floats:
    a, b, period = values
    return wave(conditions.angle_deg, period, a, b)[:, None, :]


def _backlash(conditions: Conditions, _: Floats) -> Floats:
    return np.asarray(-conditions.sense[:, None, None] / 2)


def _drift(conditions: Conditions, _: Floats) -> Floats:
    """Shift of the targets along the instrument's axes, in the frame of the axis."""
    return np.asarray(conditions.elapsed[:, None, None] * conditions.instrument)


def periods(positions: Floats, *, closed: bool = False) -> tuple[float, ...]:
    """Periods to try, deg, longest first: a third of the range to two steps.

    closed: Whether positions all around, with a step from the last to the first, are of a range of
    one turn: three periods a turn are tried, then, as no harmonics are.

    The longest evenly in frequency; shorter ones are whole parts of a turn, as of the teeth of a
    wheel. A period below two steps of an even sweep looks like a longer one, and is named as that.
    """
    if len(positions) < 8:
        return ()
    span = float(positions[-1] - positions[0])
    between = _step(positions)
    if closed and span < 360.0 <= span + between + SAME_POSITION_DEG:
        span = 360.0
    shortest = 2.0 * between
    step = 1.0 / (4.0 * span)
    count = int((1.0 / shortest - 3.0 / span) / step) + 1
    if count < 2:
        return ()
    rates = 3.0 / span + step * np.arange(min(count, MAX_PERIODS))
    first, last = (int(np.floor(360.0 * rate)) for rate in (rates[-1], 1.0 / shortest))
    teeth = np.arange(first + 1, min(last, MAX_TEETH) + 1)
    return tuple((1.0 / np.concatenate([rates, teeth / 360.0])).tolist())


def _step(positions: Floats) -> float:
    """Usual step of positions; those that differ by a part of it are one, read anew."""
    steps = np.diff(positions)
    apart = steps > SAME_STEP * np.quantile(steps, 0.9)
    return float(positions[-1] - positions[0]) / max(int(apart.sum()), 1)
