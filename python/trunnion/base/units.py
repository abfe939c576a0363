"""Units of parameters, read from their names, and the array types of the package."""

from __future__ import annotations

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
    "um_m_h": "µm/m/h",
    "um_min": "µm/min",
    "um_h": "µm/h",
    "mm_min": "mm/min",
    "deg_min": "deg/min",
    "deg_s2": "deg/s²",
    "mm_s2": "mm/s²",
    "mm_rev": "mm/rev",
    "m_min": "m/min",
    "um_m": "µm/m",
    "per_s": "1/s",
    "arcsec": "arcsec",
    "deg": "deg",
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
