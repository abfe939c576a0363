"""Rotations by three angles and their exact derivatives."""

from __future__ import annotations

import numpy as np

from trunnion.base.rows import ROWS_AT_HAND, at_hand
from trunnion.base.units import Floats

# ω × p = Σ ω_i (CROSS[i] @ p)
_CROSS = np.array(
    [
        [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
        [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
    ]
)


def rotations(angles: Floats) -> tuple[Floats, Floats]:
    """Return Rx(α) Ry(β) Rz(γ) and its derivative by each angle.

    angles: α, β, γ in rad, shape (n, 3).

    Returns tuple: Matrices, shape (n, 3, 3), and their derivatives, shape (3, n, 3, 3).
    """
    (ca, cb, cg), (sa, sb, sg) = cosine_sine(np.ascontiguousarray(angles.T))
    turned = np.empty((len(angles), 3, 3))
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 0, 2] = cb * cg, -cb * sg, sb
    turned[:, 1, 0], turned[:, 2, 0] = ca * sg + sa * sb * cg, sa * sg - ca * sb * cg
    turned[:, 1, 1], turned[:, 2, 1] = ca * cg - sa * sb * sg, sa * cg + ca * sb * sg
    turned[:, 1, 2], turned[:, 2, 2] = -sa * cb, ca * cb
    # To turn by one angle more is to turn about that axis where the turns before have taken it.
    axes = np.zeros((3, len(angles), 3))
    axes[0, :, 0] = 1.0
    axes[1, :, 1], axes[1, :, 2] = ca, sa
    axes[2] = turned[:, :, 2]
    return turned, np.tensordot(axes, _CROSS, axes=1) @ turned


def cosine_sine(angle: Floats, out: Floats | None = None) -> Floats:
    """Cosine and sine of angles (rad), shape (2, ...), within 3e-16.

    By the tangent of half the angle: a tenth of the time where numpy has vector instructions for it
    and none for the two.
    """
    out = np.empty((2, *np.shape(angle))) if out is None else out
    flat, both = np.reshape(angle, -1), out.reshape(2, -1)
    room = np.empty(min(flat.size, ROWS_AT_HAND))
    for some in at_hand(flat.size):
        cosine, sine = both[:, some]
        square = room[: len(sine)]
        tangent = np.tan(np.multiply(0.5, flat[some], out=sine), out=sine)
        np.multiply(tangent, tangent, out=square)
        np.subtract(1.0, square, out=cosine)
        square += 1.0
        cosine /= square
        sine *= 2.0
        sine /= square
    return out


def wave_rows(
    place: Floats, period: float, a: float, b: float, room: Floats | None = None
) -> Floats:
    """Derivatives of ``a cos(2π s / p) + b sin(2π s / p)`` by a, b and p, one a row, (3, n).

    Without the last one where it is zero, (2, n): a search starts without size. ``room``: for them,
    (3, n).
    """
    out = np.empty((3, len(place))) if room is None else room
    turn = np.multiply(place, 2 * np.pi / period, out=out[2])
    both = cosine_sine(turn, out[:2])
    if not (a or b):
        return both
    turn *= a * both[1] - b * both[0]
    turn /= period
    return out
