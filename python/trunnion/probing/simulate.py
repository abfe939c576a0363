"""Simulation of a measurement: what the probe would record on a machine with given errors."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from trunnion.base.arguments import checked
from trunnion.base.checks import finite, instance, named
from trunnion.base.errors import InputError
from trunnion.data.times import from_first_reading
from trunnion.data.touches import Touches, without_frame
from trunnion.machine.effects import split_effects
from trunnion.machine.estimate import Estimate
from trunnion.machine.geometry import refuse_other_axes
from trunnion.machine.sizes import in_other_units
from trunnion.probing.inputs import on_machine
from trunnion.probing.mistakes import large_errors_named
from trunnion.probing.model import TouchModel
from trunnion.probing.steps import as_recorded
from trunnion.setup import Setup
from trunnion.setup.artefact import UNCERTAINTY

OFF_SURFACE_MM = 5.0


@checked
def simulate(
    plan: Touches,
    setup: Setup,
    errors: Estimate | Mapping[str, float] | None = None,
    placement: Mapping[str, float] | None = None,
    effects: Mapping[Any, Mapping[str, float]] | None = None,
    noise_um: float = 0.0,
    tick_um: float | None = None,
    seed: int | None = None,
    *,
    sample: int = 0,
) -> Touches:
    """Simulate a plan, or repeat recorded touches, on a machine with errors.

    The ball moves from the start of each approach along its direction until it touches the true
    artefact; contact is solved, on faces, edges and corners. The probe triggers at the first tick
    of travel at or after contact (plus noise).

    Parameters
    ----------
    plan
        A plan, or touches: then along the line of each recorded touch, ticks counted from the
        recorded point. With `slow_feed_mm_min` in ``[plan]`` they are recorded at that feed.
    setup
        Machine, artefact and probe.
    errors
        True location errors, µm and arcsec, by name; those of the set-up where not given. Or an
        estimate, with the placement and the effects that it has unless they are given.
    placement
        True placement of the artefact on the table, `dx_um` ... `rc_arcsec`.
    effects
        True effects: id (or a user's own effect) → parameter → value. A moment is by the clock of
        the plan; where this begins more than a day from 0, from the first touch on.
    noise_um
        1 σ of the probe's repeatability.
    tick_um
        Travel between two looks at the probe; the set-up's unless given. Coordinates are rounded
        to the `resolution_um` of the set-up.
    seed
        Of the noise; there is no noise without one.
    sample
        Number of this measurement among those of one seed: measurement i is the same however
        many are drawn.

    Returns
    -------
    Touches
        The plan's rows with the recorded ball centres.

    Raises
    ------
    InputError
        Noise without a seed, negative noise or tick, unknown names.
    DataError
        A move that does not meet the artefact, a column that an effect needs and the plan lacks; an
        estimate that was made with other axes than those of the set-up; several feeds beside
        `slow_feed_mm_min`, or one that is no faster.

    Warns
    -----
    UserWarning
        No position error reaches 0.1 µm: they may be in mm.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> made = tn.simulate(tn.plan(setup), setup, {"EX0C": 15.0}, noise_um=0.3, seed=1)
    >>> round(tn.identify(made, setup)["EX0C"], 1)
    15.0
    """
    if isinstance(errors, Estimate):
        refuse_other_axes(errors, setup)
        placement = errors.placement if placement is None else placement
        effects = errors.effects if effects is None else effects
        errors = errors.errors
    expected = "effect → parameter → value, {'drift_z': {'rate_um_h': 5.0}}"
    effects = named("effects", effects, expected)
    if finite("noise_um", noise_um) < 0:
        raise InputError(f"noise_um: got {noise_um!r}, expected 0 or a positive number")
    if noise_um > 0 and seed is None:
        raise InputError(
            "seed: got none, expected a whole number: there is no noise without a seed"
        )
    if tick_um is not None:
        UNCERTAINTY("tick_um", tick_um)
    ids, own = split_effects(effects)
    model = TouchModel(setup, ids, tick_um=tick_um)
    built_in = {effect: values for effect, values in effects.items() if isinstance(effect, str)}
    values = model.values(errors, placement, built_in)
    instance("plan", plan, Touches, "Touches, as plan or read_touches gives them")
    plan = as_recorded(plan, setup)
    from_start = plan.start_mm is not None
    timed = from_first_reading(plan)
    moves = model.moves(timed, from_start=from_start)
    # A contact is expected at the planned distance; the true surface may lie off by 5 mm.
    reach = OFF_SURFACE_MM + _longest_way_mm(plan)
    named_values = dict(zip(model.error_names, values, strict=False))
    if doubt := in_other_units(named_values):
        warnings.warn(f"simulate, errors: got {doubt}", UserWarning, stacklevel=3)
    with large_errors_named(named_values):
        travel = model.core.simulate(
            moves,
            values,
            from_start=from_start,
            reach_mm=reach,
            noise_um=noise_um,
            seed=_whole("seed", seed or 0),
            sample=_whole("sample", sample),
        )
    for effect in own:
        acting = on_machine(effect, model, timed, values)
        travel = travel + 1e-3 * acting.change(timed, effects[effect])
    start = plan.start_mm if plan.start_mm is not None else plan.position_mm
    recorded = start + travel[:, None] * plan.direction
    if step := 1e-3 * setup.probe.resolution_um:
        recorded = step * np.round(recorded / step)
    places = dict(zip(("x_mm", "y_mm", "z_mm"), recorded.T, strict=True))
    return without_frame(plan.with_columns(**places))


def _longest_way_mm(plan: Touches) -> float:
    """From the start of an approach to where it is planned to end; 0 without a start."""
    if plan.start_mm is None:
        return 0.0
    return float(np.linalg.norm(plan.position_mm - plan.start_mm, axis=1).max(initial=0.0))


def _whole(what: str, value: int) -> int:
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 0:
        raise InputError(f"{what}: got {value!r}, expected a whole number from 0")
    return int(value)
