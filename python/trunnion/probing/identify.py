"""Identification by least squares: any plan, any artefact, any effects, with uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from trunnion._core import Moves
from trunnion.base.errors import DataError, InputError, UnknownNameError
from trunnion.data.touches import Touches
from trunnion.machine.effects import PLACEMENT, Effect, UserEffect, split_effects
from trunnion.machine.estimate import Estimate, named_combination
from trunnion.probing.model import TouchModel
from trunnion.probing.result import IdentificationResult, LackOfFit, lack_of_fit
from trunnion.setup import Setup

__all__ = ["identify", "identify_many"]

SECOND_ORDER = 1e-3
"""Components below this share of a combination are second-order and not named."""

Floats = NDArray[np.float64]

HUBER_KNEE = 1.345
"""Knee of Huber's loss in standard deviations: 95 % efficient on Gaussian noise."""


def identify(
    data: Touches,
    setup: Setup,
    effects: Sequence[Effect] | Estimate = (),
    *,
    loss: Literal["squares", "huber"] = "squares",
    priors: Mapping[str, tuple[float, float]] | None = None,
    max_steps: int = 50,
) -> IdentificationResult:
    """Estimate location errors, placement and effects from touches of any plan.

    Gauss-Newton on the exact model with exact derivatives of the contact; converges from zero for
    errors of 1 mm and 1°.

    Parameters
    ----------
    data
        Touches; with an effect, the columns that it needs.
    setup
        Machine, artefact, probe. Known errors of the machine are where the search starts, and
        results are totals that include them. With `probe.repeatability_um` known, standard errors
        come from it (and from the tick); else from the residuals.
    effects
        Ids of the catalogue, or effects of the user's own; of an estimate, those that it has.
    loss
        "huber" lowers the weight of readings beyond 1.345 standard deviations (robust).
    priors
        What is known of a parameter beforehand: name ("artefact_length.dl_um") → (value,
        standard uncertainty), for instance a dimension with its calibration uncertainty. Needs
        `probe.repeatability_um`.
    max_steps
        Most Gauss-Newton steps.

    Returns
    -------
    IdentificationResult
        Estimates with covariance. What the touches cannot see stays where the search started,
        has standard error inf and is named.

    Raises
    ------
    InputError, UnknownNameError
        Useless arguments; an effect that needs a column which is not there.
    DataError
        Fewer touches than parameters, touches off the modelled surface.
    """
    if loss not in ("squares", "huber"):
        raise UnknownNameError(f"loss: got {loss!r}, wanted 'squares' or 'huber'")
    effects = tuple(effects.effects) if isinstance(effects, Estimate) else effects
    ids, own = split_effects(effects)
    model = TouchModel(setup, ids)
    moves = model.moves(data)
    if own:
        if priors or loss != "squares":
            raise InputError("effects: got a user's own with priors or a loss, wanted neither")
        return _identify_own(model, data, moves, own, max_steps)
    fit = model.core.fit(
        moves,
        model.values(),
        HUBER_KNEE if loss == "huber" else None,
        known_sigma_um(setup),
        _priors(model, priors or {}),
        max_steps,
    )
    values = fit["values"]
    count = len(model.error_names)
    null = fit["null_space"]
    return IdentificationResult(
        method="least squares" if loss == "squares" else "least squares, Huber's loss",
        errors={n: float(v) for n, v in zip(model.error_names, values[:count], strict=True)},
        placement={
            n: float(v)
            for n, v in zip(PLACEMENT, values[count : count + len(PLACEMENT)], strict=True)
        },
        effects=model.effects_of(values),
        owners=model.owners,
        std_errors={
            name: _moment_error(data, value) if kind == "moment" else float(error)
            for name, kind, value, error in zip(
                model.names, model.kinds, values, fit["std_errors"], strict=True
            )
        },
        names=model.names,
        covariance=fit["covariance"],
        residuals_um=fit["residuals_um"],
        sigma_um=fit["sigma_um"],
        degrees_of_freedom=fit["degrees_of_freedom"],
        converged=fit["converged"],
        combinations=tuple(named_combination(model.names, row) for row in null),
        at_bound=_at_end_of_search(model, data, values),
        weights=fit["weights"],
        lack_of_fit=_lack_of_fit(data, fit["residuals_um"], len(values) - len(null)),
    )


