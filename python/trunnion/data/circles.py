"""Circles of a ball-bar test: the plane of commanded points, and which way the rows go round it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from trunnion.base.units import Flags, Floats, Integers
from trunnion.data.ballbar import Ballbar
from trunnion.data.meant import out_of_order

ROUND_MM = 0.01
"""Commanded points may lie so far off their circle, mm: what three decimals of a chord leave."""
MIN_POINTS = 8
MAX_AGAINST = 0.1
"""Share of a path that may go back, single steps apart."""
TREMBLE_RAD, TREMBLE_SHARE = np.radians(3.0), 0.1
"""Steps below it, or below so much of what the path spans, are joined: points of a log tremble."""
MAX_SINGLE = 0.5
"""Share of the rows of a circle that may be paths of their own: a point shows no travel."""
MIN_CHANGES = 0.25
"""Of steps between rows: where the sense changes as often, rows of both senses are mixed."""
SORTED = "Were rows sorted by angle? Then sort the rows of each path along its travel."
WAYS = {1: "counter-clockwise", -1: "clockwise"}
TURNED_ALIKE = {"XY": "from X to Y", "YZ": "from Y to Z"}
"""Planes whose counter-clockwise everybody counts alike; in ZX it is from Z to X or from X to Z."""

Path: TypeAlias = tuple[Integers, Floats]
"""Rows of a path round a circle, and their angles in its plane, rad."""


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle in a plane of the axes.

    plane, radius_mm: "XY", "YZ" or "ZX"; radius.
    angle: Of each point in the plane, rad, (n,).
    """

    plane: str
    radius_mm: float
    angle: Floats

    @classmethod
    def through(cls, points_mm: Floats) -> Circle | None:
        """Return the circle on which points (n, 3) lie; None if they lie on no such circle."""
        flat = np.flatnonzero(np.ptp(points_mm, axis=0) < ROUND_MM)
        if len(points_mm) < MIN_POINTS or len(flat) != 1:
            return None
        normal = int(flat[0])
        u, v = points_mm[:, (normal + 1) % 3], points_mm[:, (normal + 2) % 3]
        design = np.column_stack([2 * u, 2 * v, np.ones(len(u))])
        a, b, c = np.linalg.lstsq(design, u**2 + v**2, rcond=None)[0]
        radius = float(np.sqrt(c + a * a + b * b))
        if np.abs(np.hypot(u - a, v - b) - radius).max() > ROUND_MM:
            return None
        return cls(("YZ", "ZX", "XY")[normal], radius, np.arctan2(v - b, u - a))


def paths_round(tips_mm: Floats, runs: list[Integers]) -> dict[str, list[Path]]:
    """Rows of the runs of a set-up that go round a circle, and their angles, by the plane.

    A set-up is one circle, or each run is one. Of rows in no order each run is too short for it.
    """
    whole = Circle.through(tips_mm[np.concatenate(runs)])
    if whole is not None:
        angles = np.split(whole.angle, np.cumsum([len(rows) for rows in runs])[:-1])
        return {whole.plane: list(zip(runs, angles, strict=True))}
    found: dict[str, list[Path]] = {}
    for rows in runs:
        if circle := Circle.through(tips_mm[rows]):
            found.setdefault(circle.plane, []).append((rows, circle.angle))
    return found


def check_sense(data: Ballbar, plane: str, paths: list[Path], *, any_order: bool = False) -> None:
    """Refuse rows that go round a circle the other way than their column `sense` says.

    any_order: Rows may be sorted; what no sorting makes is refused.

    Raises DataError: with the first row that does, and the likely cause.
    """
    against = Against.of(data, paths)
    if not against.senses or (against.all_of_both and plane not in TURNED_ALIKE):
        return
    if any_order and not (against.all_of_both and against.known == len(WAYS)):
        return
    way = int(np.asarray(data.sense)[against.row])
    turn = f", {TURNED_ALIKE[plane]}" if plane in TURNED_ALIKE else ""
    raise out_of_order(
        f"sense ({data.place(against.row)}): got {way:+d} ({WAYS[way]}) where the rows go "
        f"{WAYS[-way]} round the circle in {plane}, expected the readings in the order in which "
        f"they were taken, and +1 for counter-clockwise{turn}. {against.likely_cause(data)}"
    )


