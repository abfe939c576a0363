"""A tick of the probe that touches show and the set-up does not state, or the other way round."""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from trunnion._core import Moves
from trunnion.base.recognition import on_grid, recognised
from trunnion.base.units import Floats
from trunnion.data.touches import Touches
from trunnion.probing.lateness import SAME_SIZE, Late, lateness
from trunnion.probing.model import TouchModel, rounding_um, steps_um, ticks_um
from trunnion.probing.recorded import (
    count_of_lines,
    off_looks_um,
    other_period_ms,
    recorded_um,
    servo_period_ms,
)
from trunnion.probing.result import NO_PROBE_UM
from trunnion.setup import Setup

FAR_LESS = 0.25
"""Of the errors of rounding: what readings recorded in a step scatter by at least."""

SURE_LOG = float(np.log(1e3))
"""Of odds of two ticks, from which the scatter of touches says which of them it is."""

OTHER_SIZE = 1.5
"""Times a tick, from which a fit distinguishes another by what it leaves of errors of rounding."""

DOUBT_SIGMAS = 3.0
"""Of rounding alike along each line, that touches are late by at least."""

MIN_OFF = 5
"""Degrees of freedom of ways from which on they tell that they are in no steps."""

MAX_CHANCE = 1e-6
"""That ways in the steps of a stated tick are off them as far."""


def tick_mistakes(
    data: Touches, plain: TouchModel, moves: Moves, near: Floats, beside: Floats
) -> list[str]:
    """Name a tick that the touches show and nobody stated, or that is stated and not there.

    plain: The model without effects. moves: The touches, as it knows them. near: Values of its
    parameters that fit them to first order, (p,). beside: How else they change, by causes that are
    known of, (n, k).
    """
    stated, commands = plain.setup.probe.servo_period_ms, plain.setup.resolution.linear_um
    steps, ticks = steps_um(plain.setup, data), ticks_um(plain.setup, data)
    if stated and (period := other_period_ms(data, stated, commands)):
        return [
            f"{_as_feeds(period)}, not every {stated:g} ms, of which half was taken off every "
            f"touch: probe.servo_period_ms = {period:.3g}."
        ]
    if not np.any(steps) and (period := servo_period_ms(data, commands)):
        return [
            f"{_as_feeds(period)}, and touches are {period / 2:.3g} ms late on average, which "
            f"looks like a delay of the trigger: state probe.servo_period_ms = {period:.3g}."
        ]
    fit = lateness(data, plain, moves, near, beside)
    if fit is None:
        return []
    off = np.asarray(plain.core.residuals(moves, plain.values()))
    if np.any(steps) and not np.any(ticks):
        return _finer_than_stated(data, plain.setup, fit, off)
    if np.any(ticks) and (said := _between_looks(data, plain.setup, fit)):
        return said
    return _late_by_half_a_tick(data, plain.setup, fit, off)


def _as_feeds(period_ms: float) -> str:
    """What steps say of the clock."""
    return (
        f"The steps of the touches are feed times {period_ms:.3g} ms: the control looks at the "
        f"probe every {period_ms:.3g} ms"
    )


def _finer_than_stated(data: Touches, setup: Setup, fit: Late, off: Floats) -> list[str]:
    """Say where readings scatter far less than a stated resolution allows, and lie on no grid.

    off: Readings less those of the machine of the set-up, µm, (n,).
    """
    steps, rounding, seen = steps_um(setup, data), rounding_um(setup, data), fit.scatter_um
    if float(np.std(off)) < float(np.max(steps)):  # all may round alike
        return []
    if seen > FAR_LESS * rounding or _on_grid(data, steps, off):
        return []
    return [
        f"The readings scatter by {seen:.2g} µm, far less than rounding to steps of "
        f"{steps.max():.4g} µm does ({rounding:.2g} µm): is probe.resolution_um right?"
    ]


