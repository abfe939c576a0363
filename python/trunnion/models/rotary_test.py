"""R-tests and ball-bar tests of rotary axes on the diagnosis engine.

A reading is the measured displacement (R-test: three a row) or length (ball-bar) less that of the
machine as the set-up knows it, in µm. Always fitted: location errors of the machine, the place of
each ball, and what ``[rotary_test]`` of the set-up says is unknown. Effects of the machine are
those on touches: with the same id, parameters and sign, from the same model of the machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.errors import InputError
from trunnion.base.rows import equal_rows, repeats
from trunnion.base.statistics import MANY_ROWS
from trunnion.base.units import ARCSEC, Floats, Integers
from trunnion.data.rotary_test import RotaryTest
from trunnion.data.times import elapsed_s
from trunnion.diagnosis.effect import (
    Effect,
    EffectLike,
    EffectValues,
    Parameter,
    drift,
    linear,
    periodic,
)
from trunnion.diagnosis.model import TURNED, Covariate, Model, Nuisance, Readings, Uncertainty
from trunnion.diagnosis.own_effects import with_own
from trunnion.machine.effects import EffectInfo, Owner, senses
from trunnion.machine.estimate import Estimate
from trunnion.machine.geometry import made_with
from trunnion.models.ballbar.effects import MIN_REACH, ballbar_length
from trunnion.models.rotary.motions import MIN_OF_A_SENSE, periods
from trunnion.models.rotary_breaks import Shifts
from trunnion.models.rotary_sensors import Sensors
from trunnion.models.warming import warmup
from trunnion.probing.rotary_readings import (
    OFFSETS,
    TOOL,
    RotaryReadings,
    RotaryTestSettings,
    machine_effects,
    tool_mm,
)
from trunnion.setup import Setup

AXES = "XYZ"
STEP_DEG = 1e-3
"""Of a rotary axis, over which readings are differenced."""
SAME_PLACE = 1e-3
"""µm, arcsec: over so little derivatives change by 1e-8 of themselves."""
PARALLEL = 1.0 - 1e-9
"""Cosine from which a displacement enters in one way, whatever frame it is given in."""
MAX_KEPT = 2
"""Derivatives: where all fits start from, and the last."""
NOT_CATALOGUED = "the model of the machine has no such effect"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ExtendedRotaryTest(Estimate):
    """What a diagnosis of an R-test or a ball-bar test of rotary axes says of the machine.

    Attributes
    ----------
    setup
        The set-up of the measurement.
    """

    setup: Setup


class RotaryTestModel(Model):
    """Readings of an R-test or a ball-bar test, as the diagnosis engine asks for them.

    Effects enter linearly, as they do on the machine of the set-up: what errors of the machine
    change of that is their product, 0.005 µm of an effect of 10 µm beside a tilt of 100 arcsec.

    Raises DataError, InputError: as `identify_rotary_test`.
    """

    def __init__(
        self, data: RotaryTest, setup: Setup, effects: Sequence[EffectLike | str] = ()
    ) -> None:
        self.data = data
        self.setup = setup
        self._known = RotaryReadings.of(data, setup)
        measured = self._known.measured
        self._reference = self._known.modelled(self._known.start).ravel()
        sigma = RotaryTestSettings.from_setup(setup).repeatability_um
        self._each = measured.shape[1]
        self.readings = Readings(
            measured.ravel() - self._reference,
            np.repeat(np.arange(len(data)), self._each),
            sigma=np.full(measured.size, sigma) if sigma > 0 else None,
            recorded=(measured.ravel(),),
        )
        errors = self._known.chain.location_errors
        units = {"um": "µm"}
        at_start = self._known.jacobian(self._known.start)
        shown = np.abs(at_start).max(axis=0) > MIN_REACH
        names = self._known.names
        self._fitted = [k for k, name in enumerate(names) if name in errors or shown[k]]
        self.nuisance = tuple(
            Nuisance(names[k], units.get(errors[names[k]], errors[names[k]]), Owner.MACHINE)
            if names[k] in errors
            else Nuisance(names[k], "µm")
            for k in self._fitted
        )
        self._at = [(self.start, at_start[:, self._fitted])]
        self._given = tuple(effects)
        self._catalogue = _Catalogue(self._known, at_start)
        found = self._catalogue.effects()
        if self._catalogue.mirrored(found):
            found = []  # of such readings they would be no causes
        known = self._known.chain.effects
        self.effects = with_own(found, effects, data, known=known, described=self)

    # --- the plain model

    @property
    def start(self) -> Floats:
        """Location errors known beforehand, balls at their places."""
        return self._known.start[self._fitted]

    def _whole(self, nuisance: Floats) -> Floats:
        """All unknowns: an offset of a ball that its bars do not show is none."""
        values = np.zeros(len(self._known.names))
        values[self._fitted] = nuisance
        return values

    def base(self, nuisance: Floats) -> Floats:
        """Return readings without any effect, µm, exact."""
        return np.asarray(self._known.modelled(self._whole(nuisance)).ravel() - self._reference)

    def base_jacobian(self, nuisance: Floats) -> Floats:
        """Return their derivative (the last are kept, of many rows for what is next to them)."""
        near = SAME_PLACE if len(self.data) >= MANY_ROWS else 0.0
        known = next((one for one in self._at if np.all(np.abs(nuisance - one[0]) <= near)), None)
        if known is None:
            jacobian = self._known.jacobian(self._whole(nuisance))
            every = len(self._fitted) == jacobian.shape[1]
            known = nuisance.copy(), jacobian if every else jacobian[:, self._fitted]
        self._at = [known, *(one for one in self._at if one is not known)][:MAX_KEPT]
        return known[1]

    # --- what the engine looks for structure in

    @property
    def covariates(self) -> tuple[Covariate, ...]:
        """Positions of the rotary axes, senses of turning, places, balls, time or order."""
        data = self.data
        spread = [
            Covariate(f"{letter.upper()} position", np.asarray(deg), "deg", period=360.0)
            for letter, deg in data.rotary_deg.items()
        ]
        spread += [
            Covariate(f"sense of {letter.upper()}", senses(np.asarray(deg)), words=TURNED)
            for letter, deg in data.rotary_deg.items()
        ]
        moved = zip(AXES, data.position_mm.T, strict=True)
        spread += [Covariate(f"{axis} place", at, "mm") for axis, at in moved]
        if len(self._known.labels) > 1:
            spread.append(Covariate("ball", self._known.index, classes=True))
        if data.time_s is not None:
            spread.append(Covariate("time", np.asarray(data.time_s), "s", sequence=True))
        spread.append(Covariate("order of measurement", np.arange(len(data)), sequence=True))
        return tuple(replace(c, values=np.repeat(c.values, self._each)) for c in spread)

    @cached_property
    def components(self) -> Mapping[str, Floats]:
        """A displacement of the tool's point along X, Y, Z of the machine and of the table.

        And what changes the bar's length. A ball that slips moves on the table, and turns with it.
        """
        entering, ways = self._catalogue, np.eye(3)
        named = {name: entering.enters(-row) for name, row in zip(AXES, ways, strict=True)}
        for name, row in zip(AXES, ways, strict=True):
            column = entering.moved(np.broadcast_to(1e-3 * row, (len(self.data), 3)))
            if not any(_is_parallel(column, known) for known in named.values()):
                named[f"{name} of the table"] = column
        return named if self._each > 1 else {**named, "the length": np.ones(len(self.data))}

    @property
    def turning(self) -> Mapping[str, Floats]:
        """As each rotary axis stands further, from the model of the machine."""
        entering, letters = self._catalogue, self._known.chain.letters
        return {x: entering.further(len(AXES) + k) for k, x in enumerate(letters)}

    @property
    def replicates(self) -> Integers | None:
        """Readings of one ball at one command, the rotary axes turned to it in the same sense."""
        turned = [np.asarray(deg) for deg in self.data.rotary_deg.values()]
        parts = [
            *np.round(self.data.position_mm.T, 4),
            *(np.round(deg, 6) for deg in turned),
            *(senses(deg) for deg in turned),
            self._known.index.astype(float),
        ]
        return repeats(parts, self._each)

    # --- what a user gets

    def bind(self, data: Any) -> RotaryTestModel:
        """Return the same model on other readings."""
        if not isinstance(data, RotaryTest):
            raise InputError(f"other data: got {type(data).__name__}, expected trunnion.RotaryTest")
        return RotaryTestModel(data, self.setup, self._given)

    def extended(
        self, nuisance: Floats, effects: EffectValues, uncertainty: Uncertainty | None = None
    ) -> ExtendedRotaryTest:
        """Return errors, offsets and effects by name, with the set-up."""
        named = {n.name: float(v) for n, v in zip(self.nuisance, nuisance, strict=True)}
        errors = self._known.chain.location_errors
        return ExtendedRotaryTest(
            setup=self.setup,
            errors={k: v for k, v in named.items() if k in errors},
            placement={k: v for k, v in named.items() if k not in errors},
            **made_with(self.setup, self.data),
            **self.estimated(effects, uncertainty, NOT_CATALOGUED, self._known.chain.effects),
        )


class _Catalogue:
    """Candidate causes of these readings, on the machine of the set-up."""

    def __init__(self, known: RotaryReadings, at_start: Floats) -> None:
        """``at_start``: derivatives by all unknowns of the plain model, (readings, unknowns)."""
        self._known = known
        self._at_start = at_start
        self._data = known.data
        chain = known.chain
        self._errors = chain.named_errors(None)
        self._axes = known.axes
        # Runs go to the same positions again: what only hangs on these is worked out once in each.
        self._at_stop, first = equal_rows(list(known.axes.T))
        self._stops = known.axes[first]
        self._relation = known.relation(known.start)
        apart = known.apart_um(known.start, self._relation)
        self._bar = None
        if known.data.displacement_um is None:
            self._bar = apart / np.linalg.norm(apart, axis=1, keepdims=True)

    def effects(self) -> list[Effect]:
        """Those of the machine as on touches, cyclic errors, drift, bar and tool's point."""
        chain, data = self._known.chain, self._data
        made = [self._of_machine(info) for info in machine_effects(chain).values()]
        for number, letter in enumerate((*AXES, *chain.letters)):
            made += self._of_axis(number, letter)
        if data.time_s is not None and np.ptp(data.time_s) > 0:
            made += self._of_time(elapsed_s(data.time_s))
            made += self._of_breaks(data.time_s)
        if self._bar is not None and self._known.bar_is_known:
            made.append(ballbar_length(len(data)))
        if self._known.tool_is_known:
            made.append(self._of_tool())
        if self._bar is None:
            made += self._sensors.effects()
        return made

    @cached_property
    def _sensors(self) -> Sensors:
        known = self._known
        return Sensors.of(known.measured, known.modelled(known.start), self._at_start)

    def mirrored(self, effects: Sequence[Effect]) -> bool:
        """Whether a reading of an R-test counts the other way, as no effect makes it."""
        return self._bar is None and self._sensors.mirrored(effects)

    def _of_tool(self) -> Effect:
        """Set-up of the tool's point: its errors are those of both axes together, alone."""
        columns = np.column_stack([self.enters(-row) for row in np.eye(3)])
        label = "offset of the tool's point from where the control has it"
        return linear(TOOL, OFFSETS, columns, label, owner=Owner.INSTRUMENT)

    def _of_time(self, seconds: Floats) -> Iterator[Effect]:
        """Drift and warm-up along X, Y, Z."""
        hours = np.repeat(seconds / 3600.0, 3 // self._narrow)
        for name, row in zip("xyz", np.eye(3), strict=True):
            along, enters = f"along {name.upper()} between tool and ball", self.enters(-row)
            yield drift(
                f"drift_{name}", "rate_um_h", hours, enters, f"drift {along}", owner=Owner.TIME
            )
            yield warmup(
                f"warmup_{name}", "amplitude_um", 60.0 * hours, enters, f"warm-up {along}",
                owner=Owner.TIME,
            )  # fmt: skip

    def _of_breaks(self, time_s: Floats) -> Iterator[Effect]:
        """Shifts in a break."""
        known = self._known
        units = known.chain.location_errors
        # the axis next to the table first: of others it leaves what differs from these
        carried = {
            name: self._at_start[:, known.names.index(name)]
            for name in reversed(units)
            if units[name] == "um"
        }
        table = [self.moved(np.broadcast_to(1e-3 * row, (len(self._data), 3))) for row in np.eye(3)]
        ways = {x: self.enters(-row) for x, row in zip("xyz", np.eye(3), strict=True)}
        shifts = Shifts(time_s, 3 // self._narrow, self._at_start)
        return shifts.effects(ways, carried, -np.column_stack(table))

    @property
    def _narrow(self) -> int:
        """3 of a ball-bar, which has one reading in the place of three."""
        return 1 if self._bar is None else 3

    def enters(self, apart_um: Floats) -> Floats:
        """Change of the readings as ball and tool come apart by this, (n, 3) or (3,), µm."""
        apart = np.broadcast_to(apart_um, (len(self._data), 3))
        if self._bar is None:
            return apart.reshape(-1)
        return np.asarray(np.einsum("ni,ni->n", self._bar, apart))

    def moved(self, tool_mm: Floats) -> Floats:
        """Change of the readings as the tool's point moves by this, table's frame, (n, 3)."""
        return self.enters(-1e3 * np.einsum("nki,ni->nk", self._relation.directions, tool_mm))

    def _of_machine(self, info: EffectInfo) -> Effect:
        """An effect of the catalogue of touches; all of them are linear."""
        columns = []
        for one in np.eye(len(info.parameters)):
            there, back = (
                tool_mm(self._known.chain, self._stops, self._errors, [(info.id, values)])
                for values in (one.tolist(), (-one).tolist())
            )
            columns.append(self.moved((there - back)[self._at_stop] / 2))
        names = [p.name for p in info.parameters]
        return linear(info.id, names, np.column_stack(columns), info.label)

    def further(self, number: int) -> Floats:
        """Change of the readings as an axis stands further by 1 µm or 1 arcsec."""
        step = np.zeros(self._axes.shape[1])
        step[number] = STEP_DEG
        machine = self._known.chain.machine(self._errors)
        there, back = (machine.forward(self._axes + s * step)[:, :3] for s in (1.0, -1.0))
        unit = np.degrees(ARCSEC) if number > 2 else 1e-3
        return self.moved((there - back) / (2 * STEP_DEG) * unit)

    def _of_axis(self, number: int, letter: str) -> list[Effect]:
        """Backlash of an axis that comes from both senses; a cyclic error of a rotary one."""
        column = self.further(number)
        name, made = letter.lower(), []
        sense = senses(np.round(self._axes[:, number], 4))
        if min(np.sum(sense > 0), np.sum(sense < 0)) >= MIN_OF_A_SENSE:
            named = (f"{name}_backlash", "b_arcsec") if number > 2 else (f"backlash_{name}", "b_um")
            half = -0.5 * np.repeat(sense, 3 // self._narrow)
            made.append(
                linear(named[0], [named[1]], half * column, f"backlash of the {letter} axis")
            )
        if number > 2:
            place = self._axes[:, number]
            if grid := periods(np.unique(np.round(place, 6)), closed=True):
                period = Parameter("period_deg", grid=grid, bounds=(grid[-1], grid[0] * 1.2))
                label = f"cyclic positioning error of the {letter} axis"
                parts = [(np.repeat(place, 3 // self._narrow), column)]
                made.append(periodic(f"{name}_cyclic", period, parts, label, unit="arcsec"))
        return made


def _is_parallel(a: Floats, b: Floats) -> bool:
    """Whether two columns are one but for their sign and length."""
    return bool(abs(a @ b) >= PARALLEL * np.linalg.norm(a) * np.linalg.norm(b))


@checked
def build(
    data: RotaryTest, setup: Setup | None, effects: Sequence[EffectLike | str] = ()
) -> RotaryTestModel:
    """Build the model of a test of rotary axes; the set-up is needed."""
    if setup is None:
        raise InputError(
            "setup: missing, expected a set-up (TOML) with the machine of these readings "
            "(trunnion init writes one)"
        )
    return RotaryTestModel(data, setup, effects)
