"""The hybrid mechanism in a pose: base, three legs, platform, wrist, tool."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trunnion._core import hybrid_example
from trunnion.base.units import Floats
from trunnion.hybrid.cube import EDGES, CubeChange
from trunnion.hybrid.mechanism import Mechanism
from trunnion.plot.scenes.traces import Trace, arrows, ball, dots, lines, mesh, tube, words
from trunnion.plot.scenes.view import View, arrow_scale, extent, scale_bar, titled
from trunnion.plot.style import BLUE, GREEN, MUTED, OCHRE, VERMILLION

LEG_MM = 22.0
JOINT_MM = 34.0
TOOL_MM = 14.0


def _dimensions(machine: Mechanism) -> dict[str, float]:
    """Return nominal e1 to e15, mm, by name."""
    nominal = hybrid_example()
    return {
        f"e{k + 1}": float(machine.dimensions.get(f"e{k + 1}_mm", nominal[k])) for k in range(15)
    }


def _turn(axis: int, angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i] = out[j, j] = c
    out[i, j], out[j, i] = -s, s
    return out


def _joints(machine: Mechanism, row: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return joints on the base (3, 3), on the platform (3, 3), wrist (2, 3) and tool point."""
    e = _dimensions(machine)
    solved = machine.nominal.forward(row)
    passive = np.radians(solved.passive_deg[0])
    base = np.array([[-e["e8"], 0.0, 0.0], [0.0, e["e4"], 0.0], [e["e8"], 0.0, 0.0]])
    ends = []
    for leg, (u, v) in enumerate(((0, 1), (2, 3), (6, 7))):
        down = np.array([0.0, 0.0, -row[leg]])
        cross = np.array([0.0, 0.0, -e[f"e{leg + 1}"]])
        ends.append(base[leg] + _turn(0, passive[u]) @ (cross + _turn(1, passive[v]) @ down))
    first, central, third = ends
    x = (third - first) / np.linalg.norm(third - first)
    origin = first + e["e9"] * x
    p = central - origin
    p -= (p @ x) * x
    p /= np.linalg.norm(p)
    lean = np.arctan2(e["e12"], e["e10"])
    z = np.sin(lean) * p + np.cos(lean) * np.cross(x, p)
    tip = solved.tip_mm[0]
    wrist = np.array([origin - e["e13"] * z, tip - e["e15"] * solved.direction[0]])
    return base, np.array(ends), wrist, tip


def mechanism_view(machine: Mechanism, pose: ArrayLike | None = None) -> View:
    """Return the mechanism, nominal dimensions.

    pose: L1, L2, L3 (mm), q4, q5 (deg); the home pose if None.
    """
    row = np.array([*machine.home_legs_mm, 0.0, 0.0] if pose is None else pose, dtype=np.float64)
    base, ends, wrist, tip = _joints(machine, row)
    legs = ", ".join(f"L{k + 1} {row[k]:.1f}" for k in range(3))
    view = View(titled("Hybrid mechanism", f"{legs} mm, q4 {row[3]:g}°, q5 {row[4]:g}°"))
    view.add(mesh(base, [[0, 1, 2]], colour=MUTED, opacity=0.35))
    for start, end in zip(base, ends, strict=True):
        view.add(mesh(*tube(start, end, LEG_MM), colour=BLUE, opacity=0.9))
    for joint in (*base, *ends, *wrist):
        view.add(mesh(*ball(joint, JOINT_MM), colour=MUTED, flatshading=False))
    view.add(mesh(ends, [[0, 1, 2]], colour=GREEN, opacity=0.85))
    view.add(_bar(ends.mean(axis=0), wrist[0], OCHRE), _bar(wrist[0], wrist[1], OCHRE))
    view.add(_bar(wrist[1], tip, VERMILLION, TOOL_MM))
    off = np.array([0.0, 0.0, 2.2 * JOINT_MM])
    view.add(words(base + off, [f"leg {k}" for k in (1, 2, 3)]), words(wrist[:1] + off, ["q4, q5"]))
    view.add(dots(tip[None], colour=VERMILLION, size=5, name="tool point"))
    return view


def _bar(start: Floats, end: Floats, colour: str, radius: float = LEG_MM) -> list[Trace]:
    if np.linalg.norm(end - start) < 1e-6:
        return []
    return [mesh(*tube(start, end, radius), colour=colour)]


def cube_view(change: CubeChange, *, magnification: float | None = None) -> View:
    """Return a cube before and after an error, displacements magnified on a stated scale."""
    shift = 1e3 * (change.moved_mm - change.nominal_mm)
    low, size = extent(change.nominal_mm)
    largest = float(np.linalg.norm(shift, axis=1).max())
    scale = arrow_scale(largest, size, magnification)
    moved = change.nominal_mm + scale * shift
    bar, said = scale_bar(low - [0.0, 0.12 * size, 0.0], scale, largest)
    stem, unit = change.error.rsplit("_", 1)
    amount = f"{change.amount:g} {'µm' if unit == 'um' else unit}"
    view = View(
        titled(f"Cube of {np.ptp(change.nominal_mm[:, 0]):g} mm moved by {stem} = {amount}", said)
    )
    view.add(bar, _edges(change.nominal_mm, MUTED, "commanded"), _edges(moved, VERMILLION, "made"))
    lengths = [f"{n:.3g} µm" for n in np.linalg.norm(shift, axis=1)]
    view.add(
        arrows(change.nominal_mm, scale * shift, size_mm=size, colour=BLUE, texts=lengths, width=3)
    )
    return view


def _edges(points: Floats, colour: str, name: str) -> Trace:
    return lines([points[[i, j]] for i, j in EDGES], colour=colour, width=4, name=name)
