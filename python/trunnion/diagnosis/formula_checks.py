"""What an effect by a formula refuses, by itself and on data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trunnion.base.checks import did_you_mean
from trunnion.base.errors import FileFormatError, InputError, TrunnionError
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


NEEDED: dict[str, tuple[str, ...]] = {
    "polynomial": ("number", "low", "high"),
    "wave": ("number", "low", "high"),
    "alternating": ("number", "low"),
    "harmonic": ("number", "turn"),
    "jump": ("number",),
    "local": ("number", "width", "turn"),
    "class": ("number",),
}
"""Shape → what its formula is made of: another number is another formula, so a file states it."""


def needed(effect: Any) -> tuple[str, ...]:
    """Return the fields that the formula of an effect is made of."""
    names = NEEDED[effect.shape]
    if effect.shape == "class" and not effect.unit:
        return ("at",)
    if effect.shape == "wave" and not (effect.searched or effect.from_start):
        return ("number",)
    if effect.shape == "harmonic" and effect.unit == "deg":
        return ("number",)  # a turn is 360°
    return names


def remember_places(effect: Any, places: Mapping[str, str]) -> None:
    """Let an effect know where its file states each field; it is no field, and not compared.

    places: Field → "effects.toml:8:9"; "" → its table.
    """
    object.__setattr__(effect, "_read_at", dict(places))


def wrong(effect: Any, key: str, message: str) -> TrunnionError:
    """Return the error about a field of an effect, with file, line and column if it has some."""
    places: Mapping[str, str] = getattr(effect, "_read_at", {})
    said = f"effect {effect.id!r}: {message}"
    if not places:
        return InputError(said)
    return FileFormatError(f"{places.get(key, places[''])}: {said}")


def check_dependence(effect: Any, described: Any) -> None:
    """Refuse a quantity or a direction that the data do not have.

    described: A model, or what describes data without one.
    """
    quantities = [v.name for v in described.covariates]
    if effect.covariate not in quantities:
        near = did_you_mean(effect.covariate, quantities)
        raise wrong(
            effect,
            "covariate",
            f"covariate: got {effect.covariate!r}, expected what these data have: "
            f"{', '.join(quantities)}{near}",
        )
    ways = list(described.components)
    known = f"{', '.join(ways)}, or an empty text for a change of all readings alike"
    if effect.component not in ("", *ways):
        near = did_you_mean(effect.component, ways) or (
            "" if not effect.component.startswith("angle") else " (is the set-up missing?)"
        )
        raise wrong(
            effect, "component", f"component: got {effect.component!r}, expected {known}{near}"
        )
    places = getattr(effect, "_read_at", {})
    if places and "component" not in places and len(ways) > 1:
        raise wrong(effect, "", f"got no component (was its line deleted?), expected {known}")


def check_reading_unit(effect: Any, described: Any, acting: Flags) -> None:
    """Refuse a change in another unit than that of the readings in which it acts.

    described: A model, or what describes data without one and states their unit; or that unit.
    """
    of = described
    if not isinstance(described, str):
        of = getattr(described, "reading_unit", None) or described.readings.unit
    known = {of} if isinstance(of, str) else {str(one) for one in np.asarray(of)[acting]}
    if known and effect.reading_unit not in known:
        expected = " or ".join(map(repr, sorted(known)))
        got = f"reading_unit: got {effect.reading_unit!r}, expected {expected}"
        raise wrong(effect, "reading_unit", f"{got}, the unit of the readings")


def check_waves(period: float, low: float, high: float) -> None:
    """Refuse a period that would take too many trials to be sought."""
    least = (high - low) / MAX_WAVES
    if period < least:
        raise InputError(
            f"number: got {period:g}, expected a period of at least {least:.4g}: {MAX_WAVES} waves "
            "from low to high; a period that is known: searched = false"
        )


def check_period(effect: Any, longest: float, unit: str, s: Floats) -> None:
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
        raise wrong(
            effect,
            "number",
            f"number: got a period sought up to {got} along {effect.covariate}, expected "
            f"{expected} at least: its values are {steps} apart and more, where a shorter wave "
            "looks like a longer one; a period that is known: searched = false",
        )
