"""Units of parameters, read from their names, and the array types of the package."""

from __future__ import annotations

from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.intp]
Flags: TypeAlias = NDArray[np.bool_]

ARCSEC = float(np.pi / 648_000)
"""One second of arc, rad."""

# Longest first: "rate_um_h" ends in both.
_SUFFIXES = {
    "um_m_m": "µm/m per m",
    "um_m2": "µm/m²",
    "um_m_h": "µm/m/h",
    "um_cycle": "µm/cycle",
    "arcsec_cycle": "arcsec/cycle",
    "um_min": "µm/min",
    "um_h": "µm/h",
    "mm_min": "mm/min",
    "deg_min": "deg/min",
    "deg_s2": "deg/s²",
    "mm_s2": "mm/s²",
    "mm_rev": "mm/rev",
    "mm_s": "mm/s",
    "deg_s": "deg/s",
    "m_min": "m/min",
    "um_m": "µm/m",
    "per_s": "1/s",
    "percent": "%",
    "arcsec": "arcsec",
    "deg": "deg",
    "ppm_k": "ppm/K",
    "um_k": "µm/K",
    "std_k": "K",
    "ppm": "ppm",
    "rpm": "1/min",
    "min": "min",
    "um": "µm",
    "mm": "mm",
    "ms": "ms",
    "hz": "Hz",
    "s": "s",
    "h": "h",
}


@cache
def unit_of(name: str) -> str:
    """Return the unit that a name stands for or ends in; empty if it names none.

    ``EX0C`` → µm, ``EA0A`` → arcsec, ``drift_z.rate_um_h`` → µm/h, ``tau_min`` → min.
    """
    last = name.rsplit(".", 1)[-1]
    if last[:1] == "E" and last[2:3] == "0":
        return "µm" if last[1] in "XYZ" else "arcsec"
    for suffix, unit in _SUFFIXES.items():
        if last == suffix or last.endswith("_" + suffix):
            return unit
    return ""


def suffix_of(unit: str) -> str:
    """Return the end of a name that stands for a unit: µm/h → um_h; empty if there is none."""
    return next((suffix for suffix, known in _SUFFIXES.items() if known == unit), "")


def without_unit(name: str) -> str:
    """Return a parameter's name without the unit at its end: ``along_um_m`` → along."""
    for suffix in _SUFFIXES:
        if name.endswith("_" + suffix):
            return name.removesuffix("_" + suffix)
    return name


def parameter_words(name: str) -> str:
    """Return a parameter's name without its unit as people read it: at_10_mm_um → at 10 mm.

    A name that is a unit alone says what it is by it: ppm_k → coefficient.
    """
    if "/" in _SUFFIXES.get(name, ""):
        return "coefficient"
    return without_unit(name).replace("_", " ")


def capital(text: str) -> str:
    """Return a text that begins with a capital."""
    return text[:1].upper() + text[1:]


_SIZES: dict[str, tuple[str, float]] = {
    **{u: ("length", s) for u, s in (("mm", 1.0), ("cm", 10.0), ("m", 1e3), ("µm", 1e-3))},
    **{u: ("length", s) for u, s in (("nm", 1e-6), ("inch", 25.4), ("in", 25.4))},
    **{u: ("angle", s) for u, s in (("deg", 1.0), ("arcsec", 1 / 3600), ("arcmin", 1 / 60))},
    **{u: ("angle", s * 180 / np.pi) for u, s in (("rad", 1.0), ("mrad", 1e-3), ("µrad", 1e-6))},
    **dict.fromkeys(("turn", "rev"), ("angle", 360.0)),
    **{u: ("slope", s) for u, s in (("µm/m", 1.0), ("mm/m", 1e3), ("m/m", 1e6))},
    **{u: ("time", s) for u, s in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9))},
    **{u: ("time", s) for u, s in (("min", 60.0), ("h", 3600.0))},
    **{u: ("feed", s) for u, s in (("mm/min", 1.0), ("mm/s", 60.0), ("m/min", 1e3))},
    "inch/min": ("feed", 25.4),
}
"""Unit → what it measures, and its size."""


def conversion(given: str, wanted: str) -> float | None:
    """Return the factor from one unit to another; None where there is none.

    An angle is an inclination, too: 1 rad is 1e6 µm/m.
    """
    given, wanted = given.replace("um", "µm"), wanted.replace("um", "µm")
    if given == wanted:
        return 1.0
    (a, size), (b, other) = (_SIZES.get(u, (u, 1.0)) for u in (given, wanted))
    if (a, b) == ("angle", "slope"):
        return float(np.radians(size) * 1e6 / other)
    return size / other if a == b else None
