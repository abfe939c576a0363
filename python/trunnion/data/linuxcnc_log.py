"""The log of a probing program of LinuxCNC, read together with the plan that it came from.

Programs of :func:`trunnion.probing_program` append one line a touch: its number, the feed it was
recorded at, and X Y Z A B C. A line in front of each run names the plan by a hash of its columns,
so that one log may have runs of several plans, a log without any of the plan is refused, and a run
that was stopped can be gone on with.

Earlier programs wrote, between ``(PROBEOPEN file)`` and ``(PROBECLOSE)``, LinuxCNC's own lines:
nine numbers ``X Y Z A B C U V W`` with six decimals, in the order of the program. LinuxCNC leaves a
line out when all nine are exactly those of the touch before; the log is then refused, as the
touches behind it do not lie where they were planned.

Positions are in the program's unit (mm under G21, which the programs of a plan set) and in its
work offset, tool length taken off: its origin has to be that of the machine frame.
"""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from trunnion.base.arguments import checked
from trunnion.base.input import file_bytes
from trunnion.base.units import Floats
from trunnion.data.frame import COLUMNS, ControlFrame
from trunnion.data.linuxcnc_runs import NUMBERED, RUN, RUN_LINE, Log, Run
from trunnion.data.touches import BESIDE_MM, ROTARY_AXES, Touches, across_mm
from trunnion.files.columns import LARGEST, SMALLEST
from trunnion.files.recognised import Recognised
from trunnion.files.text import Source, decode
from trunnion.setup import Setup

NAMES = ("X", "Y", "Z", "A", "B", "C", "U", "V", "W")
HASHED = frozenset(
    f"{prefix}{axis}{unit}"
    for prefix, axes, unit in (
        ("", "abc", "_deg"), ("", "abc", "_dir"), ("", "xyz", "_mm"), ("dir_", "xyz", ""),
        ("start_", "xyz", "_mm"), ("", ("feed",), "_mm_min"),
    )
    for axis in axes
)  # fmt: skip
"""Columns that make a plan what it is."""

ROTARY_TOLERANCE_DEG = 0.001
"""How far a logged rotary position may be from the planned one: ten steps of 0.36 arcsec."""

DISTANCE_MM = 5.0
"""How far a touch may be from the planned one; the contract's limit for touches off the surface."""
FEWEST = 4  # touches that tell where the ball was
OTHER_TOUCH = ": is it a touch of another program, or was its line changed?"


def refuse_probe_log(source: Source) -> None:
    """Raise FileFormatError for a log of a probing program, which is no data without its plan."""
    lines = enumerate(source.lines)
    first = next((i for i, line in lines if line.lstrip().startswith(RUN)), None)
    if first is not None:
        raise source.error(
            first,
            0,
            "got the log of a probing program, expected the touches that are made of it and its "
            f"plan (tn.read_probe_log; trunnion touches PLAN {source.name} SETUP -o measured.csv)",
        )


