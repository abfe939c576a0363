"""Autoregressive noise of readings in channels, estimated beside what is not noise.

A channel is a part of the readings with a noise of its own (an axis of a log). Its noise is an
autoregression, estimated by restricted likelihood from what known columns cannot explain. What the
engine would report as unexplained structure (a jump, a wave) competes with the memory of the noise
at the engine's price, and is not taken for noise.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.special import chdtri

from trunnion.base.resolution import SEED
from trunnion.base.units import Floats as Array
from trunnion.base.units import Integers as IntArray
from trunnion.diagnosis.autoregression import (
    Autoregression,
    levinson,
    partial_autocorrelations,
    predicted_off,
)
from trunnion.diagnosis.dependence import changes, length
from trunnion.diagnosis.gains import gains_beside
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.scan import SCAN_LEVEL, UNNAMED_TERM_PENALTY, Dictionary
from trunnion.diagnosis.wander import (
    Wander,
    deviance,
    fit_wander,
    innovations_beside,
    penalised,
    price_of_wander,
)

MAX_ORDER = 6
MAX_STRUCTURE = 4  # terms of unexplained structure in a channel
STATED_STRUCTURE = 1  # terms of it that are stated beside causes
MAX_TRIED = 2  # terms tried at each step
MEMORY_SIGMAS = 1.0  # by which an estimated memory of the noise is taken longer
DEPENDENT, WANDERING = "dependent", "wandering"
MIN_NOISE = 1e-6  # µm, arcsec: rounding of numbers


@dataclass(frozen=True, eq=False)
class Channel:
    """Readings of one noise, and what in them need not be noise.

    Attributes
    ----------
    rows:
        Its readings, in order, shape (n,).
    fixed:
        Columns of which any combination may be in the readings, shape (n, k).
    sought:
        Sets of columns, shape (places, n, k), of each of which one place may be.
    component:
        Its name among the model's components.
    rounding:
        What rounding makes of each reading for certain, shape (n,); None: nothing.
    growth:
        How many readings that depend on each other count as one.
    white:
        Whether its noise is taken as white, for nothing is known of its memory: ``growth`` counts.
    memory:
        Of such noise, readings that may count as one: what has a longer memory is no such noise.
    neighbours:
        Places on either side of one that is taken, of which columns are taken as well: the true
        one is between them.
    """

    rows: IntArray
    fixed: Array
    sought: tuple[Array, ...] = ()
    component: str = ""
    rounding: Array | None = None
    growth: float = 1.0
    white: bool = False
    memory: float = np.inf
    neighbours: int = 0

    def noisy(self, residuals: Array) -> Array:
        """Residuals (n,) with white noise of the same size in place of what rounding makes."""
        if self.rounding is None:
            return residuals
        size = float(np.sqrt(np.mean(self.rounding**2)))
        white = np.random.default_rng(SEED).standard_normal(len(residuals))
        return residuals - self.rounding + size * white


@dataclass(frozen=True, eq=False)
class Whitener:
    """Linear map (n, ...) → (n, ...) after which the noise is white and of size 1.

    filters: Consecutive readings, and their noise.
    dependent: Filters of readings whose residual is no stationary noise
        (:mod:`.dependence`): they are divided by the root of their long-run variance.
    wandering: Filters of readings that wander as no cause and no term does (:mod:`.wander`).
    """

    filters: tuple[tuple[IntArray, Autoregression], ...]
    dependent: tuple[int, ...] = ()
    wandering: tuple[int, ...] = ()

    def without_wander(self) -> "Whitener":
        """Return the map where readings that wander have their white noise only."""
        filters = list(self.filters)
        for i in self.wandering:
            rows, noise = filters[i]
            filters[i] = rows, Autoregression(sizes=noise.sizes[-1:])
        return replace(self, filters=tuple(filters), wandering=())

    def without(self, some: IntArray) -> "Whitener":
        """Return the map by which some readings act on no other one.

        The memory of the noise ends at each of them, and begins anew after it.
        """
        filters: list[tuple[IntArray, Autoregression]] = []
        marked: dict[str, list[int]] = {DEPENDENT: [], WANDERING: []}
        for i, (rows, noise) in enumerate(self.filters):
            out = np.flatnonzero(np.isin(rows, some))
            parts = [x for x in np.split(rows, np.union1d(out, out + 1)) if len(x)]
            for mark, of in ((DEPENDENT, self.dependent), (WANDERING, self.wandering)):
                if i in of:
                    marked[mark] += range(len(filters), len(filters) + len(parts))
            filters += [(part, noise) for part in parts]
        return Whitener(tuple(filters), tuple(marked[DEPENDENT]), tuple(marked[WANDERING]))

    def __call__(self, values: Array) -> Array:
        """Whiten each column; readings where all columns are zero stay so."""
        flat = values.reshape(len(values), -1)
        out = np.zeros_like(flat, dtype=np.float64)
        for rows, noise in self.filters:
            own = flat[rows]
            if own.any():
                out[rows] = noise.whiten(own)
        return out.reshape(values.shape)


def whitener(
    model: Model,
    residuals: Array,
    channels: Iterable[Channel],
    groups: IntArray,
    *,
    all_dependent: bool = False,
) -> Whitener:
    """Noise of each channel, as left when all that need not be noise is fitted at once.

    An effect is thus not mistaken for noise; what the fit takes of the noise is allowed for. Where
    the residual has a memory, unexplained structure is fitted too if that explains more, or a
    wander of no known form. What is no stationary noise gets its long-run variance and no
    autoregression.

    Parameters
    ----------
    model:
        Its covariates and components say what unexplained structure may look like.
    residuals:
        Of the plain model, shape (n,).
    channels:
        Together, all readings.
    groups:
        Group of each reading, shape (n,): the noise has no memory from one to another.
    all_dependent:
        Take no residual for stationary noise.
    """
    filters: list[tuple[IntArray, Autoregression]] = []
    marked: dict[str, list[int]] = {DEPENDENT: [], WANDERING: []}
    terms: dict[str, list[Array]] = {}
    every_least = np.broadcast_to(np.asarray(model.readings.least), len(residuals))

    def unnamed(channel: Channel) -> list[Array]:
        terms.update({} if terms else structure_terms(model))
        return [x[channel.rows] for x in terms[channel.component]]

    for channel in channels:
        least = float(np.max(every_least[channel.rows], initial=MIN_NOISE))
        y, own_groups = channel.noisy(residuals[channel.rows]), groups[channel.rows]
        segments = [np.flatnonzero(own_groups == g) for g in np.unique(groups)]
        segments = [s for s in segments if len(s)]
        q = _absorbed(y, channel, Autoregression(), segments)
        series = [(y - q @ (q.T @ y))[s] for s in segments]
        mark = ""
        if sum(float(x @ x) for x in series) < len(y) * least**2:
            noise = Autoregression(sizes=(least,))  # what is left is no evidence of a memory
        elif channel.white and length(series) <= channel.memory:
            size = sum(float(x @ x) for x in series) / max(len(y) - q.shape[1], 1)
            noise = Autoregression(sizes=(size**0.5,))
        elif all_dependent or channel.white:
            noise, mark = _long_run_noise(series, q.shape[1]), DEPENDENT
        else:
            noise, mark = _noise(y, q, channel, segments, unnamed)
        if mark:
            marked[mark] += range(len(filters), len(filters) + len(segments))
        # What is dependent counts as fewer readings already.
        growth = channel.growth / (length(series) if mark == DEPENDENT else 1.0)
        if growth > 1.0:
            sizes = tuple(growth**0.5 * size for size in noise.sizes)
            noise = Autoregression(noise.predictors, sizes)
        filters += [(channel.rows[s], noise) for s in segments]
    return Whitener(tuple(filters), tuple(marked[DEPENDENT]), tuple(marked[WANDERING]))


def _noise(
    y: Array,
    q: Array,
    channel: Channel,
    segments: Sequence[IntArray],
    unnamed: Callable[[Channel], Sequence[Array]],
) -> tuple[Autoregression, str]:
    """Noise of a channel beside columns q, and whether it is dependent or wandering.

    ``unnamed``: columns of unexplained structure that a channel may have.
    """
    left = y - q @ (q.T @ y)
    series = [left[s] for s in segments]
    white, order = innovations(series)
    changing = changes(white)
    # White noise beside a wander is no autoregression of first order.
    wander = fit_wander(y, q, segments) if order > 1 else None
    if changing and (wander is None or changes(innovations_beside(wander.noise, y, q, segments))):
        return _long_run_noise(series, q.shape[1]), DEPENDENT
    noise = fit_noise(y, q, segments)
    if noise.order:  # beside noise with a memory another place may fit best
        beside = _absorbed(y, channel, noise, segments)
        terms = [] if changing else unnamed(channel)
        if wander is not None:
            # Of more structure than can be stated causes would be named for a part.
            score = fit_noise_beside_structure(y, beside, segments, terms, STATED_STRUCTURE)[1]
            below = score - price_of_wander(len(y))
            if deviance(wander.noise, y, q, segments) < below:
                slow = _wander(y, channel, segments, wander, below)
                if slow is not None and not (changing and changes(slow[1])):
                    return slow[0], WANDERING
        if not changing:
            noise, _ = fit_noise_beside_structure(y, beside, segments, terms)
    if changing:
        return _long_run_noise(series, q.shape[1]), DEPENDENT
    return noise, ""


def _wander(
    y: Array, channel: Channel, segments: Sequence[IntArray], start: Wander, below: float
) -> tuple[Autoregression, Array] | None:
    """Noise of readings that wander, innovations; None where -2 ln L is not below a value.

    A wave of the best of many places is much of any wander: such columns have to pay for the place.
    """
    found: list[tuple[float, Autoregression, Array]] = []
    for sought in (channel.sought, ()) if channel.sought else ((),):
        own = replace(channel, sought=sought)
        for _ in range(2):  # another place may fit best beside it
            q = _absorbed(y, own, start.noise, segments)
            start = fit_wander(y, q, segments, start.place)
        paid = sum(float(chdtri(x.shape[2], SCAN_LEVEL / len(x))) for x in sought)
        found.append((deviance(start.noise, y, q, segments) + paid, start.noise, q))
    score, noise, q = min(found, key=lambda one: one[0])
    return (noise, innovations_beside(noise, y, q, segments)) if score < below else None


def innovations(series: Sequence[Array]) -> tuple[Array, int]:
    """What an autoregression leaves of series, one after the other; its order."""
    ar = _autoregression(series)
    parts = [predicted_off(x[:, None], ar, len(ar))[:, 0] for x in series if len(x) > len(ar)]
    return np.concatenate(parts) if parts else np.zeros(0), len(ar)


def _long_run_noise(series: Sequence[Array], fitted: int) -> Autoregression:
    """White noise of the long-run variance of residuals of so many fitted columns."""
    n = sum(len(x) for x in series)
    variance = sum(float(x @ x) for x in series) / max(n - fitted, 1)
    return Autoregression(sizes=(max(float(np.sqrt(length(series) * variance)), MIN_NOISE),))


def structure_terms(model: Model) -> dict[str, list[Array]]:
    """Unexplained structure that each component may have, the engine's own: columns (n, k)."""
    dictionary = Dictionary(model, np.arange(len(model.readings)))
    return {
        name: [
            dictionary.block(i)
            for i, term in enumerate(dictionary.terms)
            if term.component == name or term.kind == "class"
        ]
        for name in model.components
    }


