"""A second opinion on `trunnion.identify`: the same estimates from a symbolic model in CasADi.

Everything here is written anew from the conventions: kinematics, effects, contact. It shares no
code with the core, so that where both agree, the formulas are right and not only the same. It is
plain and slow on purpose.

The model of one touch: the recorded ball centre p goes along its approach d, ``p(s) = p + s d``. In
the artefact's frame that is a line ``u + s v``. The feature in contact (a face, an edge or a corner
of a box, or a sphere) is where ``|e(s)| = r_eff`` with ``e_i = m_i (σ_i (u_i + s v_i - centre_i) -
half_i)``: one mask and one sign an axis make a face of one active axis, an edge of two, a corner of
three, and a sphere of three with half sizes 0. The smaller root of this quadratic is how far behind
the recorded position the model expects the contact, and the residual (µm, along the approach) is
``-s - tick/2``: recorded minus predicted coordinate. Which feature is in contact is looked up
between the solves.

References: Kang, Kim, Jee 2022 for machine and artefact; ISO 230-1 for the location errors.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.errors import DataError, InputError, UnknownNameError
from trunnion.machine.chain import Chain
from trunnion.machine.estimate import named_combination
from trunnion.probing.result import IdentificationResult

if TYPE_CHECKING:
    from trunnion.data.touches import Touches
    from trunnion.setup import Setup

__all__ = ["identify", "linearise"]

Floats = NDArray[np.float64]

_MM_PER_UM = 1e-3
_RAD_PER_ARCSEC = np.pi / 648000.0
_NO_SIGN_BELOW = 1e-9
_FAR_MM = 5.0
# Scaled singular values below this share of the largest are not seen: what is invisible at first
# order comes back at second order, through tilts of 1e-4 rad, with a share of that size.
_RANK_TOLERANCE = 1e-3
# A parameter that moves no reading by more than this (µm a unit): sin 180° in double precision.
_NOTHING_UM = 1e-9
_STEP_TOLERANCE = 1e-9
_MAX_ITERATIONS = 60

_ERRORS = {
    "trt-ca": ("EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EX0C", "EY0C", "EB0C"),
    "trt-bc": ("EB0B", "EA0B", "EC0B", "EX0B", "EZ0B", "EX0C", "EY0C", "EA0C"),
    "table-c-head-b": (
        *("EB0B", "EA0B", "EC0B", "EX0B", "EZ0B"),
        *("EX0C", "EY0C", "EA0C", "EB0C"),
    ),
}
_FIRST_AXIS = {"trt-ca": "A", "trt-bc": "B", "table-c-head-b": "B"}
_PLACEMENT = ("dx_um", "dy_um", "dz_um", "ra_arcsec", "rb_arcsec", "rc_arcsec")

# Effects: parameters, and the columns without which they mean nothing.
_EFFECTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "probe_radius": (("dr_um",), ()),
    "probe_bending": (("k_um",), ()),
    "probe_lobing": (("a3_um", "b3_um"), ()),
    "trigger_delay": (("tau_ms",), ("feed_mm_min",)),
    "artefact_length": (("dl_um",), ()),
    "artefact_width": (("dw_um",), ()),
    "artefact_height": (("dh_um",), ()),
    "artefact_squareness": (("gamma_arcsec",), ()),
    "artefact_expansion": (("ppm",), ()),
    "setup_shift": (("dx_um", "dy_um", "dz_um", "t0_s"), ("time_s",)),
    **{f"scale_{i}": (("ppm",), ()) for i in "xyz"},
    **{f"squareness_{ij}": (("arcsec",), ()) for ij in ("xy", "xz", "yz")},
    **{f"backlash_{i}": (("b_um",), ()) for i in "xyz"},
    "c_positioning": (("a1_arcsec", "b1_arcsec"), ()),
    "c_positioning_2": (("a2_arcsec", "b2_arcsec"), ()),
    "c_radial_2": (("ax_um", "bx_um", "ay_um", "by_um"), ()),
    "c_axial": (("a1_um", "b1_um"), ()),
    "c_axial_2": (("a2_um", "b2_um"), ()),
    "c_wobble_2": (("ax_arcsec", "bx_arcsec", "ay_arcsec", "by_arcsec"), ()),
    "a_positioning": (("k_arcsec",), ()),
    "a_scale": (("k_arcsec",), ()),
    "a_sag": (("ky_um", "kz_um"), ()),
    "a_twist": (("k_arcsec",), ()),
    "c_backlash": (("b_arcsec",), ("c_dir",)),
    "a_backlash": (("b_arcsec",), ("a_dir",)),
    **{f"drift_{i}": (("rate_um_h",), ("time_s",)) for i in "xyz"},
    "warmup_z": (("amplitude_um", "tau_min"), ("time_s",)),
}
_SLIP_TIME = "setup_shift.t0_s"
_TIME_CONSTANT = "warmup_z.tau_min"


def identify(
    data: Touches,
    setup: Setup,
    *,
    effects: Iterable[str] | Mapping[str, Mapping[str, float]] = (),
    solver: str = "gauss-newton",
) -> IdentificationResult:
    """Estimate location errors, placement and effects by least squares along the approach.

    Parameters
    ----------
    data
        Recorded touches.
    setup
        Machine, artefact and probe. Half of ``probe.tick_um`` is taken off every reading;
        ``machine.errors`` is where the search starts, and results are totals.
    effects
        Ids of the catalogue, or a mapping id -> parameters held at the given values
        (``{"setup_shift": {"t0_s": 300.0}, "drift_z": {}}``). A slip's time that is not held is
        searched between every two touches; a time constant over a grid, then refined.
    solver
        "gauss-newton" or "ipopt" (exact Hessian).

    Returns
    -------
    IdentificationResult
        The covariance holds ``repeatability_um**2 + tick_um**2 / 12`` for the variance of a reading
        where the repeatability is known, else the variance of the residuals.

    Raises
    ------
    UnknownNameError
        For an effect, preset or location error that is in no list.
    InputError
        For an effect whose columns the data do not have, or an unknown solver.
    DataError
        For fewer touches than unknowns, or a touch more than 5 mm from the modelled surface.
    ImportError
        Without CasADi.
    """
    if solver not in ("gauss-newton", "ipopt"):
        raise InputError(f"solver: got {solver!r}, expected 'gauss-newton' or 'ipopt'")
    held: dict[str, Mapping[str, float]] = (
        dict(effects) if isinstance(effects, Mapping) else {id_: {} for id_ in effects}
    )
    rows = _Rows.of(data, setup, held)
    model = _Model(setup, held)
    if rows.n < len(model.names):
        raise DataError(
            f"touches: got {rows.n} rows, expected at least the {len(model.names)} of the unknowns"
        )
    solve = _gauss_newton if solver == "gauss-newton" else _ipopt
    best: _Solution | None = None
    for t0_s, start in _starts(model, rows):
        found = solve(model, rows, t0_s, start)
        if best is None or found.cost < best.cost:
            best = found
    if best is None:  # there is always a start
        raise DataError("no start for the search")
    return _result(model, rows, best, solver)


def linearise(
    data: Touches,
    setup: Setup,
    values: Mapping[str, float],
    *,
    effects: Iterable[str] = (),
) -> tuple[Floats, Floats, tuple[str, ...]]:
    """Residuals and their symbolic derivatives at given parameters, nothing solved.

    Parameters
    ----------
    data, setup
        As for `identify`.
    values
        Parameters by name, an effect's as "id.parameter"; those of the set-up or 0 if not given.
    effects
        Ids of the catalogue.

    Returns
    -------
    residuals_um : (n,)
        Recorded minus predicted coordinate along the approach, half a tick taken off.
    jacobian : (n, p)
        Derivatives of the residuals, µm per unit of each parameter.
    names
        Order of the columns; the time of a slip has none.
    """
    held: dict[str, Mapping[str, float]] = {id_: {} for id_ in effects}
    rows = _Rows.of(data, setup, held)
    model = _Model(setup, held)
    x = model.start()
    for name, value in values.items():
        if name != _SLIP_TIME and name not in model.names:
            raise UnknownNameError(f"parameter: got {name!r}, expected one of {model.names}")
        if name != _SLIP_TIME:
            x[model.names.index(name)] = value
    t0_s = float(values.get(_SLIP_TIME, 0.0))
    residuals, jacobian = _evaluate(model, rows, x, t0_s, model.contacts(x, rows, t0_s))
    return residuals, jacobian, model.names


# --- data as plain arrays -------------------------------------------------------------------------


@dataclass(frozen=True)
class _Rows:
    """The touches' quantities in mm, rad, s, h; (n,) or (n, 3)."""

    position: Floats
    direction: Floats
    first: Floats
    second: Floats
    first_dir: Floats
    second_dir: Floats
    feed: Floats
    time: Floats

    @property
    def n(self) -> int:
        return len(self.first)

    @classmethod
    def of(cls, data: Touches, setup: Setup, effects: Iterable[str]) -> _Rows:
        preset = setup.machine.preset
        if preset not in _ERRORS:
            raise UnknownNameError(f"preset: got {preset!r}, expected one of {', '.join(_ERRORS)}")
        letter = _FIRST_AXIS[preset]
        for id_ in effects:
            if id_ not in _EFFECTS or (id_.startswith("a_") and letter != "A"):
                known = [e for e in _EFFECTS if letter == "A" or not e.startswith("a_")]
                raise UnknownNameError(f"effect: got {id_!r}, expected one of {', '.join(known)}")
            for column in _EFFECTS[id_][1]:
                if getattr(data, column) is None:
                    raise InputError(f"{id_}: got touches without {column}, expected that column")

        chain = Chain(setup)
        sense = dict(zip(chain.letters, chain.senses, strict=True))

        def turned(name: str) -> Floats:
            angle = getattr(data, f"{name.lower()}_deg")
            if angle is None:
                raise InputError(f"touches: got no {name.lower()}_deg, expected it for {preset}")
            return np.asarray(sense[name] * np.radians(angle))

        def optional(name: str, factor: float = 1.0) -> Floats:
            values = getattr(data, name)
            return np.zeros(len(data)) if values is None else factor * np.asarray(values, float)

        return cls(
            position=np.stack([data.x_mm, data.y_mm, data.z_mm], axis=1),
            direction=np.stack([data.dir_x, data.dir_y, data.dir_z], axis=1),
            first=turned(letter),
            second=turned("C"),
            first_dir=optional(f"{letter.lower()}_dir", sense[letter]),
            second_dir=optional("c_dir", sense["C"]),
            feed=optional("feed_mm_min", 1 / 60),
            time=optional("time_s"),
        )

    def table(self, t0_s: float, contact: _Contacts) -> Floats:
        """One column a touch: what the symbolic model of a touch is given, in its order."""
        return np.vstack(
            [
                self.position.T,
                self.direction.T,
                np.where(np.abs(self.direction) < _NO_SIGN_BELOW, 0, np.sign(self.direction)).T,
                self.first,
                self.second,
                self.first_dir,
                self.second_dir,
                self.feed,
                self.time,
                self.time >= t0_s,
                contact.mask.T,
                contact.sign.T,
                contact.second_bar,
            ]
        )


