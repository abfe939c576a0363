"""Several instruments on the same stops of an axis: whose error it is.

Each instrument's deviations are those of the axis, as far as the instrument sees it, and its own.
The difference of two instruments is free of the axis and of its scatter. So every cause that any of
them shows, or any difference, is fitted to all of these: what the instruments share and no
difference shows is of the axis; what is in the difference is of an instrument, or of what lies
between the places that the two look at.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import special

from trunnion.base.arguments import checked
from trunnion.base.errors import InputError
from trunnion.base.report import Cell, Result, Shown, Table, plus_minus, significant
from trunnion.base.units import capital
from trunnion.data.distinct import distinct_rows
from trunnion.data.positioning import Positioning
from trunnion.diagnosis.refit import refit
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.compare import surest_causes
from trunnion.models.kinds import diagnose
from trunnion.models.positioning import SAME_COUNTER_UM

LEVEL = 0.05  # over all causes and instruments together (Holm would be sharper)
FIRST = "measured"
SINGULAR = 1e-9
ROUNDING = 1e-9  # of positions, in the unit of deviations: 1e-12 of the position


@dataclass(frozen=True)
class Attribution:
    """One cause, and whose it is.

    Attributes
    ----------
    id, label
        Of the cause.
    whose
        "axis" (two instruments or more see it alike), the name of one instrument (only that one
        shows it, of three and more), "between" (of two: one of them, or what lies between them),
        "several" (more than one instrument has its own), or "undecided" (one instrument sees it,
        and the others are too uncertain to agree or to differ).
    rms, std_error
        Instrument → what the cause does to its deviations, rms, and its standard uncertainty.
    differences
        Pair of instruments, "laser - resolver" → the same of their difference.
    seen_by, differing
        Instruments that show it, and pairs that differ in it.
    """

    id: str
    label: str
    whose: str
    rms: Mapping[str, float]
    std_error: Mapping[str, float]
    differences: Mapping[str, float]
    seen_by: tuple[str, ...]
    differing: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class InstrumentComparison(Result):
    """What several instruments on the same stops say together. See :func:`whose_error`.

    Attributes
    ----------
    instruments
        Their names; the column ``measured_mm`` is "measured".
    attributions
        One a cause, the largest first.
    scatter
        Instrument → scatter of its own, 1 σ, by the differences of three instruments and more
        (Grubbs, 1948); of two the scatter of their difference, as "a - b".
    counters
        Instruments that look like a counter of what was commanded; they are left out.
    unit
        "µm" or "arcsec".

    Examples
    --------
    >>> import trunnion as tn
    >>> axis = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    >>> motor = axis.measured - 3e-3 * axis.direction
    >>> found = tn.whose_error(axis.with_columns(motor_mm=motor))
    >>> len(found.tables())
    2
    """

    instruments: tuple[str, ...]
    attributions: tuple[Attribution, ...]
    scatter: Mapping[str, float]
    counters: tuple[str, ...]
    unit: str

    def headline(self) -> str:
        """Causes with whose they are."""
        parts = [f"{a.id}: {a.whose}" for a in self.attributions]
        return "; ".join(parts) or "the instruments agree"

    def sentences(self) -> tuple[str, ...]:
        """One sentence a cause."""
        lines = [self._sentence(a) for a in self.attributions]
        if len(self.instruments) < 2:
            lines = ["Nothing can be distinguished: no two instruments measure the axis."]
        elif not lines:
            lines.append("No instrument shows a cause, and they do not differ.")
        lines += [
            f"{name} follows the target or repeats exactly at every stop: it counts what was "
            "commanded, and takes no part."
            for name in self.counters
        ]
        return tuple(lines)

    def _sentence(self, a: Attribution) -> str:
        what = f"{a.label or a.id} ({a.id})"
        sizes = ", ".join(f"{name} {a.rms[name]:.3g}" for name in self.instruments)
        text = f"{what}, rms {self.unit}: {sizes}. "
        seen = " and ".join(a.seen_by) or "none"
        match a.whose:
            case "axis" if len(a.seen_by) == len(self.instruments):
                return text + "All instruments see it alike: it is the axis'."
            case "axis":
                return f"{text}{capital(seen)} see it alike: it is the axis'.{self._too_coarse(a)}"
            case "undecided":
                return f"{text}Only {seen} sees it: whose it is, is open.{self._too_coarse(a)}"
            case "between":
                return (
                    f"{text}The two differ by {next(iter(a.differences.values())):.3g}; seen by "
                    f"{seen}: it is an instrument's, or of what lies between the two. A third "
                    "instrument would tell."
                )
            case "several":
                return text + "More than one instrument has its own, or looks at another place."
        if a.whose not in a.seen_by:
            return f"{text}Only {a.whose} does not show it: it is behind what {a.whose} looks at."
        return f"{text}Only {a.whose} differs from the others, which agree: it is its own."

    def _too_coarse(self, a: Attribution) -> str:
        """Say which instruments neither see a cause nor differ from those that do."""
        others = [n for n in self.instruments if n not in a.seen_by]
        sizes = " and ".join(f"{n} ({a.rms[n]:.2g} ± {a.std_error[n]:.2g})" for n in others)
        return f" Too uncertain to see it, or that it is not there: {sizes}."

    def tables(self) -> tuple[Table, ...]:
        """Return causes by instrument, and the scatter."""
        rows: list[tuple[Cell, ...]] = [
            (
                a.id,
                a.whose,
                *(Shown(a.rms[n], plus_minus(a.rms[n], a.std_error[n])) for n in self.instruments),
                *(significant(v) for v in a.differences.values()),
            )
            for a in self.attributions
        ]
        pairs = [f"{a} - {b}" for a, b in combinations(self.instruments, 2)]
        causes = Table.of(
            f"Whose error it is, rms in {self.unit}", ("", "whose", *self.instruments, *pairs), rows
        )
        own = [(name, significant(s), self.unit) for name, s in self.scatter.items()]
        return causes, Table.of("Scatter", ("", "1 σ", "unit"), own)


@checked
def whose_error(data: Positioning) -> InstrumentComparison:
    """Say of every cause whether it is the axis' or an instrument's.

    Parameters
    ----------
    data
        Stops with further columns ``NAME_mm`` (``NAME_deg``) of other instruments.

    Raises
    ------
    InputError
        One instrument only.

    Examples
    --------
    >>> import trunnion as tn
    >>> axis = tn.read_positioning(tn.sample_path("positioning/axis.csv"))
    >>> motor = axis.measured - 3e-3 * axis.direction
    >>> found = tn.whose_error(axis.with_columns(motor_mm=motor))
    >>> print(found.headline())
    scale: axis; reversal: between; cycle_drift: axis; curve: axis
    """
    if not data.instruments:
        raise InputError(
            f"instruments: got one, expected further columns NAME_{'deg' if data.rotary else 'mm'} "
            "with what others measured on the same stops; with names of their own: "
            "trunnion read --column"
        )
    each = {FIRST: data, **{name: data.instrument(name) for name in data.instruments}}
    counters = tuple(name for name, one in each.items() if _counts_commands(one))
    each = {name: one for name, one in each.items() if name not in counters}
    names = tuple(each)
    pairs = {f"{a} - {b}": _difference(each[a], each[b]) for a, b in combinations(names, 2)}
    diagnoses = {name: diagnose(one) for name, one in {**each, **pairs}.items()}
    causes = surest_causes(diagnoses.values())
    sizes = {
        name: _sizes(d, causes, LEVEL / max(len(causes) * len(diagnoses), 1))
        for name, d in diagnoses.items()
    }
    labels = {k: v for d in diagnoses.values() for k, v in d.labels.items()}
    found = [_attribution(id_, labels.get(id_, ""), names, tuple(pairs), sizes) for id_ in causes]
    found.sort(key=lambda a: -max(a.rms.values()))
    return InstrumentComparison(
        names,
        tuple(a for a in found if a.seen_by or a.differing),
        _scatter(names, {k: diagnoses[k].sigma for k in pairs}),
        counters,
        data.unit,
    )


def _counts_commands(one: Positioning) -> bool:
    """Whether it follows the target, or repeats exactly at every stop: no instrument does."""
    if not one.rotary and float(np.ptp(one.deviation)) <= SAME_COUNTER_UM:
        return True
    stop = np.stack([one.stops[1], one.direction], axis=1)
    _, index, count = np.unique(stop, axis=0, return_inverse=True, return_counts=True)
    mean = np.bincount(index.reshape(-1), one.deviation) / count
    off = np.abs(one.deviation - mean[index.reshape(-1)]).max()
    return bool(count.max() > 1 and off < ROUNDING * max(float(np.abs(one.measured).max()), 1.0))


def _difference(one: Positioning, other: Positioning) -> Positioning:
    """Stops whose deviations are the difference of two instruments."""
    column = "measured_deg" if one.rotary else "measured_mm"
    return one.with_columns(**{column: one.target + one.measured - other.measured})


def _sizes(
    d: Diagnosis, causes: Mapping[str, Mapping[str, float]], level: float
) -> dict[str, tuple[float, float, bool]]:
    """Each cause: rms, its standard uncertainty, and whether it is there."""
    f = refit(d.rebuilt_model(), causes, distinct_rows(d.data).numbers(d.outliers))
    out = {}
    for name in causes:
        at = [i for i, n in enumerate(f.names) if n.startswith(f"{name}.")]
        values, covariance = f.values[at], f.covariance[np.ix_(at, at)]
        columns = f.columns[:, at] - f.columns[:, at].mean(axis=0)
        size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        inverse = np.linalg.pinv(covariance / np.outer(size, size), rcond=SINGULAR, hermitian=True)
        wald = float((values / size) @ inverse @ (values / size))
        chance = float(special.fdtrc(len(at), f.degrees_of_freedom, wald / len(at)))
        spread = np.einsum("ij,jk,ik->i", columns, covariance, columns)
        out[name] = (
            float(np.sqrt(np.mean((columns @ values) ** 2))),
            float(np.sqrt(np.mean(spread))),
            chance < level,
        )
    return out


def _attribution(
    id_: str,
    label: str,
    names: tuple[str, ...],
    pairs: tuple[str, ...],
    sizes: Mapping[str, Mapping[str, tuple[float, float, bool]]],
) -> Attribution:
    differing = tuple(p for p in pairs if sizes[p][id_][2])
    seen = tuple(n for n in names if sizes[n][id_][2])
    whose = "several"
    if not differing:
        whose = "axis" if len(seen) > 1 else "undecided"
    elif len(names) == 2:
        whose = "between"
    else:
        for name in names:
            mine = {p for p in pairs if name in p.split(" - ")}
            if mine == set(differing):
                whose = name
    return Attribution(
        id_,
        label,
        whose,
        {n: sizes[n][id_][0] for n in names},
        {n: sizes[n][id_][1] for n in names},
        {p: sizes[p][id_][0] for p in pairs},
        seen,
        differing,
    )


def _scatter(names: tuple[str, ...], of_pairs: Mapping[str, float]) -> dict[str, float]:
    """Scatter of each instrument from those of differences: s_ij² = s_i² + s_j²."""
    if len(names) <= 2:
        return dict(of_pairs)
    rows = np.array([[float(n in p.split(" - ")) for n in names] for p in of_pairs])
    squares = np.array([s**2 for s in of_pairs.values()])
    own = np.linalg.lstsq(rows, squares, rcond=None)[0]
    return {n: float(np.sqrt(max(v, 0.0))) for n, v in zip(names, own, strict=True)}
