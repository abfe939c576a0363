"""Unexplained structure as a part of the extended model, with parameters of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from scipy import special

from trunnion.base.errors import DataError
from trunnion.base.report import Result, Table
from trunnion.base.units import Floats, Integers, parameter_words, unit_of
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.cross_validation import better
from trunnion.diagnosis.effect import Effect, EffectValues, Values
from trunnion.diagnosis.explanation import Explanation
from trunnion.diagnosis.fit import Fit, fit
from trunnion.diagnosis.formula import FormulaEffect
from trunnion.diagnosis.model import Model, Uncertainty
from trunnion.diagnosis.of_some import OfSome, Orthonormal
from trunnion.diagnosis.records import (
    labelled,
    parameter_table,
    value_in_words,
)
from trunnion.diagnosis.scan import SCAN_LEVEL
from trunnion.diagnosis.term import Term
from trunnion.diagnosis.whitening import Whiten
from trunnion.machine.estimate import Estimate

WHY_NOT = "nobody has named what makes it"
NOT_FITTED = "What the residual depends on is stated, and not in the extended model"
INCOMPLETE = (
    "the model is not complete there, what is left is no stationary noise; look first for what "
    "makes most of it"
)
UNDETERMINED = "the readings do not determine it beside the causes; measure at more places"
ELSEWHERE = "measure at further places or in another order, which distinguish the two"
WORSE = f"with it readings are predicted worse from the others; {ELSEWHERE}"
DISTINGUISHED = 2.0
"""How much wider structure may make a cause's standard error, and be in the model.

Where it makes that of an error of the machine or of a placement wider, all may be off by what it
moves.
"""


@dataclass(frozen=True, eq=False, repr=False)
class Structure(Result):
    """Unexplained structure as it is in the extended model.

    Attributes
    ----------
    effect:
        Its formula.
    parameters, std_errors:
        By parameter name, in the unit of the name; a standard error of inf: not identifiable.
    share:
        Of the variance of what the causes leave.
    others:
        What the residual may depend on instead, in words.

    Examples
    --------
    >>> import trunnion as tn
    >>> wave = tn.FormulaEffect(
    ...     "rail_wave", "Touches", covariate="Y place", unit="mm", component="X",
    ...     shape="wave", number=31.0, low=-50.0, high=50.0,
    ... )
    >>> found = tn.Structure(wave, {"a_um": 2.0}, {"a_um": 0.1}, 0.6)
    >>> found.effect.id
    'rail_wave'
    """

    effect: FormulaEffect
    parameters: Mapping[str, float]
    std_errors: Mapping[str, float]
    share: float
    others: tuple[str, ...] = ()

    def sentences(self) -> tuple[str, ...]:
        """Say the formula and its values."""
        values = ", ".join(
            f"{name.split('_', 1)[0]} = {value_in_words(v, self.std_errors[name], unit_of(name))}"
            for name, v in self.parameters.items()
        )
        return (f"In the extended model: {self.effect.formula()}; {values}.",)

    def tables(self) -> tuple[Table, ...]:
        """Parameters with their standard errors."""
        return (parameter_table(self.effect.label, self.parameters, self.std_errors),)


class _ModelWith:
    """A model with one more effect, added to its readings; all else is the model's."""

    def __init__(self, model: Model, effect: Effect, source: FormulaEffect) -> None:
        self.inner, self.more, self.source = model, effect, source
        self.effects = (*model.effects, effect)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def effect(self, name: str) -> Effect:
        return self.more if name == self.more.id else self.inner.effect(name)

    def _without(self, effects: EffectValues) -> dict[str, Mapping[str, float]]:
        return {k: v for k, v in effects.items() if k != self.more.id}

    def predict(self, nuisance: Floats, effects: EffectValues) -> Floats:
        out = self.inner.predict(nuisance, self._without(effects))
        if self.more.id in effects:
            out = out + np.asarray(self.more.change(Values(effects[self.more.id])))
        return out

    def jacobian(self, nuisance: Floats, effects: EffectValues) -> Floats:
        return self.inner.jacobian(nuisance, self._without(effects))

    def left_by_places(self, effects: EffectValues) -> Mapping[tuple[str, str], float]:
        return self.inner.left_by_places(self._without(effects))

    def effect_jacobian(
        self, nuisance: Floats, effect: Effect, values: Mapping[str, float]
    ) -> Floats:
        if effect.id == self.more.id:
            return effect.columns(values)
        return self.inner.effect_jacobian(nuisance, effect, values)

    def derivatives(
        self, nuisance: Floats, effects: Sequence[Effect], values: EffectValues
    ) -> list[Floats]:
        others = [e for e in effects if e.id != self.more.id]
        first, *made = self.inner.derivatives(nuisance, others, self._without(values))
        own = iter(made)
        found = (e.columns(values[e.id]) if e.id == self.more.id else next(own) for e in effects)
        return [first, *found]

    def linear_columns(
        self, nuisance: Floats, effect: Effect, values: Sequence[Mapping[str, float]]
    ) -> Floats:
        if effect.id == self.more.id:
            return Model.linear_columns(cast("Model", self), nuisance, effect, values)
        return self.inner.linear_columns(nuisance, effect, values)

    def white_columns(
        self, nuisance: Floats, effect: Effect, values: Sequence[Values], whiten: Whiten
    ) -> Floats:
        if effect.id == self.more.id:
            return Model.white_columns(cast("Model", self), nuisance, effect, values, whiten)
        return self.inner.white_columns(nuisance, effect, values, whiten)

    def white_piece(
        self, nuisance: Floats, effect: Effect, values: Sequence[Values], whiten: Whiten
    ) -> Floats | OfSome | Orthonormal:
        if effect.id == self.more.id:
            return self.white_columns(nuisance, effect, values, whiten)
        return self.inner.white_piece(nuisance, effect, values, whiten)

    def location_errors(self, nuisance: Floats, effects: EffectValues) -> dict[str, float]:
        return self.inner.location_errors(nuisance, self._without(effects))

    def inputs(self, nuisance: Floats, effects: EffectValues) -> Any:
        return self.inner.inputs(nuisance, self._without(effects))

    def extended(
        self, nuisance: Floats, effects: EffectValues, uncertainty: Uncertainty | None = None
    ) -> Any:
        made = self.inner.extended(nuisance, self._without(effects), uncertainty)
        if self.more.id not in effects or not isinstance(made, Estimate):
            return made
        fixed, values = self.source.at_values(effects[self.more.id])
        return replace(
            made,
            effects={**made.effects, fixed: values},
            owners={**made.owners, fixed.id: fixed.owner},
            not_compensable={**made.not_compensable, fixed.id: WHY_NOT},
        )


