"""Files that controls and instruments write: one module a format, listed in `FORMATS`.

A format gives `Channels`: named series of values with the line that each row stands on. Which
channel is which column, the user says (`trunnion.models.read`): no format guesses it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from trunnion.files.foreign import camonitor, halsampler, halscope, levels, points, twincat
from trunnion.files.foreign.channels import Channels as Channels
from trunnion.files.text import Source


class Format(Protocol):
    """A module of this package."""

    NAME: str

    def matches(self, source: Source) -> bool:
        """Whether a file is of this format, by what stands in it."""
        ...

    def read(
        self, source: Source, wanted: Sequence[str] | None, period_s: float | None
    ) -> Channels:
        """Return the channels of a file.

        wanted: Channels that are to have common rows; None: all that the file has.
        period_s: Time between two rows, for a format that does not say.
        """
        ...


FORMATS: tuple[Format, ...] = (twincat, halscope, camonitor, levels, points, halsampler)
"""Every format; the first that matches is taken, the least marked ones last."""
