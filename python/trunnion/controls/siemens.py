"""Siemens 840D: axis vectors and centres, encoder and sag compensation, reversal.

$TC_CARR: 6FC5397-1DP40-6BA1, swivelling (I4 = -(I2 + I3); rotary axis 2 is based on rotary axis 1).
$AA_ENC_COMP, $AN_CEC: 6FC5397-1BP40-3BA1, K3; 808D function manual, LEC: a positive value moves the
axis in the negative direction.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.units import Floats
from trunnion.compensation.machine import Known, MachineErrors
from trunnion.controls.axis_tables import AxisTable, AxisTables, axis_tables
from trunnion.controls.files import ControlFiles, Setting
from trunnion.controls.forecast import control_files, known_errors, left_between, table_settings
from trunnion.controls.screws import Screw, screws
from trunnion.controls.stated import Need, lines, take
from trunnion.setup import Setup

MAX_POINTS = 200
"""Interpolation points that every control of the family has; MD 38000 allows more."""
PLACES = 9
CARRIER = Need(
    "vector_sign", ("1", "-1"),
    "1: V1 and V2 are the directions about which the table turns right-handed for a positive "
    "position, -1: the opposite",
)  # fmt: skip
SAG = Need(
    "cec_sign", ("1", "-1"),
    "1: $AN_CEC takes the error of the output axis, as $AA_ENC_COMP does, -1: its correction",
)  # fmt: skip


@checked
def siemens_files(
    setup: Setup,
    estimate: Known,
    *,
    stated: Mapping[str, str] | None = None,
    any_size: bool = False,
    seed: int = 0,
) -> ControlFiles:
    """Values for a Siemens 840D: $TC_CARR and kinematic chain, frame, encoder and sag compensation.

    Parameters
    ----------
    setup, estimate
        The machine (rotary axes under the table) with `[control] centre_mm`, and what a measurement
        says of it.
    stated
        `vector_sign`; with squareness also `cec_sign`: the public documentation does not say them.
    any_size
        Write location errors beyond 2 mm or 1°, too.
    seed
        Of the draws for the interval.

    Notes
    -----
    Both axes have any direction and place here, so that with the frame of `frame.spf` nothing of
    the location errors is left. Without the frame a tilt of the work as it is clamped stays.

    Raises
    ------
    InputError
        Something that must be stated is not; a rotary axis in the head; no `centre_mm`.
    DataError
        An error that the measurement does not identify.
    """
    known = known_errors(setup, estimate, any_size=any_size)
    squareness = any(name.startswith("squareness") for name in known.effects)
    said = take("Siemens 840D", stated, (CARRIER, SAG) if squareness else (CARRIER,))
    real, nominal = screws(setup, known, "Siemens 840D"), screws(setup, MachineErrors(), "")
    found = axis_tables(setup, known.effects, max_rows=MAX_POINTS, scales=True, squareness=True)
    sign = int(said["vector_sign"])
    carrier = _carrier(real, nominal, sign)
    head = [*lines(said, ";"), "; mm; vectors without unit"]
    files = {
        "tc_carr.spf": "\n".join([*head, *(f"{s.name}={s.new:.{PLACES}f}" for s in carrier)])
        + '\n$TC_CARR23[1]="P"\nM17\n',
        "kinematic_chain.csv": _chain(carrier),
        "frame.spf": _frame(real),
        **_tables(found, int(said.get("cec_sign", "1"))),
    }
    ids = set(found.held)
    held = MachineErrors(
        errors=known.errors, effects={k: v for k, v in known.effects.items() if k in ids}
    )
    notes = (
        "The frame of frame.spf is the place of the table itself at zero of its axes: chain it "
        "in front of the work offset. With the vectors alone that tilt of the work stays.",
        "Tables load with $MA_ENC_COMP_ENABLE and $MA_CEC_ENABLE 0 only; set them 1 afterwards.",
        "The tool direction is not corrected.",
    )
    where = {t.name: "enc_comp.ini" if t.over == t.of else "cec.ini" for t in found.tables}
    return control_files(
        setup, estimate, known, "Siemens 840D",
        files, [*carrier, *table_settings(found.tables, where), *_backlash(found)],
        held, reasons=found.left, between=left_between(found.tables, 0.5 * 10.0**-PLACES),
        notes=notes, seed=seed,
    )  # fmt: skip


def _carrier(real: Screw, nominal: Screw, sign: int) -> list[Setting]:
    """$TC_CARR values of I2, I3, I4, V1, V2: nominal and new."""
    made = []
    rows = (
        ("I2", (4, 5, 6), "reference point to rotary axis 1"),
        ("V1", (7, 8, 9), "direction of rotary axis 1"),
        ("V2", (10, 11, 12), "direction of rotary axis 2"),
        ("I3", (15, 16, 17), "rotary axis 1 to rotary axis 2"),
        ("I4", (18, 19, 20), "closes the chain: -(I2 + I3)"),
    )
    old, new = _vectors(nominal, sign), _vectors(real, sign)
    for name, numbers, meaning in rows:
        for number, axis, was, now in zip(numbers, "XYZ", old[name], new[name], strict=True):
            why = "point of the axis nearest to the nominal" if name[0] == "I" else ""
            made.append(
                Setting(
                    f"$TC_CARR{number}[1]", "tc_carr.spf", "" if name[0] == "V" else "mm",
                    float(was), float(now), f"{name} {axis}: {meaning}",
                    f"towards +{axis} of the machine", why if abs(now - was) > 1e-9 else "",
                )
            )  # fmt: skip
    return made


def _vectors(screw: Screw, sign: int) -> dict[str, Floats]:
    first, second = screw.points
    return {
        "I2": first,
        "I3": second - first,
        "I4": -second,
        "V1": sign * screw.directions[0],
        "V2": sign * screw.directions[1],
    }


def _chain(carrier: list[Setting]) -> str:
    """Return the same values as elements of a kinematic chain."""
    kinds = {"I2": "OFFSET", "V1": "AXIS_ROT", "I3": "OFFSET", "V2": "AXIS_ROT", "I4": "OFFSET"}
    rows = ["element,type,x,y,z"]
    for name, kind in kinds.items():
        values = [f"{s.new:.{PLACES}f}" for s in carrier if s.meaning.startswith(f"{name} ")]
        rows.append(",".join((name, kind, *values)))
    return "\n".join(rows) + "\n"


def _frame(real: Screw) -> str:
    """Frame of the table at zero; CROT turns about Z, then the new Y, then the new X."""
    turn, shift = real.zero[:3, :3], real.zero[:3, 3]
    about_y = np.arcsin(-turn[2, 0])
    about_x = np.arctan2(turn[2, 1], turn[2, 2])
    about_z = np.arctan2(turn[1, 0], turn[0, 0])
    x, y, z = shift
    a, b, c = np.degrees([about_x, about_y, about_z])
    return (
        "; the table at zero of its axes, about the reference point; RPY: Z, Y', X'' "
        "(MD 10600 = 1)\n"
        f"$P_UIFR[1]=CTRANS(X,{x:.{PLACES}f},Y,{y:.{PLACES}f},Z,{z:.{PLACES}f})"
        f":CROT(X,{a:.{PLACES}f},Y,{b:.{PLACES}f},Z,{c:.{PLACES}f})\nM17\n"
    )


def _tables(found: AxisTables, cec_sign: int) -> dict[str, str]:
    encoder = [line for t in found.tables if t.over == t.of for line in _encoder(t)]
    cross = [t for t in found.tables if t.over != t.of]
    sag = [line for i, t in enumerate(cross) for line in _sag(i, t, cec_sign)]
    files = {}
    if encoder:
        files["enc_comp.ini"] = "\n".join(["CHANDATA(1)", *encoder, "M17"]) + "\n"
    if sag:
        files["cec.ini"] = "\n".join(["CHANDATA(1)", *sag, "M17"]) + "\n"
    return files


def _encoder(table: AxisTable) -> list[str]:
    """Mean error of both senses; a positive value moves the axis in the negative direction."""
    axis = f"{table.of}1"
    rows = [f"$AA_ENC_COMP[0,{i},{axis}]={v:.{PLACES}f}" for i, v in enumerate(table.error)]
    more = (("STEP", table.step), ("MIN", table.nodes[0]), ("MAX", table.nodes[-1]))
    rows += [f"$AA_ENC_COMP_{key}[0,{axis}]={value:g}" for key, value in more]
    rows.append(f"$AA_ENC_COMP_IS_MODULO[0,{axis}]=0")
    if table.width:
        rows.append(f"$MA_BACKLASH[0,{axis}]={table.width:.{PLACES}f}")
    return rows


def _sag(index: int, table: AxisTable, sign: int) -> list[str]:
    rows = [f"$AN_CEC[{index},{i}]={sign * v:.{PLACES}f}" for i, v in enumerate(table.error)]
    more = (("STEP", table.step), ("MIN", table.nodes[0]), ("MAX", table.nodes[-1]))
    return [
        *rows,
        f"$AN_CEC_INPUT_AXIS[{index}]=({table.over}1)",
        f"$AN_CEC_OUTPUT_AXIS[{index}]=({table.of}1)",
        *(f"$AN_CEC_{key}[{index}]={value:g}" for key, value in more),
        f"$AN_CEC_DIRECTION[{index}]=0",
        f"$AN_CEC_IS_MODULO[{index}]=0",
    ]


def _backlash(found: AxisTables) -> list[Setting]:
    return [
        Setting(
            f"$MA_BACKLASH[0,{t.of}1]", "enc_comp.ini", t.unit, None, t.width, "reversal",
            "the axis falls short after a reversal",
        )
        for t in found.tables if t.width
    ]  # fmt: skip
