"""Effects as everything else sees them: whose they are, a user's own, how they move the machine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

from trunnion.base.errors import DataError, InputError, TrunnionError
from trunnion.base.units import Floats

PLACEMENT = ("dx_um", "dy_um", "dz_um", "ra_arcsec", "rb_arcsec", "rc_arcsec")
"""Placement of the artefact on the table: T_S = translate(dx, dy, dz) R(ra, rb, rc)."""


class Owner(StrEnum):
    """What a parameter belongs to, and with it what can be done about it.

    Of the machine: it moves the tool relative to the work and can be compensated. Instruments
    (probe, ball-bar, tracker) and artefacts change what is read. A workpiece and a placement are
    of one set-up and are estimated again in the next. Time: what changes slowly.
    """

    MACHINE = "machine"
    INSTRUMENT = "instrument"
    ARTEFACT = "artefact"
    WORKPIECE = "workpiece"
    PLACEMENT = "placement"
    TIME = "time"

    @classmethod
    def _missing_(cls, value: object) -> Owner | None:
        """A touch probe is an instrument."""
        return cls.INSTRUMENT if value == "probe" else None

    @property
    def of_setup(self) -> bool:
        """Whether it belongs to one set-up: estimated again on other data; others are kept."""
        return self in (Owner.WORKPIECE, Owner.PLACEMENT)


@runtime_checkable
class UserEffect(Protocol):
    """An effect of the user's own, accepted wherever the id of a built-in effect is.

    Optional members: ``jacobian(data, values)``, the derivative of ``change``, shape (n, k);
    ``motion(pose, values)``, without which it is estimated but not compensated; ``owner``, of
    :class:`Owner`; ``label``, what people call it.

    Examples
    --------
    >>> import trunnion as tn
    >>> import numpy as np
    >>> class Sun:
    ...     id = "sun"
    ...     parameters = ("b_um",)
    ...     def change(self, data, values):
    ...         return values["b_um"] * (np.arange(len(data)) >= 40)
    ...
    >>> setup = tn.read_setup(tn.sample_path("cross/setup.toml"))
    >>> touches = tn.read_touches(tn.sample_path("cross/touches.csv"))
    >>> round(tn.identify(touches, setup, effects=[Sun()]).effects["sun"]["b_um"], 1)
    -0.0
    """

    @property
    def id(self) -> str:
        """Its name."""
        ...

    @property
    def parameters(self) -> Sequence[Any]:
        """Names with their units; a diagnosis takes a ``Parameter`` where one is not linear."""
        ...

    # Any: a user's class may name narrower types than Touches and Mapping[str, float].
    def change(self, data: Any, values: Any) -> Any:
        """Change of each reading of `data` in the unit of the reading, shape (n,)."""
        ...


Effect: TypeAlias = str | UserEffect


@dataclass(frozen=True)
class ParameterInfo:
    """A parameter of an effect: name with unit, unit, and how it is found.

    `kind` is "linear" (least squares) or "searched" (on a grid, then refined); in the model of
    touches "moment" (searched between touches) or "duration" (searched over decades).
    """

    name: str
    unit: str
    kind: str


@dataclass(frozen=True)
class EffectInfo:
    """An entry of a catalogue of effects.

    Attributes
    ----------
    id, label
        Name for programs and for people.
    owner
        What it belongs to; those of the machine can be compensated.
    parameters
        Its parameters in order.
    needs
        Columns of the data without which the effect is not looked for.
    codes
        Codes of ISO 230-1 of the errors that it is part of; accepted in the place of the id.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> effect = tn.catalogue(setup)[0]
    >>> effect.id, effect.label
    ('probe_radius', 'ball radius of the probe')
    """

    id: str
    label: str
    owner: Owner
    parameters: tuple[ParameterInfo, ...]
    needs: tuple[str, ...]
    codes: tuple[str, ...] = ()


@dataclass(frozen=True)
class MotionPose:
    """Where an effect is asked for its motion.

    `position_mm` is the commanded position of the linear axes, shape (n, 3); `rotary_deg` maps the
    letter of each rotary axis to its positions in the control's sign, shape (n,).
    """

    position_mm: Floats
    rotary_deg: Mapping[str, Floats]


Motion: TypeAlias = Callable[[MotionPose, Mapping[str, float]], Any]
"""Displacement of the tool relative to the work, machine frame, µm, shape (n, 3)."""


@dataclass(frozen=True)
class Together:
    """Motion of several effects that have the same values."""

    motions: tuple[Motion, ...]

    def __call__(self, pose: MotionPose, values: Mapping[str, float]) -> Any:
        """Sum of their displacements, µm, shape (n, 3)."""
        return sum(motion(pose, values) for motion in self.motions)


@runtime_checkable
class Moving(Protocol):
    """A user's effect that moves the machine."""

    @property
    def id(self) -> str:
        """Its name."""
        ...

    def motion(self, pose: MotionPose, values: Mapping[str, float]) -> Floats:
        """Displacement of the tool relative to the work, machine frame, µm, shape (n, 3)."""
        ...


