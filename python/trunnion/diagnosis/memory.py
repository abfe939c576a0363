"""Whether the noise of readings in a row has a memory, whatever slow or local structure is in them.

Within a block of some ten readings all that is slow is a cubic. What a block has beside it is
noise, unless something local is in it (a jump, a spike): that is so in a few blocks, and noise has
its memory in all. So blocks are asked one by one whether neighbours err alike, and the middle half
of their answers is what counts.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from trunnion.base.units import Floats, Integers

BLOCK = 32  # readings
DEGREE = 3  # of the polynomial that each may have
CUT = 0.25  # of the answers of blocks, on either side
CUT_MEAN = 1.093  # standard deviation of a mean cut so, over that of a mean, of normal answers


def memory(values: Floats, runs: Sequence[Integers]) -> float:
    """How many σ neighbouring values (n,) of runs are more alike than those of white noise.

    ``runs``: row numbers of consecutive readings. 0 where all are shorter than a block.
    """
    own, alike, expected, spread = _of_white_noise()
    parts = [values[rows[: len(rows) // BLOCK * BLOCK]].reshape(-1, BLOCK) for rows in runs]
    left = np.concatenate(parts) @ own if parts else np.zeros((0, BLOCK))
    size = np.einsum("ij,ij->i", left, left)
    left, size = left[size > 0], size[size > 0]
    if not len(left):
        return 0.0
    answers = np.sort((np.einsum("ij,ij->i", left @ alike, left) / size - expected) / spread)
    cut = int(CUT * len(answers))
    middle = answers[cut : len(answers) - cut]
    return float(middle.mean() * np.sqrt(len(answers))) / CUT_MEAN


@cache
def _of_white_noise() -> tuple[Floats, Floats, float, float]:
    """What takes the polynomial off a block, and the form whose share of a sum of squares counts.

    (BLOCK, BLOCK) each; mean and standard deviation of that share, of white noise.
    """
    place = np.linspace(-1.0, 1.0, BLOCK)
    basis = np.linalg.qr(np.vander(place, DEGREE + 1))[0]
    own = np.eye(BLOCK) - basis @ basis.T
    alike = (np.eye(BLOCK, k=1) + np.eye(BLOCK, k=-1)) / 2
    form, dof = own @ alike, BLOCK - DEGREE - 1
    mean = float(np.trace(form)) / dof
    square = (2 * float(np.trace(form @ form)) + (mean * dof) ** 2) / (dof * (dof + 2))
    return own, alike, mean, float(np.sqrt(square - mean**2))
