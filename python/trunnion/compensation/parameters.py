"""Compensation by parameters of the control: zeros and centres of the rotary axes, work offsets.

A control's kinematic transformation has a zero for each rotary axis, a centre for each and the
origin of the work. It has no parameter for the direction of an axis, so tilts of the axis average
lines other than about the axis itself stay. :func:`cnc_parameters` finds the parameters that leave
the least over a range of poses, and says what they can remove and what they cannot.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import trunnion._core as _core
from trunnion.base.arguments import checked
from trunnion.base.checks import choose
from trunnion.base.errors import InputError
from trunnion.base.report import Cell, Result, Shown, Table, left_text
from trunnion.base.units import Floats
from trunnion.compensation.control import round_to
from trunnion.compensation.machine import NOMINAL, Effects, Known, MachineErrors
from trunnion.compensation.workspace import Workspace, pose_grid
from trunnion.machine.chain import Chain
from trunnion.setup import Setup
from trunnion.setup.names import called

GROUPS = ("zeros", "centres", "work")
_ROUNDS = 8
MIN_LEFT = 0.005  # share of an error that is said to be left


@dataclass(frozen=True, eq=False, repr=False)
class Removable(Result):
    """What the best parameters leave of one error, over the poses and the box asked for.

    Attributes
    ----------
    name, unit
        The location error or "effect.parameter".
    before_um
        Rms volumetric error of one unit of it (µm, arcsec) without compensation.
    left_um
        The same with the parameters that remove most of it.
    """

    name: str
    unit: str
    before_um: float
    left_um: float

    @property
    def share_left(self) -> float:
        """`left_um` / `before_um`: 0 is removed, 1 untouched."""
        return self.left_um / self.before_um if self.before_um > 0 else 0.0

    def sentences(self) -> Sequence[str]:
        """How much of it the parameters leave."""
        return (
            f"{self.name}: {100 * self.share_left:.1f} % is left, {self.left_um:.3g} of "
            f"{self.before_um:.3g} µm rms per {_unit(self.unit)}.",
        )

    def tables(self) -> tuple[Table, ...]:
        """One row: before, left, share."""
        return (_removable_table((self,)),)

    def derived(self) -> Mapping[str, Any]:
        """Share that is left."""
        return {"share_left": self.share_left}


def _signed(value: float) -> str:
    """Return a number with its sign, as it is keyed in."""
    return f"{value:+.3f}".replace("-", "−")


def _unit(suffix: str) -> str:
    """Return the unit that ends a name as people write it."""
    return suffix.replace("um", "µm")


def _removable_table(listed: Sequence[Removable]) -> Table:
    rows = [
        (
            row.name,
            _unit(row.unit),
            row.before_um,
            row.left_um,
            Shown(row.share_left, f"{100 * row.share_left:.1f} %"),
        )
        for row in listed
    ]
    title = "Volumetric error that 1 µm or 1 arcsec of each error makes, rms, µm"
    return Table.of(title, ("", "unit", "without", "with parameters", "left"), rows, digits=3)


@dataclass(frozen=True, eq=False, repr=False)
class CncParameters(Result):
    """Parameters of a control.

    Attributes
    ----------
    zeros_arcsec
        Letter → what is added to the commanded position of the axis; control's sign.
    centres_um
        Centres of the rotary axes in the control's transformation, under the names of the location
        errors that they are set to (EY0A, EZ0A, EX0C, EY0C).
    work
        Placement of the work that the control reckons with (`dx_um` ... `rc_arcsec`).
    removable
        What such parameters can remove of each error; empty where it was not asked for.
    before_um, left_um
        Volumetric error over box and poses, rms, without and with them; None where it was not
        asked for.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> found = tn.cnc_parameters(setup, {"EX0C": 15.0})
    >>> found.to_dataframe().shape
    (6, 3)
    """

    zeros_arcsec: Mapping[str, float] = field(default_factory=dict)
    centres_um: Mapping[str, float] = field(default_factory=dict)
    work: Mapping[str, float] = field(default_factory=dict)
    removable: tuple[Removable, ...] = ()
    before_um: float | None = None
    left_um: float | None = None

    def title(self) -> str:
        """Name the result."""
        return "Compensation by parameters of the control"

    def control_model(self, setup: Setup) -> tuple[_core.MachineModel, list[float]]:
        """Return the machine that the control reckons with, and its zeros."""
        core = MachineErrors(errors=self.centres_um, placement=self.work).core(setup)
        chain = Chain(setup)
        for letter in self.zeros_arcsec:
            choose("zeros_arcsec", letter, chain.letters)
        zeros = chain.to_machine({k: self.zeros_arcsec.get(k, 0.0) for k in chain.letters})[0]
        return core, zeros.tolist()

    @checked
    def commands(self, setup: Setup, points_mm: Floats, rotary_deg: Floats) -> Floats:
        """X, Y, Z by the control's transformation, rotary axes with their zeros added."""
        core, zeros = self.control_model(setup)
        linear = core.linear_commands(points_mm, rotary_deg, None)
        return np.hstack([linear, rotary_deg + np.array(zeros) / 3600.0])

    @checked
    def rounded(self, setup: Setup) -> CncParameters:
        """Return the parameters at the resolution of the set-up, as they are keyed in."""
        linear, rotary = setup.resolution.linear_um, setup.resolution.rotary_arcsec

        def each(values: Mapping[str, float], steps: Mapping[str, float]) -> dict[str, float]:
            return {
                k: float(round_to(np.array(v), steps.get(k.rsplit("_", 1)[-1], linear)))
                for k, v in values.items()
            }

        zeros = {k: float(round_to(np.array(v), rotary)) for k, v in self.zeros_arcsec.items()}
        steps = {"um": linear, "arcsec": rotary}
        return replace(
            self,
            zeros_arcsec=zeros,
            centres_um=each(self.centres_um, {}),
            work=each(self.work, steps),
        )

    def settings(self) -> list[tuple[str, float, str]]:
        """Label, value and unit of each parameter."""
        rows = [(f"zero of {name}", value, "arcsec") for name, value in self.zeros_arcsec.items()]
        rows += [
            (f"centre of {name[3:]} along {name[1]} ({name})", value, "µm")
            for name, value in self.centres_um.items()
        ]
        for name, value in self.work.items():
            label, suffix = name.rsplit("_", 1)
            rows.append((f"work {label}", value, _unit(suffix)))
        return rows

    def sentences(self) -> Sequence[str]:
        """What they are good for, what to set, and the error of which most is left."""
        listed = ", ".join(
            f"{label} {_signed(value)} {unit}" for label, value, unit in self.settings()
        )
        lines = [f"To set in the control: {listed or 'nothing'}."]
        if self.before_um is not None and self.left_um is not None:
            lines.insert(
                0,
                f"Volumetric error over the work space, rms: {self.before_um:.3g} µm before, "
                f"{left_text(self.left_um)} µm with these parameters.",
            )
        return [*lines, *filter(None, (self.held_in_words(),))]

    def held_in_words(self, names: Container[str] | None = None) -> str:
        """Say of which errors (of these names) something is left; empty where of none."""
        ranked = sorted(self.removable, key=lambda row: -row.share_left)
        parts = [
            f"{called(row.name)}, {100 * row.share_left:.0f} %"
            for row in ranked
            if row.share_left > MIN_LEFT and (names is None or row.name in names)
        ]
        if not parts:
            return ""
        return (
            f"No parameter holds these errors whole, so much of their effect stays: "
            f"{'; '.join(parts)}. An error map, or kinematics that know them, remove them."
        )

    def tables(self) -> tuple[Table, ...]:
        """What to set, and what is left of each error where it was asked for."""
        rows: list[tuple[Cell, ...]] = [
            (label, Shown(value, _signed(value)), unit) for label, value, unit in self.settings()
        ]
        to_set = Table.of("CNC parameters, added to the old values", ("", "change", "unit"), rows)
        return (to_set, _removable_table(self.removable)) if self.removable else (to_set,)


