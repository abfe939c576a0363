"""Identification by least squares: any plan, any artefact, any effects, with uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from trunnion._core import Moves
from trunnion.base.arguments import checked, name_place, renumber
from trunnion.base.errors import InputError, TrunnionError, UnknownNameError
from trunnion.base.repeats import Repeats
from trunnion.base.resolution import ANY_PLACE, grown
from trunnion.base.rows import equal_rows
from trunnion.base.statistics import linear_fit
from trunnion.base.units import Floats, unit_of
from trunnion.data.distinct import distinct_rows
from trunnion.data.times import begin_and_span_s, clock_notes, from_first_reading, time_notes
from trunnion.data.touches import Touches
from trunnion.machine.budget import Source, of_readings
from trunnion.machine.effects import PLACEMENT, Effect, Moving, UserEffect, split_effects
from trunnion.machine.estimate import Estimate, named_combination
from trunnion.machine.geometry import made_with
from trunnion.machine.stated import Stated, contradiction
from trunnion.probing.estimated import estimated
from trunnion.probing.inputs import certificate, inputs_of
from trunnion.probing.mistakes import likely_mistakes, mistakes_named, seen_at_once
from trunnion.probing.model import (
    TouchModel,
    grid_of,
    known_sigma_um,
    rounding_um,
    steps_um,
)
from trunnion.probing.own_effects import Found, Loss, TouchProblem, own_names
from trunnion.probing.recorded import readings_um
from trunnion.probing.result import IdentificationResult, lack_of_fit
from trunnion.probing.scatter import scatter_um
from trunnion.setup import Setup

MAX_STEPS = 50
HUBER_KNEE = 1.345
"""Knee of Huber's loss in standard deviations: 95 % efficient on Gaussian noise."""


@checked
def identify(
    data: Touches,
    setup: Setup,
    effects: Sequence[Effect] | Estimate = (),
    *,
    loss: Literal["squares", "huber"] = "squares",
    priors: Mapping[str, tuple[float, float]] | None = None,
    max_steps: int = MAX_STEPS,
) -> IdentificationResult:
    """Estimate location errors, placement and effects from touches of any plan.

    Gauss-Newton on the exact model with exact derivatives of the contact; converges from zero for
    errors of 1 mm and 1°.

    Parameters
    ----------
    data
        Touches; with an effect, the columns that it needs. Rows that repeat others (pasted twice,
        or copied to another cycle) count once; a note says so.
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
        standard uncertainty). Needs `probe.repeatability_um`. A dimension, the ball radius or the
        expansion of the artefact, where it is fitted, has what the set-up states of it as its prior
        unless one is given: 0 within `[artefact] calibration_um`, `calibration_arcsec`,
        `expansion_ppm_k` times `temperature_std_k`, `[probe] calibration_um`.
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

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> fit = tn.identify(touches, setup)
    >>> round(fit["EX0C"], 2), round(fit.std_errors["EX0C"], 2)
    (14.95, 0.08)
    """
    if loss not in ("squares", "huber"):
        raise UnknownNameError(f"loss: got {loss!r}, expected 'squares' or 'huber'")
    effects = tuple(effects.effects) if isinstance(effects, Estimate) else effects
    fit = partial(_identified, effects=effects, loss=loss, priors=priors or {}, max_steps=max_steps)
    return estimated(data, setup, fit)


def mistakes_in(
    model: TouchModel, data: Touches, moves: Moves, beside: Floats | None = None
) -> tuple[str, ...]:
    """Return the notes on likely mistakes that :func:`identify` gives, without the rest of it.

    Too few of them for the plain model say what shows without its estimates.

    model: Of the set-up, without effects. moves: The touches, as the core knows them. beside: How
    causes that are known of change the touches, (n, k).
    """
    if len(data) < len(model.names):
        model.core.residuals(moves, model.values())
        return seen_at_once(data, model, moves)
    how = Loss(None, known_sigma_um(model.setup, data), _priors(model.names, {}))
    found = _by_the_core(model, moves, how, MAX_STEPS)
    result = _result(model, data, (), found, None)
    return likely_mistakes(result, data, model, moves, beside)