def effect_id(effect: Effect) -> str:
    """Id of an effect that is given by its id or as an object."""
    return effect if isinstance(effect, str) else effect.id


def refuse_class(thing: Any) -> None:
    """Refuse a class in place of an effect."""
    if isinstance(thing, type):
        name = f"{thing.__module__}.{thing.__qualname__}"
        raise InputError(
            f"effect: got the class {name}, expected an object of it: {thing.__name__}()"
        )


def own_call(effect: Any, what: str, function: Callable[..., Any], *given: Any) -> Any:
    """Return what the code of an effect of the user's own returns.

    Raises InputError: it raises; names the effect, and the file and line of the user's code. Errors
        of the package's own go through as they are.
    """
    try:
        return function(*given)
    except TrunnionError:
        raise
    except Exception as error:  # the user's code
        inner = None if error.__traceback__ is None else error.__traceback__.tb_next
        where = "" if inner is None else f", {inner.tb_frame.f_code.co_filename}:{inner.tb_lineno}"
        name = f"{type(effect).__module__}.{type(effect).__qualname__}"
        raise InputError(
            f"effect {effect.id!r}: {what} of {name} raised {type(error).__name__}: {error}{where}"
        ) from error


def own_numbers(id_: str, what: str, found: Any, shape: tuple[int, ...] | None = None) -> Floats:
    """Return what an effect of the user's own gave, as finite numbers of a shape if one is stated.

    Raises DataError: of something else.
    """
    expected = "finite numbers" + ("" if shape is None else f" of shape {shape}")
    try:
        given = np.asarray(found)
        out = given.astype(np.float64, casting="safe" if given.dtype.kind == "c" else "unsafe")
    except (TypeError, ValueError):
        got = f"{found!r:.60}"
        raise DataError(f"effect {id_!r}: {what} gave {got}, expected {expected}") from None
    if shape is not None and out.shape != shape:
        raise DataError(f"effect {id_!r}: {what} gave shape {out.shape}, expected {expected}")
    if not np.all(np.isfinite(out)):
        first = out[~np.isfinite(out)][0]
        raise DataError(f"effect {id_!r}: {what} gave {first}, expected {expected}")
    return out


def split_effects(effects: Iterable[Effect]) -> tuple[list[str], list[UserEffect]]:
    """Built-in ids and the user's own effects, each checked.

    Raises InputError: if something is neither an id nor an effect, or an id stands twice.
    """
    if isinstance(effects, str):
        raise InputError(
            f"effects: got the text {effects!r}, expected a sequence of ids or effects"
        )
    ids: list[str] = []
    own: list[UserEffect] = []
    for effect in effects:
        refuse_class(effect)
        if isinstance(effect, str):
            ids.append(effect)
        elif isinstance(effect, UserEffect):
            own.append(effect)
        else:
            raise InputError(
                f"effect: got {effect!r}, expected an id of the catalogue or an object with id, "
                "parameters and change(data, values)"
            )
    names = [*ids, *(effect.id for effect in own)]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"effects: got {name!r} twice, expected each once")
    return ids, own


def senses(place: Floats) -> Floats:
    """Sense of the last move before each row, by the order of rows: +1, -1, 0 before the first."""
    step = np.concatenate([[0.0], np.sign(np.diff(place))])
    last = np.maximum.accumulate(np.where(step != 0, np.arange(len(step)), 0))
    return np.asarray(step[last])
