"""What the doubt between sets of causes adds to the uncertainty of a fit.

The values that are reported are those of the named set. Another set that explains the readings
about as well has other values. The variance about the reported ones is the mean, over the sets by
their probability, of each set's own variance and the square of its distance (law of total
variance); an effect's parameters are compared in the sets that hold it. Estimates of the sets are
those of the model linearised at the plain fit. Where a set leaves a combination of an effect's
parameters undetermined, it may be as large as what is seen of the effect, and what that would do
counts as a distance (GUM, type B).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trunnion.base.statistics import linear_fit
from trunnion.base.units import Flags, Floats
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.explanation import Explanation
from trunnion.diagnosis.fit import ABSORBED_SHARE, Fit, variant_columns
from trunnion.diagnosis.records import RELATIVE, Alternative
from trunnion.diagnosis.whitening import Whiteners
from trunnion.machine.estimate import SECOND_ORDER

MIN_PROBABILITY = 0.005  # of a set that counts
MAX_COUNTED = 20


def alternatives_of(case: Case, e: Explanation) -> list[Alternative]:
    """List the sets of causes, each once, best first."""
    ids = [x.id for x in case.effects]
    out: dict[frozenset[str], Alternative] = {}
    chances, unit = e.probabilities, case.model.readings.unit
    of_noise = not isinstance(unit, str) or isinstance(case.whiten, Whiteners)
    unit = RELATIVE if of_noise else str(unit)
    for members, distance, rss in e.sets:
        causes = frozenset(ids[m] for m in members)
        if causes not in out:
            size = np.sqrt(max(rss, 0.0) / max(len(e.fit.white), 1))
            start = {ids[m]: e.values[m][v] for m, v in members.items()}
            chance = chances.of_set(frozenset(members))
            out[causes] = Alternative(causes, float(distance), float(size), start, chance, unit)
    sets = list(out.values())
    return [*sets[:1], *sorted(sets[1:], key=lambda a: -a.probability)]


@dataclass(frozen=True)
class Doubt:
    """Uncertainty of the p nuisance and k effect parameters of a fit.

    Attributes
    ----------
    covariance:
        With the doubt between the sets, shape (p + k, p + k); 0 for what did not move.
    between:
        Part of it that is due to the doubt alone, shape (p + k, p + k).
    rival:
        Number of the set that adds most to it, shape (p + k,).
    """

    covariance: Floats
    between: Floats
    rival: tuple[int, ...]

    @classmethod
    def of(
        cls, case: Case, f: Fit, sets: Sequence[Alternative], variance: float, growth: Floats
    ) -> "Doubt":
        """Weigh the sets, of which ``f`` fits the first.

        variance: Of a reading. growth: Of standard errors by rounding, shape (p + k,).
        """
        chances = np.array([s.probability for s in sets[:MAX_COUNTED]])
        counted = [i for i, p in enumerate(chances) if i == 0 or p >= MIN_PROBABILITY]
        total = float(chances[counted].sum())
        covariance = f.covariance * np.outer(growth, growth) * variance
        if len(counted) < 2 or total <= 0:
            return cls(covariance, np.zeros_like(covariance), (0,) * len(covariance))
        squares = np.zeros((len(counted), len(covariance)))
        linear = _Sets(case, f, [sets[i] for i in counted])
        first = linear.estimate(sets[0])
        mean = covariance * chances[0] / total
        between = np.zeros_like(covariance)
        for row, i in enumerate(counted[1:], start=1):
            weight, other = chances[i] / total, linear.estimate(sets[i])
            both = first.inside & other.inside
            own = other.cofactor * np.outer(growth, growth) * variance
            # What only the named set holds keeps its uncertainty.
            mixed = np.where(np.outer(~both, ~both), covariance, 0.0)
            off = np.where(both, other.values - first.values, 0.0)
            steps = [off, *(np.where(both, step, 0.0) for step in other.steps)]
            distance = sum(np.outer(step, step) for step in steps)
            mean = mean + weight * np.where(np.outer(both, both), own, mixed)
            between = between + weight * distance
            squares[row] = weight * np.diag(distance)
        rival = tuple(counted[int(row)] for row in np.argmax(squares, axis=0))
        return cls(mean + between, between, rival)

    def beside(self, more: Floats) -> "Doubt":
        """Return it with what else is in doubt, mean squares, shape (p + k, p + k)."""
        if not more.any():
            return self
        return Doubt(self.covariance + more, self.between + more, self.rival)


@dataclass(frozen=True)
class _Estimate:
    """Parameters of a fit as another set has them.

    values: Shape (p + k,); 0 for those that the set does not hold.
    cofactor: Covariance per unit of noise.
    inside: Whether the set holds each.
    steps: What changes no reading, as large as what is seen of its effects.
    """

    values: Floats
    cofactor: Floats
    inside: Flags
    steps: list[Floats]


class _Sets:
    """Linear models of some sets of causes, in as many rows as they have columns together."""

    def __init__(self, case: Case, f: Fit, sets: Sequence[Alternative]) -> None:
        plain, self.f = case.plain, f
        self.directions, self.effects = plain.directions, {e.id: e for e in case.effects}
        self.at: dict[tuple[str, tuple[float, ...]], slice] = {}
        blocks = [case.white_jacobian(plain) @ plain.directions.T]
        width = blocks[0].shape[1]
        for name, start in (item for s in sets for item in s.start.items()):
            key = (name, tuple(start.values()))
            if key not in self.at:
                values = self.effects[name].values(start.values())
                x = variant_columns(case.model, self.effects[name], plain.nuisance, [values])[0]
                blocks.append(case.white(x))
                self.at[key] = slice(width, width := width + x.shape[1])
        self.small = np.asarray(np.linalg.qr(np.column_stack([*blocks, plain.white]), mode="r"))

    def estimate(self, s: Alternative) -> _Estimate:
        """Fit one set."""
        rank, p = self.directions.shape
        owned = [(i, q) for i in s.start for q in self.effects[i].parameters if q.linear]
        columns = [self.small[:, :rank]]
        columns += [self.small[:, self.at[i, tuple(v.values())]] for i, v in s.start.items()]
        found = linear_fit(np.hstack(columns), self.small[:, -1], tolerance=ABSORBED_SHARE)
        names = [(i, q.name) for i, q in owned]
        # Rows: parameters of the fit; columns: of this set.
        to_fit = np.zeros((p + len(self.f.names), rank + len(owned)))
        to_fit[:p, :rank] = self.directions.T
        for row, name in enumerate(self.f.names, start=p):
            if name in names:
                to_fit[row, rank + names.index(name)] = 1.0
        # What is undetermined of an effect is supposed to be as large as what is seen of it.
        owner = np.array([i for i, _ in owned])
        steps = []
        for row in found.combinations:
            own = np.abs(row[rank:])
            if own.any():
                acting = np.isin(owner, owner[own > SECOND_ORDER * own.max()])
                seen = np.max(np.abs(found.solution[rank:][acting]))
                steps.append(to_fit @ row * seen / own.max())
        return _Estimate(
            to_fit @ found.solution,
            to_fit @ found.cofactor @ to_fit.T,
            np.any(to_fit, axis=1),
            steps,
        )
