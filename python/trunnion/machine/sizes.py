"""Sizes that errors of machines, artefacts and probes have: one far outside is in another unit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trunnion.base.units import unit_of
from trunnion.data.mistaken import Sizes
from trunnion.setup import Setup
from trunnion.setup.artefact import DIMENSIONS

TINY_UM = (1e-3, 0.1)
"""Where the largest position error of no machine lies, but that of one in mm does."""

TINY_ARCSEC = (1e-7, 0.1)
"""Where the largest angular error of no machine lies, but one in degrees or radians does."""

LARGE_UM = 1000.0
"""Beyond this a location error is a length that the set-up states wrongly."""

LARGE_ARCSEC = 900.0
"""Beyond this an angular error is a zero or a direction that is not the one meant."""

PLAUSIBLE = {"µm": 2000.0, "arcsec": 3600.0}
"""Beyond these no location error is left on a machine: the set-up is of another one."""

SURE_SIGMAS = 5.0
"""Standard errors that an estimate is large for before its size is discussed."""

SIZES_OF = ("length_mm", "width_mm", "height_mm", "diameter_mm", "outer_diameter_mm")
"""Keys of an artefact that say how large it is, not where."""

_UNITS = {"inches": 25.4, "cm": 10.0, "m": 1e3}
BALL = Sizes(1e-6, 0.125, others=_UNITS, ordinary=(0.5, 6.0))
"""Radii below this are of no ball of a machine's probe: those of 0.25 mm are the smallest."""
ARTEFACT = Sizes(1e-6, 8.0, others=_UNITS, ordinary=(10.0, 1000.0))
"""No artefact is so small in all its dimensions."""

_LETTERS = {"µm": "XYZ", "arcsec": "ABC"}


def in_other_units(errors: Mapping[str, float]) -> str:
    """Ask whether errors are in mm, degrees or radians; empty where there is no doubt."""
    given = {name: float(value) for name, value in errors.items() if value}
    return " ".join(
        f"{_listed(some)}: {question}"
        for unit, (least, limit), question in (
            ("µm", TINY_UM, "are these mm? They are expected in µm."),
            ("arcsec", TINY_ARCSEC, "are these degrees or radians? They are expected in arcsec."),
        )
        if (some := {name: value for name, value in given.items() if name[1] in _LETTERS[unit]})
        and least <= max(map(abs, some.values())) < limit
    )


def length_doubts(setup: Setup) -> list[str]:
    """Ask whether lengths of a set-up are in another unit; empty: no doubt. ASCII."""
    artefact, radius = setup.artefact, setup.probe.ball_radius_mm
    names = [n for n in DIMENSIONS[artefact.kind] if n in SIZES_OF]
    sizes = {n: float(value) for n in names if (value := getattr(artefact, n)) is not None}
    judged = [("probe", {"ball_radius_mm": radius}, BALL)]
    if artefact.kind != "none":
        judged.append(("artefact", sizes, ARTEFACT))
    return [
        f"[{table}] {_listed(given)}: {asked}? They are expected in mm."
        for table, given, rule in judged
        if rule.least <= max(given.values(), default=0.0) < rule.limit
        and (asked := rule.asked(max(given.values()), "mm"))
    ]


def size_doubt(errors: Mapping[str, float], std_errors: Mapping[str, float]) -> str:
    """Ask whether errors that are to be compensated are in another unit; empty: no doubt.

    std_errors: Of an estimate; one that is not sure says nothing by its size.
    """
    sure = {
        name: value
        for name, value in errors.items()
        if abs(value) > SURE_SIGMAS * std_errors.get(name, 0.0)
    }
    far = {k: v for k, v in sure.items() if abs(v) > PLAUSIBLE[unit_of(k)]}
    large = (
        f"{_listed(far)}: more than {PLAUSIBLE['µm'] / 1e3:g} mm or "
        f"{PLAUSIBLE['arcsec'] / 3600:g}°. Errors are expected in µm and arcsec: are these 1000 "
        "times too large, or is the set-up of another machine?"
    )
    return " ".join(filter(None, (in_other_units(_judged(errors, sure)), large if far else "")))


def _judged(errors: Mapping[str, float], sure: Mapping[str, float]) -> dict[str, float]:
    """Return the errors of each unit whose largest is sure; of others none."""
    kept: dict[str, float] = {}
    for letters in _LETTERS.values():
        some = {name: value for name, value in errors.items() if name[1] in letters}
        largest = max(some, key=lambda name: abs(some[name]), default=None)
        if largest is not None and largest in sure:
            kept |= some
    return kept


def _listed(errors: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {np.round(value, 9):g}" for name, value in errors.items())
