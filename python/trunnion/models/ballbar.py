"""Ball-bar lengths on the diagnosis engine: hybrid machine and plain three-axis circle tests.

One model for both. A reading is the measured length less the length that the nominal machine would
give, in µm. Every effect is a displacement δ of the tool point, or of a part of the bar, and enters
with the bar's direction n: reading += n·δ. A three-axis machine goes where it is told; the hybrid
machine gets there through its loops, and its effects act on the legs, the joints and the wrist,
from where the exact sensitivities take them to the tool point. Always fitted: the ball's centre of
each set-up, and for the hybrid machine the 17 errors of the paper.

Signs of the three-axis machine are those of touches: p_actual = (I + Λ) p + δ with
Λ_ii += ppm, Λ_xy -= squareness_xy, Λ_xz += squareness_xz, Λ_yz -= squareness_yz, and backlash
δ_i -= b/2 · sign of travel. The others:

================  =============================  ===============================================
id                parameters                     what it does
================  =============================  ===============================================
reversal_spike_x  a_um, decay_ms (decay_mm)      δ_x -= a · sign of travel · exp(-t/decay), t since
                                                 the axis reversed (mm of path without feed, time)
gain_mismatch     y_x_ms, z_x_ms (or _um)        an axis lags the first moving axis by this time
                                                 (by this distance along the path without a feed):
                                                 δ_y -= velocity_y · y_x
cyclic_x          a_um, b_um, pitch_mm           δ_x += a cos(2π x/pitch) + b sin(2π x/pitch)
drift_x           rate_um_h                      δ_x += rate · t
ballbar_length    dl_um                          the bar reads longer by dl
================  =============================  ===============================================

On the hybrid machine (legs 1, 2, 3 together, or one of them: ids with ``_1``, ``_2``, ``_3``):

=================  ===========================  ================================================
leg_expansion      ppm[, tau_min]               leg longer by L ppm (1 - exp(-t/tau)); without
                                                times L ppm
lost_motion        b_um                         leg longer by -b/2 · sign of its travel
screw_cyclic       a_um, b_um, pitch_mm         leg longer by a cos(2π L/pitch) + b sin(2π L/pitch)
gravity            k_um                         ends of the legs sink square to them by
                                                k (L/1000 mm)³ · cos(slope): gravity along -Z
wrist_squareness   arcsec                       q5 axis not square to q4: tilt b at place wrist5
base_shift         dy_um, dz_um                 base joint of leg 3 is displaced
base_shift_2       dx_um, dz_um                 base joint of leg 2 is displaced
=================  ===========================  ================================================

Set-up file, table ``[ballbar]``; every key has the default shown::

    [ballbar]
    calibrated = true        # false: the bar's length has an unknown constant, one for all
    repeatability_um = 0.0   # 1 σ of a reading; 0 = unknown, to be estimated
    direction = [0, 0, -1]   # hybrid machine commanded in coordinates: spindle to tool point
    wrist = 1                #   and branch of the wrist, +1 or -1

A machine is hybrid if the data command joints or the set-up has a table ``[hybrid]``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from trunnion.base.errors import DataError, InputError, UnknownNameError
from trunnion.data.ballbar import Ballbar
from trunnion.diagnosis.protocol import (
    Array,
    BaseModel,
    Covariate,
    Effect,
    EffectLike,
    EffectScope,
    EffectValues,
    IntArray,
    Nuisance,
    Parameter,
    Readings,
    Uncertainty,
    as_effect,
)
from trunnion.hybrid.mechanism import Mechanism
from trunnion.hybrid.parameters import PAPER_ERRORS
from trunnion.hybrid.readings import (
    check_enough,
    check_near,
    gradient_with_centres,
    setup_index,
    start_centres,
)
from trunnion.machine.effects import Motion
from trunnion.machine.estimate import Estimate
from trunnion.machine.linear_axes import LinearMotion, Travel
from trunnion.models.candidates import for_compensation
from trunnion.setup import Setup
from trunnion.setup.fields import Flag, Number, Section, Sign, Vector, key

__all__ = ["BallbarModel", "BallbarSettings", "ExtendedBallbarModel"]

AXES = "xyz"
MIN_SINGULAR_VALUE = 3e-5  # of the largest, of columns of unit length
#: Effects that are in the machine's own catalogue, by the same names.
CATALOGUED = (
    *(f"scale_{a}" for a in AXES),
    *(f"backlash_{a}" for a in AXES),
    "squareness_xy",
    "squareness_xz",
    "squareness_yz",
)
DYNAMIC = "it depends on time or on how the axes move, or has no motion(pose, values)"
OF_MECHANISM = "it moves the legs or the wrist of the hybrid machine, not linear axes X, Y, Z"
SMALLEST_PITCH_MM = 4.0
DECAYS = 10
TIME_CONSTANTS = 12
#: Cells of a grid that are divided to find the best value.
MOST_CELLS = 8
#: Travel slower than this fraction of the change from one reading to the next is a standstill.
STANDSTILL = 0.2
#: Cosine between two steps below which the machine has turned back, where no sense is given.
TURNS_BACK = -0.7


@dataclass(frozen=True)
class BallbarSettings:
    """The table ``[ballbar]`` of a set-up; see the module."""

    calibrated: bool = key(True, Flag(), "the length of the ball-bar is known")
    repeatability_um: float = key(0.0, Number(0.0), "standard deviation; 0: to be estimated")
    direction: tuple[float, float, float] = key(
        (0.0, 0.0, -1.0), Vector(3), "from the spindle to the tool point"
    )
    wrist: int = key(1, Sign(), "branch of the wrist of the hybrid machine")

    @classmethod
    def from_setup(cls, setup: Setup | None) -> BallbarSettings:
        """Read the table.

        Raises
        ------
        FileFormatError, InputError
            A key that is none of them, or a value of the wrong kind; with its place in the file.
        """
        return Section.of("ballbar", {} if setup is None else setup.ballbar).build(cls)


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

    def lengths_mm(self, plan: Ballbar) -> Array:
        """Lengths that this machine gives on a plan, (n,); centres as the plan's lengths say."""
        model = BallbarModel(plan, self.setup)
        start = model.start
        for k, nuisance in enumerate(model.nuisance):
            start[k] = self.errors.get(nuisance.name, 0.0)
        effects = {k: v for k, v in self.effects.items() if k in {e.id for e in model.effects}}
        return np.asarray((model.predict(start, effects) + model.reference_um) * 1e-3)