def _between_looks(data: Touches, setup: Setup, fit: Late) -> list[str]:
    """Say where the ways from the starts are no multiples of the stated tick, with what is.

    What a control adds to the looks of its clock, a scale's noise or the digits of a file, is in
    the residuals, too: ways off the looks by far more than those scatter are of no such clock,
    however alike the contacts are.
    """
    stated = ticks_um(setup, data)
    off_um, freedom = off_looks_um(data, stated)
    ratio = (off_um / fit.scatter_um) ** 2
    if freedom < MIN_OFF or ratio < 1 or fdtrc(freedom, fit.freedom, ratio) > MAX_CHANCE:
        return []
    key, given, unit = _stated_as(setup)
    ticks = fit.ticks(stated, data)
    likely = f"Is probe.{key} right (0: the control latches the position at the trip)?"
    if fit.as_latched(ticks, stated, data):
        likely = f"Does it latch the position at the trip? Then probe.{key} = 0."
    elif ticks.min() > 0 and fit.gain(ticks, np.zeros(len(data))) > -SURE_LOG:
        likely = f"probe.{key} = {_size(ticks, setup, data):.2g} would do this."
    return [
        f"The ways of the touches from their starts are not in steps of the stated tick: they are "
        f"off by {off_um:.2g} µm (rms), and the readings scatter by {fit.scatter_um:.2g} µm. The "
        f"control does not look at the probe every {given:g} {unit}, of which half was taken off "
        f"every touch. {likely}"
    ]


def _late_by_half_a_tick(data: Touches, setup: Setup, fit: Late, off: Floats) -> list[str]:
    """Say where touches are late by half of a tick that their scatter allows.

    Of a stated tick, by half of what it is wrong by. A delay of the trigger and a wrong period make
    touches late alike; what rounding leaves is as large as the tick, and noise is as it is.

    off: Readings less those of the machine of the set-up, µm, (n,).
    """
    if not fit.is_sure:
        return []
    stated = ticks_um(setup, data)
    ticks = fit.ticks(stated, data)
    latched = bool(np.any(stated)) and fit.as_latched(ticks, stated, data)
    if latched:
        ticks = np.zeros(len(data))
    elif not ticks.min() > 0:
        return []
    finest = float((stated if latched else ticks).min())
    if _on_grid(data, stated, off) or any(
        recognised(v) > SAME_SIZE * finest for v in recorded_um(data)
    ):
        return []  # the steps themselves are seen
    # Where contacts differ by less than a tick all may round alike, up to half of it late or early,
    # and scatter less than it says: that is no sign of a coarser one.
    alike = float(np.std(off)) < float(stated.max())
    if alike and np.all(ticks > stated) and fit.scatter_um <= rounding_um(setup, data):
        return []
    gain, certain = fit.gain(ticks, stated), _beyond_rounding(data, fit, stated)
    sure = gain > SURE_LOG and not _near(ticks, stated)
    sure &= not latched or fit.scatter_um < rounding_um(setup, data)
    # A larger scatter than a probe's has other causes, unless it is what rounding leaves.
    is_probe = fit.before_um <= NO_PROBE_UM or (gain > 0 and fit.is_of(ticks))
    if not sure and (gain < -SURE_LOG or not (certain and is_probe)):
        return []
    if not np.any(stated):
        return [_no_tick_stated(fit, sure=sure)]
    return [_another_tick(data, setup, fit, ticks, sure=sure and certain and not alike)]


def _near(ticks: Floats, stated: Floats) -> bool:
    """Whether ticks are so near each other that a fit leaves about the same of their rounding."""
    least, most = np.minimum(ticks, stated), np.maximum(ticks, stated)
    return bool(np.any(most < OTHER_SIZE * least))


