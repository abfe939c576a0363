"""Names of the hybrid machine's errors and joints."""

from __future__ import annotations

from collections.abc import Iterable

import trunnion._core as _core
from trunnion.base.errors import InputError, UnknownNameError

_PAPER, _OUTSIDE = _core.hybrid_parameters()
#: Names that stand for the paper's 17 errors, with units; which are reconstructed: `.mechanism`.
PAPER_ERRORS: tuple[str, ...] = tuple(_PAPER)
#: Names of every component at every place, with units.
OUTSIDE_ERRORS: tuple[str, ...] = tuple(_OUTSIDE)
JOINTS = ("L1_mm", "L2_mm", "L3_mm", "q4_deg", "q5_deg")


def error_names(given: Iterable[str]) -> tuple[str, ...]:
    """Return the names with units of parameters, at least one."""
    names = tuple(error_name(name) for name in given)
    if not names:
        raise InputError("parameters: got none, expected at least one")
    return names


def error_name(name: str) -> str:
    """Return the full name with unit of an error: ``e5`` → ``e5_um``.

    Raises UnknownNameError: a name that is none.
    """
    try:
        return _core.hybrid_parameter(name)
    except InputError as error:
        raise UnknownNameError(str(error)) from None
