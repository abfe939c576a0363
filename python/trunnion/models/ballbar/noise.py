"""Noise of ball-bar lengths with a memory: what a recorder filters, what shakes the machine slowly.

Readings of a run come one after the other, some milliseconds apart. Filters of the recorder and of
the transmitter, and vibrations far slower than the readings, make the errors of neighbours alike.
Taken for independent ones, what they draw round the circle looks like causes of 0.1 µm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import orth

from trunnion.base.resolution import NO_FLOOR, Floor
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.autoregression import Autoregression
from trunnion.diagnosis.fit import grid_values, variant_columns
from trunnion.diagnosis.likely_terms import beside_a_term, terms_one_by_one
from trunnion.diagnosis.memory import memory
from trunnion.diagnosis.noise import (
    MAX_STRUCTURE,
    Channel,
    Whitener,
    basis_beside,
    fit_noise,
    likely_beside,
)
from trunnion.diagnosis.outliers import far_out_beside
from trunnion.diagnosis.scan import UNNAMED_TERM_PENALTY, Dictionary
from trunnion.diagnosis.steps import grid_of
from trunnion.diagnosis.wander import (
    PARAMETERS,
    WALK,
    deviance,
    fit_wander,
    penalised,
)
from trunnion.diagnosis.whitening import identity

if TYPE_CHECKING:
    from trunnion.models.ballbar.model import BallbarModel

MIN_READINGS = 6  # a column that is no noise: of fewer the fit makes neighbours alike
ROUNDS = 4  # in which places and noise settle
SAME = 1e-6  # columns of unit length
MIN_SIGMAS = 3.0  # by which neighbours are more alike than of white noise
MANY, PART = 4096, 512  # readings: of more, parts are taken evenly
LARGER = 1.001  # than of all readings before it, what those that are kept leave of a reading


def noise_of(model: BallbarModel, residuals: Floats) -> Callable[[Floats], Floats]:
    """Whitener of readings whose noise has a memory within a run; else they stay as they are.

    It is what is left of the residuals (n,) of the plain model when every candidate is fitted at
    once. They have a memory where neighbours are alike all round the circle, also beside structure
    without a name, and the memory makes them likelier than such structure does.
    """
    runs, least = model.path.each(), float(np.max(model.readings.least))
    single = _channel(model, sought=False)
    basis = basis_beside(residuals, single)
    left = residuals - basis @ (basis.T @ residuals)
    few = len(residuals) < MIN_READINGS * basis.shape[1]
    # a cyclic error between few readings makes neighbours less alike than by chance
    if few or abs(memory(left, runs)) < MIN_SIGMAS:
        return identity
    channel = _channel(model, sought=True)
    basis = basis_beside(residuals, channel)
    left = residuals - basis @ (basis.T @ residuals)
    if float(left @ left) < len(left) * least**2 or memory(left, runs) < MIN_SIGMAS:
        return identity
    size = float(left @ left / len(left)) ** 0.5
    grid = grid_of(model, left, len(left) - basis.shape[1], channel.fixed)
    if grid is not None and grid.matters(size):  # arches of what rounding makes of a smooth curve
        return identity
    return _fitted(model, residuals, channel, basis, left) or identity


def _fitted(
    model: BallbarModel, y: Floats, channel: Channel, basis: Floats, left: Floats
) -> Whitener | None:
    """Noise of readings y (n,); None: beside structure it is white.

    ``basis``: of what may be no noise, which has ``left`` so much.
    """
    runs, least = model.path.each(), float(np.max(model.readings.least))
    d = Dictionary(model, np.arange(len(y)))
    found, after, _ = terms_one_by_one(d, left, basis, Floor(least**2), MAX_STRUCTURE)
    if found and memory(after, runs) < MIN_SIGMAS:
        return None
    best = _Beside.of(model, y, channel, d, ()).grown()
    if not best.noise.order:
        return None
    size = best.noise.sizes[0]  # of a reading's noise, which is 1 µm of the readings that are made
    noise = replace(best.noise, sizes=tuple(float(one) / size for one in best.noise.sizes))
    return replace(best, noise=noise).whiten


@dataclass(frozen=True)
class _Beside:
    """Noise of readings y (n,) beside structure without a name and all that is no noise.

    channel: With the columns of the structure among those that are fixed. terms: Of the structure,
    by their numbers in the dictionary ``d``. noise, basis: The noise, and what is no noise if it is
    that, orthonormal. score: -2 ln L with what all costs.
    """

    model: BallbarModel
    y: Floats
    channel: Channel
    d: Dictionary
    terms: tuple[int, ...]
    noise: Autoregression
    basis: Floats
    score: float

    @classmethod
    def of(
        cls, model: BallbarModel, y: Floats, channel: Channel, d: Dictionary, terms: Sequence[int]
    ) -> _Beside:
        """Noise beside some terms, and the causes that are no noise if it is that.

        From no cause on whose place is sought: beside all of them, at their best places, noise
        would have no more than half of its slow part.
        """
        segments = _segments(model)
        blocks = [d.block(number) for number in terms]
        own = replace(channel, fixed=np.concatenate([channel.fixed, *blocks], axis=1))
        basis, sought = basis_beside(y, replace(own, sought=())), 0.0
        paid = sum(float(d.chance_of(x.shape[1])) + UNNAMED_TERM_PENALTY for x in blocks)
        for _ in range(ROUNDS):
            score, noise = _likeliest(y, basis, segments)
            before = basis
            basis, costs = likely_beside(y, own, noise, segments)
            same = basis.shape == before.shape
            if same and np.allclose(basis @ (basis.T @ before), before, atol=SAME):
                break
            sought = costs
        score += sought + paid
        return cls(model, y, channel, d, tuple(terms), noise, before, score)

    @property
    def whiten(self) -> Whitener:
        """What makes the noise white."""
        return Whitener(tuple((rows, self.noise) for rows in _segments(self.model)))

    def grown(self) -> _Beside:
        """With false readings, which are no noise, and terms that are likely beside the noise."""
        white, basis = self._left()
        far = far_out_beside(basis, white, 0.0)
        best = self
        if len(far):
            ways = np.stack([*self.model.components.values()], axis=1)
            steps = [np.where(np.arange(len(ways))[:, None] < i, 0.0, ways) for i in far]
            fixed = [self.channel.fixed, np.eye(len(self.y))[:, far], *steps]
            own = replace(self.channel, fixed=np.concatenate(fixed, axis=1))
            best = self._with(own, self.terms)
        while len(best.terms) < MAX_STRUCTURE and best.noise.order:
            white, basis = best._left()
            d = Dictionary(self.model, np.arange(len(self.y)), best.whiten, self.d)
            term = beside_a_term(d, white, basis, NO_FLOOR)[2]
            if term is None:
                break
            other = best._with(best.channel, (*best.terms, term))
            if other.score >= best.score:
                break
            best = other
        return best

    def _with(self, channel: Channel, terms: Sequence[int]) -> _Beside:
        return _Beside.of(self.model, self.y, channel, self.d, terms)

    def _left(self) -> tuple[Floats, Floats]:
        """White noise that is left, and the basis of what is no noise, white and orthonormal."""
        basis = orth(self.whiten(self.basis))
        white = self.whiten(self.y)
        return white - basis @ (basis.T @ white), basis


def _likeliest(y: Floats, q: Floats, segments: Sequence[Integers]) -> tuple[float, Autoregression]:
    """Likeliest noise of y beside orthonormal columns q, and its -2 ln L with what it costs."""
    if len(y) > MANY:
        step = PART * -(-len(y) // MANY)
        parts = [rows[i : i + PART] for rows in segments for i in range(0, len(rows), step)]
        some = np.concatenate(parts)
        y, q = y[some], orth(q[some])
        ends = np.cumsum([len(rows) for rows in parts])[:-1]
        segments = np.split(np.arange(len(some)), ends)
    walk = fit_wander(y, q, segments, kernel=WALK).noise
    of_walk = deviance(walk, y, q, segments) + PARAMETERS * float(np.log(len(y)))
    short = fit_noise(y, q, segments)
    order = int(np.argmax(np.asarray(walk.sizes) <= LARGER * walk.sizes[-1]))
    walk = Autoregression(walk.predictors[: order + 1], walk.sizes[: order + 1])
    return min(
        (of_walk, walk),
        (penalised(short, y, q, segments), short),
        key=lambda one: one[0],
    )


def _segments(model: BallbarModel) -> list[Integers]:
    """Rows of each run, in parts where the groups for cross-validation part it."""
    groups = model.groups
    parts = []
    for rows in model.path.each():
        parts += np.split(rows, np.flatnonzero(np.diff(groups[rows])) + 1)
    return parts


def _channel(model: BallbarModel, *, sought: bool) -> Channel:
    """All readings with the columns that are no noise in them.

    ``sought``: with those of effects whose place is not known.
    """
    fixed, places = [model.base_jacobian(model.start)], []
    for effect in model.effects:
        if effect.linear or sought:
            columns = variant_columns(model, effect, model.start, grid_values(effect))
            fixed += [columns[0]] if effect.linear else []
            places += [] if effect.linear else [columns]
    every = np.concatenate(fixed, axis=1)
    return Channel(np.arange(len(every)), every, tuple(places), neighbours=1)
