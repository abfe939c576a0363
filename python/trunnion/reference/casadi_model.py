"""The residual of one touch as a symbolic CasADi function, written anew from the conventions.

Kinematics, effects and contact share no code with the core, so that where both agree, the formulas
are right and not only the same. Names and senses of a machine's axes are all that is taken from it.

The recorded ball centre p goes along its approach d, ``p(s) = p + s d``. In the artefact's frame
that is a line ``u + s v``. The feature in contact (a face, an edge or a corner of a box, or a
sphere) is where ``|e(s)| = r_eff`` with ``e_i = m_i (σ_i (u_i + s v_i - centre_i) - half_i)``: one
mask and one sign an axis make a face of one active axis, an edge of two, a corner of three, and a
sphere of three with half sizes 0. The smaller root of this quadratic is how far behind the recorded
position the model expects the contact, and the residual (µm, along the approach) is
``-s - tick/2``: recorded minus predicted coordinate.

References: Kang, Kim, Jee 2022 for machine and artefact; ISO 230-1 for the location errors.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import trunnion._core as _core
from trunnion.base.checks import choose, optional_module
from trunnion.base.errors import InputError
from trunnion.base.units import ARCSEC, Floats, Integers, unit_of
from trunnion.machine.chain import Chain

if TYPE_CHECKING:
    from trunnion.data.touches import Touches
    from trunnion.setup import Setup

MM_PER_UM = 1e-3
NO_SIGN_BELOW = 1e-9
"""A component of an approach direction below this has no sign."""

PLACEMENT = ("dx_um", "dy_um", "dz_um", "ra_arcsec", "rb_arcsec", "rc_arcsec")

# Effects: parameters, and the columns without which they mean nothing.
EFFECTS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
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
SHIFT_TIME = "setup_shift.t0_s"


@dataclass(frozen=True)
class Rows:
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
        """Number of touches."""
        return len(self.first)

    @classmethod
    def of(cls, data: Touches, setup: Setup, effects: Iterable[str]) -> Rows:
        """Touches in the senses of the machine; columns that effects need must be there."""
        chain = Chain(setup)
        letter = chain.letters[0]
        for id_ in effects:
            known = (e for e in EFFECTS if letter == "A" or not e.startswith("a_"))
            for column in EFFECTS[choose("effect", id_, known)][1]:
                if getattr(data, column) is None:
                    raise InputError(f"{id_}: got touches without {column}, expected that column")
        sense = dict(zip(chain.letters, chain.senses, strict=True))

        def turned(name: str) -> Floats:
            angle = getattr(data, f"{name.lower()}_deg")
            if angle is None:
                raise InputError(
                    f"touches: got no {name.lower()}_deg, expected it for {chain.name}"
                )
            return np.asarray(sense[name] * np.radians(angle))

        def optional(name: str, factor: float = 1.0) -> Floats:
            values = getattr(data, name)
            return np.zeros(len(data)) if values is None else factor * np.asarray(values, float)

        if setup.probe.servo_period_ms and data.feed_mm_min is None:
            raise InputError("touches: got no feed_mm_min, expected it for probe.servo_period_ms")
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

    def table(self, t0_s: float, contact: Contacts) -> Floats:
        """One column a touch: what the symbolic model of a touch is given, in its order."""
        return np.vstack(
            [
                self.position.T,
                self.direction.T,
                np.where(np.abs(self.direction) < NO_SIGN_BELOW, 0, np.sign(self.direction)).T,
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


@dataclass(frozen=True)
class Contacts:
    """Active axes (n, 3), their signs (n, 3) and whether it is the Y bar (n,), 0 or 1."""

    mask: Floats
    sign: Floats
    second_bar: Floats

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Contacts) and all(
            np.array_equal(a, b)
            for a, b in (
                (self.mask, other.mask),
                (self.sign * self.mask, other.sign * other.mask),
                (self.second_bar, other.second_bar),
            )
        )

    __hash__ = None  # type: ignore[assignment]


SIGNS = np.array([s for s in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(s)])  # (26, 3)


def _box_contact(
    u: Floats, v: Floats, r: Floats, centre: Floats, half: Floats
) -> tuple[Floats, Integers]:
    """Way (n,) to the first contact with a box, inf where the ball passes; and which feature."""
    mask = np.abs(SIGNS)
    e = mask * (SIGNS * (u - centre)[:, None, :] - half)  # (n, 26, 3)
    w = SIGNS * v[:, None, :]
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


class Model:
    """The residual of one touch as a CasADi function of the unknowns x (µm, arcsec, ...)."""

    def __init__(self, setup: Setup, held: Mapping[str, Mapping[str, float]]) -> None:
        self.ca = optional_module("casadi", "trunnion.casadi_baseline", "reference")
        self.setup = setup
        self.preset = setup.machine.preset
        self.held = held
        self.error_names = tuple(name for name, _ in _core.presets()[self.preset][2])
        for name in setup.machine.errors:
            choose(f"machine.errors of {self.preset}", name, self.error_names)
        for id_, values in held.items():
            for name in values:
                choose(f"{id_}: parameter", name, EFFECTS[id_][0])
        effect_names = [
            f"{id_}.{name}"
            for id_, values in held.items()
            for name in EFFECTS[id_][0]
            if name not in values and f"{id_}.{name}" != SHIFT_TIME
        ]
        self.names = (*self.error_names, *PLACEMENT, *effect_names)
        self.x = self.ca.SX.sym("x", len(self.names))
        self.q = self.ca.SX.sym("q", 23)
        self._build()

    def start(self) -> Floats:
        """Known location errors, 0 for the other unknowns."""
        known = self.setup.machine.errors
        return np.array([float(known.get(name, 0.0)) for name in self.names])

    def _unknown(self, name: str) -> Any:
        """Return a location error or a placement, mm or rad."""
        factor = MM_PER_UM if unit_of(name) == "µm" else ARCSEC
        return self.x[self.names.index(name)] * factor

    def _effect(self, id_: str, name: str) -> Any:
        """Return an effect's parameter in inner units; 0 where the effect is not in the model."""
        if id_ not in self.held:
            return 0.0
        unit = unit_of(name)
        sizes = {"µm": MM_PER_UM, "µm/h": MM_PER_UM, "arcsec": ARCSEC, "ppm": 1e-6}
        factor = sizes.get(unit) or {"ms": 1e-3, "min": 60.0}[unit]
        if name in self.held[id_]:
            return factor * float(self.held[id_][name])
        return factor * self.x[self.names.index(f"{id_}.{name}")]

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

    def _build(self) -> None:
        ca, q = self.ca, self.q
        position, direction, side = q[0:3], q[3:6], q[6:9]
        first, second, first_dir, second_dir = q[9], q[10], q[11], q[12]
        feed, time, shifted = q[13], q[14], q[15]
        mask, sign, second_bar = q[16:19], q[19:22], q[22]

        rotation, offset = self._table(first, second, first_dir, second_dir)
        seat = [
            self._unknown(name) + shifted * self._effect("setup_shift", name)
            for name in PLACEMENT[:3]
        ]
        artefact = self.setup.artefact
        offset = offset + rotation @ (ca.vertcat(*seat) + ca.DM(artefact.place_mm))
        rotation = rotation @ self._tilts(*map(self._unknown, PLACEMENT[3:]))
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
        probe = self.setup.probe
        late = 0.5 * (probe.tick_um + probe.servo_period_ms * feed)
        residual = -s / MM_PER_UM - late

        self.residual = ca.Function("residual", [self.x, q], [residual])
        self.slope = ca.Function("slope", [self.x, q], [residual, ca.jacobian(residual, self.x)])
        self.line = ca.Function("line", [self.x, q], [u, v, r])
        self.dimensions = ca.Function(
            "dimensions", [self.x], [ca.SX(part) for part in self._dimensions()]
        )

    def _table(self, first: Any, second: Any, first_dir: Any, second_dir: Any) -> tuple[Any, Any]:
        """Rotation and offset of the table in the machine frame."""
        ca, e = self.ca, self._unknown
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

        letter = "A" if self.preset == "trt-ca" else "B"
        x, y, z = self.setup.axis_points().get(letter, (0.0, 0.0, 0.0))
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
        e = self._unknown
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

    def contacts(self, x: Floats, rows: Rows, t0_s: float) -> Contacts:
        """Which feature each touch meets first, looking both ways from the recorded position."""
        n = rows.n
        all_axes = Contacts(np.ones((n, 3)), np.ones((n, 3)), np.zeros(n))
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
        sign = SIGNS[np.array(features)[which, np.arange(n)]]
        passing = ~np.isfinite(np.array(ways)[which, np.arange(n)])
        if np.any(passing):
            # A line that passes the artefact by: the side it faces, so that the search can go on.
            facing = np.zeros((n, 3))
            axis = np.argmax(np.abs(v), axis=1)
            facing[np.arange(n), axis] = -np.sign(v[np.arange(n), axis])
            sign = np.where(passing[:, None], facing, sign)
        return Contacts(np.abs(sign), sign, which.astype(float))
