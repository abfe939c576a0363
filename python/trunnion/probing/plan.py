"""Plans: which touches, in which order, on which approach."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import DataError, InputError
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.machine.sizes import length_doubts, size_doubt
from trunnion.probing.steps import arrangement, check_feeds_recorded, cycle_of
from trunnion.setup import Setup

MAX_DEG = 3600.0
"""Ten turns: more is a typo."""
USUAL_PERIOD_MS = 1.0
"""Servo period of LinuxCNC unless its configuration says otherwise."""
DITHER_SEED = 1
MAX_STOPS = 10_000
"""Positions of the rotary axes in a plan; each has up to twenty touches."""


@checked
def plan(
    setup: Setup,
    c_deg: Sequence[float] | None = None,
    a_deg: Sequence[float] | None = None,
    feeds_mm_min: Sequence[float] = (600,),
    both_senses: bool = False,
    repeats: int = 1,
    *,
    b_deg: Sequence[float] | None = None,
    positions_deg: Sequence[tuple[float, float]] = (),
    layout: str = "side",
    all_faces: bool = False,
    dither: bool = True,
) -> Touches:
    """Plan the touches of a measurement.

    The default is the paper's: sixteen touches at A = 0 and each C, four at C = 0 and each A =
    ±90°, 72 in all, with the labels 1 to 20. Only faces that the probe can reach are planned: on
    every move ball and stem keep clear of the artefact, its stem and the table, wherever within
    its tolerance the artefact stands (`Artefact`), and an approach then meets the face that is
    meant; a position at which no face can be reached is left out. The machine is the nominal one
    with its known errors. Commands are rounded to the resolution of the axes.

    Parameters
    ----------
    setup
        Machine, artefact, probe, resolution and the measures of ``[plan]`` and ``[table]``.
    c_deg, a_deg, b_deg
        Positions of the rotary axes, in degrees. Those of the axis that turns the work against the
        tool (the one under the artefact, or C of a head) are with the table top towards the spindle
        (A = 0 on a ``trt-ca``); (0, 90, 180, 270) unless given. Those of the axis that tilts are
        with the other at zero; ±90° from there unless given.
    feeds_mm_min
        Feeds of the approaches; with several every touch is made at each. Touches are recorded at
        `slow_feed_mm_min` of ``[plan]``, where it is given: there is one then.
    both_senses
        Approach every position of the axes from both senses of turning. Feeds and senses take
        turns, so that two feeds and both senses double the plan, not quadruple it.
    repeats
        How often all of it is done.
    positions_deg
        Further pairs (tilting axis, turning axis) beyond the two cycles.
    layout
        Of the cross at ±90°: touches 17 and 20 on the side faces that look up ("side"), or on the
        top faces of the same arms ("top"); the paper's text allows both.
    all_faces
        At ±90° touch every reachable face of the cross, not only the paper's four.
    dither
        Start each approach up to one tick further back, by another part of it each time. Readings
        of a control that looks at the probe once in a servo period lie on a grid of ticks counted
        from the start; from one start all touches alike round alike, and look like errors of the
        machine. Where the set-up knows no tick, it is taken as that of 1 ms.

    Returns
    -------
    Touches
        In the order of measurement: commanded positions, expected ball centre at the trigger,
        approach direction and start, `cycle`, `point`, feed, senses of turning, and the time at
        which the program touches, pauses not counted (:func:`probing_program`). C is always
        approached from the same sense (of a round); a tilting axis goes the straight way unless
        `both_senses`.

    Raises
    ------
    InputError
        Angles, feeds or repeats that are no numbers or missing, an axis that the machine lacks; a
        clearance or an overtravel within the tolerance of the artefact's place.
    DataError
        No face can be reached; several feeds beside `slow_feed_mm_min`; a move beyond the range of
        an axis in the set-up.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> plan = tn.plan(setup)
    >>> len(plan)
    72
    >>> sorted(set(plan.c_deg.tolist()))
    [0.0, 90.0, 180.0, 270.0]
    """
    chain = Chain(setup)
    if doubt := size_doubt(setup.machine.errors, {}):
        warnings.warn(f"plan, [machine.errors]: got {doubt}", UserWarning, stacklevel=3)
    given = {"A": a_deg, "B": b_deg, "C": c_deg}
    for letter, angles in given.items():
        if angles is not None and letter not in chain.letters:
            raise InputError(
                f"{letter.lower()}_deg: got angles, expected none: {chain.name} are its rotary axes"
            )
    turn, tilt = _default_angles(chain, given)
    for feed in feeds_mm_min if not isinstance(feeds_mm_min, str) else ():
        if isinstance(feed, int | float) and not 0 < feed < float("inf"):
            raise InputError(f"feeds_mm_min: got {feed!r}, expected positive numbers")
    feeds = _numbers("feeds_mm_min", feeds_mm_min, 1)
    check_feeds_recorded(feeds, setup)
    sense = dict(zip(chain.letters, chain.senses.tolist(), strict=True))
    turn_sense, tilt_sense = (sense.get(x or "", 1.0) for x in (chain.turning, chain.tilting))
    names = [f"{(x or '').lower()}_deg" for x in (chain.turning, chain.tilting)]
    stops = _length(turn) + _length(tilt) + _length(positions_deg)
    _few_enough(stops * max(_length(feeds_mm_min), 1) * _count(repeats), names)
    with _doubts_named(setup):
        found = arrangement(setup).plan(
            turn_deg=_angles(names[0], turn, turn_sense),
            tilt_deg=_angles(names[1], tilt, tilt_sense),
            pairs_deg=[(t * tilt_sense, c * turn_sense) for t, c in positions_deg],
            feeds_mm_min=feeds,
            both_senses=both_senses,
            repeats=_count(repeats),
            linear_um=setup.resolution.linear_um,
            rotary_arcsec=setup.resolution.rotary_arcsec,
            layout=layout,
            all_faces=all_faces,
        )
    touches = _touches(chain, _dithered(setup, found) if dither else found)
    cycle = cycle_of(touches, setup)
    cycle.check_ranges()
    return touches.with_columns(time_s=cycle.times()[0])


@contextmanager
def _doubts_named(setup: Setup) -> Iterator[None]:
    """Add lengths that are likely in another unit to a DataError about faces out of reach."""
    try:
        yield
    except DataError as error:
        if not (doubts := length_doubts(setup)):
            raise
        raise DataError(f"{error}. Likely cause: {' '.join(doubts)}") from None


def _default_angles(
    chain: Chain, given: Mapping[str, Sequence[float] | None]
) -> tuple[Sequence[float], Sequence[float]]:
    """Angles of the turning and of the tilting axis: as given, or the paper's."""
    turn = given[chain.turning] if chain.turning else ()
    tilt = given[chain.tilting] if chain.tilting else ()
    if turn is None:
        turn = (0, 90, 180, 270)
    if tilt is None and chain.tilting is not None:
        level = chain.level_deg * chain.senses[chain.letters.index(chain.tilting)]
        tilt = (level + 90, level - 90) if chain.turning else (0, 90, -90)
    return turn, () if tilt is None else tilt


