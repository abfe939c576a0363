"""Axis logs with a hidden effect, made without the project's core: plain numpy, small steps.

The path is eq. (8) of Byun and Jee 2010 on the rotary axes. Servo: K/(s (tau s + 1)) under a
zero-order hold of 1 ms, advanced in sub-steps; all five axes and all cases of a batch at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

import trunnion as tn

Array = NDArray[np.float64]

AXES = "XYZAC"
PERIOD = 1e-3
SUBSTEPS = 4
GAIN = np.array([81.28, 80.544, 81.184, 81.957, 81.8201])
TAU = np.array([5.76, 5.77, 5.50, 5.85, 5.75]) * 1e-3
# µm and arcsec in the axes' units, mm and deg
SMALL = np.array([1e-3, 1e-3, 1e-3, 1 / 3600, 1 / 3600])


def commanded(feed_mm_s: float, accelerate_s: float = 0.15) -> Array:
    """Axis positions X, Y, Z (mm), A, C (deg) of eq. (8) at constant feed, (n, 5)."""
    u = np.linspace(0.0, 1.0, 200_001)
    d = np.stack([15 + 0 * u, 240 * u**2 - 80, -38.4 * u**5 + 51.2 * u**3 - 42.8 * u], axis=1)
    speed = np.linalg.norm(d, axis=1)
    s = np.r_[0.0, np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(u))]
    end = s[-1] / feed_mm_s + accelerate_s / 2
    t = np.arange(0.0, end, PERIOD)
    ramp = feed_mm_s * t**2 / (2 * accelerate_s)
    distance = np.where(t < accelerate_s, ramp, feed_mm_s * (t - accelerate_s / 2))
    at = np.interp(distance, s, u)
    x, y = 15 * at, 80 * at**3 - 80 * at
    z = -6.4 * at**6 + 12.8 * at**4 - 21.4 * at**2 + 15
    ox, oy = 2 * at, 0.16 * (at**3 - at)
    a = np.arctan2(np.hypot(ox, oy), 1.0)
    c = np.where(at > 0, np.arctan2(ox, oy), np.arctan2(2.0, -0.16))
    along, across = np.cos(c) * x - np.sin(c) * y, np.sin(c) * x + np.cos(c) * y
    return np.stack(
        [
            along,
            np.cos(a) * across - np.sin(a) * z,
            np.sin(a) * across + np.cos(a) * z,
            np.rad2deg(a),
            np.rad2deg(c),
        ],
        axis=1,
    )


@dataclass
class Cases:
    """Parameters of m cases, each of shape (m, 5) or (m,) for the log's delay."""

    m: int
    gain: Array = field(init=False)
    tau: Array = field(init=False)
    delay: Array = field(init=False)  # s, of the command
    friction: Array = field(init=False)  # mm, deg of position error
    backlash: Array = field(init=False)
    cyclic: Array = field(init=False)
    pitch: Array = field(init=False)
    phase: Array = field(init=False)
    frequency: Array = field(init=False)  # Hz, 0 = stiff
    damping: Array = field(init=False)
    log_delay: Array = field(init=False)  # s
    offset: Array = field(init=False)  # mm, deg: where a constant force holds the axis

    def __post_init__(self) -> None:
        shape = (self.m, 5)
        self.gain, self.tau = np.tile(GAIN, (self.m, 1)), np.tile(TAU, (self.m, 1))
        for name in ("delay", "friction", "backlash", "cyclic", "phase", "frequency", "offset"):
            setattr(self, name, np.zeros(shape))
        self.pitch, self.damping = np.ones(shape), np.full(shape, 0.05)
        self.log_delay = np.zeros(self.m)