def mistakes_of(data: Touches, setup: Setup) -> tuple[str, ...]:
    """Name what is likely wrong with touches, as a diagnosis of them does.

    Raises
    ------
    DataError
        Touches off the modelled surface; the message has their place and the likely cause.
    """
    own = distinct_rows(data)
    try:
        with mistakes_named(own.data, setup):
            model = TouchModel(setup)
            return mistakes_in(model, own.data, model.moves(own.data))
    except TrunnionError as error:
        if own.rows is not None:
            renumber(error, own.rows.tolist())
        name_place(error, [data])
        raise


def _identified(
    data: Touches,
    setup: Setup,
    effects: Sequence[Effect],
    loss: str,
    priors: Mapping[str, tuple[float, float]],
    max_steps: int,
) -> IdentificationResult:
    """Fit, and what the fit says."""
    clock, data = clock_notes(data), from_first_reading(data)
    ids, own = split_effects(effects)
    model = TouchModel(setup, ids)
    moves = model.moves(data)
    names = own_names(model, own)
    knee = HUBER_KNEE if loss == "huber" else None
    stated = certificate(model)
    sigma = known_sigma_um(setup, data)
    by_setup = {name: (0.0, std) for name, (_, std) in stated.items()} if sigma > 0 else {}
    how = Loss(knee, sigma, _priors(names, {**by_setup, **priors}))
    found = (
        TouchProblem(model, data, moves, own).fit(how, max_steps)
        if own
        else _by_the_core(model, moves, how, max_steps)
    )
    if not own and found.sigma_um < (rounding := rounding_um(setup, data)):
        found = _by_the_core(model, moves, replace(how, sigma_um=rounding), max_steps)
    errors = None
    labels = {names.index(name): label for name, (label, _) in stated.items()}
    known = _by_priors(names, how, found, labels)
    plain = found
    if not own and np.any(steps_um(setup, data)):
        found, errors = _beside_rounding(model, data, moves, found, known)
    problem = TouchProblem(model, data, moves, own)
    jacobian = problem.jacobian(found.values)
    timed = any("time_s" in model.chain.effects[name].needs for name in model.effect_ids)
    said = (*clock, *time_notes(data)) if timed else ()
    if not (knee or how.sigma_um):
        found, scatter = _beside_scatter(problem, jacobian, plain, found)
        said = (*said, *scatter)
    sources = _sources(problem, jacobian, plain, found, known, is_known=how.sigma_um > 0)
    lack = lack_of_fit(
        found.residuals_um if errors is None else errors(found.residuals_um),
        repeats_of(data),
        len(found.values) - len(found.combinations),
        rounding_um(setup, data),
    )
    result = _result(model, data, own, found, knee)
    result = replace(result, sources=sources, lack_of_fit=lack)
    return replace(result, notes=(*said, *_of_the_certificate(result, stated, how, priors)))


def _beside_scatter(
    problem: TouchProblem, jacobian: Floats, plain: Found, found: Found
) -> tuple[Found, tuple[str, ...]]:
    """Covariance where touches of one direction scatter more than of another, and a note on it."""
    scattered = scatter_um(problem.model.setup, problem.data, jacobian, found.residuals_um)
    if scattered is None:
        return found, ()
    each, note = scattered
    gain = plain.covariance @ jacobian.T / plain.sigma_um**2
    covariance = (gain * each**2) @ gain.T
    std = np.where(np.isfinite(found.std_errors), np.sqrt(np.diag(covariance)), np.inf)
    return replace(found, covariance=covariance, std_errors=std), (note,)


def _by_priors(
    names: Sequence[str], loss: Loss, found: Found, labels: Mapping[int, str]
) -> tuple[Source, ...]:
    """What the estimates owe to what was known beforehand: they move by C/u² with its value."""
    return tuple(
        Source(
            labels.get(k, f"prior of {names[k]}"),
            std,
            unit_of(names[k]),
            found.covariance[:, [k]] / std**2,
        )
        for k, _, std in loss.priors
    )


