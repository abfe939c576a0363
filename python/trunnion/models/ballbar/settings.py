"""The table ``[ballbar]`` of a set-up."""

from __future__ import annotations

from dataclasses import dataclass

from trunnion.setup import Setup
from trunnion.setup.fields import Flag, Number, Section, Sign, Vector, key


@dataclass(frozen=True)
class BallbarSettings:
    """The table ``[ballbar]`` of a set-up; see the package."""

    calibrated: bool = key(True, Flag(), "the length of the ball-bar is known")
    one_bar: bool = key(
        True, Flag(), "measurements of one nominal length that are diagnosed together have one bar"
    )
    repeatability_um: float = key(0.0, Number(0.0), "standard deviation; 0: to be estimated")
    direction: tuple[float, float, float] = key(
        (0.0, 0.0, -1.0), Vector(3), "from the spindle to the tool point"
    )
    wrist: int = key(1, Sign(), "branch of the wrist of the hybrid machine")

    @classmethod
    def from_setup(cls, setup: Setup | None) -> BallbarSettings:
        """Read the table.

        Raises FileFormatError, InputError: a key that is none of them, or a value of the wrong
            kind; with its place in the file.
        """
        return Section.of("ballbar", {} if setup is None else setup.ballbar).build(cls)
