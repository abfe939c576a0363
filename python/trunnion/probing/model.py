"""Touches of an artefact as the core models them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

import trunnion._core as _core
from trunnion.base.checks import finite, instance, named
from trunnion.base.errors import DataError, InputError, UnknownNameError
from trunnion.base.recognition import unstated
from trunnion.base.resolution import Grid
from trunnion.base.units import Floats, Integers
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.machine.effects import PLACEMENT, EffectInfo, Owner
from trunnion.probing.recorded import (
    coordinates_um,
    readings_um,
    recorded_um,
    servo_period_ms,
)
from trunnion.setup import Setup

UNKNOWN_TICK = (
    "if this is the tick of the control, half of it is in EZ0A and the placement, or in a cause "
    "(probe_radius, trigger_delay): state probe.servo_period_ms (or probe.tick_um); if coordinates "
    "are only rounded to it: probe.resolution_um"
)


def catalogue(setup: Setup) -> tuple[EffectInfo, ...]:
    """Every effect that can act on touches of this artefact on this machine."""
    return Chain(setup).catalogue()


def ticks_um(setup: Setup, touches: Touches) -> Floats:
    """Travel between two looks at the probe in each touch, µm; 0: not known. Shape (n,).

    Raises
    ------
    InputError
        A servo period, and touches without feeds.
    """
    probe = setup.probe
    if not probe.servo_period_ms:
        return np.full(len(touches), probe.tick_um)
    if touches.feed_mm_min is None:
        raise InputError(
            f"probe.servo_period_ms = {probe.servo_period_ms:g}: got touches without column "
            "feed_mm_min, expected it: the tick is feed × servo period (or give probe.tick_um)"
        )
    return np.asarray(probe.ticks_um(touches.feed_mm_min), dtype=np.float64)


def steps_um(setup: Setup, touches: Touches) -> Floats:
    """Step in which each touch is recorded, µm: tick or resolution; 0: not known. Shape (n,)."""
    return np.maximum(ticks_um(setup, touches), setup.probe.resolution_um)


def seen_steps_um(setup: Setup, touches: Touches) -> Floats:
    """Return :func:`steps_um`; where it states none, those of a clock that is seen, (n,)."""
    steps = steps_um(setup, touches)
    if np.any(steps) or touches.feed_mm_min is None:
        return steps
    period_ms = servo_period_ms(touches, setup.resolution.linear_um)
    return np.asarray(period_ms * touches.feed_mm_min / 60)


def rounding_um(setup: Setup, touches: Touches) -> float:
    """Standard deviation of the errors of rounding to steps, rms over the touches."""
    return float(np.sqrt(np.mean(steps_um(setup, touches) ** 2) / 12))


def known_sigma_um(setup: Setup, touches: Touches) -> float:
    """Standard deviation of a reading from the set-up: repeatability and step; 0 if unknown."""
    if setup.probe.repeatability_um == 0:
        return 0.0
    steps = steps_um(setup, touches)
    return float(np.sqrt(setup.probe.repeatability_um**2 + np.mean(steps**2) / 12))


def with_recognised_step(
    setup: Setup, touches: Touches, residuals_um: Floats, freedom: float
) -> tuple[Setup, str] | None:
    """Return the set-up with the step of the readings that it does not state, and a note on it.

    None: no step is recognised that is large beside what a fit leaves.
    """
    sigma_um = float(np.sqrt(np.sum(residuals_um**2) / max(freedom, 1.0)))

    def off() -> Floats:
        model = TouchModel(setup)
        return np.asarray(model.core.residuals(model.moves(touches), model.values()))

    stated = float(np.max(steps_um(setup, touches), initial=0.0))
    recorded = (*recorded_um(touches), coordinates_um(touches).places)
    step = unstated(recorded, stated, sigma_um, off)
    if step <= sigma_um:
        return None
    known = replace(setup, probe=replace(setup.probe, resolution_um=step))
    return known, f"Touches are recorded in steps of {step:.4g} µm; {UNKNOWN_TICK}."


def positions_of(commanded_deg: Floats) -> tuple[Floats, Integers]:
    """Positions of one rotary axis, in order, and the number of that of each touch, (n,)."""
    distinct, number = np.unique(np.round(commanded_deg, 3), return_inverse=True)
    return distinct, number


def stops_of(touches: Touches) -> Integers:
    """Number of the position of the rotary axes in which each touch was made, shape (n,)."""
    stops = np.zeros(len(touches), dtype=np.intp)
    for positions in touches.rotary_deg.values():
        distinct, number = positions_of(positions)
        stops = np.unique(stops * len(distinct) + number, return_inverse=True)[1]
    return stops


class TouchModel:
    """The core's model of touches for one set-up and some built-in effects.

    Parameters are the machine's location errors, the six placement parameters and the parameters
    of the effects (``"drift_z.rate_um_h"``), in µm, arcsec, ppm, ... as their names or units say.

    setup: Machine, artefact, probe.
    effects: Ids of the catalogue.
    tick_um: Tick of the trigger; the set-up's unless given.
    chain: That of the set-up, where another model of it has one.

    Its `unknown` (flags, (p,)) leaves out what is none: the rotation of a sphere.
    """

    def __init__(
        self,
        setup: Setup,
        effects: Sequence[str] = (),
        *,
        tick_um: float | None = None,
        chain: Chain | None = None,
    ) -> None:
        self.chain = Chain(setup) if chain is None else chain
        self.setup = setup
        self.effect_ids = tuple(map(self.chain.effect_id, effects))
        self.core = _core.TouchModel(
            self.chain.machine({}),
            self.chain.artefact,
            ball_radius_mm=setup.probe.ball_radius_mm,
            tick_um=setup.probe.tick_um if tick_um is None else tick_um,
            servo_period_ms=setup.probe.servo_period_ms if tick_um is None else 0.0,
            effect_ids=list(self.effect_ids),
        )
        parameters = self.core.parameters
        self.names = tuple(name for name, _, _ in parameters)
        self.units = tuple(unit for _, unit, _ in parameters)
        self.kinds = tuple(kind for _, _, kind in parameters)
        self.error_names = self.names[: self.core.error_count]
        self.unknown = np.array(self.core.unknown)

    @property
    def unknown_names(self) -> tuple[str, ...]:
        """Names of the parameters that are unknowns."""
        return tuple(name for name, is_one in zip(self.names, self.unknown, strict=True) if is_one)

    @property
    def owners(self) -> dict[str, Owner]:
        """Whose each of the effects is."""
        return {name: self.chain.effects[name].owner for name in self.effect_ids}

    def moves(
        self,
        touches: Touches,
        *,
        from_start: bool = False,
    ) -> _core.Moves:
        """Rows of the touches in the core's units; points are recorded positions or starts."""
        instance("touches", touches, Touches, "Touches, as read_touches or plan gives them")
        self._check_needs(touches)
        point = touches.start_mm if from_start else touches.position_mm
        if point is None:
            raise DataError("columns start_x_mm, start_y_mm, start_z_mm: got none, expected a plan")
        return _core.Moves(
            self.chain.to_machine(touches.rotary_deg, len(touches)),
            point,
            touches.direction,
            touches.feed_mm_min,
            touches.time_s,
            # Missing senses are refused by the effects that need them; for all others 0 will do.
            self.chain.turned(touches.rotary_dir, len(touches)),
        )

    def _check_needs(self, touches: Touches) -> None:
        for effect in self.chain.catalogue() if self.effect_ids else ():
            if effect.id not in self.effect_ids:
                continue
            for column in effect.needs:
                if column not in touches.columns:
                    raise InputError(
                        f"effect {effect.id!r}: got data without column {column}, expected it"
                    )

    def values(
        self,
        errors: Mapping[str, float] | None = None,
        placement: Mapping[str, float] | None = None,
        effects: Mapping[str, Mapping[str, float]] | None = None,
    ) -> Floats:
        """Parameter vector from named values.

        Location errors that are not given are those of the set-up file, else zero; everything
        else that is not given is zero.
        """
        values = dict.fromkeys(self.names, 0.0)
        expected = "names with values, {'EX0C': 15.0}"
        values.update(self.chain.named_errors(named("errors", errors, expected)))
        expected = "names with values, {'dx_um': 50.0}"
        for name, value in named("placement", placement, expected).items():
            if name not in PLACEMENT:
                raise UnknownNameError(
                    f"placement: got {name!r}, expected one of {', '.join(PLACEMENT)}"
                )
            values[name] = value
        for effect, parameters in (effects or {}).items():
            self._take_effect(values, self.chain.effect_id(effect), parameters)
        return np.array([finite(name, values[name]) for name in self.names])

    def _take_effect(
        self, values: dict[str, float], effect: str, parameters: Mapping[str, float]
    ) -> None:
        own = [name for name in self.names if name.startswith(f"{effect}.")]
        if not isinstance(parameters, Mapping):
            raise InputError(
                f"effect {effect!r}: got {parameters!r}, expected a dict of "
                f"{', '.join(name.split('.', 1)[1] for name in own)}"
            )
        for name, value in parameters.items():
            full = f"{effect}.{name}"
            if full not in values:
                expected = ", ".join(part.split(".", 1)[1] for part in own)
                raise UnknownNameError(
                    f"parameter of effect {effect!r}: got {name!r}, expected one of {expected}"
                )
            values[full] = value
        for full in own:
            kind = self.kinds[self.names.index(full)]
            name = full.split(".", 1)[1]
            if kind != "linear" and name not in parameters:
                raise InputError(f"effect {effect!r}: got no {name}, expected one")
            if kind == "duration" and not values[full] > 0:
                raise InputError(
                    f"effect {effect!r}: got {name} = {values[full]!r}, expected a positive number"
                )

    def effects_of(self, values: Floats | Sequence[float]) -> dict[str, dict[str, float]]:
        """Effects' part of a parameter vector: id → parameter → value."""
        found: dict[str, dict[str, float]] = {effect: {} for effect in self.effect_ids}
        for name, value in zip(self.names, values, strict=True):
            if "." in name:
                effect, parameter = name.split(".", 1)
                found[effect][parameter] = float(value)
        return found


def grid_of(model: TouchModel, touches: Touches, jacobian: Floats) -> Grid:
    """Return the steps of touches, and which of them round alike.

    jacobian: By location errors, placement and what else is fitted, shape (n, p).
    """
    return Grid.of(
        readings_um(touches),
        steps_um(model.setup, touches),
        jacobian[:, : len(model.error_names) + len(PLACEMENT)],
        stops_of(touches),
        recorded_um(touches),
        coordinates_um(touches),
    )
