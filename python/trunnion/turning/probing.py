"""The path of the measuring probe along a turned part, and its program (section 2.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from trunnion._core import Program, TurnedProbePath, TurnedProfile
from trunnion.base.arguments import check_fields, checked
from trunnion.base.checks import count_of, finite, line, positive, within
from trunnion.base.report import Result, Table
from trunnion.base.units import Flags, Floats
from trunnion.turning.profile import LOWEST_FEED, Blocks, Profile


@dataclass(frozen=True)
class TurningProbe:
    """The probe of Fig. 4: a ball on a cone below a cylindrical body.

    Parameters
    ----------
    ball_diameter_mm
        d.
    contact_angle_deg
        θ, full angle of the cone: slopes below tan((180° - θ)/2) touch the ball and not the cone.
    body_diameter_mm
        D.

    Notes
    -----
    The paper's text gives 3.175 mm, 89° and 4.9 mm; its Fig. 12 was made with D = 12 mm, an offset
    of 5.5 mm (ball and allowance together) and an angle between 94.9° and 125°.
    """

    ball_diameter_mm: float = 3.175
    contact_angle_deg: float = 89.0
    body_diameter_mm: float = 4.9

    def __post_init__(self) -> None:
        check_fields(self)
        positive("ball_diameter_mm", self.ball_diameter_mm)
        within("contact_angle_deg", self.contact_angle_deg, 0.0, 180.0, "deg")
        positive("body_diameter_mm", self.body_diameter_mm)


@dataclass(frozen=True, eq=False, repr=False)
class Interval(Result):
    """A stretch of one line along which the part is measured; positions of the ball's centre.

    Attributes
    ----------
    element : int
        Index of the line in ``profile.elements``.
    start_mm, end_mm : tuple of float
        z, x (radius) of the ball's centre.
    slope : float
        dx/dz of the line.
    """

    element: int
    start_mm: tuple[float, float]
    end_mm: tuple[float, float]
    slope: float

    def sentences(self) -> Sequence[str]:
        """Where it runs; X as a diameter."""
        (z0, x0), (z1, x1) = self.start_mm, self.end_mm
        return (f"Element {self.element}: Z {z0:.3f} X {2 * x0:.3f} to Z {z1:.3f} X {2 * x1:.3f}.",)

    def tables(self) -> tuple[Table, ...]:
        """One row."""
        return (interval_table([self]),)


@dataclass(frozen=True, eq=False, repr=False)
class ProbePath(Result):
    """The probe's path.

    Attributes
    ----------
    elements, reliefs
        Of the profile: lines and arcs, shape (n, 7), as `Profile.elements` has them; z, x and half
        width of each relief.
    probe, options
        What it was laid out for.
    intervals : tuple of Interval
        In the order of measurement.
    left_out : dict
        Index of an element to the reason why it is not measured, or not all of it.
    moves_mm : ndarray, shape (n, 4)
        z, x from and z, x to of the ball's centre; the first comes down from the retract height.
    feed, measures : ndarray of bool, shape (n,)
        At feed; reading the surface.
    clearance_mm : ndarray, shape (n, 2)
        Least distance between the part with its allowance and the ball; cone and body. 0 while
        measuring, never negative.
    """

    elements: Floats
    reliefs: tuple[tuple[float, float, float], ...]
    probe: TurningProbe
    options: dict[str, Any]
    intervals: tuple[Interval, ...]
    left_out: dict[int, str]
    moves_mm: Floats
    feed: Flags
    measures: Flags
    clearance_mm: Floats

    @property
    def profile(self) -> Profile:
        """The finished contour."""
        return Profile(TurnedProfile.from_elements(self.elements, list(self.reliefs)))

    def _core(self) -> TurnedProbePath:
        return self.profile.core.probe_path(**self.options)

    @checked
    def contact_z_mm(self, interval: int, z_mm: npt.ArrayLike) -> Floats:
        """Z of the point of contact for centres at `z_mm` (equation of 2.3(5)).

        Z1 = Z0 + R sin(arctan a): on a cone the ball touches beside its centre. R is the radius of
        the ball.
        """
        z = line("z_mm", z_mm)
        return self._core().contact_z(interval, z, self.probe.ball_diameter_mm / 2)

    @checked
    def stations_mm(self, pitch_mm: float) -> Floats:
        """Place readings at a pitch along Z: shape (n, 3), interval, centre z, contact z."""
        positive("pitch_mm", pitch_mm)
        rows = []
        for index, interval in enumerate(self.intervals):
            count = count_of("pitch_mm", interval.start_mm[0] - interval.end_mm[0], pitch_mm) + 1
            z = interval.start_mm[0] - pitch_mm * np.arange(count)
            rows.append(np.c_[np.full(count, index), z, self.contact_z_mm(index, z)])
        return np.concatenate(rows) if rows else np.empty((0, 3))

    @checked
    def program(
        self,
        dialect: str,
        *,
        feed: float | None = None,
        first_number: int | None = None,
        head: Blocks = (),
        tail: Blocks = (),
        retract_last: bool = True,
    ) -> Program:
        """Write the probe program: rapids between, feed along the surface.

        The first block moves X and Z at once to the place above the first interval, as in Fig. 12;
        the probe has to stand free of the part before it.

        Parameters
        ----------
        dialect
            One of `trunnion.nc.DIALECTS` for lathes. Programs for LinuxCNC want G7, G18, G21, G90
            in `head`: X is written as a diameter.
        feed
            Measuring feed as the dialect counts it; None writes no F (Fig. 12). `Gauge.feed_limit`
            says how fast the gauge follows.
        first_number
            Number of the first block; None writes none.
        head, tail
            Blocks before and behind, as lists of (letter, value).
        retract_last
            Draw back behind the last interval.

        Raises
        ------
        trunnion.InputError
            For a feed that is none.
        """
        if feed is not None:
            within("feed", feed, LOWEST_FEED)
        return self._core().program(
            dialect=dialect,
            feed=feed,
            first_number=first_number,
            comments=[] if dialect == "paper-um" else self._header(),
            head=head,
            tail=tail,
            retract_last=retract_last,
        )

    def _header(self) -> list[str]:
        """What the control must be in, as comments."""
        radius, face = self.options["chuck_radius_mm"], self.options["chuck_face_mm"]
        return [
            f"Probe: ball diameter {self.probe.ball_diameter_mm:g} mm, body "
            f"{self.probe.body_diameter_mm:g} mm; tool offsets to the centre of the ball",
            "Spindle stopped; X as a diameter, Z from the chuck face",
            f"Chuck: radius {radius:g} mm, face at Z {face:g}"
            if radius > 0
            else "No chuck was stated: nothing but the part is kept clear of",
            f"Stand above X {2 * float(self.moves_mm[:, 1].max()):.3f} before the first move"
            if len(self.moves_mm)
            else "No move",
        ]

    def sentences(self) -> Sequence[str]:
        """Count, and what was left out."""
        return (
            f"{len(self.intervals)} intervals.",
            *(f"element {index}: {reason}" for index, reason in self.left_out.items()),
        )

    def tables(self) -> tuple[Table, ...]:
        """The intervals."""
        return (interval_table(self.intervals),)


def interval_table(intervals: Sequence[Interval]) -> Table:
    """One row an interval; X as a diameter."""
    rows = [
        (f"element {i.element}", i.start_mm[0], 2 * i.start_mm[1], i.end_mm[0], 2 * i.end_mm[1])
        for i in intervals
    ]
    columns = ("", "from Z", "X", "to Z", "X")
    return Table.of("Ball centre (Z, diameter), mm", columns, rows, digits=3)


@checked
def probe_path(
    profile: Profile,
    probe: TurningProbe | None = None,
    *,
    allowance_mm: float = 0.5,
    skip: Sequence[int] = (),
    retract_x_mm: float | None = None,
    approach_mm: float = 1.0,
    chuck_radius_mm: float,
    chuck_face_mm: float = 0.0,
    shortest_mm: float = 1.0,
) -> ProbePath:
    """Lay out the path of the probe (section 2.3) and check every move of it.

    Lines are measured between their change points (Fig. 5) as far as slope (2.3(2)) and the corners
    before and behind (2.3(3), (4); Fig. 6) allow. An interval on which ball, cone or body would
    touch the part with its allowance or the chuck is shortened or left out, and named in
    `left_out`.

    Parameters
    ----------
    profile, probe
        The finished contour; the probe, by default as in the paper's text.
    allowance_mm
        T, what is still on the part, normal to the contour.
    skip
        Elements not to be measured. (Fig. 12 does not measure the flange, by no printed rule.)
    retract_x_mm, approach_mm
        Radius at which the ball's centre crosses, by default 5 mm above what is needed; height
        (radius) above the surface from which it goes down at feed.
    chuck_radius_mm, chuck_face_mm
        Radius over the jaws, and Z of their face, behind which everything up to this radius is
        kept clear of. Has to be stated: a part is measured down to its last line, on which the
        body would meet the jaws. A radius of 0: there is no chuck to keep clear of.
    shortest_mm
        Shortest interval worth measuring.

    Raises
    ------
    trunnion.InputError
        For a probe that cannot be, an allowance that closes a groove, a retract radius too small.
    """
    probe = probe or TurningProbe()
    if retract_x_mm is None:
        top = max(float(profile.outline_mm()[:, 1].max()) + allowance_mm, chuck_radius_mm)
        retract_x_mm = top + probe.ball_diameter_mm / 2 + approach_mm + 5.0
    options: dict[str, Any] = {
        "ball_radius_mm": probe.ball_diameter_mm / 2,
        "contact_angle_deg": probe.contact_angle_deg,
        "body_diameter_mm": probe.body_diameter_mm,
        "allowance_mm": allowance_mm,
        "skip": list(skip),
        "retract_x_mm": retract_x_mm,
        "approach_mm": approach_mm,
        "chuck_radius_mm": chuck_radius_mm,
        "chuck_face_mm": finite("chuck_face_mm", chuck_face_mm),
        "shortest_mm": shortest_mm,
    }
    return _probe_path(profile, probe, options)


def _probe_path(profile: Profile, probe: TurningProbe, options: dict[str, Any]) -> ProbePath:
    core = profile.core.probe_path(**options)
    moves = core.moves()
    return ProbePath(
        elements=profile.elements,
        reliefs=tuple(profile.core.reliefs()),
        probe=probe,
        options=options,
        intervals=tuple(
            Interval(int(row[0]), (row[1], row[2]), (row[3], row[4]), row[5])
            for row in core.intervals().tolist()
        ),
        left_out=dict(core.left_out()),
        moves_mm=moves[:, :4],
        feed=moves[:, 4] > 0,
        measures=moves[:, 5] > 0,
        clearance_mm=moves[:, 6:],
    )
