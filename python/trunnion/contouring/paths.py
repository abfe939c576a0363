"""Paths: where the tool tip and the tool axis should be, in the part's frame.

A path is a chain of pieces over one parameter u; in each, with s = u - start,

    (x, y, z, ox, oy, oz) = sum_i coefficients[i] s^i + cosine cos(omega s) + sine sin(omega s).

Lengths in mm. The tool direction (ox, oy, oz) need not be of unit length.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline

import trunnion.nc as nc
from trunnion._core import ContourPath
from trunnion.base.arguments import check_fields, checked
from trunnion.base.checks import array, line, positive
from trunnion.base.errors import InputError, ProgramError
from trunnion.base.units import Floats


@dataclass(frozen=True, eq=False)
class Path:
    """A path in the part's frame; see the module for the formula.

    Make one with `Path.paper`, `Path.polynomial`, `Path.spline`, `Path.lines`, `Path.circle` or
    `Path.from_program`.

    Attributes
    ----------
    breaks:
        Parameter u at the start of each piece and at the end of the last, shape (n + 1,).
    coefficients:
        Shape (n, degree + 1, 6), ascending powers of s.
    omega:
        Angular frequency of the harmonic part of each piece, rad per unit of u, shape (n,).
    cosine, sine:
        Its amplitudes, shape (n, 6).
    """

    breaks: Floats
    coefficients: Floats
    omega: Floats
    cosine: Floats
    sine: Floats

    def __post_init__(self) -> None:
        """Check by building the core's path."""
        check_fields(self)
        for name in ("breaks", "coefficients", "omega", "cosine", "sine"):
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if self.coefficients.ndim != 3 or self.coefficients.shape[2] != 6:
            raise InputError(
                f"path coefficients: got shape {self.coefficients.shape}, "
                "expected (pieces, degree + 1, 6)"
            )
        _ = self.core

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the arrays only."""
        return {k: v for k, v in self.__dict__.items() if k != "core"}

    @cached_property
    def core(self) -> ContourPath:
        """The core's path."""
        flat = self.coefficients.reshape(-1, 6)
        return ContourPath(self.breaks, flat, self.omega, self.cosine, self.sine)

    # --- makers

    @classmethod
    @checked
    def polynomial(cls, coefficients: ArrayLike, *, end: float = 1.0) -> "Path":
        """One polynomial of u from 0 to ``end``; coefficients of shape (degree + 1, 6)."""
        c = np.asarray(coefficients, dtype=np.float64)
        return cls._of(np.array([0.0, end]), c[None])

    @classmethod
    def _of(cls, breaks: Floats, coefficients: Floats) -> "Path":
        n = len(breaks) - 1
        return cls(breaks, coefficients, np.zeros(n), np.zeros((n, 6)), np.zeros((n, 6)))

    @classmethod
    @checked
    def paper(cls, *, offset_mm: Sequence[float] = (0.0, 0.0, 0.0)) -> "Path":
        """Eq. (8) of Byun and Jee 2010, with the tool normal to the surface it lies on.

        The path lies on z = 15 - x²/15 - y²/1000, whose normal is (2u, 0.16 (u³ - u), 1) along it.
        The paper says only "perpendicular to the path"; the principal normal of the curve would
        tilt A to 133 deg. ``offset_mm`` is the path's place on the table, which is not published.
        """
        c = np.zeros((7, 6))
        c[0, 2], c[0, 5] = 15.0, 1.0
        c[1] = 15.0, -80.0, 0.0, 2.0, -0.16, 0.0
        c[2, 2] = -21.4
        c[3, 1], c[3, 4] = 80.0, 0.16
        c[4, 2] = 12.8
        c[6, 2] = -6.4
        return cls.polynomial(c).shifted(offset_mm)

    @classmethod
    @checked
    def spline(cls, points_mm: ArrayLike, tools: ArrayLike, *, degree: int = 3) -> "Path":
        """Interpolating B-spline through points, shape (n, 3), with tool directions, shape (n, 3).

        The parameter is the chord length divided by the whole. Tool directions are brought to unit
        length first.
        """
        p, w = _points(points_mm, tools)
        if not 1 <= degree <= 9 or degree % 2 == 0:
            raise InputError(f"spline degree: got {degree}, expected an odd number from 1 to 9")
        if len(p) <= degree:
            raise InputError(f"spline: got {len(p)} points, expected more than the degree {degree}")
        u = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))]
        u /= u[-1]
        spline = make_interp_spline(u, np.c_[p, w], k=degree)
        breaks = np.unique(spline.t)
        # Taylor coefficients at the start of each piece.
        terms = [spline(breaks[:-1], nu=i) / factorial(i) for i in range(degree + 1)]
        return cls._of(breaks, np.stack(terms, axis=1))

    @classmethod
    @checked
    def lines(cls, points_mm: ArrayLike, tools: ArrayLike) -> "Path":
        """Straight lines between points, shape (n, 3), the tool turning in a plane between them.

        u is the number of the line plus the share of it.
        """
        p, w = _points(points_mm, tools)
        start, step = np.c_[p, w][:-1], np.diff(np.c_[p, w], axis=0)
        return cls._of(np.arange(len(p), dtype=np.float64), np.stack([start, step], axis=1))

    @classmethod
    @checked
    def circle(
        cls,
        radius_mm: float,
        *,
        turn_deg: float = 360.0,
        tilt_deg: float = 0.0,
        centre_mm: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> "Path":
        """Counter-clockwise arc in a plane z = const., tool tilted outwards by ``tilt_deg``.

        Without tilt the tool stays vertical. With a tilt and the centre on the C axis the machine
        turns C alone. u is the angle in rad.
        """
        positive("radius_mm", radius_mm)
        tilt = np.deg2rad(tilt_deg)
        constant = np.array([*centre_mm, 0.0, 0.0, np.cos(tilt)], dtype=np.float64)
        cosine = np.array([radius_mm, 0.0, 0.0, np.sin(tilt), 0.0, 0.0])
        sine = np.array([0.0, radius_mm, 0.0, 0.0, np.sin(tilt), 0.0])
        breaks = np.array([0.0, np.deg2rad(turn_deg)])
        return cls(breaks, constant[None, None], np.ones(1), cosine[None], sine[None])

    @classmethod
    @checked
    def from_program(cls, program: "nc.Program | str", *, dialect: str = "linuxcnc") -> "Path":
        """Feed moves of a part program: straight lines and arcs in work coordinates.

        X, Y, Z are the tool tip in the part's frame, A and C the rotary positions at the ends of
        each block (a program for tool-centre-point control); between them the tool turns in a
        plane. Rapid moves at the beginning give the start; a rapid move between feed moves is an
        error, because the path would have a gap.
        """
        if isinstance(program, str):
            program = nc.Program.parse(program, dialect)
        moves = nc.follow(program)
        feed = np.flatnonzero(np.isin(moves.code, (1, 2, 3)))
        long = np.linalg.norm((moves.end - moves.start)[feed, :3], axis=1) > 0
        feed = feed[long | (moves.code[feed] != 1)]
        if len(feed) == 0:
            raise ProgramError("program: no feed move (G1, G2, G3) of the tool tip to follow")
        pieces = [_piece(moves, int(i)) for i in feed]
        gap = [
            int(moves.line[j])
            for i, j in pairwise(feed)
            if np.abs(moves.end[i] - moves.start[j]).max() > 1e-6
        ]
        if gap:
            raise ProgramError(
                f"line {gap[0]}: the path has a gap here (a rapid move, or a turn on the spot); "
                "expected feed moves that follow each other"
            )
        coefficients, omega, cosine, sine = (np.array(x) for x in zip(*pieces, strict=True))
        breaks = np.arange(len(feed) + 1, dtype=np.float64)
        return cls(breaks, coefficients, omega, cosine, sine)

    # --- questions

    @checked
    def shifted(self, offset_mm: Sequence[float]) -> "Path":
        """Return the same path elsewhere on the table."""
        moved = self.coefficients.copy()
        moved[:, 0, :3] += array("offset_mm", np.asarray(offset_mm), 3, rows=1)
        return replace(self, coefficients=moved)

    @property
    def length_mm(self) -> float:
        """Arc length."""
        return self.core.length_mm

    @checked
    def points_mm(self, u: ArrayLike) -> Floats:
        """Tool tip at u, shape (n, 3)."""
        return self.core.frames(line("u", u))[0]

    @checked
    def tools(self, u: ArrayLike) -> Floats:
        """Unit tool axis at u, shape (n, 3)."""
        return self.core.frames(line("u", u))[1]

    @checked
    def curvature_per_mm(self, u: ArrayLike) -> Floats:
        """Curvature at u, shape (n,)."""
        return self.core.frames(line("u", u))[2]

    @checked
    def at_length(self, s_mm: ArrayLike) -> Floats:
        """Parameter u at arc lengths from the start, shape (n,)."""
        return self.core.at_length(line("s_mm", s_mm))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Path):
            return NotImplemented
        names = ("breaks", "coefficients", "omega", "cosine", "sine")
        return all(np.array_equal(getattr(self, n), getattr(other, n)) for n in names)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Path({len(self.omega)} pieces, {self.length_mm:.6g} mm)"