@checked
def read_probe_log(path: str | PathLike[str], plan: Touches, setup: Setup | None = None) -> Touches:
    """Read the log of a plan's probing program: the plan with the recorded positions in it.

    Parameters
    ----------
    path
        Log that a program of :func:`trunnion.probing_program` wrote, or nine numbers a touch
        between PROBEOPEN and PROBECLOSE in the order of the program; mm and deg. Blank lines and
        lines that begin with ``#`` or ``;`` are skipped.
    plan
        The plan that the program came from. Everything but the recorded position and the feed that
        it was recorded at is taken from it, commanded rotary positions and `time_s` (where
        planned) too.
    setup
        Its `[control] centre_mm` is where the work offset should have been.

    Returns
    -------
    Touches
        The touches that are in the log, in their order: of a run that was stopped those before,
        without one whose line in a numbered log is cut off, with fewer fields or decimals and no
        end of line, which `recognised` says. Their places are the lines of the log, with the
        touch's number.
        The frame that the control had stands in the columns `wcs_x_mm` to `control_corrected`,
        where the log says it.
        Numbered logs: of the last measurement, which is a run from touch 1 and those that went on
        with it; a touch that was made again counts as it was made last. An axis that is whole turns
        from the plan is at the same posture, but did not turn as planned: its `_dir` column is left
        out, and `recognised` says so. `recognised` says which
        measurements stand before it, which other plans the log has runs of, and which lines before
        the first run are of none; and what of the work offset keeps the errors that are identified
        from being compensated: a place that is not `centre_mm`, a rotary axis that it shifts, or
        corrections that were on.

    Raises
    ------
    FileFormatError
        If a line is not as it should be, runs of one measurement had not the same work offset and
        tool length, a touch stands before the first run, the log has no run of the plan, no touch
        or more than were planned, a rotary position differs from the plan's by more than 0.001 deg
        and is no whole turn from it,
        an axis that the plan lacks is not at 0, or a touch is more than 5 mm from the planned one,
        or more than 0.5 mm beside the line of its approach.
        The message names line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> from pathlib import Path
    >>> plan = tn.plan(tn.Setup(tn.Artefact("cross")))[:1]
    >>> _ = Path("touches.log").write_text("0.0 -37.5 26.002 0.0 0.0 0.0 0.0 0.0 0.0")
    >>> tn.read_probe_log("touches.log", plan).z_mm
    array([26.002])
    """
    log = _log(path, plan)
    notes: tuple[str, ...] = ()
    frame = ControlFrame()
    if log.heads:
        centre_mm = None if setup is None else setup.control.centre_mm
        entries, notes, frame = _numbered(log, plan, centre_mm)
    else:
        entries = _in_order(log, plan)
    _check(log, entries, plan)
    rows = np.array([entry.row for entry in entries], dtype=np.intp)
    logged = np.array([entry.values for entry in entries])
    x_mm, y_mm, z_mm = logged[:, :3].T
    columns = dict.fromkeys(COLUMNS) | frame.columns(len(rows))
    made = plan[rows].with_columns(x_mm=x_mm, y_mm=y_mm, z_mm=z_mm, **columns)
    feeds = [entry.feed for entry in entries]
    if None not in feeds:
        made = made.with_columns(feed_mm_min=np.array(feeds, dtype=float))
    for axis in _wrapped(entries, plan):
        made, note = _without_sense(made, axis, log)
        notes += (note,)
    taken = Recognised("the log of a probing program", "Touches", separator=" ", notes=notes)
    return made.read_from(log.name, [entry.line + 1 for entry in entries], taken, rows + 1)


def logged_hashes(path: str | PathLike[str]) -> list[str]:
    """Hash of the plan of each run in a log."""
    text = decode(str(path), file_bytes(path))
    return [found["hash"] for found in re.finditer(RUN_LINE, text)]


def _log(path: str | PathLike[str], plan: Touches) -> Log:
    name = str(path)
    axes = tuple(letter.upper() for letter in plan.rotary_deg)
    return Log(name, decode(name, file_bytes(path)).split("\n"), axes)


def logged_frame(path: str | PathLike[str], plan: Touches) -> dict[str, str]:
    """Return work offset and tool length of the last run of a plan in a log, and its kinematics."""
    log = _log(path, plan)
    if not log.heads:
        raise log.error(0, 0, f"got no run of a probing program ({RUN} ...), expected one")
    ours, _ = log.of_plan(log.runs()[0], plan_hash(plan))
    frame = log.frame(ours[-1])
    if not frame:
        said = "got a run that does not say its work offset and tool length, expected them behind "
        raise log.error(ours[-1].line, 0, said + "its first line: it cannot be compared with them")
    return frame


def logged_touches(path: str | PathLike[str], plan: Touches) -> frozenset[int]:
    """Return the numbers of the touches that the last measurement of a plan has in a log."""
    log = _log(path, plan)
    if not log.heads:
        return frozenset()
    runs = log.runs()[0]
    ours, _ = log.of_plan(runs, plan_hash(plan))
    found, *_ = _last_measurement(log, runs, ours, plan)
    return frozenset(row + 1 for row in found)


