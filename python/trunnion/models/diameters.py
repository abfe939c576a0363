"""Diameters of turned passes as the diagnosis sees them: one offset a pass, and named causes.

::

    error = offset of the pass + sum of causes + noise

The offset of a pass is the setting of the tool: it is always fitted, so that a constant says
nothing about a cause. The causes (formulas in ``trunnion_core::turning::diameter``), with s the
length cut in the pass, t its cutting time from a cold tool, z the distance from the chuck face, L
the overhang:

==============  ==========================================  ============================
id              error of the diameter                       parameters
==============  ==========================================  ============================
tool_heating    -E (1 - exp(-t/τ))                          amplitude_um E, tau_s τ
tool_wear       +q t                                        rate_um_min q
taper           +2 α z                                      angle_arcsec α
bending         +B (z/L)³ f d⁻⁴                             tip_um B
chuck_tilt      +B (z/L)² f                                 tip_um B
barrel          +4 M (z/L)(1 - z/L)                         middle_um M
chatter         a cos(2π s/p) + b sin(2π s/p)               a_um, b_um, pitch_mm p
==============  ==========================================  ============================

f is the depth of cut, d the diameter, each over that of the first row. With several kinds of
coolant tool_heating has an amplitude for each (``amplitude_<coolant>_um``), with several passes
chatter an a and b for each (``a_<pass>_um``). Where neither the data nor the set-up file tell the
time, the length cut takes its place: ``tau_mm`` and ``rate_um_m``.

Keys of ``[turning]`` in the set-up file, read here:

====================  ====================================================================
overhang_mm           from the chuck face to the free end; always wanted
feed_mm_rev           feed per revolution
cutting_speed_m_min   constant surface speed, or
spindle_rpm           constant spindle speed (a column of the data goes before both)
diameter_mm           nominal diameter, where the data have no such column
====================  ====================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from trunnion._core import turning_cause
from trunnion.base.errors import DataError, UnknownNameError
from trunnion.data.diameters import Diameters
from trunnion.diagnosis.protocol import (
    Covariate,
    Effect,
    EffectLike,
    LinearModel,
    Model,
    Nuisance,
    Parameter,
    Readings,
    Uncertainty,
    as_effect,
)
from trunnion.machine.estimate import Estimate
from trunnion.models.candidates import for_compensation
from trunnion.setup import Setup
from trunnion.setup.fields import Number, Part, Section, key

__all__ = ["CAUSES", "Conditions", "DiameterLaw", "build", "conditions"]

Array = npt.NDArray[np.float64]

# Grids from which the engine refines, so fine that what a grid point misses of a strong cause
# (45 µm, noise 0.5 µm) stays below the noise: else it would be named as a cause of its own.
TIME_CONSTANTS = 60
WAVE_STEP = 0.125

# More is a slip: a diameter itself, or another unit.
MOST_ERROR_UM = 5000.0

# Every tool wears while it cuts. Beside a tool that heats up the wear of one pass is hardly seen:
# what is left of it once amplitude and time constant are fitted anew is below the noise.
LEAST_WEAR_UM = 2.0
OF_TURNING = "it acts while a lathe cuts: correct the program or the next pass (tn.next_passes)"

CAUSES = {
    "tool_heating": "the tool heats up and grows",
    "tool_wear": "the tool wears",
    "taper": "the slide is not parallel to the spindle",
    "bending": "the part bends away from the tool",
    "chuck_tilt": "chuck and spindle tilt under the cut",
    "barrel": "the slide is bent",
    "chatter": "the cut chatters",
}


POSITIVE = Number(positive=True)


@dataclass(frozen=True)
class Conditions(Part):
    """What the set-up file's table ``[turning]`` says of a cut; None where it says nothing."""

    table: ClassVar[str] = "turning"
    overhang_mm: float = key(..., POSITIVE, "from the chuck face to the free end")
    feed_mm_rev: float | None = key(None, POSITIVE, "feed per revolution")
    cutting_speed_m_min: float | None = key(None, POSITIVE, "constant surface speed")
    spindle_rpm: float | None = key(None, POSITIVE, "constant spindle speed")
    diameter_mm: float | None = key(None, POSITIVE, "nominal diameter")


def conditions(setup: Setup | Conditions | None) -> Conditions:
    """Read ``[turning]`` of a set-up.

    Raises
    ------
    FileFormatError, InputError
        No overhang, a key that is not known, or a value that is no number above zero; with its
        place in the file of the set-up.
    """
    if isinstance(setup, Conditions):
        return setup
    return Section.of("turning", {} if setup is None else setup.turning).build(Conditions)


