"""What an effect by a formula refuses, by itself and on data."""

from __future__ import annotations

from typing import Any

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Flags, Floats
from trunnion.setup.names import error_label, is_code

MAX_WAVES = 2000  # over the range of a quantity, of a period that is sought: all are tried
APART = 1e-6  # of the range, by which values are places of their own: rounding


def check_id(name: str) -> None:
    """Refuse an id that is no identifier or not one of its own."""
    if not name.isidentifier():
        raise InputError(
            f"id: got {name!r}, expected letters, digits and underscores, no digit first"
        )
    check_own_name(name)


def check_own_name(name: str) -> None:
    """Refuse the name of an error or a placement: what is found would be reported by both."""
    if is_code(name) or error_label(name) != name:
        raise InputError(
            f"id: got {name!r}, the name of an error or of a placement, expected one of its own"
        )


def check_reading_unit(name: str, unit: str, described: Any, acting: Flags) -> None:
    """Refuse a change in another unit than that of the readings in which it acts.

    described: A model, or what describes data without one and states their unit; or that unit.
    """
    of = described
    if not isinstance(described, str):
        of = getattr(described, "reading_unit", None) or described.readings.unit
    known = {of} if isinstance(of, str) else {str(one) for one in np.asarray(of)[acting]}
    if known and unit not in known:
        expected = " or ".join(map(repr, sorted(known)))
        raise InputError(
            f"effect {name!r}: reading_unit: got {unit!r}, expected {expected}, the unit of the "
            "readings"
        )


def check_waves(period: float, low: float, high: float) -> None:
    """Refuse a period that would take too many trials to be sought."""
    least = (high - low) / MAX_WAVES
    if period < least:
        raise InputError(
            f"number: got {period:g}, expected a period of at least {least:.4g}: {MAX_WAVES} waves "
            "from low to high; a period that is known: searched = false"
        )


def check_period(name: str, longest: float, quantity: str, unit: str, s: Floats) -> None:
    """Refuse a wave whose period is sought and shorter than two steps of its quantity.

    longest: Period that is sought. s: Values of the quantity where the wave acts.
    """
    values = np.unique(s)
    if len(values) < 2:
        return
    gaps = np.diff(values)
    apart = float(gaps[gaps > APART * np.ptp(values)].min())
    if longest < 2 * apart:
        got, expected, steps = (f"{x:.4g} {unit}".rstrip() for x in (longest, 2 * apart, apart))
        raise InputError(
            f"effect {name!r}: number: got a period sought up to {got} along {quantity}, expected "
            f"{expected} at least: its values are {steps} apart and more, where a shorter wave "
            "looks like a longer one; a period that is known: searched = false"
        )
