"""What each way to compensate leaves of a machine as estimated, over one stated work space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.report import SHOWN, Cell, Result, Shown, Table, left_text
from trunnion.base.units import Floats
from trunnion.compensation.control import (
    Compensation,
    ControlModel,
    InverseCompensation,
    ModelCompensation,
)
from trunnion.compensation.machine import Known, MachineErrors
from trunnion.compensation.maps import ErrorMap
from trunnion.compensation.parameters import CncParameters, cnc_parameters
from trunnion.compensation.uncertainty import residual_interval
from trunnion.compensation.volumetric import volumetric_error
from trunnion.compensation.workspace import Workspace, work_space
from trunnion.machine.chain import Chain
from trunnion.machine.estimate import Estimate
from trunnion.machine.sizes import size_doubt
from trunnion.setup import Setup

NOTHING, PARAMETERS, ROUNDED = "nothing compensated", "CNC parameters", "CNC parameters, rounded"
MAP, EXACT, ALL_AXES = "error map", "linear axes, exact", "all axes, exact"
DRAWS = 1000
SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0
"""Weights of three nodes: exact for the square of an error that is affine in the point."""


@dataclass(frozen=True)
class Left:
    """What one way to compensate leaves.

    Attributes
    ----------
    name
        Of the way.
    max_um, rms_um
        Volumetric error, largest and root mean square over the solid box and the rotary positions.
    direction_arcsec
        Largest error of the tool direction.
    max_interval_um, rms_interval_um
        Where both lie for the uncertainty of the estimate, 95 %; None where that is not known.
    """

    name: str
    max_um: float
    rms_um: float
    direction_arcsec: float
    max_interval_um: tuple[float, float] | None = None
    rms_interval_um: tuple[float, float] | None = None

    @classmethod
    def by(
        cls,
        name: str,
        setup: Setup,
        known: MachineErrors,
        compensation: Compensation | None,
        where: Workspace,
    ) -> Left:
        """Return what a compensation leaves of known errors."""
        found = volumetric_error(
            setup, known, compensation=compensation, points=(3, 3, 3), **where.arguments()
        )
        weights = (SIMPSON if n == len(SIMPSON) else np.ones(1) for n in found.grid_shape)
        square = np.einsum("...ijk,i,j,k->...", found.magnitude_um**2, *weights)
        direction = float(np.max(found.direction_by_pose_arcsec))
        return cls(name, found.max_um, float(np.sqrt(np.mean(square))), direction)


@dataclass(frozen=True)
class SignTest:
    """How far apart a control finds a ball on the table at two postures.

    Attributes
    ----------
    place_mm
        Of the ball's centre on the table.
    postures
        Letter → rotary position, control's sign, of both.
    before_um, after_um, opposite_um
        Distance of both places without the parameters, with them, and with all signs changed.
    """

    place_mm: tuple[float, float, float]
    postures: tuple[Mapping[str, float], Mapping[str, float]]
    before_um: float
    after_um: float
    opposite_um: float


@dataclass(frozen=True, eq=False, repr=False)
class CompensationForecast(Result):
    """What each way to compensate leaves of a machine as estimated. See `compensation_forecast`.

    Attributes
    ----------
    errors, std_errors
        Location errors of the estimate and their standard uncertainties, µm and arcsec.
    parameters
        Parameters of a control that leave the least.
    left
        What each way leaves, nothing compensated first.
    space
        The work space in words.
    sign_test
        Touches that show whether the control takes the parameters with their sign; None without
        rotary axes.
    files
        Name → SHA-256 of files that were written with it.
    """

    errors: Mapping[str, float]
    std_errors: Mapping[str, float]
    parameters: CncParameters
    left: tuple[Left, ...]
    space: str
    sign_test: SignTest | None = None
    files: Mapping[str, str] = field(default_factory=dict)

    def title(self) -> str:
        """Name the result."""
        return "Compensation of the machine as estimated"

    def by_name(self, name: str) -> Left | None:
        """Return what a way leaves; None where it was not looked at."""
        return next((one for one in self.left if one.name == name), None)

    def sentences(self) -> Sequence[str]:
        """Before and after, the work space, what the parameters cannot hold."""
        after = self.by_name(PARAMETERS)
        lines = [before_and_after(self.left[0], after or self.left[0], "parameters of the control")]
        lines.append(f"Work space: {self.space}.")
        lines += filter(None, [size_doubt(self.errors, self.std_errors)])
        if held := self.parameters.held_in_words([k for k, v in self.errors.items() if v]):
            lines.append(held)
        exact = self.by_name(MAP)
        if exact is not None and after is not None:
            lines.append(
                f"An error map leaves {left_text(exact.max_um)} µm at most, of the machine as "
                f"estimated; the tool direction stays wrong by up to {exact.direction_arcsec:.3g} "
                f"arcsec, with the parameters {after.direction_arcsec:.3g} arcsec."
            )
        return lines

    def tables(self) -> tuple[Table, ...]:
        """What each way leaves, and the parameters."""
        some = any(one.max_interval_um for one in self.left)
        rows: list[tuple[Cell, ...]] = []
        for one in self.left:
            cells: list[Cell] = [one.name]
            for value, span in (
                (one.max_um, one.max_interval_um),
                (one.rms_um, one.rms_interval_um),
            ):
                cells += [Shown(value, f"{value:.3f}"), *([_interval(span)] if some else [])]
            angle = Shown(one.direction_arcsec, f"{one.direction_arcsec:.2f}")
            rows.append((*cells, angle))
        heads = ["", "largest", "rms", "direction"]
        if some:
            heads[2:3] = ["largest, 95 %", "rms", "rms, 95 %"]
        title = "Volumetric error left, µm; tool direction, arcsec"
        return (Table.of(title, heads, rows), self.parameters.tables()[0])


def before_and_after(before: Left, after: Left, means: str) -> str:
    """Say the one sentence of a compensation."""
    said = (
        f"Volumetric error over the work space: rms {_size(before.rms_um)} → "
        f"{_size(after.rms_um)} µm, largest {_size(before.max_um)} → {_size(after.max_um)} µm "
        f"with {means}"
    )
    if after.max_interval_um is None:
        return f"{said}, if the machine is as estimated."
    interval = _interval(after.max_interval_um)
    return f"{said}; for the uncertainty of the estimate {interval} µm at most (95 %)."


def _size(value: float) -> str:
    return left_text(value) if value < SHOWN else f"{value:#.3g}".rstrip(".")


def _interval(span: tuple[float, float] | None) -> str:
    return "" if span is None else f"{span[0]:.3g} to {span[1]:.3g}"


@checked
def compensation_forecast(
    setup: Setup, estimate: Known, *, table: ErrorMap | None = None, seed: int = 0
) -> CompensationForecast:
    """Forecast what each way to compensate leaves, over one work space.

    The work space is the box of `volumetric_error` on the table and the ranges that the set-up
    states of the rotary axes, else ±90° and a turn of the table.

    Parameters
    ----------
    setup
        Machine.
    estimate
        Result of an identification, or errors by name.
    table
        An error map to judge beside them.
    seed
        Of the draws for the intervals.

    Raises
    ------
    DataError
        A location error that is not identifiable.

    Examples
    --------
    >>> import trunnion as tn
    >>> from trunnion.compensation import compensation_forecast
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> found = compensation_forecast(setup, {"EX0C": 15.0})
    >>> round(found.parameters.centres_um["EX0C"], 6)
    15.0
    """
    known, where = MachineErrors.to_compensate(setup, estimate), work_space(setup)
    # Parameters and tool direction follow no motion of the linear axes; the fields below have them.
    parameters = cnc_parameters(setup, replace(known, own=()), **where.arguments())
    ways: dict[str, Compensation | None] = {NOTHING: None, PARAMETERS: parameters}
    ways[ROUNDED] = parameters.rounded(setup)
    if table is not None:
        ways[MAP] = table
    ways[EXACT] = ModelCompensation(known)
    if not known.own:
        ways[ALL_AXES] = InverseCompensation(known)
    left = [Left.by(name, setup, known, way, where) for name, way in ways.items()]
    if isinstance(estimate, Estimate) and estimate.names and not known.own:
        left = [_uncertain(one, setup, estimate, ways[one.name], where, seed) for one in left]
    return CompensationForecast(
        dict(known.errors),
        dict(estimate.std_errors) if isinstance(estimate, Estimate) else {},
        parameters,
        tuple(left),
        where.in_words(setup),
        _sign_test(setup, known, parameters, where),
    )


def _uncertain(
    one: Left,
    setup: Setup,
    estimate: Estimate,
    way: Compensation | None,
    where: Workspace,
    seed: int,
) -> Left:
    """Add the intervals, where the way is a machine that the control assumes."""
    if not isinstance(way, ControlModel):
        return one
    found = residual_interval(
        setup, estimate, **where.arguments(), compensation=way, draws=DRAWS, seed=seed
    )
    return replace(one, max_interval_um=found.max_um, rms_interval_um=found.rms_um)


def _sign_test(
    setup: Setup, known: MachineErrors, set_: CncParameters, where: Workspace
) -> SignTest | None:
    """Find the two postures at which a wrong sign shows most."""
    chain = Chain(setup)
    if not chain.letters:
        return None
    ends = {k: (float(v[0]), float(v[-1])) for k, v in where.rotary(setup)[0].items()}
    low, high = np.array(where.ends()).T[[0, -1]]
    place = 0.5 * (low + high) + np.array([0.25, 0.0, 0.0]) * (high - low)
    start = {k: float(np.clip(0.0, *span)) for k, span in ends.items()}
    turned = {k: [low, high] for k, (low, high) in ends.items()}
    if chain.turning in turned:  # a whole turn comes back to where it began
        low_deg, high_deg = ends[chain.turning]
        turned[chain.turning] = [min(low_deg + 180.0, high_deg)]
    opposite = CncParameters(
        {k: -v for k, v in set_.zeros_arcsec.items()}, {k: -v for k, v in set_.centres_um.items()}
    )
    found = []
    for letter, positions in turned.items():
        for position in positions:
            postures = (start, {**start, letter: position})
            apart = [_apart(setup, known, way, place, postures) for way in (None, set_, opposite)]
            x, y, z = map(float, place)
            found.append(SignTest((x, y, z), postures, *apart))
    return max(found, key=lambda one: one.opposite_um - one.after_um)


def _apart(
    setup: Setup,
    known: MachineErrors,
    way: Compensation | None,
    place: Floats,
    postures: Sequence[Mapping[str, float]],
) -> float:
    """Return how far apart a ball at a place of the table is found at two postures, µm."""
    found = []
    for posture in postures:
        at: dict[str, Any] = {f"{k.lower()}_deg": v for k, v in posture.items()}
        at |= {f"{x}_mm": [v] for x, v in zip("xyz", place.tolist(), strict=True)}
        field_um = volumetric_error(setup, known, compensation=way, **at).field_um
        found.append(field_um.reshape(3))
    return float(np.linalg.norm(found[1] - found[0]))
