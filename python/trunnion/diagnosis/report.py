"""Put what was found into a :class:`Diagnosis`."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from trunnion.base.statistics import linear_fit
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.at_ends import notes_at_ends
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.case import Case, kept_rows
from trunnion.diagnosis.contributions import contributions_of
from trunnion.diagnosis.doubt import Doubt
from trunnion.diagnosis.effect import Effect, Values
from trunnion.diagnosis.explain import MIN_EXPLAINED, with_behind
from trunnion.diagnosis.explanation import Explanation
from trunnion.diagnosis.fit import ABSORBED_SHARE, Fit, first_values, variant_columns
from trunnion.diagnosis.in_steps import as_read
from trunnion.diagnosis.model import Model, Uncertainty
from trunnion.diagnosis.moments import determined, moment_errors, other_optima
from trunnion.diagnosis.open_structure import in_doubt, left_open, notes_of_open
from trunnion.diagnosis.predicted import weighed
from trunnion.diagnosis.records import (
    Alternative,
    Cause,
    Gain,
    Residuals,
    Verdict,
    labelled,
    rms,
    units_of,
    with_unit,
)
from trunnion.diagnosis.remaining import unexplained
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.scatter import Scatter
from trunnion.diagnosis.shape_in_time import notes_of_shape, shape_in_doubt
from trunnion.diagnosis.structure import placed, structure_of, why_stated, with_structure
from trunnion.diagnosis.unnoticed import Others, is_small, names_of, too_little, unnoticed_of
from trunnion.diagnosis.whitening import correlated
from trunnion.machine.budget import MODEL, SHAPE, Source, of_readings, root
from trunnion.machine.effects import Owner
from trunnion.machine.estimate import bias_in_words, combined, named_combination
from trunnion.machine.stated import Stated, conditioned, contradiction

LOST = "only the outliers identify it: measure them again"
UNDETERMINED = "these data do not determine it"
ABSORBED = "what is always fitted absorbs it"
PARTLY_ABSORBED = "what is always fitted absorbs a part of it"
PLACED_ONLY = " (only the placement)"
LEFT_OPEN = " (which these readings leave open in part)"
SEEN = 0.1  # µm, arcsec: what is said of errors that have no standard error begins at half of it
NO_MATTER = "what is likely of it would shift nothing by half a standard error"
MIDDLE = "errors and sizes are those in the middle of all machines that give these readings"
MIN_SHARE = 0.25  # of the variance of a reading, from which its rounding is mentioned
MAX_STEPS = 3
TOGETHER = 0.98  # correlation of two sizes, from which readings tell only what both make
UNSURE = 3.0  # standard errors of such a size, beside one that is smaller than its own
TINY = 1e-300
LIKELY = 0.5  # probability of each, below which they explain nothing
CLEAR = 0.2  # of the rms, that causes may leave unexplained and still explain the data


def report(case: Case, e: Explanation, dropped: Integers) -> Diagnosis:
    """Put an explanation without the readings ``dropped`` into words and numbers.

    ``case``: of all readings.
    """
    e, model = with_behind(e), case.model
    rows, kept = np.flatnonzero(kept_rows(len(model.readings), dropped)), case.without(dropped)
    named = e.fit if e.sets else kept.plain
    every, plain = as_read(case, case.plain)[0], as_read(kept, kept.plain)[0]
    stated, before = why_stated(kept, e.terms, named), kept
    kept, f, source = with_structure(before, e.terms, named)
    said = unexplained(before, e := placed(e, source, f))
    variance = float(case.floor.noise(f.rss, f.dof))
    f, growth, read = _values(kept, f, variance)
    left = f.residuals - kept.shared(f)
    gain = _gain(kept, rows, plain, f, left)
    open_ = left_open(kept, e, f, source, variance, before)
    e, shape = in_doubt(kept, e, f, open_, before), shape_in_doubt(kept, f, model.effects, variance)
    left_by = open_.every + shape
    e, alternatives, of_sets = weighed(case, kept, e, f, variance, growth, left_by)
    doubt = of_sets.beside(open_.every)
    grown = replace(f, covariance=f.covariance * np.outer(growth, growth))
    wide = replace(f, covariance=doubt.covariance + shape)
    as_far = replace(grown, covariance=grown.covariance + open_.constant / max(variance, TINY))
    sigma = _sigma(model, variance, gain, len(rows) / max(f.dof, 1))
    std = _errors_std(model, wide, 1.0)
    doubts, rivals = _doubts(model, of_sets, alternatives, std)
    lost, parts = _absorbed(kept, e.candidates, std, grown)
    others = Others.of(kept, grown, variance) if std or is_small(kept) else None
    weak = unnoticed_of(kept, grown, std, others, lost)
    contributions, ladder = contributions_of(kept, case.given or plain, grown, rows)
    known = _uncertainty(kept, f, doubt, shape, sigma, variance)
    unsure = (*notes_of_open(kept, f, open_, std, variance), *notes_of_shape(model, f, shape, std))
    notes = (*stated, *unsure, *_notes(case, f, variance, sigma, read=read))
    return Diagnosis(
        verdict=_verdict(said, before, e, rows, named, len(alternatives), len(dropped)),
        causes=_causes(kept, e, as_far, variance, wide, alternatives),
        evidence=tuple(alternatives),
        gain=gain,
        unexplained=said,
        errors_before=model.location_errors(every.nuisance, {}),
        errors_after=model.location_errors(f.nuisance, f.effects),
        errors_std=std,
        doubt=doubts,
        rivals=rivals,
        unnoticed=parts | weak,
        outliers=tuple(sorted({int(r) for r in model.readings.rows[dropped]})),
        not_identifiable=_not_identifiable(case, plain, f, std) | lost,
        structure=structure_of(source, e, kept, f, wide),
        model=kept.model.extended(f.nuisance, f.effects, known),
        p_value=e.alarm,
        sigma=sigma,
        nuisance_before=_by_name(model, every),
        nuisance_after=_by_name(model, f),
        units={x.name: x.unit for x in model.nuisance},
        labels=_labels(kept, {*f.effects, *lost, *weak}, alternatives),
        residuals=_residuals(kept.model, case.given or every, f, left, rows),
        reservation=model.reservation,
        too_little=too_little(kept, others),
        notes=(*notes, *_notes_of_causes(kept, f, variance)),
        contributions=contributions,
        ladder=ladder,
        none_probability=e.probabilities.none,
    )


def _labels(
    case: Case, shown: Collection[str], alternatives: Sequence[Alternative]
) -> dict[str, str]:
    """Labels of the effects that are shown, or in a set of alternatives."""
    every = set(shown).union(*(a.causes for a in alternatives))
    return {x.id: x.label for x in case.effects if x.id in every}


def _values(case: Case, f: Fit, variance: float) -> tuple[Fit, Floats, bool]:
    """A fit as it is reported, growth of its standard errors, whether of machines read so."""
    f, read = as_read(case, f)
    f = _with_what_is_stated(case, f, variance)
    return f, np.ones(len(f.covariance)) if read else case.growth(f, variance), read


def _by_name(model: Model, f: Fit) -> dict[str, float]:
    """Values of what is always fitted, by name."""
    return {x.name: float(v) for x, v in zip(model.nuisance, f.nuisance, strict=True)}


def _stated_places(case: Case, f: Fit) -> dict[int, tuple[str, Stated]]:
    """Parameters of a fit of which something is stated, by place: name, what is stated."""
    stated = {x.id: x.stated for x in case.effects if x.stated is not None}
    first = len(case.model.nuisance)
    found = enumerate(f.names, start=first)
    return {k: (f"{i}.{name}", stated[i]) for k, (i, name) in found if i in stated}


def _with_what_is_stated(case: Case, f: Fit, variance: float) -> Fit:
    """Return a fit with what is stated of its effects, to first order in what that moves."""
    places = {k: one.std for k, (_, one) in _stated_places(case, f).items()}
    if not places or variance <= 0:
        return f
    before = np.concatenate([f.nuisance, [f.effects[i][name] for i, name in f.names]])
    values, covariance = conditioned(before, f.covariance * variance, places)
    effects = {k: Values(v) for k, v in f.effects.items()}
    for (i, name), value in zip(f.names, values[len(f.nuisance) :].tolist(), strict=True):
        effects[i][name] = value
    return replace(
        f,
        nuisance=values[: len(f.nuisance)],
        effects=effects,
        residuals=f.residuals - f.jacobian @ (values - before),
        covariance=covariance / variance,
    )


def _notes_of_causes(case: Case, f: Fit, variance: float) -> tuple[str, ...]:
    """Say which effects explain too little to be named, and which contradict what is stated."""
    said = []
    if case.minor:
        names = ", ".join(sorted(case.minor))
        least = f"{100 * MIN_EXPLAINED:.0f} %"
        said.append(f"Not named, as each explains less than {least} of what is left: {names}.")
    std = np.sqrt(np.maximum(np.diag(f.covariance) * variance, 0.0))
    for k, (name, one) in _stated_places(case, f).items():
        effect, _, parameter = name.partition(".")
        against = contradiction(name, f.effects[effect][parameter], std[k], one)
        said += [] if against is None else [against]
    return (*said, *_notes_of_pairs(case, f, std), *notes_at_ends(case, f, variance))


def _notes_of_pairs(case: Case, f: Fit, std: Floats) -> Iterator[str]:
    """Say of which two causes the readings tell what both make together only."""
    first = len(case.model.nuisance)
    sizes = {(e.id, q.name): e for e in case.effects for q in e.parameters if q.linear}
    known = {
        k: (sizes[own], abs(f.effects[own[0]][own[1]]) / std[k])
        for k, own in enumerate(f.names, start=first)
        if own in sizes and 0 < std[k] < np.inf
    }
    for (i, (one, seen)), (j, (other, also)) in itertools.combinations(known.items(), 2):
        scale = float(np.sqrt(f.covariance[i, i] * f.covariance[j, j]))
        alike = abs(f.covariance[i, j]) > TOGETHER * scale
        if one.id != other.id and alike and min(seen, also) < 1 and max(seen, also) < UNSURE:
            named = f"{labelled(one.id, one.label)} and {labelled(other.id, other.label)}"
            yield (
                f"Of {named} the readings tell what both make together, and of neither how large "
                "it is: one error of another form may make it as well."
            )


def _sigma(model: Model, variance: float, gain: Gain, readings_a_freedom: float) -> float:
    """Noise of one reading."""
    if not isinstance(model.readings.unit, str):
        # Where units are mixed the fit is in units of the noise of each reading.
        return gain.rms_after_um * float(np.sqrt(readings_a_freedom))
    return float(np.sqrt(variance))


def _residuals(model: Model, plain: Fit, f: Fit, left: Floats, rows: Integers) -> Residuals:
    """Readings with what the models leave of them."""
    return Residuals.of(model, plain.residuals, left, rows, f.nuisance, f.effects)


def _notes_of_scatter(case: Case, sigma: float) -> tuple[str, ...]:
    """Say how much readings of each direction scatter, where they scatter differently."""
    if not isinstance(case.whiten, Scatter):
        return ()
    unit = units_of(case.model.readings)[0][0]
    sizes = ", ".join(
        f"{name} {with_unit(f'{sigma * size:.2g}', unit)}"
        for name, size in case.whiten.sizes.items()
    )
    return (f"Readings scatter by direction (1 σ): {sizes}. Each is weighed by its own.",)


def _notes(case: Case, f: Fit, variance: float, sigma: float, *, read: bool) -> tuple[str, ...]:
    """Remarks of the model; what looks like named causes; what the readings say of their noise.

    ``read``: and of steps.
    """
    alike = (
        effect.not_distinguished
        for effect in case.effects
        if effect.id in f.effects and effect.looks_like
    )
    noise = correlated(case.whiten)
    shared = () if noise is None else (noise.note,)
    scatter = _notes_of_scatter(case, sigma)
    steps = _notes_of_steps(case, variance, read=read)
    return (*case.model.remarks, *alike, *shared, *scatter, *steps)


def _notes_of_steps(case: Case, variance: float, *, read: bool) -> tuple[str, ...]:
    """Say in which steps the readings are recorded, where that is what limits them.

    ``read``: whether errors are those of machines that were read so (:func:`.in_steps.as_read`).
    """
    readings, floor = case.model.readings, case.floor.variance
    if case.grid is None or floor < MIN_SHARE * variance:
        return ()
    units, index = units_of(readings)
    text = []
    for i, unit in enumerate(units):
        steps = [f"{step:.4g}" for step in np.unique(case.grid.step[index == i]) if step > 0]
        if steps:
            text.append(with_unit(" and ".join(steps[:MAX_STEPS]), unit))
    stated = case.grid.stated(readings.step)
    some, known = np.any(stated[case.grid.step > 0]), bool(np.all(stated[case.grid.step > 0]))
    source = "as the set-up states" if known else "recognised in the data"
    if readings.step is not None and not known:
        source += ", finer ones are stated"
    elif some and not known:
        source += " or as the set-up states"
    note = (
        f"Readings are recorded in steps of {', '.join(text)} ({source}): their noise is taken as "
        "at least step/√12, and what rounding does is not taken for a cause"
    )
    more = [MIDDLE] if read else []
    more += [] if known or not readings.hint else [readings.hint]
    return (f"{'; '.join([note, *more])}.",)


def _gain(case: Case, rows: Integers, plain: Fit, f: Fit, left: Floats) -> Gain:
    """Residuals fitted (``left``) and cross-validated, on the readings that are no outliers."""
    units, index = units_of(case.model.readings)
    before = case.cross_validated(case.given or plain)
    return Gain.of(
        (case.given or plain).residuals[rows],
        left[rows],
        before,
        before if f is plain else case.cross_validated(f),
        units,
        index[rows],
    )


def _not_identifiable(case: Case, plain: Fit, f: Fit, std: dict[str, float]) -> dict[str, str]:
    """Errors without a standard error, each with the reason."""
    kept, every = (_errors_std(case.model, of, 1.0) for of in (plain, case.plain))
    why = {k: UNDETERMINED for k, s in std.items() if np.isinf(s)}
    for row in f.combinations:
        members = named_combination(names_of(case.model, f), row)
        if len(members) > 1:
            text = f"{combined(members)} change no reading"
            why.update((k, text) for k in members if k in why)
    lost = {k for k, s in kept.items() if np.isinf(s) and np.isfinite(every[k])}
    return {k: LOST if k in lost else text for k, text in why.items()}


def _absorbed(
    case: Case, candidates: Candidates, std: dict[str, float], f: Fit
) -> tuple[dict[str, str], dict[str, str]]:
    """Effects that are not identifiable, with what they would do to an error of the machine.

    Of others a combination of parameters may be absorbed: they are listed where it shifts an error
    and they are not in the fit ``f``, which has no standard errors for such a combination. How much
    of these stays unnoticed is said a second time, by itself.
    """
    plain = case.plain
    out, parts = dict[str, str](), dict[str, str]()
    fitted = list(zip(case.model.nuisance, map(float, f.std()), strict=False))
    machine = {**{x.name: s for x, s in fitted if x.owner is Owner.MACHINE}, **std}
    placement = {x.name: s for x, s in fitted if x.owner is Owner.PLACEMENT}
    known = (
        (machine, ""),
        (placement, PLACED_ONLY),
        ({name: SEEN for name, s in machine.items() if np.isinf(s)}, LEFT_OPEN),
    )
    along = case.in_basis(plain) @ plain.directions.T
    rank = dict.fromkeys(map(int, candidates.not_identifiable), 0)
    largest = np.zeros(candidates.count, dtype=np.intp)  # of the blocks of each leader
    np.maximum.at(largest, candidates.owner, candidates.rank)
    for leader, alike in candidates.alike.items():
        rank.update(dict.fromkeys(alike, int(largest[leader])))
    for j, effect in enumerate(case.effects):
        linear = [p for p in effect.parameters if p.linear]
        if rank.get(j, len(linear)) == len(linear) or (rank[j] and effect.id in f.effects):
            continue
        start = first_values(effect)
        columns = variant_columns(case.model, effect, plain.nuisance, [start])[0]
        units = {f"{effect.id}.{p.name}": p.unit for p in linear}
        names = [*(x.name for x in case.model.nuisance), *units]
        rows = _confounded(plain, along, case.white(columns))
        combinations = [dict(zip(names, row, strict=True)) for row in rows]
        said = ((bias_in_words(combinations, units, errors), what) for errors, what in known)
        bias, what = next(((bias, what) for bias, what in said if bias), ("", ""))
        if rank[j] == 0:
            out[effect.id] = f"{ABSORBED}: {bias}{what}" if bias else f"{ABSORBED}: {NO_MATTER}"
        elif bias and not what:
            out[effect.id] = f"{PARTLY_ABSORBED}: {bias}"
            parts[effect.id] = f"{bias}, unnoticed"
    return out, parts


def _confounded(plain: Fit, along: Floats, columns: Floats) -> Floats:
    """Combinations of nuisance and an effect's parameters that change no reading, (k, p + q).

    ``along``: white jacobian of the plain fit along its directions, in its basis, (r, r);
    ``columns``: white ones of the effect, readings used, (n, q).
    """
    share = plain.basis.T @ columns
    left = np.linalg.qr(columns - plain.basis @ share, mode="r")
    joined = np.block([[along, share], [np.zeros((len(left), len(along))), left]])
    found = linear_fit(joined, np.zeros(len(joined)), tolerance=ABSORBED_SHARE)
    nuisance, effect = np.split(found.combinations, [along.shape[1]], axis=1)
    return np.concatenate([nuisance @ plain.directions, effect], axis=1)


def _verdict(
    unexplained: str | None,
    case: Case,
    e: Explanation,
    rows: Integers,
    f: Fit,
    sets: int,
    outliers: int,
) -> Verdict:
    before, after = (case.given or case.plain).residuals, f.residuals
    index, rows = units_of(case.model.readings)[1], rows[_measured_with(case, e, rows)]
    units = [rows[index[rows] == i] for i in range(index.max() + 1)]
    clear = sets and all(rms(after[u]) <= CLEAR * rms(before[u]) for u in units if len(u))
    named = (j for j, x in enumerate(case.effects[: e.candidates.count]) if x.id in f.effects)
    clear = clear and all(e.probabilities.of_cause(j) >= LIKELY for j in named)
    if unexplained is not None and not clear:
        return "unexplained"
    if sets > 1:
        return "ambiguous"
    return "explained" if sets or outliers else "consistent"


def _measured_with(case: Case, e: Explanation, rows: Integers) -> slice:
    """Which of some readings are of the measurement that has the structure that is stated."""
    for v in case.model.covariates:
        if e.terms and v.name == e.terms[0][0].covariate and v.readings is not None:
            return slice(*np.searchsorted(rows, v.readings).tolist())
    return slice(None)


def _errors_std(model: Model, f: Fit, variance: float) -> dict[str, float]:
    """Return standard errors of the machine's errors that are nuisance parameters themselves."""
    known = model.location_errors(f.nuisance, f.effects)
    std = f.std() * np.sqrt(variance)
    return {x.name: float(s) for x, s in zip(model.nuisance, std, strict=False) if x.name in known}


