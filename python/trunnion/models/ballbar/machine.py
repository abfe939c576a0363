"""The two machines of a ball-bar test: three linear axes, and the hybrid parallel machine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from trunnion.base.errors import DataError
from trunnion.base.units import Floats
from trunnion.data.ballbar import Ballbar
from trunnion.diagnosis.effect import Effect
from trunnion.diagnosis.model import Covariate, Nuisance
from trunnion.hybrid.mechanism import Mechanism
from trunnion.hybrid.parameters import PAPER_ERRORS
from trunnion.machine.effects import Owner
from trunnion.models.ballbar.effects import CATALOGUED, Bar, three_axis
from trunnion.models.ballbar.hybrid_effects import Solved, hybrid
from trunnion.models.ballbar.path import AXES, Path
from trunnion.models.ballbar.settings import BallbarSettings
from trunnion.setup import Setup


@dataclass(frozen=True, eq=False)
class ThreeAxis:
    """A machine that goes where it is commanded; n readings.

    tips: Tool points that the nominal machine takes, mm, (n, 3).
    errors: Errors of the machine that are always fitted.
    catalogued: Ids of effects that are in the machine's own catalogue.
    why_not: Why other effects of the machine cannot be compensated.
    """

    tips: Floats
    errors: tuple[Nuisance, ...] = ()
    catalogued: tuple[str, ...] = CATALOGUED
    why_not: str = "it depends on time or on how the axes move, or has no motion(pose, values)"

    @property
    def commands(self) -> Floats:
        """What was commanded, (n, k): equal rows are repeats."""
        return self.tips

    @property
    def start(self) -> Floats:
        """No errors."""
        return np.zeros(0)

    def lengths(self, _: Floats, centres_mm: Floats) -> tuple[Floats, Floats, Floats]:
        """Lengths, mm (n,), direction of the bar (n, 3), µm by each of the errors (n, e)."""
        arms = self.tips - centres_mm
        length = np.linalg.norm(arms, axis=1)
        return length, arms / length[:, None], np.zeros((len(arms), 0))

    def effects(self, path: Path, bar: Bar) -> list[Effect]:
        """Those of the axes."""
        return three_axis(path, bar)

    def covariates(self, path: Path) -> list[Covariate]:
        """Positions of the axes that move."""
        return [
            Covariate(f"{AXES[a].upper()} position", self.tips[:, a], "mm") for a in path.moving
        ]


@dataclass(frozen=True)
class Hybrid:
    """The same for the hybrid machine, which gets there through its loops; joints: (n, 5)."""

    mechanism: Mechanism
    joints: Floats
    catalogued: tuple[str, ...] = ()
    why_not: str = "it moves the legs or the wrist of the hybrid machine, not linear axes X, Y, Z"

    @cached_property
    def _solved(self) -> Solved:
        return Solved.of(self.mechanism, self.joints)

    @property
    def tips(self) -> Floats:
        """Tool points through the loops."""
        return self._solved.tip_mm

    @property
    def commands(self) -> Floats:
        """Commanded joints."""
        return self.joints

    @property
    def errors(self) -> tuple[Nuisance, ...]:
        """The 17 errors that describe its loops."""
        return tuple(
            Nuisance(name, "µm" if name.endswith("_um") else "arcsec", Owner.MACHINE)
            for name in PAPER_ERRORS
        )

    @property
    def start(self) -> Floats:
        """Errors of the set-up."""
        return np.array([self.mechanism.errors.get(name, 0.0) for name in PAPER_ERRORS])

    def lengths(self, errors: Floats, centres_mm: Floats) -> tuple[Floats, Floats, Floats]:
        """Lengths with these errors, those of the set-up outside the 17 kept."""
        kept = {k: v for k, v in self.mechanism.errors.items() if k not in PAPER_ERRORS}
        named = dict(zip(PAPER_ERRORS, map(float, errors), strict=True))
        machine = self.mechanism.with_errors(kept | named)
        return machine.ballbar(self.joints, centres_mm, PAPER_ERRORS)

    def effects(self, path: Path, bar: Bar) -> list[Effect]:
        """Those of legs, wrist and base."""
        return hybrid(path, bar, self._solved, self.joints)

    def covariates(self, _: Path) -> list[Covariate]:
        """Lengths of the legs and angles of the wrist."""
        legs = [Covariate(f"length of leg {k + 1}", self.joints[:, k], "mm") for k in range(3)]
        return legs + [Covariate(f"wrist joint {k + 1}", self.joints[:, k], "deg") for k in (3, 4)]


Machine: TypeAlias = ThreeAxis | Hybrid


def machine_of(data: Ballbar, setup: Setup | None, settings: BallbarSettings) -> Machine:
    """Return the machine that was measured: hybrid if joints or a table ``[hybrid]`` say so.

    Raises DataError: neither joints nor coordinates.
    Raises KinematicsError: joints or points that the hybrid machine cannot take.
    """
    if data.joints is None and (setup is None or not setup.hybrid):
        return ThreeAxis(_coordinates(data))
    mechanism = Mechanism() if setup is None else Mechanism.from_setup(setup)
    if data.joints is not None:
        return Hybrid(mechanism, np.asarray(data.joints))
    points, direction = _coordinates(data), settings.direction
    return Hybrid(mechanism, mechanism.nominal.inverse(points, direction, wrist=settings.wrist))


def _coordinates(data: Ballbar) -> Floats:
    position = data.position_mm
    if position is None:
        raise DataError("ball-bar: got no coordinates, expected columns x_mm and y_mm")
    if position.shape[1] == 2:
        return np.column_stack([position, np.zeros(len(position))])
    return np.asarray(position)
