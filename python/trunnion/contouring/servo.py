"""Servo axes and coupling controllers, and the ``[servo]`` table of the set-up file.

::

    [servo]
    period_ms = 1.0            # control period; a log without it is taken as sampled at the period
    feedback = "motor"         # "motor" | "load": which position the loops are closed on

    [servo.X]                  # one table an axis: X, Y, Z (linear), A, B, C (rotary)
    gain_per_s = 81.28         # loop gain K_v, expected
    time_constant_ms = 5.76    # of the drive, expected
    coulomb_um = 0.0           # and any other field of LinearAxis; of RotaryAxis for A, B, C

The gain is that of the whole loop (open-loop gain times axial controller gain): an axis at constant
speed v lies v/K_v behind.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from math import inf
from os import PathLike
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from trunnion.base.arguments import check_fields, checked
from trunnion.base.checks import choose, entry, floats, instance
from trunnion.base.errors import InputError
from trunnion.base.frozen import FrozenMapping
from trunnion.base.units import Floats
from trunnion.setup import Setup, read_setup
from trunnion.setup.fields import Choice, Key, Number, Part, Section, key, keys_of

Feedback: TypeAlias = Literal["motor", "load"]
Position: TypeAlias = Literal["circle", "tangent"]
Orientation: TypeAlias = Literal["proposed", "tangent"]
Order: TypeAlias = Literal["controller_last", "jacobian_last", "as_printed"]
LINEAR = ("X", "Y", "Z")
ROTARY = ("A", "B", "C")

POSITIVE = Number(positive=True)
NOT_NEGATIVE = Number(0.0)
LIMIT = Number(positive=True, infinite=True)
ANY = Number(infinite=True)
DRAG = Number(-99.0, 99.0)


class _Servo(Part):
    """What linear and rotary axes have in common."""

    def __post_init__(self) -> None:
        """Check every field, and that none contradicts another or is for nothing."""
        super().__post_init__()
        names = {name.partition("_")[0]: name for name in keys_of(type(self))}
        values = {short: getattr(self, name) for short, name in names.items()}
        if values["breakaway"] < values["coulomb"]:
            limit = f"at least {names['coulomb']} = {values['coulomb']:g}"
            raise self.refuse(names["breakaway"], f"{limit}, the friction at speed")
        if values["damping"] >= 1.0:
            raise self.refuse("damping", "a ratio from 0 to below 1")
        for name, needs in _NEEDED:
            if values[name] and not values[needs]:
                limit = f"0, or {names[needs]} above 0: without it this does nothing"
                raise self.refuse(names[name], limit)


_NEEDED = (
    ("cyclic", "pitch"),
    ("phase", "cyclic"),
    ("damping", "resonance"),
    ("stribeck", "breakaway"),
)
"""What is for nothing without another."""


@dataclass(frozen=True)
class LinearAxis(_Servo):
    """A servo of first order with gain, and what real axes add; zero switches a part off.

    Attributes
    ----------
    gain_per_s, time_constant_ms:
        Loop gain K_v and time constant of the drive.
    coulomb_um, breakaway_um, stribeck_mm_min:
        Friction at speed and at rest, as the position error it takes to overcome it, and the speed
        over which one goes into the other. Where there is a Coulomb level, the breakaway must be
        at least as large: equal where an axis at rest needs no more.
    backlash_um:
        Width of the play; the load lies half of it behind.
    cyclic_um, pitch_mm, phase_deg:
        Error of screw or gear: cyclic · sin(2π · motor position / pitch + phase) at the load.
    delay_ms:
        Delay of the velocity command; need not be a multiple of the period.
    resonance_hz, damping:
        Structure between motor and load.
    limit_mm_min:
        Largest velocity command.
    offset_um:
        Position error that a constant force (gravity, the amplifier's zero) takes; positive where
        the axis stays below its command. A Coulomb level of its own in each direction is an offset
        beside the mean level, and friction in proportion to the speed another gain and time
        constant: neither has a parameter of its own.
    friction_direction_percent:
        Share of the speed by which friction is larger in the positive direction and smaller in the
        negative one.
    velocity_forward_percent, acceleration_forward_ms:
        Feed-forward of the commanded velocity (100 % takes the following error away) and of the
        commanded acceleration, by backward differences over a control period.
    resolution_um:
        Step in which actual positions are recorded; 0: not stated, it is recognised in a log. No
        part of the simulation.
    """

    table: ClassVar[str] = "LinearAxis"
    gain_per_s: float = key(..., POSITIVE, "loop gain")
    time_constant_ms: float = key(..., NOT_NEGATIVE, "time constant of the drive")
    coulomb_um: float = key(0.0, NOT_NEGATIVE, "friction at speed, as position error")
    breakaway_um: float = key(0.0, NOT_NEGATIVE, "friction at rest, likewise")
    stribeck_mm_min: float = key(0.0, NOT_NEGATIVE, "speed over which friction falls")
    backlash_um: float = key(0.0, NOT_NEGATIVE, "width of the play")
    cyclic_um: float = key(0.0, Number(), "amplitude of the error of screw or gear")
    pitch_mm: float = key(0.0, NOT_NEGATIVE, "period of that error")
    phase_deg: float = key(0.0, Number(), "phase of that error")
    delay_ms: float = key(0.0, NOT_NEGATIVE, "delay of the velocity command")
    resonance_hz: float = key(0.0, NOT_NEGATIVE, "of the structure between motor and load")
    damping: float = key(0.0, NOT_NEGATIVE, "of that resonance")
    limit_mm_min: float = key(inf, LIMIT, "largest velocity command")
    offset_um: float = key(0.0, Number(), "position error that a constant force takes")
    friction_direction_percent: float = key(0.0, DRAG, "of the speed, lost in + and won in -")
    velocity_forward_percent: float = key(0.0, Number(), "of the commanded velocity, fed forward")
    acceleration_forward_ms: float = key(0.0, Number(), "time of the acceleration fed forward")
    resolution_um: float = key(0.0, NOT_NEGATIVE, "step of recorded positions, 0: recognised")


@dataclass(frozen=True)
class RotaryAxis(_Servo):
    """As `LinearAxis`, in arcsec, deg and deg/min; breakaway at least the Coulomb level, too."""

    table: ClassVar[str] = "RotaryAxis"
    gain_per_s: float = key(..., POSITIVE, "loop gain")
    time_constant_ms: float = key(..., NOT_NEGATIVE, "time constant of the drive")
    coulomb_arcsec: float = key(0.0, NOT_NEGATIVE, "friction at speed, as position error")
    breakaway_arcsec: float = key(0.0, NOT_NEGATIVE, "friction at rest, likewise")
    stribeck_deg_min: float = key(0.0, NOT_NEGATIVE, "speed over which friction falls")
    backlash_arcsec: float = key(0.0, NOT_NEGATIVE, "width of the play")
    cyclic_arcsec: float = key(0.0, Number(), "amplitude of the error of screw or gear")
    pitch_deg: float = key(0.0, NOT_NEGATIVE, "period of that error")
    phase_deg: float = key(0.0, Number(), "phase of that error")
    delay_ms: float = key(0.0, NOT_NEGATIVE, "delay of the velocity command")
    resonance_hz: float = key(0.0, NOT_NEGATIVE, "of the structure between motor and load")
    damping: float = key(0.0, NOT_NEGATIVE, "of that resonance")
    limit_deg_min: float = key(inf, LIMIT, "largest velocity command")
    offset_arcsec: float = key(0.0, Number(), "position error that a constant force takes")
    friction_direction_percent: float = key(0.0, DRAG, "of the speed, lost in + and won in -")
    velocity_forward_percent: float = key(0.0, Number(), "of the commanded velocity, fed forward")
    acceleration_forward_ms: float = key(0.0, Number(), "time of the acceleration fed forward")
    resolution_arcsec: float = key(0.0, NOT_NEGATIVE, "step of recorded positions, 0: recognised")


Axis: TypeAlias = LinearAxis | RotaryAxis


def varied(axis: Axis, changes: Mapping[str, float]) -> Axis:
    """Return a copy with some numbers changed; of many of them, it is the core that checks."""
    new: Axis = object.__new__(type(axis))
    vars(new).update(vars(axis), **changes)
    return new


def numbers(axes: Sequence[Axis]) -> Floats:
    """Return the numbers of axes in the order of their fields, shape (m, 17)."""
    names = simulated(axes[0])
    return np.array([[getattr(axis, name) for name in names] for axis in axes], dtype=np.float64)


def simulated(axis: Axis) -> list[str]:
    """Return the fields of an axis that a simulation takes; the others are of what is recorded."""
    return [f.name for f in fields(axis) if not f.name.startswith("resolution_")]


@dataclass(frozen=True)
class Servo:
    """The axes of a machine with their control period.

    Attributes
    ----------
    axes:
        `LinearAxis` for X, Y, Z, `RotaryAxis` for A, B, C.
    period_ms:
        Control period.
    feedback:
        "motor": the loops do not see backlash, cyclic error and resonance; "load": they do.
    """

    axes: Mapping[str, Axis] = field(default_factory=dict)
    period_ms: float | None = 1.0
    feedback: Feedback = "motor"

    def __post_init__(self) -> None:
        """Check letters and kinds."""
        check_fields(self)
        for letter, axis in self.axes.items():
            choose("servo axis", letter, (*LINEAR, *ROTARY))
            kind = LinearAxis if letter in LINEAR else RotaryAxis
            instance(f"servo axis {letter}", axis, kind, f"a {kind.__name__}")
        choose("servo feedback", self.feedback, ("motor", "load"))
        object.__setattr__(self, "axes", FrozenMapping(self.axes))

    @classmethod
    def paper(cls) -> "Servo":
        """Table 1 of Byun and Jee 2010: K_v = open-loop gain times axial controller gain.

        The table mixes units (µm, degrees, counts; 5000 µm to a degree); the products are in 1/s.
        Its rotary open-loop gain 0.0051 has two digits: 0.00505 to 0.00515 would fit as well, and
        with it 5.8 to 8.6 µm of contour error for independent axes at 3 m/min.
        """
        return cls.of_gains(
            {"X": 25.40, "Y": 25.17, "Z": 25.37, "A": 0.0051, "C": 0.0101},
            dict(zip("XYZAC", _AXIAL.tolist(), strict=True)),
            {"X": 5.76, "Y": 5.77, "Z": 5.50, "A": 5.85, "C": 5.75},
        )

    @classmethod
    @checked
    def of_gains(
        cls,
        open_loop_per_s: Mapping[str, float],
        axial_gain: Mapping[str, float],
        time_constant_ms: Mapping[str, float],
        *,
        gear_ratio: Mapping[str, float] | None = None,
    ) -> "Servo":
        """From the gains of a table such as Table 1 of Byun and Jee 2010, by letter of the axis.

        Parameters
        ----------
        open_loop_per_s
            Open-loop gain of the drive; with a `gear_ratio` that of the motor in front of the gear.
        axial_gain
            Gain of the axis' controller: velocity command for a unit of position error.
        time_constant_ms
            Time constant of the velocity loop.
        gear_ratio
            Turns of the axis for a turn of the motor: 1/180 and 1/90 for A and C of the paper, 1
            where nothing is given. The open-loop gains of the paper's table include them: they are
            0.918 and 0.909 at the motors.

        Raises
        ------
        InputError
            An axis with one of them and not the others.
        """
        ratio = {letter.upper(): value for letter, value in (gear_ratio or {}).items()}
        given = [
            {letter.upper(): value for letter, value in each.items()}
            for each in (open_loop_per_s, axial_gain, time_constant_ms)
        ]
        if len({frozenset(each) for each in given}) != 1 or not set(ratio) <= set(given[0]):
            named = "; ".join(", ".join(each) for each in given)
            raise InputError(
                f"gains of axes: got {named}, expected open-loop gain, axial gain and time "
                "constant of the same axes"
            )
        axes: dict[str, Axis] = {}
        for letter, gain in given[0].items():
            kind = (
                LinearAxis
                if choose("servo axis", letter, (*LINEAR, *ROTARY)) in LINEAR
                else RotaryAxis
            )
            loop = gain * ratio.get(letter, 1.0) * given[1][letter]
            axes[letter] = kind(loop, given[2][letter])
        return cls(axes)

    @classmethod
    @checked
    def from_table(cls, table: Mapping[str, Any]) -> "Servo":
        """From the ``[servo]`` table of a set-up (``setup.servo``), or a mapping like it.

        Raises
        ------
        FileFormatError, InputError
            A key or value that is not as the module says; with its place in the file of the set-up.
        """
        section = Section.of("servo", table)
        axes: dict[str, Axis] = {}
        for name in section:
            letter = name.upper()
            if letter not in (*LINEAR, *ROTARY):
                continue
            if letter in axes:
                with section.placed(), entry(name):
                    raise InputError(f"servo.{name}: got the axis twice, expected it once")
            kind: type[Axis] = LinearAxis if letter in LINEAR else RotaryAxis
            axes[letter] = section.table(name).build(kind)
        letters = dict.fromkeys((*LINEAR, *ROTARY, *(n for n in section if n.upper() in axes)))
        own = section.read(_KEYS, beside=letters)
        return cls(axes, own.get("period_ms"), own.get("feedback", "motor"))

    @classmethod
    @checked
    def from_setup(cls, setup: Setup) -> "Servo":
        """From the ``[servo]`` table of a set-up, which has to be there.

        Raises
        ------
        FileFormatError, InputError
            No such table, or as :meth:`from_table`.
        """
        section = Section.of("servo", setup.servo)
        if not section:
            keys = "gain_per_s and time_constant_ms of each axis, in [servo.X] and so on"
            with section.placed():
                raise InputError(f"servo: the table is missing, expected {keys}")
        return cls.from_table(section)

    def to_table(self) -> dict[str, Any]:
        """Return the ``[servo]`` table; numbers at their default are left out."""
        out: dict[str, Any] = {"feedback": self.feedback}
        if self.period_ms is not None:
            out["period_ms"] = self.period_ms
        for letter, axis in self.axes.items():
            default = {f.name: f.default for f in fields(axis)}
            out[letter] = {k: v for k, v in asdict(axis).items() if v != default[k]}
        return out

    @checked
    def row(self, letter: str) -> Floats:
        """Return the numbers of an axis in the order of its fields, shape (17,)."""
        if letter not in self.axes:
            known = ", ".join(self.axes) or "others"
            raise InputError(f"servo axis {letter}: got none, expected it beside {known}")
        axis = self.axes[letter]
        values = {name: getattr(axis, name) for name in simulated(axis)}
        return np.array([ANY(f"servo.{letter}.{name}", size) for name, size in values.items()])

    @checked
    def rows(self, letters: str = "XYZAC") -> Floats:
        """Return the numbers of five axes, shape (5, 17)."""
        return np.stack([self.row(letter) for letter in letters])


@checked
def read_servo(path: str | PathLike[str]) -> Servo:
    """Read the ``[servo]`` table of a set-up file.

    Raises
    ------
    FileFormatError
        No such table, or a key or value that is not as the module says; with its place.
    """
    return Servo.from_setup(read_setup(path))


_KEYS = {
    "period_ms": Key(POSITIVE, "control period", None),
    "feedback": Key(Choice(("motor", "load")), "position that the loops are closed on", "motor"),
}


# Table 1: ratios of the coupling gains to the axial controller gain.
_AXIAL = np.array([3.2, 3.2, 3.2, 16070.0, 8101.0])
_TABLE_1 = np.array(
    [
        [22.5, 17.6, 0.0008],
        [22.5, 17.6, 0.0008],
        [22.5, 17.6, 0.0008],
        [112491.0, 78744.0, 4.0175],
        [56709.0, 39696.0, 2.0253],
    ]
)


@dataclass(frozen=True, eq=False)
class Coupling:
    """Cross-coupled control of five axes.

    Attributes
    ----------
    position:
        Contour-error model: "circle" through the nearest three reference points (the paper's), or
        "tangent" line at the present one.
    orientation:
        "proposed" (the paper's) or "tangent", a reconstruction of earlier work (Lo 2002 was not
        available) that carries the rotary positions back along the tangent.
    gains:
        C_P/K_p (a number), C_I/K_p (1/s), C_D/K_p (s) of X, Y, Z, A, C, shape (5, 3); by default
        those of Table 1, where C_I/K_p is 5.5 for the linear and 4.9 for the rotary axes.
    order:
        "controller_last": C(z) acts on J⁻¹ ε. "jacobian_last": J⁻¹ acts on C(z) ε, each output in
        the unit of the axis it goes to. "as_printed": likewise with the numbers of Table 1, as the
        paper's text can be read: outputs for the rotary axes are in their drives' units (5000 µm to
        a degree) and enter the linear axes five times too large.
    """

    position: Position = "circle"
    orientation: Orientation = "proposed"
    gains: Floats = field(default_factory=lambda: _TABLE_1 / _AXIAL[:, None])
    order: Order = "controller_last"

    def __post_init__(self) -> None:
        """Check the gains."""
        check_fields(self)
        gains = floats("coupling gains", self.gains).copy()
        if gains.shape != (5, 3):
            raise InputError(f"coupling gains: got shape {gains.shape}, expected (5, 3)")
        gains.setflags(write=False)
        object.__setattr__(self, "gains", gains)

    @classmethod
    @checked
    def of_gains(cls, cross_gains: ArrayLike, axial_gain: ArrayLike) -> "Coupling":
        """From gains as a table states them: C_P, C_I, C_D of X, Y, Z, A, C, and axial gains.

        Parameters
        ----------
        cross_gains
            As in Table 1 of Byun and Jee 2010, shape (5, 3).
        axial_gain
            Gain of each axis' controller, shape (5,).

        Raises
        ------
        InputError
            Other shapes, or an axial gain of zero.
        """
        cross, axial = floats("cross gains", cross_gains), floats("axial gain", axial_gain)
        if cross.shape != (5, 3) or axial.shape != (5,) or not axial.all():
            raise InputError(
                f"gains: got shapes {cross.shape} and {axial.shape}, expected (5, 3) and (5,), "
                "axial gains other than zero"
            )
        return cls(gains=cross / axial[:, None])

    @checked
    def scaled(self, factor: ArrayLike) -> "Coupling":
        """Return the same controllers with all gains times a factor."""
        gains = self.gains * np.asarray(factor, dtype=np.float64)
        return Coupling(self.position, self.orientation, gains, self.order)

    @property
    def core(self) -> tuple[Position, Orientation, Floats, Order]:
        """Arguments of the core."""
        return self.position, self.orientation, self.gains, self.order


Controller: TypeAlias = Literal["independent", "existing", "proposed"] | Coupling


def coupling_of(controller: Controller) -> Coupling | None:
    """Return the coupling that a controller's name stands for; None: independent axes."""
    if isinstance(controller, Coupling):
        return controller
    known = {
        "independent": None,
        "existing": Coupling(orientation="tangent"),
        "proposed": Coupling(),
    }
    return known[choose("controller", controller, known)]