# --- which feature is in contact ------------------------------------------------------------------


@dataclass(frozen=True)
class _Contacts:
    """Active axes (n, 3), their signs (n, 3) and whether it is the Y bar (n,), 0 or 1."""

    mask: Floats
    sign: Floats
    second_bar: Floats

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Contacts) and all(
            np.array_equal(a, b)
            for a, b in (
                (self.mask, other.mask),
                (self.sign * self.mask, other.sign * other.mask),
                (self.second_bar, other.second_bar),
            )
        )

    __hash__ = None  # type: ignore[assignment]


_SIGNS = np.array([s for s in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(s)])  # (26, 3)


def _box_contact(
    u: Floats, v: Floats, r: Floats, centre: Floats, half: Floats
) -> tuple[Floats, NDArray[np.int64]]:
    """Way (n,) to the first contact with a box, inf where the ball passes; and which feature."""
    mask = np.abs(_SIGNS)
    e = mask * (_SIGNS * (u - centre)[:, None, :] - half)  # (n, 26, 3)
    w = _SIGNS * v[:, None, :]
    a = np.sum(w * w, axis=2)
    b = np.sum(e * w, axis=2)
    c = np.sum(e * e, axis=2) - (r**2)[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        s = (-b - np.sqrt(b * b - a * c)) / a
        beyond = e + s[:, :, None] * w
        local = (u - centre)[:, None, :] + s[:, :, None] * v[:, None, :]
        on = np.where(mask > 0, beyond >= -1e-9, np.abs(local) <= half + 1e-9).all(axis=2)
    s = np.where(on & np.isfinite(s), s, np.inf)
    feature = np.argmin(s, axis=1)
    return s[np.arange(len(s)), feature], feature


def _box_distance(points: Floats, centre: Floats, half: Floats) -> Floats:
    outside = np.maximum(np.abs(points - centre) - half, 0.0)
    return np.asarray(np.linalg.norm(outside, axis=1))


def _about_z(points: Floats, angle: float) -> Floats:
    """Coordinates of points (n, 3) in a frame that is turned by the angle about Z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


# --- the symbolic model ---------------------------------------------------------------------------


def _casadi() -> ModuleType:
    try:
        import casadi
    except ImportError as error:
        raise ImportError(
            "casadi is not installed; expected for trunnion.casadi_baseline: "
            "pip install 'trunnion[reference]'"
        ) from error
    module: ModuleType = casadi
    return module


class _Model:
    """The residual of one touch as a CasADi function of the unknowns x (µm, arcsec, ...)."""

    def __init__(self, setup: Setup, held: Mapping[str, Mapping[str, float]]) -> None:
        self.ca = _casadi()
        self.setup = setup
        self.preset = setup.machine.preset
        self.held = held
        self.error_names = _ERRORS[self.preset]
        unknown = set(setup.machine.errors) - set(self.error_names)
        if unknown:
            raise UnknownNameError(
                f"machine.errors: got {', '.join(sorted(unknown))}, expected one of "
                f"{', '.join(self.error_names)} for {self.preset}"
            )
        for id_, values in held.items():
            for name in values:
                if name not in _EFFECTS[id_][0]:
                    known = ", ".join(_EFFECTS[id_][0])
                    raise UnknownNameError(
                        f"{id_}: got parameter {name!r}, expected one of {known}"
                    )
        effect_names = [
            f"{id_}.{name}"
            for id_, values in held.items()
            for name in _EFFECTS[id_][0]
            if name not in values and f"{id_}.{name}" != _SLIP_TIME
        ]
        self.names = (*self.error_names, *_PLACEMENT, *effect_names)
        self.x = self.ca.SX.sym("x", len(self.names))
        self.q = self.ca.SX.sym("q", 23)
        self._build()

    def start(self) -> Floats:
        known = self.setup.machine.errors
        return np.array([float(known.get(name, 0.0)) for name in self.names])

    # Unknowns in mm, rad and so on

    def _error(self, name: str) -> Any:
        factor = _MM_PER_UM if name[1] in "XYZ" else _RAD_PER_ARCSEC
        return self.x[self.names.index(name)] * factor

    def _placement(self, name: str) -> Any:
        factor = _MM_PER_UM if name.endswith("_um") else _RAD_PER_ARCSEC
        return self.x[self.names.index(name)] * factor

    def _effect(self, id_: str, name: str) -> Any:
        """Return an effect's parameter in inner units; 0 where the effect is not in the model."""
        if id_ not in self.held:
            return 0.0
        if name.endswith("_um") or name == "rate_um_h":
            factor = _MM_PER_UM
        elif name.endswith("arcsec"):
            factor = _RAD_PER_ARCSEC
        else:
            factor = {"ppm": 1e-6, "tau_ms": 1e-3, "tau_min": 60.0}[name]
        if name in self.held[id_]:
            return factor * float(self.held[id_][name])
        return factor * self.x[self.names.index(f"{id_}.{name}")]

    # Rotations

    def _turn(self, axis: int, angle: Any) -> Any:
        c, s = self.ca.cos(angle), self.ca.sin(angle)
        rows = (
            [[1, 0, 0], [0, c, -s], [0, s, c]],
            [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        )[axis]
        return self.ca.vertcat(*(self.ca.horzcat(*row) for row in rows))

    def _tilts(self, alpha: Any, beta: Any, gamma: Any) -> Any:
        return self._turn(0, alpha) @ self._turn(1, beta) @ self._turn(2, gamma)

    # The pieces of a touch

    def _build(self) -> None:
        ca, q = self.ca, self.q
        position, direction, side = q[0:3], q[3:6], q[6:9]
        first, second, first_dir, second_dir = q[9], q[10], q[11], q[12]
        feed, time, slipped = q[13], q[14], q[15]
        mask, sign, second_bar = q[16:19], q[19:22], q[22]

        rotation, offset = self._table(first, second, first_dir, second_dir)
        seat = [self._placement(n) for n in ("dx_um", "dy_um", "dz_um")]
        seat = [
            s + slipped * self._effect("setup_shift", n)
            for s, n in zip(seat, ("dx_um", "dy_um", "dz_um"), strict=True)
        ]
        artefact = self.setup.artefact
        offset = offset + rotation @ (ca.vertcat(*seat) + ca.DM(artefact.place_mm))
        rotation = rotation @ self._tilts(
            *(self._placement(n) for n in ("ra_arcsec", "rb_arcsec", "rc_arcsec"))
        )
        rotation = rotation @ self._turn(2, np.radians(artefact.turn_deg))

        stretch, shift = self._linear_axes(side, time)
        actual = position + stretch @ position + shift + self._head(first)
        u = rotation.T @ (actual - offset)
        v = rotation.T @ (direction + stretch @ direction)
        r = self._radius(direction, feed)
        centre, half, rounded, gamma = self._solid(second_bar)

        to_bar = self._turn(2, -gamma * second_bar)
        u_bar, v_bar = to_bar @ u, to_bar @ v
        e = mask * (sign * (u_bar - centre) - half)
        w = mask * sign * v_bar
        a, b = ca.dot(w, w), ca.dot(e, w)
        c = ca.dot(e, e) - (rounded + r) ** 2
        s = (-b - ca.sqrt(b**2 - a * c)) / a
        late = 0.5 * self.setup.probe.tick_um
        residual = -s / _MM_PER_UM - late

        self.residual = ca.Function("residual", [self.x, q], [residual])
        self.slope = ca.Function("slope", [self.x, q], [residual, ca.jacobian(residual, self.x)])
        self.line = ca.Function("line", [self.x, q], [u, v, r])
        self.dimensions = ca.Function(
            "dimensions", [self.x], [ca.SX(part) for part in self._dimensions()]
        )

    def _table(self, first: Any, second: Any, first_dir: Any, second_dir: Any) -> tuple[Any, Any]:
        """Rotation and offset of the table in the machine frame."""
        ca, e = self.ca, self._error
        sin, cos = ca.sin(second), ca.cos(second)
        sin2, cos2 = ca.sin(2 * second), ca.cos(2 * second)

        def harmonic(id_: str, one: str, other: str, c: Any, s: Any) -> Any:
            return self._effect(id_, one) * c + self._effect(id_, other) * s

        move = ca.vertcat(
            harmonic("c_radial_2", "ax_um", "bx_um", cos2, sin2),
            harmonic("c_radial_2", "ay_um", "by_um", cos2, sin2),
            harmonic("c_axial", "a1_um", "b1_um", cos, sin)
            + harmonic("c_axial_2", "a2_um", "b2_um", cos2, sin2),
        )
        tilt_x = harmonic("c_wobble_2", "ax_arcsec", "bx_arcsec", cos2, sin2)
        tilt_y = harmonic("c_wobble_2", "ay_arcsec", "by_arcsec", cos2, sin2)
        turned = (
            second
            + harmonic("c_positioning", "a1_arcsec", "b1_arcsec", cos - 1, sin)
            + harmonic("c_positioning_2", "a2_arcsec", "b2_arcsec", cos2 - 1, sin2)
            - self._effect("c_backlash", "b_arcsec") / 2 * second_dir
        )
        spin = self._turn(2, turned)

        x, y, z = self.setup.axis_points().get(_FIRST_AXIS[self.preset], (0.0, 0.0, 0.0))
        if self.preset == "trt-ca":
            s_a, c_a = ca.sin(first), ca.cos(first)
            origin = ca.vertcat(
                0,
                y + e("EY0A") + self._effect("a_sag", "ky_um") * s_a,
                z + e("EZ0A") - self._effect("a_sag", "kz_um") * (1 - c_a),
            )
            twist = self._effect("a_twist", "k_arcsec") * s_a
            tipped = (
                first
                + self._effect("a_positioning", "k_arcsec") * s_a
                + self._effect("a_scale", "k_arcsec") * first / (np.pi / 2)
                - self._effect("a_backlash", "b_arcsec") / 2 * first_dir
            )
            cradle = self._tilts(e("EA0A"), e("EB0A") + twist, e("EC0A")) @ self._turn(0, tipped)
            centre = ca.vertcat(e("EX0C"), e("EY0C") - e("EY0A") - y, -z) + move
            lean = self._tilts(tilt_x, e("EB0C") - e("EB0A") + tilt_y, 0)
            return cradle @ lean @ spin, origin + cradle @ centre
        if self.preset == "trt-bc":
            origin = ca.vertcat(x + e("EX0B"), 0, z + e("EZ0B"))
            cradle = self._tilts(e("EA0B"), e("EB0B"), e("EC0B")) @ self._turn(1, first)
            centre = ca.vertcat(e("EX0C") - e("EX0B") - x, e("EY0C"), -z) + move
            lean = self._tilts(e("EA0C") - e("EA0B") + tilt_x, tilt_y, 0)
            return cradle @ lean @ spin, origin + cradle @ centre
        centre = ca.vertcat(e("EX0C"), e("EY0C"), 0) + move
        return self._tilts(e("EA0C") + tilt_x, e("EB0C") + tilt_y, 0) @ spin, centre

    def _head(self, b: Any) -> Any:
        """Return what a swivelling head's errors add to the position of its ball."""
        if self.preset != "table-c-head-b":
            return self.ca.SX.zeros(3)
        e = self._error
        length = self.setup.probe.length_mm
        x, _, _ = self.setup.axis_points().get("B", (0.0, 0.0, length))
        hanging = self._turn(1, b) @ self.ca.vertcat(-x, 0, -length)
        wrong = self._tilts(e("EA0B"), e("EB0B"), e("EC0B")) @ hanging
        return self.ca.vertcat(e("EX0B"), 0, e("EZ0B")) + wrong - hanging

    def _linear_axes(self, side: Any, time: Any) -> tuple[Any, Any]:
        """Λ and δ (mm) of the recorded position."""
        ca, f = self.ca, self._effect
        stretch = ca.vertcat(
            ca.horzcat(
                f("scale_x", "ppm"), -f("squareness_xy", "arcsec"), f("squareness_xz", "arcsec")
            ),
            ca.horzcat(0, f("scale_y", "ppm"), -f("squareness_yz", "arcsec")),
            ca.horzcat(0, 0, f("scale_z", "ppm")),
        )
        shift = [
            f(f"drift_{i}", "rate_um_h") * time / 3600 - f(f"backlash_{i}", "b_um") / 2 * side[k]
            for k, i in enumerate("xyz")
        ]
        if "warmup_z" in self.held:
            grown = 1 - ca.exp(-time / f("warmup_z", "tau_min"))
            shift[2] = shift[2] + f("warmup_z", "amplitude_um") * grown
        return stretch, ca.vertcat(*shift)

    def _radius(self, direction: Any, feed: Any) -> Any:
        ca, f = self.ca, self._effect
        sideways = 1 - direction[2] ** 2
        phi = ca.atan2(direction[1], direction[0])
        lobes = f("probe_lobing", "a3_um") * ca.cos(3 * phi)
        lobes = lobes + f("probe_lobing", "b3_um") * ca.sin(3 * phi)
        return (
            self.setup.probe.ball_radius_mm
            + f("probe_radius", "dr_um")
            - sideways * (f("probe_bending", "k_um") + lobes)
            - feed * f("trigger_delay", "tau_ms")
        )

    def _dimensions(self) -> tuple[Any, Any, Any, Any]:
        """Length, width and height (mm) as they are, and the turn (rad) of the Y bar."""
        artefact, f = self.setup.artefact, self._effect
        grown = 1 + f("artefact_expansion", "ppm")
        return (
            artefact.length_mm * grown + f("artefact_length", "dl_um"),
            artefact.width_mm * grown + f("artefact_width", "dw_um"),
            artefact.height_mm * grown + f("artefact_height", "dh_um"),
            f("artefact_squareness", "gamma_arcsec"),
        )

    def _solid(self, second_bar: Any) -> tuple[Any, Any, Any, Any]:
        """Return centre, half sizes, rounding radius and turn about Z of the part in contact.

        A sphere is a box of no size, rounded.
        """
        ca, artefact = self.ca, self.setup.artefact
        if artefact.diameter_mm is not None:
            grown = 1 + self._effect("artefact_expansion", "ppm")
            return ca.DM(artefact.centre_mm), ca.DM.zeros(3), artefact.diameter_mm / 2 * grown, 0.0
        length, width, height, gamma = self._dimensions()
        along_x = length * (1 - second_bar) + width * second_bar
        along_y = width * (1 - second_bar) + length * second_bar
        half = ca.vertcat(along_x, along_y, height) / 2
        return ca.vertcat(0, 0, height / 2), half, 0.0, gamma

    # Numbers

    def contacts(self, x: Floats, rows: _Rows, t0_s: float) -> _Contacts:
        """Which feature each touch meets first, looking both ways from the recorded position."""
        n = rows.n
        all_axes = _Contacts(np.ones((n, 3)), np.ones((n, 3)), np.zeros(n))
        if self.setup.artefact.kind == "sphere":
            return all_axes
        table = rows.table(t0_s, all_axes)
        u, v, r = (np.array(part).T for part in self.line.map(n)(x, table))
        length, width, height, gamma = (float(part) for part in self.dimensions(x))
        centre = np.array([0.0, 0.0, height / 2])
        bars = [(np.array([length, width, height]) / 2, 0.0)]
        if self.setup.artefact.kind == "cross":
            bars.append((np.array([width, length, height]) / 2, gamma))
        ways, features = [], []
        for half, turned in bars:
            s, feature = _box_contact(
                _about_z(u, turned), _about_z(v, turned), r[:, 0], centre, half
            )
            for other, other_turned in bars:
                at = _about_z(u + np.where(np.isfinite(s), s, 0.0)[:, None] * v, other_turned)
                s = np.where(_box_distance(at, centre, other) < r[:, 0] - 1e-9, np.inf, s)
            ways.append(s)
            features.append(feature)
        which = np.argmin(np.abs(ways), axis=0)
        sign = _SIGNS[np.array(features)[which, np.arange(n)]]
        passing = ~np.isfinite(np.array(ways)[which, np.arange(n)])
        if np.any(passing):
            # A line that passes the artefact by: the side it faces, so that the search can go on.
            facing = np.zeros((n, 3))
            axis = np.argmax(np.abs(v), axis=1)
            facing[np.arange(n), axis] = -np.sign(v[np.arange(n), axis])
            sign = np.where(passing[:, None], facing, sign)
        return _Contacts(np.abs(sign), sign, which.astype(float))


# --- solvers --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Solution:
    x: Floats
    t0_s: float
    residuals: Floats
    jacobian: Floats
    converged: bool

    @property
    def cost(self) -> float:
        return float(self.residuals @ self.residuals)


def _evaluate(
    model: _Model, rows: _Rows, x: Floats, t0_s: float, contact: _Contacts
) -> tuple[Floats, Floats]:
    """Residuals (n,) and their derivatives (n, p)."""
    residual, slope = model.slope.map(rows.n)(x, rows.table(t0_s, contact))
    p = len(model.names)
    # A mapped CasADi function puts the (1, p) derivatives of the touches side by side.
    return np.array(residual).ravel(), np.array(slope).reshape(rows.n, p)


def _scaled_svd(jacobian: Floats) -> tuple[Floats, Floats, Floats, Floats, int]:
    """SVD of the design with columns of length one, those lengths, and the rank."""
    scale = np.linalg.norm(jacobian, axis=0)
    nothing = scale < _NOTHING_UM
    scale = np.where(nothing, 1.0, scale)
    u, s, vt = np.linalg.svd(np.where(nothing, 0.0, jacobian / scale), full_matrices=False)
    return u, s, vt, scale, int(np.sum(s > _RANK_TOLERANCE * s[0]))


def _step(residuals: Floats, jacobian: Floats) -> Floats:
    u, s, vt, scale, rank = _scaled_svd(jacobian)
    return np.asarray(-(vt[:rank].T @ ((u[:, :rank].T @ residuals) / s[:rank])) / scale)


def _gauss_newton(model: _Model, rows: _Rows, t0_s: float, x: Floats) -> _Solution:
    converged = False
    contact = model.contacts(x, rows, t0_s)
    residuals, jacobian = _evaluate(model, rows, x, t0_s, contact)
    _check_near(residuals)
    for _ in range(_MAX_ITERATIONS):
        step = _step(residuals, jacobian)
        share = 1.0
        cost = float(residuals @ residuals)
        while True:
            tried = x + share * step
            contact = model.contacts(tried, rows, t0_s)
            new_residuals, new_jacobian = _evaluate(model, rows, tried, t0_s, contact)
            new_cost = float(new_residuals @ new_residuals)
            if np.isfinite(new_cost) and new_cost <= cost * (1 + 1e-9) + 1e-15:
                break
            share /= 2
            if share < 1e-4:
                return _Solution(x, t0_s, residuals, jacobian, converged=False)
        x, residuals, jacobian = tried, new_residuals, new_jacobian
        if np.all(np.abs(step) < _STEP_TOLERANCE * np.maximum(1.0, np.abs(x) * 1e-3)):
            converged = True
            break
    return _Solution(x, t0_s, residuals, jacobian, converged)


def _ipopt(model: _Model, rows: _Rows, t0_s: float, x: Floats) -> _Solution:
    ca = model.ca
    unknown = ca.MX.sym("x", len(model.names))
    quantities = ca.MX.sym("q", 23, rows.n)
    residuals = model.residual.map(rows.n)(unknown, quantities)
    options = {
        "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-11, "max_iter": 300},
        "print_time": False,
    }
    problem = {"x": unknown, "p": ca.vec(quantities), "f": 0.5 * ca.sumsqr(residuals)}
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    contact = model.contacts(x, rows, t0_s)
    _check_near(_evaluate(model, rows, x, t0_s, contact)[0])
    converged = False
    for _ in range(_MAX_ITERATIONS):
        table = rows.table(t0_s, contact)
        found = solver(x0=x, p=table.T.ravel())
        x = np.array(found["x"]).ravel()
        again = model.contacts(x, rows, t0_s)
        if again == contact:
            converged = bool(solver.stats()["success"])
            break
        contact = again
    return _Solution(x, t0_s, *_evaluate(model, rows, x, t0_s, contact), converged=converged)


def _check_near(residuals: Floats) -> None:
    far = np.flatnonzero(~(np.abs(residuals) * _MM_PER_UM <= _FAR_MM))
    if len(far):
        off = residuals[far[0]] * _MM_PER_UM
        where = "passes it by" if not np.isfinite(off) else f"{abs(off):.3f} mm from it"
        raise DataError(
            f"touch {far[0]}: got a position that is not on the modelled surface ({where}), "
            f"expected one within {_FAR_MM:g} mm; {len(far)} of {len(residuals)} touches are "
            "like this"
        )


def _starts(model: _Model, rows: _Rows) -> list[tuple[float, Floats]]:
    """Where to start: one place, or the best few of a grid over times that are not linear."""
    base = model.start()
    held = model.held
    times = np.unique(rows.time)
    t0_grid = [np.inf]
    if "setup_shift" in held:
        fixed = held["setup_shift"].get("t0_s")
        t0_grid = [float(fixed)] if fixed is not None else list((times[1:] + times[:-1]) / 2)
    tau_grid: list[float | None] = [None]
    if _TIME_CONSTANT in model.names:
        end_min = float(times[-1]) / 60 or 1.0
        tau_grid = list(np.geomspace(0.02 * end_min, 3 * end_min, 30))
    if len(t0_grid) * len(tau_grid) == 1:
        start = base.copy()
        return [(t0_grid[0], start)]
    slipping = np.array([name.startswith("setup_shift.") for name in model.names])
    tried = []
    for tau in tau_grid:
        start = base.copy()
        free = np.ones(len(base), dtype=bool)
        if tau is not None:
            start[model.names.index(_TIME_CONSTANT)] = tau
            free[model.names.index(_TIME_CONSTANT)] = False
        # At no slip its time changes no residual, only which rows the slip's columns have.
        contact = model.contacts(start, rows, -np.inf)
        residuals, all_slipped = _evaluate(model, rows, start, -np.inf, contact)
        _check_near(residuals)
        for t0_s in t0_grid:
            slipped = (rows.time >= t0_s)[:, None]
            jacobian = np.where(slipping & ~slipped, 0.0, all_slipped)[:, free]
            step = _step(residuals, jacobian)
            left = residuals + jacobian @ step
            moved = start.copy()
            moved[free] += step
            tried.append((float(left @ left), t0_s, moved))
    tried.sort(key=lambda t: t[0])
    return [(t0_s, start) for _, t0_s, start in tried[:3]]


# --- the result -----------------------------------------------------------------------------------


def _result(model: _Model, rows: _Rows, found: _Solution, method: str) -> IdentificationResult:
    names = model.names
    probe = model.setup.probe
    _, s, vt, scale, rank = _scaled_svd(found.jacobian)
    searched = "setup_shift" in model.held and "t0_s" not in model.held["setup_shift"]
    freedom = rows.n - rank - searched
    if probe.repeatability_um > 0:
        variance = probe.repeatability_um**2 + probe.tick_um**2 / 12
    else:
        variance = found.cost / freedom if freedom > 0 else np.inf
    weighted = vt[:rank] / s[:rank, None] / scale
    covariance = variance * weighted.T @ weighted
    unseen = np.linalg.norm(vt[rank:], axis=0) > _RANK_TOLERANCE
    covariance[unseen, :] = covariance[:, unseen] = 0.0
    std = np.where(unseen, np.inf, np.sqrt(np.diag(covariance)))
    std_errors = {name: float(value) for name, value in zip(names, std, strict=True)}
    values = {name: float(value) for name, value in zip(names, found.x, strict=True)}
    effects: dict[str, dict[str, float]] = {}
    for id_, held in model.held.items():
        given = {**held}
        if id_ == "setup_shift" and searched:
            given["t0_s"] = found.t0_s
            # Anywhere between the two touches is as likely: the spread of a uniform distribution.
            before, after = rows.time[rows.time < found.t0_s], rows.time[rows.time >= found.t0_s]
            std_errors[_SLIP_TIME] = float((after.min() - before.max()) / np.sqrt(12))
        effects[id_] = {
            name: float(given[name]) if name in given else values[f"{id_}.{name}"]
            for name in _EFFECTS[id_][0]
        }
    return IdentificationResult(
        method=f"casadi {method}",
        errors={name: values[name] for name in model.error_names},
        placement={name: values[name] for name in _PLACEMENT},
        effects=effects,
        std_errors=std_errors,
        names=names,
        covariance=covariance,
        residuals_um=found.residuals,
        sigma_um=float(np.sqrt(variance)),
        degrees_of_freedom=freedom,
        converged=found.converged,
        combinations=tuple(named_combination(names, row / scale) for row in vt[rank:]),
    )
