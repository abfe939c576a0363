"""Bridge from set-ups and touches to the core's model: the one place where both meet.

The control's sign of an axis (``sense = -1`` in the set-up file) is turned into the contract's sign
here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

import trunnion._core as _core
from trunnion.base.checks import finite, instance, named
from trunnion.base.errors import DataError, InputError, UnknownNameError
from trunnion.data.touches import Touches
from trunnion.machine.effects import PLACEMENT, EffectInfo, Owner, ParameterInfo
from trunnion.setup import Setup
from trunnion.setup.names import canonical_error_name, iso_codes

__all__ = ["TouchModel", "catalogue"]

Floats = NDArray[np.float64]


def dimensions_mm(setup: Setup) -> tuple[str, list[float]]:
    """Kind of the artefact and its dimensions as the core wants them."""
    artefact = setup.artefact
    if artefact.kind == "none":
        raise InputError(
            "artefact: got none in the set-up, wanted [artefact] with kind cross, cuboid or sphere"
        )
    if artefact.kind == "sphere":
        diameter, centre = artefact.diameter_mm, artefact.centre_mm
        if diameter is None or centre is None:
            raise InputError("sphere: got no diameter_mm or centre_mm, wanted both")
        return "sphere", [diameter, *centre]
    return artefact.kind, [artefact.length_mm, artefact.width_mm, artefact.height_mm]


def catalogue(setup: Setup) -> tuple[EffectInfo, ...]:
    """Every effect that can act on touches of this artefact on this machine."""
    entries = _core.catalogue(setup.machine.preset, *dimensions_mm(setup))
    return tuple(
        EffectInfo(
            id=name,
            label=title,
            # what happens at a moment is of one set-up: the artefact slips on the table
            owner=Owner.PLACEMENT if owner == "artefact" and needs else Owner(owner),
            parameters=tuple(ParameterInfo(*parameter) for parameter in parameters),
            needs=tuple(needs),
            codes=iso_codes(name),
        )
        for name, title, owner, parameters, needs in entries
    )


class TouchModel:
    """The core's model of touches for one set-up and some built-in effects.

    Parameters are the machine's location errors, the six placement parameters and the parameters
    of the effects (``"drift_z.rate_um_h"``), in µm, arcsec, ppm, ... as their names or units say.

    Parameters
    ----------
    setup
        Machine, artefact, probe.
    effects
        Ids of the catalogue.
    tick_um
        Tick of the trigger; the set-up's unless given.
    """

    def __init__(
        self, setup: Setup, effects: Sequence[str] = (), *, tick_um: float | None = None
    ) -> None:
        self.setup = instance("setup", setup, Setup, "a Setup, as read_setup gives it")
        self.core = _core.TouchModel(
            setup.machine.preset,
            setup.probe.length_mm,
            *dimensions_mm(setup),
            setup.probe.ball_radius_mm,
            setup.probe.tick_um if tick_um is None else tick_um,
            list(effects),
        )
        self.names = tuple(name for name, _, _ in self.core.parameters)
        self.units = tuple(unit for _, unit, _ in self.core.parameters)
        self.kinds = tuple(kind for _, _, kind in self.core.parameters)
        self.error_names = self.names[: self.core.error_count]
        self.effect_ids = tuple(effects)
        self._letters = self.core.letters.lower()
        known = {canonical_error_name(name): v for name, v in setup.machine.errors.items()}
        self._check_errors(known)
        self._known = known

    def _check_errors(self, errors: Mapping[str, float]) -> None:
        for name in errors:
            if name not in self.error_names:
                raise UnknownNameError(
                    f"location error: got {name!r}, wanted one of {', '.join(self.error_names)} "
                    f"(machine {self.setup.machine.preset})"
                )

    def moves(self, touches: Touches, *, from_start: bool = False) -> _core.Moves:
        """Rows of the touches in the core's units; points are recorded positions or starts."""
        instance("touches", touches, Touches, "Touches, as read_touches or plan gives them")
        columns = []
        for letter in self._letters:
            if letter not in touches.rotary_deg:
                raise DataError(
                    f"column {letter}_deg: got none, wanted the position of rotary axis "
                    f"{letter.upper()} (machine {self.setup.machine.preset})"
                )
            columns.append(touches.rotary_deg[letter] * self.setup.sense(letter.upper()))
        self._check_needs(touches)
        spare = set(touches.rotary_deg) - set(self._letters)
        if spare:
            letter = min(spare).upper()
            raise DataError(
                f"column {letter.lower()}_deg: got positions of axis {letter}, wanted only "
                f"{', '.join(self._letters.upper())} (machine {self.setup.machine.preset})"
            )
        senses = [
            touches.rotary_dir[letter] * self.setup.sense(letter.upper())
            if letter in touches.rotary_dir
            else None
            for letter in self._letters
        ]
        # Missing senses are refused by the effects that need them; for all others 0 will do.
        sense = None
        if any(column is not None for column in senses):
            zeros = np.zeros(len(touches))
            sense = np.column_stack([zeros if column is None else column for column in senses])
        point = touches.start_mm if from_start else touches.position_mm
        if point is None:
            raise DataError("columns start_x_mm, start_y_mm, start_z_mm: got none, wanted a plan")
        return _core.Moves(
            np.column_stack(columns).astype(float),
            point,
            touches.direction,
            touches.feed_mm_min,
            touches.time_s,
            None if sense is None else sense.astype(float),
        )

    def _check_needs(self, touches: Touches) -> None:
        for effect in catalogue(self.setup) if self.effect_ids else ():
            if effect.id not in self.effect_ids:
                continue
            for column in effect.needs:
                if column not in touches.columns:
                    raise InputError(
                        f"effect {effect.id!r}: got data without column {column}, wanted it"
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
        values.update(self._known)
        given: dict[str, float] = {}
        wanted = "names with values, {'EX0C': 15.0}"
        for spelling, value in named("errors", errors, wanted).items():
            name = canonical_error_name(spelling)
            if name in given:
                raise InputError(f"location error {name}: got two spellings, wanted it once")
            given[name] = value
        self._check_errors(given)
        values.update(given)
        wanted = "names with values, {'dx_um': 50.0}"
        for name, value in named("placement", placement, wanted).items():
            if name not in PLACEMENT:
                raise UnknownNameError(
                    f"placement: got {name!r}, wanted one of {', '.join(PLACEMENT)}"
                )
            values[name] = value
        for effect, parameters in (effects or {}).items():
            self._take_effect(values, effect, parameters)
        return np.array([finite(name, values[name]) for name in self.names])

    def _take_effect(
        self, values: dict[str, float], effect: str, parameters: Mapping[str, float]
    ) -> None:
        own = [name for name in self.names if name.startswith(f"{effect}.")]
        if not isinstance(parameters, Mapping):
            raise InputError(
                f"effect {effect!r}: got {parameters!r}, wanted a dict of "
                f"{', '.join(name.split('.', 1)[1] for name in own)}"
            )
        for name, value in parameters.items():
            full = f"{effect}.{name}"
            if full not in values:
                wanted = ", ".join(part.split(".", 1)[1] for part in own)
                raise UnknownNameError(
                    f"parameter of effect {effect!r}: got {name!r}, wanted one of {wanted}"
                )
            values[full] = value
        for full in own:
            kind = self.kinds[self.names.index(full)]
            name = full.split(".", 1)[1]
            if kind != "linear" and name not in parameters:
                raise InputError(f"effect {effect!r}: got no {name}, wanted one")
            if kind == "duration" and not values[full] > 0:
                raise InputError(
                    f"effect {effect!r}: got {name} = {values[full]!r}, wanted a positive number"
                )

    def effects_of(self, values: Floats | Sequence[float]) -> dict[str, dict[str, float]]:
        """Effects' part of a parameter vector: id → parameter → value."""
        found: dict[str, dict[str, float]] = {effect: {} for effect in self.effect_ids}
        for name, value in zip(self.names, values, strict=True):
            if "." in name:
                effect, parameter = name.split(".", 1)
                found[effect][parameter] = float(value)
        return found
