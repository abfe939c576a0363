"""Effects too small to be noticed that shift an error of the machine all the same."""

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
from scipy import special

from trunnion.base.units import Floats, unit_of
from trunnion.machine.estimate import ASSUMED_SIZE, ROUNDING, shifts_in_words

NOTICED = 3.5
"""Standard errors of an effect with which it is missed in about one case of three, known noise."""
MIN_SHIFT = 1.0  # standard errors of a location error; a smaller shift of it is not mentioned
MAX_STATED = 3
MORE = 1.0 + 1e-9  # of two parameters that shift as much, the first is named
AT_ONCE = 16  # columns
TINY = 1e-300
LARGE = 10.0
"""Assumed sizes of a large effect; effects of one such size many a good measurement misses."""


def unnoticed(
    jacobian: Floats,
    cofactor: Floats,
    names: Sequence[str],
    columns: Mapping[str, Floats],
    std: Mapping[str, float],
    absorbed: float,
    noticed: float = NOTICED,
    without: Collection[str] = (),
) -> dict[str, str]:
    """Say what effects of a plausible size that stay unnoticed would do, the worst ones first.

    Parameters
    ----------
    jacobian, cofactor
        Derivative of the readings by what is fitted, over their noise, shape (n, p), and the
        covariance of a fit, shape (p, p).
    names
        Of what is fitted (p,).
    columns
        Parameter of an effect ("id.name") → derivative of the readings by it, over their noise.
    std
        Standard errors of the location errors.
    absorbed
        Share of an effect up to which what is left of it beside the fit counts as nothing.
    noticed
        Standard errors from which an effect is noticed (:func:`noticed_with`).
    without
        Ids of effects of which something else is said.

    Returns
    -------
    dict
        Id → ``2.1 µm/h of it can stay unnoticed and would shift EZ0A by +0.6 µm``.
    """
    known = [i for i, error in enumerate(names) if np.isfinite(std.get(error, np.inf))]
    if not known:
        return {}
    least = np.array([max(std[names[i]], ROUNDING) for i in known])
    found: dict[str, tuple[float, str, float, str]] = {}
    for some, along, left, whole in _beside(jacobian, cofactor, columns):
        assumed = [ASSUMED_SIZE.get(unit_of(parameter), 1.0) for parameter in some]
        sizes = np.minimum(noticed / np.maximum(left, TINY), assumed)
        ratio = np.abs(along[:, known]) * sizes[:, None] / least
        most = np.max(ratio, axis=1)
        for i in np.flatnonzero((left > absorbed * whole) & (most > MORE * MIN_SHIFT)).tolist():
            effect, name = some[i].split(".", 1)
            if effect not in without and most[i] > MORE * found.get(effect, (MIN_SHIFT,))[0]:
                size = float(sizes[i])
                shifts = {names[k]: float(along[i, k]) * size for k in known}
                moved = shifts_in_words(
                    shifts, dict(zip(shifts, ratio[i].tolist(), strict=True)), 2
                )
                found[effect] = float(most[i]), name, size, moved
    out = {}
    for effect in sorted(found, key=lambda k: -found[k][0])[:MAX_STATED]:
        _, name, size, moved = found[effect]
        what = "it" if sum(k.startswith(f"{effect}.") for k in columns) == 1 else name
        amount = f"{size:.2g} {unit_of(name)} of {what}"
        out[effect] = f"{amount} can stay unnoticed and would shift {moved}"
    return out


def noticed_with(dof: float) -> float:
    """Return `NOTICED` of a noise that so many degrees of freedom say: Student's for a normal."""
    if dof <= 0:
        return np.inf
    return -float(special.stdtrit(dof, float(special.ndtr(-NOTICED))))


def unnoticed_if_large(
    jacobian: Floats,
    cofactor: Floats,
    columns: Mapping[str, Floats],
    absorbed: float,
    noticed: float,
) -> tuple[str, ...]:
    """Return the effects that would stay unnoticed even if they were large.

    Arguments as of :func:`unnoticed`. None of the parameters of such an effect is noticed at
    :data:`LARGE` times its assumed size.
    """
    seen: dict[str, bool] = {}
    for some, _, left, whole in _beside(jacobian, cofactor, columns):
        largest = np.array([large(unit_of(parameter)) for parameter in some])
        shown = (left > absorbed * whole) & (left * largest >= noticed)
        for parameter, one in zip(some, shown.tolist(), strict=True):
            effect = parameter.split(".", 1)[0]
            seen[effect] = one or seen.get(effect, False)
    return tuple(effect for effect, noticed in seen.items() if not noticed)


def large(unit: str) -> float:
    """Return the size at which an effect of this unit is large."""
    return LARGE * ASSUMED_SIZE.get(unit, 1.0)


def _beside(
    jacobian: Floats, cofactor: Floats, columns: Mapping[str, Floats]
) -> Iterator[tuple[list[str], Floats, Floats, Floats]]:
    """Some columns' names, what the fit makes of each (m, p), lengths of what is left, of all."""
    gram, names = jacobian.T @ jacobian, list(columns)
    for first in range(0, len(names), AT_ONCE):
        some = names[first : first + AT_ONCE]
        x = np.stack([columns[name] for name in some])
        products = x @ jacobian
        along = products @ cofactor.T
        whole = np.einsum("ij,ij->i", x, x)
        left = whole + np.einsum("ij,ij->i", along @ gram - 2.0 * products, along)
        yield some, along, np.sqrt(np.maximum(left, 0.0)), np.sqrt(np.maximum(whole, 0.0))