def _of_the_certificate(
    result: IdentificationResult,
    stated: Mapping[str, Stated],
    loss: Loss,
    given: Mapping[str, tuple[float, float]],
) -> tuple[str, ...]:
    """Say where what the set-up states could not be used, or the readings contradict it."""
    said = []
    for name, one in stated.items():
        if name in given:
            continue
        if not loss.sigma_um:
            needs = "that needs [probe] repeatability_um"
            said.append(f"{name} is fitted without the {one.what}, {one.std:g}: {needs}.")
            continue
        against = contradiction(name, result[name], result.std_errors[name], one)
        said += [] if against is None else [against]
    return tuple(said)


def _sources(
    problem: TouchProblem,
    jacobian: Floats,
    plain: Found,
    found: Found,
    known: tuple[Source, ...],
    *,
    is_known: bool,
) -> tuple[Source, ...]:
    """What the estimates' uncertainty comes from; ``found``: covariance that knows of ticks.

    ``known``: what was known beforehand; ``is_known``: whether the noise of a reading is.
    """
    model, data = problem.model, problem.data
    weighted = jacobian * found.weights[:, None]
    if plain.sigma_um > 0:
        cofactor = plain.covariance / plain.sigma_um**2
    else:
        cofactor = linear_fit(weighted, np.zeros(len(weighted)), hold=problem.held).cofactor
    freedom = np.inf if is_known else float(found.degrees_of_freedom)
    rounding = rounding_um(model.setup, data)
    rest = found.covariance - _covariance(known, len(found.values))
    readings = of_readings(rest, found.sigma_um, "µm", rounding, freedom)
    values = found.values[: len(model.names)]
    stated = inputs_of(model, problem.moves, data, values)
    gain = cofactor @ weighted.T
    return (*readings, *known, *(one.source(gain @ one.columns) for one in stated))


def _covariance(sources: Sequence[Source], count: int) -> Floats:
    """What sources add to the covariance of so many parameters."""
    return sum((one.covariance() for one in sources), np.zeros((count, count)))


def _beside_rounding(
    model: TouchModel, data: Touches, moves: Moves, found: Found, known: tuple[Source, ...]
) -> tuple[Found, Repeats | None]:
    """Covariance that knows what ticks do: repeats on one grid, and touches that round alike.

    With the errors that repeats share, if there are any.
    """
    along = readings_um(data)
    jacobian = model.core.linearise(moves, found.values)[1]
    grid = grid_of(model, data, jacobian)
    noise = grid.noise(found.residuals_um, found.degrees_of_freedom, jacobian, found.weights)
    errors = grid.errors(noise)
    shared = errors if errors is not None and len(errors.rows) else None
    drawn = grid.draws(along, found.residuals_um, jacobian, found.covariance, noise, ANY_PLACE)
    if found.sigma_um == 0 or (shared is None and drawn is None):
        return found, shared
    cofactor = found.covariance / found.sigma_um**2
    covariance, weighted = found.covariance, jacobian * found.weights[:, None]
    if shared is not None:
        covariance = found.sigma_um**2 * cofactor @ shared.covariance(weighted) @ cofactor
        covariance = covariance + _covariance(known, len(covariance))
    if drawn is not None:
        covariance = grown(covariance, cofactor @ (weighted.T @ drawn))
    std = np.where(np.isfinite(found.std_errors), np.sqrt(np.diag(covariance)), np.inf)
    return replace(found, covariance=covariance, std_errors=std), shared


