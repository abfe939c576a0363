"""Part programs corrected for the errors of a machine, for controls that cannot correct themselves.

Each move becomes one move of its own kind, or as few as keep the tool point on the work within the
tolerance of where it was programmed. Blocks without a move stay as they are.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, positive
from trunnion.base.errors import ProgramError
from trunnion.base.report import Result, Table
from trunnion.base.units import Floats
from trunnion.compensation.machine import Known
from trunnion.controls.forecast import known_errors
from trunnion.controls.tool_path import Kept, Piece, Tool, pieces
from trunnion.machine.estimate import Estimate
from trunnion.machine.sizes import size_doubt
from trunnion.nc import Moves, Program, follow
from trunnion.setup import Setup

Coordinates: TypeAlias = Literal["axes", "tcp"]
DIALECT = "linuxcnc"
RAPID_TIMES = 10.0
"""Tolerance of rapids, times that of feed moves."""
FEEDS = {93: "G93", 94: "G94"}
AXES = "XYZABC"
_WORD = re.compile(r"([A-Za-z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
_COMMENT = re.compile(r"\([^)]*\)|;.*$")
_MODES = frozenset({0, 1, 2, 3, 20, 21, 90, 90.1, 91, 91.1, 93, 94})
_STOPS = frozenset({0, 1, 2, 30, 60})


@dataclass(frozen=True, eq=False, repr=False)
class CorrectedProgram(Result):
    """A part program for a machine with errors.

    Attributes
    ----------
    text
        The program.
    moves_before, moves_after
        How many moves it had and has.
    tolerance_um
        What was asked for, on feed moves.
    before_um, left_um
        Largest distance of the tool point on the work from where it was programmed, on feed moves,
        of the program as it was and of the corrected text read again; `before_um` is None where
        program and output have different coordinates.
    minutes
        Time of the feed moves, the same before and after.
    left_out
        Effects that were found and are not in the correction, with the reason.
    notes
        What is doubtful about the errors.
    """

    text: str
    moves_before: int
    moves_after: int
    tolerance_um: float
    before_um: float | None
    left_um: float
    minutes: float
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def sentences(self) -> Sequence[str]:
        """What it corrects, in how many moves."""
        before = "" if self.before_um is None else f"{self.before_um:.3g} µm before, "
        lines = [
            f"Largest error of the tool point on the work: {before}{self.left_um:.3g} µm after "
            f"(tolerance {self.tolerance_um:g} µm), on the machine as estimated.",
            f"{self.moves_before} moves became {self.moves_after}; {self.minutes:.3g} min at feed, "
            "as before.",
        ]
        return [*lines, *(f"Not corrected: {text}." for text in self.left_out), *self.notes]

    def tables(self) -> tuple[Table, ...]:
        """Counts and errors."""
        rows = [
            ("moves", self.moves_before, self.moves_after),
            ("largest error, µm", self.before_um, self.left_um),
        ]
        return (Table.of("Corrected program", ("", "before", "after"), rows),)


@checked
def correct_program(
    setup: Setup,
    estimate: Known,
    text: str,
    *,
    given: Coordinates = "axes",
    written: Coordinates | None = None,
    origin_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    tolerance_um: float = 2.0,
    any_size: bool = False,
) -> CorrectedProgram:
    """Rewrite a part program so that the machine with these errors makes the part as programmed.

    Parameters
    ----------
    setup, estimate
        The machine, and what a measurement says of it.
    text
        Program in the dialect of LinuxCNC's mill, of the tool's centre (G40).
    given, written
        What X, Y, Z of the program, and of the result (unless given, the same), are: "axes", the
        linear axes, or "tcp", the tool point on the table (tool centre point control). "tcp" in and
        "axes" out is for a control without tool centre point control.
    origin_mm
        Zero of the program in the machine frame at zero of the rotary axes ("tcp": in the frame of
        the table, which is there then).
    tolerance_um
        Largest distance of the tool point from where it was programmed, on feed moves; ten times
        this on rapids.
    any_size
        Take location errors beyond 2 mm or 1°, too.

    Notes
    -----
    Rotary axes go where they were programmed; the tool direction is not corrected. A move in which
    they turn, or whose coordinates change, is written in G93 so that it takes the time that
    LinuxCNC gives the programmed one (F along X, Y, Z; degrees where only rotary axes move): the
    speed of the tool point is kept. Arcs stay arcs where they can.

    Raises
    ------
    ProgramError
        With line and column: what cannot be followed or corrected (tool radius compensation,
        probing, feed per revolution, a first position that is not known), also within the
        tolerance: positions are written to 0.0001 mm or degrees.
    InputError
        Errors that are not plausible; an effect that says nothing of a motion.
    DataError
        An error that the measurement does not identify.
    """
    choose("given", given, ("axes", "tcp"))
    written = given if written is None else written
    choose("written", written, ("axes", "tcp"))
    positive("tolerance_um", tolerance_um)
    known = known_errors(setup, estimate, any_size=any_size)
    known.refuse_own("a corrected program follows the model of the machine")
    tool = Tool.of(setup, known, given, written, origin_mm)
    program = Program.parse(text, DIALECT)
    moves = follow(program)
    _check(moves)
    writer = _Writer(tool, moves, 1e-3 * tolerance_um)
    lines = writer.lines(text, program)
    made = "\n".join(lines) + "\n"
    again = follow(Program.parse(made, DIALECT))
    std = estimate.std_errors if isinstance(estimate, Estimate) else {}
    return CorrectedProgram(
        made,
        len(moves),
        len(again),
        tolerance_um,
        None if given != written else 1e3 * tool.largest(moves, moves, None),
        1e3 * tool.largest(moves, again, writer.sources),
        float(np.sum(tool.minutes(moves))),
        tuple(f"{x} (moves nothing, or is no error of the machine)" for x in known.ignored),
        tuple(filter(None, [size_doubt(known.errors, std)])),
    )


def _check(moves: Moves) -> None:
    """Refuse what cannot be corrected."""
    faults = (
        (
            moves.side != 40,
            "tool radius compensation; expected the path of the tool's centre (G40)",
        ),
        (moves.code == 38, "a probing move; expected a program without"),
        (moves.feed_mode == 95, "feed per revolution; expected G93 or G94"),
    )
    for wrong, what in faults:
        for i in np.flatnonzero(wrong)[:1]:
            raise ProgramError(f"line {moves.line[i]}, column {moves.column[i]}: got {what}")


class _Writer:
    """Lines of the corrected program; `sources`: for each move written, which move it is of."""

    def __init__(self, tool: Tool, moves: Moves, tolerance_mm: float) -> None:
        self.tool = tool
        self.moves = moves
        self.tolerance_mm = tolerance_mm
        self.sources: list[Kept] = []
        self.mode: int | None = None
        self.feed: str | None = None
        self.minutes = tool.minutes(moves)

    def lines(self, text: str, program: Program) -> list[str]:
        """Return the program with each move in place of the words that made it."""
        by_block: dict[int, list[int]] = {}
        for i, block in enumerate(self.moves.block):
            by_block.setdefault(int(block), []).append(i)
        first = int(self.moves.block[0]) if len(self.moves) else len(program)
        leads = [i for i in range(first) if self._has_axes(program, i)]
        self._check_leads(leads, program)
        given = text.splitlines()
        tape = 1 if given and given[0].strip() == "%" else 0
        out = [*given[:tape], "(corrected for the errors of the machine by trunnion)"]
        out.append("G21 G90 G91.1")
        ended, unit = False, 1.0
        for index, line in enumerate(given):
            if index < tape:
                continue
            if index >= len(program) or ended:
                out.append(line)
                continue
            before, after = _words_kept(
                line, moving=index in by_block or self._has_axes(program, index)
            )
            ended = bool(
                {2.0, 30.0} & {v for letter, v, *_ in program.words(index) if letter == "M"}
            )
            out += before
            for letter, value, *_ in program.words(index):
                unit = {20.0: 25.4, 21.0: 1.0}.get(value, unit) if letter == "G" else unit
            if index in leads:
                out += self._lead(program, index, unit, last=index == leads[-1])
            for i in by_block.get(index, ()):
                out += self._move(i)
            out += after
        return out

    @staticmethod
    def _has_axes(program: Program, index: int) -> bool:
        return any(letter in AXES for letter, *_ in program.words(index))

    def _check_leads(self, leads: Sequence[int], program: Program) -> None:
        """Refuse a way to the first known position that nobody can correct."""
        if len(leads) > 1 and self.tool.converts:
            _, _, line, column = program.words(leads[0])[0]
            raise ProgramError(
                f"line {line}, column {column}: got a first move that does not name every axis of "
                "the program, expected one that does: other coordinates need all of them"
            )

    def _lead(self, program: Program, index: int, unit: float, *, last: bool) -> list[str]:
        """Rapids to the first position that is known: as they were, then corrected."""
        if last:
            return [_straight("G0", self.tool.sent(self.moves.begin[None])[0], self._named())]
        words = [w for w in program.words(index) if w[0] in AXES]
        size = {letter: unit if letter in "XYZ" else 1.0 for letter, *_ in words}
        return [" ".join(["G0", *(f"{w[0]}{w[1] * size[w[0]]:.4f}" for w in words)])]

    def _named(self) -> Sequence[int]:
        """Axes that the machine has: X, Y, Z and its rotary ones."""
        return [0, 1, 2, *self.tool.rotary]

    def _move(self, i: int) -> list[str]:
        code = int(self.moves.code[i])
        tolerance = self.tolerance_mm * (RAPID_TIMES if code == 0 else 1.0)
        found = pieces(self.tool, self.moves, i, tolerance)
        lines = []
        for piece in found:
            self.sources.append(Kept(i, piece.begin, piece.end))
            words = [f"G{piece.code}"]
            if code != 0:
                words = [*self._feed_words(i, piece), *words]
            lines.append(_spelled(words, piece, self._named()))
        return lines

    def _feed_words(self, i: int, piece: Piece) -> list[str]:
        """Mode and feed of a move, as far as they change."""
        timed = self.tool.converts or self.tool.turns(self.moves, i)
        mode = 93 if timed or self.moves.feed_mode[i] == 93 else 94
        words = [] if mode == self.mode else [FEEDS[mode]]
        value = self.moves.feed[i]
        if mode == 93:
            minutes = self.minutes[i] * (piece.end - piece.begin)
            value = 1.0 / max(minutes, 1e-9)
        feed = f"F{_decimal(value)}" if mode == 93 else f"F{value:.4f}".rstrip("0").rstrip(".")
        if mode == 93 or mode != self.mode or feed != self.feed:
            words.append(feed)
        self.mode, self.feed = mode, feed
        return words


def _words_kept(line: str, *, moving: bool) -> tuple[list[str], list[str]]:
    """What of a line stays before and after its move: no modes, no axes, no feed of a move."""
    comments = _COMMENT.findall(line)
    plain = _COMMENT.sub(" ", line)
    before: list[str] = []
    after: list[str] = []
    for letter, number in _WORD.findall(plain):
        letter, value = letter.upper(), float(number)
        if (letter == "G" and value in _MODES) or letter in "NF":
            continue
        if moving and letter in AXES + "IJKR":
            continue
        word = f"{letter}{number}"
        (after if letter == "M" and value in _STOPS else before).append(word)
    text = " ".join([*before, *comments]).strip()
    if plain.strip() == "%":
        return [line], []
    return ([text] if text or not line.strip() else []), after and [" ".join(after)]


def _decimal(value: float) -> str:
    """Six digits; controls read no exponents."""
    return np.format_float_positional(value, precision=6, fractional=False, trim="-")


def _spelled(words: Sequence[str], piece: Piece, axes: Sequence[int]) -> str:
    line = _straight(" ".join(words), piece.to, axes)
    if piece.centre is not None:
        letters = {17: "IJ", 18: "KI", 19: "JK"}[piece.plane]
        line += "".join(
            f" {letter}{value:.5f}" for letter, value in zip(letters, piece.centre, strict=True)
        )
    return line


def _straight(head: str, to: Floats, axes: Sequence[int]) -> str:
    return " ".join([head, *(f"{AXES[i]}{to[i] + 0.0:.4f}" for i in axes)])
