"""Which further readings would discriminate between sets of causes that explain the data alike.

Each set, fitted to the readings there are, predicts new ones, with a spread that holds the noise
and what the old readings leave open of its parameters. If one set is true, its rivals' sums of
squares grow by what they predict wrongly, in units of their own spread: that growth is exact for
a refit to old and new readings together. Readings are chosen one after the other for the largest
drop of confusion; the chance that all rivals end more than 6 from the true set is simulated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.columns import lengths
from trunnion.diagnosis.effect import EffectValues
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.selection import WITHIN
from trunnion.diagnosis.whitening import Whiten

DRAWS = 200
SEED = 1
RIDGE = 1e-9


@dataclass(frozen=True)
class Hypothesis:
    """A set of causes at its fit to the old readings.

    predicted: Readings under the fit, old and possible new ones, shape (n,).
    columns: Derivative by the set's parameters, shape (n, k).
    distance: Penalised -2 ln L above the best set's, on the old readings.
    """

    predicted: Floats
    columns: Floats
    distance: float

    @classmethod
    def at(
        cls, both: Model, nuisance: Floats, effects: EffectValues, distance: float, whiten: Whiten
    ) -> Hypothesis | None:
        """Return what a fitted set gives for old and possible readings.

        None: its errors are so large, for the readings do not tell them, that further touches miss.
        """
        try:
            predicted = both.predict(nuisance, effects)
            parts = [
                both.effect_jacobian(nuisance, both.effect(name), values)
                for name, values in effects.items()
            ]
        except DataError:
            return None
        white = np.asarray(whiten(np.column_stack([predicted, *parts])))
        return cls(white[:, 0], white[:, 1:], distance)


class Discrimination:
    """Choice of new readings among candidates.

    nuisance: Derivative by the nuisance parameters, old and possible new readings, shape (n, p).
    old: Which readings there are, shape (n,) of bool; the others can be had.
    sets: At least two.
    sigma: Noise of one reading.
    """

    def __init__(
        self, nuisance: Floats, old: Flags, sets: Sequence[Hypothesis], sigma: float
    ) -> None:
        self.sets = sets
        self.new = np.flatnonzero(~old)
        self.means = [h.predicted / max(sigma, 1e-12) for h in sets]
        self.designs = []
        self.spreads = []  # covariance of each set's parameters, old readings, unit noise
        for h in sets:
            d = np.concatenate([nuisance, h.columns], axis=1)
            d = d / lengths(d)
            self.designs.append(d)
            self.spreads.append(np.linalg.inv(d[old].T @ d[old] + RIDGE * np.eye(d.shape[1])))
        weight = np.exp(-0.5 * np.array([h.distance for h in sets]))
        self.weight = weight / weight.sum()
        self.pairs = [(i, j) for i in range(len(sets)) for j in range(len(sets)) if i != j]

    def choose(self, count: int) -> Integers:
        """Choose readings (indices into all readings; one may come several times)."""
        designs = [d[self.new] for d in self.designs]
        spreads = list(self.spreads)
        loose = [np.einsum("ij,jk,ik->i", d, c, d) for d, c in zip(designs, spreads, strict=True)]
        miss = {(i, j): (self.means[i] - self.means[j])[self.new] for i, j in self.pairs}
        far = dict.fromkeys(self.pairs, 0.0)
        chosen = []
        for _ in range(count):
            worth = np.zeros(len(self.new))
            for i, j in self.pairs:
                gain = miss[i, j] ** 2 / (1.0 + loose[j])
                worth += self.weight[i] * np.exp(-far[i, j] / 8) * (1 - np.exp(-gain / 8))
            best = int(np.argmax(worth))
            chosen.append(int(self.new[best]))
            for j, d in enumerate(designs):
                tied = spreads[j] @ d[best]
                pull = d @ tied
                spread = 1.0 + float(pull[best])
                spreads[j] = spreads[j] - np.outer(tied, tied) / spread
                loose[j] = np.maximum(loose[j] - pull**2 / spread, 0.0)
                for i in range(len(self.sets)):
                    if i != j:
                        now = float(miss[i, j][best])
                        far[i, j] += now**2 / spread
                        miss[i, j] = miss[i, j] - pull * (now / spread)
        return np.array(chosen, dtype=np.intp)

    def chance(self, chosen: Integers) -> float:
        """Chance that, whichever set is true, every other ends more than 6 from it."""
        if not len(chosen):
            return 0.0
        rng = np.random.default_rng(SEED)
        factors = [self._factor(j, chosen) for j in range(len(self.sets))]
        total = 0.0
        for i, h in enumerate(self.sets):
            z = rng.standard_normal((len(chosen), DRAWS))
            made = self.means[i][chosen, None] + factors[i] @ z
            own = np.sum(z * z, axis=0)
            clear = np.ones(DRAWS, dtype=bool)
            for j, rival in enumerate(self.sets):
                if i != j:
                    miss = np.linalg.solve(factors[j], made - self.means[j][chosen, None])
                    grown = np.sum(miss * miss, axis=0) - own
                    clear &= rival.distance - h.distance + grown > WITHIN
            total += float(self.weight[i] * np.mean(clear))
        return min(total, 1.0)

    def distances(self, chosen: Integers) -> list[float]:
        """How far each set predicts these readings from the first, in sigma of its own."""
        out = []
        for j in range(len(self.sets)):
            miss = np.linalg.solve(self._factor(j, chosen), (self.means[0] - self.means[j])[chosen])
            out.append(float(np.linalg.norm(miss)))
        return out

    def alike(self, chosen: Integers) -> list[tuple[int, int]]:
        """Pairs that predict these readings alike: less than one sigma apart in all."""
        out = []
        for i, j in self.pairs:
            if i < j:
                miss = (self.means[i] - self.means[j])[chosen]
                left, right = (np.linalg.solve(self._factor(k, chosen), miss) for k in (i, j))
                if max(float(left @ left), float(right @ right)) < 1.0:
                    out.append((i, j))
        return out

    def _factor(self, j: int, chosen: Integers) -> Floats:
        """Cholesky factor of the covariance with which a set predicts the chosen readings."""
        d = self.designs[j][chosen]
        return np.asarray(np.linalg.cholesky(np.eye(len(chosen)) + d @ self.spreads[j] @ d.T))
