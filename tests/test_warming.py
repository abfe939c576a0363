"""Machines that warm up by no formula of the catalogue: what is said of their location errors."""

from collections import Counter

import numpy as np

import trunnion as tn
from power.study import ground
from trunnion.diagnosis.linearised import Linearised
from trunnion.diagnosis.whitening import identity
from trunnion.models.touches import build
from twin.forward import Truth
from twin.generator import measure


def test_a_place_that_is_found_later_leaves_the_others_theirs() -> None:
    """With a curve of time and readings set aside it ended in an IndexError."""
    made, twin, _, read = ground("paper")
    model = build(tn.Touches(measure(made, twin, Truth()).columns), read)
    nonlinear = [j for j, e in enumerate(model.effects) if not e.linear][:2]
    found = Linearised(model, np.asarray(model.start), identity)
    for j in nonlinear:
        effect = model.effects[j]
        values = found.values[j][0]
        moved = {p.name: values[p.name] * (1.0 if p.linear else 1.01) for p in effect.parameters}
        found = found.with_places({j: effect.values(moved.values())})
    columns: Counter[int] = Counter()
    for j, piece in found.pieces():
        columns[j] += len(piece)
    assert [columns[j] for j in nonlinear] == [len(found.values[j]) for j in nonlinear]
