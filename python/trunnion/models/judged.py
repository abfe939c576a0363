"""Which quantities changed between measurements, judged by their uncertainties."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from trunnion.base.units import Floats
from trunnion.machine.effects import Owner
from trunnion.models.changes import Change, Trend

COVERAGE = 0.95
INDIVIDUALS = 2.66  # 3 / 1.128: limits by the mean moving range of two
MIN_STD = 1e-12  # relative to the values: of data without noise
SINGULAR = 1e-9


@dataclass(frozen=True)
class Value:
    """A quantity of one measurement; `free` is of its standard uncertainty.

    among: Count of the candidates that it was chosen from because one of the measurements shows it.
    """

    value: float
    std: float
    free: float = math.inf
    unit: str = ""
    owner: str = Owner.MACHINE.value
    label: str = ""
    among: float = 1.0


@dataclass(frozen=True)
class Vector:
    """Many parameters of one effect in one measurement, and what they do to its readings."""

    values: Floats
    covariance: Floats
    columns: Floats
    free: float
    unit: str
    label: str
    among: float = 1.0


def change_of(name: str, one: Value, other: Value) -> Change:
    """Change of one quantity, its p-value by itself, or as the one of its candidates."""
    change = other.value - one.value
    std = max(math.hypot(one.std, other.std), MIN_STD * max(abs(one.value), abs(other.value), 1))
    free = _free((one.std, one.free), (other.std, other.free))
    p = min(2 * float(special.stdtr(free, -abs(change) / std)) * one.among, 1.0)
    half = std * float(special.stdtrit(free, (1 + COVERAGE) / 2))
    return Change(
        name, one.unit, one.owner, one.value, other.value, change, std,
        change - half, change + half, p, False, one.label,
    )  # fmt: skip


def _free(*parts: tuple[float, float]) -> float:
    """Degrees of freedom of a sum (Welch-Satterthwaite), within what tables have."""
    total = sum(s**2 for s, _ in parts)
    each = sum(s**4 / f for s, f in parts)
    return float(np.clip(total**2 / each, 1.0, 1e6)) if each > 0 else 1e6


def change_of_many(name: str, one: Vector, other: Vector) -> Change:
    """Change of an effect of many parameters: rms of what it does to the first readings."""
    change, covariance = other.values - one.values, one.covariance + other.covariance
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    inverse = np.linalg.pinv(covariance / np.outer(size, size), rcond=SINGULAR, hermitian=True)
    wald = float((change / size) @ inverse @ (change / size))
    rank = max(int(np.linalg.matrix_rank(inverse, hermitian=True)), 1)
    p = float(special.fdtrc(rank, max(min(one.free, other.free), 1.0), wald / rank))
    p = min(p * one.among, 1.0)
    before, after, moved = (
        float(np.sqrt(np.mean((one.columns @ v) ** 2))) for v in (one.values, other.values, change)
    )
    spread = np.einsum("ij,jk,ik->i", one.columns, covariance, one.columns)
    std = float(np.sqrt(np.mean(spread)))
    half = std * float(special.ndtri((1 + COVERAGE) / 2))
    return Change(
        name, one.unit, Owner.MACHINE.value, before, after, moved, std,
        max(moved - half, 0.0), moved + half, p, False, one.label, True,
    )  # fmt: skip


def judged(changes: Sequence[Change], level: float) -> tuple[Change, ...]:
    """Correct p-values for their number (Holm), and order."""
    corrected = _holm([c.p_value for c in changes])
    pairs = zip(changes, corrected, strict=True)
    out = [replace(c, p_value=p, changed=p < level) for c, p in pairs]
    return tuple(sorted(out, key=lambda c: (not c.changed, -abs(c.change) / c.std_error)))


def _holm(p: Sequence[float]) -> list[float]:
    order = np.argsort(p, kind="stable")
    out, largest = [1.0] * len(p), 0.0
    for rank, i in enumerate(order):
        largest = max(largest, min(1.0, (len(p) - rank) * p[i]))
        out[i] = largest
    return out


def trends_of(
    values: Mapping[str, tuple[Value, ...]], days: Sequence[float], level: float
) -> tuple[Trend, ...]:
    """Weighted regression over time; where it leaves more than the uncertainties, these grow."""
    rows = []
    t = np.asarray(days)
    for name, v in values.items():
        y = np.array([x.value for x in v])
        std = np.maximum([x.std for x in v], MIN_STD * max(float(np.abs(y).max()), 1.0))
        design = np.column_stack([np.ones_like(t), t - t.mean()]) / std[:, None]
        q, r = np.linalg.qr(design)  # of an exact measurement beside others, too
        inverse = np.linalg.inv(r)
        cofactor, found = inverse @ inverse.T, inverse @ (q.T @ (y / std))
        free = len(t) - 2
        birge = float(np.sum((y / std - design @ found) ** 2)) / free
        error = math.sqrt(cofactor[1, 1] * max(birge, 1.0))
        # of uncertainties that hold the normal law; of scatter beyond them Student's
        dof = 1e6 if birge <= 1 else float(free)
        p = min(2 * float(special.stdtr(dof, -abs(found[1]) / error)) * v[0].among, 1.0)
        reach = INDIVIDUALS * float(np.mean(np.abs(np.diff(y))))
        centre = float(y.mean())
        outside = tuple(int(i) for i in np.flatnonzero(np.abs(y - centre) > reach))
        rows.append(
            (name, v[0].unit, float(found[1]), error, p, centre, centre - reach, centre + reach,
             outside, v[0].label)
        )  # fmt: skip
    corrected = _holm([r[4] for r in rows])
    pairs = zip(rows, corrected, strict=True)
    return tuple(Trend(*r[:4], p, p < level, *r[5:9], label=r[9]) for r, p in pairs)
