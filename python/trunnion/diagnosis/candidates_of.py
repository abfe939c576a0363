"""The candidates of a case: their columns, what is stated of them, what they gain by rounding."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import orth

from trunnion.base.resolution import inflation
from trunnion.base.units import Floats
from trunnion.diagnosis.candidates import DEPENDENT_INCOMPLETE, Candidates
from trunnion.diagnosis.columns import Columns
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.fit import Fit, first_values, variant_columns
from trunnion.diagnosis.noise import Whitener
from trunnion.diagnosis.whitening import Whiteners

if TYPE_CHECKING:
    from trunnion.diagnosis.case import Case

RARE_LEVEL = 1e-12  # at which a rare effect is named
TINY = 1e-300


def candidates_of(case: Case) -> Candidates:
    """Return the candidates beside the plain fit of a case, at the places of its columns."""
    pieces = ((j, _used(case, x)) for j, x in case.linearised.pieces())
    numbers = case.linearised.width * len(case.rows)
    own = np.array([float(e.expected) or e.level or RARE_LEVEL * e.rare for e in case.effects])
    among = np.array([e.among for e in case.effects])
    sought = np.array([e.sought for e in case.effects])
    alone = frozenset(j for j, values in enumerate(case.values) if len(values) == 1)
    low = [[p.bounds[0] for p in e.parameters if p.linear] for e in case.effects]
    positive = frozenset(j for j, bounds in enumerate(low) if bounds == [0.0])
    found = Candidates.of_pieces(
        pieces, len(case.effects), numbers, case.plain.basis, own, among, sought,
        _stated(case), alone, positive,
    )  # fmt: skip
    numbers_of = {e.id: j for j, e in enumerate(case.effects)}
    found.apart = frozenset(
        1 << j | 1 << numbers_of[other]
        for j, e in enumerate(case.effects)
        for other in e.instead_of
    )
    found.near_any = frozenset(j for j, e in enumerate(case.effects) if e.near_any)
    found.several, found.together = isinstance(case.whiten, Whiteners), case.model.together
    if case.dependent:
        found.dependent = DEPENDENT_INCOMPLETE
    return _weighed(case, found)


def with_places(case: Case, c: Candidates, further: Mapping[int, Values]) -> Candidates:
    """Return the candidates of a case, some at one place more or at another one, as its columns."""
    before = case.linearised
    case.linearised = before.with_places(further)
    more = {}
    for j, place in further.items():
        effect = case.effects[j]
        white = case.model.white_piece(before.nuisance, effect, [place], case.whiten)
        more[j] = case.values[j].index(place), _used(case, white)
    again = {j: place for j, place in before.further.items() if j in further}
    gone = {j: before.values[j].index(place) for j, place in again.items()}
    return _weighed(case, c.with_variants(more, gone))


def _used(case: Case, columns: Columns) -> Columns:
    """Columns in the readings that are used."""
    rows = slice(None) if case.complete else case.rows
    return columns[:, rows] if isinstance(columns, np.ndarray) else columns.rows(rows)


def _weighed(case: Case, c: Candidates) -> Candidates:
    """Raise the prices of candidates by rounding, and weigh them by what wanders."""
    c.inflate(_inflation(case, c))
    if isinstance(case.whiten, Whitener) and case.whiten.wandering:
        c.kept = _beside_wander(case, case.whiten, c)
    return c


def _beside_wander(case: Case, whiten: Whitener, c: Candidates) -> Floats:
    """Of the squared columns of each block, mean, what the wander of some readings leaves (b,)."""
    quiet, nuisance = whiten.without_wander(), case.plain.nuisance
    beside = orth(np.asarray(quiet(case.model.jacobian(nuisance, {})))[case.rows])
    wandering = case.rows[np.concatenate(case.wandering)]
    out = np.ones(len(c.owner))
    for j in np.unique(c.owner).tolist():
        own = np.flatnonzero(c.owner == j)
        places = [case.values[j][v] for v in c.variant[own].tolist()]
        columns = partial(case.model.white_columns, nuisance, case.effects[j])
        if not np.any(columns(places[:1], quiet)[0, wandering]):
            continue
        left = []
        for white, basis in ((whiten, case.plain.basis), (quiet, beside)):
            x = columns(places, white)[:, case.rows]
            x = x - basis @ (basis.T @ x)
            left.append(np.einsum("vnk,vnk->vk", x, x))
        out[own] = np.mean(left[0] / np.maximum(left[1], TINY), axis=1)
    return np.minimum(out, 1.0)


def _inflation(case: Case, c: Candidates) -> Floats:
    """How many times more each block of candidates gains by rounding than by noise.

    A cause that was found is judged by the machine without the weakest of those, any other one by
    the machine with all of them.
    """

    def on(machine: Fit | None) -> Floats:
        drawn = case.errors_of_rounding(machine)
        if drawn is None:
            return np.ones(len(c.owner))
        return inflation(c.gains, case.left_of(drawn, case.plain), c.rank, c.chance)

    if case.likely is None or case.found is None or case.likely is case.found:
        return on(case.likely)
    known = [j for j, effect in enumerate(case.effects) if effect.id in case.found.effects]
    return np.where(np.isin(c.owner, known), on(case.likely), on(case.found))


def _stated(case: Case) -> dict[int, float]:
    """What is stated of candidates, as the standard deviation along their unit columns."""
    sizes: dict[int, float] = {}
    start = case.plain.nuisance
    for j, effect in enumerate(case.effects):
        if effect.stated is not None:
            column = variant_columns(case.model, effect, start, [first_values(effect)])[0]
            white = case.white(column)
            free = white - case.plain.basis @ (case.plain.basis.T @ white)
            sizes[j] = effect.stated.std * float(np.linalg.norm(free))
    return sizes
