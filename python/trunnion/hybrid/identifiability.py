"""What a ball-bar plan can determine of the errors, before anything is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import positive
from trunnion.base.report import Result, Table
from trunnion.base.saved import Gridded
from trunnion.base.units import Floats
from trunnion.data.ballbar import Ballbar
from trunnion.hybrid.mechanism import Mechanism
from trunnion.hybrid.parameters import PAPER_ERRORS, error_names
from trunnion.hybrid.readings import gradient_with_centres, joints_of, setup_index, start_centres
from trunnion.hybrid.spectrum import Spectrum, combination

#: A combination with a smaller standard error (µm or arcsec) counts as well determined.
MAX_WELL_DETERMINED_UM = 5.0


@dataclass(frozen=True, eq=False, repr=False)
class Identifiability(Result):
    """What a plan can determine of the errors, before anything is measured.

    Attributes
    ----------
    parameters
        Names of the errors.
    readings, setups
        Counts.
    sigma_um
        Noise of one reading that the standard errors assume.
    rank
        Of the derivative of the readings by the errors, ball centres eliminated.
    condition
        Largest over smallest non-zero singular value, columns in µm per µm or arcsec.
    singular_values
        (k,), largest first, of the same matrix.
    directions
        Right singular vectors, one a row, (k, k): combinations, best determined first.
    std_errors
        Of each error, µm or arcsec; inf for what is not identifiable.
    direction_errors
        Standard error of each combination, (k,); inf for what is not identifiable.
    """

    parameters: tuple[str, ...]
    readings: int
    setups: int
    sigma_um: float
    rank: int
    condition: float
    singular_values: Floats
    directions: Floats
    std_errors: dict[str, float]
    direction_errors: Floats

    def gridded(self) -> Gridded:
        """Return the combinations over the errors, and the standard error of each."""
        arrays = {
            "directions": (("combination", "parameter"), self.directions),
            "singular_values": (("combination",), self.singular_values),
            "direction_errors": (("combination",), self.direction_errors),
            "std_errors": (("parameter",), np.array([*self.std_errors.values()])),
        }
        return Gridded({"parameter": list(self.parameters)}, arrays, {"sigma_um": self.sigma_um})

    @checked
    def well_determined(self, within: float = MAX_WELL_DETERMINED_UM) -> int:
        """Count the combinations with a standard error below this, µm or arcsec."""
        return int(np.sum(self.direction_errors < within))

    @property
    def not_identifiable(self) -> tuple[str, ...]:
        """Combinations that the plan cannot determine, as text."""
        return tuple(combination(v, self.parameters) for v in self.directions[self.rank :])

    def tables(self) -> tuple[Table, ...]:
        """Combinations of errors, best determined first, then the single errors."""
        rows = [
            (str(k + 1), error, combination(self.directions[k], self.parameters, 0.3))
            for k, error in enumerate(self.direction_errors.tolist())
        ]
        title = "Combinations of errors, best determined first"
        return (
            Table.of(title, ("", "std. error", "combination"), rows, digits=3),
            Table.of("Single errors", ("", "std. error"), list(self.std_errors.items()), digits=3),
        )

    def sentences(self) -> Sequence[str]:
        """Rank, condition, and what is not identifiable."""
        return (
            f"{self.readings} readings of {self.sigma_um:g} µm in {self.setups} set-up(s): rank "
            f"{self.rank} of {len(self.parameters)}, condition {self.condition:.0f}, "
            f"{self.well_determined()} combinations within {MAX_WELL_DETERMINED_UM:g} µm or "
            "arcsec.",
            *(f"Not identifiable: {text}." for text in self.not_identifiable),
        )

    def derived(self) -> Mapping[str, Any]:
        """What is not identifiable."""
        return {"not_identifiable": self.not_identifiable}


@checked
def identifiability(
    plan: Ballbar,
    mechanism: Mechanism,
    *,
    parameters: Sequence[str] = PAPER_ERRORS,
    sigma_um: float = 0.5,
    threads: int | None = 1,
) -> Identifiability:
    """Say what ball-bar readings at these poses can determine of the errors.

    Parameters
    ----------
    plan
        Commanded joints and set-ups; `length_mm` is the nominal radius.
    mechanism
        The machine around which derivatives are taken.
    parameters
        Errors to estimate; the 17 by default.
    sigma_um
        Noise of one reading (1 σ).

    Raises
    ------
    DataError
        No joints in the plan.
    InputError
        `sigma_um` not above 0.
    """
    names = error_names(parameters)
    positive("sigma_um", sigma_um)
    matrix, labels = design(plan, mechanism, names, threads)
    spectrum = Spectrum.of(matrix, len(names))
    return Identifiability(
        parameters=names,
        readings=len(plan),
        setups=len(labels),
        sigma_um=sigma_um,
        rank=spectrum.rank,
        condition=float(spectrum.values[0] / spectrum.values[spectrum.rank - 1]),
        singular_values=spectrum.values,
        directions=spectrum.directions,
        std_errors=dict(zip(names, map(float, spectrum.std_errors(sigma_um)), strict=True)),
        direction_errors=spectrum.direction_errors(sigma_um),
    )


def design(
    plan: Ballbar, mechanism: Mechanism, names: Sequence[str], threads: int | None
) -> tuple[Floats, tuple[str, ...]]:
    """Readings of a plan differentiated by errors (µm, arcsec) and ball centres (µm).

    Shape (n, k + 3 setups); and the labels of the set-ups, in the order of their centres.
    """
    joints = joints_of(plan)
    index, labels = setup_index(plan)
    tips = mechanism.forward(joints, threads=threads).tip_mm
    centres = start_centres(tips, plan.length_mm, index)
    _, direction, gradient = mechanism.ballbar(joints, centres[index], names, threads=threads)
    return gradient_with_centres(gradient, direction, index), labels
