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

BLOCK, LEAST_BLOCK = 32, 16  # readings; of shorter runs
DEGREE = 3  # of the polynomial that each may have
CUT = 0.25  # of the answers of blocks, on either side
CUT_MEAN = 1.093  # standard deviation of a mean cut so, over that of a mean, of normal answers


def memory(values: Floats, runs: Sequence[Integers], together: int = 1) -> float:
    """How many σ neighbouring values (n,) of runs are more alike than those of white noise.

    ``runs``: row numbers of consecutive readings. 0 where all are too short for a block.
    ``together``: readings of which the mean is one value: a slow noise below white noise shows.
    """
    answers = []
    for rows in runs:
        count = len(rows) // together
        means = values[rows[: count * together]].reshape(count, together).mean(axis=1)
        if (block := min(count, BLOCK)) >= LEAST_BLOCK:
            answers.append(_answers(means[: count // block * block].reshape(-1, block)))
    every = np.sort(np.concatenate(answers)) if answers else np.zeros(0)
    if not len(every):
        return 0.0
    cut = int(CUT * len(every))
    middle = every[cut : len(every) - cut]
    return float(middle.mean() * np.sqrt(len(every))) / CUT_MEAN


def _answers(blocks: Floats) -> Floats:
    """By how many σ neighbours in blocks (b, block) are alike; none of what is a polynomial."""
    own, alike, expected, spread = _of_white_noise(blocks.shape[1])
    left = blocks @ own
    size = np.einsum("ij,ij->i", left, left)
    left, size = left[size > 0], size[size > 0]
    return np.asarray((np.einsum("ij,ij->i", left @ alike, left) / size - expected) / spread)


@cache
def _of_white_noise(block: int) -> tuple[Floats, Floats, float, float]:
    """What takes the polynomial off a block, and the form whose share of a sum of squares counts.

    (block, block) each; mean and standard deviation of that share, of white noise.
    """
    place = np.linspace(-1.0, 1.0, block)
    basis = np.linalg.qr(np.vander(place, DEGREE + 1))[0]
    own = np.eye(block) - basis @ basis.T
    alike = (np.eye(block, k=1) + np.eye(block, k=-1)) / 2
    form, dof = own @ alike, block - DEGREE - 1
    mean = float(np.trace(form)) / dof
    square = (2 * float(np.trace(form @ form)) + (mean * dof) ** 2) / (dof * (dof + 2))
    return own, alike, mean, float(np.sqrt(square - mean**2))