def identify_many(
    plan: Touches,
    setup: Setup,
    positions_mm: Floats,
    effects: Sequence[str] = (),
    *,
    max_steps: int = 50,
    threads: int | None = None,
) -> tuple[tuple[str, ...], Floats, Floats, NDArray[np.bool_]]:
    """Identify many measurements of one plan on all cores.

    Parameters
    ----------
    plan
        Angles, directions, feeds, times that all measurements share.
    positions_mm
        Recorded ball centres, (m, n, 3).
    threads
        How many threads; None: all cores. The numbers do not depend on it.

    Returns
    -------
    names, values, std_errors, converged
        Parameter names (p,), estimates (m, p), standard errors (m, p), flags (m,).
    """
    positions = np.ascontiguousarray(positions_mm, dtype=float)
    if positions.ndim != 3 or positions.shape[1:] != (len(plan), 3):
        raise InputError(f"positions_mm: got shape {positions.shape}, wanted (m, {len(plan)}, 3)")
    ids, own = split_effects(effects)
    if own:
        raise InputError("effects: got a user's own, wanted ids of the catalogue")
    model = TouchModel(setup, ids)
    values, errors, converged = model.core.fit_many(
        model.moves(plan),
        positions.reshape(len(positions), -1),
        model.values(),
        None,
        known_sigma_um(setup),
        [],
        max_steps,
        threads,
    )
    return model.names, values, errors, converged


def known_sigma_um(setup: Setup) -> float:
    """Standard deviation of a reading from the set-up: repeatability and tick; 0 if unknown."""
    if setup.probe.repeatability_um == 0:
        return 0.0
    return float(np.hypot(setup.probe.repeatability_um, setup.probe.tick_um / np.sqrt(12)))


def reduced_rows(null_space: Floats) -> Floats:
    """A null space in reduced row echelon form from the last column on: few parameters a row.

    Parameters
    ----------
    null_space
        Rows of p components.
    """
    rows = np.array(null_space, dtype=float)
    done = 0
    for column in range(rows.shape[1] - 1, -1, -1):
        if done == len(rows):
            break
        share = np.abs(rows[done:, column]) / np.abs(rows[done:]).max(axis=1)
        best = done + int(np.argmax(share))
        if share.max() <= SECOND_ORDER:
            continue
        rows[[done, best]] = rows[[best, done]]
        others = np.arange(len(rows)) != done
        rows[others] -= np.outer(rows[others, column] / rows[done, column], rows[done])
        done += 1
    return rows[:done]


def _priors(
    model: TouchModel, priors: Mapping[str, tuple[float, float]]
) -> list[tuple[int, float, float]]:
    found = []
    for name, prior in priors.items():
        if name not in model.names:
            raise UnknownNameError(f"prior: got {name!r}, wanted one of {', '.join(model.names)}")
        try:
            value, uncertainty = (float(part) for part in prior)
        except (TypeError, ValueError):
            raise InputError(
                f"prior of {name}: got {prior!r}, wanted (value, standard uncertainty)"
            ) from None
        found.append((model.names.index(name), value, uncertainty))
    return found


def _moment_error(data: Touches, moment: float) -> float:
    """Standard uncertainty of a moment between two touches: anywhere between them alike."""
    if data.time_s is None:
        return float("inf")
    before = data.time_s[data.time_s <= moment]
    after = data.time_s[data.time_s > moment]
    if not len(before) or not len(after):
        return float("inf")
    return float((after.min() - before.max()) / np.sqrt(12))


def _at_end_of_search(model: TouchModel, data: Touches, values: Floats) -> tuple[str, ...]:
    """Durations that run beyond what the measurement's length can tell."""
    if data.time_s is None:
        return ()
    span_s = float(data.time_s.max(initial=0.0))
    found = []
    for name, kind, unit, value in zip(model.names, model.kinds, model.units, values, strict=True):
        seconds = value * {"min": 60.0, "s": 1.0}.get(unit, 1.0)
        if kind == "duration" and not span_s / 50 < seconds < 3 * span_s:
            found.append(name)
    return tuple(found)


def repeats_of(data: Touches) -> NDArray[np.intp]:
    """Number of the group of touches that repeat each other, (n,).

    Touches repeat where positions of the rotary axes, senses of turning, direction, feed and label
    (or, without labels, the recorded line to 10 µm) are the same.
    """
    columns = [*data.rotary_deg.values(), *data.rotary_dir.values(), *data.direction.T]
    if data.feed_mm_min is not None:
        columns.append(data.feed_mm_min)
    if data.point is not None:
        columns.append(data.point)
    else:
        along = np.sum(data.position_mm * data.direction, axis=1)
        across = data.position_mm - along[:, None] * data.direction
        columns.extend(np.round(across, 2).T)
    keys = np.round(np.column_stack([np.asarray(column, float) for column in columns]), 6)
    return np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)


def _lack_of_fit(data: Touches, residuals_um: Floats, parameters: int) -> LackOfFit | None:
    return lack_of_fit(residuals_um, repeats_of(data), parameters)


