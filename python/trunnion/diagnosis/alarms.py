"""Tests of all candidates, or all terms, together; and of the scatter against repeats and noise."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special

from trunnion.base.resolution import Floor
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.outliers import MIN_FREE
from trunnion.diagnosis.records import units_of, with_unit

CAUSE_LEVEL = 0.02
REPEAT_LEVEL = 0.005
SCATTER_LEVEL = 0.005
BEYOND_DOUBT = 1e-7
PERMUTATIONS = 299
PERMUTATION_SEED = 1
MAX_PERMUTED = 1 << 22  # numbers that are permuted at once
TINY = 1e-300
MIN_LEFT = 1e-14  # of a sum of squares: rounding


@dataclass
class Alarm:
    """A test of all candidates (or all terms) together, for residuals of a fit.

    ``p``: the smallest F-test p-value times the count of candidates. Where it is not beyond doubt
    the residuals are permuted: F tests of many columns, some of which rest on a few readings, are
    too sure of themselves when the noise has heavy tails.
    """

    gains: Callable[[Floats], Floats]
    rank: Integers
    weight: Floats  # independent places of each block
    count: float
    fit: Fit
    floor: Floor
    inflation: Floats  # of the gain of each block
    p: float = 1.0

    @classmethod
    def of_causes(cls, case: Case) -> "Alarm":
        """Test all candidates, for the plain fit."""
        c, f = case.candidates, case.plain
        count = max(c.multiplicity, 1.0)
        rank = np.where(np.isfinite(c.penalty), c.rank, 0)
        alarm = cls(c.gains, rank, c.places, count, f, case.floor, c.inflation)
        return alarm._with_gains(c.gains(f.white))

    @classmethod
    def of_terms(cls, case: Case, f: Fit) -> "Alarm":
        """Test all terms of unexplained structure, for some fit."""
        d = case.dictionary
        gain, rank = d.of_fit(f)
        n = d.count
        alarm = cls(
            lambda r: d.gains(r, f.basis)[0],
            rank,
            np.ones(n),
            max(n, 1),
            f,
            case.floor,
            case.term_inflation(f),
        )
        return alarm._with_gains(gain)

    def _with_gains(self, gain: Floats) -> "Alarm":
        if len(self.rank) and self.fit.rss > 0:
            self.p = min(1.0, self.count * float(self._smallest(gain[:, None], self.fit.rss)[0]))
        return self

    def _smallest(self, gain: Floats, rss: Floats | float) -> Floats:
        """Smallest p-value, times its places, of each column of gains (b, s)."""
        gain = gain / self.inflation[:, None]
        out = np.ones(gain.shape[1])
        kinds = set(zip(self.rank.tolist(), self.weight.tolist(), strict=True))
        for k, w in sorted(kinds):
            if k < 1 or k >= self.fit.dof:
                continue
            top = gain[(self.rank == k) & (self.weight == w)].max(axis=0)
            d2 = max(self.fit.dof - k, 1)
            left = np.maximum(rss - top, MIN_LEFT * np.asarray(rss))
            out = np.minimum(out, w * special.fdtrc(k, d2, top / k / self.floor.noise(left, d2)))
        return out

    def holds(self, level: float) -> bool:
        """Whether it stands against permutations of the residuals."""
        if self.p < BEYOND_DOUBT:
            return True
        rng = np.random.default_rng(PERMUTATION_SEED)
        q = self.fit.basis
        leverage = np.einsum("ij,ij->i", q, q)
        even = self.fit.white / np.sqrt(np.maximum(1.0 - leverage, MIN_FREE))
        most = level * (PERMUTATIONS + 1) - 1  # so many by chance are too many
        done, worse = 0, 0
        while done < PERMUTATIONS and worse <= most:
            count = min(PERMUTATIONS - done, max(1, MAX_PERMUTED // len(even)))
            r = rng.permuted(np.tile(even, (count, 1)), axis=1).T
            r = r - q @ (q.T @ r)
            rss = np.einsum("ij,ij->j", r, r)
            chance = self._smallest(self.gains(r), rss) * self.count
            worse += int(np.sum(chance <= self.p))
            done += count
        return worse <= most


def scatter(case: Case, f: Fit) -> tuple[str | None, float]:
    """Test the scatter against repeats and the stated noise: note, p in units of its level."""
    note, p = _against_repeats(case, f)
    sigma = case.model.readings.sigma
    if sigma is None or note is not None:
        return note, p
    s = np.asarray(sigma)[case.rows]
    chi2 = float(np.sum((f.residuals[case.rows] / s) ** 2))
    chance = float(special.chdtrc(f.dof, chi2))
    if chance < SCATTER_LEVEL:
        note = (
            f"the scatter is {np.sqrt(chi2 / f.dof):.2g} times the stated noise; no recorded "
            "quantity explains it"
        )
    return note, min(p, chance / SCATTER_LEVEL)


def _against_repeats(case: Case, f: Fit) -> tuple[str | None, float]:
    repeats = case.model.replicates
    if repeats is None or case.exact(f) or case.rounds_to_readings(f):
        return None, np.inf
    labels = np.asarray(repeats)[case.rows]
    _, group = np.unique(labels[labels >= 0], return_inverse=True)
    if not len(group):
        return None, np.inf
    count = np.bincount(group)
    dof_pure = len(group) - len(count)
    dof_model = f.dof - dof_pure
    if dof_pure <= 2 or dof_model <= 0:
        return None, np.inf
    white = f.white[:, None]
    pure = _pure(white, labels >= 0, group, case.floor.variance)
    if pure[0] <= 0:
        return None, np.inf

    def missed(rss: Floats | float, pure: Floats) -> Floats:
        """Mean square of what the model misses of the means of repeats, over that of repeats."""
        return np.asarray((rss - pure) / dof_model / (pure / dof_pure))

    ratio = float(missed(f.rss, pure)[0])
    drawn = case.rounding_about(f)
    if drawn is not None:
        # Errors of rounding are not those of noise: repeats share them, and means keep them.
        alike = _pure(drawn, labels >= 0, group, 0.0)
        ratio /= max(float(np.max(missed(np.sum(drawn**2, axis=0), alike))), 1.0)
    p = float(special.fdtrc(dof_model, dof_pure, max(ratio, 0.0)))
    if p >= REPEAT_LEVEL:
        return None, p / REPEAT_LEVEL
    note = (
        f"repeats agree to {_agreement(case, pure[0] / dof_pure)}, but the model misses "
        f"their means by {np.sqrt(max(ratio, 0)):.2g} times that; no recorded "
        "quantity explains it"
    )
    return note, p / REPEAT_LEVEL


def _agreement(case: Case, variance: float) -> str:
    """Say how closely repeats agree, in their unit if they have one; ``variance``: of them."""
    units, _ = units_of(case.model.readings)
    return with_unit(f"{np.sqrt(variance):.3g}", units[0] if len(units) == 1 else "")


def _pure(white: Floats, some: Flags, group: Integers, least: float) -> Floats:
    """Sum of squares of repeats about their means, at least so much each: of columns, shape (s,).

    ``white``: residuals (m, s); ``some``: which repeat others; ``group``: of each of these.
    """
    w = white[some]
    count = np.bincount(group)
    mean = np.array([np.bincount(group, column) for column in w.T]) / count
    squares = np.sum((w - mean.T[group]) ** 2, axis=0)
    return np.asarray(np.maximum(squares, (len(group) - len(count)) * max(least, TINY)))
