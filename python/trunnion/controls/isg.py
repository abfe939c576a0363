"""ISG kernel (Beckhoff TwinCAT CNC): volumetric compensation, lead-screw tables.

Syntax from infosys.beckhoff.com: 1033/tf5280_volumetric_comp (1218769547: list file, 296429067:
ISG_CSV, 296430091: Etalon, 296423819: names) and 1033/tf5200_axis_compensation_parameters
(113432971 and following: kw.ssfk).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypeAlias

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import choose
from trunnion.base.units import unit_of
from trunnion.compensation.machine import Known, MachineErrors
from trunnion.controls.axis_tables import SQUARENESS, AxisTable, AxisTables, axis_tables
from trunnion.controls.files import ControlFiles, Setting
from trunnion.controls.forecast import (
    SIGNS,
    control_files,
    known_errors,
    left_between,
    table_settings,
)
from trunnion.controls.screws import check_directions, turned_round
from trunnion.controls.stated import Need, lines, take
from trunnion.machine.chain import Chain
from trunnion.setup import Setup

Layout: TypeAlias = Literal["ISG_CSV", "etalon"]
FILE_NAMES = {"ISG_CSV": "location.csv", "etalon": "location.txt"}
MAX_POINTS = 1500
PER_UNIT = 1e4
"""Units of a kw.ssfk table in a millimetre and in a degree."""
SQUARENESS_NAMES = {"squareness_xy": "C0Y", "squareness_xz": "B0Z", "squareness_yz": "A0Z"}
NEEDS = (
    Need("angle_unit", ("rad", "deg"), "unit of angles in the file"),
    Need("sign", ("1", "-1"), "1: it takes the errors of the machine, -1: their corrections"),
    Need("chain", (), "order of the axes for P-VOLC-00007 (FCT-C26), XYZCA for example"),
)
LISTS = "#VOLCOMP ON [ID0] in the program; vol_comp[0].file_name names volcomp.lis."


@checked
def isg_files(
    setup: Setup,
    estimate: Known,
    *,
    layout: Layout = "ISG_CSV",
    stated: Mapping[str, str] | None = None,
    any_size: bool = False,
    seed: int = 0,
) -> ControlFiles:
    """Volumetric compensation of the ISG kernel (TF5280) with its lead-screw tables.

    Parameters
    ----------
    setup, estimate
        The machine, and what a measurement says of it.
    layout
        "ISG_CSV", or "etalon", the exchange format of that instrument ("Vendor").
    stated
        What the public documentation does not say: `angle_unit` ("rad", "deg"), `sign` ("1": the
        file has the errors of the machine, "-1": their corrections), `chain` (order of the axes).
    any_size
        Write location errors beyond 2 mm or 1°, too.
    seed
        Of the draws for the interval.

    Notes
    -----
    The kernel corrects positions, not tool directions. Names are those of the documentation: EX0C
    is X0C; squareness is C0Y, B0Z, A0Z. Offsets are in mm. Scale and positioning of single axes and
    their reversal are in `kw.ssfk` tables (0.1 µm, 0.0001°).

    Raises
    ------
    InputError
        Something that must be stated is not; errors that are not plausible; an oblique axis (the
        kernel's model has axes along X, Y and Z); no `centre_mm`.
    DataError
        An error that the measurement does not identify.
    """
    choose("layout", layout, ("ISG_CSV", "etalon"))
    said = take("ISG kernel (TF5280)", stated, NEEDS)
    known = known_errors(setup, estimate, any_size=any_size)
    check_directions(setup, "ISG kernel (TF5280)")
    chain = Chain(setup)
    values = _values(setup, known, said)
    found = _screws(setup, known)
    listed = _location_files(setup, values, said, layout) if values else {}
    name = FILE_NAMES[layout]
    unit = said["angle_unit"]
    settings = [
        Setting(
            key, name, "mm" if key[0] in "XYZ" else unit, 0.0, value, f"E{key}",
            SIGNS[key[0]] if said["sign"] == "1" else f"not: {SIGNS[key[0]]}",
            "" if said["sign"] == "1" else "correction: the negative of the error",
        )
        for key, value in values.items()
    ]  # fmt: skip
    held = known.only({*SQUARENESS, *found.held})
    return control_files(
        setup, estimate, known, f"ISG kernel (TF5280, {layout})",
        {**listed, **_lists(found, chain.letters)},
        settings + table_settings(found.tables, _names(found)),
        held, reasons=found.left, between=left_between(found.tables, 0.5 / PER_UNIT),
        notes=(LISTS, "Squareness counts from the zero of its axes: set the work offset again.",
               "The tool direction is not corrected."), seed=seed,
    )  # fmt: skip


@checked
def twincat_files(
    setup: Setup, estimate: Known, *, any_size: bool = False, seed: int = 0
) -> ControlFiles:
    """Lead-screw tables (`kw.ssfk`) of TwinCAT CNC alone, without volumetric compensation.

    Raises
    ------
    InputError
        Errors that are not plausible; a linear axis and no `[control] centre_mm`.
    DataError
        An error that the measurement does not identify.
    """
    known = known_errors(setup, estimate, any_size=any_size)
    found = _screws(setup, known)
    left = [f"{name} (axis tables have no place for location errors)" for name in known.errors]
    held = MachineErrors(effects=known.only(found.held).effects)
    return control_files(
        setup, estimate, known, "TwinCAT CNC (axis tables)", _lists(found, Chain(setup).letters),
        table_settings(found.tables, _names(found)), held, reasons=found.left, left_out=left,
        between=left_between(found.tables, 0.5 / PER_UNIT),
        notes=("lr_param.ssfk 1 in the list of each axis switches its table on.",), seed=seed,
    )  # fmt: skip


def _screws(setup: Setup, known: MachineErrors) -> AxisTables:
    return axis_tables(setup, known.effects, max_rows=MAX_POINTS, scales=True, squareness=False)


def _values(setup: Setup, known: MachineErrors, said: Mapping[str, str]) -> dict[str, float]:
    """Location errors by the kernel's names, in mm and the angle's unit, along its own axes."""
    mirror = turned_round(setup)
    per_arcsec = 1 / 3600.0 if said["angle_unit"] == "deg" else float(np.pi / 648_000)
    factors = {"µm": 1e-3, "arcsec": per_arcsec}
    sign = int(said["sign"])
    values = {k[1:]: mirror[k[1]] * sign * factors[unit_of(k)] * v for k, v in known.errors.items()}
    for effect, name in SQUARENESS_NAMES.items():
        if effect in known.effects:
            arcsec = mirror[name[0]] * known.effects[effect].get("arcsec", 0.0)
            values[name] = sign * per_arcsec * arcsec
    return values


def _location_files(
    setup: Setup, values: Mapping[str, float], said: Mapping[str, str], layout: Layout
) -> dict[str, str]:
    """Location errors, and the list file that loads them."""
    letters, name = Chain(setup).letters, FILE_NAMES[layout]
    head = [
        f"// location errors of a {setup.machine.name}, by trunnion; offsets in mm",
        *lines(said, "//"),
    ]
    loads = [
        "# logical axis numbers: as in your channel",
        f"workpiece_axes           {len(letters)}",
        f"Chain                    {said['chain']}",
        *(f"{letter:<25}{i}" for i, letter in enumerate("XYZ" + letters, start=1)),
        "Interpolation            GRID",
        "enable_splicing          FALSE",
        "manual_activation        FALSE",
        f"file[0]                  {name}",
        f"file_format[0]           {layout if layout == 'ISG_CSV' else 'Vendor'}",
    ]
    text = _csv if layout == "ISG_CSV" else _etalon
    return {
        name: "\n".join(head) + "\n" + text(values),
        "volcomp.lis": "\n".join(loads) + "\n",
    }


def _csv(values: Mapping[str, float]) -> str:
    return " ".join(values) + "\n" + " ".join(f"{value:.12f}" for value in values.values()) + "\n"


def _etalon(values: Mapping[str, float]) -> str:
    return "".join(f"[{name}]\nVALUE = {value:.12f}\n" for name, value in values.items())


def _names(found: AxisTables) -> dict[str, str]:
    return {table.name: f"axis_{table.name}.lis" for table in found.tables}


def _lists(found: AxisTables, letters: str) -> dict[str, str]:
    """`kw.ssfk` list of each axis: error = actual less set position, whole units."""
    names = _names(found)
    return {names[t.name]: _list(t, ("XYZ" + letters).index(t.over) + 1) for t in found.tables}


def _list(table: AxisTable, number: int) -> str:
    out = [
        "# logical axis number: as in your channel; values in 0.1 µm or 0.0001°",
        f"kopf.achs_nr {number}",
        "kw.ssfk.interval 0",
        f"kw.ssfk.kw_startpos {round(table.nodes[0] * PER_UNIT)}",
        f"kw.ssfk.kw_nr_max {len(table.nodes)}",
        "kw.ssfk.unit 1",
        "kw.ssfk.bilateral 1",
    ]
    rows = zip(table.nodes, table.forward, table.reverse, strict=True)
    for i, (node, forward, reverse) in enumerate(rows):
        for key, value in (("setpoint", node), ("pos", forward), ("neg", reverse)):
            out.append(f"kw.ssfk.table[{i}].{key} {round(value * PER_UNIT)}")
    return "\n".join(out) + "\n"
