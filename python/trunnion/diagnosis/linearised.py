"""Columns of all candidates at one point, made white."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from operator import itemgetter
from types import MappingProxyType

import numpy as np

from trunnion.base.repeats import Repeats
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats
from trunnion.diagnosis.classes import InClasses, Spread
from trunnion.diagnosis.columns import MAX_DOUBLES, Pencil, Piece, batch_numbers
from trunnion.diagnosis.effect import Effect, Values
from trunnion.diagnosis.fit import grid_values
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.of_some import OfSome, Orthonormal
from trunnion.diagnosis.whitening import Scaling, Whiten, identity


class Linearised:
    """Columns of all candidates at one point, whitened: kept of few rows, made anew of many.

    Attributes
    ----------
    values:
        Of each candidate, the parameter values of its variants (linear parameters 0).
    width:
        Count of columns that are kept.
    """

    def __init__(
        self,
        model: Model,
        nuisance: Floats,
        whiten: Whiten,
        further: Mapping[int, Values] = MappingProxyType({}),
        made: Sequence[Piece] = (),
        grids: Sequence[list[Values]] = (),
    ) -> None:
        """``further``: of some candidates with grids, one place more than those of them, in order.

        ``made``: all pieces of some of the other candidates, that need not be made again.
        ``grids``: values at all places of the grids, of each candidate.
        """
        self.model, self.nuisance, self.whiten = model, nuisance, whiten
        self.further = dict(further)
        self._grids = grids or [grid_values(effect) for effect in model.effects]
        self.values = list(self._grids)
        for j, place in further.items():
            by = itemgetter(*(p.name for p in model.effects[j].parameters if not p.linear))
            first, *_, last = map(by, self._grids[j])
            self.values[j] = sorted([*self._grids[j], place], key=by, reverse=first > last)
        self.width = sum(
            (2 if affine(effect) else len(v)) * sum(p.linear for p in effect.parameters)
            for effect, v in zip(model.effects, self.values, strict=True)
        )
        self._make = partial(_pieces, model, nuisance, whiten, self.values)
        n = len(model.readings)
        few = n < MANY_ROWS and self.width * n <= MAX_DOUBLES
        fresh = set(range(len(self.values))) - {j for j, _ in made}
        by_candidate = itemgetter(0)
        self._kept = sorted([*made, *self._make(fresh)], key=by_candidate) if few else None
        self._elsewhere: dict[str, dict[tuple[float, ...], Floats]] = {}

    def with_places(self, further: Mapping[int, Values]) -> Linearised:
        """Return the candidates, some of them at one place more, or at another one."""
        made = [(j, piece) for j, piece in self._kept or () if j not in further]
        every = {**self.further, **further}
        new = Linearised(self.model, self.nuisance, self.whiten, every, made, self._grids)
        new._elsewhere = self._elsewhere
        return new

    def place(self, id_: str) -> Values | None:
        """Return the place of an effect beside those of its grid, if there is one."""
        of = ((self.model.effects[j].id, place) for j, place in self.further.items())
        return next((place for name, place in of if name == id_), None)

    def pieces(self) -> Iterable[Piece]:
        """Give the number of a candidate and some of its variants (v, n, k), in order."""
        return self._make(range(len(self.values))) if self._kept is None else self._kept

    def columns(self, effect: Effect, values: Sequence[Values]) -> Floats | None:
        """Return :meth:`piece` of an effect that acts on all readings, (v, n, k)."""
        made = self.piece(effect, values)
        return None if isinstance(made, OfSome) else made

    def piece(self, effect: Effect, values: Sequence[Values]) -> Floats | OfSome | None:
        """White columns of an effect at these values, (v, n, k); None: none are kept.

        Those elsewhere than at places of the candidates are made once, too.
        """
        if self._kept is None:
            return None
        made = self._piece(effect, values)
        at = self._readings.get(effect.id)
        return made if at is None else OfSome(made, at)

    def _piece(self, effect: Effect, values: Sequence[Values]) -> Floats:
        """Return the same, of the readings that it acts on (v, m, k)."""
        places, known = self._known(effect.id)
        keys = [tuple(v.values()) for v in values]
        at = [places.get(key) for key in keys]
        if at == list(range(len(known))):
            return known
        made = self._made_at(
            effect, {k: v for k, v, i in zip(keys, values, at, strict=True) if i is None}
        )
        rows = [made[k] if i is None else known[i].T for k, i in zip(keys, at, strict=True)]
        return np.stack(rows).transpose(0, 2, 1)

    def _made_at(
        self, effect: Effect, values: Mapping[tuple[float, ...], Values]
    ) -> Mapping[tuple[float, ...], Floats]:
        """White columns of an effect at some values, (k, m) each, by the numbers of these."""
        made = self._elsewhere.setdefault(effect.id, {})
        if missing := {key: v for key, v in values.items() if key not in made}:
            some = [*missing.values()]
            piece = self.model.white_piece(self.nuisance, effect, some, self.whiten)
            made |= zip(missing, OfSome.of(piece).own.transpose(0, 2, 1), strict=True)
        return made

    @cached_property
    def _readings(self) -> dict[str, slice]:
        """Those that effects act on that do not act on all."""
        of_some = ((j, x) for j, x in self._kept or () if isinstance(x, OfSome | Orthonormal))
        return {self.model.effects[j].id: x.at for j, x in of_some}

    def _known(self, id_: str) -> tuple[dict[tuple[float, ...], int], Floats]:
        """White columns of an effect of which all are kept (v, m, k), and at which values each are.

        Joined where they are asked for: those of all effects take long to copy.
        """
        places, pieces = self._by_effect.get(id_, ({}, [np.zeros(0)]))
        if len(pieces) > 1:
            pieces[:] = [np.concatenate(pieces)]
        return places, pieces[0]

    @cached_property
    def _by_effect(self) -> dict[str, tuple[dict[tuple[float, ...], int], list[Floats]]]:
        """The same of each effect, in pieces."""
        pieces: dict[int, list[Floats]] = {}
        # some pieces of an effect may be what its measurement has, and others not
        others = {j for j, x in self._kept or () if not isinstance(x, np.ndarray | OfSome)}
        for j, x in self._kept or ():
            if isinstance(x, np.ndarray | OfSome) and j not in others:
                pieces.setdefault(j, []).append(OfSome.of(x).own)
        places = {j: {tuple(v.values()): i for i, v in enumerate(self.values[j])} for j in pieces}
        return {self.model.effects[j].id: (places[j], x) for j, x in pieces.items()}


def _pieces(
    model: Model,
    nuisance: Floats,
    whiten: Whiten,
    values: list[list[Values]],
    some: Collection[int],
) -> Iterator[Piece]:
    """White columns of some candidates, in order."""
    n = len(model.readings)
    for j in sorted(some):
        effect = model.effects[j]
        if name := affine(effect):
            at = np.array([v[name] for v in values[j]])
            ends = [values[j][0], values[j][-1]]
            first, last = model.white_columns(nuisance, effect, ends, whiten)
            slope = (last - first) / (at[-1] - at[0])
            yield j, Pencil(first - at[0] * slope, slope, at)
            continue
        if effect.spread is not None and n >= MANY_ROWS and _apart(whiten, effect.spread):
            yield j, _in_classes(effect.spread, values[j], whiten)
            continue
        most = max(1, batch_numbers(n) // (n * len(effect.parameters)))
        for first in range(0, len(values[j]), most):
            yield j, model.white_piece(nuisance, effect, values[j][first : first + most], whiten)


def _apart(whiten: Whiten, spread: Spread) -> bool:
    """Whether white columns of a class are zero in all others, as they are."""
    if isinstance(whiten, Repeats):
        return whiten.within(spread.label)
    return whiten is identity or isinstance(whiten, Scaling)


def _in_classes(spread: Spread, values: list[Values], whiten: Whiten) -> InClasses:
    """White columns of an effect that has sizes of its own in classes."""

    def functions(i: int) -> Floats:
        return np.asarray(whiten(spread.functions(values[i]).T)).T

    return InClasses(functions, len(values), spread.label, slice(len(spread.label)))


def affine(effect: Effect) -> str | None:
    """Name of the one parameter in which the columns of an effect are affine."""
    others = [p for p in effect.parameters if not p.linear]
    alone = len(others) == 1 and others[0].affine and len(others[0].grid) > 2
    return others[0].name if alone else None
