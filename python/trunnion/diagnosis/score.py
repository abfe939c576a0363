"""Gain of a diagnosis on data that it has not seen."""

from collections.abc import Mapping

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.statistics import NORMAL_MEDIAN, linear_fit
from trunnion.base.units import Floats
from trunnion.diagnosis import outliers
from trunnion.diagnosis.effect import EffectValues, Values
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.records import Gain, units_of

STEPS = 8


def score(
    model: Model,
    nuisance_before: Mapping[str, float],
    nuisance_after: Mapping[str, float],
    effects: EffectValues,
) -> Gain:
    """Residual rms of other data under the plain and the extended model. See Diagnosis.score.

    model: Of the other data.
    nuisance_before, nuisance_after: Values by name under both models; those of the machine are
        kept.
    effects: Parameters of the named causes.
    """
    before = _anew(model, nuisance_before, {})
    after = _anew(model, nuisance_after, effects)
    p = sum(x.owner.of_setup for x in model.nuisance)
    free = max(1.0 - p / max(len(after), 1), 0.1)
    keep = np.ones(len(after), dtype=bool)
    if len(after) - p > 5:
        keep[outliers.far_out(np.abs(after) / np.sqrt(free), free * len(after))] = False
    units, index = units_of(model.readings)
    one, two = before[keep], after[keep]
    return Gain.of(one, two, one, two, units, index[keep])


def _anew(model: Model, known: Mapping[str, float], effects: EffectValues) -> Floats:
    """Residuals with the machine kept; set-up and workpiece fitted anew, outliers held down."""
    free = np.array([x.owner.of_setup for x in model.nuisance], dtype=bool)
    at = np.array(model.start, dtype=np.float64)
    for i, x in enumerate(model.nuisance):
        if not free[i]:
            if x.name not in known:
                raise InputError(
                    f"score: got data whose model has {x.name}, expected one of "
                    f"{', '.join(known) or 'no error'}"
                )
            at[i] = known[x.name]
    values = {k: Values(v) for k, v in effects.items()}
    kept = [e for e in model.effects if e.id in values]
    missing = set(values) - {e.id for e in kept}
    if missing:
        raise InputError(
            f"score: got data whose model lacks {', '.join(sorted(missing))}, expected every cause "
            "of the diagnosis among its effects"
        )
    loose = [e for e in kept if e.owner.of_setup]
    # of more cycles, or fewer, than were diagnosed
    values |= {e.id: e.values(values[e.id].get(q.name, 0.0) for q in e.parameters) for e in loose}
    index = [(e, i) for e in loose for i, q in enumerate(e.parameters) if q.linear]
    y = model.readings.values
    r: Floats = y - model.predict(at, values)
    whiten = model.whitener(r)
    weight = np.ones(len(y))
    hold = None
    for step in range(STEPS):
        parts = [model.jacobian(at, values)[:, free]]
        for e in loose:
            linear = [i for i, q in enumerate(e.parameters) if q.linear]
            parts.append(model.effect_jacobian(at, e, values[e.id])[:, linear])
        jac = np.concatenate(parts, axis=1)
        if jac.shape[1] == 0:
            break
        root = np.sqrt(weight)
        solved = linear_fit(
            np.asarray(whiten(jac)) * root[:, None],
            np.asarray(whiten(r)) * root,
            hold=hold,
            tolerance=model.rank_tolerance,
        )
        hold = solved.held  # what is not identifiable where the fit starts stays there
        move = solved.solution
        at[free] += move[: int(free.sum())]
        for (e, i), m in zip(index, move[int(free.sum()) :], strict=True):
            values[e.id][e.parameters[i].name] += float(m)
        r = y - model.predict(at, values)
        w = np.abs(np.asarray(whiten(r)))
        typical = np.median(w) / NORMAL_MEDIAN
        weight = 1.0 / np.maximum(1.0, w / max(3.0 * typical, 1e-300)) ** 2
        if step > 2 and np.max(np.abs(root**2 - weight)) < 1e-3:
            break
    return r
