"""Readings in turn that wander: what they share with those before and after, as no cause makes it.

The temperature of a shop, an instrument that is not at rest: such an error is none of its readings
one by one, and white noise beside a drift or a warm-up takes it for these. So the noise is white
noise beside a Gaussian process over the time (:mod:`.neighbours`), where readings show one beside
all that repeats at a place and all that causes make of the time. It competes with what was found in
white noise: the likelihood of all readings, what either costs paid for, says which it is.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from trunnion.base.report import rough
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.effect import Effect, EffectValues
from trunnion.diagnosis.linear_model import LinearModel
from trunnion.diagnosis.model import Covariate, Model
from trunnion.diagnosis.neighbours import Process
from trunnion.diagnosis.records import with_unit
from trunnion.diagnosis.whitening import Correlated, correlated

MAX_READINGS = 1000  # a dense matrix of readings
PARAMETERS = 2  # share and length
SEEN = 0.02  # of the largest function of a family, what is a function of its own
MADE = 1e-9  # of a column, what is rounding
TINY = 1e-300


class ReadInTurn(LinearModel):
    """Readings one after the other, which may wander as no cause does."""

    def correlated(
        self,
        nuisance: Floats,
        effects: EffectValues,  # noqa: ARG002
        used: Integers,
        variance: float,  # noqa: ARG002
        structure: Floats,  # noqa: ARG002
    ) -> Correlated | None:
        """Noise of readings that wander, if they do: whatever causes and structure are found."""
        return wander_in_turn(self, nuisance, used)


def wander_in_turn(model: Model, nuisance: Floats, used: Integers) -> Correlated | None:
    """Noise of readings that wander, each component by itself; None: they do not.

    ``used``: readings that are no outliers.
    """
    when = next((c for c in model.covariates if c.sequence), None)
    labels = model.replicates
    n = len(model.readings)
    if when is None or labels is None or n > MAX_READINGS:
        return None
    time = np.asarray(when.values, dtype=np.float64)[:, None]
    covariance, said = np.eye(n), []
    for name, enters in model.components.items():
        rows = np.flatnonzero(enters)
        mine = np.intersect1d(rows, used)
        functions = _functions(model, nuisance, labels)[mine]
        values = np.asarray(model.readings.values)[mine, None]
        process = Process.of(time[mine], values, functions, walks=True)
        if process is None:
            continue
        covariance[np.ix_(rows, rows)] = process.whole(time[rows]) / _white(process)
        said.append(_said(name, process, when, model))
    if not said:
        return None
    note = (
        f"Readings in turn are off alike: {'; '.join(said)}. Standard errors and probabilities "
        "allow for it."
    )
    count = PARAMETERS * len(said)
    return Correlated(np.eye(n), covariance - np.eye(n), note, model.groups, parameters=count)


def price(case: Case) -> float:
    """What the noise of readings that wander costs, of -2 ln L against white noise; 0: it is white.

    Of restricted likelihood: with what the noise leaves of the parameters that are always fitted.
    """
    noise = correlated(case.whiten)
    if noise is None or not noise.parameters:
        return 0.0
    columns = case.plain.jacobian @ case.plain.directions.T
    white, as_read = case.white(columns), columns[case.rows]
    fitted = np.linalg.slogdet(white.T @ white)[1] - np.linalg.slogdet(as_read.T @ as_read)[1]
    own = np.linalg.slogdet(noise.more + np.eye(len(noise.more)))[1]
    return float(own + fitted + noise.parameters * np.log(len(case.rows)))


def _white(process: Process) -> float:
    """Variance of the white noise beside a process."""
    return float(process.weights @ process.white)


def _said(name: str, process: Process, when: Covariate, model: Model) -> str:
    """Say how much a component wanders, and how fast."""
    length, shared, white = process.typical
    unit = model.readings.unit
    unit = unit if isinstance(unit, str) else unit[0]
    over = with_unit(rough(length), when.unit or "readings")
    of = f"{name}: " if name else ""
    return (
        f"{of}errors of {with_unit(rough(shared), unit)} rms that no cause makes are correlated "
        f"over about {over}, beside {with_unit(rough(white), unit)} of each reading"
    )


def _functions(model: Model, nuisance: Floats, labels: Integers) -> Floats:
    """Columns (n, k) of what is always fitted, of what repeats, and of what causes make beside.

    Not of effects that make much of any wander.
    """
    alone = labels < 0
    number = np.where(alone, np.cumsum(alone) + labels.max(), labels)
    repeats = np.eye(int(number.max()) + 1)[number]
    every = np.concatenate([model.jacobian(nuisance, {}), repeats], axis=1)
    taken = repeats / np.maximum(np.linalg.norm(repeats, axis=0), 1.0)
    made = (_family(model, nuisance, e, taken) for e in model.effects if not e.near_any)
    return np.concatenate([every, *made], axis=1)


def _family(model: Model, nuisance: Floats, effect: Effect, taken: Floats) -> Floats:
    """Functions (n, k) that an effect makes at all its places, beside columns that are taken.

    What is next to a sum of the others is none of its own. No function where the first place has
    none: it repeats, as all do. ``taken``: orthonormal, (n, m).
    """
    places = [
        effect.values(map(float, at))
        for at in product(*(p.grid or (0.0,) for p in effect.parameters))
    ]
    out = [np.zeros((len(taken), 0))]
    for some in (places[:1], places):
        columns = model.linear_columns(nuisance, effect, some).transpose(1, 2, 0)  # (k, n, v)
        left = columns - taken @ (taken.T @ columns)
        size = np.linalg.norm(columns, axis=1, keepdims=True)
        if np.all(np.abs(left) <= MADE * size):
            return out[0]
    for own, long in zip(left, size, strict=True):
        u, s, _ = np.linalg.svd(own / np.maximum(long, TINY), full_matrices=False)
        out.append(u[:, s > SEEN * s[0]])
    return np.concatenate(out, axis=1)