def _doubts(
    model: Model, doubt: Doubt, sets: Sequence[Alternative], std: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, frozenset[str]]]:
    """Of errors of the machine, uncertainty by doubt between sets, and the set that adds most."""
    if not any(doubt.rival):
        return {}, {}
    mine = [i for i, x in enumerate(model.nuisance) if x.name in std and doubt.rival[i]]
    names = [model.nuisance[i].name for i in mine]
    return (
        {k: float(np.sqrt(doubt.between[i, i])) for i, k in zip(mine, names, strict=True)},
        {name: sets[doubt.rival[i]].causes for i, name in zip(mine, names, strict=True)},
    )


def _uncertainty(
    case: Case, f: Fit, doubt: Doubt, shape: Floats, sigma: float, variance: float
) -> Uncertainty:
    """Uncertainty of a fit with the doubt between the sets, and what it comes from.

    ``shape``: mean squares by the shape of processes in time.
    """
    names, covariance = names_of(case.model, f), doubt.covariance + shape
    std = replace(f, covariance=covariance).std()
    rounding = sigma * float(np.sqrt(min(case.floor.variance / max(variance, TINY), 1.0)))
    own, unit = doubt.covariance - doubt.between, units_of(case.model.readings)[0]
    sources = list(of_readings(own, sigma, unit[0] if len(unit) == 1 else "", rounding, f.dof))
    inputs = case.model.inputs(f.nuisance, f.effects)
    sources += [one.source(case.moved(f, case.white(one.columns))) for one in inputs]
    if np.any(doubt.between):
        sources.append(Source(MODEL, 1.0, "", root(doubt.between)))
    if np.any(shape):
        sources.append(Source(SHAPE, 1.0, "", root(shape)))
    return Uncertainty(
        names,
        dict(zip(names, map(float, std), strict=True)),
        covariance,
        sigma,
        f.dof,
        tuple(sources),
    )


