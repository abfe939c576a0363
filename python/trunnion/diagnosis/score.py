"""Gain of a diagnosis on data that it has not seen."""

from typing import Any

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import Floats
from trunnion.diagnosis import outliers
from trunnion.diagnosis.effect import EffectValues, Values
from trunnion.diagnosis.fit import orthonormal
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.result import Diagnosis, Gain

__all__ = ["score"]

STEPS = 8


def score(d: Diagnosis, other: Any) -> Gain:
    """Residual rms of other data under the plain and the extended model. See Diagnosis.score."""
    source = d.source
    if source is None:
        raise InputError("this diagnosis has no model to score other data with")
    model: Model = other if hasattr(other, "predict") else source.bind(other)
    before = _anew(model, source, d.nuisance_before, {})
    after = _anew(model, source, d.nuisance_after, d.effects)
    p = sum(x.owner.of_setup for x in model.nuisance)
    leverage = np.full(len(after), min(p / max(len(after), 1), 0.9))
    keep = np.ones(len(after), dtype=bool)
    if len(after) - p > 5:
        keep[outliers.far_out(after, leverage)] = False
    rms = [float(np.sqrt(np.mean(r[keep] ** 2))) for r in (before, after)]
    return Gain(rms[0], rms[1], rms[0], rms[1])


def _anew(model: Model, source: Model, nuisance: Floats, effects: EffectValues) -> Floats:
    """Residuals with the machine kept; set-up and workpiece fitted anew, outliers held down."""
    known = {x.name: v for x, v in zip(source.nuisance, nuisance, strict=True)}
    free = np.array([x.owner.of_setup for x in model.nuisance], dtype=bool)
    at = np.array(model.start, dtype=np.float64)
    for i, x in enumerate(model.nuisance):
        if not free[i]:
            if x.name not in known:
                raise InputError(f"the other data's model has {x.name}, which this one has not")
            at[i] = known[x.name]
    values = {k: Values(v) for k, v in effects.items()}
    kept = [e for e in model.effects if e.id in values]
    missing = set(values) - {e.id for e in kept}
    if missing:
        raise InputError(f"the other data's model does not know {', '.join(sorted(missing))}")
    loose = [e for e in kept if e.owner.of_setup]
    index = [(e, i) for e in loose for i, q in enumerate(e.parameters) if q.linear]
    y = model.readings.values
    r: Floats = y - model.predict(at, values)
    whiten = model.whitener(r)
    weight = np.ones(len(y))
    for step in range(STEPS):
        parts = [model.jacobian(at, values)[:, free]]
        for e in loose:
            linear = [i for i, q in enumerate(e.parameters) if q.linear]
            parts.append(model.effect_jacobian(at, e, values[e.id])[:, linear])
        jac = np.concatenate(parts, axis=1)
        if jac.shape[1] == 0:
            break
        root = np.sqrt(weight)
        u, s, vt, scale = orthonormal(np.asarray(whiten(jac)) * root[:, None])
        move = (vt.T / s / scale[:, None]) @ (u.T @ (np.asarray(whiten(r)) * root))
        at[free] += move[: int(free.sum())]
        for (e, i), m in zip(index, move[int(free.sum()) :], strict=True):
            values[e.id][e.parameters[i].name] += float(m)
        r = y - model.predict(at, values)
        w = np.abs(np.asarray(whiten(r)))
        typical = np.median(w) / 0.6745
        weight = 1.0 / np.maximum(1.0, w / max(3.0 * typical, 1e-300)) ** 2
        if step > 2 and np.max(np.abs(root**2 - weight)) < 1e-3:
            break
    return r
