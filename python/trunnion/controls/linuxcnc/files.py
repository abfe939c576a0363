"""What LinuxCNC loads to correct a machine, and a test of the signs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
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
from trunnion.controls.linuxcnc.axis_tables import axis_tables
from trunnion.controls.linuxcnc.kinematics import (
    check_machine,
    component,
    held,
    is_conventional,
    pin_values,
)
from trunnion.controls.linuxcnc.made import HAL, INI, Made
from trunnion.controls.linuxcnc.present import Present, read_present
from trunnion.controls.linuxcnc.sign_test import sign_test
from trunnion.controls.linuxcnc.stock import STOCK, stock
from trunnion.machine.chain import Chain
from trunnion.machine.estimate import Estimate
from trunnion.setup import Setup

NAME = "trunnionkins"
PLAUSIBLE = {"µm": 2000.0, "arcsec": 3600.0}
"""Location errors beyond 2 mm or 1° are rather a mistake in the set-up than a machine."""

Kinematics: TypeAlias = Literal["component", "stock"]


@checked
def linuxcnc_files(
    setup: Setup,
    estimate: Known,
    *,
    kinematics: Kinematics = "component",
    present: Iterable[str | Path] = (),
    any_size: bool = False,
    seed: int = 0,
) -> ControlFiles:
    """Files that correct a machine under LinuxCNC.

    Parameters
    ----------
    setup
        Machine, and ``[control] centre_mm``: where the table is in machine coordinates.
    estimate
        What a measurement says of the machine, or location errors by name (µm, arcsec).
    kinematics
        "component": a kinematics component that knows every location error, scale and squareness.
        "stock": what xyzac-trt-kins or xyzbc-trt-kins can hold: rotation points, offsets, zeros.
    present
        .hal and .ini files of the machine as it was when it was measured: old values beside the new
        ones, and zeros of the rotary axes are added to theirs.
    any_size
        Write location errors beyond 2 mm or 1°, too.
    seed
        Of the draws for the interval.

    Raises
    ------
    InputError
        A machine that cannot be held; no `centre_mm`; errors that are not plausible.
    DataError
        An error that the measurement does not identify.
    """
    check_machine(setup)
    choose("kinematics", kinematics, ("component", "stock"))
    known = MachineErrors.of(setup, estimate)
    if not any_size:
        _check_size(known.errors)
    now = read_present(present)
    own = kinematics == "component"
    made = _component(setup, known, now) if own else stock(setup, known, now)
    rotary = _range(setup)
    before = volumetric_error(setup, known, **rotary, points=(3, 3, 2)).max_um
    after = volumetric_error(
        setup, known, compensation=made.compensation, **rotary, points=(3, 3, 2)
    ).max_um
    interval = None
    if own and isinstance(estimate, Estimate) and estimate.names:
        interval = residual_interval(setup, estimate, **rotary, draws=1000, seed=seed).max_um
    return ControlFiles(
        f"LinuxCNC with {NAME if own else STOCK[check_machine(setup)]}",
        {**made.files, "sign_test.ngc": sign_test(setup)},
        made.settings,
        before,
        after,
        interval,
        made.left_out,
        made.notes,
    )


def _check_size(errors: Mapping[str, float]) -> None:
    for name, value in errors.items():
        limit = PLAUSIBLE[unit_of(name)]
        if abs(value) > limit:
            raise InputError(
                f"{name}: got {value:g} {unit_of(name)}, expected at most {limit:g}: is the "
                "set-up that of this machine (point_mm of the axes, length of the probe)? "
                "--any-size writes it"
            )


def _range(setup: Setup) -> dict[str, Any]:
    """Rotary positions for the forecast: the stated ranges, else ±90° of A or B and a turn of C."""
    ranges = setup.axis_ranges()
    out: dict[str, Any] = {"a_deg": 0, "b_deg": None}
    for letter in Chain(setup).letters:
        low, high = ranges.get(letter, (0.0, 360.0) if letter == "C" else (-90.0, 90.0))
        count = min(int((high - low) / 15) + 2, 36)
        out[f"{letter.lower()}_deg"] = tuple(np.linspace(low, high, count).tolist())
    return out


def _component(setup: Setup, known: MachineErrors, now: Present) -> Made:
    letters = check_machine(setup)
    mine = held(known)
    tables = axis_tables(setup, known.effects, letters, scales=False)
    pins = pin_values(setup, mine)
    settings = [
        Setting(f"{NAME}.{pin}", HAL, _unit(pin), now.pins.get(f"{NAME}.{pin}"), value, "total")
        for pin, value in pins.items()
        if value or now.pins.get(f"{NAME}.{pin}")
    ]
    for axis, place in zip("xyz", setup.control.centre_mm or (), strict=True):
        pin = f"{NAME}.{axis}-rot-point"
        settings.append(Setting(pin, HAL, "mm", now.pins.get(pin), place, "nominal table centre"))
    hal = [
        "# Pins of the kinematics component: after the line that loads it.",
        *(f"setp {one.name} {one.new:.6f}" for one in settings),
        f"setp {NAME}.conventional-directions {int(is_conventional(setup))}",
        "# Unless your configuration nets these pins already, under names of its own:",
        f"net trunnion-tool-offset motion.tooloffset.z => {NAME}.tool-offset",
        "net trunnion-kins-type motion.analog-out-03 => motion.switchkins-type",
    ]
    files = {
        f"{NAME}.comp": component(setup, mine),
        HAL: "\n".join(hal) + "\n",
        INI: _ini(NAME, letters, tables.files),
        **{f"{code}remap.ngc": _remap(code, kind) for code, kind in _CODES},
        **{f"comp_{axis.lower()}.txt": text for axis, text in tables.files.items()},
    }
    notes = (
        f"1. sudo halcompile --install {NAME}.comp",
        f"2. Take the lines of {INI} over into your INI file; load {HAL} after the kinematics.",
        "3. Run sign_test.ngc: it says where a mark of the table must be seen.",
        "M428: tool centre point. M429: identity, for probing and homing. M430: programs for the "
        "machine without errors. The work offset stays as it is.",
    )
    names = {*mine.effects, *tables.held}
    together = {name: values for name, values in known.effects.items() if name in names}
    every = [*known.effects, *(effect.id for effect in known.own)]
    why = "LinuxCNC has no table for it"
    return Made(
        files,
        tuple(settings),
        ModelCompensation(MachineErrors(errors=mine.errors, effects=together)),
        tuple(f"{name} ({tables.left.get(name, why)})" for name in every if name not in names),
        notes,
    )


def _unit(pin: str) -> str:
    """Unit that ends the name of a pin."""
    return pin.rpartition("-")[2].replace("um", "µm")


_CODES = (("428", 0), ("429", 1), ("430", 2))


def _remap(code: str, kind: int) -> str:
    """M-code that switches the kinematics, and waits until they are."""
    return f"o<{code}remap> sub\nM66 L0 E0\nM68 E3 Q{kind}\nM66 L0 E0\no<{code}remap> endsub\nM2\n"


def _ini(kins: str, letters: str, tables: Mapping[str, str]) -> str:
    lines = ["[KINS]", f"KINEMATICS = {kins}", f"JOINTS = {3 + len(letters)}", "[RS274NGC]"]
    lines += [f"REMAP = M{code} modalgroup=10 ngc={code}remap" for code, _ in _CODES]
    for i, axis in enumerate("XYZ" + letters):
        if axis in tables:
            lines += [f"[JOINT_{i}]", f"COMP_FILE = comp_{axis.lower()}.txt", "COMP_FILE_TYPE = 0"]
    return "\n".join(lines) + "\n"
