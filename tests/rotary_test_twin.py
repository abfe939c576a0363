"""R-tests and ball-bar tests of rotary axes on the twin's machine: ball less tool, and lengths.

The tool follows a ball on the table to where it nominally is, while A and C turn. Effects of the
machine are the twin's; cyclic errors and warm-ups along X and Y are written out here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import trunnion as tn
from twin import forward

Floats = forward.Floats
Rng = np.random.Generator
SETUP = tn.Setup(artefact=tn.Artefact("none"))
BARS = 100.0 * np.array([*np.eye(3), [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
SECONDS = 3.0  # between rows
PAUSE_S, PAUSED = 3600.0, 0.3  # of so many drawn tests
STEP = 1.0  # µm, arcsec: of differences by what is always fitted


def sense(values: Floats) -> Floats:
    """Sense of the last move before each row, 0 before the first."""
    found, last = np.zeros(len(values)), 0.0
    for row in range(1, len(values)):
        last = np.sign(values[row] - values[row - 1]) or last
        found[row] = last
    return found


def conditions(a: Floats, c: Floats, tool_mm: Floats, time: Floats) -> forward.Conditions:
    """Commands in the order of the rows as the twin has them, deg, mm, s."""
    moving = np.column_stack([sense(x) for x in tool_mm.round(4).T])
    return forward.Conditions(a, c, moving, 0 * time, time, sense(a), sense(c))


def ball_less_tool(
    at: forward.Conditions, tool_mm: Floats, ball_mm: Floats, truth: forward.Truth
) -> Floats:
    """Ball on the twin's table minus the tool's point, (n, 3), µm."""
    pose = forward._table_pose(at, forward.Setup(), truth)
    lam, delta = forward.recorded_to_actual(at, truth.effects)
    tool = tool_mm @ (np.eye(3) + lam).T + delta
    ball = np.einsum("nij,nj->ni", pose[:, :3, :3], ball_mm) + pose[:, :3, 3]
    return np.asarray(1e3 * (ball - tool))


@dataclass(frozen=True, eq=False)
class Hidden:
    """What is wrong with a machine, and what a row reads beside.

    errors, effects: as the twin has them. turned: what C turns too far, deg (n,). moved: what the
    ball moves on the table, mm (n, 3). off: what the tool's point is off, mm (n, 3). longer: of the
    bar, µm.
    """

    errors: Mapping[str, float]
    effects: forward.Effects
    turned: Floats | float = 0.0
    moved: Floats | float = 0.0
    off: Floats | float = 0.0
    longer: float = 0.0


@dataclass(frozen=True, eq=False)
class Test:
    """Commands of a test, one a row.

    bar: From ball to tool, mm; zeros: an R-test. pause: Before the second ball or bar, else the
    second half, s.
    """

    a: Floats
    c: Floats
    ball: Floats
    bar: Floats
    label: NDArray[np.int64]
    pause: float = 0.0

    @classmethod
    def of(cls, a: Floats, c: Floats, balls: Floats, bars: Floats | None = None) -> Test:
        """Turns about each ball in turn, or about one ball with each bar."""
        count = len(balls) if bars is None else len(bars)
        rows = np.repeat(np.arange(count), len(a))
        ball = balls[rows] if bars is None else np.tile(balls[0], (len(rows), 1))
        bar = np.zeros(ball.shape) if bars is None else bars[rows]
        label = rows if bars is None else 0 * rows
        return cls(np.tile(a, count), np.tile(c, count), ball, bar, label)

    @property
    def lengths(self) -> bool:
        """Whether a ball-bar reads."""
        return bool(self.bar.any())

    @property
    def time(self) -> Floats:
        """Of each row, s."""
        return np.asarray(SECONDS * np.arange(len(self.a)) + self.pause * self.late)

    @property
    def late(self) -> Floats:
        """1 in the rows after the pause, else 0."""
        place = np.column_stack([self.ball, self.bar])
        other = np.flatnonzero(np.any(place != place[0], axis=1))
        first = other[0] if len(other) else len(place) // 2
        return np.asarray(np.arange(len(place)) >= first, dtype=np.float64)

    def tool(self) -> Floats:
        """Where the tool is sent, mm."""
        pose = forward.table_pose(self.a, self.c, forward.Setup(), forward.Truth())
        at = np.einsum("nij,nj->ni", pose[:, :3, :3], self.ball) + pose[:, :3, 3] + self.bar
        return np.asarray(np.round(at, 4))

    def readings(self, hidden: Hidden) -> Floats:
        """What is read, µm: three displacements a row, or one length."""
        tool = self.tool()
        at = conditions(self.a, self.c, tool, self.time)
        at = replace(at, c_deg=self.c + hidden.turned)
        truth = forward.Truth(hidden.errors, effects=hidden.effects)
        apart = ball_less_tool(at, tool, self.ball + hidden.moved, truth)
        apart = apart - 1e3 * np.broadcast_to(hidden.off, apart.shape)
        if self.lengths:
            return np.asarray(np.linalg.norm(apart, axis=1) + hidden.longer)
        return np.asarray(apart.ravel())

    def left(self, change: Floats) -> Floats:
        """What location errors and places of the balls do not make of a change of the readings."""
        names = forward.LOCATION_ERRORS["trt-ca"]
        plain = self.readings(Hidden({}, {}))
        columns = [self.readings(Hidden({name: STEP}, {})) - plain for name in names]
        for label in np.unique(self.label):
            for i in range(3):
                moved = 1e-3 * STEP * np.outer(self.label == label, np.eye(3)[i])
                columns.append(self.readings(Hidden({}, {}, moved=moved)) - plain)
        design = np.column_stack(columns)
        return np.asarray(change - design @ np.linalg.lstsq(design, change, rcond=None)[0])

    def data(self, readings: Floats) -> tn.RotaryTest:
        """As the package takes them."""
        place = self.tool()
        columns: dict[str, Any] = {f"{x}_mm": place[:, i] for i, x in enumerate("xyz")}
        columns |= {"a_deg": self.a, "c_deg": self.c, "time_s": self.time}
        if self.lengths:
            return tn.RotaryTest(**columns, length_mm=1e-3 * readings)
        read = dict(zip(("dx_um", "dy_um", "dz_um"), readings.reshape(-1, 3).T, strict=True))
        return tn.RotaryTest(**columns, **read, ball=[f"ball {k + 1:g}" for k in self.label])

    def setup(self) -> tn.Setup:
        """The set-up; a ball-bar needs the place of its ball."""
        if not self.lengths:
            return SETUP
        return replace(SETUP, rotary_test={"balls_mm": [tuple(map(float, self.ball[0]))]})


def drawn_test(rng: Rng) -> Test:
    """An R-test with one or two balls, or five directions of a ball-bar: C both ways, A at four."""
    there = np.arange(0.0, 360.0, float(rng.choice([15.0, 20.0, 30.0])))
    c = np.tile([*there, *there[::-1]], 4)
    tilts = np.append(0.0, rng.uniform([35, -60, 65], [60, -30, 90]).round())
    a = np.repeat(tilts, len(c) // 4)
    balls = np.column_stack(
        [rng.uniform(60, 120, 2), rng.uniform(-60, 60, 2), rng.uniform(30, 120, 2)]
    ).round(1)
    balls[1, :2] *= -1
    if rng.random() < 0.3:
        test = Test.of(a, c, balls, BARS)
    else:
        test = Test.of(a, c, balls[: int(rng.integers(1, 3))])
    return replace(test, pause=PAUSE_S * float(rng.random() < PAUSED))


def _cyclic(test: Test, rng: Rng) -> Hidden:
    period = 360.0 / rng.integers(8, 20)
    turn = 2 * np.pi * test.c / period + rng.uniform(0, 2 * np.pi)
    return Hidden({}, {}, turned=np.sin(turn) / 3600)


def _warm(axis: int) -> Callable[[Test, Rng], Hidden]:
    def warm(test: Test, rng: Rng) -> Hidden:
        share = rng.uniform(0.08, 0.5) * test.time[-1]
        return Hidden({}, {}, off=1e-3 * np.outer(1 - np.exp(-test.time / share), np.eye(3)[axis]))

    return warm


def _off(axis: int) -> Callable[[Test, Rng], Hidden]:
    """The tool stands elsewhere after the pause."""
    return lambda test, _: Hidden({}, {}, off=1e-3 * np.outer(test.late, np.eye(3)[axis]))


def _slip(test: Test, rng: Rng) -> Hidden:
    """The ball stands elsewhere on the table after the pause."""
    return Hidden({}, {}, moved=1e-3 * np.outer(test.late, rng.standard_normal(3)))


OF_BREAK: dict[str, Callable[[Test, Rng], Hidden]] = {
    "zero_shift_x": _off(0),
    "zero_shift_y": _off(1),
    "zero_shift_z": _off(2),
    "setup_shift": _slip,
}
SHIFTED = "EY0C"  # by location_shift_c


def shifted(test: Test, error: str) -> Floats:
    """What a location error changes that is larger by a unit after the pause."""
    change = test.readings(Hidden({error: STEP}, {})) - test.readings(Hidden({}, {}))
    return np.asarray(change * np.repeat(test.late, len(change) // len(test.a)) / STEP)


OF_READINGS: dict[str, Callable[[Test, Rng], Hidden]] = {
    "c_cyclic": _cyclic,
    "warmup_x": _warm(0),
    "warmup_y": _warm(1),
    "warmup_z": _warm(2),
}
OF_MACHINE = tuple(
    name
    for name in forward.EFFECTS
    if not name.startswith(("probe", "artefact", "trigger", "setup", "warmup"))
)


def cause(test: Test, name: str, rng: Rng) -> Floats:
    """What a cause of some size changes in the readings."""
    if name == "ballbar_length":
        return np.ones(len(test.a))
    if name == "location_shift_c":
        return shifted(test, SHIFTED)
    if name in OF_READINGS or name in OF_BREAK:
        hidden = {**OF_READINGS, **OF_BREAK}[name](test, rng)
    else:
        values = {p: float(rng.standard_normal()) for p in forward.EFFECTS[name]}
        hidden = Hidden({}, {name: values})
    return np.asarray(test.readings(hidden) - test.readings(Hidden({}, {})))


def unknown(test: Test, rng: Rng) -> Floats:
    """What no cause makes: C sinks at one position, the spindle warms in cycles, a ball slips."""
    far = (test.c - rng.uniform(60, 300)) / rng.uniform(25, 45)
    share = test.time / test.time[-1]
    cycles = np.sin(2 * np.pi * rng.uniform(2, 6) * share + rng.uniform(0, 6.28))
    slipped = np.outer(share > rng.uniform(0.3, 0.7), rng.standard_normal(3))
    made = (
        Hidden({}, {}, off=1e-3 * np.outer(np.exp(-(far**2)), [0.0, 0.0, 1.0])),
        Hidden({}, {}, off=1e-3 * np.outer(cycles, rng.standard_normal(3))),
        Hidden({}, {}, moved=1e-3 * slipped),
    )
    hidden = made[int(rng.integers(len(made)))]
    return np.asarray(test.readings(hidden) - test.readings(Hidden({}, {})))


def causes_of(test: Test) -> Sequence[str]:
    """Which of them this test has."""
    bar = ("ballbar_length",) if test.lengths else ()
    if not test.pause:
        return (*OF_MACHINE, *OF_READINGS, *bar)
    # places of balls that begin with the pause are unknown anyhow
    breaks = (name for name in OF_BREAK if name != "setup_shift" or not test.label.any())
    return (*OF_MACHINE, *OF_READINGS, *breaks, "location_shift_c", *bar)
