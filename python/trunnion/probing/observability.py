"""What a plan can identify, before anything is measured."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import instance, within
from trunnion.base.errors import InputError
from trunnion.base.report import Result, Table
from trunnion.base.statistics import linear_fit
from trunnion.base.units import Floats, unit_of
from trunnion.data.times import begin_and_span_s
from trunnion.data.touches import Touches
from trunnion.files.columns import LARGEST, SMALLEST
from trunnion.machine.effects import PLACEMENT, split_effects
from trunnion.machine.estimate import Combinations, bias_in_words, in_words, named_combination
from trunnion.machine.unnoticed import BesideFit, unnoticed
from trunnion.probing.design import missing_positions
from trunnion.probing.inputs import certificate
from trunnion.probing.model import TouchModel, catalogue, known_sigma_um
from trunnion.probing.steps import as_recorded
from trunnion.setup import Setup

EXACT = 1e-9
"""Share of the largest singular value below which a basis has an exact dependency."""
MIN_SHARE_LEFT = 1e-6
"""An effect of which less is left once the plain model is fitted is not identifiable."""
ALIKE_SHARE = 1e-6
"""Effects are alike if less than this share of one is left after the others are fitted."""
LARGEST_SET = 4


@dataclass(frozen=True, eq=False, repr=False)
class Observability(Result):
    """What a plan can identify.

    Attributes
    ----------
    names
        Parameters of the plain model and of the effects asked for.
    rank
        Of the Jacobian with respect to them.
    condition
        Ratio of the largest to the smallest singular value, columns scaled to unit length; inf
        where the rank is not full.
    singular_values
        Of the scaled Jacobian, largest first.
    noise_um
        Standard deviation of one reading that `std_errors` stand for.
    std_errors
        Expected standard error of every parameter (Cramér-Rao bound); inf where not identifiable.
    combinations
        What the plan does not identify: parameter → component, for each combination that changes
        no reading.
    not_identifiable_effects
        Ids of effects that leave nothing once the plain model is fitted.
    bias
        Id of an effect of which all or a combination of parameters is absorbed → what some of it
        would do to the location error that it shifts most, in words; those that shift none by half
        its standard error are left out.
    unnoticed
        Id of an effect that is not in `bias` → how much of it can stay unnoticed, and what it would
        do to the location error that it shifts most; the worst three of these, worst first.
    alike
        Sets of effects of which each can take the place of the others together: pairs and larger
        sets, smallest first; none contains another.
    missing_columns
        Id → column that the plan lacks for it.
    share_left
        Id → share of the effect's change of the readings that the plain model does not absorb.
    missing_positions
        What would identify the location errors that the plan does not, in words; found by trying.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> seen = tn.observability(tn.plan(setup), setup)
    >>> round(seen.std_errors["EX0C"], 3)  # µm, at 1 µm a reading
    0.236
    """

    names: tuple[str, ...]
    rank: int
    condition: float
    singular_values: Floats
    noise_um: float
    std_errors: dict[str, float]
    combinations: tuple[dict[str, float], ...]
    not_identifiable_effects: tuple[str, ...]
    bias: dict[str, str]
    unnoticed: dict[str, str]
    alike: tuple[frozenset[str], ...]
    missing_columns: dict[str, str]
    share_left: dict[str, float]
    missing_positions: tuple[str, ...] = ()

    @property
    def not_identifiable(self) -> Combinations:
        """Sentences that name the combinations which change no reading."""
        return Combinations(map(in_words, self.combinations))

    def tables(self) -> tuple[Table, ...]:
        """Expected standard errors."""
        rows = [(name, error, unit_of(name)) for name, error in self.std_errors.items()]
        title = f"Expected standard errors at {self.noise_um:g} µm a reading (1 σ)"
        return (Table.of(title, ("", "std. error", "unit"), rows),)

    def sentences(self) -> list[str]:
        """Rank, condition, and what is not identifiable."""
        condition = "inf" if np.isinf(self.condition) else f"{self.condition:.3g}"
        lines = [f"Rank {self.rank} of {len(self.names)}, condition {condition} (columns scaled)."]
        lines.extend(self.not_identifiable)
        lines.extend(self.missing_positions)
        if self.not_identifiable_effects:
            names = ", ".join(self.not_identifiable_effects)
            lines.append(f"Not identifiable beside the location errors and the placement: {names}.")
        lines.extend(f"{k}: {text}." for k, text in {**self.bias, **self.unnoticed}.items())
        groups, sums = self._grouped()
        lines.extend(f"Alike: {', '.join(group)} cannot be distinguished." for group in groups)
        lines.extend(
            f"Dependent: each of {', '.join(members)} is a sum of the others." for members in sums
        )
        if sums and any(set(group) & set(members) for group in groups for members in sums):
            lines.append("In these sums an effect stands for all that are alike with it.")
        lines.extend(
            f"{effect} needs the column {column}, which the plan lacks."
            for effect, column in self.missing_columns.items()
        )
        return lines

    def _grouped(self) -> tuple[list[list[str]], list[list[str]]]:
        """Groups of effects that are alike, and sums with one effect for each group."""
        groups: list[set[str]] = []
        for pair in (set(group) for group in self.alike if len(group) == 2):
            joined = pair.union(*(group for group in groups if group & pair))
            groups = [group for group in groups if not group & pair] + [joined]
        first = {name: min(group) for group in groups for name in group}
        sums = {
            frozenset(first.get(name, name) for name in group)
            for group in self.alike
            if len(group) > 2
        }
        shown = sorted((sorted(members) for members in sums), key=lambda s: (len(s), s))
        return sorted(sorted(group) for group in groups), shown

    def derived(self) -> Mapping[str, Any]:
        """What is not identifiable, in words."""
        return {"not_identifiable": list(self.not_identifiable)}


@checked
def observability(
    plan: Touches,
    setup: Setup,
    effects: Sequence[str] = (),
    *,
    noise_um: float | None = None,
) -> Observability:
    """Say what a plan can identify, before anything is measured.

    Parameters
    ----------
    plan
        A plan, or touches. With `slow_feed_mm_min` in ``[plan]`` they are recorded at that feed.
    setup, effects
        Machine, artefact and probe; ids of effects to estimate together with the location errors
        and the placement. All the others of the catalogue are judged as well.
    noise_um
        Standard deviation of one reading; from the set-up unless given, 1 µm if unknown there.
        Where it is known, what the set-up states of an effect's parameter counts as its prior, as
        in :func:`identify`.

    Raises
    ------
    InputError
        Noise not above 0, an effect that needs a column which the plan lacks.
    DataError
        Several feeds beside `slow_feed_mm_min`, or one that is no faster.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> seen = tn.observability(tn.plan(setup), setup)
    >>> sorted(seen.not_identifiable_effects)[:2]
    ['a_twist', 'artefact_height']
    """
    instance("plan", plan, Touches, "Touches, as plan or read_touches gives them")
    instance("setup", setup, Setup, "a Setup, as read_setup gives it")
    plan = as_recorded(plan, setup)
    sigma = known_sigma_um(setup, plan) or 1.0
    if noise_um is not None:
        sigma = within("noise_um", noise_um, SMALLEST, LARGEST["µm"], "µm")
    ids, own = split_effects(effects)
    if own:
        raise InputError(f"effects: got {own[0].id!r}, expected ids of the catalogue")
    if len(plan) == 0:
        raise InputError("plan: got no touches, expected at least one")
    model = TouchModel(setup, ids)
    _, jacobian = model.core.linearise(model.moves(plan), _reference(model, plan))
    linear = np.array([kind != "moment" for kind in model.kinds]) & model.unknown
    names = tuple(name for name, keep in zip(model.names, linear, strict=True) if keep)
    jacobian = jacobian[:, linear]
    stated = certificate(model) if noise_um or known_sigma_um(setup, plan) else {}
    priors = [sigma / stated[k][1] * (np.array(names) == k) for k in names if k in stated]
    rows = np.vstack([jacobian, *priors])
    found = linear_fit(rows, np.zeros(len(rows)))
    singular = found.singular_values
    missing, columns = _effect_columns(plan, setup)
    plain = jacobian[:, : sum(model.unknown[: len(model.error_names) + len(PLACEMENT)])]
    shares, left = _left_after(plain, columns)
    visible = {name: left[name] for name, share in shares.items() if share > MIN_SHARE_LEFT}
    absorbed = tuple(name for name, share in shares.items() if share <= MIN_SHARE_LEFT)
    bias = _bias(setup, plain, columns, sigma)
    weak = _unnoticed(setup, plain, columns, sigma, bias)
    return Observability(
        names=names,
        rank=found.rank,
        condition=float(singular[0] / singular[-1]) if found.rank == len(names) else float("inf"),
        singular_values=singular,
        noise_um=sigma,
        std_errors=dict(zip(names, map(float, sigma * found.std), strict=True)),
        combinations=tuple(named_combination(names, row) for row in found.combinations),
        not_identifiable_effects=absorbed,
        bias=bias,
        unnoticed=weak,
        alike=dependent_sets(visible),
        missing_columns=missing,
        share_left=shares,
        missing_positions=tuple(missing_positions(plan, setup)),
    )


def _lengths(matrix: Floats) -> Floats:
    lengths: Floats = np.linalg.norm(matrix, axis=0)
    return np.where(lengths > 0, lengths, 1.0)


def _reference(model: TouchModel, plan: Touches) -> Floats:
    """Where the model is linearised: known errors, and nonlinear effects at a plausible place."""
    values = model.values()
    begin, span = begin_and_span_s(plan)
    for index, (name, kind) in enumerate(zip(model.names, model.kinds, strict=True)):
        if kind == "moment":
            values[index] = begin + 0.5 * span
        elif kind == "duration":
            values[index] = span / 180.0 if name.endswith("_min") else span / 3.0
    return values


def _effect_columns(plan: Touches, setup: Setup) -> tuple[dict[str, str], dict[str, Floats]]:
    """Change of the readings per parameter of every effect that the plan has the columns for."""
    has = set(plan.columns)
    entries = catalogue(setup)
    missing = {
        entry.id: next(need for need in entry.needs if need not in has)
        for entry in entries
        if not set(entry.needs) <= has
    }
    ids = [entry.id for entry in entries if entry.id not in missing]
    model = TouchModel(setup, ids)
    _, jacobian = model.core.linearise(model.moves(plan), _reference(model, plan))
    columns: dict[str, Floats] = {}
    for effect in ids:
        own = [
            index
            for index, (name, kind) in enumerate(zip(model.names, model.kinds, strict=True))
            if name.startswith(f"{effect}.") and kind == "linear"
        ]
        columns[effect] = jacobian[:, own]
    return missing, columns


def _left_after(
    plain: Floats, columns: dict[str, Floats]
) -> tuple[dict[str, float], dict[str, Floats]]:
    """Share and part of each effect's columns that the plain model does not absorb."""
    basis, singular, _ = np.linalg.svd(plain / _lengths(plain), full_matrices=False)
    basis = basis[:, singular > EXACT * singular[0]]
    shares, left = {}, {}
    for effect, block in columns.items():
        left[effect] = block - basis @ (basis.T @ block)
        whole = float(np.linalg.norm(block))
        shares[effect] = float(np.linalg.norm(left[effect])) / whole if whole > 0 else 0.0
    return shares, left