def probe_log_of(plan: Touches, measured: Touches, name: str) -> str:
    """Return what the program of a plan would log: all its touches in one run.

    plan, measured: As planned, and with the positions and feeds that were recorded, row by row.
    name: Of the plan, in the first line.
    """
    head = f"{RUN} 1 plan={name} hash={plan_hash(plan)} touches={len(plan)} from=1"
    joints = _planned_joints(plan)[:, :6]
    joints[:, :3] = measured.position_mm
    feeds = measured.columns["feed_mm_min"].tolist()
    lines = [
        f"{number} {feed:.6f} " + " ".join(f"{value + 0.0:.6f}" for value in values)
        for number, (feed, values) in enumerate(zip(feeds, joints.tolist(), strict=True), 1)
    ]
    return "\n".join([head, *lines]) + "\n"


@dataclass(frozen=True)
class _Entry:
    """A touch: its line in the file, its row in the plan, X to W, and the feed where it is said."""

    line: int
    row: int
    values: list[float]
    feed: float | None


def _wrapped(entries: Sequence[_Entry], plan: Touches) -> list[str]:
    """Return the rotary axes that are whole turns from where they were planned."""
    planned = _planned_joints(plan)[[entry.row for entry in entries]]
    off = np.abs(np.array([entry.values for entry in entries]) - planned)
    return [axis for axis in plan.rotary_deg if off[:, NAMES.index(axis.upper())].max() > 180.0]


def _without_sense(made: Touches, axis: str, log: Log) -> tuple[Touches, str]:
    """Return touches without the senses of turning of an axis that was wrapped, and a note."""
    note = (
        f"{log.file} has {axis.upper()} whole turns from the plan: the control wraps the axis "
        "(WRAPPED_ROTARY) and turned it otherwise than planned"
    )
    name = f"{axis}_dir"
    if name not in made.columns:
        return made, f"{note}."
    without = made.with_columns(**{name: None})
    return without, f"{note}; {name}, the sense of its last turn, is left out."


def _check(log: Log, entries: Sequence[_Entry], plan: Touches) -> None:
    """Check where the touches are; rotary axes of the plan to whole turns."""
    planned = _planned_joints(plan)
    is_turned = [NAMES.index(axis.upper()) for axis in plan.rotary_deg]
    for entry in entries:
        logged, expected = np.array(entry.values), planned[entry.row]
        first = 2 if entry.feed is not None else 0
        off = logged - expected
        off[is_turned] -= 360.0 * np.round(off[is_turned] / 360.0)  # the same posture
        bad = np.abs(off) > ROTARY_TOLERANCE_DEG
        bad[:3] = False
        for column in np.flatnonzero(bad)[:1].tolist():
            letter = NAMES[column]
            there = letter.lower() in plan.rotary_deg
            why = "as planned" if there else f"as the plan has no {letter} axis"
            raise log.error(
                entry.line,
                first + column,
                f"{letter} (touch {entry.row + 1}): got {logged[column]:.6f}, expected "
                f"{expected[column]:.6f} (to {ROTARY_TOLERANCE_DEG:g}), {why}"
                f"{_mirrored(entries, planned, is_turned)}",
            )
        distance = float(np.linalg.norm(off[:3]))
        if distance > DISTANCE_MM:
            x, y, z = expected[:3].tolist()
            why = _mirrored(entries, planned, is_turned) or _likely_cause(entries, plan, planned)
            axis = int(np.argmax(np.abs(off[:3])))
            raise log.error(
                entry.line,
                first + axis,
                f"{NAMES[axis]} (touch {entry.row + 1}): got a touch {distance:.3f} mm from the "
                f"planned one, expected at most {DISTANCE_MM:g} mm from ({x:.3f}, {y:.3f}, "
                f"{z:.3f}){why}",
            )
        across = across_mm(off[None, :3], plan.direction[[entry.row]])[0]
        beside, axis = float(np.linalg.norm(across)), int(np.argmax(np.abs(across)))
        if beside > BESIDE_MM:
            raise log.error(
                entry.line,
                first + axis,
                f"{NAMES[axis]} (touch {entry.row + 1}): got a touch {beside:.3f} mm beside the "
                f"line of its approach, expected at most {BESIDE_MM:g} mm, as the program moves "
                "the ball along it"
                f"{_likely_cause(entries, plan, planned) or OTHER_TOUCH}",
            )