@dataclass(frozen=True)
class _Reference:
    """The cut to which forces and diameters are compared, and what names the parameters."""

    depth_mm: float
    diameter_mm: float
    passes: tuple[str, ...]
    coolants: tuple[str, ...]
    timed: bool


def _labels(values: npt.NDArray[Any] | None, count: int) -> npt.NDArray[np.str_]:
    return np.full(count, "1") if values is None else np.asarray(values).astype(str)


def _in_order(labels: npt.NDArray[np.str_]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(labels.tolist()))


def _reference(data: Diameters, told: Conditions) -> _Reference:
    n = len(data)
    depth, diameter = data.depth_mm, data.diameter_mm
    return _Reference(
        depth_mm=float(depth[0]) if depth is not None and depth[0] > 0 else 1.0,
        diameter_mm=float(diameter[0]) if diameter is not None else told.diameter_mm or 1.0,
        passes=_in_order(_labels(data.pass_, n)),
        coolants=_in_order(_labels(data.coolant, n)),
        timed=_seconds(data, told, np.zeros(n)) is not None,
    )


def _seconds(data: Diameters, told: Conditions, length_mm: Array) -> Array | None:
    """Cutting time within the pass: as recorded, or from feed and speed; None if nothing tells."""
    if data.time_s is not None:
        return np.asarray(data.time_s, dtype=np.float64)
    if told.feed_mm_rev is None:
        return None
    if data.spindle_rpm is not None:
        rpm = np.asarray(data.spindle_rpm, dtype=np.float64)
        if not (rpm > 0).all():
            row = int(np.argmin(rpm > 0))
            raise DataError(
                f"spindle_rpm ({data.place(row)}): got {rpm[row]}, expected more than 0"
            )
    elif told.spindle_rpm is not None:
        rpm = np.full(len(data), told.spindle_rpm)
    else:
        diameter = data.diameter_mm if data.diameter_mm is not None else told.diameter_mm
        if told.cutting_speed_m_min is None or diameter is None:
            return None
        rpm = 1e3 * told.cutting_speed_m_min / (np.pi * np.asarray(diameter, dtype=np.float64))
    seconds: Array = length_mm / (told.feed_mm_rev * rpm / 60.0)
    return seconds


def _cuts(data: Diameters, told: Conditions, reference: _Reference) -> Array:
    """Rows of ``turning_cause``: z, length cut, time, force, diameter."""
    n = len(data)
    z = np.asarray(data.z_mm, dtype=np.float64)
    sign = np.full(n, -1) if data.feed_sign is None else data.feed_sign
    length = np.where(sign < 0, told.overhang_mm - z, z)
    time = _seconds(data, told, length) if reference.timed else length
    if time is None:
        raise DataError("these diameters have no time, and the model was made from some that have")
    depth, diameter = data.depth_mm, data.diameter_mm
    force = np.ones(n) if depth is None else np.asarray(depth) / reference.depth_mm
    size = np.ones(n) if diameter is None else np.asarray(diameter) / reference.diameter_mm
    return np.ascontiguousarray(np.c_[z, length, time, force, size], dtype=np.float64)


