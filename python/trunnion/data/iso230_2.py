"""Accuracy and repeatability of positioning by ISO 230-2:2014, clauses 3 and 8.

With deviations x_ij of target i in run j, from the positive (↑) and the negative direction (↓),
their means x̄_i and estimators of the standard uncertainty s_i of each direction:

- reversal B_i = x̄_i↑ - x̄_i↓; of the axis B = max |B_i|, mean B̄ = Σ B_i / m;
- repeatability R_i↑ = 4 s_i↑, R_i = max(2 s_i↑ + 2 s_i↓ + |B_i|, R_i↑, R_i↓), of the axis the
  largest;
- systematic deviation E↑ = max x̄_i↑ - min x̄_i↑, E over both directions, M of their mean;
- accuracy A↑ = max(x̄_i↑ + 2 s_i↑) - min(x̄_i↑ - 2 s_i↑), A over both directions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.conformity import PROBABILITY, Conformity
from trunnion.base.errors import InputError
from trunnion.base.repeats import shared_variance
from trunnion.base.report import Cell, Result, Shown, Table, measured, number, position
from trunnion.base.saved import Gridded
from trunnion.base.units import Floats, suffix_of

FIGURES: Mapping[str, str] = {
    "reversal": "reversal B",
    "mean_reversal": "mean reversal B̄",
    "repeatability_forward": "repeatability R↑",
    "repeatability_backward": "repeatability R↓",
    "repeatability": "repeatability R",
    "systematic_forward": "systematic deviation E↑",
    "systematic_backward": "systematic deviation E↓",
    "systematic": "systematic deviation E",
    "mean_systematic": "mean bi-directional deviation M",
    "accuracy_forward": "accuracy A↑",
    "accuracy_backward": "accuracy A↓",
    "accuracy": "accuracy A",
}
"""Figure of the standard → what people call it."""

ALIKE = 2 / np.sqrt(np.pi)  # chance that two stops round otherwise, by their noise in steps
DRAWS = 400
SEED = 1


@dataclass(frozen=True)
class _Stops:
    """Means and standard deviations by target from each direction, shape (m,) or (m, s)."""

    up: Floats
    down: Floats
    s_up: Floats
    s_down: Floats

    def figures(self) -> dict[str, Floats]:
        """Every figure of the standard."""
        up, down, s_up, s_down = self.up, self.down, self.s_up, self.s_down
        b = up - down
        both = np.concatenate([up, down])
        high = np.concatenate([up + 2 * s_up, down + 2 * s_down])
        low = np.concatenate([up - 2 * s_up, down - 2 * s_down])
        r = np.maximum(2 * s_up + 2 * s_down + np.abs(b), 4 * np.maximum(s_up, s_down))
        return {
            "reversal": np.abs(b).max(axis=0),
            "mean_reversal": b.mean(axis=0),
            "repeatability_forward": 4 * s_up.max(axis=0),
            "repeatability_backward": 4 * s_down.max(axis=0),
            "repeatability": r.max(axis=0),
            "systematic_forward": np.ptp(up, axis=0),
            "systematic_backward": np.ptp(down, axis=0),
            "systematic": np.ptp(both, axis=0),
            "mean_systematic": np.ptp((up + down) / 2, axis=0),
            "accuracy_forward": (up + 2 * s_up).max(axis=0) - (up - 2 * s_up).min(axis=0),
            "accuracy_backward": (down + 2 * s_down).max(axis=0) - (down - 2 * s_down).min(axis=0),
            "accuracy": high.max(axis=0) - low.min(axis=0),
        }


def _over_targets(found: Any, names: Sequence[str], unit: str) -> Gridded:
    """Return arrays of a result, in this unit, over its targets."""
    target = "target_deg" if unit == "arcsec" else "target_mm"
    arrays = {f"{name}_{unit}": ((target,), getattr(found, name)) for name in names}
    return Gridded({target: found.targets}, arrays, {})


def _shown(values: Sequence[float], std: float) -> tuple[Shown, ...]:
    """Numbers of a row, to two digits of a standard uncertainty that all rows share."""
    digits = int(np.clip(1 - np.floor(np.log10(std)), 0, 6)) if std > 0 else 3
    return tuple(Shown(float(v), number(float(v), digits)) for v in values)


@dataclass(frozen=True, eq=False, repr=False)
class CompensationTable(Result):
    """Corrections to add to commanded positions of an axis; what a control makes of it is its own.

    Attributes
    ----------
    targets
        Positions, in `position_unit`, (m,).
    forward, backward
        Corrections for an approach from below and from above, in `unit`, (m,).
    position_unit, unit
        "mm" and "µm", or "deg" and "arcsec".

    Examples
    --------
    >>> import trunnion as tn
    >>> import numpy as np
    >>> turned = np.tile(np.arange(0.0, 360.0, 60.0), 4)
    >>> data = tn.Positioning(
    ...     target_deg=turned,
    ...     measured_deg=turned + 1e-4 * np.sin(7.0 * np.arange(24)),
    ...     direction=np.tile(np.repeat([1, -1], 6), 2),
    ...     cycle=np.repeat([1, 2], 12),
    ... )
    >>> table = data.iso230_2().compensation_table(zero_at=60.0)
    >>> table.to_dataframe().shape
    (6, 3)
    """

    targets: Floats
    forward: Floats
    backward: Floats
    position_unit: str
    unit: str

    def gridded(self) -> Gridded:
        """Return the corrections over the targets."""
        return _over_targets(self, ("forward", "backward"), suffix_of(self.unit))

    def headline(self) -> str:
        """Count and largest correction."""
        largest = max(np.abs(self.forward).max(), np.abs(self.backward).max())
        return f"{len(self.targets)} targets, corrections to {largest:.3g} {self.unit}"

    def tables(self) -> tuple[Table, ...]:
        """One target a row."""
        largest = float(max(np.abs(self.forward).max(), np.abs(self.backward).max()))
        rows: list[tuple[Cell, ...]] = [
            (position(float(t)), *_shown((f, b), largest / 100))
            for t, f, b in zip(self.targets, self.forward, self.backward, strict=True)
        ]
        heads = (
            f"target, {self.position_unit}",
            f"correction ↑, {self.unit}",
            f"correction ↓, {self.unit}",
        )
        return (Table.of("Compensation", heads, rows),)


@dataclass(frozen=True, eq=False, repr=False)
class _Results:
    """What both kinds of axis have.

    Attributes
    ----------
    targets
        Target positions, mm or degrees, (m,).
    mean_forward, mean_backward, spread_forward, spread_backward
        Mean deviation and its standard deviation at each target, (m,).
    std_errors
        Standard uncertainty of each figure by the scatter of the stops and by the step in which
        they are recorded (not of the instrument, the alignment or the temperature), by simulation
        with one spread for each direction. Stops at a target that round alike share their error of
        rounding: it does not shrink with their number.
    notes
        What of the stops is taken otherwise than it is written, one sentence each.
    """

    targets: Floats
    mean_forward: Floats
    mean_backward: Floats
    spread_forward: Floats
    spread_backward: Floats
    std_errors: Mapping[str, float]
    notes: tuple[str, ...] = field(default=(), kw_only=True)

    def title(self) -> str:
        """Name the result."""
        return "Positioning, ISO 230-2"

    def sentences(self) -> tuple[str, ...]:
        """Return the notes."""
        return self.notes

    @classmethod
    def of(
        cls,
        targets: Floats,
        up: Sequence[Floats],
        down: Sequence[Floats],
        step: float = 0.0,
        notes: tuple[str, ...] = (),
    ) -> Self:
        """Results of deviations at targets, from the positive and the negative direction.

        step: In which positions are recorded, in the unit of the results; 0: none is known.
        """
        mean = [np.array([x.mean() for x in some]) for some in (up, down)]
        size = [np.array([x.std(ddof=1) for x in some]) for some in (up, down)]
        count = [np.array([len(x) for x in some])[:, None] for some in (up, down)]
        # one spread for all targets of a direction: each target's own would be drawn twice
        pooled = [np.sqrt(np.mean(s**2)) for s in size]
        rng = np.random.default_rng(SEED)
        shape = (len(targets), DRAWS)
        means = [
            m[:, None] + s / np.sqrt(n) * rng.standard_normal(shape)
            for m, s, n in zip(mean, pooled, count, strict=True)
        ]
        spreads = [
            s * np.sqrt(rng.chisquare(n - 1, shape) / (n - 1))
            for s, n in zip(pooled, count, strict=True)
        ]
        rounded = [np.sqrt(12 * shared_variance(float(s) ** 2, step)) for s in pooled]
        means = [m + w * rng.uniform(-0.5, 0.5, shape) for m, w in zip(means, rounded, strict=True)]
        # so much noise leaves so many repeats alike
        unseen = [
            w / (ALIKE * np.sum(n - 1)) * rng.standard_exponential(DRAWS)
            for w, n in zip(rounded, count, strict=True)
        ]
        spreads = [np.hypot(s, more) for s, more in zip(spreads, unseen, strict=True)]
        drawn = _Stops(*means, *spreads).figures()
        unit = cls.unit_name()
        figures = _Stops(*mean, *size).figures()
        return cls(
            targets=targets,
            mean_forward=mean[0],
            mean_backward=mean[1],
            spread_forward=size[0],
            spread_backward=size[1],
            std_errors={f"{k}_{unit}": float(np.std(v)) for k, v in drawn.items()},
            notes=notes,
            **{f"{name}_{unit}": float(value) for name, value in figures.items()},
        )

    @classmethod
    def unit_name(cls) -> str:
        """Unit at the end of names."""
        return "um"

    def gridded(self) -> Gridded:
        """Return mean deviation and spread over the targets."""
        names = ("mean_forward", "mean_backward", "spread_forward", "spread_backward")
        return _over_targets(self, names, self.unit_name())

    @classmethod
    def labels(cls) -> dict[str, str]:
        """Name of each figure → what people call it."""
        return {f"{name}_{cls.unit_name()}": label for name, label in FIGURES.items()}

    def conformity(
        self,
        *,
        standard_uncertainty: float = 0.0,
        probability: float = PROBABILITY,
        **tolerances: float,
    ) -> Conformity:
        """Compare figures with their tolerances: pass, fail or undecided (ISO 14253-1).

        Parameters
        ----------
        standard_uncertainty
            Of the instrument, its alignment and the temperature (ISO/TR 230-9), in the unit of the
            results; added to that of the scatter.
        probability
            Of a right decision.
        **tolerances
            By the name of the figure or its letter: ``accuracy_um=20.0``, ``B=5.0``; a figure
            counts without its sign.

        Raises
        ------
        InputError, UnknownNameError
            No tolerance, one that is not above 0, or an unknown figure.
        """
        values = {name: getattr(self, name) for name in self.std_errors}
        codes = {label.rpartition(" ")[2]: name for name, label in self.labels().items()}
        return Conformity.of(
            values,
            self.std_errors,
            {codes.get(name, name): limit for name, limit in tolerances.items()},
            labels=self.labels(),
            more=standard_uncertainty,
            probability=probability,
        )

    @checked
    def compensation_table(self, *, zero_at: float | None = None) -> CompensationTable:
        """Return what to add to commanded positions, by target and direction of approach.

        zero_at: Target (mm or degrees) where the mean of both corrections is to be zero, such as
            the reference point; None: as measured, with the instrument's offset in it.

        Raises
        ------
        InputError
            A place outside the targets.
        """
        zero = 0.0
        if zero_at is not None:
            low, high = float(self.targets[0]), float(self.targets[-1])
            if not low <= zero_at <= high:
                raise InputError(f"zero_at: got {zero_at:g}, expected {low:g} to {high:g}")
            mean = (self.mean_forward + self.mean_backward) / 2
            zero = float(np.interp(zero_at, self.targets, mean))
        rotary = self.unit_name() == "arcsec"
        return CompensationTable(
            self.targets,
            zero - self.mean_forward,
            zero - self.mean_backward,
            "deg" if rotary else "mm",
            "arcsec" if rotary else "µm",
        )

    def headline(self) -> str:
        """Accuracy, repeatability and reversal."""
        unit = self.unit_name()
        a, r, b = (getattr(self, f"{n}_{unit}") for n in ("accuracy", "repeatability", "reversal"))
        return f"A {a:.3g}, R {r:.3g}, B {b:.3g} {unit.replace('um', 'µm')}"

    def tables(self) -> tuple[Table, ...]:
        """Return the figures of the standard, and the targets."""
        unit = self.unit_name()
        shown = unit.replace("um", "µm")
        rows: list[tuple[Cell, ...]] = [
            (
                text,
                *measured(getattr(self, f"{name}_{unit}"), self.std_errors[f"{name}_{unit}"]),
                shown,
            )
            for name, text in FIGURES.items()
        ]
        columns = ("", "value", "standard uncertainty", "unit")
        target = "target, deg" if unit == "arcsec" else "target, mm"
        stops: list[tuple[Cell, ...]] = [
            (position(float(t)), *_shown((u, d, u - d), self.std_errors[f"mean_reversal_{unit}"]))
            for t, u, d in zip(self.targets, self.mean_forward, self.mean_backward, strict=True)
        ]
        heads = (target, f"mean ↑, {shown}", f"mean ↓, {shown}", f"reversal, {shown}")
        return (
            Table.of("Positioning, ISO 230-2", columns, rows),
            Table.of("Targets", heads, stops),
        )


@dataclass(frozen=True, eq=False, repr=False)
class Iso2302(_Results, Result):
    """Results of a linear axis, µm; `targets` in mm.

    Examples
    --------
    >>> import trunnion as tn
    >>> axis = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    >>> found = axis.iso230_2()
    >>> round(found.reversal_um, 2), round(found.repeatability_um, 1)
    (6.56, 15.3)
    """

    reversal_um: float
    mean_reversal_um: float
    repeatability_forward_um: float
    repeatability_backward_um: float
    repeatability_um: float
    systematic_forward_um: float
    systematic_backward_um: float
    systematic_um: float
    mean_systematic_um: float
    accuracy_forward_um: float
    accuracy_backward_um: float
    accuracy_um: float


@dataclass(frozen=True, eq=False, repr=False)
class Iso2302Rotary(_Results, Result):
    """Results of a rotary axis, arcsec; `targets` in degrees.

    Examples
    --------
    >>> import trunnion as tn
    >>> import numpy as np
    >>> turned = np.tile(np.arange(0.0, 360.0, 60.0), 4)
    >>> data = tn.Positioning(
    ...     target_deg=turned,
    ...     measured_deg=turned + 1e-4 * np.sin(7.0 * np.arange(24)),
    ...     direction=np.tile(np.repeat([1, -1], 6), 2),
    ...     cycle=np.repeat([1, 2], 12),
    ... )
    >>> round(data.iso230_2().accuracy_arcsec, 2)
    1.86
    """

    reversal_arcsec: float
    mean_reversal_arcsec: float
    repeatability_forward_arcsec: float
    repeatability_backward_arcsec: float
    repeatability_arcsec: float
    systematic_forward_arcsec: float
    systematic_backward_arcsec: float
    systematic_arcsec: float
    mean_systematic_arcsec: float
    accuracy_forward_arcsec: float
    accuracy_backward_arcsec: float
    accuracy_arcsec: float

    @classmethod
    def unit_name(cls) -> str:
        """Unit at the end of names."""
        return "arcsec"
