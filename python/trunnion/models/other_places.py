"""What the choice of places leaves open where measurements of one machine are at others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.effect import EffectValues, Values
from trunnion.diagnosis.joint_ids import Happened
from trunnion.models.parts import Acts, Change, Part
from trunnion.models.positioning import PositioningModel


class Joint(Protocol):
    """A model of several parts."""

    @property
    def parts(self) -> Sequence[Part]:
        """One a measurement."""
        ...

    @property
    def start(self) -> Floats:
        """Values that are always fitted."""
        ...

    def of_part(
        self, i: int, nuisance: Floats, effects: EffectValues
    ) -> tuple[Floats, Mapping[str, Values]]:
        """What is always fitted of one part, and its effects."""
        ...


def left_by_places(
    model: Joint,
    acting: Mapping[str, Sequence[Acts]],
    changes: Mapping[str, Change],
    effects: EffectValues,
) -> dict[tuple[str, str], float]:
    """Standard uncertainty of changes and differences of effects, by id and parameter.

    acting: How each shared effect acts. changes: Candidates of such, by id. effects: As fitted.
    """
    changes = {k: c for k, c in changes.items() if k in effects and c.effect}
    if not changes:
        return {}
    parts = model.parts
    own = [model.of_part(i, model.start, effects)[1] for i in range(len(parts))]
    out: dict[tuple[str, str], float] = {}
    for id_, change in changes.items():
        each = {acts.part: acts for acts in acting.get(change.effect, ())}
        if change.happened is Happened.DIFFERS:
            kind = parts[change.since].kind
            sides = [[i for i in each if parts[i].kind == kind]]
        else:
            sides = [
                [i for i in each if i < change.since][-1:],
                [i for i in each if i == change.since],
            ]
            measured = [parts[side[0]] for side in sides if side]
            if len(measured) < len(sides) or not _at_others(*measured):
                continue
        square = 0.0
        for side in filter(None, sides):
            square += float(np.mean([_left(parts[i], each[i], own[i]) ** 2 for i in side]))
        if square > 0:
            out[id_, "ppm"] = square**0.5
    return out


def _at_others(before: Part, after: Part) -> bool:
    """Whether two measurements are at different places, as two of different kinds always are."""
    return before.kind != after.kind or bool(before.model.differing(after.model))


def _left(part: Part, acts: Acts, own: EffectValues) -> float:
    """The same of an effect in one measurement, ppm: of the scale of stops, and of nothing else."""
    model = part.model
    if isinstance(model, PositioningModel) and acts.effect.id == "scale":
        return model.left_by_targets(own)
    return 0.0
