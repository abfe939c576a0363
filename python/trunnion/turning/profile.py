"""The workpiece: its contour, from points, from a finishing program, and back to a program."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from trunnion._core import Program, TurnedProfile
from trunnion.base.arguments import check_fields, checked
from trunnion.base.checks import whole, within
from trunnion.base.report import Result, Table
from trunnion.base.units import Floats

LOWEST_FEED = 1e-6
"""Below it a program would have F0."""

Kind: TypeAlias = Literal["sharp", "fillet", "arc-in", "arc-out", "arc-to-arc", "relief"]
Follows: TypeAlias = Literal["contour", "nose-centre", "tip"]
Blocks: TypeAlias = Sequence[Sequence[tuple[str, float]]]


@dataclass(frozen=True)
class Corner:
    """An input point of the shape (Fig. 3), from the tailstock towards the chuck.

    Parameters
    ----------
    z_mm, x_mm
        Position; x is the radius.
    kind
        ``"sharp"``; ``"fillet"``, an arc tangent to both lines; ``"arc-out"``, the contour leaves
        the point on an arc; ``"arc-in"``, it comes in on an arc and leaves straight;
        ``"arc-to-arc"``, both; ``"relief"``, an undercut that is made after finishing: nothing is
        measured there.
    radius_mm
        Of the fillet; of the arc that leaves the point, positive with its centre in the material
        (convex), negative with its centre in the air; half width of the relief. Not used by
        ``"sharp"`` and ``"arc-in"``.
    """

    z_mm: float
    x_mm: float
    kind: Kind = "sharp"
    radius_mm: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, eq=False, repr=False)
class Finishing(Result):
    """A finishing program.

    Attributes
    ----------
    dialect, text : str
        The program: X in diameters, arcs by radius.
    left_out_mm : tuple of (z, z)
        Stretches, from the tailstock, that fall more steeply than the tool can follow, up to where
        it plunged: another tool's work.
    """

    dialect: str
    text: str
    left_out_mm: tuple[tuple[float, float], ...]

    @property
    def program(self) -> Program:
        """The program."""
        return Program.parse(self.text, self.dialect)

    def sentences(self) -> Sequence[str]:
        """Length, and what is left to another tool."""
        return (
            f"Finishing program of {len(self.program)} blocks; stretches left out: "
            f"{len(self.left_out_mm)}.",
        )

    def tables(self) -> tuple[Table, ...]:
        """Stretches that another tool has to cut."""
        rows = [(str(k + 1), *z) for k, z in enumerate(self.left_out_mm)]
        return (Table.of("Stretches left out", ("", "from z mm", "to z mm"), rows, digits=3),)


@dataclass(frozen=True)
class Profile:
    """A turned contour of lines and arcs, tailstock first; made by its ``from_`` methods."""

    core: TurnedProfile

    @classmethod
    @checked
    def from_points(cls, points: Iterable[Corner | tuple[float, float]]) -> Profile:
        """From input points.

        Parameters
        ----------
        points
            `Corner`, or ``(z, x)`` for a sharp one.

        Raises
        ------
        trunnion.InputError
            For a contour that folds back (z that grows), fillets that do not fit, arcs that do not
            reach, kinds of corner that contradict each other.
        """
        corners = [p if isinstance(p, Corner) else Corner(*p) for p in points]
        return cls(
            TurnedProfile.from_vertices(
                [(float(c.z_mm), float(c.x_mm), c.kind, float(c.radius_mm)) for c in corners]
            )
        )

    @classmethod
    @checked
    def from_program(
        cls,
        program: Program,
        *,
        follows: Follows = "contour",
        nose_mm: float = 0.0,
        feed: float | None = None,
        machine_codes: Sequence[tuple[str, float]] = (),
    ) -> Profile:
        """From a finishing program: its longest run of feed moves, or the contour of its G71 P Q.

        Parameters
        ----------
        program
            In any lathe dialect.
        follows
            What the coordinates hold: ``"contour"`` (under G41, G42, or a sharp tool),
            ``"nose-centre"`` or ``"tip"`` (the imaginary tip, orientation 3) of a nose of radius
            `nose_mm`.
        feed
            Feed in force before the program, if it sets none itself.
        machine_codes
            Codes of this machine that move no axis.

        Raises
        ------
        trunnion.ProgramError
            With line and column, for what cannot be followed or folds back.
        """
        return cls(
            TurnedProfile.from_program(
                program,
                follows=follows,
                nose_mm=nose_mm,
                feed=feed,
                machine_codes=list(machine_codes),
            )
        )

    @property
    def elements(self) -> Floats:
        """Lines and arcs, shape (n, 7): kind, z0, x0, z1, x1, centre z, centre x.

        Kind is 0 for a line, 1 for a convex arc (centre in the material), -1 for a concave one.
        """
        return self.core.elements()

    @checked
    def path(
        self,
        follows: Follows,
        nose_mm: float,
        convex: Literal["meet", "roll"] = "roll",
    ) -> Floats:
        """Give what a program that cuts this profile holds; same columns as `elements`."""
        return self.core.path(follows, nose_mm, convex)

    @checked
    def radius_mm(self, z_mm: float) -> float | None:
        """Radius at z; the larger one at a wall; None beside the part."""
        return self.core.radius_at(z_mm)

    @checked
    def outline_mm(self, step_mm: float = 0.2) -> Floats:
        """Points (z, x) along the contour, arcs divided to `step_mm`, for drawing; shape (m, 2)."""
        return outline(self.elements, step_mm)

    @checked
    def finishing(
        self,
        dialect: str,
        *,
        follows: Follows = "contour",
        nose_mm: float = 0.0,
        convex: Literal["meet", "roll"] = "roll",
        first_element: int = 0,
        start_z_mm: float | None = None,
        retract_x_mm: float | None = None,
        approach_mm: float = 1.0,
        steepest_fall: float = 0.6,
        access_z_mm: Sequence[float] = (),
        feed: float | None = None,
        first_number: int | None = None,
        head: Blocks = (),
        tail: Blocks = (),
    ) -> Finishing:
        """Write the finishing program.

        Where the contour falls towards the chuck more steeply than the tool follows, the tool is
        drawn back and plunges at a point of access on a floor further on, as in Fig. 14.

        Parameters
        ----------
        dialect, feed, first_number, head, tail
            As in `ProbePath.program`.
        follows, nose_mm
            As in `from_program`. With ``"contour"`` put G42 into `head` and G40 into `tail` where
            the control is to compensate for the nose.
        convex
            At convex corners of a centre path: ``"roll"`` around the corner or ``"meet"`` where the
            offset lines do (the paper).
        first_element
            Element at which cutting begins (1 leaves out the face).
        start_z_mm, retract_x_mm
            Where the tool sets in, by default 2 mm and the nose before the part, and to what radius
            it draws back, by default 5 mm and the nose above the largest.
        approach_mm, access_z_mm
            Height (radius) above a floor from which a plunge goes at feed; where it may plunge.
        steepest_fall
            Largest -dx/dz the back edge allows: 0.6 is 31 degrees.

        Raises
        ------
        trunnion.InputError
            For a nose that does not fit, a fall without access, a retract radius below the part, a
            feed that is none.
        """
        elements = self.elements
        if start_z_mm is None:
            start_z_mm = float(elements[0, 1]) + nose_mm + 2.0
        if retract_x_mm is None:
            retract_x_mm = float(self.outline_mm()[:, 1].max()) + nose_mm + 5.0
        whole("first_element", first_element, 0, len(elements) - 1)
        within("steepest_fall", steepest_fall, 0.0)
        if feed is not None:
            within("feed", feed, LOWEST_FEED)
        program, left_out = self.core.finishing(
            dialect=dialect,
            follows=follows,
            nose_mm=nose_mm,
            convex=convex,
            first_element=first_element,
            start_z_mm=start_z_mm,
            retract_x_mm=retract_x_mm,
            approach_mm=approach_mm,
            steepest_fall=steepest_fall,
            access_z_mm=list(access_z_mm),
            feed=feed,
            first_number=first_number,
            head=head,
            tail=tail,
        )
        return Finishing(dialect, program.text(), tuple(left_out))


def outline(elements: Floats, step_mm: float) -> Floats:
    """Points along lines and arcs, arcs divided to `step_mm`; shape (m, 2), columns z and x."""
    points = [elements[:1, 1:3]]
    for kind, *row in elements:
        start, end, centre = (np.array(row[i : i + 2]) for i in (0, 2, 4))
        if kind == 0:
            points.append(end[None])
            continue
        a, b = start - centre, end - centre
        turned = np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
        turned = kind * ((kind * turned) % (2 * np.pi))
        count = max(2, int(np.ceil(abs(turned) * float(np.hypot(*a)) / step_mm)))
        angle = np.linspace(0.0, turned, count + 1)[1:]
        cosine, sine = np.cos(angle), np.sin(angle)
        points.append(centre + np.c_[cosine * a[0] - sine * a[1], sine * a[0] + cosine * a[1]])
    return np.concatenate(points)
