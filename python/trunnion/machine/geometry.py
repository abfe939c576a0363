"""What an estimate was made with: the axes that its location errors refer to, kept beside them.

A location error is where an axis is against where the set-up has it. Of another set-up it says
nothing: 50 mm between two points of an A axis are as many micrometres as its tilt makes of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from trunnion.base.errors import DataError, InputError
from trunnion.base.units import Floats
from trunnion.data.frame import frame_changes
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

Triple = tuple[float, float, float]
SAME = 1e-9
"""mm, and of unit vectors: rounding."""


@dataclass(frozen=True)
class Geometry:
    """Where a set-up has the rotary axes of its machine: what location errors refer to.

    Attributes
    ----------
    machine
        Name of the preset, or the kinematic code, as the set-up has it.
    chain
        Kinematic code.
    directions
        Of each rotary axis at zero of all axes, by letter, of any length.
    points_mm
        A point of each rotary axis at zero of all axes, by letter, machine frame.
    senses
        1 or -1 for each rotary axis, by letter.
    pivot_mm
        Height of the pivot, from which points of a head's axes count; 0 without a head.

    Examples
    --------
    >>> import trunnion as tn
    >>> axes = {"A": tn.AxisSetup(point_mm=(0.0, 5.0, -30.0))}
    >>> setup = tn.Setup(tn.Artefact("cross"), axes=axes)
    >>> tn.identify(tn.plan(setup), setup).geometry.points_mm
    {'A': (0.0, 5.0, -30.0), 'C': (0.0, 0.0, 0.0)}
    """

    machine: str
    chain: str
    directions: dict[str, Triple]
    points_mm: dict[str, Triple]
    senses: dict[str, int]
    pivot_mm: float = 0.0

    UPRIGHT: ClassVar[dict[str, Triple]] = {
        "A": (1.0, 0.0, 0.0), "B": (0.0, 1.0, 0.0), "C": (0.0, 0.0, 1.0)
    }  # fmt: skip

    def __post_init__(self) -> None:
        """Check that each axis has a direction, a point and a sense."""
        for name in ("directions", "points_mm"):
            if (letters := [*getattr(self, name)]) != [*self.senses]:
                raise InputError(
                    f"geometry.{name}: got axes {', '.join(letters) or 'none'}, expected "
                    f"{', '.join(self.senses) or 'none'}, those of geometry.senses"
                )

    @classmethod
    def of(cls, setup: Setup) -> Geometry:
        """Return that of a set-up, with what it does not say as it is taken."""
        known, chain = setup.description(), Chain(setup)
        pivot = setup.probe.length_mm if "head" in chain.sides.values() else 0.0
        usual = {k: (0.0, 0.0, pivot if of == "head" else 0.0) for k, of in chain.sides.items()}
        return cls(
            machine=setup.machine.name,
            chain=known.chain,
            directions={k: known.directions.get(k, cls.UPRIGHT[k]) for k in chain.letters},
            points_mm={k: known.points_mm.get(k, usual[k]) for k in chain.letters},
            senses={k: int(s) for k, s in zip(chain.letters, chain.senses, strict=True)},
            pivot_mm=pivot,
        )

    def refuse_other(self, setup: Setup) -> None:
        """Refuse a set-up with other axes than those of this one.

        Raises
        ------
        DataError
            One has another place, direction or sense; the message names key and both values.
        """
        other = Geometry.of(setup)
        found = self.differs(other)
        if found is None:
            return
        key, mine, theirs = found
        file = f" in {setup.source}" if setup.source else ""
        raise DataError(
            f"{key}: got {theirs}{file}, expected {mine}, with which the errors were identified: "
            "location errors refer to these axes. Is it the set-up of another machine, or was it "
            "changed since? Identify again with this one; names with values alone "
            "(estimate.errors) are not compared"
        )

    def differs(self, other: Geometry) -> tuple[str, str, str] | None:
        """Return the first key of the set-up that differs, with both values; None: the same.

        Two points of one line are the same axis, and so are two lengths of one direction.
        """
        if self.chain != other.chain:
            named = "[" not in self.machine + other.machine
            of = (self.machine, other.machine) if named else (self.chain, other.chain)
            return ("machine.preset" if named else "machine.chain", *of)
        for k, sense in self.senses.items():
            way = _unit(self.directions[k])
            if np.abs(way - _unit(other.directions[k])).max() > SAME:
                return f"axes.{k}.direction", *_shown(self.directions[k], other.directions[k])
            if np.abs(self._foot(k, way) - other._foot(k, way)).max() > SAME:
                return f"axes.{k}.point_mm", *_shown(self.points_mm[k], other.points_mm[k])
            if sense != other.senses[k]:
                return f"axes.{k}.sense", str(sense), str(other.senses[k])
        return None

    def _foot(self, letter: str, way: Floats) -> Floats:
        """Point of an axis that is nearest to where its points count from, (3,), mm."""
        point = np.array(self.points_mm[letter])
        if self.pivot_mm and self.of_head(letter):
            point = point - [0.0, 0.0, self.pivot_mm]
        return np.asarray(point - (point @ way) * way)

    def of_head(self, letter: str) -> bool:
        """Whether an axis is on the side of the tool: behind the bed in the kinematic code."""
        return letter in self.chain.partition(" b ")[2].replace("(C)", "")


def made_with(setup: Setup, data: object) -> dict[str, Any]:
    """Return what travels with an estimate of location errors, as fields of it.

    data: The measurement; touches may say the frame that the control had.
    """
    return {
        "tolerances": dict(setup.machine.tolerance),
        "geometry": Geometry.of(setup),
        "control_frame": data.control_frame if isinstance(data, Touches) else None,
    }


def refuse_other_axes(estimate: Any, setup: Setup) -> None:
    """Refuse a set-up with other axes than an estimate was made with; one that says none is taken.

    estimate: Anything with a `geometry`, which may be None.
    """
    if estimate.geometry is not None:
        estimate.geometry.refuse_other(setup)


def of_one_machine(estimates: Sequence[Any]) -> tuple[str, ...]:
    """Refuse estimates of other axes than those of the first, and say whose frame differs.

    estimates: Each an estimate, with or without geometry and frame; anything else says nothing.

    Raises
    ------
    DataError
        The key of the set-up, and both values.
    """
    geometries = [getattr(one, "geometry", None) for one in estimates]
    for i in range(1, len(estimates)):
        first, own = geometries[0], geometries[i]
        apart = None if first is None or own is None else first.differs(own)
        if apart is not None:
            key, mine, theirs = apart
            raise DataError(
                f"{key}: got {theirs} with measurement {i + 1}, expected {mine} as with the first: "
                "location errors refer to these axes. Estimate all of them with one set-up"
            )
    return tuple(frame_changes([getattr(one, "control_frame", None) for one in estimates]))


def _unit(direction: Sequence[float]) -> Floats:
    way = np.array(direction)
    return np.asarray(way / np.linalg.norm(way))


def _shown(*values: Triple) -> tuple[str, str]:
    one, other = (f"[{', '.join(f'{x:.12g}' for x in value)}]" for value in values)
    return one, other
