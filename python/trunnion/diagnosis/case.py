"""A model with the readings of it that are used."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from trunnion.base.recognition import MIN_STEP
from trunnion.base.repeats import Repeats
from trunnion.base.resolution import (
    ANY_PLACE,
    NO_FLOOR,
    Floor,
    Grid,
    grown,
    growth,
    inflation,
)
from trunnion.base.rounded import Place, rounds_to_all
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.candidates_of import candidates_of
from trunnion.diagnosis.cross_validation import cross_validated
from trunnion.diagnosis.dependence import growth as growth_by_dependence
from trunnion.diagnosis.dependence import growth_apart
from trunnion.diagnosis.effect import Effect, Values
from trunnion.diagnosis.fit import Fit, Flags, fit
from trunnion.diagnosis.linearised import Linearised
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.noise import Whitener
from trunnion.diagnosis.outliers import Sizes
from trunnion.diagnosis.records import rms
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.steps import weights_of
from trunnion.diagnosis.term import Term
from trunnion.diagnosis.whitening import Scaling, Whiten, correlated, identity

if TYPE_CHECKING:
    from trunnion.diagnosis.structure import WithTerm

EXACT = 1e-12  # of the largest reading: rounding
SINGULAR = 1e-8  # of a correlation matrix of estimates
DOUBTFUL_P = 1e-3  # from which on it is seen what others leave without an effect
CERTAIN_P = 1e-9  # below which an effect is there without doubt, however many were tried
KEPT_FITS = 3  # of which white derivatives are kept
TINY = 1e-300


@dataclass
class Case:
    """A model and the readings of it that are used.

    Attributes
    ----------
    model, rows, whiten:
        The model, the readings that are used, and the map of all readings to white noise.
    plain:
        Fit without effects.
    linearised:
        The candidates there.
    floor:
        Least variance of the noise of a whitened reading.
    grid:
        Steps in which the readings are recorded.
    found, likely:
        Fit of the causes that were found in the noise that is assumed, and that without the
        weakest, whose errors of rounding are simulated; None: of the plain machine.
    given:
        Plain fit of the model as it was given, where ``model`` is that about a point nearer to the
        data; None: `plain`.
    known:
        Dictionary of a case of the same model with other weights.
    minor:
        Effects that are significant and explain too little of what is left to be named.
    """

    model: Model
    rows: Integers
    whiten: Whiten
    plain: Fit
    linearised: Linearised
    floor: Floor = NO_FLOOR
    grid: Grid | None = None
    found: Fit | None = None
    likely: Fit | None = None
    given: Fit | None = None
    known: Dictionary | None = None
    minor: set[str] = field(default_factory=set)

    @property
    def values(self) -> list[list[Values]]:
        """Of each candidate, the parameter values of its variants."""
        return self.linearised.values

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """The candidates: what is expected where the model is not complete is one like others."""
        if self.dependent:
            return self.model.effects
        return tuple(replace(e, expected=False) if e.expected else e for e in self.model.effects)

    @property
    def complete(self) -> bool:
        """Whether all readings are used."""
        return len(self.rows) == len(self.model.readings)

    @cached_property
    def candidates(self) -> Candidates:
        """The candidates beside the plain fit, once searched at further places (:mod:`.nearer`)."""
        return candidates_of(self)

    def std(self, effect: Effect, f: Fit, variance: float) -> Floats:
        """Standard errors of an effect's parameters; ``variance``: of a whitened reading."""
        std = f.std()[self.columns_of(effect, f)] * np.sqrt(variance)
        return np.where(std >= 0, std, np.inf)

    def chance(self, effect: Effect, f: Fit, variance: float) -> tuple[float, float]:
        """Probability of readings like these without an effect of a fit, not counting candidates.

        And Wald's statistic of its linear parameters, not divided by the ``variance`` of a whitened
        reading.

        Where its size cannot be separated from its place (share and frequency of a resonance far
        above what the motion excites) it may be there without doubt all the same: at the place
        found.
        """
        wald, rank = self._wald(effect, f, held=False)
        sought = _tail(wald, rank, f, variance)
        if effect.linear:
            return sought, wald
        held = _tail(*self._wald(effect, f, held=True), f, variance)
        return held if held < CERTAIN_P else sought, wald

    def chance_beside(self, effect: Effect, f: Fit, variance: float) -> tuple[float, float]:
        """The same, also by what the others of the fit leave without it, where they are fitted.

        A tool that warms up so slowly that it grows in proportion to time has any amplitude, with a
        time constant to it, and is there all the same. Others take its place only at places that
        they have as candidates: one that warms up slower than any of these is no barrel.
        """
        chance, wald = self.chance(effect, f, variance)
        linear = all(e.linear for e in self.effects if e.id in f.effects)
        if linear or self.dependent or chance < DOUBTFUL_P:
            return chance, wald
        others = {name: values for name, values in f.effects.items() if name != effect.id}
        fitted = [e.within_grids() for e in self.effects if e.id in others]
        rest = fit(self.model, self.rows, fitted, f.nuisance, others, self.whiten)
        gain = max(rest.rss - f.rss, 0.0)
        return min(chance, _tail(gain, len(effect.parameters), f, variance)), wald

    def columns_of(self, effect: Effect, f: Fit) -> list[int]:
        """Return the columns of an effect's parameters among those of a fit."""
        p = len(self.model.nuisance)
        return [p + i for i, (name, _) in enumerate(f.names) if name == effect.id]

    def _wald(self, effect: Effect, f: Fit, *, held: bool) -> tuple[float, int]:
        """Wald's statistic of an effect's linear parameters, and its rank.

        ``held``: its other parameters stay at what was found.
        """
        at, linear = self.columns_of(effect, f), np.array([q.linear for q in effect.parameters])
        b = np.array([f.effects[effect.id][q.name] for q in effect.parameters])[linear]
        some = np.ones_like(linear) if held else linear
        cov = f.covariance[np.ix_(at, at)][np.ix_(some, some)]
        size = np.sqrt(np.maximum(np.diag(cov), TINY))
        seen, ways = np.linalg.eigh(cov / np.outer(size, size))
        known = seen > SINGULAR * seen[-1]
        ways = ways[:, known][linear[some]]
        wald = float(np.sum((b / size[linear[some]] @ ways) ** 2 / seen[known]))
        rank = len(seen[known]) if linear.all() else int(np.linalg.matrix_rank(ways))
        return wald, max(rank, 1)

    def term_inflation(self, f: Fit) -> Floats:
        """How many times more each term of unexplained structure gains than by noise (t,)."""
        drawn = self.rounding_about(f)
        if drawn is None:
            return np.ones(self.dictionary.count)
        d = self.dictionary
        rank = np.maximum(d.of_fit(f)[1], 1)
        return inflation(lambda r: d.gains(r, f.basis)[0], drawn, rank, d.chance(f))

    def rounding_about(self, f: Fit) -> Floats | None:
        """Residuals of a fit that rounding makes of such machines, in units of their noise.

        Shape (m, s), white and orthogonal to the fit's basis (kept); None where the readings have
        no steps to speak of. The machines are as uncertain in place as rounding makes them: a
        smooth curve of few steps rounds to arches whose places hang on that.
        """
        drawn = self._errors_about(f)
        return None if drawn is None else self.left_of(drawn, f)

    def _errors_about(self, f: Fit) -> Floats | None:
        """White errors of rounding of machines that rounding lets be like a fit (m, s) (kept)."""
        if f not in self._about:
            self._about[f] = self.errors_of_rounding(f, wide=True)
        return self._about[f]

    def left_of(self, drawn: Floats, f: Fit) -> Floats:
        """What a fit leaves of white errors in draws, in units of the noise of each (m, s)."""
        white = drawn - f.basis @ (f.basis.T @ drawn)
        return white / np.sqrt(self.floor.noise(np.einsum("ij,ij->j", white, white), f.dof))

    @property
    def dependent(self) -> list[Integers]:
        """Used readings in a row whose residual is no stationary noise."""
        return self._in_a_row(self.whiten.dependent) if isinstance(self.whiten, Whitener) else []

    @property
    def wandering(self) -> list[Integers]:
        """Used readings in a row that wander as nothing of the catalogue makes them."""
        return self._in_a_row(self.whiten.wandering) if isinstance(self.whiten, Whitener) else []

    def shared(self, f: Fit) -> Floats:
        """Return what a fit leaves of an effect without a name, beside its columns, shape (n,)."""
        white = correlated(self.whiten)
        if white is None or white.cause not in f.effects:
            return np.zeros(len(f.residuals))
        return white.shared(f.residuals)

    def _in_a_row(self, filters: Iterable[int]) -> list[Integers]:
        """Used readings of some filters of the whitener."""
        return [some for i in filters if len(some := self._of_filters[i])]

    def growth(self, f: Fit, variance: float) -> Floats:
        """How many times their standard errors errors of a fit's parameters are, (p + k,).

        By rounding (:func:`.resolution.growth`), dependence of the residuals (:mod:`.dependence`),
        or what one of several measurements leaves. ``variance``: of a white reading.
        """
        if self.dependent:
            return growth_by_dependence(
                self.white_jacobian(f), f.white, f.covariance, variance, self.segments
            )
        apart = growth_apart(self, f, variance)
        variances = np.diag(f.covariance) * variance * apart**2
        if (anywhere := self.errors_of_rounding(f, spread=ANY_PLACE)) is None:
            return apart
        return apart * growth(self.moved(f, anywhere), variances)

    @cached_property
    def _drawn_anywhere(self) -> Floats | None:
        return self.errors_of_rounding(spread=ANY_PLACE)

    @cached_property
    def _about(self) -> dict[Fit, Floats | None]:
        return {}

    @cached_property
    def _places(self) -> dict[Fit, Place | None]:
        return {}

    @cached_property
    def _rounds(self) -> dict[Fit, bool]:
        return {}

    @cached_property
    def _predicted(self) -> dict[Fit, Floats]:
        return {}

    @cached_property
    def _sizes(self) -> dict[tuple[Fit, Sizes], Floats]:
        return {}

    @cached_property
    def read(self) -> dict[Fit, Fit]:
        """Fits as readings in steps say (:mod:`.in_steps`)."""
        return {}

    @cached_property
    def fits(self) -> dict[tuple[tuple[int, int], ...], Fit]:
        """Fit of the last set of candidates and their variants (:mod:`.explain`)."""
        return {}

    @cached_property
    def structures(self) -> "dict[tuple[Term, Fit], WithTerm]":
        """Fits with a term of structure beside another fit (:mod:`.structure`)."""
        return {}

    def cross_validated(self, f: Fit) -> Floats:
        """Readings less their predictions from all other groups, by a fit (m,) (kept)."""
        if f not in self._predicted:
            self._predicted[f] = cross_validated(self.model, self.rows, f, self.whiten)
        return self._predicted[f]

    def sizes(self, f: Fit, of: Sizes) -> Floats:
        """Sizes of what a fit leaves of readings, by a function of :mod:`.outliers` (m,) (kept)."""
        if (f, of) not in self._sizes:
            self._sizes[f, of] = of(f.basis, f.white, self.least_noise)
        return self._sizes[f, of]

    @property
    def least_noise(self) -> float:
        """Least noise of a whitened reading."""
        return float(np.sqrt(self.floor.variance))

    def errors_of_rounding(
        self, of: Fit | None = None, *, spread: float = 0.0, wide: bool = False
    ) -> Floats | None:
        """Errors of rounding and noise of machines like a fit, the likely one, white, shape (m, s).

        ``wide``: as uncertain in place as rounding makes them.
        """
        if self.grid is None:
            return None
        of = of or self.likely or self.plain
        noise = self._noise_beside(self.grid, of)
        if not self.grid.draws_in(noise):
            return None
        drawn = self.grid.draws(
            self.model.readings.values,
            of.residuals,
            of.jacobian,
            self._covariance(of, wide=wide),
            noise,
            spread,
            None if spread else self.place(of),
        )
        if drawn is None:
            return None
        white = np.asarray(self.whiten(drawn))
        return (white if self.grid.known is None else self.grid.known.completed(white))[self.rows]

    def place(self, f: Fit) -> Place | None:
        """Where machines like a fit lie that were read so (kept); None: rounding is random."""
        if self.grid is None or self.as_read is None or not self.by_reading:
            return None
        if f not in self._places:
            covariance, noise = self._covariance(f, wide=True), self._noise_beside(self.grid, f)
            self._places[f] = self.grid.place(
                f.residuals, f.jacobian, covariance, noise, self.as_read
            )
        return self._places[f]

    def _covariance(self, f: Fit, *, wide: bool) -> Floats:
        """Covariance of a fit's parameters; ``wide``: as rounding anywhere makes it."""
        covariance = f.covariance * float(self.floor.noise(f.rss, f.dof))
        if wide and (drawn := self._drawn_anywhere) is not None:
            covariance = grown(covariance, self.moved(f, drawn))
        return covariance

    def _noise_beside(self, grid: Grid, f: Fit) -> float:
        """Noise beside the rounding that a fit leaves; 0: that of each reading is known."""
        if grid.known is not None:
            return 0.0
        used = np.zeros(len(f.residuals))
        used[self.rows] = f.residuals[self.rows]
        return grid.noise(used, f.dof, f.jacobian, weights_of(self.whiten))

    def rounds_to_readings(self, f: Fit) -> bool:
        """Whether some machine with the causes of a fit rounds to all used readings (kept).

        Nothing is left to explain then: a smooth curve of few steps rounds to arches and jumps.
        """
        if not f.effects and self.as_described:
            return True
        many = len(self.rows) >= MANY_ROWS
        if self.grid is None or self.grid.known is not None or self.as_read is None or many:
            return False
        if f not in self._rounds:
            step = self.grid.step[self.rows]
            self._rounds[f] = bool(np.all(step > 0)) and rounds_to_all(
                f.residuals[self.rows], f.jacobian[self.rows], step
            )
        return self._rounds[f]

    @cached_property
    def as_described(self) -> bool:
        """Whether the machine of the set-up gives all used readings, be it just between steps."""
        off = self.model.readings.values - self.model.predict(self.model.start, {})
        return self.grid is not None and self.grid.read_of(off, self.rows)

    @property
    def by_reading(self) -> bool:
        """Whether each of few readings by itself is recorded in a step."""
        few = len(self.rows) < MANY_ROWS
        return few and self.grid is not None and self.grid.by_reading and self.as_read is not None

    @property
    def as_read(self) -> Floats | None:
        """1 for readings that are used, 0 for others, (n,); None: their errors have a memory."""
        if not (self.whiten is identity or isinstance(self.whiten, Repeats | Scaling)):
            return None
        used = np.zeros(len(self.model.readings))
        used[self.rows] = 1.0
        return used

    @property
    def searched_for(self) -> Dictionary | None:
        """The dictionary, if structure was looked for."""
        return vars(self).get("dictionary")

    @cached_property
    def dictionary(self) -> Dictionary:
        """Structure without a name, whitened."""
        known = self.model.dictionary(self.whiten) if self.complete else None
        return known or Dictionary(self.model, self.rows, self.whiten, self.known)

    @cached_property
    def dictionary_as_read(self) -> Dictionary:
        """Structure without a name, not whitened."""
        return Dictionary(self.model, self.rows)

    def white_jacobian(self, f: Fit) -> Floats:
        """White derivative of a fit by its parameters (n, p + k): of few readings kept for some."""
        if len(self.rows) >= MANY_ROWS:
            return self.white(f.jacobian)
        if f not in self._jacobians:
            for oldest in [*self._jacobians][: 1 - KEPT_FITS]:
                del self._jacobians[oldest]
            self._jacobians[f] = self.white(f.jacobian)
        return self._jacobians[f]

    def moved(self, f: Fit, columns: Floats) -> Floats:
        """How far white columns (..., n, m) not in a fit move its parameters, (..., p + k, m)."""
        return np.asarray(f.covariance @ (self.white_jacobian(f).T @ columns))

    def in_basis(self, f: Fit) -> Floats:
        """White derivative of a fit in its basis, (q, p + k): kept."""
        if f not in self._in_basis:
            self._in_basis[f] = np.asarray(f.basis.T @ self.white_jacobian(f))
        return self._in_basis[f]

    @cached_property
    def _jacobians(self) -> dict[Fit, Floats]:
        return {}

    @cached_property
    def _in_basis(self) -> dict[Fit, Floats]:
        return {}

    def white(self, columns: Floats) -> Floats:
        """Whiten columns (n, ...) of all readings and take those that are used."""
        white = np.asarray(self.whiten(columns))
        return white if self.complete and len(white) >= MANY_ROWS else white[self.rows]

    def without(self, bad: Integers) -> "Case":
        """Return the case with these readings left out as well."""
        if not len(bad):
            return self
        rows = self.rows[kept_rows(len(self.rows), bad)]
        whiten, linearised, grid = self.whiten, self.linearised, self.grid
        if grid is not None and isinstance(whiten, Repeats):
            # what is left out must not act on its repeats
            grid = grid.without(self.rows[bad])
            whiten = whiten.with_labels(grid.label)
        shared = whiten if isinstance(whiten, Whitener) else correlated(whiten)
        if shared is not None:
            whiten = shared.without(self.rows[bad])
        if whiten is not self.whiten:
            linearised = Linearised(self.model, self.plain.nuisance, whiten)
        plain = fit(self.model, rows, (), self.model.start, {}, whiten)
        case = replace(self, rows=rows, whiten=whiten, plain=plain, grid=grid)
        return replace(case, linearised=linearised)

    @property
    def segments(self) -> list[Integers]:
        """Used readings in a row, indices into the used: noise of different ones is independent."""
        return [some for some in self._of_filters if len(some)]

    @property
    def _of_filters(self) -> list[Integers]:
        """The same of each filter of the whitener."""
        if not isinstance(self.whiten, Whitener):
            return [np.arange(len(self.rows))]
        place = np.full(len(self.model.readings), -1)
        place[self.rows] = np.arange(len(self.rows))
        every = [place[rows] for rows, _ in self.whiten.filters]
        return [some[some >= 0] for some in every]

    def exact(self, f: Fit) -> bool:
        """Whether a fit leaves nothing that is evidence: there is nothing to explain then."""
        return rms(f.residuals[self.rows]) < self.least_rms

    @cached_property
    def least_rms(self) -> float:
        """Rms of what rounding leaves of exact readings, or of the least noise."""
        readings = self.model.readings
        size = float(np.max(np.abs(readings.values), initial=1.0))
        for recorded in readings.numbers:
            size = max(size, float(np.max(np.abs(recorded), initial=1.0)))
        return max(EXACT * size, MIN_STEP, float(np.sqrt(np.mean(np.square(readings.least)))))

    @property
    def least_rss(self) -> float:
        """Sum of squares of readings that a set of causes fits exactly."""
        return self.plain.dof * self.least_rms**2


def _tail(gain: float, k: int, f: Fit, variance: float) -> float:
    """Probability that noise alone gains as much by k parameters (Fisher's distribution)."""
    return float(special.fdtrc(k, max(f.dof, 1), gain / k / max(variance, TINY)))


def kept_rows(n: int, bad: Integers) -> Flags:
    """Mask of the readings that stay."""
    return np.isin(np.arange(n), bad, invert=True)