@checked
def cnc_parameters(
    setup: Setup,
    errors: Known,
    effects: Effects = None,
    x_mm: ArrayLike = (-150, 150),
    y_mm: ArrayLike = (-120, 120),
    z_mm: ArrayLike = (0, 150),
    a_deg: ArrayLike = tuple(range(-90, 91, 15)),
    c_deg: ArrayLike = tuple(range(0, 360, 15)),
    *,
    b_deg: ArrayLike = tuple(range(-90, 91, 15)),
    placement: Mapping[str, float] | None = None,
    groups: Sequence[str] = ("zeros", "centres"),
    method: str = "least-squares",
) -> CncParameters:
    """Parameters of the control for a machine as identified.

    Parameters
    ----------
    setup, errors, effects, placement
        The machine as identified: errors by name, or a result; placement of the work.
    x_mm, y_mm, z_mm, a_deg, b_deg, c_deg
        Box of the work (low, high) and rotary positions at which little is to be left. The mean
        square over the solid box is taken in closed form.
    groups
        What may be set: "zeros" of the axes, "centres" of the axes, origin of the "work".
    method
        "least-squares": least mean square of the volumetric error over box and poses, exact model
        and derivatives, least norm where parameters stand for one another (as at a single pose).
        "direct": zero of each axis against its own location error (EA0A, EC0A), centres to the
        identified offsets, work to the placement. It stays small whatever the errors, at A = 0 too.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(artefact=tn.Artefact("cross"))
    >>> found = tn.cnc_parameters(setup, {"EA0A": 20.0, "EX0C": 15.0}, method="direct")
    >>> found.zeros_arcsec["A"], found.centres_um["EX0C"]
    (-20.0, 15.0)
    """
    for group in groups:
        choose("groups", group, GROUPS)
    known = MachineErrors.to_compensate(setup, errors, effects, placement)
    known.refuse_own("parameters of a control cannot follow it")
    if method == "direct":
        return _direct(setup, known, groups)
    if method != "least-squares":
        raise InputError(f'method: got {method!r}, expected "least-squares" or "direct"')
    return _Fit(setup, known, Workspace(x_mm, y_mm, z_mm, a_deg, c_deg, b_deg), groups).solve()


