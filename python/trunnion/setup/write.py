"""A set-up as plain values, as the text of a file, and as people read it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import tomli_w

from trunnion.base.frozen import thawed
from trunnion.base.report import Table
from trunnion.setup.fields import report
from trunnion.setup.machine import AxisSetup

if TYPE_CHECKING:
    from trunnion.setup.artefact import Artefact
    from trunnion.setup.parts import Setup

PARTS = ("machine", "artefact", "probe", "resolution", "table", "plan", "control", "report")
SIZES = ("length_mm", "width_mm", "height_mm", "diameter_mm")
PROCESS_TABLES: Mapping[str, str] = {
    "turning": "trunnion.models.diameters:conditions_of",
    "servo": "trunnion.contouring.servo:Servo.from_setup",
    "ballbar": "trunnion.models.ballbar.settings:BallbarSettings.from_setup",
    "hybrid": "trunnion.hybrid.mechanism:Mechanism.from_setup",
    "rotary_test": "trunnion.probing.rotary_readings:RotaryTestSettings.from_setup",
}
"""Tables that belong to a process, which declares them: its reader takes the set-up.

A reader is named as "module:name" and imported when a set-up has the table: every set-up is refused
for what is wrong in any of its tables, whoever reads it.
"""


def tables_of(setup: Setup) -> dict[str, dict[str, Any]]:
    """Return every table of the file that is not empty, with plain values."""
    tables = {name: getattr(setup, name).to_dict() for name in PARTS}
    tables["axes"] = {letter: axis.to_dict() for letter, axis in setup.axes.items()}
    tables |= {name: thawed(getattr(setup, name)) for name in PROCESS_TABLES}
    for name in ("errors", "tolerance"):
        if not tables["machine"][name]:
            del tables["machine"][name]
    if setup.table.is_assumed:
        del tables["table"]
    return {name: table for name, table in tables.items() if table}


def toml_of(setup: Setup) -> str:
    """Return the text of a file that reads back as an equal set-up."""
    return tomli_w.dumps(tables_of(setup))


def commented_toml(setup: Setup) -> str:
    """Return the text of a file with the meaning of every key beside it.

    Keys without a value, the assumed table and rotary axes without a table are comments. It reads
    back as an equal set-up.
    """
    known = tables_of(setup)
    lines: list[str] = []
    for name in PARTS:
        part, values = getattr(setup, name), known.get(name, {})
        lines.append(f"[{name}]")
        for key, declared in part.own_keys().items():
            if key in values and not isinstance(values[key], dict):
                text = " ".join(tomli_w.dumps({key: values[key]}).split())
            elif isinstance(getattr(part, key), Mapping):
                continue
            else:
                value = thawed(getattr(part, key))
                text = f"# {key} = {'' if value is None else value}".rstrip()
            lines.append(f"{text:<42} # {declared.meaning}")
        lines.append("")
    rest = {name: table for name, table in known.items() if name not in PARTS}
    for table in PARTS:
        for name, value in known.get(table, {}).items():
            if isinstance(value, dict):
                lines += [f"[{table}.{name}]", tomli_w.dumps(value)]
    lines += _axes_to_fill_in(setup)
    return "\n".join(lines) + tomli_w.dumps(rest)


def _axes_to_fill_in(setup: Setup) -> list[str]:
    """Return a table, all comments, for each rotary axis of the machine without one of its own."""
    lines: list[str] = []
    for letter in setup.machine.description().core(1.0).letters:
        if letter not in setup.axes:
            keys = {k: d for k, d in AxisSetup().own_keys().items() if k != "range_mm"}
            texts = [f"# {key} = {'1' if key == 'sense' else ''}".rstrip() for key in keys]
            said = zip(texts, keys.values(), strict=True)
            lines += [f"# [axes.{letter}]", *(f"{t:<42} # {d.meaning}" for t, d in said), ""]
    return lines


def report_of(setup: Setup) -> Table:
    """Return every key with its value, unit and meaning."""
    parts = [(name, getattr(setup, name)) for name in PARTS]
    parts += [(f"axes.{letter}", axis) for letter, axis in setup.axes.items()]
    table = report("Set-up", parts)
    rows = [
        (f"{name}.{key}", str(thawed(value)), "", "")
        for name in PROCESS_TABLES
        for key, value in getattr(setup, name).items()
    ]
    return Table.of(table.title, table.columns, (*table.rows, *rows))


def size_of(artefact: Artefact) -> str:
    """Return the dimensions of an artefact, with their unit."""
    sizes = (getattr(artefact, name) for name in SIZES if name in artefact.own_keys())
    return " × ".join(f"{value:g}" for value in sizes) + " mm"


def headline_of(setup: Setup) -> str:
    """Return the machine, the artefact and the probe in one line."""
    kind = setup.artefact.kind
    processes = [f"[{name}]" for name in PROCESS_TABLES if getattr(setup, name)]
    said = [
        setup.machine.name,
        "no artefact" if kind == "none" else f"{kind} {size_of(setup.artefact)}",
        f"ball radius {setup.probe.ball_radius_mm:g} mm",
        *processes,
    ]
    return ", ".join(said)
