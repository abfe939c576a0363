"""A tick of the probe that touches show and the set-up does not state, or the other way round."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trunnion._core import Moves
from trunnion.base.errors import TrunnionError
from trunnion.base.recognition import on_grid, recognised
from trunnion.base.statistics import linear_fit
from trunnion.base.units import Floats
from trunnion.data.touches import Touches
from trunnion.machine.sizes import SURE_SIGMAS
from trunnion.probing.model import TouchModel, rounding_um, steps_um, ticks_um
from trunnion.probing.recorded import other_period_ms, recorded_um, servo_period_ms
from trunnion.setup import Setup

FAR_LESS = 0.25
"""Of the errors of rounding: what readings recorded in a step scatter by at least."""

MIN_ROUNDED = 24
"""Touches from which on their scatter tells whether they are rounded."""

SAME_SIZE = 0.25
MAX_KURTOSIS = 2.3
"""Of errors of rounding, 1.8, and of noise, 3: what is between."""


def tick_mistakes(data: Touches, plain: TouchModel, moves: Moves, near: Floats) -> list[str]:
    """Name a tick that the touches show and nobody stated, or that is stated and not there.

    plain: The model without effects. moves: The touches, as it knows them. near: Values of its
    parameters that fit them to first order, (p,).
    """
    stated = plain.setup.probe.servo_period_ms
    steps, ticks = steps_um(plain.setup, data), ticks_um(plain.setup, data)
    if stated and (period := other_period_ms(data, stated)):
        return [
            f"{_as_feeds(period)}, not every {stated:g} ms, of which half was taken off every "
            f"touch: probe.servo_period_ms = {period:.3g}."
        ]
    if not np.any(steps) and (period := servo_period_ms(data)):
        return [
            f"{_as_feeds(period)}, and touches are {period / 2:.3g} ms late on average, which "
            f"looks like a delay of the trigger: state probe.servo_period_ms = {period:.3g}."
        ]
    if np.any(steps) and not np.any(ticks):
        return _finer_than_stated(data, plain, moves, near)
    late = _late_by_half_a_tick(data, plain, moves, near)
    return late or (_finer_than_stated(data, plain, moves, near) if np.any(ticks) else [])


def _as_feeds(period_ms: float) -> str:
    """What steps say of the clock."""
    return (
        f"The steps of the touches are feed times {period_ms:.3g} ms: the control looks at the "
        f"probe every {period_ms:.3g} ms"
    )


def _finer_than_stated(data: Touches, plain: TouchModel, moves: Moves, near: Floats) -> list[str]:
    """Say where readings scatter far less than the stated tick allows, and lie on no grid of it."""
    setup = plain.setup
    steps, rounding = steps_um(setup, data), rounding_um(setup, data)
    off = np.asarray(plain.core.residuals(moves, plain.values()))
    if float(np.std(off)) < float(np.max(steps)):  # all may round alike
        return []
    coordinates = (1e3 * data.position_mm).T
    if any(on_grid(v / steps, 1.0) for v in (*recorded_um(data), *coordinates, off)):
        return []
    fit = _late(data, plain, moves, near)
    seen = np.inf if fit is None else float(np.sqrt(np.mean(fit.residuals_um**2)))
    if seen > FAR_LESS * rounding:
        return []
    tick = "servo_period_ms" if setup.probe.servo_period_ms else "tick_um"
    if not np.any(ticks_um(setup, data)):
        return [
            f"The readings scatter by {seen:.2g} µm, far less than rounding to steps of "
            f"{steps.max():.4g} µm does ({rounding:.2g} µm): is probe.resolution_um right?"
        ]
    return [
        f"The readings scatter by {seen:.2g} µm, far less than a tick of {steps.max():.4g} µm "
        f"allows ({rounding:.2g} µm), half of which was taken off every touch: do they come from a "
        f"control that latches the position? Then probe.{tick} = 0."
    ]


def _late_by_half_a_tick(data: Touches, plain: TouchModel, moves: Moves, near: Floats) -> list[str]:
    """Say where touches are late by half of a tick whose errors of rounding the residuals are.

    Of a stated tick, by half of what it is wrong by, where the residuals are not those of it.
    """
    fit = _late(data, plain, moves, near)
    if fit is None or abs(fit.late) < SURE_SIGMAS * fit.std:
        return []
    late, stated = fit.late, ticks_um(plain.setup, data)
    ticks = stated + 2 * late * (np.asarray(data.feed_mm_min) / 60 if fit.is_delay else 1.0)
    if not ticks.min() > 0 or any(
        recognised(v) > SAME_SIZE * ticks.min() for v in recorded_um(data)
    ):
        return []  # latched, or the steps themselves are seen
    if not fit.scatters_as(ticks, data) or fit.scatters_as(stated, data):
        return []
    if np.any(stated):
        return [_another_tick(data, plain.setup, ticks)]
    if fit.is_delay:
        return [
            f"Touches are {late:.3g} ms late on average, and scatter as a control does that looks "
            f"at the probe every {2 * late:.3g} ms: a servo period that the set-up does not state "
            f"would do exactly this (probe.servo_period_ms = {2 * late:.2g}), and so would a delay "
            "of the trigger."
        ]
    return [
        f"Touches are {late:.3g} µm late on average, and scatter as a control does that looks at "
        f"the probe every {2 * late:.3g} µm of the way: a tick that the set-up does not state "
        f"would do exactly this (probe.tick_um = {2 * late:.2g}, or probe.servo_period_ms); else "
        "half of it is in a cause (probe_radius, trigger_delay), or in EZ0A and the placement."
    ]


def _another_tick(data: Touches, setup: Setup, ticks: Floats) -> str:
    """Say that the tick is another than stated, ``ticks`` (n,), µm."""
    probe = setup.probe
    name, given, size = "tick_um", probe.tick_um, float(np.mean(ticks))
    if probe.servo_period_ms:
        assert data.feed_mm_min is not None
        name, given = "servo_period_ms", probe.servo_period_ms
        size = float(np.mean(60 * ticks / data.feed_mm_min))
    unit = name.rsplit("_", 1)[1].replace("um", "µm")
    return (
        f"Half of the stated tick was taken off every touch, and the touches are off by what is "
        f"half of another, and scatter as a control does that looks at the probe every {size:.2g} "
        f"{unit}: probe.{name} = {size:.2g} (not {given:g}) would do exactly this."
    )


@dataclass(frozen=True)
class _Late:
    """How late touches are on average, ms or µm, and what a fit with it leaves, by freedom."""

    late: float
    std: float
    is_delay: bool
    residuals_um: Floats

    def scatters_as(self, ticks: Floats, data: Touches) -> bool:
        """Whether the residuals are errors of rounding to these ticks, (n,) µm, at each feed."""
        if not ticks.min() > 0:
            return False
        left, feed = self.residuals_um / ticks, data.feed_mm_min
        several = () if feed is None or not self.is_delay else np.unique(feed)
        groups = [left[feed == f] for f in several] or [left]
        sizes = np.array([np.sqrt(12 * np.mean(some**2)) for some in groups])
        kurtosis = float(np.mean(left**4)) / max(float(np.mean(left**2)) ** 2, 1e-300)
        return bool(np.all(np.abs(sizes - 1) <= SAME_SIZE) and kurtosis <= MAX_KURTOSIS)


def _late(data: Touches, plain: TouchModel, moves: Moves, near: Floats) -> _Late | None:
    """Fit by how much touches are late, weighed as ticks; None: too few touches, or off."""
    feed = data.feed_mm_min
    is_delay = feed is not None and len(np.unique(feed)) > 1
    size = np.asarray(feed) / 60 if is_delay else np.ones(len(data))
    effect = "trigger_delay" if is_delay else "probe_radius"
    try:
        model = TouchModel(plain.setup, (effect,), chain=plain.chain)
        off, jacobian = model.core.linearise(moves, np.append(near, 0.0))
    except TrunnionError:
        return None
    # What one more cause changes is linear: the touches are fitted without it.
    alike = linear_fit(jacobian, off)
    freedom = len(data) - alike.rank
    if freedom < MIN_ROUNDED or alike.not_identifiable[-1]:
        return None
    rest = off - jacobian @ alike.solution
    std = float(alike.std[-1] * np.sqrt(rest @ rest / freedom))
    weighed = linear_fit(jacobian / size[:, None], off / size) if is_delay else alike
    left = (off - jacobian @ weighed.solution) * np.sqrt(len(data) / freedom)
    value = float(weighed.solution[-1])
    return _Late(value if is_delay else -value, std, is_delay, left)
