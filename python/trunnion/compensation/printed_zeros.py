"""Equations (22) to (24) of Kang, Kim and Jee (2022) as printed: zeros of A and C, origin offsets.

They look for the rotary positions at which the nominal machine has the tool direction that the
erroneous one has at A = C = 0. Near A = 0 that position of C is anything (±49° for the errors of
Table 2), and turning C does not right a tilt that lies in front of C in the chain, as EB0C does.
:func:`~trunnion.compensation.parameters.cnc_parameters` finds the zeros that leave the least.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.report import Result, Table
from trunnion.compensation.parameters import CncParameters


@dataclass(frozen=True, eq=False, repr=False)
class PrintedZeros(Result):
    """Zeros and origin offsets of Kang, Kim and Jee (2022), section 3.2 with eqs. (22) to (24).

    Attributes
    ----------
    normal
        n_CRS of eq. (22).
    a_deg, c_deg
        A_Comp and C_Comp, for the upper and the lower sign of eq. (23).
    work
        Origin offsets that go into the work coordinates, `dx_um`, `dy_um`, `dz_um`: those of the
        rotary axes at A = C = 0 and of the artefact's placement.
    singular
        True where n_CRS is the Z direction: C_Comp is then undefined, atan2(0, 0), in floating
        point 0 or ±180° by the signs of two zeros; given as 0. Close to it C_Comp is defined, but
        hangs on the ratio of two small errors.
    """

    normal: tuple[float, float, float]
    a_deg: tuple[float, float]
    c_deg: tuple[float, float]
    work: Mapping[str, float]
    singular: bool

    def sentences(self) -> Sequence[str]:
        """Both solutions, the origin offsets, and where the position of C is undefined."""
        lines = [
            f"Equations (22) to (24) as printed: A = {a:+.6f}°, C = {c:+.4f}°."
            for a, c in zip(self.a_deg, self.c_deg, strict=True)
        ]
        offsets = ", ".join(f"{k[1].upper()} {v:+.3f} µm" for k, v in self.work.items())
        lines.append(f"Origin offsets in the work coordinates: {offsets}.")
        if self.singular:
            lines.append("The normal is the Z direction: C is undefined and given as 0.")
        return lines

    def tables(self) -> tuple[Table, ...]:
        """Positions of A and C, one row a sign of equation (23)."""
        rows = [
            (sign, a, c)
            for sign, a, c in zip(("upper", "lower"), self.a_deg, self.c_deg, strict=True)
        ]
        title = "Rotary positions by equations (22) to (24) as printed, degrees"
        return (Table.of(title, ("sign of (23)", "A", "C"), rows, digits=6),)

    @checked
    def parameters(
        self, branch: int = 0, *, turn_work: bool = True, offsets: bool = True
    ) -> CncParameters:
        """As zeros of A and C, subtracted from the commanded positions, and origin offsets.

        With `turn_work` the control knows that the work on the table is turned along with C;
        without, the program misses the work by the whole turn of C. Without `offsets` only the
        zeros are set, which is half of the printed method.
        """
        c = -self.c_deg[branch] * 3600.0
        zeros = {"A": -self.a_deg[branch] * 3600.0, "C": c}
        work = dict(self.work) if offsets else {}
        return CncParameters(zeros, work=work | ({"rc_arcsec": c} if turn_work else {}))


@checked
def printed_zeros(
    errors: Mapping[str, float],
    setup_yaw_arcsec: float = 0.0,
    placement: Mapping[str, float] | None = None,
) -> PrintedZeros:
    """Zeros of A and C by eqs. (22) to (24) as printed, and the origin offsets of the text.

    Parameters
    ----------
    errors
        EA0A, EB0C and EC0A in arcsec; EX0C, EY0C and EZ0A in µm (others are not used).
    setup_yaw_arcsec
        E_CRS, the artefact's yaw on the table.
    placement
        `dx_um`, `dy_um`, `dz_um` of the artefact, which the paper adds to the origin offsets.

    Examples
    --------
    >>> import trunnion as tn
    >>> errors = dict(EA0A=20.0, EB0C=0.0, EC0A=10.0, EX0C=15.0, EY0C=0.0, EZ0A=0.0)
    >>> tn.printed_zeros(errors)
    <PrintedZeros: Equations (22) to (24) as printed: A = +0.005556°, C = +179.9972°.>
    """
    tilts = np.array([float(errors.get(name, 0.0)) for name in ("EA0A", "EB0C", "EC0A")])
    tilts[2] += setup_yaw_arcsec
    phi, theta, psi = np.radians(tilts / 3600.0)
    ni = np.sin(phi) * np.sin(psi) - np.cos(phi) * np.cos(psi) * np.sin(theta)
    nj = np.cos(psi) * np.sin(phi) + np.cos(phi) * np.sin(psi) * np.sin(theta)
    nk = np.cos(phi) * np.cos(theta)
    # 1 − nk² without its cancellation: the normal is a unit vector.
    across = np.hypot(ni, nj)
    a, c = [], []
    for sign in (1.0, -1.0):
        tilt = np.arctan2(sign * across, nk)
        a.append(float(np.degrees(tilt)))
        c.append(float(np.degrees(np.arctan2(ni * np.sin(tilt), -nj * np.sin(tilt)) + 0.0)))
    singular = bool(across < 1e-12)
    if singular:
        c = [0.0, 0.0]
    placed = {} if placement is None else placement
    at_zero = {"dx_um": "EX0C", "dy_um": "EY0C", "dz_um": "EZ0A"}
    work = {
        k: float(errors.get(name, 0.0)) + float(placed.get(k, 0.0)) for k, name in at_zero.items()
    }
    normal = (float(ni), float(nj), float(nk))
    return PrintedZeros(normal, (a[0], a[1]), (c[0], c[1]), work, singular)
