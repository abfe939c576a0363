"""The machine with its errors, as the core wants it."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

import trunnion._core as _core
from trunnion.base.arguments import checked
from trunnion.base.checks import choose, finite, named, numbers
from trunnion.base.errors import DataError, InputError
from trunnion.base.units import Floats
from trunnion.data.frame import ControlFrame
from trunnion.machine.chain import Chain
from trunnion.machine.effects import (
    PLACEMENT,
    Motion,
    MotionPose,
    Moving,
    Owner,
    effect_id,
    own_call,
    split_effects,
)
from trunnion.machine.estimate import Estimate
from trunnion.machine.geometry import Geometry, refuse_other_axes
from trunnion.setup import Setup

Effects: TypeAlias = Estimate | Mapping[Any, Mapping[str, float]] | None
"""Effects as id (or a user's own) → parameter → value, or the estimate that has them."""


@dataclass(frozen=True)
class OwnMotion:
    """An effect outside the catalogue of the machine: how it moves the tool, and its values."""

    id: str
    motion: Motion
    values: Mapping[str, float]


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
        Effects outside the catalogue that move the tool: a user's own with a `motion`, and what a
        diagnosis found along the linear axes (straightness, angular errors, a smooth field).
    placement
        Placement of the work on the table, `dx_um` ... `rc_arcsec`.
    ignored
        Ids of effects that take no part: those of probe, artefact and time do not move the tool on
        the work, others say nothing that a compensation could use.
    geometry
        The axes that they refer to; None: not stated.
    control_frame
        That of the control that measured them; None: not stated.
    """

    errors: Mapping[str, float] = field(default_factory=dict)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    own: tuple[OwnMotion, ...] = ()
    placement: Mapping[str, float] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()
    geometry: Geometry | None = None
    control_frame: ControlFrame | None = None

    @classmethod
    def to_compensate(
        cls,
        setup: Setup,
        errors: Known = None,
        effects: Effects = None,
        placement: Mapping[str, float] | None = None,
    ) -> MachineErrors:
        """Sort what a compensation is made from, as :meth:`of` does.

        A frame of the control is refused in which these are no errors of the joints.
        """
        made = cls.of(setup, errors, effects, placement)
        given = errors if isinstance(errors, Estimate) else effects
        if isinstance(given, Estimate) and not (given.errors or made.effects or made.own):
            why = "; ".join(f"{name}: {said}" for name, said in given.not_compensable.items())
            raise DataError(
                "errors: got an estimate without location errors and effects of the machine"
                f"{f' ({why})' if why else ''}, expected one that has some: a compensation by it "
                "would change nothing"
            )
        if made.control_frame is not None:
            made.control_frame.refuse_to_compensate(setup)
        return made

    @classmethod
    @checked
    def of(
        cls,
        setup: Setup,
        errors: Known = None,
        effects: Effects = None,
        placement: Mapping[str, float] | None = None,
    ) -> MachineErrors:
        """Sort what a caller gives.

        `errors` is a mapping, or an estimate (its effects are taken unless given separately), or a
        `MachineErrors`. Location errors that are not given are those of the set-up file, else zero.

        An estimate is refused with a location error or an effect that its data do not identify, and
        where the axes of the set-up are others than those that it was made with.
        """
        chain = Chain(setup)
        if isinstance(errors, MachineErrors):
            if effects or placement:
                raise InputError(
                    "effects, placement: got both them and MachineErrors, expected one"
                )
            refuse_other_axes(errors, setup)
            return errors
        effects = effects or (errors if isinstance(errors, Estimate) else None)
        estimates = [given for given in (errors, effects) if isinstance(given, Estimate)]
        std_errors = {k: v for given in estimates for k, v in given.std_errors.items()}
        for one in estimates:
            refuse_other_axes(one, setup)
        errors = errors.errors if isinstance(errors, Estimate) else errors
        effects = effects.effects if isinstance(effects, Estimate) else effects
        expected = (
            "names with values, or an estimate: the result of an identification, the model of a "
            "diagnosis"
        )
        for what, value in (("errors", errors), ("effects", effects), ("placement", placement)):
            named(what, value, expected)
        known = chain.named_errors(errors)
        for name in placement or {}:
            choose("placement", name, PLACEMENT)
        machine, own, ignored = _sorted_effects(setup, effects or {}, estimates)
        _refuse_not_identifiable(std_errors, {*known, *machine, *(moving.id for moving in own)})
        return cls(
            errors={name: finite(name, value) for name, value in known.items()},
            effects=machine,
            own=own,
            placement={name: finite(name, value) for name, value in (placement or {}).items()},
            ignored=ignored,
            geometry=next(filter(None, (one.geometry for one in estimates)), None),
            control_frame=next(filter(None, (one.control_frame for one in estimates)), None),
        )

    def only(self, ids: Container[str]) -> MachineErrors:
        """Return the location errors with those effects of the machine that have these ids."""
        effects = {name: values for name, values in self.effects.items() if name in ids}
        return replace(self, effects=effects, own=(), placement={}, ignored=())

    def refuse_own(self, why: str) -> None:
        """Refuse motions of the user's own where only the machine's model is followed."""
        if self.own:
            raise InputError(
                f"effect {self.own[0].id!r}: got a user's own effect, expected location errors and "
                f"effects of the catalogue: {why}"
            )

    def core(
        self,
        setup: Setup,
        direction: Sequence[float] = (0.0, 0.0, 0.0),
        senses: Mapping[str, float] | None = None,
    ) -> _core.MachineModel:
        """Return the core's model of this machine; `senses` by letter in the control's sign."""
        known = Chain(setup).effects
        return Chain(setup).model(
            self.errors,
            [float(self.placement.get(name, 0.0)) for name in PLACEMENT],
            [
                (name, [float(values.get(p.name, 0.0)) for p in known[name].parameters])
                for name, values in self.effects.items()
            ],
            direction,
            senses,
        )

    def motion_mm(self, setup: Setup, position_mm: Floats, rotary_deg: Floats) -> Floats:
        """Sum of the user's own motions, mm, machine frame; rotary in the contract's sign."""
        moved = np.zeros((len(position_mm), 3))
        pose = MotionPose(position_mm, MappingProxyType(Chain(setup).to_control(rotary_deg)))
        for effect in self.own:
            found = own_call(effect, "motion", effect.motion, pose, effect.values)
            change = np.asarray(found, dtype=np.float64)
            if change.shape != moved.shape or not np.all(np.isfinite(change)):
                raise InputError(
                    f"motion of effect {effect.id!r}: got shape {change.shape} or values that are "
                    f"not finite, expected finite µm of shape {moved.shape}"
                )
            moved += 1e-3 * change
        return moved


Known: TypeAlias = MachineErrors | Estimate | Mapping[str, float] | None
"""What is wrong with a machine: an estimate, or location errors by name, µm and arcsec."""


def _refuse_not_identifiable(std_errors: Mapping[str, float], used: set[str]) -> None:
    """Nothing is corrected by a number that nobody measured; `used` are errors and effects."""
    missing = [
        name
        for name, value in std_errors.items()
        if not np.isfinite(value) and name.partition(".")[0] in used
    ]
    if missing:
        raise DataError(
            f"{', '.join(missing)}: got no estimate (not identifiable), expected one: nothing "
            "bounds what compensation leaves; give the errors as names and values if "
            "theirs are known otherwise"
        )


NOMINAL = MachineErrors()
"""A machine without errors."""


def _sorted_effects(
    setup: Setup, effects: Mapping[Any, Mapping[str, float]], estimates: Sequence[Estimate]
) -> tuple[dict[str, dict[str, float]], tuple[OwnMotion, ...], tuple[str, ...]]:
    """Effects of the catalogue that move the machine, others that do, and what takes no part."""
    split_effects(effects)
    motions = {k: v for estimate in estimates for k, v in estimate.motions.items()}
    idle = {name for estimate in estimates for name in estimate.not_compensable}
    chain = Chain(setup)
    known = chain.effects
    machine: dict[str, dict[str, float]] = {}
    own: list[OwnMotion] = []
    ignored: list[str] = []
    for effect, values in effects.items():
        name = chain.effect_id(effect) if isinstance(effect, str) else effect_id(effect)
        sizes = numbers(name, values)
        motion = effect.motion if isinstance(effect, Moving) else motions.get(name)
        if motion is not None:
            own.append(OwnMotion(name, motion, sizes))
        elif not isinstance(effect, str) or name in idle:
            ignored.append(name)
        elif name in known:
            parameters = [p.name for p in known[name].parameters]
            for parameter in values:
                choose(f"parameter of effect {name!r}", parameter, parameters)
            if known[name].owner is Owner.MACHINE:
                machine[name] = sizes
            else:
                ignored.append(name)
        else:
            choose("effect", name, known)
    return machine, tuple(own), tuple(ignored)