def actual(
    command: Array, cases: Cases, substeps: int = SUBSTEPS, feedback: str = "motor"
) -> Array:
    """Actual positions of every case, (m, n, 5), without noise.

    ``feedback``: the loop is closed on the "motor" or on the "load", which is what is recorded.
    """
    n, m = len(command), cases.m
    dt = PERIOD / substeps
    y, v = command[0] + cases.offset, np.zeros((m, 5))
    play = y.copy()
    # Axes with friction, with a structure that resonates, with a delay: the others need no more.
    rubs, swings, lags = (np.nonzero(x) for x in (cases.friction, cases.frequency, cases.delay))
    level = (cases.friction * cases.gain)[rubs]
    load = Structure(cases, swings, y[swings])
    late = Delay(cases.delay[lags], dt)
    held = np.exp(-dt / cases.tau)
    out = np.empty((n, m, 5))
    for k in range(n):
        at = y.copy()
        at[swings] = load.q
        play = np.clip(play, at - cases.backlash / 2, at + cases.backlash / 2)
        out[k] = play + cases.cyclic * np.sin(2 * np.pi * y / cases.pitch + cases.phase)
        now = cases.gain * (command[k] + cases.offset - (out[k] if feedback == "load" else y))
        for _ in range(substeps):
            w = now.copy()
            w[lags] = late(now[lags])
            y_new, v_new = _moved(y, v, w, cases.tau, dt, held)
            y_new[rubs], v_new[rubs] = _rubbed(
                y[rubs], v[rubs], w[rubs], level, cases.tau[rubs], dt
            )
            load.follow(y[swings], y_new[swings], dt)
            y, v = y_new, v_new
    logged = out.transpose(1, 0, 2)
    t = np.arange(n) * PERIOD
    for i in np.flatnonzero(cases.log_delay).tolist():
        earlier = np.maximum(t - cases.log_delay[i], 0.0)
        logged[i] = CubicSpline(t, logged[i])(earlier)
    return logged


def _moved(
    y: Array, v: Array, w: Array, tau: Array, dt: Array | float, e: Array | None = None
) -> tuple[Array, Array]:
    """Position and speed after a time dt of a constant speed command w; ``e``: exp(-dt / tau)."""
    e = np.exp(-dt / tau) if e is None else e
    return y + tau * (1 - e) * (v - w) + w * dt, e * v + (1 - e) * w


def _rubbed(
    y: Array, v: Array, w: Array, level: Array, tau: Array, dt: float
) -> tuple[Array, Array]:
    """The same with friction, which takes a level of the command and stops the axis when it turns.

    The axis stops within dt at the instant at which its speed is zero. From there on it stands if
    the command is below the level, or moves the other way.
    """
    driven = np.where(np.abs(w) > level, w - np.sign(w) * level, 0.0)  # from rest
    slowed = np.where(v != 0, w - np.sign(v) * level, driven)
    turns = v * slowed < 0
    stop = tau * np.log1p(np.where(turns, -v, 0.0) / np.where(turns, slowed, 1.0))
    until = np.where(turns & (stop < dt), stop, dt)
    y, reached = _moved(y, v, slowed, tau, until)
    return _moved(y, np.where(until < dt, 0.0, reached), driven, tau, dt - until)


class Structure:
    """Loads on springs, which follow their motors: position q and speed of each, (k,)."""

    def __init__(self, cases: Cases, some: tuple[NDArray[np.intp], ...], start: Array) -> None:
        self.q, self.speed = start.copy(), np.zeros_like(start)
        self.omega = 2 * np.pi * cases.frequency[some]
        self.drag = 2 * cases.damping[some] * self.omega

    def follow(self, before: Array, after: Array, dt: float) -> None:
        """Advance by a sub-step in which the motors move at constant speed: leapfrog, dt / 8."""
        if not len(self.q):
            return
        h = dt / 8
        for i in range(8):
            motor = before + (after - before) * (i + 0.5) / 8
            pull = self.omega**2 * (motor - (self.q + h / 2 * self.speed))
            middle = self.speed + h / 2 * (pull - self.drag * self.speed)
            acceleration = pull - self.drag * middle
            self.q = self.q + h * (self.speed + h / 2 * acceleration)
            self.speed = self.speed + h * acceleration


class Delay:
    """Commands of some while ago, a sub-step at a time; 0 before the first."""

    def __init__(self, delay: Array, dt: float) -> None:
        self.late = np.floor(delay / dt + 1e-9).astype(int)
        self.part = np.clip(delay / dt - self.late, 0.0, 1.0)  # of a sub-step
        self.last = np.zeros((int(self.late.max(initial=0)) + 2, len(delay)))  # newest first
        self.each = np.arange(len(delay))

    def __call__(self, now: Array) -> Array:
        """Take what is commanded now; return what arrives in this sub-step, its mean."""
        if not len(now):
            return now
        self.last = np.concatenate([now[None], self.last[:-1]])
        one, other = self.last[self.late, self.each], self.last[self.late + 1, self.each]
        return np.asarray((1 - self.part) * one + self.part * other)


KINDS = (
    "none",
    "gain",
    "time_constant",
    "loop_delay",
    "friction",
    "backlash",
    "cyclic",
    "resonance",
    "log_delay",
)
EVERY = (*KINDS[1:], "offset")  # of which an axis that moves one way reads some alike


