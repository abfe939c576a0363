"""Targets on one rotary axis, on the diagnosis engine: circle, axis average line, error motions.

A target fixed to the axis at v (mm, frame of the axis average line) is measured at ::

    p = O + F A [ o + E_xyz + T(E_A, E_B) Rz(θ + E_C) v ] + noise

F, O: the axis average line as the plain circles give it; o, A: its shift and tilt from there; v:
one for each target (its radius, phase and height). All of these are nuisance. E: the error motions
of ISO 230-7 at the commanded position θ: radial E_X, E_Y and axial E_Z (µm), tilt E_A, E_B and
angular positioning E_C (arcsec), in the frame of the axis, whose third direction is the one about
which a positive position turns right-handed. Effects are error motions; formulas are in
docs/effects.md. Predictions and derivatives are exact.

A reading is one coordinate of a target in its own radial, tangential and axial direction, in µm
from the plain circle. Axes position less well than instruments measure, so that the three are
brought to one noise before anything is tested.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy import optimize, special

from trunnion.base.errors import DataError, InputError
from trunnion.data.sweep import Sweep
from trunnion.diagnosis.protocol import (
    Array,
    BaseModel,
    Covariate,
    Effect,
    EffectLike,
    EffectValues,
    IntArray,
    Nuisance,
    Parameter,
    Readings,
    Uncertainty,
    Values,
)
from trunnion.machine.estimate import Estimate
from trunnion.models.candidates import for_compensation, own_effects

__all__ = ["Circle", "ExtendedSweep", "SweepModel", "circles"]

ARCSEC = np.pi / 648000
HARMONICS = 8
DEGREE = 4
BLOCKS = 10
MOST_PERIODS = 120
PIVOTS = 25
FEWEST_OF_A_SENSE = 3  # one row after a return shows nothing of reversal
NOISE_LEVEL = 0.01
MOTIONS = ("EX", "EY", "EZ", "EA", "EB", "EC")  # µm, µm, µm, arcsec, arcsec, arcsec
DIRECTIONS = ("radial", "tangential", "axial")
MOTION_UNIT = np.array([1e-3, 1e-3, 1e-3, ARCSEC, ARCSEC, ARCSEC])  # to mm and rad
#: A target further from its circle than this belongs to no model, mm.
FAR_OFF_MM = 5.0
NO_AXIS = "a sweep does not say which axis of a machine turned, nor how the instrument stood to it"
OWN_UM = 3  # nuisance parameters of a target


@dataclass(frozen=True)
class _Course:
    """What error motions depend on: position, time or order, sense of turning. Shape (n,) each."""

    angle_deg: Array
    elapsed: Array
    sense: Array
    instrument: Array  # (3, 3): instrument axes in the frame of the axis, one a column
    timed: bool = False  # elapsed in hours; else the order, 0 to 1

    @classmethod
    def of(cls, data: Sweep, frame: Array) -> _Course:
        angle = np.asarray(data.angle_deg)
        n = len(angle)
        if data.time_s is not None:
            elapsed = (np.asarray(data.time_s) - np.min(data.time_s)) / 3600.0
        else:
            elapsed = np.linspace(0.0, 1.0, n)
        return cls(angle, elapsed, _senses(data), frame.T, data.time_s is not None)


@dataclass(frozen=True)
class _Motion:
    """A candidate error motion.

    ``columns(course, values)``: derivative of EX .. EC (µm, arcsec) by each parameter, (n, 6, k).
    The motion is linear in the parameters that have no grid, and zero where those are.
    """

    parameters: tuple[Parameter, ...]
    columns: Callable[[_Course, Array], Array]
    words: str

    def motion(self, course: _Course, values: Array) -> tuple[Array, Array]:
        """Motion, mm and rad (n, 6), and its derivative by each parameter (n, 6, k)."""
        columns = self.columns(course, values) * MOTION_UNIT[:, None]
        linear = np.array([p.linear for p in self.parameters])
        return columns[:, :, linear] @ values[linear], columns


# --- the model


class SweepModel(BaseModel):
    """A sweep, as the diagnosis engine wants it.

    Readings are row by row: radial, tangential, axial of row 0, then of row 1, ...

    Parameters
    ----------
    data
        Measured sweep.
    effects
        Further candidates: ids with a harmonic beyond the default ones (``"radial_12"``), or a
        user's own, whose ``change(data, values)`` gives the change of every reading, µm.
    source
        The model whose candidates this one shares (``bind``); None: made for these data.

    Raises
    ------
    DataError
        A target with fewer than three positions, or more than 5 mm from its circle.
    """

    def __init__(
        self,
        data: Sweep,
        effects: Sequence[EffectLike | str] = (),
        source: SweepModel | None = None,
    ) -> None:
        self.data = data
        self._labels, self._target = _targets(data)
        self._turn = np.radians(np.asarray(data.angle_deg))
        self._geometry = _Geometry.of(data.position_mm, self._turn, self._target, self._labels)
        self._course = _Course.of(data, self._geometry.frame)
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
        self._local = self._directions()
        self._reference = self._places(np.zeros(len(self.nuisance)), self._still)[0]
        measured = (data.position_mm - self._geometry.origin) @ self._geometry.frame
        away = np.einsum("nij,nj->ni", self._local, measured - self._reference)
        self._check_near(away)
        n = len(data)
        self.readings = Readings(1e3 * away.reshape(-1), np.repeat(np.arange(n), 3), "µm")
        if source is None:
            self._motions = _catalogue(self._course, self._geometry, effects)
            self._own: tuple[Effect, ...] = own_effects(effects, list(self._motions))
        else:
            self._motions, self._own = source._motions, source._own
        self.effects = (*(self._effect(i, m) for i, m in self._motions.items()), *self._own)

    def _check_near(self, away: Array) -> None:
        off = np.linalg.norm(away, axis=1)
        worst = int(np.argmax(off))
        if off[worst] > FAR_OFF_MM:
            raise DataError(
                f"target {self._labels[self._target[worst]]} ({self.data.place(worst)}): got a "
                f"place {off[worst]:.1f} mm from where its circle and angle_deg put it, expected "
                f"at most {FAR_OFF_MM:.0f} mm"
            )

    def _directions(self) -> Array:
        """Radial, tangential and axial direction of each row, frame of the axis, (n, 3, 3)."""
        v = self._geometry.targets[self._target]
        at = self._turn + np.arctan2(v[:, 1], v[:, 0])
        c, s, zero = np.cos(at), np.sin(at), np.zeros_like(at)
        axial = np.stack([zero, zero, zero + 1.0], axis=1)
        radial, tangential = np.stack([c, s, zero], axis=1), np.stack([-s, c, zero], axis=1)
        return np.stack([radial, tangential, axial], axis=1)

    # --- readings and derivatives

    @property
    def _still(self) -> Array:
        return np.zeros((len(self.data), len(MOTIONS)))

    def predict(self, nuisance: Array, effects: EffectValues) -> Array:
        """Return the readings, µm; a user's own effects are added."""
        place = self._places(nuisance, self._moved(effects))[0]
        out = 1e3 * np.einsum("nij,nj->ni", self._local, place - self._reference).reshape(-1)
        for e in self._own:
            if e.id in effects:
                out = out + np.asarray(e.change(self.data, Values(effects[e.id])), dtype=float)
        return np.asarray(out)

    def jacobian(self, nuisance: Array, effects: EffectValues) -> Array:
        """Exact derivative by axis average line and targets."""
        by = self._places(nuisance, self._moved(effects))[1]
        return np.asarray(1e3 * np.einsum("nij,njp->nip", self._local, by).reshape(-1, by.shape[2]))

    def effect_jacobian(
        self, nuisance: Array, effect: Effect, values: Mapping[str, float]
    ) -> Array:
        """Exact derivative by an effect's parameters, the effect acting alone."""
        if effect.id not in self._motions:
            return effect.columns(self.data, values)
        moved, columns = self._motion(effect.id, values)
        by = self._places(nuisance, moved)[2]
        out = 1e3 * np.einsum("nij,njm,nmk->nik", self._local, by, columns)
        return np.asarray(out.reshape(-1, columns.shape[2]))

    def _motion(self, name: str, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Motion of one effect, mm and rad (n, 6), and its derivative by each parameter."""
        m = self._motions[name]
        given = np.array([values[p.name] for p in m.parameters])
        return m.motion(self._course, given)

    def _moved(self, effects: EffectValues) -> Array:
        """Sum of the error motions of all effects, mm and rad, (n, 6)."""
        out = self._still
        for name, values in effects.items():
            if name in self._motions:
                out = out + self._motion(name, values)[0]
        return out

    def _places(self, nuisance: Array, moved: Array) -> tuple[Array, Array, Array]:
        """Where the targets are in the frame of the axis, mm, (n, 3).

        Also the derivatives by the nuisance parameters (n, 3, p) and by the motions (n, 3, 6).
        """
        n = len(self._turn)
        shift = np.array([nuisance[0], nuisance[1], 0.0]) * 1e-3
        tilt, tilt_by = _tilt(np.tile(nuisance[2:4] * ARCSEC, (1, 1)))
        own = self._geometry.targets + nuisance[4:].reshape(-1, OWN_UM) * 1e-3
        v = own[self._target]
        wobble, wobble_by = _tilt(moved[:, 3:5])
        at = self._turn + moved[:, 5]
        c, s = np.cos(at), np.sin(at)
        turned = np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]], axis=1)
        faster = np.stack([-turned[:, 1], turned[:, 0], np.zeros(n)], axis=1)
        inside = moved[:, :3] + np.einsum("nij,nj->ni", wobble, turned)
        place = shift + inside @ tilt[0].T

        by_motion = np.empty((n, 3, len(MOTIONS)))
        by_motion[:, :, :3] = tilt[0]
        for j in range(2):
            by_motion[:, :, 3 + j] = np.einsum("nij,nj->ni", wobble_by[j], turned) @ tilt[0].T
        by_motion[:, :, 5] = np.einsum("nij,nj->ni", wobble, faster) @ tilt[0].T

        by = np.zeros((n, 3, len(nuisance)))
        by[:, 0, 0] = by[:, 1, 1] = 1e-3
        for j in range(2):
            by[:, :, 2 + j] = inside @ tilt_by[j][0].T * ARCSEC
        zero, one = np.zeros(n), np.ones(n)
        spin = np.stack([c, -s, zero, s, c, zero, zero, zero, one], axis=1).reshape(n, 3, 3)
        own_by = 1e-3 * np.einsum("ij,njk,nkl->nil", tilt[0], wobble, spin)
        for j in range(OWN_UM):
            by[np.arange(n), :, 4 + OWN_UM * self._target + j] = own_by[:, :, j]
        return place, by, by_motion

    def _effect(self, name: str, m: _Motion) -> Effect:
        return Effect(name, m.parameters, partial(_change, self, name), words=m.words)

    # --- what the engine looks for structure in

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Position, time or order, sense, target."""
        data = self.data
        out = [Covariate("position", np.repeat(data.angle_deg, 3), "deg", period=360.0)]
        if data.time_s is not None:
            out.append(Covariate("time", np.repeat(data.time_s, 3), "s", sequence=True))
        order = self.readings.rows.astype(float)
        out.append(Covariate("order of measurement", order, sequence=True))
        out.append(Covariate("sense of turning", np.repeat(self._course.sense, 3)))
        out.append(Covariate("target", np.repeat(self._target, 3), classes=True))
        return tuple(out)

    @property
    def components(self) -> Mapping[str, Array]:
        """Radial, tangential, axial."""
        at = np.arange(len(self.readings)) % 3
        return {name: (at == i).astype(float) for i, name in enumerate(DIRECTIONS)}

    @property
    def groups(self) -> IntArray:
        """Ten blocks of neighbouring positions, all targets together."""
        rank = np.unique(np.round(self.data.angle_deg, 6), return_inverse=True)[1].reshape(-1)
        blocks = min(BLOCKS, int(rank.max()) + 1)
        return np.repeat(rank * blocks // (rank.max() + 1), 3).astype(np.intp)

    @property
    def replicates(self) -> IntArray | None:
        """The same target at the same position, reached in the same sense."""
        parts = [np.round(self.data.angle_deg, 6), self._target, self._course.sense]
        label = np.unique(np.stack(parts, axis=1), axis=0, return_inverse=True)[1].reshape(-1)
        several = np.repeat(np.bincount(label)[label] > 1, 3)
        if not several.any():
            return None
        each = 3 * np.repeat(label, 3) + np.tile(np.arange(3), len(label))
        return np.where(several, each, -1).astype(np.intp)

    def whitener(self, residuals: Array) -> Callable[[Array], Array]:
        """Divide each direction by its noise, taken from second differences along the positions.

        Slow error motions do not count as noise so. Directions whose noise cannot be told apart
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
            return lambda a: a
        size = np.mean(d * d, axis=0)
        freedom = 18.0 / 35.0 * len(d)  # second differences of white noise are correlated
        radial, tangential, axial = map(float, size)
        if _alike(radial, freedom, axial, freedom):
            radial = axial = (radial + axial) / 2
            if _alike(tangential, freedom, radial, 2 * freedom):
                radial = axial = tangential = (2 * radial + tangential) / 3
        scale = np.tile(np.sqrt([radial, tangential, axial]), len(r))
        scale = scale / np.sqrt(np.mean(scale**2))

        def whiten(a: Array) -> Array:
            return np.asarray(a / scale.reshape(-1, *(1,) * (a.ndim - 1)))

        return whiten

    def _in_order(self, target: int) -> IntArray:
        mine = np.flatnonzero(self._target == target)
        return mine[np.argsort(np.asarray(self.data.angle_deg)[mine], kind="stable")]

    # --- what a user gets

    def bind(self, data: Any) -> SweepModel:
        """Return the same model on another sweep; its axis and targets are its own."""
        if not isinstance(data, Sweep):
            raise InputError(f"other data: got {type(data).__name__}, wanted trunnion.Sweep")
        return SweepModel(data, source=self)

    def location_errors(self, nuisance: Array, effects: EffectValues) -> dict[str, float]:  # noqa: ARG002
        """Shift and tilt of the axis average line from that of the plain circles."""
        named = zip(self.nuisance, nuisance, strict=True)
        return {x.name: float(v) for x, v in named if x.name.startswith("axis_")}

    def extended(
        self,
        nuisance: Array,
        effects: EffectValues,
        uncertainty: Uncertainty | None = None,
    ) -> ExtendedSweep:
        """Return axis, targets and error motions."""
        g = self._geometry
        tilt = _tilt(np.tile(nuisance[2:4] * ARCSEC, (1, 1)))[0][0]
        own = g.targets + nuisance[4:].reshape(-1, OWN_UM) * 1e-3
        frame = g.frame @ tilt
        return ExtendedSweep(
            point_mm=g.origin + g.frame @ np.array([nuisance[0], nuisance[1], 0.0]) * 1e-3,
            direction=frame[:, 2],
            frame=frame,
            radius_mm={k: float(np.hypot(*v[:2])) for k, v in zip(self._labels, own, strict=True)},
            height_mm={k: float(v[2]) for k, v in zip(self._labels, own, strict=True)},
            effects={k: dict(v) for k, v in effects.items()},
            source=self,
            **for_compensation(self.effects, effects, (), NO_AXIS),
            **({} if uncertainty is None else uncertainty.fields()),
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
        Directions X, Y, Z of the error motions in the instrument's frame, one a column.
    radius_mm, height_mm
        Of each target.
    """

    point_mm: Array
    direction: Array
    frame: Array
    radius_mm: dict[Any, float]
    height_mm: dict[Any, float]
    source: SweepModel = field(compare=False, repr=False)

    def error_motions(self, angle_deg: Array) -> dict[str, Array]:
        """Error motions at positions of the axis: EX, EY, EZ in µm, EA, EB, EC in arcsec.

        What depends on time, order or the sense of turning (drift, backlash) is left out.
        """
        angle = np.asarray(angle_deg, dtype=float)
        none = np.zeros(len(angle))
        course = _Course(angle, none, none, np.eye(3))
        total = np.zeros((len(angle), len(MOTIONS)))
        for name, values in self.effects.items():
            if name in self.source._motions:
                m = self.source._motions[name]
                given = np.array([values[p.name] for p in m.parameters])
                total += m.motion(course, given)[0] / MOTION_UNIT
        return dict(zip(MOTIONS, total.T, strict=True))


def _change(source: SweepModel, name: str, data: Any, values: Mapping[str, float]) -> Array:
    """Change of every reading of any sweep by one error motion, µm."""
    model = source if data is source.data else source.bind(data)
    start = np.zeros(len(model.nuisance))
    return np.asarray(model.predict(start, {name: values}) - model.predict(start, {}))


# --- the catalogue


def _catalogue(
    course: _Course, geometry: _Geometry, effects: Sequence[EffectLike | str]
) -> dict[str, _Motion]:
    """All candidates for these positions, and the harmonics that were asked for by name."""
    positions = np.unique(np.round(course.angle_deg, 6))
    travel = (float(positions[0] + positions[-1]) / 2, float(positions[-1] - positions[0]) / 2)
    heights = geometry.targets[:, 2]
    out: dict[str, _Motion] = {}
    # of causes that these targets cannot tell apart the first is named: the simpler ones first
    for kind in HARMONIC:
        for n in range(1, min(HARMONICS, max(len(positions) // 3, 1)) + 1):
            out[f"{kind}_{n}"] = _harmonic(kind, n, heights)
    for name in effects:
        kind, _, number = name.rpartition("_") if isinstance(name, str) else ("", "", "")
        if kind in HARMONIC and number.isdecimal() and int(number) > 0:
            out[str(name)] = _harmonic(kind, int(number), heights)
    degrees = range(1, min(DEGREE, len(positions) - 2) + 1)
    for kind, motions in HARMONIC.items():
        # a shift of position is a shift of the zero; its slope has a name of its own
        mine = [k for k in degrees if kind != "positioning" or k > 1]
        if mine:
            out[f"{kind}_trend"] = _Motion(
                tuple(
                    Parameter(
                        f"{MOTIONS[m][1].lower()}{k}_{UNIT[m]}"
                        if len(motions) > 1
                        else f"a{k}_{UNIT[m]}"
                    )
                    for m in motions
                    for k in mine
                ),
                partial(_trend, motions, tuple(mine), travel),
                f"the axis has a slow {WORDS[kind]}",
            )
    out["positioning_scale"] = _Motion(
        (Parameter("ppm"),), _scale, "the axis turns too far in proportion"
    )
    periods = _periods(positions)
    if periods:
        out["positioning_cyclic"] = _Motion(
            (
                Parameter("a_arcsec"),
                Parameter("b_arcsec"),
                Parameter("period_deg", grid=periods, bounds=(periods[-1], periods[0] * 1.2)),
            ),
            _cyclic,
            "the positioning of the axis has a short period",
        )
    if min(int(np.sum(course.sense > 0)), int(np.sum(course.sense < 0))) >= FEWEST_OF_A_SENSE:
        out["backlash"] = _Motion(
            (Parameter("b_arcsec"),), _backlash, "the axis loses motion on reversal"
        )
    rate = "um_h" if course.timed else "total_um"
    out["drift"] = _Motion(
        tuple(Parameter(f"d{a}_{rate}") for a in "xyz"), _drift, "instrument and axis drift apart"
    )
    return out


UNIT = ("um", "um", "um", "arcsec", "arcsec", "arcsec")
HARMONIC = {"axial": (2,), "positioning": (5,), "radial": (0, 1), "tilt": (3, 4)}
WORDS = {
    "radial": "radial motion",
    "axial": "axial motion",
    "tilt": "tilt",
    "positioning": "positioning error",
}


def _harmonic(kind: str, n: int, heights: Array) -> _Motion:
    """E = a cos nθ + b sin nθ for each motion of the kind; positioning a (cos nθ − 1) + b sin nθ.

    A tilt has a pivot on the axis, which targets of different height tell from radial motion.
    """
    motions = HARMONIC[kind]
    if len(motions) == 1:
        names = [f"a{n}_{UNIT[motions[0]]}", f"b{n}_{UNIT[motions[0]]}"]
    else:
        names = [f"{c}{a}_{UNIT[motions[0]]}" for a in "xy" for c in "ab"]
    parameters = [Parameter(name) for name in names]
    low, high = float(heights.min()), float(heights.max())
    spread = high - low
    if kind == "tilt" and spread > 0:
        grid = tuple(np.linspace(low - spread, high + spread, PIVOTS))
        bounds = (low - 5 * spread, high + 5 * spread)
        parameters.append(Parameter("pivot_mm", grid=grid, bounds=bounds))
    ending = {1: "st", 2: "nd", 3: "rd"}.get(n, "th")
    article = "an" if kind == "axial" else "a"
    words = f"the axis has {article} {WORDS[kind]} of {n}{ending} harmonic"
    return _Motion(tuple(parameters), partial(_waves, motions, n), words)


def _waves(motions: tuple[int, ...], n: int, course: _Course, values: Array) -> Array:
    turn = n * np.radians(course.angle_deg)
    cos, sin = np.cos(turn), np.sin(turn)
    if motions == (5,):
        cos = cos - 1.0
    out = np.zeros((len(turn), len(MOTIONS), 2 * len(motions)))
    for i, m in enumerate(motions):
        out[:, m, 2 * i], out[:, m, 2 * i + 1] = cos, sin
    if len(values) > 2 * len(motions):
        out = _about_pivot(out, values)
    return out


def _about_pivot(tilt: Array, values: Array) -> Array:
    """Tilt columns (n, 6, 4), about a point at height ``values[4]`` on the axis, and by it."""
    pivot = values[4]
    out = np.concatenate([tilt, np.zeros((*tilt.shape[:2], 1))], axis=2)
    # ω × (p − pivot z) = ω × p + pivot (−E_B, E_A, 0); arcsec and mm to µm
    lever = ARCSEC * 1e3
    out[:, 0, :4] = -lever * pivot * tilt[:, 4]
    out[:, 1, :4] = lever * pivot * tilt[:, 3]
    total = tilt @ values[:4]
    out[:, 0, 4] = -lever * total[:, 4]
    out[:, 1, 4] = lever * total[:, 3]
    return out


def _trend(
    motions: tuple[int, ...],
    degrees: tuple[int, ...],
    travel: tuple[float, float],
    course: _Course,
    values: Array,  # noqa: ARG001
) -> Array:
    """Legendre polynomials of the position, −1 to 1 over the range measured."""
    u = (course.angle_deg - travel[0]) / max(travel[1], 1e-9)
    p = np.polynomial.legendre.legvander(u, max(degrees))[:, list(degrees)]
    out = np.zeros((len(u), len(MOTIONS), len(motions) * len(degrees)))
    for i, m in enumerate(motions):
        out[:, m, i * len(degrees) : (i + 1) * len(degrees)] = p
    return out


def _scale(course: _Course, values: Array) -> Array:  # noqa: ARG001
    out = np.zeros((len(course.angle_deg), len(MOTIONS), 1))
    out[:, 5, 0] = np.radians(course.angle_deg) * 1e-6 / ARCSEC
    return out


def _cyclic(course: _Course, values: Array) -> Array:
    a, b, period = values
    turn = 2 * np.pi * course.angle_deg / period
    out = np.zeros((len(turn), len(MOTIONS), 3))
    out[:, 5, 0], out[:, 5, 1] = np.cos(turn), np.sin(turn)
    out[:, 5, 2] = (a * np.sin(turn) - b * np.cos(turn)) * turn / period
    return out


def _backlash(course: _Course, values: Array) -> Array:  # noqa: ARG001
    out = np.zeros((len(course.angle_deg), len(MOTIONS), 1))
    out[:, 5, 0] = -course.sense / 2
    return out


def _drift(course: _Course, values: Array) -> Array:  # noqa: ARG001
    """Shift of the targets along the instrument's axes, in the frame of the axis."""
    out = np.zeros((len(course.angle_deg), len(MOTIONS), 3))
    out[:, :3] = course.elapsed[:, None, None] * course.instrument
    return out


def _periods(positions: Array) -> tuple[float, ...]:
    """Periods to try, deg, longest first: a third of the range to two steps, evenly in frequency.

    A period below two steps of an even sweep looks like a longer one, and is named as that.
    """
    if len(positions) < 8:
        return ()
    span = float(positions[-1] - positions[0])
    shortest = 2.0 * float(np.median(np.diff(positions)))
    step = 1.0 / (4.0 * span)
    count = int((1.0 / shortest - 3.0 / span) / step) + 1
    if count < 2:
        return ()
    return tuple(1.0 / (3.0 / span + step * np.arange(min(count, MOST_PERIODS))))


# --- geometry


@dataclass(frozen=True)
class _Geometry:
    """Axis average line and targets by plain circles.

    ``frame``: (3, 3), directions of the axis' frame, one a column; ``origin``: a point of the
    axis, mm; ``targets``: (k, 3), each at position 0 in that frame.
    """

    origin: Array
    frame: Array
    targets: Array

    @classmethod
    def of(cls, p: Array, turn: Array, target: IntArray, labels: Sequence[Any]) -> _Geometry:
        """Fit all targets, with the axis in common: ``p = origin + frame Rz(turn) targets``."""
        count = len(labels)
        for k, label in enumerate(labels):
            different = len(np.unique(np.round(turn[target == k], 9)))
            if different < 3:
                raise DataError(
                    f"target {label}: got {different} different positions of the axis, "
                    "wanted at least 3"
                )
        centred = p.copy()
        for k in range(count):
            centred[target == k] -= p[target == k].mean(axis=0)
        _, size, vt = np.linalg.svd(centred, full_matrices=len(centred) < 3)
        if size[0] == 0.0:
            raise DataError("sweep: got targets that do not move, wanted targets that turn")
        frame = np.stack([vt[0], vt[1], np.cross(vt[0], vt[1])], axis=1)
        start = p.mean(axis=0)
        # the sense in which the targets go round is the one whose circles fit
        fits = []
        for sense in (1.0, -1.0):
            turned = frame * np.array([1.0, sense, sense])
            fits.append((turned, *cls._circles((p - start) @ turned, turn, target, count)))
        frame, x, _ = min(fits, key=lambda fit: fit[2])
        q = (p - start) @ frame
        height = np.array([q[target == k, 2].mean() for k in range(count)])
        middle = (height.max() + height.min()) / 2
        origin = start + frame @ np.array([x[0], x[1], middle])
        return cls(origin, frame, np.column_stack([x[2:].reshape(-1, 2), height - middle]))

    @staticmethod
    def _circles(q: Array, turn: Array, target: IntArray, count: int) -> tuple[Array, float]:
        """Axis place and targets in the plane, mm (2 + 2 count,); sum of squares left, mm²."""
        c, s = np.cos(turn), np.sin(turn)
        # linear in axis place and targets: q = (ox, oy) + Rz(turn) v
        a = np.zeros((len(q), 2, 2 + 2 * count))
        a[:, 0, 0] = a[:, 1, 1] = 1.0
        rows = np.arange(len(q))
        a[rows, 0, 2 + 2 * target], a[rows, 0, 3 + 2 * target] = c, -s
        a[rows, 1, 2 + 2 * target], a[rows, 1, 3 + 2 * target] = s, c
        design, y = a.reshape(-1, a.shape[2]), q[:, :2].reshape(-1)
        x = np.asarray(np.linalg.lstsq(design, y, rcond=None)[0], dtype=np.float64)
        return x, float(np.sum((y - design @ x) ** 2))


def _tilt(angles: Array) -> tuple[Array, tuple[Array, Array]]:
    """Rx(E_A) Ry(E_B) for angles (n, 2) in rad, (n, 3, 3), and its derivative by each."""
    ca, sa = np.cos(angles[:, 0]), np.sin(angles[:, 0])
    cb, sb = np.cos(angles[:, 1]), np.sin(angles[:, 1])
    zero, one = np.zeros_like(ca), np.ones_like(ca)

    def matrix(*rows: Array) -> Array:
        return np.stack(rows, axis=1).reshape(-1, 3, 3)

    x = matrix(one, zero, zero, zero, ca, -sa, zero, sa, ca)
    y = matrix(cb, zero, sb, zero, one, zero, -sb, zero, cb)
    dx = matrix(zero, zero, zero, zero, -sa, -ca, zero, ca, -sa)
    dy = matrix(-sb, zero, cb, zero, zero, zero, -cb, zero, -sb)
    return x @ y, (dx @ y, x @ dy)


@dataclass(frozen=True)
class Circle:
    """Plain circle of one target; the commanded positions do not enter.

    Attributes
    ----------
    radius_mm, centre_mm, normal
        Circle in space, instrument frame.
    radial_um, axial_um
        Distance of each position from it, in the plane and off the plane, in the order of rows.
    """

    radius_mm: float
    centre_mm: Array
    normal: Array
    radial_um: Array
    axial_um: Array

    @property
    def radial_rms_um(self) -> float:
        """Rms of the radial distances."""
        return float(np.sqrt(np.mean(self.radial_um**2)))

    @property
    def axial_rms_um(self) -> float:
        """Rms of the axial distances."""
        return float(np.sqrt(np.mean(self.axial_um**2)))


def circles(data: Sweep) -> dict[Any, Circle]:
    """Fit a plane and in it a circle (least distances) to each target of a sweep.

    Raises
    ------
    DataError
        A target has fewer than four positions.
    """
    labels, target = _targets(data)
    out = {}
    for k, label in enumerate(labels):
        p = data.position_mm[target == k]
        if len(p) < 4:
            raise DataError(f"target {label}: got {len(p)} positions, wanted at least 4")
        middle = p.mean(axis=0)
        vt = np.linalg.svd(p - middle, full_matrices=len(p) < 3)[2]
        q = (p - middle) @ vt.T
        a = np.column_stack([2 * q[:, :2], np.ones(len(q))])
        x, y, w = np.linalg.lstsq(a, np.sum(q[:, :2] ** 2, axis=1), rcond=None)[0]
        start = np.array([x, y, np.sqrt(max(w + x * x + y * y, 0.0))])

        def distance(c: Array, q: Array = q) -> Array:
            return np.asarray(np.hypot(q[:, 0] - c[0], q[:, 1] - c[1]) - c[2])

        def slope(c: Array, q: Array = q) -> Array:
            r = np.hypot(q[:, 0] - c[0], q[:, 1] - c[1])
            return np.stack([(c[0] - q[:, 0]) / r, (c[1] - q[:, 1]) / r, -np.ones(len(q))], axis=1)

        best = optimize.least_squares(distance, start, jac=slope, method="lm", x_scale="jac").x
        out[label] = Circle(
            radius_mm=float(best[2]),
            centre_mm=middle + best[:2] @ vt[:2],
            normal=vt[2],
            radial_um=1e3 * distance(best),
            axial_um=1e3 * q[:, 2],
        )
    return out


def _targets(data: Sweep) -> tuple[list[Any], IntArray]:
    labels, target = np.unique(np.asarray(data.target), return_inverse=True)
    return list(labels), target.reshape(-1).astype(np.intp)


def _senses(data: Sweep) -> Array:
    """Sense of the last turn before each row, by the order of rows: +1, -1, 0 before the first."""
    out = np.zeros(len(data))
    step = np.sign(np.diff(np.asarray(data.angle_deg)))
    last = 0.0
    for i, s in enumerate(step, start=1):
        last = float(s) if s != 0 else last
        out[i] = last
    return out


def _alike(one: float, one_freedom: float, two: float, two_freedom: float) -> bool:
    """Whether two variances may be the same (F test, both sides)."""
    upper = float(special.fdtrc(one_freedom, two_freedom, one / two))
    return min(upper, 1.0 - upper) > NOISE_LEVEL / 2


def build(
    data: Sweep,
    setup: Any = None,  # noqa: ARG001  a sweep needs none
    effects: Sequence[EffectLike | str] = (),
) -> SweepModel:
    """Build the model of a sweep; no set-up is needed."""
    return SweepModel(data, effects)
