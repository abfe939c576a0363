"""What the mechanism answers: forward solutions, sensitivities, over-constraint, closures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trunnion.base.arguments import checked
from trunnion.base.report import Result, Table
from trunnion.base.saved import Gridded
from trunnion.base.units import Floats
from trunnion.hybrid.parameters import JOINTS

FORWARD_COLUMNS = 26


@dataclass(frozen=True, eq=False, repr=False)
class Forward(Result):
    """Forward solutions, n poses.

    Attributes
    ----------
    joints
        L1, L2, L3 (mm), q4, q5 (deg), (n, 5).
    tip_mm
        Tool point, machine frame, (n, 3).
    direction
        Unit vector from the spindle to the tool point, (n, 3).
    passive_deg
        Y = u1, v1, u2, v2, φ, w2, u3, v3, (n, 8).
    gap_um
        Gap between platform and legs 1 and 3, machine frame, (n, 2, 3).
    misfit_arcsec
        Revolute axis of the platform against legs 1 and 3: against the leg's direction, and about
        it, (n, 2, 2). All zero where the loops close.
    pivot_ratio
        Smallest over largest pivot of ∂G/∂Y, (n,); 0 at a singular posture.
    steps
        Newton steps taken, (n,).
    """

    joints: Floats
    tip_mm: Floats
    direction: Floats
    passive_deg: Floats
    gap_um: Floats
    misfit_arcsec: Floats
    pivot_ratio: Floats
    steps: NDArray[np.int64]

    @classmethod
    def of_rows(cls, joints: Floats, rows: Floats) -> Forward:
        """From the core's rows, (n, `FORWARD_COLUMNS`)."""
        loops = rows[:, 14:24].reshape(-1, 2, 5)
        return cls(
            joints=joints,
            tip_mm=rows[:, 0:3],
            direction=rows[:, 3:6],
            passive_deg=rows[:, 6:14],
            gap_um=loops[:, :, :3],
            misfit_arcsec=loops[:, :, 3:],
            pivot_ratio=rows[:, 24],
            steps=rows[:, 25].astype(np.int64),
        )

    def __len__(self) -> int:
        return len(self.tip_mm)

    def sentences(self) -> Sequence[str]:
        """Count, and how far from singular and from closed."""
        return (
            f"Poses: {len(self)}; smallest pivot ratio {self.pivot_ratio.min(initial=1.0):.3g}, "
            f"largest misfit of the loops {np.abs(self.misfit_arcsec).max(initial=0.0):.3g} "
            f"arcsec, largest gap {np.abs(self.gap_um).max(initial=0.0):.3g} µm.",
        )

    def tables(self) -> tuple[Table, ...]:
        """Joints and tool point, then direction and pivot ratio; one row a pose."""
        return (
            _by_pose("Tool points", (*JOINTS, "x_mm", "y_mm", "z_mm"), self.joints, self.tip_mm),
            _by_pose(
                "Tool directions", ("i", "j", "k", "pivot_ratio"), self.direction, self.pivot_ratio
            ),
        )


def _by_pose(title: str, columns: tuple[str, ...], *values: Floats) -> Table:
    rows = [(str(pose), *row) for pose, row in enumerate(np.column_stack(values).tolist())]
    return Table.of(title, ("pose", *columns), rows)


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(Result):
    """How errors move the tool: n poses, k parameters; equations (1) and (2).

    Every derivative is in user units: µm or arcsec per unit of the parameter (its name says
    which, µm or arcsec).

    Attributes
    ----------
    parameters
        Their names.
    forward
        The solutions at which it holds.
    tip
        dr/dE, (n, 3, k).
    turn
        Turn of the tool about X, Y, Z of the machine, arcsec per unit, (n, 3, k).
    serial_tip, serial_turn
        (∂r/∂E)_Y: the same with the outer legs taken off the platform.
    passive
        dY/dE, arcsec per unit, (n, 8, k).
    """

    parameters: tuple[str, ...]
    forward: Forward
    tip: Floats
    turn: Floats
    serial_tip: Floats
    serial_turn: Floats
    passive: Floats

    @checked
    def table(self, pose: int = 0) -> Table:
        """Columns of dr/dE and of the tool's turn at one pose."""
        rows = [
            (name, *self.tip[pose, :, k].tolist(), *self.turn[pose, :, k].tolist())
            for k, name in enumerate(self.parameters)
        ]
        joints = ", ".join(
            f"{name[: -len(unit) - 1]} = {value:g} {unit}"
            for name, value in zip(JOINTS, self.forward.joints[pose], strict=True)
            for unit in [name.rsplit("_", 1)[1]]
        )
        title = f"Tool point (µm) and turn (arcsec) per unit of each error at {joints}"
        return Table.of(title, ("", "x", "y", "z", "about X", "about Y", "about Z"), rows)

    def tables(self) -> tuple[Table, ...]:
        """The table of the first pose."""
        return (self.table(),)

    def headline(self) -> str:
        """Counts."""
        return f"errors: {len(self.parameters)}, poses: {len(self.forward)}"

    def gridded(self) -> Gridded:
        """Return the derivatives over poses, directions and errors."""
        axes = {"joint": list(JOINTS), "direction": list("xyz"), "parameter": list(self.parameters)}
        along = ("pose", "direction", "parameter")
        arrays = {
            "joints": (("pose", "joint"), self.forward.joints),
            **{f"{name}_um": (along, getattr(self, name)) for name in ("tip", "serial_tip")},
            **{f"{name}_arcsec": (along, getattr(self, name)) for name in ("turn", "serial_turn")},
            "passive_arcsec": (("pose", "passive_joint", "parameter"), self.passive),
        }
        return Gridded(axes, arrays, {"per": "unit at the end of the parameter's name"})

    def derived(self) -> Mapping[str, Any]:
        """Poses."""
        return {"joints": self.forward.joints, "tip_mm": self.forward.tip_mm}


