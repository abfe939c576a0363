"""Errors of a diameter in proportion to the depth of cut, which look like causes that are not.

A part that is held at both ends bends most in its middle, as a bent slide makes it; the heat of the
cut makes it grow as a tool grows. Both are as large as the cut is deep, and of a form that hangs on
the part. In passes of one depth they look like a cause of the catalogue. In passes of different
depths about the same shape in proportion to the depth explains more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.effect import EffectValues
from trunnion.diagnosis.fit import grid_values, variant_columns
from trunnion.diagnosis.gains import left_by
from trunnion.diagnosis.model import Model

IN_PROPORTION = "an error of about its shape in proportion to the depth of cut"
DIFFERENT = 1.1  # the deepest cut over the shallowest, from which on it is seen
SIZE = 3.0  # times that of the causes in whose place it is: 1 sigma
RARE = 6.0  # of -2 ln L, by which it has to explain better: one in 20 beforehand
SLOW = ("tool_wear", "taper", "barrel", "bending", "chuck_tilt", "tool_heating")
"""Causes in whose place it may be."""
SHAPES = ("tool_heating", "barrel", "taper")
"""Those whose shapes it may have, beside that of the cause itself: what heats and bends a part."""
EVERY = 4  # place of a grid
TOGETHER = 3  # causes in whose place one error may be
TINY = 1e-300


def in_proportion(model: Model, depth: Floats, effects: EffectValues) -> Mapping[str, Floats]:
    """What may act in proportion to the depth of cut (n,) in the place of some effects of a fit.

    In words: columns of 1 sigma, (n, k); none where it explains no more than these.
    """
    acting = [e for e in model.effects if e.id in effects]
    slow = [e.id for e in acting if e.id in SLOW]
    n = len(depth)
    if depth.min() <= 0 or depth.max() < DIFFERENT * depth.min() or not slow:
        return {IN_PROPORTION: np.zeros((n, 0))}
    own = {e.id: model.effect_jacobian(model.start, e, effects[e.id]) for e in acting}
    changes = {e.id: np.asarray(e.change(effects[e.id])) for e in acting}
    deep = (depth / depth[0])[:, None]
    shapes = [x * deep for x in _shapes(model)]
    best = dict[str, tuple[float, Floats]]()
    small = _small(model, own, changes, deep, shapes)
    for count in range(1, min(len(slow), TOGETHER) + 1):
        for names in combinations(slow, count):
            alike = np.column_stack([own[name] for name in names]) * deep
            size = SIZE * max(float(np.ptp(changes[name])) for name in names)
            for gain, columns in zip(small.gains(names), [alike, *shapes], strict=True):
                for name in names:
                    if gain > best.get(name, (RARE,))[0]:
                        spread = np.maximum(np.ptp(columns, axis=0), TINY)
                        best[name] = gain, columns * (size / spread)
    found = {columns.tobytes(): columns for _, columns in best.values()}
    return {IN_PROPORTION: np.concatenate([np.zeros((n, 0)), *found.values()], axis=1)}


def _shapes(model: Model) -> list[Floats]:
    """Columns (n, k) of what heats and bends a part, at some of the places of each."""
    some = (e for e in model.effects if e.id in SHAPES)
    made = (variant_columns(model, e, model.start, grid_values(e)[::EVERY]) for e in some)
    return [columns for places in made for columns in places]


@dataclass(frozen=True)
class _Small:
    """All that is compared, in as many rows as there are columns, which leaves sums of squares.

    base: Of what is always fitted. own, alike: Of each cause, and in proportion to the depth.
    shapes: In proportion to it. left: Of readings by all causes. changes: By each. n: Readings.
    """

    base: Floats
    own: Mapping[str, Floats]
    alike: Mapping[str, Floats]
    shapes: Sequence[Floats]
    left: Floats
    changes: Mapping[str, Floats]
    n: int

    def gains(self, names: Sequence[str]) -> list[float]:
        """Of -2 ln L, by the shapes of some causes in proportion to the depth, and by others."""
        y = self.left + sum(self.changes[name] for name in names)
        beside = [self.base, *(x for name, x in self.own.items() if name not in names)]
        mine = np.column_stack([self.own[name] for name in names])
        before = left_by(np.column_stack([*beside, mine]), y)
        alike = np.column_stack([self.alike[name] for name in names])
        out = []
        for tried in (alike, *self.shapes):
            after = max(left_by(np.column_stack([*beside, tried]), y), TINY)
            paid = max(tried.shape[1] - mine.shape[1], 0) * np.log(self.n)
            paid += 2.0 * np.log(1 + len(self.shapes))
            out.append(self.n * float(np.log(max(before, TINY) / after)) - float(paid))
        return out


def _small(
    model: Model,
    own: Mapping[str, Floats],
    changes: Mapping[str, Floats],
    deep: Floats,
    shapes: Sequence[Floats],
) -> _Small:
    """Triangle of all columns: own, changes of causes; shapes in proportion to the depth."""
    base = model.base_jacobian(model.start)
    left = model.readings.values - model.predict(model.start, {}) - sum(changes.values())
    every = [base, *own.values(), *(x * deep for x in own.values()), *shapes]
    every += [left[:, None], *(x[:, None] for x in changes.values())]
    corner = np.linalg.qr(np.column_stack(every), mode="r")
    ends = np.cumsum([x.shape[1] for x in every])[:-1]
    parts = iter(np.split(np.asarray(corner), ends, axis=1))
    return _Small(
        base=next(parts),
        own={name: next(parts) for name in own},
        alike={name: next(parts) for name in own},
        shapes=[next(parts) for _ in shapes],
        left=next(parts)[:, 0],
        changes={name: next(parts)[:, 0] for name in changes},
        n=len(left),
    )
