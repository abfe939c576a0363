"""What a way of correcting LinuxCNC gives, before it is judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from trunnion.compensation.control import Compensation
from trunnion.compensation.machine import MachineErrors
from trunnion.controls.files import Setting

HAL = "trunnion.hal"
INI = "trunnion.ini"


@dataclass(frozen=True)
class Made:
    """Files, what they set, the errors that they hold or the compensation that they are.

    notes: What to do, in order.
    left_out: What cannot be held, with the reason; by effect in `reasons`.
    between: Errors that tables leave between their nodes.
    remaining: What `held` meets, where that is a compensation beside tables; None: all errors.
    """

    files: Mapping[str, str]
    settings: tuple[Setting, ...]
    held: MachineErrors | Compensation
    notes: tuple[str, ...]
    left_out: tuple[str, ...] = ()
    reasons: Mapping[str, str] = field(default_factory=dict)
    between: Mapping[str, float] = field(default_factory=dict)
    remaining: MachineErrors | None = None