def draw(
    m: int, rng: np.random.Generator, kinds: Sequence[str] = KINDS
) -> tuple[Cases, list[str | None]]:
    """Draw m cases, one hidden effect each, the kinds in turn: sizes of a real machine's servo.

    Gain 0.5 to 3 %, time constant 5 to 20 %, delays 0.25 to 1.5 ms (loop) and 0.2 to 2 ms (log),
    friction 1 to 5 µm, backlash 1 to 8 µm, cyclic error 0.5 to 3 µm (rotary axes: twice the number
    in arcsec), resonance 25 to 60 Hz.
    """
    cases = Cases(m)
    return cases, [put(cases, i, kinds[i % len(kinds)], rng) for i in range(m)]


def draw_together(
    m: int, rng: np.random.Generator, kinds: Sequence[str]
) -> tuple[Cases, list[list[str | None]]]:
    """Draw m cases with effects of several kinds on one axis each."""
    cases = Cases(m)
    axes = rng.integers(5, size=m).tolist()
    return cases, [[put(cases, i, kind, rng, axis=j) for kind in kinds] for i, j in enumerate(axes)]


def put(
    cases: Cases,
    i: int,
    kind: str,
    rng: np.random.Generator,
    share: float = 1.0,
    axis: int | None = None,
) -> str | None:
    """Put an effect on an axis, or on one drawn, into case i; return its id.

    ``share``: of its usual size.
    """
    j = int(rng.integers(5)) if axis is None else axis
    sign = rng.choice([-1, 1])
    small = SMALL[j] * (2 if j >= 3 else 1)
    match kind:
        case "none":
            return None
        case "log_delay":
            cases.log_delay[i] = share * rng.uniform(0.2, 2.0) * 1e-3
            return kind
        case "gain":
            cases.gain[i, j] *= 1 + share * sign * rng.uniform(0.005, 0.03)
        case "time_constant":
            cases.tau[i, j] *= 1 + share * sign * rng.uniform(0.05, 0.2)
        case "loop_delay":
            cases.delay[i, j] = share * rng.uniform(0.25, 1.5) * 1e-3
        case "friction":
            cases.friction[i, j] = share * rng.uniform(1, 5) * small
        case "backlash":
            cases.backlash[i, j] = share * rng.uniform(1, 8) * small
        case "offset":
            cases.offset[i, j] = share * sign * rng.uniform(1, 5) * small
        case "cyclic":
            cases.cyclic[i, j] = share * rng.uniform(0.5, 3) * small
            cases.pitch[i, j] = rng.uniform(4, 20) if j < 3 else rng.uniform(1, 10)
            cases.phase[i, j] = rng.uniform(0, 2 * np.pi)
        case "resonance":
            cases.frequency[i, j] = rng.uniform(25, 60)
            cases.damping[i, j] = rng.uniform(0.02, 0.1)
    return f"{kind}_{AXES[j].lower()}"


def left(actuals: Sequence[Array], *, noise_um: float = 0.2, noise_arcsec: float = 1.0) -> Array:
    """What of each case's motion a sound machine does not make, in noises of a log, (m, k).

    The first case is the sound machine.
    """
    sigma = _noise(noise_um, noise_arcsec)
    off = np.concatenate([(a - a[0]) / sigma for a in actuals], axis=1)
    return np.asarray(off.reshape(len(off), -1))


def _noise(um: float, arcsec: float) -> Array:
    """Noise of each axis in its unit, mm or deg, (5,)."""
    return np.array([um * 1e-3] * 3 + [arcsec / 3600] * 2)


def log(
    commands: Sequence[Array],
    actuals: Sequence[Array],
    rng: np.random.Generator,
    *,
    noise_um: float = 0.2,
    noise_arcsec: float = 1.0,
    memory: float = 0.0,
) -> tn.AxisLog:
    """Axis log of several runs with normal noise; ``memory``: its correlation from row to row."""
    sigma = _noise(noise_um, noise_arcsec)
    columns: dict[str, Array] = {
        "time_s": np.concatenate([np.arange(len(c)) * PERIOD for c in commands]),
        "run": np.concatenate([np.full(len(c), i) for i, c in enumerate(commands)]),
    }
    noisy = []
    for a in actuals:
        white = rng.standard_normal(a.shape)
        if memory:
            white = lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], white, axis=0)
        noisy.append(a + white * sigma)
    for i, (axis, unit) in enumerate(zip("xyzac", ("mm",) * 3 + ("deg",) * 2, strict=True)):
        columns[f"{axis}_cmd_{unit}"] = np.concatenate([c[:, i] for c in commands])
        columns[f"{axis}_act_{unit}"] = np.concatenate([a[:, i] for a in noisy])
    return tn.AxisLog(**columns)
