"""Error motion of a rotary axis as polar plots (ISO 230-7): radial, axial, tilt.

Targets on the table are measured by an instrument at rest, so that the radial error motion is that
in the direction which turns with the table, from the instrument's X at 0°.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion.base.units import ARCSEC, Floats, Integers
from trunnion.data.rotary_test import RotaryTest
from trunnion.data.sweep import Sweep
from trunnion.models.rotary.geometry import Geometry, fit_circles, targets_of
from trunnion.plot.picture import Axis, Kind, Picture, Series, line, points
from trunnion.plot.static import panels
from trunnion.plot.style import BLUE, MUTED, PALETTE, PURPLE, VERMILLION, near_number

SHARE = 0.35
LEVELS = (-2, -1, 0, 1, 2)
SAME_ANGLE_DEG = 1e-3
MIN_TARGETS = 3
ALONG = 0.9  # cosine: an axis along X
MAX_TARGETS = 3
BESIDE, MAX_BESIDE = 0.22, 1.5
"""Between readings that stand beside one another: of the least step of an axis; degrees."""


@dataclass(frozen=True)
class ErrorMotion:
    """One error motion over the angle.

    angle_deg, values: In the order of measurement, (n,). synchronous: Mean at each angle that is
    repeated, (n,): what comes again each turn; the rest is asynchronous.
    """

    name: str
    unit: str
    angle_deg: Floats
    values: Floats

    @property
    def repeated(self) -> bool:
        """Whether angles come again, so that there is an asynchronous part."""
        return len(np.unique(self._places())) < len(self.values)

    def _places(self) -> Floats:
        return np.round(np.mod(self.angle_deg, 360.0) / SAME_ANGLE_DEG) % (360.0 / SAME_ANGLE_DEG)

    def mean(self) -> tuple[Floats, Floats]:
        """Angles, and the mean of the readings at each, in the order of the angle."""
        places, index = np.unique(self._places(), return_inverse=True)
        values = np.bincount(index, self.values) / np.bincount(index)
        return places * SAME_ANGLE_DEG, values

    @property
    def synchronous(self) -> float:
        """Range of the mean over a turn: difference of the circles about the mean path."""
        return float(np.ptp(self.mean()[1]))

    @property
    def asynchronous(self) -> float:
        """Largest range of the readings at one angle."""
        _, index = np.unique(self._places(), return_inverse=True)
        order = np.lexsort((self.values, index))
        first = np.flatnonzero(np.diff(np.append(-1, index[order])))
        last = np.append(first[1:], len(order)) - 1
        return float(np.max(self.values[order[last]] - self.values[order[first]]))


def error_motions(sweep: Sweep) -> list[ErrorMotion]:
    """Return radial, axial and tilt error motion of the axis, at the middle height of the targets.

    With fewer than three targets, or targets on a line: the radial and axial distance of each
    target from its own circle, which is the error motion at that target.
    """
    labels, target = targets_of(sweep)
    whole = _of_axis(sweep, labels, np.asarray(target))
    if whole is not None:
        return whole
    found = []
    for k, (label, circle) in enumerate(fit_circles(sweep).items()):
        angle = sweep.angle_deg[target == k]
        for name, values in (("Radial", circle.radial_um), ("Axial", circle.axial_um)):
            title = f"{name} error motion at target {label}"
            found.append(ErrorMotion(title, "µm", angle, values))
    return found[: 2 * MAX_TARGETS]


def _of_axis(sweep: Sweep, labels: list[Any], target: Integers) -> list[ErrorMotion] | None:
    """Rigid motion of the table at each visit of an angle, by all targets together."""
    if len(labels) < MIN_TARGETS:
        return None
    turn = np.radians(sweep.angle_deg)
    geometry = Geometry.of(sweep.position_mm, turn, target, labels)
    c, s = np.cos(turn), np.sin(turn)
    place = geometry.targets[target]
    x, y, z = place.T
    p = np.column_stack([c * x - s * y, s * x + c * y, z])
    away = 1e3 * ((sweep.position_mm - geometry.origin) @ geometry.frame - p)
    visits = _visits(sweep.angle_deg, target)
    rows: list[tuple[float, Floats]] = []
    for visit in np.unique(visits):
        mine = visits == visit
        design = np.zeros((int(mine.sum()), 3, 6))
        design[:, :, :3] = np.eye(3)
        for axis in range(3):
            design[:, :, 3 + axis] = np.cross(np.eye(3)[axis], p[mine]) * 1e-3
        a = design.reshape(-1, 6)
        if np.linalg.matrix_rank(a, tol=1e-3) < 6:
            return None
        motion = np.linalg.lstsq(a, away[mine].ravel(), rcond=None)[0]
        rows.append((float(sweep.angle_deg[mine][0]), motion))
    angle = np.array([a for a, _ in rows])
    tx, ty, tz, rx, ry, _ = np.array([motion for _, motion in rows]).T
    start = np.arctan2(*_start(geometry.frame)[1::-1])
    c, s = np.cos(np.radians(angle) + start), np.sin(np.radians(angle) + start)
    tilt = (ry * c - rx * s) * 1e-6 / ARCSEC
    return [
        ErrorMotion("Radial error motion", "µm", angle, _centred(angle, tx * c + ty * s)),
        ErrorMotion("Axial error motion", "µm", angle, tz - tz.mean()),
        ErrorMotion("Tilt error motion", "arcsec", angle, _centred(angle, tilt)),
    ]


def _start(frame: Floats) -> Floats:
    """Direction from which the one that turns with the table starts, in the frame of the axis.

    The instrument's X; its Y where the axis is along X.
    """
    first: Floats = frame.T[:, 0] if abs(frame[0, 2]) < ALONG else frame.T[:, 1]
    return first


def _visits(angle: Floats, target: Integers) -> Integers:
    """Number of the visit of each row: the k-th reading of every target at an angle is one."""
    places = np.round(angle / SAME_ANGLE_DEG).astype(np.int64)
    seen: dict[tuple[int, int], int] = {}
    names: dict[tuple[int, int], int] = {}
    out = np.empty(len(angle), dtype=np.intp)
    for row, key in enumerate(zip(places.tolist(), target.tolist(), strict=True)):
        time = seen[key] = seen.get(key, -1) + 1
        out[row] = names.setdefault((key[0], time), len(names))
    return out


def _centred(angle: Floats, values: Floats) -> Floats:
    """Values less their least-squares circle: mean and first harmonic are of the set-up."""
    turn = np.radians(angle)
    a = np.column_stack([np.ones_like(turn), np.cos(turn), np.sin(turn)])
    return np.asarray(values - a @ np.linalg.lstsq(a, values, rcond=None)[0])


def plot_error_motion(sweep: Sweep, *, ax: Any = None, motion: int = 0, **style: Any) -> Any:
    """Draw radial, axial and tilt error motion as polar plots.

    Parameters
    ----------
    sweep
        Targets on a rotary axis, measured over its angle.
    ax
        Polar axes for one of the motions; all in a new figure unless given.
    motion
        Which one is drawn on `ax`.
    **style
        As :meth:`trunnion.plot.picture.Picture.draw` takes it.
    """
    pictures = error_motion_pictures(sweep)
    if ax is not None:
        return pictures[motion].draw(ax, **style)
    return panels(pictures, columns=min(len(pictures), 3), size=(4.7, 5.9), **style)


def error_motion_pictures(sweep: Sweep) -> list[Picture]:
    """Return the polar picture of each error motion."""
    return [error_motion_picture(one) for one in error_motions(sweep)]


def error_motion_picture(motion: ErrorMotion) -> Picture:
    """Return the polar picture: readings, their mean over a turn, the least-squares circle."""
    largest = float(np.abs(motion.values).max()) or 1.0
    step = near_number(largest / 2)
    scale = SHARE / largest
    whole = np.linspace(0, 360, 361)
    series: list[Series] = [
        line(whole, np.full_like(whole, 1 + scale * step * k), colour=MUTED, width=0.5)
        for k in LEVELS
        if k
    ]
    series.append(
        line(whole, np.ones_like(whole), "least-squares circle", colour=PURPLE, dash="dash")
    )
    texts = tuple(
        f"{a:g}°: {v:+.3g} {motion.unit}".replace("-", "−")
        for a, v in zip(motion.angle_deg, motion.values, strict=True)
    )
    reading = {"colour": VERMILLION, "size": 3.0, "hover": texts}
    series.append(points(motion.angle_deg, 1 + scale * motion.values, "reading", **reading))
    angle, mean = motion.mean()
    closed = 360 - np.ptp(angle) < 4 * float(np.median(np.diff(angle)))
    if closed:
        angle, mean = np.append(angle, angle[0] + 360), np.append(mean, mean[0])
    label = "mean of the turns" if motion.repeated else "path"
    series.append(line(angle, 1 + scale * mean, label, colour=BLUE))
    said = f"synchronous {motion.synchronous:.3g} {motion.unit}"
    if motion.repeated:
        said += f", asynchronous {motion.asynchronous:.3g} {motion.unit}"
    return Picture(
        motion.name,
        Axis("angle", "°"),
        Axis(limits=(0.0, 1 + 1.15 * SHARE), ticks=()),
        tuple(series),
        Kind.POLAR,
        note=f"{said}; {step:g} {motion.unit} a line.",
    )


def rotary_test_pictures(data: RotaryTest) -> list[Picture]:
    """Return the readings of an R-test or a ball-bar over each rotary axis that turns.

    Directions that are read at one position stand beside one another.
    """
    readings = data.displacement_um
    if readings is not None:
        shown = {f"along {name}": readings[:, k] for k, name in enumerate("XYZ")}
        y = Axis("Ball displacement", "µm")
    elif data.length_mm is not None:
        mean = float(np.mean(data.length_mm))
        shown = {f"length less {mean:.4f} mm": 1e3 * (data.length_mm - mean)}
        y = Axis("Deviation of the length", "µm")
    else:
        return []
    found = []
    for axis, at in data.rotary_deg.items():
        if np.ptp(at) == 0:
            continue
        rows = np.arange(len(data))
        step = float(np.min(np.diff(np.unique(np.round(at, 6)))))
        gap = min(BESIDE * step, MAX_BESIDE)
        middle = (len(shown) - 1) / 2
        series = [
            points(at + gap * (k - middle), values, name, colour=PALETTE[k], rows=rows, size=3.5)
            for k, (name, values) in enumerate(shown.items())
        ]
        title = f"Readings over the position of {axis.upper()}"
        x = Axis(f"Position of {axis.upper()}", "°")
        note = f"Directions of one position stand {gap:.2g}° beside one another."
        note = note if len(shown) > 1 else ""
        found.append(Picture(title, x, y, tuple(series), note=note))
    return found