class _Path:
    """How the machine travels: runs, tangents, standstills. Everything (n, ...)."""

    def __init__(self, data: Ballbar, tips: Array) -> None:
        index, _ = setup_index(data)
        step = np.linalg.norm(np.diff(tips, axis=0), axis=1)
        typical = float(np.median(step[step > 1e-9])) if (step > 1e-9).any() else 1.0
        change = (np.diff(index) != 0) | (step > 8 * typical)
        for name in ("sense", "circle", "run"):
            column = data.columns.get(name)
            if column is not None:
                change |= np.asarray(column)[1:] != np.asarray(column)[:-1]
        if data.sense is None:
            change |= _turns_back(tips)
        self.runs: IntArray = np.concatenate([[0], np.cumsum(change)]).astype(np.intp)
        self._check_time(data)
        self.along = np.zeros(len(tips))
        for rows in self.each():
            gone = np.linalg.norm(np.diff(tips[rows], axis=0), axis=1)
            self.along[rows] = np.concatenate([[0.0], np.cumsum(gone)])
        self.tips = tips
        self.tangent = self.rate(tips)
        self.tangent /= np.maximum(np.linalg.norm(self.tangent, axis=1), 1e-12)[:, None]

    def _check_time(self, data: Ballbar) -> None:
        """Refuse rows out of the order of time: where the machine travels is taken from it."""
        if data.time_s is None:
            return
        back = np.flatnonzero((np.diff(data.time_s) < 0) & (np.diff(self.runs) == 0))
        if len(back):
            row = int(back[0]) + 1
            raise DataError(
                f"time_s ({data.place(row)}): got {data.time_s[row]:g} after "
                f"{data.time_s[row - 1]:g}, expected the readings in the order in which they were "
                "taken"
            )

    def each(self) -> list[IntArray]:
        """Rows of each run."""
        return [np.flatnonzero(self.runs == k) for k in range(int(self.runs.max()) + 1)]

    def rate(self, values: Array) -> Array:
        """Change per mm of path of a quantity along each run, second order at the ends too."""
        out = np.zeros_like(values)
        for rows in self.each():
            place = self.along[rows]
            # readings where the machine stood count once
            kept = np.flatnonzero(np.diff(place, prepend=-np.inf) > 1e-9)
            which = np.searchsorted(kept, np.arange(len(rows)), side="right") - 1
            moved = rows[kept]
            if len(moved) == 2:
                out[rows] = values[moved[1]] - values[moved[0]]
            elif len(moved) > 2:
                slope = np.gradient(values[moved], place[kept], axis=0, edge_order=2)
                out[rows] = slope[which]
        return out

    def travel(self, values: Array) -> Array:
        """Sign of travel of a quantity; 0 where it stands still between two signs."""
        rate = self.rate(values)
        out = np.sign(rate)
        for rows in self.each():
            if len(rows) > 2:
                least = STANDSTILL * float(np.max(np.abs(np.diff(rate[rows])), initial=0.0))
                out[rows] = np.where(np.abs(rate[rows]) < least, 0.0, out[rows])
        return out

    def since_reversal(self, sign: Array) -> Array:
        """Path (mm) since the sign last changed in the run; inf before the first change.

        A reversal between two readings counts from where the rate vanishes, the reading nearest.
        """
        out = np.full(len(sign), np.inf)
        for rows in self.each():
            last, since = 0.0, np.inf
            for k, row in enumerate(rows):
                now = sign[row]
                if now == 0.0 and last != 0.0:
                    since = self.along[row]
                elif now != 0.0:
                    if (last != 0.0 and now != last and not np.isfinite(since)) or (
                        last != 0.0 and now != last and self._older(since, rows, k, sign)
                    ):
                        since = 0.5 * (self.along[row] + self.along[rows[k - 1]])
                    last = now
                if np.isfinite(since):
                    out[row] = self.along[row] - since
        return out

    def _older(self, since: float, rows: IntArray, k: int, sign: Array) -> bool:
        """Whether the reversal noted is not the one that ends at this reading."""
        return bool(sign[rows[k - 1]] != 0.0 or since < self.along[rows[k - 1]] - 1e-9)