def _points(points_mm: ArrayLike, tools: ArrayLike) -> tuple[Floats, Floats]:
    p, w = array("path points", points_mm, 3), array("tool directions", tools, 3)
    if len(p) < 2 or len(w) not in (1, len(p)):
        raise InputError(
            f"path: got {len(p)} points and {len(w)} tool directions, expected at least two points "
            "and one direction, or one for each"
        )
    w = np.broadcast_to(w, p.shape)
    length = np.linalg.norm(w, axis=1, keepdims=True)
    if not (length > 0).all():
        raise InputError("tool directions: got one of length 0, expected none")
    repeated = np.flatnonzero(np.linalg.norm(np.diff(p, axis=0), axis=1) == 0.0)
    if len(repeated):
        raise InputError(f"path point {repeated[0] + 1}: the same as the one before; drop it")
    return p, w / length


def _tool(a_deg: float, c_deg: float) -> Floats:
    """Tool axis in the part's frame for rotary positions of the nominal machine."""
    a, c = np.deg2rad([a_deg, c_deg])
    return np.array([np.sin(a) * np.sin(c), np.sin(a) * np.cos(c), np.cos(a)])


def _piece(moves: "nc.Moves", i: int) -> tuple[Floats, float, Floats, Floats]:
    """Coefficients (2, 6), omega, cosine, sine of one move over a unit of u."""
    start, end = moves.start[i], moves.end[i]
    w0, w1 = _tool(start[3], start[5]), _tool(end[3], end[5])
    lines = np.zeros((2, 6))
    lines[0], lines[1] = np.r_[start[:3], w0], np.r_[end[:3] - start[:3], w1 - w0]
    cosine, sine = np.zeros(6), np.zeros(6)
    code = int(moves.code[i])
    if code == 1:
        return lines, 0.0, cosine, sine
    # Arc: first and second coordinate of the plane right-handed about its normal.
    first, second = {17: (0, 1), 18: (2, 0), 19: (1, 2)}[int(moves.plane[i])]
    centre = moves.centre_mm[i]
    radius0 = np.array([start[first] - centre[0], start[second] - centre[1]])
    radius1 = np.array([end[first] - centre[0], end[second] - centre[1]])
    angle = np.arctan2(*radius1[::-1]) - np.arctan2(*radius0[::-1])
    sign = 1.0 if code == 3 else -1.0
    angle = sign * (sign * angle % (2 * np.pi) or 2 * np.pi)
    lines[0, first], lines[0, second] = centre
    lines[1, [first, second]] = 0.0
    cosine[[first, second]] = radius0
    sine[[first, second]] = -radius0[1], radius0[0]
    return lines, float(angle), cosine, sine
