"""What effects do to a test of rotary axes, exactly: for simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.checks import choose, entry, numbers, positive
from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.data.rotary_test import RotaryTest
from trunnion.data.times import elapsed_s
from trunnion.machine.chain import Chain
from trunnion.machine.effects import senses
from trunnion.probing.rotary_readings import OFFSETS, TOOL, commanded, machine_effects

AXES = "XYZ"
SENSORS = {
    "sensor_turn": (("rx_deg", "ry_deg", "rz_deg"), "turn of the sensors against X, Y, Z"),
    "sensor_gain": (("ky_percent", "kz_percent"), "gain of the sensors Y and Z beside that of X"),
}
"""Errors of an R-test's instrument by id: parameters, label."""
SENSE_PLACES = 4
"""Of millimetres and degrees: an axis that moves by less does not move."""


@dataclass(frozen=True)
class Acting:
    """Effects at each reading.

    Attributes
    ----------
    machine
        Effects of the machine with the values of their parameters in order.
    behind
        How far each axis is behind its command, machine order and sense, mm and degrees,
        (n, 3 + rotary axes).
    moved_um
        How far the tool's point has moved from the ball, machine's directions, (n, 3).
    sensors
        What makes of a displacement what an R-test reads, (3, 3).
    """

    machine: tuple[tuple[str, tuple[float, ...]], ...]
    behind: Floats
    moved_um: Floats
    sensors: Floats

    @classmethod
    def of(
        cls, chain: Chain, plan: RotaryTest, effects: Mapping[str, Mapping[str, float]]
    ) -> Acting:
        """Check effects by id and parameter.

        Raises InputError, UnknownNameError: no such effect or parameter; a drift without times.
        """
        axes = commanded(chain, plan)
        machine, behind, moved = [], np.zeros(axes.shape), np.zeros((len(plan), 3))
        sensors = np.eye(3)
        of_machine, lost = machine_effects(chain), _backlash(chain)
        known = {
            **{name: [p.name for p in info.parameters] for name, info in of_machine.items()},
            **{name: [unit] for name, (_, unit) in lost.items()},
            **{f"drift_{x}": ["rate_um_h"] for x in AXES.lower()},
            **{f"warmup_{x}": ["amplitude_um", "tau_min"] for x in AXES.lower()},
            TOOL: list(OFFSETS),
            **{name: list(parameters) for name, (parameters, _) in SENSORS.items()},
        }
        for name, given in effects.items():
            parameters = known[choose("effect", name, known)]
            sizes = numbers(name, given)
            for parameter in sizes:
                choose(f"parameter of effect {name!r}", parameter, parameters)
            values = [sizes.get(parameter, 0.0) for parameter in parameters]
            if name in of_machine:
                machine.append((name, tuple(values)))
            elif name in lost:
                at, unit = lost[name]
                size = values[0] * (1e-3 if unit == "b_um" else 1 / 3600)
                behind[:, at] += 0.5 * size * senses(np.round(axes[:, at], SENSE_PLACES))
            elif name == TOOL:
                moved += values
            elif name in SENSORS:
                sensors = sensors_of(name, values) @ sensors
            else:
                with entry(name):
                    moved[:, AXES.lower().index(name[-1])] += _with_time(name, values, plan)
        return cls(tuple(machine), behind, moved, sensors)


def sensors_of(name: str, values: ArrayLike) -> Floats:
    """What an error of `SENSORS` makes of a displacement, (3, 3), exactly.

    values: Of its parameters, degrees (an axis times the angle about it) or percent. A gain of all
    three is one of all errors.
    """
    if name == "sensor_gain":
        y, z = 1e-2 * np.asarray(values, dtype=np.float64)
        return np.asarray(np.diag([1.0, 1.0 + y, 1.0 + z]))
    turn = np.radians(np.asarray(values, dtype=np.float64))
    angle = float(np.linalg.norm(turn))
    about = cross_with(turn)
    once, twice = np.sinc(angle / np.pi), np.sinc(angle / (2.0 * np.pi)) ** 2 / 2.0
    return np.asarray(np.eye(3) + once * about + twice * about @ about)


def cross_with(vector: ArrayLike) -> Floats:
    """Return the matrix of the cross product of a vector with another, (3, 3)."""
    x, y, z = np.asarray(vector, dtype=np.float64)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _backlash(chain: Chain) -> dict[str, tuple[int, str]]:
    """Place of the axis and parameter of each backlash, by id."""
    linear = {f"backlash_{x}": (i, "b_um") for i, x in enumerate(AXES.lower())}
    rotary = {f"{x.lower()}_backlash": (3 + i, "b_arcsec") for i, x in enumerate(chain.letters)}
    return linear | rotary


def _with_time(name: str, values: list[float], plan: RotaryTest) -> Floats:
    """Displacement of a drift or a warm-up at each reading, µm, (n,)."""
    if plan.time_s is None:
        raise InputError(f"time_s: got no such column in the plan, expected it for {name}")
    seconds = elapsed_s(plan.time_s)
    if name.startswith("drift"):
        return np.asarray(values[0] * seconds / 3600.0)
    tau_min = positive(f"{name}.tau_min", values[1])
    return np.asarray(values[0] * (1 - np.exp(-seconds / 60.0 / tau_min)))
