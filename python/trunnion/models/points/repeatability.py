"""What of a measurement of features repeats, and what it is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import InputError
from trunnion.base.report import Result, Table
from trunnion.base.units import Floats, Integers
from trunnion.data.points import Points
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.points.geometry import AXES, rounded
from trunnion.models.points.model import ExtendedPoints, PointsModel

MIN_FEATURES = 10


@dataclass(frozen=True, eq=False, repr=False)
class RepeatablePart(Result):
    """What of one measurement of features is there again in another, and what it is made of.

    All rms values are per coordinate, in µm, under a placement fitted to the data they belong to.

    Attributes
    ----------
    rms_um, other_rms_um
        Residuals with the placement alone.
    correlation
        Of these residuals between the measurements, by axis.
    repeatable_um
        Rms of what repeats, from the covariance of both.
    scatter_um
        Rms of what does not repeat, of one measurement.
    named, smooth, hole_by_hole
        Shares of the variance that repeats; they add up to 1.
    left_named_um, left_smooth_um, left_hole_by_hole_um
        Rms left on the other measurement by the named causes of the first, by them and its smooth
        field, and by both and what was left at each feature.
    features
        How many features both have.

    Examples
    --------
    >>> import trunnion as tn
    >>> first = tn.read(tn.sample_path("plate/first.csv"))
    >>> second = tn.read(tn.sample_path("plate/second.csv"))
    >>> found = tn.repeatable_part(tn.diagnose(first), second)
    >>> len(found.tables())
    2
    """

    rms_um: float
    other_rms_um: float
    correlation: dict[str, float]
    repeatable_um: float
    scatter_um: float
    named: float
    smooth: float
    hole_by_hole: float
    left_named_um: float
    left_smooth_um: float
    left_hole_by_hole_um: float
    features: int

    def sentences(self) -> Sequence[str]:
        """Say how much repeats."""
        by_axis = ", ".join(f"{c:.2f} in {a}" for a, c in self.correlation.items())
        return (
            f"{self.features} features measured twice; residuals correlate {by_axis}.",
            f"{self.repeatable_um:.2f} µm rms repeat, {self.scatter_um:.2f} µm rms do not.",
        )

    def tables(self) -> tuple[Table, ...]:
        """What repeats and what it is made of; what is left on the other measurement."""
        variance = self.repeatable_um**2
        repeats = (
            ("placement alone", self.rms_um, None),
            ("placement alone, other measurement", self.other_rms_um, None),
            ("repeats", self.repeatable_um, 100.0 if variance else None),
            ("  named causes", None, 100 * self.named),
            ("  smooth, no name", None, 100 * self.smooth),
            ("  hole by hole", None, 100 * self.hole_by_hole),
            ("does not repeat (one measurement)", self.scatter_um, None),
        )
        left = (
            ("named causes", self.left_named_um),
            ("and smooth field", self.left_smooth_um),
            ("and hole by hole", self.left_hole_by_hole_um),
        )
        return (
            Table.of("What repeats", ("", "rms, µm", "share of the variance, %"), repeats),
            Table.of("Left on the other measurement by", ("", "rms, µm"), left),
        )


@checked
def repeatable_part(d: Diagnosis, other: Points) -> RepeatablePart:
    """Separate what is in the part (repeats, ISO 230-2: systematic) from the measurement.

    The noise of two measurements is independent, so that the covariance of what a model leaves of
    both is the variance of what repeats and the model does not have. The model is that of ``d``,
    from its own data alone; each measurement keeps its own placement.

    Parameters
    ----------
    d
        Diagnosis of points.
    other
        The same features measured again, in any order; others are ignored.

    Raises
    ------
    InputError
        ``d`` is not of points, or fewer than ten features are in both.

    Examples
    --------
    >>> import trunnion as tn
    >>> first = tn.read(tn.sample_path("plate/first.csv"))
    >>> second = tn.read(tn.sample_path("plate/second.csv"))
    >>> found = tn.repeatable_part(tn.diagnose(first), second)
    >>> print(found.headline())
    90 features measured twice; residuals correlate 0.95 in X, 0.88 in Y.
    """
    extended = d.model
    if not isinstance(d.data, Points) or not isinstance(extended, ExtendedPoints):
        raise InputError("repeatable_part: got a diagnosis of other data, expected one of points")
    model = extended.source
    again = model.bind(other)
    one, two = _shared(model.data, other)

    def both(**parts: bool) -> tuple[Floats, Floats]:
        return (
            _residuals(model, extended.error_um(model.data, **parts))[one],
            _residuals(again, extended.error_um(other, **parts))[two],
        )

    a, b = _residuals(model, np.zeros(1))[one], _residuals(again, np.zeros(1))[two]
    total = float(np.mean(a * b))
    named_a, named_b = both(smooth=False)
    smooth_a, smooth_b = both(smooth=True)
    _, features_b = both(smooth=True, features=True)
    after_named = float(np.mean(named_a * named_b))
    after_smooth = float(np.mean(smooth_a * smooth_b))
    return RepeatablePart(
        rms_um=_rms(a),
        other_rms_um=_rms(b),
        correlation={
            AXES[i].upper(): float(np.corrcoef(a[:, i], b[:, i])[0, 1])
            for i in range(model.dimension)
        },
        repeatable_um=float(np.sqrt(max(total, 0.0))),
        scatter_um=float(np.sqrt(np.mean((a - b) ** 2) / 2)),
        named=(total - after_named) / total,
        smooth=(after_named - after_smooth) / total,
        hole_by_hole=after_smooth / total,
        left_named_um=_rms(named_b),
        left_smooth_um=_rms(smooth_b),
        left_hole_by_hole_um=_rms(features_b),
        features=len(one),
    )


def _shared(data: Points, other: Points) -> tuple[Integers, Integers]:
    """Rows of the features that both have: the first of each place of the first, any of other."""
    first: dict[tuple[int, ...], int] = {}
    for i, k in enumerate(map(tuple, rounded(data.nominal_mm).tolist())):
        first.setdefault(k, i)
    places = enumerate(map(tuple, rounded(other.nominal_mm).tolist()))
    pairs = [(first[k], j) for j, k in places if k in first]
    if len(pairs) < MIN_FEATURES:
        raise InputError(
            f"repeatable_part: got {len(pairs)} features in both, expected at least {MIN_FEATURES}"
        )
    one, two = np.array(pairs, dtype=np.intp).T
    return one, two


def _residuals(model: PointsModel, errors: Floats) -> Floats:
    """Readings less errors, with the placement of these data fitted anew, (n, d)."""
    y = model.readings.values - errors.reshape(-1)
    jac = model.jacobian(np.zeros(len(model.nuisance)), {})
    scale = np.linalg.norm(jac, axis=0)
    move = np.linalg.lstsq(jac / scale, y, rcond=None)[0]
    return np.asarray((y - jac / scale @ move).reshape(-1, model.dimension))


def _rms(r: Floats) -> float:
    return float(np.sqrt(np.mean(r * r)))
