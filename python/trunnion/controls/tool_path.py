"""Where a program puts the tool on the work, what a machine with errors makes of it, and moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

import trunnion._core as _core
from trunnion.base.errors import ProgramError
from trunnion.base.units import Floats
from trunnion.compensation.control import ModelCompensation, nominal_commands
from trunnion.compensation.machine import MachineErrors
from trunnion.machine.chain import Chain
from trunnion.nc import Moves
from trunnion.setup import Setup

INNER = np.linspace(0.0, 1.0, 18)[1:]
"""Where along a move its error is looked at."""
DIGITS = 4
"""Decimals that positions are written with."""
SHORTEST = 1e-4
"""Smallest part of a move that is written on its own."""
MAX_TRIALS, NEAR = 20, 0.93
"""Trials for one piece; one whose error is this part of the tolerance is as long as it can be."""
PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
"""First, second and third axis of the plane of an arc."""


@dataclass(frozen=True)
class Kept:
    """A written move is the part from `begin` to `end`, 0 to 1, of move `source`."""

    source: int
    begin: float
    end: float


@dataclass(frozen=True)
class Piece:
    """A written move: its code, end (6,), and on arcs the plane and the centre from the start."""

    code: int
    begin: float
    end: float
    to: Floats
    plane: int = 0
    centre: tuple[float, float] | None = None


@dataclass(frozen=True)
class Tool:
    """The machine without and with its errors, and the coordinates of the programs.

    Positions are rows X Y Z A B C, mm and degrees, as a program has them.
    """

    setup: Setup
    known: MachineErrors
    real: _core.MachineModel
    given: str
    written: str
    origin: Floats
    rotary: tuple[int, ...]

    @classmethod
    def of(
        cls, setup: Setup, known: MachineErrors, given: str, written: str, origin: Sequence[float]
    ) -> Tool:
        """Make it for a set-up."""
        letters = Chain(setup).letters
        rotary = tuple(3 + "ABC".index(letter) for letter in letters)
        return cls(setup, known, known.core(setup), given, written, np.array(origin), rotary)

    @property
    def converts(self) -> bool:
        """Whether program and result have different coordinates."""
        return self.given != self.written

    def turns(self, moves: Moves, i: int) -> bool:
        """Whether a rotary axis turns in a move."""
        return bool(np.any(moves.start[i, 3:] != moves.end[i, 3:]))

    def _rotary(self, rows: Floats) -> Floats:
        chain = Chain(self.setup)
        return chain.to_machine({"ABC"[k - 3]: rows[:, k] for k in self.rotary}, len(rows))

    def _frame(self, rows: Floats) -> Floats:
        return rows[:, :3] * Chain(self.setup).linear_senses() + self.origin

    def point(self, rows: Floats) -> Floats:
        """Tool point on the table that a program means, (n, 3), mm."""
        points = self._frame(rows)
        if self.given == "tcp":
            return points
        turn, shift = Chain(self.setup).table_pose(self._rotary(rows))
        return np.asarray(np.einsum("nji,nj->ni", turn, points - shift))

    def sent(self, rows: Floats) -> Floats:
        """Positions to write so that the machine with errors is where the program means."""
        rotary = self._rotary(rows)
        linear = ModelCompensation(self.known).commands(self.setup, self.point(rows), rotary)[:, :3]
        if self.written == "tcp":
            turn, shift = Chain(self.setup).table_pose(rotary)
            linear = np.einsum("nji,nj->ni", turn, linear - shift)
        out = rows.copy()
        out[:, :3] = (linear - self.origin) * Chain(self.setup).linear_senses()
        return out

    def reached(self, rows: Floats, coordinates: str) -> Floats:
        """Tool point on the real table for positions as a program has them, (n, 3), mm."""
        rotary, linear = self._rotary(rows), self._frame(rows)
        if coordinates == "tcp":
            linear = nominal_commands(self.setup, linear, rotary)[:, :3]
        return np.asarray(self.real.reached(np.hstack([linear, rotary]), None)[:, :3])

    def minutes(self, moves: Moves) -> Floats:
        """Time of each move at feed as LinuxCNC counts it; 0 for rapids."""
        times = np.zeros(len(moves))
        for i in np.flatnonzero(moves.code != 0):
            if moves.feed_mode[i] == 93:
                times[i] = 1.0 / moves.feed[i]
            else:
                times[i] = _length(moves, int(i)) / moves.feed[i]
        return times

    def largest(self, moves: Moves, written: Moves, sources: Sequence[Kept] | None) -> float:
        """Largest distance of feed moves from where they should be, mm.

        written: What the machine makes. sources: Which part of `moves` each written move is of;
            None: the same moves, in the coordinates of the program.
        """
        largest = 0.0
        for j in range(len(written)):
            kept = (
                Kept(j, 0.0, 1.0) if sources is None else sources[j - len(written) + len(sources)]
            )
            if moves.code[kept.source] == 0:
                continue
            rows = along(written, j, INNER)
            way = kept.begin + (kept.end - kept.begin) * INNER
            wanted = self.point(along(moves, kept.source, way))
            at = self.reached(rows, self.given if sources is None else self.written)
            largest = max(largest, float(np.linalg.norm(at - wanted, axis=1).max()))
        return largest


def _sweep(moves: Moves, i: int) -> tuple[Floats, float, float]:
    """Centre (2,), radius and signed angle of an arc."""
    first, second, _ = PLANES[int(moves.plane[i])]
    start, end = moves.start[i, [first, second]], moves.end[i, [first, second]]
    centre = moves.centre_mm[i]
    begin = np.arctan2(*(start - centre)[::-1])
    angle = np.arctan2(*(end - centre)[::-1]) - begin
    angle = angle % (2 * np.pi)
    if moves.code[i] == 2:
        angle -= 2 * np.pi
        angle = angle if angle > -2 * np.pi + 1e-9 else -2 * np.pi
    elif angle < 1e-9:
        angle = 2 * np.pi
    return centre, float(np.hypot(*(start - centre))), float(angle)


def _length(moves: Moves, i: int) -> float:
    """Length along X, Y, Z of a move, mm; degrees where none of them moves."""
    change = moves.end[i] - moves.start[i]
    if moves.code[i] in (2, 3):
        _, radius, angle = _sweep(moves, i)
        across = change[PLANES[int(moves.plane[i])][2]]
        return float(np.hypot(radius * angle, across))
    linear = float(np.linalg.norm(change[:3]))
    return linear if linear > 0 else float(np.linalg.norm(change[3:]))


def along(moves: Moves, i: int, way: Floats) -> Floats:
    """Positions along a move at parts 0 to 1 of it, (n, 6)."""
    rows = moves.start[i] + way[:, None] * (moves.end[i] - moves.start[i])
    if moves.code[i] in (2, 3):
        first, second, _ = PLANES[int(moves.plane[i])]
        centre, radius, angle = _sweep(moves, i)
        begin = np.arctan2(*(moves.start[i, [first, second]] - centre)[::-1])
        ends = np.hypot(*(moves.end[i, [first, second]] - centre))
        size = radius + way * (ends - radius)
        rows[:, first] = centre[0] + size * np.cos(begin + way * angle)
        rows[:, second] = centre[1] + size * np.sin(begin + way * angle)
    return np.asarray(rows)


def pieces(tool: Tool, moves: Moves, i: int, tolerance_mm: float) -> Sequence[Piece]:
    """Fewest moves that keep move `i` within a tolerance: each goes as far as it can."""
    arc = moves.code[i] in (2, 3) and not tool.converts and not tool.turns(moves, i)
    found = list(_greedy(tool, moves, i, tolerance_mm, arc=arc))
    if arc and len(found) > 2:
        lines = list(_greedy(tool, moves, i, tolerance_mm, arc=False))
        return min((found, lines), key=len)
    return found


def _greedy(tool: Tool, moves: Moves, i: int, tolerance_mm: float, *, arc: bool) -> Iterator[Piece]:
    begin, length = 0.0, 1.0
    while begin < 1.0:
        piece = _farthest(tool, moves, i, begin, length, tolerance_mm, arc=arc)
        yield piece
        begin, length = piece.end, piece.end - begin


def _farthest(
    tool: Tool,
    moves: Moves,
    i: int,
    begin: float,
    length: float,
    tolerance_mm: float,
    *,
    arc: bool,
) -> Piece:
    """Return the longest piece within the tolerance, to a few percent; `length`: a first guess."""
    low, high, best, least = 0.0, 2.0, None, np.inf
    for _ in range(MAX_TRIALS):
        end = min(begin + length, 1.0)
        trial, error = _piece(tool, moves, i, begin, end, arc=arc)
        least = min(least, error)
        if error <= tolerance_mm:
            best, low = trial, length
            if end >= 1.0 or error > NEAR * tolerance_mm:
                return trial
        else:
            high = length
        if length <= SHORTEST:
            break
        # Errors grow with the square of the length, if the path bends evenly.
        wanted = length * float(np.sqrt(0.98 * tolerance_mm / max(error, 1e-3 * tolerance_mm)))
        length = wanted if low < wanted < high else 0.5 * (low + high)
        length = max(length, SHORTEST)
    if best is None and arc:  # its centre is written in steps, too
        return _farthest(tool, moves, i, begin, length, tolerance_mm, arc=False)
    if best is None:
        what = "rapid" if moves.code[i] == 0 else "move"
        raise ProgramError(
            f"line {moves.line[i]}, column {moves.column[i]}: got a tolerance of "
            f"{1e3 * tolerance_mm:.3g} µm on a {what} of which a part cannot keep it, expected a "
            f"larger one: however short, it is {1e3 * least:.3g} µm off, as positions are written "
            f"to {10.0**-DIGITS:g} mm or degrees"
        )
    return best


def _piece(
    tool: Tool, moves: Moves, i: int, begin: float, end: float, *, arc: bool
) -> tuple[Piece, float]:
    """A move over a part of another, and how far it is off at most, mm."""
    way = np.concatenate([[0.0], INNER])
    meant = along(moves, i, begin + (end - begin) * way)
    ends = np.round(tool.sent(meant[[0, -1]]), DIGITS)
    code = int(moves.code[i]) if arc else min(int(moves.code[i]), 1)
    piece = Piece(code, begin, end, ends[1])
    line = replace(
        _one(moves), start=ends[:1], end=ends[1:], code=np.array([code]), plane=np.array([0])
    )
    if arc:
        plane = int(moves.plane[i])
        centre = _centre(tool, moves, i, ends, 0.5 * (meant[0] + meant[-1]))
        line = replace(line, plane=np.array([plane]), centre_mm=centre[None])
        first, second, _ = PLANES[plane]
        away = centre - ends[0, [first, second]]
        piece = replace(piece, plane=plane, centre=(float(away[0]), float(away[1])))
    error = tool.reached(along(line, 0, way), tool.written) - tool.point(meant)
    return piece, float(np.linalg.norm(error, axis=1).max())


def _one(moves: Moves) -> Moves:
    """One move to fill in."""
    return Moves(*(getattr(moves, name)[:1] for name in moves.__dataclass_fields__))


def _centre(tool: Tool, moves: Moves, i: int, ends: Floats, middle: Floats) -> Floats:
    """Centre of the corrected arc: the corrected centre, put at equal distance from both ends."""
    first, second, _ = PLANES[int(moves.plane[i])]
    at = middle.copy()
    at[[first, second]] = moves.centre_mm[i]
    centre = tool.sent(at[None])[0, [first, second]]
    start, end = ends[0, [first, second]], ends[1, [first, second]]
    chord = end - start
    length = float(np.hypot(*chord))
    if length < 1e-6:  # a whole turn
        return np.asarray(centre)
    unit = chord / length
    return np.asarray(centre - unit * (unit @ (centre - 0.5 * (start + end))))