class _Cause:
    """One cause of the core, spread over passes or coolants where it has to be."""

    def __init__(self, name: str, told: Conditions, reference: _Reference) -> None:
        self.name, self.told, self.reference = name, told, reference
        self.classes: tuple[str, ...] = ()
        if name == "chatter" and len(reference.passes) > 1:
            self.classes = reference.passes
        if name == "tool_heating" and len(reference.coolants) > 1:
            self.classes = reference.coolants

    def parameters(self, data: Diameters) -> tuple[Parameter, ...]:
        """Names, units and grids."""
        timed = self.reference.timed
        own, shared = {
            "tool_heating": (["amplitude_um"], ["tau_s" if timed else "tau_mm"]),
            "tool_wear": (["rate_um_min" if timed else "rate_um_m"], []),
            "taper": (["angle_arcsec"], []),
            "bending": (["tip_um"], []),
            "chuck_tilt": (["tip_um"], []),
            "barrel": (["middle_um"], []),
            "chatter": (["a_um", "b_um"], ["pitch_mm"]),
        }[self.name]
        if self.classes:
            own = [p.replace("_um", f"_{label}_um") for label in self.classes for p in own]
        units = {"rate_um_min": "µm/min", "rate_um_m": "µm/m"}
        return tuple(Parameter(name, units.get(name, "")) for name in own) + tuple(
            Parameter(name, grid=self._grid(data), bounds=(1e-3, np.inf)) for name in shared
        )

    def _grid(self, data: Diameters) -> tuple[float, ...]:
        cuts = _cuts(data, self.told, self.reference)
        if self.name == "tool_heating":
            longest = max(float(np.ptp(cuts[:, 2])), 1e-6)
            return tuple(np.geomspace(longest / 15, 2 * longest, TIME_CONSTANTS).tolist())
        # From two waves over the part to what two and a half readings still show.
        span = max(float(np.ptp(cuts[:, 1])), 1e-6)
        most = max(2.5, len(np.unique(np.round(cuts[:, 1], 6))) / 2.5)
        waves = np.arange(2.0, min(most, 100.0), WAVE_STEP)
        return tuple((span / waves[::-1]).tolist())

    def _blocks(self, data: Diameters) -> list[npt.NDArray[np.bool_]]:
        n = len(data)
        if not self.classes:
            return [np.ones(n, dtype=bool)]
        labels = _labels(data.pass_ if self.name == "chatter" else data.coolant, n)
        strange = sorted(set(labels.tolist()) - set(self.classes))
        if strange and self.name == "tool_heating":
            known = ", ".join(self.classes)
            raise DataError(f"coolant: got {strange[0]!r}, wanted one that was measured: {known}")
        return [labels == label for label in self.classes]

    def _evaluate(self, data: Diameters, values: Mapping[str, float]) -> tuple[Array, Array]:
        cuts = _cuts(data, self.told, self.reference)
        numbers = [float(value) for value in values.values()]
        # Without a clock 1 mm counts as 1 s: µm/m is then 0.06 µm/min.
        scale = 0.06 if self.name == "tool_wear" and not self.reference.timed else 1.0
        own = 2 if self.name == "chatter" else 1
        blocks = self._blocks(data)
        shared = numbers[own * len(blocks) :]
        change = np.zeros(len(data))
        slopes = np.zeros((len(data), len(numbers)))
        for i, rows in enumerate(blocks):
            mine = numbers[own * i : own * (i + 1)]
            error, slope = turning_cause(
                self.name, cuts[rows], self.told.overhang_mm, [scale * v for v in mine] + shared
            )
            change[rows] = error
            slopes[rows, own * i : own * (i + 1)] = scale * slope[:, :own]
            slopes[rows, own * len(blocks) :] = slope[:, own:]
        return change, slopes

    def change(self, data: Diameters, values: Mapping[str, float]) -> Array:
        """Change of each reading, µm on the diameter."""
        return self._evaluate(data, values)[0]

    def jacobian(self, data: Diameters, values: Mapping[str, float]) -> Array:
        """Derivative of `change` by the parameters, exact."""
        return self._evaluate(data, values)[1]

    def effect(self, data: Diameters) -> Effect:
        """As the engine wants it."""
        return Effect(
            self.name,
            self.parameters(data),
            self.change,
            self.jacobian,
            words=CAUSES[self.name],
            least=self._least(data),
        )

    def _least(self, data: Diameters) -> dict[str, float] | None:
        """Wear that matters, over the longest pass; the other causes have to show themselves."""
        if self.name != "tool_wear":
            return None
        time = _cuts(data, self.told, self.reference)[:, 2]
        labels = _labels(data.pass_, len(data))
        longest = max(float(np.ptp(time[labels == label])) for label in _in_order(labels))
        if self.reference.timed:
            return {"rate_um_min": 60.0 * LEAST_WEAR_UM / max(longest, 1e-6)}
        return {"rate_um_m": 1e3 * LEAST_WEAR_UM / max(longest, 1e-6)}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DiameterLaw(Estimate):
    """The extended model of a diagnosis of diameters: what a planned pass would come out as.

    Attributes
    ----------
    offset_um : dict
        Fitted offset of each pass that was measured.
    """

    offset_um: Mapping[str, float]
    causes: Mapping[str, Callable[[Any, Mapping[str, float]], npt.ArrayLike]] = field(
        compare=False, repr=False
    )

    def error_um(self, planned: Diameters, *, offset_of: object = None) -> Array:
        """Predict the error of the diameter along a planned pass.

        Parameters
        ----------
        planned
            Places and conditions of the pass (its ``error_um`` is not looked at).
        offset_of
            Label of the measured pass whose tool setting is kept. By default no offset is added:
            the tool is set where the causes are zero.

        Raises
        ------
        trunnion.UnknownNameError
            No measured pass of that label.
        """
        error = np.zeros(len(planned))
        if offset_of is not None:
            if str(offset_of) not in self.offset_um:
                known = ", ".join(self.offset_um)
                raise UnknownNameError(f"pass {offset_of!r}: wanted one of {known}")
            error += self.offset_um[str(offset_of)]
        for name, values in self.effects.items():
            error += np.asarray(self.causes[name](planned, values), dtype=np.float64)
        return error


