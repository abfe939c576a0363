"""The chain of axes of a set-up: the one bridge between controls, the package and the core.

Here alone the sign in which a control counts a rotary axis (``sense = -1`` in the set-up file) is
turned into that of the machine and back, and the core's machine is made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

import trunnion._core as _core
from trunnion.base.checks import choose, floats, instance
from trunnion.base.errors import DataError, InputError, UnknownNameError
from trunnion.base.units import Floats
from trunnion.machine.effects import EffectInfo, Owner, ParameterInfo
from trunnion.setup import Setup
from trunnion.setup.artefact import DIMENSIONS
from trunnion.setup.machines import Description, check_error
from trunnion.setup.names import canonical_error_name, effect_ids, is_code, iso_codes


@dataclass(frozen=True)
class Chain:
    """Axes of a machine: letters, senses, the core's machine, names of its errors and effects.

    Rotary positions in *machine order* are arrays (n, axes) in degrees whose columns are the axes
    in the order of `letters` and whose positive sense is the right-handed turn of the table.
    """

    setup: Setup

    def __post_init__(self) -> None:
        """Refuse what is no set-up."""
        instance("setup", self.setup, Setup, "a Setup, as read_setup gives it")

    def __getstate__(self) -> dict[str, Setup]:
        """Pickle the set-up alone: what is derived from it is made again."""
        return {"setup": self.setup}

    @cached_property
    def _description(self) -> Description:
        return self.setup.description()

    @cached_property
    def _nominal(self) -> _core.Machine:
        return self._description.core(self.setup.probe.length_mm)

    @cached_property
    def letters(self) -> str:
        """Letters of the rotary axes, "AC" for ``trt-ca``: head, then table, from the bed."""
        return self._nominal.letters

    @property
    def count(self) -> int:
        """Number of rotary axes."""
        return len(self.letters)

    @property
    def tilting(self) -> str | None:
        """Letter of the axis that tilts the tool against the work; None without one."""
        return self._nominal.roles[1]

    @property
    def turning(self) -> str | None:
        """Letter of the axis that turns the work against the tool; None without one."""
        return self._nominal.roles[0]

    @property
    def sides(self) -> Mapping[str, Literal["table", "head"]]:
        """Side of each rotary axis, by letter."""
        return dict(zip(self.letters, self._nominal.sides, strict=True))

    @property
    def level_deg(self) -> float:
        """Position of the tilting axis, machine's sense, at which the table top faces the tool."""
        return self._nominal.level_deg

    @cached_property
    def senses(self) -> Floats:
        """1 or -1 for each rotary axis, (axes,): between the control's sign and the machine's."""
        return np.array([self.sense_of(letter) for letter in self.letters])

    def linear_senses(self) -> Floats:
        """1 or -1 for X, Y, Z."""
        return np.array([self.sense_of(letter) for letter in "XYZ"])

    def sense_of(self, letter: str) -> float:
        """1 or -1 for one axis, linear or rotary."""
        return float(self.setup.sense(letter))

    @property
    def name(self) -> str:
        """Machine and axes for messages: "machine trt-ca: A, C"."""
        return f"machine {self.setup.machine.name}: {', '.join(self.letters) or 'no rotary axis'}"

    # --- positions

    def to_machine(self, positions: Mapping[str, ArrayLike], rows: int | None = None) -> Floats:
        """Positions by letter, in the control's sign, in machine order, (n, axes).

        positions: Letter (either case) → positions, (n,) or one number for all rows.
        rows: How many rows; unless given, as many as the longest has.

        Raises DataError: an axis of the machine is missing, or there is one that it has not.
        Raises InputError: positions that are not finite, or not one a row.
        """
        given = {letter.upper(): value for letter, value in positions.items()}
        for letter in self.letters:
            if letter not in given:
                raise DataError(
                    f"{letter.lower()}_deg: got none, expected the position of rotary axis "
                    f"{letter} ({self.name})"
                )
        spare = sorted(set(given) - set(self.letters))
        if spare:
            raise DataError(
                f"{spare[0].lower()}_deg: got positions of axis {spare[0]}, expected only those of "
                f"{self.name}"
            )
        columns = [floats(f"{letter.lower()}_deg", given[letter]) for letter in self.letters]
        count = max((c.size for c in columns), default=1) if rows is None else rows
        for letter, column in zip(self.letters, columns, strict=True):
            if column.ndim > 1 or (column.ndim == 1 and len(column) != count):
                raise InputError(
                    f"{letter.lower()}_deg: got shape {column.shape}, expected one number a row, "
                    f"({count},)"
                )
        if not columns:
            return np.zeros((count, 0))
        return np.column_stack([np.broadcast_to(c, count) for c in columns]) * self.senses

    def turned(self, senses: Mapping[str, ArrayLike], rows: int) -> Floats | None:
        """Senses of the last turn by letter, in machine order, (rows, axes); None without any.

        An axis that is not given has not turned.
        """
        given = {letter.upper(): value for letter, value in senses.items()}
        if not any(letter in given for letter in self.letters):
            return None
        columns = [np.asarray(given.get(x, 0.0), dtype=float) for x in self.letters]
        return np.column_stack([np.broadcast_to(c, rows) for c in columns]) * self.senses

    def to_control(self, rotary_deg: Floats) -> dict[str, Floats]:
        """Positions in machine order (n, axes) by letter, in the control's sign, (n,) each."""
        # + 0.0 turns -0.0 into 0.0, which would otherwise stand in files.
        turned = rotary_deg * self.senses + 0.0
        return {letter: turned[..., i] for i, letter in enumerate(self.letters)}

    # --- the core's machine

    def machine(self, errors: Mapping[str, float] | None = None) -> _core.Machine:
        """The core's kinematics with these location errors (µm, arcsec).

        None: those of the set-up; {}: the nominal machine.
        """
        given = self.setup.machine.errors if errors is None else errors
        known = self.location_errors
        named = {
            name if name in known else canonical_error_name(name): float(value)
            for name, value in given.items()
        }
        if not named:
            return self._nominal
        try:
            return self._description.core(self.setup.probe.length_mm, list(named.items()))
        except UnknownNameError:
            for name in named:
                check_error(
                    f"location error of machine {self.setup.machine.name}", name, self._nominal
                )
            raise

    def model(
        self,
        errors: Mapping[str, float],
        placement: Sequence[float],
        effects: Sequence[tuple[str, Sequence[float]]],
        approach: Sequence[float] = (0.0, 0.0, 0.0),
        senses: Mapping[str, float] | None = None,
    ) -> _core.MachineModel:
        """The core's machine with errors, placement of the work and effects.

        errors: Location errors, µm and arcsec.
        placement: Six numbers, as `PLACEMENT`.
        effects: Ids with the values of their parameters in order.
        approach, senses: Direction of travel (machine frame) and sense of the last turn by letter,
            control's sign, on which reversal errors depend.
        """
        turned = {letter.upper(): value for letter, value in (senses or {}).items()}
        for letter in turned:
            choose("senses", letter, self.letters)
        return _core.MachineModel(
            self._nominal,
            errors=list(errors.items()),
            placement=list(placement),
            effects=list(effects),
            direction=[float(value) for value in approach],
            sense=[turned.get(x, 0.0) * s for x, s in zip(self.letters, self.senses, strict=True)],
        )

    def table_pose(self, rotary_deg: Floats) -> tuple[Floats, Floats]:
        """Rotation (n, 3, 3) and shift (n, 3), mm, from the work to the frame, nominal machine."""
        rows = np.ascontiguousarray(rotary_deg, dtype=float)
        pose = self._nominal.table_pose(rows).reshape(-1, 3, 4)
        return pose[:, :, :3], pose[:, :, 3]

    # --- names

    @cached_property
    def location_errors(self) -> dict[str, str]:
        """Names of the machine's location errors, with their unit ("um", "arcsec")."""
        return dict(self._nominal.location_errors)

    @cached_property
    def artefact(self) -> _core.Artefact:
        """The core's artefact, where it nominally stands on the table.

        Raises InputError: a set-up without an artefact.
        """
        artefact = self.setup.artefact
        return _core.Artefact(
            *artefact_dimensions(self.setup),
            place_mm=artefact.effective_place_mm,
            turn_deg=artefact.turn_deg,
            stem_diameter_mm=artefact.effective_stem_diameter_mm,
            **artefact.obstacles,
            tolerance_mm=artefact.tolerance_mm,
            tolerance_deg=artefact.tolerance_deg,
        )

    def named_errors(self, errors: Mapping[str, float] | None) -> dict[str, float]:
        """Location errors under their canonical names; those of the set-up where not given.

        Raises InputError: one error under two spellings.
        Raises UnknownNameError: a name that is none, or an error that the machine lacks.
        """
        known = {canonical_error_name(k): float(v) for k, v in self.setup.machine.errors.items()}
        given: dict[str, float] = {}
        for spelling, value in (errors or {}).items():
            is_one = spelling in self.location_errors
            name = spelling if is_one else canonical_error_name(spelling)
            if name in given:
                raise InputError(f"location error {name}: got two spellings, expected it once")
            where = f"location error of machine {self.setup.machine.name}"
            given[name if is_one else check_error(where, name, self._nominal)] = value
        return known | given

    def catalogue(self) -> tuple[EffectInfo, ...]:
        """Every effect that can act on touches of this artefact on this machine."""
        return self._catalogue

    @cached_property
    def _catalogue(self) -> tuple[EffectInfo, ...]:
        return self._effects(*artefact_dimensions(self.setup))

    @cached_property
    def effects(self) -> dict[str, EffectInfo]:
        """Every effect on this machine, whatever is touched, by id."""
        # What an effect of an artefact does depends on its size, that there is such an effect does
        # not.
        kinds = [self._effects(kind, sizes) for kind, sizes in _core.artefact_kinds().items()]
        return {effect.id: effect for effects in kinds for effect in effects}

    def effect_id(self, name: str) -> str:
        """Id of an effect on touches that is given by its id or its code of ISO 230-1 (EC0Y).

        A name that is neither is returned as it is.

        Raises InputError: a code of several effects (ECC: once a turn, twice a turn).
        """
        if not is_code(name):
            return name
        ids = effect_ids(name, list(self.effects))
        if len(ids) > 1:
            raise InputError(f"effect: got {name!r}, expected one of {', '.join(ids)}")
        return ids[0] if ids else name

    def _effects(self, kind: str, dimensions: Sequence[float]) -> tuple[EffectInfo, ...]:
        entries = _core.catalogue(self._nominal, kind, dimensions)
        return tuple(
            EffectInfo(
                id=name,
                label=title,
                # what happens at a moment is of one set-up: the artefact shifts on the table
                owner=Owner.PLACEMENT if owner == "artefact" and needs else Owner(owner),
                parameters=tuple(ParameterInfo(*parameter) for parameter in parameters),
                needs=tuple(needs),
                codes=iso_codes(name),
            )
            for name, title, owner, parameters, needs in entries
        )