def _causes(
    case: Case,
    e: Explanation,
    f: Fit,
    variance: float,
    wide: Fit,
    alternatives: Sequence[Alternative],
) -> tuple[Cause, ...]:
    """Describe the effects of a fit, strongest first; ``wide``: with the doubt between sets."""
    named = alternatives[0].causes if alternatives else frozenset()
    out = []
    for j, effect in enumerate(case.effects[: e.candidates.count]):  # structure is behind them
        if effect.id not in f.effects:
            continue
        numbers = f.effects[effect.id]
        std = case.std(effect, wide, 1.0)
        chance, wald = case.chance_beside(effect, f, variance)
        owned = np.flatnonzero(e.candidates.owner == j)
        places = float(e.candidates.places[owned[0]]) if len(owned) else 1.0
        aliases = {
            next(iter(a.causes - named))
            for a in alternatives[1:]
            if len(a.causes) == len(named) and named - a.causes == {effect.id}
        }
        cause = Cause(
            effect.id,
            {q.name: float(numbers[q.name]) for q in effect.parameters},
            _std_errors(case, effect, f, variance, std),
            min(1.0, chance * e.candidates.multiplicity * places),
            tuple(sorted(aliases)),
            effect.label,
            e.probabilities.of_cause(j),
            effect.instead,
        )
        out.append((wald, cause))
    out.sort(key=lambda t: -t[0])
    return tuple(cause for _, cause in out)


def _std_errors(
    case: Case, effect: Effect, f: Fit, variance: float, std: Floats
) -> dict[str, float]:
    """Standard errors of an effect's parameters by name; ``std``: by their covariance."""
    out = {q.name: float(s) for q, s in zip(effect.parameters, std, strict=True)}
    for name, off in other_optima(case, effect, f, variance).items():
        out[name] = float(np.hypot(out[name], off))
    return determined(effect, out | moment_errors(case, effect, f, variance))
