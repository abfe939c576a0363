"""``[artefact]``: what is touched, how it stands on the table and what holds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypedDict

import numpy as np

from trunnion.base.checks import entry
from trunnion.base.errors import InputError
from trunnion.setup.fields import (
    COORDINATE,
    LENGTH,
    Choice,
    Key,
    Number,
    Part,
    Vector,
    Vectors,
    key,
    keys_of,
)
from trunnion.setup.holders import CHUCKS, PLATES, VISES, Holder, seat_mm, vise_boxes

MM_PER_INCH = 25.4
FEW_MM = 20.0
"""Length of a cross below which it is likely in inches."""
DIMENSIONS: Mapping[str, tuple[str, ...]] = {
    "cross": ("length_mm", "width_mm", "height_mm"),
    "cuboid": ("length_mm", "width_mm", "height_mm"),
    "sphere": ("diameter_mm", "centre_mm", "stem_diameter_mm"),
    "spheres": ("diameter_mm", "spheres_mm", "stem_diameter_mm"),
    "ring": ("diameter_mm", "outer_diameter_mm", "height_mm"),
    "none": ("length_mm", "width_mm", "height_mm"),  # earlier versions wrote them
}
"""Keys of an artefact beside its kind; "none" where nothing is touched."""

HOLDERS = ("vise", "chuck", "plate")
"""What an artefact of any kind may be held by, by name."""

HOLDING = (*HOLDERS, "base_mm", "clamps_mm", "chuck_mm")
"""What an artefact of any kind is held by, as obstacles of a plan."""

STANDING = ("place_mm", "turn_deg", "tolerance_mm", "tolerance_deg", *HOLDING)
"""Keys that say how an artefact of any kind stands on the table."""

CERTIFICATE = (
    *("calibration_um", "calibration_arcsec", "expansion_ppm_k"),
    *("temperature_c", "temperature_std_k"),
)
"""Keys that say how well an artefact of any kind is known."""

REFERENCE_C = 20.0
"""Temperature that dimensions are stated at (ISO 1)."""

UNCERTAINTY = Number(0.0, 1e4)
"""Standard uncertainties, µm or arcsec."""


class Obstacles(TypedDict):
    """What holds an artefact, as the core takes it: none where the lengths are 0."""

    base_mm: tuple[float, float, float]
    clamps_mm: tuple[tuple[float, ...], ...]
    chuck_mm: tuple[float, float]


@dataclass(frozen=True)
class Artefact(Part):
    """What is touched, mm.

    `kind` is "cross", "cuboid" (a datum cube, wherever `place_mm` puts it), "sphere", "spheres" (a
    ball plate, a ball bar, a scale with its master balls) or "ring" (a ring gauge or a bore, its
    axis Z of the artefact frame), "none" where nothing is touched.

    A sphere needs `diameter_mm` and `centre_mm`, several need `spheres_mm`, two to nine centres
    (all in the artefact frame); a ring needs `diameter_mm` (of the bore) and `outer_diameter_mm`.
    They are None for the others. Stems, from each sphere down to the table top, are obstacles of a
    plan, as are a `vise`, a `chuck` or a `plate` (True, the name of a size or a mapping of
    dimensions) that hold it, a plate of the lengths `base_mm` under the artefact, boxes beside it
    (`clamps_mm`) and a chuck (`chuck_mm`). A `stem_diameter_mm` of None is a third of the sphere's:
    read it as `effective_stem_diameter_mm`.

    `place_mm` and `turn_deg` (about Z) are where the artefact's frame nominally stands in the
    table's, whose origin is the centre of its top; the placement that is identified is the
    deviation from there. In a holder, a Z of 0 stands for where the artefact sits in it: read it as
    `effective_place_mm`. A plan keeps clear of the artefact wherever within `tolerance_mm` (any
    direction) and `tolerance_deg` (about Z) of its place it stands.

    What is stated of its calibration and temperature is part of uncertainty budgets.

    Examples
    --------
    >>> import trunnion as tn
    >>> ball = tn.Artefact("sphere", diameter_mm=24.0, centre_mm=(60.0, 0.0, 80.0))
    >>> ball.effective_stem_diameter_mm
    8.0
    """

    table: ClassVar[str] = "artefact"
    kind: str = key(..., Choice(tuple(DIMENSIONS)), "what is touched")
    length_mm: float = key(100.0, LENGTH, "along X")
    width_mm: float = key(25.0, LENGTH, "of a cross's bars; of a cuboid along Y")
    height_mm: float = key(25.0, LENGTH, "along Z")
    diameter_mm: float | None = key(None, LENGTH, "of the sphere, of each sphere, of the bore")
    centre_mm: tuple[float, float, float] | None = key(
        None, Vector(3, COORDINATE), "of the sphere, artefact frame"
    )
    spheres_mm: tuple[tuple[float, float, float], ...] | None = key(
        None, Vectors(3, 2, 9, COORDINATE), "centres of several spheres, artefact frame"
    )
    outer_diameter_mm: float | None = key(None, LENGTH, "of the ring; its outside is not touched")
    stem_diameter_mm: float | None = key(
        None, Number(0.0, 1e5), "of the sphere's stem; 0: none; else a third of the sphere's"
    )
    place_mm: tuple[float, float, float] = key(
        (0.0, 0.0, 0.0),
        Vector(3, COORDINATE),
        "nominal place on the table, from its centre; Z of 0: on the table or in its holder",
    )
    turn_deg: float = key(0.0, Number(-360.0, 360.0), "nominal turn about Z on the table")
    tolerance_mm: float = key(2.0, Number(0.0, 1e3), "how far from its place it may stand")
    tolerance_deg: float = key(1.0, Number(0.0, 45.0), "how far it may be turned about Z")
    vise: bool | str | Mapping[str, Any] | None = key(
        None,
        Holder(VISES, ("opening_mm",)),
        "vise that holds it, turned with it, jaws along X: its body and jaws; else none",
    )
    chuck: bool | str | Mapping[str, Any] | None = key(
        None, Holder(CHUCKS), "chuck that holds it, up to the top of its jaws; else none"
    )
    plate: bool | str | Mapping[str, Any] | None = key(
        None, Holder(PLATES), "plate that it stands on, wider than itself; else none"
    )
    base_mm: tuple[float, float, float] | None = key(
        None, Vector(3, LENGTH), "plate under the artefact: along X and Y, height; else none"
    )
    clamps_mm: tuple[tuple[float, ...], ...] | None = key(
        None,
        Vectors(5, 0, 100, COORDINATE),
        "boxes beside the artefact, such as jaws of a vise, on the table and turned with it: X and "
        "Y of the middle from its place, lengths along X and Y, height; else none",
    )
    chuck_mm: tuple[float, float] | None = key(
        None, Vector(2, LENGTH), "chuck about the artefact's place: diameter, height; else none"
    )
    calibration_um: float = key(0.0, UNCERTAINTY, "standard uncertainty of each dimension")
    calibration_arcsec: float = key(0.0, UNCERTAINTY, "standard uncertainty of its squareness")
    expansion_ppm_k: float = key(11.5, Number(0.0, 100.0), "expansion coefficient; steel: 11.5")
    temperature_c: float = key(
        REFERENCE_C, Number(-50.0, 150.0), "of the artefact; dimensions are those at 20 °C"
    )
    temperature_std_k: float = key(0.0, Number(0.0, 100.0), "standard uncertainty of it")

    def __post_init__(self) -> None:
        """Check every field, and that the kind has these dimensions."""
        super().__post_init__()
        own = self.own_names()
        for name, declared in keys_of(Artefact).items():
            value = getattr(self, name)
            if name in own and value is None and name not in ("stem_diameter_mm", *HOLDING):
                raise self.refuse(name, f"{declared.takes.words}: a {self.kind} needs it")
            if name not in own and value != declared.default:
                has = ", ".join(own[1:])
                raise self.refuse(name, f"none: a {self.kind} has {has}")
        self._check_holder()
        if self.kind == "cross" and self.width_mm >= self.length_mm:
            limit = f"less than artefact.length_mm = {self.length_mm:g}: a cross has arms"
            if self.width_mm < MM_PER_INCH * self.length_mm and self.length_mm < FEW_MM:
                limit += f" (is length_mm in inches, {MM_PER_INCH * self.length_mm:g} mm?)"
            raise self.refuse("width_mm", limit)
        if self.calibration_arcsec and self.kind != "cross":
            raise self.refuse("calibration_arcsec", f"0: no squareness of a {self.kind} is fitted")
        if (self.outer_diameter_mm or np.inf) <= (self.diameter_mm or 0.0):
            limit = f"more than artefact.diameter_mm = {self.diameter_mm:g}, the bore's"
            raise self.refuse("outer_diameter_mm", limit)
        if self.diameter_mm is not None and self.effective_stem_diameter_mm >= self.diameter_mm:
            limit = f"less than artefact.diameter_mm = {self.diameter_mm:g}: the sphere is touched"
            raise self.refuse("stem_diameter_mm", limit)

    def _check_holder(self) -> None:
        """Refuse two holders, one stated twice, one that is too high, and an unknown opening."""
        names = [name for name in HOLDERS if getattr(self, name) is not None]
        twice = [*zip(names[1:], names, strict=False), ("chuck_mm", "chuck"), ("base_mm", "plate")]
        for name, same in twice:
            if getattr(self, name) is not None and same in names:
                raise self.refuse(name, f"none beside artefact.{same}: give one of the two")
        held = self.holder or {}
        if names == ["vise"]:
            self._check_opening(held)
        lowest = held.get("bed_mm", seat_mm(held) if names == ["plate"] else 0.0)
        if held and self.effective_place_mm[2] < lowest:
            limit = f"Z of 0 (where it sits) or of at least {lowest:g}, what it stands on"
            raise self.refuse("place_mm", limit)

    def _check_opening(self, vise: Mapping[str, float]) -> None:
        """Refuse jaws that nobody can place, or that are in the artefact."""
        opening = vise.get("opening_mm")
        with entry("vise", *(() if opening is None else ("opening_mm",))):
            if opening is None and self.centres_mm:
                raise InputError(
                    "artefact.vise.opening_mm: missing, expected the distance between the jaws, "
                    f"which does not follow from a {self.kind}"
                )
            if opening is not None and not self.centres_mm and opening < self.extent_mm[1]:
                raise InputError(
                    f"artefact.vise.opening_mm: got {opening:g}, expected at least "
                    f"{self.extent_mm[1]:g}, the length of the artefact between the jaws"
                )

    def _held(self, name: str) -> Mapping[str, float] | None:
        """Dimensions of a holder, mm by name."""
        found: Mapping[str, float] | None = getattr(self, name)
        return found

    @property
    def holder(self) -> Mapping[str, float] | None:
        """Dimensions of the vise, chuck or plate that holds it, mm by name; None: not stated."""
        return next((held for name in HOLDERS if (held := self._held(name)) is not None), None)

    @property
    def extent_mm(self) -> tuple[float, float]:
        """Lengths along its X and Y of the least rectangle about its origin that holds it."""
        if self.centres_mm:
            far = np.abs(self.centres_mm).max(axis=0)[:2]
            x, y = (2.0 * far + (self.diameter_mm or 0.0)).tolist()
            return x, y
        if self.kind == "ring":
            return self.outer_diameter_mm or 0.0, self.outer_diameter_mm or 0.0
        return self.length_mm, self.length_mm if self.kind == "cross" else self.width_mm

    @property
    def effective_place_mm(self) -> tuple[float, float, float]:
        """Its place on the table; a Z of 0 in a holder is where it sits in that."""
        x, y, z = self.place_mm
        return (x, y, z if z or self.holder is None else seat_mm(self.holder))

    @property
    def lowest_mm(self) -> float:
        """Its lowest point above the table top; below 0: in the table."""
        lowest = min(
            (z - 0.5 * (self.diameter_mm or 0.0) for *_, z in self.centres_mm), default=0.0
        )
        return self.effective_place_mm[2] + lowest

    @property
    def obstacles(self) -> Obstacles:
        """What holds it, by name or by its boxes."""
        x, y = self.extent_mm
        found: Obstacles = {
            "base_mm": self.base_mm or (0.0, 0.0, 0.0),
            "clamps_mm": self.clamps_mm or (),
            "chuck_mm": self.chuck_mm or (0.0, 0.0),
        }
        if vise := self._held("vise"):
            found["clamps_mm"] = (*vise_boxes(vise, y), *found["clamps_mm"])
        if plate := self._held("plate"):
            margin = 2.0 * plate["margin_mm"]
            found["base_mm"] = (x + margin, y + margin, plate["height_mm"])
        if chuck := self._held("chuck"):
            found["chuck_mm"] = (chuck["diameter_mm"], chuck["height_mm"])
        return found

    @property
    def growth(self) -> float:
        """Its dimensions at its temperature, as a multiple of those at 20 °C."""
        return 1.0 + 1e-6 * self.expansion_ppm_k * (self.temperature_c - REFERENCE_C)

    @property
    def effective_stem_diameter_mm(self) -> float:
        """Diameter of a sphere's stem: as given, or a third of the sphere's; else 0."""
        given = self.stem_diameter_mm
        if "stem_diameter_mm" not in self.own_names():
            return 0.0
        return (self.diameter_mm or 0.0) / 3.0 if given is None else given

    @property
    def centres_mm(self) -> tuple[tuple[float, float, float], ...]:
        """Centres of its spheres, artefact frame; none where it has none."""
        own = () if self.centre_mm is None else (self.centre_mm,)
        return own if self.spheres_mm is None else self.spheres_mm

    def own_names(self) -> tuple[str, ...]:
        """Return the names of the keys that this kind has."""
        return names_of(self.kind)

    def own_keys(self) -> Mapping[str, Key]:
        """Return the kind, its dimensions and how it stands."""
        own = self.own_names()
        return {name: declared for name, declared in keys_of(Artefact).items() if name in own}


def names_of(kind: str) -> tuple[str, ...]:
    """Return the names of the keys that a kind of artefact has."""
    return ("kind", *DIMENSIONS[kind], *(() if kind == "none" else STANDING + CERTIFICATE))
