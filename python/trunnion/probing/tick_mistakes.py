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
from trunnion.probing.model import (
    TouchModel,
    recorded_um,
    rounding_um,
    servo_period_ms,
    steps_um,
    ticks_um,
)

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
    if np.any(steps_um(plain.setup, data)):
        return _finer_than_stated(data, plain, moves, near)
    if period := servo_period_ms(data):
        return [
            f"The steps of the touches are as their feeds: the control looks at the probe every "
            f"{period:.3g} ms, and touches are {period / 2:.3g} ms late on average, which looks "
            f"like a delay of the trigger: state probe.servo_period_ms = {period:.3g}."
        ]
    return _late_by_half_a_tick(data, plain, moves, near)


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
    """Say where touches are late by half of a tick whose errors of rounding the residuals are."""
    fit = _late(data, plain, moves, near)
    if fit is None or fit.late < SURE_SIGMAS * fit.std:
        return []
    feed, late, several = data.feed_mm_min, fit.late, fit.is_delay
    ticks = 2 * late * (np.asarray(feed) / 60 if several else np.ones(len(data)))
    if any(recognised(v) > SAME_SIZE * ticks.min() for v in recorded_um(data)):
        return []  # the steps themselves are seen
    left = fit.residuals_um / ticks
    groups = [left[feed == f] for f in np.unique(feed)] if several and feed is not None else [left]
    sizes = np.array([np.sqrt(12 * np.mean(some**2)) for some in groups])
    kurtosis = float(np.mean(left**4)) / max(float(np.mean(left**2)) ** 2, 1e-300)
    if np.any(np.abs(sizes - 1) > SAME_SIZE) or kurtosis > MAX_KURTOSIS:
        return []
    if several:
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


@dataclass(frozen=True)
class _Late:
    """How late touches are on average, ms or µm, and what a fit with it leaves, by freedom."""

    late: float
    std: float
    is_delay: bool
    residuals_um: Floats


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
