"""What a user should know of a plan before it runs: what was assumed, what it does not identify."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trunnion.base.checks import instance
from trunnion.base.errors import DataError
from trunnion.base.statistics import linear_fit
from trunnion.base.units import without_unit
from trunnion.data.touches import Touches
from trunnion.machine.estimate import in_words, named_combination
from trunnion.machine.sizes import length_doubts
from trunnion.probing.design import missing_positions
from trunnion.probing.mistakes import offsets_along_z
from trunnion.probing.model import TouchModel
from trunnion.probing.steps import as_recorded, offset_too, taken_by_offset
from trunnion.setup import Setup
from trunnion.setup.artefact import HOLDERS

FAST_MM_MIN = 2000.0
"""Feed of an approach above which it is said how far the ball goes on: 0.6 mm at `USUAL_MM_S2`."""
SIGMA_UM = 0.125
"""Repeatability of the best probes (1 sigma); rounding to ticks up to twice of it is random."""
USUAL_MM_S2 = 1000.0
"""Acceleration of linear axes, for an example where the set-up states none."""


def plan_notes(plan: Touches, setup: Setup) -> tuple[str, ...]:
    """Sentences on a plan: what is kept clear of, and which location errors it does not identify.

    Parameters
    ----------
    plan
        A plan of this set-up, or touches.
    setup
        Machine, artefact, probe and table.

    Returns
    -------
    tuple of str
        A sentence each, for the user of a program.

    Raises
    ------
    InputError
        Not a plan, or not a set-up.

    Examples
    --------
    >>> import trunnion as tn
    >>> setup = tn.Setup(tn.Artefact("cross"))
    >>> print(tn.plan_notes(tn.plan(setup), setup)[0])
    Keeps clear as long as the artefact stands within 2 mm and 1 deg of its place.
    """
    instance("plan", plan, Touches, "Touches, as plan or read_touches gives them")
    instance("setup", setup, Setup, "a Setup, as read_setup gives it")
    feeds = () if plan.feed_mm_min is None else plan.feed_mm_min.tolist()
    return (
        *assumptions(setup),
        *taken_by_offset(plan, setup),
        *fast_approaches(feeds, setup),
        *_coarse_commands(plan, setup),
        *_not_identifiable(plan, setup),
    )


def fast_approaches(feeds_mm_min: Sequence[float], setup: Setup) -> list[str]:
    """Say how far the ball goes on behind the contact, where that may be more than a probe takes.

    ASCII, for the head of a program.
    """
    feed = max(feeds_mm_min, default=0.0)
    stated = setup.control.acceleration_mm_s2
    further_mm = goes_on_mm(feed, setup)
    if feed <= FAST_MM_MIN and not (stated and further_mm > setup.plan.overtravel_mm):
        return []
    at = "" if stated else " if acceleration_mm_s2 of [control], not stated, is"
    so = "The probe must take that."
    if further_mm > (limit := setup.plan.overtravel_mm):
        so = (
            f"That is more than [plan] overtravel_mm = {limit:g}: nothing but the end of the "
            "approach would stop it, and no program is written of it."
        )
    return [
        f"Touch {feeds_mm_min.index(feed) + 1} approaches at {feed:g} mm/min: the ball goes on by "
        f"feed^2 / 2 acceleration, {further_mm:.3g} mm{at or ' at'} {stated or USUAL_MM_S2:g} "
        f"mm/s^2. {so} Is its feed_mm_min right?"
    ]


def _coarse_commands(plan: Touches, setup: Setup) -> list[str]:
    """Say where starts cannot lie between two looks, so that dither does nothing.

    A probe that scatters by half a tick, or more, rounds at random all the same.
    """
    probe, step = setup.probe, setup.resolution.linear_um
    if plan.feed_mm_min is None and probe.servo_period_ms:
        return []
    feeds = as_recorded(plan, setup).feed_mm_min
    ticks = np.asarray(probe.ticks_um(np.zeros(1) if feeds is None else feeds))
    tick = float(ticks[ticks > 2 * max(probe.repeatability_um, SIGMA_UM)].min(initial=np.inf))
    if step < tick:
        return []
    return [
        f"The starts lie on steps of {step:g} um ([resolution] linear_um), which are no finer than "
        f"the tick of {tick:.3g} um: dither does nothing, touches alike round alike, and up to "
        "half a tick may look like an error of the machine. Finer commands, or a faster feed of "
        "the measuring pass, would vary the starts within a tick."
    ]


def goes_on_mm(feed_mm_min: float, setup: Setup) -> float:
    """How far the ball goes on behind a contact at a feed, mm."""
    return (feed_mm_min / 60) ** 2 / (2 * (setup.control.acceleration_mm_s2 or USUAL_MM_S2))


def check_feeds(feeds_mm_min: Sequence[float], setup: Setup) -> None:
    """Refuse approaches that only the end of their way would stop, not the contact.

    Raises DataError: the ball would go on by more than the overtravel.
    """
    feed = max(feeds_mm_min, default=0.0)
    limit, further_mm = setup.plan.overtravel_mm, goes_on_mm(feed, setup)
    if further_mm > limit:
        acceleration = setup.control.acceleration_mm_s2
        at = f"{acceleration or USUAL_MM_S2:g} mm/s²" + ("" if acceleration else " (not stated)")
        raise DataError(
            f"touch {list(feeds_mm_min).index(feed) + 1}: feed_mm_min: got {feed:g}, at which the "
            f"ball goes on by {further_mm:.3g} mm behind the contact (feed² / 2 acceleration, at "
            f"[control] acceleration_mm_s2 {at}); expected less than [plan] overtravel_mm = "
            f"{limit:g}: nothing but the end of the approach would stop it"
        )


def assumptions(setup: Setup) -> list[str]:
    """Say what is kept clear of, and which of it the set-up does not state."""
    artefact, table = setup.artefact, setup.table
    said = [
        f"Keeps clear as long as the artefact stands within {artefact.tolerance_mm:g} mm and "
        f"{artefact.tolerance_deg:g} deg of its place{offset_too(setup)}."
    ]
    if table.is_assumed:
        said.append(
            f"No [table] in the set-up: a table of radius {table.radius_mm:g} mm and thickness "
            f"{table.thickness_mm:g} mm is assumed."
        )
    said += length_doubts(setup)
    if artefact.lowest_mm < 0.0:
        name = next((n for n in ("centre_mm", "spheres_mm") if getattr(artefact, n)), "place_mm")
        said.append(
            f"The {artefact.kind} reaches {-artefact.lowest_mm:.4g} mm below the top of the table, "
            f"from which heights count: is artefact.{name} right?"
        )
    elif artefact.kind in ("sphere", "spheres") and artefact.stem_diameter_mm is None:
        said.append(
            "No stem_diameter_mm in the set-up: the sphere is assumed to stand on a stem of "
            f"{artefact.effective_stem_diameter_mm:.3g} mm."
        )
    if setup.probe.body_diameter_mm == 0.0:
        said.append(
            "No body_diameter_mm of the probe in the set-up: ball and stem are kept clear, its "
            "body, the holder and the spindle nose are not."
        )
    for name in HOLDERS:
        if getattr(artefact, name) is not None and artefact.holder is not None:
            sizes = ", ".join(
                f"{without_unit(key)} {size:g} mm" for key, size in artefact.holder.items()
            )
            said.append(
                f"Keeps clear of a {name}: {sizes}. The artefact is taken to stand "
                f"{artefact.effective_place_mm[2]:g} mm above the table."
            )
    return said


def _not_identifiable(plan: Touches, setup: Setup) -> list[str]:
    """Say which location errors the touches do not identify, and beside what."""
    model = TouchModel(setup)
    _, jacobian = model.core.linearise(model.moves(plan), model.values())
    fit = linear_fit(jacobian, np.zeros(len(jacobian)), hold=~model.unknown)
    std = dict(zip(model.names, map(float, fit.std), strict=True))
    missing = [name for name in model.error_names if np.isinf(std[name])]
    length = _tool_length(setup, std)
    if not missing:
        return length
    combinations = [named_combination(model.names, row) for row in fit.combinations]
    why = [in_words(c) for c in combinations if set(c) & set(missing)]
    advice = missing_positions(plan, setup)
    return [
        f"These touches do not identify {', '.join(missing)}. {' '.join(why)}",
        *length,
        *advice,
    ]


def _tool_length(setup: Setup, std: Mapping[str, float]) -> list[str]:
    """Say where a wrong length of the tool would be, unless an error of its own shows it."""
    offsets = offsets_along_z(setup)
    if "table" in offsets and np.isfinite(std[offsets["table"]]):
        return []
    names = [*offsets.values(), "dz_um"]
    alone = (
        "alone: no error of the machine shows it" if len(names) == 1 else "and in no other error"
    )
    if "head" in offsets:
        alone += ", where the control takes that length along Z"
    return [
        "A tool's length measured to the tip of the ball, not to its centre, is in "
        f"{' and '.join(names)} {alone}."
    ]
