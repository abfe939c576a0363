"""The mechanism: forward and inverse solution, sensitivities, over-constraint.

Set-up file, table ``[hybrid]``; every key has the default shown (a machine of the size of the
paper's, which prints no dimensions)::

    [hybrid]
    e1_mm = 0.0              # offsets between the u and v axes of legs 1, 2, 3
    e2_mm = 0.0
    e3_mm = 0.0
    e4_mm = 350.0            # base joint of leg 2 at (0, e4, 0)
    e8_mm = 600.0            # base joints of legs 1 and 3 at (-e8, 0, 0) and (e8, 0, 0)
    e9_mm = 200.0            # revolutes of legs 1 and 3 in the platform at x = -e9 and +e11
    e10_mm = 130.0           # revolute of leg 2 in the platform at (0, e10, e12)
    e11_mm = 200.0
    e12_mm = 0.0
    e13_mm = 200.0           # platform to q5 axis
    e14_mm = 0.0             # q4 axis to q5 axis
    e15_mm = 250.0           # q5 axis to tool point
    home_mm = [0, -350, -1400]   # a tool point in the middle of the working space: fixes the branch
    closure_mm = [1000, 1000, 1000, 1000]   # weights of the angle equations, see below
    [hybrid.errors]          # known beforehand, µm and arcsec, by name: e5_um, base3_y_um, ...

Errors: ``e1_um`` .. ``e15_um``, ``e16_arcsec``, ``e17_arcsec`` stand for the paper's 17. Its Fig.
1, which defines them, is not in the text at hand; the text fixes e5, e6, e7 and two angles (zero
offsets of the active joints L1, L2, L3, q4, q5; taken as e16, e17), the column of e2 at fixed
joints, and that e1's is zero. The meanings of e1, e3, e4 and e8 to e15 are a reconstruction. Any
other error is a component x, y, z (µm) or a, b, c (arcsec) of the displacement translate(x, y, z)
R(a, b, c) at a place: ``base1`` .. ``base3`` (joint on the base), ``cross1`` .. (between u and v
axis), ``leg1`` .. (before the telescopic travel), ``end1`` .. (after it), ``platform1`` ..
(revolute in the platform), ``wrist4`` (before q4), ``wrist5`` (before q5), ``tool``; thus
``base3_y_um``, ``wrist5_b_arcsec``.

Closure: the loops give ten equations for eight passive joints. The 17 satisfy all ten; other errors
strain the loops, and then the joints are found by least squares in which an angle misfit of the
revolutes counts as ``closure_mm`` times itself against the distance misfit in mm: against leg 1,
about leg 1, against leg 3, about leg 3. The paper's eight are ``closure_mm = [1000, 0, 1000, 0]``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from trunnion._core import Hybrid, hybrid_example
from trunnion.base.arguments import check_fields, checked
from trunnion.base.checks import array, choose, entry
from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.hybrid.parameters import JOINTS, PAPER_ERRORS, error_name
from trunnion.hybrid.results import (
    FORWARD_COLUMNS,
    ClosureDependence,
    Constraint,
    Forward,
    Sensitivity,
)
from trunnion.setup import Setup
from trunnion.setup.fields import Key, Number, Numbers, Section, Vector


def _dimension_keys() -> dict[str, int]:
    return {f"e{i + 1}_mm": i for i in range(15) if i not in (4, 5, 6)}


def joints_array(joints: ArrayLike, *, rows: int | None = None) -> Floats:
    """Return joints as (n, 5); one pose may be given as (5,)."""
    return array(f"joints ({', '.join(JOINTS)})", joints, 5, rows=rows)


def _for_each(what: str, value: ArrayLike, count: int) -> Floats:
    """Return points as (count, 3); one may be given for all."""
    points = array(what, value, 3)
    if len(points) not in (1, count):
        raise InputError(f"{what}: got shape {points.shape}, expected (3,) or ({count}, 3)")
    return np.ascontiguousarray(np.broadcast_to(points, (count, 3)))


Weights: TypeAlias = tuple[float, float, float, float]
MIN_SQUARES: Weights = (1000.0, 1000.0, 1000.0, 1000.0)

#: Closures that :meth:`Mechanism.closure_dependence` compares, by weights in mm.
CLOSURES: Mapping[str, Weights] = MappingProxyType(
    {
        "least squares": MIN_SQUARES,
        "paper's eight: about legs 1, 3 dropped": (1000.0, 0.0, 1000.0, 0.0),
        "about leg 1, against leg 3 dropped": (1000.0, 0.0, 0.0, 1000.0),
        "against leg 1, about leg 3 dropped": (0.0, 1000.0, 1000.0, 0.0),
        "against legs 1, 3 dropped": (0.0, 1000.0, 0.0, 1000.0),
    }
)


@dataclass(frozen=True)
class Mechanism:
    """A hybrid machine: dimensions, errors, closure. Immutable; see the module for the meanings.

    Attributes
    ----------
    dimensions
        Nominal e1 to e15 (mm) by the keys of the set-up file, where they differ from the example.
    errors
        Added to the dimensions, µm and arcsec by name.
    home_mm
        A tool point in the middle of the working space, tool vertical.
    closure_mm
        Weights of the angle equations against the distance equations: against and about leg 1,
        against and about leg 3.

    Raises
    ------
    UnknownNameError, InputError, KinematicsError
        Unknown names, values that are not finite, or a home point where the loops do not close.
    """

    dimensions: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    home_mm: tuple[float, float, float] = (0.0, -350.0, -1400.0)
    closure_mm: Weights = MIN_SQUARES

    def __post_init__(self) -> None:
        """Check by building the core's object."""
        check_fields(self)
        keys = _dimension_keys()
        for name in self.dimensions:
            choose("dimension", name, keys)
        named = {}
        for name, value in self.errors.items():
            with entry("errors", name):
                named[error_name(name)] = float(value)
        object.__setattr__(self, "errors", MappingProxyType(named))
        object.__setattr__(self, "dimensions", MappingProxyType(dict(self.dimensions)))
        object.__setattr__(self, "home_mm", tuple(map(float, self.home_mm)))
        object.__setattr__(self, "closure_mm", tuple(map(float, self.closure_mm)))
        _ = self._core

    def __reduce__(self) -> tuple[Any, ...]:
        given = (dict(self.dimensions), dict(self.errors), self.home_mm, self.closure_mm)
        return Mechanism, given

    def __hash__(self) -> int:
        return hash((*sorted(self.dimensions.items()), *sorted(self.errors.items()), self.home_mm))

    @cached_property
    def _core(self) -> Hybrid:
        values = hybrid_example()
        for name, index in _dimension_keys().items():
            values[index] = float(self.dimensions.get(name, values[index]))
        return Hybrid(values, list(self.home_mm), list(self.errors.items()), list(self.closure_mm))

    @classmethod
    @checked
    def from_setup(cls, setup: Setup) -> Mechanism:
        """Read the table ``[hybrid]`` of a set-up.

        Raises
        ------
        FileFormatError, InputError
            A key that is none of those in the module's docstring, or a value of the wrong kind;
            with its place in the file of the set-up.
        """
        section = Section.of("hybrid", setup.hybrid)
        dimensions = {name: Key(Number(), "dimension", None) for name in _dimension_keys()}
        values = section.read({**dimensions, **_KEYS})
        given = {name: values.pop(name) for name in dimensions if name in values}
        with section.placed():
            return cls(dimensions=given, **values)

    @checked
    def with_errors(self, errors: Mapping[str, float]) -> Mechanism:
        """Return the same machine with these errors (µm, arcsec) instead of its own."""
        return replace(self, errors=dict(errors))

    @property
    def nominal(self) -> Mechanism:
        """The same machine without errors."""
        return self.with_errors({})

    @property
    def home_legs_mm(self) -> tuple[float, float, float]:
        """Nominal leg lengths at home."""
        first, second, third = self._core.home_legs_mm
        return (first, second, third)

    @checked
    def forward(self, joints: ArrayLike, *, threads: int | None = 1) -> Forward:
        """Solve the loops: G(Y, E) = 0, then the way to the tool through leg 2.

        Parameters
        ----------
        joints
            L1, L2, L3 (mm), q4, q5 (deg), (n, 5) or (5,).
        threads
            How many; None: all cores.

        Raises
        ------
        KinematicsError
            Out of reach, on another branch, or singular; the message names the row.
        InputError
            Another shape, or values that are not finite.
        """
        poses = joints_array(joints)
        return Forward.of_rows(poses, self._core.forward(poses, threads))

    @checked
    def sensitivity(
        self,
        joints: ArrayLike,
        parameters: Sequence[str] = PAPER_ERRORS,
        *,
        threads: int | None = 1,
    ) -> Sensitivity:
        """Differentiate the closed loops by errors: dY/dE, serial part, dr/dE, turn of the tool.

        Exact where the loops close. Where errors outside the 17 strain them by ρ, a term of
        relative size ρ / leg length (1e-5 for 10 µm) is left out.

        Parameters
        ----------
        joints
            L1, L2, L3 (mm), q4, q5 (deg), (n, 5) or (5,).
        parameters
            Names of errors; the 17 by default.
        threads
            How many; None: all cores.
        """
        poses = joints_array(joints)
        names = tuple(error_name(p) for p in parameters)
        rows = self._core.sensitivity(poses, list(names), threads)
        rates = rows[:, FORWARD_COLUMNS:].reshape(len(poses), 20, len(names))
        return Sensitivity(
            parameters=names,
            forward=Forward.of_rows(poses, rows[:, :FORWARD_COLUMNS]),
            tip=rates[:, 0:3],
            turn=rates[:, 3:6],
            serial_tip=rates[:, 6:9],
            serial_turn=rates[:, 9:12],
            passive=rates[:, 12:20],
        )

    @checked
    def inverse(
        self,
        tip_mm: ArrayLike,
        direction: ArrayLike = (0.0, 0.0, -1.0),
        *,
        wrist: int = 1,
        reference_deg: float = 0.0,
        threads: int | None = 1,
    ) -> Floats:
        """Find the joints for tool points: closed form, or Newton where the machine has errors.

        Parameters
        ----------
        tip_mm
            Tool points, (n, 3) or (3,).
        direction
            Unit vectors from the spindle to the tool point, (n, 3) or one for all.
        wrist
            +1 for the branch with q5 ≥ 0, -1 for the other.
        reference_deg
            q4 where the tool lies on its axis (q5 = 0) and it is free.
        threads
            How many; None: all cores.

        Returns
        -------
        ndarray, shape (n, 5)
            L1, L2, L3 (mm), q4, q5 (deg).
        """
        if wrist not in (1, -1):
            raise InputError(f"wrist branch: got {wrist!r}, expected 1 or -1")
        tips = array("tip_mm", tip_mm, 3)
        offsets = any(self.dimensions.get(f"e{i}_mm", 0.0) for i in (1, 2, 3, 14))
        rows = self._core.inverse(
            tips,
            _for_each("direction", direction, len(tips)),
            reference_deg=reference_deg,
            negative=wrist < 0,
            exact=bool(self.errors) or offsets,
            threads=threads,
        )
        return rows[:, :5]

    @checked
    def constraint(self, joints: ArrayLike) -> Constraint:
        """Rank, mobility and self-stress of the loops at one pose, (5,)."""
        pose = joints_array(joints, rows=1)[0]
        rank, values, stress, jacobian = self._core.constraint(list(pose))
        return Constraint(
            rank=rank,
            mobility=13 - rank,
            singular_values=np.asarray(values),
            self_stress=stress.reshape(-1, 2, 6),
            jacobian=jacobian,
        )

    @checked
    def strain(
        self, joints: ArrayLike, parameters: Sequence[str], *, threads: int | None = 1
    ) -> Floats:
        """First-order misfit that errors leave in the loops, per unit, (n, 2, 5, k).

        For the loops of legs 1 and 3: gap x, y, z (µm), misfit against and about the leg (arcsec).
        Zero for the 17.
        """
        poses = joints_array(joints)
        names = [error_name(p) for p in parameters]
        rows = self._core.strain(poses, names, threads)
        return rows.reshape(len(poses), 2, 5, len(names))

    @checked
    def closure_dependence(
        self,
        joints: ArrayLike,
        errors: Mapping[str, float],
        closures: Mapping[str, Weights] = CLOSURES,
    ) -> ClosureDependence:
        """Compare the answer under several closures at one pose.

        Parameters
        ----------
        joints
            (5,): L1, L2, L3 (mm), q4, q5 (deg).
        errors
            Added to the machine's own, µm and arcsec.
        closures
            Name and weights (mm) of each.
        """
        pose = joints_array(joints, rows=1)[0]
        named = {error_name(name): float(value) for name, value in errors.items()}
        total = dict(self.errors)
        for name, value in named.items():
            total[name] = total.get(name, 0.0) + value
        moved, solved = [], []
        for weights in closures.values():
            plain = replace(self, closure_mm=weights)
            before = plain.forward(pose)
            after = plain.with_errors(total).forward(pose)
            moved.append((after.tip_mm[0] - before.tip_mm[0]) * 1e3)
            solved.append(after)
        tips = np.array(moved)
        spread = max((float(np.linalg.norm(a - b)) for a in tips for b in tips), default=0.0)
        return ClosureDependence(
            errors=named,
            closures=tuple(closures),
            tip_um=tips,
            misfit_arcsec=np.array([f.misfit_arcsec[0] for f in solved]),
            gap_um=np.array([f.gap_um[0] for f in solved]),
            spread_um=spread,
        )

    @checked
    def ballbar(
        self,
        joints: ArrayLike,
        centres_mm: ArrayLike,
        parameters: Sequence[str] = PAPER_ERRORS,
        *,
        threads: int | None = 1,
    ) -> tuple[Floats, Floats, Floats]:
        """What a ball-bar reads between a ball at rest and the tool point.

        Parameters
        ----------
        joints, centres_mm
            (n, 5) and the ball's centre, (n, 3) or one for all.
        parameters
            Errors to differentiate by.

        Returns
        -------
        length_mm : ndarray, shape (n,)
        direction : ndarray, shape (n, 3)
            Unit vector from the ball to the tool point; the gradient by the centre is its negative.
        gradient : ndarray, shape (n, k)
            µm per unit of each parameter.
        """
        poses = joints_array(joints)
        centres = _for_each("centres_mm", centres_mm, len(poses))
        names = [error_name(p) for p in parameters]
        rows = self._core.ballbar(poses, centres, names, threads)
        return rows[:, 0], rows[:, 1:4], rows[:, 4:]


_KEYS = {
    "home_mm": Key(Vector(3), "tool point at home", None),
    "closure_mm": Key(Vector(4), "weights of the closure", None),
    "errors": Key(Numbers(), "known errors, µm and arcsec", None),
}
