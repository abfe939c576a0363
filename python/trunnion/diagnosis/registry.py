"""Which model goes with which kind of data: one entry a kind.

Each file in ``trunnion.models`` registers its own::

    register(Touches, build)          # build(data, setup, effects) -> Model
"""

from collections.abc import Callable, Sequence
from typing import Any

from trunnion.diagnosis.engine import diagnose as diagnose_model
from trunnion.diagnosis.protocol import EffectLike, Model
from trunnion.diagnosis.result import Diagnosis
from trunnion.errors import InputError

__all__ = ["diagnose", "model_of", "register"]

Builder = Callable[[Any, Any, Sequence[EffectLike | str]], Model]
_BUILDERS: dict[type, Builder] = {}


def register(kind: type, builder: Builder) -> None:
    """Let :func:`diagnose` take data of this kind.

    ``builder(data, setup, effects)``: the set-up may be None; ``effects`` are further candidates,
    a user's own or ids, which the builder adds to its catalogue.
    """
    _BUILDERS[kind] = builder


def model_of(data: Any, setup: Any = None, effects: Sequence[EffectLike | str] = ()) -> Model:
    """Return the model of a measurement, with its whole catalogue of candidates."""
    for kind in type(data).__mro__:
        if kind in _BUILDERS:
            return _BUILDERS[kind](data, setup, effects)
    if all(hasattr(data, name) for name in ("readings", "nuisance", "effects", "predict")):
        model: Model = data
        return model
    known = ", ".join(sorted(k.__name__ for k in _BUILDERS)) or "none"
    raise InputError(f"data: got {type(data).__name__}, wanted a diagnosis model or one of {known}")


def diagnose(
    data: Any, setup: Any = None, *, effects: Sequence[EffectLike | str] = ()
) -> Diagnosis:
    """Say whether the model of a measurement explains it, and if not, what does.

    Parameters
    ----------
    data:
        Any kind of data that trunnion reads (touches, points, sweep, diameters, axis log, ball-bar
        lengths), or a model of the protocol in :mod:`trunnion.diagnosis.protocol`.
    setup:
        The set-up, where the kind of data needs one.
    effects:
        Further candidates, which compete with the whole catalogue on equal terms: a user's own
        effects (``id``, ``parameters``, ``change(data, values)``), or ids.

    Raises
    ------
    InputError
        No model is known for the data.
    UnknownNameError
        An effect's id is in no catalogue.
    DataError
        The data cannot belong to the model: too few readings, readings off the surface.
    """
    return diagnose_model(model_of(data, setup, effects))
