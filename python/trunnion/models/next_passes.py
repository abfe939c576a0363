"""What to turn next, when the diameters of the passes so far leave more than one explanation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import InputError
from trunnion.base.report import Result, Table
from trunnion.base.stored import fitting, plain
from trunnion.base.units import Floats
from trunnion.data.diameters import Diameters
from trunnion.data.distinct import distinct_rows
from trunnion.diagnosis.effect import Effect, Values
from trunnion.diagnosis.fit import fit
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.result import Diagnosis

Named = Mapping[str, Mapping[str, float]]

# Two laws this many standard deviations apart are distinguished in more than 99 of 100 cases.
MIN_DISTANCE = 4.0
ROUNDS = 2


@dataclass(frozen=True, eq=False, repr=False)
class NextPass(Result):
    """A further pass and what it would distinguish of what is equally consistent with the data.

    Attributes
    ----------
    label : str
        What to turn.
    apart : dict
        For each other explanation (a set of causes) its distance from the named one, in standard
        deviations, once the pass is measured like the first one.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("turning/setup.toml"))
    >>> data = tn.read_diameters(tn.sample_path("turning/diameters.csv"))
    >>> best = tn.next_passes(tn.diagnose(data, setup))[0]
    >>> [sorted(causes) for causes in best.distinguished]
    [['chuck_tilt', 'tool_heating'], ['tool_heating', 'tool_wear']]
    """

    label: str
    apart: Mapping[frozenset[str], float]

    @property
    def distinguished(self) -> tuple[frozenset[str], ...]:
        """The explanations that the pass distinguishes from the named one."""
        return tuple(causes for causes, distance in self.apart.items() if distance >= MIN_DISTANCE)

    def sentences(self) -> Sequence[str]:
        """Say what to turn, and what it would settle."""
        groups = [("distinguishes the named causes from", self.distinguished)]
        groups.append(("not from", tuple(c for c in self.apart if c not in self.distinguished)))
        said = [
            f"{verb} " + ", ".join(sorted(" + ".join(sorted(c)) for c in causes))
            for verb, causes in groups
            if causes
        ]
        return (f"{self.label} ({'; '.join(said)})" if said else self.label,)

    def tables(self) -> tuple[Table, ...]:
        """Distance of each other explanation."""
        rows = [(" + ".join(sorted(causes)), distance) for causes, distance in self.apart.items()]
        columns = ("other explanation", "distance from the named, σ")
        return (Table.of("Expected discrimination", columns, rows),)

    def __str__(self) -> str:
        """Return the sentence."""
        return self.summary()

    def summary(self) -> str:
        """Return one line."""
        return self.sentences()[0]

    def to_dict(self) -> dict[str, Any]:
        """Plain values; sets of causes as lists."""
        apart = [{"causes": sorted(c), "distance": plain(d)} for c, d in self.apart.items()]
        return {"result": type(self).__name__, "label": self.label, "apart": apart}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> NextPass:
        """Return the pass that `to_dict` described."""
        with fitting(cls.__name__):
            apart = {frozenset(a["causes"]): float(a["distance"]) for a in values["apart"]}
            return cls(str(values["label"]), apart)


@checked
def next_passes(diagnosis: Diagnosis) -> tuple[NextPass, ...]:
    """Say which further pass distinguishes the alternatives of a diagnosis of diameters.

    Tried are the first measured pass again with reversed feed, with twice the depth of cut, with
    both, with half the feed speed, all from a cold tool, and again right behind four more, so that
    the tool is warm; each with a tool setting of its own. The means under the named causes are
    fitted by every other set of causes; the residual, over the noise, is the distance. A set that
    holds all the named causes and more can fit whatever they make: there the named causes fit its
    means, the cause that hides behind them at the least size that matters, others as fitted.

    Returns
    -------
    tuple of NextPass
        The best first; empty where nothing is in doubt. Explanations that none of them
        distinguishes want something else: more readings, a calibrated bar (shows the slides alone),
        a fresh insert (no wear).

    Raises
    ------
    trunnion.InputError
        If it is no diagnosis of diameters.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("turning/setup.toml"))
    >>> data = tn.read_diameters(tn.sample_path("turning/diameters.csv"))
    >>> len(tn.next_passes(tn.diagnose(data, setup)))
    5
    """
    if not isinstance(diagnosis.data, Diameters):
        raise InputError("diagnosis: got one of other data, expected a diagnosis of diameters")
    model = diagnosis.rebuilt_model()
    others = [s for s in diagnosis.alternatives if s != diagnosis.named]
    if not others:
        return ()
    noise = max(diagnosis.sigma, 1e-9)
    wider_causes = {o: _held(diagnosis, model, o) for o in others if o > diagnosis.named}
    found = []
    for label, wider in _candidates(_with_clock(model)):
        bound = model.bind(wider)
        truth = bound.predict(np.zeros(len(bound.nuisance)), diagnosis.effects)
        apart = {}
        for other in others:
            if other > diagnosis.named:
                means = bound.predict(np.zeros(len(bound.nuisance)), wider_causes[other])
                apart[other] = _distance(bound, means, diagnosis.named, diagnosis.effects) / noise
            else:
                apart[other] = _distance(bound, truth, other, diagnosis.effects) / noise
        found.append(NextPass(label, apart))
    return tuple(sorted(found, key=_rank))


def _rank(one: NextPass) -> tuple[int, float]:
    """Order of a pass: what it distinguishes counts, and how clearly; not what no pass does."""
    least = min((one.apart[causes] for causes in one.distinguished), default=None)
    return -len(one.distinguished), -(max(one.apart.values()) if least is None else least)


def _held(diagnosis: Diagnosis, model: Model, causes: frozenset[str]) -> Named:
    """Values of a set that holds the named causes: those that may hide at their least size."""
    least = {e.id: e.least for e in model.effects if e.id in causes and e.least is not None}
    more = {id_: least[id_] for id_ in causes - diagnosis.named if id_ in least}
    if causes - diagnosis.named == set(more):
        return {**diagnosis.effects, **more}
    start = next(a.start for a in diagnosis.evidence if a.causes == causes)
    effects = [e for e in model.effects if e.id in causes]
    values = {id_: Values(v) for id_, v in start.items()}
    outliers = distinct_rows(diagnosis.data).numbers(diagnosis.outliers)
    used = np.flatnonzero(~np.isin(model.readings.rows, outliers))
    offsets = np.array(list(diagnosis.nuisance_before.values()))
    fitted = fit(model, used, effects, offsets, values, lambda rows: rows)
    return fitted.effects


def _with_clock(model: Model) -> Diameters:
    """Data with their cutting time, where the set-up file states it: that in which wear counts."""
    data: Diameters = model.data
    wear = next(e for e in model.effects if e.id == "tool_wear")
    if data.time_s is not None or wear.parameters[0].name != "rate_um_min":
        return data
    return data.with_columns(time_s=60.0 * np.asarray(wear.change(wear.values([1.0]))))


def _candidates(data: Diameters) -> Iterable[tuple[str, Diameters]]:
    n = len(data)
    labels = np.full(n, "1") if data.pass_ is None else np.asarray(data.pass_).astype(str)
    first = np.flatnonzero(labels == labels[0])
    sign = np.full(n, -1) if data.feed_sign is None else np.asarray(data.feed_sign)
    depth = np.ones(n) if data.depth_mm is None else np.asarray(data.depth_mm)
    time = data.time_s

    def with_pass(
        reverse: bool = False, deep: bool = False, slow: bool = False, behind: int = 0
    ) -> Diameters:
        columns: dict[str, Any] = {
            name: np.concatenate([values, values[first]]) for name, values in data.columns.items()
        }
        columns["pass"] = np.concatenate([labels, np.full(len(first), "next")])
        columns["feed_sign"] = np.concatenate([sign, (-1 if reverse else 1) * sign[first]])
        columns["depth_mm"] = np.concatenate([depth, (2 if deep else 1) * depth[first]])
        if time is not None:
            new = np.asarray(time)[first]
            new = new.max() + new.min() - new if reverse else new
            new = (2 if slow else 1) * new + behind * new.max()
            columns["time_s"] = np.concatenate([time, new])
        elif slow and data.spindle_rpm is not None:
            rpm = np.asarray(data.spindle_rpm)
            columns["spindle_rpm"] = np.concatenate([rpm, rpm[first] / 2])
        return Diameters(columns)

    yield "turn a pass with reversed feed, from a cold tool", with_pass(reverse=True)
    yield "turn a pass with twice the depth of cut", with_pass(deep=True)
    yield "turn a pass with reversed feed and twice the depth", with_pass(reverse=True, deep=True)
    if time is not None or data.spindle_rpm is not None:
        yield "turn a pass at half the feed speed", with_pass(slow=True)
    if time is not None:
        label = (
            "turn four passes without a pause and measure a fifth right behind them, the clock "
            "(time_s) running on"
        )
        yield label, with_pass(behind=4)


def _distance(model: Model, truth: Floats, causes: frozenset[str], named: Named) -> float:
    """Smallest residual of the truth under a set of causes, root of the sum of squares.

    Parameters that are not linear are tried on their grids, those of one cause at a time from the
    named values on: the causes that have some (a tool heating up, chatter) hardly resemble.
    """
    effects = [e for e in model.effects if e.id in causes]
    shapes = [_shapes(model, e, named.get(e.id)) for e in effects]
    base = model.jacobian(np.zeros(len(model.nuisance)), {})
    chosen = [0] * len(shapes)

    def residual(at: list[int]) -> float:
        columns = [shape[i] for shape, i in zip(shapes, at, strict=True)]
        design = np.column_stack([base, *columns])
        misfit = truth - design @ np.linalg.lstsq(design, truth, rcond=1e-10)[0]
        return float(np.sqrt(misfit @ misfit))

    least = residual(chosen)
    for _ in range(ROUNDS):
        for place, shape in enumerate(shapes):
            for i in range(len(shape)):
                tried = [*chosen[:place], i, *chosen[place + 1 :]]
                found = residual(tried) if i != chosen[place] else least
                if found < least:
                    least, chosen = found, tried
    return least


def _shapes(model: Model, effect: Effect, named: Mapping[str, float] | None) -> list[Floats]:
    """Columns of an effect's linear parameters, for every value of one that is not linear.

    The named values come first, else the middle of the grid.
    """
    linear = [i for i, p in enumerate(effect.parameters) if p.linear]
    points = list(product(*(p.grid if not p.linear else (1.0,) for p in effect.parameters)))
    first = points[len(points) // 2]
    if named is not None:
        first = tuple(1.0 if p.linear else named[p.name] for p in effect.parameters)
    start = np.zeros(len(model.nuisance))
    return [
        model.effect_jacobian(start, effect, effect.values(point))[:, linear]
        for point in ([first, *points] if len(points) > 1 else points)
    ]