def own_columns(effect: UserEffect, data: Touches, values: Mapping[str, float]) -> Floats:
    """Derivative of a user's effect by its parameters, (n, k): its own, or by differences.

    Raises
    ------
    DataError
        A `jacobian` of another shape, or with values that are not finite.
    """
    shape = (len(data), len(effect.parameters))
    given = getattr(effect, "jacobian", None)
    if given is not None:
        columns = np.asarray(given(data, dict(values)), dtype=float)
    else:
        columns = np.empty(shape)
        for k, name in enumerate(effect.parameters):
            step = 1e-4 * max(1.0, abs(values[name]))
            ahead, back = ({**values, name: values[name] + s} for s in (step, -step))
            rise = np.asarray(effect.change(data, ahead)) - np.asarray(effect.change(data, back))
            columns[:, k] = rise / (2 * step)
    if columns.shape != shape or not np.all(np.isfinite(columns)):
        raise DataError(
            f"effect {effect.id!r}: jacobian gave shape {columns.shape} or values that are not "
            f"finite, expected {shape} finite numbers"
        )
    return columns


def _identify_own(
    model: TouchModel,
    data: Touches,
    moves: Moves,
    own: Sequence[UserEffect],
    max_steps: int,
) -> IdentificationResult:
    """With effects of the user's own: the core's residuals and derivative, scipy's search.

    Derivatives of the user's effects are taken from their `jacobian` where they have one, else by
    central differences of their `change`.
    """
    names = [*model.names, *(f"{effect.id}.{name}" for effect in own for name in effect.parameters)]
    built_in = len(model.names)

    def own_values(vector: Floats) -> list[dict[str, float]]:
        found, first = [], built_in
        for effect in own:
            part = vector[first : first + len(effect.parameters)]
            found.append(dict(zip(effect.parameters, map(float, part), strict=True)))
            first += len(effect.parameters)
        return found

    def change(vector: Floats) -> Floats:
        total = np.zeros(len(data))
        for effect, values in zip(own, own_values(vector), strict=True):
            part = np.asarray(effect.change(data, values), dtype=float)
            if part.shape != total.shape or not np.all(np.isfinite(part)):
                raise DataError(
                    f"effect {effect.id!r}: change gave shape {part.shape} or values that are not "
                    f"finite, wanted {total.shape} finite numbers in µm"
                )
            total += part
        return total

    def residuals(vector: Floats) -> Floats:
        return model.core.residuals(moves, vector[:built_in]) - change(vector)

    def jacobian(vector: Floats) -> Floats:
        _, exact = model.core.linearise(moves, vector[:built_in])
        parts = zip(own, own_values(vector), strict=True)
        return np.hstack([-exact, *(-own_columns(e, data, values) for e, values in parts)])

    start = np.concatenate([model.values(), np.zeros(len(names) - built_in)])
    if len(data) < len(start):
        raise DataError(
            f"got {len(data)} touches for {len(start)} parameters, wanted at least as many"
        )
    found = optimize.least_squares(
        residuals,
        start,
        jac=jacobian,
        x_scale="jac",
        method="trf",
        xtol=1e-12,
        ftol=1e-14,
        gtol=1e-14,
        max_nfev=max_steps,
    )
    matrix = -jacobian(found.x)
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = 1.0
    _, singular, directions = np.linalg.svd(matrix / scale, full_matrices=False)
    kept = singular > SECOND_ORDER * singular[0]
    null = reduced_rows(directions[~kept] / scale)
    hidden = np.sqrt(np.sum(directions[~kept] ** 2, axis=0)) > 1e-6
    freedom = len(data) - int(kept.sum())
    left = residuals(found.x)
    sigma = known_sigma_um(model.setup) or float(np.sqrt(left @ left / max(freedom, 1)))
    weighted = directions[kept].T / singular[kept]
    covariance = sigma**2 * (weighted @ weighted.T) / np.outer(scale, scale)
    spread = np.where(hidden, np.inf, np.sqrt(np.diag(covariance)))
    count = len(model.error_names)
    effects = model.effects_of(found.x[:built_in])
    effects.update(
        {effect.id: values for effect, values in zip(own, own_values(found.x), strict=True)}
    )
    return IdentificationResult(
        method="least squares",
        errors={n: float(v) for n, v in zip(model.error_names, found.x[:count], strict=True)},
        placement={
            n: float(v)
            for n, v in zip(PLACEMENT, found.x[count : count + len(PLACEMENT)], strict=True)
        },
        effects=effects,
        owners=model.owners,
        std_errors={name: float(value) for name, value in zip(names, spread, strict=True)},
        names=tuple(names),
        covariance=covariance,
        residuals_um=left,
        sigma_um=sigma,
        degrees_of_freedom=freedom,
        converged=bool(found.status > 0),
        combinations=tuple(named_combination(names, row / np.abs(row).max()) for row in null),
        lack_of_fit=_lack_of_fit(data, left, len(names) - len(null)),
    )
