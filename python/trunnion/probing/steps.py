"""From a plan to the steps of a probing cycle: starts, levels between touches, ranges, times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import trunnion._core as _core
from trunnion.base.errors import DataError, InputError
from trunnion.base.progress import tracked
from trunnion.base.units import Flags, Floats
from trunnion.data.touches import Touches
from trunnion.files.origin import places
from trunnion.machine.chain import Chain
from trunnion.probing.cycle import BACK_OFF_DEG, Cycle, Step
from trunnion.probing.model import TouchModel
from trunnion.setup import Setup

DECIMALS = 4
AT_ONCE = 500
"""Touches that the core is asked about at a time: Ctrl-C is answered between them."""
MAX_NAMED = 10
"""Touches that a message names."""


def arrangement(setup: Setup) -> _core.Arrangement:
    """Return the core's machine, artefact, table and probe of a set-up."""
    chain = Chain(setup)
    return _core.Arrangement(
        chain.machine(),
        chain.artefact,
        ball_radius_mm=setup.probe.ball_radius_mm,
        stem_radius_mm=setup.probe.effective_stem_radius_mm,
        stem_length_mm=setup.probe.effective_stem_length_mm,
        body_radius_mm=0.5 * setup.probe.body_diameter_mm,
        body_length_mm=setup.probe.length_mm - setup.probe.effective_stem_length_mm,
        table_radius_mm=setup.table.radius_mm,
        table_thickness_mm=setup.table.thickness_mm,
        clearance_mm=setup.plan.clearance_mm,
        overtravel_mm=setup.plan.overtravel_mm,
        rotary_offset_deg=setup.control.rotary_offset_deg,
    )


def cycle_of(plan: Touches, setup: Setup) -> Cycle:
    """Return what a program of a plan with starts and feeds does."""
    chain = Chain(setup)
    rotary = chain.to_machine(plan.rotary_deg, len(plan))
    arranged = arrangement(setup)
    swing, levels = arranged.safe_levels(rotary)
    at_top = arranged.offset_shift_mm(0.0)
    return Cycle(
        setup=setup,
        letters=tuple(chain.letters),
        swing=_up(swing),
        steps=_steps(plan, setup, levels),
        offset_mm=(at_top, arranged.offset_shift_mm(1.0) - at_top),
    )


def in_ranges(plan: Touches, setup: Setup) -> Flags:
    """Which touches stay in the ranges of the set-up whatever is touched before them, (n,)."""
    starts = plan.start_mm
    assert starts is not None
    ends = plan.position_mm + setup.plan.overtravel_mm * plan.direction
    reached = {axis: np.stack([starts[:, i], ends[:, i]]) for i, axis in enumerate("XYZ")}
    for letter, angles in plan.rotary_deg.items():
        over = BACK_OFF_DEG * plan.rotary_dir.get(letter, np.zeros(len(plan)))
        reached[letter.upper()] = np.stack([angles, angles - over])
    inside = np.full(len(plan), True)
    for axis, (low, high) in setup.axis_ranges().items():
        if axis in reached:
            inside &= ((reached[axis] >= low) & (reached[axis] <= high)).all(axis=0)
    return inside


def with_starts(plan: Touches, setup: Setup, feed: float | None) -> Touches:
    """Return the plan with starts and feeds.

    Raises InputError: a feed is given, and the plan has its own. DataError: neither.
    """
    added: dict[str, Floats] = {}
    if plan.feed_mm_min is None:
        if feed is None:
            raise DataError("plan: got no column feed_mm_min, expected it, or a feed_mm_min given")
        added["feed_mm_min"] = np.full(len(plan), float(feed))
    elif feed is not None:
        raise InputError(
            f"feed_mm_min: got {feed:g}, and a plan with its own feeds (column feed_mm_min); "
            "expected one of them: leave it out, or plan with another feed"
        )
    if plan.start_mm is None:
        starts = plan.position_mm - setup.plan.clearance_mm * plan.direction
        added |= {f"start_{axis}_mm": starts[:, i] for i, axis in enumerate("xyz")}
    return plan.with_columns(**added) if added else plan


def check_feeds_recorded(feeds_mm_min: Sequence[float], setup: Setup) -> None:
    """Refuse several feeds where every touch is recorded at that of its second pass.

    And a feed of the first pass that is no faster: there is nothing to find fast then.
    """
    slow, feeds = setup.plan.slow_feed_mm_min, sorted(set(feeds_mm_min))
    if slow and len(feeds) > 1:
        raise DataError(
            f"plan: got feeds of {', '.join(f'{feed:g}' for feed in feeds)} mm/min beside [plan] "
            f"slow_feed_mm_min = {slow:g}, at which every touch is recorded; expected one feed, or "
            "slow_feed_mm_min = 0: two feeds tell nothing then"
        )
    if slow and feeds and slow >= feeds[0]:
        raise DataError(
            f"[plan] slow_feed_mm_min: got {slow:g}, no slower than the plan's feed of "
            f"{feeds[0]:g} mm/min; expected less (a second, slower pass that measures), or 0: one "
            "pass. Are the two exchanged?"
        )


