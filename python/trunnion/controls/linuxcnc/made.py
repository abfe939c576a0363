"""What a way of correcting LinuxCNC gives, before it is judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from trunnion.compensation.control import Compensation
from trunnion.controls.files import Setting

HAL = "trunnion.hal"
INI = "trunnion.ini"


@dataclass(frozen=True)
class Made:
    """Files, what they set, what they are as a compensation, what is left, what to do."""

    files: Mapping[str, str]
    settings: tuple[Setting, ...]
    compensation: Compensation
    left_out: tuple[str, ...]
    notes: tuple[str, ...]