def _direct(setup: Setup, known: MachineErrors, groups: Sequence[str]) -> CncParameters:
    names = known.core(setup).control_parameters
    chain = Chain(setup)
    zeros, centres, work = {}, {}, {}
    if "zeros" in groups:
        # A zero can stand against a location error that does the same at zero of all axes: EA0A
        # against A, EC0A against C on a trt-ca.
        nominal, none = NOMINAL.core(setup), [0.0] * chain.count
        pose = np.zeros((1, chain.count))
        errors = nominal.truth_rates(nominal, none, pose).reshape(-1, 12)
        turns = nominal.control_rates(nominal, none, pose).reshape(-1, 12)[: chain.count]
        against = np.zeros(chain.count)
        for axis, (letter, turn) in enumerate(zip(chain.letters, turns, strict=True)):
            for (name, _), column in zip(nominal.parameters, errors, strict=True):
                ratio = (column @ turn) / (turn @ turn) if turn.any() else 0.0
                if ratio != 0.0 and np.abs(column - ratio * turn).max() < 1e-9:
                    against[axis] -= ratio * known.errors.get(name, 0.0)
            if letter == "C":
                against[axis] -= known.placement.get("rc_arcsec", 0.0)
        zeros = {letter: float(zero) for letter, zero in chain.to_control(against).items()}
    if "centres" in groups:
        centres = {k: v for k, v in known.errors.items() if k in names}
    if "work" in groups:
        work = {k: v for k, v in known.placement.items() if k.endswith("_um")}
    return CncParameters(zeros, centres, work)


