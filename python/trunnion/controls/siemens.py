"""Siemens 840D: axis vectors and centres, encoder and sag compensation, reversal.

$TC_CARR: `trunnion.controls.toolholder`.
$AA_ENC_COMP, $AN_CEC: 6FC5397-1BP40-3BA1, K3; 808D function manual, LEC: a positive value moves the
axis in the negative direction.
"""

from __future__ import annotations

from collections.abc import Mapping

from trunnion.base.arguments import checked
from trunnion.compensation.machine import Known, MachineErrors
from trunnion.controls.axis_tables import AxisTable, AxisTables, axis_tables
from trunnion.controls.files import ControlFiles, Setting
from trunnion.controls.forecast import control_files, known_errors, left_between, table_settings
from trunnion.controls.stated import Need, take
from trunnion.controls.toolholder import CARRIER, PLACES, Toolholder
from trunnion.setup import Setup

MAX_POINTS = 200
"""Interpolation points that every control of the family has; MD 38000 allows more."""
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
        The machine with `[control] centre_mm`, for a head `pivot_mm`, and what a measurement says
        of it. Without rotary axes there is no $TC_CARR: only the tables of the axes are written.
    stated
        With axes of the table `vector_sign`, with squareness `cec_sign`: the public documentation
        does not say them.
    any_size
        Write location errors beyond 2 mm or 1°, too.
    seed
        Of the draws for the interval.

    Notes
    -----
    Axes have any direction and place here, so that with the frame of `frame.spf` nothing of the
    location errors is left; of a head's, for a tool as long as the probe: a tilt of the tool itself
    at zero has no place, and the notes say what it leaves on other tools.

    Raises
    ------
    InputError
        Something that must be stated is not; no `centre_mm`, no `pivot_mm`.
    DataError
        An error that the measurement does not identify.
    """
    known = known_errors(setup, estimate, any_size=any_size)
    squareness = any(name.startswith("squareness") for name in known.effects)
    holder = Toolholder.of(setup, known)
    needs = ((CARRIER,) if holder.table.points.size else ()) + ((SAG,) if squareness else ())
    said = take("Siemens 840D", stated, needs)
    found = axis_tables(setup, known.effects, max_rows=MAX_POINTS, scales=True, squareness=True)
    sign = int(said.get("vector_sign", "1"))
    carrier = holder.settings(Toolholder.of(setup, MachineErrors()), sign)
    files = {
        **holder.files(carrier, said),
        **_tables(found, int(said.get("cec_sign", "1"))),
    }
    notes = (
        *holder.notes(),
        "Tables load with $MA_ENC_COMP_ENABLE and $MA_CEC_ENABLE 0 only; set them 1 afterwards.",
    )
    where = {t.name: "enc_comp.ini" if t.over == t.of else "cec.ini" for t in found.tables}
    return control_files(
        setup, estimate, known, "Siemens 840D",
        files, [*carrier, *table_settings(found.tables, where), *_backlash(found)],
        known.only(found.held), reasons=found.left,
        between=left_between(found.tables, 0.5 * 10.0**-PLACES), notes=notes, seed=seed,
    )  # fmt: skip


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
