"""Noise with a memory within runs of readings: what a recorder filters, what a surface waves.

Readings of a run follow each other in time or along a part. Filters of a recorder, vibrations far
slower than the readings, and the waviness of a surface make the errors of neighbours alike. Taken
for independent ones, what they draw looks like causes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import orth

from trunnion.base.resolution import NO_FLOOR, Floor
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.autoregression import Autoregression
from trunnion.diagnosis.fit import grid_values, variant_columns
from trunnion.diagnosis.likely_terms import beside_a_term, terms_one_by_one
from trunnion.diagnosis.memory import memory
from trunnion.diagnosis.model import Model
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
    SMOOTH,
    WALK,
    Kernel,
    deviance,
    fit_wander,
    penalised,
)
from trunnion.diagnosis.whitening import identity

MIN_READINGS = 6  # a column that is no noise: of fewer the fit makes neighbours alike
ROUNDS = 4  # in which places and noise settle
SAME = 1e-6  # columns of unit length
MIN_SIGMAS = 3.0  # by which neighbours are more alike than of white noise
LIKELY_SIGMAS = 2.0  # from which on slow noise competes with white noise
SCALES = (1, 2, 4)  # readings of which means are taken, where noise may be slow
MANY, PART = 4096, 512  # readings: of more, parts are taken evenly
LARGER = 1.001  # than of all readings before it, what those that are kept leave of a reading


def noise_in_runs(
    model: Model, residuals: Floats, runs: Sequence[Integers], *, slow: bool = False
) -> Callable[[Floats], Floats]:
    """Whitener of readings whose noise has a memory within a run; else they stay as they are.

    It is what is left of the residuals (n,) of the plain model when every candidate is fitted at
    once. They have a memory where neighbours are alike all along the runs, also beside structure
    without a name, and the memory makes them likelier than such structure does.

    ``runs``: row numbers of consecutive readings, together all. ``slow``: whether the noise may be
    so slow that a cause with a place, or some structure, has most of it (waviness of a surface):
    then it has to make the readings likelier than white noise beside such causes and structure.
    Slow noise of many readings is not asked for.
    """
    scales, sigmas = (SCALES, LIKELY_SIGMAS) if slow else (SCALES[:1], MIN_SIGMAS)
    single = _channel(model, sought=False)
    basis = basis_beside(residuals, single)
    left = residuals - basis @ (basis.T @ residuals)
    few = len(residuals) < MIN_READINGS * basis.shape[1]
    # a cyclic error between few readings makes neighbours less alike than by chance
    white = max(abs(memory(left, runs, scale)) for scale in scales) < MIN_SIGMAS
    if few or white or (slow and len(residuals) > MANY):
        return identity
    channel = _channel(model, sought=True)
    basis = basis_beside(residuals, channel)
    left = residuals - basis @ (basis.T @ residuals)
    exact = float(left @ left) < len(left) * float(np.max(model.readings.least)) ** 2
    if exact or max(memory(left, runs, scale) for scale in scales) < sigmas:
        return identity
    grid = grid_of(model, left, len(left) - basis.shape[1], channel.fixed)
    if grid is not None and grid.matters(float(left @ left / len(left)) ** 0.5):
        return identity  # arches of what rounding makes of a smooth curve
    segments = _segments(model, runs)
    if slow:
        noise = _slow(model, residuals, runs, channel)
    else:
        noise = _short(model, residuals, runs, segments, channel, basis)
    if noise is None or not noise.order:
        return identity
    size = noise.sizes[0]  # of a reading's noise, which is 1 µm of the readings that are made
    noise = replace(noise, sizes=tuple(float(one) / size for one in noise.sizes))
    return Whitener(tuple((rows, noise) for rows in segments))


def _short(
    model: Model,
    y: Floats,
    runs: Sequence[Integers],
    segments: Sequence[Integers],
    channel: Channel,
    basis: Floats,
) -> Autoregression | None:
    """Noise of readings y (n,); None: beside structure it is white.

    ``basis``: of what may be no noise.
    """
    left, least = y - basis @ (basis.T @ y), float(np.max(model.readings.least))
    d = Dictionary(model, np.arange(len(y)))
    found, after, _ = terms_one_by_one(d, left, basis, Floor(least**2), MAX_STRUCTURE)
    if found and memory(after, runs) < MIN_SIGMAS:
        return None
    return _Beside.of(model, y, segments, (WALK,), channel, d).grown().noise


def _slow(
    model: Model, y: Floats, runs: Sequence[Integers], channel: Channel
) -> Autoregression | None:
    """Noise of readings y (n,); None: white noise beside causes and structure is likelier."""
    d = Dictionary(model, np.arange(len(y)))
    best = _Beside.of(model, y, runs, (WALK, SMOOTH), channel, d).grown()
    if not best.noise.order:
        return None
    # a wave that is taken first leaves nothing of a jump
    for own in (channel, replace(channel, sought=())):
        if _Beside.of(model, y, runs, (), own, d).grown().score <= best.score:
            return None
    return best.noise


@dataclass(frozen=True)
class _Beside:
    """Noise of readings y (n,) beside structure without a name and all that is no noise.

    kernels: Of processes that the noise may have; of none it is white. channel: With the columns of
    the structure among those that are fixed. terms: Of the structure, by their numbers in the
    dictionary ``d``. false: Number of false readings that are no noise. noise, basis: The noise,
    and what is no noise if it is that, orthonormal. score: -2 ln L with what all costs.
    """

    model: Model
    y: Floats
    segments: Sequence[Integers]
    kernels: Sequence[Kernel]
    channel: Channel
    d: Dictionary
    terms: tuple[int, ...]
    false: int
    noise: Autoregression
    basis: Floats
    score: float

    @classmethod
    def of(
        cls,
        model: Model,
        y: Floats,
        segments: Sequence[Integers],
        kernels: Sequence[Kernel],
        channel: Channel,
        d: Dictionary,
        terms: Sequence[int] = (),
        false: int = 0,
    ) -> _Beside:
        """Noise beside some terms, and the causes that are no noise if it is that.

        From no cause on whose place is sought: beside all of them, at their best places, noise
        would have no more than half of its slow part.
        """
        blocks = [d.block(number) for number in terms]
        own = replace(channel, fixed=np.concatenate([channel.fixed, *blocks], axis=1))
        basis, sought = basis_beside(y, replace(own, sought=())), 0.0
        ranks = [x.shape[1] for x in blocks] + [2] * false
        paid = sum(float(d.chance_of(rank)) + UNNAMED_TERM_PENALTY for rank in ranks)
        for _ in range(ROUNDS):
            score, noise = _likeliest(y, basis, segments, kernels)
            before = basis
            basis, costs = likely_beside(y, own, noise, segments)
            same = basis.shape == before.shape
            if same and np.allclose(basis @ (basis.T @ before), before, atol=SAME):
                break
            sought = costs
        score += sought + paid
        what = (model, y, segments, kernels, channel, d, tuple(terms), false)
        return cls(*what, noise, before, score)

    @property
    def whiten(self) -> Whitener:
        """What makes the noise white."""
        return Whitener(tuple((rows, self.noise) for rows in self.segments))

    def grown(self) -> _Beside:
        """With false readings, which are no noise, and terms that are likely beside the noise."""
        white, basis = self._left()
        far = far_out_beside(basis, white, 0.0)
        best = self
        if len(far):
            ways = np.stack([*self.model.components.values()], axis=1)
            place = np.argsort(np.concatenate(self.segments))[:, None]
            steps = [np.where(place < place[i], 0.0, ways) for i in far]
            fixed = [self.channel.fixed, np.eye(len(self.y))[:, far], *steps]
            own = replace(self.channel, fixed=np.concatenate(fixed, axis=1))
            best = replace(self, channel=own, false=len(far))._with(self.terms)
        while len(best.terms) < MAX_STRUCTURE and (best.noise.order or not best.kernels):
            white, basis = best._left()
            d = Dictionary(self.model, np.arange(len(self.y)), best.whiten, self.d)
            term = beside_a_term(d, white, basis, NO_FLOOR)[2]
            if term is None:
                break
            other = best._with((*best.terms, term))
            if other.score >= best.score:
                break
            best = other
        return best

    def _with(self, terms: Sequence[int]) -> _Beside:
        what = (self.model, self.y, self.segments, self.kernels, self.channel, self.d)
        return _Beside.of(*what, terms, self.false)

    def _left(self) -> tuple[Floats, Floats]:
        """White noise that is left, and the basis of what is no noise, white and orthonormal."""
        basis = orth(self.whiten(self.basis))
        white = self.whiten(self.y)
        return white - basis @ (basis.T @ white), basis


def _likeliest(
    y: Floats, q: Floats, segments: Sequence[Integers], kernels: Sequence[Kernel]
) -> tuple[float, Autoregression]:
    """Likeliest noise of y beside orthonormal columns q, and its -2 ln L with what it costs.

    Of processes of these kernels beside white noise and autoregressions; of none white noise alone.
    """
    if len(y) > MANY:
        step = PART * -(-len(y) // MANY)
        parts = [rows[i : i + PART] for rows in segments for i in range(0, len(rows), step)]
        some = np.concatenate(parts)
        y, q = y[some], orth(q[some])
        ends = np.cumsum([len(rows) for rows in parts])[:-1]
        segments = np.split(np.arange(len(some)), ends)
    if not kernels:
        left = y - q @ (q.T @ y)
        size = float(left @ left / max(len(y) - q.shape[1], 1)) ** 0.5
        return deviance(Autoregression(), y, q, segments), Autoregression(sizes=(size,))
    short = fit_noise(y, q, segments)
    found = [(penalised(short, y, q, segments), short)]
    for kernel in kernels:
        noise = fit_wander(y, q, segments, kernel=kernel).noise
        score = deviance(noise, y, q, segments) + PARAMETERS * float(np.log(len(y)))
        order = int(np.argmax(np.asarray(noise.sizes) <= LARGER * noise.sizes[-1]))
        kept = Autoregression(noise.predictors[: order + 1], noise.sizes[: order + 1])
        found.append((score, kept))
    return min(found, key=lambda one: one[0])


def _segments(model: Model, runs: Sequence[Integers]) -> list[Integers]:
    """Rows of each run, in parts where the groups for cross-validation part it."""
    groups = model.groups
    parts = []
    for rows in runs:
        parts += np.split(rows, np.flatnonzero(np.diff(groups[rows])) + 1)
    return parts


def _channel(model: Model, *, sought: bool) -> Channel:
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