def _result(
    model: TouchModel,
    data: Touches,
    own: Sequence[UserEffect],
    found: Found,
    knee: float | None,
) -> IdentificationResult:
    """Estimates by name."""
    names = own_names(model, own)
    count, built_in = len(model.error_names), len(model.names)
    values, kinds = found.values, [*model.kinds, *["linear"] * (len(names) - built_in)]
    effects_found = model.effects_of(values[:built_in])
    at = built_in
    for e in own:
        part = map(float, values[at : at + len(e.parameters)])
        effects_found[e.id] = dict(zip(e.parameters, part, strict=True))
        at += len(e.parameters)
    return IdentificationResult(
        method="least squares" if knee is None else "least squares, Huber's loss",
        errors=dict(zip(model.error_names, map(float, values[:count]), strict=True)),
        placement=dict(zip(PLACEMENT, map(float, values[count : count + 6]), strict=True)),
        effects=effects_found,
        owners=model.owners,
        motions={e.id: e.motion for e in own if isinstance(e, Moving)},
        not_compensable={
            e.id: "it has no motion(pose, values)" for e in own if not isinstance(e, Moving)
        },
        std_errors={
            name: _moment_error(data, value) if kind == "moment" else float(error)
            for name, kind, value, error in zip(names, kinds, values, found.std_errors, strict=True)
        },
        names=names,
        covariance=found.covariance,
        residuals_um=found.residuals_um,
        sigma_um=found.sigma_um,
        degrees_of_freedom=float(found.degrees_of_freedom),
        converged=found.converged,
        combinations=tuple(named_combination(names, row) for row in found.combinations),
        at_bound=_at_end_of_search(model, data, values[:built_in]),
        weights=found.weights,
        **made_with(model.setup, data),
    )


def _by_the_core(model: TouchModel, moves: Moves, loss: Loss, max_steps: int) -> Found:
    fit = model.core.fit(
        moves,
        model.values(),
        huber=loss.knee,
        sigma_um=loss.sigma_um,
        priors=list(loss.priors),
        max_steps=max_steps,
    )
    return Found(
        fit["values"],
        fit["std_errors"],
        fit["covariance"],
        fit["null_space"],
        fit["residuals_um"],
        fit["weights"],
        fit["sigma_um"],
        fit["degrees_of_freedom"],
        fit["converged"],
    )


@checked
def identify_many(
    plan: Touches,
    setup: Setup,
    positions_mm: Floats,
    effects: Sequence[str] = (),
    *,
    max_steps: int = MAX_STEPS,
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

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> import numpy as np
    >>> both = np.stack([touches.position_mm, touches.position_mm])
    >>> names, values, std_errors, converged = tn.identify_many(touches, setup, both)
    >>> values[:, names.index("EX0C")].round(2)
    array([14.95, 14.95])
    """
    positions = np.ascontiguousarray(positions_mm, dtype=float)
    if positions.ndim != 3 or positions.shape[1:] != (len(plan), 3):
        raise InputError(f"positions_mm: got shape {positions.shape}, expected (m, {len(plan)}, 3)")
    ids, own = split_effects(effects)
    if own:
        raise InputError("effects: got a user's own, expected ids of the catalogue")
    model = TouchModel(setup, ids)
    sigma = known_sigma_um(setup, plan)
    stated = {name: (0.0, std) for name, (_, std) in certificate(model).items()} if sigma else {}
    values, errors, converged = model.core.fit_many(
        model.moves(plan),
        positions.reshape(len(positions), -1),
        model.values(),
        huber=None,
        sigma_um=sigma,
        priors=_priors(model.names, stated),
        max_steps=max_steps,
        threads=threads,
    )
    return model.names, values, errors, converged


def _priors(
    names: Sequence[str], priors: Mapping[str, tuple[float, float]]
) -> list[tuple[int, float, float]]:
    found = []
    for name, prior in priors.items():
        if name not in names:
            raise UnknownNameError(f"prior: got {name!r}, expected one of {', '.join(names)}")
        try:
            value, uncertainty = (float(part) for part in prior)
        except (TypeError, ValueError):
            raise InputError(
                f"prior of {name}: got {prior!r}, expected (value, standard uncertainty)"
            ) from None
        found.append((names.index(name), value, uncertainty))
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
    span_s = begin_and_span_s(data)[1]
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
    return equal_rows([np.round(np.asarray(column, float), 6) for column in columns])[0]
