"""What an effect with one nonlinear parameter explains along it, on its grid and between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.effect import Effect, Parameter, Values
from trunnion.diagnosis.gains import Variants, gains_at
from trunnion.diagnosis.grid import best_place
from trunnion.diagnosis.linearised import affine
from trunnion.diagnosis.of_some import OfSome

if TYPE_CHECKING:
    from trunnion.diagnosis.case import Case

BEYOND = 0.25  # of the drop to the lower neighbour, that a peak may be above the best of a grid
MIN_PLACES = 3  # of a grid, that has places between


def of_ratios(effect: Effect) -> Parameter | None:
    """The one parameter of an effect that is sought on a scale of ratios; None: there is none."""
    free = [p for p in effect.parameters if not p.linear]
    if len(free) != 1 or affine(effect) or min(free[0].grid) <= 0.0:  # no time, no length
        return None
    return free[0] if len(free[0].grid) >= MIN_PLACES else None


@dataclass(frozen=True, eq=False)
class Beside:
    """What else is fitted: the nuisance at which columns are made, and an orthonormal basis (n, q).

    residual: Of the whitened readings that are used, beside all (n,). keeps: Whether columns beside
    the basis are kept. more: Further directions (n, k). kept: These columns, by effect and places:
    for all that has further directions.
    """

    nuisance: Floats
    basis: Floats
    residual: Floats
    keeps: bool = False
    more: Floats | None = None
    kept: dict[tuple[str, bytes], tuple[Variants, slice] | None] = field(default_factory=dict)

    @cached_property
    def directions(self) -> Floats:
        """All that is fitted, (n, q + k)."""
        more = self.more
        return self.basis if more is None else np.concatenate([self.basis, more], axis=1)

    @property
    def rss(self) -> float:
        """Sum of squares of the residual."""
        return float(self.residual @ self.residual)


@dataclass(frozen=True, eq=False)
class Along:
    """What an effect gains beside others along its one parameter, of a scale of ratios.

    places: Some of its grid, and one between each two, ascending (m,). gains: Of each, the drop of
    the sum of squares (m,); 0 where readings do not change with the parameter (a slip's moment).
    """

    case: Case
    effect: Effect
    free: Parameter
    beside: Beside
    places: Floats
    gains: Floats
    _best: dict[int, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, case: Case, effect: Effect, free: Parameter, beside: Beside, about: Sequence[float]
    ) -> Along:
        """Gains in the cells of the grid next to some places."""
        grid = np.sort(free.grid)
        above = np.searchsorted(grid, about)
        cells = np.unique(np.clip(np.append(above - 1, above), 0, len(grid) - 2))
        low, high = grid[cells], grid[cells + 1]
        places = np.unique(np.concatenate([low, np.sqrt(low * high), high]))
        new = cls(case, effect, free, beside, places, np.zeros(len(places)))
        if not beside.keeps:
            return replace(new, gains=new.at(places)) if new.smooth else new
        columns = new._beside_common()
        if columns is None:
            return new
        variants, at = columns
        more = beside.basis[at, :0] if beside.more is None else beside.more[at]
        return replace(new, gains=variants.gains(more, beside.residual[at]))

    def _beside_common(self) -> tuple[Variants, slice] | None:
        """Columns at all places beside what is common, and of which readings they are.

        None: readings do not change with the places.
        """
        kept, key = self.beside.kept, (self.effect.id, self.places.tobytes())
        if key not in kept:
            kept[key] = None
            if self.smooth:
                own = self.columns(self.places)
                common = self.beside.basis[own.at]
                kept[key] = Variants.of(own.own.transpose(0, 2, 1), common), own.at
        return kept[key]

    @property
    def smooth(self) -> bool:
        """Whether readings change with the parameter: not with the moment of a slip."""
        middle = float(np.sqrt(self.places[0] * self.places[-1]))
        of_ones = Values({name: x or 1.0 for name, x in self.values(middle).items()})
        slopes = self.case.model.effect_jacobian(self.beside.nuisance, self.effect, of_ones)
        return bool(np.any(slopes[:, self.effect.parameters.index(self.free)]))

    def on_grid(self, place: float) -> bool:
        """Whether a place is within the grid."""
        return min(self.free.grid) <= place <= max(self.free.grid)

    def values(self, place: float) -> Values:
        """Parameters at a place, linear ones 0."""
        return self.effect.values(place if p is self.free else 0.0 for p in self.effect.parameters)

    def columns(self, places: Floats) -> OfSome:
        """White columns of the linear parameters at places, of the readings that they change."""
        every = [self.values(place) for place in places.tolist()]
        case, start = self.case, self.beside.nuisance
        known = case.linearised if start is case.linearised.nuisance else None
        made = None if known is None else known.piece(self.effect, every)
        if made is None:
            made = case.model.white_columns(start, self.effect, every, case.whiten)
        return OfSome.of(made).rows(slice(None) if case.complete else case.rows)

    def at(self, places: Floats) -> Floats:
        """Gains at places (m,)."""
        return gains_at(self.columns, places, self.beside.directions, self.beside.residual)

    def sizes(self, place: float) -> Floats:
        """Linear parameters at a place (k,)."""
        basis = self.beside.directions
        x = self.columns(np.array([place])).made(0, len(basis))
        left = x - basis @ (basis.T @ x)
        return np.asarray(np.linalg.lstsq(left, self.beside.residual, rcond=None)[0])

    def peaks(self) -> tuple[Integers, Floats]:
        """Places about which the gain has a peak, and the most that it may be there; best first."""
        g = self.gains
        before, after = np.append(g[1], g[:-1]), np.append(g[1:], g[-2])  # at an end that inside
        most = g + BEYOND * (g - np.minimum(before, after))
        most[[0, -1]] = 2 * g[[0, -1]] - g[[1, -2]]
        tops = np.flatnonzero((g >= before) & (g >= after))
        tops = tops[np.argsort(-most[tops], kind="stable")]
        return tops, most[tops]

    def best_about(self, top: int) -> tuple[float, float]:
        """Most gain between the neighbours of a place, or a step beyond the last; and where."""
        if top not in self._best:
            self._best[top] = self._sought_about(top)
        return self._best[top]

    def _sought_about(self, top: int) -> tuple[float, float]:
        x = self.places
        low = x[top - 1] if top else x[0] ** 2 / x[1]
        high = x[top + 1] if top + 1 < len(x) else x[-1] ** 2 / x[-2]
        around = np.clip([low, x[top], high], *self.free.bounds)
        place = float(np.clip(best_place(self.at, np.unique(around).tolist()), *self.free.bounds))
        return float(self.at(np.array([place]))[0]), place
