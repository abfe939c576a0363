"""What an artefact is held by, as a set-up names it: a vise, a chuck, a plate.

Sizes are round figures of what is sold for the tables of five-axis machines (self-centring vises,
power chucks), not of one make: every one can be stated, and `plan_notes` says which were assumed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from trunnion.base.checks import choose, entry, mapping
from trunnion.base.errors import InputError
from trunnion.base.frozen import FrozenMapping
from trunnion.setup.fields import LENGTH, Number

Box = tuple[float, float, float, float, float]
Sizes = Mapping[str, Mapping[str, float]]


def _vise(jaw: float, thickness: float, length: float, bed: float, height: float) -> dict[str, Any]:
    own = {"jaw_mm": jaw, "thickness_mm": thickness, "length_mm": length}
    return {**own, "bed_mm": bed, "height_mm": height, "grip_mm": 8.0}


VISES: Sizes = {
    "125": _vise(125.0, 40.0, 235.0, 75.0, 100.0),
    "80": _vise(80.0, 30.0, 130.0, 60.0, 80.0),
    "160": _vise(160.0, 45.0, 280.0, 90.0, 120.0),
}
"""By width of the jaws: that (along X), how thick each is (along Y), length of the body (along Y),
heights of the bed and of the top of the jaws above the table, how deep the artefact is gripped."""

CHUCKS: Sizes = {
    "160": {"diameter_mm": 160.0, "height_mm": 110.0, "grip_mm": 10.0},
    "100": {"diameter_mm": 100.0, "height_mm": 80.0, "grip_mm": 10.0},
    "200": {"diameter_mm": 200.0, "height_mm": 130.0, "grip_mm": 10.0},
}
"""By diameter: that, height of the top of the jaws above the table, how deep they grip."""

PLATES: Sizes = {"20": {"margin_mm": 20.0, "height_mm": 20.0}}
"""By height: how far the plate reaches beyond the artefact, and the height."""


@dataclass(frozen=True)
class Holder:
    """``true``, the name of a size, or a table of dimensions with those of a size as defaults."""

    sizes: Sizes
    more: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """What is expected."""
        usual, *others = self.sizes
        names = ", ".join(repr(name) for name in others)
        sized = f"true (size {usual!r})" + (f", one of the sizes {names}" if names else "")
        keys = ", ".join((*self.sizes[usual], *self.more))
        return f"{sized}, or a table with any of size, {keys}"

    def __call__(self, what: str, value: Any) -> FrozenMapping[float] | None:
        """Return its dimensions; None for ``false``."""
        usual = next(iter(self.sizes))
        if value is False:
            return None
        if isinstance(value, str):
            return FrozenMapping(self.sizes[choose(what, value, self.sizes)])
        given = {} if value is True else dict(mapping(what, value, self.words))
        with entry("size"):
            size = choose(f"{what}.size", given.pop("size", usual), self.sizes)
        found = dict(self.sizes[size])
        for name, length in given.items():
            with entry(name):
                choose(what, name, (*found, *self.more))
                takes = LENGTH if name != "grip_mm" else Number(0.0, 1e5)
                found[name] = takes(f"{what}.{name}", length)
        top, bed = found["height_mm"], found.get("bed_mm", 0.0)
        for name, most in (("bed_mm", top), ("grip_mm", top - bed)):
            with entry(name):
                if found.get(name, 0.0) > most:
                    below = "height_mm" if name == "bed_mm" or not bed else "height_mm less bed_mm"
                    raise InputError(
                        f"{what}.{name}: got {found[name]:g}, expected at most {below} = {most:g}"
                    )
        return FrozenMapping(found)


def seat_mm(holder: Mapping[str, float]) -> float:
    """Height above the table at which an artefact sits in a holder: gripped, or on a plate."""
    return holder["height_mm"] - holder.get("grip_mm", 0.0)


def vise_boxes(vise: Mapping[str, float], opening_mm: float) -> tuple[Box, ...]:
    """Body and jaws of a vise: X and Y of the middle, lengths along X and Y, height."""
    jaw, thickness, top = vise["jaw_mm"], vise["thickness_mm"], vise["height_mm"]
    side = 0.5 * (vise.get("opening_mm", opening_mm) + thickness)
    return (
        (0.0, 0.0, jaw, vise["length_mm"], vise["bed_mm"]),
        (0.0, side, jaw, thickness, top),
        (0.0, -side, jaw, thickness, top),
    )
