"""What models of measured coordinates share: effects from columns, and a user's own effects."""

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from trunnion.base.errors import InputError, UnknownNameError
from trunnion.diagnosis.protocol import Array, Effect, EffectLike, EffectScope, Parameter, as_effect
from trunnion.machine.effects import Owner

__all__ = ["effect_of_columns", "for_compensation", "own_effects", "periodic_effect"]

Columns = Callable[[Any], Array]


def effect_of_columns(
    id_: str,
    parameters: Sequence[str | Parameter],
    columns: Columns,
    words: str,
    scope: EffectScope = "machine",
) -> Effect:
    """Make an effect that is linear in all its parameters.

    ``columns(data)``: change of the readings per unit of each parameter, shape (n, k).
    """
    full = tuple(p if isinstance(p, Parameter) else Parameter(p) for p in parameters)
    names = tuple(p.name for p in full)
    return Effect(
        id_,
        full,
        partial(_linear_change, columns, names),
        partial(_linear_jacobian, columns),
        scope,
        words=words,
    )


def _linear_change(
    columns: Columns, names: tuple[str, ...], data: Any, values: Mapping[str, float]
) -> Array:
    return np.asarray(columns(data) @ np.array([values[name] for name in names]))


def _linear_jacobian(columns: Columns, data: Any, values: Mapping[str, float]) -> Array:  # noqa: ARG001
    return columns(data)


def periodic_effect(
    id_: str,
    period: Parameter,
    where: Columns,
    enters: Columns,
    words: str,
    unit: str = "um",
) -> Effect:
    """Make ``a cos(2π s / period) + b sin(2π s / period)``, the period found by profiling.

    ``where(data)``: s, shape (n,), in the unit of the period; ``enters(data)``: change of each
    reading per unit of the wave, shape (n,).
    """
    names = (f"a_{unit}", f"b_{unit}", period.name)
    parameters = (Parameter(names[0]), Parameter(names[1]), period)
    jacobian = partial(_wave_jacobian, names, where, enters)
    return Effect(id_, parameters, partial(_wave_change, names, jacobian), jacobian, words=words)


def _wave_jacobian(
    names: tuple[str, ...],
    where: Columns,
    enters: Columns,
    data: Any,
    values: Mapping[str, float],
) -> Array:
    a, b, period = (values[name] for name in names)
    s, size = where(data), enters(data)
    turn = 2 * np.pi * s / period
    cos, sin = size * np.cos(turn), size * np.sin(turn)
    return np.stack([cos, sin, (a * sin - b * cos) * turn / period], axis=1)


def _wave_change(
    names: tuple[str, ...],
    jacobian: Callable[[Any, Mapping[str, float]], Array],
    data: Any,
    values: Mapping[str, float],
) -> Array:
    size = np.array([values[name] for name in names[:2]])
    return np.asarray(jacobian(data, values)[:, :2] @ size)


def for_compensation(
    effects: Iterable[Effect], found: Container[str], catalogued: Container[str], why_not: str
) -> dict[str, Any]:
    """How effects that were found act on the machine, as fields of an estimate.

    Parameters
    ----------
    effects
        All candidates.
    found
        Ids of those that were found.
    catalogued
        Ids that are in the machine's catalogue under the same name and with the same parameters.
    why_not
        Why an effect of the machine that has no ``motion`` cannot be compensated.
    """
    motions, not_compensable, owners = {}, {}, {}
    whose = {"instrument": "it belongs to the instrument", "workpiece": "it belongs to the part"}
    for e in effects:
        if e.id not in found:
            continue
        owners[e.id] = Owner(e.scope)
        if e.motion is not None:
            motions[e.id] = e.motion
        elif e.id not in catalogued or e.scope != "machine":
            not_compensable[e.id] = whose.get(e.scope, why_not)
    return {"motions": motions, "not_compensable": not_compensable, "owners": owners}


def own_effects(effects: Sequence[EffectLike | str], known: Sequence[str]) -> tuple[Effect, ...]:
    """Complete a user's own effects; ids that are in the catalogue already add nothing."""
    if isinstance(effects, str):
        raise InputError(f"effects: got the text {effects!r}, wanted a sequence of ids or effects")
    own: list[Effect] = []
    for e in effects:
        if isinstance(e, str):
            if e not in known:
                raise UnknownNameError(f"effect: got {e!r}, wanted one of {', '.join(known)}")
            continue
        made = as_effect(e)
        if made.id in known or any(made.id == o.id for o in own):
            raise InputError(f"effect: got {made.id!r} twice, wanted a name of its own")
        own.append(made)
    return tuple(own)
