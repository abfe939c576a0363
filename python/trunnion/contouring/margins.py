"""How far from instability the loops are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

import trunnion._core as _core
from trunnion.base.arguments import checked
from trunnion.base.checks import line
from trunnion.base.report import Result, Table
from trunnion.base.saved import Gridded
from trunnion.base.units import Floats
from trunnion.contouring.paths import Path
from trunnion.contouring.servo import Controller, Servo, coupling_of
from trunnion.contouring.simulation import five_axis_machine, period_ms
from trunnion.setup import Setup


@dataclass(frozen=True, eq=False, repr=False)
class Margins(Result):
    """Margins of the axes' loops and of the coupled five-axis loop.

    Attributes
    ----------
    axes:
        Letters of the axes.
    gain:
        Factor on the loop gain at which an axis's loop oscillates, shape (5,). With a coupling it
        is the loop along the normal of the path, K_v (1 + C(z)) of matched axes; below 1 it is
        unstable.
    phase_deg, crossover_hz, delay_ms:
        Further phase lag, highest frequency of unit gain, further delay at which it oscillates.
    u:
        Points of the path.
    pole:
        Largest pole of the coupled loop of all axes with the geometry frozen there, shape (n,);
        stable below 1.
    coupled_gain:
        Factor on all loop gains at which that loop becomes unstable, shape (n,).
    """

    axes: str
    gain: Floats
    phase_deg: Floats
    crossover_hz: Floats
    delay_ms: Floats
    u: Floats
    pole: Floats
    coupled_gain: Floats

    def gridded(self) -> Gridded:
        """Return the margins of the axes, and those of the coupled loop along the path."""
        own, along = ("gain", "phase_deg", "crossover_hz", "delay_ms"), ("pole", "coupled_gain")
        arrays = {name: (("axis",), getattr(self, name)) for name in own}
        arrays |= {name: (("u",), getattr(self, name)) for name in along}
        return Gridded({"axis": list(self.axes), "u": self.u}, arrays, {})

    @property
    def stable(self) -> bool:
        """Whether every loop is stable."""
        return bool((self.gain > 1).all() and (self.pole < 1).all())

    def sentences(self) -> Sequence[str]:
        """Stability, and the coupled loop along the path."""
        lines = ["Every loop is stable." if self.stable else "Unstable."]
        if len(self.u):
            lines.append(
                f"Coupled along the path: gain margin {self.coupled_gain.min():.3f} to "
                f"{self.coupled_gain.max():.3f}, largest pole {self.pole.max():.5f}."
            )
        return lines

    def tables(self) -> tuple[Table, ...]:
        """Margins of the axes, and of the coupled loop along the path."""
        columns = ("axis", "gain", "phase deg", "crossover Hz", "delay ms")
        values = np.column_stack([self.gain, self.phase_deg, self.crossover_hz, self.delay_ms])
        rows = [(axis, *row) for axis, row in zip(self.axes, values.tolist(), strict=True)]
        tables = [Table.of("Margins of the axes", columns, rows, digits=3)]
        if len(self.u):
            along = np.column_stack([self.u, self.coupled_gain, self.pole]).tolist()
            points = [(f"{u:g}", gain, pole) for u, gain, pole in along]
            tables.append(Table.of("Coupled loop", ("u", "gain", "largest pole"), points, digits=5))
        return tuple(tables)


@checked
def margins(
    servo: Servo | None = None,
    *,
    controller: Controller = "proposed",
    path: Path | None = None,
    u: ArrayLike | None = None,
    assumed: Mapping[str, float] | None = None,
    setup: Setup | None = None,
) -> Margins:
    """Gain and stability margins of the loops, by the exact sampled response with its delay.

    Friction, backlash, cyclic error and resonance are left out (resonance lies outside the loop
    when it is closed on the motor). ``path`` and ``u`` (by default 11 points of it) give the
    coupled loop of all five axes along a path, on the machine of ``setup`` (a ``trt-ca``).
    """
    servo = servo or Servo.paper()
    period_s = period_ms(servo) * 1e-3
    coupling = coupling_of(controller)
    gains = None if coupling is None else coupling.gains
    machine = five_axis_machine(setup, assumed)
    letters = f"XYZ{machine.letters}"
    rows = servo.rows(letters)
    table = _core.contour_axis_margins(rows, gains, period_s)
    points = np.zeros(0)
    along = np.zeros((0, 2))
    if path is not None and gains is not None:
        span = np.linspace(path.breaks[0], path.breaks[-1], 11)
        points = span if u is None else line("u", u)
        along = _core.contour_path_margins(
            path.core,
            points,
            axes=rows,
            gains=gains,
            period_s=period_s,
            assumed=machine,
        )
    return Margins(
        letters,
        table[:, 0],
        np.rad2deg(table[:, 1]),
        table[:, 2],
        table[:, 3] * 1e3,
        points,
        along[:, 0],
        along[:, 1],
    )
