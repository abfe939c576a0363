"""The residual of one touch as a symbolic CasADi function, written from the conventions alone.

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

from trunnion.base.checks import choose, optional_module
from trunnion.base.errors import InputError
from trunnion.base.units import ARCSEC, Floats, Integers, unit_of
from trunnion.machine.chain import Chain
from trunnion.reference.chain import LETTERS, Axes, RotaryAxis

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
MAX_ROTARY = 2
SHIFT_TIME = "setup_shift.t0_s"


def known_effects(setup: Setup) -> list[str]:
    """Return the effects on a set-up's touches that this model has.

    Error motions of rotary axes under the table, along X and Z only: A and C.
    """
    straight = {
        f"{axis.letter.lower()}_"
        for axis in Axes.of(setup).table
        if np.array_equal(axis.direction, LETTERS[axis.letter])
    }
    return [e for e in EFFECTS if e[:2] not in {"a_", "c_"} or e[:2] in straight]


@dataclass(frozen=True)
class Rows:
    """The touches' quantities in mm, rad, s, h; (n,), (n, 3), rotary axes (n, MAX_ROTARY)."""

    position: Floats
    direction: Floats
    angles: Floats
    turned: Floats
    feed: Floats
    time: Floats

    @property
    def n(self) -> int:
        """Number of touches."""
        return len(self.feed)

    @classmethod
    def of(cls, data: Touches, setup: Setup, effects: Iterable[str]) -> Rows:
        """Touches in the senses of the machine; columns that effects need must be there."""
        chain = Chain(setup)
        known = known_effects(setup)
        for id_ in effects:
            for column in EFFECTS[choose("effect", id_, known)][1]:
                if getattr(data, column) is None:
                    raise InputError(f"{id_}: got touches without {column}, expected that column")

        def optional(name: str, factor: float = 1.0) -> Floats:
            values = getattr(data, name)
            return np.zeros(len(data)) if values is None else factor * np.asarray(values, float)

        angles, turned = np.zeros((2, len(data), MAX_ROTARY))
        for i, (letter, sense) in enumerate(zip(chain.letters, chain.senses, strict=True)):
            angle = getattr(data, f"{letter.lower()}_deg")
            if angle is None:
                raise InputError(
                    f"touches: got no {letter.lower()}_deg, expected it for {chain.name}"
                )
            angles[:, i] = sense * np.radians(angle)
            turned[:, i] = optional(f"{letter.lower()}_dir", sense)

        if setup.probe.servo_period_ms and data.feed_mm_min is None:
            raise InputError("touches: got no feed_mm_min, expected it for probe.servo_period_ms")
        return cls(
            position=np.stack([data.x_mm, data.y_mm, data.z_mm], axis=1),
            direction=np.stack([data.dir_x, data.dir_y, data.dir_z], axis=1),
            angles=angles,
            turned=turned,
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
                self.angles.T,
                self.turned.T,
                self.feed,
                self.time - self.time.min(initial=np.inf),
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


KINDS = ("cross", "cuboid", "sphere")
"""What its contact is written for."""


class Model:
    """The residual of one touch as a CasADi function of the unknowns x (µm, arcsec, ...)."""

    def __init__(self, setup: Setup, held: Mapping[str, Mapping[str, float]]) -> None:
        self.ca = optional_module("casadi", "trunnion.casadi_baseline", "reference")
        if setup.artefact.kind not in KINDS:
            text = f"one of {', '.join(KINDS)}: its contact is written for these"
            raise InputError(
                f"CasADi baseline: got an artefact of kind {setup.artefact.kind!r}, expected {text}"
            )
        self.setup = setup
        self.axes, self.letters = Axes.of(setup), Chain(setup).letters
        self.held = held
        self.error_names = tuple(Chain(setup).location_errors)
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
        angles = dict(zip(self.letters, (q[9], q[10]), strict=False))
        turned = dict(zip(self.letters, (q[11], q[12]), strict=False))
        feed, time, shifted = q[13], q[14], q[15]
        mask, sign, second_bar = q[16:19], q[19:22], q[22]

        rotation, offset = self._table(angles, turned)
        seat = [
            self._unknown(name) + shifted * self._effect("setup_shift", name)
            for name in PLACEMENT[:3]
        ]
        artefact = self.setup.artefact
        # Tilts about X and Y take Z to the normal of the table top.
        x, y, z = np.array(self.setup.description().table_normal)
        lean = (np.arctan2(-y, z), np.arctan2(x, np.hypot(y, z)), np.radians(artefact.turn_deg))
        top = ca.DM(np.array(self._tilts(lean[0], lean[1], 0.0), float))
        offset = offset + rotation @ (ca.vertcat(*seat) + top @ ca.DM(artefact.effective_place_mm))
        tilts = [
            self._unknown(name) + nominal for name, nominal in zip(PLACEMENT[3:], lean, strict=True)
        ]
        rotation = rotation @ self._tilts(*tilts)

        stretch, shift = self._linear_axes(side, time)
        actual = position + stretch @ position + shift + self._head(angles)
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

    def _table(self, angles: Mapping[str, Any], turned: Mapping[str, Any]) -> tuple[Any, Any]:
        """Rotation and offset of the table in the machine frame."""
        rotation, offset = self.ca.SX.eye(3), self.ca.SX.zeros(3)
        for axis in self.axes.table:
            motion = self._motion(axis.letter, angles[axis.letter], turned[axis.letter])
            rotation, offset = self._carried(axis, rotation, offset, *motion)
        if self.axes.table:
            offset = offset - rotation @ self.ca.DM(self.axes.table[-1].origin)
        return rotation, offset

    def _head(self, angles: Mapping[str, Any]) -> Any:
        """Return what a head's errors add to the position of its ball."""
        ends = []
        for errors in (True, False):
            rotation, offset = self.ca.SX.eye(3), self.ca.SX.zeros(3)
            for axis in self.axes.head:
                still = (angles[axis.letter], [0.0] * 6)
                rotation, offset = self._carried(axis, rotation, offset, *still, errors=errors)
            if self.axes.head:
                offset = offset - rotation @ self.ca.DM(self.axes.head[-1].origin)
            ends.append(offset)
        return ends[0] - ends[1]

    def _carried(
        self,
        axis: RotaryAxis,
        rotation: Any,
        offset: Any,
        angle: Any,
        motion: list[Any],
        *,
        errors: bool = True,
    ) -> tuple[Any, Any]:
        """Rotation and origin behind the turn of an axis on what has these."""
        ca, known = self.ca, {name: self._unknown(name) for name in self.error_names}
        amounts = axis.amounts(known) if errors else [0.0] * 6
        x, y, z, a, b, c = (own + more for own, more in zip(amounts, motion, strict=True))
        offset = offset + rotation @ (ca.DM(axis.offset) + ca.vertcat(x, y, z))
        skew = ca.skew(ca.DM(axis.direction))
        turn = ca.DM.eye(3) + ca.sin(angle) * skew + (1 - ca.cos(angle)) * (skew @ skew)
        return rotation @ self._tilts(a, b, c) @ turn, offset

    def _motion(self, letter: str, angle: Any, sense: Any) -> tuple[Any, list[Any]]:
        """Angle that an axis really turns by, and the six components of its error motions."""
        f, s, c = self._effect, self.ca.sin(angle), self.ca.cos(angle)
        if letter == "A":
            tipped = (
                angle
                + f("a_positioning", "k_arcsec") * s
                + f("a_scale", "k_arcsec") * angle / (np.pi / 2)
                - f("a_backlash", "b_arcsec") / 2 * sense
            )
            sag = [f("a_sag", "ky_um") * s, -f("a_sag", "kz_um") * (1 - c)]
            return tipped, [0.0, *sag, 0.0, f("a_twist", "k_arcsec") * s, 0.0]
        if letter != "C":
            return angle, [0.0] * 6
        s2, c2 = self.ca.sin(2 * angle), self.ca.cos(2 * angle)

        def harmonic(id_: str, one: str, other: str, cosine: Any, sine: Any) -> Any:
            return f(id_, one) * cosine + f(id_, other) * sine

        turned = (
            angle
            + harmonic("c_positioning", "a1_arcsec", "b1_arcsec", c - 1, s)
            + harmonic("c_positioning_2", "a2_arcsec", "b2_arcsec", c2 - 1, s2)
            - f("c_backlash", "b_arcsec") / 2 * sense
        )
        return turned, [
            harmonic("c_radial_2", "ax_um", "bx_um", c2, s2),
            harmonic("c_radial_2", "ay_um", "by_um", c2, s2),
            harmonic("c_axial", "a1_um", "b1_um", c, s)
            + harmonic("c_axial_2", "a2_um", "b2_um", c2, s2),
            harmonic("c_wobble_2", "ax_arcsec", "bx_arcsec", c2, s2),
            harmonic("c_wobble_2", "ay_arcsec", "by_arcsec", c2, s2),
            0.0,
        ]

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
        grown = artefact.growth * (1 + f("artefact_expansion", "ppm"))
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
            grown = artefact.growth * (1 + self._effect("artefact_expansion", "ppm"))
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
