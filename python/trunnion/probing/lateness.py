"""How late touches are on average, beside what else changes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trunnion._core import Moves
from trunnion.base.errors import TrunnionError
from trunnion.base.rounded import log_of
from trunnion.base.statistics import linear_fit
from trunnion.base.units import Floats
from trunnion.data.touches import Touches
from trunnion.machine.sizes import SURE_SIGMAS
from trunnion.probing.model import TouchModel

DELAYS = ("trigger_delay", "probe_radius")
"""Effects that make touches late: as the feed, and all alike."""

MIN_ROUNDED = 24
"""Touches from which on their scatter tells whether they are rounded."""

SAME_SIZE = 0.25

NOISES = np.geomspace(0.02, 1.5, 30)
"""Noise beside the rounding that is tried, of the scatter."""

MIN_TICK = 0.05
"""Of the noise, below which a tick makes no difference to it."""

MIN_UM = 1e-6
"""Scatter that exact readings are taken to have."""

AS_NONE = 0.01
"""Of the stated tick: one so fine acts as none."""

MAX_BESIDE = 6
"""Effects that touches are fitted with before their lateness is judged, at most."""

BETTER = 2 * float(np.log(20.0))
"""In -2 ln of the probability, by which another effect fits touches better than lateness does."""

OWN_PART = 1e-6
"""Of a column, that others do not change readings by: less is rounding."""


@dataclass(frozen=True)
class Late:
    """How late touches are on average, ms or µm, and what a fit with it leaves, by freedom.

    before_um: What a fit without it leaves, rms.
    """

    late: float
    std: float
    is_delay: bool
    residuals_um: Floats
    freedom: int
    before_um: float

    @property
    def is_sure(self) -> bool:
        """Whether touches are late, or early, beyond its uncertainty."""
        return abs(self.late) >= SURE_SIGMAS * self.std

    @property
    def scatter_um(self) -> float:
        """Root of the mean square of what is left."""
        return max(float(np.sqrt(np.mean(self.residuals_um**2))), MIN_UM)

    def ticks(self, stated: Floats, data: Touches) -> Floats:
        """Ticks (n,), µm, of which touches are half of one late beyond half of the stated one."""
        return np.asarray(stated + 2 * self.late * self._way_of(data))

    def as_latched(self, ticks: Floats, stated: Floats, data: Touches) -> bool:
        """Whether such ticks are none within their uncertainty, or as good as none."""
        least = 2 * SURE_SIGMAS * self.std * self._way_of(data)
        return bool(np.all(np.abs(ticks) <= np.maximum(least, AS_NONE * stated)))

    def is_of(self, ticks: Floats) -> bool:
        """Whether what is left is as large as errors of rounding to ticks (n,), µm."""
        if not ticks.min() > 0:
            return False
        size = float(np.sqrt(12 * np.mean((self.residuals_um / ticks) ** 2)))
        return abs(size - 1) <= SAME_SIZE

    def gain(self, ticks: Floats, stated: Floats) -> float:
        """Logarithm of how many times more probable what is left is with ticks than as stated.

        Each with the noise with which it is most.
        """
        return self._log(ticks) - self._log(stated)

    def _log(self, ticks: Floats) -> float:
        """Logarithm of the probability of errors of rounding to ticks (n,), µm, and of noise."""
        left, found = self.residuals_um, []
        for noise in self.scatter_um * NOISES:
            step = np.maximum(ticks, MIN_TICK * noise)
            found.append(log_of(left, step, float(noise)) - float(np.log(step).sum()))
        return max(found)

    def _way_of(self, data: Touches) -> Floats:
        """How far the ball moves in one of the unit of `late`, µm, (n,)."""
        feed = data.feed_mm_min
        return np.asarray(feed) / 60 if self.is_delay else np.ones(len(data))


def lateness(
    data: Touches, plain: TouchModel, moves: Moves, near: Floats, beside: Floats
) -> Late | None:
    """Fit by how much touches are late, weighed by their scatter; None: too few touches, or off.

    A scale or a backlash makes touches late on average, too: they are fitted first with ``beside``,
    columns (n, k) of causes that are known of, and with effects that fit them clearly better than
    lateness does. What fits them alike is no reason against it.

    plain: The model without effects. moves: The touches, as it knows them. near: Values of its
    parameters that fit them to first order, (p,).
    """
    feed = data.feed_mm_min
    is_delay = feed is not None and len(np.unique(feed)) > 1
    effect = DELAYS[0] if is_delay else DELAYS[1]
    apart = DELAYS[:1] if is_delay else DELAYS  # at one feed both are one
    try:
        base, off, of_effects = _columns(data, plain, moves, near)
    except TrunnionError:
        return None
    if effect not in of_effects:
        return None
    base, late = np.hstack([base, beside]), of_effects[effect]
    rivals = {name: columns for name, columns in of_effects.items() if name not in apart}
    found: Late | None = None
    for _ in range(MAX_BESIDE + 1):
        made = _fitted(np.hstack([base, late]), off, feed if is_delay else None)
        if made is None or not made[0].is_sure:
            return None if made is None else made[0]
        (found, size), none = made, late[:, :0]
        better = _better(base, off, late, rivals, size)
        # Two of them may together look like lateness: it is judged beside what it leaves, too.
        also = better or _better(np.hstack([base, late]), off, none, rivals, size)
        if also is None:
            return found
        base = np.hstack([base, rivals.pop(also)])
    return None if better else found


def _columns(
    data: Touches, plain: TouchModel, moves: Moves, near: Floats
) -> tuple[Floats, Floats, dict[str, Floats]]:
    """Columns of the plain model (n, p), what it leaves (n,), columns of effects (n, k) by id.

    What one more effect changes is linear: each from no effect. Those that begin at a moment or
    come to an end are none of these.
    """
    known = [i for i in plain.chain.catalogue() if all(n in data.columns for n in i.needs)]
    ids = [i.id for i in known if all(p.kind == "linear" for p in i.parameters)]
    model = TouchModel(plain.setup, ids, chain=plain.chain)
    values = np.append(near, np.zeros(len(model.names) - len(near)))
    off, jacobian = model.core.linearise(moves, values)
    owner = np.array([name.partition(".")[0] for name in model.names[len(near) :]])
    own = jacobian[:, len(near) :]
    return jacobian[:, : len(near)], np.asarray(off), {i: own[:, owner == i] for i in ids}


def _fitted(columns: Floats, off: Floats, feed: Floats | None) -> tuple[Late, Floats] | None:
    """Fit with columns (n, p), lateness the last; with the scatter that weighs touches (n,).

    feed: Where lateness is as the feed; rounding to ticks, and so the scatter, may be, too.
    """
    fit = linear_fit(columns, off)
    freedom = len(off) - fit.rank
    if freedom < MIN_ROUNDED or fit.not_identifiable[-1]:
        return None
    size = np.ones(len(off))
    if feed is not None:
        size = _by_feed(off - columns @ fit.solution, np.asarray(feed))
        fit = linear_fit(columns / size[:, None], off / size)
    before = off - columns[:, :-1] @ linear_fit(columns[:, :-1], off).solution
    rms_um = float(np.sqrt(np.mean(before**2)))
    left = (off - columns @ fit.solution) * np.sqrt(len(off) / freedom)
    value, std = float(fit.solution[-1]), float(fit.std[-1] * np.sqrt(np.mean((left / size) ** 2)))
    late = value if feed is not None else -value
    return Late(late, std, feed is not None, left, freedom, rms_um), size


def _better(
    base: Floats, off: Floats, than: Floats, rivals: Mapping[str, Floats], size: Floats
) -> str | None:
    """Effect that fits touches clearly better beside the base (n, p) than columns do; None: none.

    than: These columns, (n, k). size: Scatter of the touches, (n,).
    """
    off = off / size
    basis = linear_fit(base / size[:, None], off, basis=True).basis

    def left(columns: Floats) -> Floats:
        return np.asarray(columns - basis @ (basis.T @ columns))

    own_off, least = left(off), MIN_UM**2 * len(off)

    def score(columns: Floats) -> float:
        """-2 ln of the probability, by the number of parameters, up to what all share."""
        white = columns / size[:, None]
        own = left(white)
        own = own[:, np.linalg.norm(own, axis=0) > OWN_PART * np.linalg.norm(white, axis=0)]
        solution = np.linalg.lstsq(own, own_off, rcond=OWN_PART)[0] if own.size else None
        rest = own_off if solution is None else own_off - own @ solution
        squares = max(float(rest @ rest), least / float(np.mean(size**2)))
        return float(len(off) * np.log(squares) + columns.shape[1] * np.log(len(off)))

    scores = {name: score(columns) for name, columns in rivals.items()}
    best = min(scores, key=lambda name: scores[name], default=None)
    return best if best is not None and scores[best] < score(than) - BETTER else None


def _by_feed(left: Floats, feed: Floats) -> Floats:
    """Scatter (rms) of what is left at the feed of each touch, (n,)."""
    _, label = np.unique(feed, return_inverse=True)
    squares = np.bincount(label, left**2) / np.bincount(label)
    return np.asarray(np.maximum(np.sqrt(squares), MIN_UM)[label])