class _DiameterModel(LinearModel):
    """Adds the law in the form it is used with."""

    def extended(
        self,
        nuisance: Array,
        effects: Mapping[str, Mapping[str, float]],
        uncertainty: Uncertainty | None = None,
    ) -> DiameterLaw:
        """Return offsets and causes."""
        names = (n.name.removeprefix("offset_").removesuffix("_um") for n in self.nuisance)
        return DiameterLaw(
            offset_um=dict(zip(names, map(float, nuisance), strict=True)),
            effects={k: dict(v) for k, v in effects.items()},
            causes={e.id: e.change for e in self.effects if e.id in effects},
            **for_compensation(self.effects, effects, (), OF_TURNING),
            **({} if uncertainty is None else uncertainty.fields()),
        )


def build(
    data: Diameters,
    setup: Setup | Conditions | None,
    effects: Sequence[EffectLike | str] = (),
    *,
    reference: _Reference | None = None,
) -> Model:
    """Make the model of measured diameters.

    Parameters
    ----------
    data
        One or more passes.
    setup
        With a table ``[turning]``.
    effects
        A user's own candidates; ids of the catalogue are in it already.

    Raises
    ------
    DataError
        Too few readings in a pass, readings beyond the overhang or of more than 5 mm.
    InputError, UnknownNameError
        As `conditions`, and for an id that is in no catalogue.
    """
    told = conditions(setup)
    z = np.asarray(data.z_mm, dtype=np.float64)
    if (z > told.overhang_mm + 1e-6).any():
        row = int(np.argmax(z))
        raise DataError(
            f"z_mm ({data.place(row)}): got {z[row]}, expected at most the overhang, "
            f"{told.overhang_mm} mm"
        )
    error = np.asarray(data.error_um, dtype=np.float64)
    if (np.abs(error) > MOST_ERROR_UM).any():
        row = int(np.argmax(np.abs(error)))
        raise DataError(
            f"error_um ({data.place(row)}): got {error[row]}, expected measured minus nominal "
            "diameter, µm, "
            f"within ±{MOST_ERROR_UM:g}"
        )
    reference = reference or _reference(data, told)
    labels = _labels(data.pass_, len(data))
    passes = _in_order(labels)
    for label in passes:
        if (count := int((labels == label).sum())) < 4:
            raise DataError(f"pass {label}: got {count} readings, wanted at least 4")
    own: list[Effect] = []
    for thing in effects:
        if not isinstance(thing, str):
            own.append(as_effect(thing))
        elif thing not in CAUSES:
            raise UnknownNameError(f"effect {thing!r}: wanted one of {', '.join(CAUSES)}")
    along = _cuts(data, told, reference)[:, 2]
    time = Covariate("cutting time" if reference.timed else "length cut", along, "s")
    covariates = [
        Covariate("position along the part", z, "mm"),
        time if reference.timed else replace(time, unit="mm"),
    ]
    if len(passes) > 1:
        covariates.append(Covariate("pass", labels, classes=True))
    order = Covariate("order of measurement", np.arange(len(data), dtype=float), sequence=True)
    # Blocks of five along each pass, the same places together, are left out as a whole.
    place = np.clip((5 * (z - z.min()) / max(float(np.ptp(z)), 1e-9)).astype(int), 0, 4)
    return _DiameterModel(
        data=data,
        readings=Readings(error, rows=np.arange(len(data)), unit="µm"),
        nuisance=[Nuisance(f"offset_{label}_um", "µm") for label in passes],
        design=(labels[:, None] == np.array(passes)[None, :]).astype(float),
        effects=[_Cause(name, told, reference).effect(data) for name in CAUSES] + own,
        covariates=[*covariates, order],
        groups=place,
        binder=partial(_bound, setup=told, effects=tuple(effects), reference=reference),
    )


def _bound(
    data: Diameters,
    *,
    setup: Conditions,
    effects: Sequence[EffectLike | str],
    reference: _Reference,
) -> Model:
    return build(data, setup, effects, reference=reference)
