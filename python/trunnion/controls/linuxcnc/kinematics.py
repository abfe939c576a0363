"""A kinematics component of LinuxCNC that knows the errors of a machine."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files

import trunnion._core as _core
from trunnion.base.errors import InputError
from trunnion.base.units import Floats, unit_of
from trunnion.compensation.machine import MachineErrors
from trunnion.controls.links import COMPONENTS, Link, links, table_centre
from trunnion.controls.linuxcnc.present import MM
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

LINEAR_ERRORS = (
    ("scale_x", "ppm", "e * scale_x_ppm"),
    ("scale_y", "ppm", "e * scale_y_ppm"),
    ("scale_z", "ppm", "e * scale_z_ppm"),
    ("squareness_xy", "arcsec", "-a * squareness_xy_arcsec"),
    ("squareness_xz", "arcsec", "a * squareness_xz_arcsec"),
    ("squareness_yz", "arcsec", "-a * squareness_yz_arcsec"),
)
"""Effects that the component holds beside location errors: the entries XX YY ZZ XY XZ YZ of Λ."""

PIVOT = "pivot-length"
PLACES = 6
"""Decimals of numbers in the source: a nanometre."""


def held(known: MachineErrors) -> MachineErrors:
    """Errors that the component holds: location errors, scale and squareness."""
    mine = {name for name, _, _ in LINEAR_ERRORS}
    effects = {name: values for name, values in known.effects.items() if name in mine}
    return MachineErrors(errors=known.errors, effects=effects)


def is_conventional(setup: Setup) -> bool:
    """Whether all rotary axes count as ISO 841 does, against the turn of the table."""
    senses = Chain(setup).senses
    return bool(senses.size and (senses < 0).all())


def pin_values(setup: Setup, known: MachineErrors) -> dict[str, float]:
    """Pin → value: each location error of the machine, scale and squareness, zeros."""
    units = Chain(setup).location_errors
    pins = {f"{name.lower()}-{unit}": known.errors.get(name, 0.0) for name, unit in units.items()}
    for name, unit, _ in LINEAR_ERRORS:
        pin = f"{name}-{unit}".replace("_", "-")
        pins[pin] = known.effects.get(name, {}).get(unit, 0.0)
    if (pivot := pivot_mm(setup)) is not None:
        pins[PIVOT] = pivot
    pins |= {f"zero-{letter.lower()}-arcsec": 0.0 for letter in Chain(setup).letters}
    return {name: round(value, PLACES) + 0.0 for name, value in pins.items()}


def pivot_mm(setup: Setup) -> float | None:
    """From the pivot of a head to the gauge line of the spindle; None without a head.

    Raises InputError: a head, and the set-up does not say it.
    """
    if "head" not in Chain(setup).sides.values():
        return None
    if setup.control.pivot_mm is None:
        raise InputError(
            "control.pivot_mm: not given, expected the distance from the head's pivot to where "
            "the tool length is 0: probe.length_mm less the probe's length in the tool table"
        )
    return setup.control.pivot_mm


def joint_letters(setup: Setup) -> str:
    """Rotary axes in the order of LinuxCNC's joints behind X, Y, Z: by the alphabet."""
    return "".join(sorted(Chain(setup).letters))


def component(setup: Setup, known: MachineErrors, name: str = "trunnionkins") -> str:
    """Source of the component, for ``halcompile --install``.

    Raises
    ------
    InputError
        No ``[control] centre_mm``; a head without ``pivot_mm``.
    """
    chain, frames, centre = Chain(setup), links(setup), table_centre(setup)
    letters, joints = chain.letters, joint_letters(setup)
    conventional = is_conventional(setup)
    signs = [1.0 if conventional else sense for sense in chain.senses.tolist()]
    words = {
        "NAME": name,
        "VERSION": _core.__version__,
        "MACHINE": setup.machine.name,
        "COORDINATES": " ".join("XYZ" + joints),
        "AXES": str(len(letters)),
        "HEAD": str(len(frames.head)),
        "UNIT": f"{MM[setup.control.linear_units]}",
        "CONVENTIONAL": str(int(conventional)),
        "PINS": _pins(pin_values(setup, known)),
        "LINKS": "\n".join(
            _link(link, carries_tool=i < min(1, len(frames.head)))
            for i, link in enumerate((*frames.head, *frames.table))
        ),
        "REACH": "pivot_length + UNIT * tool_offset" if frames.head else "0",
        "SEAT": _vector(frames.seat),
        "NOSE": _vector(frames.nose),
        "LAMBDA": ", ".join(formula for _, _, formula in LINEAR_ERRORS),
        "SIGNS": ", ".join(f"{sign:g}" for sign in [*signs, 0.0]),
        "JOINTS": ", ".join([*(f"joint[{3 + joints.index(c)}]" for c in letters), "0"]),
        "POSITIONS": ", ".join([*(f"pos->{c.lower()} + {_zero(c)}" for c in letters), "0"]),
        "TO_POSITIONS": "\n".join(
            f"    pos->{c.lower()} = joint[{3 + i}] - {_zero(c)};" for i, c in enumerate(joints)
        ),
        "TO_JOINTS": "\n".join(
            f"    joint[{3 + i}] = turned[{letters.index(c)}];" for i, c in enumerate(joints)
        ),
    }
    for axis, place, sense in zip("XYZ", centre, chain.linear_senses(), strict=True):
        words |= {axis: f"{place:.{PLACES}f}", f"S{axis}": f"{sense:.0f}"}
    text = files(__package__).joinpath("kinematics.comp.in").read_text(encoding="utf-8")
    for word, value in words.items():
        text = text.replace(f"@{word}@", value)
    return text


def _zero(letter: str) -> str:
    """Zero of a rotary axis in degrees; none where the coordinates are those of the joints."""
    return f"(type == 1 ? 0 : zero_{letter.lower()}_arcsec / 3600)"


def _pins(values: Mapping[str, float]) -> str:
    lines = []
    for name, value in values.items():
        what, _, unit = name.rpartition("-")
        said = what.upper() if "0" in what else what.replace("-", " ")
        unit = "mm: pivot to the gauge line" if name == PIVOT else unit.replace("um", "µm")
        lines.append(f'pin in float {name.replace("-", "_")} = {value!r} "{said}, {unit}";')
    return "\n".join(lines)


def _link(link: Link, *, carries_tool: bool) -> str:
    """Return a frame in that of the axis that carries it, with the pins of its errors."""
    parts: dict[str, list[str]] = {key: [] for key in COMPONENTS}
    for key, (own, carried) in link.errors.items():
        term = _pin(own) if carried is None else f"({_pin(own)} - {_pin(carried)})"
        parts[key].append(f"{'u' if key in 'XYZ' else 'a'} * {term}")
    for key, shift in zip("XYZ", link.offset, strict=True):
        parts[key].insert(0, f"{shift:.{PLACES}f}")
    if carries_tool:
        parts["Z"].append("reach")
    sums = [" + ".join(parts[key] or ["0"]) for key in COMPONENTS]
    offset, tilt = ", ".join(sums[:3]), ", ".join(sums[3:])
    about = _vector(link.direction, 15)
    return f"            {{{about}, {{{offset}}}, {{{tilt}}}}}, /* {link.letter} */"


def _vector(values: Floats, places: int = PLACES) -> str:
    return "{" + ", ".join(f"{value + 0.0:.{places}f}" for value in values) + "}"


def _pin(name: str) -> str:
    """Return the pin of a location error as C knows it."""
    return f"{name.lower()}_{unit_of(name).replace('µ', 'u')}"