# --- one channel


def fit_noise(y: Array, q: Array, segments: Sequence[IntArray]) -> Autoregression:
    """Noise of readings y (n,) of which columns q (n, k), orthonormal, may be no noise.

    The order is the one that BIC takes for what q leaves. Its coefficients maximise the restricted
    likelihood (of what no q can change): those of the residual itself would be too small, for q
    takes most of the slow part of the noise. Their memory is then taken `MEMORY_SIGMAS` longer.

    ``segments``: row numbers of consecutive readings; the memory ends where one ends.
    """
    residual = y - q @ (q.T @ y)
    start = _autoregression([residual[s] for s in segments])
    order = len(start)
    both = np.concatenate([q, y[:, None]], axis=1)
    count = sum(max(len(s) - order, 0) for s in segments) - q.shape[1]

    def triangle(ar: Array) -> Array:
        white = [predicted_off(both[s], ar, order) for s in segments if len(s) > order]
        corner = np.asarray(np.linalg.qr(np.concatenate(white), mode="r"), dtype=np.float64)
        return np.asarray(np.abs(np.diag(corner)))

    def cost(z: Array) -> float:
        d = np.maximum(triangle(levinson(np.tanh(z))[-1]), 1e-300)
        return float(2 * count * np.log(d[-1]) + 2 * np.sum(np.log(d[:-1])))

    partial = np.clip(partial_autocorrelations(start), -0.999, 0.999)
    if order:
        from scipy.optimize import minimize  # takes 0.1 s to load

        z = np.asarray(minimize(cost, np.arctanh(partial), method="BFGS").x)
        partial = np.tanh(z + MEMORY_SIGMAS * _longer(cost, z))
    predictors = levinson(partial)
    size = max(float(triangle(predictors[-1])[-1]) / np.sqrt(max(count, 1)), MIN_NOISE)
    left = np.cumprod((1.0 / np.sqrt(1.0 - np.minimum(partial**2, 1 - 1e-12)))[::-1])[::-1]
    return Autoregression(predictors, (*(size * left).tolist(), size))


