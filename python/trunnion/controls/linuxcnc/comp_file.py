"""COMP_FILE tables of LinuxCNC: positioning errors of single joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.arguments import checked
from trunnion.base.checks import floats
from trunnion.base.errors import InputError

MAX_ROWS = 256


@checked
def comp_file(nominal: ArrayLike, forward: ArrayLike, reverse: ArrayLike) -> str:
    """COMP_FILE of type 0: nominal position, actual position forward and in reverse.

    Parameters
    ----------
    nominal
        Positions of the joint, ascending, mm or degrees, shape (n,); at most 256.
    forward, reverse
        Where the joint really is when it is sent there in the positive and in the negative sense.

    Notes
    -----
    LinuxCNC stops reading at the first line that is not three numbers, so the file has no comments.
    BACKLASH of the joint is ignored while it has a COMP_FILE: the difference of the columns is it.

    Raises
    ------
    InputError
        More rows than LinuxCNC reads, positions that do not ascend, columns of different length.
    """
    columns = [floats("nominal", nominal), floats("forward", forward), floats("reverse", reverse)]
    rows = {column.shape for column in columns}
    if len(rows) != 1 or columns[0].ndim != 1:
        raise InputError(f"COMP_FILE: got columns of shapes {rows}, expected one length")
    if not 2 <= len(columns[0]) <= MAX_ROWS:
        raise InputError(f"COMP_FILE: got {len(columns[0])} rows, expected 2 to {MAX_ROWS}")
    if not np.all(np.diff(columns[0]) > 0):
        raise InputError("COMP_FILE: got positions that do not ascend, expected ascending ones")
    lines = [" ".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"
