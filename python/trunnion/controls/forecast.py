"""What is common to all writers: errors that may be written, and what their files leave."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from trunnion.base.errors import InputError
from trunnion.base.units import unit_of
from trunnion.compensation.control import Compensation, ControlModel, ModelCompensation
from trunnion.compensation.forecast import Left
from trunnion.compensation.machine import Known, MachineErrors
from trunnion.compensation.uncertainty import residual_interval
from trunnion.compensation.workspace import Workspace, work_space
from trunnion.controls.axis_tables import AxisTable
from trunnion.controls.files import SETTINGS, ControlFiles, Setting, settings_text
from trunnion.machine.estimate import Estimate
from trunnion.machine.sizes import PLAUSIBLE
from trunnion.setup import Setup

SIGNS = {
    "X": "the axis lies towards +X of the machine frame",
    "Y": "the axis lies towards +Y of the machine frame",
    "Z": "the axis lies towards +Z of the machine frame",
    "A": "tilted right-handed about X",
    "B": "tilted right-handed about Y",
    "C": "tilted right-handed about Z",
}
"""What a positive location error means, by its second letter."""


def known_errors(setup: Setup, estimate: Known, *, any_size: bool) -> MachineErrors:
    """Errors that may go into a control.

    Raises DataError: an error that the measurement does not identify.
    Raises InputError: one that is not plausible, unless `any_size`.
    """
    known = MachineErrors.to_compensate(setup, estimate)
    for name, value in known.errors.items():
        limit = PLAUSIBLE[unit_of(name)]
        if not any_size and abs(value) > limit:
            raise InputError(
                f"{name}: got {value:g} {unit_of(name)}, expected at most {limit:g}: is the "
                "set-up that of this machine (point_mm of the axes, length of the probe), and the "
                "error in that unit? --any-size writes it"
            )
    return known


def control_files(
    setup: Setup,
    estimate: Known,
    known: MachineErrors,
    control: str,
    files: Mapping[str, str],
    settings: Sequence[Setting],
    held: MachineErrors | Compensation,
    *,
    reasons: Mapping[str, str] | None = None,
    left_out: Sequence[str] = (),
    notes: Sequence[str] = (),
    between: Mapping[str, float] | None = None,
    remaining: MachineErrors | None = None,
    seed: int = 0,
) -> ControlFiles:
    """Judge files by what they leave on the machine as estimated.

    held: Errors that the files hold exactly but for `between`, or the compensation that they are.
    reasons: Effect → why it is not held; for the others the control has no place.
    remaining: Errors that a compensation meets, tables having taken off the others; None: all.
    """
    compensation = ModelCompensation(held) if isinstance(held, MachineErrors) else held
    where = work_space(setup)
    before = Left.by("", setup, known, None, where)
    after = Left.by("", setup, remaining or known, compensation, where)
    interval = _interval(setup, estimate, remaining or known, compensation, where, seed)
    why = f"{control.partition(' (')[0]} has no place for it"
    every = [*known.effects, *(effect.id for effect in known.own)]
    if isinstance(held, MachineErrors):
        in_files = {*held.effects, *(effect.id for effect in held.own)}
        every = [x for x in every if x not in in_files]
    elif remaining is not None:
        every = [x for x in every if x in remaining.effects and x in (reasons or {})]
    else:
        every = []
    left = [*left_out, *(f"{x} ({(reasons or {}).get(x, why)})" for x in every)]
    made = {**files, SETTINGS: settings_text(settings)}
    return ControlFiles(
        control, made, tuple(settings), before.max_um, after.max_um, interval,
        tuple(left), tuple(notes),
        {name: size for name, size in (between or {}).items() if size > 0} or None,
        (before.rms_um, after.rms_um), after.direction_arcsec, where.in_words(setup),
        dict(known.errors), dict(estimate.std_errors) if isinstance(estimate, Estimate) else {},
    )  # fmt: skip


def _interval(
    setup: Setup,
    estimate: Known,
    meets: MachineErrors,
    compensation: Compensation,
    where: Workspace,
    seed: int,
) -> tuple[float, float] | None:
    """Interval of the largest error left, 95 %.

    None without a covariance, and with motions of the linear axes, whose covariance is not known.

    meets: Errors that the compensation meets; what tables hold is as good as its estimate.
    """
    if not (isinstance(estimate, Estimate) and estimate.names):
        return None
    if not isinstance(compensation, ControlModel) or meets.own:
        return None
    every = MachineErrors.of(setup, estimate)
    zero = {k: v if k in meets.effects else dict.fromkeys(v, 0.0) for k, v in every.effects.items()}
    from_residuals = setup.probe.repeatability_um == 0 and np.isfinite(estimate.degrees_of_freedom)
    freedom = estimate.degrees_of_freedom if from_residuals else None
    return residual_interval(
        setup, replace(meets, effects=zero), **where.arguments(), compensation=compensation,
        covariance=estimate.covariance, names=estimate.names, degrees_of_freedom=freedom,
        draws=1000, seed=seed,
    ).max_um  # fmt: skip


def table_settings(tables: Sequence[AxisTable], names: Mapping[str, str]) -> list[Setting]:
    """Each table as its largest value: people see where it goes and over which range it holds."""
    made = []
    for table in tables:
        per = 1e3 if table.of in "XYZ" else 3600.0
        both = np.concatenate([table.forward, table.reverse])
        largest = float(both[np.argmax(np.abs(both))])
        made.append(
            Setting(
                table.name, names[table.name], "µm" if table.of in "XYZ" else "arcsec", None,
                per * largest, f"largest of {len(table.nodes)} values every {table.step:g} "
                f"{table.unit}: {', '.join(table.effects)}",
                "the axis comes further in + than it is sent", "", table.holds,
            )
        )  # fmt: skip
    return made


def left_between(tables: Sequence[AxisTable], rounding: float) -> dict[str, float]:
    """What tables leave between their nodes, µm and arcsec; `rounding` in mm and degrees."""
    per = {table.name: 1e3 if table.of in "XYZ" else 3600.0 for table in tables}
    return {table.name: per[table.name] * (table.left + rounding) for table in tables}