def as_recorded(plan: Touches, setup: Setup) -> Touches:
    """Return a plan with the feeds at which its touches are recorded: of a second pass, if any.

    Touches that were recorded so, all of them at that feed, stay as they are.

    Raises DataError: as `check_feeds_recorded`.
    """
    slow, feeds = setup.plan.slow_feed_mm_min, plan.feed_mm_min
    if not slow or (feeds is not None and np.all(feeds == slow)):
        return plan
    if feeds is not None:
        check_feeds_recorded(feeds.tolist(), setup)
    return plan.with_columns(feed_mm_min=np.full(len(plan), slow))


def check_clear(plan: Touches, setup: Setup) -> None:
    """Refuse a plan of another set-up, or of no planner, that runs into something."""
    starts = plan.start_mm
    assert starts is not None
    model, arranged = TouchModel(setup), arrangement(setup)
    model.moves(plan, from_start=True)  # what is wrong with a row is said by its own number
    reach = np.linalg.norm(plan.position_mm - starts, axis=1) + setup.plan.overtravel_mm
    found: list[int] = []
    for first in tracked(range(0, len(plan), AT_ONCE), "clear", -(-len(plan) // AT_ONCE)):
        some = slice(first, first + AT_ONCE)
        moves = model.moves(plan[some], from_start=True)
        found += [first + row for row in arranged.blocked_moves(moves, reach[some].tolist())]
    if found:
        artefact = setup.artefact
        raise DataError(
            f"plan: got touches that run into something or find nothing with the artefact within "
            f"{artefact.tolerance_mm:g} mm and {artefact.tolerance_deg:g} deg of its place"
            f"{offset_too(setup)}: {places(plan, found, MAX_NAMED)}; expected a plan of this "
            "set-up (artefact, place, tolerance, table, probe, clearance)"
        )


def offset_too(setup: Setup) -> str:
    """Say what rotary axes may be off by, where that is anything."""
    off = setup.control.rotary_offset_deg
    return f", rotary axes within {off:g} deg of theirs" if off else ""


def taken_by_offset(plan: Touches, setup: Setup) -> list[str]:
    """Say how many touches the plan has not because rotary axes may be off, where it is any.

    Of those at the plan's positions of the axes, each once.
    """
    off, chain = setup.control.rotary_offset_deg, Chain(setup)
    if not off:
        return []
    machine = dict(zip(chain.letters, chain.to_machine(plan.rotary_deg, len(plan)).T, strict=True))
    turn, tilt = (machine.get(x or "", np.zeros(0)) for x in (chain.turning, chain.tilting))
    both = len(turn) and len(tilt)
    each: dict[str, Any] = {
        "turn_deg": [] if both else np.unique(turn).tolist(),
        "tilt_deg": [] if both else np.unique(tilt).tolist(),
        "pairs_deg": sorted(set(zip(tilt.tolist(), turn.tolist(), strict=True))) if both else [],
    }
    places = np.round(np.column_stack([plan.position_mm, plan.direction]), 2)
    own = len(np.unique(np.column_stack([*machine.values(), places]), axis=0))

    def reached(known: Setup, *, all_faces: bool) -> int:
        return len(
            arrangement(known).plan(
                **each,
                feeds_mm_min=[1.0],
                both_senses=False,
                repeats=1,
                linear_um=setup.resolution.linear_um,
                rotary_arcsec=setup.resolution.rotary_arcsec,
                layout="side",
                all_faces=all_faces,
            )["feed_mm_min"]
        )

    all_faces = own > reached(setup, all_faces=False)
    without = replace(setup, control=replace(setup.control, rotary_offset_deg=0.0))
    count = reached(without, all_faces=all_faces)
    taken = count - reached(setup, all_faces=all_faces)
    if not taken:
        return []
    return [
        f"rotary_offset_deg = {off:g} of [control] took {taken} of the {count} touches that can be "
        "made at these positions of the axes."
    ]


def table_pose(touches: Touches, setup: Setup) -> tuple[Floats, Floats]:
    """Rotation (n, 3, 3) and shift (n, 3), mm, from the table to the machine frame, each touch."""
    chain = Chain(setup)
    return chain.table_pose(chain.to_machine(touches.rotary_deg, len(touches)))


def _steps(plan: Touches, setup: Setup, levels: Floats) -> tuple[Step, ...]:
    starts, feeds = plan.start_mm, plan.feed_mm_min
    assert starts is not None
    assert feeds is not None
    ends = plan.position_mm + setup.plan.overtravel_mm * plan.direction
    ways = table_pose(plan, setup)[0].swapaxes(1, 2) @ (ends - starts)[:, :, None]
    rotary: Mapping[str, Floats] = plan.rotary_deg
    senses = plan.rotary_dir
    steps = []
    for row in range(len(plan)):
        angles = {x.upper(): _round(float(values[row])) for x, values in rotary.items()}
        sense = {x: int(senses[x.lower()][row]) if x.lower() in senses else 0 for x in angles}
        start = tuple(_round(float(v)) for v in starts[row])
        steps.append(
            Step(
                angles=angles,
                senses=sense,
                start=start,
                contact=tuple(float(v) for v in plan.position_mm[row]),
                end=tuple(_round(float(v)) for v in ends[row]),
                way=tuple(_round(float(v)) for v in ways[row, :, 0]),
                level=max(_up(float(levels[row])), start[2]),
                feed=float(feeds[row]),
            )
        )
    return tuple(steps)


def _round(value: float) -> float:
    return float(round(value, DECIMALS)) + 0.0


def _up(value: float) -> float:
    return float(np.ceil(value * 1e4 - 1e-6)) / 1e4
