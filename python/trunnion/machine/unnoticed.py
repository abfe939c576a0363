"""Effects too small to be noticed that shift an error of the machine all the same."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class BesideFit:
    """What a fit makes of effects that are not in it, of one parameter after the other.

    Attributes
    ----------
    parameters
        "id.name" of each (m,).
    along
        What the fitted parameters take of it, (m, p).
    left, whole
        Length of its derivative beside the fit, and of all of it, over the noise, (m,).
    """

    parameters: tuple[str, ...]
    along: Floats
    left: Floats
    whole: Floats

    @classmethod
    def of(cls, jacobian: Floats, cofactor: Floats, columns: Mapping[str, Floats]) -> BesideFit:
        """Return that of a fit.

        Parameters
        ----------
        jacobian, cofactor
            Derivative of the readings by what is fitted, over their noise, shape (n, p), and the
            covariance of a fit, shape (p, p).
        columns
            Parameter of an effect ("id.name") → derivative of the readings by it, over their noise.
            They are asked for in order, a few at a time.
        """
        gram, names = jacobian.T @ jacobian, list(columns)
        along, left, whole = [np.zeros((0, len(gram)))], [np.zeros(0)], [np.zeros(0)]
        for first in range(0, len(names), AT_ONCE):
            x = np.stack([columns[name] for name in names[first : first + AT_ONCE]])
            acting = np.flatnonzero(x.any(axis=0))  # of one of several measurements: few
            some = slice(acting[0], acting[-1] + 1) if len(acting) else slice(0)
            x = x[:, some]
            products = x @ jacobian[some]
            own = products @ cofactor.T
            square = np.einsum("ij,ij->i", x, x)
            rest = square + np.einsum("ij,ij->i", own @ gram - 2.0 * products, own)
            along.append(own)
            left.append(np.sqrt(np.maximum(rest, 0.0)))
            whole.append(np.sqrt(np.maximum(square, 0.0)))
        parts = along, left, whole
        return cls(tuple(names), *(np.concatenate(part) for part in parts))


def unnoticed(
    beside: BesideFit,
    names: Sequence[str],
    std: Mapping[str, float],
    absorbed: float,
    noticed: float = NOTICED,
    without: Collection[str] = (),
) -> dict[str, str]:
    """Say what effects of a plausible size that stay unnoticed would do, the worst ones first.

    Parameters
    ----------
    beside
        The effects beside a fit.
    names
        Of what is fitted (p,).
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
    assumed = [ASSUMED_SIZE.get(unit_of(parameter), 1.0) for parameter in beside.parameters]
    sizes = np.minimum(noticed / np.maximum(beside.left, TINY), assumed)
    ratio = np.abs(beside.along[:, known]) * sizes[:, None] / least
    most = np.max(ratio, axis=1)
    shown = (beside.left > absorbed * beside.whole) & (most > MORE * MIN_SHIFT)
    for i in np.flatnonzero(shown).tolist():
        effect, name = beside.parameters[i].split(".", 1)
        if effect not in without and most[i] > MORE * found.get(effect, (MIN_SHIFT,))[0]:
            size = float(sizes[i])
            shifts = {names[k]: float(beside.along[i, k]) * size for k in known}
            ratios = dict(zip(shifts, ratio[i].tolist(), strict=True))
            found[effect] = float(most[i]), name, size, shifts_in_words(shifts, ratios, 2)
    out = {}
    # those that shift as much are in the order of the catalogue, not of rounding
    for effect in sorted(found, key=lambda k: -float(f"{found[k][0]:.6g}"))[:MAX_STATED]:
        _, name, size, moved = found[effect]
        what = "it" if sum(k.startswith(f"{effect}.") for k in beside.parameters) == 1 else name
        amount = f"{size:.2g} {unit_of(name)} of {what}"
        out[effect] = f"{amount} can stay unnoticed and would shift {moved}"
    return out


def noticed_with(dof: float) -> float:
    """Return `NOTICED` of a noise that so many degrees of freedom say: Student's for a normal."""
    if dof <= 0:
        return np.inf
    return -float(special.stdtrit(dof, float(special.ndtr(-NOTICED))))


def unnoticed_if_large(beside: BesideFit, absorbed: float, noticed: float) -> tuple[str, ...]:
    """Return the effects that would stay unnoticed even if they were large.

    Arguments as of :func:`unnoticed`. None of the parameters of such an effect is noticed at
    :data:`LARGE` times its assumed size.
    """
    seen: dict[str, bool] = {}
    largest = np.array([large(unit_of(parameter)) for parameter in beside.parameters])
    shown = (beside.left > absorbed * beside.whole) & (beside.left * largest >= noticed)
    for parameter, one in zip(beside.parameters, shown.tolist(), strict=True):
        effect = parameter.split(".", 1)[0]
        seen[effect] = one or seen.get(effect, False)
    return tuple(effect for effect, noticed in seen.items() if not noticed)


def large(unit: str) -> float:
    """Return the size at which an effect of this unit is large."""
    return LARGE * ASSUMED_SIZE.get(unit, 1.0)
