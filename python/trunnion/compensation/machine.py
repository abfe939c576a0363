"""The machine with its errors, as the core wants it, and the axes of its grids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

import trunnion._core as _core
from trunnion.base.checks import instance
from trunnion.base.errors import DataError, InputError, UnknownNameError
from trunnion.probing.model import PLACEMENT, Effect, UserEffect, split_effects
from trunnion.setup import Setup
from trunnion.setup.names import canonical_error_name

__all__ = ["Floats", "MachineErrors", "MotionPose", "axis_nodes", "chain_letters", "rotary_nodes"]

Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class MotionPose:
    """Where a user's own effect is asked for its motion.

    `position_mm` is the position of the linear axes that the control believes to have, shape
    (n, 3); `rotary_deg` maps the letter of each rotary axis to its positions, shape (n,).
    """

    position_mm: Floats
    rotary_deg: Mapping[str, Floats]


@runtime_checkable
class Moving(Protocol):
    """A user's effect that moves the machine."""

    def motion(self, pose: MotionPose, values: Mapping[str, float]) -> Floats:
        """Displacement of the tool relative to the work, machine frame, µm, shape (n, 3)."""
        ...


@dataclass(frozen=True)
class MachineErrors:
    """What is wrong with a machine: location errors, effects, placement of the work.

    Attributes
    ----------
    errors
        Location errors by name, µm and arcsec, totals.
    effects
        Effects of the machine: id → parameter → value.
    own
        The user's own effects that have a `motion`, with their values.
    placement
        Placement of the work on the table, `dx_um` ... `rc_arcsec`.
    ignored
        Ids of effects that belong to probe, artefact or time: they do not move the tool on the
        work and take no part.
    """

    errors: Mapping[str, float] = field(default_factory=dict)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    own: tuple[tuple[UserEffect, Mapping[str, float]], ...] = ()
    placement: Mapping[str, float] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        setup: Setup,
        errors: Any = None,
        effects: Any = None,
        placement: Mapping[str, float] | None = None,
    ) -> MachineErrors:
        """Sort what a caller gives.

        `errors` is a mapping, or a result with `errors` (and `effects`, taken unless given
        separately), or a `MachineErrors`. Location errors that are not given are those of the
        set-up file, else zero.

        Raises
        ------
        DataError
            A result with a location error or an effect of the machine that its data could not see.
        """
        instance("setup", setup, Setup, "a Setup, as read_setup gives it")
        if isinstance(errors, MachineErrors):
            if effects or placement:
                raise InputError("effects, placement: got both them and MachineErrors, wanted one")
            return errors
        std_errors: Mapping[str, float] = {}
        if errors is not None and not isinstance(errors, Mapping):
            std_errors = getattr(errors, "std_errors", None) or {}
            effects = effects or getattr(errors, "effects", None)
            errors = getattr(errors, "errors", errors)
        if effects is not None and not isinstance(effects, Mapping):
            effects = getattr(effects, "effects", effects)
        for what, value in (("errors", errors), ("effects", effects), ("placement", placement)):
            if value is not None and not isinstance(value, Mapping):
                raise InputError(
                    f"{what}: got {type(value).__name__}, wanted names with values, or a result "
                    "that has them"
                )
        named = {canonical_error_name(k): v for k, v in setup.machine.errors.items()}
        named |= {canonical_error_name(name): value for name, value in (errors or {}).items()}
        for name in placement or {}:
            if name not in PLACEMENT:
                raise UnknownNameError(
                    f"placement: got {name!r}, wanted one of {', '.join(PLACEMENT)}"
                )
        machine, own, ignored = _sorted_effects(setup, effects or {})
        _refuse_unseen(std_errors, {*named, *machine})
        state = cls(
            errors={name: _finite(name, value) for name, value in named.items()},
            effects=machine,
            own=own,
            placement={k: _finite(k, v) for k, v in (placement or {}).items()},
            ignored=ignored,
        )
        state.core(setup)  # unknown location errors are refused here, by the machine's list
        return state

    def core(
        self,
        setup: Setup,
        direction: Sequence[float] = (0.0, 0.0, 0.0),
        senses: Mapping[str, float] | None = None,
    ) -> _core.MachineModel:
        """Return the core's model of this machine; `senses` by letter in the control's sign."""
        letters = chain_letters(setup)
        turned = {letter.upper(): value for letter, value in (senses or {}).items()}
        for letter in turned:
            if letter not in letters:
                raise InputError(f"senses: got axis {letter}, wanted among {', '.join(letters)}")
        effects = []
        parameters = _effect_parameters(setup)
        for name, values in self.effects.items():
            effects.append((name, [float(values.get(p, 0.0)) for p in parameters[name][1]]))
        return _core.MachineModel(
            setup.machine.preset,
            setup.probe.length_mm,
            errors=list(self.errors.items()),
            placement=[float(self.placement.get(name, 0.0)) for name in PLACEMENT],
            effects=effects,
            direction=[float(value) for value in direction],
            sense=[turned.get(letter, 0.0) * setup.sense(letter) for letter in letters],
        )

    def motion_mm(self, setup: Setup, position_mm: Floats, rotary_deg: Floats) -> Floats:
        """Sum of the user's own motions, mm, machine frame; rotary in the contract's sign."""
        moved = np.zeros((len(position_mm), 3))
        letters = chain_letters(setup)
        pose = MotionPose(
            position_mm,
            MappingProxyType(
                {letter: rotary_deg[:, i] * setup.sense(letter) for i, letter in enumerate(letters)}
            ),
        )
        for effect, values in self.own:
            if not isinstance(effect, Moving):
                continue
            change = np.asarray(effect.motion(pose, values), dtype=np.float64)
            if change.shape != moved.shape or not np.all(np.isfinite(change)):
                raise InputError(
                    f"motion of effect {effect.id!r}: got shape {change.shape} or values that are "
                    f"not finite, wanted finite µm of shape {moved.shape}"
                )
            moved += 1e-3 * change
        return moved


