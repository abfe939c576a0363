"""Families of causes: what the sign of a size means at a machine, and what to do about it.

One table for all kinds of data: a family is found by what a cause belongs to, else by its id.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from trunnion.base.report import rough
from trunnion.base.units import ARCSEC, unit_of
from trunnion.diagnosis.joint_ids import Happened, JointId
from trunnion.machine.effects import Owner

LENGTH_MM = 300.0  # over which an inclination is stated where no travel is known
RADIUS_MM = 100.0


@dataclass(frozen=True)
class Family:
    """Causes that mean the same and need the same hands.

    Attributes
    ----------
    name
        What people call them.
    ids
        Regular expression of the ids; its groups are the letters of axes in `plus` and `minus`.
    advice
        What to do.
    plus, minus
        What a positive and a negative size mean; empty: its sign says nothing at the machine.
    over
        What makes a length of an angle or a ratio: a travel, or a radius.
    grows
        Whether it grows along the measurement, so that its words want what it has reached.
    """

    name: str
    ids: str
    advice: str
    plus: str = ""
    minus: str = ""
    over: Literal["", "length", "radius"] = ""
    grows: bool = False


_SQUARENESS = (
    "level the machine first and measure again; if it stays, align the guide or the column, or "
    "enter it as perpendicularity compensation of the control."
)
WARM = (
    "let machine and instrument run until they are warm and measure again; find what heats "
    "(spindle, screw, sun, door) before anything is compensated."
)
_LARGER = "the angle between +{a} and +{b} is larger than 90°"
_SMALLER = "the angle between +{a} and +{b} is smaller than 90°"
_LOST = (
    "lost motion: after a reversal the axis stops short",
    "no lost motion: after a reversal the axis goes too far (compensation set too large?)",
)

OF_BREAK = Family(
    "measurement in two parts",
    r"zero_shift(_[xyz])?|location_shift_[abc]",
    "measure again in one go, or begin again after a break with readings that were taken before "
    "it: what differs between the two is the shift.",
)
OF_CYCLES = Family(
    "not the same all the time",
    r"(zero|scale)_of_cycle|scale_change",
    "find what was done or what happened in between: a homing, a zero of the instrument, a "
    "temperature compensation or an error table that was switched, heat that came or went; measure "
    "again without it before anything is compensated.",
)
FAMILIES = (
    OF_BREAK,
    OF_CYCLES,
    Family(
        "friction at reversal",
        r"reversal_spike_.|friction_.|friction_direction_.|stribeck_.",
        "look at lubrication, wipers and preload of the guide; then set the friction compensation "
        "of the drive.",
    ),
    Family(
        "backlash",
        r"backlash(_[xyz])?|lost_motion.*",
        "look at thrust bearing, nut and coupling; enter what is left as backlash compensation of "
        "the control.",
        plus=_LOST[0],
        minus=_LOST[1],
    ),
    Family(
        "backlash",
        r"backlash_slope_(?P<a>[xyz])",
        "look at the friction of guide and nut (it winds up a screw that is held at one end, the "
        "more the farther the nut is), and at the wear of the screw; one value of backlash "
        "compensation takes off what is left in the middle only.",
        "the backlash is larger towards +{a}",
        "the backlash is larger towards −{a}",
    ),
    Family(
        "backlash",
        r"backlash_slope_[xyz]_along_(?P<a>[xyz])",
        "the carriage turns a little as the axis turns back: look at the play of its guide (a worn "
        "or loose side, a drive beside the middle) and take it out there; one value of backlash "
        "compensation takes off what is left in the middle only.",
        "the backlash is larger towards +{a}",
        "the backlash is larger towards −{a}",
    ),
    Family(
        "lateral play",
        r"lateral_play_(?P<a>[xyz])_of_(?P<b>[xyz])",
        "look at the play of the guide across its travel (carriages, gibs, their preload and wear) "
        "and take it out there; backlash compensation of the control does not act on it.",
        "while {b} travels towards +, the tool stands on the −{a} side",
        "while {b} travels towards +, the tool stands on the +{a} side",
    ),
    Family(
        "backlash",
        r"[abc]_backlash|backlash_[abc]",
        "look at gear and clamping; enter what is left as backlash compensation of the control.",
        plus=_LOST[0],
        minus=_LOST[1],
    ),
    Family(
        "backlash",
        r"reversal(_of_position|_slope)?",
        "see first what backlash compensation the control has now; look at thrust bearing, nut and "
        "coupling; then change the compensation by the value that is left.",
        plus=_LOST[1],
        minus=_LOST[0],
    ),
    Family(
        "squareness",
        r"squareness_(?P<a>x|y)(?P<b>y|(?<=y)z)",
        _SQUARENESS,
        _LARGER,
        _SMALLER,
        "length",
    ),
    Family("squareness", r"squareness_(?P<a>x)(?P<b>z)", _SQUARENESS, _SMALLER, _LARGER, "length"),
    Family("squareness", r"wrist_squareness", _SQUARENESS),
    Family(
        "scale",
        r"scale(_[a-z])?|positioning_scale",
        "see first how warm scale or screw were (1 K is about 11 ppm of steel); what is left goes "
        "into the error table of the axis in the control.",
        "the axis travels too far",
        "the axis does not travel far enough",
        "length",
    ),
    Family(
        "scale of all axes",
        r"scale_[xyz]{2,3}",
        "all axes alike: see how warm machine, scales and instrument were (1 K is about 11 ppm of "
        "steel), and compare the length of the instrument or artefact with its certificate; what "
        "is left goes into the error tables of these axes in the control.",
        "the axes travel too far",
        "the axes do not travel far enough",
        "length",
    ),
    Family(
        "positioning, rotary axis",
        r"[abc]_(positioning|scale).*|positioning_(\d+|trend)|harmonic_\d+",
        "enter it as error table of the axis in the control; once a turn comes from a scale or "
        "gear that is not centred, twice a turn from one that is tilted or oval: look at its seat.",
        over="radius",
    ),
    Family(
        "positioning curve",
        r"curve|positioning_[xyz]",
        "enter the curve as error table of the axis in the control (pitch error compensation), "
        "once what depends on time is mended.",
    ),
    Family(
        "periodic error",
        r"(periodic|cyclic)(_.)?|._cyclic|positioning_cyclic|screw_cyclic.*",
        "compare its period with the lead of the screw (coupling, bearing of the screw), the teeth "
        "of the gear, and the period of the scale (clean and adjust the reading head). An error "
        "table helps only if its steps are shorter than a quarter of the period.",
    ),
    Family(
        "error motion of a rotary axis",
        r"(._)?(radial|axial|tilt|wobble)(_\d+|_trend)?|[abc]_twist",
        "look at the bearing of the axis, its preload and its seat; only a control with a "
        "volumetric compensation can take it off.",
    ),
    Family(
        "guide",
        r"(straightness|angular)_.*|._sag|gravity|field",
        "level the machine, then look at guides and foundation; only a control with a volumetric "
        "compensation can take it off.",
    ),
    Family(
        "location of an axis",
        r"rotary_centre|base_shift.*",
        "measure where the rotary axes are by touches or a ball, and enter it in the control.",
    ),
    Family(
        "shape of a surface",
        r"twist|bow|kink(_[xy])?",
        "adjust the feet or shims of the bed and read the level again; scrape or grind only what "
        "stays after that.",
    ),
    Family(
        "servo",
        r"(gain|time_constant|loop_delay|velocity_forward|acceleration_forward|offset)_."
        r"|gain_mismatch",
        "tune the drive: axes that interpolate get the same loop gain and feed-forward.",
    ),
    Family(
        "resonance",
        r"resonance_.",
        "lower the jerk or set a filter of the drive at its frequency; look at the mounting.",
    ),
    Family(
        "drift",
        r"(common_|cycle_)?drift|warmup",
        WARM,
        "the readings rise",
        "the readings fall",
        grows=True,
    ),
    Family(
        "drift",
        r"(drift|warmup)_(?P<a>[xyz])",
        WARM,
        "the tool moves towards +{a}, seen from the work",
        "the tool moves towards −{a}, seen from the work",
        grows=True,
    ),
    Family(
        "drift",
        r"expansion|leg_expansion.*|screw_warmup(_[xyz])?",
        WARM,
    ),
    Family(
        "tool that grows",
        r"tool_heating",
        "correct the program of the next part by this curve (trunnion turning correct), or keep "
        "the insert cool: coolant, a pause before the last pass, less depth in it.",
        "the diameter gets smaller along the cut",
        "the diameter gets larger along the cut",
        grows=True,
    ),
    Family(
        "tool that wears",
        r"tool_wear",
        "change the insert, or add the wear to the offset of the tool after each part.",
    ),
    Family(
        "alignment of the lathe",
        r"taper|barrel",
        "turn a test bar without tailstock; if it stays, align headstock or tailstock, or correct "
        "the program (trunnion turning correct).",
    ),
    Family(
        "part that gives way",
        r"bending|chuck_tilt",
        "support the part (tailstock, steady rest), or take less depth in the last pass; then "
        "correct the program (trunnion turning correct).",
    ),
    Family(
        "cut",
        r"chatter|block_acceleration",
        "change speed or overhang of the tool, and smooth the path of the last pass.",
    ),
    Family(
        "part that grows",
        r"workpiece_heating",
        "measure the part when it is cold; use coolant or pause before the last pass.",
    ),
)
OTHER = Family(
    "other", r".*", "no advice is known for this cause: find it at the machine before you act."
)
OWNED = {
    Owner.INSTRUMENT: Family(
        "instrument",
        "",
        "it belongs to the instrument, not to the machine: have it calibrated. The other results "
        "are free of it.",
    ),
    Owner.ARTEFACT: Family(
        "artefact",
        "",
        "it belongs to the artefact, not to the machine: have it calibrated. The other results are "
        "free of it.",
    ),
    Owner.PLACEMENT: Family(
        "clamping",
        "",
        "what is clamped has moved, not the machine: clamp it anew and measure again.",
    ),
    Owner.WORKPIECE: Family(
        "part", "", "it belongs to this part, not to the machine: let the part cool, measure again."
    ),
}
"""By what a cause belongs to, where it is not the machine's."""
EITHER = Family(
    "instrument or machine",
    "",
    "the measurement does not say which it is. Measure the length of instrument or artefact, or "
    "how warm it and the machine were (1 K is about 11 ppm of steel); or measure one axis with "
    "another instrument and have both measurements diagnosed together. Correct nothing before.",
)
"""Of what may as well be a machine that is uniformly warm."""
HAPPENED = {
    Happened.CHANGED: Family(
        "change",
        "",
        "it is another than before: look for what happened to the machine in between (a crash, "
        "work on it, another temperature); then correct it by its value of now.",
    ),
    Happened.ENDED: Family(
        "end",
        "",
        "it is gone: nothing is to be done if it was mended or compensated in between; else look "
        "for what else changed.",
    ),
    Happened.ONCE: Family(
        "once",
        "",
        "it was another in this measurement alone and was as before in the next: look for what was "
        "otherwise that day (temperature, clamping, what was done to the machine); correct it by "
        "its value in the others.",
    ),
    Happened.DIFFERS: Family(
        "contradiction",
        "",
        "the measurements contradict each other, or the machine was changed between them (a "
        "crash, work on it): compare signs, units, temperatures and certificates of the one that "
        "differs with the others, measure it again, and correct nothing before.",
    ),
}
"""By what happened to a cause in one of several measurements."""
_OF_AXIS = re.compile(r"(\w+)_of_[abcxyz]")


