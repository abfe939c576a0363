"""What is left of the readings of one of several measurements, before they are diagnosed together.

The causes are found together: of each measurement alone it is asked what noise it has, and whether
readings are to be set aside. Causes taken one after the other, and structure beside them, leave
about the noise that the best set leaves. Where what they leave shows anything else, its own
diagnosis says what that is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import orth

from trunnion.base.resolution import Grid
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import Floats, Integers
from trunnion.diagnosis.alike import Alike
from trunnion.diagnosis.candidates import Candidates
from trunnion.diagnosis.case import Case
from trunnion.diagnosis.effect import Effect, Values
from trunnion.diagnosis.explain import LINEAR_ERROR
from trunnion.diagnosis.explanation import Explanation
from trunnion.diagnosis.fit import Fit, variant_columns
from trunnion.diagnosis.in_steps import as_read
from trunnion.diagnosis.likely_terms import terms_one_by_one
from trunnion.diagnosis.linearised import Linearised
from trunnion.diagnosis.noise import Whitener
from trunnion.diagnosis.outliers import far_out_beside
from trunnion.diagnosis.records import rms
from trunnion.diagnosis.remaining import depends_on, unexplained
from trunnion.diagnosis.result import Diagnosis
from trunnion.diagnosis.scan import Dictionary
from trunnion.diagnosis.selection import one_by_one
from trunnion.diagnosis.steps import weights_of
from trunnion.diagnosis.structure import placed, with_structure
from trunnion.diagnosis.suspects import rested_on
from trunnion.diagnosis.whitening import Whiten, sizes_of

MAX_TERMS = 2  # of structure that is taken as a cause is: of more its own diagnosis is asked
MAX_NONLINEAR = 0.1  # of the rms of the residuals, that is left to the second order


@dataclass(frozen=True, eq=False)
class Left:
    """What is left of the readings: all that is asked of one of several measurements.

    before, after: Reading minus prediction of the plain model and beside causes, (n,).
    rows: Data row of each reading, (n,).
    outliers: Data rows that were set aside, in order.
    parameters: Count of those of the causes.
    unexplained: Structure that no cause makes, in words.
    linearised: The candidates at the plain fit of all readings.
    whiten: What made the noise of all readings white; None: some are left out, or it is not known.
    grid: Steps of all readings, where ``whiten`` is known; None: they have none.
    dictionary: Structure without a name in all readings, if it was looked for there.
    exact: Whether they have no noise.
    assumed: Variance of a white reading that the causes of exact ones were searched with.
    candidates: Count of those that one cause is among beforehand; 0: not known.
    columns: The candidates beside the plain fit, of few readings.
    """

    before: Floats
    after: Floats
    rows: Integers
    outliers: tuple[int, ...]
    parameters: int
    unexplained: str | None
    linearised: Linearised | None = None
    whiten: Whiten | None = None
    grid: Grid | None = None
    dictionary: Dictionary | None = None
    exact: bool = False
    assumed: float = 0.0
    candidates: float = 0.0
    columns: Candidates | None = None

    @classmethod
    def of(cls, found: Diagnosis) -> Left | None:
        """Return that of a diagnosis; None: it has no residuals."""
        r = found.residuals
        if r is None:
            return None
        count = sum(len(c.parameters) for c in found.causes)
        return cls(r.before, r.after, r.rows, found.outliers, count, found.unexplained)


def left_one_by_one(case: Case) -> Left | None:
    """Return what causes leave that are found one after the other; None: that may not do.

    It does where all that they leave is stationary noise, but for one or two terms of structure
    (one that a cause makes leaves the noise that the cause would), and not next to nothing: no
    reading is far out, no cause rests on one, steps of readings do not matter, what the causes
    change is proportional to their sizes, and none makes much of any structure.
    """
    plain, n = case.plain, len(case.rows)
    sizes = sizes_of(case.whiten, n)
    stationary = isinstance(case.whiten, Whitener) and not (case.dependent or case.wandering)
    if (sizes is None and not stationary) or case.exact(plain):
        return None
    causes = one_by_one(case.candidates, plain.white, floor=case.floor)
    if any(case.effects[j].near_any for j in causes.members):
        return None
    basis, white = plain.basis, plain.white
    d = case.dictionary
    columns = [case.candidates.columns(b).T.astype(np.float64) for b in causes.blocks]
    if columns:
        own = orth(np.concatenate(columns, axis=1), rcond=case.candidates.dependent)
        basis = np.concatenate([basis, own], axis=1)
        white = white - own @ (own.T @ white)
    most = 0 if sizes is None else MAX_TERMS
    seen, white, basis = terms_one_by_one(d, white, basis, case.floor, most + 1)
    if len(seen) > most:
        return None
    named = Alike(case, [number for number, _ in seen]).with_a_name()
    unnamed = [(d.term(number), share) for number, share in seen if number not in named]
    rss, dof = float(white @ white), n - basis.shape[1]
    if sizes is None:
        after = _beside(case, causes.blocks)
    else:
        after = plain.residuals - sizes * (plain.white - white)
    if dof < 1 or rss < LINEAR_ERROR**2 * plain.rss or after is None or _in_steps(case, after, dof):
        return None
    if case.model.allows_outliers and (
        len(far_out_beside(basis, white, case.least_noise)) or _rest_on_one(columns, plain, white)
    ):
        return None
    rows = np.asarray(case.model.readings.rows)
    return Left(
        plain.residuals,
        after,
        rows,
        (),
        plain.dof - dof,
        depends_on(unnamed[:1]) if unnamed else None,
        case.linearised,
        case.whiten,
        case.grid,
        case.dictionary,
        candidates=case.candidates.multiplicity,
        columns=_kept(case),
    )


def _kept(case: Case) -> Candidates | None:
    """The candidates of a case, unless they are of many readings."""
    return case.candidates if len(case.rows) < MANY_ROWS else None


def _beside(case: Case, blocks: Sequence[int]) -> Floats | None:
    """What a fit of blocks of candidates leaves of the readings, (n,).

    None: what they change, all simulated together, is not proportional to their sizes.
    """
    plain, model, c = case.plain, case.model, case.candidates
    columns, acting = [plain.jacobian @ plain.directions.T], list[tuple[Effect, Values]]()
    for b in blocks:
        effect, values = case.effects[j := int(c.owner[b])], case.values[j][int(c.variant[b])]
        columns.append(variant_columns(model, effect, plain.nuisance, [values])[0])
        acting.append((effect, values))
    every = np.concatenate(columns, axis=1)
    sizes = np.linalg.lstsq(np.asarray(case.whiten(every)), plain.white, rcond=None)[0]
    left = np.asarray(plain.residuals - every @ sizes)
    moved, own = np.split(sizes, [len(plain.directions)])
    found, rest = dict[str, Values](), iter(own.tolist())
    for effect, values in acting:
        linear = {p.name: next(rest) for p in effect.parameters if p.linear}
        found[effect.id] = Values({**values, **linear})
    exact = model.exact_residuals(plain.nuisance + moved @ plain.directions, found)
    off = rms(exact - left)
    return left if off <= MAX_NONLINEAR * max(rms(left), case.least_rms) else None


def _rest_on_one(causes: Sequence[Floats], plain: Fit, left: Floats) -> bool:
    """Whether one of some causes, of columns (n, k), rests on one reading, which may be a bad one.

    ``left``: what they leave, (n,).
    """
    none = np.zeros((len(left), 0))
    for i, own in enumerate(causes):
        others = np.concatenate([none, *causes[:i], *causes[i + 1 :]], axis=1)
        both = np.concatenate([own, others], axis=1)
        made = own @ np.linalg.lstsq(both, plain.white, rcond=None)[0][: own.shape[1]]
        made = made - others @ np.linalg.lstsq(others, made, rcond=None)[0]
        if rested_on(made, left) is not None:
            return True
    return False


def _in_steps(case: Case, left: Floats, dof: int) -> bool:
    """Whether readings are recorded in steps that matter beside the noise of what is left."""
    if case.grid is None:
        return False
    noise = case.grid.noise(left, dof, case.plain.jacobian, weights_of(case.whiten))
    return case.grid.matters(noise)


def left_of(case: Case, e: Explanation, dropped: Integers) -> Left:
    """Return what an explanation leaves: the same as its report says."""
    kept, model = case.without(dropped), case.model
    named = e.fit if e.sets else kept.plain
    whole, f, source = with_structure(kept, e.terms, named)
    said = unexplained(kept, placed(e, source, f))
    kept = whole
    f = as_read(kept, f)[0]
    rows = np.asarray(model.readings.rows)
    return Left(
        (case.given or as_read(case, case.plain)[0]).residuals,
        f.residuals,
        rows,
        tuple(sorted({int(r) for r in rows[dropped]})),
        sum(len(values) for values in named.effects.values()),
        said,
        case.linearised,
        None if len(dropped) else case.whiten,
        case.grid,
        case.searched_for,
        exact=e.assumed > 0 or kept.exact(f),
        assumed=e.assumed,
        candidates=case.candidates.multiplicity,
        columns=_kept(case),
    )
