"""The contract's model of a trt-ca in plain numpy, without the core: what tests compare with.

p_machine = T_A Rx(a) T_C Rz(c) T_S p; errors in µm and arcsec.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ARCSEC = np.pi / 648000.0
TABLE_2 = {
    "EA0A": 21.6, "EB0A": 18.0, "EC0A": 10.8, "EB0C": 25.2,
    "EX0C": 15.0, "EY0A": 17.0, "EZ0A": 12.0, "EY0C": 21.0,
}  # fmt: skip
"""Random errors of Table 2; EB0C = 18 + 7.2, EY0C = 17 + 4."""
TABLE_2_ESTIMATES = {
    "EA0A": 21.5784, "EB0A": 18.0086, "EC0A": 10.8288, "EB0C": 18.0086 + 7.2194,
    "EX0C": 14.9908, "EY0A": 16.95, "EZ0A": 12.0, "EY0C": 16.95 + 4.0666,
}  # fmt: skip
"""The paper's estimates of them."""
NAMES = ("EA0A", "EB0A", "EC0A", "EY0A", "EZ0A", "EB0C", "EX0C", "EY0C")


def turn(axis: str, angle: float) -> Floats:
    """4 × 4 right-handed turn about x, y or z."""
    s, c = np.sin(angle), np.cos(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(4)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def shift(x: float, y: float, z: float) -> Floats:
    """4 × 4 translation."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def table_pose(
    errors: Mapping[str, float], a_deg: float, c_deg: float, ecc_arcsec: float = 0.0
) -> Floats:
    """T_A Rx(a) T_C Rz(c + ECC), mm."""
    e = dict.fromkeys(NAMES, 0.0) | dict(errors)
    t_a = (
        shift(0.0, e["EY0A"] * 1e-3, e["EZ0A"] * 1e-3)
        @ turn("x", e["EA0A"] * ARCSEC)
        @ turn("y", e["EB0A"] * ARCSEC)
        @ turn("z", e["EC0A"] * ARCSEC)
    )
    t_c = shift(e["EX0C"] * 1e-3, (e["EY0C"] - e["EY0A"]) * 1e-3, 0.0)
    t_c = t_c @ turn("y", (e["EB0C"] - e["EB0A"]) * ARCSEC)
    a, c = np.radians(a_deg), np.radians(c_deg) + ecc_arcsec * ARCSEC
    return t_a @ turn("x", a) @ t_c @ turn("z", c)


def box(n: int = 5, half: tuple[float, float] = (150.0, 120.0), height: float = 150.0) -> Floats:
    """Points of the paper's volume, (n³, 3)."""
    axes = [np.linspace(-half[0], half[0], n), np.linspace(-half[1], half[1], n)]
    axes.append(np.linspace(0.0, height, n))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def displaced_um(
    errors: Mapping[str, float],
    points: Floats,
    a_deg: float = 0.0,
    c_deg: float = 0.0,
    assumed: Mapping[str, float] | None = None,
) -> Floats:
    """p_machine of the machine with errors minus that of the assumed one, µm, machine frame."""
    p = np.column_stack([points, np.ones(len(points))]).T
    real = table_pose(errors, a_deg, c_deg) @ p
    known = table_pose(assumed or {}, a_deg, c_deg) @ p
    return (real - known)[:3].T * 1e3
