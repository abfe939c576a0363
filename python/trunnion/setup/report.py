"""``[report]``: what a report says of where a measurement comes from."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from typing import Any, ClassVar

from trunnion.base.checks import instance
from trunnion.base.errors import InputError
from trunnion.setup.fields import Part, key

MAX_TEXT = 200


@dataclass(frozen=True)
class _Text:
    """One line in any language."""

    words: str = f"one line of text, at most {MAX_TEXT} characters"

    def __call__(self, what: str, value: Any) -> str:
        text = instance(what, value, str, self.words).strip()
        if len(text) > MAX_TEXT or not text.isprintable():
            raise InputError(f"{what}: got {text[:60]!r}, expected {self.words}")
        return " ".join(text.split())


@dataclass(frozen=True)
class _Day:
    """A date, or a date with its time."""

    words: str = "a date such as 2026-11-22, with the time or without"

    def __call__(self, what: str, value: Any) -> str:
        if isinstance(value, date):  # TOML has dates of its own
            return value.isoformat()
        return _Text(self.words)(what, value)


@dataclass(frozen=True)
class ReportSetup(Part):
    """What a report prints beside its results: which machine, who measured, when, with what.

    Examples
    --------
    >>> import trunnion as tn
    >>> tn.ReportSetup().table
    'report'
    """

    table: ClassVar[str] = "report"
    machine: str | None = key(None, _Text(), "maker and type of the machine")
    serial: str | None = key(None, _Text(), "its serial or inventory number")
    control: str | None = key(None, _Text(), "its control, with the version")
    operator: str | None = key(None, _Text(), "who measured")
    date: str | None = key(None, _Day(), "when it was measured")
    place: str | None = key(None, _Text(), "where the machine stands")
    instrument: str | None = key(None, _Text(), "instrument, with number and last calibration")
    remark: str | None = key(None, _Text(), "anything else that belongs in the record")