def check_travel(data: Ballbar, plane: str, paths: list[Path]) -> None:
    """Refuse rows of both senses that are mixed: most are paths of one point, without travel.

    Raises DataError: with the first row at which the sense changes, and the likely cause.
    """
    rows = np.sort(np.concatenate([mine for mine, _ in paths]))
    single = sum(len(mine) == 1 for mine, _ in paths)
    changes = np.flatnonzero(np.diff(np.asarray(data.sense)[rows]))
    if single <= MAX_SINGLE * len(rows) or len(changes) < MIN_CHANGES * len(rows):
        return
    raise out_of_order(
        f"sense ({data.place(int(rows[changes[0] + 1]))}): it changes {len(changes)} times in the "
        f"{len(rows)} rows round the circle in {plane}, {single} of which are a path of one point, "
        f"expected the readings in the order in which they were taken. {SORTED}"
    )


def _wrapped(angle: Floats) -> Floats:
    """Angles the short way round, rad."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def _without_tremble(angle: Floats) -> Integers:
    """Places along a path each of which is further from the one before than a log trembles."""
    beyond = _wrapped(angle - angle[0])
    least = min(TREMBLE_RAD, TREMBLE_SHARE * float(np.abs(beyond).max()))
    kept = [0]
    last, turn = 0.0, 2 * np.pi
    for k, at in enumerate(beyond.tolist()):
        apart = abs(at - last)
        if min(apart, turn - apart) > least:
            kept.append(k)
            last = at
    return np.asarray(kept, dtype=np.intp)


def _single_steps_back(back: Flags) -> Flags:
    """Steps back between steps forward: the machine returned to a start, or a row trembles."""
    if len(back) < 2:
        return np.zeros(len(back), dtype=bool)
    beside = np.concatenate([[False], back[:-1]]) | np.concatenate([back[1:], [False]])
    single: Flags = back & ~beside
    return single


@dataclass(frozen=True)
class Against:
    """Paths whose rows go the other way than their sense says.

    senses: +1, -1 of which more than `MAX_AGAINST` does. row: The first that does.
    whole: All of these paths does. known: Senses that the data have.
    """

    senses: tuple[int, ...] = ()
    row: int = -1
    whole: bool = False
    known: int = 0

    @property
    def all_of_both(self) -> bool:
        """Whether every path goes the other way: the column counts the other way."""
        return self.whole and len(self.senses) == self.known

    @classmethod
    def of(cls, data: Ballbar, paths: list[Path]) -> Against:
        """Compare rows and their angles with the column `sense`."""
        if data.sense is None:
            return cls()
        rows, steps = [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
        for mine, angle in paths:
            kept = _without_tremble(angle)
            turned = _wrapped(np.diff(angle[kept]))
            way = np.asarray(data.sense)[mine[kept[1:]]]
            counts = ~_single_steps_back(way * turned < 0)
            rows.append(mine[kept[1:]][counts])
            steps.append(turned[counts])
        row, step = np.concatenate(rows), np.concatenate(steps)
        sense = np.asarray(data.sense)[row]
        back, size = np.maximum(-sense * step, 0.0), np.abs(step)
        ways = [s for s in (1, -1) if size[sense == s].sum() > 0]
        share = {s: float(back[sense == s].sum() / size[sense == s].sum()) for s in ways}
        wrong = tuple(s for s in ways if share[s] > MAX_AGAINST)
        if not wrong:
            return cls()
        first = int(row[(back > 0) & np.isin(sense, wrong)].min())
        whole = all(share[s] > 1 - MAX_AGAINST for s in wrong)
        return cls(wrong, first, whole, len(ways))

    def likely_cause(self, data: Any) -> str:
        """Say what most often makes it."""
        if self.all_of_both and (data.time_s is not None or self.known == 2):
            return "All rows do: is the sense counted the other way?"
        if self.all_of_both:
            return "All rows do: is the sense counted the other way, or were rows sorted by angle?"
        if self.whole:
            return SORTED
        return "Were rows sorted, or put together from several files?"
