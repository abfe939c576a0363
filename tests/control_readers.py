"""Controls that read tables, written from the formats' descriptions, on a machine with errors.

Nothing here is imported from the package: the machine is the contract's, in plain numpy.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from reference_trt_ca import ARCSEC, NAMES, Floats, shift, turn

CENTRE = np.array([210.5, 148.2, -301.0])
CORNERS = np.array(
    [[x, y, z] for x in (-150.0, 150.0) for y in (-120.0, 120.0) for z in (0.0, 150.0)]
)


@dataclass(frozen=True)
class RealMachine:
    """A trt-ca with location errors, errors of its axes, and senses of them; µm, arcsec, ppm."""

    errors: Mapping[str, float]
    scale: tuple[float, float, float] = (0.0, 0.0, 0.0)
    squareness: tuple[float, float, float] = (0.0, 0.0, 0.0)  # XY, XZ, YZ
    waves_c: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # a1 b1 a2 b2
    wobble_c: float = 0.0  # EAC = ax cos 2c
    scale_a: float = 0.0
    backlash: Mapping[str, float] = field(default_factory=dict)
    sense_a: int = 1
    senses: tuple[int, int, int] = (1, 1, 1)  # in which the control counts X, Y, Z

    def linear(self) -> Floats:
        """I + Λ."""
        matrix = np.diag(1 + 1e-6 * np.array(self.scale))
        xy, xz, yz = np.array(self.squareness) * ARCSEC
        matrix[0, 1], matrix[0, 2], matrix[1, 2] = -xy, xz, -yz
        return matrix

    def pose(self, a: float, c: float) -> Floats:
        """T_A Rx(a) T_C Rz(c) where the axes are sent to a, c, degrees of the machine."""
        e = dict.fromkeys(NAMES, 0.0) | dict(self.errors)
        q = np.radians(c)
        a1, b1, a2, b2 = self.waves_c
        ecc = a1 * (np.cos(q) - 1) + b1 * np.sin(q) + a2 * (np.cos(2 * q) - 1) + b2 * np.sin(2 * q)
        place_a = shift(0, e["EY0A"] * 1e-3, e["EZ0A"] * 1e-3)
        for axis, name in zip("xyz", ("EA0A", "EB0A", "EC0A"), strict=True):
            place_a = place_a @ turn(axis, e[name] * ARCSEC)
        place_c = shift(e["EX0C"] * 1e-3, (e["EY0C"] - e["EY0A"]) * 1e-3, 0)
        place_c = place_c @ turn("x", self.wobble_c * np.cos(2 * q) * ARCSEC)
        place_c = place_c @ turn("y", (e["EB0C"] - e["EB0A"]) * ARCSEC)
        turned_a = np.radians(a) + self.scale_a * a / 90 * ARCSEC
        return place_a @ turn("x", turned_a) @ place_c @ turn("z", q + ecc * ARCSEC)

    def reached(self, motor: Mapping[str, float], travel: int = 0) -> Floats:
        """Tool point on the table for motor positions, reached from one side (or neither)."""
        late = {k: -travel * v / 2 for k, v in self.backlash.items()}
        linear = np.array([motor[k] + late.get(k, 0.0) * 1e-3 for k in "XYZ"])
        tip = np.append(self.linear() @ (self.senses * (linear - CENTRE)), 1.0)
        a = self.sense_a * (motor["A"] + late.get("A", 0.0) / 3600)
        c = motor["C"] + late.get("C", 0.0) / 3600
        return np.asarray(np.linalg.solve(self.pose(a, c), tip)[:3])


class Control(Protocol):
    """Where a control sends its motors for a point of the work and rotary positions."""

    def motors(self, point: Floats, a: float, c: float, travel: int) -> dict[str, float]:
        """X, Y, Z in machine coordinates, A and C in degrees."""
        ...


def left_um(control: Control, machine: RealMachine, poses: list[tuple[float, float]]) -> Floats:
    """Errors of the corners of the work, (poses × corners, 3)."""
    rows = [
        machine.reached(control.motors(machine.senses * corner, a, c, 0)) - corner
        for a, c in poses
        for corner in CORNERS
    ]
    return 1e3 * np.array(rows)


def nominal_point(point: Floats, a: float, c: float, sense_a: int, sense_c: int = 1) -> Floats:
    """Machine coordinates of a point on the table; senses are about the control's axes."""
    pose = turn("x", np.radians(sense_a * a)) @ turn("z", np.radians(sense_c * c))
    return np.asarray((pose @ np.append(point, 1.0))[:3] + CENTRE)


# --- tables of single axes