class _Fit:
    """Least squares of the parameters over box and poses."""

    def __init__(
        self,
        setup: Setup,
        known: MachineErrors,
        where: Workspace,
        groups: Sequence[str],
    ) -> None:
        self.setup = setup
        self.chain = Chain(setup)
        self.truth = known.core(setup)
        self.poses = pose_grid(setup, where.rotary(setup, spare=True)[0])
        ends = where.ends()
        self.middle = np.array([0.5 * (e[0] + e[-1]) for e in ends])
        # Standard deviation of a coordinate over the solid box: a mean square over the box is
        # |M m + t|² + Σ |M_j|² σ_j², so these twelve numbers a pose are the residuals.
        self.spread = np.array([(e[-1] - e[0]) / np.sqrt(12.0) for e in ends])
        names = self.truth.control_parameters
        kinds = ["zeros"] * self.chain.count
        others = names[self.chain.count :]
        kinds += ["work" if name in ("dx", "dy", "dz") else "centres" for name in others]
        self.names = names
        self.used = [i for i, kind in enumerate(kinds) if kind in groups]

    def residuals(self, fields: Floats) -> Floats:
        """Fields (m, 12, ...) as residuals (12 m, ...) whose sum of squares is the mean square."""
        field = fields.reshape(len(self.poses), 3, 4, -1)
        centre = np.einsum("mijk,j->mik", field[:, :, :3], self.middle) + field[:, :, 3]
        spread = field[:, :, :3] * self.spread[None, None, :, None]
        parts = np.concatenate([centre[:, :, None], spread], axis=2)
        flat: Floats = parts.reshape(12 * len(self.poses), -1) / np.sqrt(len(self.poses))
        return flat

    def rates(self, flat: Floats, count: int) -> Floats:
        """Derivatives (m, 12 count) as columns of residuals."""
        return self.residuals(np.moveaxis(flat.reshape(len(self.poses), count, 12), 1, 2))

    def parameters(self, values: Floats) -> CncParameters:
        named = {self.names[i]: float(values[i]) for i in self.used}
        zeros = {}
        if any(f"zero_{k}" in named for k in self.chain.letters):
            found = np.array([named.pop(f"zero_{k}") for k in self.chain.letters])
            zeros = {k: float(v) for k, v in self.chain.to_control(found).items()}
        work = {f"{k}_um": named.pop(k) for k in ("dx", "dy", "dz") if k in named}
        return CncParameters(zeros, named, work)

    def solve(self) -> CncParameters:
        values, before = np.zeros(len(self.names)), None
        for _ in range(_ROUNDS):
            assumed, zeros = self.parameters(values).control_model(self.setup)
            left = self.residuals(self.truth.fields(assumed, zeros, self.poses)[0])[:, 0]
            size = float(np.linalg.norm(left))
            before = size if before is None else before
            rates = self.truth.control_rates(assumed, zeros, self.poses)
            columns = self.rates(rates, len(self.names))[:, self.used]
            if not self.used:
                break
            step = np.linalg.lstsq(columns, -left, rcond=1e-9)[0]
            values[self.used] += step
            if np.abs(step).max() < 1e-9:
                break
        return replace(
            self.parameters(values), removable=self.removable(), before_um=before, left_um=size
        )

    def removable(self) -> tuple[Removable, ...]:
        """What parameters can remove of one unit of each error: projection, nominal machine."""
        nominal, zeros = NOMINAL.core(self.setup), [0.0] * self.chain.count
        listed = self.truth.parameters
        errors = self.rates(self.truth.truth_rates(nominal, zeros, self.poses), len(listed))
        columns = self.truth.control_rates(nominal, zeros, self.poses)
        columns = self.rates(columns, len(self.names))[:, self.used]
        left = errors
        if self.used:
            left = errors - columns @ np.linalg.lstsq(columns, errors, rcond=1e-9)[0]
        before, after = np.linalg.norm(errors, axis=0), np.linalg.norm(left, axis=0)
        # What rounding leaves of a removed column is no remainder.
        after = np.where(after < 1e-9 * np.maximum(before, 1e-300), 0.0, after)
        return tuple(
            Removable(name, unit, float(b), float(a))
            for (name, unit), b, a in zip(listed, before, after, strict=True)
        )