@dataclass(frozen=True, eq=False, repr=False)
class Constraint(Result):
    """Over-constraint of the loops at one pose.

    Attributes
    ----------
    rank
        Of the 12 × 13 Jacobian of the loop equations (two loops, position and orientation) by the
        joints (Y, L1, L2, L3 and the two outer platform revolutes).
    mobility
        Degrees of freedom, 13 - rank.
    singular_values
        Orientation rows times 1000 mm; mm per mm or rad, (12,).
    self_stress
        States of stress without load, one a redundant equation: (states, 2 loops, 6), force and
        moment (times mm, about the seat) of legs 1 and 3 on the platform, machine frame, unit size.
    jacobian
        (12, 13), mm per mm or rad.
    """

    rank: int
    mobility: int
    singular_values: Floats
    self_stress: Floats
    jacobian: Floats

    @property
    def redundant(self) -> int:
        """Redundant equations: states of self-stress."""
        return len(self.self_stress)

    def sentences(self) -> Sequence[str]:
        """Rank, mobility, self-stress."""
        return (
            f"Loop Jacobian 12 × 13 of rank {self.rank}: {self.mobility} degrees of freedom, "
            f"{self.redundant} redundant equations, thus {self.redundant} states of self-stress; "
            f"smallest non-zero singular value {self.singular_values[self.rank - 1]:.3g} mm/rad.",
        )

    def tables(self) -> tuple[Table, ...]:
        """Singular values, and the states of self-stress."""
        columns = ("state, leg", "force x", "y", "z", "moment x", "y", "z")
        stress = [
            (f"{state + 1}, leg {leg}", *loop)
            for state, loops in enumerate(self.self_stress.tolist())
            for leg, loop in zip((1, 3), loops, strict=True)
        ]
        values = [(str(k + 1), v) for k, v in enumerate(self.singular_values.tolist())]
        return (
            Table.of("Singular values of the loop Jacobian", ("", "mm/mm or rad"), values),
            Table.of("Self-stress, unit size, moments times mm", columns, stress),
        )


@dataclass(frozen=True, eq=False, repr=False)
class ClosureDependence(Result):
    """What errors strain, and how far the answer depends on which equations are kept.

    Attributes
    ----------
    errors
        The errors looked at, name and amount.
    closures
        Names of the closures compared.
    tip_um
        Displacement of the tool point under each, (closures, 3).
    misfit_arcsec, gap_um
        What each leaves in the loops, (closures, 2, 2) and (closures, 2, 3).
    spread_um
        Largest distance between two of the answers.
    """

    errors: Mapping[str, float]
    closures: tuple[str, ...]
    tip_um: Floats
    misfit_arcsec: Floats
    gap_um: Floats
    spread_um: float

    @property
    def depends(self) -> bool:
        """Whether the loops are strained, beyond rounding, so that joint stiffness decides."""
        return bool(np.abs(self.misfit_arcsec).max() > 1e-6 or np.abs(self.gap_um).max() > 1e-6)

    def sentences(self) -> Sequence[str]:
        """Whether the closure matters."""
        if not self.depends:
            return ("All equations stay satisfied: the answer does not depend on the closure.",)
        return (
            f"The loops are strained: answers differ by {self.spread_um:.3f} µm, and only the "
            "stiffness of the joints decides between them.",
        )

    def tables(self) -> tuple[Table, ...]:
        """One row a closure."""
        rows = [
            (
                name,
                *self.tip_um[i].tolist(),
                float(np.abs(self.misfit_arcsec[i]).max()),
                float(np.abs(self.gap_um[i]).max()),
            )
            for i, name in enumerate(self.closures)
        ]
        amounts = ", ".join(f"{name} = {value:g}" for name, value in self.errors.items())
        title = f"Displacement of the tool point under {amounts}"
        columns = ("closure", "dx µm", "dy µm", "dz µm", "misfit arcsec", "gap µm")
        return (Table.of(title, columns, rows, digits=3),)

    def derived(self) -> Mapping[str, Any]:
        """Whether the closure matters."""
        return {"depends": self.depends}