def _touches(chain: Chain, found: Mapping[str, Any]) -> Touches:
    """Return the core's plan as touches, positions and senses in the control's signs."""
    columns: dict[str, object] = {}
    turned = chain.to_control(found["sense"])
    for letter, positions in chain.to_control(found["rotary_deg"]).items():
        columns[f"{letter.lower()}_deg"] = positions
        columns[f"{letter.lower()}_dir"] = turned[letter].astype(np.int64)
    for index, axis in enumerate("xyz"):
        columns[f"{axis}_mm"] = found["contact_mm"][:, index]
        columns[f"dir_{axis}"] = found["direction"][:, index] + 0.0
        columns[f"start_{axis}_mm"] = found["start_mm"][:, index]
    for name in ("cycle", "point", "feed_mm_min"):
        columns[name] = found[name]
    return Touches(columns)


def _dithered(setup: Setup, found: Mapping[str, Any]) -> Mapping[str, Any]:
    """Start 0 to 1 tick further back, the same for the same plan, rounded like commands."""
    feed = found["feed_mm_min"]
    ticks = setup.probe.ticks_um(feed)
    ticks = np.where(ticks > 0, ticks, USUAL_PERIOD_MS * feed / 60.0)
    back = 1e-3 * ticks * np.random.default_rng(DITHER_SEED).uniform(size=len(feed))
    start = np.asarray(found["start_mm"] - back[:, None] * found["direction"])
    step = 1e-3 * setup.resolution.linear_um
    return {**found, "start_mm": step * np.round(start / step) if step else start}


def _few_enough(stops: int, names: Sequence[str]) -> None:
    """Refuse a plan with more stops of the rotary axes than a measurement has."""
    if stops > MAX_STOPS:
        raise InputError(
            f"{', '.join(names)}, feeds_mm_min, repeats: got more than {MAX_STOPS:,} "
            "stops of the rotary axes together, expected fewer"
        )


def _length(values: Sequence[object]) -> int:
    return len(values) if hasattr(values, "__len__") else 0


def _numbers(what: str, values: Sequence[float], factor: float) -> list[float]:
    try:
        return [float(value) * factor for value in values]
    except (TypeError, ValueError):
        raise InputError(f"{what}: got {values!r}, expected a sequence of numbers") from None


def _angles(what: str, values: Sequence[float], factor: float) -> list[float]:
    angles = _numbers(what, values, factor)
    for angle in angles:
        if not abs(angle) <= MAX_DEG:
            raise InputError(
                f"{what}: got {angle * factor:g}, expected angles within ±{MAX_DEG:g}°"
            )
    return angles


def _count(repeats: int) -> int:
    if not isinstance(repeats, int) or isinstance(repeats, bool) or repeats < 1:
        raise InputError(f"repeats: got {repeats!r}, expected a whole number from 1")
    return repeats
