"""``[control]``: the control that runs a probing program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from trunnion.base.checks import instance, within
from trunnion.base.errors import InputError
from trunnion.setup.fields import COORDINATE, Choice, Flag, Number, Part, Vector, key

WORK_OFFSETS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
MAX_LINE = 200
MAX_TOOL = 99_999
ACCELERATION = Number(0.0, 1e6)


@dataclass(frozen=True)
class _Line:
    """One line of a program."""

    words: str = f"one line of a program, at most {MAX_LINE} printable ASCII characters"

    def __call__(self, what: str, value: Any) -> str:
        line = instance(what, value, str, self.words).strip()
        if len(line) > MAX_LINE or not line.isascii() or not (line.isprintable() or not line):
            raise InputError(f"{what}: got {line[:60]!r}, expected {self.words}")
        return line


@dataclass(frozen=True)
class _Tool:
    """The number of a tool."""

    words: str = "the number of a tool, 0 for the tool length that is in force"

    def __call__(self, what: str, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise InputError(f"{what}: got {value!r}, expected {self.words}")
        return int(within(what, value, 0, MAX_TOOL))


@dataclass(frozen=True)
class ControlSetup(Part):
    """How the control runs a probing program: its work offset, its tool, lines of its own.

    The work offset has its origin in that of the machine frame; `centre_mm` says where that is in
    machine coordinates, so that the program can check it. Accelerations are for the planned time.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.ControlSetup(centre_mm=(210.5, 148.2, -301.0)).wcs
    'G54'
    """

    table: ClassVar[str] = "control"
    wcs: str = key(
        "G54", Choice(WORK_OFFSETS), "work offset with its origin in the machine frame's"
    )
    centre_mm: tuple[float, float, float] | None = key(
        None, Vector(3, COORDINATE), "that origin in machine coordinates, which the program checks"
    )
    linear_units: str = key(
        "mm", Choice(("mm", "inch")), "LINEAR_UNITS of LinuxCNC's INI file; programs are in mm"
    )
    pivot_mm: float | None = key(
        None, COORDINATE, "of a head: from its pivot to where the tool length is 0"
    )
    centre_tolerance_mm: float = key(1.0, Number(1e-3, 1e3), "of this check")
    rotary_offset_deg: float = key(
        0.0,
        Number(0.0, 5.0),
        "how far the work offset may shift a rotary axis: plans keep clear, the program checks it",
    )
    tool_number: int = key(0, _Tool(), "of the probe: G43 H; 0: the tool length in force is taken")
    tool_check: bool = key(True, Flag(), "stop unless a tool length is in force")
    tcp_off: str = key("", _Line(), "line that switches tool centre point control off (M429)")
    tcp_on: str = key("M428", _Line(), "line that switches it on, for --tcp")
    corrected_on: str = key(
        "M430", _Line(), "line that switches machine coordinates with corrections on"
    )
    tcp_check: bool = key(True, Flag(), "stop if it is on: at C5 X must move joint 0 alone")
    probe_on: str = key("", _Line(), "line that switches the probe on")
    probe_off: str = key("", _Line(), "line that switches it off")
    before_turn: str = key("", _Line(), "line before a rotary axis turns (unclamp)")
    after_turn: str = key("", _Line(), "line after it has turned (clamp)")
    positioning_mm_min: float = key(
        2000.0,
        Number(1e-3, 1e7),
        "feed of the way down beside the artefact, which stops on contact",
    )
    back_off_mm: float = key(0.3, Number(0.01, 100.0), "between the two passes of a touch")
    acceleration_mm_s2: float = key(0.0, ACCELERATION, "of linear axes; 0: not known")
    rotary_acceleration_deg_s2: float = key(0.0, ACCELERATION, "of rotary axes; 0: not known")
