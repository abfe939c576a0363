"""Where ball and artefact are: poses, errors and effects, each at its own place.

Independent of the project's core on purpose: plain numpy, written from the conventions alone, so
that agreement means something. Inside mm, rad, s; names of arguments carry µm, arcsec, deg.

    p_machine = T_A Rx(a) T_C Rz(c) T_S p_artefact          (trt-ca)
    p_actual  = (I + Λ) p_recorded + δ
    the ball touches where its centre is r_eff from the artefact's surface

Choices where the conventions are silent:

- a component of the approach smaller than 1e-9 has no sign (backlash does not act on it);
- error motions are functions of the commanded axis position; backlash is added beside them;
- ``sense = -1`` turns position and sense of turning alike, before anything else;
- a slip has happened when ``time_s >= t0_s``;
- a dimension is ``nominal * (1 + ppm * 1e-6) + its own error``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Effects = Mapping[str, Mapping[str, float]]

MM_PER_UM = 1e-3
RAD_PER_ARCSEC = np.pi / (180.0 * 3600.0)
NO_SIGN_BELOW = 1e-9

LOCATION_ERRORS: dict[str, tuple[str, ...]] = {
    "trt-ca": ("EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EX0C", "EY0C", "EB0C"),
    "trt-bc": ("EB0B", "EA0B", "EC0B", "EX0B", "EZ0B", "EX0C", "EY0C", "EA0C"),
    "table-c-head-b": (
        *("EB0B", "EA0B", "EC0B", "EX0B", "EZ0B"),
        *("EX0C", "EY0C", "EA0C", "EB0C"),
    ),
}
PLACEMENT = ("dx_um", "dy_um", "dz_um", "ra_arcsec", "rb_arcsec", "rc_arcsec")

EFFECTS: dict[str, tuple[str, ...]] = {
    "probe_radius": ("dr_um",),
    "probe_bending": ("k_um",),
    "probe_lobing": ("a3_um", "b3_um"),
    "trigger_delay": ("tau_ms",),
    "artefact_length": ("dl_um",),
    "artefact_width": ("dw_um",),
    "artefact_height": ("dh_um",),
    "artefact_squareness": ("gamma_arcsec",),
    "artefact_expansion": ("ppm",),
    "setup_shift": ("dx_um", "dy_um", "dz_um", "t0_s"),
    "scale_x": ("ppm",),
    "scale_y": ("ppm",),
    "scale_z": ("ppm",),
    "squareness_xy": ("arcsec",),
    "squareness_xz": ("arcsec",),
    "squareness_yz": ("arcsec",),
    "backlash_x": ("b_um",),
    "backlash_y": ("b_um",),
    "backlash_z": ("b_um",),
    "c_positioning": ("a1_arcsec", "b1_arcsec"),
    "c_positioning_2": ("a2_arcsec", "b2_arcsec"),
    "c_radial_2": ("ax_um", "bx_um", "ay_um", "by_um"),
    "c_axial": ("a1_um", "b1_um"),
    "c_axial_2": ("a2_um", "b2_um"),
    "c_wobble_2": ("ax_arcsec", "bx_arcsec", "ay_arcsec", "by_arcsec"),
    "a_positioning": ("k_arcsec",),
    "a_scale": ("k_arcsec",),
    "a_sag": ("ky_um", "kz_um"),
    "a_twist": ("k_arcsec",),
    "c_backlash": ("b_arcsec",),
    "a_backlash": ("b_arcsec",),
    "drift_x": ("rate_um_h",),
    "drift_y": ("rate_um_h",),
    "drift_z": ("rate_um_h",),
    "warmup_z": ("amplitude_um", "tau_min"),
}
NONLINEAR = {("setup_shift", "t0_s"), ("warmup_z", "tau_min")}


@dataclass(frozen=True)
class Artefact:
    """A cross or a cuboid stands on the table, centred; a sphere has a centre of its own."""

    kind: str = "cross"
    length_mm: float = 100.0
    width_mm: float = 25.0
    height_mm: float = 25.0
    diameter_mm: float = 25.0
    centre_mm: tuple[float, float, float] = (0.0, 0.0, 50.0)
    squareness_rad: float = 0.0  # the Y bar of a cross turned about Z


@dataclass(frozen=True)
class Setup:
    """What the operator knows: machine, artefact, probe, resolutions."""

    preset: str = "trt-ca"
    known_errors: Mapping[str, float] = field(default_factory=dict)  # µm, arcsec
    sense: Mapping[str, int] = field(default_factory=dict)  # axis letter -> +1, -1
    artefact: Artefact = field(default_factory=Artefact)
    ball_radius_mm: float = 1.0
    probe_length_mm: float = 100.0
    tilt_point_mm: tuple[float, float, float] | None = None  # of the A or B axis, machine frame
    place_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the artefact on the table
    turn_deg: float = 0.0
    tick_um: float = 0.0
    repeatability_um: float = 0.0
    linear_um: float = 0.1
    rotary_arcsec: float = 0.36

    @property
    def tilt_letter(self) -> str:
        return "A" if self.preset == "trt-ca" else "B"

    @property
    def tilt_axis_mm(self) -> tuple[float, float, float]:
        """A point of the tilting axis, (x, y, z); the pivot of a head is above the ball."""
        if self.tilt_point_mm is not None:
            return self.tilt_point_mm
        return (0.0, 0.0, self.probe_length_mm if self.preset == "table-c-head-b" else 0.0)


@dataclass(frozen=True)
class Truth:
    """What is really there: absolute location errors, placement, effects."""

    errors: Mapping[str, float] = field(default_factory=dict)
    placement: Mapping[str, float] = field(default_factory=dict)
    effects: Effects = field(default_factory=dict)


@dataclass(frozen=True)
class Conditions:
    """Under which each of the n touches is made. Positions and senses as the control shows them."""

    a_deg: Floats  # tilting axis: A, or B where the machine has one
    c_deg: Floats
    direction: Floats  # (n, 3) unit approach, machine frame
    feed_mm_min: Floats
    time_s: Floats
    a_dir: Floats
    c_dir: Floats

    def __len__(self) -> int:
        return len(self.a_deg)


# --- rigid poses as (..., 4, 4) -------------------------------------------------------------------
# Numbers keep their type from here on: complex parameters go through to the approach lines, which
# gives derivatives by the complex step.


def translation(x: Floats | float, y: Floats | float, z: Floats | float) -> Floats:
    x, y, z = np.broadcast_arrays(x, y, z)
    pose = np.zeros((*x.shape, 4, 4), np.result_type(x, y, z, float))
    pose[..., range(4), range(4)] = 1.0
    pose[..., 0, 3], pose[..., 1, 3], pose[..., 2, 3] = x, y, z
    return pose


def turn(axis: int, angle: Floats | float) -> Floats:
    """Right-handed rotation about axis 0 = X, 1 = Y, 2 = Z."""
    angle = np.asarray(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    pose = np.zeros((*angle.shape, 4, 4), np.result_type(angle, float))
    pose[..., axis, axis] = pose[..., 3, 3] = 1.0
    pose[..., i, i] = pose[..., j, j] = np.cos(angle)
    pose[..., i, j] = -np.sin(angle)
    pose[..., j, i] = np.sin(angle)
    return pose


def tilts(alpha: Floats | float, beta: Floats | float, gamma: Floats | float) -> Floats:
    """R(α, β, γ) = Rx(α) Ry(β) Rz(γ)."""
    return turn(0, alpha) @ turn(1, beta) @ turn(2, gamma)


# --- the five places where effects act ------------------------------------------------------------


def _get(effects: Effects, id_: str) -> tuple[float, ...]:
    """Parameters of an effect in catalogue order, zeros where it is absent."""
    given = effects.get(id_, {})
    unknown = set(given) - set(EFFECTS[id_])
    if unknown:
        raise KeyError(f"{id_} has no parameter {sorted(unknown)}; it has {EFFECTS[id_]}")
    return tuple(given.get(name, 0.0) for name in EFFECTS[id_])


def axis_positions(k: Conditions, setup: Setup) -> tuple[Floats, Floats, Floats, Floats]:
    """Right-handed positions (rad) and senses of turning of the tilting and of the C axis."""
    sense_a, sense_c = setup.sense.get(setup.tilt_letter, 1), setup.sense.get("C", 1)
    return (
        np.radians(k.a_deg) * sense_a,
        np.radians(k.c_deg) * sense_c,
        k.a_dir * sense_a,
        k.c_dir * sense_c,
    )


@dataclass(frozen=True)
class Motion:
    """Error motion of one rotary axis: offsets (mm), tilts (rad), and what is added to its turn."""

    x: Floats | float = 0.0
    y: Floats | float = 0.0
    z: Floats | float = 0.0
    alpha: Floats | float = 0.0
    beta: Floats | float = 0.0
    turn: Floats | float = 0.0


def c_motion(c: Floats, c_dir: Floats, effects: Effects) -> Motion:
    a1, b1 = _get(effects, "c_positioning")
    a2, b2 = _get(effects, "c_positioning_2")
    rax, rbx, ray, rby = _get(effects, "c_radial_2")
    za1, zb1 = _get(effects, "c_axial")
    za2, zb2 = _get(effects, "c_axial_2")
    wax, wbx, way, wby = _get(effects, "c_wobble_2")
    (backlash,) = _get(effects, "c_backlash")
    cos1, sin1, cos2, sin2 = np.cos(c), np.sin(c), np.cos(2 * c), np.sin(2 * c)
    positioning = a1 * (cos1 - 1) + b1 * sin1 + a2 * (cos2 - 1) + b2 * sin2
    return Motion(
        x=(rax * cos2 + rbx * sin2) * MM_PER_UM,
        y=(ray * cos2 + rby * sin2) * MM_PER_UM,
        z=(za1 * cos1 + zb1 * sin1 + za2 * cos2 + zb2 * sin2) * MM_PER_UM,
        alpha=(wax * cos2 + wbx * sin2) * RAD_PER_ARCSEC,
        beta=(way * cos2 + wby * sin2) * RAD_PER_ARCSEC,
        turn=(positioning - backlash / 2 * c_dir) * RAD_PER_ARCSEC,
    )


def a_motion(a: Floats, a_dir: Floats, effects: Effects) -> Motion:
    (positioning,) = _get(effects, "a_positioning")
    (scale,) = _get(effects, "a_scale")
    ky, kz = _get(effects, "a_sag")
    (twist,) = _get(effects, "a_twist")
    (backlash,) = _get(effects, "a_backlash")
    turned = positioning * np.sin(a) + scale * a / (np.pi / 2) - backlash / 2 * a_dir
    return Motion(
        y=ky * np.sin(a) * MM_PER_UM,
        z=-kz * (1 - np.cos(a)) * MM_PER_UM,
        beta=twist * np.sin(a) * RAD_PER_ARCSEC,
        turn=turned * RAD_PER_ARCSEC,
    )


def recorded_to_actual(k: Conditions, effects: Effects) -> tuple[Floats, Floats]:
    """Λ (3, 3) and δ (n, 3) in mm of p_actual = (I + Λ) p_recorded + δ."""
    kind = np.result_type(float, *(v for values in effects.values() for v in values.values()))
    lam = np.zeros((3, 3), kind)
    for i, letter in enumerate("xyz"):
        lam[i, i] = _get(effects, f"scale_{letter}")[0] * 1e-6
    lam[0, 1] = -_get(effects, "squareness_xy")[0] * RAD_PER_ARCSEC
    lam[0, 2] = +_get(effects, "squareness_xz")[0] * RAD_PER_ARCSEC
    lam[1, 2] = -_get(effects, "squareness_yz")[0] * RAD_PER_ARCSEC
    sign = np.where(np.abs(k.direction) < NO_SIGN_BELOW, 0.0, np.sign(k.direction))
    hours = (k.time_s - k.time_s.min()) / 3600.0
    delta = np.zeros((len(k), 3), kind)
    for i, letter in enumerate("xyz"):
        delta[:, i] -= _get(effects, f"backlash_{letter}")[0] / 2 * sign[:, i]
        delta[:, i] += _get(effects, f"drift_{letter}")[0] * hours
    if "warmup_z" in effects:
        amplitude, tau_min = _get(effects, "warmup_z")
        delta[:, 2] += amplitude * -np.expm1(-60.0 * hours / tau_min)
    return lam, delta * MM_PER_UM


def effective_radius(k: Conditions, setup: Setup, effects: Effects) -> Floats:
    """r_eff (n,) in mm."""
    (dr,) = _get(effects, "probe_radius")
    (bending,) = _get(effects, "probe_bending")
    a3, b3 = _get(effects, "probe_lobing")
    (tau_ms,) = _get(effects, "trigger_delay")
    dx, dy, dz = k.direction.T
    w = 1 - dz**2
    phi = np.arctan2(dy, dx)
    lobing = a3 * np.cos(3 * phi) + b3 * np.sin(3 * phi)
    travel_mm = k.feed_mm_min / 60.0 * tau_ms * 1e-3
    pretravel = (dr - bending * w - lobing * w) * MM_PER_UM - travel_mm
    return np.asarray(setup.ball_radius_mm + pretravel)


def true_artefact(setup: Setup, effects: Effects) -> Artefact:
    nominal = setup.artefact
    grow = 1 + _get(effects, "artefact_expansion")[0] * 1e-6
    dl, dw, dh = (
        _get(effects, f"artefact_{name}")[0] * MM_PER_UM for name in ("length", "width", "height")
    )
    gamma = _get(effects, "artefact_squareness")[0] * RAD_PER_ARCSEC
    return replace(
        nominal,
        length_mm=nominal.length_mm * grow + dl,
        width_mm=nominal.width_mm * grow + dw,
        height_mm=nominal.height_mm * grow + dh,
        diameter_mm=nominal.diameter_mm * grow,
        squareness_rad=nominal.squareness_rad + gamma,
    )


def placement_pose(
    k: Conditions, setup: Setup, placement: Mapping[str, float], effects: Effects
) -> Floats:
    """T_S (n, 4, 4) = translate(place + d) R(ra, rb, rc) Rz(turn), with the slip from its time."""
    unknown = set(placement) - set(PLACEMENT)
    if unknown:
        raise KeyError(f"placement has no {sorted(unknown)}; it has {PLACEMENT}")
    dx, dy, dz, ra, rb, rc = (placement.get(name, 0.0) for name in PLACEMENT)
    sx, sy, sz, t0 = _get(effects, "setup_shift")
    slipped = (k.time_s >= t0).astype(float)
    offset = translation(
        (dx + sx * slipped) * MM_PER_UM,
        (dy + sy * slipped) * MM_PER_UM,
        (dz + sz * slipped) * MM_PER_UM,
    )
    tilted = tilts(ra * RAD_PER_ARCSEC, rb * RAD_PER_ARCSEC, rc * RAD_PER_ARCSEC)
    return translation(*setup.place_mm) @ offset @ tilted @ turn(2, np.radians(setup.turn_deg))


def nominal_placement(setup: Setup) -> Floats:
    """Where the artefact nominally stands on the table, (4, 4)."""
    return translation(*setup.place_mm) @ turn(2, np.radians(setup.turn_deg))


# --- machines -------------------------------------------------------------------------------------


def _in_mm_rad(errors: Mapping[str, float], preset: str) -> dict[str, float]:
    """Location errors in mm and rad, zeros where absent. X, Y, Z are offsets, A, B, C tilts."""
    names = LOCATION_ERRORS[preset]
    unknown = set(errors) - set(names)
    if unknown:
        raise KeyError(f"{preset} has no location error {sorted(unknown)}; it has {names}")
    unit = {name: MM_PER_UM if name[1] in "XYZ" else RAD_PER_ARCSEC for name in names}
    return {name: errors.get(name, 0.0) * unit[name] for name in names}


def joint_poses(
    a: Floats, c: Floats, setup: Setup, errors: Mapping[str, float], first: Motion, second: Motion
) -> tuple[Floats, Floats]:
    """Pose of the tilting axis' and of the C axis' joint in its parent, (n, 4, 4) each.

    On the machine with a swivelling head the first one is the identity: nothing tilts the table.
    """
    preset = setup.preset
    e = _in_mm_rad(errors, preset)
    px, py, pz = setup.tilt_axis_mm
    if preset == "trt-ca":
        to_axis, back = translation(0.0, py, pz), translation(0.0, -py, -pz)
        T_A = translation(first.x, e["EY0A"] + first.y, e["EZ0A"] + first.z) @ tilts(
            e["EA0A"] + first.alpha, e["EB0A"] + first.beta, e["EC0A"]
        )
        T_C = translation(e["EX0C"] + second.x, e["EY0C"] - e["EY0A"] + second.y, second.z) @ tilts(
            second.alpha, e["EB0C"] - e["EB0A"] + second.beta, 0.0
        )
        T_A, T_C = to_axis @ T_A, back @ T_C
        return T_A @ turn(0, a + first.turn), T_C @ turn(2, c + second.turn)
    if preset == "trt-bc":
        T_B = translation(e["EX0B"], 0.0, e["EZ0B"]) @ tilts(e["EA0B"], e["EB0B"], e["EC0B"])
        T_C = translation(e["EX0C"] - e["EX0B"] + second.x, e["EY0C"] + second.y, second.z) @ tilts(
            e["EA0C"] - e["EA0B"] + second.alpha, second.beta, 0.0
        )
        T_B, T_C = translation(px, 0.0, pz) @ T_B, translation(-px, 0.0, -pz) @ T_C
        return T_B @ turn(1, a), T_C @ turn(2, c + second.turn)
    T_C = translation(e["EX0C"] + second.x, e["EY0C"] + second.y, second.z) @ tilts(
        e["EA0C"] + second.alpha, e["EB0C"] + second.beta, 0.0
    )
    return translation(0 * a, 0.0, 0.0), T_C @ turn(2, c + second.turn)


def head_displacement(b: Floats, setup: Setup, errors: Mapping[str, float]) -> Floats:
    """What a swivelling head's errors add to the position (n, 3) that the control believes, mm."""
    if setup.preset != "table-c-head-b":
        return np.zeros((len(b), 3))
    e = _in_mm_rad(errors, setup.preset)
    px, _, pz = setup.tilt_axis_mm
    to_pivot, to_ball = translation(px, 0.0, pz), translation(-px, 0.0, -pz)
    nominal = to_pivot @ turn(1, b) @ to_ball
    wrong = (
        to_pivot
        @ translation(e["EX0B"], 0.0, e["EZ0B"])
        @ tilts(e["EA0B"], e["EB0B"], e["EC0B"])
        @ turn(1, b)
        @ to_ball
    )
    return np.asarray((wrong - nominal)[:, :3, 3])


