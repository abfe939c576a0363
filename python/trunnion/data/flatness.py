"""Straightness, twist and flatness of slopes that a level read.

The deviation from straightness (flatness) is the largest less the smallest distance from a
reference line (plane): of least squares (LSLI, LSPL), or the one for which it is smallest (minimum
zone, MZLI, MZPL; ISO 1101). Its uncertainty is that of the points which limit it, at first order;
noise itself widens the zone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from trunnion.base.report import Cell, Result, Table, measured, position, significant
from trunnion.base.units import Floats
from trunnion.data.slopes import Mesh, Noise, Slopes, Zone

LEAST_SQUARES, MINIMUM_ZONE = "least squares", "minimum zone"


class _Zones:
    """What straightness and flatness say alike, by their name `what`."""

    what: ClassVar[str]
    minimum_zone_um: float
    std_errors: Mapping[str, float]
    notes: tuple[str, ...]

    def labels(self) -> dict[str, str]:
        """Name of each figure → what people call it."""
        named = {f"{self.what}_um": LEAST_SQUARES, "minimum_zone_um": MINIMUM_ZONE}
        return {name: f"{self.what}, {zone}" for name, zone in named.items()}

    def headline(self) -> str:
        """Both zones."""
        width_um = getattr(self, f"{self.what}_um")
        return f"{self.what} {width_um:.3g} µm, minimum zone {self.minimum_zone_um:.3g} µm"

    def sentences(self) -> tuple[str, ...]:
        """What is not known."""
        return self.notes

    def _zones(self, zeros: Sequence[float | None], noise: Sequence[Noise]) -> Table:
        """Table of both zones with their uncertainty, and of the instrument."""
        rows: list[tuple[Cell, ...]] = [
            (label, *measured(getattr(self, name), self.std_errors[name]), "µm")
            for name, label in self.labels().items()
        ]
        for text, zero, one in zip(("along", "across"), zeros, noise, strict=False):
            if zero is not None:
                rows.append((f"instrument zero {text}", significant(zero), None, "µm/m"))
            rows.append(
                (f"noise of a reading {text}, {one.source}", significant(one.sigma), None, "µm/m")
            )
        heads = ("", "value", "standard uncertainty", "unit")
        return Table.of(self.what.capitalize(), heads, rows)


@dataclass(frozen=True, eq=False, repr=False)
class Straightness(_Zones, Result):
    """Profile of a line, and its straightness.

    Attributes
    ----------
    positions_mm, heights_um
        Profile above its line of least squares, (n,).
    heights_std_um
        Standard uncertainty of the heights by noise of the readings, (n,).
    straightness_um, minimum_zone_um
        Deviation from straightness: from the line of least squares, and the minimum zone.
    std_errors
        Standard uncertainty of both, and of the zero if there is one, by noise of the readings.
    instrument_zero_um_m
        Of the instrument; None where it was not turned.
    noise_um_m, noise_source
        Of one reading, and where it is from.
    chained
        Whether each reading stood where its neighbour stood; otherwise the trapezoidal rule.
    notes
        What a reader should know.

    Examples
    --------
    >>> import trunnion as tn
    >>> bed = tn.read_levels(tn.sample_path("levels/bed.csv"))
    >>> line = bed.straightness()
    >>> round(line.minimum_zone_um, 1)
    18.0
    """

    GRID = dict.fromkeys(("heights_um", "heights_std_um"), ("positions_mm",))
    what = "straightness"

    positions_mm: Floats
    heights_um: Floats
    heights_std_um: Floats
    straightness_um: float
    minimum_zone_um: float
    std_errors: Mapping[str, float]
    instrument_zero_um_m: float | None
    noise_um_m: float
    noise_source: str
    chained: bool
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        at: Floats,
        heights: Floats,
        slopes: Slopes,
        noise: Noise,
        chained: bool,
        note: str,
    ) -> Straightness:
        """Of slopes (m,), and how heights at n places follow from them, (n, m)."""
        covariance = heights @ (slopes.cofactor * noise.variance) @ heights.T
        zone = Zone.of(at[:, None], heights @ slopes.values, covariance)
        return cls(
            positions_mm=at,
            heights_um=zone.heights,
            heights_std_um=zone.std,
            straightness_um=zone.widths[0],
            minimum_zone_um=zone.widths[1],
            std_errors=_errors("straightness_um", zone, [noise]),
            instrument_zero_um_m=slopes.zero,
            noise_um_m=noise.sigma,
            noise_source=noise.source,
            chained=chained,
            notes=(note,) if note else (),
        )

    def tables(self) -> tuple[Table, ...]:
        """Return both zones, and the profile."""
        rows: list[tuple[Cell, ...]] = [
            (position(float(x)), *measured(float(z), float(s)))
            for x, z, s in zip(self.positions_mm, self.heights_um, self.heights_std_um, strict=True)
        ]
        heads = ("position, mm", "height, µm", "standard uncertainty, µm")
        noise = Noise(self.noise_um_m, self.noise_source)
        zones = self._zones([self.instrument_zero_um_m], [noise])
        return zones, Table.of(f"Profile, {LEAST_SQUARES}", heads, rows)


@dataclass(frozen=True, eq=False, repr=False)
class Flatness(_Zones, Result):
    """Heights of a surface, and its flatness.

    Attributes
    ----------
    x_mm, y_mm, heights_um
        Heights above the plane of least squares, (n,).
    heights_std_um
        Their standard uncertainty by noise of the readings, (n,).
    flatness_um, minimum_zone_um
        Deviation from flatness: from the plane of least squares, and the minimum zone.
    std_errors
        Standard uncertainty of both by noise of the readings.
    closure_um_m
        What differences of height around the grid's meshes leave of the slopes, rms.
    instrument_zero_um_m
        Of the instrument along and across; None where it was not turned.
    noise_um_m, noise_source
        Of one reading, along and across, and where it is from.
    notes
        What a reader should know.

    Examples
    --------
    >>> import trunnion as tn
    >>> plate = tn.read_levels(tn.sample_path("levels/plate.csv"))
    >>> round(plate.flatness().flatness_um, 1)
    4.5
    """

    GRID = dict.fromkeys(("x_mm", "y_mm", "heights_um", "heights_std_um"), ("place",))
    what = "flatness"

    x_mm: Floats
    y_mm: Floats
    heights_um: Floats
    heights_std_um: Floats
    flatness_um: float
    minimum_zone_um: float
    std_errors: Mapping[str, float]
    closure_um_m: float
    instrument_zero_um_m: tuple[float, float] | None
    noise_um_m: tuple[float, float]
    noise_source: str
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, slopes: Sequence[Slopes], noise: Sequence[Noise], note: str) -> Flatness:
        """Of slopes in x and in y."""
        places, m = slopes[0].places, len(slopes[0].places)
        mesh = Mesh.of(places)
        heights = mesh.heights()
        both = np.concatenate([s.values for s in slopes])
        covariance = np.zeros((2 * m, 2 * m))
        for i, (s, n) in enumerate(zip(slopes, noise, strict=True)):
            covariance[i * m : (i + 1) * m, i * m : (i + 1) * m] = s.cofactor * n.variance
        z = heights @ both
        zone = Zone.of(places, z, heights @ covariance @ heights.T)
        zeros = [s.zero for s in slopes if s.zero is not None]
        return cls(
            x_mm=places[:, 0],
            y_mm=places[:, 1],
            heights_um=zone.heights,
            heights_std_um=zone.std,
            flatness_um=zone.widths[0],
            minimum_zone_um=zone.widths[1],
            std_errors=_errors("flatness_um", zone, noise),
            closure_um_m=mesh.closure(z, both),
            instrument_zero_um_m=(zeros[0], zeros[1]) if len(zeros) > 1 else None,
            noise_um_m=(noise[0].sigma, noise[1].sigma),
            noise_source=noise[0].source,
            notes=(note,) if note else (),
        )

    def tables(self) -> tuple[Table, ...]:
        """Return both zones, and the heights."""
        rows: list[tuple[Cell, ...]] = [
            (position(float(x)), position(float(y)), *measured(float(z), float(s)))
            for x, y, z, s in zip(
                self.x_mm, self.y_mm, self.heights_um, self.heights_std_um, strict=True
            )
        ]
        heads = ("x, mm", "y, mm", "height, µm", "standard uncertainty, µm")
        noise = [Noise(n, self.noise_source) for n in self.noise_um_m]
        zones = self._zones(self.instrument_zero_um_m or (None, None), noise)
        return zones, Table.of(f"Heights, {LEAST_SQUARES}", heads, rows)


@dataclass(frozen=True, eq=False, repr=False)
class Twist(Result):
    """How fast the slope across changes along a line, or over a grid: height k x y.

    Attributes
    ----------
    twist_um_m_m
        µm/m per m, by a line of least squares through the slopes.
    roll_um_m
        Largest less smallest slope across.
    std_errors
        Standard uncertainty by noise of the readings; what is not straight about the roll is not
        in it.
    residual_um_m
        What a constant twist leaves of the slopes, rms.
    noise_um_m, noise_source
        Of one reading, and where it is from.
    at_mm, slopes_um_m
        Slopes across over the position along, (n,) each, without the constant of their direction.

    Examples
    --------
    >>> import trunnion as tn
    >>> bed = tn.read_levels(tn.sample_path("levels/bed.csv"))
    >>> round(bed.twist().twist_um_m_m, 1)
    39.9
    """

    twist_um_m_m: float
    roll_um_m: float
    std_errors: Mapping[str, float]
    residual_um_m: float
    noise_um_m: float
    noise_source: str
    at_mm: Floats = field(default_factory=lambda: np.zeros(0))
    slopes_um_m: Floats = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, slopes: Sequence[Slopes], noise: Sequence[Noise]) -> Twist:
        """Of slopes across a line, or in x and y."""
        columns = []
        for i, s in enumerate(slopes):
            # on a grid the slope in x changes along y, and the other way round
            lever = s.places[:, (1 - i) if len(slopes) > 1 else 0] * 1e-3
            own = np.zeros((len(lever), 1 + len(slopes)))
            own[:, 0], own[:, 1 + i] = lever - lever.mean(), 1.0
            columns.append(own)
        inverse = np.linalg.pinv(np.concatenate(columns))
        values = np.concatenate([s.values for s in slopes])
        found = inverse @ values
        design = np.concatenate(columns)
        left = values - design @ found
        parts = np.split(inverse[0], np.cumsum([len(c) for c in columns])[:-1])
        variance = sum(
            s.variance(p) * n.variance for p, s, n in zip(parts, slopes, noise, strict=True)
        )
        roll = slopes[-1].values
        ends = np.zeros(len(roll))
        ends[np.argmax(roll)] += 1.0
        ends[np.argmin(roll)] -= 1.0
        return cls(
            twist_um_m_m=float(found[0]),
            roll_um_m=float(np.ptp(roll)),
            std_errors={
                "twist_um_m_m": _known(float(np.sqrt(variance)), noise),
                "roll_um_m": _known((slopes[-1].variance(ends) * noise[-1].variance) ** 0.5, noise),
            },
            residual_um_m=float(np.sqrt(np.mean(left**2))),
            noise_um_m=noise[-1].sigma,
            noise_source=noise[-1].source,
            at_mm=1e3 * design[:, 0],
            slopes_um_m=values - design[:, 1:] @ found[1:],
        )

    def labels(self) -> dict[str, str]:
        """Name of each figure → what people call it."""
        return {"twist_um_m_m": "whole twist", "roll_um_m": "range of the slope across"}

    def headline(self) -> str:
        """Twist."""
        return f"twist {self.twist_um_m_m:.3g} µm/m per m"

    def tables(self) -> tuple[Table, ...]:
        """Return twist and roll."""
        u, noise = self.std_errors, f"noise of a reading, {self.noise_source}"
        rows: list[tuple[Cell, ...]] = [
            ("twist", *measured(self.twist_um_m_m, u["twist_um_m_m"]), "µm/m per m"),
            ("range of the slope across", *measured(self.roll_um_m, u["roll_um_m"]), "µm/m"),
            ("residual of a constant twist, rms", significant(self.residual_um_m), None, "µm/m"),
            (noise, significant(self.noise_um_m), None, "µm/m"),
        ]
        return (Table.of("Twist", ("", "value", "standard uncertainty", "unit"), rows),)


def _known(std: float, noise: Sequence[Noise]) -> float:
    return std if all(np.isfinite(n.sigma) for n in noise) else float(np.inf)


def _errors(name: str, zone: Zone, noise: Sequence[Noise]) -> dict[str, float]:
    names = (name, "minimum_zone_um")
    return {k: _known(s, noise) for k, s in zip(names, zone.std_errors, strict=True)}
