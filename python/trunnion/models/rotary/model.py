"""The model of a sweep that the diagnosis engine asks, and what a diagnosis says of the axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import special

from trunnion.base.arguments import checked
from trunnion.base.errors import DataError, InputError
from trunnion.base.rotation import rotations
from trunnion.base.rows import at_hand, repeats, where
from trunnion.base.units import ARCSEC, Floats, Integers
from trunnion.data.sweep import Sweep
from trunnion.diagnosis.effect import TURNED_ONCE, Effect, EffectLike, EffectValues, Values
from trunnion.diagnosis.model import (
    FINEST_NOISE,
    TURNED,
    Covariate,
    Model,
    Nuisance,
    Readings,
    Uncertainty,
)
from trunnion.diagnosis.one_effect import OneEffect
from trunnion.diagnosis.own_effects import with_own
from trunnion.diagnosis.whitening import Scaling, identity
from trunnion.machine.estimate import Estimate
from trunnion.models.rotary.geometry import Geometry, targets_of
from trunnion.models.rotary.motions import MOTION_UNIT, MOTIONS, Conditions, Motion, catalogue
from trunnion.models.rotary.passes import check_one_axis

BLOCKS = 10
NOISE_LEVEL = 0.01
MAX_NOISE_RATIO = 20.0  # of two directions: of a laser tracker, or less
DIRECTIONS = ("radial", "tangential", "axial")
#: A target further from its circle than this belongs to no model, mm.
MAX_DISTANCE_MM = 5.0
TARGET_PARAMETERS = 3  # nuisance parameters of a target
NO_AXIS = "a sweep does not say which axis of a machine turned, nor how the instrument stood to it"


@dataclass(frozen=True, eq=False)
class _Turned:
    """Targets at every row: where they are, mm, and the turns that take them there.

    In the frame of the axis (``place``), before its tilt (``inside``), before the error motions
    (``target``), all (n, 3); ``tilt`` (3, 3), ``wobble`` and ``spin`` (n, 3, 3), derivatives by the
    angles first.
    """

    place: Floats
    inside: Floats
    target: Floats
    tilt: Floats
    tilt_by: Floats
    wobble: Floats
    wobble_by: Floats
    spin: Floats


class SweepModel(Model):
    """A sweep, as the diagnosis engine asks for it.

    Readings are row by row: radial, tangential, axial of row 0, then of row 1, ...

    data: Measured sweep.
    effects: Further candidates: ids with a harmonic beyond the default ones (``"radial_12"``), or a
        user's own, whose ``change(data, values)`` gives the change of every reading, µm.
    source: The model whose candidates this one shares (``bind``); None: made for these data.

    Raises DataError: a target with fewer than three positions, or more than 5 mm from its circle.
    """

    def __init__(
        self,
        data: Sweep,
        effects: Sequence[EffectLike | str] = (),
        source: SweepModel | None = None,
    ) -> None:
        self.data = data
        self._labels, self._target = targets_of(data)
        self._turn = np.radians(np.asarray(data.angle_deg))
        self._geometry = Geometry.of(data.position_mm, self._turn, self._target, self._labels)
        self._conditions = Conditions.of(data, self._geometry.frame)
        several = len(self._labels) > 1
        self.nuisance = (
            Nuisance("axis_x_um", "µm"),
            Nuisance("axis_y_um", "µm"),
            Nuisance("axis_rx_arcsec", "arcsec"),
            Nuisance("axis_ry_arcsec", "arcsec"),
            *(
                Nuisance(f"{name} of {label}" if several else name, "µm")
                for label in self._labels
                for name in ("target_x_um", "target_y_um", "target_z_um")
            ),
        )
        self._at: tuple[bytes, Floats] | None = None
        self._local = self._directions()
        self._reference = self._turned(np.zeros(len(self.nuisance)), self._still).place
        measured = (data.position_mm - self._geometry.origin) @ self._geometry.frame
        away = np.einsum("nij,nj->ni", self._local, measured - self._reference)
        self._check_near(away)
        check_one_axis(np.asarray(data.angle_deg), 1e3 * away, self._target)
        n = len(data)
        self.readings = Readings(
            1e3 * away.reshape(-1),
            np.repeat(np.arange(n), 3),
            recorded=(1e3 * data.position_mm.reshape(-1),),
            least=FINEST_NOISE,
        )
        given = effects if source is None else source._given
        self._given: tuple[EffectLike | str, ...] = tuple(given)
        self._motions: dict[str, Motion] = (
            catalogue(self._conditions, self._geometry.targets[:, 2], effects)
            if source is None
            else source._motions
        )
        named = [self._effect(name, motion) for name, motion in self._motions.items()]
        self.effects = with_own(named, self._given, data)
        self._own = self.effects[len(named) :]

    def _check_near(self, away: Floats) -> None:
        off = np.linalg.norm(away, axis=1)
        worst = int(np.argmax(off))
        if off[worst] > MAX_DISTANCE_MM:
            raise DataError(
                f"target {self._labels[self._target[worst]]} ({self.data.place(worst)}): got a "
                f"place {off[worst]:.1f} mm from where its circle and angle_deg put it, expected "
                f"at most {MAX_DISTANCE_MM:.0f} mm"
            )

    def _directions(self) -> Floats:
        """Radial, tangential and axial direction of each row, frame of the axis, (n, 3, 3)."""
        v = self._geometry.targets[self._target]
        at = self._turn + np.arctan2(v[:, 1], v[:, 0])
        c, s, zero = np.cos(at), np.sin(at), np.zeros_like(at)
        axial = np.stack([zero, zero, zero + 1.0], axis=1)
        radial, tangential = np.stack([c, s, zero], axis=1), np.stack([-s, c, zero], axis=1)
        return np.stack([radial, tangential, axial], axis=1)

    # --- readings and derivatives

    @property
    def _still(self) -> Floats:
        return np.zeros((len(self.data), len(MOTIONS)))

    def predict(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Return the readings, µm; a user's own effects are added."""
        place = self._turned(nuisance, self._moved(effects)).place
        out = 1e3 * np.einsum("nij,nj->ni", self._local, place - self._reference).reshape(-1)
        for e in self._own:
            if e.id in effects:
                out = out + np.asarray(e.change(Values(effects[e.id])), dtype=float)
        return np.asarray(out)

    def jacobian(self, nuisance: Floats, effects: EffectValues) -> Floats:
        """Exact derivative by axis average line and targets."""
        turned = self._turned(nuisance, self._moved(effects))
        out = np.zeros((len(nuisance), len(self._turn), 3))
        out[0], out[1] = self._local[:, :, 0], self._local[:, :, 1]
        for j in range(2):
            lever = turned.inside @ turned.tilt_by[j].T * (1e3 * ARCSEC)
            out[2 + j] = np.einsum("nij,nj->ni", self._local, lever)
        own = self._local @ (turned.tilt @ turned.wobble @ turned.spin)
        for target in range(len(self._labels)):
            mine, first = where(self._target == target), 4 + TARGET_PARAMETERS * target
            for j in range(TARGET_PARAMETERS):
                out[first + j, mine] = own[mine, :, j]
        return out.reshape(len(out), -1).T

    def effect_jacobian(
        self, nuisance: Floats, effect: Effect, values: Mapping[str, float]
    ) -> Floats:
        """Exact derivative by an effect's parameters, the effect acting alone."""
        if effect.id not in self._motions:
            return effect.columns(values)
        motion = self._motions[effect.id]
        columns = motion.rates(self._conditions, values)
        by = self._by_motions(nuisance, motion.motion(self._conditions, values))
        out = np.zeros((columns.shape[2], *self._local.shape[:2]))
        # Of most parameters a motion or two; what is zero for all is left out.
        pairs = np.argwhere(np.any(columns != 0, axis=0)).tolist()
        for rows in at_hand(len(columns)):
            for a, k in pairs:
                out[k, rows] += (by[motion.acts[a]][:, rows] * columns[rows, a, k]).T
        return out.reshape(len(out), -1).T

    def _by_motions(self, nuisance: Floats, moved: Floats) -> Floats:
        """Derivative of the readings by the motions, µm by µm and arcsec, (6, 3, n).

        The last one without any motion is kept: the columns of all effects need it.
        """
        still = not np.any(moved)
        key = nuisance.tobytes()
        if still and self._at is not None and self._at[0] == key:
            return self._at[1]
        turned = self._turned(nuisance, moved)
        by = np.empty((len(moved), 3, len(MOTIONS)))
        by[:, :, :3] = turned.tilt
        for j in range(2):
            lever = np.einsum("nij,nj->ni", turned.wobble_by[j], turned.target)
            by[:, :, 3 + j] = lever @ turned.tilt.T
        x, y = turned.target[:, 0], turned.target[:, 1]
        faster = np.stack([-y, x, np.zeros(len(x))], axis=1)
        by[:, :, 5] = np.einsum("nij,nj->ni", turned.wobble, faster) @ turned.tilt.T
        out = np.ascontiguousarray((self._local @ by * (1e3 * MOTION_UNIT)).transpose(2, 1, 0))
        if still:
            self._at = (key, out)
        return out

    def _moved(self, effects: EffectValues) -> Floats:
        """Sum of the error motions of all effects, mm and rad, (n, 6)."""
        out = self._still
        for name, values in effects.items():
            if name in self._motions:
                out = out + self._motions[name].motion(self._conditions, values)
        return out

    def _turned(self, nuisance: Floats, moved: Floats) -> _Turned:
        """Where the targets are under these motions, mm and rad (n, 6)."""
        shift = np.array([nuisance[0], nuisance[1], 0.0]) * 1e-3
        tilt, tilt_by = rotations(np.array([[*nuisance[2:4] * ARCSEC, 0.0]]))
        own = self._geometry.targets + nuisance[4:].reshape(-1, TARGET_PARAMETERS) * 1e-3
        # E_A and E_B tilt, before that the axis turns, with E_C
        tilted = moved[:, 3:5] if np.any(moved[:, 3:5]) else np.zeros((1, 2))
        wobble, wobble_by = rotations(np.column_stack([tilted, np.zeros(len(tilted))]))
        wobble = np.broadcast_to(wobble, (len(moved), 3, 3))
        wobble_by = np.broadcast_to(wobble_by, (3, len(moved), 3, 3))
        at = self._turn + moved[:, 5]
        spin = np.zeros((len(moved), 3, 3))
        spin[:, 0, 0] = spin[:, 1, 1] = np.cos(at)
        spin[:, 1, 0], spin[:, 0, 1] = np.sin(at), -np.sin(at)
        spin[:, 2, 2] = 1.0
        target = np.einsum("nij,nj->ni", spin, own[self._target])
        inside = moved[:, :3] + np.einsum("nij,nj->ni", wobble, target)
        place = shift + inside @ tilt[0].T
        return _Turned(place, inside, target, tilt[0], tilt_by[:, 0], wobble, wobble_by, spin)

    def _effect(self, name: str, motion: Motion) -> Effect:
        bound = OneEffect(self, name)
        return Effect(
            name,
            motion.parameters,
            bound.change,
            bound.jacobian,
            motion.label,
            motion.owner,
            looks_like=TURNED_ONCE if motion.slow and self._conditions.in_turn else "",
        )

    # --- what the engine looks for structure in

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Position, time or order, sense, target."""
        data = self.data
        out = [Covariate("position", np.repeat(data.angle_deg, 3), "deg", period=360.0)]
        if data.time_s is not None:
            out.append(Covariate("time", np.repeat(data.time_s, 3), "s", sequence=True, apart=True))
        order = self.readings.rows.astype(float)
        out.append(Covariate("order of measurement", order, sequence=True, apart=True))
        sense = np.repeat(self._conditions.sense, 3)
        out.append(Covariate("sense of turning", sense, words=TURNED))
        out.append(Covariate("target", np.repeat(np.asarray(data.target), 3), classes=True))
        return tuple(out)

    @property
    def components(self) -> Mapping[str, Floats]:
        """Radial, tangential, axial; of the instrument X, Y, Z."""
        at = np.arange(len(self.readings)) % 3
        along = (self._local @ self._geometry.frame.T).reshape(-1, 3)
        return {
            **{name: (at == i).astype(float) for i, name in enumerate(DIRECTIONS)},
            **dict(zip("XYZ", along.T, strict=True)),
        }

    @property
    def groups(self) -> Integers:
        """Ten blocks of neighbouring positions, all targets together."""
        rank = np.unique(np.round(self.data.angle_deg, 6), return_inverse=True)[1].reshape(-1)
        blocks = min(BLOCKS, int(rank.max()) + 1)
        return np.repeat(rank * blocks // (rank.max() + 1), 3).astype(np.intp)

    @property
    def replicates(self) -> Integers | None:
        """The same target at the same position, reached in the same sense."""
        parts = [np.round(self.data.angle_deg, 6), self._target, self._conditions.sense]
        return repeats(parts, 3)

    def whitener(self, residuals: Floats) -> Callable[[Floats], Floats]:
        """Divide each direction by its noise, taken from second differences along the positions.

        Slow error motions do not count as noise so. Directions whose noise cannot be distinguished
        (F test, 1 %) share one.
        """
        r = residuals.reshape(-1, 3)
        second = [
            (x[:-2] - 2 * x[1:-1] + x[2:]) / np.sqrt(6.0)
            for k in range(len(self._labels))
            for x in [r[self._in_order(k)]]
            if len(x) > 2
        ]
        d = np.concatenate(second) if second else np.zeros((0, 3))
        if len(d) < 6 or not np.all(np.any(d, axis=0)):
            return identity
        size = np.mean(d * d, axis=0)
        freedom = 18.0 / 35.0 * len(d)  # second differences of white noise are correlated
        radial, tangential, axial = map(float, size)
        if _alike(radial, freedom, axial, freedom):
            radial = axial = (radial + axial) / 2
            if _alike(tangential, freedom, radial, 2 * freedom):
                radial = axial = tangential = (2 * radial + tangential) / 3
        noise = np.sqrt([radial, tangential, axial])
        # A direction in which nothing happens has no noise: it does not outweigh the others.
        scale = np.tile(np.maximum(noise, noise.max() / MAX_NOISE_RATIO), len(r))
        scale = scale / np.sqrt(np.mean(scale**2))
        return Scaling(scale)

    def _in_order(self, target: int) -> Integers:
        mine = np.flatnonzero(self._target == target)
        return mine[np.argsort(np.asarray(self.data.angle_deg)[mine], kind="stable")]

    # --- what a user gets

    def bind(self, data: Any) -> SweepModel:
        """Return the same model on another sweep; its axis and targets are its own."""
        if not isinstance(data, Sweep):
            raise InputError(f"other data: got {type(data).__name__}, expected trunnion.Sweep")
        return SweepModel(data, source=self)

    def location_errors(self, nuisance: Floats, effects: EffectValues) -> dict[str, float]:  # noqa: ARG002
        """Shift and tilt of the axis average line from that of the plain circles."""
        named = zip(self.nuisance, nuisance, strict=True)
        return {x.name: float(v) for x, v in named if x.name.startswith("axis_")}

    def extended(
        self,
        nuisance: Floats,
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,
    ) -> ExtendedSweep:
        """Return axis, targets and error motions."""
        g = self._geometry
        tilt = rotations(np.array([[*nuisance[2:4] * ARCSEC, 0.0]]))[0][0]
        own = g.targets + nuisance[4:].reshape(-1, TARGET_PARAMETERS) * 1e-3
        frame = g.frame @ tilt
        return ExtendedSweep(
            point_mm=g.origin + g.frame @ np.array([nuisance[0], nuisance[1], 0.0]) * 1e-3,
            direction=frame[:, 2],
            frame=frame,
            radius_mm={k: float(np.hypot(*v[:2])) for k, v in zip(self._labels, own, strict=True)},
            height_mm={k: float(v[2]) for k, v in zip(self._labels, own, strict=True)},
            source=self,
            **self.estimated(effects, uncertainty, NO_AXIS),
        )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ExtendedSweep(Estimate):
    """What a diagnosis of a sweep says of the axis.

    Attributes
    ----------
    point_mm, direction
        A point of the axis average line, at the middle height of the targets, and its direction,
        in the instrument's frame; a positive position turns right-handed about it.
    frame
        Directions X, Y, Z of the error motions in the instrument's frame, one a column: Z is the
        axis, X the instrument's X (its Y where the axis is within 45° of X) as far as it is square
        to Z.
    radius_mm, height_mm
        Of each target.

    Examples
    --------
    >>> import trunnion as tn
    >>> d = tn.diagnose(tn.read_sweep(tn.sample_path("axis/sweep.csv")))
    >>> sorted(d.model.effects)
    ['axial_2', 'positioning_3']
    """

    point_mm: Floats
    direction: Floats
    frame: Floats
    radius_mm: dict[Any, float]
    height_mm: dict[Any, float]
    source: SweepModel = field(compare=False, repr=False)

    @checked
    def error_motions(self, angle_deg: Floats) -> dict[str, Floats]:
        """Error motions at positions of the axis: EX, EY, EZ in µm, EA, EB, EC in arcsec.

        What depends on time, order or the sense of turning (drift, backlash) is left out.
        """
        angle = np.asarray(angle_deg, dtype=float)
        total = np.zeros((len(angle), len(MOTIONS)))
        for name, values in self.effects.items():
            if name in self.source._motions:
                motion = self.source._motions[name]
                total += motion.motion(Conditions.at(angle), values) / MOTION_UNIT
        return dict(zip(MOTIONS, total.T, strict=True))


def _alike(one: float, one_freedom: float, two: float, two_freedom: float) -> bool:
    """Whether two variances may be the same (F test, both sides)."""
    upper = float(special.fdtrc(one_freedom, two_freedom, one / two))
    return min(upper, 1.0 - upper) > NOISE_LEVEL / 2


@checked
def build(
    data: Sweep,
    _: Any = None,
    effects: Sequence[EffectLike | str] = (),
) -> SweepModel:
    """Build the model of a sweep; no set-up is needed."""
    return SweepModel(data, effects)