def ssfk(text: str) -> dict[int, tuple[Floats, Floats, Floats]]:
    """`kw.ssfk` lists: logical axis → set positions, errors forward and backward, mm or degrees."""
    number = 0
    rows: dict[int, dict[str, float]] = {}
    for line in text.splitlines():
        if line.startswith("#"):
            continue
        key, value = line.split()
        if key == "kopf.achs_nr":
            number = int(value)
        elif found := re.fullmatch(r"kw\.ssfk\.table\[(\d+)\]\.(setpoint|pos|neg)", key):
            rows.setdefault(int(found[1]), {})[found[2]] = int(value) * 1e-4
        elif key == "kw.ssfk.kw_nr_max":
            count = int(value)
        elif key == "kw.ssfk.unit":
            assert value == "1"  # metric
    assert sorted(rows) == list(range(count))
    columns = [np.array([rows[i][key] for i in sorted(rows)]) for key in ("setpoint", "pos", "neg")]
    return {number: (columns[0], columns[1], columns[2])}


@dataclass
class TwinCat:
    """Sends an axis where its table says that it comes out right."""

    tables: dict[int, tuple[Floats, Floats, Floats]]
    sense_a: int
    sense_c: int = 1

    def motors(self, point: Floats, a: float, c: float, travel: int) -> dict[str, float]:
        x, y, z = nominal_point(point, a, c, self.sense_a, self.sense_c)
        return self.sent({"X": x, "Y": y, "Z": z, "A": a, "C": c}, travel)

    def sent(self, meant: dict[str, float], travel: int) -> dict[str, float]:
        out = dict(meant)
        for number, (nodes, forward, backward) in self.tables.items():
            axis = "XYZAC"[number - 1]
            rows = {1: forward, -1: backward, 0: (forward + backward) / 2}[travel]
            out[axis] -= float(np.interp(meant[axis], nodes, rows))
        return out


# --- Siemens 840D


@dataclass
class Siemens:
    """$TC_CARR, frame, $AA_ENC_COMP, $AN_CEC, $MA_BACKLASH."""

    carrier: dict[int, float]
    kind: str
    frame: Floats
    encoder: dict[str, tuple[Floats, Floats]]
    backlash: dict[str, float]
    sag: list[tuple[str, str, Floats, Floats]]
    vector_sign: int
    cec_sign: int

    @classmethod
    def read(cls, files: Mapping[str, str], vector_sign: int, cec_sign: int) -> Siemens:
        carrier = {
            int(n): float(v)
            for n, v in re.findall(r"^\$TC_CARR(\d+)\[1\]=(\S+)$", files["tc_carr.spf"], re.M)
            if not v.startswith('"')
        }
        (kind,) = re.findall(r'^\$TC_CARR23\[1\]="(\w)"$', files["tc_carr.spf"], re.M)
        words = re.findall(r"([XYZ]),(-?[\d.]+)", files["frame.spf"])
        numbers = [float(v) for _, v in words]
        frame = shift(*numbers[:3])  # RPY: about Z, then the new Y, then the new X
        for axis, angle in zip("zyx", numbers[:2:-1], strict=True):
            frame = frame @ turn(axis, np.radians(angle))
        encoder, backlash = _encoder(files.get("enc_comp.ini", ""))
        sag = _sag(files.get("cec.ini", ""))
        return cls(carrier, kind, frame, encoder, backlash, sag, vector_sign, cec_sign)

    def linear(self, point: Floats, turned: tuple[float, float], tool_mm: float) -> Floats:
        """X, Y, Z of the reference point of the toolholder, less the tool length along Z.

        A vector that the manual ignores for a kind may have any value.
        """
        i1, i2, i3, i4, v1, v2 = (
            np.array([self.carrier.get(n, np.nan) for n in numbers])
            for numbers in (
                (1, 2, 3), (4, 5, 6), (15, 16, 17), (18, 19, 20), (7, 8, 9), (10, 11, 12)
            )
        )  # fmt: skip
        q1, q2 = turned
        zero, tool = np.zeros(3), np.array([0.0, 0.0, tool_mm])
        at = (self.frame @ np.append(point + CENTRE, 1.0))[:3]
        if self.kind == "P":
            np.testing.assert_allclose(i4, -(i2 + i3), atol=1e-6)
            at = _about(i2 + i3, self.vector_sign * v2, q2, at)
            return _about(i2, self.vector_sign * v1, q1, at)
        if self.kind == "T":
            np.testing.assert_allclose(i1, -(i2 + i3), atol=1e-6)
            inner = i2 + _about(zero, v2, q2, i3 + tool)
        else:
            np.testing.assert_allclose(np.r_[i1, i4], -np.r_[i2, i3], atol=1e-6)
            at = _about(i3, self.vector_sign * v2, q2, at)
            inner = i2 + tool
        return np.asarray(at + i1 + _about(zero, v1, q1, inner) - tool)

    def motors(self, point: Floats, a: float, c: float, travel: int) -> dict[str, float]:
        x, y, z = self.linear(point, (a, c), 0.0)
        meant = {"X": x, "Y": y, "Z": z, "A": a, "C": c}
        out = dict(meant)
        for axis, (nodes, values) in self.encoder.items():
            # A positive value moves the axis in the negative direction.
            out[axis] -= float(np.interp(meant[axis], nodes, values))
        for over, of, nodes, values in self.sag:
            out[of] -= self.cec_sign * float(np.interp(meant[over], nodes, values))
        for axis, width in self.backlash.items():
            out[axis] += travel * width / 2
        return out


