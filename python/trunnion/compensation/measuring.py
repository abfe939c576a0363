"""Measuring a compensated machine: what its control does during a touch.

The control shows and takes positions of the machine that it pretends to be, the nominal one. For a
touch it sends the rotary axes to their commanded positions (with its zeros), moves the linear axes
along the compensated line, and, when the probe triggers, shows the position that it would have
commanded to get there. :func:`remeasure` does exactly that on top of :func:`trunnion.simulate`, so
that a second identification sees what is left.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import instance
from trunnion.base.units import Floats
from trunnion.compensation.control import Compensation, InverseCompensation, control_commands
from trunnion.compensation.machine import NOMINAL, Known, MachineErrors
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.machine.effects import Effect
from trunnion.probing.simulate import simulate
from trunnion.setup import Setup

_ROUNDS = 20
_SETTLED_MM = 1e-10


class _Axes:
    """Between positions that the control shows and positions of the axes, a touch a row."""

    def __init__(self, setup: Setup, compensation: Compensation | None, rotary_deg: Floats) -> None:
        self.setup = setup
        self.compensation = compensation
        self.rotary_deg = rotary_deg
        self.nominal = NOMINAL.core(setup)

    def points(self, shown_mm: Floats) -> Floats:
        """Points of the work that positions shown by the control stand for."""
        axes = np.hstack([shown_mm, self.rotary_deg])
        return np.ascontiguousarray(self.nominal.reached(axes, None)[:, :3])

    def commands(self, shown_mm: Floats) -> Floats:
        """What is sent for a position shown."""
        points = self.points(shown_mm)
        return control_commands(self.setup, self.compensation, points, self.rotary_deg)

    def sent_at(self, shown_mm: Floats, held_deg: Floats) -> Floats:
        """Linear axes for a position shown, the rotary axes held where the touch began."""
        if isinstance(self.compensation, InverseCompensation):
            # During a touch the rotary axes stand still: linear axes alone, as they now stand.
            known = self.compensation.known.core(self.setup)
            return known.linear_commands(self.points(shown_mm), held_deg, None)
        return self.commands(shown_mm)[:, :3]

    def shown_at(self, sent_mm: Floats, held_deg: Floats) -> Floats:
        """Return the position shown for positions of the linear axes: the inverse of `sent_at`."""
        shown = sent_mm.copy()
        for _ in range(_ROUNDS):
            miss = sent_mm - self.sent_at(shown, held_deg)
            shown = shown + miss
            if np.abs(miss).max(initial=0.0) < _SETTLED_MM:
                return shown
        # A table that is rounded step by step cannot be inverted closer than its step.
        return shown


@checked
def remeasure(
    plan: Touches,
    setup: Setup,
    compensation: Compensation | None,
    errors: Known = None,
    placement: Mapping[str, float] | None = None,
    effects: Mapping[Effect, Mapping[str, float]] | None = None,
    noise_um: float = 0.0,
    tick_um: float | None = None,
    seed: int | None = None,
    *,
    sample: int = 0,
) -> Touches:
    """Simulate a measurement on a machine whose control compensates.

    Parameters
    ----------
    plan
        As for `simulate`: a plan, or recorded touches.
    setup, errors, placement, effects, noise_um, tick_um, seed, sample
        The machine as it really is, as for `simulate`.
    compensation
        What the control does; None: nothing, and this is `simulate`.

    Returns
    -------
    Touches
        Rows of the plan with the positions that the control shows. Identified without known
        errors, they give what the compensation has left (and the placement of the artefact).

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> errors = {"EX0C": 15.0}
    >>> known = tn.ModelCompensation(tn.compensation.MachineErrors(errors))
    >>> shown = tn.remeasure(tn.plan(setup), setup, known, errors)
    >>> abs(round(tn.identify(shown, setup)["EX0C"], 2))
    0.0
    """
    instance("plan", plan, Touches, "trunnion.Touches")
    state = MachineErrors.of(setup, errors, effects)
    truth = (state.errors, placement, effects, noise_um, tick_um, seed)
    if compensation is None:
        return simulate(plan, setup, *truth, sample=sample)
    chain = Chain(setup)
    rotary = chain.to_machine(plan.rotary_deg, len(plan))
    axes = _Axes(setup, compensation, rotary)
    held = axes.commands(plan.position_mm)[:, 3:]
    target = axes.sent_at(plan.position_mm, held)
    columns: dict[str, Floats] = {}
    if plan.start_mm is not None:
        start = axes.sent_at(plan.start_mm, held)
        columns |= {f"start_{axis}_mm": start[:, i] for i, axis in enumerate("xyz")}
    else:
        start = axes.sent_at(plan.position_mm - plan.direction, held)
    way = target - start
    direction = way / np.linalg.norm(way, axis=1)[:, None]
    columns |= {f"{axis}_mm": target[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"dir_{axis}": direction[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"{k.lower()}_deg": angle for k, angle in chain.to_control(held).items()}
    recorded = simulate(plan.with_columns(**columns), setup, *truth, sample=sample)
    shown = axes.shown_at(recorded.position_mm, held)
    return plan.with_columns(x_mm=shown[:, 0], y_mm=shown[:, 1], z_mm=shown[:, 2])
