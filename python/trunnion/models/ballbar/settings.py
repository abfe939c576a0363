"""The table ``[ballbar]`` of a set-up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trunnion.base.errors import InputError, UnknownNameError
from trunnion.setup import Setup

__all__ = ["BallbarSettings"]


@dataclass(frozen=True)
class BallbarSettings:
    """The table ``[ballbar]`` of a set-up; see the package."""

    calibrated: bool = True
    repeatability_um: float = 0.0
    direction: tuple[float, float, float] = (0.0, 0.0, -1.0)
    wrist: int = 1

    @classmethod
    def from_setup(cls, setup: Setup | None) -> BallbarSettings:
        """Read the table.

        Raises
        ------
        UnknownNameError
            A key that is none of them.
        InputError
            A value of the wrong kind.
        """
        table = {} if setup is None else dict(setup.ballbar)
        known = ("calibrated", "repeatability_um", "direction", "wrist")
        for key in table:
            if key not in known:
                raise UnknownNameError(
                    f"[ballbar] key {key!r}; expected one of: {', '.join(known)}"
                )
        if not isinstance(table.get("calibrated", True), bool):
            raise InputError(
                f"[ballbar] calibrated: got {table['calibrated']!r}, expected true, false"
            )
        sigma = table.get("repeatability_um", 0.0)
        if isinstance(sigma, bool) or not isinstance(sigma, int | float) or not sigma >= 0:
            raise InputError(f"[ballbar] repeatability_um: got {sigma!r}, expected a number ≥ 0")
        if table.get("wrist", 1) not in (1, -1):
            raise InputError(f"[ballbar] wrist: got {table['wrist']!r}, expected 1 or -1")
        way = table.get("direction", (0.0, 0.0, -1.0))
        if not isinstance(way, Sequence) or len(way) != 3:
            raise InputError(f"[ballbar] direction: got {way!r}, expected three numbers")
        if any(isinstance(w, bool) or not isinstance(w, int | float) for w in way):
            raise InputError(f"[ballbar] direction: got {way!r}, expected three numbers")
        direction = (float(way[0]), float(way[1]), float(way[2]))
        return cls(table.get("calibrated", True), float(sigma), direction, table.get("wrist", 1))
