"""The lines of a probe log of LinuxCNC, and the runs of probing programs that are in it.

A control appends to a log, whatever is in it: runs of this plan, of others, and lines of programs
that are none of ours.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trunnion.base.errors import FileFormatError
from trunnion.data.frame import GOT_EXPECTED, MODES, ControlFrame, differences, listed
from trunnion.files.columns import parse_number
from trunnion.setup.control import WORK_OFFSETS

NUMBERED = ("touch", "feed", *"XYZABC")
COUNTS = {8: "eight", 9: "nine"}

RUN = "trunnion-touches"
"""How the first line of a run begins."""
RUN_LINE = (
    rf"{RUN} 1 plan=(?P<plan>\S+) hash=(?P<hash>[0-9a-f]{{12}}) touches=\d+ "
    r"from=(?P<first>\d{1,9})"
)
FRAME_LINE = re.compile(r"\s*;\s*(G5|.*\btool length\b)", re.IGNORECASE)
"""How a line begins that says the control's frame: a run has one behind its first line."""
FIRST_PARTS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("wcs", WORK_OFFSETS), ("x", ()), ("y", ()), ("z", ()),
    ("", ("tool",)), ("", ("length",)), ("length", ()),
)  # fmt: skip
"""Words of a frame by name, with what they may be, or none: a number. Those of earlier programs
were no more; then come letter and shift of each rotary axis, and the kinematics."""
END = "the end of the line"
CALLED = {"length": "tool length", "mode": "kinematics", "": "frame of the control"}
"""What people call parts of a frame that are none of the work offset."""
MAX_OTHERS = 5
"""Other plans that a message names; of more it says how many."""


@dataclass(frozen=True)
class Run:
    """One run of a program: its first line, what that says, and the lines of its touches.

    line: From 0.
    """

    line: int
    plan: str
    plan_hash: str
    first: int
    touches: tuple[int, ...]