def _bias(setup: Setup, plain: Floats, columns: dict[str, Floats], sigma: float) -> dict[str, str]:
    """Say what each effect that is absorbed, or a part of it, would do to a location error."""
    model = TouchModel(setup)
    std = linear_fit(plain, np.zeros(len(plain))).std * sigma
    limits = dict(zip(model.error_names, map(float, std), strict=False))
    said = {}
    for entry in (e for e in catalogue(setup) if e.id in columns):
        linear = [f"{entry.id}.{p.name}" for p in entry.parameters if p.kind == "linear"]
        units = {name: unit_of(name) for name in linear}
        joined = np.hstack([plain, columns[entry.id]])
        rows = linear_fit(joined, np.zeros(len(joined))).combinations
        names = (*model.unknown_names, *units)
        text = bias_in_words((dict(zip(names, r, strict=True)) for r in rows), units, limits)
        if text:
            said[entry.id] = text
    return said


def _unnoticed(
    setup: Setup,
    plain: Floats,
    columns: dict[str, Floats],
    sigma: float,
    without: Collection[str],
) -> dict[str, str]:
    """Say what effects that may be there unnoticed would do to a location error.

    without: Ids of those of which something else is said.
    """
    model = TouchModel(setup)
    found = linear_fit(plain / sigma, np.zeros(len(plain)))
    std = dict(zip(model.error_names, map(float, found.std), strict=False))
    single: dict[str, Floats] = {}
    for entry in (e for e in catalogue(setup) if e.id in columns):
        if all(p.kind == "linear" for p in entry.parameters):
            names = (f"{entry.id}.{p.name}" for p in entry.parameters)
            single |= dict(zip(names, columns[entry.id].T / sigma, strict=True))
    beside = BesideFit.of(plain / sigma, found.cofactor, single)
    return unnoticed(beside, model.unknown_names, std, MIN_SHARE_LEFT, without=without)


