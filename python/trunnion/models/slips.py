"""The turn of an artefact that slips on the table.

The core's slip is a shift (`setup_shift`). What turns with it is fitted here: the rotation of the
placement about the table's Z, from the same moment on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.machine.effects import Owner

SLIP = "setup_shift"
TURN = "rc_arcsec"
"""Its parameter, and the placement's that it changes."""
MIN_TO_TURN = 12
"""Touches before and after a slip, from which on it turns: of fewer a turn from another moment on
explains what a shift does."""


def show_a_turn(after: NDArray[Any]) -> bool:
    """Whether there are enough touches on both sides of a slip; ``after``: 1 from it on, (n,)."""
    count = int(np.count_nonzero(after))
    return min(count, len(after) - count) >= MIN_TO_TURN


@dataclass(frozen=True)
class SlipTurn:
    """The artefact turns on the table at a moment, as an effect of touches.

    t0_s: The moment.
    """

    t0_s: float
    id: str = "setup_turn"
    label: str = "turn of the artefact on the table"
    parameters: tuple[str, ...] = (TURN,)
    owner: Owner = Owner.PLACEMENT

    def change(self, data: Any, values: Mapping[str, float]) -> NoReturn:  # noqa: ARG002
        """Refuse touches without a machine."""
        raise InputError(f"effect {self.id!r}: got touches only, expected a set-up beside them")

    def on_machine(self, machine: Any) -> FromThenOn:
        """Return what changes the readings on a machine."""
        return FromThenOn(self.t0_s, TURN, machine.placed(TURN))


@dataclass(frozen=True, eq=False)
class FromThenOn:
    """By how much readings change per unit of a parameter, ``column`` (n,), from a moment on."""

    t0_s: float
    parameter: str
    column: Floats

    def change(self, data: Any, values: Mapping[str, float]) -> Floats:
        """Change of each reading, (n,)."""
        return self.jacobian(data, values)[:, 0] * values[self.parameter]

    def jacobian(self, data: Any, _: Mapping[str, float]) -> Floats:
        """Derivative of the change, (n, 1)."""
        return np.where(np.asarray(data.time_s) >= self.t0_s, self.column, 0.0)[:, None]


def turned_apart(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a fit says of uncertainty, the turn of a slip under the name of its own."""
    one, own = f"{SLIP}.{TURN}", f"{SlipTurn.id}.{TURN}"
    names = tuple(own if name == one else name for name in fields["names"])
    std = {own if name == one else name: v for name, v in fields["std_errors"].items()}
    return {**fields, "names": names, "std_errors": std}
