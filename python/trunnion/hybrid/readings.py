"""Readings of a ball-bar: their set-ups, and the ball centres, which are unknown.

A reading is the distance of the tool point from a ball that rests on the table; its centre is one
unknown point for each set-up, on any machine.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.units import Floats, Integers
from trunnion.data.ballbar import Ballbar

#: A bar further from the modelled length than this is refused, mm.
MAX_DEVIATION_MM = 5.0
#: Readings of a set-up that place the ball's centre.
MIN_READINGS = 3


def setup_index(data: Ballbar) -> tuple[Integers, tuple[str, ...]]:
    """Number of the set-up of each row, (n,), and the labels in order of appearance."""
    _, first, inverse = np.unique(data.setup, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    labels = tuple(str(data.setup[first[k]]) for k in order)
    return np.asarray(rank[inverse], dtype=np.intp), labels


def joints_of(data: Ballbar) -> Floats:
    """Return the commanded joints, (n, 5); data that command coordinates are refused."""
    joints = data.joints
    if joints is None:
        raise DataError(
            "ball-bar data: got no joints, expected columns l1_mm, l2_mm, l3_mm, q4_deg, q5_deg"
        )
    return joints


def start_centres(tips: Floats, lengths_mm: Floats, index: Integers) -> Floats:
    """Centre of the sphere (of each set-up) that fits tool points and lengths best, (setups, 3).

    |p|² - L² = 2 p·c - |c|² + const is linear in the centre; where the points lie in a plane the
    centre starts in it.
    """
    centres = np.zeros((int(index.max()) + 1, 3))
    for k in range(len(centres)):
        rows = index == k
        points = tips[rows]
        mean = points.mean(axis=0)
        arms = points - mean
        right = 0.5 * ((arms**2).sum(axis=1) - lengths_mm[rows] ** 2)
        design = np.column_stack([arms, np.ones(len(arms))])
        found, *_ = np.linalg.lstsq(design, right, rcond=1e-9)
        centres[k] = mean + found[:3]
    return centres


def check_near(lengths_mm: Floats, reference_mm: Floats) -> None:
    """Refuse lengths that the commanded points cannot have, whatever the ball's centre."""
    deviation = np.abs(lengths_mm - reference_mm)
    worst = int(np.argmax(deviation))
    if deviation[worst] > MAX_DEVIATION_MM:
        raise DataError(
            f"length_mm (row {worst}): got {lengths_mm[worst]:.4f}, expected within "
            f"{MAX_DEVIATION_MM:g} mm of {reference_mm[worst]:.4f}, the distance of the "
            "commanded point from the best centre"
        )


def check_enough(index: Integers, labels: Sequence[str]) -> None:
    """Refuse set-ups whose readings cannot place the ball."""
    counts = np.bincount(index, minlength=len(labels))
    for label, count in zip(labels, counts, strict=True):
        if count < MIN_READINGS:
            raise DataError(
                f"ball-bar: got {count} reading{'' if count == 1 else 's'} in set-up {label}, "
                f"expected at least {MIN_READINGS} to place the ball"
            )


def gradient_with_centres(gradient: Floats, direction: Floats, index: Integers) -> Floats:
    """Columns of the errors, (n, k), followed by three of each centre: those are -direction."""
    setups = int(index.max()) + 1
    full = np.zeros((len(gradient), gradient.shape[1] + 3 * setups))
    full[:, : gradient.shape[1]] = gradient
    for axis in range(3):
        full[np.arange(len(gradient)), gradient.shape[1] + 3 * index + axis] = -direction[:, axis]
    return full