def dependent_sets(columns: dict[str, Floats]) -> tuple[frozenset[str], ...]:
    """Smallest sets of effects that depend on each other exactly, up to four together.

    A set depends if its columns have a lower rank than the sum of the ranks of its members and
    every member takes part.
    """
    bases: dict[str, Floats] = {}
    for name, block in _without_rows(columns).items():
        vectors, singular, _ = np.linalg.svd(block, full_matrices=False)
        kept = singular > MIN_SHARE_LEFT * singular[0]
        bases[name] = vectors[:, kept]
    found: list[frozenset[str]] = []
    names = list(bases)
    if not names:
        return ()
    for size in range(2, LARGEST_SET + 1):
        # Only effects whose columns lie in the span of all others can be in any further set.
        for members in combinations(_dependent_at_all(bases, names), size):
            group = frozenset(members)
            if any(smaller <= group for smaller in found):
                continue
            matrix = np.hstack([bases[member] for member in members])
            singular = np.linalg.svd(matrix, compute_uv=False)
            if singular[-1] < ALIKE_SHARE:
                found.append(group)
    return tuple(found)


def _without_rows(columns: dict[str, Floats]) -> dict[str, Floats]:
    """Blocks with the same lengths and angles in as many rows as there are columns."""
    if not columns:
        return {}
    small = np.linalg.qr(np.hstack(list(columns.values())), mode="r")
    ends = np.cumsum([block.shape[1] for block in columns.values()])[:-1]
    return dict(zip(columns, np.split(small, ends, axis=1), strict=True))


def _dependent_at_all(bases: dict[str, Floats], names: list[str]) -> list[str]:
    """Effects that take part in at least one exact dependency among all."""
    matrix = np.hstack([bases[name] for name in names])
    _, singular, directions = np.linalg.svd(matrix, full_matrices=True)
    rank = int(np.sum(singular > ALIKE_SHARE))
    moved = np.linalg.norm(directions[rank:], axis=0)
    owners = np.repeat(np.arange(len(names)), [bases[name].shape[1] for name in names])
    return [
        name for index, name in enumerate(names) if np.any(moved[owners == index] > ALIKE_SHARE)
    ]
