"""A servo axis as it might stand in a laboratory, made without the project's core and formulas.

A mass on a stiff, damped screw with a motor, two-mass drive; LuGre friction (Canudas de Wit et al.
1995) on the load, with levels of its own in each direction; a proportional velocity loop with a
first-order filter within a proportional position loop, whose amplifier has an offset. Integrated in
small steps. Force pulses on the load can be added that no column of the log records.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import trunnion as tn

Array = NDArray[np.float64]

PERIOD = 1e-3
SUBSTEPS = 20


@dataclass
class Rig:
    """Parameters, SI units: m, kg, N, s. Arrays (r,) stand for r rigs."""

    position_gain: Any = 120.0  # 1/s
    velocity_gain: Any = 9000.0  # N/(m/s)
    filter_s: float = 0.6e-3
    motor_kg: float = 40.0
    load_kg: float = 60.0
    stiffness: float = 4e7
    damping: float = 4e4
    coulomb: Any = 25.0  # N
    static: Any = 25.0
    stribeck_speed: float = 2e-3
    bristle: float = 5e6  # N/m
    bristle_damping: float = 300.0
    # N/(m/s), in the positive and the negative direction
    viscous: tuple[Any, Any] = (250.0, 250.0)
    offset: Any = 4.0  # N
    pulses: tuple[tuple[float, float, float], ...] = field(default=())  # from, to (s), N
    noise_um: float = 0.05

    @property
    def stiffness_of_loop(self) -> Any:
        """Force by metre of position error."""
        return self.position_gain * self.velocity_gain

    @property
    def gain(self) -> Any:
        """Loop gain at constant speed, 1/s, at the mean viscous friction."""
        return self.position_gain / (1 + sum(self.viscous) / 2 / self.velocity_gain)

    @property
    def coulomb_um(self) -> Any:
        """Coulomb friction as position error."""
        return 1e6 * self.coulomb / self.stiffness_of_loop

    @property
    def offset_um(self) -> Any:
        """Constant force as position error."""
        return 1e6 * self.offset / self.stiffness_of_loop


def commanded(seconds: float = 6.0, reach_mm: float = 80.0) -> Array:
    """Moves of several speeds up and down with ramps, and rests, mm, (n,)."""
    speeds = np.array([30.0, 70.0, 110.0, 50.0])
    t = np.arange(0.0, seconds, PERIOD)
    v = np.zeros(len(t))
    legs = [*speeds, *(-speeds)]
    each = seconds / len(legs)
    for i, speed in enumerate(legs):
        start = i * each
        ramp = 0.1
        inside = (t >= start) & (t < start + each)
        u = t[inside] - start
        up = np.clip(u / ramp, 0, 1)
        down = np.clip((each - 0.05 - u) / ramp, 0, 1)
        v[inside] = speed * np.minimum(up, down)
    x = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2) * PERIOD])
    return np.asarray(x * reach_mm / np.ptp(x))


def actual(rig: Rig, command_mm: Array, forces: Array | None = None) -> Array:
    """Motor encoder's position, mm, (n,), with noise left out; (n, r) for r rigs.

    forces: On the load, N, (n, r), that no model knows.
    """
    dt = PERIOD / SUBSTEPS
    shape = np.shape(rig.position_gain)
    x = np.full((2, *shape), command_mm[0] * 1e-3)  # motor, load
    v = np.zeros((2, *shape))
    z: Any = np.zeros(shape)
    force: Any = np.zeros(shape)
    out = np.empty((len(command_mm), *shape))
    for k, command in enumerate(command_mm):
        out[k] = 1e3 * x[0]
        t = k * PERIOD
        speed = rig.position_gain * (command * 1e-3 - x[0])  # held over a period of the control
        pushed: Any = sum(size for start, end, size in rig.pulses if start <= t < end)
        if forces is not None:
            pushed = pushed + forces[k]
        for _ in range(SUBSTEPS):
            wanted = rig.velocity_gain * (speed - v[0])
            force += dt / rig.filter_s * (wanted - force)
            between = rig.stiffness * (x[0] - x[1]) + rig.damping * (v[0] - v[1])
            level = rig.coulomb + (rig.static - rig.coulomb) * np.exp(
                -((v[1] / rig.stribeck_speed) ** 2)
            )
            # implicit in the bristle: stiff at speed
            z = (z + dt * v[1]) / (1 + dt * rig.bristle * abs(v[1]) / level)
            zdot = v[1] - rig.bristle * abs(v[1]) / level * z
            up = v[1] > 0
            drag = rig.viscous[0] * up + rig.viscous[1] * ~up
            friction = rig.bristle * z + rig.bristle_damping * zdot + drag * v[1]
            v[0] += dt / rig.motor_kg * (force - between)
            v[1] += dt / rig.load_kg * (between - friction - rig.offset + pushed)
            x += dt * v
    return out


def log(rig: Rig, command_mm: Array, rng: np.random.Generator) -> tn.AxisLog:
    """Axis log of the X axis alone, rounded to 0.01 µm as a file would be."""
    position = actual(rig, command_mm) + 1e-3 * rig.noise_um * rng.standard_normal(len(command_mm))
    return as_log(command_mm, position)


def as_log(command_mm: Array, position: Array) -> tn.AxisLog:
    """Axis log of these positions, mm."""
    return tn.AxisLog(
        time_s=np.arange(len(command_mm)) * PERIOD,
        x_cmd_mm=np.round(command_mm, 5),
        x_act_mm=np.round(position, 5),
    )