def table_pose(a_deg: Floats, c_deg: Floats, setup: Setup, truth: Truth) -> Floats:
    """Pose (n, 4, 4) of the table (before T_S) at the given positions; no sense of turning."""
    zero = np.zeros(np.broadcast(a_deg, c_deg).shape)
    k = Conditions(a_deg + zero, c_deg + zero, np.zeros((len(zero), 3)), zero, zero, zero, zero)
    return _table_pose(k, setup, truth)


def _table_pose(k: Conditions, setup: Setup, truth: Truth) -> Floats:
    a, c, a_dir, c_dir = axis_positions(k, setup)
    if setup.preset == "trt-ca":
        first = a_motion(a, a_dir, truth.effects)
    else:
        first = Motion()
        wrong = [id_ for id_ in truth.effects if id_.startswith("a_")]
        if wrong:
            raise KeyError(f"{setup.preset} has no A axis: {wrong}")
    second = c_motion(c, c_dir, truth.effects)
    first_pose, second_pose = joint_poses(a, c, setup, truth.errors, first, second)
    return np.asarray(first_pose @ second_pose)


@dataclass(frozen=True)
class Lines:
    """Ways of the ball centres through the artefact's frame: start + s · step, s in mm recorded."""

    start: Floats  # (n, 3)
    step: Floats  # (n, 3), almost a unit vector
    radius: Floats  # (n,) r_eff
    artefact: Artefact


def approach_lines(
    k: Conditions,
    start_mm: Floats,
    setup: Setup,
    truth: Truth,
    extra_mm: Floats | float = 0.0,
) -> Lines:
    """Lines of approach seen from the true artefact.

    start_mm (n, 3) are recorded positions; the ball goes from there along ``k.direction``.
    ``extra_mm`` (n, 3) is added to δ: what no effect of the catalogue makes.
    """
    lam, delta = recorded_to_actual(k, truth.effects)
    b = axis_positions(k, setup)[0]
    delta = delta + head_displacement(b, setup, truth.errors) + extra_mm
    seen = np.eye(3) + lam
    pose = _table_pose(k, setup, truth) @ placement_pose(k, setup, truth.placement, truth.effects)
    back = np.swapaxes(pose[:, :3, :3], 1, 2)
    start = start_mm @ seen.T + delta - pose[:, :3, 3]
    step = k.direction @ seen.T
    return Lines(
        start=np.einsum("nij,nj->ni", back, start),
        step=np.einsum("nij,nj->ni", back, step),
        radius=effective_radius(k, setup, truth.effects),
        artefact=true_artefact(setup, truth.effects),
    )