def _about(point: Floats, direction: Floats, angle: float, at: Floats) -> Floats:
    """Turn right-handed about a line (Rodrigues); a direction of zero does not turn."""
    if not direction.any():
        return at
    q, r = np.radians(angle), at - point
    k = direction / np.linalg.norm(direction)
    turned = r * np.cos(q) + np.cross(k, r) * np.sin(q) + k * (k @ r) * (1 - np.cos(q))
    return np.asarray(point + turned)


def _encoder(text: str) -> tuple[dict[str, tuple[Floats, Floats]], dict[str, float]]:
    tables: dict[str, tuple[Floats, Floats]] = {}
    for axis in sorted(set(re.findall(r"\$AA_ENC_COMP\[0,\d+,(\w)1\]", text))):
        values = re.findall(rf"\$AA_ENC_COMP\[0,(\d+),{axis}1\]=(\S+)", text)
        assert [int(i) for i, _ in values] == list(range(len(values)))
        low, high, step = (
            float(re.findall(rf"\$AA_ENC_COMP_{key}\[0,{axis}1\]=(\S+)", text)[0])
            for key in ("MIN", "MAX", "STEP")
        )
        nodes = np.asarray(low + step * np.arange(len(values)), dtype=np.float64)
        assert nodes[-1] == high
        tables[axis] = nodes, np.array([float(v) for _, v in values])
    found = re.findall(r"\$MA_BACKLASH\[0,(\w)1\]=(\S+)", text)
    return tables, {axis: float(value) for axis, value in found}


def _sag(text: str) -> list[tuple[str, str, Floats, Floats]]:
    tables: list[tuple[str, str, Floats, Floats]] = []
    for t, over in re.findall(r"\$AN_CEC_INPUT_AXIS\[(\d+)\]=\((\w)1\)", text):
        values = [float(v) for v in re.findall(rf"\$AN_CEC\[{t},\d+\]=(\S+)", text)]
        (of,) = re.findall(rf"\$AN_CEC_OUTPUT_AXIS\[{t}\]=\((\w)1\)", text)
        low, step = (
            float(re.findall(rf"\$AN_CEC_{key}\[{t}\]=(\S+)", text)[0]) for key in ("MIN", "STEP")
        )
        nodes = np.asarray(low + step * np.arange(len(values)), dtype=np.float64)
        tables.append((over, of, nodes, np.array(values)))
    return tables


# --- Heidenhain


def kinematics_steps(text: str) -> list[tuple[str, float]]:
    """Steps of a kinematics table."""
    lines = [line for line in text.splitlines() if line[0] != "#"]
    return [(row["step"].split(None, 1)[1], float(row["new"])) for row in csv.DictReader(lines)]


def pose_of(steps: list[tuple[str, float]], chain_sign: int, angles: Mapping[str, float]) -> Floats:
    """Place of the end of a chain of steps in the frame of its beginning."""
    place = np.eye(4)
    for key, value in steps:
        if key.startswith("axis "):
            letter = key[5:]
            step = turn("xyz"["ABC".index(letter)], np.radians(value * angles[letter]))
        elif key in "XYZ":
            step = shift(*(value * np.eye(3)["XYZ".index(key)]))
        else:
            step = turn("xyz"["ABC".index(key)], np.radians(value))
        # From the table to the machine an axis undoes what it does from the machine to it.
        undone = chain_sign < 0 and key.startswith("axis ")
        place = place @ (np.linalg.inv(step) if undone else step)
    return np.asarray(place if chain_sign > 0 else np.linalg.inv(place), np.float64)