@dataclass(frozen=True)
class Log:
    """The lines of a log, and its errors.

    axes: Letters of the rotary axes of the plan.
    """

    name: str
    lines: list[str]
    axes: tuple[str, ...]

    @property
    def file(self) -> str:
        """Name of the file without its folders."""
        return Path(self.name).name

    @property
    def filled(self) -> list[int]:
        """Lines that are neither blank nor comments."""
        return [
            i for i, line in enumerate(self.lines) if line.strip() and line.lstrip()[0] not in "#;"
        ]

    def error(self, line: int, field: int, message: str) -> FileFormatError:
        """Return the error at a field of a line, both counted from 0."""
        at = [match.start() for match in re.finditer(r"\S+", self.lines[line])] or [0]
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

    def runs(self) -> tuple[list[Run], tuple[str, ...]]:
        """Return the runs, and notes on lines that are left out.

        Touches before the first line of a run are refused: whose they are is not known.
        """
        lines, heads = self.filled, self.heads
        notes: tuple[str, ...] = ()
        if len(heads) > 1 and heads[-1] == len(self.lines) - 1:
            # Without an end of line it may be cut, and nothing was measured behind it.
            notes = (f"Line {heads.pop() + 1} of {self.file} is cut off: a run without touches.",)
        strange = [i for i in lines if i < heads[0]]
        for i in strange:
            if self._is_touch(i):
                raise self.error(
                    i, 0,
                    f"got a touch before the first line of a run ({RUN} ..., line {heads[0] + 1}), "
                    "expected that line before it: was the beginning of the log cut off?",
                )  # fmt: skip
        ends = [*heads[1:], len(self.lines)]
        found = []
        for head, end in zip(heads, ends, strict=True):
            found.append(self._run(head, [i for i in lines if head < i < end]))
            if self._head(head):
                notes += (
                    f"Line {head + 1} of {self.file} begins with one that was cut off, before the "
                    "first line of a run: that is left out.",
                )
        return found, (*self._skipped(strange), *notes)

    @property
    def heads(self) -> list[int]:
        """Lines in which runs begin."""
        return [i for i in self.filled if self._head(i) is not None]

    def _head(self, line: int) -> int | None:
        """Where the first line of a run begins in a line; None: nowhere.

        In the middle where the control was stopped while it wrote a line: the next run appends.
        """
        text = self.lines[line]
        if text.lstrip().startswith(RUN):
            return 0
        match = re.search(rf"{RUN_LINE}\s*$", text) if RUN in text else None
        return match.start() if match else None

    def _run(self, head: int, touches: Iterable[int]) -> Run:
        text = self.lines[head][self._head(head) :].strip()
        match = re.fullmatch(RUN_LINE, text)
        if match is None:
            expected = f"expected the first line of a run: {RUN} 1 ..."
            raise self.error(head, 0, f"got {text[:60]!r}, {expected}")
        return Run(head, match["plan"], match["hash"], int(match["first"]), tuple(touches))

    def _is_touch(self, line: int) -> bool:
        """Whether a line has the numbers of a touch."""
        values = [parse_number(field) for field in self.lines[line].split()]
        return len(values) == len(NUMBERED) and None not in values

    def _skipped(self, lines: Sequence[int]) -> tuple[str, ...]:
        if not lines:
            return ()
        many = f"1 line ({lines[0] + 1})"
        if len(lines) > 1:
            many = f"{len(lines)} lines ({lines[0] + 1} to {lines[-1] + 1})"
        return (f"{many} of {self.file} before its first run are of no probing program: skipped.",)

    def of_plan(self, runs: Sequence[Run], plan_hash: str) -> tuple[list[Run], tuple[str, ...]]:
        """Return the runs of a plan, and a note on those of others."""
        ours = [run for run in runs if run.plan_hash == plan_hash]
        others = [run for run in runs if run.plan_hash != plan_hash]
        if not ours:
            raise self.error(
                runs[0].line,
                0,
                f"got the log of {_plans(others)}, expected that of this plan, hash {plan_hash}: "
                "is it another plan, or was it changed since its program was written?",
            )
        if not others:
            return ours, ()
        count = "1 run" if len(others) == 1 else f"{len(others)} runs"
        return ours, (f"{self.file} also has {count} of {_plans(others)}: not read.",)

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
            f"Line {last + 1} of {self.file} is cut off ({short}, no end of line): its touch is "
            "left out.",
        )

    def frame(self, run: Run) -> dict[str, str]:
        """Return the frame of a run, as the line behind its first says; empty where none does."""
        line = self._frame_line(run)
        text = self.lines[line]
        if FRAME_LINE.match(text) is None:
            return {}
        words, parts = text.replace(";", " ", 1).split(), [*FIRST_PARTS]
        if len(words) > len(parts):
            for x in sorted(self.axes, key=[*words, *self.axes].index):  # in any order
                parts += [("", (x,)), (x.lower(), ())]
            parts.append(("mode", MODES))
        frame = {}
        for at, (part, allowed) in enumerate([*parts, ("", (END,))]):
            word = words[at] if at < len(words) else END
            number = parse_number(word)
            if not (word in allowed if allowed else number is not None and np.isfinite(number)):
                got, expected = END if word == END else repr(word), ", ".join(allowed) or "a number"
                field = at + (text.split()[0] == ";")
                raise self.error(line, field, f"{_called(part)}: got {got}, expected {expected}")
            if part:
                frame[part] = word
        return frame

    def said_of_frame(self, run: Run, centre_mm: Sequence[float] | None) -> tuple[str, ...]:
        """Say what keeps what is identified in the frame of a run from being compensated."""
        frame, line = self.frame(run), self._frame_line(run) + 1
        found = ControlFrame.of_words(frame).hindrances(centre_mm, frame.get("wcs", ""))
        return tuple(f"Line {line} of {self.file}: {said}" for said in found)

    def _frame_line(self, run: Run) -> int:
        return min(run.line + 1, len(self.lines) - 1)

    def check_frame(self, runs: Iterable[Run]) -> None:
        """Check that runs of which touches are used had one work offset and tool length.

        And that all of them say as much: nothing is known of the others.
        """
        first: tuple[Run, dict[str, str]] | None = None
        for run in runs:
            frame = self.frame(run)
            if first is None:
                first = (run, frame)
                continue
            self._check_said(first, (run, frame))
            apart = differences(first[1], frame)
            if apart:
                said = [one._replace(name=_called(one.name)) for one in apart]
                raise self.error(
                    self._frame_line(run),
                    0,
                    f"{listed(said, GOT_EXPECTED)} as in line "
                    f"{self._frame_line(first[0]) + 1}: the control was "
                    "changed between two runs of one measurement, whose touches lie in two "
                    "frames. Measure again from touch 1 with one work offset and tool length, or "
                    "read a copy of the log without one of the runs",
                )

    def _check_said(
        self, one: tuple[Run, dict[str, str]], other: tuple[Run, dict[str, str]]
    ) -> None:
        """Refuse the frames of two runs of which one says what the other does not."""
        for (run, frame), (full, said) in ((one, other), (other, one)):
            if lacking := [_called(part) for part in said if part not in frame]:
                line, there = self._frame_line(run), self._frame_line(full) + 1
                raise self.error(
                    line if frame else run.line,
                    0,
                    f"got a run that does not say {', '.join(lacking)}, expected it as in line "
                    f"{there}: nothing is known of whether the touches of one measurement lie in "
                    f"one frame. If they do, put a copy of line {there} "
                    f"{'in place of this line' if frame else 'behind this line'}; if not, measure "
                    "again from touch 1, or read a copy of the log without one of the runs",
                )


def _called(part: str) -> str:
    """Return what people call a part of a frame."""
    return CALLED.get(part, f"work offset {part}")


def spans(numbers: Iterable[int]) -> str:
    """Numbers as people list them: ``3, 31 to 39``."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and runs[-1][-1] == number - 1:
            runs[-1][1:] = [number]
        else:
            runs.append([number])
    return ", ".join(" to ".join(map(str, run)) for run in runs)


def _plans(runs: Sequence[Run]) -> str:
    """Name the plans of runs, each with the line of its first one."""
    found: dict[str, str] = {}
    for run in runs:
        where = f"plan {run.plan}, hash {run.plan_hash} (line {run.line + 1})"
        found.setdefault(run.plan_hash, where)
    named = list(found.values())[:MAX_OTHERS]
    more = len(found) - len(named)
    return "; ".join(named) + (f"; and {more} more" if more else "")
