"""Effects on ball-bar lengths of the hybrid parallel machine: its legs, screws, wrist and base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.effect import Effect, linear
from trunnion.hybrid.mechanism import Mechanism
from trunnion.models.ballbar.effects import Bar, cyclic, expansion
from trunnion.models.ballbar.path import Path

LEGS = (0, 1, 2)
GROUPS = (("", LEGS, "the legs"), *((f"_{k + 1}", (k,), f"leg {k + 1}") for k in LEGS))
"""Suffix of the id, members, name: all legs alike, and each by itself."""
SHIFTS = {
    "wrist_squareness": (("arcsec",), ("wrist5_b_arcsec",), "squareness of the wrist's axes"),
    "base_shift": (
        ("dy_um", "dz_um"),
        ("base3_y_um", "base3_z_um"),
        "shift of the base joint of leg 3",
    ),
    "base_shift_2": (
        ("dx_um", "dz_um"),
        ("base2_x_um", "base2_z_um"),
        "shift of the base joint of leg 2",
    ),
}
"""Id → parameters, errors of the mechanism that they are, label."""


ENDS = tuple(f"end{k + 1}_{axis}_um" for k in LEGS for axis in "xy")
ERRORS = (
    "e5_um",
    "e6_um",
    "e7_um",
    *ENDS,
    *(name for _, some, _ in SHIFTS.values() for name in some),
)
"""Errors of the mechanism of which the effects are made."""


@dataclass(frozen=True, eq=False)
class Solved:
    """The machine at its commands: tool points (n, 3), passive joints (n, 8), dr/dE of `ERRORS`."""

    tip_mm: Floats
    passive_deg: Floats
    rates: Floats  # (n, 3, k)

    @classmethod
    def of(cls, mechanism: Mechanism, joints: Floats) -> Solved:
        """Solve the loops at commanded joints (n, 5)."""
        found = mechanism.sensitivity(joints, ERRORS)
        # copies, so that the many columns that are not needed are given back
        kept = (found.forward.tip_mm, found.forward.passive_deg, found.tip)
        return cls(*map(np.array, kept))


def hybrid(path: Path, bar: Bar, solved: Solved, joints: Floats) -> list[Effect]:
    """Effects of the hybrid machine; ``joints`` (n, 5) are the commanded ones."""
    reach = np.einsum("ij,ijk->ik", bar.direction, solved.rates)
    column = dict(zip(ERRORS, reach.T, strict=True))
    length = joints[:, :3]
    sign = [path.travel(length[:, k]) for k in LEGS]

    out: list[Effect] = []
    for suffix, legs, who in GROUPS:
        grows = np.asarray(sum(reach[:, k] * length[:, k] * 1e-3 for k in legs))
        label = f"thermal expansion of {who}"
        out.append(expansion(f"leg_expansion{suffix}", path.hours, grows, label))
    for suffix, legs, who in GROUPS:
        lost = np.asarray(sum(-0.5 * sign[k] * reach[:, k] for k in legs))
        out.append(linear(f"lost_motion{suffix}", ["b_um"], lost, f"lost motion of {who}"))
    for suffix, legs, who in GROUPS:
        pairs = [(length[:, k], reach[:, k]) for k in legs]
        screws = f"the screw{'s' if len(legs) > 1 else ''} of {who}"
        out += cyclic(f"screw_cyclic{suffix}", pairs, f"cyclic error of {screws}")
    sag = _gravity(solved.passive_deg, joints, column)
    out.append(linear("gravity", ["k_um"], sag, "bending of the legs by their weight"))
    for id_, (parameters, parts, label) in SHIFTS.items():
        out.append(linear(id_, parameters, np.column_stack([column[n] for n in parts]), label))
    return out


def _gravity(passive_deg: Floats, joints: Floats, column: Mapping[str, Floats]) -> Floats:
    """Sag of the legs' ends, square to each leg, for 1 µm at 1000 mm and a level leg."""
    passive = np.radians(passive_deg)
    total = np.zeros(len(joints))
    for leg, (u, v) in enumerate(((0, 1), (2, 3), (6, 7))):
        su, cu = np.sin(passive[:, u]), np.cos(passive[:, u])
        sv = np.sin(passive[:, v])
        # (0, 0, -1) in the frame Rx(u) Ry(v): -(third row of the rotation).
        x, y = sv * cu, -su
        if leg == 1:
            turn = passive[:, 4]
            x, y = x * np.cos(turn) + y * np.sin(turn), -x * np.sin(turn) + y * np.cos(turn)
        sag = (joints[:, leg] / 1000.0) ** 3
        total += sag * (x * column[f"end{leg + 1}_x_um"] + y * column[f"end{leg + 1}_y_um"])
    return total
