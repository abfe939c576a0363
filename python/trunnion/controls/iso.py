"""Location errors and effects by ISO 230-1 name, for any control."""

from __future__ import annotations

from trunnion.base.arguments import checked
from trunnion.base.units import unit_of
from trunnion.compensation.machine import Known
from trunnion.controls.files import ControlFiles, Setting
from trunnion.controls.forecast import SIGNS, control_files, known_errors
from trunnion.machine.chain import Chain
from trunnion.machine.estimate import Estimate
from trunnion.setup import Setup

MEANING = {"X": "offset", "Y": "offset", "Z": "offset", "A": "tilt", "B": "tilt", "C": "tilt"}


@checked
def iso_table(
    setup: Setup, estimate: Known, *, any_size: bool = False, seed: int = 0
) -> ControlFiles:
    """Location errors and effects by name as CSV, with unit, sign, frame and uncertainty.

    For a control that has no writer of its own (Fanuc, Okuma, Mazak, ...: no public page shows the
    syntax of their error files), or that people key in.

    Raises
    ------
    InputError
        Errors that are not plausible.
    DataError
        An error that the measurement does not identify.
    """
    known = known_errors(setup, estimate, any_size=any_size)
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
    settings = [
        Setting(
            name,
            "errors.csv",
            unit_of(name),
            0.0,
            value,
            f"{MEANING[name[1]]} of the {name[3]} axis",
            SIGNS[name[1]],
        )
        for name, value in known.errors.items()
    ]
    for effect, values in known.effects.items():
        units = {p.name: p.unit for p in chain.effects[effect].parameters}
        label = chain.effects[effect].label
        settings += [
            Setting(f"{effect}.{name}", "errors.csv", units[name], 0.0, value, label)
            for name, value in values.items()
        ]
    rows = []
    for one in settings:
        u = std.get(one.name)
        said = "" if u is None else f"{u:.6f}"
        rows.append(f"{one.name},{one.new:.6f},{one.unit},{said},{one.meaning}")
    files = {"errors.csv": "\n".join(head + rows) + "\n"}
    return control_files(
        setup, estimate, known, "Table by ISO 230-1", files, settings, known, seed=seed
    )
