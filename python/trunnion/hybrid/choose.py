"""Choice of ball-bar poses by D-optimality."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.arguments import checked
from trunnion.base.checks import whole
from trunnion.base.errors import InputError
from trunnion.base.units import Floats, Integers
from trunnion.data.ballbar import Ballbar
from trunnion.hybrid.identifiability import design
from trunnion.hybrid.mechanism import Mechanism
from trunnion.hybrid.parameters import PAPER_ERRORS, error_names


@checked
def choose_poses(
    candidates: Ballbar,
    mechanism: Mechanism,
    count: int,
    *,
    parameters: Sequence[str] = PAPER_ERRORS,
    sigma_um: float = 0.5,
    tolerance: float = 100.0,
    blocks: ArrayLike | None = None,
    threads: int | None = 1,
) -> Integers:
    """Choose readings by D-optimality: the largest determinant of the errors' information.

    Each reading (or block) is added where the determinant grows most, then exchanged as long as
    that helps. Ball centres are unknown; errors are known to `tolerance` beforehand.

    Parameters
    ----------
    candidates
        Poses to choose from, set-ups labelled.
    mechanism
        The machine around which derivatives are taken.
    count
        How many readings, or blocks, to choose.
    parameters, sigma_um, tolerance
        Errors that matter, noise of a reading, what is known beforehand (µm, arcsec).
    blocks
        Label of the block of each candidate, (n,): chosen as a whole (a circle, a set-up). None:
        every reading is its own.

    Returns
    -------
    ndarray of int
        Rows of `candidates`, in order: ``candidates[rows]`` is the plan.
    """
    names = error_names(parameters)
    label = np.arange(len(candidates)) if blocks is None else np.asarray(blocks)
    if label.shape != (len(candidates),):
        raise InputError(f"blocks: got shape {label.shape}, expected ({len(candidates)},)")
    kinds, block = np.unique(label, return_inverse=True)
    count = whole("count", count, 1, len(kinds))
    matrix, labels = design(candidates, mechanism, names, threads)
    rows = matrix / sigma_um
    # A centre is known to a millimetre before it is measured: next to nothing.
    known = np.concatenate([np.full(len(names), tolerance), np.full(3 * len(labels), 1000.0)])
    members = [np.flatnonzero(block == k) for k in range(len(kinds))]
    chosen = _exchange([rows[m] for m in members], np.diag(1 / known**2), count)
    return np.sort(np.concatenate([members[k] for k in chosen]))


def _exchange(blocks: Sequence[Floats], information: Floats, count: int) -> list[int]:
    """Greedy choice of blocks, then exchanges, for the largest determinant."""
    rows = np.vstack(blocks)
    single = len(rows) == len(blocks)

    def gains(matrix: Floats, among: Sequence[int]) -> Floats:
        """Growth of the logarithm of the determinant by each block on top of a matrix."""
        inverse = np.linalg.inv(matrix)
        if single:
            own = rows[among]
            return np.asarray(np.log1p(np.sum((own @ inverse) * own, axis=1)))
        inner = [np.eye(len(blocks[k])) + blocks[k] @ inverse @ blocks[k].T for k in among]
        return np.array([np.linalg.slogdet(m)[1] for m in inner])

    free = list(range(len(blocks)))
    chosen: list[int] = []
    current = information.copy()
    for _ in range(count):
        best = free.pop(int(np.argmax(gains(current, free))))
        chosen.append(best)
        current += blocks[best].T @ blocks[best]
    for _ in range(3):
        better = False
        for place, old in enumerate(chosen if free else ()):
            without = current - blocks[old].T @ blocks[old]
            own, *others = gains(without, [old, *free])
            at = int(np.argmax(others))
            if others[at] > own + 1e-9:
                best = free[at]
                chosen[place], free[at] = best, old
                current = without + blocks[best].T @ blocks[best]
                better = True
        if not better:
            break
    return chosen
