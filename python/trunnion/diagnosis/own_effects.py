"""A user's own effects: bound to data, checked, and behind the catalogue of a kind."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, runtime_checkable

from numpy.typing import ArrayLike

from trunnion.base.errors import InputError, UnknownNameError
from trunnion.diagnosis.effect import Effect, EffectLike, NamedValues, parameters_of
from trunnion.diagnosis.formula_checks import check_own_name, wrong
from trunnion.machine.effects import Owner, own_call, own_numbers, refuse_class
from trunnion.setup.names import effect_ids

T = TypeVar("T")


@runtime_checkable
class Binding(Protocol):
    """A user's effect that binds itself to data."""

    def bound(self, data: Any, described: Any = None, *, sought: bool = False) -> Effect:
        """Return it bound to data; ``described``: their model; ``sought``: as a candidate."""
        ...


@dataclass(frozen=True, eq=False)
class _Own:
    """A user's effect with the data it is bound to."""

    thing: Any
    data: Any

    def change(self, values: NamedValues) -> ArrayLike:
        found = own_call(self.thing, "change", self.thing.change, self.data, values)
        return own_numbers(self.thing.id, "change", found)

    def jacobian(self, values: NamedValues) -> ArrayLike:
        found = own_call(self.thing, "jacobian", self.thing.jacobian, self.data, values)
        return own_numbers(self.thing.id, "jacobian", found)


def as_effect(thing: EffectLike | Effect, data: Any, described: Any = None) -> Effect:
    """Bind a user's effect to data; an :class:`Effect` is bound already and stays as it is.

    Optional members are used where there are some: ``data``, the name of the class of data that it
    is for, in others of several measurements it does not act; ``jacobian(data, values)``, (n, k);
    ``motion(pose, values)``, without which the effect is diagnosed but not compensated; ``owner``
    ("machine", "instrument", "workpiece", ...); ``label``, what people call it.

    Raises
    ------
    InputError
        A class; an object without ``id``, ``parameters`` or ``change``, without a parameter, or
        with an unknown owner.
    """
    if isinstance(thing, Effect):
        return thing
    refuse_class(thing)
    if isinstance(thing, Binding):
        return thing.bound(data, described, sought=True)
    missing = [n for n in ("id", "parameters", "change") if not hasattr(thing, n)]
    if missing:
        raise InputError(
            f"an effect needs id, parameters and change(data, values); "
            f"{type(thing).__name__} has no {', '.join(missing)}"
        )
    parameters = parameters_of(thing.parameters)
    if not parameters:
        raise InputError(f"effect {thing.id!r}: got no parameter, expected at least one")
    owner = getattr(thing, "owner", Owner.MACHINE)
    try:
        owner = Owner(owner)
    except ValueError:
        known = ", ".join(Owner)
        raise InputError(
            f"effect {thing.id!r}: owner: got {owner!r}, expected one of {known}"
        ) from None
    bound = _Own(thing, data)
    return Effect(
        id=thing.id,
        parameters=parameters,
        change=bound.change,
        jacobian=bound.jacobian if hasattr(thing, "jacobian") else None,
        label=getattr(thing, "label", ""),
        owner=owner,
        motion=getattr(thing, "motion", None),
    )


def acting_in(effects: Sequence[T], data: Any) -> tuple[T, ...]:
    """Leave out effects that are for data of another class, by their ``data`` if they state one."""
    kinds = {base.__name__ for base in type(data).__mro__}
    stated = ((one, getattr(one, "data", None)) for one in effects)
    return tuple(one for one, of in stated if not isinstance(of, str) or of in kinds)


def with_own(
    catalogue: Sequence[Effect],
    effects: Sequence[EffectLike | Effect | str],
    data: Any,
    *,
    known: Iterable[str] = (),
    described: Any = None,
) -> tuple[Effect, ...]:
    """Return the catalogue with a user's own effects behind it, bound to the data.

    Parameters
    ----------
    catalogue
        The kind's own effects; asking for one of these by its id, or by its code of ISO 230-1,
        adds nothing.
    effects
        Own effects and ids.
    known
        Further ids of the kind, of effects for which these data lack a column.
    described
        Model of the data, which an effect by a formula may ask for what it depends on.

    Raises
    ------
    InputError
        No sequence, or an id that is taken: by an effect, an error or a placement.
    UnknownNameError
        An id or code that is not known.
    """
    if isinstance(effects, str):
        raise InputError(
            f"effects: got the text {effects!r}, expected a sequence of ids or effects"
        )
    ids = [e.id for e in catalogue]
    ids += [name for name in known if name not in ids]
    catalogue_ids = frozenset(ids)
    out = list(catalogue)
    for thing in effects:
        if isinstance(thing, str):
            if not effect_ids(thing, ids):
                raise UnknownNameError(
                    f"effect: got {thing!r}, expected one of {', '.join(ids) or 'none'}"
                )
            continue
        made = as_effect(thing, data, described)
        check_own_name(made.id)
        if made.id in ids:
            own = made.id not in catalogue_ids
            whose = "another effect that was given" if own else "the catalogue of these data"
            raise wrong(
                thing,
                "id",
                f"id: got {made.id!r}, which {whose} has too, expected an id of its own"
                + ("" if own else f", such as {'own_' + made.id!r}"),
            )
        ids.append(made.id)
        out.append(made)
    return tuple(out)


def check_own(effect: Effect, readings: int) -> None:
    """Refuse a user's own effect that does not change so many readings.

    Raises DataError: of another shape than (n,), and (n, k) of the derivative.
    """
    if not isinstance(getattr(effect.change, "__self__", None), _Own):
        return
    start = effect.values(p.grid[0] if p.grid else 1.0 for p in effect.parameters)
    own_numbers(effect.id, "change", effect.change(start), (readings,))
    if effect.jacobian is not None:
        shape = (readings, len(effect.parameters))
        own_numbers(effect.id, "jacobian", effect.jacobian(start), shape)
