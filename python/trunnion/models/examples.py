"""A small measurement of each kind, with every optional column: what a catalogue is listed from.

The same measurements are what the tests of the protocol run on, so that a kind gets them with its
entry in :mod:`trunnion.models.kinds`. Noise and errors of the machine are small; no effect acts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from trunnion.base.units import Floats
from trunnion.contouring.paths import Path
from trunnion.contouring.servo import Servo
from trunnion.contouring.simulation import simulate as simulate_contour
from trunnion.data.axis_log import AxisLog
from trunnion.data.ballbar import Ballbar
from trunnion.data.diameters import Diameters
from trunnion.data.levels import Levels
from trunnion.data.points import Points
from trunnion.data.positioning import Positioning
from trunnion.data.rotary_test import RotaryTest
from trunnion.data.sweep import Sweep
from trunnion.data.touches import Touches
from trunnion.hybrid import Mechanism, ballbar_plan
from trunnion.machine.chain import Chain
from trunnion.probing.plan import plan
from trunnion.probing.rotary_test import plan_rotary_test, simulate_rotary_test
from trunnion.probing.simulate import simulate
from trunnion.setup import Artefact, Setup

SEED = 1
NOISE_UM = 0.3


def touches() -> tuple[Touches, Setup]:
    """Touches of the cross, from both senses of turning, at two feeds."""
    setup = Setup(artefact=Artefact("cross"))
    positions = plan(
        setup,
        c_deg=(0.0, 90.0, 180.0, 270.0),
        a_deg=(90.0, -90.0),
        feeds_mm_min=(300.0, 600.0),
        both_senses=True,
    )
    errors = {"EX0C": 15.0, "EY0A": -10.0}
    placement = {"dx_um": 20.0, "rc_arcsec": 10.0}
    return simulate(positions, setup, errors, placement, noise_um=NOISE_UM, seed=SEED), setup


def points() -> tuple[Points, None]:
    """Two measurements, each a set-up of its own, of the same features in space."""
    grid = np.meshgrid(*(200.0 * np.linspace(0.0, 1.0, n) ** 1.1 for n in (6, 4, 3)), indexing="ij")
    nominal = np.tile(np.stack([x.ravel() for x in grid], axis=1), (2, 1))
    rows = np.arange(len(nominal))
    # the guide of X has a kink, which no named effect makes
    kink = np.maximum(nominal[:, :1] - 120.0, 0.0) * [0.0, 1e-4, 0.0]
    measured = nominal + kink + 1e-3 * NOISE_UM * _normal(nominal.shape)
    columns = {f"nominal_{a}_mm": nominal[:, i] for i, a in enumerate("xyz")}
    columns |= {f"{a}_mm": measured[:, i] for i, a in enumerate("xyz")}
    return Points(columns, time_s=30.0 * rows, group=rows * 2 // len(rows)), None


def touches_in_two_parts() -> tuple[Touches, Setup]:
    """The touches of the cross, with a break of an hour between them."""
    data, setup = touches()
    return data.with_columns(time_s=_with_a_break(data.time_s)), setup


def points_in_two_parts() -> tuple[Points, None]:
    """The points, with a break of an hour in the second measurement."""
    data, _ = points()
    return data.with_columns(time_s=_with_a_break(data.time_s)), None


def positioning_in_two_parts() -> tuple[Positioning, None]:
    """The stops, with a break of an hour in the fourth cycle."""
    data, _ = positioning()
    return data.with_columns(time_s=_with_a_break(data.time_s)), None


def _with_a_break(time_s: Any) -> Floats:
    """Times (n,) of which the last quarter is an hour later."""
    late = np.arange(len(time_s)) >= 3 * len(time_s) // 4
    return np.asarray(time_s) + np.where(late, 3600.0, 0.0)


def positioning() -> tuple[Positioning, None]:
    """Eleven targets, both directions, five cycles."""
    targets = np.linspace(0.0, 300.0, 11)
    run = np.concatenate([targets, targets[::-1]])
    target = np.tile(run, 5)
    n = len(target)
    data = Positioning(
        target_mm=target,
        measured_mm=target + 1e-3 * (2.0 + NOISE_UM * _normal((n,))),
        direction=np.tile(np.repeat([1, -1], len(targets)), 5),
        cycle=np.repeat(np.arange(1, 6), len(run)),
        time_s=20.0 * np.arange(n),
        temperature_c=20.0 + 0.02 * np.arange(n) ** 0.5,
    )
    return data, None


def levels() -> tuple[Levels, None]:
    """Twelve places of a line with the instrument one way, and again with it turned."""
    return _turned_level(position_mm=100.0 * np.arange(1.0, 13.0)), None


def surface_levels() -> tuple[Levels, None]:
    """Seven by six places of a surface, with the instrument one way, then turned."""
    x, y = (100.0 * a.ravel() for a in np.meshgrid(np.arange(7.0), np.arange(6.0)))
    return _turned_level(x_mm=x, y_mm=y), None


def levels_read_again() -> tuple[Levels, None]:
    """Twelve places of a line, with the instrument one way and turned, and both again."""
    return _turned_level(2, position_mm=100.0 * np.arange(1.0, 13.0)), None


def _turned_level(times: int = 1, **places_mm: Floats) -> Levels:
    """Readings at places, (n,) each, with the instrument one way, and again with it turned.

    times: All of that.
    """
    sense = np.tile(np.repeat([1.0, -1.0], len(next(iter(places_mm.values())))), times)
    noise = NOISE_UM * _normal((2, len(sense)))
    return Levels(
        **{name: np.tile(place, 2 * times) for name, place in places_mm.items()},
        along_um_m=30.0 * sense + noise[0],
        across_um_m=-12.0 * sense + noise[1],
        turn_deg=np.where(sense > 0, 0.0, 180.0),
        time_s=20.0 * np.arange(len(sense)),
    )


def sweep() -> tuple[Sweep, None]:
    """Three targets at different heights, there and back."""
    there = np.arange(0.0, 360.0, 15.0)
    angle = np.concatenate([there, there[::-1]])
    turn = np.radians(angle)
    parts = [
        np.column_stack([r * np.cos(turn + phase), r * np.sin(turn + phase), np.full_like(turn, h)])
        for r, phase, h in ((100.0, 0.3, 0.0), (150.0, 2.0, 60.0), (80.0, 4.0, -40.0))
    ]
    place = np.concatenate(parts)
    place = place + 1e-3 * NOISE_UM * _normal(place.shape)
    columns: dict[str, Any] = {f"{a}_mm": place[:, i] for i, a in enumerate("xyz")}
    data = Sweep(
        columns,
        angle_deg=np.tile(angle, len(parts)),
        target=np.repeat(np.arange(1, len(parts) + 1), len(angle)),
        time_s=10.0 * np.arange(len(place)),
    )
    return data, None


def diameters() -> tuple[Diameters, Setup]:
    """Two passes, the second with twice the depth, another coolant and reversed feed."""
    z = np.linspace(5.0, 95.0, 19)
    back = np.repeat([False, True], len(z))
    z = np.tile(z, 2)
    data = Diameters(
        {"pass": np.where(back, "2", "1")},
        z_mm=z,
        error_um=NOISE_UM * _normal(z.shape),
        time_s=1.2 * np.where(back, z, 100.0 - z),
        feed_sign=np.where(back, 1, -1),
        depth_mm=np.where(back, 1.0, 0.5),
        diameter_mm=np.full(len(z), 40.0),
        spindle_rpm=np.full(len(z), 1000.0),
        coolant=np.where(back, "wet", "dry"),
    )
    return data, Setup(
        artefact=Artefact("none"), turning={"overhang_mm": 100.0, "feed_mm_rev": 0.05}
    )


def ballbar() -> tuple[Ballbar, None]:
    """Circles of a three-axis machine in the three planes, both senses."""
    turn = np.radians(np.arange(0.0, 365.0, 5.0))
    turn = np.concatenate([turn, turn[::-1]])
    place, zero = [], np.zeros_like(turn)
    for i, j in ((0, 1), (1, 2), (0, 2)):
        circle = [zero, zero, zero]
        circle[i], circle[j] = 100.0 * np.cos(turn), 100.0 * np.sin(turn)
        place.append(np.column_stack(circle))
    tip = np.concatenate(place)
    columns = {f"{a}_mm": tip[:, i] for i, a in enumerate("xyz")}
    data = Ballbar(
        columns,
        setup=np.repeat([0, 1, 2], len(turn)),
        length_mm=100.0 + 1e-3 * NOISE_UM * _normal((len(tip),)),
        sense=np.tile(np.repeat([1, -1], len(turn) // 2), 3),
        feed_mm_min=np.full(len(tip), 600.0),
        time_s=1.0 * np.arange(len(tip)),
    )
    return data, None


def hybrid_ballbar() -> tuple[Ballbar, Setup]:
    """Circles of the hybrid parallel machine about one ball."""
    data = ballbar_plan(Mechanism(), np.array([0.0, -350.0, -1400.0]), step_deg=10.0)
    length = data.length_mm + 1e-3 * NOISE_UM * _normal((len(data),))
    return data.with_columns(length_mm=length, time_s=1.0 * np.arange(len(data))), Setup(
        artefact=Artefact("none")
    )


def rotary_test() -> tuple[RotaryTest, Setup]:
    """An R-test of two balls, A and C turned to and fro."""
    setup = Setup(artefact=Artefact("none"))
    return _rotary_test(setup, {"near": (90.0, 20.0, 60.0), "far": (-40.0, 110.0, 90.0)}), setup


def rotary_test_in_two_parts() -> tuple[RotaryTest, Setup]:
    """An R-test of one ball, with a break of half an hour in its middle."""
    setup = Setup(artefact=Artefact("none"))
    data = _rotary_test(setup, {"near": (90.0, 20.0, 60.0)})
    later = 1800.0 * (np.arange(len(data)) >= len(data) // 2)
    return data.with_columns(time_s=np.asarray(data.time_s) + later), setup


def rotary_bars() -> tuple[RotaryTest, Setup]:
    """A ball-bar in three directions."""
    setup = Setup(artefact=Artefact("none"), rotary_test={"balls_mm": [(90.0, 20.0, 60.0)] * 3})
    balls = dict.fromkeys("xyz", setup.rotary_test["balls_mm"][0])
    return _rotary_test(setup, balls, bar=True), setup


def _rotary_test(
    setup: Setup, balls: dict[str, tuple[float, float, float]], *, bar: bool = False
) -> RotaryTest:
    """Turns of A and C to and fro about each ball in turn, a bar along X, Y, Z."""
    there = np.arange(0.0, 360.0, 30.0)
    turns = {"A": np.repeat([0.0, 50.0, -35.0, 80.0], 24), "C": np.tile([*there, *there[::-1]], 4)}
    bars = 100.0 * np.eye(3) if bar else np.zeros((len(balls), 3))
    made = []
    for number, (label, ball) in enumerate(balls.items()):
        planned = plan_rotary_test(setup, ball, turns, bar_mm=bars[number])
        given: dict[str, Any] = {"noise_um": NOISE_UM, "seed": SEED + number, "bar": bar}
        part = simulate_rotary_test(planned, setup, ball, {"EX0C": 5.0, "EZ0A": -8.0}, **given)
        time = 4.0 * (np.arange(len(part)) + number * len(part))
        made.append(part.with_columns(ball=np.full(len(part), label), time_s=time))
    return RotaryTest.concatenate(made)


def axis_log() -> tuple[AxisLog, Setup]:
    """X, Y, Z, A and C along a curve at two feeds, with the tool tip."""
    table = {
        "period_ms": 1.0,
        **{axis: {"gain_per_s": 80.0, "time_constant_ms": 5.7} for axis in "XYZAC"},
    }
    servo = Servo.from_table(table)
    logs = [
        simulate_contour(Path.paper(), feed, controller="independent", servo=servo).axis_log(
            noise_um=NOISE_UM, noise_arcsec=1.0, seed=SEED + i, run=f"{feed:g} mm/min"
        )[::8]
        for i, feed in enumerate((3000.0, 6000.0))
    ]
    log = AxisLog.concatenate(logs)
    setup = Setup(artefact=Artefact("none"), servo=table)
    chain = Chain(setup)
    axes = np.column_stack([log.actual(letter) for letter in f"xyz{chain.letters.lower()}"])
    tip = chain.machine({"EX0C": 5.0, "EZ0A": -8.0}).forward(axes)[:, :3]
    return log.with_columns(**{f"tip_{a}_mm": tip[:, i] for i, a in enumerate("xyz")}), setup


def _normal(shape: tuple[int, ...]) -> Floats:
    return np.random.default_rng(SEED).standard_normal(shape)
