"""Mistakes of places: touches beside their approach, an artefact that stands elsewhere."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from trunnion.base.errors import TrunnionError
from trunnion.base.units import Floats
from trunnion.data.touches import BESIDE_MM, Touches, across_mm
from trunnion.files.origin import places
from trunnion.machine.chain import Chain
from trunnion.machine.sizes import LARGE_UM
from trunnion.probing.model import TouchModel
from trunnion.probing.steps import table_pose
from trunnion.setup import Setup

MAX_NAMED = 5
"""Touches that a sentence names."""
REACH_MM = 500.0
"""How far from a touch the artefact is looked for."""
ACROSS_FACE = 0.9
"""Cosine of the angle between an approach and the normal of a face within which it is along it."""
ROUNDS = 5
SETTLED_MM = 0.02


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


def other_place_mm(data: Touches, setup: Setup) -> tuple[float, float, float] | None:
    """Where the touches put an artefact with flat faces, `place_mm` to 0.1 mm; None: its place.

    Middle of the faces that are farthest out, then by as much as touches are off their faces.
    """
    artefact = setup.artefact
    letters = {letter.upper() for letter in data.rotary_deg}
    if artefact.kind not in ("cross", "cuboid") or letters != {*Chain(setup).letters}:
        return None
    turn, shift = table_pose(data, setup)
    cos, sin = np.cos(np.radians(artefact.turn_deg)), np.sin(np.radians(artefact.turn_deg))
    own = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])  # of the table's axes
    ways = np.einsum("ij,nkj,nk->ni", own, turn, data.direction)
    contact = data.position_mm + setup.probe.ball_radius_mm * data.direction - shift
    faces = np.einsum("ij,nkj,nk->ni", own, turn, contact)
    given = np.array(artefact.effective_place_mm)
    place = _middle(faces, ways, own @ given, artefact.height_mm or 0.0)
    for _ in range(ROUNDS):
        moved = own.T @ place
        try:
            there = replace(setup, artefact=replace(artefact, place_mm=tuple(moved.tolist())))
        except TrunnionError:  # no place for an artefact
            return None
        off = _off_mm(data, there)
        step = np.zeros(3)
        for axis in range(3):
            along = (np.abs(ways[:, axis]) > ACROSS_FACE) & np.isfinite(off)
            if along.any():
                step[axis] = np.median(-off[along] / ways[along, axis])
        place = place + step
        if np.abs(step).max() < SETTLED_MM:
            break
    found = np.round(own.T @ place, 1) + 0.0
    if np.linalg.norm(found - given) <= LARGE_UM / 1e3:
        return None
    x, y, z = found.tolist()
    return x, y, z


def _middle(faces: Floats, ways: Floats, given: Floats, height_mm: float) -> Floats:
    """Place between the outermost faces touched from either side; where there are none, `given`.

    faces, ways: Contacts and approaches along the artefact's axes, (n, 3).
    """
    place = given.copy()
    for axis in range(2):
        low, high = (faces[sign * ways[:, axis] > ACROSS_FACE, axis] for sign in (1.0, -1.0))
        if len(low) and len(high):
            place[axis] = (low.min() + high.max()) / 2
    top = faces[ways[:, 2] < -ACROSS_FACE, 2]
    if len(top):
        place[2] = top.max() - height_mm
    return place


def _off_mm(data: Touches, setup: Setup) -> Floats:
    """How far along its approach each touch is before the artefact, (n,); nan: it passes."""
    model = TouchModel(setup)
    off = np.full(len(data), np.nan)
    for row in range(len(data)):
        with suppress(TrunnionError):
            off[row] = model.core.simulate(
                model.moves(data[[row]]), model.values(), from_start=False, reach_mm=REACH_MM,
                noise_um=0.0, seed=0, sample=0,
            )[0]  # fmt: skip
    return off
