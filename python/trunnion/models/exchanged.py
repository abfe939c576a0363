"""Positioning runs whose axes were exchanged, known by what other measurements say of the axes.

Tried where causes do not explain the measurements, mostly as they contradict each other. Runs that
were exchanged agree with the others the other way round; those that are off by themselves do not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from trunnion.data.positioning import Positioning
from trunnion.diagnosis.effect import EffectValues
from trunnion.diagnosis.refit import Refit, refit
from trunnion.diagnosis.result import Diagnosis
from trunnion.models.agreement import LEVEL
from trunnion.models.joint import JointModel
from trunnion.models.several import Measured, joint_model

GAIN = -2.0 * float(np.log(LEVEL))
"""Of -2 ln L: runs that were exchanged fit as much better as what takes them apart has to."""
MAX_LEFT = 0.95
"""Of the residual in noises, that exchanged runs leave: where most of it stays, it has another
cause, and the exchange is none."""
AGREE = 1e-3
"""Probability below which exchanged runs contradict the others, too."""


class _Pair(NamedTuple):
    """Two runs of different axes, by number, and the effects of a run that other kinds share."""

    runs: tuple[int, int]
    own: frozenset[str]


def exchanged(found: Diagnosis, model: JointModel, measured: Sequence[Measured]) -> str:
    """Say which two runs agree with the others once their axes are exchanged; empty: none.

    measured: The parts of the model.
    """
    pairs = list(_pairs(model, measured)) if found.verdict == "unexplained" else []
    if not pairs:
        return ""
    best = _fitted(model, found.effects)
    fitting = []
    for pair in pairs:
        before, after = _as_given(found, model, pair), _other_way(found, model, measured, pair)
        fewer = max(len(best.names) - len(after.names), 1)
        agree = after.rss - best.rss <= special.chdtri(fewer, AGREE)
        better = _of_noise(after) <= MAX_LEFT * _of_noise(before)
        if agree and better and before.rss - after.rss >= GAIN:
            names = (f"{model.parts[k].name} ({_letter(measured[k])})" for k in pair.runs)
            fitting.append((_of_noise(after), _of_noise(before), " and ".join(names)))
    if not fitting:
        return ""
    now, as_given, _ = min(fitting)
    which = ", or of ".join(names for _, _, names in sorted(fitting))
    return (
        f"the data fit to {now:.3g} times their noise, not {as_given:.3g} times, if the axis "
        f"letters of {which} are exchanged."
    )


def _pairs(model: JointModel, measured: Sequence[Measured]) -> Iterator[_Pair]:
    """Pairs of runs of different axes, linear or rotary both, that share with another kind."""
    runs = [i for i, one in enumerate(measured) if _letter(one)]
    others = {
        id_
        for i, one in enumerate(measured)
        if not isinstance(one.data, Positioning)
        for id_ in model.ids_of_part(i).values()
    }
    for i, j in combinations(runs, 2):
        ids = [model.ids_of_part(k) for k in (i, j)]
        own = {name for one in ids for name, id_ in one.items() if id_ in others}
        alike = measured[i].data.rotary == measured[j].data.rotary
        other = _letter(measured[i]) != _letter(measured[j])
        if alike and other and own:
            yield _Pair((i, j), frozenset(own))


def _letter(one: Measured) -> str:
    """Letter of the axis of a run; empty: it is none, or of none."""
    if not isinstance(one.data, Positioning) or one.data.axis is None:
        return ""
    return str(one.data.axis[0]).strip().upper()


def _as_given(found: Diagnosis, model: JointModel, pair: _Pair) -> Refit:
    """Fit with the causes that were found, but what takes apart what runs share."""
    return _fitted(model, {**_kept(found, model, pair), **_free(model, pair)})


def _other_way(
    found: Diagnosis, model: JointModel, measured: Sequence[Measured], pair: _Pair
) -> Refit:
    """Fit the same with the axes of two runs exchanged."""
    i, j = pair.runs
    given = list(measured)
    given[i], given[j] = (
        _of_axis(one, other.data.axis[0])
        for one, other in ((measured[i], measured[j]), (measured[j], measured[i]))
    )
    other = joint_model(given, model.bind)
    called = {
        id_: other.ids_of_part(k)[name]
        for k in pair.runs
        for name, id_ in model.ids_of_part(k).items()
        if name not in pair.own
    }
    known = {e.id for e in other.effects}
    kept = {called.get(name, name): values for name, values in _kept(found, model, pair).items()}
    kept = {name: values for name, values in kept.items() if name in known}
    return _fitted(other, {**kept, **_free(other, pair)})


def _of_axis(one: Measured, letter: Any) -> Measured:
    """Return a run as one of another axis."""

    def named(data: Positioning) -> Positioning:
        return data.with_columns(axis=np.full(len(data), letter))

    return replace(one, data=named(one.data), model=one.model.bind(named(one.model.data)))


def _kept(found: Diagnosis, model: JointModel, pair: _Pair) -> EffectValues:
    """Causes that were found, without what takes apart what the runs share."""
    shared = _free(model, pair)
    apart = {i for i, (_, of) in model.apart.items() if of in shared}
    return {name: values for name, values in found.effects.items() if name not in apart}


def _free(model: JointModel, pair: _Pair) -> dict[str, Mapping[str, float]]:
    """What the runs share with other kinds, of both axes: all of it is fitted."""
    ids = [model.ids_of_part(k).get(name) for k in pair.runs for name in sorted(pair.own)]
    return {i: {p.name: 0.0 for p in model.effect(i).parameters} for i in ids if i is not None}


def _fitted(model: JointModel, effects: EffectValues) -> Refit:
    return refit(model, effects, np.zeros(0, dtype=np.intp))


def _of_noise(fitted: Refit) -> float:
    """What is left, in noises of the readings."""
    return float(np.sqrt(fitted.rss / fitted.degrees_of_freedom))
