"""The log of a probing program of LinuxCNC, read together with the plan that it came from.

Programs of :func:`trunnion.probing_program` append one line a touch: its number, the feed it was
recorded at, and X Y Z A B C. A line in front of each run names the plan by a hash of its columns,
so that a log of another plan is refused and a run that was stopped can be gone on with.

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
from pathlib import Path

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import FileFormatError
from trunnion.base.input import file_bytes
from trunnion.base.units import Floats
from trunnion.data.touches import ROTARY_AXES, Touches
from trunnion.files.columns import LARGEST, LEAST, parse_number
from trunnion.files.recognised import Recognised
from trunnion.files.text import Source, decode

NAMES = ("X", "Y", "Z", "A", "B", "C", "U", "V", "W")
NUMBERED = ("touch", "feed", *"XYZABC")
COUNTS = {8: "eight", 9: "nine"}

RUN = "trunnion-touches"
"""How the first line of a run begins."""
RUN_LINE = (
    rf"{RUN} 1 plan=(?P<plan>\S+) hash=(?P<hash>[0-9a-f]{{12}}) touches=\d+ "
    r"from=(?P<first>\d{1,9})"
)

STATE_LINE = (
    r"\s*;\s*(?P<wcs>G5\S+) (?P<x>\S+) (?P<y>\S+) (?P<z>\S+) tool length (?P<length>\S+)\s*"
)
"""What a run says of the control behind its first line."""
SAME_FRAME_MM = 1e-4  # far less than a touch repeats to

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


def refuse_probe_log(source: Source) -> None:
    """Raise FileFormatError for a log of a probing program, which is no data without its plan."""
    if source.lines[0].startswith(RUN):
        raise source.error(
            0,
            0,
            "got the log of a probing program, expected the touches that are made of it and its "
            f"plan (tn.read_probe_log; trunnion touches PLAN {source.name} SETUP -o measured.csv)",
        )


@checked
def read_probe_log(path: str | PathLike[str], plan: Touches) -> Touches:
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

    Returns
    -------
    Touches
        The touches that are in the log, in their order: of a run that was stopped those before,
        without one whose line in a numbered log is cut off, with fewer fields or decimals and no
        end of line, which `recognised` says. Their places are the lines of the log, with the
        touch's number.
        Numbered logs: of the last measurement, which is a run from touch 1 and those that went on
        with it; a touch that was made again counts as it was made last. `recognised` says which
        measurements stand before it.

    Raises
    ------
    FileFormatError
        If a line is not as it should be, runs of one measurement had not the same work offset and
        tool length, the log is of another plan, has no touch or more than were planned, a rotary
        position differs from the plan's by more than 0.001 deg, an axis that the plan lacks is not
        at 0, or a touch is more than 5 mm from the planned one. The message names line and column.

    Examples
    --------
    >>> import trunnion as tn
    >>> from pathlib import Path
    >>> plan = tn.plan(tn.Setup(tn.Artefact("cross")))[:1]
    >>> _ = Path("touches.log").write_text("0.0 -37.5 26.002 0.0 0.0 0.0 0.0 0.0 0.0")
    >>> tn.read_probe_log("touches.log", plan).z_mm
    array([26.002])
    """
    name = str(path)
    lines = decode(name, file_bytes(path)).split("\n")
    data = [i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#;"]
    log = _Log(name, lines)
    notes: tuple[str, ...] = ()
    if data and lines[data[0]].lstrip().startswith(RUN):
        notes = log.cut(data[-1]) if len(data) > 1 else ()
        entries, before = _numbered(log, data[:-1] if notes else data, plan)
        notes = (*before, *notes)
    else:
        entries = _in_order(log, data, plan)
    log.check(entries, plan)
    rows = np.array([entry.row for entry in entries], dtype=np.intp)
    logged = np.array([entry.values for entry in entries])
    x_mm, y_mm, z_mm = logged[:, :3].T
    made = plan[rows].with_columns(x_mm=x_mm, y_mm=y_mm, z_mm=z_mm)
    feeds = [entry.feed for entry in entries]
    if None not in feeds:
        made = made.with_columns(feed_mm_min=np.array(feeds, dtype=float))
    taken = Recognised("the log of a probing program", "Touches", separator=" ", notes=notes)
    return made.read_from(name, [entry.line + 1 for entry in entries], taken, rows + 1)


def logged_hash(path: str | PathLike[str]) -> str | None:
    """Hash of the plan that the first run of a log names; None without such a line."""
    found = re.search(RUN_LINE, decode(str(path), file_bytes(path)))
    return found["hash"] if found else None


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


@dataclass(frozen=True)
class _Log:
    """The lines of a log, and its errors."""

    name: str
    lines: list[str]

    def error(self, line: int, field: int, message: str) -> FileFormatError:
        """Return the error at a field of a line, both counted from 0."""
        at = _starts(self.lines[line]) or [0]
        column = at[min(field, len(at) - 1)] + 1
        return FileFormatError(f"{self.name}:{line + 1}:{column}: {message}")

    def numbers(self, line: int, names: Sequence[str]) -> list[float]:
        """Return the numbers of a line."""
        fields = self.lines[line].split()
        if len(fields) != len(names):
            many = f"{COUNTS[len(names)]} numbers: {' '.join(names)}"
            last = min(len(fields), len(names)) - 1
            raise self.error(line, last, f"got {len(fields)} fields, expected {many}")
        values = []
        for column, field in enumerate(fields):
            value = parse_number(field)
            if value is None or not np.isfinite(value):
                message = f"{names[column]}: got {field[:60]!r}, expected a finite number"
                raise self.error(line, column, message)
            values.append(value)
        return values

    def cut(self, last: int) -> tuple[str, ...]:
        """Say that the last line, whose number is given, is cut off; nothing if it is whole.

        It has no end: the control was stopped while it wrote the line.
        """
        fields = self.lines[last].split()
        if last < len(self.lines) - 1 or len(fields) > len(NUMBERED):
            return ()
        short = f"{len(fields)} of {len(NUMBERED)} fields"
        if len(fields) == len(NUMBERED):
            digits = [len(field.partition(".")[2]) for field in fields[-2:]]
            if digits[0] <= digits[1]:
                return ()
            short = f"{digits[1]} of {digits[0]} decimals in its last field"
        return (
            f"Line {last + 1} of {Path(self.name).name} is cut off ({short}, no end of line): its "
            "touch is left out.",
        )

    def check_frame(self, runs: Sequence[int], entries: Sequence[_Entry]) -> None:
        """Check that runs of which touches are used had one work offset and tool length.

        ``runs``: their first lines.
        """
        first: tuple[int, dict[str, str]] | None = None
        for run in sorted({max(r for r in runs if r < entry.line) for entry in entries}):
            line = min(run + 1, len(self.lines) - 1)
            found = re.fullmatch(STATE_LINE, self.lines[line])
            if found is None:
                continue
            state = found.groupdict()
            if first is None:
                first = line, state
                continue
            for name, value in state.items():
                if not _alike(value, first[1][name]):
                    what = "tool length" if name == "length" else f"work offset {name}"
                    raise self.error(
                        line,
                        0,
                        f"{what}: got {value}, expected {first[1][name]} as in line "
                        f"{first[0] + 1}: the control was changed between two runs of one "
                        "measurement, whose touches lie in two frames. Measure again from touch 1 "
                        "with one work offset and tool length, or read a copy of the log without "
                        "one of the runs",
                    )

    def before(self, earlier: Sequence[tuple[int, int]], begin: int, count: int) -> tuple[str, ...]:
        """Say which measurements stand before the one that is used, and how to use them.

        earlier: Of each the line it begins with and how many touches it has.
        begin, count: The same of the one that is used.
        """
        if not earlier:
            return ()
        others = ", ".join(f"{n} {_touches(n)} from line {line + 1} on" for line, n in earlier)
        return (
            f"{Path(self.name).name} has {len(earlier) + 1} measurements (a run from touch 1 "
            f"begins a new one): the last is used, {count} {_touches(count)} from line {begin + 1} "
            f"on; not used: {others}. To use one of those, read a copy of the log that ends with "
            "it.",
        )

    def check(self, entries: Sequence[_Entry], plan: Touches) -> None:
        """Check where the touches are."""
        planned = _planned_joints(plan)
        for entry in entries:
            logged, expected = np.array(entry.values), planned[entry.row]
            first = 2 if entry.feed is not None else 0
            bad = np.abs(logged - expected) > ROTARY_TOLERANCE_DEG
            bad[:3] = False
            for column in np.flatnonzero(bad)[:1].tolist():
                letter = NAMES[column]
                there = letter.lower() in plan.rotary_deg
                why = "as planned" if there else f"as the plan has no {letter} axis"
                raise self.error(
                    entry.line,
                    first + column,
                    f"{letter} (touch {entry.row + 1}): got {logged[column]:.6f}, expected "
                    f"{expected[column]:.6f} (to {ROTARY_TOLERANCE_DEG:g}), {why}",
                )
            distance = float(np.linalg.norm(logged[:3] - expected[:3]))
            if distance > DISTANCE_MM:
                x, y, z = expected[:3].tolist()
                raise self.error(
                    entry.line,
                    first,
                    f"X (touch {entry.row + 1}): got a touch {distance:.3f} mm from the planned "
                    f"one, expected at most {DISTANCE_MM:g} mm from ({x:.3f}, {y:.3f}, {z:.3f})"
                    f"{_in_another_unit(entries, planned)}",
                )


def _alike(one: str, other: str) -> bool:
    """Whether two words of a state, or two lengths, are the same."""
    a, b = parse_number(one), parse_number(other)
    return one == other if a is None or b is None else abs(a - b) <= SAME_FRAME_MM


def _in_another_unit(entries: Sequence[_Entry], planned: Floats) -> str:
    """Say that all touches are where they were planned if they are in inches; else nothing."""
    logged = np.array([entry.values[:3] for entry in entries])
    expected = planned[[entry.row for entry in entries], :3]
    for text, factor in (("in inches (G20)", 25.4), ("in mm, taken for inches", 1 / 25.4)):
        if np.linalg.norm(factor * logged - expected, axis=1).max() <= DISTANCE_MM:
            return f"; all are where they were planned if X, Y and Z are {text}"
    return ""


def _in_order(log: _Log, data: Sequence[int], plan: Touches) -> list[_Entry]:
    """Return the touches of a log of PROBEOPEN, the first of which are the plan's first."""
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
    log: _Log, data: Sequence[int], plan: Touches
) -> tuple[list[_Entry], tuple[str, ...]]:
    """Return the touches of the last measurement in a log with numbers, and a note on others."""
    found: dict[int, _Entry] = {}
    earlier: list[tuple[int, int]] = []
    begin, runs = data[0], list[int]()
    for i in data:
        text = log.lines[i].strip()
        if text.startswith(RUN):
            runs.append(i)
            if _first_touch(log, i, text, plan) == 1:
                earlier += [(begin, len(found))] if found else []
                found, begin = {}, i
            continue
        number, feed, *values = log.numbers(i, NUMBERED)
        if number != int(number) or not 1 <= number <= len(plan):
            message = f"touch: got {number:g}, expected a number from 1 to {len(plan)}"
            raise log.error(i, 0, message)
        if not LEAST <= feed <= LARGEST["mm/min"]:
            allowed = f"a number from {LEAST:g} to {LARGEST['mm/min']:g}"
            raise log.error(i, 1, f"feed: got {feed:g}, expected {allowed}")
        row = int(number) - 1
        found.pop(row, None)
        found[row] = _Entry(i, row, [*values, 0.0, 0.0, 0.0], feed)
    if not found:
        none = "got no touches, expected those of the plan"
        said = "; ".join((none, *log.before(earlier, begin, 0)))
        raise log.error(len(log.lines) - 1, 0, said)
    log.check_frame(runs, list(found.values()))
    return list(found.values()), log.before(earlier, begin, len(found))


def _first_touch(log: _Log, line: int, text: str, plan: Touches) -> int:
    """Return the touch that a run began with, once it is known to be of this plan."""
    match = re.fullmatch(RUN_LINE, text)
    if match is None:
        raise log.error(
            line, 0, f"got {text[:60]!r}, expected the first line of a run: {RUN} 1 ..."
        )
    if match["hash"] != plan_hash(plan):
        message = (
            f"got the log of plan {match['plan']}, hash {match['hash']}, expected that of this "
            f"plan, hash {plan_hash(plan)}: is it another plan, or was it changed since its "
            "program was written?"
        )
        raise log.error(line, 0, message)
    return int(match["first"])


def _starts(line: str) -> list[int]:
    return [match.start() for match in re.finditer(r"\S+", line)]


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
