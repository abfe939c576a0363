"""Values on the command line: names with numbers, lists and ranges."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

import typer

from trunnion.base.errors import InputError
from trunnion.base.input import listed_numbers

Angles = Annotated[str, typer.Option(help="0,90,180 or first:last:step, degrees")]


def names(text: str) -> list[str]:
    """Return ``"drift_z, scale_x"`` as a list."""
    return [part.strip() for part in text.split(",") if part.strip()]


def sensible(what: str, value: float, name: str) -> float:
    """Return a number that some machine may have, by the unit that its name ends in.

    Raises InputError: one that is not finite, or far beyond; `what` begins the message.
    """
    from trunnion.base.units import unit_of
    from trunnion.files.columns import LARGEST

    unit = unit_of(name)
    limit = LARGEST.get(unit, LARGEST[""])
    if not abs(value) <= limit:
        raise InputError(
            f"{what}: got {value:g}, expected {f'a number within ±{limit:g} {unit}'.rstrip()}"
        )
    return value


def named_values(what: str, texts: Iterable[str] | None) -> dict[str, float]:
    """Return ``["EX0C=15", "EB0C=25.2"]`` as a dict.

    Raises InputError: text that is not name=number, or a name given twice.
    """
    found: dict[str, float] = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        if name.strip() in found:
            raise InputError(f"{what}: got {name.strip()!r} twice, expected it once")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            equals = ""
        if not equals:
            mark = " with a decimal point" if "," in value else ""
            raise InputError(f"{what}: got {text!r}, expected name=number{mark}")
        sensible(f"{what} {name.strip()}", found[name.strip()], name.strip())
    return found


def exactly(what: str, text: str, count: int) -> list[float]:
    """Return numbers, as many as `count` says."""
    values = listed_numbers(what, text)
    if len(values) != count:
        raise InputError(f"{what}: got {text!r}, expected {count} numbers separated by commas")
    return values