@dataclass
class Heidenhain:
    """A kinematics table of shifts and turns, *.COM tables that *.CMA assigns."""

    steps: list[tuple[str, float]]
    tables: list[tuple[str, str, Floats, Floats, Floats]]
    chain_sign: int
    com_sign: int

    @classmethod
    def read(cls, files: Mapping[str, str], chain_sign: int, com_sign: int) -> Heidenhain:
        rows = kinematics_steps(files["kinematics.csv"])
        tables = []
        if "config.cma" in files:
            head, line = files["config.cma"].splitlines()
            assert head.split()[-1] == "ACTIVE"
            assert line.split()[-1] == "*"
            names = zip(head.split()[1:-1], line.split()[1:-1], strict=True)
            for over, name in names:
                tables += _com(files[name], over)
        return cls(rows, tables, chain_sign, com_sign)

    def pose(self, a: float, c: float) -> Floats:
        return pose_of(self.steps, self.chain_sign, {"A": a, "C": c})

    def motors(self, point: Floats, a: float, c: float, travel: int) -> dict[str, float]:
        x, y, z = (self.pose(a, c) @ np.append(point, 1.0))[:3] + CENTRE
        meant = {"X": x, "Y": y, "Z": z, "A": a, "C": c}
        out = dict(meant)
        for over, of, nodes, forward, backward in self.tables:
            rows = {1: forward, -1: backward, 0: (forward + backward) / 2}[travel]
            out[of] -= self.com_sign * float(np.interp(meant[over], nodes, rows))
        return out


def _com(text: str, over: str) -> list[tuple[str, str, Floats, Floats, Floats]]:
    """Columns AXISPOS, an axis each, BACKLASH: values measured in the negative direction."""
    lines = text.splitlines()
    names = lines[0].split()
    rows = np.array([[float(v) for v in line.split()] for line in lines[1:]])
    columns = {name: rows[:, i] for i, name in enumerate(names)}
    back = columns.get("BACKLASH", columns.get(over, columns["AXISPOS"]))
    return [
        (over, of, columns["AXISPOS"], columns[of], columns[of] if of != over else back)
        for of in names
        if of in "XYZAC"
    ]


# --- ISG kernel


def isg_csv(text: str) -> dict[str, float]:
    """Read a block of location errors as the documentation of ISG_CSV shows it."""
    rows = [line.split() for line in text.splitlines() if not line.startswith("//")]
    return dict(zip(rows[0], map(float, rows[1]), strict=True))


def etalon(text: str) -> dict[str, float]:
    """Read parameters of the variant "Vendor": [NAME], VALUE = ..."""
    plain = "\n".join(line.partition("//")[0] for line in text.splitlines())
    found = re.findall(r"\[(\w+)\]\s*VALUE\s*=\s*(\S+)", plain)
    return {name: float(value) for name, value in found}


def chained(
    letters: str, points: Mapping[str, Floats], errors: Mapping[str, float], angles: Floats
) -> Floats:
    """Place of the end of axes that carry each other, errors in mm and rad by name ("X0C"), (4, 4).

    An axis of the chain is where its own errors put it, less those of the axes that carry it.
    """
    place, before = np.eye(4), np.zeros(3)
    carried: dict[str, float] = {}
    for letter, angle in zip(letters, angles, strict=True):
        i = "ABC".index(letter)
        origin = points[letter] * (np.arange(3) != i)
        own = {k: errors[f"{k}0{letter}"] for k in "XYZABC" if f"{k}0{letter}" in errors}
        e = dict.fromkeys("XYZABC", 0.0) | {k: v - carried.get(k, 0.0) for k, v in own.items()}
        carried |= own
        place = place @ shift(*(origin - before + [e[k] for k in "XYZ"]))
        for axis, key in zip("xyz", "ABC", strict=True):
            place = place @ turn(axis, e[key])
        place, before = place @ turn("xyz"[i], np.radians(angle)), origin
    return np.asarray(place @ shift(*-before))


@dataclass
class Isg:
    """Takes off the position error of the machine that it read, then the tables of its axes."""

    errors: dict[str, float]
    sign: int
    angle: float  # rad in a unit
    screws: TwinCat

    def motors(self, point: Floats, a: float, c: float, travel: int) -> dict[str, float]:
        given = {f"E{k}": self.sign * v for k, v in self.errors.items()}
        arcsec = self.angle / ARCSEC
        known = RealMachine({k: v * (1e3 if k[1] in "XYZ" else arcsec) for k, v in given.items()})
        square = [given.get(name, 0.0) * self.angle for name in ("EC0Y", "EB0Z", "EA0Z")]
        pose = known.pose(self.screws.sense_a * a, self.screws.sense_c * c)
        at = (pose @ np.append(point, 1.0))[:3]
        # C0Y turns the Y axis about Z, B0Z and A0Z the Z axis about Y and X, from the axis' zero.
        y, z = at[1] + square[2] * at[2], at[2]
        at += np.array([square[0] * y - square[1] * z, square[2] * z, 0.0])
        x, y, z = at + CENTRE
        return self.screws.sent({"X": x, "Y": y, "Z": z, "A": a, "C": c}, travel)
