"""Diameters of turned passes as the diagnosis sees them: one offset a pass, and named causes.

::

    error = offset of the pass + sum of causes + noise

The offset of a pass is the setting of the tool: it is always fitted, so that a constant says
nothing about a cause. The causes are in the core (``trunnion_core::turning::diameter``), formulas
and parameters in docs/reference/effects.md, the keys of ``[turning]`` in `Conditions`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from trunnion._core import turning_cause
from trunnion.base.arguments import checked
from trunnion.base.checks import choose
from trunnion.base.errors import DataError, InputError
from trunnion.base.rows import where
from trunnion.base.units import Floats, Integers
from trunnion.data.diameters import Diameters
from trunnion.diagnosis.classes import waves_in_classes
from trunnion.diagnosis.effect import Effect, EffectLike, EffectValues, Parameter, Values
from trunnion.diagnosis.linear_model import LinearModel
from trunnion.diagnosis.model import FINEST_NOISE, Covariate, Nuisance, Readings, Uncertainty
from trunnion.diagnosis.noise_in_runs import noise_in_runs
from trunnion.diagnosis.own_effects import with_own
from trunnion.diagnosis.ways import Description
from trunnion.machine.estimate import Estimate
from trunnion.models.depth_of_cut import in_proportion
from trunnion.models.passes import along_passes, check_passes, in_order, labels_of
from trunnion.setup import Setup
from trunnion.setup.fields import COORDINATE, Number, Part, Section, Vector, key

# Grids from which the engine refines, so fine that what a grid point misses of a strong cause
# (45 µm, noise 0.5 µm) stays below the noise: else it would be named as a cause of its own.
TIME_CONSTANTS = 60
WAVE_STEP = 0.125

# Every tool wears while it cuts. Beside a tool that heats up the wear of one pass is hardly seen:
# what is left of it once amplitude and time constant are fitted anew is below the noise.
MIN_WEAR_UM = 2.0

OF_TURNING = "it acts while a lathe cuts: correct the program or the next pass (tn.next_passes)"

# A worn tool cuts a thicker part, a cut presses the part away, no tool shrinks as it warms.
ONE_SIGN = frozenset(("tool_wear", "bending", "chuck_tilt", "tool_heating"))

CAUSES = {
    "tool_heating": "thermal growth of the tool",
    "tool_wear": "wear of the tool",
    "taper": "taper (slide not parallel to the spindle)",
    "bending": "bending of the part away from the tool",
    "chuck_tilt": "tilt of chuck and spindle under the cut",
    "barrel": "barrel (bent slide)",
    "workpiece_heating": "thermal growth of the workpiece",
    "block_acceleration": "acceleration at the starts of blocks",
    "chatter": "chatter of the cut",
}
"""Id → label."""


FAR_MM = 1e9
"""Distance to the nearest start of a block where none is stated."""
MIN_DIAMETER_RANGE = 1.1
"""On diameters that differ less, a part that grows looks like a tool that grows."""

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
    blocks_mm: tuple[float, ...] = key(
        (), Vector(0, COORDINATE), "z where blocks of the program start along the part"
    )

    def __post_init__(self) -> None:
        """Check every field, and that none contradicts another or is for nothing."""
        super().__post_init__()
        for name in ("cutting_speed_m_min", "spindle_rpm"):
            speed = getattr(self, name)
            if speed is not None and self.feed_mm_rev is None:
                limit = f"a finite number above 0 beside turning.{name} = {speed:g}: together they"
                raise self.refuse("feed_mm_rev", f"{limit} say how long the cut takes")
        if self.cutting_speed_m_min is not None and self.spindle_rpm is not None:
            limit = f"none beside turning.cutting_speed_m_min = {self.cutting_speed_m_min:g}"
            raise self.refuse("spindle_rpm", f"{limit}: give one of the two")


def conditions_of(setup: Setup | Conditions | None) -> Conditions:
    """Read ``[turning]`` of a set-up.

    Raises FileFormatError, InputError: no overhang, a key that is not known, or a value that is no
        number above zero; with its place in the file of the set-up.
    """
    if isinstance(setup, Conditions):
        return setup
    if setup is None:
        raise InputError(
            "setup: missing, expected a set-up (TOML) with a table [turning] and its overhang_mm, "
            "from the chuck face to the free end"
        )
    return Section.of("turning", setup.turning).build(Conditions)


@dataclass(frozen=True)
class _Reference:
    """The cut to which forces and diameters are compared, and what names the parameters."""

    depth_mm: float
    diameter_mm: float
    passes: tuple[str, ...]
    coolants: tuple[str, ...]
    timed: bool


def _reference(data: Diameters, conditions: Conditions) -> _Reference:
    n = len(data)
    depth, diameter = data.depth_mm, data.diameter_mm
    return _Reference(
        depth_mm=float(depth[0]) if depth is not None and depth[0] > 0 else 1.0,
        diameter_mm=float(diameter[0]) if diameter is not None else conditions.diameter_mm or 1.0,
        passes=in_order(labels_of(data.pass_, n)),
        coolants=in_order(labels_of(data.coolant, n)),
        timed=_seconds(data, conditions, np.zeros(n)) is not None,
    )


def _seconds(data: Diameters, conditions: Conditions, length_mm: Floats) -> Floats | None:
    """Cutting time within the pass: as recorded, or from feed and speed; None if unknown."""
    if data.time_s is not None:
        return np.asarray(data.time_s, dtype=np.float64)
    if conditions.feed_mm_rev is None:
        return None
    if data.spindle_rpm is not None:
        rpm = np.asarray(data.spindle_rpm, dtype=np.float64)
        if not (rpm > 0).all():
            row = int(np.argmin(rpm > 0))
            raise DataError(
                f"spindle_rpm ({data.place(row)}): got {rpm[row]}, expected more than 0"
            )
    elif conditions.spindle_rpm is not None:
        rpm = np.full(len(data), conditions.spindle_rpm)
    else:
        diameter = data.diameter_mm if data.diameter_mm is not None else conditions.diameter_mm
        if conditions.cutting_speed_m_min is None or diameter is None:
            return None
        rpm = (
            1e3 * conditions.cutting_speed_m_min / (np.pi * np.asarray(diameter, dtype=np.float64))
        )
    seconds: Floats = length_mm / (conditions.feed_mm_rev * rpm / 60.0)
    return seconds


def _cuts(data: Diameters, conditions: Conditions, reference: _Reference) -> Floats:
    """Rows of ``turning_cause``: z, length cut, time, force, diameter, way to a block's start."""
    n = len(data)
    z = np.asarray(data.z_mm, dtype=np.float64)
    sign = np.full(n, -1) if data.feed_sign is None else data.feed_sign
    length = np.where(sign < 0, conditions.overhang_mm - z, z)
    time = _seconds(data, conditions, length) if reference.timed else length
    if time is None:
        raise DataError("these diameters have no time, and the model was made from some that have")
    depth, diameter = data.depth_mm, data.diameter_mm
    force = np.ones(n) if depth is None else np.asarray(depth) / reference.depth_mm
    size = np.ones(n) if diameter is None else np.asarray(diameter) / reference.diameter_mm
    away = np.abs(z[:, None] - np.array(conditions.blocks_mm or (FAR_MM,))).min(axis=1)
    return np.ascontiguousarray(np.c_[z, length, time, force, size, away], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Cause:
    """One cause of the core in these passes, spread over passes or coolants where it has to be.

    cuts: Rows of ``turning_cause``, which all causes share.
    """

    name: str
    data: Diameters
    conditions: Conditions
    reference: _Reference
    cuts: Floats

    @property
    def classes(self) -> tuple[str, ...]:
        """Labels of the passes or coolants that have a size of their own; empty: one for all."""
        labels = {"chatter": self.reference.passes, "tool_heating": self.reference.coolants}
        own = labels.get(self.name, ())
        return own if len(own) > 1 else ()

    def parameters(self) -> tuple[Parameter, ...]:
        """Names, units and grids."""
        timed = self.reference.timed
        own, shared = {
            "tool_heating": (["amplitude_um"], ["tau_s" if timed else "tau_mm"]),
            "tool_wear": (["rate_um_min" if timed else "rate_um_m"], []),
            "taper": (["angle_arcsec"], []),
            "bending": (["tip_um"], []),
            "chuck_tilt": (["tip_um"], []),
            "barrel": (["middle_um"], []),
            "workpiece_heating": (["amplitude_um"], ["tau_s" if timed else "tau_mm"]),
            "block_acceleration": (["amplitude_um"], ["way_mm"]),
            "chatter": (["a_um", "b_um"], ["pitch_mm"]),
        }[self.name]
        if self.classes:
            own = [p.replace("_um", f"_{label}_um") for label in self.classes for p in own]
        least = 0.0 if self.name in ONE_SIGN else -np.inf
        return tuple(Parameter(name, bounds=(least, np.inf)) for name in own) + tuple(
            Parameter(name, grid=self._grid(), bounds=(1e-3, np.inf)) for name in shared
        )

    def _grid(self) -> tuple[float, ...]:
        cuts = self.cuts
        if self.name == "block_acceleration":
            pitch = float(np.median(np.diff(np.unique(cuts[:, 0])))) if len(cuts) > 1 else 0.1
            return tuple(
                np.geomspace(2 * pitch, max(20 * pitch, 5.0), TIME_CONSTANTS // 2).tolist()
            )
        if self.name.endswith("heating"):
            # A pass on a tool that was warm before makes the time of all passes long.
            longest = max(float(np.ptp(cuts[:, 2])), 1e-6)
            low, high = max(self._pass_time(), 1e-6) / 15, 2 * longest
            count = TIME_CONSTANTS * np.log(high / low) / np.log(30.0)
            return tuple(np.geomspace(low, high, int(np.ceil(count - 1e-9))).tolist())
        # From two waves over the part to what two and a half readings of one pass still show.
        span = max(float(np.ptp(cuts[:, 1])), 1e-6)
        places = [np.unique(np.round(some[:, 1], 6)) for some in self._cuts if len(some)]
        step = min(float(np.ptp(x)) / max(len(x) - 1, 1) or np.inf for x in places)
        waves = np.arange(2.0, min(max(2.5, (span / step + 1) / 2.5), 100.0), WAVE_STEP)
        return tuple((span / waves[::-1]).tolist())

    @cached_property
    def _blocks(self) -> list[slice | Integers]:
        """Rows of each class."""
        n = len(self.data)
        if not self.classes:
            return [slice(n)]
        column = self.data.pass_ if self.name == "chatter" else self.data.coolant
        labels = labels_of(column, n)
        unknown = sorted(set(labels.tolist()) - set(self.classes))
        if unknown and self.name == "tool_heating":
            known = ", ".join(self.classes)
            raise DataError(f"coolant: got {unknown[0]!r}, expected one that was measured: {known}")
        return [where(labels == label) for label in self.classes]

    @cached_property
    def _cuts(self) -> list[Floats]:
        """Cuts of each class."""
        return [self.cuts[rows] for rows in self._blocks]

    def _evaluate(self, values: Mapping[str, float]) -> tuple[Floats, Floats]:
        cuts = self.cuts
        numbers = [float(value) for value in values.values()]
        # Without a clock 1 mm counts as 1 s: µm/m is then 0.06 µm/min.
        scale = 0.06 if self.name == "tool_wear" and not self.reference.timed else 1.0
        own = 2 if self.name == "chatter" else 1
        blocks = self._blocks
        shared = numbers[own * len(blocks) :]
        change = np.zeros(len(cuts))
        slopes = np.zeros((len(numbers), len(cuts)))
        for i, (rows, some) in enumerate(zip(blocks, self._cuts, strict=True)):
            mine = [scale * v for v in numbers[own * i : own * (i + 1)]]
            overhang = self.conditions.overhang_mm
            change[rows], slope = turning_cause(self.name, some, overhang, mine + shared)
            for place, column in enumerate(slope.T):
                if place < own:
                    slopes[own * i + place, rows] = scale * column
                else:
                    slopes[own * len(blocks) + place - own, rows] = column
        return change, slopes.T

    def change(self, values: Mapping[str, float]) -> Floats:
        """Change of each reading, µm on the diameter."""
        return self._evaluate(values)[0]

    def jacobian(self, values: Mapping[str, float]) -> Floats:
        """Derivative of `change` by the parameters, exact."""
        return self._evaluate(values)[1]

    def effect(self) -> Effect:
        """Return the effect, bound to the passes."""
        spread = self.name == "chatter" and bool(self.classes)
        return Effect(
            self.name,
            self.parameters(),
            self.change,
            self.jacobian,
            label=CAUSES[self.name],
            least=self._least(),
            spread=waves_in_classes(self.cuts[:, 1], self._blocks, "pitch_mm") if spread else None,
        )

    def _least(self) -> dict[str, float] | None:
        """Wear that matters, over the longest pass; the other causes have to show themselves."""
        if self.name != "tool_wear":
            return None
        longest = max(self._pass_time(), 1e-6)
        if self.reference.timed:
            return {"rate_um_min": 60.0 * MIN_WEAR_UM / longest}
        return {"rate_um_m": 1e3 * MIN_WEAR_UM / longest}

    def _pass_time(self) -> float:
        """Cutting time of the longest pass."""
        time = self.cuts[:, 2]
        labels = labels_of(self.data.pass_, len(time))
        return max(float(np.ptp(time[labels == label])) for label in in_order(labels))


def _catalogue(data: Diameters, conditions: Conditions, reference: _Reference) -> list[Effect]:
    """Causes that these passes can show; a growing part only where diameters differ."""
    sizes = data.diameter_mm
    differ = sizes is not None and np.max(sizes) > MIN_DIAMETER_RANGE * np.min(sizes)
    shown = {"workpiece_heating": differ, "block_acceleration": bool(conditions.blocks_mm)}
    causes = [name for name in CAUSES if shown.get(name, True)]
    cuts = _cuts(data, conditions, reference)
    return [_Cause(name, data, conditions, reference, cuts).effect() for name in causes]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DiameterLaw(Estimate):
    """The extended model of a diagnosis of diameters: what a planned pass would come out as.

    Attributes
    ----------
    offset_um : dict
        Fitted offset of each pass that was measured.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.read_setup(tn.sample_path("turning/setup.toml"))
    >>> data = tn.read_diameters(tn.sample_path("turning/diameters.csv"))
    >>> law = tn.diagnose(data, setup).model
    >>> sorted(law.effects)
    ['tool_heating']
    """

    offset_um: Mapping[str, float]
    source: DiameterModel = field(compare=False, repr=False)

    @checked
    def error_um(self, planned: Diameters, *, offset_of: object = None) -> Floats:
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
            error += self.offset_um[choose("pass", str(offset_of), self.offset_um)]
        for effect in self.source.effects_on(planned):
            if effect.id in self.effects:
                values = Values(self.effects[effect.id])
                error += np.asarray(effect.change(values), dtype=np.float64)
        return error


class DiameterModel(LinearModel):
    """Diameters of passes, as the diagnosis engine asks for them.

    data: One or more passes.
    conditions: Of the cut.
    effects: Further candidates: a user's own effects, or ids.
    reference: The cut to which forces and diameters are compared; None: the first row of these.

    Raises DataError: too few readings in a pass, readings beyond the overhang or of more than 5 mm.
    """

    def __init__(
        self,
        data: Diameters,
        conditions: Conditions,
        effects: Sequence[EffectLike | str] = (),
        reference: _Reference | None = None,
    ) -> None:
        check_passes(data, conditions.overhang_mm)
        self.conditions = conditions
        self.reference = reference or _reference(data, conditions)
        self._given = tuple(effects)
        self._noises: dict[bytes, Callable[[Floats], Floats]] = {}
        z = np.asarray(data.z_mm, dtype=np.float64)
        labels = labels_of(data.pass_, len(data))
        passes = in_order(labels)
        # Blocks of five along each pass, the same places together, are left out as a whole.
        place = np.clip((5 * (z - z.min()) / max(float(np.ptp(z)), 1e-9)).astype(int), 0, 4)
        super().__init__(
            data=data,
            readings=Readings(
                np.asarray(data.error_um, dtype=np.float64),
                np.arange(len(data)),
                least=FINEST_NOISE,
            ),
            nuisance=[Nuisance(f"offset_{label}_um", "µm") for label in passes],
            design=(labels[:, None] == np.array(passes)[None, :]).astype(float),
            effects=self.effects_on(data),
            covariates=self._quantities(data),
            groups=place,
        )

    def effects_on(self, data: Diameters) -> tuple[Effect, ...]:
        """Every candidate, bound to these or other passes."""
        found = _catalogue(data, self.conditions, self.reference)
        own = Description(self._quantities(data), {}, "µm")
        return with_own(found, self._given, data, described=own)

    def _quantities(self, data: Diameters) -> list[Covariate]:
        """Place, time or length cut, pass and order."""
        along = _cuts(data, self.conditions, self.reference)[:, 2]
        time = Covariate("cutting time", along, "s")
        out = [
            Covariate("position along the part", np.asarray(data.z_mm, dtype=np.float64), "mm"),
            time if self.reference.timed else replace(time, name="length cut", unit="mm"),
        ]
        labels = labels_of(data.pass_, len(data))
        if len(in_order(labels)) > 1:
            out.append(Covariate("pass", labels, classes=True))
        order = np.arange(len(data), dtype=float)
        return [*out, Covariate("order of measurement", order, sequence=True)]

    def supposed(self, effects: EffectValues) -> Mapping[str, Floats]:
        """An error in proportion to the depth of cut, where that explains more than causes do."""
        depth = self.data.depth_mm
        return {} if depth is None else in_proportion(self, np.asarray(depth), effects)

    def whitener(self, residuals: Floats) -> Callable[[Floats], Floats]:
        """Noise with a memory along each pass, if it has one (:mod:`.noise_in_runs`)."""
        asked = residuals.tobytes()  # of one diagnosis, twice the same
        if asked not in self._noises:
            passes = along_passes(self.data)
            self._noises = {asked: noise_in_runs(self, residuals, passes, slow=True)}
        return self._noises[asked]

    def bind(self, data: Any) -> DiameterModel:
        """Return the same model, with the same reference cut, on other passes."""
        if not isinstance(data, Diameters):
            raise InputError(f"other data: got {type(data).__name__}, expected trunnion.Diameters")
        return DiameterModel(data, self.conditions, self._given, self.reference)

    def extended(
        self, nuisance: Floats, effects: EffectValues, uncertainty: Uncertainty | None = None
    ) -> DiameterLaw:
        """Return offsets and causes."""
        names = (n.name.removeprefix("offset_").removesuffix("_um") for n in self.nuisance)
        return DiameterLaw(
            offset_um=dict(zip(names, map(float, nuisance), strict=True)),
            source=self,
            **self.estimated(effects, uncertainty, OF_TURNING),
        )


@checked
def build(
    data: Diameters, setup: Setup | Conditions | None, effects: Sequence[EffectLike | str] = ()
) -> DiameterModel:
    """Make the model of measured diameters; the set-up needs a table ``[turning]``.

    Raises DataError, InputError, UnknownNameError: as :class:`DiameterModel` and `conditions_of`,
        and for an id that is in no catalogue.
    """
    return DiameterModel(data, conditions_of(setup), effects)
