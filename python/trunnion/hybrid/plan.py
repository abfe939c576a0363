"""Plan of a ball-bar test on the hybrid machine: circles and arcs around one ball."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.arguments import checked
from trunnion.base.checks import choose, count_of, point, positive
from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.data.ballbar import Ballbar
from trunnion.hybrid.mechanism import Mechanism

#: Axes of the circles: first and second coordinate; angles run from the first to the second.
PLANES: Mapping[str, tuple[int, int]] = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0), "XZ": (0, 2)}


@checked
def ballbar_plan(
    mechanism: Mechanism,
    centre_mm: ArrayLike,
    *,
    setup: int | str = 0,
    radius_mm: float = 150.0,
    direction: ArrayLike = (0.0, 0.0, -1.0),
    wrist: int = 1,
    circles: Sequence[tuple[str, float, float]] = (
        ("XY", 0.0, 360.0),
        ("XZ", -20.0, 200.0),
        ("YZ", -20.0, 200.0),
    ),
    step_deg: float = 5.0,
    both_senses: bool = True,
    repeat_first: bool = True,
    feed_mm_min: float = 1000.0,
    pause_s: float = 30.0,
    start_s: float = 0.0,
) -> Ballbar:
    """Plan circles and arcs around one ball centre; lengths are the nominal radius.

    Parameters
    ----------
    mechanism, direction, wrist
        Joints are those of the nominal machine, the direction a unit vector from spindle to tool
        point, the branch of the wrist 1 or -1.
    centre_mm
        Assumed ball centre, machine frame, (3,).
    setup
        Label of the set-up.
    radius_mm
        Nominal length of the bar.
    circles, step_deg
        Plane, first and last angle (deg), and the angle between readings. A vertical arc of 220°
        stays above the table.
    both_senses, repeat_first
        Run each there and back; run the first again at the end, which shows drift.
    feed_mm_min, pause_s, start_s
        Feed along the circle, pause between circles, time of the first reading.

    Returns
    -------
    Ballbar
        Columns `setup`, `circle` (number of the run), the joints, `sense`, `feed_mm_min`, `time_s`.

    Raises
    ------
    UnknownNameError, InputError
        An unknown plane, or a size that is not above 0.
    KinematicsError
        A point out of reach.
    """
    sizes = {"radius_mm": radius_mm, "step_deg": step_deg, "feed_mm_min": feed_mm_min}
    for what, value in sizes.items():
        positive(what, value)
    centre = np.array(point("centre_mm", centre_mm))
    if not len(circles):
        raise InputError("circles: got none, expected at least one (plane, first, last angle)")
    runs = _runs(circles, step_deg, both_senses=both_senses, repeat_first=repeat_first)
    points = np.vstack([run.points_mm(centre, radius_mm) for run in runs])
    joints = mechanism.nominal.inverse(points, direction, wrist=wrist)
    return Ballbar(
        setup=np.full(len(joints), setup),
        **dict(zip(("l1_mm", "l2_mm", "l3_mm", "q4_deg", "q5_deg"), joints.T, strict=True)),
        length_mm=np.full(len(joints), radius_mm),
        feed_mm_min=np.full(len(joints), feed_mm_min),
        **_schedule(runs, radius_mm, feed_mm_min, pause_s, start_s),
    )


@dataclass(frozen=True, eq=False)
class _Run:
    """One travel along a circle or arc."""

    plane: str
    angles_deg: Floats
    sense: int

    def points_mm(self, centre: Floats, radius_mm: float) -> Floats:
        """Tool points, machine frame, (n, 3)."""
        first, second = PLANES[self.plane]
        points = np.tile(centre, (len(self.angles_deg), 1))
        points[:, first] += radius_mm * np.cos(np.radians(self.angles_deg))
        points[:, second] += radius_mm * np.sin(np.radians(self.angles_deg))
        return points


def _runs(
    circles: Sequence[tuple[str, float, float]],
    step_deg: float,
    *,
    both_senses: bool,
    repeat_first: bool,
) -> list[_Run]:
    runs = []
    for plane, first, last in circles:
        choose("plane of a circle", plane, PLANES)
        count_of("step_deg", abs(last - first), step_deg)
        angles = np.linspace(first, last, round(abs(last - first) / step_deg) + 1)
        runs.append(_Run(plane, angles, 1))
        if both_senses:
            runs.append(_Run(plane, angles[::-1], -1))
    return [*runs, runs[0]] if repeat_first else runs


def _schedule(
    runs: Sequence[_Run], radius_mm: float, feed_mm_min: float, pause_s: float, start_s: float
) -> dict[str, Any]:
    """Columns `circle`, `sense` and `time_s` of all readings."""
    times = []
    clock = start_s
    for run in runs:
        along = np.abs(np.radians(run.angles_deg - run.angles_deg[0])) * radius_mm
        times.append(clock + along / feed_mm_min * 60.0)
        clock = float(times[-1][-1]) + pause_s
    counts = [len(run.angles_deg) for run in runs]
    return {
        "circle": np.repeat(np.arange(len(runs)), counts),
        "sense": np.repeat([run.sense for run in runs], counts),
        "time_s": np.concatenate(times),
    }