def fit_noise_beside_structure(
    y: Array,
    q: Array,
    segments: Sequence[IntArray],
    terms: Sequence[Array],
    most: int = MAX_STRUCTURE,
) -> tuple[Autoregression, float]:
    """Noise of y where unexplained structure may be beside q, a term at a time; its -2 ln L.

    The likelihood is penalised by what the terms and the memory of the noise cost. A term is taken
    if it makes readings likelier than noise with a longer memory does, by the price that the engine
    asks for it.
    """

    def score(basis: Array) -> tuple[float, Autoregression]:
        noise = fit_noise(y, basis, segments)
        both = np.concatenate([basis, y[:, None]], axis=1)
        white = np.concatenate([noise.whiten(both[s])[MAX_ORDER:] for s in segments])
        left = float(np.abs(np.asarray(np.linalg.qr(white, mode="r"))[-1, -1])) * noise.sizes[-1]
        return (
            len(white) * 2 * np.log(max(left, 1e-300)) + noise.order * np.log(len(white)),
            noise,
        )

    best, noise = score(q)
    paid = 0.0
    for _ in range(most if terms else 0):
        if not noise.order:
            break
        residual = y - q @ (q.T @ y)
        seen = [x - q @ (q.T @ x) for x in terms]
        own = [_basis(x) if np.any(np.abs(x) > 1e-6) else np.zeros((len(y), 0)) for x in seen]
        gain = [float(np.sum((x.T @ residual) ** 2)) for x in own]
        tried = []
        for i in np.argsort(gain)[::-1][:MAX_TRIED]:
            wider = np.concatenate([q, own[i]], axis=1)
            price = float(chdtri(max(own[i].shape[1], 1), SCAN_LEVEL / len(terms)))
            price += UNNAMED_TERM_PENALTY
            tried.append((*score(wider), price, wider))
        value, other, price, wider = min(tried, key=lambda t: t[0] + t[2])
        if value + price >= best:
            break
        best, noise, q, paid = value, other, wider, paid + price
    return noise, penalised(noise, y, q, segments) + paid


