"""Errors of readings predicted from others: each group of readings from all other groups.

Linear in the parameters about a fit. What the other groups do not identify of the nuisance
parameters (the ball centre of a set-up that is left out) is fitted to the group itself; what they
do not identify of an effect stays zero. Time is linear in readings, whatever the count of groups.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from trunnion.base.repeats import Repeats, within_groups
from trunnion.base.statistics import MANY_ROWS, linear_fit
from trunnion.base.units import Flags, Floats, Integers
from trunnion.diagnosis.columns import DEPENDENT
from trunnion.diagnosis.effect import Values
from trunnion.diagnosis.fit import Fit
from trunnion.diagnosis.model import Model
from trunnion.diagnosis.records import units_of
from trunnion.diagnosis.whitening import Correlated, Whiten, correlated, identity

SURE = 0.9  # norm of a group's hat matrix below which the others certainly identify all
MIN_KEPT = 1e-3  # share of a squared direction that the others keep: enough to divide by
MAX_ROWS = 2048  # readings that are worked on at once, unless a group has more
ROUNDING = 1e-12


def cross_validated(model: Model, rows: Integers, f: Fit, whiten: Whiten) -> Floats:
    """Reading less its prediction from all other groups, in the reading's unit, shape (m,)."""
    # neighbours that share errors are left out together
    noise = correlated(whiten)
    groups = np.asarray(model.groups if noise is None else noise.groups)
    labels = groups[rows]
    order = np.argsort(labels, kind="stable")
    ordered = labels[order]
    first = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    start = np.append(first, len(labels)).astype(np.intp)
    problem = _Problem.of(rows, *_in_groups(model, rows, f, whiten))
    errors = np.empty(len(rows))
    for groups in _chunks(start):
        part = order[start[groups[0]] : start[groups[-1] + 1]]
        errors[part], sure = _left_out(problem, part, start[groups] - start[groups[0]])
        for g in groups[~sure]:
            own = order[start[g] : start[g + 1]]
            errors[own] = _own_fit(problem, own)
    return errors


def _in_groups(model: Model, rows: Integers, f: Fit, whiten: Whiten) -> tuple[Fit, Whiten]:
    """Return the fit and its whitener with nothing shared between groups: others predict it."""
    if (noise := correlated(whiten)) is not None:
        if noise.cause in f.effects:
            f = _completed(f, noise)
        basis = np.linalg.qr(f.jacobian[rows] @ f.directions.T)[0]
        return replace(f, basis=np.asarray(basis)), identity
    groups = np.asarray(model.groups)
    if not isinstance(whiten, Repeats) or whiten.within(groups):
        return f, whiten
    apart = whiten.with_labels(within_groups(whiten.label, groups))
    white = np.asarray(apart(f.jacobian))[rows] @ f.directions.T
    return replace(f, basis=np.asarray(np.linalg.qr(white)[0])), apart


def _completed(f: Fit, whiten: Correlated) -> Fit:
    """Return a fit with all that an effect without a name makes, in columns of their own."""
    known = f.jacobian @ f.directions.T
    known = known / np.linalg.norm(known, axis=0)
    beside = whiten.basis - known @ np.linalg.lstsq(known, whiten.basis, rcond=DEPENDENT)[0]
    u, size, _ = np.linalg.svd(beside, full_matrices=False)
    more = u[:, size > DEPENDENT**0.5]
    names = [str(i) for i in range(more.shape[1])]
    return replace(
        f,
        jacobian=np.concatenate([f.jacobian, more], axis=1),
        directions=block_diag(f.directions, np.eye(len(names))),
        names=(*f.names, *(("", name) for name in names)),
        effects={**f.effects, "": Values(dict.fromkeys(names, 0.0))},
    )


def better(model: Model, rows: Integers, plain: Floats, found: Floats) -> bool:
    """Whether errors of a fit's predictions are less than those of the plain one, all units."""
    index = units_of(model.readings)[1][rows]
    before, after = (np.bincount(index, errors**2) for errors in (plain, found))
    known = before > 0
    return bool(np.all(after == before) or np.mean(after[known] / before[known]) < 1)


