"""Mistakes of places: touches beside their approach, a sphere that stands elsewhere."""

from __future__ import annotations

import numpy as np

from trunnion.data.touches import BESIDE_MM, Touches, across_mm
from trunnion.files.origin import places
from trunnion.machine.chain import Chain
from trunnion.machine.sizes import LARGE_UM
from trunnion.probing.steps import table_pose
from trunnion.setup import Setup

MAX_NAMED = 5
"""Touches that a sentence names."""


def beside(data: Touches) -> list[str]:
    """Name touches that are not on the line from where their approach started.

    On a face that is flat there their readings are right; near an edge, or on a ball, they are not.
    """
    if data.start_mm is None:
        return []
    off_mm = np.linalg.norm(across_mm(data.position_mm - data.start_mm, data.direction), axis=1)
    far = np.flatnonzero(off_mm > BESIDE_MM).tolist()
    if not far:
        return []
    return [
        f"{len(far)} of {len(data)} touches are up to {off_mm.max():.3g} mm beside the line from "
        f"the start of their approach (start_x_mm, ...), which the ball moves along: "
        f"{places(data, far, MAX_NAMED)}. Are they of another plan, or was a column changed?"
    ]


def other_centre_mm(data: Touches, setup: Setup) -> tuple[float, float, float] | None:
    """Where the touches put a sphere, artefact frame, to 0.1 mm; None where that is its place.

    The centre that is equally far from all of them as the nominal machine has them on its table.
    """
    artefact = setup.artefact
    letters = {letter.upper() for letter in data.rotary_deg}
    if artefact.centre_mm is None or letters != {*Chain(setup).letters}:
        return None
    turn, shift = table_pose(data, setup)
    points = np.einsum("nji,nj->ni", turn, data.position_mm - shift) - artefact.effective_place_mm
    cos, sin = np.cos(np.radians(artefact.turn_deg)), np.sin(np.radians(artefact.turn_deg))
    points = points @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    # |p|² = 2 c·p + (r² - |c|²), from near their middle: no digits are lost.
    middle = points.mean(axis=0)
    off = points - middle
    known = np.column_stack([2.0 * off, np.ones(len(off))])
    found, _, rank, _ = np.linalg.lstsq(known, np.sum(off**2, axis=1), rcond=None)
    centre = np.round(middle + found[:3], 1) + 0.0
    if rank < known.shape[1] or np.linalg.norm(centre - artefact.centre_mm) <= LARGE_UM / 1e3:
        return None
    x, y, z = centre.tolist()
    return x, y, z