# --- autoregressions


def _autoregression(series: Sequence[Array]) -> Array:
    """Coefficients of an autoregression, of the order that BIC takes; empty for white noise."""
    n = sum(len(s) for s in series)
    series = [s for s in series if len(s) > 2 * MAX_ORDER]
    if not series:
        return np.zeros(0)
    y = np.concatenate([s[MAX_ORDER:] for s in series])
    lags = np.concatenate(
        [
            np.stack([s[MAX_ORDER - k : len(s) - k] for k in range(1, MAX_ORDER + 1)], axis=1)
            for s in series
        ]
    )
    best: Array = np.zeros(0)
    best_cost = np.inf
    for order in range(MAX_ORDER + 1):
        x = lags[:, :order]
        coefficients = np.asarray(np.linalg.lstsq(x, y, rcond=None)[0], np.float64)
        rss = float(np.sum((y - x @ coefficients) ** 2))
        cost = len(y) * np.log(max(rss, 1e-300)) + order * np.log(max(n, 2))
        if cost < best_cost - 1e-9:
            best, best_cost = coefficients, cost
    return best


def _longer(cost: Callable[[Array], float], z: Array) -> Array:
    """Change of z = artanh of partial autocorrelations that makes the memory longer by 1 σ.

    ``cost``: -2 ln L, least at z. The slow part of the noise goes with Π 1/(1 - tanh z)².
    """
    step = 0.02 * np.eye(len(z))
    middle = cost(z)
    up, down = np.array([[cost(z + s), cost(z - s)] for s in step]).T
    hessian = np.diag(up + down - 2 * middle)
    for i, j in combinations(range(len(z)), 2):
        both = cost(z + step[i] + step[j]) + cost(z - step[i] - step[j])
        hessian[i, j] = hessian[j, i] = (both + 2 * middle - up[i] - down[i] - up[j] - down[j]) / 2
    values, vectors = np.linalg.eigh(hessian / 0.02**2 / 2)
    covariance = (vectors / np.maximum(values, 1.0)) @ vectors.T
    slope = 1.0 + np.tanh(z)
    return np.asarray(covariance @ slope / np.sqrt(slope @ covariance @ slope))