def _mirrored(entries: Sequence[_Entry], planned: Floats, is_turned: Sequence[int]) -> str:
    """Say that all touches are as planned if some axes count the other way; else nothing.

    is_turned: Columns of the rotary axes of the plan, which count to whole turns.
    """
    logged = np.array([entry.values for entry in entries])
    limits = np.array([DISTANCE_MM] * 3 + [ROTARY_TOLERANCE_DEG] * (len(NAMES) - 3))

    def far(sign: float) -> NDArray[np.bool_]:
        off = sign * logged - planned[[entry.row for entry in entries]]
        off[:, is_turned] -= 360.0 * np.round(off[:, is_turned] / 360.0)
        return np.asarray(np.abs(off).max(axis=0) > limits)

    found = [name for name, is_far in zip(NAMES, far(1.0), strict=True) if is_far]
    if len(entries) < FEWEST or (far(1.0) & far(-1.0)).any() or not found:
        return ""
    senses = ", ".join(f"[axes.{name}] sense" for name in found if name not in NAMES[:3])
    return (
        f"; all are as planned if {' and '.join(found)} count{'s' * (len(found) == 1)} the other "
        "way: does the control's axis run the other way from that of the set-up"
        f"{f' ({senses})' if senses else ''}?"
    )


def _likely_cause(entries: Sequence[_Entry], plan: Touches, planned: Floats) -> str:
    """Say that all touches are as planned in inches, or where the ball is elsewhere; else nothing.

    The program moves the ball along the line of approach, so that what lies across it tells where
    the ball was, wherever the artefact stands.
    """
    rows = [entry.row for entry in entries]
    logged = np.array([entry.values[:3] for entry in entries])
    expected, way = planned[rows, :3], plan.direction[rows]
    for text, factor in (("in inches (G20)", 25.4), ("in mm, taken for inches", 1 / 25.4)):
        if np.linalg.norm(factor * logged - expected, axis=1).max() <= DISTANCE_MM:
            said = f"; all are where they were planned if X, Y and Z are {text}"
            return said + (", or if the plan's set-up is in inches" if factor < 1.0 else "")
    if len(rows) < FEWEST:
        return ""
    across = np.eye(3) - way[:, :, None] * way[:, None, :]
    parts = across_mm(logged - expected, way)
    moved = np.linalg.lstsq(across.reshape(-1, 3), parts.reshape(-1), rcond=None)[0]
    apart = np.linalg.norm(parts - across @ moved, axis=1).max()
    if apart > BESIDE_MM or np.linalg.norm(moved) <= BESIDE_MM:
        return ""
    x, y, z = np.round(moved, 3) + 0.0
    tip = ", or to the tip instead of the ball's centre" if max(abs(x), abs(y)) < 0.1 else ""
    return (
        f"; all are on their lines if the ball was ({x:g}, {y:g}, {z:g}) mm from where it was "
        f"planned: was the work offset another, or the tool's length (of another tool{tip})?"
    )


def _in_order(log: Log, plan: Touches) -> list[_Entry]:
    """Return the touches of a log of PROBEOPEN, the first of which are the plan's first."""
    data = log.filled
    entries = [_Entry(i, row, log.numbers(i, NAMES), None) for row, i in enumerate(data)]
    if len(data) > len(plan):
        why = f"got {len(data)} touches, expected {len(plan)}, one for each touch of the plan"
        raise log.error(data[len(plan)], 0, why)
    if not data:
        raise log.error(len(log.lines) - 1, 0, "got no touches, expected those of the plan")
    return entries


def _touches(count: int) -> str:
    return "touch" if count == 1 else "touches"


