"""What a diagnosis says, in sentences and tables."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import InputError
from trunnion.base.report import (
    Cell,
    Result,
    Shown,
    Table,
    class_named,
    measured,
    number,
    significant,
)
from trunnion.base.stored import fitting, plain, structured
from trunnion.base.units import unit_of
from trunnion.data.distinct import distinct_rows
from trunnion.data.times import from_first_reading
from trunnion.diagnosis.contributions import (
    Contribution,
    Ladder,
    bias_table,
    contributions_table,
)
from trunnion.diagnosis.formula import FormulaEffect
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.own_effects import acting_in
from trunnion.diagnosis.records import (
    MAX_PARAMETERS,
    WITHOUT_DATA,
    Alternative,
    Cause,
    Gain,
    Residuals,
    Verdict,
    alternatives_table,
    chance,
)
from trunnion.diagnosis.score import score
from trunnion.diagnosis.sentences import MAX_SETS, sentences_of, unit_in
from trunnion.diagnosis.structure import NOT_FITTED, Structure, model_with
from trunnion.files.table import Table as DataTable
from trunnion.machine.budget import Budget, Method
from trunnion.machine.effects import Owner
from trunnion.machine.estimate import Estimate
from trunnion.setup import Setup

UNCERTAINTY = ("std_errors", "names", "covariance", "sigma_um", "degrees_of_freedom", "sources")


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Result):
    """Whether the model explains the data, and if not, what does. See :func:`diagnose`.

    A value: it holds numbers, records, the data and the set-up, never a model of them.

    Attributes
    ----------
    verdict:
        "consistent", "explained" (by named causes, or by outliers alone), "ambiguous" (several
        sets of causes do) or "unexplained" (something is there that no known cause makes).
    causes:
        Strongest first.
    evidence:
        Every set of causes within 6 of the best in penalised -2 ln L, or more than a fifth as
        probable as the likeliest of these, with distance and rms, the named set first; the empty
        set, that nothing acts, is one of them by the same rule.
    gain:
        Residual rms before and after, of the fit and cross-validated.
    unexplained:
        What the residual depends on, or None. Beside causes that leave a fifth of the rms or less
        it does not change the verdict.
    errors_before, errors_after:
        The machine's errors under the plain and the extended model.
    errors_std:
        Standard uncertainties of ``errors_after``, the doubt between the sets of causes included;
        inf: not identifiable.
    outliers:
        Data rows, counted from 0, that belong to no model.
    not_identifiable:
        Errors of the machine and effects that these data do not identify: name → why, or the
        combination that is not. Such errors stay where the fit began.
    p_value:
        Of the data under the plain model, over all tests together.
    sigma:
        Noise of one reading under the extended model, in the unit of `gain`.
    nuisance_before, nuisance_after:
        Values of what is always fitted (errors, placement, a circle, a ball centre).
    units:
        Of these, by name.
    labels:
        What people call an effect, by id.
    model:
        The extended model, in the form its kind of data is used with.
    residuals:
        The readings with what the models leave of them.
    notes:
        What else a reader should know, in sentences.
    mistakes:
        What is likely mistaken about the data or their set-up (a unit, a sense, a place), in
        sentences that are in `notes`, too; first in the summary.
    reservation:
        Why the data may say nothing of the machine, in a sentence; first in the summary.
    too_little:
        That the measurement is too small for its verdict, in a sentence, or None: more than half
        of the causes looked for would stay unnoticed (3.5 standard errors) even at ten times the
        size that is otherwise assumed (50 µm, 50 arcsec, 100 ppm), so that "none acts" would
        mostly be said of causes that these readings cannot show. First in the summary.
    contributions:
        What each named cause explains, and what it had biased, in descending order.
    ladder:
        Residual rms after each cause.
    doubt:
        Of ``errors_std``, what is due to the doubt between the sets of causes.
    rivals:
        Set of causes that moves an error from ``errors_after`` most, by its probability.
    unnoticed:
        Id of an effect that is not named → how much of it can stay unnoticed, and what it would do
        to the location error that it shifts most; first those of which a combination of parameters
        changes no reading, then the worst three of the others, worst first.
    none_probability:
        That no cause of the catalogue acts of a size that the readings would show: noise, or
        structure that none of them makes. Smaller ones may act.
    structure:
        Unexplained structure as it is in the extended model, or None. What a model that is not
        complete leaves (`unexplained` says so) is stated and not part of the model.
    data, setup, candidates:
        What :func:`diagnose` was given; None and () for a model of one's own. JSON keeps of a
        user's own candidates those that are formulas (:class:`FormulaEffect`); of Python code, the
        ids only.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("hidden/setup.toml"))
    >>> d = tn.diagnose(tn.read_touches(tn.sample_path("hidden/touches.csv")), setup)
    >>> d.verdict
    'ambiguous'
    >>> [c.id for c in d.causes]
    ['c_positioning_2', 'drift_z']
    >>> round(d.errors_before["EC0A"], 1), round(d.errors_after["EC0A"], 1)
    (11.6, 17.0)
    """

    verdict: Verdict
    causes: tuple[Cause, ...]
    evidence: tuple[Alternative, ...]
    gain: Gain
    unexplained: str | None
    errors_before: Mapping[str, float]
    errors_after: Mapping[str, float]
    errors_std: Mapping[str, float]
    outliers: tuple[int, ...]
    not_identifiable: Mapping[str, str]
    p_value: float
    sigma: float
    nuisance_before: Mapping[str, float]
    nuisance_after: Mapping[str, float]
    units: Mapping[str, str]
    labels: Mapping[str, str]
    model: Any
    residuals: Residuals | None = None
    notes: tuple[str, ...] = ()
    mistakes: tuple[str, ...] = ()
    reservation: str | None = None
    too_little: str | None = None
    contributions: tuple[Contribution, ...] = ()
    ladder: Ladder | None = None
    none_probability: float = 0.0
    doubt: Mapping[str, float] = field(default_factory=dict)
    rivals: Mapping[str, frozenset[str]] = field(default_factory=dict)
    unnoticed: Mapping[str, str] = field(default_factory=dict)
    structure: Structure | None = None
    data: Any = None
    setup: Any = None
    candidates: tuple[Any, ...] = field(default=(), compare=False)

    # --- what follows from the fields

    @property
    def alternatives(self) -> tuple[frozenset[str], ...]:
        """Ids of every set of `evidence`, the named set first."""
        return tuple(a.causes for a in self.evidence)

    @property
    def named(self) -> frozenset[str]:
        """The ids of the named causes."""
        return frozenset(c.id for c in self.causes)

    @property
    def effects(self) -> dict[str, dict[str, float]]:
        """Parameters of the named causes: id → parameter → value."""
        return {c.id: dict(c.parameters) for c in self.causes}

    @checked
    def draft_effect(self, id: str = "", label: str = "") -> FormulaEffect:  # noqa: A002
        """Return the unexplained structure as an effect: with a formula, in words and as code.

        It can be handed to :func:`diagnose` as a candidate, or written to a file by
        :func:`write_effects`. A smooth function of time is counted from its start, as a drift of
        the catalogue is: errors of the machine are those at the start then.

        Parameters
        ----------
        id, label
            Name for programs and for people; by default what it depends on.

        Raises
        ------
        InputError
            Nothing is left unexplained that depends on a recorded quantity; an id that the
            catalogue of the data has.
        """
        if self.structure is None:
            found = self.unexplained or "nothing is unexplained"
            why = "".join(f" ({n})" for n in self.notes if n.startswith(NOT_FITTED))
            raise InputError(
                f"draft_effect: got {found}, expected structure in the extended model{why}"
            )
        draft = self.structure.effect.from_start_if_in_time
        names = getattr(self.model, "measurements", None)  # of several together
        if names is not None:
            draft = draft.of_one(names, self.data)
        named = draft.named(id or draft.id, label or ("" if id else draft.label))
        if self.data is not None and id:
            kinds = importlib.import_module("trunnion.models.kinds")
            for one in self.data if isinstance(self.data, tuple) else (self.data,):
                if own := acting_in([named], one):
                    kinds.model_of(one, self.setup, own)
        return named

    def rebuilt_model(self) -> Model:
        """Return the model of the data that was diagnosed, made anew: copies of rows left out.

        Raises
        ------
        InputError
            The diagnosis has no data: it is one of a model of one's own, or comes from JSON
            without them.
        """
        if self.data is None:
            raise InputError(f"diagnosis: {WITHOUT_DATA}")
        kinds = importlib.import_module("trunnion.models.kinds")
        used = distinct_rows(self.data).data
        model: Model = kinds.model_of(used, self.setup, self.candidates)
        return model

    @checked
    def score(self, other: Any) -> Gain:
        """Gain on data that the diagnosis has not seen.

        ``other``: data of the same kind, or a model of it. Errors of the machine and effects are
        kept from this diagnosis; what belongs to the set-up or the workpiece is fitted anew.
        Readings that belong to no model are left out. Unexplained structure is kept, too, unless it
        depends on time or order.

        Raises
        ------
        InputError
            The model of the other data lacks an error or an effect of this one.
        """
        if hasattr(other, "predict"):
            model = other
        elif self.data is None:
            raise InputError(
                f"score: got {type(other).__name__}, expected a model of the other data: "
                f"{WITHOUT_DATA}"
            )
        else:
            several = isinstance(other, list | tuple)
            used = [*map(from_first_reading, other)] if several else from_first_reading(other)
            model = self.rebuilt_model().bind(distinct_rows(used).data)
        known = {e.id for e in model.effects}
        owners = self.model.owners if isinstance(self.model, Estimate) else {}
        effects = {
            k: v
            for k, v in self.effects.items()
            if k in known or not owners.get(k, Owner.MACHINE).of_setup
        }
        lasting = self.structure
        if lasting is not None and lasting.effect.owner is not Owner.TIME:
            model = model_with(model, lasting.effect)
            effects[lasting.effect.id] = dict(lasting.parameters)
        return score(model, self.nuisance_before, self.nuisance_after, effects)

    @checked
    def budget(
        self,
        names: Sequence[str] | None = None,
        *,
        tolerances: Mapping[str, float] | None = None,
        method: Method = "linear",
        draws: int = 20_000,
        seed: int = 0,
    ) -> Budget:
        """Uncertainty budget of the machine's errors (None: of all), by the GUM.

        As :meth:`Estimate.budget` of `model`, with the doubt between sets of causes as a source.

        Raises
        ------
        InputError
            The diagnosis is one of a model of one's own, whose extended model is no estimate.
        """
        if self.model is None:  # as JSON has it
            if self.data is None:
                raise InputError(f"budget: {WITHOUT_DATA}")
            lacking = ", ".join(sorted(self.named)) or "the causes"
            raise InputError(
                f"budget: got a diagnosis from JSON with causes that are Python code ({lacking}), "
                "expected ones of the catalogue or of a file of effects: diagnose the data again"
            )
        if not isinstance(self.model, Estimate):
            kind = type(self.model).__name__
            raise InputError(f"budget: got a model of type {kind}, expected an Estimate")
        return self.model.budget(
            names, tolerances=tolerances, method=method, draws=draws, seed=seed
        )

    # --- JSON

    def derived(self) -> dict[str, Any]:
        """Sets of causes and values of the named ones."""
        return {"alternatives": self.alternatives}

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values, ready for JSON (inf as "inf")."""
        data, model = self.data, self.model
        return {
            **super().to_dict(),
            "model": plain(model),
            "data": _described(data),
            "candidates": [getattr(c, "id", c) for c in self.candidates],
            "formulas": [plain(c) for c in self.candidates if isinstance(c, FormulaEffect)],
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Diagnosis:
        """Return the diagnosis that `to_dict` described."""
        if not isinstance(values, Mapping):
            return super().from_dict(values)
        formulas = values.get("formulas", ())  # an older version wrote none
        given = {**values, "candidates": structured(formulas, tuple[FormulaEffect, ...])}
        given["data"] = _data_of(values.get("data"))
        if isinstance(values.get("setup"), Mapping):
            given["setup"] = structured(values["setup"], Setup)
        made = super().from_dict(given)
        with fitting(cls.__name__):
            return replace(made, model=made._model(values.get("model")))

    def _model(self, stored: Any) -> Any:
        """Return `model` from what JSON holds of it; what it does is code, made anew of the data.

        None where there are no data, or a cause is an effect of the user's own.
        """
        if not isinstance(stored, Mapping) or "result" not in stored:
            return stored
        if self.data is None:
            return None
        source = self.rebuilt_model()
        if not self.named <= {effect.id for effect in source.effects}:
            return None
        effects = self.effects
        if self.structure is not None:
            source = model_with(source, self.structure.effect)
            effects[self.structure.effect.id] = dict(self.structure.parameters)
        made = source.extended(np.array(list(self.nuisance_after.values())), effects)
        if not isinstance(made, Estimate):
            return made
        known = Estimate.from_dict({key: stored[key] for key in UNCERTAINTY if key in stored})
        return replace(made, **{key: getattr(known, key) for key in UNCERTAINTY})

    # --- sentences

    def title(self) -> str:
        """Heading of the page."""
        return f"Diagnosis: {self.verdict}"

    def headline(self) -> str:
        """Verdict and ids."""
        named = ", ".join(c.id for c in self.causes[:MAX_SETS])
        out = f"{len(self.outliers)} outliers" if self.outliers else ""
        small = "too little measured" if self.too_little else ""
        return "; ".join(part for part in (self.verdict, small, named, out) if part)

    def sentences(self) -> tuple[str, ...]:
        """Say the verdict first, then what carries it."""
        return sentences_of(self)

    # --- tables

    def table(self) -> Table:
        """Return the estimates: parameters of the causes, errors of the machine."""
        plain = self.verdict == "consistent"
        rows = [] if plain else [row for c in self.causes for row in self._cause_rows(c)]
        for name, after in self.errors_after.items():
            std = self.errors_std.get(name)
            value, error = measured(after, std)
            row: tuple[Cell, ...] = (name, value, error, unit_in(self, name))
            if not plain:
                before = self.errors_before.get(name)
                row = (*row, None if before is None else _shown_like(before, std), None)
            rows.append(row)
        columns = ("", "value", "standard error", "unit")
        return Table.of("Estimates", columns if plain else (*columns, "plain model", "p"), rows)

    def _cause_rows(self, c: Cause) -> Iterable[tuple[Cell, ...]]:
        p = Shown(c.p_value, chance(c.p_value).removeprefix("p ").removeprefix("= "))
        if len(c.parameters) > MAX_PARAMETERS:
            return [(f"{c.id} ({len(c.parameters)} parameters)", None, None, "", None, p)]
        return [
            (f"{c.id}.{name}", *measured(value, c.std_errors[name]), unit_of(name), None, p)
            for name, value in c.parameters.items()
        ]

    def tables(self) -> tuple[Table, ...]:
        """Return estimates, sets of causes, residuals, and what is not identifiable."""
        estimates = self.table()
        tables = [estimates] if estimates.rows else []
        if len(self.evidence) > 1:
            called = {**self.labels, **{c.id: c.label for c in self.causes}}
            tables.append(alternatives_table(self.evidence[: MAX_SETS + 1], called))
        if self.contributions:
            tables.append(contributions_table(self.contributions))
            biases = bias_table(self.contributions, self.errors_std)
            tables += [biases] if biases.rows else []
        tables.append(self._residual_table())
        if self.not_identifiable:
            rows = [(name, why) for name, why in self.not_identifiable.items()]
            tables.append(Table.of("Not identifiable", ("", "why"), rows))
        return tuple(tables)

    def _residual_table(self) -> Table:
        """Return rms before and after; in a consistent diagnosis there is one model only."""
        table = self.gain.table()
        rows = list(table.rows)
        if not self.gain.others:
            noise = ("noise of one reading", None, significant(self.sigma), self.gain.unit)
            rows.append(noise)
        if self.verdict != "consistent":
            return Table.of(table.title, table.columns, rows)
        once = [(name, after, unit) for name, _, after, unit in rows]
        return Table.of(table.title, ("", "model", "unit"), once)


def _described(data: Any) -> Any:
    """Return data, or several, as plain values; None for what is no table."""
    if isinstance(data, tuple) and all(isinstance(one, DataTable) for one in data):
        return [one.described() for one in data]
    return data.described() if isinstance(data, DataTable) else None


def _data_of(values: Any) -> Any:
    """Return the data that `_described` described."""
    if isinstance(values, list):
        return tuple(map(_data_of, values))
    if not isinstance(values, Mapping):
        return values
    return class_named(str(values.get("data")), DataTable).from_description(values)


def _shown_like(value: float, std: float | None) -> Cell:
    """Return a value to the digits of another's standard error."""
    if std is None or std <= 0 or not np.isfinite(std):
        return significant(value, 4)
    return Shown(value, number(value, int(np.clip(1 - np.floor(np.log10(std)), 0, 9))))