def basis_beside(y: Array, channel: Channel) -> Array:
    """Orthonormal basis of what need not be noise in readings y (n,) of a channel."""
    return _absorbed(y, channel, Autoregression(), [np.arange(len(y))])


def likely_beside(
    y: Array, channel: Channel, noise: Autoregression, segments: Sequence[IntArray]
) -> tuple[Array, float]:
    """Orthonormal basis of what is no noise, if the noise is this; what it costs, of -2 ln L.

    All fixed columns, and of the sets sought those whose best place gains more than such noise.
    """
    taken, paid = _taken(y, channel, noise, segments, SCAN_LEVEL)
    return _basis(taken), paid


def _absorbed(
    y: Array, channel: Channel, noise: Autoregression, segments: Sequence[IntArray]
) -> Array:
    """Orthonormal basis of a channel's columns: all fixed, and the best place of each set sought.

    So little of the noise goes with what is not noise. ``noise``: what is known of it.
    """
    return _basis(_taken(y, channel, noise, segments)[0])


def _taken(
    y: Array,
    channel: Channel,
    noise: Autoregression,
    segments: Sequence[IntArray],
    level: float | None = None,
) -> tuple[Array, float]:
    """Columns of `_absorbed`, and what those sought cost, of -2 ln L.

    ``level``: probability from which on a set is left out whose best place gains as much by noise.
    """

    def white(columns: Array) -> Array:
        if noise.order == 0:
            return columns / noise.sizes[-1]
        flat = columns.reshape(len(columns), -1)
        made = np.concatenate([noise.whiten(flat[s]) for s in segments])
        return made.reshape(columns.shape)

    taken, paid = channel.fixed[:, np.any(channel.fixed != 0, axis=0)], 0.0
    q = _basis(white(taken))
    r = white(y[:, None])
    left = r - q @ (q.T @ r)
    for places in channel.sought:
        every = white(places.transpose(1, 0, 2)).transpose(1, 0, 2)
        gains = gains_beside(every, q, left[:, 0])
        best = int(np.argmax(gains))
        if level is not None:
            price = float(chdtri(places.shape[2], level / len(places)))
            if gains[best] < price:
                continue
        some = slice(max(best - channel.neighbours, 0), best + channel.neighbours + 1)
        near = np.concatenate([*every[some]], axis=1)
        own = _basis(near - q @ (q.T @ near))
        if level is not None:
            paid += float(chdtri(own.shape[1], level / len(places)))
        taken = np.concatenate([taken, *places[some]], axis=1)
        q = np.concatenate([q, own], axis=1)
        left = left - own @ (own.T @ left)
    return taken, paid


def _basis(columns: Array) -> Array:
    """Orthonormal basis of columns; those that vanish are left out."""
    size = np.sqrt((columns**2).sum(axis=0))
    seen = size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)
    u, s, _ = np.linalg.svd(columns[:, seen] / size[seen], full_matrices=False)
    return np.asarray(u[:, s > 1e-6 * s.max(initial=0.0)])
