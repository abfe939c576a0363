"""A kinematics component of LinuxCNC that knows the errors of a machine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

import trunnion._core as _core
from trunnion.base.units import Floats, unit_of
from trunnion.compensation.machine import MachineErrors
from trunnion.controls.links import COMPONENTS, Link, links, pivot_mm, table_centre
from trunnion.controls.linuxcnc.linear_map import LinearMap, map_words
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


@dataclass(frozen=True)
class _Motion:
    """A parameter of an error motion: on which component of its axis' frame it acts, and how.

    shape: In C, of the position q of the axis.
    """

    effect: str
    parameter: str
    key: str
    shape: str

    @property
    def pin(self) -> str:
        return f"{self.effect}-{self.parameter}".replace("_", "-")


_MOTIONS = {
    "radial_2": {"a?_um": ("?", "cos(2 * q)"), "b?_um": ("?", "sin(2 * q)")},
    "wobble_2": {"a?_arcsec": ("tilt ?", "cos(2 * q)"), "b?_arcsec": ("tilt ?", "sin(2 * q)")},
    "axial": {"a1_um": ("along", "cos(q)"), "b1_um": ("along", "sin(q)")},
    "axial_2": {"a2_um": ("along", "cos(2 * q)"), "b2_um": ("along", "sin(2 * q)")},
    "sag": {"kx_um": ("X", "sin(q)"), "ky_um": ("Y", "sin(q)"), "kz_um": ("Z", "(cos(q) - 1)")},
    "twist": {"k_arcsec": ("tilt across", "sin(q)")},
}
"""Error motions of an axis along X, Y or Z (docs/reference/effects.md); ? is x, y or z."""


def _motions(setup: Setup) -> dict[str, list[_Motion]]:
    """Error motions that the component holds, by letter of the axis."""
    known = Chain(setup).effects
    found: dict[str, list[_Motion]] = {}
    frames = links(setup)
    for link in (*frames.head, *frames.table):
        own = "XYZ"["ABC".index(link.letter)]
        if np.abs(link.direction).max() < 1.0:
            continue  # an oblique axis has them in a frame of its own
        for what, shapes in _MOTIONS.items():
            effect = f"{link.letter.lower()}_{what}"
            for parameter in known[effect].parameters if effect in known else ():
                among = {"along": own, "across": "X" if own == "Y" else "Y"}
                wild = parameter.name[1]
                where, shape = (
                    shapes.get(parameter.name) or shapes[parameter.name.replace(wild, "?", 1)]
                )
                name = where.rpartition(" ")[2].replace("?", wild.upper())
                place = "XYZ".index(among.get(name, name))
                key = "ABC"[place] if where.startswith("tilt") else "XYZ"[place]
                motion = _Motion(effect, parameter.name, key, shape)
                found.setdefault(link.letter, []).append(motion)
    return found


def held(setup: Setup, known: MachineErrors) -> MachineErrors:
    """Errors that the component holds: location errors, error motions, scale and squareness."""
    mine = {name for name, _, _ in LINEAR_ERRORS}
    mine |= {motion.effect for listed in _motions(setup).values() for motion in listed}
    return known.only(mine)


def is_conventional(setup: Setup) -> bool:
    """Whether all rotary axes count as ISO 841 does, against the turn of the table."""
    senses = Chain(setup).senses
    return bool(senses.size and (senses < 0).all())


def pin_values(setup: Setup, known: MachineErrors) -> dict[str, float]:
    """Pin → value: location errors, scale and squareness, error motions, zeros."""
    units = Chain(setup).location_errors
    pins = {f"{name.lower()}-{unit}": known.errors.get(name, 0.0) for name, unit in units.items()}
    for name, unit, _ in LINEAR_ERRORS:
        pin = f"{name}-{unit}".replace("_", "-")
        pins[pin] = known.effects.get(name, {}).get(unit, 0.0)
    for motions in _motions(setup).values():
        for one in motions:
            pins[one.pin] = known.effects.get(one.effect, {}).get(one.parameter, 0.0)
    if (pivot := pivot_mm(setup)) is not None:
        pins[PIVOT] = pivot
    pins |= {f"zero-{letter.lower()}-arcsec": 0.0 for letter in Chain(setup).letters}
    return {name: round(value, PLACES) + 0.0 for name, value in pins.items()}


def joint_letters(setup: Setup) -> str:
    """Rotary axes in the order of LinuxCNC's joints behind X, Y, Z: by the alphabet."""
    return "".join(sorted(Chain(setup).letters))


def component(
    setup: Setup, known: MachineErrors, grid: LinearMap | None = None, name: str = "trunnionkins"
) -> str:
    """Source of the component, for ``halcompile --install``.

    Raises
    ------
    InputError
        No ``[control] centre_mm``; a head without ``pivot_mm``.
    """
    chain, frames, centre = Chain(setup), links(setup), table_centre(setup)
    letters, joints = chain.letters, joint_letters(setup)
    conventional, motions = is_conventional(setup), _motions(setup)
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
            _link(link, motions.get(link.letter, ()), i, carries_tool=i < min(1, len(frames.head)))
            for i, link in enumerate((*frames.head, *frames.table))
        ),
        "REACH": "pivot_length + UNIT * tool_offset" if frames.head else "0",
        "SEAT": _vector(frames.seat),
        "NOSE": _vector(frames.nose),
        **map_words(grid),
        "ROUNDS": "1" if grid is None else "4",
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
        lines.append(f'pin in float {_c(name)} = {value!r} "{said}, {unit}";')
    return "\n".join(lines)


def _link(link: Link, motions: Iterable[_Motion], index: int, *, carries_tool: bool) -> str:
    """Return a frame in that of the axis that carries it, with the pins of its errors."""
    parts: dict[str, list[str]] = {key: [] for key in COMPONENTS}
    for key, (own, carried) in link.errors.items():
        term = _pin(own) if carried is None else f"({_pin(own)} - {_pin(carried)})"
        parts[key].append(f"{'u' if key in 'XYZ' else 'a'} * {term}")
    for one in motions:
        shape = one.shape.replace("q)", f"angle[{index}])")
        parts[one.key].append(f"{'u' if one.key in 'XYZ' else 'a'} * {_c(one.pin)} * {shape}")
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


def _c(pin: str) -> str:
    """Return a pin as C knows it."""
    return pin.replace("-", "_")


def _pin(name: str) -> str:
    """Return the pin of a location error as C knows it."""
    return f"{name.lower()}_{unit_of(name).replace('µ', 'u')}"
