"""Measurements by one instrument, which is wrong once for all, and what looks like that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from trunnion.diagnosis.effect import Effect
from trunnion.models.parts import Acts, Part

SAME_SIZE_MM = 0.5  # of instruments: nominal sizes that differ by less are one


@dataclass(frozen=True)
class ScaleAlike:
    """One scale of all axes, as a warm machine has it, or an instrument of another length.

    axes: Their letters; empty: it is no candidate.
    of_one_kind: Whether one kind of measurement shows it, and its instrument could be wrong.
    """

    axes: str = ""
    of_one_kind: bool = False

    @property
    def id(self) -> str:
        """Id of the candidate; empty: there is none."""
        return f"scale_{self.axes}" if self.axes else ""

    @property
    def label(self) -> str:
        """What people call it."""
        return f"scale of {' and '.join(self.axes.upper())} alike"

    @property
    def scales(self) -> tuple[str, ...]:
        """Ids of the scales that it is instead of."""
        return tuple(f"scale_{axis}" for axis in self.axes)

    @property
    def why_idle(self) -> str:
        """Why a compensation leaves it out; empty: it does not."""
        if not self.of_one_kind:
            return ""
        return "without a standard it cannot be distinguished from the length of the instrument"

    def acts(self, acting: Mapping[str, Sequence[Acts]]) -> list[Acts]:
        """How it acts on each part: as the scales do."""
        return [one for id_ in self.scales for one in acting[id_]]


@dataclass
class Instruments:
    """Instruments of several measurements, with the effect that is the size of each."""

    _known: list[tuple[str, str, float, str]] = field(default_factory=list)  # kind, effect, size

    @property
    def ids(self) -> tuple[str, ...]:
        """What a joint model calls these effects."""
        return tuple(id_ for *_, id_ in self._known)

    def id_of(self, part: Part, own: Effect) -> str:
        """Id of an effect that is not the machine's: of the first part by the same instrument."""
        id_, size = f"{part.name}:{own.id}", part.model.instrument_size(own)
        if size is None:
            return id_
        for kind, effect, other, first in self._known:
            if (kind, effect) == (part.kind, own.id) and abs(other - size) < SAME_SIZE_MM:
                return first
        self._known.append((part.kind, own.id, size, id_))
        return id_

    def scale_alike(self, acting: Mapping[str, Sequence[Acts]], kinds: Sequence[str]) -> ScaleAlike:
        """Return the scale of all axes together, if that is a candidate.

        It is one cause, as a wrong instrument is, where a scale of each axis would be several. Not
        of one kind with an artefact for each date, which is not distinguished from it.

        kinds: Of the parts.
        """
        axes = "".join(a for a in "xyz" if f"scale_{a}" in acting)
        several = {kinds[one.part] for a in axes for one in acting[f"scale_{a}"]}
        shared = any(len(acting[id_]) > 1 for id_ in self.ids)
        if len(axes) < 2 or not (shared or len(several) > 1):
            return ScaleAlike()
        return ScaleAlike(axes, len(several) == 1)