def _beyond_rounding(data: Touches, fit: Late, stated: Floats) -> bool:
    """Whether touches are later than those that all round alike along each line would be."""
    lines = count_of_lines(data, stated)
    by_rounding = DOUBT_SIGMAS * float(np.sqrt(np.mean(stated**2) / 12 / lines))
    return float(np.max(np.abs(fit.ticks(stated, data) - stated))) / 2 > by_rounding


def _no_tick_stated(fit: Late, *, sure: bool) -> str:
    """Say that the touches are late as a tick makes them that nothing states."""
    late = fit.late
    if fit.is_delay:
        as_clock = f"a control does that looks at the probe every {2 * late:.3g} ms"
        scatter = f"scatter as {as_clock}" if sure else f"may scatter as {as_clock}"
        return (
            f"Touches are {late:.3g} ms late on average, and {scatter}: a servo period that the "
            f"set-up does not state would do exactly this (probe.servo_period_ms = {2 * late:.2g}),"
            " and so would a delay of the trigger."
        )
    as_clock = f"a control does that looks at the probe every {2 * late:.3g} µm of the way"
    scatter = f"scatter as {as_clock}" if sure else f"may scatter as {as_clock}"
    return (
        f"Touches are {late:.3g} µm late on average, and {scatter}: a tick that the set-up does "
        f"not state would do exactly this (probe.tick_um = {2 * late:.2g}, or "
        "probe.servo_period_ms); else half of it is in a cause (probe_radius, trigger_delay), or "
        "in EZ0A and the placement."
    )


def _another_tick(data: Touches, setup: Setup, fit: Late, ticks: Floats, *, sure: bool) -> str:
    """Say that the tick is another than stated, ``ticks`` (n,), µm; 0: latched; or may be."""
    key, given, unit = _stated_as(setup)
    size, stated = _size(ticks, setup, data), ticks_um(setup, data)
    if not sure:
        late, by = abs(fit.late), "ms" if fit.is_delay else "µm"
        clock = f"that looks at the probe every {size:.2g} {unit}" if size else "that latches it"
        return (
            f"Half of the stated tick was taken off every touch, and the touches are {late:.3g} "
            f"{by} {'later' if fit.late > 0 else 'earlier'} than that on average. A delay of the "
            f"trigger or another radius of the ball does so, and a control {clock} would do "
            f"exactly this, too: is probe.{key} = {given:g} right, not {size:.2g}?"
        )
    if size == 0.0:
        allowed = rounding_um(setup, data)
        return (
            f"The readings scatter by {fit.scatter_um:.2g} µm, far less than a tick of "
            f"{stated.max():.4g} µm allows ({allowed:.2g} µm), half of which was taken off every "
            f"touch: do they come from a control that latches the position? Then probe.{key} = 0."
        )
    return (
        f"Half of the stated tick was taken off every touch, and the touches are off by what is "
        f"half of another, and scatter as a control does that looks at the probe every {size:.2g} "
        f"{unit}: probe.{key} = {size:.2g} (not {given:g}) would do exactly this."
    )


def _stated_as(setup: Setup) -> tuple[str, float, str]:
    """Key of the set-up that states the tick, its value and unit."""
    probe = setup.probe
    if probe.servo_period_ms:
        return "servo_period_ms", probe.servo_period_ms, "ms"
    return "tick_um", probe.tick_um, "µm"


def _size(ticks: Floats, setup: Setup, data: Touches) -> float:
    """Ticks (n,), µm, as the set-up states one: a period, or one of all feeds."""
    if not setup.probe.servo_period_ms:
        return float(np.mean(ticks))
    assert data.feed_mm_min is not None
    return float(np.mean(60 * ticks / data.feed_mm_min))


def _on_grid(data: Touches, steps: Floats, off: Floats) -> bool:
    """Whether ways, places, coordinates or what they are off the nominal are in these steps."""
    coordinates = (1e3 * data.position_mm).T
    return bool(np.all(steps > 0)) and any(
        on_grid(v / steps, 1.0) for v in (*recorded_um(data), *coordinates, off)
    )
