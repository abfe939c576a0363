"""A kinematics component of LinuxCNC that knows the errors of a machine."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files

import trunnion._core as _core
from trunnion.compensation.machine import MachineErrors
from trunnion.controls.screws import table_letters
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

DIRECTIONS = "ABC"
COMPONENTS = {"X": 0, "Y": 1, "Z": 2, "A": 0, "B": 1, "C": 2}
LINEAR_ERRORS = (
    ("scale_x", "ppm", "e * scale_x_ppm"),
    ("scale_y", "ppm", "e * scale_y_ppm"),
    ("scale_z", "ppm", "e * scale_z_ppm"),
    ("squareness_xy", "arcsec", "-a * squareness_xy_arcsec"),
    ("squareness_xz", "arcsec", "a * squareness_xz_arcsec"),
    ("squareness_yz", "arcsec", "-a * squareness_yz_arcsec"),
)
"""Effects that the component holds beside location errors: the entries XX YY ZZ XY XZ YZ of Λ."""

PLACES = 6
"""Decimals of numbers in the source: a nanometre."""


def held(known: MachineErrors) -> MachineErrors:
    """Errors that the component holds: location errors, scale and squareness."""
    mine = {name for name, _, _ in LINEAR_ERRORS}
    effects = {name: values for name, values in known.effects.items() if name in mine}
    return MachineErrors(errors=known.errors, effects=effects)


def is_conventional(setup: Setup) -> bool:
    """Whether all rotary axes count as ISO 841 does, against the turn of the table."""
    return bool((Chain(setup).senses < 0).all())


def pin_values(setup: Setup, known: MachineErrors) -> dict[str, float]:
    """Pin → value: each location error of the machine, scale and squareness, zeros."""
    units = Chain(setup).location_errors
    pins = {f"{name.lower()}-{unit}": known.errors.get(name, 0.0) for name, unit in units.items()}
    for name, unit, _ in LINEAR_ERRORS:
        pin = f"{name}-{unit}".replace("_", "-")
        pins[pin] = known.effects.get(name, {}).get(unit, 0.0)
    pins |= {f"zero-{letter.lower()}-arcsec": 0.0 for letter in Chain(setup).letters}
    return {name: round(value, PLACES) + 0.0 for name, value in pins.items()}


def component(setup: Setup, known: MachineErrors, name: str = "trunnionkins") -> str:
    """Source of the component, for ``halcompile --install``.

    Raises
    ------
    InputError
        A machine that it cannot hold, or no ``[control] centre_mm``.
    """
    letters = table_letters(setup, "LinuxCNC kinematics")
    senses = Chain(setup).senses.tolist()
    conventional = is_conventional(setup)
    words = {
        "NAME": name,
        "VERSION": _core.__version__,
        "MACHINE": setup.machine.name,
        "COORDINATES": " ".join("XYZ" + letters),
        "AXES": str(len(letters)),
        "CONVENTIONAL": str(int(conventional)),
        "PINS": _pins(pin_values(setup, known)),
        "LINKS": _links(setup, letters),
        "LAMBDA": ", ".join(formula for _, _, formula in LINEAR_ERRORS),
        "ANGLES": "\n".join(
            f"    angle[{i}] = {'' if conventional or sense > 0 else '-'}sense * joint[{i}];"
            for i, sense in enumerate(senses)
        ),
        "JOINTS": ", ".join(f"joint[{3 + i}]" for i in range(len(letters))),
        "POSITIONS": ", ".join(f"pos->{c.lower()} + {_zero(c)}" for c in letters),
        "TO_POSITIONS": "\n".join(
            f"    pos->{c.lower()} = joint[{3 + i}] - {_zero(c)};" for i, c in enumerate(letters)
        ),
        "TO_JOINTS": "\n".join(f"    joint[{3 + i}] = turned[{i}];" for i in range(len(letters))),
    }
    for axis, place in zip("XYZ", setup.control.centre_mm or (), strict=True):
        words[axis] = f"{place:.{PLACES}f}"
        words[f"S{axis}"] = f"{Chain(setup).linear_senses()['XYZ'.index(axis)]:.0f}"
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
        unit = unit.replace("um", "µm")
        lines.append(f'pin in float {name.replace("-", "_")} = {value!r} "{said}, {unit}";')
    return "\n".join(lines)


def _links(setup: Setup, letters: str) -> str:
    """Frame of each rotary axis in that of the axis that carries it.

    Location errors are absolute: what an axis carries has the difference to those of its carrier.
    """
    names = Chain(setup).location_errors
    points = setup.axis_points()
    lines, carrier, before = [], "", (0.0, 0.0, 0.0)
    for letter in letters:
        axis = DIRECTIONS.index(letter)
        point = list(points.get(letter, (0.0, 0.0, 0.0)))
        point[axis] = 0.0
        parts: dict[str, list[str]] = {"offset": ["0"] * 3, "tilt": ["0"] * 3}
        for i in range(3):
            parts["offset"][i] = f"{point[i] - before[i]:.{PLACES}f}"
        for kind, unit in COMPONENTS.items():
            name = f"E{kind}0{letter}"
            if name not in names:
                continue
            term = _pin(name, names)
            carried = f"E{kind}0{carrier}"
            if carried in names:
                term = f"({term} - {_pin(carried, names)})"
            if names[name] == "um":
                parts["offset"][unit] += f" + u * {term}"
            else:
                parts["tilt"][unit] = f"a * {term}"
        offset, tilt = ", ".join(parts["offset"]), ", ".join(parts["tilt"])
        lines.append(f"            {{{axis}, {{{offset}}}, {{{tilt}}}}},")
        carrier, before = letter, (point[0], point[1], point[2])
    return "\n".join(lines)


def _pin(name: str, names: Mapping[str, str]) -> str:
    return f"{name.lower()}_{names[name]}"
