"""Measurements by one instrument, which is wrong once for all, and what looks like that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from trunnion.diagnosis.effect import Effect
from trunnion.models.parts import Acts, Part

SAME_SIZE_MM = 0.5  # of instruments: nominal sizes that differ by less are one


@dataclass(frozen=True)
class ScaleAlike:
    """One scale of all axes together, which looks like an instrument of another length.

    axes: Their letters; empty: it is no candidate.
    has_standard: Whether something beside the instrument shows the scale of one of them.
    """

    axes: str = ""
    has_standard: bool = False

    @property
    def id(self) -> str:
        """Id of the candidate; empty: there is none."""
        return f"scale_{self.axes}" if self.axes else ""

    @property
    def label(self) -> str:
        """What people call it."""
        return f"scale of {' and '.join(self.axes.upper())} alike"

    @property
    def why_idle(self) -> str:
        """Why a compensation leaves it out."""
        if self.has_standard:
            return "give it to the compensation as the scale of each of these axes"
        return "without a standard it cannot be distinguished from the length of the instrument"

    def acts(self, acting: Mapping[str, Sequence[Acts]]) -> list[Acts]:
        """How it acts on each part: as the scales do."""
        return [one for a in self.axes for one in acting[f"scale_{a}"]]


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

    def scale_alike(self, acting: Mapping[str, Sequence[Acts]]) -> ScaleAlike:
        """Return the scale of all axes together, if that is a candidate.

        Only where several measurements are by one instrument, which is one cause beside a scale of
        each axis, and where nothing else shows the scale of some axis.
        """
        own = [acting[id_] for id_ in self.ids]
        axes = "".join(a for a in "xyz" if f"scale_{a}" in acting)
        by = {one.part for acts in own for one in acts}
        shown = [a for a in axes if any(one.part not in by for one in acting[f"scale_{a}"])]
        if len(axes) < 2 or len(shown) == len(axes) or all(len(acts) == 1 for acts in own):
            return ScaleAlike()
        return ScaleAlike(axes, bool(shown))