def _numbered(
    log: Log, plan: Touches, centre_mm: Sequence[float] | None
) -> tuple[list[_Entry], tuple[str, ...], ControlFrame]:
    """Return the touches of the last measurement of a plan, notes on others, and its frame."""
    runs, skipped = log.runs()
    ours, others = log.of_plan(runs, plan_hash(plan))
    found, before, cut = _last_measurement(log, runs, ours, plan)
    if not found:
        none = "got no touches, expected those of the plan"
        raise log.error(len(log.lines) - 1, 0, "; ".join((none, *before)))
    lines = {entry.line for entry in found.values()}
    used = [run for run in ours if not lines.isdisjoint(run.touches)]
    log.check_frame(used)
    known = used[-1]  # all say the same
    notes = (*skipped, *others, *before, *cut, *log.said_of_frame(known, centre_mm))
    return list(found.values()), notes, ControlFrame.of_words(log.frame(known))


def _last_measurement(
    log: Log, runs: Sequence[Run], ours: Sequence[Run], plan: Touches
) -> tuple[dict[int, _Entry], tuple[str, ...], tuple[str, ...]]:
    """Return touches by row of the plan, in their order, and notes on what else there is."""
    last = runs[-1].touches[-1:]
    cut = log.cut(last[0]) if last and ours[-1] is runs[-1] else ()
    found: dict[int, _Entry] = {}
    earlier: list[tuple[int, int]] = []
    begin = ours[0].line
    for run in ours:
        if run.first == 1:
            earlier += [(begin, len(found))] if found else []
            found, begin = {}, run.line
        for i in run.touches:
            if not (cut and i == last[0]):
                entry = _entry(log, i, plan)
                found.pop(entry.row, None)
                found[entry.row] = entry
    return found, _before(log, earlier, begin, len(found)), cut


def _entry(log: Log, line: int, plan: Touches) -> _Entry:
    """Return the touch of a line with a number."""
    number, feed, *values = log.numbers(line, NUMBERED)
    if number != int(number) or not 1 <= number <= len(plan):
        message = f"touch: got {number:g}, expected a number from 1 to {len(plan)}"
        raise log.error(line, 0, message)
    if not SMALLEST <= feed <= LARGEST["mm/min"]:
        allowed = f"a number from {SMALLEST:g} to {LARGEST['mm/min']:g}"
        raise log.error(line, 1, f"feed: got {feed:g}, expected {allowed}")
    return _Entry(line, int(number) - 1, [*values, 0.0, 0.0, 0.0], feed)


def _before(
    log: Log, earlier: Sequence[tuple[int, int]], begin: int, count: int
) -> tuple[str, ...]:
    """Say which measurements stand before the one that is used, and how to use them.

    earlier: Of each the line it begins with and how many touches it has.
    begin, count: The same of the one that is used.
    """
    if not earlier:
        return ()
    others = ", ".join(f"{n} {_touches(n)} from line {line + 1} on" for line, n in earlier)
    return (
        f"{log.file} has {len(earlier) + 1} measurements (a run from touch 1 begins a new one): "
        f"the last is used, {count} {_touches(count)} from line {begin + 1} on; not used: "
        f"{others}. To use one of those, read a copy of the log that ends with it.",
    )


def _planned_joints(plan: Touches) -> Floats:
    """Return what the log should say, in its columns; X, Y and Z as planned, absent axes 0."""
    planned = np.zeros((len(plan), len(NAMES)))
    planned[:, :3] = plan.position_mm
    for axis in ROTARY_AXES:
        if axis in plan.rotary_deg:
            planned[:, NAMES.index(axis.upper())] = plan.rotary_deg[axis]
    return planned


def plan_hash(plan: Touches) -> str:
    """Twelve hexadecimal digits that name a plan: its positions, directions, starts and feeds."""
    names = sorted(HASHED.intersection(plan.columns))
    text = ";".join(f"{name}={_digits(plan.columns[name])}" for name in names)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _digits(values: Floats) -> str:
    return ",".join(f"{value + 0.0:.6f}" for value in values.tolist())