@dataclass
class _Problem:
    """A linear problem about a fit: the directions of p nuisance parameters, then of effects.

    ``white``, ``raw``: its jacobian, (m, c); ``unit``: combinations of these columns that are the
    directions, of white length 1, (c, r); ``y``: what there is to explain, to first order, effects
    taken out; ``residual``: what the fit to all readings leaves of it; ``basis``: orthonormal, of
    the white directions; ``along``, ``part``: these and y in the basis; ``to_basis``: combinations
    of the columns that are the basis.
    """

    p: int
    white: Floats
    raw: Floats
    unit: Floats
    y: Floats
    y_raw: Floats
    residual: Floats
    residual_raw: Floats
    basis: Floats
    along: Floats
    part: Floats
    to_basis: Floats

    @classmethod
    def of(cls, rows: Integers, f: Fit, whiten: Whiten) -> "_Problem":
        """Of the directions that the fit identifies."""
        effects = [f.effects[i][name] for i, name in f.names]
        own = f.directions.T @ (f.directions[:, len(f.nuisance) :] @ effects)
        some = slice(None) if MANY_ROWS <= len(rows) == len(f.jacobian) else rows
        columns = np.asarray(whiten(f.jacobian))
        raw = f.jacobian[some]
        white = raw if columns is f.jacobian else columns[some]
        y_raw = f.residuals[rows] + raw @ own
        y = np.asarray(whiten(f.residuals))[rows] + white @ own
        part, beside = f.basis.T @ y, (f.basis.T @ white) @ f.directions.T
        scale = np.linalg.norm(beside, axis=0)
        unit, along = f.directions.T / scale, beside / scale
        to_basis = np.asarray(unit @ np.linalg.inv(along), dtype=np.float64)
        residual_raw = y_raw - raw @ (to_basis @ part)
        p = int(np.any(f.directions[:, : len(f.nuisance)], axis=1).sum())
        left = y - f.basis @ part
        return cls(
            p, white, raw, unit, y, y_raw, left, residual_raw, f.basis, along, part, to_basis
        )

    @cached_property
    def gram(self) -> Floats:
        """Inner products of the white directions."""
        return np.asarray(self.along.T @ self.along)

    @cached_property
    def rhs(self) -> Floats:
        """Inner products of the white directions with what there is to explain."""
        return np.asarray(self.along.T @ self.part)

    @cached_property
    def frame(self) -> Floats:
        """Directions of the nuisance that all readings together identify."""
        return _frame(self.gram[: self.p, : self.p])


def _chunks(start: Integers) -> list[Integers]:
    """Numbers of neighbouring groups with not too many readings together."""
    chunk = start[:-1] // MAX_ROWS
    return np.split(np.arange(len(chunk)), np.flatnonzero(np.diff(chunk)) + 1)


def _left_out(problem: _Problem, part: Integers, at: Integers) -> tuple[Floats, Flags]:
    """Misses of groups whose readings the others predict, and of which groups that is sure.

    With q the rows of a group in the basis and e its residuals in the fit to all, the fit to the
    others changes by -(I - q'q)^-1 q'e.
    """
    q = problem.basis[part]
    e = problem.residual[part]
    pull = np.add.reduceat(q * e[:, None], at)
    taken = _squares(q, np.diff(at, append=len(q)), at)
    kept = np.eye(q.shape[1]) - taken
    # No eigenvalue is larger than the norm of all of them.
    sure = np.linalg.norm(taken, axis=(1, 2)) < SURE
    doubtful = np.flatnonzero(~sure)
    if len(doubtful):
        sure[doubtful] = np.linalg.eigvalsh(kept[doubtful])[:, 0] > MIN_KEPT
    kept[~sure] = np.eye(q.shape[1])
    change = np.linalg.solve(kept, pull[:, :, None])[:, :, 0]
    each = np.repeat(change, np.diff(at, append=len(q)), axis=0)
    raw = problem.raw[part] @ problem.to_basis
    return problem.residual_raw[part] + np.einsum("ij,ij->i", raw, each), sure


def _squares(q: Floats, sizes: Integers, at: Integers) -> Floats:
    """Inner products of the columns of each group of rows, (g, k, k): of groups of a size at once.

    ``sizes``: rows of each group (g,); ``at``: its first row (g,).
    """
    out = np.empty((len(at), q.shape[1], q.shape[1]))
    for size in np.unique(sizes).tolist():
        some = sizes == size
        rows = q[at[some][:, None] + np.arange(size)]
        out[some] = rows.transpose(0, 2, 1) @ rows
    return out


def _own_fit(problem: _Problem, part: Integers) -> Floats:
    """Misses of a group of which the others do not identify all."""
    p, frame = problem.p, problem.frame
    a, y = problem.white[part] @ problem.unit, problem.y[part]
    matrix = problem.gram - a.T @ a
    b = problem.rhs - a.T @ y
    inverse, unknown = _pseudo_inverse(frame.T @ matrix[:p, :p] @ frame)
    inverse, unknown = frame @ inverse @ frame.T, frame @ unknown
    cross = matrix[:p, p:]
    effect = _pseudo_inverse(matrix[p:, p:] - cross.T @ inverse @ cross)[0] @ (
        b[p:] - cross.T @ inverse @ b[:p]
    )
    beta = np.concatenate([inverse @ (b[:p] - cross @ effect), effect])
    if unknown.shape[1]:
        beta[:p] += unknown @ linear_fit(a[:, :p] @ unknown, y - a @ beta).solution
    return np.asarray(problem.y_raw[part] - problem.raw[part] @ (problem.unit @ beta))


def _frame(gram: Floats) -> Floats:
    """Directions in which all readings together identify a unit, however weakly.

    What a part of them identifies is then judged by the share that it keeps.
    """
    w, v = np.linalg.eigh(gram)
    some = w > ROUNDING * w.max(initial=0.0)
    return np.asarray(v[:, some] / np.sqrt(w[some]))


def _pseudo_inverse(matrix: Floats) -> tuple[Floats, Floats]:
    """Inverse of a Gram matrix of unit columns where that is possible, and a basis elsewhere."""
    if not matrix.size:
        return matrix, matrix
    w, v = np.linalg.eigh(matrix)
    some = w > DEPENDENT
    return (v[:, some] / w[some]) @ v[:, some].T, v[:, ~some]
