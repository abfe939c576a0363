"""What the choice of places leaves open where measurements of one machine are at others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.effect import EffectValues, Values
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
        if change.of_kind:
            kind = parts[change.since].kind
            sides = [[i for i in each if parts[i].kind == kind]]
        else:
            sides = [
                [i for i in each if i < change.since][-1:],
                [i for i in each if i == change.since],
            ]
            places = [parts[side[0]].model for side in sides if side]
            if len(places) < len(sides) or not places[0].differing(places[1]):
                continue
        squares: dict[str, float] = {}
        for side in filter(None, sides):
            for name in (p.name for p in each[side[0]].effect.parameters):
                known = [_left(parts[i], own[i]).get((each[i].effect.id, name), 0.0) for i in side]
                squares[name] = squares.get(name, 0.0) + float(np.mean(np.square(known)))
        out |= {(id_, name): float(np.sqrt(x)) for name, x in squares.items() if x > 0}
    return out


def _left(part: Part, own: EffectValues) -> Mapping[tuple[str, str], float]:
    """The same of one measurement: stops alone are at targets that may be others."""
    model = part.model
    return model.left_by_targets(own) if isinstance(model, PositioningModel) else {}
