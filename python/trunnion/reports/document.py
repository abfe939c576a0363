"""What a report says, before it is a page: a verdict, and sections with what stands in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol, TypeAlias, runtime_checkable

from trunnion.base.report import Table
from trunnion.base.units import Integers


class Mark(StrEnum):
    """How a verdict is marked, by colour and by the words beside it."""

    GOOD = "good"
    BAD = "bad"
    DOUBT = "doubt"
    NEUTRAL = "neutral"


@runtime_checkable
class Interactive(Protocol):
    """A picture that Plotly draws: :class:`~trunnion.plot.picture.Picture`, or a scene in 3-D."""

    @property
    def title(self) -> str:
        """What it shows."""
        ...

    @property
    def note(self) -> str:
        """What stands below it."""
        ...

    @property
    def description(self) -> str:
        """Alternative text."""
        ...

    def to_plotly(self) -> dict[str, Any]:
        """Traces and layout, as plain values."""
        ...


@dataclass(frozen=True)
class Listing:
    """Text that keeps its lines: a set-up file, a command."""

    text: str


@dataclass(frozen=True)
class Points:
    """Sentences as a list, under a heading of their own if they have one."""

    sentences: tuple[str, ...]
    title: str = ""


Item: TypeAlias = "str | Table | Interactive | Listing | Points"


@dataclass(frozen=True)
class Section:
    """A part of a report under its own heading; one without items is not shown."""

    title: str
    items: tuple[Item, ...]


@dataclass(frozen=True)
class Group:
    """Readings that belong together, such as those that a cause changes: rows (m,) from 0."""

    label: str
    rows: Integers


@dataclass(frozen=True)
class Document:
    """A report.

    Attributes
    ----------
    title, subtitle
        What it is, and of which machine.
    mark, verdict
        The result in one sentence.
    top
        What people came for: results, what to do, one picture.
    sections
        The evidence, then where it comes from.
    groups
        Readings to highlight in all pictures, by key.
    """

    title: str
    subtitle: str
    mark: Mark
    verdict: str
    top: tuple[Item, ...]
    sections: tuple[Section, ...]
    groups: Mapping[str, Group] = field(default_factory=dict)