def family_of(id_: str, owner: Owner = Owner.MACHINE, instead: str = "") -> Family:
    """Return the family of a cause, of one measurement or of several.

    instead: What the measurement does not distinguish from it (`Cause.instead`).
    """
    if instead:
        return EITHER
    of = JointId.of(id_)
    if owner in OWNED and not any(re.fullmatch(f.ids, of.cause) for f in (OF_BREAK, OF_CYCLES)):
        return OWNED[owner]
    return _named(of.cause) if of.happened is None else HAPPENED[of.happened]


def _named(cause: str) -> Family:
    """Return the family of an id; of several measurements a cause of one axis has that behind."""
    of_axis = _OF_AXIS.fullmatch(cause)
    ids = (cause, of_axis[1]) if of_axis else (cause,)
    return next((f for i in ids for f in FAMILIES if re.fullmatch(f.ids, i)), OTHER)


def meaning(id_: str, parameters: Mapping[str, float], travel_mm: float | None = None) -> str:
    """Say what size and sign of a cause of the machine mean; empty where that needs the readings.

    Parameters
    ----------
    id_, parameters
        The cause with its values.
    travel_mm
        Travel that was measured, where one is known.
    """
    of = JointId.of(id_)
    family = _named(of.cause)
    unit = unit_of(next(iter(parameters), ""))
    values = [v for name, v in parameters.items() if unit_of(name) == unit]  # others shape its law
    words = ""
    if family.plus and len(values) == 1 and of.happened is None:
        match = re.fullmatch(family.ids, of.cause)
        axes = {k: v.upper() for k, v in (match.groupdict() if match else {}).items()}
        words = (family.plus if values[0] > 0 else family.minus).format(**axes)
    ratio = {"ppm": 1e-6, "arcsec": ARCSEC}.get(unit)
    if not family.over or ratio is None:
        return words
    if family.over == "radius":
        radial = float(np.hypot.reduce(values)) * ratio * RADIUS_MM * 1e3
        return f"{rough(radial)} µm at a radius of {RADIUS_MM:g} mm"
    length = travel_mm or LENGTH_MM
    size = f"{rough(abs(values[0]) * ratio * length * 1e3)} µm over {length:.3g} mm"
    return f"{words}: {size}" if words else size