def model_with(model: Model, source: FormulaEffect) -> Model:
    """Return a model with an effect by a formula among its effects."""
    return cast("Model", _ModelWith(model, source.bound(model.data, model), source))


@dataclass(frozen=True)
class WithTerm:
    """The causes fitted with a term of structure.

    Attributes
    ----------
    found:
        The case with it among the effects, the fit, the effect; None: it is not to be had.
    why_not:
        Why it is not in the extended model, and what to do; empty: it is.
    """

    found: tuple[Case, Fit, FormulaEffect] | None
    why_not: str = ""


def with_structure(
    kept: Case, terms: Sequence[tuple[Term, float]], f: Fit
) -> tuple[Case, Fit, FormulaEffect | None]:
    """Fit the causes with the structure that is left: the case with it among the effects, the fit.

    ``kept``: without the outliers. Beside a model that is not complete structure is stated only,
    and so is structure that the data do not distinguish from the causes: it would take their place
    (a drift by order of measurement, a backlash where the direction turns once), and with which
    readings are predicted worse from others.
    """
    if not terms or kept.dependent:
        return kept, f, None
    tried = _tried(kept, terms[0][0], f)
    if tried.found is None or tried.why_not:
        return kept, f, None
    tried.found[0].given = kept.given  # may be known since
    return tried.found


def structure_beside(case: Case, e: Explanation, bad: Integers) -> tuple[Fit, Floats]:
    """Fit of an explanation with its structure, and the columns of that in all readings (n, k).

    ``bad``: readings that are left out.
    """
    none = e.fit, np.zeros((len(case.model.readings), 0))
    if not e.terms:
        return none
    whole, f, source = with_structure(case.without(bad), e.terms, e.fit)
    if source is None:
        return none
    return f, f.jacobian[:, whole.columns_of(whole.model.effect(source.id), f)]


def why_stated(kept: Case, terms: Sequence[tuple[Term, float]], f: Fit) -> tuple[str, ...]:
    """Say why structure beside a fit is stated only, and what to do; empty: it is fitted."""
    if not terms:
        return ()
    why = INCOMPLETE if kept.dependent else _tried(kept, terms[0][0], f).why_not
    return (f"{NOT_FITTED}: {why}.",) if why else ()


def predicts_worse(kept: Case, terms: Sequence[tuple[Term, float]], f: Fit) -> bool:
    """Whether structure is not fitted beside causes as readings are predicted worse with it."""
    return bool(terms) and not kept.dependent and _tried(kept, terms[0][0], f).why_not == WORSE


def idle_beside(kept: Case, terms: Sequence[tuple[Term, float]], f: Fit, level: float) -> set[str]:
    """Causes of a fit that do nothing once structure is fitted beside them, its period no grid's.

    Also where the data do not distinguish the two: a cause beside which there is structure does not
    explain by itself what the structure does. ``level``: of an effect's chance, from which it might
    as well not be there.
    """
    if not terms or kept.dependent or not f.effects:
        return set()
    tried = _tried(kept, terms[0][0], f)
    if tried.found is None:
        return set()
    whole, found, _ = tried.found
    variance = float(whole.floor.noise(found.rss, found.dof))
    causes = (e for e in kept.effects if e.id in f.effects and not e.expected)
    return {e.id for e in causes if whole.chance(e, found, variance)[0] > level}


