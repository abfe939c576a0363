"""The model of ball-bar lengths that the diagnosis engine asks, and what a diagnosis says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import DataError, InputError
from trunnion.base.rows import repeats
from trunnion.base.statistics import linear_fit
from trunnion.base.units import Floats, Integers
from trunnion.data.ballbar import Ballbar
from trunnion.diagnosis.effect import ALL_AXES, Effect, EffectLike, EffectValues
from trunnion.diagnosis.fit import variant_columns
from trunnion.diagnosis.gains import gains_beside, left_by
from trunnion.diagnosis.grid import best_place
from trunnion.diagnosis.model import Covariate, Model, Nuisance, Readings, Uncertainty
from trunnion.diagnosis.noise_in_runs import noise_in_runs
from trunnion.diagnosis.own_effects import with_own
from trunnion.hybrid.readings import (
    check_enough,
    check_near,
    gradient_with_centres,
    setup_index,
    start_centres,
)
from trunnion.machine.estimate import Estimate
from trunnion.machine.linear_axes import LinearMotion, Travel
from trunnion.models.ballbar.effects import (
    BACKLASH_SLOPE,
    BAR_LENGTH,
    MIN_REACH,
    SHIFT,
    Bar,
    ballbar_length,
    between_readings,
    drifts,
    setup_shift,
)
from trunnion.models.ballbar.machine import ThreeAxis, machine_of
from trunnion.models.ballbar.path import AXES, Path
from trunnion.models.ballbar.settings import BallbarSettings
from trunnion.setup import Setup

SENSES = ((1.0, "counter-clockwise"), (-1.0, "clockwise"))
FIRST_ORDER_NOISE_UM = 0.03  # of an instrument that shows 0.1 µm; formulas to first order miss less
MAX_SPREAD_UM = 500.0  # of commanded lengths, about their nominal one

STEP = "a backlash of the {} axis that is another on either side of the middle"
STEP_UM = 5.0  # of the two, what they may differ by
RARE = 6.0  # of -2 ln L, by which it has to explain better: one in 20 beforehand
BY_CHANCE = 10.0  # of -2 ln L, that one more cause among all has to gain

POINTS_KEPT = 4  # the start, to which every fit returns, and the last ones
TRIAL_NUMBERS = 1 << 20  # readings of the trial values that are compared at once
MIN_SINGULAR_VALUE = 3e-5  # of the largest, of columns of unit length


class BallbarModel(Model):
    """Ball-bar lengths, as the diagnosis engine asks for them.

    Parameters
    ----------
    data
        Measured lengths with commanded coordinates or joints.
    setup
        Tables ``[ballbar]`` and ``[hybrid]`` are read; None: their defaults.
    effects
        Further candidates: a user's own effects, or ids.
    travel
        Of X, Y and Z, about the middle of which guides are bent; None: that of the readings.
    at_reversals
        Whether readings where an axis stands still between two ways are used. Nobody knows on
        which side of its play it stands there; a few are left out.

    Raises
    ------
    DataError
        Lengths more than 5 mm from the modelled ones, fewer than three readings in a set-up, or a
        run whose readings are not in the order of time, or a circle round which they go the other
        way than their `sense` says.
    KinematicsError
        Joints or points that the hybrid machine cannot take.

    Examples
    --------
    >>> import trunnion as tn
    >>> d = tn.diagnose(tn.read_ballbar(tn.sample_path("ballbar/circle.csv")))
    >>> sorted(d.model.effects)
    ['backlash_y', 'squareness_xy']
    """

    def __init__(
        self,
        data: Ballbar,
        setup: Setup | None = None,
        effects: Sequence[EffectLike | str] = (),
        travel: Travel | None = None,
        *,
        at_reversals: bool = False,
    ) -> None:
        self.data = data
        self.setup = setup
        self.settings = BallbarSettings.from_setup(setup)
        self.machine = machine_of(data, setup, self.settings)
        self.index, self.labels = setup_index(data)
        check_enough(self.index, self.labels)
        tips, lengths = self.machine.tips, np.asarray(data.length_mm)
        self.path = Path(data, tips, travel)
        self._centres = start_centres(tips, lengths, self.index)
        arms = tips - self._centres[self.index]
        reference = np.linalg.norm(arms, axis=1)
        check_near(lengths, reference)
        if not (reference > 1e-3).all():
            raise DataError("ball-bar: the commanded points coincide with the ball's centre")
        rows = np.arange(len(data))
        if not at_reversals and isinstance(self.machine, ThreeAxis):
            rows = self.path.between_reversals()
        if len(rows) < len(data):
            data, lengths, tips = data[rows], lengths[rows], tips[rows]
            arms, reference, self.index = arms[rows], reference[rows], self.index[rows]
            self.machine = machine_of(data, setup, self.settings)
            self.path = Path(data, tips, self.path.used)
        self._used = data
        self.bar = arms / reference[:, None]
        reach = np.zeros((len(self.labels), 3))
        np.maximum.at(reach, self.index, np.abs(self.bar))
        self._seen_axes = [np.flatnonzero(row > MIN_REACH) for row in reach]
        self.reference_um = reference * 1e3
        sigma = self.settings.repeatability_um
        self.readings = Readings(
            (lengths - reference) * 1e3,
            rows,
            "µm",
            np.full(len(data), sigma) if sigma > 0 else None,
            recorded=(lengths * 1e3,),
            least=FIRST_ORDER_NOISE_UM,
        )
        self.nuisance = self._nuisance()
        self._known: dict[bytes, tuple[Floats, Floats]] = {}
        self._given = tuple(effects)
        if self._given:
            with_own(self._catalogue(), self._given, data, described=self)  # checked at once

    def _nuisance(self) -> tuple[Nuisance, ...]:
        """Errors of the machine, centres along the axes that the bar shows, the bar's constant."""
        out = list(self.machine.errors)
        for label, axes in zip(self.labels, self._seen_axes, strict=True):
            out += [Nuisance(f"centre_{label}_{AXES[a]}_um", "µm") for a in axes]
        if not self.settings.calibrated:
            out.append(Nuisance("ballbar_length_um", "µm"))
        return tuple(out)

    @cached_property
    def effects(self) -> tuple[Effect, ...]:  # type: ignore[override]
        """The catalogue, its grids with the values that are best here, and the user's own."""
        found = self._sharpened(self._catalogue())
        return with_own(found, self._given, self._used, described=self)

    def _catalogue(self) -> list[Effect]:
        bar = Bar(self.bar, self._centres[self.index])
        out = self.machine.effects(self.path, bar) + drifts(self.path, bar)
        out += setup_shift(*self._moments, self.index, bar, self.path.moving)
        if self.settings.calibrated:
            several = sum(effect.id.startswith("scale_") for effect in out) > 1
            out.append(ballbar_length(len(self._used), ALL_AXES if several else ""))
        return out

    @cached_property
    def _moments(self) -> tuple[Floats, str]:
        """Times, or row numbers where there are none, (n,), and what the moment among them is."""
        time = self._used.time_s
        if time is None or np.ptp(time) <= 0:
            return np.arange(len(self._used), dtype=np.float64), "row"
        return np.asarray(time, dtype=np.float64), "t0_s"

    def instrument_size(self, effect: Effect) -> float | None:
        """Nominal length of the bar, if all circles have one: its error is that of one bar."""
        own = effect.id != BAR_LENGTH or not self.settings.one_bar
        if own or np.ptp(self.reference_um) > MAX_SPREAD_UM:
            return None
        return float(np.mean(self.reference_um)) * 1e-3

    # --- the plain model

    @property
    def start(self) -> Floats:
        """Errors known beforehand, the ball where the nominal machine puts it."""
        start = np.zeros(len(self.nuisance))
        start[: len(self.machine.errors)] = self.machine.start
        return start

    @property
    def rank_tolerance(self) -> float:
        """Weaker combinations of the 17 are left alone.

        Errors of 50 µm change the readings of a circle along them by less than the noise, but a
        fit that followed them would take the errors to where derivatives no longer hold. They have
        no gap: the singular values of a circle fall evenly from 1 to 1e-6.
        """
        return MIN_SINGULAR_VALUE

    def _centres_at(self, nuisance: Floats) -> Floats:
        centres = self._centres.copy()
        at = len(self.machine.errors)
        for k, axes in enumerate(self._seen_axes):
            centres[k, axes] += nuisance[at : at + len(axes)] * 1e-3
            at += len(axes)
        return centres

    def _plain(self, nuisance: Floats) -> tuple[Floats, Floats]:
        """Readings and their derivative without effects; those at the last points are kept."""
        key = nuisance.tobytes()
        if key in self._known:
            self._known[key] = self._known.pop(key)
            return self._known[key]
        errors = len(self.machine.errors)
        centres = self._centres_at(nuisance)[self.index]
        length, direction, gradient = self.machine.lengths(nuisance[:errors], centres)
        full = gradient_with_centres(gradient, direction, self.index)
        kept = list(range(errors))
        for k, axes in enumerate(self._seen_axes):
            kept += [errors + 3 * k + int(a) for a in axes]
        jacobian = full[:, kept]
        readings = length * 1e3 - self.reference_um
        if not self.settings.calibrated:
            readings = readings + nuisance[-1]
            jacobian = np.column_stack([jacobian, np.ones(len(jacobian))])
        if len(self._known) == POINTS_KEPT:
            del self._known[next(iter(self._known))]
        self._known[key] = readings, jacobian
        return readings, jacobian

    def base(self, nuisance: Floats) -> Floats:
        """Return readings without any effect, µm, exact."""
        return self._plain(nuisance)[0]

    def base_jacobian(self, nuisance: Floats) -> Floats:
        """Return their derivative by errors, centres and the bar's constant, exact."""
        return self._plain(nuisance)[1]

    def _sharpened(self, effects: Sequence[Effect]) -> list[Effect]:
        """Add to each grid the value that explains these readings best, found between its points.

        Ball-bar effects can stand hundreds of times above the noise: on a plain grid of pitches or
        time constants even the right effect would leave something for others to explain.
        """
        readings, jacobian = self._plain(self.start)
        residual = self.readings.values - readings
        judged = linear_fit(jacobian, residual, tolerance=self.rank_tolerance)
        basis = linear_fit(jacobian @ judged.directions.T, residual, basis=True).basis
        residual = residual - basis @ (basis.T @ residual)
        return [self._sharp(e, basis, residual) for e in effects]

    def _sharp(self, effect: Effect, basis: Floats, residual: Floats) -> Effect:
        """Add the best value to the grid of an effect's nonlinear parameter, if it has one."""
        if effect.linear:
            return effect
        parameter = next(p for p in effect.parameters if not p.linear)
        some = max(1, TRIAL_NUMBERS // len(residual))

        def explained(trials: Floats) -> Floats:
            at = [
                effect.values(trial if p is parameter else 0.0 for p in effect.parameters)
                for trial in map(float, trials)
            ]
            parts = (at[first : first + some] for first in range(0, len(at), some))
            columns = (variant_columns(self, effect, self.start, part) for part in parts)
            return np.concatenate([gains_beside(x, basis, residual) for x in columns])

        grid = np.sort(np.array(parameter.grid))
        if effect.id == SHIFT:
            near = self._moments_near(grid, explained)
        else:
            value = best_place(explained, grid.tolist())
            bottom, top = parameter.bounds
            near = [v for v in (value * 0.998, value, value * 1.002) if bottom < v < top]
        sharp = replace(parameter, grid=tuple(map(float, np.unique([*grid, *near]))))
        parameters = tuple(sharp if p is parameter else p for p in effect.parameters)
        return replace(effect, parameters=parameters)

    def _moments_near(self, grid: Floats, explained: Callable[[Floats], Floats]) -> list[float]:
        """The moment between readings that explains most, and its neighbours."""
        best = int(np.argmax(explained(grid)))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
        every = between_readings(self._moments[0])
        some = every[(every >= low) & (every <= high)]
        at = int(np.argmax(explained(some)))
        return [float(t) for t in some[max(at - 1, 0) : at + 2]]

    # --- what the engine looks for structure in

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Angle on the circle, place or joints, sense, run, feed, time or order."""
        data = self._used
        out: list[Covariate] = []
        for i, j in ((0, 1), (1, 2), (0, 2)):
            flat = np.hypot(self.bar[:, i], self.bar[:, j]) > 0.999
            if flat.mean() > 0.2:
                angle = np.degrees(np.arctan2(self.bar[:, j], self.bar[:, i]))
                plane = AXES[i].upper() + AXES[j].upper()
                angle = np.where(flat, angle, 0.0)
                out.append(Covariate(f"angle in the {plane} plane", angle, "deg", period=360.0))
        out += self.machine.covariates(self.path)
        if data.sense is not None and np.ptp(data.sense) > 0:
            sense = np.asarray(data.sense)
            out.append(Covariate("sense of travel", sense, classes=True, words=SENSES))
        if int(self.path.runs.max()) > 0:
            out.append(Covariate("run", self.path.runs, classes=True))
        if data.feed_mm_min is not None and np.ptp(data.feed_mm_min) > 0:
            out.append(Covariate("feed", np.asarray(data.feed_mm_min), "mm/min"))
        if data.time_s is not None:
            out.append(Covariate("time", np.asarray(data.time_s, float), "s", sequence=True))
        out.append(
            Covariate("order of measurement", np.arange(len(data), dtype=float), sequence=True)
        )
        return tuple(out)

    @property
    def components(self) -> Mapping[str, Floats]:
        """A displacement of the tool point along X, Y, Z, and the bar itself."""
        named = {AXES[a].upper(): self.bar[:, a] for a in self.path.moving}
        return {**named, "the length": np.ones(len(self._used))}

    def supposed(self, effects: EffectValues) -> Mapping[str, Floats]:
        """Beside other causes a backlash that grows may be one that changes in the middle.

        Where that explains more than all that grow do, but for what more of them gain by chance.
        """
        known = {e.id: e for e in self.effects if e.id in effects}
        grow = [name for name in known if name.startswith(BACKLASH_SLOPE)]
        if not grow or len(known) < 2:
            return {}
        values = {id_: effects[id_] for id_ in known}
        own = {k: self.effect_jacobian(self.start, e, values[k]) for k, e in known.items()}
        always = [self.base_jacobian(self.start), *(x for k, x in own.items() if k not in grow)]
        r = self.readings.values - self.predict(
            self.start, {k: v for k, v in values.items() if k not in grow}
        )
        least = left_by(np.column_stack([*always, *(own[k] for k in grow)]), r)
        least *= np.exp((BY_CHANCE * (len(grow) - 1) - RARE) / len(r))
        return {
            STEP.format(AXES[axis].upper()): STEP_UM * step[:, None]
            for axis, step in self.path.steps_of_backlash(self.bar)
            if left_by(np.column_stack([*always, step]), r) < least
        }

    @property
    def groups(self) -> Integers:
        """Runs, or with fewer than three of them fifths of each run."""
        runs = self.path.runs
        if int(runs.max()) >= 2 and self._runs_share_setups():
            return runs
        out = np.zeros(len(runs), dtype=np.intp)
        for rows in self.path.each():
            out[rows] = np.arange(len(rows)) * 5 // len(rows)
        return out

    def _runs_share_setups(self) -> bool:
        """Whether every set-up has several runs, so that leaving one out keeps its centre."""
        runs = self.path.runs
        seen = np.zeros((int(self.index.max()) + 1, int(runs.max()) + 1), dtype=bool)
        seen[self.index, runs] = True
        return bool(seen.sum(axis=1).min() > 2)

    @property
    def replicates(self) -> Integers | None:
        """Readings at one command, in one set-up, in the same sense and at the same feed."""
        parts = [*np.round(self.machine.commands, 4).T, self.index.astype(float), self._senses()]
        if self._used.feed_mm_min is not None:
            parts.append(np.asarray(self._used.feed_mm_min))
        return repeats(parts)

    def whitener(self, residuals: Floats) -> Callable[[Floats], Floats]:
        """Noise with a memory within each run, if it has one (:mod:`.noise_in_runs`)."""
        return noise_in_runs(self, residuals, self.path.each())

    def _senses(self) -> Floats:
        if self._used.sense is not None:
            return np.asarray(self._used.sense, dtype=float)
        # Without the column: turn of the tangent about the bar.
        turn = np.cross(self.bar, self.path.tangent)
        largest = np.argmax(np.abs(turn), axis=1)
        return np.asarray(np.sign(np.take_along_axis(turn, largest[:, None], axis=1)[:, 0]))

    # --- what a user gets

    @property
    def remarks(self) -> tuple[str, ...]:
        """Say how many readings are left out at reversals."""
        left_out = len(self.data) - len(self._used)
        if not left_out:
            return ()
        return (
            f"{left_out} of {len(self.data)} readings are left out, where an axis just "
            "turns: on which side of its play it stands there is not known.",
        )

    def bind(self, data: Any) -> BallbarModel:
        """Return the same model on other lengths."""
        if not isinstance(data, Ballbar):
            raise InputError(f"other data: got {type(data).__name__}, expected trunnion.Ballbar")
        return BallbarModel(data, self.setup, self._given, self.path.used)

    def beside(self, others: Sequence[Model]) -> Model:
        """Return the same model, guides bent about the middle of what all of them travel.

        Beside circles at another place a bent guide is out of square, too.
        """
        alike = [m for m in others if isinstance(m, BallbarModel)]
        travel = self.path.used.with_more(m.path.used for m in alike)
        if travel == self.path.used:
            return self
        return BallbarModel(self.data, self.setup, self._given, travel)

    def extended(
        self,
        nuisance: Floats,
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,
    ) -> ExtendedBallbarModel:
        """Return errors, centres and effects by name, with the set-up."""
        named = {n.name: float(v) for n, v in zip(self.nuisance, nuisance, strict=True)}
        errors = {n.name for n in self.machine.errors}
        machine = self.machine
        return ExtendedBallbarModel(
            setup=self.setup,
            errors={k: v for k, v in named.items() if k in errors},
            centres_um={k: v for k, v in named.items() if k not in errors},
            **self.estimated(effects, uncertainty, machine.why_not, machine.catalogued),
        )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ExtendedBallbarModel(Estimate):
    """What a diagnosis of ball-bar lengths says of the machine.

    Attributes
    ----------
    setup
        The set-up of the measurement, or None.
    errors
        The hybrid machine's 17, µm and arcsec; empty for a three-axis machine.
    centres_um
        Ball centre of each set-up, from where the nominal machine puts it.
    """

    setup: Setup | None
    centres_um: dict[str, float]

    def lengths_mm(self, plan: Ballbar) -> Floats:
        """Lengths that this machine gives on a plan, (n,); centres as the plan's lengths say."""
        linear = (m for m in self.motions.values() if isinstance(m, LinearMotion))
        measured = next((m.travel for m in linear), None)  # guides are bent about its middle
        model = BallbarModel(plan, self.setup, travel=measured, at_reversals=True)
        start = model.start
        for k, nuisance in enumerate(model.nuisance):
            start[k] = self.errors.get(nuisance.name, 0.0)
        effects = {k: v for k, v in self.effects.items() if k in {e.id for e in model.effects}}
        return np.asarray((model.predict(start, effects) + model.reference_um) * 1e-3)


@checked
def build(data: Ballbar, setup: Setup | None, effects: Sequence[EffectLike | str]) -> BallbarModel:
    """Build the model of a ball-bar test; a hybrid machine needs a set-up."""
    return BallbarModel(data, setup, effects)


def described(data: Ballbar) -> BallbarModel:
    """Return what describes all readings, those where an axis just turns, too."""
    return BallbarModel(data, at_reversals=True)
