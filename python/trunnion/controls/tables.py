"""Location errors as tables: by ISO 230-1 name for any control, and for the ISG kernel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import choose
from trunnion.base.errors import InputError
from trunnion.base.units import unit_of
from trunnion.compensation.control import ModelCompensation
from trunnion.compensation.machine import Known, MachineErrors
from trunnion.compensation.uncertainty import residual_interval
from trunnion.compensation.volumetric import volumetric_error
from trunnion.controls.files import ControlFiles, Setting
from trunnion.machine.chain import Chain
from trunnion.machine.estimate import Estimate
from trunnion.setup import Setup

AngleUnit: TypeAlias = Literal["rad", "deg"]
MEANING = {
    "X": "offset of the axis along X",
    "Y": "offset of the axis along Y",
    "Z": "offset of the axis along Z",
    "A": "tilt of the axis about X",
    "B": "tilt of the axis about Y",
    "C": "tilt of the axis about Z",
}
ISG_LIST = """workpiece_axes           0
X                        1
Y                        2
Z                        3
Interpolation            GRID
enable_splicing          FALSE
manual_activation        FALSE
file[0]                  {file}
file_format[0]           ISG_CSV
"""


@checked
def iso_table(setup: Setup, estimate: Known) -> ControlFiles:
    """Location errors and effects by name as CSV, with unit, sign, frame and uncertainty.

    For a control that has no writer of its own, or that people key in.

    Raises
    ------
    DataError
        An error that the measurement does not identify.
    """
    known = MachineErrors.of(setup, estimate)
    std = estimate.std_errors if isinstance(estimate, Estimate) else {}
    chain = Chain(setup)
    head = [
        f"# machine {setup.machine.name}; names of ISO 230-1 and -7",
        "# frame: the machine's, right-handed, Z along the spindle, origin in the centre of the "
        "table top; errors are absolute in it",
        "# sign: where the real axis is, less where the nominal one is; tilts right-handed",
        "# a positive rotary position turns the table right-handed; primes of ISO 841 turn the "
        "other way",
        f"# order of the rotary axes from the bed: {', '.join(chain.letters)}",
        "name,value,unit,standard_uncertainty,meaning",
    ]
    rows = [
        (name, value, unit_of(name), std.get(name), f"{MEANING[name[1]]}, {name[3]} axis")
        for name, value in known.errors.items()
    ]
    for effect, values in known.effects.items():
        label = chain.effects[effect].label
        for parameter, value in values.items():
            unit = next(p.unit for p in chain.effects[effect].parameters if p.name == parameter)
            key = f"{effect}.{parameter}"
            rows.append((key, value, unit, std.get(key), label))
    lines = [
        f"{name},{value:.6f},{unit},{'' if u is None else f'{u:.6f}'},{said}"
        for name, value, unit, u, said in rows
    ]
    settings = tuple(
        Setting(name, "errors.csv", unit, None, v, said) for name, v, unit, _, said in rows
    )
    text = "\n".join(head + lines) + "\n"
    return _made(setup, estimate, known, "Table by ISO 230-1", {"errors.csv": text}, settings, ())


@checked
def isg_files(
    setup: Setup,
    estimate: Known,
    *,
    angle_unit: AngleUnit | None = None,
    sign: int | None = None,
) -> ControlFiles:
    """Volumetric compensation of the ISG kernel (Beckhoff TF5280): list file and ISG_CSV.

    Parameters
    ----------
    setup, estimate
        The machine, and what a measurement says of it.
    angle_unit, sign
        Unit of angles in the file, and 1 where it wants the errors of the machine, -1 where it
        wants their corrections. The public documentation says neither: ask your control's
        builder, or try one error.

    Notes
    -----
    The kernel corrects positions, not tool directions. Names are those of the documentation: EX0C
    is X0C. Offsets are written in mm.

    Raises
    ------
    InputError
        No `angle_unit` or `sign`.
    DataError
        An error that the measurement does not identify.
    """
    if angle_unit is None or sign is None:
        missing = "angle_unit (rad, deg)" if angle_unit is None else "sign (1, -1)"
        raise InputError(
            f"ISG_CSV: got no {missing}, expected both: the public documentation of the format "
            f"does "
            "not say them; ask the control's builder, or try one error"
        )
    choose("angle_unit", angle_unit, ("rad", "deg"))
    if sign not in (1, -1):
        raise InputError(f"sign: got {sign}, expected 1 or -1")
    known = MachineErrors.of(setup, estimate)
    per_arcsec = 1 / 3600.0 if angle_unit == "deg" else float(np.pi / 648_000)
    factors = {"µm": 1e-3, "arcsec": per_arcsec}
    values = {k[1:]: sign * factors[unit_of(k)] * v for k, v in known.errors.items()}
    said = "errors of the machine" if sign > 0 else "corrections, the negative of the errors"
    lines = [
        f"// location errors of a {setup.machine.name}, by trunnion",
        f"// offsets in mm, angles in {angle_unit}: {said}; unit and sign were given by the user,",
        "// the public documentation of ISG_CSV does not state them: test one error first",
        " ".join(values),
        " ".join(f"{value:.12f}" for value in values.values()),
    ]
    settings = tuple(
        Setting(name, "location.csv", "mm" if name[0] in "XYZ" else angle_unit, None, v, f"E{name}")
        for name, v in values.items()
    )
    left = tuple(f"{name} (not written: location errors only)" for name in known.effects)
    files = {
        "location.csv": "\n".join(lines) + "\n",
        "volcomp.lis": ISG_LIST.format(file="location.csv"),
    }
    held = MachineErrors(errors=known.errors)
    notes = (
        "Put both files where vol_comp[0].file_name points to; #VOLCOMP ON [ID0] in the program.",
        "The tool direction is not corrected.",
    )
    return _made(setup, estimate, known, "ISG kernel (TF5280)", files, settings, left, held, notes)


def _made(
    setup: Setup,
    estimate: Known,
    known: MachineErrors,
    control: str,
    files: Mapping[str, str],
    settings: tuple[Setting, ...],
    left: tuple[str, ...],
    held: MachineErrors | None = None,
    notes: tuple[str, ...] = (),
) -> ControlFiles:
    """Judge files by what they leave on the machine as estimated."""
    tilt = Chain(setup).tilting
    rotary: dict[str, Any] = {
        "a_deg": (-90, -45, 0, 45, 90) if tilt == "A" else 0,
        "b_deg": (-90, -45, 0, 45, 90) if tilt == "B" else None,
        "c_deg": tuple(range(0, 360, 30)),
    }
    before = volumetric_error(setup, known, **rotary, points=(3, 3, 2)).max_um
    after = volumetric_error(
        setup, known, compensation=ModelCompensation(held or known), **rotary, points=(3, 3, 2)
    ).max_um
    interval = None
    if isinstance(estimate, Estimate) and estimate.names:
        interval = residual_interval(setup, estimate, **rotary, draws=1000).max_um
    return ControlFiles(control, files, settings, before, after, interval, left, notes)
