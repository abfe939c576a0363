"""Doubt about the shape of a process in time that is named.

No machine drifts or warms up by a formula. A process that fits to within the noise may have another
shape where the readings do not show it: before the first of them, and wherever all that was
measured at one time can take its place. What is missed there is in the errors of the machine, which
are those at the start of the process.

So the process is supposed to be the named one, p, times 1 + h / √t, t being the share of the time
that has passed: heat goes into a body with the root of time at first (Carslaw and Jaeger 1959,
2.4), and h is any smooth function of that root (a Gaussian process, as in :mod:`.smooth`). The
readings weigh its lengths and its sizes. Beforehand each length is as likely, and each root of a
size, from nothing to all of p: intervals hold as often as they say then, for curves that follow
other laws (``tests/power/warming.py``). Sizes that are as likely in each octave make them too short
for these, sizes that are as likely in each step too long.

The parameters of the process itself are those of its named shape.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache

import numpy as np

from trunnion.base.units import Floats
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.effect import Effect
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.model import Covariate, Model
from trunnion.diagnosis.open_structure import notes_of_structure
from trunnion.diagnosis.smooth import covariances
from trunnion.machine.effects import Owner

OCTAVES = 6  # of sizes below that of the process, and more down to a quarter of the noise
DEGREE = 16  # of polynomials of the root of time: of the shortest h they leave a few per cent
MIN_MOMENTS = 3  # at which a process acts, of which it has a shape
TINY = 1e-300


def _processes(effects: Iterable[Effect], f: Fit) -> list[Effect]:
    """Return the effects of a fit that are processes in time."""
    return [e for e in effects if e.owner is Owner.TIME and e.id in f.effects]


def shape_in_doubt(kept: Case, f: Fit, effects: Iterable[Effect], variance: float) -> Floats:
    """What the shapes of processes leave open of the parameters of a fit, (p + k, p + k).

    Mean squares. Beside a model that is not complete, and of exact readings, nothing.
    ``effects``: the candidates. ``variance``: of a white reading.
    """
    out = np.zeros_like(f.covariance)
    if kept.dependent or variance <= 0 or kept.exact(f):
        return out
    for effect in _processes(effects, f):
        at = kept.columns_of(effect, f)
        numbers = np.array([f.effects[effect.id][p.name] for p in effect.parameters])
        linear = np.array([p.linear for p in effect.parameters])
        process = f.jacobian[:, at] @ np.where(linear, numbers, 0.0)
        clock = _clock(kept, process)
        if clock is not None:
            made = _deviations(process, np.asarray(clock.values))
            moved = _mean_squares(kept, f, kept.white(made), variance)
            moved[at] = moved[:, at] = 0.0
            out += moved
    return out


def notes_of_shape(
    model: Model, f: Fit, open_: Floats, std: Mapping[str, float]
) -> tuple[str, ...]:
    """Say for when errors of the machine are stated, where the shape of processes matters.

    ``open_``: what it leaves open, (p + k, p + k); ``std``: by name of the error.
    """
    labels = " and the ".join(e.label for e in _processes(model.effects, f))
    found = notes_of_structure(model, open_, std, f"the shape of the {labels}")
    when = "Errors of the machine are stated for the start of the measurement"
    return tuple(f"{when}. {note}" for note in found)


def _clock(kept: Case, process: Floats) -> Covariate | None:
    """Return the time, or else the order, of the readings that a process changes."""
    acting = np.flatnonzero(process)

    def serves(v: Covariate) -> bool:
        first, end = v.readings or (0, len(process))
        if not (v.sequence and np.all((acting >= first) & (acting < end))):
            return False
        return len(np.unique(v.values[acting])) >= MIN_MOMENTS

    found = [v for v in kept.model.covariates if serves(v)]
    return min(found, key=lambda v: not v.unit, default=None)


def _deviations(process: Floats, when: Floats) -> Floats:
    """Change of the readings by each polynomial of the root of time that h may be, (n, m).

    A process may begin before it acts on a reading, by one interval of these.
    """
    acting = process != 0
    moments = np.unique(when[acting].astype(np.float64))
    begin = moments[0] - float(np.median(np.diff(moments)))
    root = np.sqrt((when[acting] - begin) / (moments[-1] - begin))
    out = np.zeros((len(process), DEGREE + 1))
    polynomials = np.polynomial.legendre.legvander(2.0 * root - 1.0, DEGREE)
    out[acting] = polynomials * (process[acting] / root)[:, None]
    return out


def _mean_squares(kept: Case, f: Fit, deviations: Floats, variance: float) -> Floats:
    """Mean squares of what a fit takes of deviations (white, (n, m)) for its parameters.

    Over all lengths l and sizes s of h, by the probability of the readings.
    """
    own = deviations - f.basis @ (f.basis.T @ deviations)
    gram, along = own.T @ own / variance, own.T @ f.white / variance
    factor = _factors()
    seen, turn = np.linalg.eigh(factor.transpose(0, 2, 1) @ gram @ factor)
    factor = factor @ turn
    seen, along = np.maximum(seen, 0.0), along @ factor  # (l, m)
    largest = float(np.max(np.abs(deviations[:, 0]))) / np.sqrt(variance)
    octaves = max(OCTAVES, int(np.ceil(np.log2(4.0 * max(largest, 1.0)))))
    sizes = 2.0 ** -np.arange(octaves + 1.0)
    squares = sizes[:, None, None] ** 2
    free = squares / (1.0 + squares * seen)  # variances that the readings leave, (s, l, m)
    left = f.rss - variance * np.sum(free * along**2, axis=-1)
    deviance = kept.floor.deviance(np.maximum(left, TINY), f.dof)
    deviance = deviance + np.log1p(squares * seen).sum(axis=-1)
    weight = np.sqrt(sizes)[:, None] * np.exp((deviance.min() - deviance) / 2)
    weight /= weight.sum()
    moves = kept.moved(f, deviations) @ factor  # (l, p + k, m)
    mean = np.einsum("lpm,slm->slp", moves, free * along)
    scatter = np.einsum("sl,slm->lm", weight, free)
    out = np.einsum("sl,slp,slq->pq", weight, mean, mean)
    return np.asarray(out + np.sum((moves * scatter[:, None]) @ moves.transpose(0, 2, 1), axis=0))


@cache
def _factors() -> Floats:
    """Return factors of the covariances of the polynomials of h, of each length, (l, m, m)."""
    spread, axes = np.linalg.eigh(covariances(DEGREE, 0))
    return np.asarray(axes * np.sqrt(np.maximum(spread, 0.0))[:, None])