def artefact_dimensions(setup: Setup) -> tuple[str, list[float]]:
    """Kind of the artefact and its dimensions at its temperature, mm, as the core takes them.

    Raises InputError: a set-up without an artefact.
    """
    artefact, grown = setup.artefact, setup.artefact.growth
    if artefact.kind == "none":
        raise InputError(
            "artefact: got none in the set-up, expected [artefact] with kind "
            f"{', '.join(kind for kind in DIMENSIONS if kind != 'none')}"
        )
    if artefact.kind == "sphere":
        diameter, centre = artefact.diameter_mm, artefact.centre_mm
        if diameter is None or centre is None:
            raise InputError("sphere: got no diameter_mm or centre_mm, expected both")
        return "sphere", [diameter * grown, *centre]
    if artefact.kind == "spheres":
        diameter, spheres = artefact.diameter_mm, artefact.spheres_mm
        if diameter is None or spheres is None:
            raise InputError("spheres: got no diameter_mm or spheres_mm, expected both")
        return "spheres", [diameter * grown, *(x * grown for centre in spheres for x in centre)]
    if artefact.kind == "ring":
        diameter, outer = artefact.diameter_mm, artefact.outer_diameter_mm
        if diameter is None or outer is None:
            raise InputError("ring: got no diameter_mm or outer_diameter_mm, expected both")
        return "ring", [diameter * grown, outer * grown, artefact.height_mm * grown]
    sizes = artefact.length_mm, artefact.width_mm, artefact.height_mm
    return artefact.kind, [size * grown for size in sizes]