def _tried(kept: Case, term: Term, f: Fit) -> WithTerm:
    """Kept by the case, by term and fit."""
    key = term, f
    if key not in kept.structures:
        kept.structures[key] = _with_term(kept, *key)
    return kept.structures[key]


def _with_term(kept: Case, term: Term, f: Fit) -> WithTerm:
    """Fit the causes with a term of structure."""
    source = FormulaEffect.of_term(term, kept.model)
    try:
        source, model, found = _likelier(kept, source, f)
    except DataError:
        return WithTerm(None, UNDETERMINED)
    added = model.effect(source.id)
    if found.rss >= f.rss or found.dof < 1:
        return WithTerm(None, UNDETERMINED)
    whole = replace(kept, model=model)
    before, after = kept.cross_validated(f), whole.cross_validated(found)
    if not better(model, kept.rows, before, after):
        return WithTerm(None, WORSE)
    grown = wider(f, found)[len(f.nuisance) :]
    why = ""
    if np.max(grown, initial=0.0) > DISTINGUISHED:
        at = int(np.argmax(grown))
        times = "not determined" if np.isinf(grown[at]) else f"{grown[at]:.2g} times as wide"
        id_, parameter = f.names[at]
        label = next((e.label for e in model.effects if e.id == id_), "")
        name = f"{parameter_words(parameter)} of {labelled(id_, label)}"
        why = f"beside it the standard error of {name} would be {times}; {ELSEWHERE}"
    said = f"unexplained, {_as_found(term, source, found).sentence()}"
    source, added = replace(source, label=said), replace(added, label=said)
    whole.model = cast("Model", _ModelWith(kept.model, added, source))
    return WithTerm((whole, found, source), why)


def _likelier(kept: Case, source: FormulaEffect, f: Fit) -> tuple[FormulaEffect, Model, Fit]:
    """Fit the causes with a formula: of a wave with what alternates, unless a period shows itself.

    The nearer a period is to two steps of a grid, the less its places show of a sine beside what
    alternates, and the less the fit determines either.
    """
    model, found = _fitted(kept, source, f)
    alternating = source.alternating
    if alternating is None:
        return source, model, found
    model_held, held = _fitted(kept, alternating, f)
    before, after = (kept.floor.deviance(x.rss, held.dof) for x in (held, found))
    if before - after > special.chdtri(2, SCAN_LEVEL):  # of the period and the other amplitude
        return source, model, found
    return alternating, model_held, held


def _fitted(kept: Case, source: FormulaEffect, f: Fit) -> tuple[Model, Fit]:
    """Fit the causes of a fit with a formula beside them."""
    model = model_with(kept.model, source)
    added = model.effect(source.id)
    searched = iter(source.start)
    start = added.values(0.0 if p.linear else next(searched) for p in added.parameters)
    every = [*(kept.model.effect(name) for name in f.effects), added]
    values = {**f.effects, source.id: start}
    return model, fit(model, kept.rows, every, f.nuisance, values, kept.whiten, f.judged)


def placed(e: Explanation, source: FormulaEffect | None, f: Fit) -> Explanation:
    """Return an explanation whose structure, and its share, are those of the fit of its formula."""
    if source is None:
        return e
    (term, _), *others = e.terms
    share = 1.0 - f.rss / e.fit.rss
    return replace(e, terms=[(_as_found(term, source, f), share), *others])


def _as_found(term: Term, source: FormulaEffect, f: Fit) -> Term:
    """Return a term where the fit with its formula has it, between the places of the scan."""
    if term.kind not in ("wave", "local"):
        return term
    at, _ = source.at_values(f.effects[source.id])
    return replace(term, number=at.number if term.kind == "wave" else (at.number, at.width))


def wider(without: Fit, found: Fit) -> Floats:
    """How many times as wide structure makes the standard errors of a fit, shape (p + k,)."""
    before = np.sqrt(np.diag(without.covariance))
    after = np.sqrt(np.diag(found.covariance))[: len(before)]
    known = np.isfinite(before) & (before > 0)
    return np.where(known, after / np.where(known, before, 1.0), 0.0)


def structure_of(
    source: FormulaEffect | None, e: Explanation, case: Case, f: Fit, wide: Fit
) -> Structure | None:
    """Return the record of structure in a fit; ``wide``: with standard errors."""
    if source is None:
        return None
    std = case.std(case.model.effect(source.id), wide, 1.0)
    numbers = f.effects[source.id]
    return Structure(
        source,
        {k: float(v) for k, v in numbers.items()},
        {k: float(s) for k, s in zip(numbers, std, strict=True)},
        e.terms[0][1],
        tuple(term.sentence() for term, _ in e.terms[1:]),
    )