def _turns_back(tips: Array) -> NDArray[np.bool_]:
    """Steps (n - 1,) with which the machine goes back where it came from: a new run.

    Standstill before such a step belongs to the new run but for its first reading.
    """
    step = np.diff(tips, axis=0)
    size = np.linalg.norm(step, axis=1)
    moving = np.flatnonzero(size > 1e-9)
    way = step[moving] / size[moving, None]
    out = np.zeros(len(step), dtype=bool)
    for k in np.flatnonzero(np.einsum("ij,ij->i", way[:-1], way[1:]) < TURNS_BACK) + 1:
        out[min(moving[k - 1] + 1, moving[k])] = True
    return out


class BallbarModel(BaseModel):
    """Ball-bar lengths, as the diagnosis engine wants them.

    Parameters
    ----------
    data
        Measured lengths with commanded coordinates or joints.
    setup
        Tables ``[ballbar]`` and ``[hybrid]`` are read; None: their defaults.
    effects
        Further candidates: a user's own effects, or ids.

    Raises
    ------
    DataError
        Lengths more than 5 mm from the modelled ones, fewer than three readings in a set-up, or a
        run whose readings are not in the order of time.
    KinematicsError
        Joints or points that the hybrid machine cannot take.
    """

    def __init__(
        self,
        data: Ballbar,
        setup: Setup | None = None,
        effects: Sequence[EffectLike | str] = (),
    ) -> None:
        self.data = data
        self.setup = setup
        self.settings = BallbarSettings.from_setup(setup)
        self.mechanism = self._hybrid()
        self.joints = self._joints() if self.mechanism is not None else None
        self.tips = self._tips()
        self.index, self.labels = setup_index(data)
        check_enough(self.index, self.labels)
        self.path = _Path(data, self.tips)
        self._centres = start_centres(self.tips, data.length_mm, self.index)
        arms = self.tips - self._centres[self.index]
        reference = np.linalg.norm(arms, axis=1)
        check_near(np.asarray(data.length_mm), reference)
        if not (reference > 1e-3).all():
            raise DataError("ball-bar: the commanded points coincide with the ball's centre")
        self.bar = arms / reference[:, None]
        self._seen_axes = [
            [a for a in range(3) if np.abs(self.bar[self.index == k, a]).max() > 1e-3]
            for k in range(len(self.labels))
        ]
        self.reference_um = reference * 1e3
        sigma = self.settings.repeatability_um
        self.readings = Readings(
            (data.length_mm - reference) * 1e3,
            np.arange(len(data)),
            "µm",
            np.full(len(data), sigma) if sigma > 0 else None,
        )
        self.nuisance = self._nuisance()
        self._own = [e for e in effects if not isinstance(e, str)]
        built_in = self._catalogue()
        for name in (e for e in effects if isinstance(e, str)):
            if name not in {e.id for e in built_in}:
                known = ", ".join(e.id for e in built_in)
                raise UnknownNameError(
                    f"effect {name!r} for these ball-bar data; wanted one of: {known}"
                )
        self._at: tuple[bytes, Array, Array] | None = None
        built_in = self._sharpened(built_in)
        self.effects = (*built_in, *(as_effect(e) for e in self._own))

    # --- machine

    def _hybrid(self) -> Mechanism | None:
        if self.data.joints is None and (self.setup is None or not self.setup.hybrid):
            return None
        return Mechanism() if self.setup is None else Mechanism.from_setup(self.setup)

    def _joints(self) -> Array:
        joints = self.data.joints
        if joints is not None:
            return np.asarray(joints)
        nominal = self._machine.nominal
        settings = self.settings
        return nominal.inverse(self._coordinates(), settings.direction, wrist=settings.wrist)

    @property
    def _machine(self) -> Mechanism:
        if self.mechanism is None:
            raise InputError("this model is of a three-axis machine")
        return self.mechanism

    def _coordinates(self) -> Array:
        position = self.data.position_mm
        if position is None:
            raise DataError("ball-bar: got no coordinates, wanted columns x_mm and y_mm")
        if position.shape[1] == 2:
            return np.column_stack([position, np.zeros(len(position))])
        return np.asarray(position)

    def _tips(self) -> Array:
        if self.mechanism is None:
            return self._coordinates()
        return self.mechanism.forward(self._hybrid_joints).tip_mm

    @property
    def _hybrid_joints(self) -> Array:
        if self.joints is None:
            raise InputError("this model is of a three-axis machine")
        return self.joints

    # --- the plain model

    def _nuisance(self) -> tuple[Nuisance, ...]:
        out = []
        if self.mechanism is not None:
            for name in PAPER_ERRORS:
                unit = "µm" if name.endswith("_um") else "arcsec"
                out.append(Nuisance(name, unit, "machine"))
        for label, axes in zip(self.labels, self._seen_axes, strict=True):
            out += [Nuisance(f"centre_{label}_{AXES[a]}_um", "µm") for a in axes]
        if not self.settings.calibrated:
            out.append(Nuisance("ballbar_length_um", "µm"))
        return tuple(out)

    @property
    def _errors(self) -> int:
        return 0 if self.mechanism is None else len(PAPER_ERRORS)

    @property
    def start(self) -> Array:
        """Errors known beforehand, the ball where the nominal machine puts it."""
        start = np.zeros(len(self.nuisance))
        if self.mechanism is not None:
            start[: self._errors] = [self.mechanism.errors.get(n, 0.0) for n in PAPER_ERRORS]
        return start

    @property
    def rank_tolerance(self) -> float:
        """Weaker combinations of the 17 are left alone.

        Errors of 50 µm change the readings of a circle along them by less than the noise, but a
        fit that followed them would take the errors to where derivatives no longer hold. They have
        no gap: the singular values of a circle fall evenly from 1 to 1e-6.
        """
        return MIN_SINGULAR_VALUE

    def _centres_at(self, nuisance: Array) -> Array:
        centres = self._centres.copy()
        at = self._errors
        for k, axes in enumerate(self._seen_axes):
            centres[k, axes] += nuisance[at : at + len(axes)] * 1e-3
            at += len(axes)
        return centres

    def _plain(self, nuisance: Array) -> tuple[Array, Array]:
        """Readings and their derivative without effects (the last ones are kept)."""
        key = nuisance.tobytes()
        if self._at is not None and self._at[0] == key:
            return self._at[1], self._at[2]
        centres = self._centres_at(nuisance)
        if self.mechanism is None:
            arms = self.tips - centres[self.index]
            length = np.linalg.norm(arms, axis=1)
            direction, gradient = arms / length[:, None], np.zeros((len(arms), 0))
        else:
            rest = {k: v for k, v in self.mechanism.errors.items() if k not in PAPER_ERRORS}
            named = dict(zip(PAPER_ERRORS, map(float, nuisance[: self._errors]), strict=True))
            machine = self.mechanism.with_errors(rest | named)
            length, direction, gradient = machine.ballbar(
                self._hybrid_joints, centres[self.index], PAPER_ERRORS
            )
        full = gradient_with_centres(gradient, direction, self.index)
        kept = list(range(self._errors))
        for k, axes in enumerate(self._seen_axes):
            kept += [self._errors + 3 * k + a for a in axes]
        jacobian = full[:, kept]
        readings = length * 1e3 - self.reference_um
        if not self.settings.calibrated:
            readings = readings + nuisance[-1]
            jacobian = np.column_stack([jacobian, np.ones(len(jacobian))])
        self._at = (key, readings, jacobian)
        return readings, jacobian

    def base(self, nuisance: Array) -> Array:
        """Return readings without any effect, µm, exact."""
        return self._plain(nuisance)[0]

    def base_jacobian(self, nuisance: Array) -> Array:
        """Return their derivative by errors, centres and the bar's constant, exact."""
        return self._plain(nuisance)[1]

    # --- the catalogue

    def _read(self, displacement: Array) -> Array:
        """What a displacement of the tool point, (n, 3), does to the readings."""
        return np.asarray(np.einsum("ij,ij->i", self.bar, displacement))

    def _catalogue(self) -> tuple[Effect, ...]:
        out = self._three_axis() if self.mechanism is None else self._hybrid_effects()
        out += self._drifts()
        if self.settings.calibrated:
            out.append(
                _linear(
                    "ballbar_length",
                    {"dl_um": np.ones(len(self.data))},
                    "the ball-bar's length is wrong",
                    "instrument",
                )
            )
        return tuple(out)

    def _moving(self) -> list[int]:
        return [a for a in range(3) if np.ptp(self.tips[:, a]) > 1e-3]

    @cached_property
    def hours(self) -> Array | None:
        """Time since the first reading, h."""
        time = self.data.time_s
        return None if time is None else (np.asarray(time) - float(np.min(time))) / 3600.0

    def _drifts(self) -> list[Effect]:
        hours = self.hours
        if hours is None or np.ptp(hours) == 0:
            return []
        return [
            _linear(
                f"drift_{AXES[a]}",
                {"rate_um_h": self.bar[:, a] * hours},
                f"the tool drifts along {AXES[a].upper()}",
            )
            for a in self._moving()
        ]

    @property
    def _travel(self) -> Travel:
        """Travel of X, Y, Z along the readings."""
        low, high = self.tips.min(axis=0), self.tips.max(axis=0)
        return Travel(tuple(map(float, (low + high) / 2)), tuple(map(float, (high - low) / 2)))

    def _three_axis(self) -> list[Effect]:
        moving = self._moving()
        # From the centre: the constant part is the centre's anyway, and columns stay small.
        place = self.tips - self._centres[self.index]
        out = []
        for a in moving:
            name, letter = AXES[a], AXES[a].upper()
            column = self.bar[:, a] * place[:, a] * 1e-3
            out.append(_linear(f"scale_{name}", {"ppm": column}, f"the {letter} scale is wrong"))
        for i, j, g in ((0, 1, -1.0), (0, 2, 1.0), (1, 2, -1.0)):
            if i in moving and j in moving:
                name = f"squareness_{AXES[i]}{AXES[j]}"
                column = g * self.bar[:, i] * place[:, j] * 1e3 / ARCSEC_PER_RAD
                words = f"{AXES[i].upper()} and {AXES[j].upper()} are not square"
                out.append(_linear(name, {"arcsec": column}, words))
        for a in moving:
            sign = self.path.travel(self.tips[:, a])
            if not (np.any(sign > 0) and np.any(sign < 0)):
                continue
            name, letter = AXES[a], AXES[a].upper()
            out.append(
                _linear(
                    f"backlash_{name}",
                    {"b_um": -0.5 * sign * self.bar[:, a]},
                    f"the {letter} axis has backlash",
                )
            )
            out += self._spike(a, sign)
        out += self._gain_mismatch(moving)
        for a in moving:
            place_a = self.tips[:, a]
            out += self._cyclic(
                f"cyclic_{AXES[a]}",
                [(place_a, self.bar[:, a])],
                f"the {AXES[a].upper()} axis has a cyclic error",
                LinearMotion(f"cyclic_{AXES[a]}", self._travel),
            )
        return out

    @cached_property
    def speed_mm_s(self) -> Array | None:
        """Speed along the path: from the feed, else from the times, else None."""
        if self.data.feed_mm_min is not None:
            return np.asarray(self.data.feed_mm_min) / 60.0
        if self.data.time_s is None:
            return None
        pace = self.path.rate(np.asarray(self.data.time_s, dtype=float))
        good = pace > 1e-9
        if not good.any():
            return None
        return np.where(good, 1.0 / np.where(good, pace, 1.0), float(np.median(1.0 / pace[good])))

    def _spike(self, axis: int, sign: Array) -> list[Effect]:
        since = self.path.since_reversal(sign)
        if not np.isfinite(since).any():
            return []
        speed = self.speed_mm_s
        if speed is None:
            name, past = "decay_mm", since
        else:
            name, past = "decay_ms", since / speed * 1e3
        inside = past[np.isfinite(past) & (past > 0)]
        if not len(inside):
            return []
        shortest = float(np.quantile(inside, 0.02)) / 2
        grid = tuple(map(float, np.geomspace(shortest, 60 * shortest, DECAYS)))
        reach = -sign * self.bar[:, axis]

        def shape(decay: float) -> Array:
            return np.where(np.isfinite(past), np.exp(-np.minimum(past / decay, 700.0)), 0.0)

        def change(data: Any, v: Mapping[str, float]) -> Array:  # noqa: ARG001
            return np.asarray(v["a_um"] * reach * shape(v[name]))

        def jacobian(data: Any, v: Mapping[str, float]) -> Array:  # noqa: ARG001
            own = reach * shape(v[name])
            finite = np.where(np.isfinite(past), past, 0.0)
            return np.column_stack([own, v["a_um"] * own * finite / v[name] ** 2])

        decay = Parameter(name, grid=grid, bounds=(shortest / 5, 300 * shortest))
        words = f"the {AXES[axis].upper()} axis sticks when it reverses"
        parameters = (Parameter("a_um"), decay)
        return [Effect(f"reversal_spike_{AXES[axis]}", parameters, change, jacobian, words=words)]

    def _gain_mismatch(self, moving: list[int]) -> list[Effect]:
        if len(moving) < 2:
            return []
        speed = self.speed_mm_s
        unit = "um" if speed is None else "ms"
        # A distance in µm per unit of the path; a velocity in mm/s makes µm of ms.
        size = np.ones(len(self.tips)) if speed is None else speed
        first, *others = moving
        columns = {
            f"{AXES[a]}_{AXES[first]}_{unit}": -self.path.tangent[:, a] * size * self.bar[:, a]
            for a in others
        }
        return [_linear("gain_mismatch", columns, "the axes follow with different lags")]

    def _cyclic(
        self,
        name: str,
        parts: Sequence[tuple[Array, Array]],
        words: str,
        motion: Motion | None = None,
    ) -> list[Effect]:
        """Periodic error of positions (mm) that enter the readings with weights, summed."""
        travel = max(float(np.ptp(place)) for place, _ in parts)
        # Readings lie unevenly along an axis, so pitches below two of their gaps can be told.
        shortest = max(SMALLEST_PITCH_MM, travel / 100)
        longest = travel / 2
        if longest <= shortest:
            return []
        waves = np.arange(1 / longest, 1 / shortest, 1 / (2 * travel))
        bounds = (0.9 / waves[-1], 1.1 / waves[0])
        pitch = Parameter("pitch_mm", grid=tuple(map(float, 1 / waves)), bounds=bounds)

        def waves_at(p: float) -> tuple[Array, Array]:
            cosine = sum(w * np.cos(2 * np.pi * x / p) for x, w in parts)
            sine = sum(w * np.sin(2 * np.pi * x / p) for x, w in parts)
            return np.asarray(cosine), np.asarray(sine)

        def change(data: Any, v: Mapping[str, float]) -> Array:  # noqa: ARG001
            cosine, sine = waves_at(v["pitch_mm"])
            return np.asarray(v["a_um"] * cosine + v["b_um"] * sine)

        def jacobian(data: Any, v: Mapping[str, float]) -> Array:  # noqa: ARG001
            p = v["pitch_mm"]
            slope = sum(
                w
                * (2 * np.pi * x / p**2)
                * (v["a_um"] * np.sin(2 * np.pi * x / p) - v["b_um"] * np.cos(2 * np.pi * x / p))
                for x, w in parts
            )
            return np.column_stack([*waves_at(p), np.asarray(slope)])

        parameters = (Parameter("a_um"), Parameter("b_um"), pitch)
        return [Effect(name, parameters, change, jacobian, motion=motion, words=words)]

    # --- the hybrid machine's

    def _hybrid_effects(self) -> list[Effect]:
        legs = (0, 1, 2)
        parts = [f"end{k + 1}_{axis}_um" for k in legs for axis in "xy"]
        others = [
            "wrist5_b_arcsec",
            "base3_y_um",
            "base3_z_um",
            "base2_x_um",
            "base2_z_um",
        ]
        names = ("e5_um", "e6_um", "e7_um", *parts, *others)
        found = self._machine.sensitivity(self._hybrid_joints, names)
        reach = np.einsum("ij,ijk->ik", self.bar, found.tip)
        column = dict(zip(names, reach.T, strict=True))
        lengths = self._hybrid_joints[:, :3]
        per_leg = [reach[:, k] for k in legs]
        out: list[Effect] = []
        groups = [("", legs, "the legs"), *((f"_{k + 1}", (k,), f"leg {k + 1}") for k in legs)]
        for suffix, members, who in groups:
            grows = sum(per_leg[k] * lengths[:, k] * 1e-3 for k in members)
            many = len(members) > 1
            out.append(
                self._expansion(
                    f"leg_expansion{suffix}",
                    np.asarray(grows),
                    f"{who} {'expand' if many else 'expands'}",
                )
            )
        signs = [self.path.travel(lengths[:, k]) for k in legs]
        for suffix, members, who in groups:
            lost = sum(-0.5 * signs[k] * per_leg[k] for k in members)
            words = f"{who} {'have' if len(members) > 1 else 'has'} lost motion"
            out.append(_linear(f"lost_motion{suffix}", {"b_um": np.asarray(lost)}, words))
        for suffix, members, who in groups:
            pairs = [(lengths[:, k], per_leg[k]) for k in members]
            verb = "screws have" if len(members) > 1 else "screw has"
            words = f"{who.removesuffix('s') if len(members) > 1 else who} {verb} a cyclic error"
            out += self._cyclic(f"screw_cyclic{suffix}", pairs, words)
        out.append(_linear("gravity", {"k_um": self._gravity(column)}, "the legs bend by weight"))
        out.append(
            _linear(
                "wrist_squareness",
                {"arcsec": column["wrist5_b_arcsec"]},
                "the wrist's axes are not square",
            )
        )
        out.append(
            _linear(
                "base_shift",
                {"dy_um": column["base3_y_um"], "dz_um": column["base3_z_um"]},
                "the base joint of leg 3 is displaced",
            )
        )
        out.append(
            _linear(
                "base_shift_2",
                {"dx_um": column["base2_x_um"], "dz_um": column["base2_z_um"]},
                "the base joint of leg 2 is displaced",
            )
        )
        return out

    # --- grids

    def _sharpened(self, effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
        """Add to each grid the value that explains these readings best, found between its points.

        Ball-bar effects can stand hundreds of times above the noise: on a plain grid of pitches or
        time constants even the right effect would leave something for others to explain.
        """
        start = self.start
        readings, jacobian = self._plain(start)
        scale = np.linalg.norm(jacobian, axis=0)
        u, s, _ = np.linalg.svd(jacobian / np.where(scale > 0, scale, 1.0), full_matrices=False)
        basis = u[:, s > self.rank_tolerance * s[0]]

        def left(columns: Array) -> Array:
            return np.asarray(columns - basis @ (basis.T @ columns))

        rest = left((self.readings.values - readings)[:, None])[:, 0]

        def sharpen(effect: Effect) -> Effect:
            curved = [p for p in effect.parameters if not p.linear]
            if not curved:
                return effect
            parameter = curved[0]
            linear = [k for k, p in enumerate(effect.parameters) if p.linear]

            def explained(value: float) -> float:
                at = {p.name: value if p is parameter else 0.0 for p in effect.parameters}
                own = left(effect.columns(self.data, at)[:, linear])
                found, *_ = np.linalg.lstsq(own, rest, rcond=1e-6)
                return float(rest @ (own @ found))

            grid = np.sort(np.array(parameter.grid))
            scores = np.array([explained(float(g)) for g in grid])
            # The best cell may look worse than a side lobe until it is divided.
            cells = np.argsort(-scores)[:MOST_CELLS]
            fine = np.unique(
                [
                    grid[c] ** (1 - t) * grid[d] ** t
                    for c in cells
                    for d in (max(c - 1, 0), min(c + 1, len(grid) - 1))
                    for t in (0.0, 0.25, 0.5)
                ]
            )
            best = fine[int(np.argmax([explained(float(g)) for g in fine]))]
            cell = int(np.clip(np.searchsorted(grid, best), 1, len(grid) - 1))
            width = 0.3 * float(np.log(grid[cell] / grid[cell - 1]))
            low, high = best * np.exp(-width), best * np.exp(width)
            found = optimize.minimize_scalar(
                lambda log: -explained(float(np.exp(log))),
                bounds=(float(np.log(low)), float(np.log(high))),
                method="bounded",
                options={"xatol": 1e-5},
            )
            value = float(np.exp(found.x))
            bottom, top = parameter.bounds
            near = [v for v in (value * 0.998, value, value * 1.002) if bottom < v < top]
            full = tuple(map(float, np.sort(np.concatenate([grid, near]))))
            sharp = replace(parameter, grid=full)
            return replace(
                effect, parameters=tuple(sharp if p is parameter else p for p in effect.parameters)
            )

        return tuple(map(sharpen, effects))

    def _expansion(self, name: str, grows: Array, words: str) -> Effect:
        hours = self.hours
        if hours is None or np.ptp(hours) == 0:
            return _linear(name, {"ppm": grows}, words)
        minutes = hours * 60.0
        length = float(np.ptp(minutes))

        def change(data: Any, v: Mapping[str, float]) -> Array:  # noqa: ARG001
            return np.asarray(-v["ppm"] * grows * np.expm1(-minutes / v["tau_min"]))

        def jacobian(data: Any, v: Mapping[str, float]) -> Array:  # noqa: ARG001
            tau = v["tau_min"]
            own = -grows * np.expm1(-minutes / tau)
            slope = -v["ppm"] * grows * np.exp(-minutes / tau) * minutes / tau**2
            return np.column_stack([own, slope])

        grid = tuple(map(float, np.geomspace(length / 40, 4 * length, TIME_CONSTANTS)))
        tau = Parameter("tau_min", grid=grid, bounds=(length / 200, 20 * length))
        return Effect(name, (Parameter("ppm"), tau), change, jacobian, words=words)

    def _gravity(self, column: Mapping[str, Array]) -> Array:
        """Sag of the legs' ends, square to each leg, for 1 µm at 1000 mm and a level leg."""
        passive = np.radians(self._machine.forward(self._hybrid_joints).passive_deg)
        total = np.zeros(len(self.tips))
        for leg, (u, v) in enumerate(((0, 1), (2, 3), (6, 7))):
            su, cu = np.sin(passive[:, u]), np.cos(passive[:, u])
            sv = np.sin(passive[:, v])
            # (0, 0, -1) in the frame Rx(u) Ry(v): -(third row of the rotation).
            x, y = sv * cu, -su
            if leg == 1:
                turn = passive[:, 4]
                x, y = x * np.cos(turn) + y * np.sin(turn), -x * np.sin(turn) + y * np.cos(turn)
            sag = (self._hybrid_joints[:, leg] / 1000.0) ** 3
            total += sag * (x * column[f"end{leg + 1}_x_um"] + y * column[f"end{leg + 1}_y_um"])
        return total

    # --- what the engine looks for structure in

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Angle on the circle, place or joints, sense, run, feed, time or order."""
        data = self.data
        out = []
        for i, j in ((0, 1), (1, 2), (0, 2)):
            flat = np.hypot(self.bar[:, i], self.bar[:, j]) > 0.999
            if flat.mean() > 0.2:
                angle = np.degrees(np.arctan2(self.bar[:, j], self.bar[:, i]))
                plane = AXES[i].upper() + AXES[j].upper()
                angle = np.where(flat, angle, 0.0)
                out.append(Covariate(f"angle in the {plane} plane", angle, "deg", period=360.0))
        if self.joints is None:
            out += [
                Covariate(f"{AXES[a].upper()} position", self.tips[:, a], "mm")
                for a in self._moving()
            ]
        else:
            out += [Covariate(f"length of leg {k + 1}", self.joints[:, k], "mm") for k in range(3)]
            out += [Covariate(f"wrist joint {k + 1}", self.joints[:, k], "deg") for k in (3, 4)]
        if data.sense is not None and np.ptp(data.sense) > 0:
            out.append(Covariate("sense of travel", np.asarray(data.sense), classes=True))
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
    def components(self) -> Mapping[str, Array]:
        """A displacement of the tool point along X, Y, Z, and the bar itself."""
        named = {AXES[a].upper(): self.bar[:, a] for a in self._moving()}
        return {**named, "the length": np.ones(len(self.data))}

    @property
    def groups(self) -> IntArray:
        """Runs, or with fewer than three of them fifths of each run."""
        runs = self.path.runs
        if int(runs.max()) >= 2 and min(np.bincount(self.index)) > 0 and self._runs_share_setups():
            return runs
        out = np.zeros(len(runs), dtype=np.intp)
        for rows in self.path.each():
            out[rows] = np.arange(len(rows)) * 5 // len(rows)
        return out

    def _runs_share_setups(self) -> bool:
        """Whether every set-up has several runs, so that leaving one out keeps its centre."""
        return all(
            len(np.unique(self.path.runs[self.index == k])) > 2 for k in range(len(self.labels))
        )

    @property
    def replicates(self) -> IntArray | None:
        """Readings at one command, in one set-up, in the same sense and at the same feed."""
        commands = self.tips if self.joints is None else self.joints
        parts = [*np.round(commands, 4).T, self.index.astype(float), self._senses()]
        if self.data.feed_mm_min is not None:
            parts.append(np.asarray(self.data.feed_mm_min))
        label = np.unique(np.stack(parts, axis=1), axis=0, return_inverse=True)[1].reshape(-1)
        several = np.bincount(label)[label] > 1
        return np.where(several, label, -1).astype(np.intp) if several.any() else None

    def _senses(self) -> Array:
        if self.data.sense is not None:
            return np.asarray(self.data.sense, dtype=float)
        # Without the column: turn of the tangent about the bar.
        turn = np.cross(self.bar, self.path.tangent)
        largest = np.argmax(np.abs(turn), axis=1)
        return np.asarray(np.sign(np.take_along_axis(turn, largest[:, None], axis=1)[:, 0]))

    # --- what a user gets

    def bind(self, data: Any) -> BallbarModel:
        """Return the same model on other lengths."""
        if not isinstance(data, Ballbar):
            raise InputError(f"other data: got {type(data).__name__}, wanted trunnion.Ballbar")
        return BallbarModel(data, self.setup, self._own)

    def extended(
        self,
        nuisance: Array,
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,
    ) -> ExtendedBallbarModel:
        """Return errors, centres and effects by name, with the set-up."""
        named = {n.name: float(v) for n, v in zip(self.nuisance, nuisance, strict=True)}
        known = DYNAMIC if self.mechanism is None else OF_MECHANISM
        return ExtendedBallbarModel(
            setup=self.setup,
            errors={k: v for k, v in named.items() if k in PAPER_ERRORS},
            centres_um={k: v for k, v in named.items() if k not in PAPER_ERRORS},
            effects={k: dict(v) for k, v in effects.items()},
            **for_compensation(self.effects, effects, () if self.mechanism else CATALOGUED, known),
            **({} if uncertainty is None else uncertainty.fields()),
        )


ARCSEC_PER_RAD = 648000.0 / np.pi


def _linear(
    name: str, columns: Mapping[str, Array], words: str, scope: EffectScope = "machine"
) -> Effect:
    """An effect that is linear in all its parameters."""
    names = tuple(columns)
    design: NDArray[np.float64] = np.column_stack([columns[n] for n in names])

    def change(data: Any, v: Mapping[str, float]) -> Array:  # noqa: ARG001
        return np.asarray(design @ np.array([v[n] for n in names]))

    jacobian: Callable[[Any, Mapping[str, float]], Array] = lambda data, v: design  # noqa: ARG005, E731
    parameters = tuple(Parameter(n) for n in names)
    return Effect(name, parameters, change, jacobian, scope=scope, words=words)


def build(data: Ballbar, setup: Setup | None, effects: Sequence[EffectLike | str]) -> BallbarModel:
    """Build the model of a ball-bar test; a hybrid machine needs a set-up."""
    return BallbarModel(data, setup, effects)
