"""What a sweep varies of a set-up: any key of machine, axes, artefact, probe, ..., and the plan."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass
from typing import Any

from trunnion.base.checks import choose
from trunnion.base.errors import InputError
from trunnion.base.input import listed_numbers
from trunnion.base.units import unit_of
from trunnion.data.touches import Touches
from trunnion.machine.chain import Chain
from trunnion.probing.model import catalogue
from trunnion.probing.plan import plan
from trunnion.setup import Artefact, Machine, Setup
from trunnion.setup.artefact import names_of
from trunnion.setup.fields import Vector, keys_of
from trunnion.setup.machine import AxisSetup
from trunnion.setup.machines import presets
from trunnion.setup.parts import AXES, PARTS
from trunnion.setup.read import setup_of
from trunnion.studies.study import Parameter, Value, Values

BASE = "setup"
"""Parameter that holds the text of the set-up that a sweep begins with."""
NOT_VARIED = ("report", "control")
"""Tables that change no number."""
PLAN: Mapping[str, Parameter] = {
    "plan.c_deg": Parameter("0,90,180,270", "deg"),
    "plan.tilt_deg": Parameter("90,-90", "deg"),
    "plan.feeds_mm_min": Parameter("600", "mm/min"),
    "plan.both_senses": Parameter(False),
    "plan.all_faces": Parameter(False),
    "plan.layout": Parameter("side", choices=("side", "top")),
    "plan.repeats": Parameter(1, low=1, high=1000),
}
"""Arguments of :func:`trunnion.plan`; lists as text: "0,90" or "first:last:step"."""
ARTEFACTS = ("cross", "cuboid", "sphere")


def setup_parameters(base: Setup) -> dict[str, Parameter]:
    """Return what a study can vary of a set-up, TABLE.KEY, and of the plan of its touches."""
    found = {BASE: Parameter(base.to_toml(), in_grid=False), **PLAN}
    for table, part in PARTS.items():
        if table not in NOT_VARIED:
            found |= _keys(table, part)
    for axis in AXES:
        found |= _keys(f"axes.{axis}", AxisSetup)
    return found


def _keys(table: str, part: Any) -> dict[str, Parameter]:
    """Return the keys of one table; numbers in a list are text, "60,0,80"."""
    found = {}
    for name, declared in keys_of(part).items():
        if isinstance(declared.default, Mapping):
            continue  # names of errors: their true values are drawn
        default = declared.default
        if (
            default is MISSING
            or isinstance(declared.takes, Vector)
            or default is None
            or not isinstance(default, float | int | str)
        ):
            default = None
        found[f"{table}.{name}"] = Parameter(default, unit_of(name), optional=True)
    return found


@dataclass(frozen=True, eq=False)
class Setting:
    """Set-up and plan of one node."""

    setup: Setup
    touches: Touches

    @classmethod
    def of(cls, values: Values) -> Setting:
        """Of the parameters of a node; kept, because its blocks share it.

        Raises InputError: values that no set-up has, or a plan that cannot be.
        """
        names = [n for n in values if n == BASE or "." in n]
        return _setting(tuple((name, values[name]) for name in names))


@functools.lru_cache(maxsize=64)
def _setting(items: tuple[tuple[str, Value], ...]) -> Setting:
    values = dict(items)
    setup = set_up(values)
    tilting = f"{(Chain(setup).tilting or 'a').lower()}_deg"
    made = plan(
        setup,
        c_deg=listed_numbers("plan.c_deg", str(values["plan.c_deg"])),
        feeds_mm_min=listed_numbers("plan.feeds_mm_min", str(values["plan.feeds_mm_min"])),
        both_senses=bool(values["plan.both_senses"]),
        all_faces=bool(values["plan.all_faces"]),
        layout=str(values["plan.layout"]),
        repeats=int(values["plan.repeats"]),
        **{tilting: listed_numbers("plan.tilt_deg", str(values["plan.tilt_deg"]))},  # type: ignore[arg-type]
    )
    return Setting(setup, made)


def set_up(values: Values) -> Setup:
    """Return the set-up of a node: that of the sweep, with the keys that it varies."""
    tables: dict[str, Any] = tomllib.loads(str(values[BASE]))
    kind = str(values.get("artefact.kind", tables["artefact"]["kind"]))
    own = names_of(choose("artefact.kind", kind, ARTEFACTS))
    tables["artefact"] = {k: v for k, v in tables["artefact"].items() if k in own}
    for name, value in values.items():
        *above, key = name.split(".")
        if not above or name in PLAN or above[0] not in (*PARTS, "axes"):
            continue
        if above == ["artefact"] and key not in own:  # a dimension of another kind
            continue
        table = tables
        for part in above:
            table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise InputError(f"{name}: got a value in its place, expected a table")
        table[key] = _stored(above, key, value)
    return setup_of(tables)


def _stored(above: list[str], key: str, value: Value) -> Any:
    """Return a value as the set-up has it: lists are given as text."""
    part: Any = AxisSetup if above[0] == "axes" else PARTS[above[0]]
    if isinstance(value, str) and isinstance(keys_of(part)[key].takes, Vector):
        return [float(each) for each in value.split(",")]
    return value


@functools.cache
def effect_parameters() -> Mapping[str, tuple[str, ...]]:
    """Return all effects on touches, of any machine and artefact: id → its parameters."""
    found: dict[str, tuple[str, ...]] = {}
    for preset in presets():
        for kind in ARTEFACTS:
            size = {"diameter_mm": 25.0, "centre_mm": (60.0, 0.0, 80.0)} if kind == "sphere" else {}
            setup = Setup(artefact=Artefact(kind, **size), machine=Machine(preset=preset))  # type: ignore[arg-type]
            found |= {
                entry.id: tuple(p.name for p in entry.parameters) for entry in catalogue(setup)
            }
    return found