def _refuse_unseen(std_errors: Mapping[str, float], used: set[str]) -> None:
    """Nothing is corrected by a number that nobody measured; `used` are errors and effects."""
    unseen = [
        name
        for name, value in std_errors.items()
        if not np.isfinite(value) and name.partition(".")[0] in used
    ]
    if unseen:
        raise DataError(
            f"{', '.join(unseen)}: got no estimate (the data cannot see it), wanted one: nothing "
            "bounds what compensation leaves; give the errors as names and values if theirs are "
            "known otherwise"
        )


NOMINAL = MachineErrors()
"""A machine without errors."""


def _finite(name: str, value: object) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number) or isinstance(value, bool):
        raise InputError(f"{name}: got {value!r}, wanted a finite number")
    return number


def _effect_parameters(setup: Setup) -> dict[str, tuple[str, list[str]]]:
    """Owner and parameter names of every effect on this machine."""
    # Effects of the machine do not depend on the artefact, which a set-up may lack.
    entries = _core.catalogue(setup.machine.preset, "cross", [2.0, 1.0, 1.0])
    return {name: (owner, [p[0] for p in ps]) for name, _, owner, ps, _ in entries}


def _sorted_effects(
    setup: Setup, effects: Mapping[Effect, Mapping[str, float]]
) -> tuple[
    dict[str, dict[str, float]],
    tuple[tuple[UserEffect, Mapping[str, float]], ...],
    tuple[str, ...],
]:
    ids, users = split_effects(effects)
    known = _effect_parameters(setup)
    machine: dict[str, dict[str, float]] = {}
    ignored: list[str] = []
    for name in ids:
        if name not in known:
            # A sphere has effects that a cross lacks; they belong to the artefact.
            if name == "artefact_diameter":
                ignored.append(name)
                continue
            raise UnknownNameError(f"effect: got {name!r}, wanted one of {', '.join(known)}")
        owner, parameters = known[name]
        for parameter in effects[name]:
            if parameter not in parameters:
                raise UnknownNameError(
                    f"parameter of effect {name!r}: got {parameter!r}, wanted one of "
                    f"{', '.join(parameters)}"
                )
        if owner != "machine":
            ignored.append(name)
            continue
        machine[name] = {k: _finite(f"{name}.{k}", v) for k, v in effects[name].items()}
    own = []
    for effect in users:
        if isinstance(effect, Moving):
            own.append((effect, dict(effects[effect])))
        else:
            ignored.append(effect.id)
    return machine, tuple(own), tuple(ignored)


def chain_letters(setup: Setup) -> str:
    """Letters of the rotary axes in the machine's order, "AC" for ``trt-ca``."""
    return _core.Machine(setup.machine.preset, setup.probe.length_mm, []).letters


# --- axes of grids


def axis_nodes(name: str, given: ArrayLike, count: int) -> Floats:
    """Nodes of an axis: `count` from a pair (low, high), or more than two nodes as they are."""
    nodes = _numbers(name, given)
    if nodes.ndim == 0:
        nodes = nodes[None]
    if len(nodes) == 2 and nodes[0] < nodes[1]:
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 2:
            raise InputError(f"points along {name}: got {count!r}, wanted a whole number from 2")
        return np.linspace(nodes[0], nodes[1], int(count))
    if nodes.ndim != 1 or len(nodes) == 0 or np.any(np.diff(nodes) <= 0):
        raise InputError(f"{name}: got {given!r}, wanted (low, high) or rising nodes, in mm")
    return nodes


def rotary_nodes(
    setup: Setup, given: Mapping[str, ArrayLike | None]
) -> tuple[dict[str, Floats], tuple[int, ...]]:
    """Positions of each rotary axis by letter (control's sign) and the shape of their grid.

    An axis that is not given stands at zero; a number takes no part in the shape.
    """
    letters = chain_letters(setup)
    for letter, value in given.items():
        if letter not in letters and value is not None and np.any(np.asarray(value) != 0):
            raise InputError(
                f"{letter.lower()}_deg: got {value!r}, wanted none: machine "
                f"{setup.machine.preset} has the rotary axes {', '.join(letters)}"
            )
    nodes: dict[str, Floats] = {}
    shape: list[int] = []
    for letter in letters:
        value = given.get(letter)
        positions = _numbers(f"{letter.lower()}_deg", 0.0 if value is None else value)
        if positions.ndim > 1 or positions.size == 0:
            raise InputError(f"{letter.lower()}_deg: got {value!r}, wanted a number or a sequence")
        shape.extend(positions.shape)
        nodes[letter] = np.atleast_1d(positions)
    return nodes, tuple(shape)


def pose_grid(setup: Setup, nodes: Mapping[str, Floats]) -> Floats:
    """Every combination of positions, contract's sign, shape (m, axes), last axis fastest."""
    axes = [nodes[letter] * setup.sense(letter) for letter in chain_letters(setup)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def _numbers(name: str, given: ArrayLike) -> Floats:
    try:
        values = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        values = np.array(np.nan)
    if not np.all(np.isfinite(values)):
        raise InputError(f"{name}: got {given!r}, wanted finite numbers")
    return values
